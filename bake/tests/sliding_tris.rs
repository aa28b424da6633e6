//! Sliding-Tris order and windows: properties that must hold for any collapse sequence.

mod common;

use std::collections::BTreeSet;

use common::{random_sequence, sheets};
use throng_bake::mesh::{Collapse, CollapseSequence, Mesh, Replacement};
use throng_bake::sliding_tris::{
    BandForm, SlidingTris, ancestor, band_at, live_count, order, step_ratio, triangles_at,
};

const COLLAPSED: BandForm = BandForm::Collapsed {
    ratio: std::f32::consts::SQRT_2,
};

/// Triangles of one submesh as sets of source vertices, after the first `steps` collapses, by plain replay.
fn replay(mesh: &Mesh, sequence: &CollapseSequence, error: f32, submesh: u8) -> BTreeSet<Vec<u32>> {
    let replaced = sequence.replacement.as_ref();
    let replaced = replaced.filter(|r| sequence.steps[r.step].error_m <= error);
    let triangles = replaced.map_or(&mesh.triangles, |r| &r.triangles);
    let mut now: Vec<u32> = (0..mesh.vertex_count() as u32).collect();
    for s in sequence.steps.iter().filter(|s| s.error_m <= error) {
        now.iter_mut()
            .filter(|c| **c == s.vertex)
            .for_each(|c| *c = s.target);
    }
    let corners = triangles.iter().map(|t| t.map(|v| now[v as usize]));
    corners
        .filter(|c| {
            mesh.submesh[c[0] as usize] == submesh && c[0] != c[1] && c[1] != c[2] && c[2] != c[0]
        })
        .map(|c| c.into_iter().collect::<BTreeSet<_>>().into_iter().collect())
        .collect()
}

fn as_sources(
    sliding: &SlidingTris,
    submesh: usize,
    triangles: impl IntoIterator<Item = [u32; 3]>,
) -> BTreeSet<Vec<u32>> {
    let first = sliding.submeshes[submesh].first_vertex;
    let sources = |t: [u32; 3]| {
        t.map(|v| sliding.source_vertex[(first + v) as usize])
            .into_iter()
            .collect::<BTreeSet<_>>()
    };
    triangles
        .into_iter()
        .map(|t| sources(t).into_iter().collect())
        .collect()
}

#[test]
fn every_level_shows_the_same_triangles_as_replaying_the_collapses() {
    let mesh = sheets(9);
    let sequence = random_sequence(&mesh, 3);
    let sliding = order(&mesh, &sequence, COLLAPSED).unwrap();
    for (s, submesh) in sliding.submeshes.iter().enumerate() {
        let collapse =
            &sliding.collapse[submesh.first_vertex as usize..][..submesh.vertex_count as usize];
        let band = sliding.bands[submesh.first_band as usize];
        let full = &sliding.indices[band.first_index as usize..][..band.index_count as usize];
        for step in (0..sequence.steps.len()).step_by(5) {
            let error = sequence.steps[step].error_m;
            let shown = triangles_at(collapse, full, |a, b| a == b, error);
            assert_eq!(
                as_sources(&sliding, s, shown),
                replay(&mesh, &sequence, error, s as u8),
                "at error {error}"
            );
        }
    }
}

#[test]
fn a_band_shows_what_the_full_window_shows_and_indexes_only_living_vertices() {
    let mesh = sheets(12);
    let sequence = random_sequence(&mesh, 5);
    let sliding = order(&mesh, &sequence, COLLAPSED).unwrap();
    for submesh in &sliding.submeshes {
        let collapse =
            &sliding.collapse[submesh.first_vertex as usize..][..submesh.vertex_count as usize];
        let bands = &sliding.bands[submesh.first_band as usize..][..submesh.band_count as usize];
        assert!(bands.len() > 5, "{} bands", bands.len());
        let window = |b: &throng_bake::baked::Band| {
            &sliding.indices[b.first_index as usize..][..b.index_count as usize]
        };
        for step in (0..sequence.steps.len()).step_by(7) {
            let live = live_count(collapse, sequence.steps[step].error_m);
            let band = bands.iter().rev().find(|b| b.vertex_count >= live).unwrap();
            assert!(window(band).iter().all(|&v| v < band.vertex_count));
            let moved = |indices: &[u32]| -> BTreeSet<[u32; 3]> {
                let corners = indices
                    .chunks_exact(3)
                    .map(|t| [t[0], t[1], t[2]].map(|v| ancestor(collapse, v, live)));
                let sorted = corners
                    .filter(|c| c[0] != c[1] && c[1] != c[2] && c[2] != c[0])
                    .map(|mut c| {
                        c.sort();
                        c
                    });
                sorted.collect()
            };
            assert_eq!(
                moved(window(band)),
                moved(window(&bands[0])),
                "{live} vertices alive"
            );
        }
    }
}

/// Two sheets of which the first becomes a square of four new vertices after `kept` steps, while the second ends.
fn replaced(side: usize, kept: usize) -> (Mesh, CollapseSequence) {
    let mut mesh = sheets(side);
    let mut sequence = random_sequence(&mesh, 3);
    sequence.steps.truncate(kept);
    let first = mesh.vertex_count() as u32;
    for (x, y) in [(0.0, 0.0), (1.0, 0.0), (1.0, 2.0), (0.0, 2.0)] {
        let like = |v: &mut Vec<_>| v.push(v[0]);
        like(&mut mesh.uvs);
        mesh.positions.push(glam::Vec3::new(x, y, 0.5));
        mesh.normals.push(mesh.normals[0]);
        mesh.colors.push(mesh.colors[0]);
        mesh.layers.push(mesh.layers[0]);
        mesh.body_parts.push(mesh.body_parts[0]);
        mesh.joints.push(mesh.joints[0]);
        mesh.weights.push(mesh.weights[0]);
        mesh.submesh.push(0);
    }
    let dead = |steps: &[Collapse], v: u32| steps.iter().any(|s| s.vertex == v);
    let root = (0..first)
        .find(|&v| mesh.submesh[v as usize] == 1 && !dead(&sequence.steps, v))
        .unwrap();
    let mut step = |vertex, target, error_m| {
        sequence.steps.push(Collapse {
            vertex,
            target,
            error_m,
        });
    };
    let living: Vec<u32> = (0..first)
        .filter(|&v| !dead(&random_sequence(&sheets(side), 3).steps[..kept], v))
        .collect();
    for v in living.into_iter().filter(|&v| v != root) {
        let target = [first, root][usize::from(mesh.submesh[v as usize])];
        step(v, target, 5.0);
    }
    step(first + 3, first, 6.0);
    step(first + 2, first + 1, 7.0);
    step(first + 1, first, 7.0);
    sequence.replacement = Some(Replacement {
        step: kept,
        triangles: vec![[first, first + 1, first + 2], [first, first + 2, first + 3]],
    });
    (mesh, sequence)
}

#[test]
fn where_triangles_are_replaced_levels_on_both_sides_are_right_and_a_band_begins() {
    for (kept, form) in [
        (30, COLLAPSED),
        (90, COLLAPSED),
        (150, COLLAPSED),
        (90, BandForm::SingleWindow),
    ] {
        let (mesh, sequence) = replaced(9, kept);
        let sliding = order(&mesh, &sequence, form).unwrap();
        for (s, submesh) in sliding.submeshes.iter().enumerate() {
            let collapse =
                &sliding.collapse[submesh.first_vertex as usize..][..submesh.vertex_count as usize];
            let bands =
                &sliding.bands[submesh.first_band as usize..][..submesh.band_count as usize];
            let live = live_count(collapse, 5.0);
            assert!(bands.iter().any(|b| b.vertex_count == live), "{bands:?}");
            for step in &sequence.steps {
                let band = band_at(bands, live_count(collapse, step.error_m)).unwrap();
                let window =
                    &sliding.indices[band.first_index as usize..][..band.index_count as usize];
                let shown = triangles_at(collapse, window, |a, b| a == b, step.error_m);
                let expected = replay(&mesh, &sequence, step.error_m, s as u8);
                assert_eq!(
                    as_sources(&sliding, s, shown),
                    expected,
                    "{form:?}, error {}",
                    step.error_m
                );
                if step.error_m == 5.0 {
                    assert_eq!(expected.len(), [2, 0][s]);
                    assert!(window.iter().all(|&v| v < live));
                }
            }
        }
    }
}

#[test]
fn coarse_bands_stand_closer_than_fine_ones() {
    let ratio = std::f32::consts::SQRT_2;
    let steps: Vec<f32> = [1000, 250, 60, 15, 4]
        .map(|live| step_ratio(ratio, live, 1000))
        .to_vec();
    assert_eq!(steps[0], ratio);
    assert!(steps.is_sorted_by(|a, b| a >= b), "{steps:?}");
    // A quarter of the logarithm and no less: bands are draws.
    assert!((steps[4] - ratio.powf(0.25)).abs() < 1e-6, "{steps:?}");
    assert!(steps.iter().all(|&s| s > 1.0));

    let mesh = sheets(24);
    let sliding = order(&mesh, &random_sequence(&mesh, 5), COLLAPSED).unwrap();
    let submesh = &sliding.submeshes[0];
    let bands = &sliding.bands[submesh.first_band as usize..][..submesh.band_count as usize];
    let step = |w: &[throng_bake::baked::Band]| w[0].vertex_count as f32 / w[1].vertex_count as f32;
    assert!(step(&bands[..2]) > 1.3, "{bands:?}");
    let coarse = bands.partition_point(|b| b.vertex_count * 8 > submesh.vertex_count);
    assert!(step(&bands[coarse..]) < 1.3, "{bands:?}");
}

#[test]
fn the_single_window_keeps_what_lives_in_a_prefix() {
    let mesh = sheets(10);
    let sequence = random_sequence(&mesh, 11);
    let sliding = order(&mesh, &sequence, BandForm::SingleWindow).unwrap();
    for submesh in &sliding.submeshes {
        let collapse =
            &sliding.collapse[submesh.first_vertex as usize..][..submesh.vertex_count as usize];
        let bands = &sliding.bands[submesh.first_band as usize..][..submesh.band_count as usize];
        assert!(bands.iter().all(|b| b.first_index == bands[0].first_index));
        for band in bands {
            let alive = |t: &[u32]| {
                let c = [t[0], t[1], t[2]].map(|v| ancestor(collapse, v, band.vertex_count));
                c[0] != c[1] && c[1] != c[2] && c[2] != c[0]
            };
            let all =
                &sliding.indices[bands[0].first_index as usize..][..bands[0].index_count as usize];
            let (inside, outside) = all.split_at(band.index_count as usize);
            assert!(
                inside.chunks_exact(3).all(alive),
                "a dead triangle in the window"
            );
            assert!(
                !outside.chunks_exact(3).any(alive),
                "a living triangle outside the window"
            );
        }
    }
}

#[test]
fn parents_come_before_their_children_and_errors_fall() {
    let mesh = sheets(9);
    let sliding = order(&mesh, &random_sequence(&mesh, 1), COLLAPSED).unwrap();
    for submesh in &sliding.submeshes {
        let collapse =
            &sliding.collapse[submesh.first_vertex as usize..][..submesh.vertex_count as usize];
        assert!(collapse.is_sorted_by(|a, b| a.error >= b.error));
        let living = collapse
            .iter()
            .enumerate()
            .filter(|(_, c)| c.error.is_finite());
        assert!(
            living.clone().count() > 70 && living.clone().all(|(v, c)| (c.parent as usize) < v)
        );
    }
}

#[test]
fn a_sequence_that_breaks_its_rules_is_refused() {
    let mesh = sheets(3);
    let step = |vertex, target, error_m| Collapse {
        vertex,
        target,
        error_m,
    };
    let broken = [
        vec![step(0, 0, 0.0)],
        vec![step(0, 99, 0.0)],
        vec![step(0, 1, 0.0), step(0, 2, 0.0)],
        vec![step(0, 1, 0.0), step(2, 0, 0.0)],
        vec![step(0, 10, 0.0)],
        vec![step(0, 1, 1.0), step(2, 1, 0.5)],
        vec![step(0, 1, f32::NAN)],
    ];
    for steps in broken {
        let sequence = CollapseSequence {
            steps,
            replacement: None,
        };
        assert!(order(&mesh, &sequence, COLLAPSED).is_err(), "{sequence:?}");
    }
    assert!(order(&mesh, &CollapseSequence::default(), COLLAPSED).is_ok());

    let (mesh, good) = replaced(9, 30);
    assert!(order(&mesh, &good, COLLAPSED).is_ok());
    type Break = fn(&mut Replacement);
    let breaks: [Break; 5] = [
        |r| r.step += 1,
        |r| r.step = usize::MAX,
        |r| r.triangles[0][0] = 0,
        |r| r.triangles[0][0] = 999,
        |r| r.triangles[0] = [100; 3],
    ];
    for (i, b) in breaks.into_iter().enumerate() {
        let mut sequence = good.clone();
        b(sequence.replacement.as_mut().unwrap());
        assert!(order(&mesh, &sequence, COLLAPSED).is_err(), "{i}");
    }
}
