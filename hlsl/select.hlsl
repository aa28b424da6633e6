// select: culls agents, turns the pixel error into a level of detail and sorts (agent, submesh) pairs into one instance
// list per (submesh, band), and impostors into one per slice of distance. Three passes: count, scan, scatter. Twin:
// src/reference/select.rs
// In: agents[agent_count] and the tables of all characters; out: instances[], draws[] (src/gpu/slot.rs says what is where), shadows[].
// The order within a list is not defined.
// Occluders' lists are made the same way before: count_occluders takes coarse levels of who is large enough.
//
// What makes it cheap on a CPU driver: lavapipe reads and writes structured buffers lane by lane, at a price per access more
// than per byte, so records are whole uint4s; it reads texel buffers for all lanes at once, several times as fast, so what
// is only read is one where the device allows large ones; it reads constants once for all lanes only outside
// control flow, so that is where they are read; and it runs both sides of a branch, at nearly the full price of what they
// write, but skips a loop that no lane enters, so what few agents need stands in loops. Its threads take the
// workgroups in as many runs: a shard's counters stay in one core's cache.

#include "gpu_types.hlsli"
#include "records.hlsli"

[[vk::binding(0, 0)]] ConstantBuffer<FrameConstants> frame;
[[vk::binding(1, 0)]] RECORDS(uint4) agents; // 3 of them are an AgentState
[[vk::binding(2, 0)]] RECORDS(uint4) characters; // 3 are a CharacterInfo
[[vk::binding(3, 0)]] RECORDS(uint4) clips; // 4 are a ClipInfo
[[vk::binding(4, 0)]] RECORDS(uint4) submeshes; // 1 is a SubmeshInfo
[[vk::binding(5, 0)]] StructuredBuffer<BandInfo> bands;
[[vk::binding(6, 0)]] RECORDS(uint2) levels; // 1 is a LevelInfo
[[vk::binding(7, 0)]] RWStructuredBuffer<uint> tally;
[[vk::binding(8, 0)]] RWStructuredBuffer<uint4> selected; // 1 is a Selected
[[vk::binding(9, 0)]] RWStructuredBuffer<DrawCommand> draws;
[[vk::binding(13, 0)]] RECORDS(uint4) ranges; // 2 are the MAX_RANGES RangeInfo of a character
[[vk::binding(11, 0)]] RECORDS(uint4) chosen; // selected, in the scatter pass
[[vk::binding(12, 0)]] RECORDS(uint) tallied; // tally, in the scatter pass
[[vk::binding(10, 0)]] RWStructuredBuffer<uint4> instances; // 4 are an Instance
[[vk::binding(14, 0)]] RECORDS(float) pyramid; // of the occlude stage
[[vk::binding(15, 0)]] RWStructuredBuffer<float4> shadows; // place and radius, metres

AgentState LoadAgent(uint index)
{
    uint4 a = agents[3u * index];
    uint4 b = agents[3u * index + 1u];
    uint4 c = agents[3u * index + 2u];
    AgentState agent;
    agent.position = asfloat(a.xyz);
    agent.heading_cos = asfloat(a.w);
    agent.heading_sin = asfloat(b.x);
    agent.scale = asfloat(b.y);
    agent.character = b.z;
    agent.clips = b.w;
    agent.phase0 = asfloat(c.x);
    agent.phase1 = asfloat(c.y);
    agent.blend = asfloat(c.z);
    agent.tint_seed = c.w;
    return agent;
}

CharacterInfo LoadCharacter(uint index)
{
    uint4 a = characters[3u * index];
    uint4 b = characters[3u * index + 1u];
    CharacterInfo character;
    character.first_submesh = a.x;
    character.submesh_count = a.y;
    character.first_clip = a.z;
    character.joint_count = a.w;
    character.influences1_error = asfloat(b.x);
    character.influences2_error = asfloat(b.y);
    character.influences3_error = asfloat(b.z);
    character.lowest = asfloat(b.w);
    character.occluder_error = asfloat(characters[3u * index + 2u].x);
    return character;
}

ClipInfo LoadClip(uint index)
{
    uint4 a = clips[4u * index];
    uint4 b = clips[4u * index + 1u];
    uint4 c = clips[4u * index + 2u];
    uint4 d = clips[4u * index + 3u];
    ClipInfo clip;
    clip.sphere_center = asfloat(a.xyz);
    clip.sphere_radius = asfloat(a.w);
    clip.box_center = asfloat(b.xyz);
    clip.first_pose = b.w;
    clip.box_half_extent = asfloat(c.xyz);
    clip.pose_count = c.w;
    clip.first_frame = d.x;
    clip.frame_count = d.y;
    clip.nearest_error = asfloat(d.z);
    clip.shadow_radius = asfloat(d.w);
    return clip;
}

SubmeshInfo LoadSubmesh(uint index)
{
    uint4 a = submeshes[index];
    SubmeshInfo submesh;
    submesh.first_level = a.x;
    submesh.level_count = a.y;
    submesh.first_key = int(a.z);
    submesh.vertex_count = a.w;
    return submesh;
}

// The smallest signed distance that any vertex of a clip may have to a plane is at most this; below 0 it is outside.
float Support(ClipInfo clip, AgentState agent, float4 plane)
{
    // The plane's normal in model space: heading is a rotation about +Y.
    float3 n = float3(
        agent.heading_cos * plane.x - agent.heading_sin * plane.z,
        plane.y,
        agent.heading_sin * plane.x + agent.heading_cos * plane.z);
    float origin = dot(plane.xyz, agent.position) + plane.w;
    return origin + agent.scale * (dot(n, clip.box_center) + dot(abs(n), clip.box_half_extent));
}

float DistanceToSphere(ClipInfo clip, AgentState agent)
{
    float3 c = clip.sphere_center;
    float3 center = agent.position + agent.scale * float3(
        agent.heading_cos * c.x + agent.heading_sin * c.z,
        c.y,
        agent.heading_cos * c.z - agent.heading_sin * c.x);
    return max(length(center - frame.eye) - agent.scale * clip.sphere_radius, frame.near);
}

#include "occlusion.hlsli"
#include "stretch.hlsli"

// How many clips an agent blends with its first: none or one. A loop over them, in place of a branch: a CPU driver leaves it
// where no lane goes in, and runs both sides of a branch.
uint BlendedClips(AgentState agent)
{
    return (agent.clips >> 16) == (agent.clips & 0xffffu) ? 0u : 1u;
}

// Frame position of a phase: the last frame stands at the clip's end.
float FramePosition(ClipInfo clip, float phase)
{
    return (phase - floor(phase)) * float(clip.frame_count - 1u);
}

// Radius of an agent's contact shadow in metres. Whoever floats or flies casts less of it.
float ShadowRadius(AgentState agent, CharacterInfo character, ClipInfo clip0)
{
    float height = abs(agent.position.y + agent.scale * character.lowest);
    return max(agent.scale * clip0.shadow_radius - height, 0.0);
}

// Agents of a shard: whole workgroups.
uint ShardAgents()
{
    uint groups = (frame.agent_count + SELECT_SHARDS * SELECT_GROUP_SIZE - 1u) / (SELECT_SHARDS * SELECT_GROUP_SIZE);
    return groups * SELECT_GROUP_SIZE;
}

// Where a shard's part of the tally starts; that of the frame starts at 0.
uint ShardTally(uint shard)
{
    uint words = (TALLY_BINS + frame.bin_count + TALLY_ALIGNMENT - 1u) / TALLY_ALIGNMENT * TALLY_ALIGNMENT;
    return (shard + 1u) * words;
}

// Where a shard's entries start in the selected buffer.
uint ShardEntries(uint shard)
{
    return shard * ShardAgents() * frame.entry_stride;
}

// The agent of a thread, where passes have one thread per agent and a row of workgroups per shard.
struct Member
{
    uint index; // any agent's where the thread has none
    bool inside;
};

Member MemberAt(uint3 thread)
{
    uint index = thread.y * ShardAgents() + thread.x;
    Member member;
    member.index = min(index, frame.agent_count - 1u);
    member.inside = index < frame.agent_count;
    return member;
}

// Selected::packed of an agent at an error, but for its shadow.
uint PackSelected(uint index, AgentState agent, CharacterInfo character, ClipInfo clip0, ClipInfo clip1, float lod_error, bool still)
{
    float allowed = lod_error * SKINNING_ERROR_SHARE;
    uint influence_count = allowed < character.influences3_error ? 4u
        : allowed < character.influences2_error ? 3u
        : allowed < character.influences1_error ? 2u : 1u;
    float blend = saturate(agent.blend);
    float error = max(blend < 1.0 ? clip0.nearest_error : 0.0, blend > 0.0 ? clip1.nearest_error : 0.0);
    bool nearest = still || allowed >= error;
    return influence_count | (nearest ? SELECTED_NEAREST : 0u) | (index << 6);
}

// The instance of an agent's list entry.
Instance MakeInstance(uint4 selected_entry, AgentState agent, CharacterInfo character, ClipInfo clip0, bool still)
{
    ClipInfo clip1 = clip0;
    for (uint i = BlendedClips(agent); i > 0u; i--)
    {
        clip1 = LoadClip(character.first_clip + (agent.clips >> 16));
    }
    Instance instance;
    instance.position = agent.position;
    instance.tint_seed = agent.tint_seed;
    instance.heading_cos = agent.heading_cos * agent.scale;
    instance.heading_sin = agent.heading_sin * agent.scale;
    instance.live_vertex_count = selected_entry.z;

    float blend = still ? 0.0 : saturate(agent.blend);
    float position0 = still ? 0.0 : FramePosition(clip0, agent.phase0);
    float position1 = still ? 0.0 : FramePosition(clip1, agent.phase1);
    bool nearest = (selected_entry.w & SELECTED_NEAREST) != 0u;

    if (nearest)
    {
        position0 = floor(position0 + 0.5);
        position1 = floor(position1 + 0.5);
    }
    uint frame0 = uint(position0);
    uint frame1 = uint(position1);
    float fraction0 = position0 - float(frame0);
    float fraction1 = position1 - float(frame1);
    uint4 frames = uint4(
        clip0.first_frame + frame0,
        clip0.first_frame + min(frame0 + 1u, clip0.frame_count - 1u),
        clip1.first_frame + frame1,
        clip1.first_frame + min(frame1 + 1u, clip1.frame_count - 1u));
    float4 weights = float4(
        (1.0 - blend) * (1.0 - fraction0),
        (1.0 - blend) * fraction0,
        blend * (1.0 - fraction1),
        blend * fraction1);
    bool both = blend > 0.0 && blend < 1.0;
    if (blend >= 1.0)
    {
        frames.xy = frames.zw;
        weights.xy = weights.zw;
    }
    if (nearest)
    {
        frames.y = frames.z;
        weights.y = weights.z;
    }
    uint sample_count = (nearest ? 1u : 2u) * (both ? 2u : 1u);
    instance.packed = (selected_entry.w & ~0x38u) | (sample_count << 3);
    instance.sample_entries = frames * character.joint_count;
    instance.sample_weights = weights.xyz;
    instance.padding0 = 0u;
    return instance;
}

// Where a submesh's level at an error stands.
uint LevelAt(SubmeshInfo submesh, float lod_error)
{
    int step = clamp((asint(lod_error) >> LEVEL_SHIFT) - submesh.first_key, 0, int(submesh.level_count) - 2) + 1;
    return submesh.first_level + (lod_error < 0.0 ? 0u : uint(step));
}

// What draws an agent at a projected size, in bind-space units per pixel: a representation, and for the first steps of its
// range also the one before it. Small agents are drawn once: each switches somewhere within these steps, by its seed, so that
// a crowd does not do so along a line. Bins; BIN_NONE is the mesh.
struct Choice
{
    uint bin;
    uint before; // the same where nothing fades
    uint fade; // share of `bin`, 255ths
};

Choice ChooseRange(uint character, float units, float height, uint seed)
{
    uint4 r01 = ranges[2u * character];
    uint4 r23 = ranges[2u * character + 1u];
    float3 ends = asfloat(uint3(r01.x, r01.z, r23.x));
    uint place = units < ends.x ? 0u : units < ends.y ? 1u : units < ends.z ? 2u : 3u;
    Choice choice;
    choice.bin = place == 0u ? r01.y : place == 1u ? r01.w : place == 2u ? r23.y : r23.w;
    choice.before = place <= 1u ? r01.y : place == 2u ? r01.w : r23.y;
    float start = place <= 1u ? ends.x : place == 2u ? ends.y : ends.z;
    float fade = (units / start - 1.0) * (1.0 / FADE_SPAN);
    bool fades = place > 0u && fade < 1.0;
    bool switches = height < SWITCH_HEIGHT_PX * units;
    float own = float((seed * 0x9e3779b9u) >> 8) * (1.0 / 16777216.0);
    choice.bin = fades && switches && fade < own ? choice.before : choice.bin;
    fades = fades && !switches;
    choice.before = fades ? choice.before : choice.bin;
    choice.fade = fades ? uint(fade * 254.0) + 1u : 255u;
    return choice;
}

// The captured pose nearest to a phase.
uint PoseAt(ClipInfo clip, float phase)
{
    uint pose = uint((phase - floor(phase)) * float(clip.pose_count) + 0.5);
    return clip.first_pose + (pose < clip.pose_count ? pose : 0u);
}

// Takes places for a lane's entries among its shard's, and counts. All lanes call it: their sums are added by one atomic, in a
// lane each.
uint TakePlaces(uint shard_tally, uint entry_count, bool visible, bool is_mesh, bool casts)
{
    uint before = WavePrefixSum(entry_count) - entry_count; // glslang's scan is inclusive
    uint all = WaveActiveSum(entry_count);
    uint counted = WaveActiveSum((visible ? 1u : 0u) | (is_mesh ? 1u << 8 : 0u) | (casts ? 1u << 16 : 0u));
    uint lane = WaveGetLaneIndex();
    uint word = lane == 0u ? TALLY_ENTRIES : lane == 1u ? TALLY_VISIBLE : lane == 2u ? TALLY_MESHES : TALLY_SHADOWS;
    uint sum = lane == 0u ? all : (counted >> (8u * lane - 8u)) & 0xffu;
    uint place = 0u;
    if (lane < 4u && sum > 0u)
    {
        InterlockedAdd(tally[shard_tally + word], sum, place);
    }
    return WaveReadLaneFirst(place) + before;
}

// What to add to an impostor kind's first bin for that of a distance.
uint SliceAt(float distance)
{
    uint step = asuint(max(distance / frame.near, 1.0)) - asuint(1.0);
    return SLICE_COUNT - 1u - min(step >> SLICE_SHIFT, SLICE_COUNT - 1u);
}

// What an agent's bounds say: how far it is, and whether any of it is in the picture.
struct Bounds
{
    float distance;
    bool inside;
};

Bounds FindBounds(AgentState agent, ClipInfo clip0, ClipInfo clip1, float4 planes[6])
{
    // A blend is a convex combination of both clips, vertex by vertex: outside only where both are.
    float nearest = 0.0;
    [unroll]
    for (uint p = 0u; p < 6u; p++)
    {
        float support = max(Support(clip0, agent, planes[p]), Support(clip1, agent, planes[p]));
        nearest = p == 0u ? support : min(nearest, support);
    }
    Bounds bounds;
    bounds.inside = nearest >= 0.0;
    bounds.distance = min(DistanceToSphere(clip0, agent), DistanceToSphere(clip1, agent));
    return bounds;
}

// Coarse meshes of who is large enough to hide others. Threads: one per agent, a row of workgroups per shard.
[numthreads(SELECT_GROUP_SIZE, 1, 1)]
void CSCountOccluders(uint3 thread : SV_DispatchThreadID)
{
    float4 planes[6] = frame.planes;
    float occluder_angle = frame.occluder_angle;
    float eye_height = frame.eye.y;
    bool still = (frame.flags & FLAG_STILL) != 0u;
    uint shard_tally = ShardTally(thread.y);
    uint first_entry = ShardEntries(thread.y);
    Member member = MemberAt(thread);
    bool inside = member.inside;
    uint index = member.index;
    AgentState agent = LoadAgent(index);
    CharacterInfo character = LoadCharacter(agent.character);
    ClipInfo clip0 = LoadClip(character.first_clip + (agent.clips & 0xffffu));
    Bounds bounds = FindBounds(agent, clip0, clip0, planes);
    float height = 2.0 * agent.scale * clip0.box_half_extent.y;
    bool large = height >= occluder_angle * bounds.distance;
    // Over whom one looks down steeply, only much smaller ones could be hidden.
    float top = agent.position.y + agent.scale * (clip0.box_center.y + clip0.box_half_extent.y);
    bool level_view = eye_height - top <= OCCLUDER_SLOPE_MAX * bounds.distance;
    bool wanted = inside && bounds.inside && large && level_view;
    uint entry_count = wanted ? character.submesh_count : 0u;
    uint place = TakePlaces(shard_tally, entry_count, false, wanted, false);
    for (uint s = 0u; s < entry_count; s++)
    {
        ClipInfo clip1 = LoadClip(character.first_clip + (agent.clips >> 16));
        // As far off in the picture, whatever their height, up to what all larger ones have.
        float lod_error = character.occluder_error * max(OCCLUDER_FINE_HEIGHTS * occluder_angle * bounds.distance / height, 1.0);
        uint packed = PackSelected(index, agent, character, clip0, clip1, lod_error, still);
        uint2 level = levels[LevelAt(LoadSubmesh(character.first_submesh + s), lod_error)];
        uint rank = 0u;
        if (level.y != BIN_NONE)
        {
            InterlockedAdd(tally[shard_tally + TALLY_BINS + level.y], 1u, rank);
        }
        selected[first_entry + place + s] = uint4(level.y, rank, level.x, packed);
    }
}

// Threads: one per agent, a row of workgroups per shard.
[numthreads(SELECT_GROUP_SIZE, 1, 1)]
void CSCount(uint3 thread : SV_DispatchThreadID)
{
    float4 planes[6] = frame.planes;
    float error_per_metre = frame.error_per_metre;
    float pixel_angle = frame.pixel_angle;
    bool still = (frame.flags & FLAG_STILL) != 0u;
    bool full = (frame.flags & FLAG_FULL_DETAIL) != 0u;
    bool shadows_drawn = (frame.flags & FLAG_SHADOWS) != 0u;
    float3 eye = frame.eye;
    uint shard_tally = ShardTally(thread.y);
    uint first_entry = ShardEntries(thread.y);
    Member member = MemberAt(thread);
    bool inside = member.inside;
    uint index = member.index;
    AgentState agent = LoadAgent(index);
    CharacterInfo character = LoadCharacter(agent.character);
    ClipInfo clip0 = LoadClip(character.first_clip + (agent.clips & 0xffffu));
    Bounds bounds = FindBounds(agent, clip0, clip0, planes);
    ClipInfo clip1 = clip0;
    for (uint i = BlendedClips(agent); i > 0u; i--)
    {
        clip1 = LoadClip(character.first_clip + (agent.clips >> 16));
        bounds = FindBounds(agent, clip0, clip1, planes);
    }
    float distance = bounds.distance
        * StretchShare(agent.position + float3(0.0, agent.scale * clip0.sphere_center.y, 0.0));
    bool visible = bounds.inside && inside;
    bool occluded = false;
    float shadow_radius = ShadowRadius(agent, character, clip0);
    bool casts = visible && shadows_drawn && length(agent.position - eye) < 2.0 * SHADOW_FADE_RADII * shadow_radius;
#ifdef OCCLUSION
    Viewed viewed = LoadViewed();
    float open = OpenShareOfBody(viewed, agent, clip0, clip1, visible);
    bool body_hidden = open == 0.0;
    casts = casts && !IsShadowHidden(viewed, agent, shadow_radius, casts && body_hidden);
    occluded = body_hidden && !casts;
    visible = visible && !occluded;
    error_per_metre *= OpenErrorFactor(open);
#endif
    bool second = agent.blend > 0.5 && !still;
    uint pose = PoseAt(clip0, still ? 0.0 : agent.phase0);
    uint pose1 = PoseAt(clip1, agent.phase1);
    pose = second ? pose1 : pose;

    float lod_error = full ? -1.0 : error_per_metre * distance / agent.scale;
    Choice choice = ChooseRange(
        agent.character, pixel_angle * distance / agent.scale, 2.0 * clip0.box_half_extent.y, agent.tint_seed);
    bool is_mesh = visible && (choice.bin == BIN_NONE || choice.before == BIN_NONE);
    bool shows = visible && choice.bin != BIN_NONE;
    bool leaves = visible && choice.before != BIN_NONE && choice.before != choice.bin;
    uint slice = SliceAt(bounds.distance);
    uint submesh_count = is_mesh ? character.submesh_count : 0u;
    uint entry_count = submesh_count + (shows ? 1u : 0u) + (leaves ? 1u : 0u);
    uint place = TakePlaces(shard_tally, entry_count, visible, is_mesh, casts);
    uint live_vertices = 0u;
    // An agent's first entry lists its shadow.
    for (uint e = 0u; e < entry_count; e++)
    {
        bool of_mesh = e < submesh_count;
        uint2 level = levels[LevelAt(LoadSubmesh(character.first_submesh + (of_mesh ? e : 0u)), lod_error)];
        // A mesh that fades out is drawn whole: what fades in covers it.
        bool fades_out = !shows || e > submesh_count;
        uint pose_fade = pose | (choice.fade << IMPOSTOR_FADE_SHIFT) | (fades_out ? IMPOSTOR_FADES_OUT : 0u);
        uint bin = of_mesh ? level.y : (fades_out ? choice.before : choice.bin) + slice;
        uint packed = PackSelected(index, agent, character, clip0, clip1, lod_error, still);
        uint rank = 0u;
        if (bin != BIN_NONE)
        {
            InterlockedAdd(tally[shard_tally + TALLY_BINS + bin], 1u, rank);
        }
        selected[first_entry + place + e] =
            uint4(bin, rank, of_mesh ? level.x : pose_fade, packed | (casts ? SELECTED_CASTS : 0u));
        live_vertices += of_mesh && bin != BIN_NONE ? level.x : 0u;
        casts = false;
    }

    uint wave_live_vertices = WaveActiveSum(live_vertices);
    if (WaveIsFirstLane() && wave_live_vertices > 0u)
    {
        uint before;
        InterlockedAdd(tally[shard_tally + TALLY_LIVE_VERTICES_LOW], wave_live_vertices, before);
        for (uint carry = before + wave_live_vertices < before ? 1u : 0u; carry > 0u; carry--)
        {
            InterlockedAdd(tally[shard_tally + TALLY_LIVE_VERTICES_HIGH], 1u);
        }
    }
#ifdef OCCLUSION
    uint wave_occluded = WaveActiveCountBits(occluded);
    if (WaveIsFirstLane() && wave_occluded > 0u)
    {
        InterlockedAdd(tally[shard_tally + TALLY_OCCLUDED], wave_occluded);
    }
#endif
}

groupshared uint scan_sums[SCAN_GROUP_SIZE];
// Where the instances of each draw of impostors start, and where the last one's end.
groupshared uint impostor_starts[IMPOSTOR_DRAWS + 1];

// The first bin of a draw of impostors; behind the last draw, that of the meshes.
uint ImpostorDrawBin(uint draw)
{
    return draw == 0u ? QUAD_BIN : draw == 1u ? QUAD_BIN + frame.plain_slices : FLAT_BIN + (draw - 2u) * SLICE_COUNT;
}

// Sums of what the shards counted, where their shadows start and the draw of all of them, and the dispatch of the scatter
// pass: a row of workgroups per shard, as long as the longest.
void SumShards()
{
    uint visible = 0u;
    uint meshes = 0u;
    uint occluded = 0u;
    uint low = 0u;
    uint high = 0u;
    uint entries = 0u;
    uint shadow_count = 0u;
    for (uint shard = 0u; shard < SELECT_SHARDS; shard++)
    {
        uint start = ShardTally(shard);
        visible += tally[start + TALLY_VISIBLE];
        meshes += tally[start + TALLY_MESHES];
        occluded += tally[start + TALLY_OCCLUDED];
        uint part = tally[start + TALLY_LIVE_VERTICES_LOW];
        low += part;
        high += tally[start + TALLY_LIVE_VERTICES_HIGH] + (low < part ? 1u : 0u);
        entries = max(entries, tally[start + TALLY_ENTRIES]);
        uint first_shadow = shadow_count;
        shadow_count += tally[start + TALLY_SHADOWS];
        tally[start + TALLY_SHADOWS] = first_shadow;
    }
    tally[TALLY_VISIBLE] = visible;
    tally[TALLY_MESHES] = meshes;
    tally[TALLY_OCCLUDED] = occluded;
    tally[TALLY_LIVE_VERTICES_LOW] = low;
    tally[TALLY_LIVE_VERTICES_HIGH] = high;
    tally[TALLY_ENTRIES] = (entries + SELECT_GROUP_SIZE - 1u) / SELECT_GROUP_SIZE;
    tally[TALLY_ENTRIES + 1u] = SELECT_SHARDS;
    tally[TALLY_ENTRIES + 2u] = 1u;
    // As a VkDrawIndirectCommand, behind the last bin.
    DrawCommand squares;
    squares.index_count = 4u;
    squares.instance_count = shadow_count;
    squares.first_index = 0u;
    squares.vertex_offset = 0;
    squares.first_instance = 0u;
    draws[frame.bin_count] = squares;
}

// The commands of a list that is drawn packed: whole instances, and what is left over. Vertex numbers say whose a vertex is,
// `vertices` for each entry; `first_index` is where windows of `index_count` indices stand, one for each agent of an instance.
void WritePacked(uint command, uint count, uint first_entry, uint vertices, uint index_count, uint first_index)
{
    uint whole = count / AGENTS_PER_INSTANCE;
    uint left = count - whole * AGENTS_PER_INSTANCE;
    DrawCommand draw;
    draw.index_count = index_count * AGENTS_PER_INSTANCE;
    draw.instance_count = whole;
    draw.first_index = first_index;
    draw.vertex_offset = int(vertices * first_entry);
    draw.first_instance = 0u;
    draws[command] = draw;
    draw.index_count = index_count * left;
    draw.instance_count = min(left, 1u);
    draw.vertex_offset = int(vertices * (first_entry + whole * AGENTS_PER_INSTANCE));
    draws[command + 1u] = draw;
}

// Where the commands of a mesh's bin stand that is drawn packed: behind those of impostors.
uint PackedCommand(uint bin)
{
    return frame.bin_count + 1u + PACKED_COMMANDS * (IMPOSTOR_DRAWS + bin - 2u * SLICE_COUNT);
}

// One workgroup turns counts into draw commands. Thread t scans a run of neighbouring bins.
[numthreads(SCAN_GROUP_SIZE, 1, 1)]
void CSScan(uint local : SV_GroupIndex)
{
    uint run = (frame.bin_count + SCAN_GROUP_SIZE - 1u) / SCAN_GROUP_SIZE;
    uint first = min(local * run, frame.bin_count);
    uint end = min(first + run, frame.bin_count);
    uint sum = 0u;
    for (uint i = first; i < end; i++)
    {
        uint count = 0u;
        for (uint shard = 0u; shard < SELECT_SHARDS; shard++)
        {
            count += tally[ShardTally(shard) + TALLY_BINS + i];
        }
        tally[TALLY_BINS + i] = count;
        sum += count;
    }
    scan_sums[local] = sum;
    if (local <= IMPOSTOR_DRAWS)
    {
        impostor_starts[local] = 0u;
    }
    GroupMemoryBarrierWithGroupSync();
    for (uint step = 1u; step < SCAN_GROUP_SIZE; step <<= 1)
    {
        uint before = local >= step ? scan_sums[local - step] : 0u;
        GroupMemoryBarrierWithGroupSync();
        scan_sums[local] += before;
        GroupMemoryBarrierWithGroupSync();
    }
    uint offset = scan_sums[local] - sum;
    for (uint bin = first; bin < end; bin++)
    {
        uint count = tally[TALLY_BINS + bin];
        for (uint i = 0u; i <= IMPOSTOR_DRAWS; i++)
        {
            if (bin == ImpostorDrawBin(i))
            {
                impostor_starts[i] = offset;
            }
        }
        DrawCommand draw;
        draw.index_count = bands[bin].index_count;
        draw.instance_count = count;
        draw.first_index = bands[bin].first_index;
        draw.vertex_offset = 0;
        draw.first_instance = offset;
        draws[bin] = draw;
        for (uint p = bands[bin].packed_first_index != 0u ? 1u : 0u; p > 0u; p--)
        {
            WritePacked(PackedCommand(bin), count, offset, PACKED_VERTICES, draw.index_count, bands[bin].packed_first_index);
        }
        uint start = offset;
        for (uint shard = 0u; shard < SELECT_SHARDS; shard++)
        {
            uint word = ShardTally(shard) + TALLY_BINS + bin;
            uint part = tally[word];
            tally[word] = start;
            start += part;
        }
        offset += count;
    }
    if (local == 0u)
    {
        SumShards();
    }
    // And behind that the impostors', many slices in one.
    GroupMemoryBarrierWithGroupSync();
    if (local < IMPOSTOR_DRAWS)
    {
        uint first_instance = impostor_starts[local];
        uint count = impostor_starts[local + 1u] - first_instance;
        uint first_bin = ImpostorDrawBin(local);
        BandInfo window = bands[first_bin];
        uint command = frame.bin_count + 1u + PACKED_COMMANDS * local;
        if (first_bin < FLAT_BIN)
        {
            WritePacked(command, count, first_instance, 4u, 6u, window.first_index);
        }
        else
        {
            DrawCommand slices;
            slices.index_count = window.index_count;
            slices.instance_count = count;
            slices.first_index = window.first_index;
            slices.vertex_offset = 0;
            slices.first_instance = first_instance;
            draws[command] = slices;
            slices.instance_count = 0u;
            draws[command + 1u] = slices;
        }
    }
}

// Threads: one per entry, a row of workgroups per shard.
[numthreads(SELECT_GROUP_SIZE, 1, 1)]
void CSScatter(uint3 thread : SV_DispatchThreadID)
{
    uint shard_tally = ShardTally(thread.y);
    uint first_entry = ShardEntries(thread.y);
    bool still = (frame.flags & FLAG_STILL) != 0u;
    uint4 entry = chosen[first_entry + thread.x];
    bool inside = thread.x < tallied[shard_tally + TALLY_ENTRIES];
    // A wave takes places for all its shadows at once.
    bool casts = inside && (entry.w & SELECTED_CASTS) != 0u;
    uint shadow_place = WavePrefixCountBits(casts);
    uint shadow_count = WaveActiveCountBits(casts);
    uint first_shadow = 0u;
    if (WaveIsFirstLane() && shadow_count > 0u)
    {
        InterlockedAdd(tally[shard_tally + TALLY_SHADOWS], shadow_count, first_shadow);
    }
    shadow_place += WaveReadLaneFirst(first_shadow);
    for (uint i = inside ? 1u : 0u; i > 0u; i--)
    {
        AgentState agent = LoadAgent(entry.w >> 6);
        CharacterInfo character = LoadCharacter(agent.character);
        ClipInfo clip0 = LoadClip(character.first_clip + (agent.clips & 0xffffu));
        if (casts)
        {
            shadows[shadow_place] = float4(agent.position, ShadowRadius(agent, character, clip0));
        }
        if (entry.x == BIN_NONE)
        {
            continue;
        }
        Instance instance = MakeInstance(entry, agent, character, clip0, still);
        uint place = 4u * (tallied[shard_tally + TALLY_BINS + entry.x] + entry.y);
        instances[place] = uint4(asuint(instance.position), asuint(instance.heading_cos));
        instances[place + 1u] =
            uint4(instance.tint_seed, instance.live_vertex_count, instance.packed, asuint(instance.heading_sin));
        instances[place + 2u] = instance.sample_entries;
        instances[place + 3u] = uint4(asuint(instance.sample_weights), 0u);
    }
}
