//! Drawing a shot and measuring what it costs.

use std::time::Instant;

use anyhow::{Result, ensure};
use serde::Serialize;
use throng::gpu::{Headless, HeadlessDesc};
use throng::{FrameOptions, FrameReport, Method, Representation, StageTime};

use super::output::{grouped, median_p95};
use super::shot::Shot;

/// Frames drawn before any is timed: drivers compile shaders at the first draws.
pub const WARM_UP_FRAMES: usize = 2;

/// How the crowd is drawn, as the command line names it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum MethodName {
    /// By projected height the cheapest representation whose error is allowed: meshes near, impostors far
    Hybrid,
    /// Meshes only: continuous levels of detail, one instanced draw per submesh
    Lod,
    /// Impostors with a quad per group of joints, for every character that has them
    Flat,
    /// Impostors of one quad, for every character that has them
    Quad,
    /// The same instanced draws, everybody at full detail
    Full,
    /// Full detail, and one draw per agent and submesh
    Uninstanced,
}

impl MethodName {
    /// Characters that are baked for it need impostors.
    pub fn uses_impostors(self) -> bool {
        matches!(self, Self::Hybrid | Self::Flat | Self::Quad)
    }

    fn to_method(self) -> Method {
        match self {
            Self::Hybrid => Method::Hybrid,
            Self::Lod => Method::Lod,
            Self::Flat => Method::Flat,
            Self::Quad => Method::Quad,
            Self::Full => Method::Full,
            Self::Uninstanced => Method::Uninstanced,
        }
    }
}

/// Milliseconds of a number of frames.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct FrameTime {
    pub median: f64,
    pub p95: f64,
    pub runs: usize,
}

/// What drawing a frame took and did.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    pub device: String,
    pub driver: String,
    pub method: MethodName,
    pub animated: bool,
    /// Of the picture that was drawn, before it was averaged down.
    pub size_px: [u32; 2],
    pub supersample: u32,
    pub pixel_error_px: f32,
    pub time_s: f32,
    pub agents: u64,
    pub visible: u64,
    pub culled: u64,
    pub draw_calls: u64,
    pub instances: u64,
    pub triangles: u64,
    pub live_vertices: u64,
    /// Absent where the device does not count them.
    pub vertex_invocations: Option<u64>,
    /// From handing over the agents to the finished picture.
    pub frame_ms: FrameTime,
    pub fps: f64,
    /// Medians.
    pub stage_ms: Vec<StageTime>,
    pub representations: Vec<Representation>,
}

/// What is to be drawn.
#[derive(Debug, Clone, Copy)]
pub struct Drawing {
    pub method: MethodName,
    pub pixel_error: f32,
    pub supersample: u32,
    pub animated: bool,
    pub time: f32,
    /// Frames timed, at least 1; from 2 on, frames that warm up come before them.
    pub runs: usize,
}

/// A device that has the characters of a shot.
pub struct Studio {
    headless: Headless,
    size_px: [u32; 2],
}

impl Studio {
    /// Opens the device and uploads the shot's characters. `size_px` is that of the picture.
    pub fn new(
        shot: &Shot,
        device: Option<&str>,
        size_px: [u32; 2],
        supersample: u32,
    ) -> Result<Self> {
        let size_px = size_px.map(|x| x.saturating_mul(supersample));
        let mut headless = Headless::new(&HeadlessDesc {
            device: device.map(str::to_string),
            size_px,
            ..HeadlessDesc::default()
        })?;
        for (i, character) in shot.characters.iter().enumerate() {
            let id = headless.add_character(character)?;
            ensure!(id.0 as usize == i, "characters are numbered out of order");
        }
        Ok(Self { headless, size_px })
    }

    /// Draws a frame as often as asked, the last of which [`Studio::pixels`] returns.
    pub fn draw(&mut self, shot: &Shot, drawing: &Drawing) -> Result<Report> {
        let agents = shot.agents(drawing.time);
        let view = shot.view(drawing.time, self.size_px);
        let options = FrameOptions {
            method: drawing.method.to_method(),
            // An error is as large in the picture that is kept, however many samples its pixels have.
            pixel_error: drawing.pixel_error * drawing.supersample as f32,
            animate: drawing.animated,
            ..shot.frame_options()
        };
        if drawing.runs > 1 {
            for _ in 0..WARM_UP_FRAMES {
                self.headless.render(&agents, &view, &options)?;
            }
        }
        let mut frame_ms = Vec::with_capacity(drawing.runs);
        let mut frames: Vec<FrameReport> = Vec::with_capacity(drawing.runs);
        for _ in 0..drawing.runs.max(1) {
            let start = Instant::now();
            frames.push(self.headless.render(&agents, &view, &options)?);
            frame_ms.push(start.elapsed().as_secs_f64() * 1e3);
        }
        Ok(self.report(drawing, &frame_ms, &frames))
    }

    fn report(&self, drawing: &Drawing, frame_ms: &[f64], frames: &[FrameReport]) -> Report {
        let last = frames.last().cloned().unwrap_or_default();
        let (median, p95) = median_p95(frame_ms);
        let stage_ms = last.stage_ms.iter().enumerate().map(|(i, stage)| {
            let each: Vec<f64> = frames
                .iter()
                .filter_map(|f| f.stage_ms.get(i))
                .map(|s| s.ms)
                .collect();
            StageTime {
                stage: stage.stage,
                ms: median_p95(&each).0,
            }
        });
        Report {
            stage_ms: stage_ms.collect(),
            device: last.device,
            driver: last.driver,
            method: drawing.method,
            animated: drawing.animated,
            size_px: self.size_px,
            supersample: drawing.supersample,
            pixel_error_px: drawing.pixel_error,
            time_s: drawing.time,
            agents: last.agents,
            visible: last.visible,
            culled: last.culled,
            draw_calls: last.draw_calls,
            instances: last.instances,
            triangles: last.triangles,
            live_vertices: last.live_vertices,
            vertex_invocations: last.vertex_invocations,
            frame_ms: FrameTime {
                median,
                p95,
                runs: frame_ms.len(),
            },
            fps: if median > 0.0 { 1e3 / median } else { 0.0 },
            representations: last.representations,
        }
    }

    /// The last picture, as drawn.
    pub fn pixels(&mut self) -> Result<Vec<[u8; 4]>> {
        Ok(self.headless.read_image()?)
    }

    /// Size of the pictures, as drawn.
    pub fn size_px(&self) -> [u32; 2] {
        self.size_px
    }
}

impl std::fmt::Display for Report {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [width, height] = self.size_px.map(|x| x / self.supersample);
        let mut rows = Vec::new();
        let mut row = |name: &str, value: String| rows.push((name.to_string(), value));
        row("device", self.device.clone());
        row("driver", self.driver.clone());
        row("picture", format!("{width} x {height}"));
        row("agents", grouped(self.agents));
        row("visible", grouped(self.visible));
        row("draw calls", grouped(self.draw_calls));
        row("triangles", grouped(self.triangles));
        row(
            "vertex-shader runs",
            self.vertex_invocations
                .map_or("not counted here".into(), grouped),
        );
        for s in &self.stage_ms {
            row(&format!("{} ms", s.stage), format!("{:.2}", s.ms));
        }
        row(
            "frame ms (median, p95)",
            format!("{:.2}, {:.2}", self.frame_ms.median, self.frame_ms.p95),
        );
        row("frames per second", format!("{:.1}", self.fps));
        rows.iter()
            .try_for_each(|(name, value)| writeln!(f, "  {name:22}  {value}"))
    }
}
