//! From the polygonised surface to a character's parts: joint weights, reduction to a triangle budget, shading baked into
//! vertex colours.

use std::collections::HashMap;

use glam::{Vec2, Vec3};
use meshopt::{SimplifyOptions, VertexDataAdapter};
use rayon::prelude::*;

use super::cut::{Face, Surface};
use super::field::Model;
use crate::character::{Material, Part};

/// Weight of a unit normal's change against a position's, relative to the whole mesh: it sends triangles to heads and hands.
const NORMAL_WEIGHT: f32 = 0.03;
/// Weight of a full change of joint, so that joints keep enough rings of vertices to bend.
const JOINT_WEIGHT: f32 = 0.06;
/// Rounds of weight smoothing on the fine mesh; each reaches one grid step.
const SMOOTHING_ROUNDS: usize = 10;
/// Primitives this much farther than the nearest have a share of 1/e in a vertex's weights.
const BIND_FALLOFF: f32 = 0.010;

/// Vertex data on the fine mesh: one wedge per vertex and paint around it.
struct Wedge {
    vertex: u32,
    face: Face,
}

/// Parts of `surface` of about `triangle_budget` triangles, one per material in use.
///
/// `height` is the size of the front projection that texture coordinates come from. Where `importance` is above 1, bends of
/// the surface keep that many times more weight.
#[allow(clippy::too_many_arguments, reason = "one call site, plain arrays")]
pub fn parts(
    model: &Model,
    surface: &Surface,
    materials: &[Material],
    joint_count: usize,
    triangle_budget: usize,
    height: f32,
    importance: impl Fn(Vec3) -> f32,
) -> Vec<Part> {
    let weights = smooth(
        surface,
        joint_weights(model, surface, joint_count),
        joint_count,
    );
    let (wedges, triangles) = wedges(surface);
    let normals: Vec<Vec3> = wedges
        .par_iter()
        .map(|w| {
            model.layers[w.face.layer as usize]
                .normal(surface.positions[w.vertex as usize], w.face.trim as usize)
        })
        .collect();
    let bends: Vec<Vec3> = wedges
        .iter()
        .zip(&normals)
        .map(|(w, &n)| n * importance(surface.positions[w.vertex as usize]))
        .collect();
    let kept = reduce(
        surface,
        &wedges,
        &bends,
        &weights,
        joint_count,
        &triangles,
        triangle_budget,
    );
    let mut parts = Vec::new();
    for (m, material) in materials.iter().enumerate() {
        let of_material = |t: &&[u32; 3]| {
            let paint = wedges[t[0] as usize].face.paint as usize;
            surface.paints[paint].material == m
        };
        let own: Vec<[u32; 3]> = kept.iter().filter(of_material).copied().collect();
        if own.is_empty() {
            continue;
        }
        let mut part = Part {
            name: material.name.clone(),
            material: m as u32,
            ..Part::default()
        };
        let mut index: HashMap<u32, u32> = HashMap::new();
        let mut order: Vec<u32> = Vec::new();
        for t in &own {
            part.triangles.push(t.map(|w| {
                *index.entry(w).or_insert_with(|| {
                    order.push(w);
                    order.len() as u32 - 1
                })
            }));
        }
        let shade: Vec<f32> = order
            .par_iter()
            .map(|&w| {
                let p = surface.positions[wedges[w as usize].vertex as usize];
                openness(model, p, normals[w as usize])
            })
            .collect();
        for (&w, &open) in order.iter().zip(&shade) {
            let wedge = &wedges[w as usize];
            let p = surface.positions[wedge.vertex as usize];
            let tint = surface.paints[wedge.face.paint as usize].tint;
            // Occluded skin and cloth go dark, never black.
            let light = 0.42 + 0.58 * open;
            part.positions.push(p);
            part.normals.push(normals[w as usize]);
            part.uvs
                .push(Vec2::new(0.5 + p.x / height, 1.0 - p.y / height));
            part.colors
                .push([tint[0] * light, tint[1] * light, tint[2] * light, 1.0]);
            let all = &weights[wedge.vertex as usize * joint_count..][..joint_count];
            let (joints, weights) = strongest(all);
            part.joints.push(joints);
            part.weights.push(weights);
        }
        parts.push(part);
    }
    parts
}

/// Dense weights `[vertex_count * joint_count]` from the primitives that make the surface there.
fn joint_weights(model: &Model, surface: &Surface, joint_count: usize) -> Vec<f32> {
    let mut out = vec![0f32; surface.positions.len() * joint_count];
    out.par_chunks_mut(joint_count)
        .zip(&surface.positions)
        .zip(&surface.layers)
        .for_each(|((out, &p), &layer)| {
            model.layers[layer as usize].bind(p, BIND_FALLOFF, out);
        });
    out
}

/// Averages weights with those of the neighbours along the surface, so that nothing bleeds across a gap.
fn smooth(surface: &Surface, mut weights: Vec<f32>, joint_count: usize) -> Vec<f32> {
    let vertex_count = surface.positions.len();
    let mut edges: Vec<(u32, u32)> = surface
        .triangles
        .iter()
        .flat_map(|&[a, b, c]| [(a, b), (b, a), (b, c), (c, b), (c, a), (a, c)])
        .collect();
    edges.sort_unstable();
    edges.dedup();
    let mut start = vec![0usize; vertex_count + 1];
    for &(a, _) in &edges {
        start[a as usize + 1] += 1;
    }
    for i in 0..vertex_count {
        start[i + 1] += start[i];
    }
    let mut next = vec![0f32; weights.len()];
    for _ in 0..SMOOTHING_ROUNDS {
        next.par_chunks_mut(joint_count)
            .enumerate()
            .for_each(|(v, out)| {
                let around = &edges[start[v]..start[v + 1]];
                let own = &weights[v * joint_count..][..joint_count];
                if around.is_empty() {
                    out.copy_from_slice(own);
                    return;
                }
                out.fill(0.0);
                for &(_, b) in around {
                    let other = &weights[b as usize * joint_count..][..joint_count];
                    out.iter_mut().zip(other).for_each(|(o, x)| *o += x);
                }
                let share = 0.5 / around.len() as f32;
                out.iter_mut()
                    .zip(own)
                    .for_each(|(o, x)| *o = *o * share + 0.5 * x);
            });
        std::mem::swap(&mut weights, &mut next);
    }
    weights
}

/// A wedge per vertex and face, and the triangles over wedges.
fn wedges(surface: &Surface) -> (Vec<Wedge>, Vec<[u32; 3]>) {
    let mut wedges = Vec::with_capacity(surface.positions.len() * 11 / 10);
    let mut index: HashMap<(u32, Face), u32> = HashMap::with_capacity(wedges.capacity());
    let triangles = surface
        .triangles
        .iter()
        .zip(&surface.faces)
        .map(|(t, &face)| {
            t.map(|vertex| {
                *index.entry((vertex, face)).or_insert_with(|| {
                    wedges.push(Wedge { vertex, face });
                    wedges.len() as u32 - 1
                })
            })
        })
        .collect();
    (wedges, triangles)
}

fn reduce(
    surface: &Surface,
    wedges: &[Wedge],
    bends: &[Vec3],
    weights: &[f32],
    joint_count: usize,
    triangles: &[[u32; 3]],
    triangle_budget: usize,
) -> Vec<[u32; 3]> {
    let positions: Vec<Vec3> = wedges
        .iter()
        .map(|w| surface.positions[w.vertex as usize])
        .collect();
    // Joints in chain order as one number would tie unlike joints together: three mixed sums tell neighbours apart.
    const MIXES: usize = 3;
    let mut attributes = Vec::with_capacity(wedges.len() * (3 + MIXES));
    for (wedge, bend) in wedges.iter().zip(bends) {
        attributes.extend(bend.to_array());
        let own = &weights[wedge.vertex as usize * joint_count..][..joint_count];
        for mix in 0..MIXES {
            let value = |joint: usize| ((joint * (mix + 1)) as f32 * 2.399).sin();
            let sum: f32 = own.iter().enumerate().map(|(j, w)| w * value(j)).sum();
            attributes.push(sum);
        }
    }
    let (n, j) = (NORMAL_WEIGHT, JOINT_WEIGHT);
    let Ok(adapter) =
        VertexDataAdapter::new(bytemuck::cast_slice(&positions), size_of::<Vec3>(), 0)
    else {
        return triangles.to_vec();
    };
    let reduced = meshopt::simplify_with_attributes_and_locks(
        triangles.as_flattened(),
        &adapter,
        &attributes,
        &[n, n, n, j, j, j],
        (3 + MIXES) * size_of::<f32>(),
        &vec![false; wedges.len()],
        triangle_budget * 3,
        1.0,
        SimplifyOptions::None,
        None,
    );
    reduced.as_chunks::<3>().0.to_vec()
}

/// The share of the sky above the surface that the character itself does not hide, by distances along a few rays.
fn openness(model: &Model, p: Vec3, normal: Vec3) -> f32 {
    const RAYS: usize = 10;
    let (u, v) = normal.any_orthonormal_pair();
    let mut sum = 0.0;
    for i in 0..RAYS {
        // Golden-angle spiral, cosine-weighted.
        let r2 = (i as f32 + 0.5) / RAYS as f32;
        let r = r2.sqrt();
        let (sin, cos) = (i as f32 * 2.399_963).sin_cos();
        let direction = (u * cos + v * sin) * r + normal * (1.0 - r2).sqrt();
        let mut open = 1f32;
        for t in [0.02, 0.06, 0.14] {
            let d = model.distance(p + normal * 0.003 + direction * t, None).0;
            open = open.min((d / (0.45 * t)).clamp(0.0, 1.0));
            if open == 0.0 {
                break;
            }
        }
        sum += open;
    }
    sum / RAYS as f32
}

/// The four strongest joints by falling weight, normalised.
fn strongest(all: &[f32]) -> ([u16; 4], [f32; 4]) {
    let mut order: Vec<usize> = (0..all.len()).filter(|&j| all[j] > 0.004).collect();
    order.sort_by(|&a, &b| all[b].total_cmp(&all[a]).then(a.cmp(&b)));
    order.truncate(4);
    let sum: f32 = order.iter().map(|&j| all[j]).sum();
    let mut joints = [0; 4];
    let mut weights = [0.0; 4];
    for (i, &j) in order.iter().enumerate() {
        joints[i] = j as u16;
        weights[i] = all[j] / sum;
    }
    (joints, weights)
}
