//! Merges a character's parts into one welded [`Mesh`] with as few submeshes as the draw state allows.
//!
//! Parts that differ only by texture or colour share a submesh: the colour goes into the vertices, the texture becomes a
//! layer of the character's texture array. What no pixel can show is dropped before welding (texture coordinates without a
//! texture, alpha tests that always pass), because every attribute that differs at a position is a vertex more in every
//! level of detail.

use std::collections::{HashMap, HashSet};

use glam::{Vec2, Vec3};

use crate::character::{Alpha, Character, Part};
use crate::error::BakeError;
use crate::mesh::{Mesh, SubmeshInfo};

/// Positions closer than this share of the bounding diagonal are one.
const POSITION_TOLERANCE: f32 = 1e-6;
/// Weights that differ less than this are the same skinning.
const WEIGHT_TOLERANCE: f32 = 1e-4;
/// Cosine of the angle (2 degrees) below which two normals are the same.
const NORMAL_COSINE: f32 = 0.9994;
/// Texture coordinates closer than this are the same: a quarter of a texel of a 4096-pixel image.
const UV_TOLERANCE: f32 = 1.0 / 16384.0;

/// One mesh from all parts of `character`.
///
/// Guarantees: deterministic; every triangle has three different points; vertices of one point have bit-equal positions,
/// joints and weights; no two triangles of a submesh have the same corners in the same order of turning.
/// Errors: [`BakeError::Limit`] where joints, materials, images or submeshes exceed what a vertex can index,
/// [`BakeError::Empty`] where every triangle is degenerate.
pub fn merge(character: &Character) -> Result<Mesh, BakeError> {
    let limit = |what, count: usize, limit: usize| {
        if count <= limit {
            return Ok(());
        }
        Err(BakeError::Limit {
            character: character.name.clone(),
            what,
            count: count as u64,
            limit: limit as u64,
        })
    };
    limit("palette joints", character.joints.len(), 256)?;
    limit("materials", character.materials.len(), 256)?;
    let images = used_images(character);
    limit("images", images.len(), Mesh::UNTEXTURED as usize)?;

    let mut welder = Welder::new(character);
    let mut seen = HashSet::new();
    for part in &character.parts {
        let submesh = welder.submesh(character, part);
        limit("submeshes", welder.mesh.submeshes.len(), 256)?;
        let source = PartAttributes::new(character, part, &images);
        let wedges: Vec<u32> = (0..part.positions.len())
            .map(|i| welder.weld(source.vertex(part, submesh, i)))
            .collect();
        for t in &part.triangles {
            let corners = t.map(|i| wedges[i as usize]);
            let points = corners.map(|w| welder.point_of_wedge[w as usize]);
            let [a, b, c] = points;
            if a != b && b != c && c != a && seen.insert((submesh, rotated(points))) {
                welder.mesh.triangles.push(corners);
            }
        }
    }
    let mut mesh = welder.mesh;
    if mesh.triangles.is_empty() {
        return Err(BakeError::Empty {
            character: character.name.clone(),
            reason: "every triangle is degenerate, there is nothing to draw",
        });
    }
    drop_unused_vertices(&mut mesh);
    move_islands_home(&mut mesh);
    Ok(mesh)
}

/// The images that some part shows, ascending: the layers of the texture array, in order.
pub fn used_images(character: &Character) -> Vec<u32> {
    let mut images: Vec<u32> = character
        .parts
        .iter()
        .filter(|p| !p.triangles.is_empty())
        .filter_map(|p| character.materials[p.material as usize].base_color_image)
        .collect();
    images.sort_unstable();
    images.dedup();
    images
}

/// The cutoff of the alpha test that `part` needs; `None` where no pixel can fail it.
fn effective_cutoff(character: &Character, part: &Part) -> Option<f32> {
    let material = &character.materials[part.material as usize];
    let Alpha::Mask(cutoff) = material.alpha else {
        return None;
    };
    let image_alpha = material.base_color_image.map_or(1.0, |i| {
        let pixels = &character.images[i as usize].pixels;
        pixels.iter().map(|p| p[3]).min().unwrap_or(255) as f32 / 255.0
    });
    let vertex_alpha = part.colors.iter().map(|c| c[3]).fold(1.0, f32::min);
    // Half a step of 8-bit alpha: what quantisation may take away.
    let least = image_alpha * vertex_alpha * material.base_color[3] - 0.5 / 255.0;
    (least < cutoff).then_some(cutoff)
}

/// A triangle's points with the smallest first, its turning direction kept.
fn rotated([a, b, c]: [u32; 3]) -> [u32; 3] {
    if a < b && a < c {
        [a, b, c]
    } else if b < c {
        [b, c, a]
    } else {
        [c, a, b]
    }
}

/// What is the same for all vertices of a part.
struct PartAttributes {
    base_color: [f32; 4],
    layer: u8,
    body_part: u8,
}

/// One source vertex as it will be drawn.
struct SourceVertex {
    position: Vec3,
    normal: Vec3,
    uv: Vec2,
    color: [u8; 4],
    layer: u8,
    body_part: u8,
    joints: [u8; 4],
    weights: [f32; 4],
    submesh: u8,
}

impl PartAttributes {
    fn new(character: &Character, part: &Part, images: &[u32]) -> Self {
        let material = &character.materials[part.material as usize];
        let layer = material
            .base_color_image
            .and_then(|image| images.binary_search(&image).ok());
        Self {
            base_color: material.base_color,
            layer: layer.map_or(Mesh::UNTEXTURED, |l| l as u8),
            body_part: part.material as u8,
        }
    }

    fn vertex(&self, part: &Part, submesh: u8, i: usize) -> SourceVertex {
        let mut color = self.base_color;
        if let Some(vertex_color) = part.colors.get(i) {
            color
                .iter_mut()
                .zip(vertex_color)
                .for_each(|(c, v)| *c *= v);
        }
        let textured = self.layer != Mesh::UNTEXTURED;
        let (joints, weights) = tidy_influences(part.joints[i], part.weights[i]);
        SourceVertex {
            position: part.positions[i],
            normal: part.normals[i].normalize_or(Vec3::Y),
            uv: match part.uvs.get(i) {
                Some(&uv) if textured => uv,
                _ => Vec2::ZERO,
            },
            color: [
                srgb8(color[0]),
                srgb8(color[1]),
                srgb8(color[2]),
                unit8(color[3]),
            ],
            layer: self.layer,
            body_part: self.body_part,
            joints,
            weights,
            submesh,
        }
    }
}

/// Influences by falling weight, ties by joint, each joint once, weights that sum to 1.
fn tidy_influences(joints: [u16; 4], weights: [f32; 4]) -> ([u8; 4], [f32; 4]) {
    let mut list: [(u16, f32); 4] = [(0, 0.0); 4];
    let mut count = 0;
    for (joint, weight) in joints.into_iter().zip(weights) {
        if weight <= 0.0 {
            continue;
        }
        match list[..count].iter_mut().find(|(j, _)| *j == joint) {
            Some((_, w)) => *w += weight,
            None => {
                list[count] = (joint, weight);
                count += 1;
            }
        }
    }
    list[..count].sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    let sum: f32 = list.iter().map(|x| x.1).sum();
    if sum <= 0.0 {
        return ([0; 4], [1.0, 0.0, 0.0, 0.0]);
    }
    (list.map(|x| x.0 as u8), list.map(|x| x.1 / sum))
}

/// A linear colour component as 8-bit sRGB.
fn srgb8(linear: f32) -> u8 {
    let c = linear.clamp(0.0, 1.0);
    unit8(if c <= 0.003_130_8 {
        12.92 * c
    } else {
        1.055 * c.powf(1.0 / 2.4) - 0.055
    })
}

fn unit8(x: f32) -> u8 {
    (x.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// Builds the mesh vertex by vertex; equal vertices come back as one.
struct Welder {
    mesh: Mesh,
    tolerance: f32,
    /// Points by cell of a grid four tolerances wide.
    cells: HashMap<[i64; 3], Vec<u32>>,
    /// Per point: its wedges.
    wedges_of_point: Vec<Vec<u32>>,
    point_of_wedge: Vec<u32>,
}

impl Welder {
    fn new(character: &Character) -> Self {
        let (mut low, mut high) = (Vec3::MAX, Vec3::MIN);
        for p in character.parts.iter().flat_map(|p| &p.positions) {
            low = low.min(*p);
            high = high.max(*p);
        }
        Self {
            mesh: Mesh::default(),
            tolerance: ((high - low).max(Vec3::ZERO).length() * POSITION_TOLERANCE)
                .max(f32::MIN_POSITIVE),
            cells: HashMap::new(),
            wedges_of_point: Vec::new(),
            point_of_wedge: Vec::new(),
        }
    }

    /// The submesh with the draw state that `part` needs, made where it is the first.
    fn submesh(&mut self, character: &Character, part: &Part) -> u8 {
        let material = &character.materials[part.material as usize];
        let alpha_cutoff = effective_cutoff(character, part);
        let submeshes = &mut self.mesh.submeshes;
        let same = submeshes.iter().position(|s| {
            s.double_sided == material.double_sided && s.alpha_cutoff == alpha_cutoff
        });
        let index = same.unwrap_or_else(|| {
            submeshes.push(SubmeshInfo {
                name: String::new(),
                double_sided: material.double_sided,
                alpha_cutoff,
            });
            submeshes.len() - 1
        });
        let name = &mut submeshes[index].name;
        if !name.split(", ").any(|n| n == material.name) {
            if !name.is_empty() {
                name.push_str(", ");
            }
            name.push_str(&material.name);
        }
        // More than 256 are refused right after this.
        index as u8
    }

    /// The wedge for `v`: an existing one that looks the same, else a new one.
    fn weld(&mut self, v: SourceVertex) -> u32 {
        let point = self.point(&v);
        let m = &self.mesh;
        let same = self.wedges_of_point[point as usize]
            .iter()
            .copied()
            .find(|&w| {
                let i = w as usize;
                m.submesh[i] == v.submesh
                    && m.layers[i] == v.layer
                    && m.body_parts[i] == v.body_part
                    && m.colors[i] == v.color
                    && m.uvs[i].distance(v.uv) <= UV_TOLERANCE
                    && m.normals[i].dot(v.normal) >= NORMAL_COSINE
            });
        if let Some(wedge) = same {
            return wedge;
        }
        let wedge = m.vertex_count() as u32;
        // The point's first wedge says what position and skinning are, to the bit.
        let twin = self.wedges_of_point[point as usize].first().copied();
        let (position, joints, weights) = match twin.map(|t| t as usize) {
            Some(t) => (m.positions[t], m.joints[t], m.weights[t]),
            None => (v.position, v.joints, v.weights),
        };
        let m = &mut self.mesh;
        m.positions.push(position);
        m.joints.push(joints);
        m.weights.push(weights);
        m.normals.push(v.normal);
        m.uvs.push(v.uv);
        m.colors.push(v.color);
        m.layers.push(v.layer);
        m.body_parts.push(v.body_part);
        m.submesh.push(v.submesh);
        self.wedges_of_point[point as usize].push(wedge);
        self.point_of_wedge.push(point);
        wedge
    }

    /// The point with the position and skinning of `v`, made where there is none yet.
    fn point(&mut self, v: &SourceVertex) -> u32 {
        let width = 4.0 * self.tolerance as f64;
        let cell = |offset: f64| {
            v.position
                .to_array()
                .map(|x| ((x as f64 + offset) / width).floor() as i64)
        };
        let (low, high) = (cell(-self.tolerance as f64), cell(self.tolerance as f64));
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    for &point in self.cells.get(&[x, y, z]).into_iter().flatten() {
                        let wedge = self.wedges_of_point[point as usize][0] as usize;
                        let m = &self.mesh;
                        if m.positions[wedge].distance(v.position) <= self.tolerance
                            && same_skinning(
                                (m.joints[wedge], m.weights[wedge]),
                                (v.joints, v.weights),
                            )
                        {
                            return point;
                        }
                    }
                }
            }
        }
        let point = self.wedges_of_point.len() as u32;
        self.wedges_of_point.push(Vec::new());
        self.cells.entry(cell(0.0)).or_default().push(point);
        point
    }
}

fn same_skinning(a: ([u8; 4], [f32; 4]), b: ([u8; 4], [f32; 4])) -> bool {
    let covers = |a: ([u8; 4], [f32; 4]), b: ([u8; 4], [f32; 4])| {
        (0..4).all(|i| {
            let same: f32 = (0..4).filter(|&k| b.0[k] == a.0[i]).map(|k| b.1[k]).sum();
            a.1[i] == 0.0 || (a.1[i] - same).abs() <= WEIGHT_TOLERANCE
        })
    };
    covers(a, b) && covers(b, a)
}

/// Keeps the vertices that triangles use, in order.
fn drop_unused_vertices(mesh: &mut Mesh) {
    let mut used = vec![false; mesh.vertex_count()];
    for &v in mesh.triangles.iter().flatten() {
        used[v as usize] = true;
    }
    if used.iter().all(|&u| u) {
        return;
    }
    let mut next = 0;
    let new_index: Vec<u32> = used
        .iter()
        .map(|&u| {
            next += u as u32;
            next.wrapping_sub(1)
        })
        .collect();
    fn keep<T>(list: &mut Vec<T>, used: &[bool]) {
        let mut flags = used.iter();
        list.retain(|_| *flags.next().unwrap_or(&false));
    }
    keep(&mut mesh.positions, &used);
    keep(&mut mesh.normals, &used);
    keep(&mut mesh.uvs, &used);
    keep(&mut mesh.colors, &used);
    keep(&mut mesh.layers, &used);
    keep(&mut mesh.body_parts, &used);
    keep(&mut mesh.joints, &used);
    keep(&mut mesh.weights, &used);
    keep(&mut mesh.submesh, &used);
    for v in mesh.triangles.iter_mut().flatten() {
        *v = new_index[*v as usize];
    }
}

/// Moves UV islands by whole repeats of their texture to around the first one: the picture stays the same, and the range
/// that 16 bits have to cover shrinks.
fn move_islands_home(mesh: &mut Mesh) {
    let mut island: Vec<u32> = (0..mesh.vertex_count() as u32).collect();
    fn root(island: &mut [u32], mut i: u32) -> u32 {
        while island[i as usize] != i {
            island[i as usize] = island[island[i as usize] as usize];
            i = island[i as usize];
        }
        i
    }
    for t in &mesh.triangles {
        let a = root(&mut island, t[0]);
        for &corner in &t[1..] {
            let b = root(&mut island, corner);
            island[b as usize] = a;
        }
    }
    let mut bounds = vec![(Vec2::MAX, Vec2::MIN); mesh.vertex_count()];
    for v in 0..mesh.vertex_count() {
        let (low, high) = &mut bounds[root(&mut island, v as u32) as usize];
        *low = low.min(mesh.uvs[v]);
        *high = high.max(mesh.uvs[v]);
    }
    for v in 0..mesh.vertex_count() {
        if mesh.layers[v] != Mesh::UNTEXTURED {
            let (low, high) = bounds[root(&mut island, v as u32) as usize];
            mesh.uvs[v] -= ((low + high) * 0.5).floor();
        }
    }
}
