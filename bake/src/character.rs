//! The imported character: what every importer produces and everything after it consumes.
//!
//! Units are the source's own (glTF: metres), +Y up, facing +Z, right-handed. Flat arrays; an index never points outside
//! its array ([`Character::validate`] is what proves it, and every importer ends with it).

use glam::{Affine3A, Mat4, Quat, Vec2, Vec3};
use serde::{Deserialize, Serialize};

use crate::error::ImportError;

/// One rigged character, or a static model: then it has one joint, the identity, and no clips.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Character {
    /// File stem, or the name that the source states.
    pub name: String,
    /// Drawable pieces, one per source primitive; never empty.
    pub parts: Vec<Part>,
    /// Materials that `Part::material` indexes; never empty.
    pub materials: Vec<Material>,
    /// Decoded images that materials index.
    pub images: Vec<Image>,
    /// The whole transform hierarchy that joints hang in; a node's parent comes before it.
    pub nodes: Vec<Node>,
    /// Skinning joints: what `Part::joints` indexes and what the palette has an entry for; never empty.
    pub joints: Vec<Joint>,
    /// Animation clips.
    pub clips: Vec<Clip>,
    /// What was dropped or repaired while importing, one sentence each, for the user.
    pub warnings: Vec<String>,
}

/// Triangles with one material. All per-vertex arrays have one entry per vertex, or none where said.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Part {
    /// Name of the source mesh or object.
    pub name: String,
    /// Index into [`Character::materials`].
    pub material: u32,
    /// Positions in bind space, `[vertex_count]`.
    pub positions: Vec<Vec3>,
    /// Unit normals in bind space, `[vertex_count]`; generated where the source has none.
    pub normals: Vec<Vec3>,
    /// Texture coordinates (origin top left, as glTF), `[vertex_count]` or empty.
    pub uvs: Vec<Vec2>,
    /// Linear RGBA that multiplies the material's base colour, `[vertex_count]` or empty.
    pub colors: Vec<[f32; 4]>,
    /// Indices into [`Character::joints`], `[vertex_count]`; sorted by falling weight, unused ones 0.
    pub joints: Vec<[u16; 4]>,
    /// Weights of `joints`, `[vertex_count]`; not negative, they sum to 1.
    pub weights: Vec<[f32; 4]>,
    /// Counter-clockwise triangles, indices into the per-vertex arrays.
    pub triangles: Vec<[u32; 3]>,
}

/// How a surface's colour and coverage are made.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// Name in the source; colour variety goes by it.
    pub name: String,
    /// Linear RGBA factor.
    pub base_color: [f32; 4],
    /// Index into [`Character::images`], sampled with `Part::uvs`, sRGB.
    pub base_color_image: Option<u32>,
    /// What alpha means.
    pub alpha: Alpha,
    /// Both faces are drawn.
    pub double_sided: bool,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: String::new(),
            base_color: [1.0; 4],
            base_color_image: None,
            alpha: Alpha::Opaque,
            double_sided: false,
        }
    }
}

/// What a material's alpha means.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Alpha {
    /// Ignored.
    #[default]
    Opaque,
    /// A pixel is there where alpha is at least the cutoff. Blended materials import as a mask of 0.5 with a warning.
    Mask(f32),
}

/// A decoded image: 8-bit sRGB colour and linear alpha, rows from the top.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Image {
    /// Name or file of the source.
    pub name: String,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `[width * height]`.
    pub pixels: Vec<[u8; 4]>,
}

/// Translation, rotation, scale: applied in the order scale, rotation, translation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Transform {
    /// In the parent's units.
    pub translation: Vec3,
    /// Unit quaternion.
    pub rotation: Quat,
    /// Per axis.
    pub scale: Vec3,
}

impl Transform {
    /// Leaves everything where it is.
    pub const IDENTITY: Self = Self {
        translation: Vec3::ZERO,
        rotation: Quat::IDENTITY,
        scale: Vec3::ONE,
    };

    /// The same as a matrix, `parent_from_node`.
    pub fn to_affine(&self) -> Affine3A {
        Affine3A::from_scale_rotation_translation(self.scale, self.rotation, self.translation)
    }
}

/// One transform of the hierarchy.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Node {
    /// Name in the source.
    pub name: String,
    /// Index of the parent, smaller than the node's own.
    pub parent: Option<u32>,
    /// `parent_from_node` where no clip says otherwise.
    pub rest: Transform,
}

/// The axis that points up in a character's file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum UpAxis {
    /// +Y, as glTF has it and most OBJ files do.
    #[default]
    Y,
    /// +Z, as scanners, CAD programs and maps have it; what looks along -Y there faces +Z then.
    Z,
}

/// A node that vertices are bound to.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Joint {
    /// Index into [`Character::nodes`].
    pub node: u32,
    /// The inverse bind matrix, affine: bind space to the node's space.
    pub joint_from_bind: Mat4,
}

/// An animation: keys for some properties of some nodes, from time 0 to its duration.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Clip {
    /// Name in the source.
    pub name: String,
    /// Seconds; the greatest key time.
    pub duration_s: f32,
    /// Speed at which feet do not slide, metres per second along +Z; 0 where unknown. glTF: `extras.ground_speed`.
    pub ground_speed: f32,
    /// At most one per node and property.
    pub tracks: Vec<Track>,
}

/// Keys of one property of one node.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// Index into [`Character::nodes`].
    pub node: u32,
    /// What is animated; it says how many floats a value has.
    pub property: Property,
    /// How to read between keys.
    pub interpolation: Interpolation,
    /// Rising key times in seconds; never empty.
    pub times_s: Vec<f32>,
    /// `[times * width]`; cubic spline: `[times * 3 * width]` as in-tangent, value, out-tangent.
    pub values: Vec<f32>,
}

/// What a track animates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[repr(u32)]
pub enum Property {
    /// 3 floats.
    Translation = 0,
    /// 4 floats, x y z w.
    Rotation = 1,
    /// 3 floats.
    Scale = 2,
}

impl Property {
    /// Floats in one value.
    pub fn width(self) -> usize {
        match self {
            Self::Translation | Self::Scale => 3,
            Self::Rotation => 4,
        }
    }
}

/// How a track reads between two keys.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[repr(u32)]
pub enum Interpolation {
    /// The earlier key.
    Step = 0,
    /// Straight, spherical for rotations.
    Linear = 1,
    /// Hermite with the keys' tangents.
    CubicSpline = 2,
}

impl Character {
    /// Triangles of all parts.
    pub fn triangle_count(&self) -> usize {
        self.parts.iter().map(|p| p.triangles.len()).sum()
    }

    /// Vertices of all parts.
    pub fn vertex_count(&self) -> usize {
        self.parts.iter().map(|p| p.positions.len()).sum()
    }

    /// Checks every invariant that this module's documentation states.
    ///
    /// Errors: [`ImportError::Malformed`] with the part, node or clip and the reason.
    pub fn validate(&self, path: &std::path::Path) -> Result<(), ImportError> {
        let bad = |place: String, reason: &str| ImportError::malformed(path, place, reason);
        let all_finite = |v: &[f32]| v.iter().all(|x| x.is_finite());
        if self.parts.is_empty() {
            return Err(bad("meshes".into(), "there are no triangles to draw"));
        }
        if self.joints.is_empty() || self.materials.is_empty() {
            return Err(bad("character".into(), "it has no joint or no material"));
        }
        for (i, p) in self.parts.iter().enumerate() {
            let place = || format!("part {i} '{}'", p.name);
            let n = p.positions.len();
            let same = p.normals.len() == n
                && p.joints.len() == n
                && p.weights.len() == n
                && (p.uvs.is_empty() || p.uvs.len() == n)
                && (p.colors.is_empty() || p.colors.len() == n);
            if !same {
                return Err(bad(place(), "its vertex arrays differ in length"));
            }
            if p.material as usize >= self.materials.len() {
                return Err(bad(place(), "its material does not exist"));
            }
            if p.triangles.is_empty() || p.triangles.iter().flatten().any(|&v| v as usize >= n) {
                return Err(bad(
                    place(),
                    "it has no triangles, or one names a vertex that does not exist",
                ));
            }
            if p.joints
                .iter()
                .flatten()
                .any(|&j| j as usize >= self.joints.len())
            {
                return Err(bad(place(), "a vertex names a joint that does not exist"));
            }
            let finite = all_finite(bytemuck::cast_slice(&p.positions))
                && all_finite(bytemuck::cast_slice(&p.normals))
                && all_finite(bytemuck::cast_slice(&p.uvs))
                && all_finite(p.colors.as_flattened())
                && all_finite(p.weights.as_flattened());
            if !finite {
                return Err(bad(
                    place(),
                    "a vertex attribute is infinite or not a number",
                ));
            }
            let off = |w: &[f32; 4]| {
                w.iter().any(|&x| x < 0.0) || (w.iter().sum::<f32>() - 1.0).abs() > 1e-3
            };
            if p.weights.iter().any(off) {
                return Err(bad(
                    place(),
                    "a vertex's weights are negative or do not sum to 1",
                ));
            }
        }
        for (i, m) in self.materials.iter().enumerate() {
            if m.base_color_image
                .is_some_and(|x| x as usize >= self.images.len())
                || !all_finite(&m.base_color)
            {
                return Err(bad(
                    format!("material {i} '{}'", m.name),
                    "its image does not exist or its colour is not finite",
                ));
            }
        }
        for (i, x) in self.images.iter().enumerate() {
            if x.width == 0
                || x.height == 0
                || x.pixels.len() as u64 != x.width as u64 * x.height as u64
            {
                return Err(bad(
                    format!("image {i} '{}'", x.name),
                    "its size and its pixels differ",
                ));
            }
        }
        for (i, n) in self.nodes.iter().enumerate() {
            let r = &n.rest;
            if n.parent.is_some_and(|p| p as usize >= i) {
                return Err(bad(
                    format!("node {i} '{}'", n.name),
                    "its parent does not come before it",
                ));
            }
            if !(r.translation.is_finite() && r.rotation.is_finite() && r.scale.is_finite()) {
                return Err(bad(
                    format!("node {i} '{}'", n.name),
                    "its transform is not finite",
                ));
            }
        }
        for (i, j) in self.joints.iter().enumerate() {
            if j.node as usize >= self.nodes.len() || !j.joint_from_bind.is_finite() {
                return Err(bad(
                    format!("joint {i}"),
                    "its node does not exist or its inverse bind matrix is not finite",
                ));
            }
        }
        for c in &self.clips {
            let place = || format!("clip '{}'", c.name);
            if !(c.duration_s.is_finite() && c.duration_s >= 0.0) {
                return Err(bad(place(), "its duration is not a finite time"));
            }
            for t in &c.tracks {
                let values = t.property.width()
                    * if t.interpolation == Interpolation::CubicSpline {
                        3
                    } else {
                        1
                    };
                if t.node as usize >= self.nodes.len()
                    || t.times_s.is_empty()
                    || t.values.len() != t.times_s.len() * values
                {
                    return Err(bad(
                        place(),
                        "a track's node does not exist, or its keys and values differ in number",
                    ));
                }
                if !all_finite(&t.times_s)
                    || !all_finite(&t.values)
                    || t.times_s.windows(2).any(|w| w[1] < w[0])
                {
                    return Err(bad(
                        place(),
                        "a track's keys are not finite or its times fall",
                    ));
                }
            }
        }
        Ok(())
    }
}
