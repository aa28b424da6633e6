//! Drawing a shot and measuring what it costs.

use std::time::Instant;

use anyhow::{Result, ensure};
use serde::Serialize;
use throng::gpu::{Frozen, Headless, HeadlessDesc};
use throng::{Agent, FrameOptions, FrameReport, Method, Representation, StageTime, View};
use throng_bake::baked::Baked;
use throng_bake::impostor::Kind;

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

    /// The kind of impostors that it draws everybody as.
    pub fn impostor_kind(self) -> Option<Kind> {
        match self {
            Self::Flat => Some(Kind::Flat),
            Self::Quad => Some(Kind::Quad),
            _ => None,
        }
    }

    /// As the command line and reports call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Hybrid => "hybrid",
            Self::Lod => "lod",
            Self::Flat => "flat",
            Self::Quad => "quad",
            Self::Full => "full",
            Self::Uninstanced => "uninstanced",
        }
    }

    /// As the library calls it.
    pub fn to_method(self) -> Method {
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
    pub min: f64,
    /// From the first to the third quartile, as a share of the median: how much frames differ.
    pub spread: f64,
    pub runs: usize,
}

impl FrameTime {
    /// The columns of a table that [`FrameTime::cells`] fills.
    pub const HEADS: [&str; 5] = ["runs", "ms median", "p95", "min", "spread"];

    /// A row's part under [`FrameTime::HEADS`].
    pub fn cells(&self) -> [String; 5] {
        [
            self.runs.to_string(),
            format!("{:.1}", self.median),
            format!("{:.1}", self.p95),
            format!("{:.1}", self.min),
            format!("{:.0} %", 100.0 * self.spread),
        ]
    }

    /// Of every frame's time; zeros where there is none.
    pub fn new(each: &[f64]) -> Self {
        let (median, p95) = median_p95(each);
        let mut sorted = each.to_vec();
        sorted.sort_by(f64::total_cmp);
        let quartile = |n: usize| sorted.get(sorted.len() * n / 4).copied().unwrap_or(0.0);
        Self {
            median,
            p95,
            min: sorted.first().copied().unwrap_or(0.0),
            spread: (quartile(3) - quartile(1)) / median.max(1e-9),
            runs: each.len(),
        }
    }
}

/// A frame that was timed.
#[derive(Debug, Clone)]
pub struct Sample {
    /// From handing over the agents to the finished picture.
    pub wall_ms: f64,
    /// Of all threads of the process; absent where the system does not tell.
    pub cpu_ms: Option<f64>,
    pub frame: FrameReport,
}

/// What `draw` takes of wall time and of the process's CPU time.
fn timed(draw: impl FnOnce() -> Result<FrameReport>) -> Result<Sample> {
    let (start, cpu_start) = (Instant::now(), cpu_seconds());
    let frame = draw()?;
    let wall_ms = start.elapsed().as_secs_f64() * 1e3;
    let cpu_ms = match (cpu_start, cpu_seconds()) {
        (Some(start), Some(end)) => Some((end - start) * 1e3),
        _ => None,
    };
    Ok(Sample {
        wall_ms,
        cpu_ms,
        frame,
    })
}

/// CPU time that all threads of the process have spent.
fn cpu_seconds() -> Option<f64> {
    #[cfg(unix)]
    {
        let t = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
        Some(t.tv_sec as f64 + t.tv_nsec as f64 * 1e-9)
    }
    #[cfg(not(unix))]
    None
}

/// What drawing a frame took and did.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    pub device: String,
    pub driver: String,
    pub method: &'static str,
    pub animated: bool,
    /// Of the picture that was drawn, before it was averaged down.
    pub size_px: [u32; 2],
    pub supersample: u32,
    pub pixel_error_px: f32,
    pub time_s: f32,
    pub agents: u64,
    pub visible: u64,
    pub culled: u64,
    pub occluded: u64,
    /// Agents drawn as depth first, to hide others.
    pub occluders: u64,
    pub draw_calls: u64,
    pub instances: u64,
    pub triangles: u64,
    /// Not among the triangles.
    pub occluder_triangles: u64,
    pub live_vertices: u64,
    /// Absent where the device does not count them.
    pub vertex_invocations: Option<u64>,
    /// From handing over the agents to the finished picture.
    pub frame_ms: FrameTime,
    /// Of all threads of the process in the same time; absent where the system does not tell.
    pub cpu_ms: Option<FrameTime>,
    pub fps: f64,
    /// Medians.
    pub stage_ms: Vec<StageTime>,
    pub representations: Vec<Representation>,
}

/// How frames were drawn, for their report.
#[derive(Debug, Clone, Copy)]
pub struct Timing {
    pub method: &'static str,
    pub animated: bool,
    pub size_px: [u32; 2],
    pub supersample: u32,
    pub pixel_error: f32,
    pub time_s: f32,
}

impl Report {
    /// Counts are those of the last frame, times those of all.
    pub fn new(timing: &Timing, samples: &[Sample]) -> Self {
        let last = samples.last().map(|s| s.frame.clone()).unwrap_or_default();
        let wall: Vec<f64> = samples.iter().map(|s| s.wall_ms).collect();
        let cpu: Vec<f64> = samples.iter().filter_map(|s| s.cpu_ms).collect();
        let stage_ms = last.stage_ms.iter().enumerate().map(|(i, stage)| {
            let each = samples.iter().filter_map(|s| s.frame.stage_ms.get(i));
            let each: Vec<f64> = each.map(|s| s.ms).collect();
            StageTime {
                stage: stage.stage,
                ms: median_p95(&each).0,
            }
        });
        let frame_ms = FrameTime::new(&wall);
        Self {
            stage_ms: stage_ms.collect(),
            device: last.device,
            driver: last.driver,
            method: timing.method,
            animated: timing.animated,
            size_px: timing.size_px,
            supersample: timing.supersample,
            pixel_error_px: timing.pixel_error,
            time_s: timing.time_s,
            agents: last.agents,
            visible: last.visible,
            culled: last.culled,
            occluded: last.occluded,
            occluders: last.occluders,
            draw_calls: last.draw_calls,
            instances: last.instances,
            triangles: last.triangles,
            occluder_triangles: last.occluder_triangles,
            live_vertices: last.live_vertices,
            vertex_invocations: last.vertex_invocations,
            frame_ms,
            cpu_ms: (!cpu.is_empty()).then(|| FrameTime::new(&cpu)),
            fps: if frame_ms.median > 0.0 {
                1e3 / frame_ms.median
            } else {
                0.0
            },
            representations: last.representations,
        }
    }
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
        Self::open(shot, device, size_px, 1)
    }

    /// The same for [`Studio::stream`] with up to that many frames in flight.
    pub fn open(
        shot: &Shot,
        device: Option<&str>,
        size_px: [u32; 2],
        frames_in_flight: u32,
    ) -> Result<Self> {
        let mut headless = Headless::new(&HeadlessDesc {
            device: device.map(str::to_string),
            size_px,
            frames_in_flight,
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
        let samples: Result<Vec<Sample>> = (0..drawing.runs.max(1))
            .map(|_| self.frame(&agents, &view, &options))
            .collect();
        let timing = Timing {
            method: drawing.method.name(),
            animated: drawing.animated,
            size_px: self.size_px,
            supersample: drawing.supersample,
            pixel_error: drawing.pixel_error,
            time_s: drawing.time,
        };
        Ok(Report::new(&timing, &samples?))
    }

    /// Draws one frame and times it.
    pub fn frame(
        &mut self,
        agents: &[Agent],
        view: &View,
        options: &FrameOptions,
    ) -> Result<Sample> {
        timed(|| Ok(self.headless.render(agents, view, options)?))
    }

    /// As [`Headless::stream`].
    pub fn stream(
        &mut self,
        frames: &[(Vec<Agent>, View)],
        options: &FrameOptions,
        in_flight: usize,
    ) -> Result<Vec<f64>> {
        Ok(self.headless.stream(frames, options, in_flight)?)
    }

    /// Draws one frame and keeps its triangles and quads, transformed. `characters` are the shot's.
    pub fn freeze(
        &mut self,
        agents: &[Agent],
        view: &View,
        options: &FrameOptions,
        characters: &[Baked],
    ) -> Result<Frozen> {
        Ok(self.headless.freeze(agents, view, options, characters)?)
    }

    /// Draws what was kept and times it.
    pub fn frozen_frame(&mut self, frozen: &Frozen, flat: bool) -> Result<Sample> {
        timed(|| Ok(self.headless.render_frozen(frozen, flat)?))
    }

    /// Frees what was kept.
    pub fn release(&mut self, frozen: Frozen) {
        self.headless.release(frozen);
    }

    /// The device's name.
    pub fn device_name(&self) -> &str {
        self.headless.device_name()
    }

    /// The driver's name and version.
    pub fn driver(&self) -> &str {
        self.headless.driver()
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
        row("occluded", grouped(self.occluded));
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
