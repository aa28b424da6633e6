//! The mesh while it is being simplified: points, their wedges, their triangles, and where they are in every pose.

use std::collections::HashMap;

use glam::{Affine3A, Mat3, Vec3};

use crate::mesh::{CollapseSequence, Mesh};
use crate::pose;

use super::lanes::LANES;
use super::poses::PoseSet;

/// A triangle: its wedges and, the same corners, their points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Face {
    pub wedges: [u32; 3],
    pub points: [u32; 3],
    pub alive: bool,
}

impl Face {
    pub fn has(&self, point: u32) -> bool {
        self.points.contains(&point)
    }

    /// The wedge at `point`, which must be a corner.
    pub fn wedge_at(&self, point: u32) -> u32 {
        let corner = self.points.iter().position(|&p| p == point);
        self.wedges[corner.unwrap_or(0)]
    }
}

/// Points and their neighbourhoods. Lengths are in shares of the character's size, so that constants hold for any unit.
#[derive(Clone)]
pub(super) struct Surface<'a> {
    /// The full mesh, and behind its vertices those that refits have made.
    pub mesh: Mesh,
    /// Of the poses, and behind them the one at rest where it is known.
    palettes: Vec<&'a [Affine3A]>,
    /// The pose at rest where it is none of the weighted ones.
    pub rest: Option<usize>,
    /// Groups of [`LANES`] poses that have a weight.
    pub group_count: usize,
    /// Per palette joint, see [`PoseSet::heads`].
    heads: &'a [bool],
    /// Box of the full mesh in each pose: low and high corner.
    pub boxes: Vec<[[f32; 3]; 2]>,
    /// What stands at this surface's origin in the poses, `[3][pose_count]`.
    origins: Vec<f32>,
    /// Length in this surface's unit of one in the poses.
    scale: f32,
    /// Poses, a multiple of [`LANES`]; the last ones may be the one at rest and some to fill up, with a weight of 0.
    pub pose_count: usize,
    /// Sums to 1 over `[pose_count]`.
    pub pose_weights: Vec<f32>,
    /// `[point][3][pose_count]`.
    posed: Vec<f32>,
    /// Bind-space units in one unit of this surface.
    pub unit: f32,
    pub faces: Vec<Face>,
    pub faces_of: Vec<Vec<u32>>,
    /// Living wedges of each point; none for a dead one.
    pub wedges_of: Vec<Vec<u32>>,
    pub point_of_wedge: Vec<u32>,
    /// Points of other pieces that this one may contract with.
    pub links: Vec<Vec<u32>>,
    /// Area of each face as it is now, mean over the poses.
    pub areas: Vec<f32>,
    pub sequence: CollapseSequence,
}

impl<'a> Surface<'a> {
    pub fn new(mesh: &Mesh, poses: &'a PoseSet) -> Self {
        let (point_of_wedge, wedges_of) = points(mesh);
        let mut palettes: Vec<&[Affine3A]> = poses.poses.iter().map(|p| &p.palette[..]).collect();
        let rest = (!poses.rest.is_empty()).then_some(palettes.len());
        palettes.extend(rest.map(|_| &poses.rest[..]));
        let pose_count = palettes.len().next_multiple_of(LANES);
        let mut pose_weights: Vec<f32> = poses.poses.iter().map(|p| p.weight).collect();
        pose_weights.resize(pose_count, 0.0);

        let mut posed = vec![0.0; wedges_of.len() * 3 * pose_count];
        for (point, wedges) in wedges_of.iter().enumerate() {
            let w = wedges[0] as usize;
            let out = &mut posed[point * 3 * pose_count..][..3 * pose_count];
            for k in 0..pose_count {
                let palette = palettes[k.min(palettes.len() - 1)];
                let p = mesh.posed(palette, w);
                (out[k], out[pose_count + k], out[2 * pose_count + k]) = (p.x, p.y, p.z);
            }
        }
        let faces: Vec<Face> = mesh
            .triangles
            .iter()
            .map(|&wedges| Face {
                wedges,
                points: wedges.map(|w| point_of_wedge[w as usize]),
                alive: true,
            })
            .collect();
        let mut faces_of = vec![Vec::new(); wedges_of.len()];
        for (i, f) in faces.iter().enumerate() {
            for p in f.points {
                faces_of[p as usize].push(i as u32);
            }
        }
        let mut surface = Self {
            mesh: mesh.clone(),
            palettes,
            rest,
            group_count: poses.poses.len().div_ceil(LANES),
            heads: &poses.heads,
            boxes: Vec::new(),
            origins: Vec::new(),
            scale: 1.0,
            pose_count,
            pose_weights,
            posed,
            unit: 1.0,
            faces,
            links: vec![Vec::new(); wedges_of.len()],
            faces_of,
            wedges_of,
            point_of_wedge,
            areas: Vec::new(),
            sequence: CollapseSequence::default(),
        };
        surface.scale_to_unit_size();
        surface
    }

    /// Makes the bounding diagonal, mean over the poses, 1, and measures the faces.
    fn scale_to_unit_size(&mut self) {
        let n = self.pose_count;
        let bind_area = bind_area_of(&self.mesh);
        let mut diagonal = 0.0;
        for k in 0..n {
            let squared: f32 = (0..3)
                .map(|axis| {
                    let (mut low, mut high) = (f32::MAX, f32::MIN);
                    for p in self.posed.chunks_exact(3 * n) {
                        low = low.min(p[axis * n + k]);
                        high = high.max(p[axis * n + k]);
                    }
                    (high - low) * (high - low)
                })
                .sum();
            diagonal += self.pose_weights[k] * squared.sqrt();
        }
        let scale = if diagonal > 0.0 && diagonal.is_finite() {
            1.0 / diagonal
        } else {
            1.0
        };
        // Relative to the first pose's first vertex, so that a character far from its origin loses no digits.
        self.origins = self.posed.get(..3 * n).unwrap_or_default().to_vec();
        for axis in 0..3 {
            for k in 0..n {
                let origin = self.posed[axis * n + k];
                for p in self.posed.chunks_exact_mut(3 * n) {
                    p[axis * n + k] = (p[axis * n + k] - origin) * scale;
                }
            }
        }
        self.scale = scale;
        self.boxes = vec![[[f32::MAX; 3], [f32::MIN; 3]]; n];
        for p in self.posed.chunks_exact(3 * n) {
            for axis in 0..3 {
                for k in 0..n {
                    let [low, high] = &mut self.boxes[k];
                    low[axis] = low[axis].min(p[axis * n + k]);
                    high[axis] = high[axis].max(p[axis * n + k]);
                }
            }
        }
        self.areas = (self.faces.iter())
            .map(|f| self.face_area(f.points))
            .collect();
        let area: f64 = self.areas.iter().map(|&a| a as f64).sum();
        // Poses may be in other units than bind space (a skeleton scaled by 100): areas say by how much.
        self.unit = if area > 0.0 && bind_area > 0.0 {
            (bind_area / area).sqrt() as f32
        } else {
            1.0 / scale
        };
    }

    /// Whether `wedge` is of a head.
    pub fn is_head(&self, wedge: u32) -> bool {
        let w = wedge as usize;
        let influences = self.mesh.joints[w].into_iter().zip(self.mesh.weights[w]);
        let heads = influences.filter(|i| self.heads.get(i.0 as usize) == Some(&true));
        heads.map(|i| i.1).sum::<f32>() > 0.5
    }

    /// Where `point` is in every pose: x, y and z, `[pose_count]` each.
    pub fn at(&self, point: u32) -> [&[f32]; 3] {
        let n = self.pose_count;
        let p = &self.posed[point as usize * 3 * n..][..3 * n];
        [&p[..n], &p[n..2 * n], &p[2 * n..]]
    }

    /// The same as one slice, `[3][pose_count]`.
    pub fn posed_of(&self, point: u32) -> &[f32] {
        &self.posed[point as usize * 3 * self.pose_count..][..3 * self.pose_count]
    }

    /// How far a vertex with the skinning of `point` moves in each pose for a step of one in bind space.
    pub fn steps_of(&self, point: u32) -> Vec<Mat3> {
        let wedge = self.wedges_of[point as usize][0];
        (0..self.pose_count)
            .map(|k| self.step_of(wedge, k))
            .collect()
    }

    /// The same in pose `k` for the point of `wedge`.
    pub fn step_of(&self, wedge: u32, k: usize) -> Mat3 {
        let (m, w) = (&self.mesh, wedge as usize);
        let palette = self.palettes[k.min(self.palettes.len() - 1)];
        let of = |i: usize| {
            let joint = &palette[m.joints[w][i] as usize];
            Mat3::from(joint.matrix3) * (m.weights[w][i] * self.scale)
        };
        of(0) + of(1) + of(2) + of(3)
    }

    /// Puts `point` `offset` away, in bind space, from `start` (`[3][pose_count]`); `steps` as [`Surface::steps_of`] has
    /// them. Whether it is within the box of the full mesh in every pose that has a weight.
    pub fn place(&mut self, point: u32, start: &[f32], steps: &[Mat3], offset: Vec3) -> bool {
        let n = self.pose_count;
        let mut inside = true;
        let out = &mut self.posed[point as usize * 3 * n..][..3 * n];
        for (k, (step, [low, high])) in steps.iter().zip(&self.boxes).enumerate() {
            let shift = *step * offset;
            for axis in 0..3 {
                let x = start[axis * n + k] + shift[axis];
                inside &= self.pose_weights[k] <= 0.0 || x >= low[axis] && x <= high[axis];
                out[axis * n + k] = x;
            }
        }
        inside
    }

    /// From `from` to `to` in bind space.
    pub fn way(&self, from: u32, to: u32) -> Vec3 {
        let at = |p: u32| self.mesh.positions[self.wedges_of[p as usize][0] as usize];
        at(to) - at(from)
    }

    /// A new point where a vertex stands that is at `at` in bind space, without faces. The vertex is like `wedge` but for its
    /// skinning.
    pub fn add_point(&mut self, wedge: u32, at: Vec3, joints: [u8; 4], weights: [f32; 4]) -> u32 {
        let point = self.faces_of.len() as u32;
        let new = self.add_wedge(wedge);
        let (m, i) = (&mut self.mesh, new as usize);
        (m.positions[i], m.joints[i], m.weights[i]) = (at, joints, weights);
        self.point_of_wedge[i] = point;
        self.faces_of.push(Vec::new());
        self.links.push(Vec::new());
        self.wedges_of.push(vec![new]);
        let n = self.pose_count;
        let mut posed = vec![0.0; 3 * n];
        for k in 0..n {
            let palette = self.palettes[k.min(self.palettes.len() - 1)];
            let p = pose::skin(palette, joints.map(u16::from), weights, at);
            for (axis, x) in p.to_array().into_iter().enumerate() {
                posed[axis * n + k] = (x - self.origins[axis * n + k]) * self.scale;
            }
        }
        self.posed.extend(posed);
        point
    }

    /// Takes the points from `count` on away again, and their vertices from `vertex_count` on.
    pub fn drop_points(&mut self, count: usize, vertex_count: usize) {
        self.faces_of.truncate(count);
        self.links.truncate(count);
        self.wedges_of.truncate(count);
        self.posed.truncate(count * 3 * self.pose_count);
        self.drop_wedges(vertex_count);
    }

    /// A new vertex at the point of `wedge` and like it.
    pub fn add_wedge(&mut self, wedge: u32) -> u32 {
        let m = &mut self.mesh;
        let i = wedge as usize;
        m.positions.push(m.positions[i]);
        m.normals.push(m.normals[i]);
        m.uvs.push(m.uvs[i]);
        m.colors.push(m.colors[i]);
        m.layers.push(m.layers[i]);
        m.body_parts.push(m.body_parts[i]);
        m.joints.push(m.joints[i]);
        m.weights.push(m.weights[i]);
        m.submesh.push(m.submesh[i]);
        self.point_of_wedge.push(self.point_of_wedge[i]);
        self.point_of_wedge.len() as u32 - 1
    }

    /// A new vertex at `target` that looks like `wedge`, which is of another point.
    pub fn carry_wedge(&mut self, wedge: u32, target: u32) -> u32 {
        let new = self.add_wedge(wedge);
        // Wedges without a face may be where the point was before a refit.
        let faces = self.faces_of[target as usize].iter();
        let there = faces
            .map(|&f| self.faces[f as usize].wedge_at(target))
            .min();
        let there = there.unwrap_or(self.wedges_of[target as usize][0]) as usize;
        let (m, i) = (&mut self.mesh, new as usize);
        m.positions[i] = m.positions[there];
        m.joints[i] = m.joints[there];
        m.weights[i] = m.weights[there];
        self.point_of_wedge[i] = target;
        self.wedges_of[target as usize].push(new);
        new
    }

    /// Takes the vertices from `count` on away again; no face may use them.
    pub fn drop_wedges(&mut self, count: usize) {
        let m = &mut self.mesh;
        m.positions.truncate(count);
        m.normals.truncate(count);
        m.uvs.truncate(count);
        m.colors.truncate(count);
        m.layers.truncate(count);
        m.body_parts.truncate(count);
        m.joints.truncate(count);
        m.weights.truncate(count);
        m.submesh.truncate(count);
        self.point_of_wedge.truncate(count);
    }

    /// Lets `new` take the place of wedge `old` of `point`.
    pub fn replace_wedge(&mut self, point: u32, old: u32, new: u32) {
        let replace = |w: &mut u32| {
            if *w == old {
                *w = new;
            }
        };
        for &f in &self.faces_of[point as usize] {
            self.faces[f as usize].wedges.iter_mut().for_each(replace);
        }
        self.wedges_of[point as usize].iter_mut().for_each(replace);
    }

    /// Twice the area vector of the triangle of three points in pose `k`.
    pub fn normal(&self, points: [u32; 3], k: usize) -> [f32; 3] {
        let [a, b, c] = points.map(|p| self.at(p).map(|x| x[k]));
        let (u, v) = (sub(b, a), sub(c, a));
        cross(u, v)
    }

    /// Area of the triangle of three points, mean over the poses.
    pub fn face_area(&self, points: [u32; 3]) -> f32 {
        (0..self.pose_count)
            .map(|k| 0.5 * self.pose_weights[k] * length(self.normal(points, k)))
            .sum()
    }

    /// Points that share a face with `point` or are linked to it, ascending.
    pub fn neighbors(&self, point: u32, out: &mut Vec<u32>) {
        out.clear();
        for &f in &self.faces_of[point as usize] {
            out.extend(
                self.faces[f as usize]
                    .points
                    .iter()
                    .filter(|&&p| p != point),
            );
        }
        out.extend(&self.links[point as usize]);
        out.sort_unstable();
        out.dedup();
    }
}

/// Groups vertices into points: the point of each vertex, and the vertices of each point.
pub(super) fn points(mesh: &Mesh) -> (Vec<u32>, Vec<Vec<u32>>) {
    let mut index = HashMap::new();
    let mut wedges_of: Vec<Vec<u32>> = Vec::new();
    let point_of_wedge = (0..mesh.vertex_count())
        .map(|v| {
            let position = mesh.positions[v].to_array().map(f32::to_bits);
            let weights = mesh.weights[v].map(f32::to_bits);
            let point = *index
                .entry((position, mesh.joints[v], weights))
                .or_insert(wedges_of.len() as u32);
            if point as usize == wedges_of.len() {
                wedges_of.push(Vec::new());
            }
            wedges_of[point as usize].push(v as u32);
            point
        })
        .collect();
    (point_of_wedge, wedges_of)
}

/// Area of all triangles in bind space.
fn bind_area_of(mesh: &Mesh) -> f64 {
    mesh.triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|v| mesh.positions[v as usize].as_dvec3());
            0.5 * (b - a).cross(c - a).length()
        })
        .sum()
}

pub(super) fn sub(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(super) fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

pub(super) fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn length(a: [f32; 3]) -> f32 {
    dot(a, a).sqrt()
}
