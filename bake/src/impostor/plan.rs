//! Plans the pictures of each kind: their rectangles, texels and poses.

use glam::{UVec2, Vec2, Vec3};

use super::build::ImpostorOptions;
use super::capture::CaptureView;
use super::clip_poses;
use super::groups::Groups;
use super::picture::padded;
use super::pose::{self, Skin};
use super::{NO_JOINT, PoseRange, Quad, ViewSet};
use crate::baked::{Baked, PaletteEntry};

/// Surface with less than this weight in a group is never in its pictures.
pub(super) const LEAST_WEIGHT: f32 = 0.04;
/// Surface with this weight often is: sizes are estimated from it.
const SHOWN_WEIGHT: f32 = 0.25;

/// Shares of the wanted views of `Quad` that are tried where memory is short.
const FEWER_VIEWS: [f32; 3] = [0.84, 0.7, 0.59];

/// A picture to take, a tile to be.
pub(super) struct Shot {
    /// Pose of the clips; none for bind space.
    pub pose: Option<u32>,
    /// Its group; none for the whole body.
    pub group: Option<u8>,
    center: Vec3,
    right: Vec3,
    up: Vec3,
    depth_extent: f32,
    /// Left and top edge in the plane.
    pub corner: Vec2,
    /// Side of a texel.
    pub texel: f32,
    /// Columns and rows.
    pub size: UVec2,
}

impl Shot {
    /// The question to the renderer.
    pub fn view(&self, pose: u32, group: Option<u8>, supersample: u32) -> CaptureView {
        let extent = self.size.as_vec2() * self.texel;
        CaptureView {
            pose,
            group,
            center: self.center,
            right: self.right,
            up: self.up,
            min: Vec2::new(self.corner.x, self.corner.y - extent.y),
            max: Vec2::new(self.corner.x + extent.x, self.corner.y),
            depth_extent: self.depth_extent,
            size: (self.size * supersample).to_array(),
        }
    }
}

/// A rectangle of whole texels around the points, one texel larger on each side: corner and size.
fn rectangle(points: &[Vec3], center: Vec3, right: Vec3, up: Vec3, texel: f32) -> (Vec2, UVec2) {
    let (mut min, mut max) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
    for &p in points {
        let at = Vec2::new((p - center).dot(right), (p - center).dot(up));
        (min, max) = (min.min(at), max.max(at));
    }
    if min.x > max.x {
        return (Vec2::ZERO, UVec2::ZERO);
    }
    let size = ((max - min) / texel).ceil().max(Vec2::ONE).as_uvec2() + 2;
    let middle = (min + max) * 0.5;
    let half = size.as_vec2() * texel * 0.5;
    (Vec2::new(middle.x - half.x, middle.y + half.y), size)
}

/// Height of the first clip's first pose, model space; for lying things at least half of their length.
pub(super) fn height(baked: &Baked, skins: &[Skin]) -> f32 {
    let palette = pose::affines(&pose::palette_at(baked, 0, 0.0));
    let (min, max) = pose::bounds(skins.iter().map(|s| s.posed(&palette)));
    let extent = max - min;
    extent.y.max(0.5 * extent.max_element()).max(1e-6)
}

/// The pictures of a kind, and what draws them. Quads count tiles and view sets from the plan's own first.
pub(super) struct Plan {
    pub view_sets: Vec<ViewSet>,
    pub quads: Vec<Quad>,
    pub clip_poses: Vec<PoseRange>,
    /// Parallel to the tiles.
    pub shots: Vec<Shot>,
    /// Texels that the tiles will take, roughly.
    pub expected_texels: u64,
}

/// Plans the pictures of groups, with texels coarser than the options' by a factor.
pub(super) fn plan_flat(
    baked: &Baked,
    groups: &Groups,
    options: &ImpostorOptions,
    height: f32,
    coarser: f32,
) -> Plan {
    let clouds = |least| pose::group_clouds(baked, &groups.of_joint, groups.groups.len(), least);
    let (clouds, shown_clouds) = (clouds(LEAST_WEIGHT), clouds(SHOWN_WEIGHT));
    let mut plan = Plan {
        view_sets: vec![ViewSet::icosahedral(options.body_view_cuts, -1.0)],
        quads: Vec::new(),
        clip_poses: Vec::new(),
        shots: Vec::new(),
        expected_texels: 0,
    };
    let mut head_set = 0;
    if groups.groups.iter().any(|g| g.is_head) && options.head_view_cuts != options.body_view_cuts {
        head_set = 1;
        plan.view_sets
            .push(ViewSet::icosahedral(options.head_view_cuts, -1.0));
    }
    let first_pose = pose::palette_at(baked, 0, 0.0);
    for (g, group) in groups.groups.iter().enumerate() {
        let cloud = &clouds[g];
        let (min, max) = pose::bounds(cloud.iter().copied());
        let center = (min + max) * 0.5;
        let (view_set, boost) = if group.is_head {
            (head_set, options.head_boost)
        } else {
            (0, 1.0)
        };
        let scale = scale(&first_pose[group.driver as usize]);
        let texel = height / scale / options.texels_per_height / boost * coarser;
        let radius = cloud.iter().map(|p| p.distance(center)).fold(0.0, f32::max);
        let depth_extent = radius + 2.0 * texel;
        plan.quads.push(Quad {
            name: group.name.clone(),
            joint: group.driver,
            center,
            depth_extent,
            first_tile: plan.shots.len() as u32,
            view_set: view_set as u32,
        });
        let views = &plan.view_sets[view_set];
        for (view, &right) in views.rights.iter().enumerate() {
            let up = views.up(view);
            let (corner, size) = rectangle(cloud, center, right, up, texel);
            let shown = rectangle(&shown_clouds[g], center, right, up, texel).1;
            let tile = padded(
                shown.saturating_sub(UVec2::splat(2)),
                options.margin(),
                options.multiple(),
            );
            plan.expected_texels += u64::from(tile.x) * u64::from(tile.y);
            plan.shots.push(Shot {
                pose: None,
                group: Some(g as u8),
                center,
                right,
                up,
                depth_extent,
                corner,
                texel,
                size,
            });
        }
    }
    plan
}

/// Metres of model space per unit of bind space under a palette entry.
fn scale(entry: &PaletteEntry) -> f32 {
    let volume = entry.to_affine().matrix3.determinant().abs();
    if volume > 1e-18 { volume.cbrt() } else { 1.0 }
}

/// Plans the pictures of the whole body, as many and as fine as fit.
pub(super) fn plan_quad(
    baked: &Baked,
    skins: &[Skin],
    options: &ImpostorOptions,
    height: f32,
    texel_limit: u64,
    warnings: &mut Vec<String>,
) -> Plan {
    let wanted = height / options.quad_texels_per_height;
    let depth = clip_poses::depths(baked, skins);
    let most = ViewSet::icosahedral(options.quad_view_cuts, options.quad_lowest_y);
    let planned = |share: f32| {
        let count = (most.directions.len() as f32 * share) as usize;
        let (views, turn) = ViewSet::spread(count, options.quad_lowest_y, &depth);
        let plan = clip_poses::plan(
            baked,
            skins,
            (&views, turn),
            wanted,
            options.quad_poses_per_clip,
            texel_limit,
            (options.margin(), options.multiple()),
        );
        (views, plan)
    };
    let (mut views, mut plan) = planned(1.0);
    for share in FEWER_VIEWS {
        if !plan.is_reduced {
            break;
        }
        // Characters with many clips may be better off with fewer views of finer pictures.
        let fewer = planned(share);
        if fewer.1.error < plan.error {
            (views, plan) = fewer;
        }
    }
    let texel = wanted / plan.share;
    let pose_count: u32 = plan.ranges.iter().map(|r| r.pose_count).sum();
    if plan.is_reduced {
        warnings.push(format!(
            "one-quad impostors have {:.0} texels along the height, {} views and {pose_count} poses in {} clips: more would \
             exceed the memory limit",
            options.quad_texels_per_height * plan.share,
            views.directions.len(),
            baked.clips.len()
        ));
    }
    let boxes = baked.clips.iter().flat_map(|c| [c.box_min, c.box_max]);
    let (min, max) = pose::bounds(boxes);
    let (center, depth_extent) = ((min + max) * 0.5, (max - min).length() * 0.5 + texel);
    let mut shots = Vec::new();
    for (clip, range) in plan.ranges.iter().enumerate() {
        for p in 0..range.pose_count {
            let palette = pose::affines(&pose::palette_at(
                baked,
                clip,
                p as f32 / range.pose_count as f32,
            ));
            let points: Vec<Vec3> = skins.iter().map(|s| s.posed(&palette)).collect();
            for (view, &right) in views.rights.iter().enumerate() {
                let up = views.up(view);
                let (corner, size) = rectangle(&points, center, right, up, texel);
                shots.push(Shot {
                    pose: Some(range.first_pose + p),
                    group: None,
                    center,
                    right,
                    up,
                    depth_extent,
                    corner,
                    texel,
                    size,
                });
            }
        }
    }
    Plan {
        quads: vec![Quad {
            name: "body".into(),
            joint: NO_JOINT,
            center,
            depth_extent,
            first_tile: 0,
            view_set: 0,
        }],
        view_sets: vec![views],
        clip_poses: plan.ranges,
        shots,
        expected_texels: texel_limit,
    }
}
