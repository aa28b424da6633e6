//! Plane quadrics of every point in every pose (Garland & Heckbert 1997, summed over poses as Mohr & Gleicher 2003 do).

use super::lanes::LANES;
use super::surface::{Surface, cross, dot, length, sub};

/// Coefficients of a symmetric 4x4 matrix.
const COEFFICIENTS: usize = 10;
/// Weight of the planes that hold an open border in place, against a face of the edge's length squared.
const BORDER_WEIGHT: f64 = 1.0;

/// Area-weighted sums of squared distances to planes.
#[derive(Clone)]
pub(super) struct Quadrics {
    pose_count: usize,
    pose_weights: Vec<f64>,
    /// `[point][COEFFICIENTS][pose_count]`.
    values: Vec<f64>,
}

impl Quadrics {
    /// Every face's plane goes to its corners, a third each; an edge with one face adds a plane across it.
    pub fn new(surface: &Surface) -> Self {
        let n = surface.group_count * LANES;
        let points = surface.faces_of.len();
        let mut quadrics = Self {
            pose_count: n,
            pose_weights: surface.pose_weights[..n]
                .iter()
                .map(|&w| w as f64)
                .collect(),
            values: vec![0.0; points * COEFFICIENTS * n],
        };
        for face in &surface.faces {
            for k in 0..n {
                let normal = surface.normal(face.points, k);
                let twice_area = length(normal);
                if twice_area > 0.0 {
                    let unit = normal.map(|x| x / twice_area);
                    let weight = twice_area as f64 / 6.0;
                    for p in face.points {
                        quadrics.add_plane(surface, p, face.points[0], k, unit, weight);
                    }
                }
            }
            for corner in 0..3 {
                let (a, b) = (face.points[corner], face.points[(corner + 1) % 3]);
                let faces = surface.faces_of[a as usize].iter();
                if faces.filter(|&&f| surface.faces[f as usize].has(b)).count() == 1 {
                    quadrics.add_border(surface, face.points, a, b);
                }
            }
        }
        quadrics
    }

    fn add_border(&mut self, surface: &Surface, points: [u32; 3], a: u32, b: u32) {
        for k in 0..self.pose_count {
            let [from, to] = [a, b].map(|p| surface.at(p).map(|x| x[k]));
            let edge = sub(to, from);
            let across = cross(edge, surface.normal(points, k));
            let (long, size) = (length(across), dot(edge, edge));
            if long > 0.0 {
                let unit = across.map(|x| x / long);
                for p in [a, b] {
                    self.add_plane(surface, p, a, k, unit, BORDER_WEIGHT * size as f64 / 2.0);
                }
            }
        }
    }

    /// The plane through `on` with the unit normal `n`, in pose `k`, for `point`.
    fn add_plane(
        &mut self,
        surface: &Surface,
        point: u32,
        on: u32,
        k: usize,
        normal: [f32; 3],
        weight: f64,
    ) {
        let n = normal.map(f64::from);
        let on = surface.at(on).map(|x| x[k] as f64);
        let d = -(n[0] * on[0] + n[1] * on[1] + n[2] * on[2]);
        let products = [
            n[0] * n[0],
            n[1] * n[1],
            n[2] * n[2],
            2.0 * n[0] * n[1],
            2.0 * n[0] * n[2],
            2.0 * n[1] * n[2],
            2.0 * n[0] * d,
            2.0 * n[1] * d,
            2.0 * n[2] * d,
            d * d,
        ];
        let base = point as usize * COEFFICIENTS * self.pose_count + k;
        for (i, product) in products.into_iter().enumerate() {
            self.values[base + i * self.pose_count] += weight * product;
        }
    }

    /// Makes room for `points`, of which the new ones stand for nothing.
    pub fn resize(&mut self, points: usize) {
        self.values
            .resize(points * COEFFICIENTS * self.pose_count, 0.0);
    }

    /// `to` takes over what `from` stands for.
    pub fn add(&mut self, to: u32, from: u32) {
        let length = COEFFICIENTS * self.pose_count;
        let (to, from) = (to as usize, from as usize);
        for i in 0..length {
            self.values[to * length + i] += self.values[from * length + i];
        }
    }

    /// Area times squared distance if `point` moved to where `target` is, mean over the poses.
    pub fn error(&self, surface: &Surface, point: u32, target: u32) -> f64 {
        let n = self.pose_count;
        let q = &self.values[point as usize * COEFFICIENTS * n..][..COEFFICIENTS * n];
        let [x, y, z] = surface.at(target);
        let mut sum = 0.0;
        for k in 0..n {
            let (x, y, z) = (x[k] as f64, y[k] as f64, z[k] as f64);
            let error = x * (q[k] * x + q[3 * n + k] * y + q[4 * n + k] * z + q[6 * n + k])
                + y * (q[n + k] * y + q[5 * n + k] * z + q[7 * n + k])
                + z * (q[2 * n + k] * z + q[8 * n + k])
                + q[9 * n + k];
            sum += self.pose_weights[k] * error.max(0.0);
        }
        sum
    }
}
