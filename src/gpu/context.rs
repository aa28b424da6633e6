//! What every object needs: the host's device, its capabilities, memory and names.

use std::sync::Mutex;

use ash::vk;
use ash::vk::Handle;
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};

use super::renderer::{DeviceHandles, RendererDesc};
use super::requirements::{self, Capabilities, OptionalFeatures};
use crate::error::RenderError;

/// Owned by the renderer; everything else borrows it.
pub(crate) struct Context {
    pub device: ash::Device,
    pub capabilities: Capabilities,
    pub allocator: Mutex<Option<Allocator>>,
    pub optional: OptionalFeatures,
    debug: Option<ash::ext::debug_utils::Device>,
    name: String,
}

impl Context {
    pub fn new(handles: &DeviceHandles, desc: &RendererDesc) -> Result<Self, RenderError> {
        let mut capabilities = requirements::check(
            handles.instance,
            handles.physical_device,
            handles.queue_family,
            desc.color_format,
            desc.depth_format,
        )?;
        if desc.storage_records {
            capabilities.texel_count = 0;
        }
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: handles.instance.clone(),
            device: handles.device.clone(),
            physical_device: handles.physical_device,
            debug_settings: Default::default(),
            buffer_device_address: false,
            allocation_sizes: Default::default(),
        })
        .map_err(|source| RenderError::Memory {
            object: desc.name.into(),
            source,
        })?;
        Ok(Self {
            device: handles.device.clone(),
            capabilities,
            allocator: Mutex::new(Some(allocator)),
            optional: handles.optional,
            debug: handles
                .debug_utils
                .then(|| ash::ext::debug_utils::Device::new(handles.instance, handles.device)),
            name: desc.name.into(),
        })
    }

    /// The full name of one of the renderer's objects.
    pub fn full_name(&self, name: &str) -> String {
        format!("{}: {name}", self.name)
    }

    /// Names a Vulkan object for debuggers and validation messages.
    pub fn set_name<H: Handle>(&self, handle: H, name: &str) {
        let Some(debug) = &self.debug else {
            return;
        };
        if let Ok(name) = std::ffi::CString::new(self.full_name(name)) {
            let info = vk::DebugUtilsObjectNameInfoEXT::default()
                .object_handle(handle)
                .object_name(&name);
            // SAFETY: the handle was made by this device just now. A lost name is no error.
            let _ = unsafe { debug.set_debug_utils_object_name(&info) };
        }
    }

    /// Starts a label in a command buffer.
    pub fn begin_label(&self, cmd: vk::CommandBuffer, name: &str) {
        let Some(debug) = &self.debug else {
            return;
        };
        if let Ok(name) = std::ffi::CString::new(self.full_name(name)) {
            let label = vk::DebugUtilsLabelEXT::default().label_name(&name);
            // SAFETY: `Commands::new` promises that the command buffer is recording.
            unsafe { debug.cmd_begin_debug_utils_label(cmd, &label) };
        }
    }

    /// Ends the innermost label.
    pub fn end_label(&self, cmd: vk::CommandBuffer) {
        if let Some(debug) = &self.debug {
            // SAFETY: as in `begin_label`, which came before.
            unsafe { debug.cmd_end_debug_utils_label(cmd) };
        }
    }
}
