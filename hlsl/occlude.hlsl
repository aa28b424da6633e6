// occlude: the depth of coarse meshes of the larger agents, which the select stage lists, and a pyramid of the farthest depth
// in ever larger squares of it, against which select then tests everybody. Twin: src/reference/occlude.rs
// In: the occluders' instance lists, depth; out: pyramid. Threads: one per block of the depth.

#ifndef REDUCE

#include "mesh.hlsli"
#include "instance.hlsli"

// Window extraction, collapse and skinning as for the picture.
float4 VSMain(uint vertex : SV_VertexID, InstanceAttributes attributes) : SV_Position
{
    Instance instance = InstanceFrom(attributes);
    PackedVertex v = LoadVertex(LivingAncestor(vertex, instance.live_vertex_count));
    return mul(frame.clip_from_world, float4(SkinVertex(v, instance).position, 1.0));
}

#else

#include "occlusion.hlsli"

[[vk::binding(0, 0)]] ConstantBuffer<FrameConstants> frame;
[[vk::binding(1, 0)]] Texture2D<float> depth;
[[vk::binding(2, 0)]] RWStructuredBuffer<float> pyramid;

float LoadDepth(int2 texel, int2 last, bool reversed)
{
    float d = depth.Load(int3(clamp(texel, int2(0, 0), last), 0));
    return reversed ? -d : d;
}

// Levels 0 to 3 over a block of 8 by 8 texels.
[numthreads(REDUCE_GROUP_SIZE, 1, 1)]
void CSReduce(uint3 thread : SV_DispatchThreadID)
{
    int2 last = int2(DepthSide(frame.width_px), DepthSide(frame.height_px)) - 1;
    bool reversed = (frame.flags & FLAG_REVERSED_DEPTH) != 0u;
    uint2 padded = uint2(PaddedSide(uint(last.x) + 1u), PaddedSide(uint(last.y) + 1u));
    uint area = padded.x * padded.y;
    uint start1 = LevelStart(area, 1u);
    uint start2 = LevelStart(area, 2u);
    uint start3 = LevelStart(area, 3u);
    uint blocks = padded.x / REDUCE_BLOCK;
    uint2 block = uint2(thread.x % blocks, thread.x / blocks);
    if (block.y >= padded.y / REDUCE_BLOCK)
    {
        return;
    }
    float4 above = 0.0; // the row of level 1 before
    float far3 = -1e30;
    for (uint pair = 0u; pair < 4u; pair++)
    {
        uint2 corner = block * REDUCE_BLOCK + uint2(0u, 2u * pair);
        float row[4];
        [unroll]
        for (uint i = 0u; i < 4u; i++)
        {
            uint2 texel = corner + uint2(2u * i, 0u);
            float4 four;
            four.x = LoadDepth(int2(texel), last, reversed);
            four.y = LoadDepth(int2(texel) + int2(1, 0), last, reversed);
            four.z = LoadDepth(int2(texel) + int2(0, 1), last, reversed);
            four.w = LoadDepth(int2(texel) + int2(1, 1), last, reversed);
            uint place = texel.y * padded.x + texel.x;
            pyramid[place] = four.x;
            pyramid[place + 1u] = four.y;
            pyramid[place + padded.x] = four.z;
            pyramid[place + padded.x + 1u] = four.w;
            row[i] = max(max(four.x, four.y), max(four.z, four.w));
            pyramid[start1 + (texel.y >> 1) * (padded.x >> 1) + (texel.x >> 1)] = row[i];
        }
        float4 here = float4(row[0], row[1], row[2], row[3]);
        if ((pair & 1u) != 0u)
        {
            float2 row2 = max(max(above.xz, above.yw), max(here.xz, here.yw));
            uint place2 = start2 + (corner.y >> 2) * (padded.x >> 2) + (corner.x >> 2);
            pyramid[place2] = row2.x;
            pyramid[place2 + 1u] = row2.y;
            far3 = max(far3, max(row2.x, row2.y));
        }
        above = here;
    }
    pyramid[start3 + block.y * (padded.x >> 3) + block.x] = far3;
}

// Levels 4 and 5, over 4 by 4 texels of level 3.
[numthreads(REDUCE_GROUP_SIZE, 1, 1)]
void CSReduceTop(uint3 thread : SV_DispatchThreadID)
{
    uint2 padded = uint2(PaddedSide(DepthSide(frame.width_px)), PaddedSide(DepthSide(frame.height_px)));
    uint area = padded.x * padded.y;
    uint start3 = LevelStart(area, 3u);
    uint start4 = LevelStart(area, 4u);
    uint start5 = LevelStart(area, 5u);
    uint2 sides = padded >> 5;
    uint2 texel = uint2(thread.x % sides.x, thread.x / sides.x);
    if (texel.y >= sides.y)
    {
        return;
    }
    float far5 = -1e30;
    for (uint i = 0u; i < 4u; i++)
    {
        uint2 child = 2u * texel + uint2(i & 1u, i >> 1);
        uint from = start3 + 2u * child.y * (padded.x >> 3) + 2u * child.x;
        float4 four = float4(pyramid[from], pyramid[from + 1u], pyramid[from + (padded.x >> 3)], pyramid[from + (padded.x >> 3) + 1u]);
        float far4 = max(max(four.x, four.y), max(four.z, four.w));
        pyramid[start4 + child.y * (padded.x >> 4) + child.x] = far4;
        far5 = max(far5, far4);
    }
    pyramid[start5 + texel.y * (padded.x >> 5) + texel.x] = far5;
}

#endif
