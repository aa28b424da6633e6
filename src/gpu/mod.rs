//! All of ash and all of `unsafe`: the device, memory, pipelines, recording, and the offscreen host.

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
