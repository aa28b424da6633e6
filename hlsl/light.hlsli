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

// Colour variety: a tint multiplies a colour's mean over all tints, which is what impostors' pictures hold: so texels where
// body parts meet, and what filtering makes of them, are right on average. Rule 0 leaves the colour, 1 varies lightness and
// warmth a little, 2 dyes it. The numbers are those of bake/src/impostor/tint.rs.
float3 MeanOfTints(float3 color, uint rule)
{
    float dyed = TINT_DYED_MEAN * (0.25 + dot(color, float3(0.3, 0.6, 0.1)));
    return rule == 0u ? color : rule == 1u ? color * TINT_NATURAL_MEAN : float3(dyed, dyed, dyed);
}

// Three numbers from 0 to 1 that make an agent's tints.
float3 TintRandom(uint tint_seed)
{
    uint h = Hash(tint_seed);
    return float3(h & 0x3ffu, (h >> 10) & 0x7ffu, h >> 21) * float3(1.0 / 1024.0, 1.0 / 2048.0, 1.0 / 2048.0);
}

// An agent's tint of a body part; its mean over all agents is 1. `code`: the part in bits 0-5, its rule in bits 6-7.
float3 TintOf(float3 random, float code)
{
    float3 r = frac(random * (code * 13.13 + 3.7));
    bool is_dyed = code > 127.5;
    bool is_natural = code > 63.5;
    float value = is_dyed ? 0.247 + 2.26 * r.z * r.z : is_natural ? 0.693 + 0.614 * r.z : 1.0;
    float strength = is_dyed ? 0.55 : is_natural ? 0.07 : 0.0;
    // Along red against cyan and blue against yellow, of equal lightness; rather muted than not.
    float2 hue = r.xy * 2.0 - 1.0;
    hue *= abs(hue) * strength;
    return value * (1.0 + hue.x * float3(1.0, -0.4, -0.6) + hue.y * float3(-0.3, -0.05, 1.2));
}

#endif
