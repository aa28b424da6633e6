//! A host of our own, with an offscreen target on a device of its own, for the command line, tests and servers without a window.

use std::time::Instant;

use ash::vk;
use gpu_allocator::MemoryLocation;

use super::commands::{Access, Commands};
use super::memory::{Buffer, Image, ImageDesc, ImageShape};
use super::own_device::{OwnDevice, tune_allocator_for_cpu};
use super::probe::{Probe, Probed};
use super::renderer::{DeviceHandles, Renderer, RendererDesc};
use super::slot::Slot;
use crate::error::RenderError;
use crate::frame::{Agent, CharacterId, FrameOptions, FrameReport, View};
use crate::reference::occlude::Pyramid;
use crate::reference::select::Selection;
use crate::representation::CostModel;

const COLOR: vk::Format = vk::Format::R8G8B8A8_UNORM;
const DEPTH: vk::Format = vk::Format::D32_SFLOAT;

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
    /// [`RendererDesc::storage_records`]: for tests.
    pub storage_records: bool,
    /// As [`RendererDesc::costs`].
    pub costs: Option<CostModel>,
    /// The most frames that [`Headless::stream`] draws at once, 1 to 64; [`Headless::render`] draws one.
    pub frames_in_flight: u32,
    /// Impostors' pictures that were baked in blocks stay in them on CPU drivers, too, which then take five times as long for a
    /// frame, because they decode a block for every texel that they look up: for tests. GPUs always keep them.
    pub block_textures: bool,
}

impl Default for HeadlessDesc {
    fn default() -> Self {
        Self {
            device: None,
            size_px: [1024, 768],
            validation: false,
            keep_lists: false,
            storage_records: false,
            costs: None,
            frames_in_flight: 1,
            block_textures: false,
        }
    }
}

/// Renders frames one at a time and waits for each, or streams them.
pub struct Headless {
    // Dropped by `Drop` in this order; `None` only there.
    pub(super) renderer: Option<Renderer>,
    pub(super) target: Option<Target>,
    pub(super) core: OwnDevice,
}

/// The offscreen attachments.
pub(super) struct Target {
    pub(super) size_px: [u32; 2],
    color: Image,
    depth: Image,
    readback: Buffer,
    /// A frame was drawn into it.
    drawn: bool,
}

fn wants_validation(desc: &HeadlessDesc) -> bool {
    desc.validation || std::env::var("THRONG_VALIDATION").is_ok_and(|v| v == "1")
}

impl Headless {
    /// Makes instance, device, target and renderer.
    ///
    /// Errors: [`RenderError::NoVulkan`], [`RenderError::NoSuchDevice`], and those of [`Renderer::new`].
    pub fn new(desc: &HeadlessDesc) -> Result<Self, RenderError> {
        let mut core = OwnDevice::new_instance(wants_validation(desc))?;
        core.make_device(desc.device.as_deref(), [COLOR, DEPTH], desc.block_textures)?;
        if core.software {
            tune_allocator_for_cpu();
        }
        let handles = DeviceHandles {
            instance: &core.instance,
            physical_device: core.physical_device,
            device: core.device(),
            queue_family: core.queue_family,
            debug_utils: core.messenger.is_some(),
            optional: core.optional,
        };
        let renderer_desc = RendererDesc {
            name: "throng",
            frames_in_flight: desc.frames_in_flight,
            agent_capacity: 4 << 20,
            color_format: COLOR,
            depth_format: DEPTH,
            reversed_depth: true,
            keep_lists: desc.keep_lists,
            storage_records: desc.storage_records,
            costs: desc.costs,
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

    /// As [`Renderer::costs`].
    pub fn costs(&self) -> CostModel {
        self.renderer().costs()
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

    /// As [`Renderer::remove_character`].
    pub fn remove_character(&mut self, character: CharacterId) -> Result<(), RenderError> {
        self.renderer_mut().remove_character(character)
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

    /// Draws one frame and waits for it. The view's size must be the target's, and its offset none.
    ///
    /// Errors: those of the renderer's calls.
    pub fn render(
        &mut self,
        agents: &[Agent],
        view: &View,
        options: &FrameOptions,
    ) -> Result<FrameReport, RenderError> {
        let mut report = FrameReport::default();
        self.render_into(agents, view, options, &mut report)
            .map(|()| report)
    }

    /// As [`Headless::render`], with the report in the memory of an earlier one: nothing is allocated in a steady frame.
    ///
    /// Errors: those of the renderer's calls.
    pub fn render_into(
        &mut self,
        agents: &[Agent],
        view: &View,
        options: &FrameOptions,
        report: &mut FrameReport,
    ) -> Result<(), RenderError> {
        let (Some(renderer), Some(target)) = (&mut self.renderer, &mut self.target) else {
            return Err(dropped());
        };
        check_size(view, target)?;
        let start = Instant::now();
        let core = &self.core;
        // SAFETY: every submission is waited for before the next frame begins; the command buffer is recorded in the order
        // that the renderer's contract asks for.
        unsafe {
            renderer.begin_frame(0)?;
            renderer.set_agents(0, agents)?;
            core.begin()?;
            let recorded = target.record(core.cmd, core.device(), renderer, 0, (view, options));
            core.submit_and_wait(recorded)?;
        }
        target.drawn = true;
        // SAFETY: the frame's commands are finished: `submit_and_wait` waited for the fence.
        unsafe { renderer.report_into(0, report) }?;
        report.frame_ms = Some(start.elapsed().as_secs_f64() * 1e3);
        Ok(())
    }

    /// Draws what `record` records into the target and waits for it.
    ///
    /// Errors: [`RenderError::BadOption`] where the target has another size.
    pub(super) fn submit_drawing(
        &mut self,
        view: &View,
        slot: &Slot,
        record: impl FnOnce(&Renderer, &mut Commands),
    ) -> Result<(), RenderError> {
        let (Some(renderer), Some(target)) = (&self.renderer, &mut self.target) else {
            return Err(dropped());
        };
        check_size(view, target)?;
        let core = &self.core;
        core.begin()?;
        // SAFETY: the command buffer is recording, outside rendering until the target begins it; every submission is waited
        // for.
        unsafe {
            let mut c = Commands::new(&renderer.cx, core.cmd);
            slot.reset_queries(&mut c);
            target.begin_rendering(core.cmd, core.device(), renderer);
            record(renderer, &mut c);
            core.device().cmd_end_rendering(core.cmd);
        }
        core.submit_and_wait(Ok(()))?;
        target.drawn = true;
        Ok(())
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

    /// The last frame's depth of occluders and the pyramid over it, where the description keeps lists and hidden agents were
    /// looked for.
    pub fn occlusion(&self) -> Option<(Vec<f32>, Pyramid)> {
        // SAFETY: every frame is waited for.
        unsafe { self.renderer().occlusion(0) }
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
        let rows = self.probe(character, Probed::Mesh(submesh), instance)?;
        let vertices = rows
            .chunks_exact(3)
            .map(|r| crate::reference::mesh::Skinned {
                position: r[0].truncate(),
                normal: r[1].truncate(),
                color: r[2].truncate(),
            });
        Ok(vertices.collect())
    }

    /// Runs the impostor stage's vertex work for entry `instance` of the last frame's instance lists and returns the four
    /// corners of every quad of the character's impostor kind `kind` (its place among those it has).
    ///
    /// Errors: [`RenderError::BadOption`] where there is no such kind, and those of making a buffer.
    pub fn probe_impostor(
        &mut self,
        character: CharacterId,
        kind: usize,
        instance: u32,
    ) -> Result<Vec<crate::reference::impostor::Placed>, RenderError> {
        let rows = self.probe(character, Probed::Impostor(kind), instance)?;
        let corners = rows
            .chunks_exact(4)
            .map(|r| crate::reference::impostor::Placed {
                corner: r[0].truncate(),
                mip: r[0].w,
                towards: r[1].truncate(),
                depth_extent: r[1].w,
                uv: r[2].truncate().truncate(),
                depth: r[2].z,
                shift: r[3].truncate().truncate(),
                sharpness: r[3].z,
            });
        Ok(corners.collect())
    }

    fn probe(
        &mut self,
        character: CharacterId,
        probed: Probed,
        instance: u32,
    ) -> Result<Vec<glam::Vec4>, RenderError> {
        let Some(renderer) = &self.renderer else {
            return Err(dropped());
        };
        let probe = Probe::new(renderer, character, probed)?;
        let result = self.core.begin().and_then(|()| {
            // SAFETY: the command buffer is recording and outside rendering.
            let mut c = unsafe { Commands::new(&renderer.cx, self.core.cmd) };
            probe.record(&mut c, renderer, instance);
            self.core.submit_and_wait(Ok(()))
        });
        let rows = result.map(|()| probe.read());
        probe.destroy(renderer);
        rows
    }

    /// Uploads a character whose pictures the capture stage takes.
    ///
    /// Errors: [`RenderError::BadCharacter`], [`RenderError::MissingFeature`] where the device cannot take them, and those
    /// of making objects.
    pub fn capturer<'a>(
        &'a mut self,
        baked: &'a throng_bake::baked::Baked,
    ) -> Result<super::Capturer<'a>, RenderError> {
        super::Capturer::new(self, baked)
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

pub(super) fn check_size(view: &View, target: &Target) -> Result<(), RenderError> {
    match view.size_px == target.size_px && view.offset_px == [0, 0] {
        true => Ok(()),
        false => Err(RenderError::BadOption {
            option: "view",
            reason: format!(
                "its size is {:?} at {:?}, and the target's is {:?}",
                view.size_px, view.offset_px, target.size_px
            ),
        }),
    }
}

pub(super) fn dropped() -> RenderError {
    RenderError::Order {
        call: "Headless",
        reason: "it is being dropped",
    }
}

impl Target {
    pub(super) fn new(renderer: &Renderer, size_px: [u32; 2]) -> Result<Self, RenderError> {
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
            shape: ImageShape::Plain,
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

    pub(super) fn destroy(self, renderer: &Renderer) {
        renderer.cx.destroy_image(self.color);
        renderer.cx.destroy_image(self.depth);
        renderer.cx.destroy_buffer(self.readback);
    }

    /// Records a frame of a slot.
    ///
    /// # Safety
    /// The command buffer is recording and outside rendering; `begin_frame` and `set_agents` were called for the slot.
    pub(super) unsafe fn record(
        &self,
        cmd: vk::CommandBuffer,
        device: &ash::Device,
        renderer: &mut Renderer,
        slot: usize,
        (view, options): (&View, &FrameOptions),
    ) -> Result<(), RenderError> {
        // SAFETY: this function's contract.
        unsafe {
            renderer.record_uploads(cmd)?;
            renderer.record_select(cmd, slot, view, options)?;
            self.begin_rendering(cmd, device, renderer);
            let drawn = renderer.record_draw(cmd, slot);
            device.cmd_end_rendering(cmd);
            drawn
        }
    }

    fn begin_rendering(&self, cmd: vk::CommandBuffer, device: &ash::Device, renderer: &Renderer) {
        use vk::{AccessFlags2 as A, ImageLayout as L, PipelineStageFlags2 as S};
        // SAFETY: the command buffer is recording and outside rendering.
        let mut c = unsafe { Commands::new(&renderer.cx, cmd) };
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
        unsafe { device.cmd_begin_rendering(cmd, &info) };
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
