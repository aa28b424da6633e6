//! Impostors: far agents as pictures that the renderer took of the character itself.
//!
//! A *kind* is a way to draw a whole character with a few textured quads. `Flat` has a quad for every group of joints (a
//! hand with its fingers), which follows its joint, so that any clip plays on the same pictures. `Quad` has one quad for the
//! whole body, captured in poses of the clips. Both choose the picture by the direction to the eye in the quad's own space,
//! looked up in a small cube map of view cells.
//!
//! Spaces: a quad's pictures are orthographic, seen from `direction`, with axes `right` and `up = direction x right`, in
//! units of bind space from the quad's centre. A quad that follows a joint lives in bind space and is moved by the joint's
//! `model_from_bind`; one that follows none lives in model space.
//!
//! Source: Izquierdo 2014, §3.1.3 and §4.2; the Voronoi cells are exact here, and hold three neighbours for blending.

pub mod blocks;
pub mod build;
pub mod capture;
mod clip_poses;
pub(crate) mod file;
pub mod groups;
mod lean;
mod pack;
mod picture;
mod plan;
pub mod pose;
mod realise;
mod take;
pub(crate) mod validate;
pub mod views;

use blocks::Blocks;
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// Texels in a row of a face of a view set's cube map.
pub const CUBE_SIZE: u32 = 32;
/// Texels of a view set's cube map.
pub const CUBE_TEXELS: usize = (6 * CUBE_SIZE * CUBE_SIZE) as usize;
/// Greatest slope of [`Tile::lean`]: seen from the edge of a view cell, a tile shows its front still.
pub const MAX_LEAN: f32 = 1.2;
/// [`Quad::joint`] of a quad in model space.
pub const NO_JOINT: u32 = u32::MAX;

/// All impostors of a character. Quads, view sets and tiles of all kinds share one atlas.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Impostors {
    /// What was captured, in the order of [`Kind`].
    pub kinds: Vec<KindInfo>,
    /// Quads of all kinds.
    pub quads: Vec<Quad>,
    /// View directions and their cells.
    pub view_sets: Vec<ViewSet>,
    /// Poses of `Quad` by clip, parallel to `Baked::clips`; empty where `Quad` was not captured.
    pub clip_poses: Vec<PoseRange>,
    /// Pictures of all quads.
    pub tiles: Vec<Tile>,
    /// The pixels of all tiles.
    pub atlas: Atlas,
}

/// A way to draw a character with quads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// A quad per group of joints.
    Flat,
    /// One quad for the whole body.
    Quad,
}

/// A captured kind.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct KindInfo {
    /// Which.
    pub kind: Kind,
    /// First of its quads in [`Impostors::quads`].
    pub first_quad: u32,
    /// Its quads.
    pub quad_count: u32,
    /// Screen-space error against projected height, measured beside the mesh; heights rise. Empty where not measured yet.
    pub errors: Vec<ErrorSample>,
}

/// A point of an error curve.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ErrorSample {
    /// Projected height of the character's bounds, pixels.
    pub height_px: f32,
    /// Pixel error of the mesh level that is as far from the reference picture as this kind is.
    pub error_px: f32,
}

/// A quad of a kind.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Quad {
    /// For people: `head`, `left hand` and so on.
    pub name: String,
    /// Palette joint that it follows, or [`NO_JOINT`].
    pub joint: u32,
    /// Origin of its pictures.
    pub center: Vec3,
    /// Depths in its pictures reach this far to either side of the centre; greater than 0.
    pub depth_extent: f32,
    /// Its tiles begin here, `[pose_count][view_count]`; a quad that follows a joint has one pose.
    pub first_tile: u32,
    /// Its view set.
    pub view_set: u32,
}

/// Directions that pictures are taken from, and which of them lie nearest to any direction.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ViewSet {
    /// Towards the eye, unit length.
    pub directions: Vec<Vec3>,
    /// Right axis of each direction's picture, unit length, orthogonal to it.
    pub rights: Vec<Vec3>,
    /// The cube map, `[6][CUBE_SIZE][CUBE_SIZE]`, faces and rows in Vulkan's order: the three directions whose spherical
    /// Delaunay triangle holds the texel's centre, the nearest first (its Voronoi cell), and a zero.
    pub cells: Vec<[u16; 4]>,
}

/// Captured poses of a clip: pose `p` stands at phase `p / pose_count`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct PoseRange {
    /// First of its poses among those of all clips.
    pub first_pose: u32,
    /// At least 1.
    pub pose_count: u32,
}

/// A picture: a rectangle of the plane through its quad's centre and one of the atlas, where it lies on its side. An empty picture
/// has no texels.
#[derive(Debug, Clone, Copy, PartialEq, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Tile {
    /// Left and bottom edge in the plane, along right and up.
    pub min: [f32; 2],
    /// Right and top edge.
    pub max: [f32; 2],
    /// First column and row in the atlas. Columns run from the top edge down, rows from the left edge to the right.
    pub texel: [u16; 2],
    /// Columns and rows of the atlas; multiples of 2 to the power of (mips - 1), as are the first column and row.
    pub size: [u16; 2],
    /// The plane that it is drawn on, which fits its surface: depth towards the eye per unit along right and along up, and
    /// at the centre. The slope is at most [`MAX_LEAN`].
    pub lean: [f32; 3],
}

/// Pixels of all tiles, two pictures of the same size with mips.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Atlas {
    /// Columns of mip 0.
    pub width: u32,
    /// Rows of mip 0.
    pub height: u32,
    /// Mips, halved each time; few enough that no tile bleeds into the next.
    pub mip_count: u32,
    /// Square roots of the linear colour without light, the mean over all tints, and the distance from the outline: 0 and 255 are a
    /// texel outside and inside, in every mip. Mips one after the other.
    pub color: Vec<[u8; 4]>,
    /// Normal along right and up (128 is 0, 1 and 255 are -1 and 1), body part in bits 0-5 with its tint rule in bits 6-7,
    /// and depth towards the eye (0 and 255 are the far and the near end of the quad's extent). As `color`.
    pub surface: Vec<[u8; 4]>,
    /// The same in blocks, where the bake was asked for them; `color` and `surface` are then what they decode to.
    pub blocks: Option<Blocks>,
}

impl Atlas {
    /// Bytes of both pictures, all mips, as the file and a device that reads blocks have them.
    pub fn size_bytes(&self) -> u64 {
        match &self.blocks {
            Some(blocks) => blocks.size_bytes(),
            None => ((self.color.len() + self.surface.len()) * 4) as u64,
        }
    }

    /// Columns, rows and the first texel of a mip in `color` and `surface`.
    pub fn mip(&self, mip: u32) -> (u32, u32, usize) {
        let texels = |m: u32| (self.width >> m) as usize * (self.height >> m) as usize;
        (
            self.width >> mip,
            self.height >> mip,
            (0..mip).map(texels).sum(),
        )
    }
}
