//! Primitives become surfaces in their mesh's own space.

use glam::{Vec2, Vec3};

use super::data::Source;
use super::json::Primitive;
use super::materials::Materials;
use crate::error::ImportError;
use crate::import::files;
use crate::import::surface::{Influences, Surface};

/// Greatest number of vertices, and of triangles, of one character.
const MAX_COUNT: usize = 1 << 24;
/// Greatest number of `JOINTS_n` sets of a primitive.
const MAX_INFLUENCE_SETS: usize = 16;

/// A primitive of a node of the scene.
pub struct Draft {
    pub surface: Surface,
    /// Place in [`super::scene::Scene::nodes`] of the node that shows it.
    pub node: u32,
    /// The skin that its influences index the joints of; none where it is rigid.
    pub skin: Option<usize>,
}

/// What is read so far.
#[derive(Default)]
pub struct Primitives {
    pub drafts: Vec<Draft>,
    pub materials: Materials,
    pub warnings: Vec<String>,
    vertex_count: usize,
    triangle_count: usize,
}

impl Primitives {
    /// Reads the primitives of the file's node `node_index`, which stands at place `node`.
    pub fn read_node(
        &mut self,
        source: &Source,
        node_index: usize,
        node: u32,
    ) -> Result<(), ImportError> {
        let given = &source.document.nodes[node_index];
        let Some(mesh) = given.mesh else {
            return Ok(());
        };
        let place = format!("nodes[{node_index}]");
        let meshes = &source.document.meshes;
        let list = &source.get(meshes, mesh, "mesh", || format!("{place}.mesh"))?;
        if let Some(skin) = given.skin {
            source.get(&source.document.skins, skin, "skin", || {
                format!("{place}.skin")
            })?;
        }
        let name = given
            .name
            .as_deref()
            .or(list.name.as_deref())
            .map_or_else(|| format!("mesh{mesh}"), |n| files::shorten(n, 1024));
        for (i, primitive) in list.primitives.iter().enumerate() {
            let place = format!("meshes[{mesh}].primitives[{i}]");
            self.read_primitive(source, primitive, &place, &name, node, given.skin)?;
        }
        Ok(())
    }

    fn read_primitive(
        &mut self,
        source: &Source,
        primitive: &Primitive,
        place: &str,
        name: &str,
        node: u32,
        skin: Option<usize>,
    ) -> Result<(), ImportError> {
        match primitive.mode {
            4..=6 => {}
            0..=3 => {
                self.warnings
                    .push(format!("{place} is points or lines; it is left out"));
                return Ok(());
            }
            mode => return Err(source.bad(place, format!("mode {mode} does not exist"))),
        }
        if !primitive.targets.is_empty() {
            self.warnings.push(format!(
                "{place} has {} morph targets; it is drawn without them",
                primitive.targets.len()
            ));
        }
        let attribute = |key: &str| primitive.attributes.get(key).copied();
        let Some(position) = attribute("POSITION") else {
            self.warnings
                .push(format!("{place} has no positions; it is left out"));
            return Ok(());
        };
        let at = |key: &str| format!("{place}.attributes.{key}");
        // Where the extension is not required, the file holds the data plainly as well, or should.
        let plain = source.document.accessors.get(position);
        if plain.is_some_and(|a| a.buffer_view.is_none())
            && primitive
                .extensions
                .contains_key("KHR_draco_mesh_compression")
        {
            return Err(super::draco(source.path, place));
        }
        let positions = source.floats(position, &["VEC3"], &at("POSITION"))?;
        let count = positions.count();
        self.vertex_count += count;
        if self.vertex_count > MAX_COUNT {
            return Err(source.bad(place, format!("there are more than {MAX_COUNT} vertices")));
        }
        let read = |key: &str, kinds: &[&str]| match attribute(key) {
            None => Ok(None),
            Some(accessor) => {
                let elements = source.floats(accessor, kinds, &at(key))?;
                same_count(source, elements.count(), count, &at(key))?;
                Ok(Some(elements))
            }
        };
        let vec3 = |values: &[f32]| values.chunks_exact(3).map(Vec3::from_slice).collect();
        let mut surface = Surface {
            name: name.to_string(),
            positions: vec3(&positions.values),
            triangles: self.triangles(source, primitive, place, count)?,
            ..Surface::default()
        };
        if let Some(normals) = read("NORMAL", &["VEC3"])? {
            surface.normals = vec3(&normals.values);
        }
        if let Some(colors) = read("COLOR_0", &["VEC3", "VEC4"])? {
            let full = |c: &[f32]| [c[0], c[1], c[2], *c.get(3).unwrap_or(&1.0)];
            surface.colors = colors.values.chunks(colors.width).map(full).collect();
        }
        let material = self.materials.find(source, primitive.material, place)?;
        surface.material = material.index;
        let key = format!("TEXCOORD_{}", material.uv_set);
        if let Some(accessor) = attribute(&key) {
            let uvs = source.floats_unchecked(accessor, &["VEC2"], &at(&key))?;
            same_count(source, uvs.count(), count, &at(&key))?;
            let image_uv = |uv: &[f32]| {
                material
                    .image_from_uv
                    .transform_point2(Vec2::from_slice(uv))
            };
            surface.uvs = uvs.values.chunks_exact(2).map(image_uv).collect();
            if surface.uvs.iter().any(|uv| !uv.is_finite()) {
                surface.uvs = Vec::new();
                self.warnings
                    .push(format!("{} is not finite; it is left out", at(&key)));
            }
        }
        let skin = skin.filter(|_| primitive.attributes.contains_key("JOINTS_0"));
        if let Some(skin) = skin {
            surface.influences = influences(source, primitive, place, count, skin)?;
        }
        self.drafts.push(Draft {
            surface,
            node,
            skin,
        });
        Ok(())
    }

    /// The triangles of a list, strip or fan. Errors: an index that is not below `vertex_count`.
    fn triangles(
        &mut self,
        source: &Source,
        primitive: &Primitive,
        place: &str,
        vertex_count: usize,
    ) -> Result<Vec<[u32; 3]>, ImportError> {
        let indices = match primitive.indices {
            None => (0..vertex_count as u32).collect(),
            Some(accessor) => {
                let place = format!("{place}.indices");
                let indices = source.integers(accessor, &["SCALAR"], &place)?.values;
                if let Some(v) = indices.iter().find(|&&v| v as usize >= vertex_count) {
                    let reason = format!("vertex {v} does not exist: there are {vertex_count}");
                    return Err(source.bad(place, reason));
                }
                indices
            }
        };
        self.triangle_count += indices.len();
        if self.triangle_count > 3 * MAX_COUNT {
            return Err(source.bad(place, format!("there are more than {MAX_COUNT} triangles")));
        }
        Ok(match primitive.mode {
            4 => {
                if indices.len() % 3 != 0 {
                    self.warnings.push(format!(
                        "{place} has {} indices, which is not a multiple of 3; the last ones are left out",
                        indices.len()
                    ));
                }
                indices
                    .chunks_exact(3)
                    .map(|t| [t[0], t[1], t[2]])
                    .collect()
            }
            5 => indices
                .windows(3)
                .enumerate()
                .map(|(i, t)| [t[0], t[1 + i % 2], t[2 - i % 2]])
                .collect(),
            _ => indices
                .windows(2)
                .skip(1)
                .map(|t| [indices[0], t[0], t[1]])
                .collect(),
        })
    }
}

fn same_count(
    source: &Source,
    count: usize,
    positions: usize,
    place: &str,
) -> Result<(), ImportError> {
    if count == positions {
        return Ok(());
    }
    let reason = format!("it has {count} elements where there are {positions} positions");
    Err(source.bad(place, reason))
}

/// All influences of all vertices, joints as the skin counts them.
fn influences(
    source: &Source,
    primitive: &Primitive,
    place: &str,
    vertex_count: usize,
    skin: usize,
) -> Result<Influences, ImportError> {
    let joint_count = source.document.skins[skin].joints.len();
    let mut sets = Vec::new();
    for set in 0..MAX_INFLUENCE_SETS {
        let Some(&joints) = primitive.attributes.get(&format!("JOINTS_{set}")) else {
            break;
        };
        let at = |key: &str| format!("{place}.attributes.{key}_{set}");
        let Some(&weights) = primitive.attributes.get(&format!("WEIGHTS_{set}")) else {
            return Err(source.bad(at("WEIGHTS"), "it is missing where its JOINTS is there"));
        };
        let joints = source.integers(joints, &["VEC4"], &at("JOINTS"))?;
        same_count(source, joints.count(), vertex_count, &at("JOINTS"))?;
        let weights = source.floats(weights, &["VEC4"], &at("WEIGHTS"))?;
        same_count(source, weights.count(), vertex_count, &at("WEIGHTS"))?;
        let pairs = joints.values.iter().zip(&weights.values);
        for (i, (&joint, &weight)) in pairs.enumerate() {
            if weight < -1e-3 {
                let reason = format!("vertex {} has a negative weight", i / 4);
                return Err(source.bad(at("WEIGHTS"), reason));
            }
            if weight > 0.0 && joint as usize >= joint_count {
                let reason = format!(
                    "vertex {} names joint {joint}; skin {skin} has {joint_count}",
                    i / 4
                );
                return Err(source.bad(at("JOINTS"), reason));
            }
        }
        sets.push((joints.values, weights.values));
    }
    let width = 4 * sets.len();
    let mut of_vertices = Vec::with_capacity(width * vertex_count);
    for v in 0..vertex_count {
        for (joints, weights) in &sets {
            let pairs = joints[4 * v..][..4].iter().zip(&weights[4 * v..][..4]);
            of_vertices.extend(pairs.map(|(&j, &w)| if w > 0.0 { (j, w) } else { (0, 0.0) }));
        }
    }
    Ok(Influences { width, of_vertices })
}
