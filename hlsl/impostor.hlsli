// The vertex work of the impostor stage: which picture of a quad an instance shows, and where. Twin: src/reference/impostor.rs
// Source: Izquierdo 2014, section 4.2; the quads' pictures and cells: bake/src/impostor.

#include "gpu_types.hlsli"
#include "palette.hlsli"

[[vk::binding(0, 0)]] ConstantBuffer<FrameConstants> frame;
[[vk::binding(0, 1)]] ConstantBuffer<CharacterConstants> character;
[[vk::binding(6, 1)]] Texture2D<float4> impostor_texture; // quads and views, 2 texels each; tiles, 3
[[vk::binding(7, 1)]] TextureCubeArray<float4> cells_texture; // three views; by view set
[[vk::binding(8, 1)]] SamplerState nearest_sampler;

#include "light.hlsli"

// A picture of a quad in world space.
struct Placed
{
    float3 corner; // of the vertex
    float3 right; // axes of the picture, unit length
    float3 up;
    float3 towards; // right x up: towards the eye, but for the width of a cell
    float2 uv; // in the atlas
    float depth_extent; // metres
    float depth; // of the corner before the quad's centre, metres
    float mip;
};

float4 ImpostorTexel(uint i)
{
    return impostor_texture.Load(int3(i % IMPOSTOR_ROW_TEXELS, i / IMPOSTOR_ROW_TEXELS, 0));
}

// The view whose picture stands for a direction: one of the three around it, each for the share of `random` in [0, 1) that
// the direction's barycentric coordinates give it.
uint ViewOf(float3 direction, float view_set, uint first_view, float random)
{
    float3 views = cells_texture.SampleLevel(nearest_sampler, float4(direction, view_set), 0.0).xyz;
    uint3 v = uint3(views + 0.5);
    float3 a = ImpostorTexel(character.first_view_texel + 2u * (first_view + v.x)).xyz;
    float3 b = ImpostorTexel(character.first_view_texel + 2u * (first_view + v.y)).xyz;
    float3 c = ImpostorTexel(character.first_view_texel + 2u * (first_view + v.z)).xyz;
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
    float4 texel = ImpostorTexel(2u * quad);
    float3 center = texel.xyz;
    float depth_extent = texel.w;
    texel = ImpostorTexel(2u * quad + 1u);
    uint first_tile = uint(texel.y + 0.5);
    uint first_view = uint(texel.z + 0.5);
    uint packed = uint(texel.w + 0.5); // views, and from bit 12 the view set
    uint view_count = packed & 0xfffu;

    // Model space from the quad's space: bind space where it follows a joint.
    float4 row0 = float4(1.0, 0.0, 0.0, 0.0);
    float4 row1 = float4(0.0, 1.0, 0.0, 0.0);
    float4 row2 = float4(0.0, 0.0, 1.0, 0.0);
    uint pose = 0u;
    if (texel.x >= 0.0)
    {
        row0 = 0.0;
        row1 = 0.0;
        row2 = 0.0;
        AddJoint(instance, uint(texel.x + 0.5), 1.0, row0, row1, row2);
    }
    else
    {
        pose = instance.live_vertex_count & IMPOSTOR_POSE_MASK;
    }
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

    uint view = ViewOf(direction, float(packed >> 12), first_view, random);
    uint tile = character.first_tile_texel + 3u * (first_tile + pose * view_count + view);
    float4 plane = ImpostorTexel(tile);
    float4 uv = ImpostorTexel(tile + 1u);
    float4 lean = ImpostorTexel(tile + 2u);
    uint v = character.first_view_texel + 2u * (first_view + view);
    float3 towards = ImpostorTexel(v).xyz;
    float3 right = ImpostorTexel(v + 1u).xyz;
    float3 up = cross(towards, right);

    float2 side = float2(corner & 1u, corner >> 1);
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
    o.uv = lerp(uv.xy, uv.zw, side);
    o.depth_extent = depth_extent * scale;
    o.depth = depth * scale;
    // Units of the quad's space in a pixel, over those in a texel.
    float pixel = frame.pixel_angle * length(eye);
    float atlas_texel = (plane.z - plane.x) / max((uv.z - uv.x) * character.atlas_size.x, 1.0);
    o.mip = clamp(log2(max(pixel / max(atlas_texel, 1e-12), 1.0)) + IMPOSTOR_MIP_BIAS, 0.0, character.last_mip);
    return o;
}
