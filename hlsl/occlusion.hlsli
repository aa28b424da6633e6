// The pyramid of the occluders' farthest depth, and the test of bounds against it. Twin: src/reference/occlude.rs
// Depths in it rise away from the eye, whichever way the depth buffer goes. A texel of level l covers 2^l by 2^l of
// the depth's; sides are rounded up to whole texels of the last level, so that every texel has four children.

#ifndef THRONG_OCCLUSION
#define THRONG_OCCLUSION

#include "gpu_types.hlsli"

// Texels of a side of the depth, for pixels of the picture's.
uint DepthSide(uint side_px)
{
    return (side_px + OCCLUDER_TEXEL_PX - 1u) / OCCLUDER_TEXEL_PX;
}

// Rounded up to whole texels of the last level.
uint PaddedSide(uint depth_side)
{
    return ((depth_side + (1u << PYRAMID_TOP) - 1u) >> PYRAMID_TOP) << PYRAMID_TOP;
}

// Where a level starts in a pyramid over `area` padded texels: the sum of area / 4^k over the levels before it.
uint LevelStart(uint area, uint level)
{
    return (4u * area - ((4u * area) >> (2u * level))) / 3u;
}

#ifdef OCCLUSION

// What the test takes from the frame, read once outside of control flow.
struct Viewed
{
    float4x4 clip_from_world;
    float3 eye;
    float4 eye_clip;
    uint2 size_px;
    uint2 padded; // depth texels
    float near;
    float depth_sign; // -1 where depth is reversed
};

Viewed LoadViewed()
{
    Viewed v;
    v.clip_from_world = frame.clip_from_world;
    v.eye = frame.eye;
    v.eye_clip = mul(v.clip_from_world, float4(v.eye, 1.0));
    v.size_px = uint2(frame.width_px, frame.height_px);
    v.padded = uint2(PaddedSide(DepthSide(v.size_px.x)), PaddedSide(DepthSide(v.size_px.y)));
    v.near = frame.near;
    v.depth_sign = (frame.flags & FLAG_REVERSED_DEPTH) != 0u ? -1.0 : 1.0;
    return v;
}

// Where points are seen.
struct Seen
{
    float2 low; // normalised device coordinates
    float2 high;
    float nearest; // depth that rises away from the eye
    float w_min;
};

Seen SeenNothing()
{
    Seen seen;
    seen.low = 1e30;
    seen.high = -1e30;
    seen.nearest = 1e30;
    seen.w_min = 1e30;
    return seen;
}

// Occluders' surfaces are only about where they are drawn: a point counts as a little nearer.
Seen AndPoint(Viewed v, Seen seen, float4 clip)
{
    float2 ndc = clip.xy / max(clip.w, 1e-6);
    float2 nearer = lerp(clip.zw, v.eye_clip.zw, OCCLUDER_MARGIN);
    seen.low = min(seen.low, ndc);
    seen.high = max(seen.high, ndc);
    seen.nearest = min(seen.nearest, v.depth_sign * nearer.x / max(nearer.y, 1e-6));
    seen.w_min = min(seen.w_min, clip.w);
    return seen;
}

// Share of what is seen there that no occluder covers; 0 is hidden. The texels of the finest level of which few enough hold it
// decide; whatever needs larger ones than there are, or crosses the near plane, is all open, and so is what is not asked for.
float OpenShare(Viewed v, Seen seen, bool asked)
{
    float2 size = float2(v.size_px);
    float2 low = (float2(seen.low.x, -seen.high.y) * 0.5 + 0.5) * size;
    float2 high = (float2(seen.high.x, -seen.low.y) * 0.5 + 0.5) * size;
    // A pixel more, for edges that impostors blend, and because an occluder's outline is only good to a texel.
    uint2 first = uint2(clamp(floor(low - 1.0), 0.0, size - 1.0)) / OCCLUDER_TEXEL_PX;
    uint2 last = uint2(clamp(floor(high + 1.0), 0.0, size - 1.0)) / OCCLUDER_TEXEL_PX;
    uint level = PYRAMID_TOP + 1u;
    [unroll]
    for (uint l = 0u; l <= PYRAMID_TOP; l++)
    {
        uint2 span = (last >> (PYRAMID_TOP - l)) - (first >> (PYRAMID_TOP - l));
        level = span.x < TEST_COLUMNS && span.y < TEST_ROWS ? PYRAMID_TOP - l : level;
    }
    bool decided = asked && level <= PYRAMID_TOP && seen.w_min > v.near;
    level = min(level, PYRAMID_TOP);
    first = first >> level;
    last = last >> level;
    uint start = LevelStart(v.padded.x * v.padded.y, level);
    uint pitch = v.padded.x >> level;
    float open = 0.0;
    for (uint y = first.y; y <= last.y && decided; y++)
    {
        for (uint x = first.x; x <= last.x; x++)
        {
            open += seen.nearest > pyramid[start + y * pitch + x] ? 0.0 : 1.0;
        }
    }
    uint2 span = last - first + 1u;
    return decided ? open / float(span.x * span.y) : 1.0;
}

// Of an agent's bounds, whatever its clips do.
float OpenShareOfBody(Viewed v, AgentState agent, ClipInfo clip0, ClipInfo clip1, bool asked)
{
    float3 low = min(clip0.box_center - clip0.box_half_extent, clip1.box_center - clip1.box_half_extent);
    float3 high = max(clip0.box_center + clip0.box_half_extent, clip1.box_center + clip1.box_half_extent);
    float3 c = agent.scale * 0.5 * (low + high);
    float3 h = agent.scale * 0.5 * (high - low);
    float2 turn = float2(agent.heading_cos, agent.heading_sin);
    float3 center = agent.position + float3(turn.x * c.x + turn.y * c.z, c.y, turn.x * c.z - turn.y * c.x);
    float4 middle = mul(v.clip_from_world, float4(center, 1.0));
    float4 x = mul(v.clip_from_world, float4(turn.x * h.x, 0.0, -turn.y * h.x, 0.0));
    float4 y = mul(v.clip_from_world, float4(0.0, h.y, 0.0, 0.0));
    float4 z = mul(v.clip_from_world, float4(turn.y * h.z, 0.0, turn.x * h.z, 0.0));
    Seen seen = SeenNothing();
    seen = AndPoint(v, seen, middle - x - y - z);
    seen = AndPoint(v, seen, middle + x - y - z);
    seen = AndPoint(v, seen, middle - x + y - z);
    seen = AndPoint(v, seen, middle + x + y - z);
    seen = AndPoint(v, seen, middle - x - y + z);
    seen = AndPoint(v, seen, middle + x - y + z);
    seen = AndPoint(v, seen, middle - x + y + z);
    seen = AndPoint(v, seen, middle + x + y + z);
    return OpenShare(v, seen, asked);
}

// How many times the error may be that an agent's mesh has, of which a share is open: the less of it shows, the less of the
// picture is off, but the same triangles are paid for.
float OpenErrorFactor(float open)
{
    return min(1.0 / sqrt(max(open, 1e-3)), OPEN_ERROR_MAX);
}

// Of an agent's contact shadow, a square on the ground that looks at the camera; false where it is not asked.
bool IsShadowHidden(Viewed v, AgentState agent, float radius, bool asked)
{
    float2 away = agent.position.xz - v.eye.xz;
    away = away * (radius / max(length(away), 1e-6));
    float4 middle = mul(v.clip_from_world, float4(agent.position.x, SHADOW_LIFT, agent.position.z, 1.0));
    float4 x = mul(v.clip_from_world, float4(-away.y, 0.0, away.x, 0.0));
    float4 z = mul(v.clip_from_world, float4(away.x, 0.0, away.y, 0.0));
    Seen seen = SeenNothing();
    seen = AndPoint(v, seen, middle - x - z);
    seen = AndPoint(v, seen, middle + x - z);
    seen = AndPoint(v, seen, middle - x + z);
    seen = AndPoint(v, seen, middle + x + z);
    return OpenShare(v, seen, asked) == 0.0;
}

#endif
#endif
