//! All of ash and all of `unsafe`.
pub mod shaders;
