//! The mean of a colour over all tints that agents may give it: what pictures show.
//!
//! Twin of `MeanOfTints` in hlsl/light.hlsli. An agent's tint multiplies it. A texel where body parts meet, and every mip of
//! it, then mixes what its parts look like on average, and not one part's plain colour under another part's dye.

use glam::Vec3;

/// Mean of the tints of skin and hair.
pub const NATURAL_MEAN: f32 = 0.9;
/// Mean of the dyes, for a colour of lightness 0.75.
pub const DYED_MEAN: f32 = 0.487;

/// The mean of a linear colour over all tints. `part` is a body part with its rule in bits 6-7, as surfaces have it.
pub(super) fn mean_of_tints(color: Vec3, part: u8) -> Vec3 {
    match part >> 6 {
        0 => color,
        1 => color * NATURAL_MEAN,
        _ => Vec3::splat(DYED_MEAN * (0.25 + color.dot(Vec3::new(0.3, 0.6, 0.1)))),
    }
}

/// How far an agent's tint of a body part is from 1, the mean square: none, little, much.
pub(super) fn spread(part: u8) -> f32 {
    match part >> 6 {
        0 => 0.0,
        1 => 0.03,
        _ => 0.5,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dyes_keep_the_lightness_of_a_colour_only() {
        let (red, green) = (Vec3::new(0.6, 0.0, 0.0), Vec3::new(0.0, 0.3, 0.0));
        let dyed = 2 << 6 | 5;
        assert!(mean_of_tints(red, dyed).abs_diff_eq(mean_of_tints(green, dyed), 1e-6));
        assert_eq!(mean_of_tints(red, 5), red);
        assert_eq!(mean_of_tints(red, 1 << 6), red * NATURAL_MEAN);
        assert!(mean_of_tints(Vec3::ONE, dyed).max_element() < 1.0);
    }
}
