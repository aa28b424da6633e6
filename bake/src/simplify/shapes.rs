//! Shapes of a few triangles for a piece of a character: tubes, spikes and boxes along its nodes.

use std::collections::HashMap;
use std::f32::consts::TAU;

use glam::{Vec3, Vec4};

use crate::mesh::Mesh;

use super::limbs::{Kind, LimbSample, Piece, mean};

/// Half the breadth of a ring over the standard deviation of the surface around a node: equal mean widths.
const BREADTH: [f32; 2] = [1.71, 1.62];
/// Distance of colours (black and white are 1.7 apart) and cosine of normals within which corners at a point are one vertex.
const WELD_COLOR: f32 = 0.2;
const WELD_COSINE: f32 = 0.5;
/// A corner's first colour is that of a place this share of the way to the middle of the face, from about as far around as this
/// share of the face's size.
const INWARDS: f32 = 0.3;
const LOOK_REACH: f32 = 0.3;
/// Most triangles of a shape.
const MOST_TRIANGLES: usize = 20;
/// Share of the way to the next node that a node stands for.
const NEAR: f32 = 0.3;

/// A corner of a shape.
#[derive(Debug, Clone)]
pub(super) struct ShapePoint {
    pub at: Vec3,
    pub joints: [u8; 4],
    pub weights: [f32; 4],
}

/// A shape that may stand for a piece.
#[derive(Debug, Clone, Default)]
pub(super) struct Shape {
    pub points: Vec<ShapePoint>,
    pub faces: Vec<[usize; 3]>,
    /// For each corner of each face: what it looks like.
    pub looks: Vec<[CornerLook; 3]>,
}

/// What a corner of a face looks like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CornerLook {
    /// Of unit length, bind space.
    pub normal: Vec3,
    /// Gamma space.
    pub color: Vec4,
    pub part: u8,
}

/// Corners at a point that look nearly the same.
struct Alike {
    normals: Vec3,
    colors: Vec4,
    part: u8,
    /// Face and corner.
    at: Vec<(usize, usize)>,
}

impl Shape {
    /// Adds the points and faces of another.
    pub fn append(&mut self, other: &Self) {
        let first = self.points.len();
        self.points.extend_from_slice(&other.points);
        self.faces
            .extend(other.faces.iter().map(|f| f.map(|i| i + first)));
        self.looks.extend_from_slice(&other.looks);
    }

    /// Makes looks at a point that are nearly the same the same.
    pub fn weld(&mut self) {
        for point in 0..self.points.len() {
            let mut kinds: Vec<Alike> = Vec::new();
            for (f, face) in self.faces.iter().enumerate() {
                for i in (0..3).filter(|&i| face[i] == point) {
                    let look = self.looks[f][i];
                    let alike = |k: &&mut Alike| {
                        let color = k.colors / k.at.len() as f32;
                        k.part == look.part
                            && color.distance(look.color) < WELD_COLOR
                            && k.normals.normalize_or_zero().dot(look.normal) > WELD_COSINE
                    };
                    match kinds.iter_mut().find(alike) {
                        Some(k) => {
                            k.normals += look.normal;
                            k.colors += look.color;
                            k.at.push((f, i));
                        }
                        None => kinds.push(Alike {
                            normals: look.normal,
                            colors: look.color,
                            part: look.part,
                            at: vec![(f, i)],
                        }),
                    }
                }
            }
            for k in kinds {
                let look = CornerLook {
                    normal: k.normals.normalize_or(Vec3::Y),
                    color: k.colors / k.at.len() as f32,
                    part: k.part,
                };
                for (f, i) in k.at {
                    self.looks[f][i] = look;
                }
            }
        }
    }
}

/// What stands at a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum At {
    Ring,
    Apex,
}

/// The shapes that a piece may have, none of them empty.
pub(super) fn shapes(mesh: &Mesh, piece: &Piece) -> Vec<Shape> {
    let last = piece.nodes.len() - 1;
    let mut lines: Vec<Vec<(usize, At)>> = Vec::new();
    let starts = 0..=usize::from(last > 1 && piece.kind == Kind::Limb);
    for from in starts {
        let ends = if last > from + 1 && piece.kind == Kind::Limb {
            last - 1..=last
        } else {
            last..=last
        };
        for to in ends.filter(|&to| to > from) {
            let between = from + 1..to;
            let mut middles = vec![None];
            middles.extend(between.map(Some));
            for middle in middles {
                for (start, end) in [
                    (At::Ring, At::Ring),
                    (At::Ring, At::Apex),
                    (At::Apex, At::Ring),
                ] {
                    let mut line = vec![(from, start)];
                    line.extend(middle.map(|m| (m, At::Ring)));
                    line.push((to, end));
                    lines.push(line);
                }
                if let Some(m) = middle {
                    lines.push(vec![(from, At::Apex), (m, At::Ring), (to, At::Apex)]);
                }
            }
        }
    }
    let mut out = Vec::new();
    for sides in [3, 4] {
        for line in &lines {
            let rings = line.iter().filter(|n| n.1 == At::Ring).count();
            let caps: &[[bool; 2]] = match piece.kind {
                Kind::Limb => &[[false, false]],
                _ => &[[false, false], [false, true], [true, true], [true, false]],
            };
            for &[first, end] in caps {
                let capped = |cap: bool, at: At| !cap || at == At::Ring;
                if capped(first, line[0].1) && capped(end, line[line.len() - 1].1) && rings <= 3 {
                    out.push(build(mesh, piece, line, sides, [first, end]));
                }
            }
        }
    }
    out.retain(|s| s.faces.len() <= MOST_TRIANGLES);
    out
}

fn build(mesh: &Mesh, piece: &Piece, line: &[(usize, At)], sides: usize, caps: [bool; 2]) -> Shape {
    let mut shape = Shape::default();
    let mut frame = None;
    let mut rows: Vec<Vec<usize>> = Vec::new();
    let mut normals: Vec<Vec3> = Vec::new();
    for &(node, at) in line {
        let d = piece.direction(node);
        let u: Vec3 = match frame {
            None => piece.across(d),
            Some(u) => u,
        };
        let u = (u - d * d.dot(u)).normalize_or(d.any_orthonormal_vector());
        let v = d.cross(u);
        frame = Some(u);
        let near = piece.near(node);
        let (joints, weights) = skinning(mesh, near.iter().map(|&i| &piece.samples[i]));
        let center = piece.center(node, &near, d);
        let mut row = Vec::new();
        match at {
            At::Apex => {
                row.push(shape.points.len());
                normals.push(d);
                shape.points.push(ShapePoint {
                    at: piece.nodes[node] * 0.5 + center * 0.5,
                    joints,
                    weights,
                });
            }
            At::Ring => {
                let (a, b) = piece.breadth(&near, center, u, v);
                let scale = BREADTH[sides - 3];
                for k in 0..sides {
                    let angle =
                        TAU * (k as f32 + if sides == 4 { 0.5 } else { 0.25 * 3.0 }) / sides as f32;
                    let (sin, cos) = angle.sin_cos();
                    let out = u * (a * cos) + v * (b * sin);
                    row.push(shape.points.len());
                    normals.push(out.normalize_or(u));
                    shape.points.push(ShapePoint {
                        at: center + out * scale,
                        joints,
                        weights,
                    });
                }
            }
        }
        rows.push(row);
    }
    let mut faces: Vec<([usize; 3], Option<Vec3>)> = Vec::new();
    for pair in rows.windows(2) {
        let (a, b) = (&pair[0], &pair[1]);
        for k in 0..sides {
            let n = (k + 1) % sides;
            match (a.len() > 1, b.len() > 1) {
                (true, true) => {
                    faces.push(([a[k], a[n], b[n]], None));
                    faces.push(([a[k], b[n], b[k]], None));
                }
                (true, false) => faces.push(([a[k], a[n], b[0]], None)),
                (false, true) => faces.push(([a[0], b[n], b[k]], None)),
                (false, false) => {}
            }
        }
    }
    let (first, end) = (&rows[0], &rows[rows.len() - 1]);
    for k in 1..sides - 1 {
        if caps[0] {
            faces.push((
                [first[0], first[k + 1], first[k]],
                Some(-piece.direction(line[0].0)),
            ));
        }
        if caps[1] {
            faces.push((
                [end[0], end[k], end[k + 1]],
                Some(piece.direction(line[line.len() - 1].0)),
            ));
        }
    }
    for (face, flat) in faces {
        let at = face.map(|i| shape.points[i].at);
        let middle = (at[0] + at[1] + at[2]) / 3.0;
        let facing = (at[1] - at[0]).cross(at[2] - at[0]).normalize_or_zero();
        let size = at[1].distance(at[0]).max(at[2].distance(at[0]));
        let looks = [0, 1, 2].map(|i| {
            let (color, part) = piece.look(at[i].lerp(middle, INWARDS), facing, LOOK_REACH * size);
            CornerLook {
                normal: flat.unwrap_or(normals[face[i]]),
                color,
                part,
            }
        });
        shape.faces.push(face);
        shape.looks.push(looks);
    }
    shape
}

impl Piece {
    /// Indices of the samples around a node.
    fn near(&self, node: usize) -> Vec<usize> {
        let mut reach = NEAR;
        loop {
            let near: Vec<usize> = (0..self.samples.len())
                .filter(|&i| (self.along[i] - node as f32).abs() <= reach)
                .collect();
            if near.len() >= 12 || reach > self.nodes.len() as f32 {
                return near;
            }
            reach *= 1.5;
        }
    }

    /// Across `d`, the direction in which the samples lie farthest apart.
    fn across(&self, d: Vec3) -> Vec3 {
        let center = mean(&self.samples);
        let u = d.any_orthonormal_vector();
        let v = d.cross(u);
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for s in &self.samples {
            let (x, y) = ((s.at - center).dot(u), (s.at - center).dot(v));
            xx += s.weight * x * x;
            xy += s.weight * x * y;
            yy += s.weight * y * y;
        }
        let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
        u * angle.cos() + v * angle.sin()
    }

    /// The middle of the samples around a node, in its plane.
    fn center(&self, node: usize, near: &[usize], d: Vec3) -> Vec3 {
        let mut sum = Vec4::ZERO;
        for &i in near {
            let s = &self.samples[i];
            sum += s.at.extend(1.0) * s.weight;
        }
        let middle = sum.truncate() / sum.w.max(f32::MIN_POSITIVE);
        let at = self.nodes[node];
        if sum.w > 0.0 {
            middle - d * d.dot(middle - at)
        } else {
            at
        }
    }

    /// Standard deviations of the samples around a node along `u` and `v`.
    fn breadth(&self, near: &[usize], center: Vec3, u: Vec3, v: Vec3) -> (f32, f32) {
        let (mut a, mut b, mut sum) = (0.0, 0.0, 0.0);
        for &i in near {
            let s = &self.samples[i];
            a += s.weight * (s.at - center).dot(u).powi(2);
            b += s.weight * (s.at - center).dot(v).powi(2);
            sum += s.weight;
        }
        let sum = f32::max(sum, f32::MIN_POSITIVE);
        ((a / sum).sqrt(), (b / sum).sqrt())
    }

    /// Colour and body part at a place of the surface that faces `facing`.
    fn look(&self, at: Vec3, facing: Vec3, reach: f32) -> (Vec4, u8) {
        let mut sum = Vec4::ZERO;
        let mut total = 0.0;
        let mut parts: HashMap<u8, f32> = HashMap::new();
        for s in &self.samples {
            let turned = s.normal.dot(facing);
            let gap = s.at.distance_squared(at) / (reach * reach).max(1e-20);
            let w = s.weight * (0.02 + turned.max(0.0)) / (1.0 + gap * gap);
            sum += s.color * w;
            total += w;
            *parts.entry(s.part).or_default() += w;
        }
        let part = parts
            .into_iter()
            .max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
        (
            sum / f32::max(total, f32::MIN_POSITIVE),
            part.map_or(0, |p| p.0),
        )
    }
}

/// Mean skinning of places on the surface.
fn skinning<'a>(mesh: &Mesh, samples: impl Iterator<Item = &'a LimbSample>) -> ([u8; 4], [f32; 4]) {
    let mut sums = [0.0f32; 256];
    for s in samples {
        let v = s.vertex as usize;
        for (j, w) in mesh.joints[v].into_iter().zip(mesh.weights[v]) {
            sums[j as usize] += w * s.weight;
        }
    }
    let mut order: Vec<usize> = (0..256).filter(|&j| sums[j] > 0.0).collect();
    order.sort_by(|&a, &b| sums[b].total_cmp(&sums[a]).then(a.cmp(&b)));
    order.truncate(4);
    let most = order.first().map_or(0.0, |&j| sums[j]);
    order.retain(|&j| sums[j] > 0.1 * most);
    let total: f32 = order.iter().map(|&j| sums[j]).sum();
    let (mut joints, mut weights) = ([0; 4], [0.0; 4]);
    for (i, &j) in order.iter().enumerate() {
        joints[i] = j as u8;
        weights[i] = sums[j] / total;
    }
    if order.is_empty() {
        weights[0] = 1.0;
    }
    (joints, weights)
}
