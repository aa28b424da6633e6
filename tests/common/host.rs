//! A host that owns everything: instance, device, queue, targets, command buffers and fences.

#![allow(
    dead_code,
    clippy::undocumented_unsafe_blocks,
    reason = "each test takes what it needs; a host is one long run of Vulkan calls on objects that it has just made"
)]

use std::sync::Mutex;

use ash::vk;
use throng::gpu::{DeviceHandles, requirements};

pub const SIZE: [u32; 2] = [192, 128];
pub const COLOR: vk::Format = vk::Format::B8G8R8A8_SRGB;
pub const DEPTH: vk::Format = vk::Format::D32_SFLOAT;
pub const FRAMES: usize = 2;

static MESSAGES: Mutex<Vec<String>> = Mutex::new(Vec::new());

/// What the validation layer has said.
pub fn messages() -> Vec<String> {
    MESSAGES.lock().expect("no callback panics").clone()
}

unsafe extern "system" fn message(
    _: vk::DebugUtilsMessageSeverityFlagsEXT,
    _: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    _: *mut std::ffi::c_void,
) -> vk::Bool32 {
    let text = unsafe { (*data).message_as_c_str() }.unwrap_or(c"");
    let mut messages = MESSAGES.lock().expect("no callback panics");
    messages.push(text.to_string_lossy().into_owned());
    vk::FALSE
}

/// What a host has; its own draw is a red triangle.
pub struct Host {
    _entry: ash::Entry,
    instance: ash::Instance,
    debug: (ash::ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT),
    pub physical: vk::PhysicalDevice,
    family: u32,
    optional: requirements::OptionalFeatures,
    pub device: ash::Device,
    pub queue: vk::Queue,
    pool: vk::CommandPool,
    pub cmds: Vec<vk::CommandBuffer>,
    pub fences: Vec<vk::Fence>,
    layout: vk::PipelineLayout,
    triangle: vk::Pipeline,
    color: (vk::Image, vk::DeviceMemory, vk::ImageView),
    depth: (vk::Image, vk::DeviceMemory, vk::ImageView),
}

impl Host {
    pub unsafe fn new() -> Self {
        unsafe {
            let entry = ash::Entry::load().expect("a Vulkan loader");
            let app = vk::ApplicationInfo::default().api_version(requirements::API_VERSION);
            let layers = [c"VK_LAYER_KHRONOS_validation".as_ptr()];
            let extensions = [
                ash::ext::debug_utils::NAME.as_ptr(),
                ash::ext::validation_features::NAME.as_ptr(),
            ];
            let enables = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
            let mut validation =
                vk::ValidationFeaturesEXT::default().enabled_validation_features(&enables);
            let info = vk::InstanceCreateInfo::default()
                .application_info(&app)
                .enabled_layer_names(&layers)
                .enabled_extension_names(&extensions)
                .push_next(&mut validation);
            let instance = entry.create_instance(&info, None).expect("an instance");
            let debug = ash::ext::debug_utils::Instance::new(&entry, &instance);
            let messenger = debug
                .create_debug_utils_messenger(
                    &vk::DebugUtilsMessengerCreateInfoEXT::default()
                        .message_severity(
                            vk::DebugUtilsMessageSeverityFlagsEXT::WARNING
                                | vk::DebugUtilsMessageSeverityFlagsEXT::ERROR,
                        )
                        .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION)
                        .pfn_user_callback(Some(message)),
                    None,
                )
                .expect("a messenger");
            let physical = instance.enumerate_physical_devices().expect("devices")[0];
            let family = instance
                .get_physical_device_queue_family_properties(physical)
                .iter()
                .position(|f| {
                    let both = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
                    f.queue_flags.contains(both)
                })
                .expect("a queue") as u32;
            let supported = instance.get_physical_device_features(physical);
            let optional = requirements::OptionalFeatures::among(&supported);
            let mut features = requirements::features(optional);
            let queues = [vk::DeviceQueueCreateInfo::default()
                .queue_family_index(family)
                .queue_priorities(&[1.0])];
            let info = vk::DeviceCreateInfo::default()
                .queue_create_infos(&queues)
                .enabled_features(&features.core)
                .push_next(&mut features.vulkan13);
            let device = instance
                .create_device(physical, &info, None)
                .expect("a device");
            let queue = device.get_device_queue(family, 0);
            let pool = device
                .create_command_pool(
                    &vk::CommandPoolCreateInfo::default()
                        .queue_family_index(family)
                        .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER),
                    None,
                )
                .expect("a pool");
            let cmds = device
                .allocate_command_buffers(
                    &vk::CommandBufferAllocateInfo::default()
                        .command_pool(pool)
                        .command_buffer_count(FRAMES as u32),
                )
                .expect("command buffers");
            let signalled = vk::FenceCreateInfo::default().flags(vk::FenceCreateFlags::SIGNALED);
            let fences = (0..FRAMES)
                .map(|_| device.create_fence(&signalled, None).expect("a fence"))
                .collect();
            let layout = device
                .create_pipeline_layout(&vk::PipelineLayoutCreateInfo::default(), None)
                .expect("a layout");
            let color = image(
                &instance,
                physical,
                &device,
                COLOR,
                vk::ImageUsageFlags::COLOR_ATTACHMENT | vk::ImageUsageFlags::TRANSFER_SRC,
                vk::ImageAspectFlags::COLOR,
            );
            let depth = image(
                &instance,
                physical,
                &device,
                DEPTH,
                vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT,
                vk::ImageAspectFlags::DEPTH,
            );
            let triangle = triangle(&device, layout);
            Self {
                _entry: entry,
                instance,
                debug: (debug, messenger),
                physical,
                family,
                optional,
                device,
                queue,
                pool,
                cmds,
                fences,
                layout,
                triangle,
                color,
                depth,
            }
        }
    }

    pub fn handles(&self) -> DeviceHandles<'_> {
        DeviceHandles {
            instance: &self.instance,
            physical_device: self.physical,
            device: &self.device,
            queue_family: self.family,
            debug_utils: true,
            optional: self.optional,
        }
    }

    /// Starts rendering into the targets; depth is ordinary here: 0 is near, cleared to 1.
    pub unsafe fn begin_rendering(&self, cmd: vk::CommandBuffer) {
        use vk::{AccessFlags2 as A, ImageLayout as L, PipelineStageFlags2 as S};
        let barrier = |image, aspect, layout, stages, write| {
            vk::ImageMemoryBarrier2::default()
                .image(image)
                .old_layout(L::UNDEFINED)
                .new_layout(layout)
                .src_stage_mask(stages)
                .src_access_mask(write)
                .dst_stage_mask(stages)
                .dst_access_mask(write)
                .subresource_range(vk::ImageSubresourceRange {
                    aspect_mask: aspect,
                    level_count: 1,
                    layer_count: 1,
                    ..Default::default()
                })
        };
        let barriers = [
            barrier(
                self.color.0,
                vk::ImageAspectFlags::COLOR,
                L::COLOR_ATTACHMENT_OPTIMAL,
                S::COLOR_ATTACHMENT_OUTPUT,
                A::COLOR_ATTACHMENT_WRITE,
            ),
            barrier(
                self.depth.0,
                vk::ImageAspectFlags::DEPTH,
                L::DEPTH_ATTACHMENT_OPTIMAL,
                S::EARLY_FRAGMENT_TESTS | S::LATE_FRAGMENT_TESTS,
                A::DEPTH_STENCIL_ATTACHMENT_WRITE,
            ),
        ];
        let color = [vk::RenderingAttachmentInfo::default()
            .image_view(self.color.2)
            .image_layout(L::COLOR_ATTACHMENT_OPTIMAL)
            .load_op(vk::AttachmentLoadOp::CLEAR)
            .store_op(vk::AttachmentStoreOp::STORE)];
        let depth = vk::RenderingAttachmentInfo::default()
            .image_view(self.depth.2)
            .image_layout(L::DEPTH_ATTACHMENT_OPTIMAL)
            .load_op(vk::AttachmentLoadOp::CLEAR)
            .clear_value(vk::ClearValue {
                depth_stencil: vk::ClearDepthStencilValue {
                    depth: 1.0,
                    stencil: 0,
                },
            });
        let info = vk::RenderingInfo::default()
            .render_area(area())
            .layer_count(1)
            .color_attachments(&color)
            .depth_attachment(&depth);
        unsafe {
            let dependency = vk::DependencyInfo::default().image_memory_barriers(&barriers);
            self.device.cmd_pipeline_barrier2(cmd, &dependency);
            self.device.cmd_begin_rendering(cmd, &info);
        }
    }

    pub unsafe fn draw_triangle(&self, cmd: vk::CommandBuffer) {
        let viewport = vk::Viewport {
            width: SIZE[0] as f32,
            height: SIZE[1] as f32,
            max_depth: 1.0,
            ..Default::default()
        };
        unsafe {
            let d = &self.device;
            d.cmd_bind_pipeline(cmd, vk::PipelineBindPoint::GRAPHICS, self.triangle);
            d.cmd_set_viewport(cmd, 0, &[viewport]);
            d.cmd_set_scissor(cmd, 0, &[area()]);
            d.cmd_draw(cmd, 3, 1, 0, 0);
        }
    }

    /// The colour target's pixels as they are in memory, `[SIZE]`, after everything submitted.
    pub unsafe fn read_color(&self) -> Vec<[u8; 4]> {
        use vk::{AccessFlags2 as A, ImageLayout as L, PipelineStageFlags2 as S};
        let d = &self.device;
        let bytes = 4 * SIZE[0] as u64 * SIZE[1] as u64;
        let cmd = self.cmds[0];
        unsafe {
            d.device_wait_idle().expect("idle");
            let info = vk::BufferCreateInfo::default()
                .size(bytes)
                .usage(vk::BufferUsageFlags::TRANSFER_DST);
            let buffer = d.create_buffer(&info, None).expect("a buffer");
            let needs = d.get_buffer_memory_requirements(buffer);
            let memory = allocate(
                &self.instance,
                self.physical,
                d,
                needs,
                vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT,
            );
            d.bind_buffer_memory(buffer, memory, 0).expect("bound");
            d.begin_command_buffer(cmd, &vk::CommandBufferBeginInfo::default())
                .expect("recording");
            let barrier = [vk::ImageMemoryBarrier2::default()
                .image(self.color.0)
                .old_layout(L::COLOR_ATTACHMENT_OPTIMAL)
                .new_layout(L::TRANSFER_SRC_OPTIMAL)
                .src_stage_mask(S::COLOR_ATTACHMENT_OUTPUT)
                .src_access_mask(A::COLOR_ATTACHMENT_WRITE)
                .dst_stage_mask(S::ALL_TRANSFER)
                .dst_access_mask(A::TRANSFER_READ)
                .subresource_range(vk::ImageSubresourceRange {
                    aspect_mask: vk::ImageAspectFlags::COLOR,
                    level_count: 1,
                    layer_count: 1,
                    ..Default::default()
                })];
            let dependency = vk::DependencyInfo::default().image_memory_barriers(&barrier);
            d.cmd_pipeline_barrier2(cmd, &dependency);
            let region = vk::BufferImageCopy {
                image_subresource: vk::ImageSubresourceLayers {
                    aspect_mask: vk::ImageAspectFlags::COLOR,
                    layer_count: 1,
                    ..Default::default()
                },
                image_extent: area().extent.into(),
                ..Default::default()
            };
            let layout = L::TRANSFER_SRC_OPTIMAL;
            d.cmd_copy_image_to_buffer(cmd, self.color.0, layout, buffer, &[region]);
            d.end_command_buffer(cmd).expect("recorded");
            let cmds = [vk::CommandBufferSubmitInfo::default().command_buffer(cmd)];
            let submit = [vk::SubmitInfo2::default().command_buffer_infos(&cmds)];
            d.queue_submit2(self.queue, &submit, vk::Fence::null())
                .expect("submitted");
            d.device_wait_idle().expect("idle");
            let mapped = d
                .map_memory(memory, 0, bytes, vk::MemoryMapFlags::empty())
                .expect("mapped");
            let pixels = std::slice::from_raw_parts(mapped.cast(), bytes as usize / 4).to_vec();
            d.destroy_buffer(buffer, None);
            d.free_memory(memory, None);
            pixels
        }
    }

    pub unsafe fn destroy(self) {
        unsafe {
            let d = &self.device;
            for fence in &self.fences {
                d.destroy_fence(*fence, None);
            }
            d.destroy_pipeline(self.triangle, None);
            d.destroy_pipeline_layout(self.layout, None);
            d.destroy_command_pool(self.pool, None);
            for (image, memory, view) in [self.color, self.depth] {
                d.destroy_image_view(view, None);
                d.destroy_image(image, None);
                d.free_memory(memory, None);
            }
            d.destroy_device(None);
            self.debug
                .0
                .destroy_debug_utils_messenger(self.debug.1, None);
            self.instance.destroy_instance(None);
        }
    }
}

fn area() -> vk::Rect2D {
    vk::Rect2D {
        offset: vk::Offset2D::default(),
        extent: vk::Extent2D {
            width: SIZE[0],
            height: SIZE[1],
        },
    }
}

unsafe fn image(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
    device: &ash::Device,
    format: vk::Format,
    usage: vk::ImageUsageFlags,
    aspect: vk::ImageAspectFlags,
) -> (vk::Image, vk::DeviceMemory, vk::ImageView) {
    let info = vk::ImageCreateInfo::default()
        .image_type(vk::ImageType::TYPE_2D)
        .format(format)
        .extent(area().extent.into())
        .mip_levels(1)
        .array_layers(1)
        .samples(vk::SampleCountFlags::TYPE_1)
        .usage(usage);
    unsafe {
        let image = device.create_image(&info, None).expect("an image");
        let needs = device.get_image_memory_requirements(image);
        let none = vk::MemoryPropertyFlags::empty();
        let memory = allocate(instance, physical, device, needs, none);
        device.bind_image_memory(image, memory, 0).expect("bound");
        let view = device
            .create_image_view(
                &vk::ImageViewCreateInfo::default()
                    .image(image)
                    .format(format)
                    .view_type(vk::ImageViewType::TYPE_2D)
                    .subresource_range(vk::ImageSubresourceRange {
                        aspect_mask: aspect,
                        level_count: 1,
                        layer_count: 1,
                        ..Default::default()
                    }),
                None,
            )
            .expect("a view");
        (image, memory, view)
    }
}

unsafe fn allocate(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
    device: &ash::Device,
    needs: vk::MemoryRequirements,
    properties: vk::MemoryPropertyFlags,
) -> vk::DeviceMemory {
    unsafe {
        let types = instance.get_physical_device_memory_properties(physical);
        let fits = |i: &u32| {
            let flags = types.memory_types[*i as usize].property_flags;
            needs.memory_type_bits & (1 << i) != 0 && flags.contains(properties)
        };
        let index = (0..types.memory_type_count)
            .find(fits)
            .expect("a memory type");
        let info = vk::MemoryAllocateInfo::default()
            .allocation_size(needs.size)
            .memory_type_index(index);
        device.allocate_memory(&info, None).expect("memory")
    }
}

unsafe fn triangle(device: &ash::Device, layout: vk::PipelineLayout) -> vk::Pipeline {
    unsafe {
        let [vs, ps] = [&TRIANGLE_VS[..], &TRIANGLE_PS[..]].map(|code| {
            device
                .create_shader_module(&vk::ShaderModuleCreateInfo::default().code(code), None)
                .expect("a module")
        });
        let stage = |module, stage| {
            vk::PipelineShaderStageCreateInfo::default()
                .module(module)
                .stage(stage)
                .name(c"main")
        };
        let stages = [
            stage(vs, vk::ShaderStageFlags::VERTEX),
            stage(ps, vk::ShaderStageFlags::FRAGMENT),
        ];
        let input = vk::PipelineVertexInputStateCreateInfo::default();
        let assembly = vk::PipelineInputAssemblyStateCreateInfo::default()
            .topology(vk::PrimitiveTopology::TRIANGLE_LIST);
        let viewport = vk::PipelineViewportStateCreateInfo::default()
            .viewport_count(1)
            .scissor_count(1);
        let raster = vk::PipelineRasterizationStateCreateInfo::default().line_width(1.0);
        let samples = vk::PipelineMultisampleStateCreateInfo::default()
            .rasterization_samples(vk::SampleCountFlags::TYPE_1);
        let depth = vk::PipelineDepthStencilStateCreateInfo::default();
        let attachments = [vk::PipelineColorBlendAttachmentState::default()
            .color_write_mask(vk::ColorComponentFlags::RGBA)];
        let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&attachments);
        let dynamic = vk::PipelineDynamicStateCreateInfo::default()
            .dynamic_states(&[vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR]);
        let mut rendering = vk::PipelineRenderingCreateInfo::default()
            .color_attachment_formats(&[COLOR])
            .depth_attachment_format(DEPTH);
        let info = vk::GraphicsPipelineCreateInfo::default()
            .stages(&stages)
            .vertex_input_state(&input)
            .input_assembly_state(&assembly)
            .viewport_state(&viewport)
            .rasterization_state(&raster)
            .multisample_state(&samples)
            .depth_stencil_state(&depth)
            .color_blend_state(&blend)
            .dynamic_state(&dynamic)
            .layout(layout)
            .push_next(&mut rendering);
        let pipeline = device
            .create_graphics_pipelines(vk::PipelineCache::null(), &[info], None)
            .expect("a pipeline")[0];
        device.destroy_shader_module(vs, None);
        device.destroy_shader_module(ps, None);
        pipeline
    }
}

/// The vertex shader of the host's triangle:
/// `return float4(v == 1 ? 0.5 : -0.5, v == 2 ? 0.5 : -0.5, 0.5, 1.0);`
#[rustfmt::skip]
const TRIANGLE_VS: [u32; 259] = [
119734787, 66304, 524299, 46, 0, 131089, 1, 393227, 1, 1280527431, 1685353262, 808793134, 0, 196622, 0, 1,
458767, 0, 4, 1852399981, 0, 31, 44, 196611, 5, 500, 262149, 4, 1852399981, 0, 327685, 12, 1767992640,
829761646, 59, 196613, 11, 118, 196613, 29, 118, 196613, 31, 118, 327685, 34, 1936683072, 1869182057, 110,
262149, 35, 1634886000, 109, 458757, 44, 1953391936, 1867544946, 1333030505, 1970304117, 116, 262215, 31,
11, 42, 262215, 44, 11, 0, 131091, 2, 196641, 3, 2, 262165, 6, 32, 0, 262176, 7, 7, 6, 196630, 8, 32,
262167, 9, 8, 4, 262177, 10, 9, 7, 262187, 6, 15, 1, 131092, 16, 262187, 8, 18, 1056964608, 262187, 8, 19,
3204448256, 262187, 6, 22, 2, 262187, 8, 25, 1065353216, 262176, 30, 1, 6, 262203, 30, 31, 1, 262176, 33, 7,
9, 262176, 38, 7, 8, 262176, 43, 3, 9, 262203, 43, 44, 3, 327734, 2, 4, 0, 3, 131320, 5, 262203, 7, 29, 7,
262203, 33, 34, 7, 262203, 7, 35, 7, 262205, 6, 32, 31, 196670, 29, 32, 262205, 6, 36, 29, 196670, 35, 36,
327737, 9, 37, 12, 35, 196670, 34, 37, 327745, 38, 39, 34, 15, 262205, 8, 40, 39, 262271, 8, 41, 40, 327745,
38, 42, 34, 15, 196670, 42, 41, 262205, 9, 45, 34, 196670, 44, 45, 65789, 65592, 327734, 9, 12, 0, 10,
196663, 7, 11, 131320, 13, 262205, 6, 14, 11, 327850, 16, 17, 14, 15, 393385, 8, 20, 17, 18, 19, 262205, 6,
21, 11, 327850, 16, 23, 21, 22, 393385, 8, 24, 23, 18, 19, 458832, 9, 26, 20, 24, 18, 25, 131326, 26, 65592,
];

/// Its fragment shader: `return float4(1.0, 0.0, 0.0, 1.0);`
#[rustfmt::skip]
const TRIANGLE_PS: [u32; 111] = [
119734787, 66304, 524299, 19, 0, 131089, 1, 393227, 1, 1280527431, 1685353262, 808793134, 0, 196622, 0, 1,
393231, 4, 4, 1852399981, 0, 17, 196624, 4, 7, 196611, 5, 500, 262149, 4, 1852399981, 0, 262149, 9,
1767992640, 10350, 458757, 17, 1953391936, 1867544946, 1333030505, 1970304117, 116, 262215, 17, 30, 0,
131091, 2, 196641, 3, 2, 196630, 6, 32, 262167, 7, 6, 4, 196641, 8, 7, 262187, 6, 11, 1065353216, 262187, 6,
12, 0, 458796, 7, 13, 11, 12, 12, 11, 262176, 16, 3, 7, 262203, 16, 17, 3, 327734, 2, 4, 0, 3, 131320, 5,
262201, 7, 18, 9, 196670, 17, 18, 65789, 65592, 327734, 7, 9, 0, 8, 131320, 10, 131326, 13, 65592,
];
