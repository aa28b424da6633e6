//! The poses in which simplification measures its error.

use glam::Affine3A;

use crate::character::Character;
use crate::impostor::groups::{Extremity, hanging_in};
use crate::mesh::Mesh;
use crate::pose;

use super::rig::Rig;

/// Frames of every clip that are looked at before some are chosen.
const FRAMES_PER_CLIP: usize = 8;
/// Frames that are looked at over all clips.
const CANDIDATES_MAX: usize = 240;
/// How much more a frame of a clip that moves the character about counts: crowds walk and run.
const LOCOMOTION_WEIGHT: f32 = 3.0;
/// Words in the names of such clips.
const LOCOMOTION: [&str; 6] = ["walk", "run", "jog", "gallop", "trot", "sprint"];
/// Lengths that describe a pose when two are compared.
const DESCRIPTOR_LEN: usize = 192;

/// A palette, and the share of the animation that it stands for.
#[derive(Debug, Clone)]
pub struct Pose {
    /// `model_from_bind` of every palette joint.
    pub palette: Vec<Affine3A>,
    /// Not negative; the weights of a set sum to 1.
    pub weight: f32,
}

/// Representative poses of a character; never empty.
#[derive(Debug, Clone, Default)]
pub struct PoseSet {
    /// The poses, the most typical first.
    pub poses: Vec<Pose>,
    /// The palette at rest, which few look at but editors show first; empty where it is unknown or one of the poses.
    pub rest: Vec<Affine3A>,
    /// Per palette joint: it moves a head, which people look at. Joints beyond the end do not.
    pub heads: Vec<bool>,
    /// How the joints make limbs; none where there are no joints to speak of.
    pub rig: Rig,
}

impl PoseSet {
    /// Poses per character unless said otherwise. 12 have 6 percent less deviation in the mean, for a tenth more time of a bake.
    pub const DEFAULT_COUNT: usize = 8;

    /// At most `count` poses that together stand for all clips of `character`: the rest pose where it has none.
    ///
    /// Poses are picked one after the other, each the one that differs most from those already picked, and weighted by
    /// the frames that are nearest to them, frames of locomotion clips counting more. Close to the representative poses
    /// of Zhao et al. (VDR-AM), chosen by farthest points instead of clustering.
    pub fn choose(character: &Character, mesh: &Mesh, count: usize) -> Self {
        let per_clip = (CANDIDATES_MAX / character.clips.len().max(1)).clamp(1, FRAMES_PER_CLIP);
        let mut candidates = Vec::new();
        for clip in &character.clips {
            let name = clip.name.to_lowercase();
            let moves = LOCOMOTION.iter().any(|word| name.contains(word));
            let weight = if moves { LOCOMOTION_WEIGHT } else { 1.0 };
            for frame in 0..per_clip {
                let time_s = clip.duration_s * frame as f32 / per_clip as f32;
                let palette = pose::palette(character, Some(clip), time_s);
                // A clip may animate a scale to nothing or carry absurd keys; such a frame says nothing about the surface.
                if palette.iter().all(|m| m.is_finite()) {
                    candidates.push(Pose { palette, weight });
                }
            }
        }
        let has_clips = !candidates.is_empty();
        if !has_clips {
            candidates.push(Pose {
                palette: pose::palette(character, None, 0.0),
                weight: 1.0,
            });
        }
        let rest = pose::palette(character, None, 0.0);
        let known = has_clips && rest.iter().all(|m| m.is_finite());
        Self {
            rest: if known { rest } else { Vec::new() },
            heads: hanging_in(Extremity::Head, &character.nodes, &character.joints),
            rig: Rig::of(character, mesh),
            ..Self::among(candidates, mesh, count)
        }
    }

    /// At most `count` poses out of `candidates`, which must not be empty; nothing about rest and heads.
    pub fn among(candidates: Vec<Pose>, mesh: &Mesh, count: usize) -> Self {
        let described: Vec<Vec<f32>> = candidates
            .iter()
            .map(|c| descriptor(mesh, &c.palette))
            .collect();
        // The first is the one nearest to the weighted mean: the most typical.
        let total: f32 = candidates.iter().map(|c| c.weight).sum();
        let mut mean = vec![0.0; described[0].len()];
        for (c, d) in candidates.iter().zip(&described) {
            mean.iter_mut()
                .zip(d)
                .for_each(|(m, d)| *m += d * c.weight / total);
        }
        let first = argmin(described.iter().map(|d| distance_squared(d, &mean)));
        let mut chosen = vec![first];
        let mut nearest = vec![0; candidates.len()];
        let mut gap: Vec<f32> = described
            .iter()
            .map(|d| distance_squared(d, &described[first]))
            .collect();
        while chosen.len() < count.min(candidates.len()) {
            // Of two equally different frames the one from a locomotion clip is the better pick.
            let next = argmin(gap.iter().zip(&candidates).map(|(g, c)| -g * c.weight));
            if gap[next] <= 1e-10 * described[next].iter().map(|x| x * x).sum::<f32>() {
                break;
            }
            for (i, d) in described.iter().enumerate() {
                let to_next = distance_squared(d, &described[next]);
                if to_next < gap[i] {
                    gap[i] = to_next;
                    nearest[i] = chosen.len();
                }
            }
            chosen.push(next);
        }
        let mut weights = vec![0.0; chosen.len()];
        for (i, c) in candidates.iter().enumerate() {
            weights[nearest[i]] += c.weight / total;
        }
        let poses = chosen
            .iter()
            .zip(weights)
            .map(|(&i, weight)| Pose {
                palette: candidates[i].palette.clone(),
                weight,
            })
            .collect();
        Self {
            poses,
            ..Self::default()
        }
    }
}

/// Distances between fixed pairs of posed vertices: two poses that differ by a rigid motion have the same.
fn descriptor(mesh: &Mesh, palette: &[Affine3A]) -> Vec<f32> {
    let count = mesh.vertex_count();
    (0..DESCRIPTOR_LEN)
        .map(|k| {
            // Two low-discrepancy walks over the vertices.
            let at = |step: f64| ((k as f64 * step).fract() * count as f64) as usize;
            mesh.posed(palette, at(0.618_033_988_749))
                .distance(mesh.posed(palette, at(0.414_213_562_373)))
        })
        .collect()
}

fn distance_squared(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// Index of the first smallest value.
fn argmin(values: impl Iterator<Item = f32>) -> usize {
    values
        .enumerate()
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map_or(0, |x| x.0)
}
