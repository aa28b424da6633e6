// The frames of the palette that an instance blends, which meshes and impostors share.

#ifndef THRONG_PALETTE
#define THRONG_PALETTE

#include "gpu_types.hlsli"

uint SampleCount(Instance instance)
{
    return (instance.packed >> 3) & 7u;
}

// Palette entry of the first joint in a frame.
uint SampleEntry(Instance instance, uint s)
{
    return s == 0u ? instance.sample_entries.x : s == 1u ? instance.sample_entries.y
        : s == 2u ? instance.sample_entries.z : instance.sample_entries.w;
}

float SampleWeight(Instance instance, uint s)
{
    return s == 0u ? instance.sample_weights.x : s == 1u ? instance.sample_weights.y
        : s == 2u ? instance.sample_weights.z : 1.0 - instance.sample_weights.x - instance.sample_weights.y - instance.sample_weights.z;
}

#endif
