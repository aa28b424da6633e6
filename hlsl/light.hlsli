// The crowd's light, which meshes and impostors share.

#ifndef THRONG_LIGHT
#define THRONG_LIGHT

// Linear colours of what shines.
struct Light
{
    float3 sun;
    float3 sky;
    float3 ground;
};

// Sun with a slight wrap, sky and ground by the normal's height, a rim of sky, darker near the ground.
// In: the normal's cosines to the sun, to world +Y and to the eye.
float3 LightOn(Light light, float to_sun, float to_sky, float to_eye, float openness)
{
    float sun = saturate(to_sun * 0.85 + 0.15);
    float3 hemisphere = lerp(light.ground, light.sky, to_sky * 0.5 + 0.5);
    float rim = 1.0 - saturate(to_eye);
    rim *= rim;
    return light.sun * sun + (hemisphere + light.sky * (0.35 * rim * rim)) * openness;
}

// Share of the sky that reaches a point this many metres above its agent's ground.
float Openness(float height)
{
    return 0.5 + 0.5 * saturate(height * 1.2);
}

#endif
