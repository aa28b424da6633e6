//! `throng bench`: experiments of papers, rebuilt. `ramos`: Ramos et al. 2012, table 2 and figures 3 and 4. `height` is in
//! [`super::bench_height`].

use std::path::PathBuf;

use anyhow::{Result, bail};
use serde::Serialize;

use super::cache;
use super::inspect::Contents;
use super::measure::{Drawing, MethodName, Report, Studio, WARM_UP_FRAMES};
use super::output::{Progress, Table, grouped, say, write_json};
use super::render::Size;
use super::shot::{Request, Shot};
use super::source::Recipe;

/// Measure what drawing costs: experiments of papers, and representations by height
#[derive(clap::Args)]
#[command(
    long_about = "Measures what drawing costs.\n\nramos: Ramos, Ripolles and Chover 2012. Triangles with and \
                  without levels of detail over the number of agents (figure 3b); milliseconds with instancing and \
                  without, and with levels of detail and without (figure 4a); draw calls (figure 4b); animation on and \
                  off (figure 3a); bytes per vertex (table 2).\n\nheight: milliseconds per 1,000 agents of one \
                  character by projected height, from 4 to 400 pixels, in every representation, and how near the \
                  hybrid is to the cheapest one that --pixel-error allows.\n\nAbsolute times are this machine's; compare ratios.",
    after_help = "Examples:\n  \
                  throng bench ramos\n  \
                  throng bench ramos --agents 1000,10000 --character ped.glb --json ramos.json\n  \
                  throng bench height --character fox.glb --plot height.svg --json height.json"
)]
pub struct Arguments {
    /// Which experiments
    #[arg(value_enum, default_value = "ramos")]
    name: Name,
    /// Numbers of agents, for ramos
    #[arg(short = 'n', long, value_name = "N,N,...", value_delimiter = ',',
          default_values_t = [1_000, 2_000, 4_000, 6_000, 8_000, 10_000])]
    agents: Vec<usize>,
    /// A scene file, or the name of a built-in scene, for ramos
    #[arg(long, default_value = "plaza")]
    scene: String,
    /// A character in place of the scene's; may be repeated. For height: the one that is measured
    #[arg(short, long = "character", value_name = "FILE")]
    pub characters: Vec<String>,
    /// Which of the scene's cameras, for ramos
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Largest error of levels of detail in pixels
    #[arg(long, value_name = "PX", default_value_t = 1.0)]
    pub pixel_error: f32,
    /// Size of the picture
    #[arg(long, value_name = "WxH", default_value = "1024x768")]
    pub size: Size,
    #[command(flatten)]
    pub cache: cache::Options,
    /// Frames timed of each kind, after two that warm up
    #[arg(long, value_name = "N", default_value_t = 10)]
    pub runs: usize,
    /// A part of the device's name, or its index
    #[arg(long, value_name = "DEVICE")]
    pub device: Option<String>,
    /// Also write everything that was measured as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Also write a plot, for height
    #[arg(long, value_name = "FILE.svg")]
    pub plot: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
enum Name {
    /// Ramos et al. 2012: continuous levels of detail for animated crowds
    Ramos,
    /// Every representation by projected height
    Height,
}

/// What was measured at one number of agents.
#[derive(Serialize)]
struct Step {
    lod: Report,
    lod_without_animation: Report,
    full: Report,
    uninstanced: Report,
    ratios: Ratios,
}

/// How many times the second of the two in each name the first one is.
#[derive(Serialize)]
struct Ratios {
    triangles_full_to_lod: f64,
    ms_uninstanced_to_full: f64,
    ms_full_to_lod: f64,
    ms_animated_to_still: f64,
    draw_calls_uninstanced_to_lod: f64,
}

#[derive(Serialize)]
struct Results {
    experiment: Name,
    scene: String,
    warm_up_frames: usize,
    steps: Vec<Step>,
    characters: Vec<Contents>,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    if arguments.runs == 0 || arguments.agents.is_empty() {
        bail!("--runs and --agents have to be at least 1");
    }
    match arguments.name {
        Name::Ramos => run_ramos(arguments),
        Name::Height => super::bench_height::run(arguments),
    }
}

fn run_ramos(arguments: &Arguments) -> Result<()> {
    if arguments.plot.is_some() {
        bail!("--plot: it is for height");
    }
    let progress = Progress::default();
    let request = Request {
        scene: Some(&arguments.scene),
        characters: &arguments.characters,
        camera: arguments.camera.as_deref(),
        ..Request::default()
    };
    let recipe = Recipe {
        cache: arguments.cache.open(),
        ..Recipe::default()
    };
    let mut shot = Shot::new(&request, &recipe, &progress)?;
    let mut studio = Studio::new(&shot, arguments.device.as_deref(), arguments.size.0, 1)?;
    let bar = progress.bar("Measuring", 4 * arguments.agents.len() as u64);
    let mut steps = Vec::new();
    for &count in &arguments.agents {
        shot.set_agent_count(count);
        let mut draw = |method: MethodName, animated: bool| {
            bar.set_message(format!("{method:?}, {} agents", grouped(count as u64)));
            let drawing = Drawing {
                method,
                pixel_error: arguments.pixel_error,
                supersample: 1,
                animated,
                time: 0.0,
                runs: arguments.runs,
            };
            let report = studio.draw(&shot, &drawing);
            bar.inc(1);
            report
        };
        let (lod, still) = (draw(MethodName::Lod, true)?, draw(MethodName::Lod, false)?);
        let full = draw(MethodName::Full, true)?;
        let uninstanced = draw(MethodName::Uninstanced, true)?;
        steps.push(Step::new(lod, still, full, uninstanced));
    }
    bar.finish_and_clear();
    let results = Results {
        experiment: arguments.name,
        scene: arguments.scene.clone(),
        warm_up_frames: WARM_UP_FRAMES,
        steps,
        characters: shot.characters.iter().map(Contents::of).collect(),
    };
    say(&results)?;
    match &arguments.json {
        Some(path) => write_json(path, &results),
        None => Ok(()),
    }
}

impl Step {
    fn new(lod: Report, still: Report, full: Report, uninstanced: Report) -> Self {
        let ratio = |a: f64, b: f64| if b > 0.0 { a / b } else { 0.0 };
        let ms = |a: &Report, b: &Report| ratio(a.frame_ms.median, b.frame_ms.median);
        Self {
            ratios: Ratios {
                triangles_full_to_lod: ratio(full.triangles as f64, lod.triangles as f64),
                ms_uninstanced_to_full: ms(&uninstanced, &full),
                ms_full_to_lod: ms(&full, &lod),
                ms_animated_to_still: ms(&lod, &still),
                draw_calls_uninstanced_to_lod: ratio(
                    uninstanced.draw_calls as f64,
                    lod.draw_calls as f64,
                ),
            },
            lod,
            lod_without_animation: still,
            full,
            uninstanced,
        }
    }
}

impl std::fmt::Display for Results {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if let Some(step) = self.steps.first() {
            let [width, height] = step.lod.size_px;
            writeln!(
                f,
                "{}, {}; scene {}, {width} x {height}, {} px of error, {} frames each\n",
                step.lod.device,
                step.lod.driver,
                self.scene,
                step.lod.pixel_error_px,
                step.lod.frame_ms.runs
            )?;
        }
        let mut table = Table::new([
            "agents",
            "method",
            "visible",
            "draw calls",
            "triangles",
            "vertex-shader runs",
            "ms median",
            "ms p95",
        ]);
        for step in &self.steps {
            for (name, r) in [
                ("lod", &step.lod),
                ("lod, no animation", &step.lod_without_animation),
                ("full", &step.full),
                ("uninstanced", &step.uninstanced),
            ] {
                table.row([
                    grouped(r.agents),
                    name.into(),
                    grouped(r.visible),
                    grouped(r.draw_calls),
                    grouped(r.triangles),
                    r.vertex_invocations.map_or("-".into(), grouped),
                    format!("{:.1}", r.frame_ms.median),
                    format!("{:.1}", r.frame_ms.p95),
                ]);
            }
        }
        writeln!(f, "{table}")?;
        let mut table = Table::new([
            "agents",
            "triangles full/lod",
            "ms full/lod",
            "ms uninstanced/full",
            "ms animated/still",
            "draw calls uninstanced/lod",
        ]);
        for step in &self.steps {
            let r = &step.ratios;
            table.row([
                grouped(step.lod.agents),
                format!("{:.1}", r.triangles_full_to_lod),
                format!("{:.1}", r.ms_full_to_lod),
                format!("{:.2}", r.ms_uninstanced_to_full),
                format!("{:.2}", r.ms_animated_to_still),
                format!("{:.0}", r.draw_calls_uninstanced_to_lod),
            ]);
        }
        writeln!(f, "{table}")?;
        let mut table = Table::new([
            "bytes per vertex",
            "geometry",
            "collapse",
            "triangles",
            "bands",
            "together",
            "skinning",
            "with skinning",
        ]);
        for c in &self.characters {
            let b = &c.bytes_per_vertex;
            let row = [
                b.geometry,
                b.collapse,
                b.triangles,
                b.bands,
                b.total_without_skinning,
                b.skinning,
                b.total,
            ]
            .map(|x| format!("{x:.1}"));
            let [a, b, c2, d, e, g, h] = row;
            table.row([c.name.clone(), a, b, c2, d, e, g, h]);
        }
        write!(f, "{table}")
    }
}
