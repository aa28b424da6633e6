//! Samples of the full surface, tracked through all collapses: how far the surface of a level really is from them, and how
//! different it looks there.
//!
//! Every face keeps the samples that it stands for. A collapse hands the samples of the faces around the dying point to the
//! nearest of the faces that take their place, so that its cost is the change of the summed squared distance over all poses:
//! what quadrics estimate, measured.

mod refit;

pub(super) use refit::WedgeFit;

use super::attributes::{WedgeMove, moved};
use super::lanes::{TriangleLanes, Vec3Lanes, read};
use super::looks::{Look, Looks};
use super::surface::{Surface, cross, dot, length, sub};
use super::visibility::visibility;

/// Share of a triangle's area that its centroid stands for; the corners share the rest. Exact for squared distances to a
/// plane.
const CENTROID_SHARE: f32 = 0.75;
/// What a hidden surface counts, against one in full view: it must not come out through what hides it.
const HIDDEN_SHARE: f32 = 0.4;
/// Squared deviation that weighs as much as showing black for white, over the deviation of the level and the character's
/// size. An outline that is off by `d` shows as `d` times its length; wrong colour shows as its area: so what colour is
/// worth in squared distances grows with the level's own deviation.
const LOOKS_LENGTH: f64 = 4.0;
/// Deviation of a level below which looks are worth no less.
const LOOKS_LEAST: f64 = 2e-4;
/// Weight of faces that stand out over the full surface, against samples that the surface is off from.
const OVERHANG_WEIGHT: f64 = 4.0;

#[derive(Clone)]
pub(super) struct Samples {
    looks: Looks,
    /// Share of each face of the full mesh that is seen.
    pub visibility: Vec<f32>,
    /// Points of the full mesh: the first samples stand at them.
    point_count: u32,
    pose_count: usize,
    /// `[sample][3][pose_count]`.
    posed: Vec<f32>,
    /// Area that each sample stands for: for distances, hidden surfaces counting less, and for looks, only the visible.
    weights: Vec<[f32; 2]>,
    /// What the full surface looks like there; none where several wedges meet.
    look: Vec<Option<Look>>,
    /// Body part of the full surface there.
    part: Vec<u8>,
    /// Of the surface as it is: squared distance, squared contrast.
    deviations: Vec<[f32; 2]>,
    /// Samples that each face stands for.
    of_face: Vec<Vec<u32>>,
    /// Of each face: see [`Samples::overhang`].
    overhangs: Vec<f64>,
    trial: Trial,
    /// Sum of weights times deviations over all samples, and of weights.
    total: [f64; 2],
    area: f64,
    /// Squared distance that weighs as much as a contrast of 1.
    look_weight: f64,
}

/// The samples that a collapse concerns, and where they would go.
#[derive(Clone, Default)]
struct Trial {
    samples: Vec<u32>,
    /// Parallel to `samples`.
    best: Vec<Nearest>,
    sums: Vec<f32>,
    deviations: Vec<[f32; 2]>,
    faces: Vec<TrialFace>,
    /// The first of `faces` that the collapse makes; those after them were there before.
    new_faces: usize,
    /// Overhang of the new faces.
    overhangs: Vec<f64>,
}

/// The face that is nearest to a sample, by index into [`Trial::faces`].
#[derive(Clone, Copy)]
struct Nearest {
    /// Squared distance, mean over the poses.
    mean: f32,
    face: u32,
}

/// A face as it would be after a collapse.
#[derive(Clone, Copy)]
struct TrialFace {
    face: u32,
    points: [u32; 3],
    wedges: [u32; 3],
}

impl Samples {
    /// A sample at every point and at the centroid of every face.
    pub fn new(surface: &Surface, looks: Looks) -> Self {
        let n = surface.pose_count;
        let points = surface.faces_of.len();
        let mut s = Self {
            point_count: points as u32,
            pose_count: n,
            posed: Vec::with_capacity((points + surface.faces.len()) * 3 * n),
            weights: vec![[0.0; 2]; points],
            look: Vec::with_capacity(points + surface.faces.len()),
            part: Vec::with_capacity(points + surface.faces.len()),
            deviations: vec![[0.0; 2]; points + surface.faces.len()],
            of_face: Vec::with_capacity(surface.faces.len()),
            overhangs: vec![0.0; surface.faces.len()],
            trial: Trial::default(),
            visibility: visibility(surface),
            looks,
            total: [0.0; 2],
            area: 0.0,
            look_weight: LOOKS_LENGTH * LOOKS_LEAST,
        };
        for p in 0..points as u32 {
            for axis in surface.at(p) {
                s.posed.extend_from_slice(axis);
            }
            let first = surface.wedges_of[p as usize][0];
            s.part.push(surface.mesh.body_parts[first as usize]);
            s.look.push(match surface.wedges_of[p as usize][..] {
                [wedge] => Some(s.looks.of(&surface.mesh, wedge)),
                _ => None,
            });
        }
        for (i, face) in surface.faces.iter().enumerate() {
            let corners = face.points.map(|p| surface.at(p));
            for axis in 0..3 {
                let [a, b, c] = corners.map(|x| x[axis]);
                s.posed
                    .extend((0..n).map(|k| (a[k] + b[k] + c[k]) * (1.0 / 3.0)));
            }
            let hs = HIDDEN_SHARE;
            let weight = [
                surface.areas[i] * (hs + (1.0 - hs) * s.visibility[i]),
                surface.areas[i] * s.visibility[i],
            ];
            for p in face.points {
                for (w, x) in s.weights[p as usize].iter_mut().zip(weight) {
                    *w += x * (1.0 - CENTROID_SHARE) / 3.0;
                }
            }
            s.weights.push(weight.map(|w| w * CENTROID_SHARE));
            s.look
                .push(Some(s.looks.at(&surface.mesh, face.wedges, [1.0 / 3.0; 3])));
            s.part
                .push(surface.mesh.body_parts[face.wedges[0] as usize]);
            s.of_face.push(vec![(points + i) as u32]);
        }
        s.area = s.weights.iter().map(|w| w[0] as f64).sum();
        s
    }

    /// Begins anew with other faces: every sample goes to the nearest of those that live.
    pub fn restart(&mut self, surface: &Surface) {
        self.of_face = vec![Vec::new(); surface.faces.len()];
        self.overhangs = vec![0.0; surface.faces.len()];
        let trial = &mut self.trial;
        trial.samples = (0..self.look.len() as u32).collect();
        trial.faces = (0..surface.faces.len() as u32)
            .filter(|&f| surface.faces[f as usize].alive)
            .map(|face| TrialFace {
                face,
                points: surface.faces[face as usize].points,
                wedges: surface.faces[face as usize].wedges,
            })
            .collect();
        trial.new_faces = 0;
        trial.overhangs.clear();
        let none = Nearest {
            mean: f32::MAX,
            face: u32::MAX,
        };
        trial.best = vec![none; trial.samples.len()];
        for i in 0..self.trial.faces.len() {
            let points = self.trial.faces[i].points;
            self.measure(surface, i as u32, points);
        }
        self.total = [0.0; 2];
        for i in 0..self.trial.samples.len() {
            let new = [self.trial.best[i].mean, self.contrast(surface, i)];
            self.deviations[i] = new;
            let terms = self.weights[i].iter().zip(new);
            for (total, (weight, new)) in self.total.iter_mut().zip(terms) {
                *total += (weight * new) as f64;
            }
            if let Some(face) = self.trial.faces.get(self.trial.best[i].face as usize) {
                self.of_face[face.face as usize].push(i as u32);
            }
        }
    }

    pub fn looks(&self) -> &Looks {
        &self.looks
    }

    /// Change of area times squared deviation if `point` moves onto `target`, its wedges as `moves` say.
    /// [`Samples::commit_collapse`] then does it.
    pub fn try_collapse(
        &mut self,
        surface: &Surface,
        point: u32,
        target: u32,
        moves: &[WedgeMove],
    ) -> f64 {
        let trial = &mut self.trial;
        trial.samples.clear();
        if point < self.point_count {
            trial.samples.push(point);
        }
        trial.faces.clear();
        for &f in &surface.faces_of[point as usize] {
            trial.samples.extend(&self.of_face[f as usize]);
            let face = &surface.faces[f as usize];
            if !face.has(target) {
                trial.faces.push(TrialFace {
                    face: f,
                    points: face.points.map(|p| if p == point { target } else { p }),
                    wedges: face.wedges.map(|w| moved(moves, w)),
                });
            }
        }
        trial.new_faces = trial.faces.len();
        if trial.faces.is_empty() {
            self.faces_nearby(surface, point, target);
        }
        let trial = &mut self.trial;
        trial.best.clear();
        let none = Nearest {
            mean: f32::MAX,
            face: u32::MAX,
        };
        trial.best.resize(trial.samples.len(), none);
        if self.trial.faces.is_empty() {
            // Nothing is left nearby: the piece ends as the point that it vanished onto.
            self.measure(surface, u32::MAX, [target; 3]);
        }
        for i in 0..self.trial.faces.len() {
            let points = self.trial.faces[i].points;
            self.measure(surface, i as u32, points);
        }
        self.weigh(surface) + OVERHANG_WEIGHT * self.overhang(surface, point)
    }

    /// The same if the corners of wedge `from` go to its twin `to`. [`Samples::commit_twin`] then does it.
    pub fn try_twin(&mut self, surface: &Surface, point: u32, from: u32, to: u32) -> f64 {
        let moves = [WedgeMove { from, to: Some(to) }];
        self.stay(surface, point, |wedges| {
            wedges
                .contains(&from)
                .then(|| wedges.map(|w| moved(&moves, w)))
        });
        // Distances stay as they are: only the looks change.
        let mut contrast = 0.0;
        for (i, &sample) in self.trial.samples.iter().enumerate() {
            let after = self.contrast(surface, i);
            let before = self.deviations[sample as usize][1];
            contrast += (self.weights[sample as usize][1] * (after - before)) as f64;
        }
        self.look_weight * contrast
    }

    /// Cost of the trial: every sample goes to its nearest face.
    fn weigh(&mut self, surface: &Surface) -> f64 {
        let mut cost = 0.0;
        self.trial.deviations.clear();
        for i in 0..self.trial.samples.len() {
            let sample = self.trial.samples[i] as usize;
            let nearest = self.trial.best[i];
            let new = [nearest.mean, self.contrast(surface, i)];
            let old = self.deviations[sample];
            self.trial.deviations.push(new);
            let [place, look] = self.weights[sample];
            cost += (place * (new[0] - old[0])) as f64;
            cost += self.look_weight * (look * (new[1] - old[1])) as f64;
        }
        cost
    }

    /// Squared contrast of sample `i` of the trial with its nearest face.
    fn contrast(&self, surface: &Surface, i: usize) -> f32 {
        let sample = self.trial.samples[i] as usize;
        let Some(look) = &self.look[sample] else {
            return 0.0;
        };
        let Some(face) = self.trial.faces.get(self.trial.best[i].face as usize) else {
            // Nothing is left to look at.
            return 1.0;
        };
        let n = self.pose_count;
        let at = [0, 1, 2].map(|axis| self.posed[(sample * 3 + axis) * n]);
        let corners = face.points.map(|p| surface.at(p).map(|x| x[0]));
        let there = self
            .looks
            .at(&surface.mesh, face.wedges, nearest_barycentric(at, corners));
        look.contrast_squared(&there)
    }

    /// Offers the triangle of `points` to all samples of the trial as face `face`.
    fn measure(&mut self, surface: &Surface, face: u32, points: [u32; 3]) {
        let n = self.pose_count;
        let trial = &mut self.trial;
        trial.sums.clear();
        trial.sums.resize(trial.samples.len(), 0.0);
        for group in 0..surface.group_count {
            let [a, b, c] = points.map(|p| Vec3Lanes::read(surface.posed_of(p), n, group));
            let triangle = TriangleLanes::new(a, b, c);
            let weights = read(&surface.pose_weights, group);
            for (&sample, sum) in trial.samples.iter().zip(&mut trial.sums) {
                let p = &self.posed[sample as usize * 3 * n..][..3 * n];
                let d = triangle.distance_squared(Vec3Lanes::read(p, n, group));
                *sum += d.dot(weights);
            }
        }
        for (&mean, best) in trial.sums.iter().zip(&mut trial.best) {
            if mean < best.mean {
                *best = Nearest { mean, face };
            }
        }
    }

    /// How much farther the new faces stand out over the full surface than those around `point` do: area times squared
    /// distance from each one's centroid to the nearest sample, first pose. Distances within the samples' spacing do not
    /// count.
    fn overhang(&mut self, surface: &Surface, point: u32) -> f64 {
        let n = self.pose_count;
        let trial = &mut self.trial;
        trial.overhangs.clear();
        for face in &trial.faces[..trial.new_faces] {
            let [a, b, c] = face.points.map(|p| surface.at(p).map(|x| x[0]));
            let area = 0.5 * length(cross(sub(b, a), sub(c, a)));
            let center = [0, 1, 2].map(|i| (a[i] + b[i] + c[i]) * (1.0 / 3.0));
            let mut least = f32::MAX;
            for &sample in &trial.samples {
                let sample = sample as usize;
                let at = [0, 1, 2].map(|axis| self.posed[(sample * 3 + axis) * n]);
                let gap = sub(at, center);
                least = least.min(dot(gap, gap) - self.weights[sample][0]);
            }
            trial.overhangs.push((area * least.max(0.0)) as f64);
        }
        let faces = surface.faces_of[point as usize].iter();
        let before: f64 = faces.map(|&f| self.overhangs[f as usize]).sum();
        trial.overhangs.iter().sum::<f64>() - before
    }

    /// The faces that samples fall back to where a collapse leaves none of the faces around a point.
    fn faces_nearby(&mut self, surface: &Surface, point: u32, target: u32) {
        let around = std::iter::once(&target)
            .chain(&surface.links[point as usize])
            .chain(&surface.links[target as usize])
            .flat_map(|&p| &surface.faces_of[p as usize]);
        for &f in around {
            let face = &surface.faces[f as usize];
            let faces = &mut self.trial.faces;
            if !face.has(point) && !faces.iter().any(|x| x.face == f) {
                faces.push(TrialFace {
                    face: f,
                    points: face.points,
                    wedges: face.wedges,
                });
            }
        }
    }

    /// Carries out what [`Samples::try_collapse`] was last asked for.
    pub fn commit_collapse(&mut self, surface: &Surface, point: u32) {
        for &f in &surface.faces_of[point as usize] {
            self.of_face[f as usize].clear();
        }
        let trial = &self.trial;
        for (face, &overhang) in trial.faces.iter().zip(&trial.overhangs) {
            self.overhangs[face.face as usize] = overhang;
        }
        for (i, &sample) in trial.samples.iter().enumerate() {
            let (old, new) = (self.deviations[sample as usize], trial.deviations[i]);
            for k in 0..2 {
                self.total[k] += (self.weights[sample as usize][k] * (new[k] - old[k])) as f64;
            }
            self.deviations[sample as usize] = new;
            if let Some(face) = trial.faces.get(trial.best[i].face as usize) {
                self.of_face[face.face as usize].push(sample);
            }
        }
        let level = (self.total[0].max(0.0) / self.area.max(f64::MIN_POSITIVE)).sqrt();
        let look_weight = LOOKS_LENGTH * level;
        self.look_weight = self.look_weight.max(look_weight);
    }

    /// Root mean square deviation of the surface as it is, distances and looks.
    pub fn deviation(&self) -> f64 {
        let sum = self.total[0] + self.look_weight * self.total[1];
        (sum.max(0.0) / self.area.max(f64::MIN_POSITIVE)).sqrt()
    }

    /// Squared distance that weighs as much as a contrast of 1, at this level.
    pub fn look_weight(&self) -> f64 {
        self.look_weight
    }

    /// Makes a trial in which the faces around `point` stay where they are, with the wedges that `wedges` gives each; those it
    /// gives none are no part of it.
    fn stay(
        &mut self,
        surface: &Surface,
        point: u32,
        wedges: impl Fn([u32; 3]) -> Option<[u32; 3]>,
    ) {
        let trial = &mut self.trial;
        trial.samples.clear();
        trial.faces.clear();
        trial.best.clear();
        for &f in &surface.faces_of[point as usize] {
            let face = &surface.faces[f as usize];
            let Some(wedges) = wedges(face.wedges) else {
                continue;
            };
            trial.samples.extend(&self.of_face[f as usize]);
            let here = Nearest {
                mean: 0.0,
                face: trial.faces.len() as u32,
            };
            trial.best.resize(trial.samples.len(), here);
            trial.faces.push(TrialFace {
                face: f,
                points: face.points,
                wedges,
            });
        }
    }

    /// Carries out what [`Samples::try_twin`] was last asked for.
    pub fn commit_twin(&mut self, surface: &Surface) {
        for i in 0..self.trial.samples.len() {
            let after = self.contrast(surface, i);
            let sample = self.trial.samples[i] as usize;
            let change = after - self.deviations[sample][1];
            self.deviations[sample][1] = after;
            self.total[1] += (self.weights[sample][1] * change) as f64;
        }
    }
}

/// Barycentric coordinates of the point of a triangle that is nearest to `p` (Ericson 2005, §5.1.5).
fn nearest_barycentric(p: [f32; 3], [a, b, c]: [[f32; 3]; 3]) -> [f32; 3] {
    let (ab, ac, ap) = (sub(b, a), sub(c, a), sub(p, a));
    let (d1, d2) = (dot(ab, ap), dot(ac, ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let bp = sub(p, b);
    let (d3, d4) = (dot(ab, bp), dot(ac, bp));
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let v = d1 / (d1 - d3).max(f32::MIN_POSITIVE);
        return [1.0 - v, v, 0.0];
    }
    let cp = sub(p, c);
    let (d5, d6) = (dot(ab, cp), dot(ac, cp));
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let w = d2 / (d2 - d6).max(f32::MIN_POSITIVE);
        return [1.0 - w, 0.0, w];
    }
    let va = d3 * d6 - d5 * d4;
    let (along, across) = (d4 - d3, d5 - d6);
    if va <= 0.0 && along >= 0.0 && across >= 0.0 {
        let w = along / (along + across).max(f32::MIN_POSITIVE);
        return [0.0, 1.0 - w, w];
    }
    let sum = va + vb + vc;
    if sum > 0.0 {
        let (v, w) = (vb / sum, vc / sum);
        [1.0 - v - w, v, w]
    } else {
        [1.0, 0.0, 0.0]
    }
}
