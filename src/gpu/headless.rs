//! A host of our own: instance, device and an offscreen target, for the command line, tests and servers without a window.

use std::ffi::CStr;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use ash::vk;
use gpu_allocator::MemoryLocation;

use super::commands::{Access, Commands};
use super::memory::{Buffer, Image, ImageDesc};
use super::renderer::{DeviceHandles, Renderer, RendererDesc};
use super::requirements;
use crate::error::RenderError;
use crate::frame::{Agent, CharacterId, FrameOptions, FrameReport, View};
use crate::reference::select::Selection;

const COLOR: vk::Format = vk::Format::R8G8B8A8_UNORM;
const DEPTH: vk::Format = vk::Format::D32_SFLOAT;
const VALIDATION: &CStr = c"VK_LAYER_KHRONOS_validation";

/// A device that could be chosen.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DeviceInfo {
    /// Name that `HeadlessDesc::device` may name, or a part of it.
    pub name: String,
    /// It is a CPU driver.
    pub software: bool,
}

/// What to make.
#[derive(Debug, Clone)]
pub struct HeadlessDesc {
    /// Part of a device's name, or its index; `None` takes the best GPU, or a CPU driver where there is none.
    pub device: Option<String>,
    /// Size of the picture.
    pub size_px: [u32; 2],
    /// Turns the validation layer with synchronisation validation on; [`Headless::messages`] then has what it says.
    /// The environment's `THRONG_VALIDATION=1` does the same.
    pub validation: bool,
    /// Keeps the instance lists for [`Headless::selection`]: for tests.
    pub keep_lists: bool,
}

impl Default for HeadlessDesc {
    fn default() -> Self {
        Self {
            device: None,
            size_px: [1024, 768],
            validation: false,
            keep_lists: false,
        }
    }
}

/// Renders frames one at a time and waits for each.
pub struct Headless {
    // Dropped by `Drop` in this order; `None` only there.
    renderer: Option<Renderer>,
    target: Option<Target>,
    core: Core,
}

/// Instance and device.
struct Core {
    _entry: ash::Entry,
    instance: ash::Instance,
    device: Option<ash::Device>,
    queue: vk::Queue,
    pool: vk::CommandPool,
    cmd: vk::CommandBuffer,
    fence: vk::Fence,
    messenger: Option<(ash::ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    messages: Arc<Mutex<Vec<String>>>,
    physical_device: vk::PhysicalDevice,
    queue_family: u32,
    software: bool,
    pipeline_statistics: bool,
}

/// The offscreen attachments.
struct Target {
    size_px: [u32; 2],
    color: Image,
    depth: Image,
    readback: Buffer,
    /// A frame was drawn into it.
    drawn: bool,
}

/// Stops glibc from giving the heap back after every frame, which halves the speed of CPU drivers that allocate their scene
/// memory per frame. [`Headless::new`] calls it for software devices; hosts of their own may. Does nothing elsewhere.
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
    let core = Core::new_instance(false)?;
    Ok(core.devices()?.into_iter().map(|d| d.1).collect())
}

fn wants_validation(desc: &HeadlessDesc) -> bool {
    desc.validation || std::env::var("THRONG_VALIDATION").is_ok_and(|v| v == "1")
}

impl Headless {
    /// Makes instance, device, target and renderer.
    ///
    /// Errors: [`RenderError::NoVulkan`], [`RenderError::NoSuchDevice`], and those of [`Renderer::new`].
    pub fn new(desc: &HeadlessDesc) -> Result<Self, RenderError> {
        let mut core = Core::new_instance(wants_validation(desc))?;
        core.make_device(desc.device.as_deref())?;
        if core.software {
            tune_allocator_for_cpu();
        }
        let handles = DeviceHandles {
            instance: &core.instance,
            physical_device: core.physical_device,
            device: core.device(),
            queue_family: core.queue_family,
            debug_utils: core.messenger.is_some(),
            pipeline_statistics: core.pipeline_statistics,
        };
        let renderer_desc = RendererDesc {
            name: "throng",
            frames_in_flight: 1,
            agent_capacity: 4 << 20,
            color_format: COLOR,
            depth_format: DEPTH,
            reversed_depth: true,
            keep_lists: desc.keep_lists,
        };
        // SAFETY: the handles were made above with the required features and are destroyed after the renderer (`Drop`).
        let renderer = unsafe { Renderer::new(&handles, &renderer_desc) }?;
        let mut headless = Self {
            renderer: Some(renderer),
            target: None,
            core,
        };
        headless.resize(desc.size_px)?;
        Ok(headless)
    }

    /// Name of the device.
    pub fn device_name(&self) -> &str {
        self.renderer().device_name()
    }

    /// Name and version of the driver.
    pub fn driver(&self) -> &str {
        self.renderer().driver()
    }

    /// The device is a CPU driver.
    pub fn is_software(&self) -> bool {
        self.core.software
    }

    /// The characters' tables, for the CPU twins.
    pub fn tables(&self) -> &crate::prepare::Tables {
        self.renderer().tables()
    }

    /// As [`Renderer::add_character`].
    pub fn add_character(
        &mut self,
        baked: &throng_bake::baked::Baked,
    ) -> Result<CharacterId, RenderError> {
        self.renderer_mut().add_character(baked)
    }

    /// Makes a target of another size.
    ///
    /// Errors: [`RenderError::BadOption`] for a size of 0 or above the device's limit, [`RenderError::Memory`].
    pub fn resize(&mut self, size_px: [u32; 2]) -> Result<(), RenderError> {
        let limit = self.renderer().cx.capabilities.image_size;
        if size_px.iter().any(|&x| x == 0 || x > limit) {
            return Err(RenderError::BadOption {
                option: "size",
                reason: format!("{}x{} is not in 1 to {limit}", size_px[0], size_px[1]),
            });
        }
        let new = Target::new(self.renderer(), size_px)?;
        if let Some(old) = self.target.replace(new) {
            old.destroy(self.renderer());
        }
        Ok(())
    }

    /// Draws one frame and waits for it. The view's size must be the target's.
    ///
    /// Errors: those of the renderer's calls.
    pub fn render(
        &mut self,
        agents: &[Agent],
        view: &View,
        options: &FrameOptions,
    ) -> Result<FrameReport, RenderError> {
        let (Some(renderer), Some(target)) = (&mut self.renderer, &mut self.target) else {
            return Err(dropped());
        };
        if view.size_px != target.size_px {
            return Err(RenderError::BadOption {
                option: "view",
                reason: format!(
                    "its size is {:?} and the target's is {:?}",
                    view.size_px, target.size_px
                ),
            });
        }
        let start = Instant::now();
        let core = &self.core;
        // SAFETY: every submission is waited for before the next frame begins; the command buffer is recorded in the order
        // that the renderer's contract asks for.
        unsafe {
            renderer.begin_frame(0)?;
            renderer.set_agents(0, agents)?;
            core.begin()?;
            let recorded = (|| {
                renderer.record_uploads(core.cmd)?;
                renderer.record_select(core.cmd, 0, view, options)?;
                target.begin_rendering(core, renderer);
                let drawn = renderer.record_draw(core.cmd, 0);
                core.device().cmd_end_rendering(core.cmd);
                drawn
            })();
            core.submit_and_wait(recorded)?;
        }
        target.drawn = true;
        // SAFETY: the frame's commands are finished: `submit_and_wait` waited for the fence.
        let mut report = unsafe { renderer.report(0) }?;
        report.frame_ms = Some(start.elapsed().as_secs_f64() * 1e3);
        Ok(report)
    }

    /// The last frame: `[height * width]` sRGB pixels, rows from the top.
    ///
    /// Errors: [`RenderError::Order`] before the first frame.
    pub fn read_image(&mut self) -> Result<Vec<[u8; 4]>, RenderError> {
        let (Some(renderer), Some(target)) = (&self.renderer, &self.target) else {
            return Err(dropped());
        };
        if !target.drawn {
            return Err(RenderError::Order {
                call: "read_image",
                reason: "render comes first",
            });
        }
        self.core.begin()?;
        // SAFETY: the command buffer is recording and outside rendering.
        let mut c = unsafe { Commands::new(&renderer.cx, self.core.cmd) };
        target.record_copy(&mut c);
        self.core.submit_and_wait(Ok(()))?;
        Ok(target
            .readback
            .read(target.size_px[0] as usize * target.size_px[1] as usize))
    }

    /// The last frame's lists, where the description keeps them.
    pub fn selection(&self) -> Option<Selection> {
        // SAFETY: every frame is waited for.
        unsafe { self.renderer().selection(0) }
    }

    /// Runs the mesh stage's vertex work for entry `instance` of the last frame's instance lists and returns the position
    /// and the normal of every vertex number of the submesh.
    ///
    /// Errors: [`RenderError::BadOption`] where there is no such submesh, and those of making a buffer.
    pub fn probe_mesh(
        &mut self,
        character: CharacterId,
        submesh: usize,
        instance: u32,
    ) -> Result<Vec<crate::reference::mesh::Skinned>, RenderError> {
        let Some(renderer) = &self.renderer else {
            return Err(dropped());
        };
        let probe = super::probe::Probe::new(renderer, character, submesh)?;
        let result = self.core.begin().and_then(|()| {
            // SAFETY: the command buffer is recording and outside rendering.
            let mut c = unsafe { Commands::new(&renderer.cx, self.core.cmd) };
            probe.record(&mut c, renderer, instance);
            self.core.submit_and_wait(Ok(()))
        });
        let vertices = result.map(|()| probe.read());
        probe.destroy(renderer);
        vertices
    }

    /// What the validation layer has said since the last call; always empty where it is off.
    pub fn messages(&self) -> Vec<String> {
        std::mem::take(&mut *self.core.messages.lock().unwrap_or_else(|e| e.into_inner()))
    }

    fn renderer(&self) -> &Renderer {
        self.renderer
            .as_ref()
            .expect("only drop takes the renderer")
    }

    fn renderer_mut(&mut self) -> &mut Renderer {
        self.renderer
            .as_mut()
            .expect("only drop takes the renderer")
    }
}

impl Drop for Headless {
    fn drop(&mut self) {
        if let Some(renderer) = self.renderer.take() {
            if let Some(target) = self.target.take() {
                target.destroy(&renderer);
            }
            // SAFETY: every submission was waited for.
            unsafe { renderer.destroy() };
        }
    }
}

fn dropped() -> RenderError {
    RenderError::Order {
        call: "Headless",
        reason: "it is being dropped",
    }
}

fn core_error(call: &'static str) -> impl FnOnce(vk::Result) -> RenderError {
    RenderError::vulkan("headless", call)
}

impl Target {
    fn new(renderer: &Renderer, size_px: [u32; 2]) -> Result<Self, RenderError> {
        use vk::ImageUsageFlags as U;
        let cx = &renderer.cx;
        let desc = ImageDesc {
            format: COLOR,
            extent: vk::Extent2D {
                width: size_px[0],
                height: size_px[1],
            },
            mips: 1,
            layers: 1,
            array: false,
            usage: U::COLOR_ATTACHMENT | U::TRANSFER_SRC,
            aspect: vk::ImageAspectFlags::COLOR,
        };
        let color = cx.create_image("target colour", &desc)?;
        let depth = cx.create_image(
            "target depth",
            &ImageDesc {
                format: DEPTH,
                usage: U::DEPTH_STENCIL_ATTACHMENT,
                aspect: vk::ImageAspectFlags::DEPTH,
                ..desc
            },
        );
        let depth = match depth {
            Ok(depth) => depth,
            Err(e) => {
                cx.destroy_image(color);
                return Err(e);
            }
        };
        let readback = cx.create_buffer(
            "target readback",
            size_px[0] as u64 * size_px[1] as u64 * 4,
            vk::BufferUsageFlags::TRANSFER_DST,
            MemoryLocation::GpuToCpu,
        );
        match readback {
            Ok(readback) => Ok(Self {
                size_px,
                color,
                depth,
                readback,
                drawn: false,
            }),
            Err(e) => {
                cx.destroy_image(color);
                cx.destroy_image(depth);
                Err(e)
            }
        }
    }

    fn destroy(self, renderer: &Renderer) {
        renderer.cx.destroy_image(self.color);
        renderer.cx.destroy_image(self.depth);
        renderer.cx.destroy_buffer(self.readback);
    }

    fn begin_rendering(&self, core: &Core, renderer: &Renderer) {
        use vk::{AccessFlags2 as A, ImageLayout as L, PipelineStageFlags2 as S};
        // SAFETY: the command buffer is recording and outside rendering.
        let mut c = unsafe { Commands::new(&renderer.cx, core.cmd) };
        c.image_barrier(
            &self.color,
            (
                L::UNDEFINED,
                S::ALL_TRANSFER | S::COLOR_ATTACHMENT_OUTPUT,
                A::NONE,
            ),
            (
                L::COLOR_ATTACHMENT_OPTIMAL,
                S::COLOR_ATTACHMENT_OUTPUT,
                A::COLOR_ATTACHMENT_WRITE | A::COLOR_ATTACHMENT_READ,
            ),
            vk::ImageAspectFlags::COLOR,
        );
        let depth_stages = S::EARLY_FRAGMENT_TESTS | S::LATE_FRAGMENT_TESTS;
        c.image_barrier(
            &self.depth,
            (
                L::UNDEFINED,
                depth_stages,
                A::DEPTH_STENCIL_ATTACHMENT_WRITE,
            ),
            (
                L::DEPTH_ATTACHMENT_OPTIMAL,
                depth_stages,
                A::DEPTH_STENCIL_ATTACHMENT_WRITE | A::DEPTH_STENCIL_ATTACHMENT_READ,
            ),
            vk::ImageAspectFlags::DEPTH,
        );
        let color = [vk::RenderingAttachmentInfo::default()
            .image_view(self.color.view)
            .image_layout(L::COLOR_ATTACHMENT_OPTIMAL)
            .load_op(vk::AttachmentLoadOp::CLEAR)
            .store_op(vk::AttachmentStoreOp::STORE)
            .clear_value(vk::ClearValue {
                color: vk::ClearColorValue {
                    float32: [0.75, 0.78, 0.82, 1.0],
                },
            })];
        let depth = vk::RenderingAttachmentInfo::default()
            .image_view(self.depth.view)
            .image_layout(L::DEPTH_ATTACHMENT_OPTIMAL)
            .load_op(vk::AttachmentLoadOp::CLEAR)
            .store_op(vk::AttachmentStoreOp::DONT_CARE)
            .clear_value(vk::ClearValue {
                depth_stencil: vk::ClearDepthStencilValue {
                    depth: 0.0,
                    stencil: 0,
                },
            });
        let info = vk::RenderingInfo::default()
            .render_area(vk::Rect2D {
                offset: vk::Offset2D::default(),
                extent: self.color.extent,
            })
            .layer_count(1)
            .color_attachments(&color)
            .depth_attachment(&depth);
        // SAFETY: as above; the attachments are in the layouts that were just recorded.
        unsafe { core.device().cmd_begin_rendering(core.cmd, &info) };
    }

    fn record_copy(&self, c: &mut Commands) {
        use vk::{AccessFlags2 as A, ImageLayout as L, PipelineStageFlags2 as S};
        c.image_barrier(
            &self.color,
            (
                L::COLOR_ATTACHMENT_OPTIMAL,
                S::COLOR_ATTACHMENT_OUTPUT,
                A::COLOR_ATTACHMENT_WRITE,
            ),
            (L::TRANSFER_SRC_OPTIMAL, S::ALL_TRANSFER, A::TRANSFER_READ),
            vk::ImageAspectFlags::COLOR,
        );
        c.copy_from_image(&self.color, &self.readback);
        c.barrier(Access::TransferWrite, &[Access::HostRead]);
        c.image_barrier(
            &self.color,
            (L::TRANSFER_SRC_OPTIMAL, S::ALL_TRANSFER, A::NONE),
            (
                L::COLOR_ATTACHMENT_OPTIMAL,
                S::COLOR_ATTACHMENT_OUTPUT,
                A::COLOR_ATTACHMENT_WRITE,
            ),
            vk::ImageAspectFlags::COLOR,
        );
    }
}

impl Core {
    fn new_instance(validation: bool) -> Result<Self, RenderError> {
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
            pipeline_statistics: false,
        };
        if validation {
            core.make_messenger()?;
        }
        Ok(core)
    }

    fn make_messenger(&mut self) -> Result<(), RenderError> {
        use vk::{DebugUtilsMessageSeverityFlagsEXT as S, DebugUtilsMessageTypeFlagsEXT as T};
        let debug = ash::ext::debug_utils::Instance::new(&self._entry, &self.instance);
        let info = vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(S::WARNING | S::ERROR)
            .message_type(T::VALIDATION | T::PERFORMANCE | T::GENERAL)
            .pfn_user_callback(Some(collect_message))
            .user_data(Arc::as_ptr(&self.messages) as *mut _);
        // SAFETY: the user data outlives the messenger: `Drop` destroys the messenger first.
        let messenger = unsafe { debug.create_debug_utils_messenger(&info, None) }
            .map_err(core_error("vkCreateDebugUtilsMessengerEXT"))?;
        self.messenger = Some((debug, messenger));
        Ok(())
    }

    /// Devices in the loader's order.
    fn devices(&self) -> Result<Vec<(vk::PhysicalDevice, DeviceInfo, u32)>, RenderError> {
        // SAFETY: the instance is alive.
        let devices = unsafe { self.instance.enumerate_physical_devices() }
            .map_err(core_error("vkEnumeratePhysicalDevices"))?;
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

    fn make_device(&mut self, wanted: Option<&str>) -> Result<(), RenderError> {
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
            COLOR,
            DEPTH,
        )?;
        self.pipeline_statistics = supported.pipeline_statistics_query == vk::TRUE;
        let mut features = requirements::features(self.pipeline_statistics);
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
                .map_err(core_error("vkCreateDevice"))?;
            self.queue = device.get_device_queue(self.queue_family, 0);
            let device = self.device.insert(device);
            self.pool = device
                .create_command_pool(
                    &vk::CommandPoolCreateInfo::default()
                        .queue_family_index(self.queue_family)
                        .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER),
                    None,
                )
                .map_err(core_error("vkCreateCommandPool"))?;
            self.cmd = device
                .allocate_command_buffers(
                    &vk::CommandBufferAllocateInfo::default()
                        .command_pool(self.pool)
                        .level(vk::CommandBufferLevel::PRIMARY)
                        .command_buffer_count(1),
                )
                .map_err(core_error("vkAllocateCommandBuffers"))?[0];
            self.fence = device
                .create_fence(&vk::FenceCreateInfo::default(), None)
                .map_err(core_error("vkCreateFence"))?;
        }
        Ok(())
    }

    fn device(&self) -> &ash::Device {
        self.device.as_ref().expect("make_device made it")
    }

    /// Starts the command buffer, which is never pending here.
    fn begin(&self) -> Result<(), RenderError> {
        let info = vk::CommandBufferBeginInfo::default()
            .flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: every submission was waited for.
        unsafe { self.device().begin_command_buffer(self.cmd, &info) }
            .map_err(core_error("vkBeginCommandBuffer"))
    }

    /// Ends the command buffer, submits it and waits. Where recording failed it still runs what was recorded: uploads are
    /// recorded once only.
    fn submit_and_wait(&self, recorded: Result<(), RenderError>) -> Result<(), RenderError> {
        let device = self.device();
        // SAFETY: the command buffer is recording and outside rendering; the fence is unsignalled and reset after the wait.
        unsafe {
            let ended = device
                .end_command_buffer(self.cmd)
                .map_err(core_error("vkEndCommandBuffer"));
            ended?;
            let cmds = [vk::CommandBufferSubmitInfo::default().command_buffer(self.cmd)];
            let submit = [vk::SubmitInfo2::default().command_buffer_infos(&cmds)];
            device
                .queue_submit2(self.queue, &submit, self.fence)
                .map_err(core_error("vkQueueSubmit2"))?;
            device
                .wait_for_fences(&[self.fence], true, u64::MAX)
                .map_err(core_error("vkWaitForFences"))?;
            device
                .reset_fences(&[self.fence])
                .map_err(core_error("vkResetFences"))?;
        }
        recorded
    }
}

impl Drop for Core {
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
    // SAFETY: the layer's data is valid during the call; the user data is the Arc's content, which `Core` keeps alive.
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
