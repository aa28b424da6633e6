//! `throng bench height`: what an agent costs in each representation, by projected height.

use std::path::Path;

use anyhow::{Result, bail};
use serde::Serialize;
use throng::gpu::{Headless, HeadlessDesc};
use throng::representation::{CostModel, Representations};
use throng::sheet::{Sheet, SheetDesc};
use throng::{FrameOptions, Method};
use throng_bake::impostor::Kind;

use super::Arguments;
use super::plot::{Curve, curves};
use crate::cli::impostors::Plan;
use crate::cli::measure::WARM_UP_FRAMES;
use crate::cli::output::{Progress, Table, median_p95};
use crate::cli::source::{self, Recipe};

/// Projected heights, pixels.
const HEIGHTS_PX: [f32; 14] = [
    4.0, 6.0, 8.0, 11.0, 16.0, 23.0, 32.0, 45.0, 64.0, 91.0, 128.0, 181.0, 256.0, 400.0,
];
/// What is measured; the first three may be forced, the last chooses.
const METHODS: [(&str, Method); 4] = [
    ("lod", Method::Lod),
    ("flat", Method::Flat),
    ("quad", Method::Quad),
    ("hybrid", Method::Hybrid),
];
/// The camera's pitch, radians: on a balcony.
const PITCH: f32 = 0.4;
/// From one agent to the next, in heights: the picture is full of them, and few stand behind others.
const CELL: [f32; 2] = [0.5, 1.05];
/// Most agents: more take longer and tell no more.
const AGENTS_MAX: f32 = 6000.0;
/// Who is measured where nobody is named.
const DEFAULT_CHARACTER: &str = "builtin:worker";

/// What was measured at a projected height.
#[derive(Serialize)]
struct Step {
    height_px: f32,
    agents: usize,
    /// Milliseconds per 1,000 agents, without what a frame of no agents takes, by method.
    ms_per_1000: Vec<Cost>,
    /// The cheapest method whose error is allowed.
    cheapest_allowed: &'static str,
    hybrid_to_cheapest: f64,
    /// The hybrid's agents by representation.
    representations: Vec<throng::Representation>,
    lod_triangles_per_agent: f64,
}

#[derive(Serialize)]
struct Cost {
    method: &'static str,
    ms: f64,
    /// Pixel error that was measured for the kind, or is asked of meshes.
    error_px: Option<f32>,
}

#[derive(Serialize)]
struct Results {
    experiment: &'static str,
    device: String,
    driver: String,
    character: String,
    size_px: [u32; 2],
    pixel_error_px: f32,
    runs: usize,
    warm_up_frames: usize,
    steps: Vec<Step>,
    /// What the measured costs amount to in the terms of the renderer's cost model.
    cost_model_ns: Fitted,
}

/// `throng::representation::CostModel`, fitted.
#[derive(Serialize)]
struct Fitted {
    mesh: f64,
    triangle: f64,
    impostor: f64,
    quad: f64,
    quad_pixel: f64,
    relief_pixel: f64,
}

/// Runs the experiment.
pub fn run(arguments: &Arguments) -> Result<()> {
    let progress = Progress::default();
    let source = match &arguments.characters[..] {
        [] => DEFAULT_CHARACTER,
        [one] => one,
        _ => bail!("--character: this experiment measures one character"),
    };
    let device = arguments.device.as_deref();
    let recipe = Recipe {
        impostors: Some(Plan::on(device)),
        cache: arguments.cache.open(),
        ..Recipe::default()
    };
    let baked = source::baked(source, &recipe, &progress)?;
    let mut headless = Headless::new(&HeadlessDesc {
        device: device.map(str::to_string),
        size_px: arguments.size.0,
        ..HeadlessDesc::default()
    })?;
    let character = headless.add_character(&baked)?;
    let errors = Representations::new(&baked);
    let bar = progress.bar("Measuring", HEIGHTS_PX.len() as u64);
    let mut steps = Vec::new();
    for height_px in HEIGHTS_PX {
        let sheet = Sheet::new(&baked, character, &filled(height_px, arguments.size.0));
        let mut timing = Timing {
            headless: &mut headless,
            sheet: &sheet,
            pixel_error: arguments.pixel_error,
            runs: arguments.runs(),
        };
        let mut step = Step {
            height_px,
            agents: sheet.agents.len(),
            ms_per_1000: Vec::new(),
            cheapest_allowed: "lod",
            hybrid_to_cheapest: 1.0,
            representations: Vec::new(),
            lod_triangles_per_agent: 0.0,
        };
        let methods: Vec<_> = (METHODS.iter())
            .map(|&(name, method)| {
                (
                    name,
                    method,
                    errors.kinds.iter().find(|k| kind_name(k.kind) == name),
                )
            })
            .filter(|(_, method, kind)| {
                !matches!(method, Method::Flat | Method::Quad) || kind.is_some()
            })
            .collect();
        let forced: Vec<Method> = methods.iter().map(|m| m.1).collect();
        let timed = timing.run(&forced)?;
        bar.inc(1);
        for (&(name, method, kind), (ms, report)) in methods.iter().zip(timed) {
            match method {
                Method::Lod => {
                    let visible = report.visible.max(1) as f64;
                    step.lod_triangles_per_agent = report.triangles as f64 / visible;
                }
                Method::Hybrid => step.representations = report.representations,
                _ => {}
            }
            step.ms_per_1000.push(Cost {
                method: name,
                ms: ms * 1000.0 / sheet.agents.len() as f64,
                error_px: match kind {
                    Some(kind) => kind.error(height_px),
                    None => (method == Method::Lod).then_some(arguments.pixel_error),
                },
            });
        }
        step.compare(arguments.pixel_error);
        steps.push(step);
    }
    bar.finish_and_clear();
    let fitted = Fitted::new(&steps, &errors);
    let results = Results {
        experiment: "height",
        device: headless.device_name().into(),
        driver: headless.driver().into(),
        character: baked.name.clone(),
        size_px: arguments.size.0,
        pixel_error_px: arguments.pixel_error,
        runs: arguments.runs(),
        warm_up_frames: WARM_UP_FRAMES,
        steps,
        cost_model_ns: fitted,
    };
    arguments.hand_out(&results, |path| results.plot(path))
}

/// A sheet that fills the picture.
fn filled(height_px: f32, size_px: [u32; 2]) -> SheetDesc {
    let [width, height] = size_px.map(|s| s as f32);
    let cell = CELL.map(|c| c * height_px);
    let cells = width * height / (cell[0] * cell[1]);
    let spread = (cells / AGENTS_MAX).sqrt().max(1.0);
    let cell_px = cell.map(|c| c * spread);
    SheetDesc {
        height_px,
        pitch: PITCH,
        grid: [width / cell_px[0], height / cell_px[1]].map(|n| (n as u32).max(1)),
        cell_px,
        size_px,
    }
}

/// Times frames of one sheet.
struct Timing<'a> {
    headless: &'a mut Headless,
    sheet: &'a Sheet,
    pixel_error: f32,
    runs: usize,
}

impl Timing<'_> {
    /// Median milliseconds that the agents add to a frame, by method, and the last frame's report. Methods, and frames with
    /// and without agents, take turns, so that a machine that grows slower does so for all. Each is drawn twice and timed the
    /// second time: lavapipe frees what a frame of many quads took in the next one.
    fn run(&mut self, methods: &[Method]) -> Result<Vec<(f64, throng::FrameReport)>> {
        let view = self.sheet.view(1);
        let mut timed = vec![(Vec::new(), throng::FrameReport::default()); methods.len()];
        for run in 0..WARM_UP_FRAMES + self.runs {
            for (&method, (added, last)) in methods.iter().zip(&mut timed) {
                let options = FrameOptions {
                    method,
                    pixel_error: self.pixel_error,
                    ground: false,
                    shadows: false,
                    sky: false,
                    occlusion: false,
                    ..FrameOptions::default()
                };
                let mut second = |agents: &[throng::Agent]| {
                    self.headless.render(agents, &view, &options)?;
                    self.headless.render(agents, &view, &options)
                };
                let empty = second(&[])?;
                *last = second(&self.sheet.agents)?;
                if run >= WARM_UP_FRAMES
                    && let (Some(with), Some(without)) = (last.frame_ms, empty.frame_ms)
                {
                    added.push(with - without);
                }
            }
        }
        let medians = timed
            .into_iter()
            .map(|(added, last)| (median_p95(&added).0.max(0.0), last));
        Ok(medians.collect())
    }
}

impl Step {
    /// Finds the cheapest method that is allowed, and how many times as much the hybrid costs.
    fn compare(&mut self, pixel_error: f32) {
        let allowed = self.ms_per_1000.iter().filter(|c| {
            let is_forced = c.method != "hybrid";
            is_forced && c.error_px.is_some_and(|e| e <= pixel_error)
        });
        let cheapest = allowed.min_by(|a, b| a.ms.total_cmp(&b.ms));
        let hybrid = self.ms_per_1000.iter().find(|c| c.method == "hybrid");
        if let (Some(cheapest), Some(hybrid)) = (cheapest, hybrid) {
            self.cheapest_allowed = cheapest.method;
            self.hybrid_to_cheapest = hybrid.ms / cheapest.ms.max(1e-9);
        }
    }

    fn ms(&self, method: &str) -> Option<f64> {
        let cost = self.ms_per_1000.iter().find(|c| c.method == method);
        cost.map(|c| c.ms)
    }
}

impl Fitted {
    /// Heights up to which costs count, pixels: where impostors may be allowed.
    const HEIGHT_MAX_PX: f32 = 64.0;

    fn new(steps: &[Step], representations: &Representations) -> Self {
        const NS_PER_MS: f64 = 1e6;
        let units = [0, 1, 2, 3].map(|i| {
            let [impostor, quad, quad_pixel, relief_pixel] =
                std::array::from_fn(|k| f32::from(u8::from(k == i)));
            CostModel {
                impostor,
                quad,
                quad_pixel,
                relief_pixel,
                ..CostModel::CPU
            }
        });
        let (mut meshes, mut impostors) = (Vec::new(), Vec::new());
        for step in steps.iter().filter(|s| s.height_px <= Self::HEIGHT_MAX_PX) {
            let ns = |method| step.ms(method).map(|ms| ms * NS_PER_MS / 1000.0);
            if let Some(ns) = ns("lod") {
                meshes.push(([1.0, step.lod_triangles_per_agent], ns));
            }
            for kind in &representations.kinds {
                if let Some(ns) = ns(kind_name(kind.kind)) {
                    let each = units.map(|unit| kind.cost(&unit, step.height_px) as f64);
                    impostors.push((each, ns));
                }
            }
        }
        let [mesh, triangle] = fit(&meshes);
        let [impostor, quad, quad_pixel, relief_pixel] = fit(&impostors);
        Self {
            mesh,
            triangle,
            impostor,
            quad,
            quad_pixel,
            relief_pixel,
        }
    }
}

/// The factors, none below 0, for which their products with `x` sum to nearly `y` for all `(x, y)`, by least squares of relative
/// differences; zeros where nothing was measured. Coordinate descent: few factors, few points.
fn fit<const N: usize>(points: &[([f64; N], f64)]) -> [f64; N] {
    const ROUNDS: usize = 20_000;
    let weighted = points.iter().filter(|p| p.1 > 0.0);
    let rows: Vec<[f64; N]> = weighted.map(|(x, y)| x.map(|x| x / y)).collect();
    let mut factors = [0.0; N];
    for round in 0..ROUNDS * N {
        let i = round % N;
        let (mut along, mut square) = (0.0, 0.0);
        for row in &rows {
            let others = (0..N).filter(|&k| k != i).map(|k| row[k] * factors[k]);
            along += row[i] * (1.0 - others.sum::<f64>());
            square += row[i] * row[i];
        }
        factors[i] = if square > 0.0 {
            (along / square).max(0.0)
        } else {
            0.0
        };
    }
    factors
}

fn kind_name(kind: Kind) -> &'static str {
    match kind {
        Kind::Flat => "flat",
        Kind::Quad => "quad",
    }
}

impl Results {
    /// One curve per method.
    fn plot(&self, path: &Path) -> Result<()> {
        let title = format!(
            "{} on {}, {} px of error",
            self.character, self.device, self.pixel_error_px
        );
        let all: Vec<Curve> = METHODS
            .iter()
            .map(|(name, _)| Curve {
                name: name.to_string(),
                points: (self.steps.iter())
                    .filter_map(|s| Some((s.height_px as f64, s.ms(name)?)))
                    .filter(|p| p.1 > 0.0)
                    .collect(),
                // The hybrid lies over one of the others.
                width: if *name == "hybrid" { 1 } else { 3 },
            })
            .collect();
        let axes = ["projected height, pixels", "milliseconds per 1,000 agents"];
        curves(path, &title, axes, &all)
    }
}

impl std::fmt::Display for Results {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [width, height] = self.size_px;
        writeln!(
            f,
            "{}, {}; {}, {width} x {height}, {} px of error, {} frames each\n",
            self.device, self.driver, self.character, self.pixel_error_px, self.runs
        )?;
        let mut table = Table::new([
            "height px",
            "agents",
            "lod ms/1000",
            "flat ms/1000",
            "error px",
            "quad ms/1000",
            "error px",
            "hybrid ms/1000",
            "cheapest allowed",
            "hybrid/cheapest",
        ]);
        for s in &self.steps {
            let ms = |method| s.ms(method).map_or("-".into(), |x| format!("{x:.3}"));
            let error = |method: &str| {
                let cost = s.ms_per_1000.iter().find(|c| c.method == method);
                let error = cost.and_then(|c| c.error_px);
                error.map_or("-".into(), |e| format!("{e:.2}"))
            };
            table.row([
                format!("{:.0}", s.height_px),
                s.agents.to_string(),
                ms("lod"),
                ms("flat"),
                error("flat"),
                ms("quad"),
                error("quad"),
                ms("hybrid"),
                s.cheapest_allowed.into(),
                format!("{:.2}", s.hybrid_to_cheapest),
            ]);
        }
        let m = &self.cost_model_ns;
        writeln!(
            f,
            "{table}\nFitted up to {} px, ns: mesh {:.0}, triangle {:.1}, impostor {:.0}, its quad {:.0}, quad's pixel {:.2}, with \
             relief {:.2}",
            Fitted::HEIGHT_MAX_PX,
            m.mesh,
            m.triangle,
            m.impostor,
            m.quad,
            m.quad_pixel,
            m.relief_pixel
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_are_found_and_never_below_0() {
        let exact = [
            ([1.0, 30.0], 160.0),
            ([1.0, 100.0], 510.0),
            ([1.0, 7.0], 45.0),
        ];
        let [a, b] = fit(&exact);
        assert!((a - 10.0).abs() < 1e-6 && (b - 5.0).abs() < 1e-6);
        let falling = [([1.0, 1.0], 4.0), ([1.0, 2.0], 2.0)];
        let [a, b] = fit(&falling);
        assert!(a > 0.0 && b == 0.0, "{a} {b}");
        assert_eq!(fit::<2>(&[]), [0.0, 0.0]);
    }

    #[test]
    fn sheets_fill_the_picture_with_no_more_agents_than_they_may() {
        for height_px in HEIGHTS_PX {
            let size = [1024, 768];
            let desc = filled(height_px, size);
            let count = desc.grid[0] * desc.grid[1];
            assert!((1..=AGENTS_MAX as u32).contains(&count));
            for ((n, cell), side) in desc.grid.iter().zip(desc.cell_px).zip(size) {
                let filled = *n as f32 * cell / side as f32;
                assert!(filled > 0.45 && filled <= 1.0, "{height_px}: {filled}");
            }
        }
    }
}
