// The palette: joints in the frames that an instance blends, which meshes and impostors share.

#ifndef THRONG_PALETTE
#define THRONG_PALETTE

#include "gpu_types.hlsli"

[[vk::binding(3, 1)]] Texture2D<float4> palette_texture; // 3 texels per joint and frame

// Adds `weight` times the rows of a joint's model_from_bind in an instance's frames.
void AddJoint(Instance instance, uint joint, float weight, inout float4 row0, inout float4 row1, inout float4 row2)
{
    uint sample_count = (instance.packed >> 3) & 7u;
    for (uint s = 0u; s < sample_count; s++)
    {
        uint entry = (s == 0u ? instance.sample_entries.x : s == 1u ? instance.sample_entries.y
            : s == 2u ? instance.sample_entries.z : instance.sample_entries.w) + joint;
        float share = weight * (s == 0u ? instance.sample_weights.x : s == 1u ? instance.sample_weights.y
            : s == 2u ? instance.sample_weights.z : 1.0 - instance.sample_weights.x - instance.sample_weights.y - instance.sample_weights.z);
        int x = int(entry % PALETTE_ROW_ENTRIES) * 3;
        int y = int(entry / PALETTE_ROW_ENTRIES);
        row0 += share * palette_texture.Load(int3(x, y, 0));
        row1 += share * palette_texture.Load(int3(x + 1, y, 0));
        row2 += share * palette_texture.Load(int3(x + 2, y, 0));
    }
}

#endif
