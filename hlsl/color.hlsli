// Colour spaces and the light that crowd, ground and sky share.

#ifndef THRONG_COLOR
#define THRONG_COLOR

// sRGB to linear, within 0.002.
float3 LinearFromSrgb(float3 c)
{
    return c * (c * (c * 0.305306011 + 0.682171111) + 0.012522878);
}

// Linear to sRGB, within 0.0022 from 0.002 on and 0.0074 below, without a power and with one root; clamps to [0, 1].
float3 SrgbFromLinear(float3 c)
{
    float3 s = sqrt(saturate(c));
    return saturate(s * (s * (s * 0.20294262 - 0.52476281) + 1.35378716) - 0.03196697);
}

// Share of the haze at a distance.
float HazeShare(float distance, float haze_per_metre)
{
    float x = distance * haze_per_metre;
    return x / (1.0 + x);
}

#endif
