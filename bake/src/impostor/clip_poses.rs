//! Which poses of the clips whole-body pictures are taken in, and how large they may be.

use glam::{Affine3A, UVec2, Vec3};

use super::picture::padded;
use super::pose::{Skin, affines, palette_at};
use super::{PoseRange, ViewSet};
use crate::baked::Baked;

/// Vertices that the change of a pose is measured on.
const MEASURED_VERTICES: usize = 400;
/// Poses of a clip that sizes are estimated from.
const SIZED_POSES: usize = 4;
/// What a texel, a step from pose to pose and a turn to the nearest view cost in silhouettes, as shares of their sizes;
/// chosen by measured overlap with the mesh.
const TEXEL_COST: f32 = 0.35;
const STEP_COST: f32 = 0.12;
const TURN_COST: f32 = 0.5;
/// Sizes tried, as shares of the wanted resolution.
const SHARES: [f32; 13] = [
    1.0, 0.9, 0.8, 0.7, 0.65, 0.6, 0.55, 0.5, 0.45, 0.4, 0.35, 0.3, 0.25,
];

/// What was decided.
pub(super) struct PosePlan {
    /// Expected error, model-space units.
    pub error: f32,
    /// By clip.
    pub ranges: Vec<PoseRange>,
    /// Share of the wanted texels per height.
    pub share: f32,
    /// Fewer poses or texels than wanted.
    pub is_reduced: bool,
}

/// Measures of one clip.
struct ClipSize {
    /// Distance that the surface travels over the clip, root mean square over the surface.
    travel: f32,
    /// Most poses that make sense.
    most: u32,
    /// Extent of sample pictures, `[pose][view]`, with how many of them stand for one pose.
    extents: Vec<(f32, f32)>,
}

/// Chooses poses per clip and texels so that all pictures take at most `texel_limit` texels and the expected error is
/// smallest.
pub(super) fn plan(
    baked: &Baked,
    skins: &[Skin],
    views: &ViewSet,
    texel: f32,
    most_poses: u32,
    texel_limit: u64,
    (margin, multiple): (u32, u32),
) -> PosePlan {
    let clips: Vec<ClipSize> = (0..baked.clips.len())
        .map(|c| measure(baked, skins, views, c, most_poses))
        .collect();
    let total = |share: f32, step: f32| -> u64 {
        let side = texel / share;
        clips
            .iter()
            .map(|c| {
                let samples = (c.extents.len() / views.directions.len()).max(1) as u64;
                let area: u64 = c
                    .extents
                    .iter()
                    .map(|&(w, h)| {
                        let content = UVec2::new(
                            (w / side + 0.7).ceil() as u32,
                            (h / side).ceil() as u32 + 1,
                        );
                        let size = padded(content, margin, multiple);
                        u64::from(size.x) * u64::from(size.y)
                    })
                    .sum();
                area / samples * u64::from(pose_count(c, step))
            })
            .sum()
    };
    // Finest step first; each next one has fewer poses.
    let steps: Vec<f32> = (0..60).map(|i| texel * 0.5 * 1.12f32.powi(i)).collect();
    let mut best: Option<(f32, f32, f32)> = None;
    for share in SHARES {
        let fits = steps
            .iter()
            .copied()
            .find(|&step| total(share, step) <= texel_limit);
        if let Some(step) = fits {
            let error = TEXEL_COST * texel / share + STEP_COST * step;
            if best.is_none_or(|b| error < b.0) {
                best = Some((error, share, step));
            }
        }
    }
    let (error, share, step) =
        best.unwrap_or((f32::INFINITY, SHARES[SHARES.len() - 1], f32::INFINITY));
    // Directions are this far from the nearest view on average; surface turns with them about the body's axis.
    let turn = 0.37 * (4.0 * std::f32::consts::PI / views.directions.len() as f32).sqrt();
    let widths: f32 = clips
        .iter()
        .map(|c| mean(c.extents.iter().map(|e| e.0)))
        .sum();
    let radius = 0.5 * widths / clips.len() as f32;
    let mut first_pose = 0;
    let ranges = clips.iter().map(|c| {
        let range = PoseRange {
            first_pose,
            pose_count: pose_count(c, step),
        };
        first_pose += range.pose_count;
        range
    });
    PosePlan {
        error: error + TURN_COST * turn * radius,
        ranges: ranges.collect(),
        share,
        is_reduced: share < 1.0 || step > steps[0],
    }
}

fn pose_count(clip: &ClipSize, step: f32) -> u32 {
    ((clip.travel / step).ceil() as u32).clamp(1, clip.most)
}

fn measure(
    baked: &Baked,
    skins: &[Skin],
    views: &ViewSet,
    clip: usize,
    most_poses: u32,
) -> ClipSize {
    let frame_count = baked.clips[clip].frame_count;
    let intervals = frame_count - 1;
    let few: Vec<&Skin> = skins
        .iter()
        .step_by(skins.len().div_ceil(MEASURED_VERTICES).max(1))
        .collect();
    let pose = |phase: f32| affines(&palette_at(baked, clip, phase));
    let posed =
        |palette: Vec<Affine3A>| -> Vec<Vec3> { few.iter().map(|s| s.posed(&palette)).collect() };
    let mut travel = 0.0;
    let mut before = posed(pose(0.0));
    for frame in 1..frame_count {
        let now = posed(pose(frame as f32 / intervals as f32));
        let squares: f32 = now
            .iter()
            .zip(&before)
            .map(|(a, b)| a.distance_squared(*b))
            .sum();
        travel += (squares / few.len().max(1) as f32).sqrt();
        before = now;
    }
    let samples = (SIZED_POSES as u32).min(frame_count);
    let mut extents = Vec::new();
    for s in 0..samples {
        let palette = pose(s as f32 / samples as f32);
        let points: Vec<Vec3> = few.iter().map(|s| s.posed(&palette)).collect();
        for (view, right) in views.rights.iter().enumerate() {
            let extent = |axis: Vec3| {
                let (mut min, mut max) = (f32::INFINITY, f32::NEG_INFINITY);
                for p in &points {
                    let x = p.dot(axis);
                    (min, max) = (min.min(x), max.max(x));
                }
                (max - min).max(0.0)
            };
            extents.push((extent(*right), extent(views.up(view))));
        }
    }
    ClipSize {
        travel,
        most: most_poses.min(intervals).max(1),
        extents,
    }
}

fn mean(values: impl ExactSizeIterator<Item = f32>) -> f32 {
    let count = values.len().max(1);
    values.sum::<f32>() / count as f32
}
