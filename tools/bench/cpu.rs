//! What the CPU side costs: the stages of a bake, reading a file, and a frame's upload and recording, with criterion.
//!
//! `cargo bench --bench cpu`, or `cargo bench --bench cpu -- simplify`. Frames need Vulkan and are left out without it.

#![allow(missing_docs)] // of what criterion_group makes

use std::hint::black_box;
use std::path::Path;
use std::time::Duration;

use criterion::{BatchSize, BenchmarkId, Criterion, criterion_group, criterion_main};
use glam::Vec3;
use throng::bake::bake::{BakeOptions, bake};
use throng::bake::character::Character;
use throng::bake::simplify::PoseSet;
use throng::bake::sliding_tris::{self, BandForm};
use throng::bake::{file, glb, import, merge, palette, people, simplify};
use throng::gpu::{Headless, HeadlessDesc};
use throng::{Agent, FrameOptions, FrameReport, View};

/// Who is baked.
const CHARACTER: &str = "worker";
/// Poses that simplification looks at, as many as in a bake.
const POSE_COUNT: usize = 12;
const SIZE: [u32; 2] = [256, 192];

fn character() -> Character {
    people::build(CHARACTER).expect("a built-in character")
}

/// Each stage of a bake alone.
fn bakes(c: &mut Criterion) {
    let character = character();
    let mesh = merge::merge(&character).expect("it merges");
    let poses = PoseSet::choose(&character, &mesh, POSE_COUNT);
    let mut simplified = mesh.clone();
    let sequence = simplify::simplify(&mut simplified, &poses, &[]);
    let source = glb::write_glb(&character).expect("it is written");
    let (baked, _) = bake(&character, &BakeOptions::default(), &mut |_| {}).expect("it bakes");
    let bytes = file::to_bytes(&baked);
    let path = Path::new("worker");

    let mut group = c.benchmark_group("bake");
    group.sample_size(10);
    group.bench_function("import", |b| {
        b.iter(|| import::import_bytes(Path::new("worker.glb"), black_box(&source)))
    });
    group.bench_function("merge", |b| b.iter(|| merge::merge(black_box(&character))));
    group.bench_function("simplify", |b| {
        b.iter_batched_ref(
            || mesh.clone(),
            |mesh| simplify::simplify(mesh, &poses, &[]),
            BatchSize::PerIteration,
        )
    });
    group.bench_function("order", |b| {
        let form = BandForm::Collapsed {
            ratio: std::f32::consts::SQRT_2,
        };
        b.iter(|| sliding_tris::order(black_box(&simplified), &sequence, form))
    });
    group.bench_function("palette", |b| {
        b.iter(|| palette::sample_clips(black_box(&character), &mesh, 30.0))
    });
    group.bench_function("write", |b| b.iter(|| file::to_bytes(black_box(&baked))));
    group.bench_function("read", |b| {
        b.iter(|| file::from_bytes(path, black_box(&bytes)))
    });
    group.finish();
}

/// Handing over the agents and recording the commands, from the report of whole frames.
fn frames(c: &mut Criterion) {
    let desc = HeadlessDesc {
        size_px: SIZE,
        ..HeadlessDesc::default()
    };
    let mut headless = match Headless::new(&desc) {
        Ok(headless) => headless,
        Err(e) => return eprintln!("SKIPPED: {e}"),
    };
    let (baked, _) = bake(&character(), &BakeOptions::default(), &mut |_| {}).expect("it bakes");
    let character = headless.add_character(&baked).expect("it uploads");
    let view = View::perspective(Vec3::new(0.0, 900.0, 0.0), Vec3::ZERO, 0.6, 0.1, SIZE);
    let mut report = FrameReport::default();
    for stage in ["upload", "record"] {
        let mut group = c.benchmark_group(stage);
        group
            .sample_size(10)
            .measurement_time(Duration::from_secs(2));
        for count in [100, 1_000, 10_000, 100_000] {
            let agents = spread(count, character);
            group.bench_function(BenchmarkId::from_parameter(count), |b| {
                b.iter_custom(|iterations| {
                    let frames = (0..iterations).map(|_| {
                        let options = FrameOptions::default();
                        headless
                            .render_into(&agents, &view, &options, &mut report)
                            .expect("a frame");
                        let found = report.stage_ms.iter().find(|s| s.stage == stage);
                        Duration::from_secs_f64(found.map_or(0.0, |s| s.ms) * 1e-3)
                    });
                    frames.sum()
                })
            });
        }
        group.finish();
    }
}

/// Agents in a square, 2 m apart.
fn spread(count: usize, character: throng::CharacterId) -> Vec<Agent> {
    let side = (count as f32).sqrt().ceil() as usize;
    (0..count)
        .map(|i| Agent {
            character,
            position: Vec3::new((i % side) as f32 * 2.0, 0.0, (i / side) as f32 * 2.0),
            phases: [i as f32 * 0.618 % 1.0; 2],
            ..Agent::default()
        })
        .collect()
}

criterion_group!(cpu, bakes, frames);
criterion_main!(cpu);
