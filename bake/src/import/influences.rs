//! Any number of influences a vertex become the four that a part holds.

use glam::{Affine3A, Vec3};

use super::surface::Influences;
use crate::character::Character;
use crate::pose;

/// Influences that a part holds.
const KEPT: usize = 4;
/// Influences of a vertex among which the kept ones are chosen, by falling weight.
const MAX_CANDIDATES: usize = 12;
/// Poses in which a vertex with too many influences is kept near its place.
const POSE_COUNT: usize = 24;
/// Pull towards the file's own weights, as a share of the mean square distance at stake: poses that no clip shows should
/// not suffer for those that one does.
const PULL: f64 = 1e-3;

/// Writes `joints` and `weights` of every part of `character` from `influences`, one entry a part, joints already as the
/// character counts them.
///
/// Influences of one joint are summed. Where more than four remain, four are chosen and their weights fitted (least
/// squares, not negative, sum 1) so that the vertex stays near its place in poses sampled from the clips; a warning
/// says how far it moves.
pub(super) fn reduce(character: &mut Character, influences: &[Influences]) {
    let mut fit = Fit::default();
    let mut unbound_count = 0;
    let mut parts = std::mem::take(&mut character.parts);
    for (part, influences) in parts.iter_mut().zip(influences) {
        part.joints.reserve_exact(part.positions.len());
        part.weights.reserve_exact(part.positions.len());
        for (v, &position) in part.positions.iter().enumerate() {
            let mut own = merged(influences.of(v));
            if own.is_empty() {
                unbound_count += 1;
                own.push((influences.of(v).first().map_or(0, |x| x.0), 1.0));
            }
            if own.len() > KEPT {
                own = fit.reduce(character, own, position);
            }
            let (mut joints, mut weights) = ([0; KEPT], [0.0; KEPT]);
            for (k, (joint, weight)) in own.into_iter().enumerate() {
                (joints[k], weights[k]) = (joint as u16, weight as f32);
            }
            part.joints.push(joints);
            part.weights.push(weights);
        }
    }
    character.parts = parts;
    if unbound_count > 0 {
        character.warnings.push(format!(
            "{unbound_count} vertices have no weights; they are bound to the first joint of their skin"
        ));
    }
    if fit.vertex_count > 0 {
        let rms = |sum: f64| (sum / (fit.vertex_count * fit.poses.len()) as f64).sqrt();
        character.warnings.push(format!(
            "{} vertices have more than {KEPT} influences; the {KEPT} kept move them by at most {:.2e} (RMS {:.2e}) in the \
             clips' poses, where the largest weights alone would by {:.2e} (RMS {:.2e})",
            fit.vertex_count,
            fit.after.max,
            rms(fit.after.square_sum),
            fit.before.max,
            rms(fit.before.square_sum),
        ));
    }
}

/// The influences that count, one a joint, by falling weight; they sum to 1.
fn merged(influences: &[(u32, f32)]) -> Vec<(u32, f64)> {
    let mut own: Vec<(u32, f64)> = Vec::with_capacity(influences.len());
    for &(joint, weight) in influences.iter().filter(|x| x.1 > 0.0) {
        match own.iter_mut().find(|x| x.0 == joint) {
            Some(known) => known.1 += f64::from(weight),
            None => own.push((joint, f64::from(weight))),
        }
    }
    normalize(&mut own);
    own
}

/// Sorts by falling weight, drops what cannot be told from zero, and scales the rest to sum to 1.
fn normalize(influences: &mut Vec<(u32, f64)>) {
    influences.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    let sum: f64 = influences.iter().map(|x| x.1).sum();
    influences.retain(|x| x.1 > 1e-7 * sum);
    let sum: f64 = influences.iter().map(|x| x.1).sum();
    for (_, weight) in influences {
        *weight /= sum;
    }
}

/// Chooses four influences of vertices that have more.
#[derive(Default)]
struct Fit {
    /// Palettes of the sampled poses; made when the first vertex needs them.
    poses: Vec<Vec<Affine3A>>,
    vertex_count: usize,
    before: Moved,
    after: Moved,
}

/// How far vertices move over all poses.
#[derive(Default)]
struct Moved {
    max: f64,
    square_sum: f64,
}

impl Fit {
    fn reduce(
        &mut self,
        character: &Character,
        all: Vec<(u32, f64)>,
        position: Vec3,
    ) -> Vec<(u32, f64)> {
        if self.poses.is_empty() {
            self.poses = sample_poses(character);
        }
        self.vertex_count += 1;
        // Where each influence alone would put the vertex, relative to where it belongs: [pose][influence].
        let offsets: Vec<Vec<[f64; 3]>> = self
            .poses
            .iter()
            .map(|palette| {
                let alone = |&(j, _): &(u32, f64)| {
                    palette[j as usize].transform_point3(position).to_array()
                };
                let mut points: Vec<[f64; 3]> =
                    all.iter().map(|x| alone(x).map(f64::from)).collect();
                let mut place = [0.0; 3];
                for (point, (_, weight)) in points.iter().zip(&all) {
                    for axis in 0..3 {
                        place[axis] += weight * point[axis];
                    }
                }
                for point in &mut points {
                    for axis in 0..3 {
                        point[axis] -= place[axis];
                    }
                }
                points
            })
            .collect();
        let count = all.len().min(MAX_CANDIDATES);
        let gram: Vec<Vec<f64>> = (0..count)
            .map(|i| {
                let entry = |j: usize| offsets.iter().map(|o| dot(o[i], o[j])).sum::<f64>();
                (0..count).map(entry).collect()
            })
            .collect();
        let moved = |kept: &[(usize, f64)], to: &mut Moved| {
            for pose in &offsets {
                let mut offset = [0.0; 3];
                for &(i, weight) in kept {
                    for axis in 0..3 {
                        offset[axis] += weight * pose[i][axis];
                    }
                }
                let square = dot(offset, offset);
                to.max = to.max.max(square.sqrt());
                to.square_sum += square;
            }
        };
        let heaviest: f64 = all[..KEPT].iter().map(|x| x.1).sum();
        let largest: Vec<(usize, f64)> = (0..KEPT).map(|i| (i, all[i].1 / heaviest)).collect();
        moved(&largest, &mut self.before);
        let prior: Vec<f64> = all[..count].iter().map(|x| x.1).collect();
        let chosen = choose(&gram, &prior).unwrap_or(largest);
        moved(&chosen, &mut self.after);
        let mut kept = chosen.iter().map(|&(i, w)| (all[i].0, w)).collect();
        normalize(&mut kept);
        kept
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The rest pose, and poses at even distances through the clips one after another.
fn sample_poses(character: &Character) -> Vec<Vec<Affine3A>> {
    let mut poses = vec![pose::palette(character, None, 0.0)];
    let total_s: f32 = character.clips.iter().map(|c| c.duration_s).sum();
    if !(total_s > 0.0 && total_s.is_finite()) {
        return poses;
    }
    for k in 0..POSE_COUNT {
        let mut time_s = total_s * (k as f32 + 0.5) / POSE_COUNT as f32;
        for clip in &character.clips {
            if time_s < clip.duration_s {
                poses.push(pose::palette(character, Some(clip), time_s));
                break;
            }
            time_s -= clip.duration_s;
        }
    }
    poses
}

/// The influences to keep, at most four, with their weights: starting from all, the one whose loss costs least goes, until
/// four are left. `gram[i][j]` sums, over the poses, the products of the offsets of influences i and j; `prior` are the
/// file's weights. `None` where the numbers overflow.
fn choose(gram: &[Vec<f64>], prior: &[f64]) -> Option<Vec<(usize, f64)>> {
    let count = prior.len();
    let mean = (0..count).map(|i| gram[i][i]).sum::<f64>() / count as f64;
    let pull = if mean > 0.0 { PULL * mean } else { 1.0 };
    let mut kept: Vec<usize> = (0..count).collect();
    let mut best = None;
    while kept.len() > KEPT {
        let without = |i: usize| {
            let rest: Vec<usize> = kept.iter().copied().filter(|&k| k != i).collect();
            fit(gram, prior, pull, rest)
        };
        let (cost, weights) = kept
            .iter()
            .filter_map(|&i| without(i))
            .min_by(|a, b| a.0.total_cmp(&b.0))?;
        if !cost.is_finite() {
            return None;
        }
        kept = weights.iter().map(|x| x.0).collect();
        best = Some(weights);
    }
    best
}

/// The weights of the influences `kept` that cost least, and what they cost; an influence whose weight would be negative
/// is dropped.
fn fit(
    gram: &[Vec<f64>],
    prior: &[f64],
    pull: f64,
    mut kept: Vec<usize>,
) -> Option<(f64, Vec<(usize, f64)>)> {
    loop {
        let n = kept.len();
        let prior_sum: f64 = kept.iter().map(|&i| prior[i]).sum();
        let target: Vec<f64> = kept.iter().map(|&i| prior[i] / prior_sum).collect();
        let matrix: Vec<Vec<f64>> = (0..n)
            .map(|a| {
                let entry = |b: usize| gram[kept[a]][kept[b]] + if a == b { pull } else { 0.0 };
                (0..n).map(entry).collect()
            })
            .collect();
        // Least squares under "sum is 1": the free solution plus a multiple of the one for equal right sides.
        let pulled: Vec<f64> = target.iter().map(|t| pull * t).collect();
        let free = solve(&matrix, &pulled)?;
        let ones = solve(&matrix, &vec![1.0; n])?;
        let multiple = (1.0 - free.iter().sum::<f64>()) / ones.iter().sum::<f64>();
        let weights: Vec<f64> = (0..n).map(|a| free[a] + multiple * ones[a]).collect();
        let lowest = (0..n).min_by(|&a, &b| weights[a].total_cmp(&weights[b]))?;
        if weights[lowest] < 0.0 && n > 1 {
            kept.remove(lowest);
            continue;
        }
        let mut cost = 0.0;
        for a in 0..n {
            cost += pull * (weights[a] - target[a]).powi(2);
            for b in 0..n {
                cost += weights[a] * weights[b] * gram[kept[a]][kept[b]];
            }
        }
        return Some((cost, kept.into_iter().zip(weights).collect()));
    }
}

/// Solves `matrix * x = right` for a symmetric positive definite matrix (Cholesky). `None` where it is not.
fn solve(matrix: &[Vec<f64>], right: &[f64]) -> Option<Vec<f64>> {
    let n = right.len();
    let mut lower = vec![vec![0.0; n]; n];
    let mut x = vec![0.0; n];
    for i in 0..n {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| lower[i][k] * lower[j][k]).sum();
            let rest = matrix[i][j] - sum;
            lower[i][j] = if i == j {
                Some(rest.sqrt()).filter(|d| d.is_finite() && *d > 0.0)?
            } else {
                rest / lower[j][j]
            };
        }
        let sum: f64 = (0..i).map(|k| lower[i][k] * x[k]).sum();
        x[i] = (right[i] - sum) / lower[i][i];
    }
    for i in (0..n).rev() {
        let sum: f64 = (i + 1..n).map(|k| lower[k][i] * x[k]).sum();
        x[i] = (x[i] - sum) / lower[i][i];
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn joints_named_twice_are_summed_and_sorted() {
        let own = merged(&[(3, 0.25), (1, 0.5), (3, 0.5), (9, 0.0)]);
        assert_eq!(own, [(3, 0.6), (1, 0.4)]);
    }

    #[test]
    fn an_influence_that_moves_like_another_gives_it_its_weight() {
        // Influences 0 and 4 always agree (rows and columns are equal); the others differ from all.
        let offsets = [
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
            [-1.0, -1.0, 0.5],
            [1.0, 0.0, 0.0],
        ];
        let prior = [0.3, 0.2, 0.2, 0.2, 0.1];
        let mut place = [0.0; 3];
        for (o, w) in offsets.iter().zip(prior) {
            for axis in 0..3 {
                place[axis] += w * o[axis];
            }
        }
        let offsets = offsets.map(|o| [o[0] - place[0], o[1] - place[1], o[2] - place[2]]);
        let gram: Vec<Vec<f64>> = offsets
            .iter()
            .map(|&a| offsets.iter().map(|&b| dot(a, b)).collect())
            .collect();
        let chosen = choose(&gram, &prior).unwrap();
        let kept: HashSet<usize> = chosen.iter().map(|x| x.0).collect();
        assert_eq!(kept, HashSet::from([0, 1, 2, 3]));
        let of = |i: usize| chosen.iter().find(|x| x.0 == i).unwrap().1;
        assert!((of(0) - 0.4).abs() < 1e-2, "{chosen:?}");
        assert!((chosen.iter().map(|x| x.1).sum::<f64>() - 1.0).abs() < 1e-12);
    }
}
