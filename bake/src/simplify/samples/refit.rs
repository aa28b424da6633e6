//! Where a point should stand, and what its wedges should look like, for the samples around it to be as near as can be: one
//! Gauss-Newton step each.

use glam::{Mat3, Vec3, Vec4};

use super::super::surface::{Surface, cross, length, sub};
use super::{Nearest, OVERHANG_WEIGHT, Samples, TrialFace, nearest_barycentric};

/// Share of a fit's trace that holds a point where its samples say nothing.
const DAMPING: f32 = 0.02;

/// Colours nearer than this are alike where looks stay distinct; black and white are 1.7 apart.
const ALIKE: f32 = 0.3;

/// What a wedge should look like.
#[derive(Debug, Clone, Copy)]
pub struct WedgeFit {
    /// What it shows, texture and all; gamma space.
    pub color: [u8; 4],
    pub normal: Vec3,
    /// The one that most of it shows.
    pub body_part: u8,
}

impl Samples {
    /// The step in bind space that brings the faces around `point` nearest to their samples; `steps` are how far the point
    /// moves in each pose for a step of one.
    pub fn better_place(&self, surface: &Surface, point: u32, steps: &[Mat3]) -> Option<Vec3> {
        let n = self.pose_count;
        let mut h = Mat3::ZERO;
        let mut g = Vec3::ZERO;
        for &f in &surface.faces_of[point as usize] {
            let face = &surface.faces[f as usize];
            let corner = face.points.iter().position(|&p| p == point)?;
            for (k, step) in steps.iter().enumerate() {
                let share = surface.pose_weights[k];
                if share <= 0.0 {
                    continue;
                }
                let corners = face.points.map(|p| surface.at(p).map(|x| x[k]));
                let normal = cross(sub(corners[1], corners[0]), sub(corners[2], corners[0]));
                let long = length(normal);
                let across = step.transpose() * (Vec3::from(normal) / long.max(1e-20));
                let whole = step.transpose() * *step;
                for &sample in &self.of_face[f as usize] {
                    let sample = sample as usize;
                    let at = [0, 1, 2].map(|axis| self.posed[(sample * 3 + axis) * n + k]);
                    let b = nearest_barycentric(at, corners);
                    if b[corner] <= 0.0 {
                        continue;
                    }
                    let mut e = Vec3::from(at);
                    for i in 0..3 {
                        e -= b[i] * Vec3::from(corners[i]);
                    }
                    let weight = self.weights[sample][0] * share * b[corner];
                    if b.iter().all(|&b| b > 1e-4) && long > 1e-12 {
                        let m = weight * b[corner];
                        h += Mat3::from_cols(
                            across * across.x,
                            across * across.y,
                            across * across.z,
                        ) * m;
                        g += weight * (Vec3::from(normal) / long).dot(e) * across;
                    } else {
                        h += whole * (weight * b[corner]);
                        g += weight * (step.transpose() * e);
                    }
                }
            }
        }
        let trace = h.x_axis.x + h.y_axis.y + h.z_axis.z;
        let damped = h + Mat3::from_diagonal(Vec3::splat(DAMPING * trace));
        let step = damped.inverse() * g;
        step.is_finite().then_some(step)
    }

    /// Change of area times squared deviation now that `point` has moved; [`Samples::commit_collapse`] keeps it.
    pub fn try_place(&mut self, surface: &Surface, point: u32) -> f64 {
        let trial = &mut self.trial;
        trial.samples.clear();
        trial.faces.clear();
        for &f in &surface.faces_of[point as usize] {
            trial.samples.extend(&self.of_face[f as usize]);
            let face = &surface.faces[f as usize];
            trial.faces.push(TrialFace {
                face: f,
                points: face.points,
                wedges: face.wedges,
            });
        }
        trial.new_faces = trial.faces.len();
        trial.best.clear();
        let none = Nearest {
            mean: f32::MAX,
            face: u32::MAX,
        };
        trial.best.resize(trial.samples.len(), none);
        for i in 0..self.trial.faces.len() {
            let points = self.trial.faces[i].points;
            self.measure(surface, i as u32, points);
        }
        self.weigh(surface) + OVERHANG_WEIGHT * self.overhang(surface, point)
    }

    /// What wedge `wedge` of `point` should look like; none where it has no visible samples.
    ///
    /// The colour and body part that the most of it shows, unmixed, because an agent's tint may dye neighbouring parts apart.
    /// Where looks are to stay `distinct`, colours of one part that are far apart do not mix either.
    /// The normal that makes the interpolated ones fit best.
    pub fn better_look(
        &self,
        surface: &Surface,
        point: u32,
        wedge: u32,
        distinct: bool,
    ) -> Option<WedgeFit> {
        let n = self.pose_count;
        let mesh = &surface.mesh;
        let (mut normal, mut square) = (Vec3::ZERO, 0.0f32);
        let mut parts: Vec<(u8, f32, Vec4)> = Vec::new();
        for &f in &surface.faces_of[point as usize] {
            let face = &surface.faces[f as usize];
            let corner = face.points.iter().position(|&p| p == point)?;
            if face.wedges[corner] != wedge {
                continue;
            }
            let corners = face.points.map(|p| surface.at(p).map(|x| x[0]));
            for &sample in &self.of_face[f as usize] {
                let sample = sample as usize;
                let Some(look) = &self.look[sample] else {
                    continue;
                };
                let at = [0, 1, 2].map(|axis| self.posed[(sample * 3 + axis) * n]);
                let b = nearest_barycentric(at, corners);
                let weight = self.weights[sample][1] * b[corner];
                if weight <= 0.0 {
                    continue;
                }
                let now = self.looks.at(mesh, face.wedges, b);
                normal += weight * (look.normal - now.normal);
                square += weight * b[corner];
                let part = self.part[sample];
                let alike = |p: &&mut (u8, f32, Vec4)| {
                    p.0 == part && (!distinct || (p.2 / p.1).distance(look.color) < ALIKE)
                };
                match parts.iter_mut().find(alike) {
                    Some((_, sum, color)) => {
                        *sum += weight;
                        *color += weight * look.color;
                    }
                    None => parts.push((part, weight, weight * look.color)),
                }
            }
        }
        let most = parts
            .iter()
            .max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
        let &(body_part, sum, color) = most.filter(|_| square > 0.0)?;
        let w = wedge as usize;
        Some(WedgeFit {
            color: (color / sum * 255.0).round().to_array().map(|c| c as u8),
            normal: (mesh.normals[w] + normal / square).normalize_or(mesh.normals[w]),
            body_part,
        })
    }

    /// Area times squared contrast of the surface as it is.
    pub fn contrast_total(&self) -> f64 {
        self.total[1]
    }

    /// Measures again what the samples around `point` look like.
    pub fn look_again(&mut self, surface: &Surface, point: u32) {
        self.stay(surface, point, Some);
        self.commit_twin(surface);
    }
}
