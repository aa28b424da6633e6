// impostor: draws every quad of an impostor kind of every agent that shows it; a sub-draw per kind. Twin: src/reference/impostor.rs
// In: instance lists of the select stage; live_vertex_count is pose and fade.
// Vertex numbers: 4 per quad.

#include "impostor.hlsli"
#include "color.hlsli"
#include "instance.hlsli"

[[vk::binding(5, 1)]] SamplerState atlas_sampler;
[[vk::binding(9, 1)]] Texture2D<float4> color_texture; // sRGB-encoded colour, coverage
[[vk::binding(10, 1)]] Texture2D<float4> surface_texture; // normal, body part and tint rule, depth

[[vk::constant_id(1)]] const bool SRGB_TARGET = false;

// Coverage below which an edge pixel is not drawn: it would hide what stands behind.
static const float SOFT_EDGE = 0.2;

struct Interpolants
{
    float4 position : SV_Position;
    float4 uv_depth : TEXCOORD0; // atlas; clip-space z and w
    float2 height_depth : TEXCOORD1; // metres above the agent's ground; plane before the quad's centre, in its extents
    nointerpolation float4 sun_mip : TEXCOORD2; // towards the sun in the picture's axes; mip
    nointerpolation float4 up_haze : TEXCOORD3; // world +Y in the picture's axes; haze's share
    nointerpolation uint4 depth_fade_tint : TEXCOORD4; // floats z and w of a step from the centre to the near end of the depths; pose and fade; tint
};

Interpolants VSMain(uint vertex : SV_VertexID, InstanceAttributes attributes)
{
    Instance instance = InstanceFrom(attributes);
    uint quad = vertex >> 2;
    Placed placed = PlaceQuad(instance, quad, vertex & 3u, QuadRandom(instance, quad));

    Interpolants o;
    o.position = mul(frame.clip_from_world, float4(placed.corner, 1.0));
    o.uv_depth = float4(placed.uv, o.position.zw);
    o.height_depth = float2(placed.corner.y - instance.position.y, placed.depth / placed.depth_extent);
    float3 sun = frame.to_sun;
    o.sun_mip = float4(dot(placed.right, sun), dot(placed.up, sun), dot(placed.towards, sun), placed.mip);
    float haze = HazeShare(length(frame.eye - instance.position), frame.haze_per_metre);
    o.up_haze = float4(placed.right.y, placed.up.y, placed.towards.y, haze);
    float2 step = mul(frame.clip_from_world, float4(placed.towards * placed.depth_extent, 0.0)).zw;
    o.depth_fade_tint = uint4(asuint(step.x), asuint(step.y), instance.live_vertex_count, Hash(instance.tint_seed));
    return o;
}

// A threshold in (0, 1) by pixel: an ordered 4x4 pattern.
float DitherThreshold(float2 pixel)
{
    uint2 p = uint2(pixel);
    uint x = p.x ^ p.y;
    uint index = ((x & 1u) << 3) | ((p.y & 1u) << 2) | (x & 2u) | ((p.y & 2u) >> 1);
    return (float(index) + 0.5) * (1.0 / 16.0);
}

// Squares and roots stand in for the sRGB curve, which a colour that is not lit survives unchanged; this bends light so that
// a lit one comes out as it would by the curve, within 0.015.
float3 BentLight(float3 light)
{
    return light * (1.1 - 0.1 * light);
}

#ifdef SOFT
float4 PSMain(Interpolants i) : SV_Target
#else
float4 PSMain(Interpolants i, out float depth : SV_Depth) : SV_Target
#endif
{
    float4 color = color_texture.SampleLevel(atlas_sampler, i.uv_depth.xy, i.sun_mip.w);
    // A fade draws a share of the pixels, or all but that share.
    uint bits = i.depth_fade_tint.z;
    float fade = float((bits >> IMPOSTOR_FADE_SHIFT) & 0xffu) * (1.0 / 255.0);
    bool shown = (DitherThreshold(i.position.xy) < fade) != ((bits & IMPOSTOR_FADES_OUT) != 0u);
    // One quad blends its edges, and its plane is depth enough. Quads of joints overlap: blended, they would let the ground
    // shine through where they meet, and they hide each other by the depth of every pixel.
#ifdef SOFT
    if (color.a < SOFT_EDGE || !shown)
#else
    if (color.a < 0.5 || !shown)
#endif
    {
        discard;
    }
    float4 surface = surface_texture.SampleLevel(nearest_sampler, i.uv_depth.xy, i.sun_mip.w);
    float2 xy = (surface.xy * 255.0 - 128.0) * (1.0 / 127.0);
    float3 normal = float3(xy, sqrt(saturate(1.0 - dot(xy, xy))));
    uint part = uint(surface.z * 255.0 + 0.5);
    float3 albedo = TintedColor(color.rgb * color.rgb, i.depth_fade_tint.w, part & 63u, part >> 6);
    float3 light = LightOn(dot(normal, i.sun_mip.xyz), dot(normal, i.up_haze.xyz), normal.z, Openness(i.height_depth.x));
    float3 encoded = sqrt(saturate(lerp(albedo * BentLight(light), BentLight(frame.haze), i.up_haze.w)));
    float3 lit = SRGB_TARGET ? LinearFromSrgb(encoded) : encoded;
#ifdef SOFT
    return float4(lit * color.a, color.a);
#else
    float2 zw = i.uv_depth.zw + asfloat(i.depth_fade_tint.xy) * (surface.w * 2.0 - 1.0 - i.height_depth.y);
    depth = saturate(zw.x / max(zw.y, 1e-6));
    return float4(lit, 1.0);
#endif
}
