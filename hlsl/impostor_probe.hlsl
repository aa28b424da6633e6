// impostor_probe: the impostor stage's vertex work for one entry of an instance list, written to a buffer instead of drawn, so
// that tests can compare it with the twin. Twin: src/reference/impostor.rs. Threads: one per vertex number.

#include "impostor.hlsli"

[[vk::binding(1, 0)]] StructuredBuffer<Instance> instances;
[[vk::binding(0, 3)]] RWStructuredBuffer<float4> probed; // corner and mip, towards and depth extent, uv, depth and atlas, shift and sharpness; 4 per vertex

[numthreads(SELECT_GROUP_SIZE, 1, 1)]
void CSMain(uint3 thread : SV_DispatchThreadID)
{
    if (thread.x >= draw.probe_vertex_count)
    {
        return;
    }
    Instance instance = instances[draw.probe_instance];
    uint vertex = draw.first_vertex + thread.x;
    Placed placed = PlaceQuad(instance, vertex >> 2, vertex & 3u, QuadRandom(instance, vertex >> 2));
    probed[4u * thread.x] = float4(placed.corner, placed.mip);
    probed[4u * thread.x + 1u] = float4(placed.towards, placed.depth_extent);
    probed[4u * thread.x + 2u] = float4(placed.uv, placed.depth, placed.atlas);
    probed[4u * thread.x + 3u] = float4(placed.shift, placed.sharpness, 0.0);
}
