//! A frame's triangles and quads, already transformed, in static buffers: what [`crate::limit`] draws.

use ash::vk;
use gpu_allocator::MemoryLocation;
use throng_bake::baked::Baked;

use super::commands::{Access, Commands};
use super::descriptors::{allocate_set, descriptor_pool, write_buffers};
use super::frozen_parts::{Lists, Look, Pair, Plan, plans};
use super::headless::{Headless, dropped};
use super::memory::Buffer;
use super::record::stamp;
use super::renderer::{Drawing, Renderer};
use super::shader_stages::compute;
use super::slot::{Slot, Stamp, list_bytes};
use crate::error::RenderError;
use crate::frame::{Agent, FrameOptions, FrameReport, Method, View};
use crate::gpu_types::{DrawCommand, DrawConstants, Instance};
use crate::prepare;

/// Frames drawn before the one that is kept: what they leave for the next one counts for a steady frame.
const FRAMES_BEFORE: usize = 2;

/// What [`Headless::freeze`] keeps; [`Headless::release`] frees it.
pub struct Frozen {
    /// Has the frame's constants and, for the contact shadows, its lists.
    slot: Slot,
    parts: Vec<Part>,
    looks: Vec<(Look, Pair)>,
    view: View,
    options: FrameOptions,
    report: FrameReport,
}

/// What one draw of the frame showed.
pub(crate) struct Part {
    pub character: usize,
    pub constants: DrawConstants,
    pub limit: vk::Pipeline,
    pub floor: vk::Pipeline,
    pub vertices: Buffer,
    pub indices: Buffer,
    pub index_count: u32,
    pub(super) look: Look,
}

impl Headless {
    /// Draws a frame and keeps its triangles and quads as the stages' vertex shaders transformed them, without those
    /// triangles that a level of detail has collapsed. `characters` are those that were added, in order.
    ///
    /// Errors: [`RenderError::BadOption`] where `characters` are others, or the method is `Uninstanced`;
    /// [`RenderError::Limit`] where a part is larger than the device's buffers; those of [`Headless::render`].
    pub fn freeze(
        &mut self,
        agents: &[Agent],
        view: &View,
        options: &FrameOptions,
        characters: &[Baked],
    ) -> Result<Frozen, RenderError> {
        let renderer = self.renderer.as_mut().ok_or_else(dropped)?;
        check_characters(renderer, characters)?;
        if options.method == Method::Uninstanced {
            return Err(RenderError::BadOption {
                option: "method",
                reason: "uninstanced frames have no lists on the device".into(),
            });
        }
        let slot = Slot::new(&renderer.cx, &renderer.pipelines, renderer.slots.len())?;
        // The frame is drawn as any other, in a slot of its own.
        let usual = std::mem::replace(&mut renderer.slots[0], slot);
        let drawn: Result<Vec<_>, _> = (0..=FRAMES_BEFORE)
            .map(|_| self.render(agents, view, options))
            .collect();
        let renderer = self.renderer.as_mut().ok_or_else(dropped)?;
        let slot = std::mem::replace(&mut renderer.slots[0], usual);
        let mut frozen = Frozen {
            slot,
            parts: Vec::new(),
            looks: Vec::new(),
            view: *view,
            options: *options,
            report: FrameReport::default(),
        };
        let filled = drawn.and_then(|reports| {
            frozen.report = reports.into_iter().next_back().unwrap_or_default();
            self.fill(&mut frozen, characters)
        });
        match filled {
            Ok(()) => Ok(frozen),
            Err(e) => {
                self.release(frozen);
                Err(e)
            }
        }
    }

    /// Draws what was kept, with the stages' pixel shaders or, where `flat`, in one colour, and with the frame's ground,
    /// contact shadows and sky as usual. The report counts this draw; agents are those of the frame that was kept.
    ///
    /// Errors: [`RenderError::BadOption`] where the target has another size than the frame had.
    pub fn render_frozen(
        &mut self,
        frozen: &Frozen,
        flat: bool,
    ) -> Result<FrameReport, RenderError> {
        let mut draw_calls = 0;
        self.submit_drawing(&frozen.view, &frozen.slot, |renderer, c| {
            frozen.record(renderer, c, flat);
            draw_calls = c.draw_calls;
        })?;
        let renderer = self.renderer.as_ref().ok_or_else(dropped)?;
        let index_count: u64 = frozen.parts.iter().map(|p| p.index_count as u64).sum();
        let mut stage_ms = Vec::new();
        renderer.add_stage_times(&frozen.slot, &mut stage_ms);
        Ok(FrameReport {
            draw_calls,
            instances: 0,
            triangles: index_count / 3,
            vertex_invocations: renderer.vertex_invocations(&frozen.slot),
            stage_ms,
            frame_ms: None,
            ..frozen.report.clone()
        })
    }

    /// Frees what was kept.
    pub fn release(&mut self, frozen: Frozen) {
        let Some(renderer) = &self.renderer else {
            return;
        };
        let cx = &renderer.cx;
        for part in frozen.parts {
            cx.destroy_buffer(part.vertices);
            cx.destroy_buffer(part.indices);
        }
        for pipeline in frozen.looks.into_iter().flat_map(|(_, pair)| pair) {
            // SAFETY: every submission was waited for; each pipeline stands here once.
            unsafe { cx.device.destroy_pipeline(pipeline, None) };
        }
        frozen.slot.destroy(cx);
    }

    fn fill(&mut self, frozen: &mut Frozen, characters: &[Baked]) -> Result<(), RenderError> {
        let lists = self.read_lists(&frozen.slot)?;
        let renderer = self.renderer.as_ref().ok_or_else(dropped)?;
        let plans = plans(renderer, &lists, characters);
        for plan in plans.into_iter().filter(|p| !p.indices.is_empty()) {
            let renderer = self.renderer.as_ref().ok_or_else(dropped)?;
            let known = frozen.looks.iter().find(|(look, _)| *look == plan.look);
            let pair = match known {
                Some(&(_, pair)) => pair,
                None => {
                    let pair = plan.look.pipelines(&renderer.cx, &renderer.pipelines)?;
                    frozen.looks.push((plan.look, pair));
                    pair
                }
            };
            let part = plan.allocate(&renderer.cx, pair)?;
            frozen.parts.push(part);
            let made = frozen.parts.last_mut();
            if let Some(part) = made {
                self.transform(&frozen.slot, &plan, part)?;
            }
        }
        Ok(())
    }

    /// The lists of the frame in `slot`, in the order in which they are drawn.
    fn read_lists(&mut self, slot: &Slot) -> Result<Lists, RenderError> {
        let renderer = self.renderer.as_ref().ok_or_else(dropped)?;
        let cx = &renderer.cx;
        let Some(buffers) = &slot.buffers else {
            return Err(dropped());
        };
        let [_, draw_bytes, instance_bytes, _] = list_bytes(slot.shape);
        let readback = cx.create_buffer(
            "frozen lists",
            draw_bytes + instance_bytes,
            vk::BufferUsageFlags::TRANSFER_DST,
            MemoryLocation::GpuToCpu,
        )?;
        let copied = self.core.begin().and_then(|()| {
            // SAFETY: the command buffer is recording and outside rendering.
            let mut c = unsafe { Commands::new(cx, self.core.cmd) };
            c.barrier(Access::ComputeReadWrite, &[Access::TransferRead]);
            for (from, dst_offset, size) in [
                (&buffers.draws, 0, draw_bytes),
                (&buffers.instances, draw_bytes, instance_bytes),
            ] {
                let region = vk::BufferCopy {
                    src_offset: 0,
                    dst_offset,
                    size: size.min(from.size_bytes),
                };
                c.copy_buffer(from, &readback, region);
            }
            c.barrier(Access::TransferWrite, &[Access::HostRead]);
            self.core.submit_and_wait(Ok(()))
        });
        let bytes: Vec<u8> = readback.read((draw_bytes + instance_bytes) as usize);
        cx.destroy_buffer(readback);
        copied?;
        let (draws, instances) = bytes.split_at(draw_bytes as usize);
        let whole = |bytes: &[u8], size: usize| bytes.len() / size * size;
        let recorded = slot.recorded.as_ref();
        Ok(Lists {
            plain_slices: recorded.map_or(0, |r| r.plain_slices),
            draws: bytemuck::pod_collect_to_vec(&draws[..whole(draws, size_of::<DrawCommand>())]),
            instances: bytemuck::pod_collect_to_vec(
                &instances[..whole(instances, size_of::<Instance>())],
            ),
        })
    }

    /// Fills a part's buffers.
    fn transform(&mut self, slot: &Slot, plan: &Plan, part: &mut Part) -> Result<(), RenderError> {
        let renderer = self.renderer.as_ref().ok_or_else(dropped)?;
        let cx = &renderer.cx;
        let p = &renderer.pipelines;
        let pipeline = compute(cx, &plan.look.module("cs"), p.probe_layout)?;
        let result = (|| {
            let pool = descriptor_pool(cx, "limit sets", 1, 1)?;
            let set = allocate_set(cx, "limit set", pool, p.probe_set);
            let mut staging = None;
            let result = set.and_then(|set| {
                write_buffers(cx, set, &[(super::bindings::Kind::Storage, &part.vertices)]);
                let bytes = size_of_val(&plan.indices[..]) as u64;
                let staging = staging.insert(cx.create_buffer(
                    "limit staging",
                    bytes,
                    vk::BufferUsageFlags::TRANSFER_SRC,
                    MemoryLocation::CpuToGpu,
                )?);
                staging.write(0, &plan.indices);
                self.core.begin()?;
                // SAFETY: the command buffer is recording and outside rendering.
                let mut c = unsafe { Commands::new(cx, self.core.cmd) };
                let region = vk::BufferCopy {
                    src_offset: 0,
                    dst_offset: 0,
                    size: bytes,
                };
                c.copy_buffer(staging, &part.indices, region);
                c.barrier(Access::TransferWrite, &[Access::AnyRead]);
                plan.record_transform(&mut c, renderer, slot, pipeline, set);
                self.core.submit_and_wait(Ok(()))
            });
            if let Some(staging) = staging {
                cx.destroy_buffer(staging);
            }
            // SAFETY: the commands that used its set were waited for, or never submitted.
            unsafe { cx.device.destroy_descriptor_pool(pool, None) };
            result
        })();
        // SAFETY: as above.
        unsafe { cx.device.destroy_pipeline(pipeline, None) };
        result
    }
}

impl Frozen {
    fn record(&self, renderer: &Renderer, c: &mut Commands, flat: bool) {
        let slot = &self.slot;
        let drawing = Drawing {
            pipelines: &renderer.pipelines,
            residents: &renderer.residents,
            gallery: renderer.gallery.as_ref(),
            slot,
        };
        let parts = |meshes: bool| {
            let parts = self.parts.iter();
            parts.filter(move |p| matches!(p.look, Look::Mesh(_)) == meshes)
        };
        let mut handed_over = 0;
        let mut counted = |c: &mut Commands, query, meshes| {
            let statistics = slot.statistics != vk::QueryPool::null();
            if statistics {
                c.begin_query(slot.statistics, query);
            }
            crate::limit::record(c, &drawing, parts(meshes), flat, &mut handed_over);
            if statistics {
                c.end_query(slot.statistics, query);
            }
        };
        stamp(c, slot, Stamp::OccludeBegin);
        stamp(c, slot, Stamp::SelectBegin);
        stamp(c, slot, Stamp::SelectEnd);
        stamp(c, slot, Stamp::DrawBegin);
        c.set_viewport(self.view.offset_px, self.view.size_px);
        counted(c, 0, true);
        stamp(c, slot, Stamp::MeshEnd);
        if self.options.ground {
            crate::ground::record(c, &drawing);
        }
        stamp(c, slot, Stamp::GroundEnd);
        if self.options.ground && self.options.shadows {
            crate::shadow::record(c, &drawing, None, renderer.tables.bands.len());
        }
        stamp(c, slot, Stamp::ShadowEnd);
        if self.options.sky {
            crate::sky::record(c, &drawing);
        }
        stamp(c, slot, Stamp::SkyEnd);
        counted(c, 1, false);
        stamp(c, slot, Stamp::ImpostorEnd);
    }
}

/// Errors where the characters are not those that the renderer has.
fn check_characters(renderer: &Renderer, characters: &[Baked]) -> Result<(), RenderError> {
    let same = |(baked, resident): (&Baked, &Option<super::resident::Resident>)| {
        let draws = resident.as_ref().map(|r| &r.draws[..]);
        prepare::validate(baked).is_ok() && draws == Some(&prepare::submesh_draws(baked)[..])
    };
    let known = renderer.residents.len() == characters.len()
        && characters.iter().zip(&renderer.residents).all(same);
    match known {
        true => Ok(()),
        false => Err(RenderError::BadOption {
            option: "characters",
            reason: "they are not the renderer's, in its order".into(),
        }),
    }
}
