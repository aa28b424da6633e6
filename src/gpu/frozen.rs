//! A frame's triangles and quads, already transformed, in static buffers: what [`crate::limit`] draws.

use ash::vk;
use gpu_allocator::MemoryLocation;
use throng_bake::baked::Baked;
use throng_bake::impostor::Kind as ImpostorKind;

use super::commands::{Access, Commands};
use super::context::Context;
use super::descriptors::{allocate_set, descriptor_pool, write_buffers};
use super::headless::{Headless, dropped};
use super::memory::Buffer;
use super::pipeline::{
    ALPHA_TESTED, DrawState, Input, MeshVariant, Mix, Pipelines, SRGB_TARGET, compute,
};
use super::renderer::{Drawing, Renderer, stamp};
use super::slot::{Slot, Stamp, list_bytes};
use crate::error::RenderError;
use crate::frame::{Agent, FrameOptions, FrameReport, Method, View};
use crate::gpu_types::{DrawCommand, DrawConstants, Instance, QUAD_BIN, SELECT_GROUP_SIZE};
use crate::prepare;
use crate::reference::mesh::living_ancestor;

/// Frames drawn before the one that is kept: what they leave for the next one counts for a steady frame.
const FRAMES_BEFORE: usize = 2;
/// Workgroups that every device takes along an axis.
const WORKGROUPS_MAX: u32 = 65_535;

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
    look: Look,
}

/// Which stage's pixel shader draws a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Look {
    Mesh(MeshVariant),
    Impostor(ImpostorKind),
}

/// Pipelines for `limit` and `floor`.
type Pair = [vk::Pipeline; 2];

/// The frame's lists, read back.
struct Lists {
    draws: Vec<DrawCommand>,
    instances: Vec<Instance>,
}

/// A part before it is on the device.
struct Plan {
    character: usize,
    look: Look,
    constants: DrawConstants,
    runs: Vec<Run>,
    vertex_count: u32,
    indices: Vec<u32>,
}

/// Instances whose vertices are transformed together.
struct Run {
    /// Vertices of one instance.
    vertex_count: u32,
    first_instance: u32,
    instance_count: u32,
    first_output: u32,
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
        self.submit_drawing(frozen.view.size_px, &frozen.queries(), |renderer, c| {
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
        let [_, draw_bytes, instance_bytes] = list_bytes(slot.shape);
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
        Ok(Lists {
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
            tables: &renderer.tables,
            gallery: renderer.gallery.as_ref(),
            slot,
        };
        let parts = |meshes: bool| {
            let parts = self.parts.iter();
            parts.filter(move |p| matches!(p.look, Look::Mesh(_)) == meshes)
        };
        let counted = |c: &mut Commands, query, meshes| {
            let statistics = slot.statistics != vk::QueryPool::null();
            if statistics {
                c.begin_query(slot.statistics, query);
            }
            crate::limit::record(c, &drawing, parts(meshes), flat);
            if statistics {
                c.end_query(slot.statistics, query);
            }
        };
        stamp(c, slot, Stamp::SelectBegin);
        stamp(c, slot, Stamp::SelectEnd);
        stamp(c, slot, Stamp::DrawBegin);
        c.set_viewport(self.view.size_px);
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

    /// Query pools that have to be reset before [`Frozen::record`], with their sizes.
    pub(super) fn queries(&self) -> [(vk::QueryPool, u32); 2] {
        [
            (self.slot.timestamps, Stamp::Count as u32),
            (self.slot.statistics, 2),
        ]
    }
}

/// Errors where the characters are not those that the renderer has.
fn check_characters(renderer: &Renderer, characters: &[Baked]) -> Result<(), RenderError> {
    let same = |(baked, resident): (&Baked, &super::resident::Resident)| {
        prepare::validate(baked).is_ok() && prepare::submesh_draws(baked) == resident.draws
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

/// What every draw of the frame shows, in the order of the draws.
fn plans(renderer: &Renderer, lists: &Lists, characters: &[Baked]) -> Vec<Plan> {
    let mut meshes = Vec::new();
    let mut impostors = Vec::new();
    for (character, (resident, baked)) in renderer.residents.iter().zip(characters).enumerate() {
        for draw in &resident.draws {
            let mut plan = Plan::new(character, Look::Mesh(draw.variant()));
            plan.constants.first_vertex = draw.first_vertex;
            plan.constants.alpha_cutoff = draw.alpha_cutoff.unwrap_or(0.0);
            for band in draw.first_band..draw.first_band + draw.band_count {
                let command = lists.draw(resident.first_bin + band);
                let band = &baked.bands[band as usize];
                let window =
                    &baked.indices[band.first_index as usize..][..band.index_count as usize];
                let first = plan.begin(&command, band.vertex_count);
                let instances = lists.instances(&command);
                for (instance, base) in instances
                    .iter()
                    .zip((first..).step_by(band.vertex_count.max(1) as usize))
                {
                    let live = instance.live_vertex_count;
                    let living = |v| living_ancestor(baked, draw.first_vertex as usize, v, live).0;
                    for corners in window.chunks_exact(3) {
                        let [a, b, c] = [corners[0], corners[1], corners[2]].map(living);
                        if a != b && b != c && c != a {
                            plan.indices.extend([a, b, c].map(|v| base + v));
                        }
                    }
                }
            }
            meshes.push(plan);
        }
        let kinds = &renderer.tables.representations[character].kinds;
        for kind in kinds.iter().filter(|k| k.bin != QUAD_BIN) {
            let mut plan = Plan::new(character, Look::Impostor(kind.kind));
            plan.constants.first_vertex = 4 * kind.first_quad;
            plan.constants.first_quad = kind.first_quad_texel;
            plan.add_quads(renderer, lists, kind.bin);
            impostors.push(plan);
        }
    }
    // What blends comes last, for all characters.
    if !characters.is_empty() {
        let mut plan = Plan::new(0, Look::Impostor(ImpostorKind::Quad));
        plan.add_quads(renderer, lists, QUAD_BIN);
        impostors.push(plan);
    }
    meshes.append(&mut impostors);
    meshes
}

impl Lists {
    fn draw(&self, bin: u32) -> DrawCommand {
        let none: DrawCommand = bytemuck::Zeroable::zeroed();
        self.draws.get(bin as usize).copied().unwrap_or(none)
    }

    fn instances(&self, draw: &DrawCommand) -> &[Instance] {
        let first = draw.first_instance as usize;
        let list = self
            .instances
            .get(first..first + draw.instance_count as usize);
        list.unwrap_or(&[])
    }
}

impl Plan {
    fn new(character: usize, look: Look) -> Self {
        Self {
            character,
            look,
            constants: bytemuck::Zeroable::zeroed(),
            runs: Vec::new(),
            vertex_count: 0,
            indices: Vec::new(),
        }
    }

    /// Adds a list of impostors.
    fn add_quads(&mut self, renderer: &Renderer, lists: &Lists, bin: u32) {
        let window = &renderer.tables.bands[bin as usize];
        let command = lists.draw(bin);
        let first = self.begin(&command, window.vertex_count);
        let quads = window.vertex_count / 4 * lists.instances(&command).len() as u32;
        let corners = crate::impostor::indices(quads);
        self.indices.extend(corners.iter().map(|v| first + v));
    }

    /// Adds a list, each of whose instances has `vertex_count` vertices, and returns where they begin.
    fn begin(&mut self, command: &DrawCommand, vertex_count: u32) -> u32 {
        let first_output = self.vertex_count;
        self.runs.push(Run {
            vertex_count,
            first_instance: command.first_instance,
            instance_count: command.instance_count,
            first_output,
        });
        let added = vertex_count.saturating_mul(command.instance_count);
        self.vertex_count = self.vertex_count.saturating_add(added);
        first_output
    }

    fn allocate(&self, cx: &Context, [limit, floor]: Pair) -> Result<Part, RenderError> {
        use vk::BufferUsageFlags as U;
        let bytes = self.vertex_count as u64 * 16 * self.look.rows() as u64;
        if bytes > cx.capabilities.storage_range {
            return Err(RenderError::Limit {
                object: cx.full_name("transformed vertices"),
                needed: bytes,
                limit: cx.capabilities.storage_range,
                unit: "bytes of storage buffer",
                hint: "freeze a frame of fewer agents, or of coarser levels of detail",
            });
        }
        let usage = U::STORAGE_BUFFER | U::VERTEX_BUFFER;
        let vertices = cx.create_buffer(
            "transformed vertices",
            bytes,
            usage,
            MemoryLocation::GpuOnly,
        )?;
        let indices = cx.create_buffer(
            "transformed indices",
            size_of_val(&self.indices[..]) as u64,
            U::INDEX_BUFFER | U::TRANSFER_DST,
            MemoryLocation::GpuOnly,
        );
        let indices = match indices {
            Ok(indices) => indices,
            Err(e) => {
                cx.destroy_buffer(vertices);
                return Err(e);
            }
        };
        Ok(Part {
            character: self.character,
            constants: self.constants,
            limit,
            floor,
            vertices,
            indices,
            index_count: self.indices.len() as u32,
            look: self.look,
        })
    }

    fn record_transform(
        &self,
        c: &mut Commands,
        renderer: &Renderer,
        slot: &Slot,
        pipeline: vk::Pipeline,
        set: vk::DescriptorSet,
    ) {
        const COMPUTE: vk::PipelineBindPoint = vk::PipelineBindPoint::COMPUTE;
        let layout = renderer.pipelines.probe_layout;
        c.bind_pipeline(COMPUTE, pipeline);
        c.bind_set(COMPUTE, layout, 0, slot.draw_set);
        c.bind_set(COMPUTE, layout, 1, renderer.residents[self.character].set);
        if let Some(gallery) = &renderer.gallery {
            c.bind_set(COMPUTE, layout, 2, gallery.set);
        }
        c.bind_set(COMPUTE, layout, 3, set);
        for run in self.runs.iter().filter(|r| r.vertex_count > 0) {
            let mut done = 0;
            while done < run.instance_count {
                let rows = (run.instance_count - done).min(WORKGROUPS_MAX);
                let constants = DrawConstants {
                    probe_vertex_count: run.vertex_count,
                    probe_instance: run.first_instance + done,
                    probe_output: run.first_output + done * run.vertex_count,
                    ..self.constants
                };
                c.push_constants(layout, vk::ShaderStageFlags::COMPUTE, &constants);
                c.dispatch_rows([run.vertex_count.div_ceil(SELECT_GROUP_SIZE), rows]);
                done += rows;
            }
        }
        c.barrier(Access::ComputeReadWrite, &[Access::DrawRead]);
    }
}

impl Look {
    /// Rows of 16 bytes of a transformed vertex: `LIMIT_ROWS` of hlsl/limit.hlsl.
    fn rows(self) -> u32 {
        match self {
            Self::Mesh(v) => 2 + v.textured as u32 + v.double_sided as u32,
            Self::Impostor(ImpostorKind::Flat) => 7,
            Self::Impostor(ImpostorKind::Quad) => 5,
        }
    }

    fn module(self, stage: &str) -> String {
        let what = match self {
            Self::Mesh(v) => match (v.textured, v.double_sided) {
                (false, false) => "mesh",
                (true, false) => "mesh_textured",
                (false, true) => "mesh_double",
                (true, true) => "mesh_textured_double",
            },
            Self::Impostor(ImpostorKind::Flat) => "impostor",
            Self::Impostor(ImpostorKind::Quad) => "impostor_soft",
        };
        format!("limit_{what}_{stage}")
    }

    /// Of the stage that draws it otherwise.
    fn pixel_module(self) -> String {
        self.module("ps").replace("limit_", "")
    }

    fn pipelines(self, cx: &Context, pipelines: &Pipelines) -> Result<Pair, RenderError> {
        let (alpha_tested, double_sided, mix) = match self {
            Self::Mesh(v) => (v.alpha_tested, v.double_sided, Mix::Replaces),
            Self::Impostor(ImpostorKind::Flat) => (false, true, Mix::Replaces),
            Self::Impostor(ImpostorKind::Quad) => (false, true, Mix::Covers),
        };
        let rows = self.rows();
        let limit = pipelines.graphics(
            cx,
            &DrawState {
                name: "limit",
                modules: &[&self.module("vs"), &self.pixel_module()],
                input: Input::Rows {
                    read: rows,
                    of: rows,
                },
                constants: &[
                    (ALPHA_TESTED, alpha_tested),
                    (SRGB_TARGET, pipelines.encodes_srgb()),
                ],
                cull: match double_sided {
                    true => vk::CullModeFlags::NONE,
                    false => vk::CullModeFlags::BACK,
                },
                topology: vk::PrimitiveTopology::TRIANGLE_LIST,
                depth_write: true,
                mix,
            },
        )?;
        let floor = pipelines.graphics(
            cx,
            &DrawState {
                name: "floor",
                modules: &["limit_floor_vs", "limit_floor_ps"],
                input: Input::Rows { read: 1, of: rows },
                constants: &[],
                cull: match double_sided {
                    true => vk::CullModeFlags::NONE,
                    false => vk::CullModeFlags::BACK,
                },
                topology: vk::PrimitiveTopology::TRIANGLE_LIST,
                depth_write: true,
                mix: Mix::Replaces,
            },
        );
        match floor {
            Ok(floor) => Ok([limit, floor]),
            Err(e) => {
                // SAFETY: made just now, used by nothing.
                unsafe { cx.device.destroy_pipeline(limit, None) };
                Err(e)
            }
        }
    }
}
