//! `throng bench`: what drawing costs. One file per experiment; [`turns`] is how every one of them measures.

use std::fmt::Display;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use serde::Serialize;

use super::cache;
use super::impostors::Plan;
use super::measure::{MethodName, Studio};
use super::output::{say, write_json};
use super::render::Size;
use super::shot::{Request, Shot, Switch};
use super::source::Recipe;

mod compare;
mod flip;
mod height;
mod path;
mod plot;
mod ramos;
mod stream;
mod turns;

/// Measure what drawing costs: methods beside each other, the number of agents, papers' experiments
#[derive(clap::Args)]
#[command(
    long_about = "Measures what drawing costs.\n\n\
        methods: every method on one scene.\n\n\
        scale: cost per agent from 100 to 1,000,000 agents.\n\n\
        limit: the hybrid beside the least that this driver can spend on its picture. `limit` draws the very triangles \
        and quads of that frame from static buffers, already transformed, with the same pixel shaders; `floor` draws \
        them in one flat colour. Both draw ground, contact shadows and sky as usual. `methods` and `scale` say every \
        figure as a multiple of both, too.\n\n\
        ramos: Ramos, Ripolles and Chover 2012. Triangles with and without levels of detail over the number of agents \
        (figure 3b); milliseconds with instancing and without, and with levels of detail and without (figure 4a); draw \
        calls (figure 4b); animation on and off (figure 3a); bytes per vertex (table 2).\n\n\
        height: milliseconds per 1,000 agents of one character by projected height, from 4 to 400 pixels, in every \
        representation, and how near the hybrid is to the cheapest one that --pixel-error allows.\n\n\
        path: the pictures, frame by frame, along a camera's path: their mean FLIP error against `full` with many samples \
        per pixel, and how much each frame differs from the one before it, both as multiples of what one-sample `full` \
        shows. `flicker` is the change of the difference to the reference, in which the camera's motion and the agents' \
        cancels. It draws everybody at full detail twice a frame: allow half an hour, or take fewer --agents.\n\n\
        stream: milliseconds from frame to frame where the next frames are recorded while the device works on one, with \
        one, two and three in flight: what a program that shows them gets.\n\n\
        How it is measured: everything compared takes turns, frame by frame (A B C A B C ...), so that a machine that \
        grows slower does so for all alike. Every turn draws the next frame of the scene: agents walk. Before that each \
        draws frames until they grow faster no more, because drivers compile shaders at the first draws. Frames so slow \
        that --runs of them would take more than half a minute are drawn less often, three times at least; the table \
        says how often. `ms` is wall time from handing over the agents to the finished picture, `CPU ms` is what all \
        threads of the process spent on it, `spread` is the middle half of the frames (from the first to the third \
        quartile) in percent of the median: the noise. Absolute times are this machine's; compare ratios.",
    after_help = "Examples:\n  \
        throng bench methods                            every method on the street\n  \
        throng bench methods --scene stampede --method hybrid,lod --flip\n  \
        throng bench methods --scene foxes -c Fox.glb   a scene of 10,000 of your own\n  \
        throng bench scale --plot scale.svg --json scale.json\n  \
        throng bench limit --scene plaza\n  \
        throng bench ramos --agents 1000,10000 -c ped.glb --json ramos.json\n  \
        throng bench height -c fox.glb --plot height.svg\n  \
        throng bench path --agents 2000 --runs 20 --pictures out/path"
)]
pub struct Arguments {
    /// Which experiment
    #[arg(value_enum, default_value = "methods")]
    name: Name,
    /// Numbers of agents: for scale 100 to 1,000,000 where left out, for ramos 1,000 to 10,000, else the scene's (path takes one)
    #[arg(short = 'n', long, value_name = "N,N,...", value_delimiter = ',')]
    agents: Vec<usize>,
    /// A scene file, or the name of a built-in scene; for scale `scale`, for ramos and path `plaza`, else `street` where left out
    #[arg(long)]
    scene: Option<String>,
    /// A character in place of the scene's; may be repeated. For height: the one that is measured
    #[arg(short, long = "character", value_name = "FILE")]
    characters: Vec<String>,
    /// Which of the scene's cameras; for path the first that has one where left out
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// What is compared, for methods, scale, limit, path and stream; for methods all of them where left out, for path lod and hybrid,
    /// else hybrid
    #[arg(
        long = "method",
        value_name = "METHOD,METHOD,...",
        value_delimiter = ','
    )]
    methods: Vec<MethodName>,
    /// Largest error of levels of detail and impostors in pixels
    #[arg(long, value_name = "PX", default_value_t = 1.0)]
    pixel_error: f32,
    /// Size of the picture
    #[arg(long, value_name = "WxH", default_value = "1024x768")]
    size: Size,
    /// Leave out agents whom nearer ones hide, in methods other than full and uninstanced
    #[arg(long, value_name = "on|off", default_value = "on")]
    occlusion: Switch,
    #[command(flatten)]
    cache: cache::Options,
    /// Frames timed of each kind, after those that warm up: 30 where left out; slow ones get fewer. For path the frames
    /// compared, from the first: the whole path where left out
    #[arg(long, value_name = "N")]
    runs: Option<usize>,
    /// Also measures each picture's mean FLIP error against `full` with 16 samples per pixel, for methods: takes a minute
    #[arg(long)]
    flip: bool,
    /// For path: samples along each side of a pixel of the reference
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=16))]
    supersample: Option<u32>,
    /// For path: keep the pictures that are compared in this folder
    #[arg(long, value_name = "FOLDER")]
    pictures: Option<PathBuf>,
    /// A part of the device's name, or its index
    #[arg(long, value_name = "DEVICE")]
    device: Option<String>,
    /// Also write everything that was measured as JSON, every frame's time included
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Also write a plot
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
enum Name {
    /// Every method on one scene
    Methods,
    /// Cost by the number of agents
    Scale,
    /// The hybrid beside the least that its picture can cost
    Limit,
    /// Ramos et al. 2012: continuous levels of detail for animated crowds
    Ramos,
    /// Every representation by projected height
    Height,
    /// Pictures along a camera's path
    Path,
    /// Frames a second with several in flight
    Stream,
}

/// What the figures of every experiment on a scene depend on.
#[derive(Serialize)]
struct Setup {
    version: &'static str,
    device: String,
    driver: String,
    /// CPU cores that the program may use.
    cores: usize,
    scene: String,
    characters: Vec<String>,
    size_px: [u32; 2],
    pixel_error_px: f32,
}

impl Setup {
    /// `default_scene` is what [`Arguments::shot`] was given.
    fn new(arguments: &Arguments, default_scene: &str, shot: &Shot, studio: &Studio) -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION"),
            device: studio.device_name().into(),
            driver: studio.driver().into(),
            cores: std::thread::available_parallelism().map_or(0, usize::from),
            scene: arguments.scene_name(default_scene).into(),
            characters: shot.characters.iter().map(|c| c.name.clone()).collect(),
            size_px: arguments.size.0,
            pixel_error_px: arguments.pixel_error,
        }
    }
}

/// The line that experiments begin with.
impl Display for Setup {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [width, height] = self.size_px;
        write!(
            f,
            "{}, {}, {} cores; scene {}, {width} x {height}, {} px of error",
            self.device, self.driver, self.cores, self.scene, self.pixel_error_px
        )
    }
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    if arguments.runs == Some(0) || arguments.agents.contains(&0) {
        bail!("--runs and --agents have to be at least 1");
    }
    let e = arguments.pixel_error;
    if !(e >= 0.0 && e.is_finite()) {
        bail!("--pixel-error {e}: it is not a number of at least 0");
    }
    let only = |given: bool, option: &str, names: &[Name]| match given
        && !names.contains(&arguments.name)
    {
        true => bail!("{option}: it is not for {:?}", arguments.name),
        false => Ok(()),
    };
    use Name::{Limit, Methods, Path, Ramos, Scale, Stream};
    only(arguments.flip, "--flip", &[Methods])?;
    only(arguments.supersample.is_some(), "--supersample", &[Path])?;
    only(arguments.pictures.is_some(), "--pictures", &[Path])?;
    only(
        !arguments.methods.is_empty(),
        "--method",
        &[Methods, Scale, Limit, Path, Stream],
    )?;
    only(
        !arguments.agents.is_empty(),
        "--agents",
        &[Methods, Scale, Limit, Ramos, Path, Stream],
    )?;
    only(
        arguments.scene.is_some(),
        "--scene",
        &[Methods, Scale, Limit, Ramos, Path, Stream],
    )?;
    if arguments.agents.len() > 1 && matches!(arguments.name, Path | Stream) {
        bail!("--agents: this experiment takes one number");
    }
    match arguments.name {
        Name::Methods | Name::Scale | Name::Limit => compare::run(arguments),
        Name::Ramos => ramos::run(arguments),
        Name::Height => height::run(arguments),
        Name::Path => path::run(arguments),
        Name::Stream => stream::run(arguments),
    }
}

impl Arguments {
    /// Prints results, and writes the files that were asked for.
    fn hand_out<R: Display + Serialize>(
        &self,
        results: &R,
        plot: impl FnOnce(&Path) -> Result<()>,
    ) -> Result<()> {
        say(results)?;
        if let Some(path) = &self.plot {
            plot(path)?;
        }
        match &self.json {
            Some(path) => write_json(path, results),
            None => Ok(()),
        }
    }

    /// Frames timed of each kind.
    fn runs(&self) -> usize {
        self.runs.unwrap_or(30)
    }

    /// The scene with its characters, baked with impostors where `impostors` says so.
    fn shot(
        &self,
        default_scene: &str,
        impostors: bool,
        progress: &super::output::Progress,
    ) -> Result<Shot> {
        let request = Request {
            scene: Some(self.scene_name(default_scene)),
            characters: &self.characters,
            camera: self.camera.as_deref(),
            occlusion: Some(self.occlusion),
            ..Request::default()
        };
        let recipe = Recipe {
            impostors: impostors.then(|| Plan::on(self.device.as_deref())),
            cache: self.cache.open(),
            ..Recipe::default()
        };
        Shot::new(&request, &recipe, progress)
    }

    /// What is compared: `always`, and then what was asked for, or else `default`. Errors where one is there twice.
    fn methods(&self, always: &[MethodName], default: &[MethodName]) -> Result<Vec<MethodName>> {
        let given = match &self.methods[..] {
            [] => default,
            given => given,
        };
        let methods = [always, given].concat();
        match (1..methods.len()).find(|&i| methods[..i].contains(&methods[i])) {
            Some(i) if always.contains(&methods[i]) => {
                bail!("--method: {} is always there", methods[i].name())
            }
            Some(i) => bail!("--method: {} is there twice", methods[i].name()),
            None => Ok(methods),
        }
    }

    /// Gives the shot the number of agents that was asked for, if one was.
    fn set_agents(&self, shot: &mut Shot) {
        if let [count] = self.agents[..] {
            shot.set_agent_count(count);
        }
    }

    fn scene_name<'a>(&'a self, default: &'a str) -> &'a str {
        self.scene.as_deref().unwrap_or(default)
    }
}
