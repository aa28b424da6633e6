// Colour variety, which meshes and impostors share. Twin: bake/src/tint.rs
// A tint multiplies a colour's mean over all tints, which is what impostors' pictures hold: so texels where body parts meet,
// and what filtering makes of them, are right on average. `code` says what a body part's tints follow from: below 64 there are
// none, from 64 on they vary lightness and warmth a little, from 128 on is cloth of any colour, from 192 skin and from 224 hair.

#ifndef THRONG_TINT
#define THRONG_TINT

#include "gpu_types.hlsli"
#include "color.hlsli"

// A colour's mean over all tints.
float3 MeanOfTints(float3 color, float code)
{
    float cloth = TINT_CLOTH_MEAN * (0.25 + dot(color, float3(0.3, 0.6, 0.1)));
    float3 mean = code > 63.5 ? color * TINT_NATURAL_MEAN : color;
    mean = code > 127.5 ? float3(cloth, cloth, cloth) : mean;
    mean = code > 191.5 ? float3(0.169, 0.095, 0.058) + color * float3(0.41, 0.37, 0.39) : mean;
    return code > 223.5 ? float3(0.128, 0.08, 0.048) + color * float3(0.3, 0.27, 0.22) : mean;
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

// Three numbers from 0 to 1 that make an agent's tints.
float3 TintRandom(uint tint_seed)
{
    uint h = Hash(tint_seed);
    return float3(h & 0x3ffu, (h >> 10) & 0x7ffu, h >> 21) * float3(1.0 / 1024.0, 1.0 / 2048.0, 1.0 / 2048.0);
}

// An agent's tint of a body part; its mean over all agents is 1.
float3 TintOf(float3 random, float code)
{
    float3 r = frac(random * (code * 13.13 + 3.7));
    // Hue, saturation, value: what is light is pale.
    float3 missing = saturate(2.0 - abs(frac(r.x + float3(0.0, 2.0 / 3.0, 1.0 / 3.0)) * 6.0 - 3.0));
    bool is_cloth = code > 127.5;
    float saturation = r.y * (is_cloth ? 0.95 - 0.55 * r.z : 0.1);
    float value = is_cloth ? 0.2917 + 2.6254 * r.z * r.z : 0.711 + 0.63 * r.z;
    float3 tint = value - value * saturation * missing;
    // From dark to light through olive and tan.
    float m = random.z;
    float3 skin = float3(0.2134, 0.1772, 0.1667) + m * (float3(1.5415, 1.0717, 0.3333) + m * float3(0.0474, 0.8608, 2.0));
    tint = code > 191.5 ? skin : tint;
    // Grey against red; whoever has light skin rather has light hair.
    float red = r.x * 2.0 - 1.0;
    value = (0.25 + 2.25 * r.y * r.y) * (0.1 + 1.8 * m);
    tint = code > 223.5 ? value + value * red * abs(red) * float3(0.2, -0.12, -0.6) : tint;
    return code > 63.5 ? tint : float3(1.0, 1.0, 1.0);
}

// What an agent's vertex colour, sRGB, becomes, linear.
float3 TintedColor(float3 color, float code, uint tint_seed)
{
    return MeanOfTints(LinearFromSrgb(color), code) * TintOf(TintRandom(tint_seed), code);
}

#endif
