//! Runs the mesh stage's vertex work in compute and reads it back, for the comparison with its twin.

use ash::vk;
use glam::Vec4;
use gpu_allocator::MemoryLocation;

use super::bindings::Kind;
use super::commands::{Access, Commands};
use super::memory::Buffer;
use super::pipeline::{allocate_set, descriptor_pool, write_buffers};
use super::renderer::Renderer;
use crate::error::RenderError;
use crate::frame::CharacterId;
use crate::gpu_types::{DrawConstants, SELECT_GROUP_SIZE};
use crate::reference::mesh::Skinned;

/// One submesh's output.
pub(super) struct Probe {
    output: Buffer,
    pool: vk::DescriptorPool,
    set: vk::DescriptorSet,
    character: usize,
    first_vertex: u32,
    vertex_count: u32,
}

impl Probe {
    pub fn new(
        renderer: &Renderer,
        character: CharacterId,
        submesh: usize,
    ) -> Result<Self, RenderError> {
        let cx = &renderer.cx;
        let found = renderer
            .residents
            .get(character.0 as usize)
            .and_then(|r| Some((r, r.draws.get(submesh)?)));
        let Some((resident, draw)) = found else {
            return Err(RenderError::BadOption {
                option: "submesh",
                reason: format!("there is no submesh {submesh} of character {}", character.0),
            });
        };
        let vertex_count =
            renderer.tables.submeshes[resident.first_submesh as usize + submesh].vertex_count;
        let output = cx.create_buffer(
            "probed vertices",
            vertex_count as u64 * 32,
            vk::BufferUsageFlags::STORAGE_BUFFER,
            MemoryLocation::GpuToCpu,
        )?;
        let sets = descriptor_pool(cx, "probe sets", 1, 1).and_then(|pool| {
            allocate_set(cx, "probe set", pool, renderer.pipelines.probe_set)
                .map(|set| (pool, set))
                .inspect_err(|_| {
                    // SAFETY: the pool was made just now and has no set in use.
                    unsafe { cx.device.destroy_descriptor_pool(pool, None) }
                })
        });
        let (pool, set) = match sets {
            Ok(sets) => sets,
            Err(e) => {
                cx.destroy_buffer(output);
                return Err(e);
            }
        };
        write_buffers(cx, set, &[(Kind::Storage, &output)]);
        Ok(Self {
            output,
            pool,
            set,
            character: character.0 as usize,
            first_vertex: draw.first_vertex,
            vertex_count,
        })
    }

    pub fn record(&self, c: &mut Commands, renderer: &Renderer, instance: u32) {
        const COMPUTE: vk::PipelineBindPoint = vk::PipelineBindPoint::COMPUTE;
        let p = &renderer.pipelines;
        let slot = &renderer.slots[0];
        let cpu = slot.recorded.as_ref().is_some_and(|r| r.cpu.is_some());
        let draw_set = if cpu {
            slot.cpu_draw_set
        } else {
            slot.draw_set
        };
        c.bind_pipeline(COMPUTE, p.probe);
        c.bind_set(COMPUTE, p.probe_layout, 0, draw_set);
        c.bind_set(
            COMPUTE,
            p.probe_layout,
            1,
            renderer.residents[self.character].set,
        );
        c.bind_set(COMPUTE, p.probe_layout, 2, self.set);
        c.push_constants(
            p.probe_layout,
            vk::ShaderStageFlags::COMPUTE,
            &DrawConstants {
                first_vertex: self.first_vertex,
                alpha_cutoff: 0.0,
                probe_vertex_count: self.vertex_count,
                probe_instance: instance,
            },
        );
        c.dispatch(self.vertex_count.div_ceil(SELECT_GROUP_SIZE));
        c.barrier(Access::ComputeReadWrite, &[Access::HostRead]);
    }

    pub fn read(&self) -> Vec<Skinned> {
        let rows: Vec<Vec4> = self.output.read(2 * self.vertex_count as usize);
        rows.chunks_exact(2)
            .map(|r| Skinned {
                position: r[0].truncate(),
                normal: r[1].truncate(),
            })
            .collect()
    }

    pub fn destroy(self, renderer: &Renderer) {
        // SAFETY: the caller waited for the commands; consumed, so once.
        unsafe { renderer.cx.device.destroy_descriptor_pool(self.pool, None) };
        renderer.cx.destroy_buffer(self.output);
    }
}
