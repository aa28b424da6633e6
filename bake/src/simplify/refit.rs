//! Refits: after a collapse in the coarse part of a sequence the point that stays moves to where the surface around it is
//! nearest to the full one, and its wedges get the colours and normals of what they now stand for.
//!
//! Half-edge collapses alone only keep what was there: chords of round limbs, which makes limbs thin, and the normal of one
//! facet for all that it replaces. A refit adds new vertices that nothing uses before it, as the targets of the old ones.

use glam::Vec3;

use crate::mesh::Mesh;

use super::Simplifier;
use super::coarse::MOVES;
use super::lanes::LANES;
use super::samples::WedgeFit;
use super::surface::{Surface, cross, dot, length, sub};

/// Share of the points from which on collapses refit: above it there are many points, each of little effect.
const REFIT_SHARE: f64 = 0.35;
/// Steps towards the best place.
const STEPS: usize = 2;
/// Halvings of a step that leaves the box of the full mesh, before it is given up.
const HALVINGS: usize = 4;
/// Cosine of the farthest that a step may turn a face.
const TURN_COSINE: f32 = 0.5;
/// Shortest move that is worth new vertices, as a share of the level's deviation.
const LEAST_MOVE: f32 = 0.3;
/// Least change of a normal that is, in radians.
const LEAST_TURN: f32 = 0.2;
/// Least change of a colour's channel that is.
const LEAST_COLOR: u8 = 4;

impl Simplifier<'_> {
    /// Refits `point` with all its wedges after another, `way` from it in bind space, has moved onto it. Each wedge that is
    /// replaced, with the one that takes its place.
    pub(super) fn refit(&mut self, point: u32, way: Vec3) -> Vec<(u32, u32)> {
        if !self.refits() || self.surface.faces_of[point as usize].is_empty() {
            return Vec::new();
        }
        if self.placed_by_pictures() {
            return self.refit_by_pictures(point, &MOVES, way);
        }
        let offset = self.refit_place(point);
        if self.pictured() {
            self.coarse.pictures.place(&self.surface, point);
        }
        let wedges = self.surface.wedges_of[point as usize].clone();
        self.refit_wedges(point, &wedges, offset)
    }

    /// Gives one wedge of `point` the look that it should have. The same result.
    pub(super) fn refit_look(&mut self, point: u32, wedge: u32) -> Vec<(u32, u32)> {
        if !self.refits() {
            return Vec::new();
        }
        self.refit_wedges(point, &[wedge], Vec3::ZERO)
    }

    pub(super) fn refits(&self) -> bool {
        self.living_points as f64 <= REFIT_SHARE * self.surface.faces_of.len() as f64
    }

    /// Moves `point` in all poses to where the faces around it are nearest to their samples; how far, in bind space.
    fn refit_place(&mut self, point: u32) -> Vec3 {
        let s = &mut self.surface;
        let per_pose = s.steps_of(point);
        let start = s.posed_of(point).to_vec();
        let mut offset = Vec3::ZERO;
        for _ in 0..STEPS {
            let Some(step) = self.samples.better_place(s, point, &per_pose) else {
                break;
            };
            let before = s.posed_of(point).to_vec();
            let mut share = 1.0;
            let inside = (0..HALVINGS).any(|i| {
                share = 0.5f32.powi(i as i32);
                s.place(point, &start, &per_pose, offset + step * share)
            });
            if inside && !turns_faces(s, point, &before) && self.samples.try_place(s, point) < 0.0 {
                self.samples.commit_collapse(s, point);
                offset += step * share;
            } else {
                s.place(point, &start, &per_pose, offset);
                break;
            }
        }
        // Anything shorter is not worth new vertices.
        let least = LEAST_MOVE * self.samples.deviation() as f32;
        if offset != Vec3::ZERO && offset.length() < least * s.unit {
            offset = Vec3::ZERO;
            s.place(point, &start, &per_pose, offset);
            self.samples.try_place(s, point);
            self.samples.commit_collapse(s, point);
        }
        for f in s.faces_of[point as usize].clone() {
            s.areas[f as usize] = s.face_area(s.faces[f as usize].points);
        }
        offset
    }

    /// New vertices in the place of those of `wedges` that have faces, `offset` away from them in bind space.
    pub(super) fn refit_wedges(
        &mut self,
        point: u32,
        wedges: &[u32],
        offset: Vec3,
    ) -> Vec<(u32, u32)> {
        let distinct = self.pictured();
        let s = &mut self.surface;
        let faces = &s.faces_of[point as usize];
        let used = |w: u32| {
            let mut faces = faces.iter();
            faces.any(|&f| s.faces[f as usize].wedges.contains(&w))
        };
        let fits: Vec<_> = (wedges.iter().filter(|&&w| used(w)))
            .map(|&w| {
                let (m, i) = (&s.mesh, w as usize);
                let fit = self.samples.better_look(s, point, w, distinct);
                let mut fit = fit.unwrap_or(WedgeFit {
                    color: m.colors[i],
                    normal: m.normals[i],
                    body_part: m.body_parts[i],
                });
                if m.layers[i] != Mesh::UNTEXTURED {
                    // A texture says itself what colours there are.
                    fit.color = m.colors[i];
                }
                (w, fit)
            })
            .collect();
        let changes = fits.iter().any(|(w, fit)| {
            let w = *w as usize;
            let turn = s.mesh.normals[w].distance(fit.normal);
            let colors = s.mesh.colors[w].iter().zip(fit.color);
            turn > LEAST_TURN || colors.map(|(a, b)| a.abs_diff(b)).max() > Some(LEAST_COLOR)
        });
        if offset == Vec3::ZERO && !changes {
            return Vec::new();
        }
        let mut renewed = Vec::new();
        for (wedge, fit) in fits {
            let new = s.add_wedge(wedge);
            let (m, i) = (&mut s.mesh, new as usize);
            m.positions[i] += offset;
            m.normals[i] = fit.normal;
            m.colors[i] = fit.color;
            m.body_parts[i] = fit.body_part;
            renewed.push((wedge, new));
        }
        for &(old, new) in &renewed {
            s.replace_wedge(point, old, new);
        }
        self.samples.look_again(s, point);
        self.learn();
        renewed
    }
}

/// Whether a face of `point` has turned too far since the point stood at `before`.
fn turns_faces(surface: &Surface, point: u32, before: &[f32]) -> bool {
    let n = surface.pose_count;
    surface.faces_of[point as usize].iter().any(|&f| {
        let points = surface.faces[f as usize].points;
        (0..n.min(surface.group_count * LANES)).any(|k| {
            let old = points.map(|p| {
                if p == point {
                    [before[k], before[n + k], before[2 * n + k]]
                } else {
                    surface.at(p).map(|x| x[k])
                }
            });
            let old = cross(sub(old[1], old[0]), sub(old[2], old[0]));
            let new = surface.normal(points, k);
            dot(old, new) < TURN_COSINE * length(old) * length(new)
        })
    })
}
