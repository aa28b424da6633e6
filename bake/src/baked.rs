//! The baked character: plain arrays that upload as they are. [`crate::file`] stores exactly this.

use bytemuck::{Pod, Zeroable};
use glam::{Affine3A, Mat3A, Vec2, Vec3, Vec3A};
use serde::{Deserialize, Serialize};

use crate::character::{Clip, Node};
use crate::mesh::SubmeshInfo;

/// One baked character. Vertices, collapse entries, bands and indices of all submeshes stand one after the other.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Baked {
    /// Name of the character.
    pub name: String,
    /// Draws: one per submesh.
    pub submeshes: Vec<Submesh>,
    /// Quantised vertices, all submeshes.
    pub vertices: Vec<Vertex>,
    /// The collapse texture's texels, parallel to `vertices`.
    pub collapse: Vec<CollapseEntry>,
    /// Index windows, all submeshes, finest first within each.
    pub bands: Vec<Band>,
    /// Vertex numbers within their submesh, all bands.
    pub indices: Vec<u32>,
    /// Position that quantised 0 stands for, bind space.
    pub position_min: Vec3,
    /// Extent that quantised 65535 stands for.
    pub position_extent: Vec3,
    /// Texture coordinate that quantised 0 stands for.
    pub uv_min: Vec2,
    /// Extent that quantised 65535 stands for.
    pub uv_extent: Vec2,
    /// Names and tint rules of the body parts that `Vertex::body_part` indexes.
    pub body_parts: Vec<BodyPart>,
    /// `model_from_bind` as three rows, `[frame_count][joint_count][3]`.
    pub palette: Vec<PaletteEntry>,
    /// Where each clip's frames stand in the palette; never empty (the rest pose where the source has no clip).
    pub clips: Vec<BakedClip>,
    /// The skeleton as imported, for export and attachments.
    pub nodes: Vec<Node>,
    /// Palette joints.
    pub joints: Vec<crate::character::Joint>,
    /// The clips as imported, for export.
    pub source_clips: Vec<Clip>,
    /// The texture array; no layers where nothing is textured.
    pub textures: TextureArray,
    /// Largest collapse error, bind-space units.
    pub error_max: f32,
    /// Pictures for far agents, where they were captured.
    pub impostors: Option<crate::impostor::Impostors>,
}

/// A draw: vertices, bands and the state they need.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Submesh {
    /// State that makes it a draw of its own.
    pub info: SubmeshInfo,
    /// First of its vertices in [`Baked::vertices`].
    pub first_vertex: u32,
    /// Its vertices at full detail.
    pub vertex_count: u32,
    /// First of its bands in [`Baked::bands`].
    pub first_band: u32,
    /// Its bands.
    pub band_count: u32,
}

/// An index window: the triangles of a submesh alive when `vertex_count` vertices are, every corner moved to its living
/// ancestor. Instances with `k` live vertices draw the band with the smallest `vertex_count >= k`.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Band {
    /// First of its indices in [`Baked::indices`].
    pub first_index: u32,
    /// Three per triangle.
    pub index_count: u32,
    /// Live vertices; every index is below it.
    pub vertex_count: u32,
    /// Collapse error of the coarsest collapse already made in it, bind-space units.
    pub error: f32,
}

/// A vertex in 28 bytes. Positions and texture coordinates are 16-bit fractions of the character's extents.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Vertex {
    /// Fraction of [`Baked::position_extent`].
    pub position: [u16; 3],
    /// Texture layer, `Mesh::UNTEXTURED` for none.
    pub layer: u8,
    /// Body part.
    pub body_part: u8,
    /// Octahedral unit normal, signed 16-bit fractions.
    pub normal: [i16; 2],
    /// Fraction of [`Baked::uv_extent`].
    pub uv: [u16; 2],
    /// sRGB colour and linear alpha.
    pub color: [u8; 4],
    /// Palette joints by falling weight.
    pub joints: [u8; 4],
    /// Weights 1 to 3 as fractions of 1/2 (11 bits), 1/3 (11 bits) and 1/4 (10 bits), low bits first; weight 0 is the rest.
    /// Falling order makes these ranges sufficient.
    pub weights: u32,
}

/// A texel of the collapse texture.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct CollapseEntry {
    /// Half-edge collapse target, smaller than the vertex's own number; its own number for a vertex that never dies.
    pub parent: u32,
    /// The vertex is dead for LOD errors of at least this, bind-space units; infinite for one that never dies.
    /// Does not rise from one vertex of a submesh to the next.
    pub error: f32,
}

/// `model_from_bind` of one joint in one frame: rows of a 3x4 matrix.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct PaletteEntry {
    /// Row-major.
    pub rows: [[f32; 4]; 3],
}

impl PaletteEntry {
    /// The rows of `m`.
    pub fn from_affine(m: &Affine3A) -> Self {
        let (c, t) = (m.matrix3, m.translation);
        let row = |i: usize| [c.x_axis[i], c.y_axis[i], c.z_axis[i], t[i]];
        Self {
            rows: [row(0), row(1), row(2)],
        }
    }

    /// As a transform.
    pub fn to_affine(&self) -> Affine3A {
        let column = |i: usize| Vec3A::from([0, 1, 2].map(|row| self.rows[row][i]));
        Affine3A {
            matrix3: Mat3A::from_cols(column(0), column(1), column(2)),
            translation: column(3),
        }
    }
}

/// A clip's frames in the palette, and bounds that hold in all of them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BakedClip {
    /// Name in the source.
    pub name: String,
    /// First frame.
    pub first_frame: u32,
    /// Frames; the last one stands at `duration_s`, so a clip of one frame is a still.
    pub frame_count: u32,
    /// Seconds.
    pub duration_s: f32,
    /// Speed at which feet do not slide, metres per second along +Z, as the source states it or planted feet show it; 0 where
    /// neither does.
    pub ground_speed: f32,
    /// Box of every animated vertex at every frame, model space.
    pub box_min: Vec3,
    /// Its other corner.
    pub box_max: Vec3,
    /// Sphere of the same.
    pub sphere_center: Vec3,
    /// Its radius.
    pub sphere_radius: f32,
    /// Height of the ground that the character stands on, model space: the lowest that its feet come, where joints are named as
    /// such, else that anything does.
    pub ground: f32,
}

/// A body part, for colour variety.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BodyPart {
    /// Name of the source's material.
    pub name: String,
    /// How far an agent's tint may change it.
    pub tint: Tint,
}

/// How far an agent's tint may change a body part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[repr(u32)]
pub enum Tint {
    /// Never: eyes, teeth, textured wholes.
    Fixed = 0,
    /// A little lighter or darker, warmer or cooler: fur, and whatever should look as it was made, or nearly so.
    Natural = 1,
    /// Any hue, saturation and value: clothes.
    // Its name in files from before.
    #[serde(alias = "Free")]
    Cloth = 2,
    /// A person's, from dark to light.
    Skin = 3,
    /// A person's: black, brown, blond, red or grey.
    Hair = 4,
}

impl BodyPart {
    /// What vertices and impostors say of the body part with this index: everything that its tints follow from. All skin of an
    /// agent is of one tint, as is all hair; of what else there is, each part has its own.
    pub fn code(&self, index: u8) -> u8 {
        match self.tint {
            Tint::Skin => 3 << 6,
            Tint::Hair => 3 << 6 | 1 << 5,
            rule => (rule as u8) << 6 | index.min(63),
        }
    }
}

/// Equal-sized layers, 8-bit sRGB colour with linear alpha, full mip chains.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TextureArray {
    /// Pixels in a row of mip 0; 0 where there are no layers.
    pub width: u32,
    /// Rows of mip 0.
    pub height: u32,
    /// Layers.
    pub layer_count: u32,
    /// Mips, `width x height` halved (rounded down, at least 1) each time until 1x1.
    pub mip_count: u32,
    /// Mip 0 of all layers, then mip 1 of all layers, and so on.
    pub pixels: Vec<[u8; 4]>,
}
