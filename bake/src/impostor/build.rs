//! Builds all impostors of a character from pictures that a renderer takes.

use glam::{UVec2, Vec2, Vec3};

use super::capture::{Capture, CaptureBatch, CaptureView, CapturedView};
use super::clip_poses;
use super::groups::Groups;
use super::lean;
use super::pack;
use super::picture::{Picture, padded};
use super::pose::{self, Skin};
use super::{Impostors, Kind, KindInfo, NO_JOINT, PoseRange, Quad, ViewSet};
use crate::baked::{Baked, PaletteEntry};

/// Bytes of pictures that one batch asks for at most.
const BATCH_BYTES: u64 = 64 << 20;
/// Bytes of a pixel of a capture or of a texel of the atlas.
const TEXEL_BYTES: u64 = 8;
/// What a batch's poses may take besides: joints times poses.
const BATCH_ENTRIES: usize = 1 << 17;
/// Share of the memory limit that is planned for: packing wastes some.
const PLANNED_SHARE: f64 = 0.94;
/// Share of the memory that `Flat` may take where `Quad` is captured, too.
const FLAT_SHARE: f64 = 0.4;
/// Surface with at least this weight belongs to a group's pictures, half less an overlap that closes bent joints.
const LEAST_WEIGHT: f32 = 0.35;

/// What a build of impostors may be told.
#[derive(Debug, Clone, PartialEq)]
pub struct ImpostorOptions {
    /// What to capture.
    pub kinds: Vec<Kind>,
    /// Cuts of the icosahedron's edges for `Flat`: `10 cuts^2 + 2` views.
    pub body_view_cuts: u32,
    /// The same for heads.
    pub head_view_cuts: u32,
    /// The same for `Quad`.
    pub quad_view_cuts: u32,
    /// `Quad` is not captured from below this height on the unit sphere of directions.
    pub quad_lowest_y: f32,
    /// Texels of `Flat` along the character's height.
    pub texels_per_height: f32,
    /// Finer texels for heads by this factor.
    pub head_boost: f32,
    /// Most texels of `Quad` along the character's height.
    pub quad_texels_per_height: f32,
    /// Most poses of a clip for `Quad`.
    pub quad_poses_per_clip: u32,
    /// Most bytes of the atlas, all kinds and mips.
    pub memory_limit_bytes: u64,
    /// Poses that decide what a group shows beyond its own surface; 0 for weights alone.
    pub mask_samples: u32,
    /// Samples of a texel along each axis.
    pub supersample: u32,
    /// Mips of the atlas.
    pub mip_count: u32,
}

impl Default for ImpostorOptions {
    fn default() -> Self {
        Self {
            kinds: vec![Kind::Flat, Kind::Quad],
            body_view_cuts: 3,
            head_view_cuts: 4,
            quad_view_cuts: 3,
            quad_lowest_y: -0.3,
            texels_per_height: 64.0,
            head_boost: 1.5,
            quad_texels_per_height: 40.0,
            quad_poses_per_clip: 16,
            memory_limit_bytes: 16_000_000,
            mask_samples: 12,
            supersample: 4,
            mip_count: 3,
        }
    }
}

impl ImpostorOptions {
    /// Empty texels on each side of a tile: two tiles' contents are a texel apart in the coarsest mip.
    fn margin(&self) -> u32 {
        ((1 << (self.mip_count - 1)) / 2).max(1)
    }

    /// Tiles' places and sizes are multiples of this.
    fn multiple(&self) -> u32 {
        1 << (self.mip_count - 1)
    }

    /// Bytes of all mips for each texel of the first.
    fn bytes_per_texel(&self) -> f64 {
        (0..self.mip_count)
            .map(|m| TEXEL_BYTES as f64 / f64::from(1u32 << (2 * m)))
            .sum()
    }

    /// The first number that makes no sense.
    fn check(&self) -> Result<(), &'static str> {
        let in_range = |ok: bool, reason| if ok { Ok(()) } else { Err(reason) };
        let cuts = [
            self.body_view_cuts,
            self.head_view_cuts,
            self.quad_view_cuts,
        ];
        in_range(
            cuts.iter().all(|c| (1..=8).contains(c)),
            "view cuts are not from 1 to 8",
        )?;
        let texels = [self.texels_per_height, self.quad_texels_per_height];
        in_range(
            texels.iter().all(|t| (4.0..=1024.0).contains(t)),
            "texels per height are not from 4 to 1024",
        )?;
        in_range(
            (1.0..=8.0).contains(&self.head_boost),
            "the head's boost is not from 1 to 8",
        )?;
        in_range(
            (1..=256).contains(&self.quad_poses_per_clip),
            "poses per clip are not from 1 to 256",
        )?;
        in_range(
            (1..=8).contains(&self.supersample),
            "samples along a texel are not from 1 to 8",
        )?;
        in_range(
            (1..=6).contains(&self.mip_count),
            "mips are not from 1 to 6",
        )?;
        in_range(
            self.quad_lowest_y.is_finite(),
            "the lowest view is no number",
        )
    }
}

/// Why impostors could not be built.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError<E> {
    /// The renderer failed.
    #[error(transparent)]
    Capture(E),
    /// The renderer's answer does not fit the question: a fault of the renderer.
    #[error("captured picture {picture}: {reason}")]
    Answer {
        /// Number of the picture in its batch.
        picture: usize,
        /// What is wrong with it.
        reason: &'static str,
    },
    /// An option is out of its range.
    #[error("impostor options: {0}")]
    Options(&'static str),
    /// The pictures do not fit an atlas, however small.
    #[error("the pictures fit no atlas of {bytes} bytes")]
    TooLarge {
        /// The memory limit.
        bytes: u64,
    },
}

/// Built impostors, and what the user should know of them.
#[derive(Debug, Clone, PartialEq)]
pub struct Built {
    /// The impostors.
    pub impostors: Impostors,
    /// What is coarser than asked for, one sentence each.
    pub warnings: Vec<String>,
}

/// Builds the impostors of `baked`, which is valid. `progress` hears the share of pictures taken, rising to 1. The same
/// character, options and pictures give the same bytes.
///
/// Errors: [`BuildError::Capture`] with what `capture` says; the others are for options and faults of the renderer.
pub fn build<E>(
    baked: &Baked,
    groups: &Groups,
    options: &ImpostorOptions,
    capture: &mut Capture<E>,
    progress: &mut dyn FnMut(f32),
) -> Result<Built, BuildError<E>> {
    options.check().map_err(BuildError::Options)?;
    let mut out = Impostors::default();
    let mut warnings = Vec::new();
    let skins = Skin::of(baked);
    let has = |kind| options.kinds.contains(&kind);
    let texel_limit = options.memory_limit_bytes as f64 / options.bytes_per_texel() * PLANNED_SHARE;
    let height = height(baked, &skins);
    let mut shots = Vec::new();
    let mut tile_count = 0u32;
    let mut flat_texels = 0;
    if has(Kind::Flat) {
        let limit = texel_limit * if has(Kind::Quad) { FLAT_SHARE } else { 1.0 };
        let first_quad = out.quads.len() as u32;
        flat_texels = plan_flat(
            baked,
            groups,
            options,
            height,
            limit,
            &mut out,
            &mut shots,
            &mut warnings,
        );
        push_kind(&mut out, Kind::Flat, first_quad);
        tile_count = shots.len() as u32;
    }
    if has(Kind::Quad) {
        let first_quad = out.quads.len() as u32;
        let limit = (texel_limit as u64).saturating_sub(flat_texels);
        plan_quad(
            baked,
            &skins,
            options,
            height,
            limit,
            tile_count,
            &mut out,
            &mut shots,
            &mut warnings,
        );
        push_kind(&mut out, Kind::Quad, first_quad);
    }
    let pictures = take(
        baked,
        groups,
        options,
        &out.clip_poses,
        &shots,
        capture,
        progress,
    )?;
    let too_large = BuildError::TooLarge {
        bytes: options.memory_limit_bytes,
    };
    let Some((tiles, atlas)) = pack::pack(&pictures, options.mip_count) else {
        return Err(too_large);
    };
    (out.tiles, out.atlas) = (tiles, atlas);
    lean::lean_tiles(&mut out, &pictures);
    if out.atlas.size_bytes() > options.memory_limit_bytes {
        return Err(too_large);
    }
    progress(1.0);
    Ok(Built {
        impostors: out,
        warnings,
    })
}

fn push_kind(out: &mut Impostors, kind: Kind, first_quad: u32) {
    out.kinds.push(KindInfo {
        kind,
        first_quad,
        quad_count: out.quads.len() as u32 - first_quad,
        errors: Vec::new(),
    });
}

/// A picture to take, a tile to be.
struct Shot {
    /// Pose of the clips; none for bind space.
    pose: Option<u32>,
    group: Option<u8>,
    center: Vec3,
    right: Vec3,
    up: Vec3,
    depth_extent: f32,
    corner: Vec2,
    texel: f32,
    size: UVec2,
}

impl Shot {
    fn view(&self, pose: u32, supersample: u32) -> CaptureView {
        let extent = self.size.as_vec2() * self.texel;
        CaptureView {
            pose,
            group: self.group,
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
fn height(baked: &Baked, skins: &[Skin]) -> f32 {
    let palette = pose::affines(&pose::palette_at(baked, 0, 0.0));
    let (min, max) = pose::bounds(skins.iter().map(|s| s.posed(&palette)));
    let extent = max - min;
    extent.y.max(0.5 * extent.max_element()).max(1e-6)
}

/// Plans the pictures of groups; returns the texels that their tiles may take.
#[allow(
    clippy::too_many_arguments,
    reason = "the plan of one kind, split from the driver"
)]
fn plan_flat(
    baked: &Baked,
    groups: &Groups,
    options: &ImpostorOptions,
    height: f32,
    texel_limit: f64,
    out: &mut Impostors,
    shots: &mut Vec<Shot>,
    warnings: &mut Vec<String>,
) -> u64 {
    let clouds = pose::group_clouds(baked, &groups.of_joint, groups.groups.len(), LEAST_WEIGHT);
    let body_views = out.view_sets.len() as u32;
    out.view_sets
        .push(ViewSet::icosahedral(options.body_view_cuts, -1.0));
    let head_views = if groups.groups.iter().any(|g| g.is_head)
        && options.head_view_cuts != options.body_view_cuts
    {
        out.view_sets
            .push(ViewSet::icosahedral(options.head_view_cuts, -1.0));
        body_views + 1
    } else {
        body_views
    };
    let first_pose = pose::palette_at(baked, 0, 0.0);
    let mut coarser = 1.0f32;
    loop {
        let mut planned = Vec::new();
        let mut quads = Vec::new();
        let mut texels = 0;
        for (g, (group, cloud)) in groups.groups.iter().zip(&clouds).enumerate() {
            let (min, max) = pose::bounds(cloud.iter().copied());
            let center = (min + max) * 0.5;
            let view_set = if group.is_head {
                head_views
            } else {
                body_views
            };
            let scale = scale(&first_pose[group.driver as usize]);
            let boost = if group.is_head {
                options.head_boost
            } else {
                1.0
            };
            let texel = height / scale / options.texels_per_height / boost * coarser;
            let radius = cloud.iter().map(|p| p.distance(center)).fold(0.0, f32::max);
            let depth_extent = radius + 2.0 * texel;
            quads.push(Quad {
                name: group.name.clone(),
                joint: group.driver,
                center,
                depth_extent,
                first_tile: (shots.len() + planned.len()) as u32,
                view_set,
            });
            let views = &out.view_sets[view_set as usize];
            for (view, &right) in views.rights.iter().enumerate() {
                let up = views.up(view);
                let (corner, size) = rectangle(cloud, center, right, up, texel);
                let tile = padded(size - 2, options.margin(), options.multiple());
                texels += u64::from(tile.x) * u64::from(tile.y);
                planned.push(Shot {
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
        if texels as f64 <= texel_limit || coarser > 64.0 {
            if coarser > 1.0 {
                warnings.push(format!(
                    "flat impostors have {:.0} texels along the height, not {:.0}: more would exceed the memory limit",
                    options.texels_per_height / coarser,
                    options.texels_per_height
                ));
            }
            out.quads.extend(quads);
            shots.extend(planned);
            return texels;
        }
        coarser *= 1.05;
    }
}

/// Metres of model space per unit of bind space under a palette entry.
fn scale(entry: &PaletteEntry) -> f32 {
    let volume = entry.to_affine().matrix3.determinant().abs();
    if volume > 1e-18 { volume.cbrt() } else { 1.0 }
}

/// Plans the pictures of the whole body.
#[allow(
    clippy::too_many_arguments,
    reason = "the plan of one kind, split from the driver"
)]
fn plan_quad(
    baked: &Baked,
    skins: &[Skin],
    options: &ImpostorOptions,
    height: f32,
    texel_limit: u64,
    first_tile: u32,
    out: &mut Impostors,
    shots: &mut Vec<Shot>,
    warnings: &mut Vec<String>,
) {
    let wanted = height / options.quad_texels_per_height;
    let planned = |cuts: u32| {
        let views = ViewSet::icosahedral(cuts, options.quad_lowest_y);
        let plan = clip_poses::plan(
            baked,
            skins,
            &views,
            wanted,
            options.quad_poses_per_clip,
            texel_limit,
            (options.margin(), options.multiple()),
        );
        (views, plan)
    };
    let (mut views, mut plan) = planned(options.quad_view_cuts);
    if plan.is_reduced && options.quad_view_cuts > 1 {
        // Characters with many clips may be better off with fewer views of finer pictures.
        let fewer = planned(options.quad_view_cuts - 1);
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
    out.quads.push(Quad {
        name: "body".into(),
        joint: NO_JOINT,
        center,
        depth_extent,
        first_tile,
        view_set: out.view_sets.len() as u32,
    });
    out.view_sets.push(views);
    out.clip_poses = plan.ranges;
}

/// The palette of a pose of the clips.
fn pose_palette(baked: &Baked, clip_poses: &[PoseRange], pose: u32) -> Vec<PaletteEntry> {
    let clip = clip_poses
        .partition_point(|r| r.first_pose <= pose)
        .saturating_sub(1);
    let range = clip_poses[clip];
    pose::palette_at(
        baked,
        clip,
        (pose - range.first_pose) as f32 / range.pose_count as f32,
    )
}

/// Takes the pictures, in batches, and averages them to cropped pictures, parallel to `shots`.
fn take<E>(
    baked: &Baked,
    groups: &Groups,
    options: &ImpostorOptions,
    clip_poses: &[PoseRange],
    shots: &[Shot],
    capture: &mut Capture<E>,
    progress: &mut dyn FnMut(f32),
) -> Result<Vec<Picture>, BuildError<E>> {
    let mut pictures = Vec::with_capacity(shots.len());
    let supersample = options.supersample;
    while pictures.len() < shots.len() {
        progress(pictures.len() as f32 / shots.len() as f32);
        let first = pictures.len();
        let mut batch = CaptureBatch {
            groups: groups.of_joint.clone(),
            error: f32::INFINITY,
            ..CaptureBatch::default()
        };
        let (mut bytes, mut posed) = (0, None);
        let mut asked = Vec::new();
        for shot in &shots[first..] {
            let pixels =
                u64::from(shot.size.x * shot.size.y) * u64::from(supersample * supersample);
            // The level of detail is one of the batch's: pictures of other texels wait for the next.
            let error = shot.texel * 0.5;
            let other = batch.error.is_finite() && (batch.error - error).abs() > 0.1 * error;
            let full =
                bytes + pixels * TEXEL_BYTES > BATCH_BYTES || batch.poses.len() > BATCH_ENTRIES;
            if !asked.is_empty() && (other || full) {
                break;
            }
            bytes += pixels * TEXEL_BYTES;
            batch.error = batch.error.min(error);
            asked.push(shot.size.x > 0);
            if shot.size.x == 0 {
                continue;
            }
            if posed != Some(shot.pose) {
                posed = Some(shot.pose);
                batch.poses.extend(match shot.pose {
                    Some(pose) => pose_palette(baked, clip_poses, pose),
                    None => pose::bind_palette(baked),
                });
            }
            let pose = (batch.poses.len() / baked.joints.len()) as u32 - 1;
            batch.views.push(shot.view(pose, supersample));
        }
        let answers = if batch.views.is_empty() {
            Vec::new()
        } else {
            capture(&batch).map_err(BuildError::Capture)?
        };
        check_answers(&batch, &answers)?;
        let mut answers = answers.iter();
        for (shot, asked) in shots[first..].iter().zip(asked) {
            let answer = answers.as_slice().first().filter(|_| asked);
            pictures.push(answer.map_or_else(Picture::default, |captured| {
                average(shot, captured, options).cropped(options.margin(), options.multiple())
            }));
            if asked {
                answers.next();
            }
        }
    }
    Ok(pictures)
}

fn check_answers<E>(batch: &CaptureBatch, answers: &[CapturedView]) -> Result<(), BuildError<E>> {
    if answers.len() != batch.views.len() {
        return Err(BuildError::Answer {
            picture: answers.len(),
            reason: "the pictures differ from those asked for in number",
        });
    }
    for (picture, (answer, view)) in answers.iter().zip(&batch.views).enumerate() {
        let pixels = view.size[0] as usize * view.size[1] as usize;
        if answer.color.len() != pixels || answer.surface.len() != pixels {
            return Err(BuildError::Answer {
                picture,
                reason: "its pixels and its size differ",
            });
        }
    }
    Ok(())
}

fn average(shot: &Shot, captured: &CapturedView, options: &ImpostorOptions) -> Picture {
    let least = if shot.group.is_some() {
        (1.0 + 254.0 * LEAST_WEIGHT) as u8
    } else {
        1
    };
    Picture::average(
        captured,
        shot.corner,
        shot.texel,
        shot.size,
        options.supersample,
        |_, alpha| alpha >= least,
    )
}
