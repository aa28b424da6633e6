//! A piece of surface on its way from a source file to a [`Part`]: checks, missing normals, unused vertices.

use std::collections::HashMap;

use glam::{DAffine3, DMat3, DVec3, Vec2, Vec3};

use crate::character::{Alpha, Part};

/// Where a file has no normals, faces that meet at a greater angle than this stay a visible edge.
const CREASE_COS: f32 = 0.5; // 60 degrees
/// Corners at one position above which no crease is looked for: the search is quadratic in them.
const MAX_CREASE_CORNERS: usize = 64;

/// A primitive of a source file. Per-vertex arrays have one entry per vertex, or none.
#[derive(Default)]
pub(super) struct Surface {
    pub name: String,
    /// Index into the character's materials.
    pub material: u32,
    pub positions: Vec<Vec3>,
    pub normals: Vec<Vec3>,
    pub uvs: Vec<Vec2>,
    pub colors: Vec<[f32; 4]>,
    pub influences: Influences,
    pub triangles: Vec<[u32; 3]>,
}

/// Joints and weights of vertices, any number of influences each.
#[derive(Default, Clone)]
pub(super) struct Influences {
    /// Influences of one vertex; 0 where nothing is bound yet.
    pub width: usize,
    /// `[vertex_count * width]`: joint and weight; a weight of 0 means nothing.
    pub of_vertices: Vec<(u32, f32)>,
}

impl Influences {
    /// The influences of vertex `v`.
    pub fn of(&self, v: usize) -> &[(u32, f32)] {
        &self.of_vertices[v * self.width..][..self.width]
    }
}

impl Surface {
    /// Drops triangles without area: those that name one vertex twice, or two vertices that move as one.
    pub fn drop_degenerate(&mut self) {
        let mut triangles = std::mem::take(&mut self.triangles);
        triangles.retain(|&[a, b, c]| {
            let same = |a: u32, b: u32| {
                let (a, b) = (a as usize, b as usize);
                a == b
                    || self.positions[a] == self.positions[b]
                        && self.influences.of(a) == self.influences.of(b)
            };
            !(same(a, b) || same(b, c) || same(c, a))
        });
        self.triangles = triangles;
    }

    /// Drops vertices that no triangle names; the others keep their order.
    pub fn drop_unused(&mut self) {
        let mut new_index = vec![u32::MAX; self.positions.len()];
        for &v in self.triangles.iter().flatten() {
            new_index[v as usize] = 0;
        }
        let kept: Vec<u32> = (0..new_index.len() as u32)
            .filter(|&v| new_index[v as usize] == 0)
            .collect();
        if kept.len() == new_index.len() {
            return;
        }
        for (new, &old) in kept.iter().enumerate() {
            new_index[old as usize] = new as u32;
        }
        self.gather(&kept);
        for v in self.triangles.iter_mut().flatten() {
            *v = new_index[*v as usize];
        }
    }

    /// Makes vertex `i` a copy of the present vertex `from[i]`; triangles stay as they are.
    fn gather(&mut self, from: &[u32]) {
        fn pick<T: Copy>(values: &mut Vec<T>, from: &[u32]) {
            if !values.is_empty() {
                *values = from.iter().map(|&v| values[v as usize]).collect();
            }
        }
        pick(&mut self.positions, from);
        pick(&mut self.normals, from);
        pick(&mut self.uvs, from);
        pick(&mut self.colors, from);
        let influences = &self.influences;
        self.influences.of_vertices = from
            .iter()
            .flat_map(|&v| influences.of(v as usize))
            .copied()
            .collect();
    }

    /// Moves the surface by `new_from_old`: positions, normals (by the inverse transpose), and the winding where it mirrors.
    pub fn transform(&mut self, new_from_old: &DAffine3) {
        for p in &mut self.positions {
            *p = new_from_old.transform_point3(p.as_dvec3()).as_vec3();
        }
        let linear: DMat3 = new_from_old.matrix3;
        let normal_matrix = linear.inverse().transpose();
        for n in &mut self.normals {
            *n = (normal_matrix * n.as_dvec3()).normalize_or_zero().as_vec3();
        }
        if linear.determinant() < 0.0 {
            for [_, b, c] in &mut self.triangles {
                std::mem::swap(b, c);
            }
        }
    }

    /// The corners of the box around all positions; there is at least one.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let start = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        self.positions.iter().fold(start, |(low, high), p| {
            (low.min(p.as_dvec3()), high.max(p.as_dvec3()))
        })
    }

    /// Gives every vertex a unit normal: the file's own where it has one, else one made from the faces around it,
    /// weighted by their angles. Returns how many of the file's normals had no direction.
    ///
    /// glTF asks for flat faces where there are no normals. Characters without them are smooth surfaces whose exporter
    /// left them out, so faces that meet at less than 60 degrees are smoothed here, across vertices at one position;
    /// at sharper edges vertices are doubled, the copies appended behind the others.
    pub fn complete_normals(&mut self) -> usize {
        if self.normals.is_empty() {
            self.make_normals();
            return 0;
        }
        let usable = |n: &Vec3| n.length_squared() > 1e-12;
        let missing = self.normals.iter().filter(|n| !usable(n)).count();
        for n in &mut self.normals {
            *n = if usable(n) { n.normalize() } else { Vec3::ZERO };
        }
        if missing > 0 {
            let mut sums = vec![Vec3::ZERO; self.positions.len()];
            for (corner, normal) in self.corner_normals().into_iter().enumerate() {
                sums[self.triangles[corner / 3][corner % 3] as usize] += normal;
            }
            for (n, sum) in self.normals.iter_mut().zip(sums) {
                if *n == Vec3::ZERO {
                    *n = sum.try_normalize().unwrap_or(Vec3::Y);
                }
            }
        }
        missing
    }

    /// One normal a corner, `[3 * triangle_count]`, then one a vertex by doubling vertices whose corners differ.
    fn make_normals(&mut self) {
        let corners = self.corner_normals();
        let vertex_count = self.positions.len();
        let mut from: Vec<u32> = (0..vertex_count as u32).collect();
        let mut normals: Vec<Option<Vec3>> = vec![None; vertex_count];
        // The copies of a vertex, as a list: the next one, or none.
        let mut next: Vec<Option<u32>> = vec![None; vertex_count];
        for (corner, normal) in corners.into_iter().enumerate() {
            let v = &mut self.triangles[corner / 3][corner % 3];
            let source = *v;
            loop {
                let at = *v as usize;
                match normals[at] {
                    None => normals[at] = Some(normal),
                    Some(n) if n.dot(normal) > 0.9999 => {}
                    Some(_) => {
                        *v = *next[at].get_or_insert(from.len() as u32);
                        if *v as usize == from.len() {
                            from.push(source);
                            normals.push(None);
                            next.push(None);
                        }
                        continue;
                    }
                }
                break;
            }
        }
        self.gather(&from);
        self.normals = normals.into_iter().map(|n| n.unwrap_or(Vec3::Y)).collect();
    }

    /// The smoothed normal at every corner of every triangle.
    fn corner_normals(&self) -> Vec<Vec3> {
        let position = |v: u32| self.positions[v as usize];
        let mut faces = Vec::with_capacity(self.triangles.len());
        let mut weights = Vec::with_capacity(3 * self.triangles.len());
        let mut groups: HashMap<[u32; 3], Vec<u32>> = HashMap::new();
        for (t, triangle) in self.triangles.iter().enumerate() {
            let [a, b, c] = triangle.map(position);
            faces.push((b - a).cross(c - a).normalize_or_zero());
            for (k, (from, to, back)) in [(a, b, c), (b, c, a), (c, a, b)].into_iter().enumerate() {
                let (u, v) = (to - from, back - from);
                weights.push(u.cross(v).length().atan2(u.dot(v)));
                // Adding zero makes -0 and 0 one key.
                let key = (from + Vec3::ZERO).to_array().map(f32::to_bits);
                groups.entry(key).or_default().push((3 * t + k) as u32);
            }
        }
        let mut normals = vec![Vec3::Y; weights.len()];
        for group in groups.values() {
            for &corner in group {
                let own = faces[corner as usize / 3];
                let smooth = |other: &&u32| {
                    group.len() > MAX_CREASE_CORNERS
                        || own.dot(faces[**other as usize / 3]) >= CREASE_COS
                };
                let others = if group.len() > MAX_CREASE_CORNERS && corner != group[0] {
                    normals[corner as usize] = normals[group[0] as usize];
                    continue;
                } else {
                    group.iter().filter(smooth)
                };
                let sum: Vec3 = others
                    .map(|&o| faces[o as usize / 3] * weights[o as usize])
                    .sum();
                normals[corner as usize] = sum
                    .try_normalize()
                    .or_else(|| own.try_normalize())
                    .unwrap_or(Vec3::Y);
            }
        }
        normals
    }

    /// The finished part, its joints and weights still empty.
    pub fn into_part(self) -> (Part, Influences) {
        let part = Part {
            name: self.name,
            material: self.material,
            positions: self.positions,
            normals: self.normals,
            uvs: self.uvs,
            colors: self.colors,
            joints: Vec::new(),
            weights: Vec::new(),
            triangles: self.triangles,
        };
        (part, self.influences)
    }
}

/// Alpha below which a blended material is meant not to be seen.
const INVISIBLE_ALPHA: f32 = 0.02;

/// What stands for a blended material, and the warning that says so: crowds are drawn without sorting. Glass and the
/// like become opaque; a texture's alpha cuts out.
pub(super) fn unblended(
    material: &str,
    base_color: &mut [f32; 4],
    textured: bool,
) -> (Alpha, String) {
    let seen = base_color[3] >= INVISIBLE_ALPHA;
    if seen {
        base_color[3] = 1.0;
    }
    let (alpha, how) = match (seen, textured) {
        (false, _) => (Alpha::Mask(0.5), "not at all, as its alpha is near 0"),
        (true, true) => (
            Alpha::Mask(0.5),
            "where its texture's alpha is at least 0.5",
        ),
        (true, false) => (Alpha::Opaque, "opaque"),
    };
    (
        alpha,
        format!("material '{material}' is blended; it is drawn {how}"),
    )
}
