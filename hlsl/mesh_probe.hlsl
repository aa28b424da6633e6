// mesh_probe: the mesh stage's vertex work for one entry of an instance list, written to a buffer instead of drawn, so that
// tests can compare it with the twin. Twin: src/reference/mesh.rs. Threads: one per vertex number.

#include "mesh.hlsli"
#include "tint.hlsli"

[[vk::binding(1, 0)]] StructuredBuffer<Instance> instances;
[[vk::binding(0, 3)]] RWStructuredBuffer<float4> probed; // position, normal, colour before light and texture; 3 per vertex

[numthreads(SELECT_GROUP_SIZE, 1, 1)]
void CSMain(uint3 thread : SV_DispatchThreadID)
{
    if (thread.x >= draw.probe_vertex_count)
    {
        return;
    }
    Instance instance = instances[draw.probe_instance];
    PackedVertex v = LoadVertex(LivingAncestor(thread.x, instance.live_vertex_count));
    Skinned skinned = SkinVertex(v, instance);
    probed[3u * thread.x] = float4(skinned.position, 1.0);
    probed[3u * thread.x + 1u] = float4(skinned.normal, 0.0);
    probed[3u * thread.x + 2u] = float4(TintedColor(DecodeColor(v).rgb, float(v.tail.w), instance.tint_seed), 0.0);
}
