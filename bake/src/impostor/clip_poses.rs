//! Which poses of the clips whole-body pictures are taken in, and how large they may be.

use glam::{Affine3A, UVec2, Vec3};

use super::picture::padded;
use super::pose::{Skin, affines, palette_at};
use super::{PoseRange, ViewSet};
use crate::baked::Baked;

/// Vertices that the change of a pose is measured on.
const MEASURED_VERTICES: usize = 400;
/// Poses of all clips that depths are measured in.
const DEPTH_POSES: usize = 14;
/// Poses of a clip that sizes are estimated from.
const SIZED_POSES: usize = 4;
/// What a step from pose to pose and a turn to the nearest view cost in silhouettes beside a texel, as factors of their squares:
/// independent errors add up as squares do. Fitted to measured overlaps with the mesh.
const STEP_COST: f32 = 0.25;
const TURN_COST: f32 = 3.5;
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

/// How deep the body is along a direction towards the eye, beside the plane that its picture leans as: root mean square over
/// the surface and some poses of all clips, model-space units.
pub(super) fn depths(baked: &Baked, skins: &[Skin]) -> impl Fn(Vec3) -> f32 + use<> {
    let few: Vec<&Skin> = skins
        .iter()
        .step_by(skins.len().div_ceil(MEASURED_VERTICES).max(1))
        .collect();
    let bodies: Vec<Vec<Vec3>> = (0..DEPTH_POSES)
        .map(|k| {
            let at = k as f32 / DEPTH_POSES as f32 * baked.clips.len() as f32;
            let palette = affines(&palette_at(baked, at as usize, at.fract()));
            few.iter().map(|s| s.posed(&palette)).collect()
        })
        .collect();
    move |direction| {
        let right = Vec3::Y.cross(direction).try_normalize().unwrap_or(Vec3::X);
        let up = direction.cross(right);
        let mut sum = 0.0;
        for body in &bodies {
            let seen = |p: &Vec3| (Vec3::new(p.dot(right), p.dot(up), p.dot(direction)), 1.0);
            let points: Vec<(Vec3, f32)> = body.iter().map(seen).collect();
            let plane = super::lean::plane(&points, 0.0);
            let before = |p: &Vec3| p.z - plane.dot(Vec3::new(p.x, p.y, 1.0));
            let squares = points.iter().map(|(p, _)| before(p).powi(2));
            sum += squares.sum::<f32>() / points.len().max(1) as f32;
        }
        (sum / bodies.len().max(1) as f32).sqrt().max(1e-6)
    }
}

/// Chooses poses per clip and texels so that all pictures take at most `texel_limit` texels and the expected error is
/// smallest. `turn` is how far the surface shifts from the nearest view, root mean square.
pub(super) fn plan(
    baked: &Baked,
    skins: &[Skin],
    (views, turn): (&ViewSet, f32),
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
    // As far as poses are apart, mean square over the clips.
    let apart = |step: f32| {
        let squares = clips
            .iter()
            .map(|c| (c.travel / pose_count(c, step) as f32).powi(2));
        squares.sum::<f32>() / clips.len().max(1) as f32
    };
    let error = |side: f32, step: f32| {
        (side * side + STEP_COST * apart(step) + TURN_COST * turn * turn).sqrt()
    };
    let mut best: Option<(f32, f32, f32)> = None;
    for share in SHARES {
        let fits = steps
            .iter()
            .copied()
            .find(|&step| total(share, step) <= texel_limit);
        if let Some(step) = fits {
            let error = error(texel / share, step);
            if best.is_none_or(|b| error < b.0) {
                best = Some((error, share, step));
            }
        }
    }
    let (error, share, step) =
        best.unwrap_or((f32::INFINITY, SHARES[SHARES.len() - 1], f32::INFINITY));
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
        error,
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
