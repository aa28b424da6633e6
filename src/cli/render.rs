//! `throng render`: pictures of a scene or of a character.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Result, bail};
use serde::Serialize;
use throng::scene::builtin_names;
use throng_bake::baked::Baked;
use throng_bake::impostor::Impostors;

use super::cache;
use super::impostors::Plan;
use super::measure::{Drawing, MethodName, Report, Studio};
use super::output::{Progress, check_output, grouped, say, write_json};
use super::picture::{average, write_png};
use super::shot::{Request, Shot, Switch, ViewFrom};
use super::source::{Recipe, Up};

/// Draw a scene, or a character, to PNG files
#[derive(clap::Args)]
#[command(
    long_about = "Draws a scene to PNG files: a TOML file, or a built-in scene (street, plaza, plaza_air, stampede, \
                  file, scale, foxes, pedestrians, lineup). --character replaces the scene's characters by files of your own, baked or not (several take equal shares). \
                  Characters without a scene are drawn side by side, each at the start of its idle clip, and the camera \
                  takes them in; with --agents they people the plaza.",
    after_help = "Examples:\n  \
                  throng render plaza -o plaza.png\n  \
                  throng render my_scene.toml --camera street --frames 0-89 -o film/street.png\n  \
                  throng render --character fox.glb --clip run --time 0.3 --view side -o fox.png\n  \
                  throng render --character fox.glb --agents 2000 --report foxes.json -o foxes.png\n  \
                  throng render plaza --method full --supersample 4 -o reference.png\n\n\
                  A scene file, in short (the scenes in assets/scenes show more):\n  \
                  [[character]]\n  source = \"fox.glb\"          # relative to the scene; or builtin:NAME\n  \
                  height = 0.5                # metres; as it is where left out\n\n  \
                  [[crowd]]\n  count = 500\n  area.rectangle = { size = [30, 20] }\n  motion = \"wander\"\n  \
                  clips = [{ name = \"run\", share = 2 }, { name = \"idle\" }]\n\n  \
                  [[camera]]\n  position = [0, 4, 20]\n  target = [0, 0, 0]\n\n\
                  Clips are found by their name, else without regard to case, else by a word in it that begins so (Walking_A \
                  for walk), else by other words for the same (Gallop, Jog for run); a note says which was taken."
)]
pub struct Arguments {
    /// A scene file, or the name of a built-in scene
    scene: Option<String>,
    /// A character, baked or not, or builtin:NAME, in place of the scene's; may be repeated
    #[arg(short, long = "character", value_name = "FILE")]
    characters: Vec<String>,
    /// The axis that points up in the characters' files: OBJ files do not say it
    #[arg(
        long,
        value_name = "AXIS",
        default_value = "y",
        requires = "characters"
    )]
    up: Up,
    /// Number of agents, in place of the scene's
    #[arg(short = 'n', long, value_name = "N")]
    agents: Option<usize>,
    /// Everything random follows from it; in place of the scene's
    #[arg(long, value_name = "S")]
    seed: Option<u64>,
    /// Size of the picture
    #[arg(long, value_name = "WxH", default_value = "1024x768")]
    size: Size,
    /// The frame to draw; its time is F / the scene's frames per second
    #[arg(long, value_name = "F", conflicts_with_all = ["frames", "time"])]
    frame: Option<u32>,
    /// Draw frames A to B; each file name gets its number: out_0007.png
    #[arg(long, value_name = "A-B", conflicts_with = "time")]
    frames: Option<Frames>,
    /// The time to draw, in seconds, in place of a frame
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
    time: Option<f32>,
    /// Everybody plays this clip, in place of the scene's; named as in scenes
    #[arg(long, value_name = "NAME")]
    clip: Option<String>,
    /// Which of the scene's cameras; the first where left out
    #[arg(long, value_name = "NAME", conflicts_with = "view")]
    camera: Option<String>,
    /// A camera that takes everybody in, from this side
    #[arg(long, value_name = "SIDE")]
    view: Option<ViewFrom>,
    /// Leave out agents whom nearer ones hide, in methods other than full and uninstanced
    #[arg(long, value_name = "on|off", default_value = "on")]
    occlusion: Switch,
    #[command(flatten)]
    quality: Quality,
    /// A part of the device's name, or its index; the best GPU where left out, a CPU driver where there is none
    #[arg(long, value_name = "DEVICE")]
    device: Option<String>,
    #[command(flatten)]
    cache: cache::Options,
    /// Frames timed for the report, after two that warm up; 10 with --report, else 1 that is not timed
    #[arg(long, value_name = "N")]
    runs: Option<usize>,
    /// The picture to write
    #[arg(short, long, value_name = "OUT.png")]
    output: PathBuf,
    /// Also write what was drawn and what it took as JSON
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

/// How well a picture is drawn.
#[derive(clap::Args)]
pub struct Quality {
    /// Largest error of levels of detail, in pixels of the picture
    #[arg(long, value_name = "PX", default_value_t = 1.0)]
    pub pixel_error: f32,
    /// Samples per pixel along each side: draws N times as large and averages, in linear light
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=16))]
    pub supersample: u32,
    /// How the crowd is drawn
    #[arg(long, value_name = "METHOD", default_value = "hybrid")]
    pub method: MethodName,
    /// Everybody stands in the first frame of their clip
    #[arg(long)]
    pub no_animation: bool,
}

/// Width and height in pixels, as `WxH`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size(pub [u32; 2]);

impl FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parse = |t: &str| t.parse().ok().filter(|&x: &u32| (1..=65_536).contains(&x));
        let sides = text.split_once(['x', 'X']);
        match sides.map(|(w, h)| (parse(w), parse(h))) {
            Some((Some(w), Some(h))) => Ok(Self([w, h])),
            _ => Err("it is not WIDTHxHEIGHT in pixels, such as 1024x768".into()),
        }
    }
}

/// First and last frame, as `A-B`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Frames {
    first: u32,
    last: u32,
}

impl FromStr for Frames {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text
            .split_once('-')
            .map(|(a, b)| (a.parse::<u32>(), b.parse::<u32>()));
        match numbers {
            Some((Ok(first), Ok(last))) if first <= last => Ok(Self { first, last }),
            _ => Err("it is not FIRST-LAST, such as 0-99".into()),
        }
    }
}

/// The report of a picture.
#[derive(Serialize)]
struct PictureReport<'a> {
    picture: String,
    #[serde(flatten)]
    report: &'a Report,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    check(arguments)?;
    let progress = Progress::default();
    let request = Request {
        scene: arguments.scene.as_deref(),
        characters: &arguments.characters,
        agents: arguments.agents,
        seed: arguments.seed,
        clip: arguments.clip.as_deref(),
        camera: arguments.camera.as_deref(),
        side: arguments.view,
        occlusion: Some(arguments.occlusion),
    };
    let quality = &arguments.quality;
    let device = arguments.device.as_deref();
    let recipe = Recipe {
        impostors: quality.method.uses_impostors().then(|| Plan::on(device)),
        cache: arguments.cache.open(),
        up: arguments.up,
        ..Recipe::default()
    };
    let shot = Shot::new(&request, &recipe, &progress)?;
    warn_of_missing_impostors(quality.method, &shot.characters, &progress);
    let size = arguments.size;
    let mut studio = Studio::new(&shot, device, size.0, quality.supersample)?;
    let default_runs = if arguments.report.is_some() { 10 } else { 1 };
    let frames = match arguments.frames {
        Some(f) => f.first..=f.last,
        None => arguments.frame.unwrap_or(0)..=arguments.frame.unwrap_or(0),
    };
    let mut reports = Vec::new();
    let bar = progress.bar("Drawing", frames.clone().count() as u64);
    for frame in frames.clone() {
        let time = arguments
            .time
            .unwrap_or(frame as f32 / shot.scene.frames_per_second);
        let drawing = Drawing {
            method: quality.method,
            pixel_error: quality.pixel_error,
            supersample: quality.supersample,
            animated: !quality.no_animation,
            time,
            runs: arguments.runs.unwrap_or(default_runs),
        };
        let report = studio.draw(&shot, &drawing)?;
        let path = frame_path(&arguments.output, arguments.frames.map(|_| frame));
        save(&mut studio, quality.supersample, &path)?;
        bar.suspend(|| {
            // A single frame's time is mostly that of drivers that compile shaders at the first draw.
            let time = match drawing.runs {
                1 => String::new(),
                _ => format!(", {:.1} ms", report.frame_ms.median),
            };
            say(format_args!(
                "{}: {} agents, {} visible, {} draw calls, {} triangles{time}\n",
                path.display(),
                grouped(report.agents),
                grouped(report.visible),
                grouped(report.draw_calls),
                grouped(report.triangles)
            ))
        })?;
        bar.inc(1);
        reports.push((path, report));
    }
    bar.finish_and_clear();
    match &arguments.report {
        Some(path) => write_report(path, &frames, &reports),
        None => Ok(()),
    }
}

fn check(arguments: &Arguments) -> Result<()> {
    let e = arguments.quality.pixel_error;
    if !(e >= 0.0 && e.is_finite()) {
        bail!("--pixel-error {e}: it is not a number of at least 0");
    }
    if let Some(t) = arguments.time.filter(|t| !t.is_finite()) {
        bail!("--time {t}: it is not a time");
    }
    if arguments.runs == Some(0) {
        bail!("--runs 0: at least one frame has to be drawn");
    }
    let scene = arguments.scene.as_deref();
    let read = || {
        scene
            .into_iter()
            .chain(arguments.characters.iter().map(String::as_str))
    };
    check_output(&arguments.output, "png", read())?;
    if let Some(report) = &arguments.report {
        check_output(report, "json", read())?;
        if *report == arguments.output {
            bail!(
                "{}: it cannot be both the picture and the report",
                report.display()
            );
        }
    }
    if scene == Some("") {
        bail!(
            "no scene is called ''; there are {}",
            builtin_names().join(", ")
        );
    }
    Ok(())
}

/// Says who is drawn otherwise than asked for.
fn warn_of_missing_impostors(method: MethodName, characters: &[Baked], progress: &Progress) {
    let Some(kind) = method.impostor_kind() else {
        return;
    };
    for c in characters {
        let has = |i: &Impostors| i.kinds.iter().any(|k| k.kind == kind);
        if !c.impostors.as_ref().is_some_and(has) {
            progress.warn(&format!(
                "{}: it has no {} impostors; its meshes take their place",
                c.name,
                method.name()
            ));
        }
    }
}

/// Averages the last picture down and writes it.
pub fn save(studio: &mut Studio, supersample: u32, path: &Path) -> Result<()> {
    let [width, height] = studio.size_px().map(|x| x / supersample);
    let pixels = studio.pixels()?;
    let picture = average(
        &pixels,
        width as usize,
        height as usize,
        supersample as usize,
    );
    write_png(path, &picture, width, height)
}

/// One report as an object, those of several frames as a list.
fn write_report(
    path: &Path,
    frames: &RangeInclusive<u32>,
    reports: &[(PathBuf, Report)],
) -> Result<()> {
    let reports: Vec<PictureReport> = reports
        .iter()
        .map(|(picture, report)| PictureReport {
            picture: picture.display().to_string(),
            report,
        })
        .collect();
    match &reports[..] {
        [one] if frames.start() == frames.end() => write_json(path, one),
        many => write_json(path, &many),
    }
}

/// `out.png` itself, or `out_0007.png` for frame 7.
fn frame_path(output: &Path, frame: Option<u32>) -> PathBuf {
    let Some(frame) = frame else {
        return output.to_path_buf();
    };
    let part = |s: Option<&std::ffi::OsStr>| s.map(|s| s.to_string_lossy().into_owned());
    let stem = part(output.file_stem()).unwrap_or_default();
    let extension = part(output.extension()).unwrap_or_else(|| "png".into());
    output.with_file_name(format!("{stem}_{frame:04}.{extension}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_and_frames_are_read() {
        assert_eq!("640x480".parse(), Ok(Size([640, 480])));
        for text in ["", "640", "640x", "0x480", "-1x3", "99999999x1", "1.5x2"] {
            assert!(text.parse::<Size>().is_err(), "{text}");
        }
        assert_eq!("0-9".parse(), Ok(Frames { first: 0, last: 9 }));
        for text in ["", "3", "9-0", "a-b", "-1-3"] {
            assert!(text.parse::<Frames>().is_err(), "{text}");
        }
    }

    #[test]
    fn frames_get_their_number() {
        let path = |frame| frame_path(Path::new("film/a.b.png"), frame);
        assert_eq!(path(None), Path::new("film/a.b.png"));
        assert_eq!(path(Some(7)), Path::new("film/a.b_0007.png"));
        assert_eq!(path(Some(12345)), Path::new("film/a.b_12345.png"));
    }
}
