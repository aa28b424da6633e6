// mesh: draws one submesh of every visible agent; a sub-draw per band. Twin: src/reference/mesh.rs
// In: instance lists of the select stage, a character's arrays and textures. Compiled with and without TEXTURED, DOUBLE_SIDED and PACKED,
// because lavapipe pays for interpolants that a specialisation constant leaves unused. One vertex shader run does window extraction,
// collapse, skinning and light; pixels interpolate sRGB-encoded colour, which costs a CPU driver the least.

#include "mesh.hlsli"
#include "color.hlsli"
#ifdef PACKED
#define READS_LISTS
#endif
#include "instance.hlsli"
#include "light.hlsli"
#include "tint.hlsli"

#ifdef TEXTURED
[[vk::binding(4, 1)]] Texture2DArray<float4> albedo_texture; // sRGB-encoded colour, linear alpha
[[vk::binding(5, 1)]] SamplerState albedo_sampler;
#endif

[[vk::constant_id(0)]] const bool ALPHA_TESTED = false;
[[vk::constant_id(1)]] const bool SRGB_TARGET = false; // the format encodes, so pixels decode

struct Interpolants
{
    float4 position : SV_Position;
    float4 color : COLOR0; // sRGB-encoded lit colour, linear alpha
#ifdef TEXTURED
    float4 uv_layer : TEXCOORD0; // w: share of light that haze lets through
    nointerpolation float3 haze_square : TEXCOORD1; // of its encoded colour
#endif
#ifdef DOUBLE_SIDED
    float3 color_back : COLOR1; // lit from the other side
#endif
};

Interpolants VertexOf(uint vertex, Instance instance)
{
    PackedVertex v = LoadVertex(LivingAncestor(vertex, instance.live_vertex_count));
    Skinned skinned = SkinVertex(v, instance);

    float4 color = DecodeColor(v);
    color.rgb = TintedColor(color.rgb, float(v.tail.w), instance.tint_seed);

    float3 to_eye = frame.eye - skinned.position;
    float distance = length(to_eye);
    to_eye /= max(distance, 1e-6);
    float openness = Openness(skinned.position.y - instance.position.y);
    float3 cosines = float3(dot(skinned.normal, frame.to_sun), skinned.normal.y, dot(skinned.normal, to_eye));
    float haze = HazeShare(distance, frame.haze_per_metre);

#ifdef TEXTURED
    // Haze is in front of the texture, so pixels add it.
    float clear = 1.0 - haze;
    haze = 0.0;
#endif
    Interpolants o;
    o.position = mul(frame.clip_from_world, float4(skinned.position, 1.0));
    Light light = { frame.sun, frame.sky, frame.ground };
    float3 front = lerp(color.rgb * LightOn(light, cosines.x, cosines.y, cosines.z, openness), frame.haze, haze);
    o.color = float4(SrgbFromLinear(front), color.a);
#ifdef DOUBLE_SIDED
    float3 back = lerp(color.rgb * LightOn(light, -cosines.x, -cosines.y, -cosines.z, openness), frame.haze, haze);
    o.color_back = SrgbFromLinear(back);
#endif
#ifdef TEXTURED
    float2 uv = float2(v.head.w & 0xffffu, v.head.w >> 16) * (1.0 / 65535.0);
    o.uv_layer = float4(character.uv_min + character.uv_extent * uv, float((v.head.y >> 16) & 0xffu), clear);
    o.haze_square = frame.haze_square;
#endif
    return o;
}

#ifdef PACKED
// Many agents to an instance. Its number includes firstInstance, which is 0: vertex numbers begin where the list does.
Interpolants VSMain(uint vertex : SV_VertexID, uint instance : SV_InstanceID)
{
    return VertexOf(vertex % PACKED_VERTICES, LoadInstance(vertex / PACKED_VERTICES + AGENTS_PER_INSTANCE * instance));
}
#else
Interpolants VSMain(uint vertex : SV_VertexID, InstanceAttributes attributes)
{
    return VertexOf(vertex, InstanceFrom(attributes));
}
#endif

#ifdef DOUBLE_SIDED
float4 PSMain(Interpolants i, bool front_face : SV_IsFrontFace) : SV_Target
#else
float4 PSMain(Interpolants i) : SV_Target
#endif
{
    float4 color = i.color;
#ifdef DOUBLE_SIDED
    color.rgb = front_face ? color.rgb : i.color_back;
#endif
#ifdef TEXTURED
    color *= albedo_texture.Sample(albedo_sampler, i.uv_layer.xyz);
    // Light mixes linearly, as it does for vertices without a texture: squares are near enough to linear colour.
    color.rgb = sqrt(lerp(i.haze_square, color.rgb * color.rgb, i.uv_layer.w));
#endif
    if (ALPHA_TESTED)
    {
        if (color.a < draw.alpha_cutoff)
        {
            discard;
        }
    }
    if (SRGB_TARGET)
    {
        color.rgb = LinearFromSrgb(color.rgb);
    }
    return float4(color.rgb, 1.0);
}
