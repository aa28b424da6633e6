//! `throng bench methods`, `scale` and `limit`: the scene drawn in several ways beside each other.

use std::path::Path;

use anyhow::Result;
use serde::Serialize;

use super::plot::{Bar, Curve, bars, curves};
use super::turns::{self, Contender, Entry};
use super::{Arguments, Name, Setup, flip};
use crate::cli::measure::{FrameTime, MethodName, Studio};
use crate::cli::output::{Progress, Table, grouped};

const ALL_METHODS: [MethodName; 6] = [
    MethodName::Hybrid,
    MethodName::Lod,
    MethodName::Flat,
    MethodName::Quad,
    MethodName::Full,
    MethodName::Uninstanced,
];
const SCALE: [usize; 9] = [
    100, 316, 1_000, 3_162, 10_000, 31_623, 100_000, 316_228, 1_000_000,
];

#[derive(Serialize)]
struct Results {
    experiment: Name,
    setup: TurnsSetup,
    steps: Vec<Step>,
}

#[derive(Serialize)]
struct TurnsSetup {
    #[serde(flatten)]
    setup: Setup,
    runs: usize,
    /// The method whose triangles and quads `limit` and `floor` draw.
    limit_of: &'static str,
}

/// One number of agents.
#[derive(Serialize)]
struct Step {
    agents: u64,
    entries: Vec<Row>,
}

#[derive(Serialize)]
struct Row {
    #[serde(flatten)]
    entry: Entry,
    /// Microseconds of wall time per agent.
    us_per_agent: f64,
    /// Median wall time as a multiple of that of `limit`, and of `floor`.
    to_limit: Option<f64>,
    to_floor: Option<f64>,
    /// The same of median CPU time, which suffers less from what else the machine does.
    cpu_to_limit: Option<f64>,
    cpu_to_floor: Option<f64>,
    /// Mean FLIP error against the many-sampled picture, where it was asked for.
    flip: Option<f64>,
}

/// Runs the experiment.
pub fn run(arguments: &Arguments) -> Result<()> {
    let progress = Progress::default();
    let is_scale = arguments.name == Name::Scale;
    let default = match arguments.name {
        Name::Methods => &ALL_METHODS[..],
        _ => &ALL_METHODS[..1],
    };
    let methods = arguments.methods(&[], default)?;
    let scene = if is_scale { "scale" } else { "street" };
    let mut shot = arguments.shot(scene, true, &progress)?;
    let counts = match &arguments.agents[..] {
        [] if is_scale => SCALE.to_vec(),
        [] => vec![shot.scene.agent_count()],
        given => given.to_vec(),
    };
    let device = arguments.device.as_deref();
    let mut studio = Studio::new(&shot, device, arguments.size.0, 1)?;
    let contenders: Vec<Contender> = methods
        .iter()
        .map(|&m| Contender::Method(m, true))
        .chain([Contender::Limit, Contender::Floor])
        .collect();
    let bar = progress.bar("Measuring", (counts.len() * arguments.runs()) as u64);
    let mut steps = Vec::new();
    for count in counts {
        if count != shot.scene.agent_count() {
            shot.set_agent_count(count);
        }
        let entries = turns::measure(
            &shot,
            &mut studio,
            &contenders,
            arguments.pixel_error,
            arguments.runs(),
            &bar,
        )?;
        steps.push(Step::new(count as u64, entries));
    }
    bar.finish_and_clear();
    if arguments.flip {
        let line = progress.spinner("Comparing pictures");
        match flip::measure(&shot, &mut studio, device, arguments.pixel_error, &methods) {
            Ok(errors) => {
                for (row, error) in steps.iter_mut().flat_map(|s| &mut s.entries).zip(errors) {
                    row.flip = Some(error);
                }
            }
            Err(e) => progress.warn(&format!("FLIP is not measured: {e}")),
        }
        line.finish_and_clear();
    }
    let results = Results {
        experiment: arguments.name,
        setup: TurnsSetup {
            setup: Setup::new(arguments, scene, &shot, &studio),
            runs: arguments.runs(),
            limit_of: turns::limit_of(&contenders).name(),
        },
        steps,
    };
    arguments.hand_out(&results, |path| results.plot(path))
}

impl Step {
    fn new(agents: u64, entries: Vec<Entry>) -> Self {
        let wall = |e: &Entry| Some(e.report.frame_ms.median).filter(|&ms| ms > 0.0);
        let cpu = |e: &Entry| Some(e.report.cpu_ms?.median).filter(|&ms| ms > 0.0);
        let named = |name: &str| entries.iter().find(|e| e.report.method == name);
        let [limit, floor] = [Contender::Limit, Contender::Floor].map(|c| {
            let entry = named(c.name());
            [entry.and_then(wall), entry.and_then(cpu)]
        });
        let ratio = |a: Option<f64>, b: Option<f64>| Some(a? / b?);
        let rows = entries.into_iter().map(|entry| Row {
            us_per_agent: entry.report.frame_ms.median * 1e3 / agents.max(1) as f64,
            to_limit: ratio(wall(&entry), limit[0]),
            to_floor: ratio(wall(&entry), floor[0]),
            cpu_to_limit: ratio(cpu(&entry), limit[1]),
            cpu_to_floor: ratio(cpu(&entry), floor[1]),
            flip: None,
            entry,
        });
        Self {
            agents,
            entries: rows.collect(),
        }
    }

    fn row(&self, method: &str) -> Option<&Row> {
        self.entries
            .iter()
            .find(|r| r.entry.report.method == method)
    }
}

impl Row {
    fn agents_as(&self, kind: &str) -> Option<u64> {
        let all = &self.entry.report.representations;
        all.iter().find(|r| r.kind == kind).map(|r| r.agents)
    }
}

impl Results {
    /// For `scale` microseconds per agent over agents; else milliseconds by method.
    fn plot(&self, path: &Path) -> Result<()> {
        let setup = &self.setup.setup;
        let title = format!(
            "{} on {}, {} px of error",
            setup.scene, setup.device, setup.pixel_error_px
        );
        let Some(first) = self.steps.first() else {
            return Ok(());
        };
        if let [only] = &self.steps[..] {
            let measured = only
                .entries
                .iter()
                .filter(|r| r.entry.report.frame_ms.median > 0.0);
            let all: Vec<Bar> = measured
                .map(|r| Bar {
                    name: r.entry.report.method.into(),
                    value: r.entry.report.frame_ms.median,
                    whisker: [r.entry.report.frame_ms.min, r.entry.report.frame_ms.p95],
                })
                .collect();
            return bars(
                path,
                &title,
                "milliseconds: median, least to 95th percentile",
                &all,
            );
        }
        let names = first.entries.iter().map(|r| r.entry.report.method);
        let all: Vec<Curve> = names
            .map(|name| Curve {
                name: name.into(),
                points: (self.steps.iter())
                    .filter_map(|s| Some((s.agents as f64, s.row(name)?.us_per_agent)))
                    .filter(|p| p.1 > 0.0)
                    .collect(),
                width: 2,
            })
            .collect();
        curves(path, &title, ["agents", "microseconds per agent"], &all)
    }
}

impl std::fmt::Display for Results {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(
            f,
            "{}; limit and floor draw the frame of {}\n",
            self.setup.setup, self.setup.limit_of
        )?;
        let ratios = [
            "CPU ms",
            "us/agent",
            "x limit",
            "x floor",
            "CPU x limit",
            "CPU x floor",
            "FLIP",
        ];
        let heads = [&["agents", "method"][..], &FrameTime::HEADS, &ratios];
        let mut table = Table::with_heads(heads.concat());
        let optional =
            |x: Option<f64>, digits: usize| x.map_or("-".into(), |x| format!("{x:.digits$}"));
        let rows = || {
            self.steps
                .iter()
                .flat_map(|s| s.entries.iter().map(move |r| (s.agents, r)))
        };
        for (agents, row) in rows() {
            let r = &row.entry.report;
            let ratios = [
                optional(r.cpu_ms.map(|t: FrameTime| t.median), 1),
                format!("{:.2}", row.us_per_agent),
                optional(row.to_limit, 2),
                optional(row.to_floor, 2),
                optional(row.cpu_to_limit, 2),
                optional(row.cpu_to_floor, 2),
                optional(row.flip, 5),
            ];
            let what = [grouped(agents), r.method.into()];
            table.push([&what[..], &r.frame_ms.cells(), &ratios].concat());
        }
        writeln!(f, "{table}")?;
        let mut table = Table::new([
            "agents",
            "method",
            "visible",
            "hidden",
            "triangles",
            "of occluders",
            "draw calls",
            "vertex-shader runs",
            "mesh",
            "flat",
            "quad",
        ]);
        for (agents, row) in rows() {
            let r = &row.entry.report;
            let kind = |k| row.agents_as(k).map_or("-".into(), grouped);
            table.row([
                grouped(agents),
                r.method.into(),
                grouped(r.visible),
                grouped(r.occluded),
                grouped(r.triangles),
                grouped(r.occluder_triangles),
                grouped(r.draw_calls),
                r.vertex_invocations.map_or("-".into(), grouped),
                kind("mesh"),
                kind("flat"),
                kind("quad"),
            ]);
        }
        writeln!(f, "{table}")?;
        let mut stages: Vec<&str> = Vec::new();
        for stage in rows().flat_map(|(_, row)| &row.entry.report.stage_ms) {
            if !stages.contains(&stage.stage) {
                stages.push(stage.stage);
            }
        }
        let heads = ["agents", "ms of stage"]
            .into_iter()
            .chain(stages.iter().copied());
        let mut table = Table::with_heads(heads);
        for (agents, row) in rows() {
            let r = &row.entry.report;
            let mut cells = vec![grouped(agents), r.method.to_string()];
            cells.extend(stages.iter().map(|name| {
                let stage = r.stage_ms.iter().find(|s| s.stage == *name);
                optional(stage.map(|s| s.ms), 2)
            }));
            table.push(cells);
        }
        write!(f, "{table}")?;
        for (agents, row) in rows() {
            if let Some(note) = &row.entry.note {
                writeln!(
                    f,
                    "\n{}, {} agents: {note}",
                    row.entry.report.method,
                    grouped(agents)
                )?;
            }
        }
        Ok(())
    }
}
