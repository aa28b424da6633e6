//! What the draws of a frame showed, before it is on the device: which instances' vertices to transform, and the triangles that
//! are left of them.

use std::ops::Range;

use ash::vk;
use gpu_allocator::MemoryLocation;
use throng_bake::baked::Baked;

use super::commands::{Access, Commands};
use super::context::Context;
use super::frozen::Part;
use super::pipeline::{ALPHA_TESTED, DrawState, Input, MeshVariant, Mix, Pipelines, SRGB_TARGET};
use super::renderer::Renderer;
use super::slot::Slot;
use crate::error::RenderError;
use crate::gpu_types::{DrawCommand, DrawConstants, Instance, SELECT_GROUP_SIZE};
use crate::impostor;
use crate::reference::mesh::living_ancestor;

/// Workgroups that every device takes along an axis.
const WORKGROUPS_MAX: u32 = 65_535;

/// Which stage's pixel shader draws a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Look {
    Mesh(MeshVariant),
    Impostor(impostor::Look),
}

/// Pipelines for `limit` and `floor`.
pub(super) type Pair = [vk::Pipeline; 2];

/// The frame's lists, read back.
pub(super) struct Lists {
    pub draws: Vec<DrawCommand>,
    pub plain_slices: u32,
    pub instances: Vec<Instance>,
}

/// A part before it is on the device.
pub(super) struct Plan {
    pub character: usize,
    pub look: Look,
    pub constants: DrawConstants,
    pub runs: Vec<Run>,
    pub vertex_count: u32,
    pub indices: Vec<u32>,
}

/// Instances whose vertices are transformed together.
pub(super) struct Run {
    /// Vertices of one instance.
    pub vertex_count: u32,
    pub first_instance: u32,
    pub instance_count: u32,
    pub first_output: u32,
}

/// What every draw of the frame shows, in the order of the draws.
pub(super) fn plans(renderer: &Renderer, lists: &Lists, characters: &[Baked]) -> Vec<Plan> {
    let mut meshes = Vec::new();
    let mut impostors = Vec::new();
    for (character, (resident, baked)) in renderer.residents.iter().zip(characters).enumerate() {
        let Some(resident) = resident else { continue };
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
    }
    // What blends comes last, for all characters.
    if !characters.is_empty() {
        for (look, bins) in impostor::draws(lists.plain_slices) {
            let plan = Plan::new(0, Look::Impostor(look));
            impostors.extend(plan.of_quads(renderer, lists, bins));
        }
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

    /// A list of impostors, in as many plans like this one as the device's buffers ask for.
    fn of_quads(self, renderer: &Renderer, lists: &Lists, bins: Range<u32>) -> Vec<Self> {
        let Some(window) = renderer.tables.bands.get(bins.start as usize) else {
            return Vec::new();
        };
        let vertex_count = window.vertex_count;
        let instance_bytes = 16 * self.look.rows() as u64 * vertex_count.max(1) as u64;
        let at_most = renderer.cx.capabilities.storage_range / instance_bytes;
        let at_most = at_most.clamp(1, u32::MAX as u64) as u32;
        let all = impostor::draw_of(&lists.draws, bins);
        let firsts = (0..all.instance_count).step_by(at_most as usize);
        let plan = |first: u32| {
            let mut plan = Self::new(self.character, self.look);
            plan.constants = self.constants;
            let command = DrawCommand {
                first_instance: all.first_instance + first,
                instance_count: at_most.min(all.instance_count - first),
                ..all
            };
            plan.begin(&command, vertex_count);
            plan.indices = impostor::indices(vertex_count / 4 * command.instance_count);
            plan
        };
        firsts.map(plan).collect()
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

    pub(super) fn allocate(&self, cx: &Context, [limit, floor]: Pair) -> Result<Part, RenderError> {
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

    pub(super) fn record_transform(
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
        if let Some(resident) = &renderer.residents[self.character] {
            c.bind_set(COMPUTE, layout, 1, resident.set);
        }
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
            Self::Impostor(impostor::Look::Plain) => 8,
            Self::Impostor(_) => 9,
        }
    }

    pub(super) fn module(self, stage: &str) -> String {
        let what = match self {
            Self::Mesh(v) => match (v.textured, v.double_sided) {
                (false, false) => "mesh",
                (true, false) => "mesh_textured",
                (false, true) => "mesh_double",
                (true, true) => "mesh_textured_double",
            },
            Self::Impostor(impostor::Look::Plain) => "impostor_plain",
            Self::Impostor(impostor::Look::Soft) => "impostor_soft",
            Self::Impostor(impostor::Look::Flat) => "impostor",
        };
        format!("limit_{what}_{stage}")
    }

    /// Of the stage that draws it otherwise.
    fn pixel_module(self) -> String {
        self.module("ps").replace("limit_", "")
    }

    pub(super) fn pipelines(
        self,
        cx: &Context,
        pipelines: &Pipelines,
    ) -> Result<Pair, RenderError> {
        let (alpha_tested, double_sided, mix) = match self {
            Self::Mesh(v) => (v.alpha_tested, v.double_sided, Mix::Replaces),
            Self::Impostor(_) => (false, true, Mix::Covers),
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
