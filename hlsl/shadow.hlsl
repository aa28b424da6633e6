// shadow: a soft dark spot on the ground under every agent that stands on it, as one instanced quad draw over all instance
// lists. It fades with distance, by metres and not by pixels, so that pictures of any size agree.

#include "instance.hlsli"

[[vk::binding(0, 0)]] ConstantBuffer<FrameConstants> frame;
[[vk::constant_id(1)]] const bool SRGB_TARGET = false;

// Light that the middle of a shadow takes.
static const float STRENGTH = 0.5;
// Metres above the ground, so that the two do not fight for depth.
static const float LIFT = 0.01;
// Distance in radii at which a shadow begins to fade; at twice that it is gone.
static const float FADE_RADII = 110.0;

struct Interpolants
{
    float4 position : SV_Position;
    float3 offset_strength : TEXCOORD0; // from the centre in radii; strength
};

Interpolants VSMain(uint vertex : SV_VertexID, InstanceAttributes attributes)
{
    Instance instance = InstanceFrom(attributes);
    float2 corner = float2(vertex & 1u, vertex >> 1) * 2.0 - 1.0;
    float radius = instance.shadow_radius;
    float distance = length(instance.position - frame.eye);
    float fade = saturate(2.0 - distance / max(radius * FADE_RADII, 1e-6));
    // Whoever floats or flies casts less of it.
    fade *= saturate(1.0 - abs(instance.position.y) / max(radius, 1e-6));
    Interpolants o;
    o.offset_strength = float3(corner, fade * STRENGTH);
    float2 ground = instance.position.xz + corner * (fade > 0.0 ? radius : 0.0);
    o.position = mul(frame.clip_from_world, float4(ground.x, LIFT, ground.y, 1.0));
    return o;
}

// The target's colour is multiplied by one minus alpha.
float4 PSMain(Interpolants i) : SV_Target
{
    float spot = saturate(1.0 - dot(i.offset_strength.xy, i.offset_strength.xy));
    float left = 1.0 - i.offset_strength.z * spot * spot;
    // What the factor is on sRGB-encoded colour, it is to the power 2.2 on linear colour.
    if (SRGB_TARGET)
    {
        left *= left;
    }
    return float4(0.0, 0.0, 0.0, 1.0 - left);
}
