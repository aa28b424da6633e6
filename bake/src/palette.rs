//! Samples the clips into the palette texture and finds bounds that hold in every frame.
//!
//! Source: Ramos et al. 2012, §3.2 (all frames of all animations in one texture).

use glam::{Affine3A, Vec3};
use rayon::prelude::*;

use crate::baked::{BakedClip, PaletteEntry};
use crate::character::{Character, Clip};
use crate::error::BakeError;
use crate::ground_speed::{self, ground_speed};
use crate::mesh::Mesh;
use crate::pose;

/// Most palette entries (joints times frames): 256 MiB of them.
const MAX_PALETTE_ENTRIES: u64 = 256 * 1024 * 1024 / 48;

/// Frames that differ by less than this share of the model's size are one still.
const STILL_TOLERANCE: f32 = 1e-6;

/// The palette of all clips, `[frame_count][joint_count]`, and where each clip stands in it.
///
/// The first frame of a clip stands at 0, the last at its duration, `frame_rate_hz` or slightly more in between.
/// A character without clips gets one still of its rest pose. Ground speeds that clips do not state are measured
/// (`ground_speed`). Bounds hold for every vertex at every frame, hence
/// also between frames and in blends, which are weighted means of them.
///
/// Errors: [`BakeError::Limit`] when the palette would not fit.
pub fn sample_clips(
    character: &Character,
    mesh: &Mesh,
    frame_rate_hz: f32,
) -> Result<(Vec<PaletteEntry>, Vec<BakedClip>), BakeError> {
    let rest = [Clip {
        name: "rest".into(),
        ..Clip::default()
    }];
    let clips = if character.clips.is_empty() {
        &rest[..]
    } else {
        &character.clips
    };
    let frame_counts: Vec<u64> = clips
        .iter()
        .map(|c| (f64::from(c.duration_s) * f64::from(frame_rate_hz) - 1e-3).ceil() as u64 + 1)
        .collect();
    let entries = frame_counts.iter().fold(0u64, |sum, &n| {
        sum.saturating_add(n.saturating_mul(character.joints.len() as u64))
    });
    if entries > MAX_PALETTE_ENTRIES {
        return Err(BakeError::Limit {
            character: character.name.clone(),
            what: "palette entries (joints times frames of all clips)",
            count: entries,
            limit: MAX_PALETTE_ENTRIES,
        });
    }
    let cloud = distinct_vertices(mesh);
    // Others wait for coarser levels, and may stand below all soles.
    let mut is_drawn = vec![false; mesh.vertex_count()];
    for &v in mesh.triangles.iter().flatten() {
        is_drawn[v as usize] = true;
    }
    let baked: Vec<(Vec<Vec<Affine3A>>, BakedClip)> = clips
        .par_iter()
        .zip(&frame_counts)
        .map(|(clip, &frame_count)| {
            let frames = frames(character, clip, frame_count as usize);
            let bounds = bounds(mesh, &cloud, &is_drawn, &frames);
            let frame_s = clip.duration_s / (frames.len() - 1).max(1) as f32;
            let baked = BakedClip {
                name: clip.name.clone(),
                first_frame: 0,
                frame_count: frames.len() as u32,
                duration_s: clip.duration_s,
                ground_speed: match clip.ground_speed {
                    0.0 => {
                        let rows = bounds.ground..bounds.max.y;
                        ground_speed(mesh, &bounds.soles, &frames, frame_s, rows)
                    }
                    stated => stated,
                },
                box_min: bounds.min,
                box_max: bounds.max,
                sphere_center: bounds.center,
                sphere_radius: bounds.radius,
            };
            (frames, baked)
        })
        .collect();
    let mut palette = Vec::with_capacity(entries as usize);
    let mut out = Vec::with_capacity(baked.len());
    for (frames, mut clip) in baked {
        clip.first_frame = (palette.len() / character.joints.len()) as u32;
        palette.extend(frames.iter().flatten().map(PaletteEntry::from_affine));
        out.push(clip);
    }
    Ok((palette, out))
}

fn frames(character: &Character, clip: &Clip, frame_count: usize) -> Vec<Vec<Affine3A>> {
    let last = (frame_count - 1).max(1) as f32;
    let mut frames: Vec<Vec<Affine3A>> = (0..frame_count)
        .map(|f| pose::palette(character, Some(clip), clip.duration_s * (f as f32 / last)))
        .collect();
    let still = frames[1..].iter().all(|f| {
        f.iter()
            .zip(&frames[0])
            .all(|(a, b)| a.abs_diff_eq(*b, STILL_TOLERANCE))
    });
    if still {
        frames.truncate(1);
    }
    frames
}

/// One vertex for each position and skinning.
fn distinct_vertices(mesh: &Mesh) -> Vec<u32> {
    let mut seen = std::collections::HashSet::new();
    (0..mesh.vertex_count() as u32)
        .filter(|&v| {
            let v = v as usize;
            seen.insert((
                mesh.positions[v].to_array().map(f32::to_bits),
                mesh.joints[v],
                mesh.weights[v].map(f32::to_bits),
            ))
        })
        .collect()
}

struct Bounds {
    min: Vec3,
    max: Vec3,
    center: Vec3,
    radius: f32,
    /// The lowest that vertices of the full mesh come, and those that come near to it.
    ground: f32,
    soles: Vec<u32>,
}

fn bounds(mesh: &Mesh, cloud: &[u32], is_drawn: &[bool], frames: &[Vec<Affine3A>]) -> Bounds {
    let (mut min, mut max) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let mut lowest = vec![f32::INFINITY; cloud.len()];
    for frame in frames {
        for (&v, lowest) in cloud.iter().zip(&mut lowest) {
            let p = mesh.posed(frame, v as usize);
            (min, max) = (min.min(p), max.max(p));
            *lowest = lowest.min(p.y);
        }
    }
    let mut soles: Vec<(u32, f32)> = cloud.iter().copied().zip(lowest).collect();
    soles.retain(|&(v, _)| is_drawn[v as usize]);
    let ground = soles.iter().map(|s| s.1).fold(f32::INFINITY, f32::min);
    let near = ground + ground_speed::LEVEL * (max.y - min.y);
    soles.retain(|&(_, lowest)| lowest < near);
    let center = (min + max) * 0.5;
    let mut radius = 0.0f32;
    for frame in frames {
        for &v in cloud {
            radius = radius.max(mesh.posed(frame, v as usize).distance_squared(center));
        }
    }
    // Quantised positions and weights move vertices by less than this.
    let slack = (max - min).length() * 1e-3;
    Bounds {
        min: min - slack,
        max: max + slack,
        center,
        radius: radius.sqrt() + slack,
        ground,
        soles: soles.into_iter().map(|s| s.0).collect(),
    }
}
