//! `throng demo`: the built-in characters on a plaza, from nothing to a picture and its cost.

use std::path::PathBuf;

use anyhow::Result;

use super::cache;
use super::impostors::Plan;
use super::measure::{Drawing, MethodName, Studio};
use super::output::{Progress, check_output, say, write_json};
use super::render::{Size, save};
use super::shot::{Request, Shot, Switch};
use super::source::Recipe;

/// Draw 10,000 animated people on a plaza and show what it costs
#[derive(clap::Args)]
#[command(
    long_about = "Makes and bakes the built-in characters, draws 10,000 of them, animated, on a plaza, and prints what \
                  that costs: draw calls, triangles, vertex-shader runs, milliseconds by stage.",
    after_help = "Examples:\n  throng demo\n  throng demo --agents 100000 --size 1920x1080 -o big.png"
)]
pub struct Arguments {
    /// Number of agents
    #[arg(short = 'n', long, value_name = "N")]
    agents: Option<usize>,
    /// Size of the picture
    #[arg(long, value_name = "WxH", default_value = "1024x768")]
    size: Size,
    /// A part of the device's name, or its index; the best GPU where left out, a CPU driver where there is none
    #[arg(long, value_name = "DEVICE")]
    device: Option<String>,
    /// Leave out agents whom nearer ones hide, in methods other than full and uninstanced
    #[arg(long, value_name = "on|off", default_value = "on")]
    occlusion: Switch,
    #[command(flatten)]
    cache: cache::Options,
    /// Frames timed, after two that warm up
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..))]
    runs: usize,
    /// The picture to write
    #[arg(short, long, value_name = "OUT.png", default_value = "out/demo.png")]
    output: PathBuf,
    /// Also write the figures as JSON
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    check_output(&arguments.output, "png", [])?;
    let progress = Progress::default();
    let request = Request {
        scene: Some("plaza"),
        agents: arguments.agents,
        occlusion: Some(arguments.occlusion),
        ..Request::default()
    };
    let device = arguments.device.as_deref();
    let recipe = Recipe {
        impostors: Some(Plan::on(device)),
        cache: arguments.cache.open(),
        ..Recipe::default()
    };
    let shot = Shot::new(&request, &recipe, &progress)?;
    let mut studio = Studio::new(&shot, device, arguments.size.0, 1)?;
    let line = progress.spinner("Drawing");
    let drawing = Drawing {
        method: MethodName::Hybrid,
        pixel_error: 1.0,
        supersample: 1,
        animated: true,
        time: 0.0,
        runs: arguments.runs,
    };
    let report = studio.draw(&shot, &drawing)?;
    save(&mut studio, 1, &arguments.output)?;
    line.finish_and_clear();
    say(format_args!(
        "{report}\nThe picture: {}\n",
        arguments.output.display()
    ))?;
    match &arguments.report {
        Some(path) => write_json(path, &report),
        None => Ok(()),
    }
}
