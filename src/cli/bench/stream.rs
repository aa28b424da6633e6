//! `throng bench stream`: frames a second where the next frame is recorded while the device works on those before.

use std::path::Path;

use anyhow::Result;
use serde::Serialize;
use throng::gpu::{Headless, HeadlessDesc};
use throng::{Agent, FrameOptions, View};

use super::plot::{Bar, bars};
use super::{Arguments, Name};
use crate::cli::measure::{FrameTime, MethodName};
use crate::cli::output::{Progress, Table, grouped};

/// What is compared.
const IN_FLIGHT: [usize; 3] = [1, 2, 3];
/// Frames of a round, in which each of them has a turn.
const ROUND: usize = 10;

#[derive(Serialize)]
struct Results {
    experiment: Name,
    device: String,
    driver: String,
    scene: String,
    agents: usize,
    size_px: [u32; 2],
    pixel_error_px: f32,
    rows: Vec<Row>,
}

#[derive(Serialize)]
struct Row {
    method: &'static str,
    in_flight: usize,
    /// From the end of a frame to that of the next.
    frame_ms: FrameTime,
    frame_ms_each: Vec<f64>,
}

/// Runs the experiment.
pub fn run(arguments: &Arguments) -> Result<()> {
    let progress = Progress::default();
    let mut shot = arguments.shot("street", true, &progress)?;
    arguments.set_agents(&mut shot);
    let methods = match &arguments.methods[..] {
        [] => &[MethodName::Hybrid][..],
        given => given,
    };
    let size_px = arguments.size.0;
    let mut headless = Headless::new(&HeadlessDesc {
        device: arguments.device.clone(),
        size_px,
        frames_in_flight: IN_FLIGHT[IN_FLIGHT.len() - 1] as u32,
        ..HeadlessDesc::default()
    })?;
    for character in &shot.characters {
        headless.add_character(character)?;
    }
    let moment = |frame: usize| -> (Vec<Agent>, View) {
        let time = frame as f32 / shot.scene.frames_per_second;
        (shot.agents(time), shot.view(time, size_px))
    };
    let rounds = arguments.runs().div_ceil(ROUND);
    let bar = progress.bar(
        "Measuring",
        (rounds * IN_FLIGHT.len() * methods.len()) as u64,
    );
    let mut rows = Vec::new();
    for &method in methods {
        let options = FrameOptions {
            method: method.to_method(),
            pixel_error: arguments.pixel_error,
            ..shot.frame_options()
        };
        let mut each = vec![Vec::new(); IN_FLIGHT.len()];
        for round in 0..=rounds {
            // The first frames fill what is in flight.
            let first = round * ROUND;
            let longest = ROUND + IN_FLIGHT[IN_FLIGHT.len() - 1];
            let frames: Vec<_> = (first..first + longest).map(moment).collect();
            for (&in_flight, each) in IN_FLIGHT.iter().zip(&mut each) {
                let ms = headless.stream(&frames[..ROUND + in_flight], &options, in_flight)?;
                // The first round warms up.
                if round > 0 {
                    each.extend(&ms[in_flight..]);
                    bar.inc(1);
                }
            }
        }
        rows.extend(
            IN_FLIGHT
                .into_iter()
                .zip(each)
                .map(|(in_flight, each)| Row {
                    method: method.name(),
                    in_flight,
                    frame_ms: FrameTime::new(&each),
                    frame_ms_each: each,
                }),
        );
    }
    bar.finish_and_clear();
    let results = Results {
        experiment: arguments.name,
        device: headless.device_name().into(),
        driver: headless.driver().into(),
        scene: arguments.scene_name("street").into(),
        agents: shot.scene.agent_count(),
        size_px,
        pixel_error_px: arguments.pixel_error,
        rows,
    };
    arguments.hand_out(&results, |path| results.plot(path))
}

impl Results {
    fn plot(&self, path: &Path) -> Result<()> {
        let bar = |row: &Row| Bar {
            name: format!("{}, {} in flight", row.method, row.in_flight),
            value: row.frame_ms.median,
            whisker: [row.frame_ms.min, row.frame_ms.p95],
        };
        let all: Vec<Bar> = self.rows.iter().map(bar).collect();
        bars(path, &self.scene, "milliseconds from frame to frame", &all)
    }
}

impl std::fmt::Display for Results {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [width, height] = self.size_px;
        writeln!(
            f,
            "{}, {}; scene {}, {width} x {height}, {} px of error\n",
            self.device, self.driver, self.scene, self.pixel_error_px
        )?;
        let mut table = Table::new([
            "agents",
            "method",
            "frames in flight",
            "runs",
            "ms median",
            "p95",
            "min",
            "spread",
            "frames a second",
        ]);
        for row in &self.rows {
            let t = &row.frame_ms;
            table.row([
                grouped(self.agents as u64),
                row.method.into(),
                row.in_flight.to_string(),
                t.runs.to_string(),
                format!("{:.1}", t.median),
                format!("{:.1}", t.p95),
                format!("{:.1}", t.min),
                format!("{:.0} %", t.spread * 100.0),
                format!("{:.1}", 1e3 / t.median.max(1e-9)),
            ]);
        }
        write!(f, "{table}")
    }
}
