//! Cuts a mesh along the borders between faces and paints, so that hems, eyes and soles have clean edges.

use std::collections::HashMap;

use glam::Vec3;
use rayon::prelude::*;

use super::field::{Active, Model, Paint, gradient};

/// A watertight triangle mesh whose triangles each have one paint and one smooth face.
pub struct Surface {
    pub positions: Vec<Vec3>,
    /// The layer that makes the surface, per vertex; one of those that meet at borders.
    pub layers: Vec<u16>,
    pub triangles: Vec<[u32; 3]>,
    /// Per triangle.
    pub faces: Vec<Face>,
    pub paints: Vec<Paint>,
}

/// What a triangle is part of: a paint, and the solid (`trim` 0) or a trim of a layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Face {
    /// Index into [`Surface::paints`].
    pub paint: u16,
    pub layer: u16,
    pub trim: u16,
}

/// What the surface is at a point: the layer, its trim that cuts there and the mark that paints it, each counted from 1
/// with 0 for none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Label {
    layer: u16,
    trim: u16,
    mark: u16,
}

/// `p` moved onto the surface by Newton's method, at most `reach` away.
pub fn project(model: &Model, active: &Active, p: Vec3, reach: f32) -> Vec3 {
    let mut q = p;
    for _ in 0..4 {
        let (d, layer) = model.distance(q, Some(active));
        if d.abs() < 3e-5 {
            break;
        }
        let prims = prims_of(active, layer);
        let g = gradient(|x| model.layers[layer].distance(x, prims), q);
        let next = q - g * (d / g.length_squared().max(0.1));
        if next.distance_squared(p) > reach * reach {
            break;
        }
        q = next;
    }
    q
}

fn prims_of(active: &Active, layer: usize) -> Option<&[u16]> {
    let found = active.iter().find(|a| a.0 as usize == layer);
    found.map(|a| a.1.as_slice())
}

/// What the surface near `p` is.
pub fn label(model: &Model, active: &Active, p: Vec3) -> Label {
    let index = model.distance(p, Some(active)).1;
    let layer = &model.layers[index];
    let mark = layer
        .marks
        .iter()
        .rposition(|(region, _)| region(p) < 0.0)
        .map_or(0, |m| m as u16 + 1);
    Label {
        layer: index as u16,
        trim: layer.cutting_trim(p, prims_of(active, index)) as u16,
        mark,
    }
}

/// The cutting under way.
pub struct Cut<'a> {
    model: &'a Model,
    step: f32,
    /// What matters in each block of the grid, and the block of each vertex.
    actives: Vec<Active>,
    owner: Vec<u32>,
    positions: Vec<Vec3>,
    labels: Vec<Label>,
    on_edge: HashMap<(u32, u32), u32>,
}

impl<'a> Cut<'a> {
    pub fn new(
        model: &'a Model,
        step: f32,
        actives: Vec<Active>,
        owner: Vec<u32>,
        positions: Vec<Vec3>,
        labels: Vec<Label>,
    ) -> Self {
        Self {
            model,
            step,
            actives,
            owner,
            positions,
            labels,
            on_edge: HashMap::new(),
        }
    }

    pub fn run(mut self, triangles: Vec<[u32; 3]>) -> Surface {
        self.snap(&triangles);
        let mut out: Vec<[u32; 3]> = Vec::with_capacity(triangles.len() * 11 / 10);
        let mut labels: Vec<Label> = Vec::with_capacity(out.capacity());
        for t in triangles {
            let l = t.map(|v| self.labels[v as usize]);
            let mut push = |t: [u32; 3], label| {
                out.push(t);
                labels.push(label);
            };
            if l[0] == l[1] && l[1] == l[2] {
                push(t, l[0]);
            } else if l[0] != l[1] && l[1] != l[2] && l[2] != l[0] {
                let middle = self.middle(t);
                let m = [0, 1, 2].map(|i| self.split(t[i], t[(i + 1) % 3]));
                for i in 0..3 {
                    push([t[i], m[i], middle], l[i]);
                    push([t[i], middle, m[(i + 2) % 3]], l[i]);
                }
            } else {
                // Turn the triangle until its odd corner comes first.
                let odd = (0..3)
                    .find(|&i| l[(i + 1) % 3] == l[(i + 2) % 3])
                    .unwrap_or(0);
                let [a, b, c] = [0, 1, 2].map(|i| t[(odd + i) % 3]);
                let (ab, ac) = (self.split(a, b), self.split(a, c));
                let (one, two) = (l[odd], l[(odd + 1) % 3]);
                push([a, ab, ac], one);
                push([ab, b, c], two);
                push([ab, c, ac], two);
            }
        }
        self.finish(out, labels)
    }

    fn active(&self, vertex: u32) -> &Active {
        &self.actives[self.owner[vertex as usize] as usize]
    }

    /// Where the label changes between two vertices, as (place, share of the way from `a`).
    fn border(&self, a: u32, b: u32) -> (Vec3, f32) {
        let (pa, pb) = (self.positions[a as usize], self.positions[b as usize]);
        let from = self.labels[a as usize];
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..8 {
            let t = 0.5 * (low + high);
            if label(self.model, self.active(a), pa.lerp(pb, t)) == from {
                low = t;
            } else {
                high = t;
            }
        }
        let t = 0.5 * (low + high);
        let place = pa.lerp(pb, t);
        let across = label(self.model, self.active(a), pa.lerp(pb, high));
        (self.onto_border(a, from, across, place), t)
    }

    /// `place` moved to where two faces meet, or where a mark ends on its face, by Newton's method on both conditions.
    fn onto_border(&self, near: u32, one: Label, two: Label, place: Vec3) -> Vec3 {
        let active = self.active(near);
        let face = |label: Label, p: Vec3| {
            let layer = &self.model.layers[label.layer as usize];
            let prims = prims_of(active, label.layer as usize);
            layer.face_distance(p, prims, label.trim as usize)
        };
        let other = |p: Vec3| {
            if (one.layer, one.trim) != (two.layer, two.trim) {
                return face(two, p);
            }
            let mark = one.mark.max(two.mark) as usize;
            let marks = &self.model.layers[one.layer as usize].marks;
            marks[mark - 1].0(p)
        };
        let mut q = place;
        for _ in 0..4 {
            let (f, g) = (face(one, q), other(q));
            let (df, dg) = (gradient(|p| face(one, p), q), gradient(other, q));
            // The shortest step that meets both, unless they run along each other.
            let (ff, fg, gg) = (df.dot(df), df.dot(dg), dg.dot(dg));
            let det = ff * gg - fg * fg;
            if det < 0.05 * ff * gg || det < 1e-6 {
                break;
            }
            let (u, v) = ((f * gg - g * fg) / det, (g * ff - f * fg) / det);
            q -= df * u + dg * v;
            if u * u * ff + v * v * gg < 1e-10 {
                break;
            }
        }
        if q.is_finite() && q.distance(place) < 0.9 * self.step {
            q
        } else {
            place
        }
    }

    /// Vertices close to a border move onto it, so that cutting leaves no slivers.
    fn snap(&mut self, triangles: &[[u32; 3]]) {
        let mut edges: Vec<(u32, u32)> = triangles
            .iter()
            .flat_map(|t| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])])
            .filter(|&(a, b)| a < b && self.labels[a as usize] != self.labels[b as usize])
            .collect();
        edges.sort_unstable();
        edges.dedup();
        let borders: Vec<(Vec3, f32)> = edges.par_iter().map(|&(a, b)| self.border(a, b)).collect();
        let mut nearest: HashMap<u32, (f32, Vec3)> = HashMap::new();
        for (&(a, b), &(place, t)) in edges.iter().zip(&borders) {
            for (vertex, share) in [(a, t), (b, 1.0 - t)] {
                let best = nearest.entry(vertex).or_insert((0.3, place));
                if share < best.0 {
                    *best = (share, place);
                }
            }
        }
        nearest.retain(|_, best| best.0 < 0.3);
        // A moved vertex keeps its label; it lies on the border, so every cut edge to it ends there.
        for (&(a, b), &(place, _)) in edges.iter().zip(&borders) {
            let (moved_a, moved_b) = (nearest.get(&a), nearest.get(&b));
            let vertex = match (moved_a, moved_b) {
                (Some(x), Some(y)) if x.0 <= y.0 => a,
                (Some(_), None) => a,
                (_, Some(_)) => b,
                (None, None) => {
                    let index = self.push(place, a);
                    self.on_edge.insert((a, b), index);
                    continue;
                }
            };
            self.on_edge.insert((a, b), vertex);
        }
        for (vertex, (_, place)) in nearest {
            self.positions[vertex as usize] = place;
        }
    }

    fn push(&mut self, p: Vec3, near: u32) -> u32 {
        self.positions.push(p);
        self.labels.push(self.labels[near as usize]);
        self.owner.push(self.owner[near as usize]);
        self.positions.len() as u32 - 1
    }

    fn split(&mut self, a: u32, b: u32) -> u32 {
        let key = (a.min(b), a.max(b));
        if let Some(&vertex) = self.on_edge.get(&key) {
            return vertex;
        }
        let place = self.border(key.0, key.1).0;
        let index = self.push(place, key.0);
        self.on_edge.insert(key, index);
        index
    }

    fn middle(&mut self, t: [u32; 3]) -> u32 {
        let sum: Vec3 = t.iter().map(|&v| self.positions[v as usize]).sum();
        self.push(sum / 3.0, t[0])
    }

    /// Drops triangles without area and turns labels into paints.
    fn finish(self, triangles: Vec<[u32; 3]>, labels: Vec<Label>) -> Surface {
        let mut paints: Vec<Paint> = Vec::new();
        let mut known: HashMap<Label, u16> = HashMap::new();
        let mut surface = Surface {
            layers: self.labels.iter().map(|l| l.layer).collect(),
            positions: self.positions,
            triangles: Vec::with_capacity(labels.len()),
            faces: Vec::with_capacity(labels.len()),
            paints: Vec::new(),
        };
        for (t, label) in triangles.into_iter().zip(labels) {
            if t[0] == t[1] || t[1] == t[2] || t[2] == t[0] {
                continue;
            }
            let paint = *known.entry(label).or_insert_with(|| {
                let layer = &self.model.layers[label.layer as usize];
                let paint = match label.mark {
                    0 => layer.paint,
                    mark => layer.marks[mark as usize - 1].1,
                };
                let at = paints.iter().position(|p| *p == paint);
                at.unwrap_or_else(|| {
                    paints.push(paint);
                    paints.len() - 1
                }) as u16
            });
            surface.triangles.push(t);
            surface.faces.push(Face {
                paint,
                layer: label.layer,
                trim: label.trim,
            });
        }
        surface.paints = paints;
        surface
    }
}
