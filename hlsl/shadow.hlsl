// shadow: a soft dark spot on the ground under every agent that stands on it, as one instanced quad draw over the list that the
// select stage makes of them. It fades with distance, by metres and not by pixels, so that pictures of any size agree. A pixel draws the ground
// anew with less light, and the target keeps the darker of what it has and gets: where spots overlap the darkest counts, so
// that the picture does not depend on the order of the lists.

#include "ground.hlsli"

// Share of its sRGB-encoded colour that the middle of a shadow takes from the ground.
static const float STRENGTH = 0.5;
// Less than this cannot be seen, and would only show that this pixel's ground is not to the last bit the one beneath.
static const float STRENGTH_MIN = 0.01;

struct Interpolants
{
    float4 position : SV_Position;
    float3 offset_strength : TEXCOORD0; // from the centre in radii; strength
    float2 offset : TEXCOORD1; // of the ground beneath from the camera's foot point, metres
    GroundConstants constants;
};

// Place and radius, metres.
Interpolants VSMain(uint vertex : SV_VertexID, [[vk::location(0)]] float4 place_radius : ATTRIBUTE0)
{
    float3 place = place_radius.xyz;
    float radius = place_radius.w;
    float2 corner = float2(vertex & 1u, vertex >> 1) * 2.0 - 1.0;
    float distance = length(place - frame.eye);
    float fade = saturate(2.0 - distance / max(radius * SHADOW_FADE_RADII, 1e-6));
    Interpolants o;
    o.offset_strength = float3(corner, fade * STRENGTH);
    float2 offset = place.xz - frame.eye.xz + corner * radius;
    o.position = mul(frame.clip_from_world, float4(frame.eye.x + offset.x, SHADOW_LIFT, frame.eye.z + offset.y, 1.0));
    // Of the ground, what the pixel has beneath it, seen from the camera.
    o.offset = offset * (frame.eye.y > 2.0 * SHADOW_LIFT ? frame.eye.y / (frame.eye.y - SHADOW_LIFT) : 1.0);
    o.constants = ConstantsOfGround();
    return o;
}

// The target keeps the smaller of this and what it has.
float4 PSMain(Interpolants i) : SV_Target
{
    float3 ground = GroundColor(i.constants, i.offset);
    float spot = saturate(1.0 - dot(i.offset_strength.xy, i.offset_strength.xy));
    float strength = i.offset_strength.z * spot * spot;
    if (strength < STRENGTH_MIN)
    {
        discard;
    }
    float left = 1.0 - strength;
    // What the factor is on sRGB-encoded colour, it is to the power 2.2 on linear colour.
    return SRGB_TARGET ? float4(saturate(ground * left * left), 1.0) : float4(SrgbFromLinear(ground) * left, 1.0);
}
