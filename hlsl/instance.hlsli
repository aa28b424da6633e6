// An entry of an instance list, as vertex attributes of instance rate. The host's side: instance_attributes in
// src/gpu/pipeline.rs.

#ifndef THRONG_INSTANCE
#define THRONG_INSTANCE

#include "gpu_types.hlsli"

struct InstanceAttributes
{
    [[vk::location(0)]] float4 position_cos : ATTRIBUTE0;
    [[vk::location(1)]] uint4 seed_live_packed_sin : ATTRIBUTE1;
    [[vk::location(2)]] uint4 sample_entries : ATTRIBUTE2;
    [[vk::location(3)]] float4 weights_shadow : ATTRIBUTE3;
};

Instance InstanceFrom(InstanceAttributes attributes)
{
    Instance instance;
    instance.position = attributes.position_cos.xyz;
    instance.heading_cos = attributes.position_cos.w;
    instance.tint_seed = attributes.seed_live_packed_sin.x;
    instance.live_vertex_count = attributes.seed_live_packed_sin.y;
    instance.packed = attributes.seed_live_packed_sin.z;
    instance.heading_sin = asfloat(attributes.seed_live_packed_sin.w);
    instance.sample_entries = attributes.sample_entries;
    instance.sample_weights = attributes.weights_shadow.xyz;
    instance.shadow_radius = attributes.weights_shadow.w;
    return instance;
}

#endif
