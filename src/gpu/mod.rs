//! All of ash and all of `unsafe`: the device, memory, pipelines, recording, and the offscreen host.
//!
//! # A frame in a Vulkan program
//! Per frame in flight, after the host's fence for it:
//! ```no_run
//! use throng::{Agent, FrameOptions, RenderError, View, ash::vk, gpu::Renderer};
//! # fn begin_rendering(_: vk::CommandBuffer) {}
//! # fn end_rendering(_: vk::CommandBuffer) {}
//! /// `slot` counts frames in flight: 0, 1, 0, 1, ... where there are two.
//! unsafe fn record(
//!     renderer: &mut Renderer, slot: usize, cmd: vk::CommandBuffer, agents: &[Agent], view: &View,
//! ) -> Result<(), RenderError> {
//!     unsafe {
//!         renderer.begin_frame(slot)?; // `report(slot)` before this says what its last frame did
//!         renderer.record_uploads(cmd)?; // of characters that are new
//!         renderer.set_agents(slot, agents)?;
//!         renderer.record_select(cmd, slot, view, &FrameOptions::default())?;
//!         begin_rendering(cmd); // the host's: one colour and one depth attachment, of the view's size
//!         renderer.record_draw(cmd, slot)?; // and the host's own draws, before or after
//!         end_rendering(cmd);
//!     }
//!     Ok(())
//! }
//! ```

pub mod bindings;
mod capturer;
mod commands;
mod context;
mod descriptors;
mod frozen;
mod frozen_parts;
mod gallery;
mod headless;
mod memory;
mod occluders;
mod own_device;
mod pipeline;
mod probe;
mod record;
mod record_buffers;
mod renderer;
mod report;
pub mod requirements;
mod resident;
mod shader_stages;
pub mod shaders;
mod slot;
mod stream;

pub use capturer::Capturer;
pub use frozen::Frozen;
pub use headless::{Headless, HeadlessDesc};
pub use own_device::{DeviceInfo, list_devices, tune_allocator_for_cpu};
pub use renderer::{DeviceHandles, Renderer, RendererDesc};

pub(crate) use commands::{Access, Commands};
pub(crate) use frozen::Part;
pub(crate) use pipeline::DRAW_STAGES;
pub(crate) use renderer::Drawing;
pub(crate) use slot::{Recorded, list_bytes, packed_command};
