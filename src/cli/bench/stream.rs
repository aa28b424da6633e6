//! `throng bench stream`: frames a second where the next frame is recorded while the device works on those before.

use std::path::Path;

use anyhow::Result;
use serde::Serialize;
use throng::{Agent, FrameOptions, View};

use super::plot::{Bar, bars};
use super::{Arguments, Name, Setup};
use crate::cli::measure::{FrameTime, MethodName, Studio};
use crate::cli::output::{Progress, Table, grouped};

const SCENE: &str = "street";
/// What is compared.
const IN_FLIGHT: [usize; 3] = [1, 2, 3];
/// Frames of a round, in which each of them has a turn.
const ROUND: usize = 10;

#[derive(Serialize)]
struct Results {
    experiment: Name,
    setup: Setup,
    agents: usize,
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
    let methods = arguments.methods(&[], &[MethodName::Hybrid])?;
    let mut shot = arguments.shot(SCENE, true, &progress)?;
    arguments.set_agents(&mut shot);
    let size_px = arguments.size.0;
    let most = IN_FLIGHT[IN_FLIGHT.len() - 1];
    let mut studio = Studio::open(&shot, arguments.device.as_deref(), size_px, most as u32)?;
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
    for method in methods {
        let options = FrameOptions {
            method: method.to_method(),
            pixel_error: arguments.pixel_error,
            ..shot.frame_options()
        };
        let mut each = vec![Vec::new(); IN_FLIGHT.len()];
        for round in 0..=rounds {
            // The first frames fill what is in flight.
            let first = round * ROUND;
            let longest = ROUND + most;
            let frames: Vec<_> = (first..first + longest).map(moment).collect();
            for (&in_flight, each) in IN_FLIGHT.iter().zip(&mut each) {
                let ms = studio.stream(&frames[..ROUND + in_flight], &options, in_flight)?;
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
        setup: Setup::new(arguments, SCENE, &shot, &studio),
        agents: shot.scene.agent_count(),
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
        bars(
            path,
            &self.setup.scene,
            "milliseconds from frame to frame",
            &all,
        )
    }
}

impl std::fmt::Display for Results {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "{}\n", self.setup)?;
        let what = ["agents", "method", "frames in flight"];
        let heads = [&what[..], &FrameTime::HEADS, &["frames a second"]];
        let mut table = Table::with_heads(heads.concat());
        for row in &self.rows {
            let what = [
                grouped(self.agents as u64),
                row.method.into(),
                row.in_flight.to_string(),
            ];
            let rate = format!("{:.1}", 1e3 / row.frame_ms.median.max(1e-9));
            table.push([&what[..], &row.frame_ms.cells(), &[rate]].concat());
        }
        write!(f, "{table}")
    }
}
