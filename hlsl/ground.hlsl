// ground: the plane y = 0 out to the horizon, paved, as a square around the camera and rings around that, each a fixed
// number of times as wide as the one within: drivers interpolate place and depth over triangles near the camera's size
// well, and over a single huge one badly (SwiftShader: by half a slab).
// The paving is filtered over each pixel's footprint, so that it fades instead of flickering.

#include "ground.hlsli"

// Half the side of the innermost square in metres, and how often each ring doubles it; haze covers the edge of the last.
static const float FIRST_HALF_SIDE = 1.25;
static const uint RING_DOUBLINGS = 2u;
struct Interpolants
{
    float4 position : SV_Position;
    float2 offset : TEXCOORD0; // from the camera's foot point, metres: small numbers stay exact
    GroundConstants constants;
};

Interpolants VSMain(uint vertex : SV_VertexID)
{
    // Two triangles each: the square, then four trapezoids of every ring.
    static const uint CORNERS[6] = { 0u, 1u, 2u, 2u, 1u, 3u };
    uint piece = vertex / 6u;
    uint corner = CORNERS[vertex % 6u];
    float2 place = float2(corner & 1u, corner >> 1) * 2.0 - 1.0;
    float half_side = FIRST_HALF_SIDE;
    if (piece > 0u)
    {
        // A trapezoid from the side y = -1 of the inner square to that of the outer one, turned by quarters.
        uint side = (piece - 1u) % 4u;
        half_side *= float(1u << (RING_DOUBLINGS * ((piece - 1u) / 4u + (corner >> 1))));
        place.y = -1.0;
        place = side == 0u ? place : side == 1u ? float2(-place.y, place.x) : side == 2u ? -place : float2(place.y, -place.x);
    }
    Interpolants o;
    o.offset = place * half_side;
    o.position = mul(frame.clip_from_world, float4(frame.eye.x + o.offset.x, 0.0, frame.eye.z + o.offset.y, 1.0));
    o.constants = ConstantsOfGround();
    return o;
}

float4 PSMain(Interpolants i) : SV_Target
{
    return TargetColor(GroundColor(i.constants, i.offset));
}
