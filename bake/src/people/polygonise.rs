//! A model's surface as triangles: surface nets on a sparse grid, vertices moved onto the surface.

use std::collections::HashMap;

use glam::{IVec3, Vec3};
use rayon::prelude::*;

use super::cut::{Cut, Label, Surface, label, project};
use super::field::{Active, Model};

/// Cells along a block's edge.
const BLOCK: i32 = 4;
/// Blocks along the edge of a coarse block, which rejects empty space.
const COARSE: i32 = 5;

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
    let projected: Vec<Vec<(Vec3, Label)>> = blocks
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
    let actives = blocks.into_iter().map(|b| b.active).collect();
    Cut::new(model, step, actives, owner, positions, labels).run(triangles)
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
            let radius = half_diagonal(BLOCK * COARSE);
            model
                .active(middle, radius, 2.0 * step, None)
                .map(|a| (c, a))
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
            let radius = half_diagonal(BLOCK);
            let active = model.active(middle, radius, 2.0 * step, Some(&near[parent].1))?;
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
