// The vertex work of the mesh stage: window extraction, collapse, palette skinning. Twin: src/reference/mesh.rs
// Source: Ramos et al. 2012, section 3; the bands and per-instance LOD are ours.

#include "gpu_types.hlsli"
#include "palette.hlsli"
#include "records.hlsli"

[[vk::binding(0, 0)]] ConstantBuffer<FrameConstants> frame;
[[vk::binding(0, 1)]] ConstantBuffer<CharacterConstants> character;
[[vk::binding(1, 1)]] RECORDS(uint4) vertices; // 2 per vertex
[[vk::binding(2, 1)]] RECORDS(uint) parents; // collapse targets
[[vk::binding(3, 1)]] RECORDS(float4) palette; // 3 per joint and frame
[[vk::push_constant]] ConstantBuffer<DrawConstants> draw;

// A vertex after window extraction and collapse, still packed.
struct PackedVertex
{
    uint4 head; // position xy | position z, layer, body part | normal | uv
    uint4 tail; // colour | joints | weights | tint code
};

// The living ancestor of a vertex, both numbered within the submesh.
// Lanes that fill up a group on lavapipe read 0 live vertices and take part in the loop: for them nothing is dead.
uint LivingAncestor(uint vertex, uint live_vertex_count)
{
    uint last_alive = live_vertex_count - 1u;
    uint first_vertex = draw.first_vertex; // constants are read lane by lane within loops
    while (vertex > last_alive)
    {
        vertex = parents[first_vertex + vertex];
    }
    return vertex;
}

PackedVertex LoadVertex(uint vertex)
{
    uint i = 2u * (draw.first_vertex + vertex);
    PackedVertex v;
    v.head = vertices[i];
    v.tail = vertices[i + 1u];
    return v;
}

float3 DecodePosition(PackedVertex v)
{
    float3 fraction = float3(v.head.x & 0xffffu, v.head.x >> 16, v.head.y & 0xffffu) * (1.0 / 65535.0);
    return character.position_min + character.position_extent * fraction;
}

// sRGB-encoded colour, linear alpha.
float4 DecodeColor(PackedVertex v)
{
    uint packed = v.tail.x;
    return float4(packed & 0xffu, (packed >> 8) & 0xffu, (packed >> 16) & 0xffu, packed >> 24) * (1.0 / 255.0);
}

// Octahedral, signed 16-bit fractions; of unit length only after normalisation.
float3 DecodeNormal(PackedVertex v)
{
    int packed = int(v.head.z);
    float2 o = float2((packed << 16) >> 16, packed >> 16) * (1.0 / 32767.0);
    float3 n = float3(o, 1.0 - abs(o.x) - abs(o.y));
    float fold = max(-n.z, 0.0);
    n.x += n.x >= 0.0 ? -fold : fold;
    n.y += n.y >= 0.0 ? -fold : fold;
    return n;
}

float4 DecodeWeights(PackedVertex v)
{
    float4 w;
    w.y = float(v.tail.z & 0x7ffu) * (0.5 / 2047.0);
    w.z = float((v.tail.z >> 11) & 0x7ffu) * (1.0 / 3.0 / 2047.0);
    w.w = float(v.tail.z >> 22) * (0.25 / 1023.0);
    w.x = 1.0 - w.y - w.z - w.w;
    return w;
}

// Adds `weight` times the rows of a joint's model_from_bind in an instance's frames.
void AddJoint(Instance instance, uint joint, float weight, inout float4 row0, inout float4 row1, inout float4 row2)
{
    uint sample_count = SampleCount(instance);
    for (uint s = 0u; s < sample_count; s++)
    {
        uint row = 3u * (SampleEntry(instance, s) + joint);
        float share = weight * SampleWeight(instance, s);
        row0 += share * palette[row];
        row1 += share * palette[row + 1u];
        row2 += share * palette[row + 2u];
    }
}

struct Skinned
{
    float3 position; // world
    float3 normal; // world, unit length
};

// Linear blend skinning with the instance's influences and frames, then the agent's place.
Skinned SkinVertex(PackedVertex v, Instance instance)
{
    uint influence_count = instance.packed & 7u;
    float4 weights = DecodeWeights(v);
    float4 row0 = 0.0;
    float4 row1 = 0.0;
    float4 row2 = 0.0;
    float sum = 0.0;
    for (uint j = 0u; j < influence_count; j++)
    {
        uint joint = (v.tail.y >> (8u * j)) & 0xffu;
        float weight = j == 0u ? weights.x : j == 1u ? weights.y : j == 2u ? weights.z : weights.w;
        sum += weight;
        AddJoint(instance, joint, weight, row0, row1, row2);
    }
    float4 bind = float4(DecodePosition(v), 1.0);
    float3 normal = DecodeNormal(v);
    // Influences that were left out leave their weight to the others.
    float3 model = float3(dot(row0, bind), dot(row1, bind), dot(row2, bind)) * (1.0 / sum);
    float3 n = float3(dot(row0.xyz, normal), dot(row1.xyz, normal), dot(row2.xyz, normal));
    float scale = sqrt(instance.heading_cos * instance.heading_cos + instance.heading_sin * instance.heading_sin);

    Skinned result;
    result.position = instance.position + float3(
        instance.heading_cos * model.x + instance.heading_sin * model.z,
        scale * model.y,
        instance.heading_cos * model.z - instance.heading_sin * model.x);
    n = float3(
        instance.heading_cos * n.x + instance.heading_sin * n.z,
        scale * n.y,
        instance.heading_cos * n.z - instance.heading_sin * n.x);
    result.normal = n * rsqrt(max(dot(n, n), 1e-24));
    return result;
}
