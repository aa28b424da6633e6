// The vertex work of the impostor stage: which picture of a quad an instance shows, and where. Twin: src/reference/impostor.rs
// Source: Izquierdo 2014, section 4.2; the quads' pictures and cells: bake/src/impostor.

#include "gpu_types.hlsli"
#include "palette.hlsli"
#include "records.hlsli"

[[vk::binding(0, 0)]] ConstantBuffer<FrameConstants> frame;
[[vk::binding(0, 2)]] RECORDS(float4) gallery; // src/impostor.rs says what is where
[[vk::binding(1, 2)]] TextureCubeArray<float4> cells_texture; // three views; by view set
[[vk::binding(4, 2)]] SamplerState nearest_sampler; // of pictures without mips, as the other
[[vk::push_constant]] ConstantBuffer<DrawConstants> draw;

#include "light.hlsli"
#include "stretch.hlsli"
#include "tint.hlsli"

// Least cosine between the eye's ray and a picture's plane that pixels are shifted for: no further at flatter angles.
static const float MIN_SLANT = 0.4;

// A picture of a quad in world space.
struct Placed
{
    float3 corner; // of the vertex
    float3 right; // axes of the picture, unit length
    float3 up;
    float3 towards; // right x up: towards the eye, but for the width of a cell
    float2 uv; // texels of its atlas, where it lies on its side
    float atlas; // which of the gallery's
    float depth_extent; // metres
    float depth; // of the corner before the quad's centre, metres
    float2 shift; // texels, to where the eye's ray meets what lies a depth extent before the plane
    float4 bounds; // least and greatest texels of the atlas where a pixel may shift to
    float mip; // a whole number
    float sharpness; // pixels in a texel of that mip
};

// Where texels of a mip of an atlas are in the gallery's pictures, as factors and what to add: atlases stand in rows of a grid,
// and coarser mips of all of them below it, side by side, in half the grid's height.
float4 GalleryFrom(float atlas, float mip)
{
    float4 grid = gallery[0u]; // width and height of the first mip; width of an atlas's place in it; columns
    float row = floor((atlas + 0.5) / grid.w);
    float column = atlas - row * grid.w;
    float share = exp2(-mip);
    float2 origin = mip < 0.5 ? float2(0.0, 0.0) : float2(grid.x - 2.0 * share * grid.x, grid.y);
    float2 texel = 1.0 / float2(grid.x, 1.5 * grid.y);
    return float4(share * texel, (share * grid.z * float2(column, row) + origin) * texel);
}

// A quad of an instance: where the gallery's table has it and its first view's tile, and model space from the quad's space.
struct Posed
{
    uint quad;
    uint tile;
    float4 row0;
    float4 row1;
    float4 row2;
    float extent; // 0 for a quad that the character does not have
};

#ifdef SOFT
// One quad for the whole body, by pose.
Posed PoseQuad(Instance instance, uint quad)
{
    float4 pose = gallery[instance.live_vertex_count & IMPOSTOR_POSE_MASK];
    Posed o;
    o.quad = uint(pose.x + 0.5);
    o.tile = uint(pose.y + 0.5);
    o.row0 = float4(1.0, 0.0, 0.0, 0.0);
    o.row1 = float4(0.0, 1.0, 0.0, 0.0);
    o.row2 = float4(0.0, 0.0, 1.0, 0.0);
    o.extent = 1.0;
    return o;
}
#else
// A quad that follows a joint; its space is bind space.
Posed PoseQuad(Instance instance, uint quad)
{
    float4 pose = gallery[instance.live_vertex_count & IMPOSTOR_POSE_MASK];
    uint quad_count = uint(pose.w + 0.5);
    Posed o;
    o.quad = uint(pose.z + 0.5) + 3u * min(quad, quad_count - 1u);
    o.extent = quad < quad_count ? 1.0 : 0.0;
    float4 texel = gallery[o.quad + 1u];
    o.tile = uint(texel.y + 0.5);
    o.row0 = 0.0;
    o.row1 = 0.0;
    o.row2 = 0.0;
    uint joint = uint(texel.w + 0.5) + 3u * uint(texel.x + 0.5);
    uint sample_count = SampleCount(instance);
    for (uint s = 0u; s < sample_count; s++)
    {
        uint rows = joint + 3u * SampleEntry(instance, s);
        float weight = SampleWeight(instance, s);
        o.row0 += weight * gallery[rows];
        o.row1 += weight * gallery[rows + 1u];
        o.row2 += weight * gallery[rows + 2u];
    }
    return o;
}
#endif

// The view whose picture stands for a direction: one of the three around it, each for the share of `random` in [0, 1) that
// the direction's barycentric coordinates give it.
uint ViewOf(float3 direction, float view_set, uint first_view, float random)
{
    float3 views = cells_texture.SampleLevel(nearest_sampler, float4(direction, view_set), 0.0).xyz;
    uint3 v = uint3(views + 0.5);
    float3 a = gallery[first_view + 2u * v.x].xyz;
    float3 b = gallery[first_view + 2u * v.y].xyz;
    float3 c = gallery[first_view + 2u * v.z].xyz;
    float3 w = max(float3(dot(direction, cross(b, c)), dot(direction, cross(c, a)), dot(direction, cross(a, b)))
        * sign(dot(a, cross(b, c))), 0.0);
    // Near the middle of a cell every agent shows its view; towards a border they change one by one.
    w = max(w - 0.8 * max(w.x, max(w.y, w.z)), 0.0);
    float at = random * (w.x + w.y + w.z);
    return at < w.x || w.x + w.y + w.z <= 0.0 ? v.x : at < w.x + w.y ? v.y : v.z;
}

// Steady over frames, different for every agent and quad; in [0, 1).
float QuadRandom(Instance instance, uint quad)
{
    return float(Hash((instance.packed >> 6) ^ (quad * 0x9e3779b9u)) >> 8) * (1.0 / 16777216.0);
}

// Places one corner (0 to 3: left bottom, right bottom, left top, right top) of one quad of an instance.
Placed PlaceQuad(Instance instance, uint quad, uint corner, float random)
{
    Posed posed = PoseQuad(instance, quad);
    float4 row0 = posed.row0;
    float4 row1 = posed.row1;
    float4 row2 = posed.row2;
    float4 texel = gallery[posed.quad];
    float3 center = texel.xyz;
    float depth_extent = texel.w;
    uint first_view = uint(gallery[posed.quad + 1u].z + 0.5);
    float4 place = gallery[posed.quad + 2u]; // view set, atlas, last mip
    float scale = sqrt(instance.heading_cos * instance.heading_cos + instance.heading_sin * instance.heading_sin);

    // The eye from the quad's centre, in model space and then in the quad's own.
    float3 e = frame.eye - instance.position;
    float3 eye = float3(
        instance.heading_cos * e.x - instance.heading_sin * e.z,
        scale * e.y,
        instance.heading_sin * e.x + instance.heading_cos * e.z) / (scale * scale);
    float4 c = float4(center, 1.0);
    eye -= float3(dot(row0, c), dot(row1, c), dot(row2, c));
    float3 direction = normalize(row0.xyz * eye.x + row1.xyz * eye.y + row2.xyz * eye.z);

    uint view = ViewOf(direction, place.x, first_view, random);
    uint tile = posed.tile + 3u * view;
    float4 plane = gallery[tile];
    float4 uv = gallery[tile + 1u];
    float4 lean = gallery[tile + 2u];
    float3 towards = gallery[first_view + 2u * view].xyz;
    float3 right = gallery[first_view + 2u * view + 1u].xyz;
    float3 up = cross(towards, right);

    float2 side = posed.extent * float2(corner & 1u, corner >> 1);
    float2 at = lerp(plane.xy, plane.zw, side);
    float depth = lean.x * at.x + lean.y * at.y + lean.z;
    float4 p = float4(center + right * at.x + up * at.y + towards * depth, 1.0);
    float3 model = float3(dot(row0, p), dot(row1, p), dot(row2, p));
    float3 axes[3] = { right, up, towards };
    [unroll]
    for (uint i = 0u; i < 3u; i++)
    {
        float3 m = float3(dot(row0.xyz, axes[i]), dot(row1.xyz, axes[i]), dot(row2.xyz, axes[i]));
        axes[i] = normalize(float3(
            instance.heading_cos * m.x + instance.heading_sin * m.z,
            scale * m.y,
            instance.heading_cos * m.z - instance.heading_sin * m.x));
    }

    Placed o;
    o.corner = instance.position + float3(
        instance.heading_cos * model.x + instance.heading_sin * model.z,
        scale * model.y,
        instance.heading_cos * model.z - instance.heading_sin * model.x);
    o.right = axes[0];
    o.up = axes[1];
    o.towards = axes[2];
    o.uv = lerp(uv.xy, uv.zw, side.yx);
    o.atlas = place.y;
    o.depth_extent = depth_extent * scale;
    o.depth = depth * scale;
    float3 ray = float3(dot(direction, right), dot(direction, up), dot(direction, towards));
    o.shift = ray.yx * ((uv.zw - uv.xy) / max(plane.wz - plane.yx, 1e-12) * (depth_extent / max(ray.z - dot(lean.xy, ray.xy), MIN_SLANT)));
    o.bounds = float4(uv.zy, uv.xw);
    // Units of the quad's space in a pixel, over those in a texel.
    float pixel = frame.pixel_angle * length(eye) * StretchShare(instance.position);
    float atlas_texel = (plane.z - plane.x) / max(uv.w - uv.y, 1.0);
    o.mip = floor(clamp(log2(max(pixel / max(atlas_texel, 1e-12), 1.0)) + IMPOSTOR_MIP_BIAS, 0.0, place.z) + 0.5);
    o.sharpness = clamp(atlas_texel * exp2(o.mip) / max(pixel, 1e-12), SHARPNESS_MIN, SHARPNESS_MAX);
    return o;
}
