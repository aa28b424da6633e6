//! Any number of influences a vertex become the four that a part holds.

use std::cmp::Ordering;

use super::surface::Influences;
use crate::character::Character;

/// Writes `joints` and `weights` of every part of `character` from `influences`, one entry a part, joints already as the
/// character counts them.
pub(super) fn reduce(character: &mut Character, influences: &[Influences]) {
    let mut unbound = 0;
    for (part, influences) in character.parts.iter_mut().zip(influences) {
        for v in 0..part.positions.len() {
            let mut sum: Vec<(u32, f32)> = Vec::with_capacity(influences.width);
            for &(joint, weight) in influences.of(v) {
                if weight > 0.0 {
                    match sum.iter_mut().find(|(j, _)| *j == joint) {
                        Some((_, w)) => *w += weight,
                        None => sum.push((joint, weight)),
                    }
                }
            }
            sum.sort_by(|a, b| b.1.partial_cmp(&a.1).unwrap_or(Ordering::Equal));
            sum.truncate(4);
            let total: f32 = sum.iter().map(|x| x.1).sum();
            if total <= 1e-12 || !total.is_finite() {
                unbound += 1;
                sum = vec![(influences.of(v).first().map_or(0, |x| x.0), 1.0)];
            }
            let total: f32 = sum.iter().map(|x| x.1).sum();
            let (mut joints, mut weights) = ([0; 4], [0.0; 4]);
            for (k, (joint, weight)) in sum.into_iter().enumerate() {
                (joints[k], weights[k]) = (joint as u16, weight / total);
            }
            part.joints.push(joints);
            part.weights.push(weights);
        }
    }
    if unbound > 0 {
        character.warnings.push(format!(
            "{unbound} vertices have no weights; they are bound to the first joint of their skin"
        ));
    }
}
