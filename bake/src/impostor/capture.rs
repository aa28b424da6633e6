//! What the baker asks of a renderer: pictures of a character in given poses, from given directions. The capture stage of the
//! renderer answers.

use glam::{Vec2, Vec3};

use crate::baked::PaletteEntry;

/// Pictures to take of one character.
#[derive(Debug, Clone, Default)]
pub struct CaptureBatch {
    /// Palettes, `[pose_count][joint_count]`.
    pub poses: Vec<PaletteEntry>,
    /// Group of every joint, `[joint_count]`.
    pub groups: Vec<u8>,
    /// Surfaces may be off by this much, bind-space units: the level of detail that is drawn.
    pub error: f32,
    /// The pictures.
    pub views: Vec<CaptureView>,
}

/// One orthographic picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CaptureView {
    /// Which of the poses.
    pub pose: u32,
    /// Draw only surfaces with weight in this group, both faces, those that follow it by at least 0.3 before others; front
    /// faces of every surface where `None`.
    pub group: Option<u8>,
    /// Origin of the plane.
    pub center: Vec3,
    /// Unit length; the eye is on the side of `right x up`.
    pub right: Vec3,
    /// Unit length, orthogonal to `right`.
    pub up: Vec3,
    /// Left and bottom edge of the picture along right and up, from the centre.
    pub min: Vec2,
    /// Right and top edge.
    pub max: Vec2,
    /// Depths reach this far to either side of the centre.
    pub depth_extent: f32,
    /// Columns and rows.
    pub size: [u32; 2],
}

/// The answer to a [`CaptureView`]: `[rows][columns]`, rows from the top.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CapturedView {
    /// sRGB colour without tint and light. Alpha is 0 where nothing was drawn, else 1 + 254 times the surface's weight in
    /// the group (255 without a group).
    pub color: Vec<[u8; 4]>,
    /// As [`super::Atlas::surface`].
    pub surface: Vec<[u8; 4]>,
}

/// Takes the pictures of a batch, in its order.
pub type Capture<'a, E> = dyn FnMut(&CaptureBatch) -> Result<Vec<CapturedView>, E> + 'a;
