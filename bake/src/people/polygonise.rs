//! A model's surface as triangles: surface nets on a sparse grid, vertices moved onto the surface, triangles cut along the
//! borders between paints so that hems, eyes and soles have clean edges.

use std::collections::HashMap;

use glam::{IVec3, Vec3};
use rayon::prelude::*;

use super::field::{Active, Model, Paint, gradient};

/// Cells along a block's edge.
const BLOCK: i32 = 8;
/// Blocks along the edge of a coarse block, which rejects empty space.
const COARSE: i32 = 4;

/// A watertight triangle mesh whose triangles each have one paint.
pub struct Surface {
    pub positions: Vec<Vec3>,
    /// Index into `paints` and layer, per triangle.
    pub triangle_paints: Vec<(u16, u16)>,
    pub triangles: Vec<[u32; 3]>,
    pub paints: Vec<Paint>,
}

struct Cell {
    at: IVec3,
    position: Vec3,
}

/// A grid edge that crosses the surface: its lower end, its axis, and whether the lower end is inside.
struct Crossing {
    at: IVec3,
    axis: usize,
    inside_first: bool,
}

struct Block {
    cells: Vec<Cell>,
    crossings: Vec<Crossing>,
    active: Active,
}

/// The surface of `model` inside the box, sampled every `step`.
pub fn polygonise(model: &Model, low: Vec3, high: Vec3, step: f32) -> Surface {
    let blocks = blocks(model, low, high, step);
    let cell_count = blocks.iter().map(|b| b.cells.len()).sum();
    let mut index = HashMap::with_capacity(cell_count);
    let mut positions = Vec::with_capacity(cell_count);
    let mut labels = Vec::with_capacity(cell_count);
    let projected: Vec<Vec<(Vec3, (u16, u16))>> = blocks
        .par_iter()
        .map(|block| {
            let project = |c: &Cell| {
                let p = project(model, &block.active, c.position, 0.8 * step);
                (p, label(model, &block.active, p))
            };
            block.cells.iter().map(project).collect()
        })
        .collect();
    let mut owner = Vec::with_capacity(cell_count);
    for (b, (block, projected)) in blocks.iter().zip(projected).enumerate() {
        for (cell, (position, label)) in block.cells.iter().zip(projected) {
            index.insert(cell.at, positions.len() as u32);
            positions.push(position);
            labels.push(label);
            owner.push(b as u32);
        }
    }
    let mut triangles = Vec::with_capacity(2 * cell_count);
    for crossing in blocks.iter().flat_map(|b| &b.crossings) {
        let (u, v) = match crossing.axis {
            0 => (IVec3::Y, IVec3::Z),
            1 => (IVec3::Z, IVec3::X),
            _ => (IVec3::X, IVec3::Y),
        };
        let around = [
            crossing.at - u - v,
            crossing.at - v,
            crossing.at,
            crossing.at - u,
        ];
        let Some(mut quad) = around
            .iter()
            .map(|c| index.get(c).copied())
            .collect::<Option<Vec<u32>>>()
        else {
            continue;
        };
        if !crossing.inside_first {
            quad.reverse();
        }
        let at = |i: usize| positions[quad[i] as usize];
        let [a, b, c, d] = [quad[0], quad[1], quad[2], quad[3]];
        if at(0).distance_squared(at(2)) <= at(1).distance_squared(at(3)) {
            triangles.extend([[a, b, c], [a, c, d]]);
        } else {
            triangles.extend([[a, b, d], [b, c, d]]);
        }
    }
    triangles.retain(|t: &[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]);
    let cut = Cut {
        model,
        blocks: &blocks,
        owner,
        positions,
        labels,
        on_edge: HashMap::new(),
    };
    cut.run(triangles)
}

fn blocks(model: &Model, low: Vec3, high: Vec3, step: f32) -> Vec<Block> {
    let size = ((high - low) / (step * BLOCK as f32)).ceil().as_ivec3();
    let coarse = (size + COARSE - 1) / COARSE;
    let boxes = |size: IVec3| {
        (0..size.z).flat_map(move |z| {
            (0..size.y).flat_map(move |y| (0..size.x).map(move |x| IVec3::new(x, y, z)))
        })
    };
    let half_diagonal = |cells: i32| 3f32.sqrt() * 0.5 * cells as f32 * step;
    let all: Vec<IVec3> = boxes(coarse).collect();
    let near: Vec<(IVec3, Active)> = all
        .into_par_iter()
        .filter_map(|c| {
            let middle = low + (c.as_vec3() + 0.5) * (BLOCK * COARSE) as f32 * step;
            let radius = half_diagonal(BLOCK * COARSE) + step;
            model.active(middle, radius, None).map(|a| (c, a))
        })
        .collect();
    let fine: Vec<(IVec3, usize)> = near
        .iter()
        .enumerate()
        .flat_map(|(i, (c, _))| boxes(IVec3::splat(COARSE)).map(move |b| (*c * COARSE + b, i)))
        .collect();
    fine.into_par_iter()
        .filter_map(|(block, parent)| {
            let middle = low + (block.as_vec3() + 0.5) * BLOCK as f32 * step;
            let radius = half_diagonal(BLOCK) + 2.0 * step;
            let active = model.active(middle, radius, Some(&near[parent].1))?;
            let made = sample(model, active, block * BLOCK, low, step);
            (!made.cells.is_empty() || !made.crossings.is_empty()).then_some(made)
        })
        .collect()
}

/// Surface-nets vertices and crossing edges of one block of cells.
fn sample(model: &Model, active: Active, first: IVec3, low: Vec3, step: f32) -> Block {
    const N: usize = BLOCK as usize + 1;
    let mut d = [0f32; N * N * N];
    let at = |x: usize, y: usize, z: usize| (z * N + y) * N + x;
    for z in 0..N {
        for y in 0..N {
            for x in 0..N {
                let corner = first + IVec3::new(x as i32, y as i32, z as i32);
                let p = low + corner.as_vec3() * step;
                d[at(x, y, z)] = model.distance(p, Some(&active)).0;
            }
        }
    }
    let mut block = Block {
        cells: Vec::new(),
        crossings: Vec::new(),
        active,
    };
    for z in 0..N - 1 {
        for y in 0..N - 1 {
            for x in 0..N - 1 {
                let cell = first + IVec3::new(x as i32, y as i32, z as i32);
                let corner: [f32; 8] =
                    std::array::from_fn(|i| d[at(x + (i & 1), y + (i >> 1 & 1), z + (i >> 2 & 1))]);
                let inside = corner.iter().filter(|&&v| v < 0.0).count();
                if inside == 0 || inside == 8 {
                    continue;
                }
                let mut sum = Vec3::ZERO;
                let mut count = 0.0;
                for i in 0..8usize {
                    for axis in 0..3 {
                        let j = i | 1 << axis;
                        if i == j || (corner[i] < 0.0) == (corner[j] < 0.0) {
                            continue;
                        }
                        let t = corner[i] / (corner[i] - corner[j]);
                        let mut p =
                            Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2 & 1) as f32);
                        p[axis] = t;
                        sum += p;
                        count += 1.0;
                        if i == 0 {
                            block.crossings.push(Crossing {
                                at: cell,
                                axis,
                                inside_first: corner[0] < 0.0,
                            });
                        }
                    }
                }
                block.cells.push(Cell {
                    at: cell,
                    position: low + (cell.as_vec3() + sum / count) * step,
                });
            }
        }
    }
    block
}

/// `p` moved onto the surface by Newton's method, at most `reach` away.
fn project(model: &Model, active: &Active, p: Vec3, reach: f32) -> Vec3 {
    let mut q = p;
    for _ in 0..4 {
        let (d, layer) = model.distance(q, Some(active));
        if d.abs() < 1e-5 {
            break;
        }
        let prims = active.iter().find(|a| a.0 as usize == layer);
        let prims = prims.map(|a| a.1.as_slice());
        let g = gradient(|x| model.layers[layer].distance(x, prims), q);
        let next = q - g * (d / g.length_squared().max(0.1));
        if next.distance_squared(p) > reach * reach {
            break;
        }
        q = next;
    }
    q
}

/// Layer and mark (0: none) that `p` shows.
fn label(model: &Model, active: &Active, p: Vec3) -> (u16, u16) {
    let layer = model.distance(p, Some(active)).1;
    let marks = &model.layers[layer].marks;
    let mark = marks.iter().rposition(|(region, _)| region(p) < 0.0);
    (layer as u16, mark.map_or(0, |m| m as u16 + 1))
}

struct Cut<'a> {
    model: &'a Model,
    blocks: &'a [Block],
    owner: Vec<u32>,
    positions: Vec<Vec3>,
    labels: Vec<(u16, u16)>,
    on_edge: HashMap<(u32, u32), u32>,
}

impl Cut<'_> {
    fn run(mut self, triangles: Vec<[u32; 3]>) -> Surface {
        self.snap(&triangles);
        let mut out: Vec<[u32; 3]> = Vec::with_capacity(triangles.len() * 11 / 10);
        let mut labels: Vec<(u16, u16)> = Vec::with_capacity(out.capacity());
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
        &self.blocks[self.owner[vertex as usize] as usize].active
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
        (pa.lerp(pb, t), t)
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
    fn finish(self, triangles: Vec<[u32; 3]>, labels: Vec<(u16, u16)>) -> Surface {
        let mut paints: Vec<Paint> = Vec::new();
        let mut known: HashMap<(u16, u16), u16> = HashMap::new();
        let mut surface = Surface {
            positions: self.positions,
            triangle_paints: Vec::with_capacity(labels.len()),
            triangles: Vec::with_capacity(labels.len()),
            paints: Vec::new(),
        };
        for (t, label) in triangles.into_iter().zip(labels) {
            if t[0] == t[1] || t[1] == t[2] || t[2] == t[0] {
                continue;
            }
            let paint = *known.entry(label).or_insert_with(|| {
                let layer = &self.model.layers[label.0 as usize];
                let paint = match label.1 {
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
            surface.triangle_paints.push((paint, label.0));
        }
        surface.paints = paints;
        surface
    }
}
