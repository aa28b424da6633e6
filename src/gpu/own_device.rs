//! An instance and a device of our own, and one command buffer that is waited for: what the offscreen host stands on.

use std::ffi::CStr;
use std::sync::{Arc, Mutex};

use ash::vk;

use super::requirements::{self, OptionalFeatures};
use crate::error::RenderError;

const VALIDATION: &CStr = c"VK_LAYER_KHRONOS_validation";

/// Instance and device.
pub(super) struct OwnDevice {
    _entry: ash::Entry,
    pub(super) instance: ash::Instance,
    pub(super) device: Option<ash::Device>,
    queue: vk::Queue,
    pub(super) pool: vk::CommandPool,
    pub(super) cmd: vk::CommandBuffer,
    fence: vk::Fence,
    pub(super) messenger: Option<(ash::ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    pub(super) messages: Arc<Mutex<Vec<String>>>,
    pub(super) physical_device: vk::PhysicalDevice,
    pub(super) queue_family: u32,
    pub(super) software: bool,
    pub(super) optional: OptionalFeatures,
    /// The device clips at shaders' own distances, which only the capture stage needs.
    pub(super) clip_distance: bool,
}

/// A device that could be chosen.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DeviceInfo {
    /// Name that `HeadlessDesc::device` may name, or a part of it.
    pub name: String,
    /// It is a CPU driver.
    pub software: bool,
}

/// Stops glibc from giving the heap back after every frame, which halves the speed of CPU drivers that allocate their scene
/// memory per frame. [`Headless::new`](crate::gpu::Headless::new) calls it for software devices; hosts of their own may. Does nothing elsewhere.
pub fn tune_allocator_for_cpu() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: mallopt only sets a number; glibc locks around it.
    unsafe {
        libc::mallopt(libc::M_TRIM_THRESHOLD, i32::MAX);
    }
}

/// The devices that there are, in the order of their indices.
///
/// Errors: [`RenderError::NoVulkan`].
pub fn list_devices() -> Result<Vec<DeviceInfo>, RenderError> {
    let core = OwnDevice::new_instance(false)?;
    Ok(core.devices()?.into_iter().map(|d| d.1).collect())
}

fn error(call: &'static str) -> impl FnOnce(vk::Result) -> RenderError {
    RenderError::vulkan("headless", call)
}

impl OwnDevice {
    pub(super) fn new_instance(validation: bool) -> Result<Self, RenderError> {
        let no_vulkan = |reason: String| RenderError::NoVulkan { reason };
        // SAFETY: loading the system's Vulkan loader runs its initialisers; there is no other way to use it.
        let entry = unsafe { ash::Entry::load() }
            .map_err(|e| no_vulkan(format!("the Vulkan loader cannot be opened ({e})")))?;
        // SAFETY: the entry is alive.
        let layers = unsafe { entry.enumerate_instance_layer_properties() }.unwrap_or_default();
        let has_layer = layers
            .iter()
            .any(|l| l.layer_name_as_c_str() == Ok(VALIDATION));
        if validation && !has_layer {
            return Err(no_vulkan(
                "the validation layer was asked for and is not there (Debian, Ubuntu: apt install vulkan-validationlayers)"
                    .into(),
            ));
        }
        let app = vk::ApplicationInfo::default()
            .application_name(c"throng")
            .engine_name(c"throng")
            .api_version(requirements::API_VERSION);
        let layer_names = [VALIDATION.as_ptr()];
        let extension_names = [
            ash::ext::debug_utils::NAME.as_ptr(),
            ash::ext::validation_features::NAME.as_ptr(),
        ];
        let enabled = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
        let mut features =
            vk::ValidationFeaturesEXT::default().enabled_validation_features(&enabled);
        let mut info = vk::InstanceCreateInfo::default().application_info(&app);
        if validation {
            info = info
                .enabled_layer_names(&layer_names)
                .enabled_extension_names(&extension_names)
                .push_next(&mut features);
        }
        // SAFETY: the description is complete and its pointers live until the call returns.
        let instance = unsafe { entry.create_instance(&info, None) }
            .map_err(|e| no_vulkan(format!("no instance can be made ({e})")))?;
        let messages: Arc<Mutex<Vec<String>>> = Arc::default();
        let mut core = Self {
            _entry: entry,
            instance,
            device: None,
            queue: vk::Queue::null(),
            pool: vk::CommandPool::null(),
            cmd: vk::CommandBuffer::null(),
            fence: vk::Fence::null(),
            messenger: None,
            messages,
            physical_device: vk::PhysicalDevice::null(),
            queue_family: 0,
            software: false,
            optional: OptionalFeatures::default(),
            clip_distance: false,
        };
        if validation {
            core.make_messenger()?;
        }
        Ok(core)
    }

    pub(super) fn make_messenger(&mut self) -> Result<(), RenderError> {
        use vk::{DebugUtilsMessageSeverityFlagsEXT as S, DebugUtilsMessageTypeFlagsEXT as T};
        let debug = ash::ext::debug_utils::Instance::new(&self._entry, &self.instance);
        let info = vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(S::WARNING | S::ERROR)
            .message_type(T::VALIDATION | T::PERFORMANCE | T::GENERAL)
            .pfn_user_callback(Some(collect_message))
            .user_data(Arc::as_ptr(&self.messages) as *mut _);
        // SAFETY: the user data outlives the messenger: `Drop` destroys the messenger first.
        let messenger = unsafe { debug.create_debug_utils_messenger(&info, None) }
            .map_err(error("vkCreateDebugUtilsMessengerEXT"))?;
        self.messenger = Some((debug, messenger));
        Ok(())
    }

    /// Devices in the loader's order.
    pub(super) fn devices(
        &self,
    ) -> Result<Vec<(vk::PhysicalDevice, DeviceInfo, u32)>, RenderError> {
        // SAFETY: the instance is alive.
        let devices = unsafe { self.instance.enumerate_physical_devices() }
            .map_err(error("vkEnumeratePhysicalDevices"))?;
        Ok(devices
            .into_iter()
            .map(|d| {
                // SAFETY: as above.
                let p = unsafe { self.instance.get_physical_device_properties(d) };
                let rank = match p.device_type {
                    vk::PhysicalDeviceType::DISCRETE_GPU => 0,
                    vk::PhysicalDeviceType::INTEGRATED_GPU => 1,
                    vk::PhysicalDeviceType::VIRTUAL_GPU => 2,
                    vk::PhysicalDeviceType::CPU => 4,
                    _ => 3,
                };
                let info = DeviceInfo {
                    name: requirements::text(&p.device_name),
                    software: p.device_type == vk::PhysicalDeviceType::CPU,
                };
                (d, info, rank)
            })
            .collect())
    }

    /// Makes the device that `wanted` names, or the best there is, if it can draw into these formats of colour and depth.
    /// `block_textures`: CPU drivers, too, get them.
    pub(super) fn make_device(
        &mut self,
        wanted: Option<&str>,
        [color, depth]: [vk::Format; 2],
        block_textures: bool,
    ) -> Result<(), RenderError> {
        let devices = self.devices()?;
        let available = || {
            let names: Vec<String> = (0..)
                .zip(&devices)
                .map(|(i, d): (u32, _)| format!("{i} '{}'", d.1.name))
                .collect();
            names.join(", ")
        };
        let chosen = match wanted {
            None => devices.iter().min_by_key(|d| d.2),
            Some(w) => match w.parse::<usize>() {
                Ok(index) => devices.get(index),
                Err(_) => devices
                    .iter()
                    .find(|d| d.1.name.to_lowercase().contains(&w.to_lowercase())),
            },
        };
        let Some((physical_device, info, _)) = chosen else {
            return Err(match wanted {
                Some(w) if !devices.is_empty() => RenderError::NoSuchDevice {
                    wanted: w.into(),
                    available: available(),
                },
                _ => RenderError::NoVulkan {
                    reason: "there is no device".into(),
                },
            });
        };
        self.physical_device = *physical_device;
        self.software = info.software;
        // SAFETY: instance and physical device are alive.
        let (families, supported) = unsafe {
            (
                self.instance
                    .get_physical_device_queue_family_properties(*physical_device),
                self.instance.get_physical_device_features(*physical_device),
            )
        };
        let both = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
        let Some(family) = families.iter().position(|f| f.queue_flags.contains(both)) else {
            return Err(RenderError::MissingFeature {
                device: info.name.clone(),
                feature: "a queue family with graphics and compute".into(),
                needed_for: "everything".into(),
            });
        };
        self.queue_family = family as u32;
        // Checked before the device is made, so that what is missing is named.
        requirements::check(
            &self.instance,
            *physical_device,
            self.queue_family,
            color,
            depth,
        )?;
        self.optional = OptionalFeatures::among(&supported);
        self.optional.block_textures &= block_textures || !self.software;
        self.clip_distance = supported.shader_clip_distance == vk::TRUE;
        let mut features = requirements::features(self.optional);
        features.core = features.core.shader_clip_distance(self.clip_distance);
        let queues = [vk::DeviceQueueCreateInfo::default()
            .queue_family_index(self.queue_family)
            .queue_priorities(&[1.0])];
        let device_info = vk::DeviceCreateInfo::default()
            .queue_create_infos(&queues)
            .enabled_features(&features.core)
            .push_next(&mut features.vulkan13);
        // SAFETY: `check` found every feature that is enabled here.
        unsafe {
            let device = self
                .instance
                .create_device(*physical_device, &device_info, None)
                .map_err(error("vkCreateDevice"))?;
            self.queue = device.get_device_queue(self.queue_family, 0);
            let device = self.device.insert(device);
            self.pool = device
                .create_command_pool(
                    &vk::CommandPoolCreateInfo::default()
                        .queue_family_index(self.queue_family)
                        .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER),
                    None,
                )
                .map_err(error("vkCreateCommandPool"))?;
        }
        (self.cmd, self.fence) = self.new_submission()?;
        Ok(())
    }

    pub(super) fn device(&self) -> &ash::Device {
        self.device.as_ref().expect("make_device made it")
    }

    /// Starts the command buffer, which is never pending here.
    pub(super) fn begin(&self) -> Result<(), RenderError> {
        self.begin_on(self.cmd)
    }

    /// Ends the command buffer, submits it and waits. Where recording failed it still runs what was recorded: uploads are
    /// recorded once only.
    pub(super) fn submit_and_wait(
        &self,
        recorded: Result<(), RenderError>,
    ) -> Result<(), RenderError> {
        self.submit(self.cmd, self.fence)?;
        self.wait(self.fence)?;
        recorded
    }

    /// Another command buffer and a fence for it; whoever asks destroys them.
    pub(super) fn new_submission(&self) -> Result<(vk::CommandBuffer, vk::Fence), RenderError> {
        let device = self.device();
        let info = vk::CommandBufferAllocateInfo::default()
            .command_pool(self.pool)
            .level(vk::CommandBufferLevel::PRIMARY)
            .command_buffer_count(1);
        // SAFETY: the device is alive; a command buffer without a fence goes with its pool.
        unsafe {
            let cmd = device
                .allocate_command_buffers(&info)
                .map_err(error("vkAllocateCommandBuffers"))?[0];
            let fence = device
                .create_fence(&vk::FenceCreateInfo::default(), None)
                .map_err(error("vkCreateFence"))?;
            Ok((cmd, fence))
        }
    }

    /// Starts a command buffer that is not pending.
    pub(super) fn begin_on(&self, cmd: vk::CommandBuffer) -> Result<(), RenderError> {
        let info = vk::CommandBufferBeginInfo::default()
            .flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the caller has waited for its last submission.
        unsafe { self.device().begin_command_buffer(cmd, &info) }
            .map_err(error("vkBeginCommandBuffer"))
    }

    /// Ends a command buffer and submits it; [`OwnDevice::wait`] waits for its fence.
    pub(super) fn submit(
        &self,
        cmd: vk::CommandBuffer,
        fence: vk::Fence,
    ) -> Result<(), RenderError> {
        let device = self.device();
        let cmds = [vk::CommandBufferSubmitInfo::default().command_buffer(cmd)];
        let submit = [vk::SubmitInfo2::default().command_buffer_infos(&cmds)];
        // SAFETY: the command buffer is recording and outside rendering; the fence is unsignalled and nothing waits for it.
        unsafe {
            device
                .end_command_buffer(cmd)
                .map_err(error("vkEndCommandBuffer"))?;
            device
                .queue_submit2(self.queue, &submit, fence)
                .map_err(error("vkQueueSubmit2"))
        }
    }

    /// Waits for a fence that was submitted, and resets it.
    pub(super) fn wait(&self, fence: vk::Fence) -> Result<(), RenderError> {
        let device = self.device();
        // SAFETY: the fence is alive and was submitted.
        unsafe {
            device
                .wait_for_fences(&[fence], true, u64::MAX)
                .map_err(error("vkWaitForFences"))?;
            device
                .reset_fences(&[fence])
                .map_err(error("vkResetFences"))
        }
    }
}

impl Drop for OwnDevice {
    fn drop(&mut self) {
        // SAFETY: every submission was waited for, or failed; objects are destroyed once, in reverse order.
        unsafe {
            if let Some(device) = self.device.take() {
                let _ = device.device_wait_idle();
                device.destroy_fence(self.fence, None);
                device.destroy_command_pool(self.pool, None);
                device.destroy_device(None);
            }
            if let Some((debug, messenger)) = self.messenger.take() {
                debug.destroy_debug_utils_messenger(messenger, None);
            }
            self.instance.destroy_instance(None);
        }
    }
}

/// The messenger's callback.
///
/// # Safety
/// Called by the validation layer with valid data and the user data of `make_messenger`.
unsafe extern "system" fn collect_message(
    _: vk::DebugUtilsMessageSeverityFlagsEXT,
    _: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user_data: *mut std::ffi::c_void,
) -> vk::Bool32 {
    // SAFETY: the layer's data is valid during the call; the user data is the Arc's content, which `OwnDevice` keeps alive.
    unsafe {
        let messages = &*(user_data as *const Mutex<Vec<String>>);
        let text = (*data).message_as_c_str().unwrap_or(c"");
        messages
            .lock()
            .unwrap_or_else(|e| e.into_inner())
            .push(text.to_string_lossy().into_owned());
    }
    vk::FALSE
}
