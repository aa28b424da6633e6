//! The structs that host and shaders share: twins of hlsl/gpu_types.hlsli, where every field is explained.
//!
//! One macro declares a struct and its field table; tests/layouts.rs compares the tables with the compiled modules.

use bytemuck::{Pod, Zeroable};

/// Threads of a workgroup of the select stage.
pub const SELECT_GROUP_SIZE: u32 = 64;
/// Parts of the crowd that count on their own.
pub const SELECT_SHARDS: u32 = 8;
/// Threads of the workgroup that scans the lists.
pub const SCAN_GROUP_SIZE: u32 = 256;
/// Bits of an impostor's [`Instance::live_vertex_count`] that hold its pose.
pub const IMPOSTOR_POSE_MASK: u32 = 0x7f_ffff;
/// First of its bits that hold its fade, in 255ths.
pub const IMPOSTOR_FADE_SHIFT: u32 = 23;
/// Its bit that says it fades out.
pub const IMPOSTOR_FADES_OUT: u32 = 0x8000_0000;
/// Slices of distance that impostors of a kind are listed by, a bin for each, the farthest first.
pub const SLICE_COUNT: u32 = 512;
/// Bits of distance / near below its slice.
pub const SLICE_SHIFT: u32 = 18;
/// The first bin of all characters' agents that are one quad.
pub const QUAD_BIN: u32 = 0;
/// The first bin of those that are a quad for each group of joints.
pub const FLAT_BIN: u32 = SLICE_COUNT;
/// Draws of impostors: one quad in the farthest slices, in the others; a quad for each group of joints.
pub const IMPOSTOR_DRAWS: u32 = 3;
/// Agents that an instance holds of a list that is drawn packed: of those of one quad, and of the smallest meshes.
pub const AGENTS_PER_INSTANCE: u32 = 64;
/// Commands of such a list: whole instances, and what is left over.
pub const PACKED_COMMANDS: u32 = 2;
/// The most vertices of a band whose agents are drawn packed; an agent's vertex numbers begin at a multiple of it.
pub const PACKED_VERTICES: u32 = 16;
/// Ranges of projected size per character.
pub const MAX_RANGES: u32 = 4;
/// How much further than its end a range fades out.
pub const FADE_SPAN: f32 = 0.06;
/// How much perspective may stretch an agent's error along the way from the picture's middle: as in
/// the corners of a picture of 45 degrees.
pub const FREE_STRETCH: f32 = 1.5;
/// Height in pixels below which an agent does not fade but switches, at a size of its own within the span.
pub const SWITCH_HEIGHT_PX: f32 = 12.0;
/// Added to an impostor's mip before rounding: below 0 is sharper.
pub const IMPOSTOR_MIP_BIAS: f32 = -0.75;
/// The least pixels in a texel that edges of impostors follow: further inside than a texel, outlines do not tell.
pub const SHARPNESS_MIN: f32 = 0.5;
/// The most: at most 4, as they are packed for pixels.
pub const SHARPNESS_MAX: f32 = 3.75;
const _: () = assert!(SHARPNESS_MAX < 4.0);
/// Mean of the tints of what stays nearly as it was made.
pub const TINT_NATURAL_MEAN: f32 = throng_bake::tint::NATURAL_MEAN;
/// Mean of the tints of cloth, for a colour of lightness 0.75.
pub const TINT_CLOTH_MEAN: f32 = throng_bake::tint::CLOTH_MEAN;
/// Share of the LOD error that fewer influences, or one frame instead of two, may each cost on top of it.
pub const SKINNING_ERROR_SHARE: f32 = 0.5;
/// Bits of a LOD error below its step: 128 steps to a doubling.
pub const LEVEL_SHIFT: u32 = 16;
/// Bit of `Selected::packed`: one frame instead of two.
pub const SELECTED_NEAREST: u32 = 8;
/// Bit of `Selected::packed`: the agent casts a contact shadow, and this entry lists it.
pub const SELECTED_CASTS: u32 = 16;
/// `Selected::bin` of a submesh that draws nothing.
pub const BIN_NONE: u32 = u32::MAX;
/// Place of the visible agents' count in the tally buffer.
pub const TALLY_VISIBLE: usize = 0;
/// Place of the low half of the 64-bit sum of live vertices.
pub const TALLY_LIVE_VERTICES_LOW: usize = 1;
/// Place of the high half.
pub const TALLY_LIVE_VERTICES_HIGH: usize = 2;
/// Place of the count of agents that their mesh draws.
pub const TALLY_MESHES: usize = 3;
/// Place of the count of agents that are hidden.
pub const TALLY_OCCLUDED: usize = 4;
/// Place of the number of a shard's entries; of an indirect dispatch's arguments in the frame's part of the tally.
pub const TALLY_ENTRIES: usize = 5;
/// Place of the first list's count.
pub const TALLY_BINS: usize = 8;
/// Words that each part of the tally starts at multiples of.
pub const TALLY_ALIGNMENT: usize = 16;
/// Pixels per texel of the occluders' depth, each way.
pub const OCCLUDER_TEXEL_PX: u32 = 4;
/// Metres by which the eye may be above occluders, per metre of distance.
pub const OCCLUDER_SLOPE_MAX: f32 = 0.05;
/// Occluders of at least this many times the least height have the finest meshes.
pub const OCCLUDER_FINE_HEIGHTS: f32 = 2.0;
/// Occluders only hide what is further behind them than this share of its distance.
pub const OCCLUDER_MARGIN: f32 = 0.005;
/// Last level of the pyramid over it; level 0 is the depth itself.
pub const PYRAMID_TOP: u32 = 5;
/// How many times the error may be that an agent's mesh has, where others hide most of it.
pub const OPEN_ERROR_MAX: f32 = 3.0;
/// The most columns of texels that a test looks at.
pub const TEST_COLUMNS: u32 = 16;
/// The most rows.
pub const TEST_ROWS: u32 = 32;
/// Texels of a side that a thread of the occlude stage reduces.
pub const REDUCE_BLOCK: u32 = 8;
/// Threads of a workgroup of the occlude stage.
pub const REDUCE_GROUP_SIZE: u32 = 64;
/// `CaptureInstance::group` of a picture of all surfaces.
pub const CAPTURE_ALL_GROUPS: u32 = u32::MAX;
/// Surfaces with less weight in a picture's group are not in it.
pub const CAPTURE_WEIGHT_MIN: f32 = 0.00197;
/// Surfaces with at least this weight in a picture's group are in front of those with less.
pub const CAPTURE_WEIGHT_OWN: f32 = 0.3;
/// Surfaces are drawn up to this many depth extents from a picture's centre.
pub const CAPTURE_DEPTH_REACH: f32 = 8.0;
/// Metres above the ground that contact shadows are drawn at.
pub const SHADOW_LIFT: f32 = 0.01;
/// Distance in radii at which a shadow begins to fade; at twice that it is gone.
pub const SHADOW_FADE_RADII: f32 = 110.0;
/// Every vertex lives.
pub const FLAG_FULL_DETAIL: u32 = 1;
/// No animation.
pub const FLAG_STILL: u32 = 2;
/// `FrameConstants::ground_color` holds a colour.
pub const GROUND_PLAIN: u32 = 0x8000_0000;
/// Near is depth 1.
pub const FLAG_REVERSED_DEPTH: u32 = 4;
/// Contact shadows are drawn.
pub const FLAG_SHADOWS: u32 = 8;

/// One field of a shared struct.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Field {
    /// Name, the same on both sides.
    pub name: &'static str,
    /// Bytes from the start of the struct.
    pub offset: usize,
    /// Rust type; vectors are arrays, matrices arrays of columns.
    pub kind: &'static str,
}

/// One shared struct.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Name, the same on both sides.
    pub name: &'static str,
    /// Bytes, which is also the stride of an array of them.
    pub size: usize,
    /// In order.
    pub fields: &'static [Field],
}

macro_rules! shared_structs {
    ($($(#[$meta:meta])* struct $name:ident { $($field:ident: $type:ty,)* })*) => {
        $(
            $(#[$meta])*
            #[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
            #[repr(C)]
            #[allow(missing_docs, reason = "hlsl/gpu_types.hlsli explains the fields")]
            pub struct $name { $(pub $field: $type,)* }
        )*
        /// Every shared struct.
        pub static LAYOUTS: &[Layout] = &[$(Layout {
            name: stringify!($name),
            size: size_of::<$name>(),
            fields: &[$(Field {
                name: stringify!($field),
                offset: std::mem::offset_of!($name, $field),
                kind: stringify!($type),
            },)*],
        },)*];
    };
}

shared_structs! {
    /// One member of the crowd.
    struct AgentState {
        position: [f32; 3],
        heading_cos: f32,
        heading_sin: f32,
        scale: f32,
        character: u32,
        clips: u32,
        phase0: f32,
        phase1: f32,
        blend: f32,
        tint_seed: u32,
    }
    /// A character in the tables of the select stage.
    struct CharacterInfo {
        first_submesh: u32,
        submesh_count: u32,
        first_clip: u32,
        joint_count: u32,
        influences1_error: f32,
        influences2_error: f32,
        influences3_error: f32,
        lowest: f32,
        occluder_error: f32,
        padding0: u32,
        padding1: u32,
        padding2: u32,
    }
    /// A clip's bounds and frames.
    struct ClipInfo {
        sphere_center: [f32; 3],
        sphere_radius: f32,
        box_center: [f32; 3],
        first_pose: u32,
        box_half_extent: [f32; 3],
        pose_count: u32,
        first_frame: u32,
        frame_count: u32,
        nearest_error: f32,
        shadow_radius: f32,
    }
    /// A submesh's levels of detail by the key of the LOD error.
    struct SubmeshInfo {
        first_level: u32,
        level_count: u32,
        first_key: i32,
        vertex_count: u32,
    }
    /// A submesh at one LOD error.
    struct LevelInfo {
        live_vertex_count: u32,
        bin: u32,
    }
    /// An index window.
    struct BandInfo {
        first_index: u32,
        index_count: u32,
        vertex_count: u32,
        waiting_vertex_count: u32,
        packed_first_index: u32,
    }
    /// A range of projected sizes.
    struct RangeInfo {
        units_end: f32,
        bin: u32,
    }
    /// What the count pass found for one list entry of one agent.
    struct Selected {
        bin: u32,
        rank: u32,
        live_vertex_count: u32,
        packed: u32,
    }
    /// An entry of an instance list: everything about an agent that all vertices of a submesh share.
    struct Instance {
        position: [f32; 3],
        heading_cos: f32,
        tint_seed: u32,
        live_vertex_count: u32,
        packed: u32,
        heading_sin: f32,
        sample_entries: [u32; 4],
        sample_weights: [f32; 3],
        padding0: u32,
    }
    /// A picture that the capture stage takes.
    struct CaptureInstance {
        center: [f32; 3],
        depth_scale: f32,
        right: [f32; 3],
        first_entry: u32,
        up: [f32; 3],
        group: u32,
        clip_scale: [f32; 2],
        clip_offset: [f32; 2],
        clip_min: [f32; 2],
        clip_max: [f32; 2],
    }
    /// `VkDrawIndexedIndirectCommand`.
    struct DrawCommand {
        index_count: u32,
        instance_count: u32,
        first_index: u32,
        vertex_offset: i32,
        first_instance: u32,
    }
    /// The view, the options and the light of one frame.
    struct FrameConstants {
        clip_from_world: [[f32; 4]; 4],
        world_from_clip: [[f32; 4]; 4],
        planes: [[f32; 4]; 6],
        eye: [f32; 3],
        near: f32,
        to_sun: [f32; 3],
        error_per_metre: f32,
        sun: [f32; 3],
        agent_count: u32,
        sky: [f32; 3],
        bin_count: u32,
        ground: [f32; 3],
        entry_stride: u32,
        haze: [f32; 3],
        haze_per_metre: f32,
        haze_square: [f32; 3],
        plain_slices: u32,
        flags: u32,
        pixel_angle: f32,
        ground_color: u32,
        width_px: u32,
        height_px: u32,
        occluder_angle: f32,
        left_px: u32,
        top_px: u32,
        stretch_share_min: f32,
        padding0: u32,
        padding1: u32,
        padding2: u32,
    }
    /// A character's constants for drawing.
    struct CharacterConstants {
        position_min: [f32; 3],
        padding0: u32,
        position_extent: [f32; 3],
        padding1: u32,
        uv_min: [f32; 2],
        uv_extent: [f32; 2],
    }
    /// Push constants of a submesh's draw.
    struct DrawConstants {
        first_vertex: u32,
        alpha_cutoff: f32,
        probe_vertex_count: u32,
        probe_instance: u32,
        probe_output: u32,
    }
}

impl Instance {
    /// `packed` from its parts.
    pub fn pack(influence_count: u32, sample_count: u32, agent: u32) -> u32 {
        influence_count | (sample_count << 3) | (agent << 6)
    }

    /// Influences per vertex, 1 to 4.
    pub fn influence_count(&self) -> u32 {
        self.packed & 7
    }

    /// Frames, 1, 2 or 4.
    pub fn sample_count(&self) -> u32 {
        (self.packed >> 3) & 7
    }

    /// Weight of a frame.
    pub fn sample_weight(&self, sample: usize) -> f32 {
        let [a, b, c] = self.sample_weights;
        self.sample_weights
            .get(sample)
            .copied()
            .unwrap_or(1.0 - a - b - c)
    }

    /// Place in the crowd.
    pub fn agent(&self) -> u32 {
        self.packed >> 6
    }
}
