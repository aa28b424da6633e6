// sky: a gradient by elevation behind everything, as one triangle at the far end of the depth range.

#include "gpu_types.hlsli"
#include "color.hlsli"

[[vk::binding(0, 0)]] ConstantBuffer<FrameConstants> frame;
[[vk::constant_id(1)]] const bool SRGB_TARGET = false;
[[vk::constant_id(2)]] const bool REVERSED_DEPTH = true;

struct Interpolants
{
    float4 position : SV_Position;
    float3 direction : TEXCOORD0; // world, any length
    // Pixels get all constants so: lavapipe looks up those of a buffer lane by lane in pixel shaders.
    nointerpolation float3 zenith : TEXCOORD1; // linear colours
    nointerpolation float3 horizon : TEXCOORD2;
};

Interpolants VSMain(uint vertex : SV_VertexID)
{
    float2 corner = float2((vertex << 1) & 2u, vertex & 2u) * 2.0 - 1.0;
    float depth = 1.0;
    if (REVERSED_DEPTH)
    {
        depth = 0.0;
    }
    Interpolants o;
    o.position = float4(corner, depth, 1.0);
    // A point between near and far in the same column of clip space, seen from the eye.
    float4 world = mul(frame.world_from_clip, float4(corner, 0.5, 1.0));
    o.direction = world.xyz / world.w - frame.eye;
    o.zenith = frame.sky * float3(0.45, 0.75, 1.15);
    o.horizon = frame.haze;
    return o;
}

float4 PSMain(Interpolants i) : SV_Target
{
    float elevation = saturate(i.direction.y * rsqrt(dot(i.direction, i.direction)));
    float share = 1.0 - elevation;
    share *= share;
    share *= share;
    float3 color = lerp(i.zenith, i.horizon, share);
    return float4(SRGB_TARGET ? saturate(color) : SrgbFromLinear(color), 1.0);
}
