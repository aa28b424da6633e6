// ground: the plane y = 0 out to the horizon, paved, as a square around the camera and rings around that, each a fixed
// number of times as wide as the one within: drivers interpolate place and depth over triangles near the camera's size
// well, and over a single huge one badly (SwiftShader: by half a slab).
// The paving is filtered over each pixel's footprint, so that it fades instead of flickering.

#include "gpu_types.hlsli"
#include "color.hlsli"

[[vk::binding(0, 0)]] ConstantBuffer<FrameConstants> frame;
[[vk::constant_id(1)]] const bool SRGB_TARGET = false;

// Half the side of the innermost square in metres, and how often each ring doubles it; haze covers the edge of the last.
static const float FIRST_HALF_SIDE = 1.25;
static const uint RING_DOUBLINGS = 2u;
// Metres of a slab, and the share of it that is joint.
static const float SLAB = 1.2;
static const float JOINT = 0.03;

struct Interpolants
{
    float4 position : SV_Position;
    float2 offset : TEXCOORD0; // from the camera's foot point, metres: small numbers stay exact
};

Interpolants VSMain(uint vertex : SV_VertexID)
{
    // Two triangles each: the square, then four trapezoids of every ring.
    static const uint CORNERS[6] = { 0u, 1u, 2u, 2u, 1u, 3u };
    uint piece = vertex / 6u;
    uint corner = CORNERS[vertex % 6u];
    float2 place = float2(corner & 1u, corner >> 1) * 2.0 - 1.0;
    float half_side = FIRST_HALF_SIDE;
    if (piece > 0u)
    {
        // A trapezoid from the side y = -1 of the inner square to that of the outer one, turned by quarters.
        uint side = (piece - 1u) % 4u;
        half_side *= float(1u << (RING_DOUBLINGS * ((piece - 1u) / 4u + (corner >> 1))));
        place.y = -1.0;
        place = side == 0u ? place : side == 1u ? float2(-place.y, place.x) : side == 2u ? -place : float2(place.y, -place.x);
    }
    Interpolants o;
    o.offset = place * half_side;
    o.position = mul(frame.clip_from_world, float4(frame.eye.x + o.offset.x, 0.0, frame.eye.z + o.offset.y, 1.0));
    return o;
}

// Share of a pixel's footprint that is joint, by axis.
float2 JointShare(float2 p, float2 width)
{
    float2 a = p + 0.5 * width;
    float2 b = p - 0.5 * width;
    return saturate((floor(a) + min(frac(a) / JOINT, 1.0) - floor(b) - min(frac(b) / JOINT, 1.0)) * JOINT / width);
}

float4 PSMain(Interpolants i) : SV_Target
{
    float2 p = (frame.eye.xz + i.offset) / SLAB;
    float2 width = max(abs(ddx(i.offset)) + abs(ddy(i.offset)), 1e-4) / SLAB;
    float2 joint_share = JointShare(p, width);
    float joint = 1.0 - (1.0 - joint_share.x) * (1.0 - joint_share.y);

    // Every slab has its own lightness, as long as a pixel is smaller than a slab.
    int2 slab = int2(floor(p));
    uint hash = uint(slab.x) * 0x9e3779b9u ^ uint(slab.y) * 0x85ebca6bu;
    hash = (hash ^ (hash >> 15)) * 0x2c1b3c6du;
    float lightness = float((hash >> 8) & 0xffu) * (1.0 / 255.0) - 0.5;
    float near_share = saturate(1.5 - 2.0 * max(width.x, width.y));
    float3 albedo = float3(0.40, 0.385, 0.36) * (1.0 + 0.16 * lightness * near_share) * (1.0 - 0.4 * joint);

    float3 light = frame.sun * saturate(frame.to_sun.y) + frame.sky;
    float distance = sqrt(dot(i.offset, i.offset) + frame.eye.y * frame.eye.y);
    float haze = HazeShare(distance, frame.haze_per_metre);
    // The horizon itself is all haze.
    haze = lerp(haze, 1.0, saturate(distance * (1.0 / 4000.0)));
    float3 color = lerp(albedo * light, frame.haze, haze);
    return float4(SRGB_TARGET ? saturate(color) : SrgbFromLinear(color), 1.0);
}
