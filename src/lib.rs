//! Throng draws huge animated crowds in Vulkan with a handful of draw calls.

pub use throng_bake as bake;
