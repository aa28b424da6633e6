// impostor: draws every quad of an impostor kind of every agent that shows it. Twin: src/reference/impostor.rs
// In: instance lists of the select stage; live_vertex_count is pose and fade.
// Vertex numbers: 4 per quad. Agents of one quad are AGENTS_PER_INSTANCE to an instance of the draw; of others each is one.

#include "impostor.hlsli"
#include "color.hlsli"
#if defined(SOFT) && !defined(TRANSFORM)
#define READS_LISTS
#endif
#include "instance.hlsli"

[[vk::binding(2, 2)]] Texture2D<float4> color_texture; // square roots of linear colour, distance from the outline
[[vk::binding(3, 2)]] Texture2D<float4> surface_texture; // normal, body part and tint rule, depth
// Levels of both samplers end at the first, so that pixels after a discard may sample, too.
[[vk::binding(5, 2)]] SamplerState color_sampler;

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
    float4 uv_height_depth : TEXCOORD0; // place in the gallery; metres above the agent's ground; plane before the quad's centre, in its extents
    nointerpolation float4 sun_shift : TEXCOORD1; // towards it in the picture's axes; shift in the gallery by a depth extent before the plane, of quads of joints their sharpness
    nointerpolation float4 up_shift : TEXCOORD2; // world +Y in the picture's axes; the shift's other coordinate
    nointerpolation float4 tint_share : TEXCOORD3; // of the agent; of the picture that is shown: of one quad 255ths, and a quarter of its sharpness; of quads of joints less 2 where it is the part that the fade leaves
    nointerpolation float4 sunlight_haze : TEXCOORD4; // what haze lets through; the red that it adds
    nointerpolation float4 skylight_haze : TEXCOORD5; // and green
    nointerpolation float4 groundlight_haze : TEXCOORD6; // and blue
#if defined(RELIEF)
    nointerpolation float4 bounds : TEXCOORD7; // of the picture in the gallery
#elif !defined(SOFT)
    float2 plane_zw : TEXCOORD7; // clip space
    nointerpolation float4 depth_step_corner : TEXCOORD8; // clip-space z and w of a step from the centre to the near end of the depths; pixels of the picture's corner
#endif
};

// A corner, 0 to 3, of one of an instance's quads.
Interpolants CornerOf(Instance instance, uint quad, uint corner)
{
    Placed placed = PlaceQuad(instance, quad, corner, QuadRandom(instance, quad));

    Interpolants o;
    o.position = mul(frame.clip_from_world, float4(placed.corner, 1.0));
    float4 in_gallery = GalleryFrom(placed.atlas, placed.mip);
    o.uv_height_depth = float4(
        placed.uv * in_gallery.xy + in_gallery.zw, placed.corner.y - instance.position.y, placed.depth / placed.depth_extent);
    float2 shift = 0.0;
#if defined(RELIEF)
    shift = placed.shift * in_gallery.xy;
#endif
    float3 sun = frame.to_sun;
    o.sun_shift = float4(dot(placed.right, sun), dot(placed.up, sun), dot(placed.towards, sun), shift.x);
    o.up_shift = float4(placed.right.y, placed.up.y, placed.towards.y, shift.y);
    float share = float((instance.live_vertex_count >> IMPOSTOR_FADE_SHIFT) & 0xffu);
    bool fades_out = (instance.live_vertex_count & IMPOSTOR_FADES_OUT) != 0u;
#if defined(SOFT)
    share = (fades_out ? 255.0 - share : share) + 0.25 * placed.sharpness;
#else
    share = share * (1.0 / 255.0) - (fades_out ? 2.0 : 0.0);
    o.sun_shift.w = placed.sharpness;
#endif
    o.tint_share = float4(TintRandom(instance.tint_seed), share);
    // Pixels get all constants so: lavapipe looks up those of a buffer lane by lane in pixel shaders.
    float haze = HazeShare(length(frame.eye - instance.position), frame.haze_per_metre);
    o.sunlight_haze = float4(frame.sun * (1.0 - haze), frame.haze.r * haze);
    o.skylight_haze = float4(frame.sky * (1.0 - haze), frame.haze.g * haze);
    o.groundlight_haze = float4(frame.ground * (1.0 - haze), frame.haze.b * haze);
#if defined(RELIEF)
    o.bounds = placed.bounds * in_gallery.xyxy + in_gallery.zwzw;
#elif !defined(SOFT)
    o.plane_zw = o.position.zw;
    float2 depth_step = mul(frame.clip_from_world, float4(placed.towards * placed.depth_extent, 0.0)).zw;
    o.depth_step_corner = float4(depth_step, frame.left_px, frame.top_px);
#endif
    return o;
}

#ifdef READS_LISTS
// The instance's number includes firstInstance, which is 0: vertex numbers begin where the list does.
Interpolants VSMain(uint vertex : SV_VertexID, uint instance : SV_InstanceID)
{
    return CornerOf(LoadInstance((vertex >> 2) + AGENTS_PER_INSTANCE * instance), 0u, vertex & 3u);
}
#else
Interpolants VSMain(uint vertex : SV_VertexID, InstanceAttributes attributes)
{
    return CornerOf(InstanceFrom(attributes), vertex >> 2, vertex & 3u);
}
#endif

// A threshold in (0, 1) by pixel: an ordered 4x4 pattern.
float DitherThreshold(float2 pixel)
{
    uint2 p = uint2(pixel);
    uint x = p.x ^ p.y;
    uint index = ((x & 1u) << 3) | ((p.y & 1u) << 2) | (x & 2u) | ((p.y & 2u) >> 1);
    return (float(index) + 0.5) * (1.0 / 16.0);
}

// The share of a pixel that is inside of an outline, by what a texel says of its distance and by the pixels in a texel.
float CoverageAt(float outline, float sharpness)
{
    return saturate((outline - 0.5) * (2.0 * sharpness) + 0.5);
}

// The colour of a texel in light and haze, linear.
float3 Lit(Interpolants i, float3 root, float4 surface)
{
    float2 xy = surface.xy * (255.0 / 127.0) - 128.0 / 127.0;
    float3 normal = float3(xy, sqrt(saturate(1.0 - dot(xy, xy))));
    float3 albedo = root * root * TintOf(i.tint_share.xyz, surface.z * 255.0);
    Light light = { i.sunlight_haze.rgb, i.skylight_haze.rgb, i.groundlight_haze.rgb };
    float3 lit = albedo
        * LightOn(light, dot(normal, i.sun_shift.xyz), dot(normal, i.up_shift.xyz), normal.z, Openness(i.uv_height_depth.z));
    return lit + float3(i.sunlight_haze.w, i.skylight_haze.w, i.groundlight_haze.w);
}

// What covers a share of a pixel, to be blended over what is behind it.
float4 Covering(float3 lit, float coverage)
{
    if (SRGB_TARGET)
    {
        return float4(lit * coverage, coverage);
    }
    float3 encoded = SrgbFromLinear(lit);
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
    float2 uv = i.uv_height_depth.xy;
#ifdef RELIEF
    float before = surface_texture.Sample(nearest_sampler, uv).w * 2.0 - 1.0 - i.uv_height_depth.w;
    uv = clamp(uv + before * float2(i.sun_shift.w, i.up_shift.w), i.bounds.xy, i.bounds.zw);
#endif
    float4 color = color_texture.Sample(color_sampler, uv);
    float share = floor(i.tint_share.w);
    float coverage = CoverageAt(color.a, 4.0 * (i.tint_share.w - share)) * (share * (1.0 / 255.0));
    if (coverage < SOFT_EDGE)
    {
        discard;
    }
    float4 surface = surface_texture.Sample(nearest_sampler, uv);
    float3 lit = Lit(i, color.rgb, surface);
    return Covering(lit, coverage);
}
#else
// Quads of joints overlap: blended, they would let the ground shine through where they meet. So what covers most of a pixel hides
// what is behind it, by the depth of what it shows, and the rim around it blends from behind the body.
float4 PSMain(Interpolants i, out float depth : SV_Depth) : SV_Target
{
    float4 color = color_texture.Sample(color_sampler, i.uv_height_depth.xy);
    // A fade draws a share of the pixels, or all but that share.
    bool fades_out = i.tint_share.w < -0.5;
    float fade = fades_out ? i.tint_share.w + 2.0 : i.tint_share.w;
    bool shown = (DitherThreshold(i.position.xy - i.depth_step_corner.zw) < fade) != fades_out;
    float coverage = CoverageAt(color.a, i.sun_shift.w);
    if (coverage < SOFT_EDGE || !shown)
    {
        discard;
    }
    bool is_core = coverage >= CORE;
    float4 surface = surface_texture.Sample(nearest_sampler, i.uv_height_depth.xy);
    float3 lit = Lit(i, color.rgb, surface);
    float before = surface.w * 2.0 - 1.0 - i.uv_height_depth.w - (is_core ? 0.0 : RIM_BEHIND);
    float2 zw = i.plane_zw + i.depth_step_corner.xy * before;
    depth = saturate(zw.x / max(zw.y, 1e-6));
    return Covering(lit, is_core ? 1.0 : coverage);
}
#endif
