// impostor: draws every quad of an impostor kind of every agent that shows it. Twin: src/reference/impostor.rs
// In: instance lists of the select stage; live_vertex_count is pose and fade.
// Vertex numbers: 4 per quad.

#include "impostor.hlsli"
#include "color.hlsli"
#include "instance.hlsli"

[[vk::binding(2, 2)]] Texture2D<float4> color_texture; // square roots of linear colour, coverage
[[vk::binding(3, 2)]] Texture2D<float4> surface_texture; // normal, body part and tint rule, depth
[[vk::binding(5, 2)]] SamplerState color_sampler; // both take texels as coordinates: the pictures have no mips
[[vk::binding(6, 2)]] SamplerState surface_sampler;

[[vk::constant_id(1)]] const bool SRGB_TARGET = false;

// Coverage below which an edge pixel is not drawn: it would hide what stands behind.
static const float SOFT_EDGE = 0.2;
// Encoded lightness of what usually stands behind an edge.
static const float BEHIND = 0.7;
// Coverage from which a pixel of a joint's quad hides what is behind it.
static const float CORE = 0.75;
// How far behind the quad its rim stands, in depth extents.
static const float RIM_BEHIND = 2.0;

struct Interpolants
{
    float4 position : SV_Position;
    float3 uv_height : TEXCOORD0; // texels of the gallery; metres above the agent's ground
    nointerpolation float3 sun : TEXCOORD1; // towards it in the picture's axes
    nointerpolation float4 up_haze : TEXCOORD2; // world +Y in the picture's axes; haze's share
    nointerpolation float4 tint_share : TEXCOORD3; // of the agent; of a soft picture that is shown
#if defined(RELIEF)
    float depth : TEXCOORD4; // of the plane before the quad's centre, in its extents
    nointerpolation float4 bounds : TEXCOORD5; // of the picture in the gallery
    nointerpolation float2 shift : TEXCOORD6; // in the gallery by a depth extent before the plane
#elif !defined(SOFT)
    float3 depths : TEXCOORD4; // clip-space z and w; plane before the quad's centre, in its extents
    nointerpolation float2 depth_step : TEXCOORD5; // clip-space z and w of a step from the centre to the near end of the depths
    nointerpolation uint pose_fade : TEXCOORD6;
#endif
};

Interpolants VSMain(uint vertex : SV_VertexID, InstanceAttributes attributes)
{
    Instance instance = InstanceFrom(attributes);
    uint quad = vertex >> 2;
    Placed placed = PlaceQuad(instance, quad, vertex & 3u, QuadRandom(instance, quad));

    Interpolants o;
    o.position = mul(frame.clip_from_world, float4(placed.corner, 1.0));
    float3 in_gallery = GalleryFrom(placed.atlas, placed.mip);
    o.uv_height = float3(placed.uv * in_gallery.x + in_gallery.yz, placed.corner.y - instance.position.y);
    float3 sun = frame.to_sun;
    o.sun = float3(dot(placed.right, sun), dot(placed.up, sun), dot(placed.towards, sun));
    float haze = HazeShare(length(frame.eye - instance.position), frame.haze_per_metre);
    o.up_haze = float4(placed.right.y, placed.up.y, placed.towards.y, haze);
    float share = float((instance.live_vertex_count >> IMPOSTOR_FADE_SHIFT) & 0xffu) * (1.0 / 255.0);
    share = (instance.live_vertex_count & IMPOSTOR_FADES_OUT) != 0u ? 1.0 - share : share;
    o.tint_share = float4(TintRandom(instance.tint_seed), share);
#if defined(RELIEF)
    o.depth = placed.depth / placed.depth_extent;
    o.bounds = placed.bounds * in_gallery.x + in_gallery.yzyz;
    o.shift = placed.shift * in_gallery.x;
#elif !defined(SOFT)
    o.depths = float3(o.position.zw, placed.depth / placed.depth_extent);
    o.depth_step = mul(frame.clip_from_world, float4(placed.towards * placed.depth_extent, 0.0)).zw;
    o.pose_fade = instance.live_vertex_count;
#endif
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

// The colour of a texel in light and haze, linear.
float3 Lit(Interpolants i, float3 root, float4 surface)
{
    float2 xy = surface.xy * (255.0 / 127.0) - 128.0 / 127.0;
    float3 normal = float3(xy, sqrt(saturate(1.0 - dot(xy, xy))));
    float3 albedo = root * root * TintOf(i.tint_share.xyz, surface.z * 255.0);
    float3 light = LightOn(dot(normal, i.sun), dot(normal, i.up_haze.xyz), normal.z, Openness(i.uv_height.z));
    return lerp(albedo * light, frame.haze, i.up_haze.w);
}

// Linear to sRGB within 0.01, with one root.
float3 EncodedColor(float3 color)
{
    float3 s = sqrt(saturate(color));
    return s * (1.13 - 0.13 * s);
}

// What covers a share of a pixel, to be blended over what is behind it.
float4 Covering(float3 lit, float coverage)
{
    if (SRGB_TARGET)
    {
        return float4(lit * coverage, coverage);
    }
    float3 encoded = EncodedColor(lit);
    // Encoded colours do not blend as light does: an edge that is darker than what is behind it, which is about as bright as
    // the ground, would come out too dark.
    float share = coverage - coverage * (1.0 - coverage) * (BEHIND - encoded.g);
    return float4(encoded * share, share);
}

#ifdef SOFT
// One quad blends its edges, and its plane is depth enough. What lies before or behind the plane shifts with the direction to
// the eye: one step along its ray, from the depth at the plane, leaves a third of the error that a view's width causes.
// Where that is too little to see, the variant without RELIEF leaves it out.
float4 PSMain(Interpolants i) : SV_Target
{
    float2 uv = i.uv_height.xy;
#ifdef RELIEF
    float before = surface_texture.SampleLevel(surface_sampler, uv, 0.0).w * 2.0 - 1.0 - i.depth;
    uv = clamp(uv + before * i.shift, i.bounds.xy, i.bounds.zw);
#endif
    float4 color = color_texture.SampleLevel(color_sampler, uv, 0.0);
    float coverage = color.a * i.tint_share.w;
    if (coverage < SOFT_EDGE)
    {
        discard;
    }
    float4 surface = surface_texture.SampleLevel(surface_sampler, uv, 0.0);
    float3 lit = Lit(i, color.rgb, surface);
    return Covering(lit, coverage);
}
#else
// Quads of joints overlap: blended, they would let the ground shine through where they meet. So what covers most of a pixel hides
// what is behind it, by the depth of what it shows, and the rim around it blends from behind the body.
float4 PSMain(Interpolants i, out float depth : SV_Depth) : SV_Target
{
    float4 color = color_texture.SampleLevel(color_sampler, i.uv_height.xy, 0.0);
    // A fade draws a share of the pixels, or all but that share.
    uint bits = i.pose_fade;
    float fade = float((bits >> IMPOSTOR_FADE_SHIFT) & 0xffu) * (1.0 / 255.0);
    bool shown = (DitherThreshold(i.position.xy - float2(frame.left_px, frame.top_px)) < fade) != ((bits & IMPOSTOR_FADES_OUT) != 0u);
    if (color.a < SOFT_EDGE || !shown)
    {
        discard;
    }
    bool is_core = color.a >= CORE;
    float4 surface = surface_texture.SampleLevel(surface_sampler, i.uv_height.xy, 0.0);
    float3 lit = Lit(i, color.rgb, surface);
    float2 zw = i.depths.xy + i.depth_step * (surface.w * 2.0 - 1.0 - i.depths.z - (is_core ? 0.0 : RIM_BEHIND));
    depth = saturate(zw.x / max(zw.y, 1e-6));
    return Covering(lit, is_core ? 1.0 : color.a);
}
#endif
