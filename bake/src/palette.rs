//! Samples the clips into the palette texture and finds bounds that hold in every frame.
//!
//! Source: Ramos et al. 2012, §3.2 (all frames of all animations in one texture).

use glam::{Affine3A, Vec3};
use rayon::prelude::*;

use crate::baked::{BakedClip, PaletteEntry};
use crate::character::{Character, Clip};
use crate::error::BakeError;
use crate::ground_speed::{self, ground_speed};
use crate::impostor::groups::{Extremity, hanging_in};
use crate::mesh::Mesh;
use crate::pose;

/// Most palette entries (joints times frames): 256 MiB of them.
const MAX_PALETTE_ENTRIES: u64 = 256 * 1024 * 1024 / 48;

/// Feet stand on the ground unless something is lower by this share of the height: what hands hold reaches through it, but the
/// feet of a rider hang in the air.
const BELOW_FEET: f32 = 0.3;

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
    let limbs = Limbs::of(character, mesh);
    let baked: Vec<(Vec<Vec<Affine3A>>, BakedClip)> = clips
        .par_iter()
        .zip(&frame_counts)
        .map(|(clip, &frame_count)| {
            let frames = frames(character, clip, frame_count as usize);
            let bounds = bounds(mesh, &cloud, &limbs, &frames);
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
                ground: bounds.ground,
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

/// What a character may stand on.
struct Limbs {
    /// The joint that each vertex follows most; none where a vertex waits for coarser levels, which may be below all soles.
    main_joint: Vec<Option<u8>>,
    /// Whether a joint is one of a foot.
    feet: Vec<bool>,
}

impl Limbs {
    fn of(character: &Character, mesh: &Mesh) -> Self {
        let mut main_joint = vec![None; mesh.vertex_count()];
        for v in mesh.triangles.iter().flatten().map(|&v| v as usize) {
            let influences = mesh.weights[v].into_iter().zip(mesh.joints[v]);
            main_joint[v] = influences
                .max_by(|a, b| a.0.total_cmp(&b.0))
                .map(|(_, joint)| joint);
        }
        Self {
            main_joint,
            feet: hanging_in(Extremity::Foot, &character.nodes, &character.joints),
        }
    }

    /// The height of the ground, and the vertices that stand on it, of all with the lowest that they come; `height` is the
    /// character's.
    fn ground(&self, lowest: &[(u32, f32)], height: f32) -> (f32, Vec<u32>) {
        let joint_of = |v: u32| self.main_joint[v as usize].map(usize::from);
        let mut of_joint = vec![f32::INFINITY; 256];
        for &(v, low) in lowest {
            if let Some(joint) = joint_of(v) {
                of_joint[joint] = of_joint[joint].min(low);
            }
        }
        let least = |a: f32, (_, &b): (usize, &f32)| a.min(b);
        let joints = || of_joint.iter().enumerate();
        let all = joints().fold(f32::INFINITY, least);
        let feet = joints()
            .filter(|&(j, _)| self.feet.get(j) == Some(&true))
            .fold(f32::INFINITY, least);
        let ground = if feet - all < BELOW_FEET * height {
            feet
        } else {
            all
        };
        // Hands may be paws; what hangs from them through the ground is no sole.
        let near = ground_speed::LEVEL * height;
        let is_sole = |&(v, low): &(u32, f32)| {
            low < ground + near && joint_of(v).is_some_and(|j| of_joint[j] > ground - near)
        };
        let soles = lowest.iter().copied().filter(is_sole);
        (ground, soles.map(|(v, _)| v).collect())
    }
}

struct Bounds {
    min: Vec3,
    max: Vec3,
    center: Vec3,
    radius: f32,
    /// The lowest that what stands comes, and the vertices that come near to it.
    ground: f32,
    soles: Vec<u32>,
}

fn bounds(mesh: &Mesh, cloud: &[u32], limbs: &Limbs, frames: &[Vec<Affine3A>]) -> Bounds {
    let (mut min, mut max) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let mut lowest = vec![f32::INFINITY; cloud.len()];
    for frame in frames {
        for (&v, lowest) in cloud.iter().zip(&mut lowest) {
            let p = mesh.posed(frame, v as usize);
            (min, max) = (min.min(p), max.max(p));
            *lowest = lowest.min(p.y);
        }
    }
    let lowest: Vec<(u32, f32)> = cloud.iter().copied().zip(lowest).collect();
    let (ground, soles) = limbs.ground(&lowest, max.y - min.y);
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
        soles,
    }
}
