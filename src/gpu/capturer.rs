//! Takes pictures of one character through the capture stage: a page of them per submission, read back and cut up.

use std::collections::HashMap;

use ash::vk;
use gpu_allocator::MemoryLocation;
use throng_bake::baked::Baked;
use throng_bake::impostor::capture::{CaptureBatch, CapturedView};

use super::bindings::{self, Kind};
use super::commands::{Access, Commands};
use super::context::Context;
use super::descriptors::{allocate_set, descriptor_pool, set_layout, write_buffers};
use super::headless::{Headless, dropped};
use super::memory::{Buffer, Image, ImageDesc, ImageShape};
use super::pipeline::{ALPHA_TESTED, DRAW_STAGES, MeshVariant, TEXTURED, pipeline_layout};
use super::record_buffers::{FLOAT4, create_records};
use super::resident::{self, Resident};
use super::shader_stages::with_stages;
use crate::capture::{self, Level, PAGE_SIZE, Page, group_of};
use crate::error::RenderError;
use crate::gpu_types::{CAPTURE_ALL_GROUPS, CaptureInstance, DrawConstants};
use crate::prepare;

const COLOR: vk::Format = vk::Format::R8G8B8A8_UNORM;
const DEPTH: vk::Format = vk::Format::D32_SFLOAT;
const GRAPHICS: vk::PipelineBindPoint = vk::PipelineBindPoint::GRAPHICS;

/// Takes pictures of one character, which stays on the device; made by [`Headless::capturer`].
pub struct Capturer<'a> {
    headless: &'a mut Headless,
    baked: &'a Baked,
    objects: Objects,
}

/// Everything that lives as long as the capturer.
#[derive(Default)]
struct Objects {
    set_layout: vk::DescriptorSetLayout,
    layout: vk::PipelineLayout,
    pipelines: HashMap<MeshVariant, vk::Pipeline>,
    pool: vk::DescriptorPool,
    set: vk::DescriptorSet,
    resident: Option<Resident>,
    /// Colour, surface, depth.
    targets: Vec<Image>,
    /// Of colour and surface.
    readbacks: Vec<Buffer>,
}

/// Objects of one batch.
struct Batch<'a> {
    cx: &'a Context,
    buffers: Vec<Buffer>,
}

impl Drop for Batch<'_> {
    fn drop(&mut self) {
        for buffer in self.buffers.drain(..) {
            self.cx.destroy_buffer(buffer);
        }
    }
}

impl Batch<'_> {
    /// A host-visible buffer with this content.
    fn buffer<T: bytemuck::Pod>(
        &mut self,
        name: &str,
        usage: vk::BufferUsageFlags,
        data: &[T],
    ) -> Result<vk::Buffer, RenderError> {
        let size = size_of_val(data) as u64;
        let location = MemoryLocation::CpuToGpu;
        let mut buffer = self.cx.create_buffer(name, size, usage, location)?;
        buffer.write(0, data);
        let handle = buffer.handle;
        self.buffers.push(buffer);
        Ok(handle)
    }
}

impl<'a> Capturer<'a> {
    pub(super) fn new(headless: &'a mut Headless, baked: &'a Baked) -> Result<Self, RenderError> {
        prepare::validate(baked)?;
        if !headless.core.clip_distance {
            return Err(RenderError::MissingFeature {
                device: headless.device_name().into(),
                feature: "shaderClipDistance".into(),
                needed_for: "the capture of impostors".into(),
            });
        }
        // From here on `Drop` destroys what there is.
        let mut capturer = Self {
            headless,
            baked,
            objects: Objects::default(),
        };
        capturer.fill()?;
        Ok(capturer)
    }

    fn fill(&mut self) -> Result<(), RenderError> {
        let Some(renderer) = &mut self.headless.renderer else {
            return Err(dropped());
        };
        let cx = &renderer.cx;
        let o = &mut self.objects;
        let (resident, upload) = resident::make(
            cx,
            &mut renderer.pipelines,
            self.baked,
            0,
            (0, 0),
            (0, false),
        )?;
        let variants: Vec<MeshVariant> = (resident.draws.iter())
            .flat_map(|d| [d.variant(), both_faces(d.variant())])
            .collect();
        let resident = o.resident.insert(resident);
        // A begun command buffer runs even where recording failed, so the staging buffer may go after the wait.
        if let Err(e) = self.headless.core.begin() {
            upload.destroy(cx);
            return Err(e);
        }
        // SAFETY: the command buffer is recording and outside rendering.
        let mut c = unsafe { Commands::new(cx, self.headless.core.cmd) };
        let staging = c.label("upload", |c| upload.record(c, resident));
        let done = self.headless.core.submit_and_wait(Ok(()));
        cx.destroy_buffer(staging);
        done?;

        let stages = vk::ShaderStageFlags::VERTEX;
        o.set_layout = set_layout(cx, "capture", bindings::CAPTURE, stages)?;
        let p = &renderer.pipelines;
        o.layout = pipeline_layout(
            cx,
            "capture",
            &[p.draw_set, p.character_set, o.set_layout],
            Some((DRAW_STAGES, size_of::<DrawConstants>() as u32)),
        )?;
        for variant in variants {
            if !o.pipelines.contains_key(&variant) {
                o.pipelines
                    .insert(variant, pipeline(cx, o.layout, variant)?);
            }
        }
        o.pool = descriptor_pool(cx, "capture", 1, bindings::CAPTURE.len() as u32)?;
        o.set = allocate_set(cx, "capture", o.pool, o.set_layout)?;
        o.make_targets(cx)
    }

    /// Takes the pictures of a batch, in its order.
    ///
    /// Memory beside the answer does not depend on the number of pictures but for 80 bytes each.
    ///
    /// Errors: [`RenderError::BadOption`] where the batch does not fit the character or itself, [`RenderError::Limit`],
    /// [`RenderError::Memory`], [`RenderError::Vulkan`].
    pub fn capture(&mut self, batch: &CaptureBatch) -> Result<Vec<CapturedView>, RenderError> {
        capture::validate(self.baked, batch)?;
        if batch.views.is_empty() {
            return Ok(Vec::new());
        }
        let pages = capture::pages(&batch.views);
        let level = capture::level(self.baked, batch);
        let Some(renderer) = &self.headless.renderer else {
            return Err(dropped());
        };
        let cx = &renderer.cx;
        let instances: Vec<CaptureInstance> = pages
            .iter()
            .flat_map(|page| &page.places)
            .map(|p| capture::instance(&batch.views[p.view], p, self.baked.joints.len()))
            .collect();
        let groups: Vec<u32> = batch.groups.iter().map(|&g| g.into()).collect();
        let mut objects = Batch {
            cx,
            buffers: Vec::new(),
        };
        use vk::BufferUsageFlags as U;
        let indices = objects.buffer("capture indices", U::INDEX_BUFFER, &level.indices)?;
        objects.buffer("captures", U::STORAGE_BUFFER, &instances)?;
        objects.buffer("joint groups", U::STORAGE_BUFFER, &groups)?;
        let storage: Vec<_> = objects.buffers[1..]
            .iter()
            .map(|buffer| (Kind::Storage, buffer))
            .collect();
        write_buffers(cx, self.objects.set, &storage);
        self.upload_poses(&mut objects, batch)?;

        let mut pictures = vec![CapturedView::default(); batch.views.len()];
        let mut first_instance = 0;
        for page in &pages {
            self.draw_page(cx, page, batch, &level, indices, first_instance)?;
            first_instance += page.places.len() as u32;
            let pixels = page.row_count as usize * PAGE_SIZE as usize;
            let [color, surface] = [0, 1].map(|i| self.objects.readbacks[i].read(pixels));
            for place in &page.places {
                pictures[place.view] =
                    capture::cut(&batch.views[place.view], place, &color, &surface);
            }
        }
        Ok(pictures)
    }

    /// Makes the poses' palette and puts it in the place of the clips'.
    fn upload_poses(&self, objects: &mut Batch, batch: &CaptureBatch) -> Result<(), RenderError> {
        let cx = objects.cx;
        let Some(resident) = &self.objects.resident else {
            return Err(dropped());
        };
        let mut palette = create_records(
            cx,
            "capture poses",
            size_of_val(&batch.poses[..]) as u64,
            vk::BufferUsageFlags::empty(),
            MemoryLocation::CpuToGpu,
            FLOAT4,
            "take fewer poses at a time",
        )?;
        palette.write(0, &batch.poses);
        resident.write_palette(cx, &palette);
        objects.buffers.push(palette);
        Ok(())
    }

    fn draw_page(
        &self,
        cx: &Context,
        page: &Page,
        batch: &CaptureBatch,
        level: &Level,
        indices: vk::Buffer,
        first_instance: u32,
    ) -> Result<(), RenderError> {
        let core = &self.headless.core;
        core.begin()?;
        // SAFETY: the command buffer is recording and outside rendering.
        let mut commands = unsafe { Commands::new(cx, core.cmd) };
        let c = &mut commands;
        let o = &self.objects;
        c.label("capture", |c| {
            o.begin_rendering(c, page.row_count);
            c.set_viewport([0, 0], [PAGE_SIZE, PAGE_SIZE]);
            self.draw_runs(c, page, batch, level, indices, first_instance);
            // SAFETY: `begin_rendering` began it.
            unsafe { cx.device.cmd_end_rendering(c.cmd) };
            o.record_readback(c, page.row_count);
        });
        core.submit_and_wait(Ok(()))
    }

    /// A draw for every group on the page and submesh.
    fn draw_runs(
        &self,
        c: &mut Commands,
        page: &Page,
        batch: &CaptureBatch,
        level: &Level,
        indices: vk::Buffer,
        first_instance: u32,
    ) {
        let o = &self.objects;
        let Some(resident) = &o.resident else { return };
        c.bind_set(GRAPHICS, o.layout, 1, resident.set);
        c.bind_set(GRAPHICS, o.layout, 2, o.set);
        // SAFETY: the command buffer is recording; the batch keeps the buffer until the page is finished.
        unsafe {
            let device = &c.context.device;
            device.cmd_bind_index_buffer(c.cmd, indices, 0, vk::IndexType::UINT32);
        }
        let groups: Vec<u32> = (page.places.iter())
            .map(|p| group_of(&batch.views[p.view]))
            .collect();
        for run in &level.runs {
            let first = groups.partition_point(|&g| g < run.group) as u32;
            let end = groups.partition_point(|&g| g <= run.group) as u32;
            if first == end {
                continue;
            }
            let draw = &resident.draws[run.submesh];
            let variant = match run.group {
                CAPTURE_ALL_GROUPS => draw.variant(),
                _ => both_faces(draw.variant()),
            };
            let pipeline = o.pipelines.get(&variant).copied();
            c.bind_pipeline(GRAPHICS, pipeline.unwrap_or_default());
            let constants = DrawConstants {
                first_vertex: draw.first_vertex,
                alpha_cutoff: draw.alpha_cutoff.unwrap_or(0.0),
                ..bytemuck::Zeroable::zeroed()
            };
            c.push_constants(o.layout, DRAW_STAGES, &constants);
            let instances = first_instance + first..first_instance + end;
            c.draw_indexed_instances(run.first_index, run.index_count, instances);
        }
    }
}

/// Pictures of a group show both faces of it.
fn both_faces(variant: MeshVariant) -> MeshVariant {
    MeshVariant {
        double_sided: true,
        ..variant
    }
}

impl Drop for Capturer<'_> {
    fn drop(&mut self) {
        let Some(renderer) = &self.headless.renderer else {
            return;
        };
        let cx = &renderer.cx;
        let o = std::mem::take(&mut self.objects);
        // SAFETY: every submission was waited for; null is ignored, and each object is destroyed once because all are taken.
        unsafe {
            for pipeline in o.pipelines.into_values() {
                cx.device.destroy_pipeline(pipeline, None);
            }
            cx.device.destroy_descriptor_pool(o.pool, None);
            cx.device.destroy_pipeline_layout(o.layout, None);
            cx.device.destroy_descriptor_set_layout(o.set_layout, None);
        }
        if let Some(resident) = o.resident {
            resident.destroy(cx);
        }
        for image in o.targets {
            cx.destroy_image(image);
        }
        for buffer in o.readbacks {
            cx.destroy_buffer(buffer);
        }
    }
}

impl Objects {
    fn make_targets(&mut self, cx: &Context) -> Result<(), RenderError> {
        use vk::ImageUsageFlags as U;
        let read = U::COLOR_ATTACHMENT | U::TRANSFER_SRC;
        let color = vk::ImageAspectFlags::COLOR;
        let depth = vk::ImageAspectFlags::DEPTH;
        for (name, format, usage, aspect) in [
            ("capture colour", COLOR, read, color),
            ("capture surface", COLOR, read, color),
            ("capture depth", DEPTH, U::DEPTH_STENCIL_ATTACHMENT, depth),
        ] {
            self.targets.push(cx.create_image(
                name,
                &ImageDesc {
                    format,
                    extent: vk::Extent2D {
                        width: PAGE_SIZE,
                        height: PAGE_SIZE,
                    },
                    mips: 1,
                    layers: 1,
                    shape: ImageShape::Plain,
                    usage,
                    aspect,
                },
            )?);
        }
        for name in ["capture colour readback", "capture surface readback"] {
            self.readbacks.push(cx.create_buffer(
                name,
                4 * u64::from(PAGE_SIZE) * u64::from(PAGE_SIZE),
                vk::BufferUsageFlags::TRANSFER_DST,
                MemoryLocation::GpuToCpu,
            )?);
        }
        Ok(())
    }

    /// Clears everything to 0, which is the far end of the depth.
    fn begin_rendering(&self, c: &mut Commands, row_count: u32) {
        use vk::{AccessFlags2 as A, ImageLayout as L, PipelineStageFlags2 as S};
        let output = S::COLOR_ATTACHMENT_OUTPUT;
        let writes = A::COLOR_ATTACHMENT_WRITE | A::COLOR_ATTACHMENT_READ;
        for image in &self.targets[..2] {
            c.image_barrier(
                image,
                (L::UNDEFINED, S::ALL_TRANSFER | output, A::NONE),
                (L::COLOR_ATTACHMENT_OPTIMAL, output, writes),
                vk::ImageAspectFlags::COLOR,
            );
        }
        let tests = S::EARLY_FRAGMENT_TESTS | S::LATE_FRAGMENT_TESTS;
        let (read, write) = (
            A::DEPTH_STENCIL_ATTACHMENT_READ,
            A::DEPTH_STENCIL_ATTACHMENT_WRITE,
        );
        c.image_barrier(
            &self.targets[2],
            (L::UNDEFINED, tests, write),
            (L::DEPTH_ATTACHMENT_OPTIMAL, tests, read | write),
            vk::ImageAspectFlags::DEPTH,
        );
        let attachment = |image: &Image, layout, store| {
            vk::RenderingAttachmentInfo::default()
                .image_view(image.view)
                .image_layout(layout)
                .load_op(vk::AttachmentLoadOp::CLEAR)
                .store_op(store)
        };
        let store = vk::AttachmentStoreOp::STORE;
        let colors =
            [0, 1].map(|i| attachment(&self.targets[i], L::COLOR_ATTACHMENT_OPTIMAL, store));
        let depth = attachment(
            &self.targets[2],
            L::DEPTH_ATTACHMENT_OPTIMAL,
            vk::AttachmentStoreOp::DONT_CARE,
        );
        let info = vk::RenderingInfo::default()
            .render_area(vk::Rect2D {
                offset: vk::Offset2D::default(),
                extent: vk::Extent2D {
                    width: PAGE_SIZE,
                    height: row_count,
                },
            })
            .layer_count(1)
            .color_attachments(&colors)
            .depth_attachment(&depth);
        // SAFETY: the command buffer is recording and outside rendering; the attachments are in the layouts recorded above.
        unsafe { c.context.device.cmd_begin_rendering(c.cmd, &info) };
    }

    fn record_readback(&self, c: &mut Commands, row_count: u32) {
        use vk::{AccessFlags2 as A, ImageLayout as L, PipelineStageFlags2 as S};
        for (image, readback) in self.targets.iter().zip(&self.readbacks) {
            c.image_barrier(
                image,
                (
                    L::COLOR_ATTACHMENT_OPTIMAL,
                    S::COLOR_ATTACHMENT_OUTPUT,
                    A::COLOR_ATTACHMENT_WRITE,
                ),
                (L::TRANSFER_SRC_OPTIMAL, S::ALL_TRANSFER, A::TRANSFER_READ),
                vk::ImageAspectFlags::COLOR,
            );
            c.copy_rows_from_image(image, readback, row_count);
        }
        c.barrier(Access::TransferWrite, &[Access::HostRead]);
    }
}

/// The capture stage for one kind of submesh.
fn pipeline(
    cx: &Context,
    layout: vk::PipelineLayout,
    variant: MeshVariant,
) -> Result<vk::Pipeline, RenderError> {
    let entry = |id: u32, offset: u32| {
        vk::SpecializationMapEntry::default()
            .constant_id(id)
            .offset(offset)
            .size(4)
    };
    let entries = [entry(ALPHA_TESTED, 0), entry(TEXTURED, 4)];
    let values = [variant.alpha_tested as u32, variant.textured as u32];
    let specialization = vk::SpecializationInfo::default()
        .map_entries(&entries)
        .data(bytemuck::cast_slice(&values));
    with_stages(
        cx,
        &["capture_vs", "capture_ps"],
        &specialization,
        |stages| pipeline_from_stages(cx, layout, stages, variant.double_sided),
    )
}

fn pipeline_from_stages(
    cx: &Context,
    layout: vk::PipelineLayout,
    stages: &[vk::PipelineShaderStageCreateInfo],
    double_sided: bool,
) -> Result<vk::Pipeline, RenderError> {
    let vertex_input = vk::PipelineVertexInputStateCreateInfo::default();
    let assembly = vk::PipelineInputAssemblyStateCreateInfo::default()
        .topology(vk::PrimitiveTopology::TRIANGLE_LIST);
    let viewport = vk::PipelineViewportStateCreateInfo::default()
        .viewport_count(1)
        .scissor_count(1);
    let raster = vk::PipelineRasterizationStateCreateInfo::default()
        .polygon_mode(vk::PolygonMode::FILL)
        .cull_mode(match double_sided {
            true => vk::CullModeFlags::NONE,
            false => vk::CullModeFlags::BACK,
        })
        .front_face(vk::FrontFace::COUNTER_CLOCKWISE)
        .line_width(1.0);
    let multisample = vk::PipelineMultisampleStateCreateInfo::default()
        .rasterization_samples(vk::SampleCountFlags::TYPE_1);
    let depth = vk::PipelineDepthStencilStateCreateInfo::default()
        .depth_test_enable(true)
        .depth_write_enable(true)
        .depth_compare_op(vk::CompareOp::GREATER_OR_EQUAL);
    let attachments = [vk::PipelineColorBlendAttachmentState::default()
        .color_write_mask(vk::ColorComponentFlags::RGBA); 2];
    let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&attachments);
    let dynamic = vk::PipelineDynamicStateCreateInfo::default()
        .dynamic_states(&[vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR]);
    let formats = [COLOR; 2];
    let mut rendering = vk::PipelineRenderingCreateInfo::default()
        .color_attachment_formats(&formats)
        .depth_attachment_format(DEPTH);
    let info = vk::GraphicsPipelineCreateInfo::default()
        .stages(stages)
        .vertex_input_state(&vertex_input)
        .input_assembly_state(&assembly)
        .viewport_state(&viewport)
        .rasterization_state(&raster)
        .multisample_state(&multisample)
        .depth_stencil_state(&depth)
        .color_blend_state(&blend)
        .dynamic_state(&dynamic)
        .layout(layout)
        .push_next(&mut rendering);
    // SAFETY: every handle in the description is alive.
    let made = unsafe {
        cx.device
            .create_graphics_pipelines(vk::PipelineCache::null(), &[info], None)
    };
    let pipeline = made.map_err(|(_, e)| RenderError::Vulkan {
        object: cx.full_name("capture"),
        call: "vkCreateGraphicsPipelines",
        source: e,
    })?[0];
    cx.set_name(pipeline, "capture");
    Ok(pipeline)
}
