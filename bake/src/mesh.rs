//! The character as simplification sees it: one indexed mesh over all submeshes.

use glam::{Affine3A, Vec2, Vec3};

use crate::pose;

/// One mesh for the whole character. Every triangle lies in one submesh; per-vertex arrays are `[vertex_count]`.
///
/// Vertices with bit-equal positions and skinning are wedges of one *point* and move together.
#[derive(Debug, Clone, Default)]
pub struct Mesh {
    /// Submeshes; `Mesh::submesh` indexes them.
    pub submeshes: Vec<SubmeshInfo>,
    /// Bind-space positions.
    pub positions: Vec<Vec3>,
    /// Unit normals in bind space.
    pub normals: Vec<Vec3>,
    /// Texture coordinates; zero where the vertex has no texture.
    pub uvs: Vec<Vec2>,
    /// sRGB colour and linear alpha: material factor times vertex colour.
    pub colors: Vec<[u8; 4]>,
    /// Layer of the character's texture array; [`Mesh::UNTEXTURED`] where there is none.
    pub layers: Vec<u8>,
    /// Body part: index of the source's material.
    pub body_parts: Vec<u8>,
    /// Palette joints by falling weight.
    pub joints: Vec<[u8; 4]>,
    /// Weights that sum to 1.
    pub weights: Vec<[f32; 4]>,
    /// Submesh of each vertex.
    pub submesh: Vec<u8>,
    /// Counter-clockwise triangles.
    pub triangles: Vec<[u32; 3]>,
}

/// What makes a submesh a draw of its own.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SubmeshInfo {
    /// For people: the materials in it.
    pub name: String,
    /// Both faces are drawn.
    pub double_sided: bool,
    /// Pixels below this alpha are not drawn; `None`: opaque.
    pub alpha_cutoff: Option<f32>,
}

impl Mesh {
    /// Layer of a vertex without a texture.
    pub const UNTEXTURED: u8 = u8::MAX;

    /// Number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.positions.len()
    }

    /// Where a vertex stands under a palette.
    pub fn posed(&self, palette: &[Affine3A], vertex: usize) -> Vec3 {
        let joints = self.joints[vertex].map(u16::from);
        pose::skin(
            palette,
            joints,
            self.weights[vertex],
            self.positions[vertex],
        )
    }
}

/// Half-edge collapses of a whole character, coarsest last.
#[derive(Debug, Clone, Default)]
pub struct CollapseSequence {
    /// In the order in which they happen; `error_m` never falls. Each vertex is the source of at most one.
    pub steps: Vec<Collapse>,
    /// Triangles that take the place of all others at the coarse end, where that looks better.
    pub replacement: Option<Replacement>,
}

/// Triangles that take the place of all others.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Replacement {
    /// It happens with this step and those after it of the same error: in levels of fewer steps the mesh's triangles are drawn,
    /// in others these.
    pub step: usize,
    /// Counter-clockwise triangles, of vertices that are alive from the first step on and in no other triangle.
    pub triangles: Vec<[u32; 3]>,
}

/// A vertex moves onto another of the same submesh that is alive at that time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Collapse {
    /// The vertex that dies.
    pub vertex: u32,
    /// Where its triangles' corners go.
    pub target: u32,
    /// Collapse error in bind-space units: the side of a pixel in which the difference between the level that this step
    /// makes and the full mesh, in animated poses, may hide.
    pub error_m: f32,
}
