//! select: culls agents, turns the pixel error into a level of detail and sorts (agent, submesh) pairs into instance lists.
//! Host side of hlsl/select.hlsl; twin in [`crate::reference::select`].

use ash::vk;
use glam::{Mat4, Vec4};
use throng_bake::texture::encode_srgb;

use crate::frame::{FrameOptions, Method, View};
use crate::gpu::{Access, Commands, Drawing, list_bytes};
use crate::gpu_types::{
    FLAG_FULL_DETAIL, FLAG_REVERSED_DEPTH, FLAG_SHADOWS, FLAG_STILL, FREE_STRETCH, FrameConstants,
    GROUND_PLAIN, SELECT_GROUP_SIZE, SELECT_SHARDS, TALLY_ENTRIES,
};
use crate::prepare::Tables;
use crate::reference::select::slice_at;

/// Linear colour of the air at the horizon, as a share of the sky's light.
const HAZE_OF_SKY: f32 = 1.6;
/// Haze takes half of the light at one over this many metres.
const HAZE_PER_METRE: f32 = 1.0 / 900.0;

/// Agents of at least this height in the picture hide others.
const OCCLUDER_HEIGHT_PX: f32 = 20.0;

/// Quads of agents of this length in the picture, and smaller ones, are drawn without relief. With 24 the plaza has 1.9 percent more
/// FLIP error, with 18 0.6.
pub(crate) const PLAIN_LENGTH_PX: f32 = 18.0;

/// The constants that all stages of a frame read; `reversed_depth` as in [`crate::gpu::RendererDesc::reversed_depth`].
/// Without `plain_slices`, which follows from the crowd and which only draws depend on.
pub fn frame_constants(
    view: &View,
    options: &FrameOptions,
    agent_count: u32,
    tables: &Tables,
    reversed_depth: bool,
) -> FrameConstants {
    let clip_from_world = view.clip_from_world();
    let light = &options.light;
    let haze = light.sky * HAZE_OF_SKY;
    let mut flags = 0;
    if matches!(options.method, Method::Full | Method::Uninstanced) {
        flags |= FLAG_FULL_DETAIL;
    }
    if !options.animate {
        flags |= FLAG_STILL;
    }
    if reversed_depth {
        flags |= FLAG_REVERSED_DEPTH;
    }
    if options.ground && options.shadows {
        flags |= FLAG_SHADOWS;
    }
    FrameConstants {
        clip_from_world: clip_from_world.to_cols_array_2d(),
        world_from_clip: clip_from_world.inverse().to_cols_array_2d(),
        planes: frustum_planes(clip_from_world).map(|p| p.to_array()),
        eye: view.eye().into(),
        near: view.near,
        to_sun: light.to_sun.normalize_or(glam::Vec3::Y).into(),
        error_per_metre: options.pixel_error * view.pixel_angle(),
        sun: light.sun.into(),
        agent_count,
        sky: light.sky.into(),
        bin_count: tables.bands.len() as u32,
        ground: light.ground.into(),
        entry_stride: tables.entry_stride(),
        haze: haze.into(),
        haze_per_metre: HAZE_PER_METRE,
        haze_square: haze.to_array().map(|c| encode_srgb(c).powi(2)),
        plain_slices: 0,
        flags,
        pixel_angle: view.pixel_angle(),
        ground_color: options.ground_color.map_or(0, packed_color),
        width_px: view.size_px[0],
        height_px: view.size_px[1],
        occluder_angle: OCCLUDER_HEIGHT_PX * view.pixel_angle(),
        left_px: view.offset_px[0],
        top_px: view.offset_px[1],
        stretch_share_min: stretch_share_min(view),
        padding0: 0,
        padding1: 0,
        padding2: 0,
    }
}

/// How many of the farthest slices are so far that a pixel of the quads of agents up to `longest` metres, which are as high or as
/// deep, hardly shifts by its depth.
pub(crate) fn plain_slices(longest: f32, view: &View) -> u32 {
    slice_at(longest / (PLAIN_LENGTH_PX * view.pixel_angle() * view.near))
}

/// `FrameConstants::stretch_share_min`: of the corner that is farthest from the view's axis.
fn stretch_share_min(view: &View) -> f32 {
    let p = view.clip_from_view;
    // Where the edges cross the plane one metre in front of the eye, by the squared tangent of their angle.
    let edge = |scale: f32, middle: f32| ((1.0 + middle.abs()) / scale).powi(2);
    let squares = edge(p.x_axis.x, p.z_axis.x) + edge(p.y_axis.y, p.z_axis.y);
    (FREE_STRETCH / (1.0 + squares)).min(1.0)
}

/// `FrameConstants::ground_color` of a plain ground.
fn packed_color(linear: glam::Vec3) -> u32 {
    let [r, g, b] = linear
        .to_array()
        .map(|x| (x.clamp(0.0, 1.0).sqrt() * 255.0).round() as u32);
    GROUND_PLAIN | r | g << 8 | b << 16
}

/// The six planes of a frustum, inward and of unit length. A plane at infinity holds everything.
fn frustum_planes(clip_from_world: Mat4) -> [Vec4; 6] {
    let [x, y, z, w] = [0, 1, 2, 3].map(|i| clip_from_world.row(i));
    [w + x, w - x, w + y, w - y, z, w - z].map(|plane| {
        let length = plane.truncate().length();
        if length > 1e-12 {
            plane / length
        } else {
            Vec4::W
        }
    })
}

const COMPUTE: vk::PipelineBindPoint = vk::PipelineBindPoint::COMPUTE;

/// Workgroups of a shard's threads, one per agent.
pub(crate) fn shard_groups(agents: u32) -> u32 {
    agents.div_ceil(SELECT_GROUP_SIZE * SELECT_SHARDS)
}

/// Records the passes that make the lists of everybody, or, with `occlusion`, of those whom the occluders do not hide.
pub(crate) fn record(c: &mut Commands, drawing: &Drawing, occlusion: bool) {
    let (slot, pipelines) = (drawing.slot, drawing.pipelines);
    let groups = shard_groups(slot.agents.len() as u32);
    begin(c, drawing);
    if groups > 0 {
        c.bind_pipeline(
            COMPUTE,
            if occlusion {
                pipelines.count_unhidden
            } else {
                pipelines.count
            },
        );
        c.dispatch_rows([groups, SELECT_SHARDS]);
    }
    scan_and_scatter(c, drawing);
}

/// Records the passes that make the occluders' lists, which those of [`record`] overwrite.
pub(crate) fn record_occluders(c: &mut Commands, drawing: &Drawing) {
    let (slot, pipelines) = (drawing.slot, drawing.pipelines);
    let Some(buffers) = &slot.buffers else { return };
    begin(c, drawing);
    c.bind_pipeline(COMPUTE, pipelines.count_occluders);
    c.dispatch_rows([shard_groups(slot.agents.len() as u32), SELECT_SHARDS]);
    scan_and_scatter(c, drawing);
    let region = vk::BufferCopy {
        src_offset: 0,
        dst_offset: 0,
        size: list_bytes(slot.shape)[0],
    };
    c.copy_buffer(&buffers.tally, &buffers.readback, region);
    c.barrier(Access::TransferWrite, &[Access::HostRead]);
}

/// Empties the tally, which the frame's commands before may still be reading.
fn begin(c: &mut Commands, drawing: &Drawing) {
    let (slot, pipelines) = (drawing.slot, drawing.pipelines);
    let Some(buffers) = &slot.buffers else { return };
    c.barrier(Access::ListRead, &[Access::TransferWrite]);
    c.fill_zero(&buffers.tally, vk::WHOLE_SIZE);
    c.barrier(Access::TransferWrite, &[Access::ComputeReadWrite]);
    c.bind_set(COMPUTE, pipelines.select_layout, 0, slot.select_set);
}

/// From counts to lists.
fn scan_and_scatter(c: &mut Commands, drawing: &Drawing) {
    let (slot, pipelines) = (drawing.slot, drawing.pipelines);
    let Some(buffers) = &slot.buffers else { return };
    c.barrier(Access::ComputeReadWrite, &[Access::ComputeReadWrite]);
    c.bind_pipeline(COMPUTE, pipelines.scan);
    c.dispatch(1);
    c.barrier(
        Access::ComputeReadWrite,
        &[Access::ComputeReadWrite, Access::DispatchRead],
    );
    c.bind_pipeline(COMPUTE, pipelines.scatter);
    c.dispatch_indirect(&buffers.tally, 4 * TALLY_ENTRIES as u64);
    c.barrier(
        Access::ComputeReadWrite,
        &[
            Access::DrawRead,
            Access::TransferRead,
            Access::ComputeReadWrite,
        ],
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn quads_without_relief_are_small() {
        let view = View::perspective(Vec3::ZERO, Vec3::NEG_Z, 0.7, 0.1, [1024, 768]);
        let (longest, plain) = (1.9, plain_slices(1.9, &view));
        // Slices of distances at which the longest is so long in the picture.
        let slice =
            |length_px: f32| slice_at(longest / (length_px * view.pixel_angle()) / view.near);
        assert!(slice(17.5) < plain, "smaller ones have none");
        assert!(slice(18.5) >= plain, "larger ones have it");
        assert_eq!(plain_slices(1e9, &view), 0, "all have it");
        let all = crate::gpu_types::SLICE_COUNT;
        assert_eq!(
            plain_slices(0.0, &view),
            all - 1,
            "but for who touches the eye"
        );
    }

    #[test]
    fn planes_hold_what_the_camera_sees() {
        let view = View::perspective(Vec3::ZERO, Vec3::NEG_Z, 1.0, 0.1, [100, 100]);
        let planes = frustum_planes(view.clip_from_world());
        let inside = |p: Vec3| planes.iter().all(|plane| plane.dot(p.extend(1.0)) >= 0.0);
        assert!(inside(Vec3::new(0.0, 0.0, -1.0)));
        assert!(
            inside(Vec3::new(0.0, 0.0, -1e6)),
            "the far plane is at infinity"
        );
        assert!(
            !inside(Vec3::new(0.0, 0.0, -0.05)),
            "nearer than the near plane"
        );
        assert!(!inside(Vec3::new(0.0, 0.0, 1.0)), "behind");
        // tan(0.5) = 0.546: the edge of a field of view of 1 radian.
        assert!(inside(Vec3::new(0.54, 0.0, -1.0)));
        assert!(!inside(Vec3::new(0.55, 0.0, -1.0)));
        assert!(inside(Vec3::new(0.0, -0.54, -1.0)));
        assert!(!inside(Vec3::new(0.0, 0.55, -1.0)));
    }
}
