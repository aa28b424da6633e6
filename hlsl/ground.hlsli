// The look of the paved ground, which the ground stage draws and the shadow stage darkens.

#ifndef THRONG_GROUND
#define THRONG_GROUND

#include "gpu_types.hlsli"
#include "color.hlsli"

[[vk::binding(0, 0)]] ConstantBuffer<FrameConstants> frame;
[[vk::constant_id(1)]] const bool SRGB_TARGET = false;

// Metres of a slab, and the share of it that is joint.
static const float SLAB = 1.2;
static const float SLABS_PER_METRE = 1.0 / SLAB;
static const float JOINT = 0.03;

// What pixels of the ground get from the vertex shader: lavapipe looks up constants of a buffer lane by lane in pixel shaders.
struct GroundConstants
{
    nointerpolation float4 light_x : TEXCOORD8; // linear colour of the light on the ground; the eye's x
    nointerpolation float4 haze_z : TEXCOORD9; // linear colour of the haze; the eye's z
    nointerpolation float4 plain : TEXCOORD10; // reflectance, where the last is 1; 0: paved
    nointerpolation float2 eye_haze : TEXCOORD11; // square of the eye's height; haze per metre
};

GroundConstants ConstantsOfGround()
{
    uint plain = frame.ground_color;
    float3 root = float3(plain & 0xffu, (plain >> 8) & 0xffu, (plain >> 16) & 0xffu) * (1.0 / 255.0);
    GroundConstants o;
    o.light_x = float4(frame.sun * saturate(frame.to_sun.y) + frame.sky, frame.eye.x);
    o.haze_z = float4(frame.haze, frame.eye.z);
    o.plain = float4(root * root, (plain & GROUND_PLAIN) != 0u ? 1.0 : 0.0);
    o.eye_haze = float2(frame.eye.y * frame.eye.y, frame.haze_per_metre);
    return o;
}

// Share of a pixel's footprint that is joint, by axis.
float2 JointShare(float2 p, float2 width)
{
    float2 a = p + 0.5 * width;
    float2 b = p - 0.5 * width;
    float2 joints = floor(a) - floor(b) + saturate(frac(a) * (1.0 / JOINT)) - saturate(frac(b) * (1.0 / JOINT));
    return saturate(joints * (JOINT / width));
}

// Reflectance of the paving at an offset from the camera's foot point `eye`, metres. Takes derivatives.
float3 PavingColor(float2 eye, float2 offset)
{
    float2 p = (eye + offset) * SLABS_PER_METRE;
    float2 width = max(abs(ddx(offset)) + abs(ddy(offset)), 1e-4) * SLABS_PER_METRE;
    float2 joint_share = JointShare(p, width);
    float joint = 1.0 - (1.0 - joint_share.x) * (1.0 - joint_share.y);

    // Every slab has its own lightness, as long as a pixel is smaller than a slab.
    int2 slab = int2(floor(p));
    uint hash = uint(slab.x) * 0x9e3779b9u ^ uint(slab.y) * 0x85ebca6bu;
    hash = (hash ^ (hash >> 15)) * 0x2c1b3c6du;
    float lightness = float((hash >> 8) & 0xffu) * (1.0 / 255.0) - 0.5;
    float near_share = saturate(1.5 - 2.0 * max(width.x, width.y));
    return float3(0.40, 0.385, 0.36) * (1.0 + 0.16 * lightness * near_share) * (1.0 - 0.4 * joint);
}

// Linear colour of the ground at an offset from the camera's foot point, metres. For pixel shaders.
float3 GroundColor(GroundConstants constants, float2 offset)
{
    float3 paving = PavingColor(float2(constants.light_x.w, constants.haze_z.w), offset);
    float3 albedo = constants.plain.w > 0.5 ? constants.plain.rgb : paving;
    float distance = sqrt(dot(offset, offset) + constants.eye_haze.x);
    float haze = HazeShare(distance, constants.eye_haze.y);
    // The horizon itself is all haze.
    haze = lerp(haze, 1.0, saturate(distance * (1.0 / 4000.0)));
    return lerp(albedo * constants.light_x.rgb, constants.haze_z.rgb, haze);
}

// What a target holds of a linear colour.
float4 TargetColor(float3 color)
{
    return float4(SRGB_TARGET ? saturate(color) : SrgbFromLinear(color), 1.0);
}

#endif
