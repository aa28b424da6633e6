//! Colour variety: what an agent's tint makes of a body part's colour, and the mean of that over all tints.
//!
//! Pictures show the mean, and an agent's tint multiplies it. A texel where body parts meet, and every mip of it, then mixes
//! what its parts look like on average, and not one part's plain colour under another part's tint.
//!
//! Twin of hlsl/tint.hlsli. A part's `code` is that of [`crate::baked::BodyPart::code`].

use glam::Vec3;

/// Mean of the tints of what stays as it was made, or nearly so.
pub const NATURAL_MEAN: f32 = 0.9;
/// Mean of the tints of cloth, for a colour of lightness 0.75.
pub const CLOTH_MEAN: f32 = 0.487;
/// Skin of the mean tint: a plain part, and a share of the character's own colour.
const SKIN: [Vec3; 2] = [Vec3::new(0.169, 0.095, 0.058), Vec3::new(0.41, 0.37, 0.39)];
/// Hair likewise.
const HAIR: [Vec3; 2] = [Vec3::new(0.128, 0.08, 0.048), Vec3::new(0.3, 0.27, 0.22)];

/// The first code of each rule.
const NATURAL_CODE: u8 = 64;
const CLOTH_CODE: u8 = 128;
const SKIN_CODE: u8 = 192;
const HAIR_CODE: u8 = 224;

/// The mean of a linear colour over all tints.
pub fn mean_of_tints(color: Vec3, code: u8) -> Vec3 {
    match code {
        ..NATURAL_CODE => color,
        NATURAL_CODE..CLOTH_CODE => color * NATURAL_MEAN,
        CLOTH_CODE..SKIN_CODE => {
            Vec3::splat(CLOTH_MEAN * (0.25 + color.dot(Vec3::new(0.3, 0.6, 0.1))))
        }
        SKIN_CODE..HAIR_CODE => SKIN[0] + SKIN[1] * color,
        _ => HAIR[0] + HAIR[1] * color,
    }
}

/// Three numbers from 0 to 1, all below, that make an agent's tints.
pub fn tint_random(tint_seed: u32) -> Vec3 {
    let mut h = tint_seed;
    h = (h ^ h >> 16).wrapping_mul(0x7feb_352d);
    h = (h ^ h >> 15).wrapping_mul(0x846c_a68b);
    h ^= h >> 16;
    let [x, y, z] = [h & 0x3ff, h >> 10 & 0x7ff, h >> 21].map(|n| n as f32);
    Vec3::new(x / 1024.0, y / 2048.0, z / 2048.0)
}

/// An agent's tint of a body part, a factor for [`mean_of_tints`]. Its mean over all agents is 1.
pub fn tint_of(random: Vec3, code: u8) -> Vec3 {
    let r = (random * (f32::from(code) * 13.13 + 3.7)).fract();
    match code {
        ..NATURAL_CODE => Vec3::ONE,
        NATURAL_CODE..SKIN_CODE => {
            // Hue, saturation, value: what is light is pale. The mean of value * (1 - saturation / 2) is 1.
            let ramp = (r.x + Vec3::new(0.0, 2.0 / 3.0, 1.0 / 3.0)).fract() * 6.0 - 3.0;
            let missing = (2.0 - ramp.abs()).clamp(Vec3::ZERO, Vec3::ONE);
            let (saturation, value) = match code {
                ..CLOTH_CODE => (0.1, 0.711 + 0.63 * r.z),
                _ => (0.95 - 0.55 * r.z, 0.2917 + 2.6254 * r.z * r.z),
            };
            value * (1.0 - r.y * saturation * missing)
        }
        SKIN_CODE..HAIR_CODE => {
            let (b, c) = (
                Vec3::new(1.5415, 1.0717, 0.3333),
                Vec3::new(0.0474, 0.8608, 2.0),
            );
            Vec3::new(0.2134, 0.1772, 0.1667) + random.z * (b + random.z * c)
        }
        _ => {
            // Grey against red; whoever has light skin rather has light hair.
            let red = (r.x * 2.0 - 1.0) * (r.x * 2.0 - 1.0).abs();
            let value = (0.25 + 2.25 * r.y * r.y) * (0.1 + 1.8 * random.z);
            value * (1.0 + red * Vec3::new(0.2, -0.12, -0.6))
        }
    }
}

/// How far an agent's tint of a body part is from 1, the mean square: none, little, much.
pub(crate) fn spread(code: u8) -> f32 {
    match code {
        ..NATURAL_CODE => 0.0,
        NATURAL_CODE..CLOTH_CODE => 0.03,
        CLOTH_CODE..SKIN_CODE => 0.5,
        SKIN_CODE..HAIR_CODE => 0.33,
        _ => 0.9,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CODES: [u8; 8] = [0, 5, 64, 77, 128, 139, 192, 224];

    fn tints(code: u8) -> impl Iterator<Item = Vec3> {
        (0..40_000).map(move |seed| tint_of(tint_random(seed), code))
    }

    #[test]
    fn cloth_keeps_the_lightness_of_a_colour_only() {
        let (red, green) = (Vec3::new(0.6, 0.0, 0.0), Vec3::new(0.0, 0.3, 0.0));
        let cloth = 2 << 6 | 5;
        assert!(mean_of_tints(red, cloth).abs_diff_eq(mean_of_tints(green, cloth), 1e-6));
        assert_eq!(mean_of_tints(red, 5), red);
        assert_eq!(mean_of_tints(red, 1 << 6), red * NATURAL_MEAN);
        for code in CODES {
            assert!(code < 64 || mean_of_tints(Vec3::ONE, code).max_element() < 1.0);
        }
    }

    #[test]
    fn the_mean_of_all_tints_is_one() {
        for code in CODES {
            let mean = tints(code).sum::<Vec3>() / 40_000.0;
            assert!(mean.abs_diff_eq(Vec3::ONE, 0.015), "{code}: {mean}");
            let squares: Vec3 = tints(code).map(|t| (t - 1.0) * (t - 1.0)).sum();
            let spread_seen = squares.element_sum() / 120_000.0;
            let rated = spread(code);
            assert!(
                (spread_seen - rated).abs() <= 0.3 * rated,
                "{code}: {spread_seen}"
            );
        }
    }

    #[test]
    fn skin_and_hair_are_of_natural_colours() {
        // A light, a dark and a grey one of the built-in characters.
        let skins = [Vec3::new(0.69, 0.38, 0.23), Vec3::new(0.11, 0.04, 0.02)];
        let hairs = [Vec3::new(0.04, 0.02, 0.01), Vec3::new(0.58, 0.57, 0.53)];
        for (code, own) in skins
            .map(|c| (192, c))
            .into_iter()
            .chain(hairs.map(|c| (224, c)))
        {
            let mean = mean_of_tints(own, code);
            let (mut darkest, mut lightest) = (f32::INFINITY, 0.0f32);
            for tint in tints(code) {
                let c = mean * tint;
                darkest = darkest.min(c.y);
                lightest = lightest.max(c.y);
                // Red over green over blue, but for hair, which may be grey; nothing gaudy.
                let grey = if code == 224 { 1.15 } else { 1.0 };
                assert!(c.y <= grey * c.x && c.z <= grey * c.y, "{code}: {c}");
                assert!(c.x <= 6.0 * c.y && c.min_element() > 0.0, "{code}: {c}");
            }
            assert!(
                lightest > 8.0 * darkest && lightest < 1.3,
                "{code}: {darkest} {lightest}"
            );
        }
        // Hair is one of these: black, brown, blond, red, grey.
        let hair = |t: Vec3| mean_of_tints(hairs[0], 224) * t;
        let has = |is: fn(Vec3) -> bool| tints(224).filter(|&t| is(hair(t))).count() > 400;
        assert!(has(|c| c.x < 0.05), "black");
        assert!(
            has(|c| (0.08..0.2).contains(&c.x) && c.x > 1.3 * c.y),
            "brown"
        );
        assert!(has(|c| c.x > 0.3 && c.x > 1.3 * c.z), "blond");
        assert!(has(|c| c.x > 0.12 && c.x > 2.0 * c.y), "red");
        assert!(has(|c| c.x > 0.1 && c.z > 0.65 * c.x), "grey");
    }
}
