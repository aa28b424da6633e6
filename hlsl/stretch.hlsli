// How perspective stretches what is off the view's axis: by 1 over the cosine of the angle across the direction from the
// picture's middle, and by 1 over its square along it. Twin: `stretch_share` of src/reference/select.rs

// The share of its distance at which a place at the picture's middle would be as large in it; 1 within FREE_STRETCH.
float StretchShare(float3 place)
{
    float3 to_place = place - frame.eye;
    float depth = max(dot(frame.clip_from_world[3].xyz, to_place), 0.0);
    float share = FREE_STRETCH * depth * depth / max(dot(to_place, to_place), 1e-12);
    return clamp(share, frame.stretch_share_min, 1.0);
}
