//! The driver: imported character in, baked character out.

use std::time::Instant;

use glam::{Vec2, Vec3};

use crate::baked::{Baked, Vertex};
use crate::body_parts::body_parts;
use crate::character::{Character, Image};
use crate::error::BakeError;
use crate::indices;
use crate::mesh::Mesh;
use crate::simplify::PoseSet;
use crate::sliding_tris::{BandForm, SlidingTris};
use crate::{merge, palette, quantize, simplify, sliding_tris, texture};

/// What a bake may be told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BakeOptions {
    /// Palette frames per second of a clip.
    pub frame_rate_hz: f32,
    /// Largest side of a texture layer in pixels.
    pub texture_size: u32,
    /// One collapsed window per band, or the paper's single window.
    pub single_window: bool,
    /// Most bytes per vertex of the full mesh for geometry, skinning, collapse texture and bands, with the vertices that
    /// only coarse levels use: narrower bands are spent as far as it allows.
    pub bytes_per_vertex: f32,
}

impl Default for BakeOptions {
    fn default() -> Self {
        Self {
            frame_rate_hz: 30.0,
            texture_size: 1024,
            single_window: false,
            bytes_per_vertex: 80.0,
        }
    }
}

/// Where the time of a bake went, in the order of the stages.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct BakeTimes {
    /// Stage and milliseconds.
    pub stage_ms: Vec<(&'static str, f64)>,
}

/// Greatest ratios of live vertices from band to band that are tried until the bytes per vertex fit; the fewest vanished triangles
/// first: with 1.1 a street takes 0.97 of the CPU time that it takes with 1.31.
const BAND_RATIOS: [f32; 15] = [
    1.1, 1.12, 1.14, 1.16, 1.19, 1.23, 1.27, 1.31, 1.35, 1.41, 1.5, 1.6, 1.75, 2.0, 2.5,
];

/// Bakes `character`. `progress` hears the name of each stage as it begins. Same input and options, same result.
///
/// Errors: [`BakeError`] when it needs more than a baked character can hold.
pub fn bake(
    character: &Character,
    options: &BakeOptions,
    progress: &mut dyn FnMut(&'static str),
) -> Result<(Baked, BakeTimes), BakeError> {
    let mut times = BakeTimes::default();
    let mut stage = |name: &'static str, times: &mut BakeTimes| {
        progress(name);
        times.stage_ms.push((name, 0.0));
        Instant::now()
    };
    let done = |from: Instant, times: &mut BakeTimes| {
        if let Some(last) = times.stage_ms.last_mut() {
            last.1 = from.elapsed().as_secs_f64() * 1e3;
        }
    };

    let from = stage("merge", &mut times);
    let mut mesh = merge::merge(character)?;
    let source_count = mesh.vertex_count();
    done(from, &mut times);
    let from = stage("simplify", &mut times);
    let poses = PoseSet::choose(character, &mesh, PoseSet::DEFAULT_COUNT);
    let images: Vec<&Image> = merge::used_images(character)
        .into_iter()
        .map(|i| &character.images[i as usize])
        .collect();
    let sequence = simplify::simplify(&mut mesh, &poses, &images);
    done(from, &mut times);
    let from = stage("order", &mut times);
    let sliding = order_within_budget(&mesh, source_count, &sequence, options)?;
    done(from, &mut times);
    let from = stage("palette", &mut times);
    let (palette, clips) = palette::sample_clips(character, &mesh, options.frame_rate_hz)?;
    done(from, &mut times);
    let from = stage("textures", &mut times);
    let textures = texture::texture_array(&images, options.texture_size);
    done(from, &mut times);

    let (position_min, position_extent) = extent(mesh.positions.iter().map(|p| p.to_array()));
    let textured = |v: &u32| mesh.layers[*v as usize] != Mesh::UNTEXTURED;
    let (uv_min, uv_extent) = extent(
        sliding
            .source_vertex
            .iter()
            .filter(|v| textured(v))
            .map(|&v| mesh.uvs[v as usize].to_array()),
    );
    let (position_min, position_extent) = (Vec3::from(position_min), Vec3::from(position_extent));
    let (uv_min, uv_extent) = (Vec2::from(uv_min), Vec2::from(uv_extent));
    let vertices = sliding
        .source_vertex
        .iter()
        .map(|&v| {
            encode(
                &mesh,
                v as usize,
                position_min,
                position_extent,
                uv_min,
                uv_extent,
            )
        })
        .collect();
    let mut source_clips = character.clips.clone();
    for (source, clip) in source_clips.iter_mut().zip(&clips) {
        source.ground_speed = clip.ground_speed;
    }
    let baked = Baked {
        name: character.name.clone(),
        submeshes: sliding.submeshes,
        vertices,
        error_max: sequence.steps.last().map_or(0.0, |s| s.error_m),
        impostors: None,
        collapse: sliding.collapse,
        bands: sliding.bands,
        indices: sliding.indices,
        position_min,
        position_extent,
        uv_min,
        uv_extent,
        body_parts: body_parts(character),
        palette,
        clips,
        nodes: character.nodes.clone(),
        joints: character.joints.clone(),
        source_clips,
        textures,
    };
    Ok((baked, times))
}

/// The tightest bands whose bytes fit, or the widest.
fn order_within_budget(
    mesh: &Mesh,
    source_count: usize,
    sequence: &crate::mesh::CollapseSequence,
    options: &BakeOptions,
) -> Result<SlidingTris, BakeError> {
    if options.single_window {
        return sliding_tris::order(mesh, sequence, BandForm::SingleWindow);
    }
    let mut ordered = SlidingTris::default();
    for ratio in BAND_RATIOS {
        ordered = sliding_tris::order(mesh, sequence, BandForm::Collapsed { ratio })?;
        let bytes = ordered.collapse.len()
            * (size_of::<Vertex>() + size_of::<crate::baked::CollapseEntry>())
            + indices::pack(&ordered.indices).len()
            + size_of_val(&ordered.bands[..]);
        if bytes as f32 <= options.bytes_per_vertex * source_count as f32 {
            break;
        }
    }
    Ok(ordered)
}

/// Least value and extent per axis; zeros where there is nothing.
fn extent<const N: usize>(values: impl Iterator<Item = [f32; N]>) -> ([f32; N], [f32; N]) {
    let (mut min, mut max) = ([f32::INFINITY; N], [f32::NEG_INFINITY; N]);
    for v in values {
        for i in 0..N {
            min[i] = min[i].min(v[i]);
            max[i] = max[i].max(v[i]);
        }
    }
    if min[0] > max[0] {
        return ([0.0; N], [0.0; N]);
    }
    let mut size = [0.0; N];
    for i in 0..N {
        size[i] = max[i] - min[i];
    }
    (min, size)
}

fn encode(
    mesh: &Mesh,
    v: usize,
    position_min: Vec3,
    position_extent: Vec3,
    uv_min: Vec2,
    uv_extent: Vec2,
) -> Vertex {
    let axis = |i: usize| {
        quantize::encode_unorm16(mesh.positions[v][i], position_min[i], position_extent[i])
    };
    let uv = |i: usize| {
        if mesh.layers[v] == Mesh::UNTEXTURED {
            0
        } else {
            quantize::encode_unorm16(mesh.uvs[v][i], uv_min[i], uv_extent[i])
        }
    };
    let (joints, weights) = quantize::encode_influences(mesh.joints[v], mesh.weights[v]);
    Vertex {
        position: [axis(0), axis(1), axis(2)],
        layer: mesh.layers[v],
        body_part: mesh.body_parts[v],
        normal: quantize::encode_normal(mesh.normals[v]),
        uv: [uv(0), uv(1)],
        color: mesh.colors[v],
        joints,
        weights,
    }
}
