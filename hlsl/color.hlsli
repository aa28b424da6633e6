// Colour spaces and the light that crowd, ground and sky share.

#ifndef THRONG_COLOR
#define THRONG_COLOR

// sRGB to linear, within 0.002.
float3 LinearFromSrgb(float3 c)
{
    return c * (c * (c * 0.305306011 + 0.682171111) + 0.012522878);
}

// Linear to sRGB, within 0.003 and without a power; clamps to [0, 1].
float3 SrgbFromLinear(float3 c)
{
    c = saturate(c);
    float3 s1 = sqrt(c);
    float3 s2 = sqrt(s1);
    float3 s3 = sqrt(s2);
    return saturate(0.662002687 * s1 + 0.684122060 * s2 - 0.323583601 * s3 - 0.0225411470 * c);
}

// Share of the haze at a distance.
float HazeShare(float distance, float haze_per_metre)
{
    float x = distance * haze_per_metre;
    return x / (1.0 + x);
}

#endif
