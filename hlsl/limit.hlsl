// limit: draws triangles and quads that were transformed before, for the least that their picture can cost. Compiled for each
// kind of mesh, and with IMPOSTOR for quads, with SOFT for one quad each, with RELIEF for those of them that have it. With
// TRANSFORM, CSTransform writes what the stage's vertex shader hands to its pixel shader, once; VSLimit hands it to the same pixel shader in every frame. VSFloor and PSFloor
// draw the same triangles in one colour.
// In: instance lists of the select stage; out: transformed[instance][vertex], LIMIT_ROWS each. Threads of CSTransform: one per
// vertex number along x, groups along y are instances.

#ifdef IMPOSTOR
#include "impostor.hlsl"
#if defined(SOFT) && !defined(RELIEF)
#define LIMIT_ROWS 8
#else
#define LIMIT_ROWS 9
#endif
#else
#include "mesh.hlsl"
#if defined(TEXTURED) && defined(DOUBLE_SIDED)
#define LIMIT_ROWS 4
#elif defined(TEXTURED) || defined(DOUBLE_SIDED)
#define LIMIT_ROWS 3
#else
#define LIMIT_ROWS 2
#endif
#endif

// Rows of a vertex as attributes, in the order in which CSTransform writes them.
struct TransformedVertex
{
    [[vk::location(0)]] float4 position : ATTRIBUTE0;
    [[vk::location(1)]] float4 row1 : ATTRIBUTE1;
#if LIMIT_ROWS > 2
    [[vk::location(2)]] float4 row2 : ATTRIBUTE2;
#endif
#if LIMIT_ROWS > 3
    [[vk::location(3)]] float4 row3 : ATTRIBUTE3;
#endif
#if LIMIT_ROWS > 4
    [[vk::location(4)]] float4 row4 : ATTRIBUTE4;
#endif
#if LIMIT_ROWS > 5
    [[vk::location(5)]] float4 row5 : ATTRIBUTE5;
    [[vk::location(6)]] float4 row6 : ATTRIBUTE6;
    [[vk::location(7)]] float4 row7 : ATTRIBUTE7;
#endif
#if LIMIT_ROWS > 8
    [[vk::location(8)]] float4 row8 : ATTRIBUTE8;
#endif
};

#ifdef TRANSFORM
[[vk::binding(1, 0)]] StructuredBuffer<Instance> instances;
[[vk::binding(0, 3)]] RWStructuredBuffer<float4> transformed;

#ifndef IMPOSTOR
InstanceAttributes AttributesOf(Instance instance)
{
    InstanceAttributes attributes;
    attributes.position_cos = float4(instance.position, instance.heading_cos);
    attributes.seed_live_packed_sin =
        uint4(instance.tint_seed, instance.live_vertex_count, instance.packed, asuint(instance.heading_sin));
    attributes.sample_entries = instance.sample_entries;
    attributes.weights = float4(instance.sample_weights, 0.0);
    return attributes;
}
#endif

[numthreads(SELECT_GROUP_SIZE, 1, 1)]
void CSTransform(uint3 thread : SV_DispatchThreadID)
{
    if (thread.x >= draw.probe_vertex_count)
    {
        return;
    }
    Instance instance = instances[draw.probe_instance + thread.y];
#ifdef IMPOSTOR
    Interpolants i = CornerOf(instance, thread.x >> 2, thread.x & 3u);
#else
    Interpolants i = VSMain(thread.x, AttributesOf(instance));
#endif
    uint row = (draw.probe_output + thread.y * draw.probe_vertex_count + thread.x) * LIMIT_ROWS;
    transformed[row] = i.position;
#ifdef IMPOSTOR
    transformed[row + 1u] = i.uv_height_depth;
    transformed[row + 2u] = i.sun_shift;
    transformed[row + 3u] = i.up_shift;
    transformed[row + 4u] = i.tint_share;
    transformed[row + 5u] = i.sunlight_haze;
    transformed[row + 6u] = i.skylight_haze;
    transformed[row + 7u] = i.groundlight_haze;
#if defined(RELIEF)
    transformed[row + 8u] = i.bounds;
#elif !defined(SOFT)
    transformed[row + 8u] = i.depth_step_corner;
#endif
#else
    transformed[row + 1u] = i.color;
#ifdef TEXTURED
    transformed[row + 2u] = i.uv_layer;
#endif
#ifdef DOUBLE_SIDED
    transformed[row + LIMIT_ROWS - 1u] = float4(i.color_back, 0.0);
#endif
#endif
}

#endif

Interpolants VSLimit(TransformedVertex v)
{
    Interpolants o;
    o.position = v.position;
#ifdef IMPOSTOR
    o.uv_height_depth = v.row1;
    o.sun_shift = v.row2;
    o.up_shift = v.row3;
    o.tint_share = v.row4;
    o.sunlight_haze = v.row5;
    o.skylight_haze = v.row6;
    o.groundlight_haze = v.row7;
#if defined(RELIEF)
    o.bounds = v.row8;
#elif !defined(SOFT)
    o.plane_zw = v.position.zw;
    o.depth_step_corner = v.row8;
#endif
#else
    o.color = v.row1;
#ifdef TEXTURED
    o.uv_layer = v.row2;
    o.haze_square = frame.haze_square;
#endif
#if defined(TEXTURED) && defined(DOUBLE_SIDED)
    o.color_back = v.row3.xyz;
#elif defined(DOUBLE_SIDED)
    o.color_back = v.row2.xyz;
#endif
#endif
    return o;
}

float4 VSFloor([[vk::location(0)]] float4 position : ATTRIBUTE0) : SV_Position
{
    return position;
}

float4 PSFloor() : SV_Target
{
    return float4(0.5, 0.5, 0.5, 1.0);
}
