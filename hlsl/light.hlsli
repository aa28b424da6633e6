// The crowd's light and colour variety, which meshes and impostors share. Reads the constant buffer `frame`.

#ifndef THRONG_LIGHT
#define THRONG_LIGHT

// Sun with a slight wrap, sky and ground by the normal's height, a rim of sky, darker near the ground.
// In: the normal's cosines to the sun, to world +Y and to the eye.
float3 LightOn(float to_sun, float to_sky, float to_eye, float openness)
{
    float sun = saturate(to_sun * 0.85 + 0.15);
    float3 hemisphere = lerp(frame.ground, frame.sky, to_sky * 0.5 + 0.5);
    float rim = 1.0 - saturate(to_eye);
    rim *= rim;
    return frame.sun * sun + (hemisphere + frame.sky * (0.35 * rim * rim)) * openness;
}

// Share of the sky that reaches a point this many metres above its agent's ground.
float Openness(float height)
{
    return 0.5 + 0.5 * saturate(height * 1.2);
}

uint Hash(uint x)
{
    x ^= x >> 16;
    x *= 0x7feb352du;
    x ^= x >> 15;
    x *= 0x846ca68bu;
    x ^= x >> 16;
    return x;
}

// Colour variety; `tint` is the hash of the agent's seed. Rule 0 leaves the colour, 1 varies lightness and warmth a little,
// 2 dyes it. What depends on the part is cheap enough for every pixel of an impostor.
float3 TintedColor(float3 color, uint tint, uint body_part, uint rule)
{
    uint h = (tint ^ (body_part * 0x9e3779b9u)) * 0x846ca68bu;
    h ^= h >> 15;
    float3 r = float3(h & 0x3ffu, (h >> 10) & 0x3ffu, h >> 20) * float3(1.0 / 1023.0, 1.0 / 1023.0, 1.0 / 4095.0);
    float3 natural = color * (0.62 + 0.55 * r.x) * float3(1.04, 1.0, 0.9 + 0.14 * r.y);
    float3 hue = saturate(abs(frac(r.x + float3(0.0, 2.0 / 3.0, 1.0 / 3.0)) * 6.0 - 3.0) - 1.0);
    float3 dye = lerp(float3(1.0, 1.0, 1.0), hue, 0.15 + 0.6 * r.y * r.y) * (0.12 + 1.1 * r.z * r.z);
    float3 dyed = dye * (0.25 + dot(color, float3(0.3, 0.6, 0.1)));
    return rule == 0u ? color : rule == 1u ? natural : dyed;
}

#endif
