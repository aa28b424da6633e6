// Structs and numbers that the host and the shaders share. The Rust twin is src/gpu_types.rs; tests/layouts.rs compares the
// two by reflection of the compiled modules. Every float3 starts on 16 bytes with a 4-byte scalar behind it.

#ifndef THRONG_GPU_TYPES
#define THRONG_GPU_TYPES

// Threads of a workgroup of the select stage that work on one agent each.
#define SELECT_GROUP_SIZE 64
// Parts of the crowd that count on their own, because counters that all threads add to go from core to core.
#define SELECT_SHARDS 8
// Threads of the one workgroup that scans the lists.
#define SCAN_GROUP_SIZE 256
// Parts of an impostor's Instance::live_vertex_count.
#define IMPOSTOR_POSE_MASK 0x7fffffu
#define IMPOSTOR_FADE_SHIFT 23
#define IMPOSTOR_FADES_OUT 0x80000000u
// All characters' agents that are impostors of a kind are listed by slices of distance, so many to a kind, the farthest first:
// their soft edges blend over who stands behind them. Slices are steps of the bits of distance / near, 32 to a doubling.
#define SLICE_COUNT 512
#define SLICE_SHIFT 18
// The first bins of agents that are one quad, and of those that are a quad for each group of joints.
#define QUAD_BIN 0
#define FLAT_BIN 512
// Draws of impostors: one quad in the farthest slices, in the others; a quad for each group of joints.
#define IMPOSTOR_DRAWS 3
// Agents that an instance holds of a list that is drawn packed, of those of one quad and of the smallest meshes: fewer vertices
// would leave most of a CPU driver's lanes idle. The commands of such a list: whole instances, and what is left over.
#define AGENTS_PER_INSTANCE 64
#define PACKED_COMMANDS 2
// The most vertices of a band whose agents are drawn packed; an agent's vertex numbers begin at a multiple of it.
#define PACKED_VERTICES 16
// Ranges of projected size per character, and how much further than its end a range fades out.
#define MAX_RANGES 4
#define FADE_SPAN 0.06
// How much perspective may stretch an agent's error along the way from the picture's middle: as in the corners of a
// picture of 45 degrees.
#define FREE_STRETCH 1.5
// Height in pixels below which an agent does not fade but switches, at a size of its own within the span.
#define SWITCH_HEIGHT_PX 12.0
// Added to an impostor's mip before rounding: below 0 is sharper.
#define IMPOSTOR_MIP_BIAS -0.75
// The least and most pixels in a texel that edges of impostors follow: further inside than a texel, outlines do not tell.
#define SHARPNESS_MIN 0.5
#define SHARPNESS_MAX 3.75
// Mean of the tints of what stays nearly as it was made, and of cloth for a colour of lightness 0.75.
#define TINT_NATURAL_MEAN 0.9
#define TINT_CLOTH_MEAN 0.487
// Share of the LOD error that fewer influences, or one frame instead of two, may each cost on top of it.
#define SKINNING_ERROR_SHARE 0.5
// Bits of a LOD error below its step: 128 steps to a doubling.
#define LEVEL_SHIFT 16
// Selected::packed: one frame instead of two; the agent casts a contact shadow, and this entry lists it.
#define SELECTED_NEAREST 8u
#define SELECTED_CASTS 16u
// Selected::bin of a submesh that draws nothing.
#define BIN_NONE 0xffffffffu
// Where the tally buffer holds what; the lists' counts follow. So much for the frame, and then for each shard, whose counts the
// scan pass replaces by where the shard's part of each list starts.
#define TALLY_VISIBLE 0
// Sum of live vertices, 64 bits.
#define TALLY_LIVE_VERTICES_LOW 1
#define TALLY_LIVE_VERTICES_HIGH 2
#define TALLY_MESHES 3
#define TALLY_OCCLUDED 4
// A shard's entries in the selected buffer; the frame has a VkDispatchIndirectCommand here, for the pass over them.
#define TALLY_ENTRIES 5
// Of a shard: its contact shadows, and from the scan pass on the place of the next one in their list.
#define TALLY_SHADOWS 6
#define TALLY_BINS 8
// Words that what follows in the tally buffer starts at multiples of: a cache line.
#define TALLY_ALIGNMENT 16
// The occluders' depth has a texel per this many pixels each way.
#define OCCLUDER_TEXEL_PX 4
// Metres by which the eye may be above occluders, per metre of distance.
#define OCCLUDER_SLOPE_MAX 0.05
// Occluders of at least this many times the least height have the finest meshes; those of smaller ones are coarser.
#define OCCLUDER_FINE_HEIGHTS 2.0
// Occluders only hide what is further behind them than this share of its distance.
#define OCCLUDER_MARGIN 0.005
// The last level of the pyramid over that depth; level 0 is the depth itself.
#define PYRAMID_TOP 5
// How many times the error may be that an agent's mesh has, where others hide most of it.
#define OPEN_ERROR_MAX 3.0
// The most texels of a level that a test looks at.
#define TEST_COLUMNS 16
#define TEST_ROWS 32
// Texels of a side that a thread of the occlude stage reduces, and threads of its workgroup.
#define REDUCE_BLOCK 8
#define REDUCE_GROUP_SIZE 64
// CaptureInstance::group of a picture of all surfaces.
#define CAPTURE_ALL_GROUPS 0xffffffffu
// Surfaces with less weight in a picture's group are not in it: half a step of the 254 that weights are stored in.
#define CAPTURE_WEIGHT_MIN 0.00197
// Surfaces with at least this weight in a picture's group are in front of those with less.
#define CAPTURE_WEIGHT_OWN 0.3
// Surfaces are drawn up to this many depth extents from a picture's centre.
#define CAPTURE_DEPTH_REACH 8.0
// Metres above the ground that contact shadows are drawn at, so that the two do not fight for depth.
#define SHADOW_LIFT 0.01
// Distance in radii at which a shadow begins to fade; at twice that it is gone.
#define SHADOW_FADE_RADII 110.0
// FrameConstants::flags.
#define FLAG_FULL_DETAIL 1u
#define FLAG_STILL 2u
#define FLAG_REVERSED_DEPTH 4u
#define FLAG_SHADOWS 8u
// FrameConstants::ground_color: there is one.
#define GROUND_PLAIN 0x80000000u

// One member of the crowd, as the host states it.
struct AgentState
{
    float3 position; // world, metres
    float heading_cos; // from the host: drivers' own cosines differ
    float heading_sin;
    float scale; // metres per bind-space unit
    uint character;
    uint clips; // first clip in the low 16 bits, second in the high ones
    float phase0; // fraction of the clip, wraps
    float phase1;
    float blend; // weight of clip1, 0 to 1
    uint tint_seed;
};

// A character in the tables of the select stage.
struct CharacterInfo
{
    uint first_submesh;
    uint submesh_count;
    uint first_clip;
    uint joint_count;
    float influences1_error; // bind-space units that skinning with 1 influence is off by
    float influences2_error;
    float influences3_error;
    float lowest; // bind-space height of its lowest point where it stands
    float occluder_error; // LOD error of the finest mesh with which it hides others
    uint padding0;
    uint padding1;
    uint padding2;
};

// A clip: bounds of every vertex at every frame, model space, and its frames in the palette.
struct ClipInfo
{
    float3 sphere_center;
    float sphere_radius;
    float3 box_center;
    uint first_pose; // its texel in the gallery's table
    float3 box_half_extent;
    uint pose_count; // 0 where there are none
    uint first_frame;
    uint frame_count;
    float nearest_error; // bind-space units that the nearest frame is off by
    float shadow_radius; // of the contact shadow, bind-space units
};

// A submesh's levels of detail. LOD errors are rounded down to steps: the bits of a float from LEVEL_SHIFT up, its key. The
// first level is full detail; the next is that of first_key and of all keys below it, then one for each key.
struct SubmeshInfo
{
    uint first_level;
    uint level_count; // at least 2
    int first_key;
    uint vertex_count;
};

// A submesh at one LOD error.
struct LevelInfo
{
    uint live_vertex_count;
    uint bin; // BIN_NONE: draws nothing
};

// An index window, finest first within a submesh.
struct BandInfo
{
    uint first_index;
    uint index_count;
    uint vertex_count; // live vertices
    uint waiting_vertex_count; // of those, in no triangle yet: coarser levels use them
    uint packed_first_index; // of AGENTS_PER_INSTANCE such windows; 0: its agents are not drawn packed
};

// A range of projected sizes and the representation that draws it.
struct RangeInfo
{
    float units_end; // bind-space units per pixel at its far end
    uint bin; // of an impostor kind; BIN_NONE: the mesh
};

// What the count pass found for one list entry of one agent.
struct Selected
{
    uint bin; // BIN_NONE: draws nothing
    uint rank; // place in the shard's part of the bin's list
    uint live_vertex_count; // as the instance's
    uint packed; // influences, 1 to 4, in bits 0-2; SELECTED_NEAREST, SELECTED_CASTS; agent from bit 6
};

// An entry of an instance list: everything about an agent that all vertices of a submesh share. To meshes the lists are a vertex
// buffer of instance rate: on lavapipe that is much cheaper to read per vertex than a structured buffer. Agents of one quad
// and the smallest meshes, which are drawn packed, read them as records.
struct Instance
{
    float3 position; // world
    float heading_cos; // times scale
    uint tint_seed;
    uint live_vertex_count; // of an impostor: its pose's texel, fade in 255ths from bit 23, bit 31 where it fades out
    uint packed; // influences, 1 to 4, in bits 0-2; frames, 1, 2 or 4, in bits 3-5; agent from bit 6
    float heading_sin; // times scale
    uint4 sample_entries; // first palette entry of each frame
    float3 sample_weights; // the fourth is what they leave of 1
    uint padding0;
};

// A picture that the capture stage takes: a plane, and the page's rectangle that shows a part of it.
struct CaptureInstance
{
    float3 center;
    float depth_scale; // depth extents per bind-space unit
    float3 right; // unit length, as up; the eye is on the side of right x up
    uint first_entry; // of its pose's joints in the palette
    float3 up;
    uint group; // or CAPTURE_ALL_GROUPS
    float2 clip_scale; // clip space from the plane
    float2 clip_offset;
    float2 clip_min; // the rectangle in clip space
    float2 clip_max;
};

// VkDrawIndexedIndirectCommand.
struct DrawCommand
{
    uint index_count;
    uint instance_count;
    uint first_index;
    int vertex_offset;
    uint first_instance;
};

// The view, the options and the light of one frame.
struct FrameConstants
{
    float4x4 clip_from_world;
    float4x4 world_from_clip;
    float4 planes[6]; // world, inward: inside where dot(plane.xyz, p) + plane.w >= 0
    float3 eye;
    float near;
    float3 to_sun; // unit length
    float error_per_metre; // LOD error in metres per metre of distance
    float3 sun;
    uint agent_count;
    float3 sky;
    uint bin_count;
    float3 ground;
    uint entry_stride; // the most entries of the selected buffer that an agent has
    float3 haze;
    float haze_per_metre;
    float3 haze_square; // of its sRGB-encoded colour
    uint plain_slices; // so many of the farthest slices have quads whose relief is too small to see
    uint flags;
    float pixel_angle; // metres in a pixel per metre of distance
    uint ground_color; // square roots of red, green, blue in bytes from the lowest, and GROUND_PLAIN; 0: paved
    uint width_px; // of the picture
    uint height_px;
    float occluder_angle; // agents of at least this height, in metres per metre of distance, hide others
    uint left_px; // of the picture in its attachment
    uint top_px;
    float stretch_share_min; // StretchShare in the picture's corners; 1 in usual fields of view
    uint padding0;
    uint padding1;
    uint padding2;
};

// A character's constants for drawing.
struct CharacterConstants
{
    float3 position_min;
    uint padding0;
    float3 position_extent;
    uint padding1;
    float2 uv_min;
    float2 uv_extent;
};

// Push constants of a submesh's draw.
struct DrawConstants
{
    uint first_vertex;
    float alpha_cutoff;
    uint probe_vertex_count; // of one instance; probes and limit only
    uint probe_instance; // limit: the first
    uint probe_output; // limit: place of the first instance's first vertex
};

#endif
