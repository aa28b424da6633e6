//! How everything is measured: what is compared takes turns, frame by frame, on successive frames of the scene.

use anyhow::Result;
use indicatif::ProgressBar;
use serde::Serialize;
use throng::gpu::Frozen;
use throng::{Agent, FrameOptions, View};

use crate::cli::measure::{MethodName, Report, Sample, Studio, Timing};
use crate::cli::shot::Shot;

/// Frames that warm one contender up: at least, and at most.
const WARM_UP_FRAMES: [usize; 2] = [2, 8];
/// A frame that takes more than this share of the one before it is no faster: nothing was compiled.
const STEADY: f64 = 0.8;
/// Seconds that one contender's timed frames may take; it is drawn less often where they would take longer ...
const BUDGET_S: f64 = 30.0;
/// ... but this often at least.
const RUNS_MIN: usize = 3;

/// Something that draws the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Contender {
    /// A method, with animation or without.
    Method(MethodName, bool),
    /// The triangles and quads of another contender's frame, already transformed: [`limit_of`].
    Limit,
    /// As `Limit`, in a flat colour.
    Floor,
}

impl Contender {
    /// What tables and reports call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Method(method, true) => method.name(),
            Self::Method(MethodName::Lod, false) => "lod, no animation",
            Self::Method(_, false) => "no animation",
            Self::Limit => "limit",
            Self::Floor => "floor",
        }
    }
}

/// The method whose triangles and quads `limit` and `floor` draw: the hybrid where it is compared, else the first.
pub fn limit_of(contenders: &[Contender]) -> MethodName {
    let methods = || {
        contenders.iter().filter_map(|c| match c {
            Contender::Method(method, _) => Some(*method),
            _ => None,
        })
    };
    let hybrid = MethodName::Hybrid;
    if methods().any(|m| m == hybrid) {
        return hybrid;
    }
    methods().next().unwrap_or(hybrid)
}

/// What one contender's frames cost and did.
#[derive(Debug, Clone, Serialize)]
pub struct Entry {
    /// The last frame's counts, and times over all frames.
    #[serde(flatten)]
    pub report: Report,
    /// Frames drawn before any was timed.
    pub warm_up_frames: usize,
    /// Every frame's wall time, in order.
    pub frame_ms_each: Vec<f64>,
    /// Every frame's CPU time; empty where the system does not tell.
    pub cpu_ms_each: Vec<f64>,
    /// What could not be measured, and why.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

/// Draws every contender up to `runs` times. An entry without frames says why it has none.
///
/// The frames of `limit` and `floor` show the scene in the middle of the measured time.
pub fn measure(
    shot: &Shot,
    studio: &mut Studio,
    contenders: &[Contender],
    pixel_error: f32,
    runs: usize,
    bar: &ProgressBar,
) -> Result<Vec<Entry>> {
    let scene = Scene {
        shot,
        pixel_error,
        size_px: studio.size_px(),
    };
    let mut tracks: Vec<Track> = contenders.iter().map(|&c| Track::new(c)).collect();
    let mut frozen = None;
    if contenders
        .iter()
        .any(|c| matches!(c, Contender::Limit | Contender::Floor))
    {
        bar.set_message("transforming what limit and floor draw");
        match scene.freeze(studio, contenders, runs / 2) {
            Ok(f) => frozen = Some(f),
            Err(e) => {
                for track in &mut tracks {
                    track.note = match track.contender {
                        Contender::Method(..) => None,
                        _ => Some(format!("not measured: {e}")),
                    };
                }
            }
        }
    }
    let start = scene.moment(0);
    for track in tracks.iter_mut().filter(|t| t.note.is_none()) {
        bar.set_message(format!("warming up {}", track.contender.name()));
        track.warm_up(&start, studio, frozen.as_ref(), runs)?;
    }
    for turn in 0..runs {
        let moment = scene.moment(turn);
        for track in tracks.iter_mut().filter(|t| t.is_due(turn, runs)) {
            bar.set_message(track.contender.name());
            let sample = moment.draw(track.contender, studio, frozen.as_ref())?;
            track.samples.push(sample);
        }
        bar.inc(1);
    }
    if let Some(frozen) = frozen {
        studio.release(frozen);
    }
    let size_px = studio.size_px();
    Ok(tracks
        .into_iter()
        .map(|t| t.finish(&scene, size_px, runs))
        .collect())
}

/// What is drawn, and how well.
struct Scene<'a> {
    shot: &'a Shot,
    pixel_error: f32,
    size_px: [u32; 2],
}

/// The scene at one time.
struct Moment {
    agents: Vec<Agent>,
    view: View,
    options: FrameOptions,
}

impl Scene<'_> {
    /// Frame `frame` of the scene.
    fn moment(&self, frame: usize) -> Moment {
        let time = self.time(frame);
        Moment {
            agents: self.shot.agents(time),
            view: self.shot.view(time, self.size_px),
            options: FrameOptions {
                pixel_error: self.pixel_error,
                ..self.shot.frame_options()
            },
        }
    }

    fn time(&self, frame: usize) -> f32 {
        frame as f32 / self.shot.scene.frames_per_second
    }

    /// Draws a frame and keeps its triangles and quads.
    fn freeze(
        &self,
        studio: &mut Studio,
        contenders: &[Contender],
        frame: usize,
    ) -> Result<Frozen> {
        let moment = self.moment(frame);
        let options = FrameOptions {
            method: limit_of(contenders).to_method(),
            ..moment.options
        };
        studio.freeze(
            &moment.agents,
            &moment.view,
            &options,
            &self.shot.characters,
        )
    }
}

impl Moment {
    fn draw(
        &self,
        contender: Contender,
        studio: &mut Studio,
        frozen: Option<&Frozen>,
    ) -> Result<Sample> {
        match (contender, frozen) {
            (Contender::Method(method, animate), _) => {
                let options = FrameOptions {
                    method: method.to_method(),
                    animate,
                    ..self.options
                };
                studio.frame(&self.agents, &self.view, &options)
            }
            (_, Some(frozen)) => studio.frozen_frame(frozen, contender == Contender::Floor),
            (_, None) => anyhow::bail!("{}: no frame was kept for it", contender.name()),
        }
    }
}

/// One contender while it is measured.
struct Track {
    contender: Contender,
    warm_up_frames: usize,
    /// How many timed frames it gets.
    runs: usize,
    samples: Vec<Sample>,
    note: Option<String>,
}

impl Track {
    fn new(contender: Contender) -> Self {
        Self {
            contender,
            warm_up_frames: 0,
            runs: 0,
            samples: Vec::new(),
            note: None,
        }
    }

    fn warm_up(
        &mut self,
        start: &Moment,
        studio: &mut Studio,
        frozen: Option<&Frozen>,
        runs: usize,
    ) -> Result<()> {
        let mut before_ms = f64::INFINITY;
        let [at_least, at_most] = WARM_UP_FRAMES;
        // One frame only is asked for where nobody looks at the time.
        let at_most = if runs > 1 { at_most } else { 1 };
        while self.warm_up_frames < at_most {
            let ms = start.draw(self.contender, studio, frozen)?.wall_ms;
            self.warm_up_frames += 1;
            let is_steady = self.warm_up_frames >= at_least && ms > STEADY * before_ms;
            before_ms = ms;
            if is_steady || ms > BUDGET_S * 1e3 / RUNS_MIN as f64 {
                break;
            }
        }
        let affordable = (BUDGET_S * 1e3 / before_ms.max(1e-3)) as usize;
        self.runs = runs.min(affordable.max(RUNS_MIN));
        Ok(())
    }

    /// Its frames are spread evenly over all turns.
    fn is_due(&self, turn: usize, turns: usize) -> bool {
        (turn + 1) * self.runs / turns > turn * self.runs / turns
    }

    fn finish(self, scene: &Scene, size_px: [u32; 2], runs: usize) -> Entry {
        let each = |of: &dyn Fn(&Sample) -> Option<f64>| -> Vec<f64> {
            self.samples.iter().filter_map(of).collect()
        };
        let frame_ms_each = each(&|s| Some(s.wall_ms));
        let cpu_ms_each = each(&|s| s.cpu_ms);
        let timing = Timing {
            method: self.contender.name(),
            animated: !matches!(self.contender, Contender::Method(_, false)),
            size_px,
            supersample: 1,
            pixel_error: scene.pixel_error,
            time_s: scene.time(runs.saturating_sub(1)),
        };
        Entry {
            report: Report::new(&timing, &self.samples),
            warm_up_frames: self.warm_up_frames,
            frame_ms_each,
            cpu_ms_each,
            note: self.note,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A slow contender's turns are as many as it has runs, and lie apart.
    #[test]
    fn slow_contenders_are_spread_over_all_turns() {
        for (runs, turns) in [(30, 30), (3, 30), (7, 30), (1, 1), (0, 5)] {
            let mut track = Track::new(Contender::Floor);
            track.runs = runs;
            let due: Vec<usize> = (0..turns).filter(|&t| track.is_due(t, turns)).collect();
            assert_eq!(due.len(), runs, "{runs} of {turns}");
            for pair in due.windows(2) {
                assert!(pair[1] - pair[0] >= turns / runs);
            }
        }
    }
}
