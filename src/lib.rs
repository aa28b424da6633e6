//! Throng draws huge animated crowds in Vulkan with a handful of draw calls.
//!
//! # Data flow
//! [`bake`] turns a character file into a [`bake::baked::Baked`]; a renderer validates and uploads it once
//! (`add_character`). Each frame the host hands it [`Agent`]s and a [`View`]; [`occlude`] draws the larger ones as depth;
//! [`select`] (compute) culls, turns the pixel error into a level of detail and writes instance lists and indirect
//! arguments; [`mesh`] draws every submesh with one indirect multi-draw; [`ground`], [`shadow`] and [`sky`] are a draw each;
//! the [`FrameReport`] says what it cost.
//!
//! # Without a Vulkan program of your own
//! [`gpu::Headless`] owns an instance, a device (a GPU, or Mesa's lavapipe where there is none) and an offscreen target:
//! ```no_run
//! use throng::{Agent, FrameOptions, View, gpu::{Headless, HeadlessDesc}};
//! # fn main() -> Result<(), throng::RenderError> {
//! # let baked = throng::bake::baked::Baked::default();
//! let mut headless = Headless::new(&HeadlessDesc { size_px: [1024, 768], ..Default::default() })?;
//! let character = headless.add_character(&baked)?;
//! let agents = vec![Agent { character, ..Default::default() }];
//! let view = View::perspective([0.0, 1.7, 5.0].into(), [0.0, 1.0, 0.0].into(), 0.8, 0.1, [1024, 768]);
//! let report = headless.render(&agents, &view, &FrameOptions::default())?; // submits and waits
//! let rgba = headless.read_image()?; // [height * width] sRGB pixels, rows from the top
//! # Ok(()) }
//! ```
//!
//! # In a Vulkan program
//! [`gpu::Renderer`] records into command buffers that the host owns. It never submits, presents or waits.
//! [`gpu`] has a frame of it as code. [`gpu::requirements`] says what instance and device need; [`gpu::RendererDesc`], which
//! formats and which depth. Several renderers may share a device, and a command buffer. A renderer is destroyed by
//! [`gpu::Renderer::destroy`], before the device.
//! [`ash`] and [`glam`] are the versions that these signatures are of.

#![deny(unsafe_code)]

pub mod calibrate;
pub mod capture;
pub mod error;
pub mod frame;
#[allow(unsafe_code, reason = "Vulkan is only reachable by it")]
pub mod gpu;
pub mod gpu_types;
pub mod ground;
pub mod impostor;
pub mod limit;
pub mod mesh;
pub mod occlude;
pub mod pool;
pub mod prepare;
pub mod reference;
pub mod representation;
pub mod scene;
pub mod select;
pub mod shadow;
pub mod sheet;
pub mod sky;

pub use error::RenderError;
pub use frame::{
    Agent, CharacterId, FrameOptions, FrameReport, Light, Method, Representation, StageTime, View,
};
pub use throng_bake as bake;
pub use {ash, glam};
