//! Twin of hlsl/mesh.hlsli: collapse and palette skinning of one instance, and the tints of its colours.

use glam::{Vec3, Vec4};
use throng_bake::baked::{Baked, PaletteEntry, Vertex};
use throng_bake::quantize::{decode_normal, decode_position, decode_weights};
use throng_bake::tint::{mean_of_tints, tint_of, tint_random};

use crate::gpu_types::Instance;

/// A skinned vertex in world space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Skinned {
    /// Metres.
    pub position: Vec3,
    /// Unit length.
    pub normal: Vec3,
    /// Linear, in the agent's tint; before light and texture.
    pub color: Vec3,
}

/// Every vertex number of a submesh as an instance draws it.
pub fn mesh(baked: &Baked, submesh: usize, instance: &Instance) -> Vec<Skinned> {
    let submesh = &baked.submeshes[submesh];
    let first = submesh.first_vertex as usize;
    (0..submesh.vertex_count)
        .map(|i| {
            let (living, _) = living_ancestor(baked, first, i, instance.live_vertex_count);
            let vertex = &baked.vertices[first + living as usize];
            skin_vertex(baked, &baked.palette, vertex, instance)
        })
        .collect()
}

/// Mean parents followed per vertex-shader run: over the distinct vertices of the band that an instance with
/// `live_vertex_count` live vertices draws.
pub fn mean_hops(baked: &Baked, submesh: usize, live_vertex_count: u32) -> f64 {
    let s = &baked.submeshes[submesh];
    let bands = &baked.bands[s.first_band as usize..][..s.band_count as usize];
    let Some(band) = bands
        .iter()
        .rev()
        .find(|b| b.vertex_count >= live_vertex_count)
    else {
        return 0.0;
    };
    let mut vertices =
        baked.indices[band.first_index as usize..][..band.index_count as usize].to_vec();
    vertices.sort_unstable();
    vertices.dedup();
    let hops: u64 = vertices
        .iter()
        .map(|&v| living_ancestor(baked, s.first_vertex as usize, v, live_vertex_count).1 as u64)
        .sum();
    hops as f64 / vertices.len().max(1) as f64
}

/// The living ancestor of a vertex, numbered within its submesh, and the parents followed to it.
pub fn living_ancestor(
    baked: &Baked,
    first_vertex: usize,
    mut vertex: u32,
    live_vertex_count: u32,
) -> (u32, u32) {
    let mut hops = 0;
    while vertex >= live_vertex_count {
        vertex = baked.collapse[first_vertex + vertex as usize].parent;
        hops += 1;
    }
    (vertex, hops)
}

/// A vertex's colour as an agent has it.
fn tinted_color(baked: &Baked, vertex: &Vertex, tint_seed: u32) -> Vec3 {
    let code = baked.body_parts[vertex.body_part as usize].code(vertex.body_part);
    let [r, g, b, _] = vertex.color.map(|c| f32::from(c) / 255.0);
    // The shader's polynomial.
    let linear = |c: f32| c * (c * (c * 0.305_306 + 0.682_171_1) + 0.012_522_878);
    let mean = mean_of_tints(Vec3::new(linear(r), linear(g), linear(b)), code);
    mean * tint_of(tint_random(tint_seed), code)
}

/// A vertex with its instance's influences and frames of `palette`, at its agent's place.
pub(super) fn skin_vertex(
    baked: &Baked,
    palette: &[PaletteEntry],
    vertex: &Vertex,
    instance: &Instance,
) -> Skinned {
    let weights = decode_weights(vertex.weights);
    let mut rows = [Vec4::ZERO; 3];
    let mut sum = 0.0;
    let influences = weights.into_iter().zip(vertex.joints);
    for (weight, joint) in influences.take(instance.influence_count() as usize) {
        sum += weight;
        for s in 0..instance.sample_count() as usize {
            let entry = &palette[instance.sample_entries[s] as usize + joint as usize];
            for (row, from) in rows.iter_mut().zip(entry.rows) {
                *row += weight * instance.sample_weight(s) * Vec4::from_array(from);
            }
        }
    }
    let bind = decode_position(vertex, baked.position_min, baked.position_extent).extend(1.0);
    let model = Vec3::from(rows.map(|r| r.dot(bind))) / sum;
    let normal = decode_normal(vertex.normal);
    let normal = Vec3::from(rows.map(|r| r.truncate().dot(normal)));
    let scale = instance.heading_cos.hypot(instance.heading_sin);
    let turn = |v: Vec3| {
        Vec3::new(
            instance.heading_cos * v.x + instance.heading_sin * v.z,
            scale * v.y,
            instance.heading_cos * v.z - instance.heading_sin * v.x,
        )
    };
    Skinned {
        position: Vec3::from(instance.position) + turn(model),
        normal: turn(normal).normalize_or_zero(),
        color: tinted_color(baked, vertex, instance.tint_seed),
    }
}
