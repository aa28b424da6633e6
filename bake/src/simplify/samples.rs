//! Samples of the full surface, tracked through all collapses: how far the surface of a level really is from them.
//!
//! Every face keeps the samples that it stands for. A collapse hands the samples of the faces around the dying point to the
//! nearest of the faces that take their place, so that its cost is the change of the summed squared distance over all poses:
//! what quadrics estimate, measured.

use super::lanes::{LANES, TriangleLanes, Vec3Lanes, read};
use super::surface::Surface;

/// Share of a triangle's area that its centroid stands for; the corners share the rest. Exact for squared distances to a
/// plane.
const CENTROID_SHARE: f32 = 0.75;

pub(super) struct Samples {
    pose_count: usize,
    /// `[sample][3][pose_count]`.
    posed: Vec<f32>,
    /// Area that each sample stands for.
    weights: Vec<f32>,
    /// Squared distance to the surface as it is: mean over the poses.
    distances: Vec<f32>,
    /// Samples that each face stands for.
    of_face: Vec<Vec<u32>>,
    /// Samples that a trial looks at, and where they would go.
    trial: Vec<u32>,
    trial_best: Vec<(f32, f32, u32)>,
    trial_sum: Vec<(f32, f32)>,
    /// Faces of a trial: the face and its points after the collapse.
    trial_faces: Vec<(u32, [u32; 3])>,
}

/// What a collapse does to the samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Change {
    /// Change of area times squared distance, mean over the poses.
    pub cost: f64,
    /// Greatest squared distance afterwards, worst pose.
    pub worst: f32,
    /// Mean squared distance afterwards, mean over the poses.
    pub mean: f32,
}

impl Samples {
    /// A sample at every point and at the centroid of every face.
    pub fn new(surface: &Surface) -> Self {
        let n = surface.pose_count;
        let points = surface.faces_of.len();
        let mut s = Self {
            pose_count: n,
            posed: Vec::with_capacity((points + surface.faces.len()) * 3 * n),
            weights: vec![0.0; points],
            distances: vec![0.0; points + surface.faces.len()],
            of_face: Vec::with_capacity(surface.faces.len()),
            trial: Vec::new(),
            trial_best: Vec::new(),
            trial_sum: Vec::new(),
            trial_faces: Vec::new(),
        };
        for p in 0..points as u32 {
            for axis in surface.at(p) {
                s.posed.extend_from_slice(axis);
            }
        }
        for (i, face) in surface.faces.iter().enumerate() {
            let corners = face.points.map(|p| surface.at(p));
            for axis in 0..3 {
                let [a, b, c] = corners.map(|x| x[axis]);
                s.posed
                    .extend((0..n).map(|k| (a[k] + b[k] + c[k]) * (1.0 / 3.0)));
            }
            let area = surface.areas[i];
            for p in face.points {
                s.weights[p as usize] += area * (1.0 - CENTROID_SHARE) / 3.0;
            }
            s.weights.push(area * CENTROID_SHARE);
            s.of_face.push(vec![(points + i) as u32]);
        }
        s
    }

    /// What moving `point` onto `target` would change. Leaves the assignment ready for [`Samples::commit`].
    pub fn try_collapse(&mut self, surface: &Surface, point: u32, target: u32) -> Change {
        self.trial.clear();
        self.trial.push(point);
        self.trial_faces.clear();
        for &f in &surface.faces_of[point as usize] {
            self.trial.extend(&self.of_face[f as usize]);
            let face = &surface.faces[f as usize];
            if !face.has(target) {
                let after = face.points.map(|p| if p == point { target } else { p });
                self.trial_faces.push((f, after));
            }
        }
        if self.trial_faces.is_empty() {
            self.faces_nearby(surface, point, target);
        }
        self.trial_best.clear();
        self.trial_best
            .resize(self.trial.len(), (f32::MAX, 0.0, u32::MAX));
        for i in 0..self.trial_faces.len() {
            let (face, points) = self.trial_faces[i];
            self.measure(surface, face, points);
        }
        if self.trial_faces.is_empty() {
            // Nothing is left nearby: the piece ends as the point that it vanished onto.
            self.measure(surface, u32::MAX, [target; 3]);
        }
        let mut change = Change {
            cost: 0.0,
            worst: 0.0,
            mean: 0.0,
        };
        let (mut area, mut sum) = (0.0, 0.0);
        for (&sample, &(mean, worst, _)) in self.trial.iter().zip(&self.trial_best) {
            let weight = self.weights[sample as usize];
            change.cost += (weight * (mean - self.distances[sample as usize])) as f64;
            change.worst = change.worst.max(worst);
            area += weight;
            sum += weight * mean;
        }
        change.mean = sum / area.max(f32::MIN_POSITIVE);
        change
    }

    /// Offers a face with the corners `points` to all samples of the trial.
    fn measure(&mut self, surface: &Surface, face: u32, points: [u32; 3]) {
        let n = self.pose_count;
        self.trial_sum.clear();
        self.trial_sum.resize(self.trial.len(), (0.0, 0.0));
        for group in 0..n / LANES {
            let [a, b, c] = points.map(|p| Vec3Lanes::read(surface.posed_of(p), n, group));
            let triangle = TriangleLanes::new(a, b, c);
            let weights = read(&surface.pose_weights, group);
            for (&sample, sum) in self.trial.iter().zip(&mut self.trial_sum) {
                let p = &self.posed[sample as usize * 3 * n..][..3 * n];
                let d = triangle.distance_squared(Vec3Lanes::read(p, n, group));
                sum.0 += d.dot(weights);
                sum.1 = sum.1.max(d.max_element());
            }
        }
        for (&(mean, worst), best) in self.trial_sum.iter().zip(&mut self.trial_best) {
            if mean < best.0 {
                *best = (mean, worst, face);
            }
        }
    }

    /// The faces that samples fall back to where a collapse leaves none of the faces around a point.
    fn faces_nearby(&mut self, surface: &Surface, point: u32, target: u32) {
        let around = std::iter::once(&target)
            .chain(&surface.links[point as usize])
            .chain(&surface.links[target as usize])
            .flat_map(|&p| &surface.faces_of[p as usize]);
        for &f in around {
            let face = &surface.faces[f as usize];
            if !face.has(point) && !self.trial_faces.iter().any(|x| x.0 == f) {
                self.trial_faces.push((f, face.points));
            }
        }
    }

    /// Carries out what [`Samples::try_collapse`] was last asked for.
    pub fn commit(&mut self, surface: &Surface, point: u32, _target: u32) {
        for &f in &surface.faces_of[point as usize] {
            self.of_face[f as usize].clear();
        }
        for (&sample, &(mean, _, face)) in self.trial.iter().zip(&self.trial_best) {
            self.distances[sample as usize] = mean;
            if let Some(list) = self.of_face.get_mut(face as usize) {
                list.push(sample);
            }
        }
    }
}
