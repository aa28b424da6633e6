//! The 28-byte vertex: encoding and its exact inverse.

use glam::{Vec2, Vec3};

use crate::baked::Vertex;

const WEIGHT_STEPS: [f32; 3] = [2047.0 * 2.0, 2047.0 * 3.0, 1023.0 * 4.0];
const WEIGHT_SHIFTS: [u32; 3] = [0, 11, 22];
const WEIGHT_MAX: [u32; 3] = [2047, 2047, 1023];

/// Fraction of `extent` above `min` in 65,535 steps, per axis; an axis without extent becomes 0.
pub fn encode_unorm16(value: f32, min: f32, extent: f32) -> u16 {
    if extent > 0.0 {
        (((value - min) / extent).clamp(0.0, 1.0) * 65535.0).round() as u16
    } else {
        0
    }
}

/// Inverse of [`encode_unorm16`], to half a step.
pub fn decode_unorm16(step: u16, min: f32, extent: f32) -> f32 {
    min + extent * (step as f32 / 65535.0)
}

/// Position of `vertex` in bind space.
pub fn decode_position(vertex: &Vertex, min: Vec3, extent: Vec3) -> Vec3 {
    let [x, y, z] = vertex.position;
    min + extent * (Vec3::new(x as f32, y as f32, z as f32) / 65535.0)
}

/// Texture coordinate of `vertex`.
pub fn decode_uv(vertex: &Vertex, min: Vec2, extent: Vec2) -> Vec2 {
    min + extent * (Vec2::new(vertex.uv[0] as f32, vertex.uv[1] as f32) / 65535.0)
}

/// A unit normal on the octahedron: two signed 16-bit fractions (Meyer et al. 2010).
pub fn encode_normal(n: Vec3) -> [i16; 2] {
    let sum = n.x.abs() + n.y.abs() + n.z.abs();
    if sum == 0.0 || !sum.is_finite() {
        return [0, 0];
    }
    let mut p = Vec2::new(n.x, n.y) / sum;
    if n.z < 0.0 {
        p = (Vec2::ONE - Vec2::new(p.y, p.x).abs()) * sign(p);
    }
    [
        (p.x.clamp(-1.0, 1.0) * 32767.0).round() as i16,
        (p.y.clamp(-1.0, 1.0) * 32767.0).round() as i16,
    ]
}

/// Inverse of [`encode_normal`]; unit length.
pub fn decode_normal(e: [i16; 2]) -> Vec3 {
    let p = Vec2::new(e[0] as f32, e[1] as f32) / 32767.0;
    let z = 1.0 - p.x.abs() - p.y.abs();
    let xy = if z < 0.0 {
        (Vec2::ONE - Vec2::new(p.y, p.x).abs()) * sign(p)
    } else {
        p
    };
    Vec3::new(xy.x, xy.y, z).normalize_or(Vec3::Z)
}

/// -1 or 1 per component, 1 for zero.
fn sign(p: Vec2) -> Vec2 {
    Vec2::new(
        if p.x < 0.0 { -1.0 } else { 1.0 },
        if p.y < 0.0 { -1.0 } else { 1.0 },
    )
}

/// Packs influences, sorted by falling weight here, as [`Vertex::joints`] and [`Vertex::weights`].
///
/// Falling order bounds weight 1 by 1/2, weight 2 by 1/3 and weight 3 by 1/4, so 32 bits hold all three to 1/4000.
pub fn encode_influences(joints: [u8; 4], weights: [f32; 4]) -> ([u8; 4], u32) {
    let mut order = [0, 1, 2, 3];
    order.sort_by(|&a, &b| weights[b].total_cmp(&weights[a]));
    let sum: f32 = weights.iter().sum();
    let scale = if sum > 0.0 { 1.0 / sum } else { 0.0 };
    let mut bits = 0;
    let mut packed = [joints[order[0]]; 4];
    for i in 0..3 {
        let weight = weights[order[i + 1]] * scale;
        let step = ((weight * WEIGHT_STEPS[i]).round() as u32).min(WEIGHT_MAX[i]);
        bits |= step << WEIGHT_SHIFTS[i];
        // A weight that rounds to nothing keeps the first joint: every joint read is then one that counts.
        if step > 0 {
            packed[i + 1] = joints[order[i + 1]];
        }
    }
    (packed, bits)
}

/// Inverse of [`encode_influences`]: weights that sum to 1.
pub fn decode_weights(bits: u32) -> [f32; 4] {
    let w =
        [0, 1, 2].map(|i| ((bits >> WEIGHT_SHIFTS[i]) & WEIGHT_MAX[i]) as f32 / WEIGHT_STEPS[i]);
    [1.0 - w[0] - w[1] - w[2], w[0], w[1], w[2]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_come_back_to_a_four_thousandth_and_sum_to_one() {
        let mut state = 1u32;
        for _ in 0..2000 {
            let mut w = [0.0f32; 4];
            for x in &mut w {
                state = state.wrapping_mul(747796405).wrapping_add(2891336453);
                *x = (state >> 8) as f32 / (1 << 24) as f32;
            }
            let sum: f32 = w.iter().sum();
            let w = w.map(|x| x / sum);
            let (joints, bits) = encode_influences([10, 11, 12, 13], w);
            let back = decode_weights(bits);
            assert!((back.iter().sum::<f32>() - 1.0).abs() < 1e-6);
            for (i, &x) in w.iter().enumerate() {
                let at: f32 = (0..4)
                    .filter(|&k| joints[k] == 10 + i as u8)
                    .map(|k| back[k])
                    .sum();
                assert!((at - x).abs() < 6e-4, "{w:?} became {back:?}");
            }
        }
    }

    #[test]
    fn normals_come_back_to_a_ten_thousandth() {
        for i in 0..1000 {
            let t = i as f32 * 2.399;
            let z = 1.0 - 2.0 * (i as f32 + 0.5) / 1000.0;
            let r = (1.0 - z * z).sqrt();
            let n = Vec3::new(r * t.cos(), r * t.sin(), z);
            let back = decode_normal(encode_normal(n));
            assert!(n.cross(back).length() < 1e-4, "{n} became {back}");
        }
    }

    #[test]
    fn one_influence_needs_one_joint() {
        assert_eq!(
            encode_influences([7, 3, 2, 1], [1.0, 0.0, 0.0, 0.0]),
            ([7; 4], 0)
        );
        assert_eq!(decode_weights(0), [1.0, 0.0, 0.0, 0.0]);
    }
}
