// select: culls agents, turns the pixel error into a level of detail and sorts (agent, submesh) pairs into one instance
// list per (submesh, band). Three passes: count, scan, scatter. Twin: src/reference/select.rs
// In: agents[agent_count] and the tables of all characters; out: instances[], draws[bin_count + 1].
// The order within a list is not defined.

#include "gpu_types.hlsli"

[[vk::binding(0, 0)]] ConstantBuffer<FrameConstants> frame;
[[vk::binding(1, 0)]] StructuredBuffer<AgentState> agents;
[[vk::binding(2, 0)]] StructuredBuffer<CharacterInfo> characters;
[[vk::binding(3, 0)]] StructuredBuffer<ClipInfo> clips;
[[vk::binding(4, 0)]] StructuredBuffer<SubmeshInfo> submeshes;
[[vk::binding(5, 0)]] StructuredBuffer<BandInfo> bands;
[[vk::binding(6, 0)]] StructuredBuffer<float> collapse_errors;
[[vk::binding(7, 0)]] RWStructuredBuffer<uint> tally;
[[vk::binding(8, 0)]] RWStructuredBuffer<Selected> selected;
[[vk::binding(9, 0)]] RWStructuredBuffer<DrawCommand> draws;
[[vk::binding(10, 0)]] RWStructuredBuffer<Instance> instances;

// The smallest signed distance that any vertex of a clip may have to a plane is at most this; below 0 it is outside.
float Support(ClipInfo clip, AgentState agent, float4 plane)
{
    // The plane's normal in model space: heading is a rotation about +Y.
    float3 n = float3(
        agent.heading_cos * plane.x - agent.heading_sin * plane.z,
        plane.y,
        agent.heading_sin * plane.x + agent.heading_cos * plane.z);
    float origin = dot(plane.xyz, agent.position) + plane.w;
    float sphere = dot(n, clip.sphere_center) + clip.sphere_radius;
    float box = dot(n, clip.box_center) + dot(abs(n), clip.box_half_extent);
    return origin + agent.scale * min(sphere, box);
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

// Frame position of a phase: the last frame stands at the clip's end.
float FramePosition(ClipInfo clip, float phase)
{
    return (phase - floor(phase)) * float(clip.frame_count - 1u);
}

// An agent's list entry, but for its live vertices.
Instance MakeInstance(uint index, AgentState agent, CharacterInfo character, float lod_error)
{
    ClipInfo clip0 = clips[character.first_clip + (agent.clips & 0xffffu)];
    ClipInfo clip1 = clips[character.first_clip + (agent.clips >> 16)];
    Instance instance;
    instance.position = agent.position;
    instance.tint_seed = agent.tint_seed;
    instance.heading_cos = agent.heading_cos * agent.scale;
    instance.heading_sin = agent.heading_sin * agent.scale;
    instance.live_vertex_count = 0u;

    float allowed = lod_error * SKINNING_ERROR_SHARE;
    uint influence_count = allowed < character.influences3_error ? 4u
        : allowed < character.influences2_error ? 3u
        : allowed < character.influences1_error ? 2u : 1u;

    bool still = (frame.flags & FLAG_STILL) != 0u;
    float blend = still ? 0.0 : saturate(agent.blend);
    float position0 = still ? 0.0 : FramePosition(clip0, agent.phase0);
    float position1 = still ? 0.0 : FramePosition(clip1, agent.phase1);
    float error = max(blend < 1.0 ? clip0.nearest_error : 0.0, blend > 0.0 ? clip1.nearest_error : 0.0);
    bool nearest = still || allowed >= error;

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
    instance.packed = influence_count | (sample_count << 3) | (index << 6);
    instance.sample_entries = frames * character.joint_count;
    instance.sample_weights = weights.xyz;
    instance.shadow_radius = SHADOW_SHARE * agent.scale * sqrt(clip0.box_half_extent.x * clip0.box_half_extent.z);
    return instance;
}

// Vertices of a submesh that live at an error: those whose collapse error is greater. Errors do not rise.
uint LiveVertexCount(SubmeshInfo submesh, float lod_error)
{
    uint low = 0u;
    uint high = submesh.vertex_count;
    while (low < high)
    {
        uint middle = (low + high) >> 1;
        bool alive = collapse_errors[submesh.first_error + middle] > lod_error;
        low = alive ? middle + 1u : low;
        high = alive ? high : middle;
    }
    return low;
}

// The tightest band that holds this many vertices: bands fall.
uint BandOf(SubmeshInfo submesh, uint live_vertex_count)
{
    uint low = 0u;
    uint high = submesh.band_count - 1u;
    while (low < high)
    {
        uint middle = (low + high + 1u) >> 1;
        bool holds = bands[submesh.first_bin + middle].vertex_count >= live_vertex_count;
        low = holds ? middle : low;
        high = holds ? high : middle - 1u;
    }
    return low;
}

groupshared uint group_visible;
groupshared uint group_live_vertices;

// Threads: one per agent.
[numthreads(SELECT_GROUP_SIZE, 1, 1)]
void CSCount(uint3 thread : SV_DispatchThreadID, uint local : SV_GroupIndex)
{
    if (local == 0u)
    {
        group_visible = 0u;
        group_live_vertices = 0u;
    }
    GroupMemoryBarrierWithGroupSync();

    uint index = thread.x;
    if (index < frame.agent_count)
    {
        AgentState agent = agents[index];
        CharacterInfo character = characters[agent.character];
        ClipInfo clip0 = clips[character.first_clip + (agent.clips & 0xffffu)];

        // A blend is a convex combination of both clips, vertex by vertex: outside only where both are.
        float support[6];
        [unroll]
        for (uint p = 0u; p < 6u; p++)
        {
            support[p] = Support(clip0, agent, frame.planes[p]);
        }
        float distance = DistanceToSphere(clip0, agent);
        if (agent.blend > 0.0)
        {
            ClipInfo clip1 = clips[character.first_clip + (agent.clips >> 16)];
            [unroll]
            for (uint p = 0u; p < 6u; p++)
            {
                support[p] = max(support[p], Support(clip1, agent, frame.planes[p]));
            }
            distance = min(distance, DistanceToSphere(clip1, agent));
        }
        bool visible = min(min(min(support[0], support[1]), min(support[2], support[3])), min(support[4], support[5])) >= 0.0;

        uint live_vertices = 0u;
        if (visible)
        {
            bool full = (frame.flags & FLAG_FULL_DETAIL) != 0u;
            float lod_error = full ? -1.0 : frame.error_per_metre * distance / agent.scale;
            for (uint s = 0u; s < character.submesh_count; s++)
            {
                SubmeshInfo submesh = submeshes[character.first_submesh + s];
                Selected choice;
                choice.live_vertex_count = full ? submesh.vertex_count : LiveVertexCount(submesh, lod_error);
                choice.bin = submesh.first_bin + BandOf(submesh, choice.live_vertex_count);
                choice.rank = 0u;
                choice.lod_error = lod_error;
                if (choice.live_vertex_count < 3u || bands[choice.bin].index_count == 0u)
                {
                    choice.bin = BIN_NONE;
                }
                else
                {
                    InterlockedAdd(tally[TALLY_BINS + choice.bin], 1u, choice.rank);
                    live_vertices += choice.live_vertex_count;
                }
                selected[index * frame.submesh_stride + s] = choice;
            }
            InterlockedAdd(group_visible, 1u);
            InterlockedAdd(group_live_vertices, live_vertices);
        }
        else
        {
            for (uint s = 0u; s < character.submesh_count; s++)
            {
                selected[index * frame.submesh_stride + s].bin = BIN_NONE;
            }
        }
    }

    GroupMemoryBarrierWithGroupSync();
    if (local == 0u && group_visible > 0u)
    {
        InterlockedAdd(tally[TALLY_VISIBLE], group_visible);
        // 64 bits in two counters: each holds the sum of 16-bit halves.
        InterlockedAdd(tally[TALLY_LIVE_VERTICES_LOW], group_live_vertices & 0xffffu);
        InterlockedAdd(tally[TALLY_LIVE_VERTICES_HIGH], group_live_vertices >> 16);
    }
}

groupshared uint scan_sums[SCAN_GROUP_SIZE];

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
        sum += tally[TALLY_BINS + i];
    }
    scan_sums[local] = sum;
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
        DrawCommand draw;
        draw.index_count = bands[bin].index_count;
        draw.instance_count = count;
        draw.first_index = bands[bin].first_index;
        draw.vertex_offset = 0;
        draw.first_instance = offset;
        draws[bin] = draw;
        offset += count;
    }
    // Behind the last bin: all lists in one draw of 4 vertices, as a VkDrawIndirectCommand, for the shadow stage.
    if (local == SCAN_GROUP_SIZE - 1u)
    {
        DrawCommand all;
        all.index_count = 4u;
        all.instance_count = offset;
        all.first_index = 0u;
        all.vertex_offset = 0;
        all.first_instance = 0u;
        draws[frame.bin_count] = all;
    }
}

// Threads: one per agent.
[numthreads(SELECT_GROUP_SIZE, 1, 1)]
void CSScatter(uint3 thread : SV_DispatchThreadID)
{
    uint index = thread.x;
    if (index >= frame.agent_count)
    {
        return;
    }
    AgentState agent = agents[index];
    CharacterInfo character = characters[agent.character];
    bool made = false;
    Instance instance;
    for (uint s = 0u; s < character.submesh_count; s++)
    {
        Selected choice = selected[index * frame.submesh_stride + s];
        if (choice.bin != BIN_NONE)
        {
            if (!made)
            {
                instance = MakeInstance(index, agent, character, choice.lod_error);
                made = true;
            }
            instance.live_vertex_count = choice.live_vertex_count;
            instance.shadow_radius = s == 0u ? instance.shadow_radius : 0.0;
            instances[draws[choice.bin].first_instance + choice.rank] = instance;
        }
    }
}
