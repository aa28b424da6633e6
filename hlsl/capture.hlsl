// capture: orthographic pictures of one character for its impostors, many to a page; an instance is a picture. Twin:
// src/reference/capture.rs
// In: a character's arrays, whose palette here holds the poses to take, and indices already moved to the level of detail;
// out: colour and weight, normal, body part and depth. Skinning is the mesh stage's own.
// Pictures of a group show both faces of it, and what follows it before what hardly does: the side of a skirt that a leg
// moves is half a tube, and the other side is between it and the eye.

#include "mesh.hlsli"

[[vk::binding(4, 1)]] Texture2DArray<float4> albedo_texture; // sRGB-encoded colour, linear alpha
[[vk::binding(5, 1)]] SamplerState albedo_sampler;
[[vk::binding(0, 2)]] StructuredBuffer<CaptureInstance> captures;
[[vk::binding(1, 2)]] StructuredBuffer<uint> joint_groups; // by joint

[[vk::constant_id(0)]] const bool ALPHA_TESTED = false;
[[vk::constant_id(3)]] const bool TEXTURED = false;

struct Interpolants
{
    float4 position : SV_Position;
    float4 color : COLOR0; // sRGB-encoded, linear alpha
    float4 normal_depth : TEXCOORD0; // in the picture's frame; towards the eye in depth extents
    float4 uv_layer_weight : TEXCOORD1;
    nointerpolation uint part : TEXCOORD2; // body part and tint rule, as the atlas has them
    float4 inside : SV_ClipDistance0; // of the picture's four edges
};

struct PixelInput
{
    float4 position : SV_Position;
    float4 color : COLOR0;
    float4 normal_depth : TEXCOORD0;
    float4 uv_layer_weight : TEXCOORD1;
    nointerpolation uint part : TEXCOORD2;
};

struct Captured
{
    float4 color : SV_Target0;
    float4 surface : SV_Target1;
    float place : SV_Depth;
};

// Sum of the vertex's weights that belong to joints of the group.
float WeightInGroup(PackedVertex v, uint group)
{
    float4 weights = DecodeWeights(v);
    uint joints = v.tail.y;
    float sum = 0.0;
    sum += joint_groups[joints & 0xffu] == group ? weights.x : 0.0;
    sum += joint_groups[(joints >> 8) & 0xffu] == group ? weights.y : 0.0;
    sum += joint_groups[(joints >> 16) & 0xffu] == group ? weights.z : 0.0;
    sum += joint_groups[joints >> 24] == group ? weights.w : 0.0;
    return group == CAPTURE_ALL_GROUPS ? 1.0 : saturate(sum);
}

// SV_InstanceID includes firstInstance: the place in all pictures of the batch.
Interpolants VSMain(uint vertex : SV_VertexID, uint picture : SV_InstanceID)
{
    CaptureInstance capture = captures[picture];
    PackedVertex v = LoadVertex(vertex);
    Instance pose;
    pose.position = float3(0.0, 0.0, 0.0);
    pose.heading_cos = 1.0;
    pose.tint_seed = 0u;
    pose.live_vertex_count = 0u;
    pose.packed = 4u | (1u << 3); // all influences, one frame
    pose.heading_sin = 0.0;
    pose.sample_entries = uint4(capture.first_entry, 0u, 0u, 0u);
    pose.sample_weights = float3(1.0, 0.0, 0.0);
    pose.padding0 = 0u;
    Skinned skinned = SkinVertex(v, pose);

    float3 to_eye = cross(capture.right, capture.up);
    float3 from_center = skinned.position - capture.center;
    float2 plane = float2(dot(from_center, capture.right), dot(from_center, capture.up));
    float depth = dot(from_center, to_eye) * capture.depth_scale;

    Interpolants o;
    o.position = float4(plane * capture.clip_scale + capture.clip_offset, 0.5 + depth * (0.5 / CAPTURE_DEPTH_REACH), 1.0);
    o.color = DecodeColor(v);
    o.normal_depth = float4(dot(skinned.normal, capture.right), dot(skinned.normal, capture.up), dot(skinned.normal, to_eye), depth);
    float2 uv = float2(v.head.w & 0xffffu, v.head.w >> 16) * (1.0 / 65535.0);
    o.uv_layer_weight = float4(character.uv_min + character.uv_extent * uv, float((v.head.y >> 16) & 0xffu),
        WeightInGroup(v, capture.group));
    o.part = v.tail.w;
    o.inside = float4(o.position.xy - capture.clip_min, capture.clip_max - o.position.xy);
    return o;
}

Captured PSMain(PixelInput i, bool front_face : SV_IsFrontFace)
{
    float weight = i.uv_layer_weight.w;
    if (weight < CAPTURE_WEIGHT_MIN)
    {
        discard;
    }
    float4 color = i.color;
    if (TEXTURED)
    {
        color *= albedo_texture.Sample(albedo_sampler, i.uv_layer_weight.xyz);
    }
    if (ALPHA_TESTED)
    {
        if (color.a < draw.alpha_cutoff)
        {
            discard;
        }
    }
    float3 normal = front_face ? i.normal_depth.xyz : -i.normal_depth.xyz;
    // A smooth normal may lean away from the eye near an outline; the reader takes it to face the eye.
    normal.z = max(normal.z, 0.0);
    normal *= rsqrt(max(dot(normal, normal), 1e-24));
    Captured o;
    o.color = float4(color.rgb, (1.0 + 254.0 * saturate(weight)) * (1.0 / 255.0));
    o.surface = float4((128.0 + 127.0 * normal.xy) * (1.0 / 255.0), float(i.part) * (1.0 / 255.0),
        saturate(0.5 + 0.5 * i.normal_depth.w));
    o.place = 0.5 * i.position.z + (weight < CAPTURE_WEIGHT_OWN ? 0.0 : 0.5);
    return o;
}
