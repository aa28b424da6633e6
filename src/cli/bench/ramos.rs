//! `throng bench ramos`: the experiments of Ramos et al. 2012, table 2 and figures 3 and 4.

use anyhow::{Result, bail};
use serde::Serialize;

use super::turns::{self, Contender, Entry};
use super::{Arguments, Name, Setup};
use crate::cli::inspect::Contents;
use crate::cli::measure::{FrameTime, MethodName, Report, Studio};
use crate::cli::output::{Progress, Table, grouped};

const SCENE: &str = "plaza";
const AGENTS: [usize; 6] = [1_000, 2_000, 4_000, 6_000, 8_000, 10_000];
const CONTENDERS: [Contender; 4] = [
    Contender::Method(MethodName::Lod, true),
    Contender::Method(MethodName::Lod, false),
    Contender::Method(MethodName::Full, true),
    Contender::Method(MethodName::Uninstanced, true),
];

/// What was measured at one number of agents.
#[derive(Serialize)]
struct Step {
    lod: Entry,
    lod_without_animation: Entry,
    full: Entry,
    uninstanced: Entry,
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
    setup: Setup,
    steps: Vec<Step>,
    characters: Vec<Contents>,
}

/// Runs the experiment.
pub fn run(arguments: &Arguments) -> Result<()> {
    if arguments.plot.is_some() {
        bail!("--plot: ramos has none");
    }
    let progress = Progress::default();
    let mut shot = arguments.shot(SCENE, false, &progress)?;
    let device = arguments.device.as_deref();
    let mut studio = Studio::new(&shot, device, arguments.size.0, 1)?;
    let counts = match &arguments.agents[..] {
        [] => &AGENTS[..],
        given => given,
    };
    let bar = progress.bar("Measuring", (counts.len() * arguments.runs()) as u64);
    let mut steps = Vec::new();
    for &count in counts {
        shot.set_agent_count(count);
        let (pixel_error, runs) = (arguments.pixel_error, arguments.runs());
        let entries = turns::measure(&shot, &mut studio, &CONTENDERS, pixel_error, runs, &bar)?;
        match <[Entry; 4]>::try_from(entries) {
            Ok([lod, still, full, uninstanced]) => {
                steps.push(Step::new(lod, still, full, uninstanced))
            }
            Err(entries) => bail!("{} of 4 kinds were measured", entries.len()),
        }
    }
    bar.finish_and_clear();
    let results = Results {
        experiment: arguments.name,
        setup: Setup::new(arguments, SCENE, &shot, &studio),
        steps,
        characters: shot.characters.iter().map(Contents::of).collect(),
    };
    arguments.hand_out(&results, |_| Ok(()))
}

impl Step {
    fn new(lod: Entry, still: Entry, full: Entry, uninstanced: Entry) -> Self {
        let ratio = |a: f64, b: f64| if b > 0.0 { a / b } else { 0.0 };
        let ms = |a: &Entry, b: &Entry| ratio(a.report.frame_ms.median, b.report.frame_ms.median);
        let counts = |of: fn(&Report) -> u64, a: &Entry, b: &Entry| {
            ratio(of(&a.report) as f64, of(&b.report) as f64)
        };
        Self {
            ratios: Ratios {
                triangles_full_to_lod: counts(|r| r.triangles, &full, &lod),
                ms_uninstanced_to_full: ms(&uninstanced, &full),
                ms_full_to_lod: ms(&full, &lod),
                ms_animated_to_still: ms(&lod, &still),
                draw_calls_uninstanced_to_lod: counts(|r| r.draw_calls, &uninstanced, &lod),
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
        writeln!(f, "{}\n", self.setup)?;
        let counts = [
            "agents",
            "method",
            "visible",
            "draw calls",
            "triangles",
            "vertex-shader runs",
        ];
        let mut table = Table::with_heads([&counts[..], &FrameTime::HEADS].concat());
        for step in &self.steps {
            for entry in [
                &step.lod,
                &step.lod_without_animation,
                &step.full,
                &step.uninstanced,
            ] {
                let r = &entry.report;
                let counts = [
                    grouped(r.agents),
                    r.method.into(),
                    grouped(r.visible),
                    grouped(r.draw_calls),
                    grouped(r.triangles),
                    r.vertex_invocations.map_or("-".into(), grouped),
                ];
                table.push([&counts[..], &r.frame_ms.cells()].concat());
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
                grouped(step.lod.report.agents),
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
