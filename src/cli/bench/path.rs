//! `throng bench path`: how near pictures along a camera's path are to the many-sampled ones, and whether anything pops.

use std::path::Path;

use anyhow::Result;
use serde::Serialize;
use throng::Representation;

use super::flip::{Comparer, SUPERSAMPLE};
use super::plot::{Curve, linear_curves};
use super::{Arguments, Name, Setup};
use crate::cli::measure::{Drawing, MethodName, Studio};
use crate::cli::output::{Progress, Table, grouped};
use crate::cli::picture::{average, write_png};

const SCENE: &str = "plaza";
/// What all others are compared with: the same pictures without any simplification.
const BASIS: MethodName = MethodName::Full;
/// What is compared where nothing is named.
const METHODS: [MethodName; 2] = [MethodName::Lod, MethodName::Hybrid];

#[derive(Serialize)]
struct Results {
    experiment: Name,
    setup: PathSetup,
    /// The basis first.
    methods: Vec<Compared>,
    /// Change of the reference from frame to frame: what the camera and the agents do.
    reference_change: Vec<f64>,
}

#[derive(Serialize)]
struct PathSetup {
    #[serde(flatten)]
    setup: Setup,
    camera: String,
    agents: u64,
    /// Samples along each side of a pixel of the reference.
    supersample: u32,
    frames_per_second: f32,
    frames: usize,
}

/// A method's pictures, by frame. Changes begin with the second frame.
#[derive(Serialize)]
struct Compared {
    method: &'static str,
    /// Mean FLIP error against the reference.
    flip: Vec<f64>,
    /// Mean absolute difference to the picture before, encoded colours, 1 from black to white.
    change: Vec<f64>,
    /// The same of the difference to the reference.
    flicker: Vec<f64>,
    /// Agents by what draws them.
    representations: Vec<Vec<Representation>>,
    /// As multiples of the basis.
    to_full: ToFull,
}

#[derive(Serialize)]
struct ToFull {
    flip: Ratio,
    change: Ratio,
    flicker: Ratio,
}

/// One series as a multiple of another.
#[derive(Serialize, Clone, Copy)]
struct Ratio {
    /// Of the means.
    mean: f64,
    /// The greatest of the frames' own.
    worst: f64,
    /// Its frame, counted from 0.
    worst_frame: usize,
}

impl Ratio {
    /// `first` is the frame of the series' beginning.
    fn new(series: &[f64], basis: &[f64], first: usize) -> Self {
        let ratio = |a: f64, b: f64| if b > 0.0 { a / b } else { 1.0 };
        let each = series.iter().zip(basis).map(|(&a, &b)| ratio(a, b));
        let worst = each.enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
        let (at, worst) = worst.unwrap_or((0, 1.0));
        Self {
            mean: ratio(mean(series), mean(basis)),
            worst,
            worst_frame: first + at,
        }
    }
}

fn mean(series: &[f64]) -> f64 {
    series.iter().sum::<f64>() / series.len().max(1) as f64
}

type Picture = Vec<[u8; 4]>;

/// A picture less another, encoded colours.
fn difference(picture: &Picture, other: &Picture) -> Vec<[i16; 3]> {
    let pairs = picture.iter().zip(other);
    pairs
        .map(|(a, b)| std::array::from_fn(|c| i16::from(a[c]) - i16::from(b[c])))
        .collect()
}

/// Mean size of the entries, as a share of the greatest value of a colour.
fn mean_size(differences: impl ExactSizeIterator<Item = [i16; 3]>) -> f64 {
    let count = 3 * differences.len().max(1);
    let sum: u64 = differences
        .flatten()
        .map(|x| u64::from(x.unsigned_abs()))
        .sum();
    sum as f64 / count as f64 / 255.0
}

/// A method's series while they grow.
struct Track {
    method: MethodName,
    flip: Vec<f64>,
    change: Vec<f64>,
    flicker: Vec<f64>,
    representations: Vec<Vec<Representation>>,
    /// The last picture, and how it differed from the reference.
    before: Option<(Picture, Vec<[i16; 3]>)>,
}

impl Track {
    fn new(method: MethodName) -> Self {
        Self {
            method,
            flip: Vec::new(),
            change: Vec::new(),
            flicker: Vec::new(),
            representations: Vec::new(),
            before: None,
        }
    }

    fn add(&mut self, picture: Picture, reference: &Picture) {
        let error = difference(&picture, reference);
        if let Some((picture_before, error_before)) = &self.before {
            self.change
                .push(mean_size(difference(&picture, picture_before).into_iter()));
            let pairs = error.iter().zip(error_before);
            self.flicker.push(mean_size(
                pairs.map(|(a, b)| std::array::from_fn(|c| a[c] - b[c])),
            ));
        }
        self.before = Some((picture, error));
    }

    fn finish(self, basis: [&[f64]; 3]) -> Compared {
        Compared {
            method: self.method.name(),
            to_full: ToFull {
                flip: Ratio::new(&self.flip, basis[0], 0),
                change: Ratio::new(&self.change, basis[1], 1),
                flicker: Ratio::new(&self.flicker, basis[2], 1),
            },
            flip: self.flip,
            change: self.change,
            flicker: self.flicker,
            representations: self.representations,
        }
    }
}

/// Runs the experiment.
pub fn run(arguments: &Arguments) -> Result<()> {
    let methods = arguments.methods(&[BASIS], &METHODS)?;
    let progress = Progress::default();
    let mut shot = arguments.shot(SCENE, true, &progress)?;
    arguments.set_agents(&mut shot);
    let (camera, duration_s) = shot.fly(arguments.camera.is_some())?;
    let fps = shot.scene.frames_per_second;
    let whole = (duration_s * fps).round() as usize;
    let frames = arguments.runs.unwrap_or(whole).max(1);
    let comparer = Comparer::new(arguments.pictures.as_deref())?;
    let supersample = arguments.supersample.unwrap_or(SUPERSAMPLE);
    let device = arguments.device.as_deref();
    let mut studio = Studio::new(&shot, device, arguments.size.0, 1)?;
    let mut large = Studio::new(&shot, device, arguments.size.0, supersample)?;
    let [width, height] = arguments.size.0;
    let drawing = |method, supersample, frame: usize| Drawing {
        method,
        pixel_error: arguments.pixel_error,
        supersample,
        animated: true,
        time: frame as f32 / fps,
        runs: 1,
    };

    let bar = progress.bar("Comparing", frames as u64);
    let mut tracks: Vec<Track> = methods.iter().map(|&m| Track::new(m)).collect();
    let mut reference = Track::new(BASIS);
    for frame in 0..frames {
        bar.set_message("reference");
        large.draw(&shot, &drawing(BASIS, supersample, frame))?;
        let picture = average(
            &large.pixels()?,
            width as usize,
            height as usize,
            supersample as usize,
        );
        let reference_path = comparer.path(&format!("reference_{frame:04}"));
        write_png(&reference_path, &picture, width, height)?;
        let mut paths = Vec::new();
        for track in &mut tracks {
            bar.set_message(track.method.name());
            let report = studio.draw(&shot, &drawing(track.method, 1, frame))?;
            track.representations.push(report.representations);
            let drawn = studio.pixels()?;
            let path = comparer.path(&format!("{}_{frame:04}", track.method.name()));
            write_png(&path, &drawn, width, height)?;
            paths.push(path);
            track.add(drawn, &picture);
        }
        bar.set_message("FLIP");
        let errors = comparer.errors(&reference_path, &paths)?;
        for (track, error) in tracks.iter_mut().zip(errors) {
            track.flip.push(error);
        }
        comparer.forget(&reference_path);
        paths.iter().for_each(|path| comparer.forget(path));
        reference.add(picture.clone(), &picture);
        bar.inc(1);
    }
    bar.finish_and_clear();

    let full = &tracks[0];
    let (flip, change, flicker) = (full.flip.clone(), full.change.clone(), full.flicker.clone());
    let finish = |track: Track| track.finish([&flip, &change, &flicker]);
    let results = Results {
        experiment: arguments.name,
        setup: PathSetup {
            setup: Setup::new(arguments, SCENE, &shot, &studio),
            camera,
            agents: shot.scene.agent_count() as u64,
            supersample,
            frames_per_second: fps,
            frames,
        },
        methods: tracks.into_iter().map(finish).collect(),
        reference_change: reference.change,
    };
    arguments.hand_out(&results, |path| results.plot(path))
}

impl Results {
    /// FLIP errors and changes by frame.
    fn plot(&self, path: &Path) -> Result<()> {
        let setup = &self.setup;
        let title = format!(
            "{}, camera {}, {} agents, {} px of error",
            setup.setup.scene,
            setup.camera,
            grouped(setup.agents),
            setup.setup.pixel_error_px
        );
        let curve = |method: &Compared, what: &str, series: &[f64], first: usize| Curve {
            name: format!("{}, {what}", method.method),
            points: (series.iter().enumerate())
                .map(|(i, &y)| ((first + i) as f64, y))
                .collect(),
            width: if what == "FLIP" { 2 } else { 1 },
        };
        let flips = self.methods.iter().map(|m| curve(m, "FLIP", &m.flip, 0));
        let changes = self.methods.iter();
        let changes = changes.map(|m| curve(m, "change from frame to frame", &m.change, 1));
        let all: Vec<Curve> = flips.chain(changes).collect();
        linear_curves(path, &title, ["frame", "FLIP error; change"], &all)
    }
}

impl std::fmt::Display for Results {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let s = &self.setup;
        writeln!(
            f,
            "{}; camera {}, {} agents; reference: full with {} samples per pixel\n",
            s.setup,
            s.camera,
            grouped(s.agents),
            s.supersample * s.supersample
        )?;
        let mut heads = vec!["frame".to_string(), "change".to_string()];
        heads.extend(["FLIP", "change", "flicker"].map(|what| format!("{} {what}", BASIS.name())));
        let kinds = ["mesh", "flat", "quad"];
        let others = || self.methods.iter().filter(|m| m.method != BASIS.name());
        for method in others() {
            let series =
                ["FLIP", "change", "flicker"].map(|what| format!("{} {what}", method.method));
            heads.extend(series.into_iter().flat_map(|head| [head, "x full".into()]));
        }
        heads.extend(kinds.map(str::to_string));
        let mut table = Table::with_heads(heads);
        let at = |series: &[f64], frame: usize, first: usize| {
            let value = frame.checked_sub(first).and_then(|i| series.get(i));
            value.copied()
        };
        let said = |x: Option<f64>| x.map_or("-".into(), |x| format!("{x:.4}"));
        let times = |x: Option<f64>, y: Option<f64>| match (x, y) {
            (Some(x), Some(y)) if y > 0.0 => format!("{:.2}", x / y),
            _ => "-".into(),
        };
        for frame in 0..s.frames {
            let mut row = vec![
                frame.to_string(),
                said(at(&self.reference_change, frame, 1)),
            ];
            let of = |m: &Compared| {
                [
                    at(&m.flip, frame, 0),
                    at(&m.change, frame, 1),
                    at(&m.flicker, frame, 1),
                ]
            };
            let basis = self.methods.first().map_or([None; 3], of);
            row.extend(basis.map(said));
            for method in others() {
                for (value, basis) in of(method).into_iter().zip(basis) {
                    row.extend([said(value), times(value, basis)]);
                }
            }
            let last = self.methods.last();
            let shown = last.and_then(|m| m.representations.get(frame));
            row.extend(kinds.map(|kind| {
                let found = shown.and_then(|all| all.iter().find(|r| r.kind == kind));
                found.map_or("-".into(), |r| grouped(r.agents))
            }));
            table.push(row);
        }
        writeln!(f, "{table}")?;
        let mut table = Table::new([
            "method",
            "mean FLIP",
            "x full",
            "worst",
            "in frame",
            "mean change",
            "x full",
            "worst",
            "in frame",
            "mean flicker",
            "x full",
            "worst",
            "in frame",
        ]);
        for m in &self.methods {
            let mut row = vec![m.method.to_string()];
            let pairs = [
                (&m.flip, m.to_full.flip),
                (&m.change, m.to_full.change),
                (&m.flicker, m.to_full.flicker),
            ];
            for (series, ratio) in pairs {
                row.extend([
                    format!("{:.5}", mean(series)),
                    format!("{:.3}", ratio.mean),
                    format!("{:.3}", ratio.worst),
                    ratio.worst_frame.to_string(),
                ]);
            }
            table.push(row);
        }
        write!(f, "{table}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn series_are_compared_by_their_means_and_by_their_worst_frame() {
        let ratio = Ratio::new(&[1.0, 3.0, 2.0], &[1.0, 1.0, 2.0], 1);
        assert_eq!((ratio.mean, ratio.worst, ratio.worst_frame), (1.5, 3.0, 2));
        let empty = Ratio::new(&[], &[], 1);
        assert_eq!((empty.mean, empty.worst), (1.0, 1.0));
    }

    /// Black, then white, beside a reference that does the same: all change, no flicker. A pixel that pops is flicker.
    #[test]
    fn flicker_is_change_that_the_reference_does_not_have() {
        let [black, white] = [[0, 0, 0, 255], [255, 255, 255, 255]];
        let mut track = Track::new(BASIS);
        track.add(vec![black; 4], &vec![black; 4]);
        track.add(vec![white; 4], &vec![white; 4]);
        assert_eq!((track.change[0], track.flicker[0]), (1.0, 0.0));
        track.add(vec![white, white, white, black], &vec![white; 4]);
        assert_eq!((track.change[1], track.flicker[1]), (0.25, 0.25));
    }
}
