//! Runs the vertex work of the mesh and impostor stages in compute and reads it back, for the comparison with their twins.

use ash::vk;
use glam::Vec4;
use gpu_allocator::MemoryLocation;

use super::bindings::Kind;
use super::commands::{Access, Commands};
use super::descriptors::{allocate_set, descriptor_pool, write_buffers};
use super::memory::Buffer;
use super::renderer::Renderer;
use crate::error::RenderError;
use crate::frame::CharacterId;
use crate::gpu_types::{DrawConstants, QUAD_BIN, SELECT_GROUP_SIZE};

/// Whose vertices a probe looks at.
#[derive(Debug, Clone, Copy)]
pub(super) enum Probed {
    /// A submesh; position, normal and colour of every vertex.
    Mesh(usize),
    /// An impostor kind; corner and mip, direction and depth extent, place in the atlas, shift.
    Impostor(usize),
}

/// What is probed, and its output.
pub(super) struct Probe {
    output: Buffer,
    pool: vk::DescriptorPool,
    set: vk::DescriptorSet,
    character: usize,
    probed: Probed,
    first_vertex: u32,
    /// The kind is one quad for the whole body.
    one_quad: bool,
    vertex_count: u32,
}

impl Probed {
    fn rows(self) -> usize {
        match self {
            Self::Mesh(_) => 3,
            Self::Impostor(_) => 4,
        }
    }
}

impl Probe {
    pub fn new(
        renderer: &Renderer,
        character: CharacterId,
        probed: Probed,
    ) -> Result<Self, RenderError> {
        let cx = &renderer.cx;
        let mut one_quad = false;
        let found = renderer
            .tables
            .slot_of(character)
            .and_then(|slot| renderer.residents[slot].as_ref())
            .and_then(|r| match probed {
                Probed::Mesh(submesh) => {
                    let first = r.draws.get(submesh)?.first_vertex;
                    let info = &renderer.tables.submeshes[r.first_submesh as usize + submesh];
                    Some((first, info.vertex_count))
                }
                Probed::Impostor(kind) => {
                    let kinds = &renderer.tables.representations[character.slot()].kinds;
                    let kind = kinds.get(kind)?;
                    one_quad = kind.bin == QUAD_BIN;
                    let window = &renderer.tables.bands[kind.bin as usize];
                    Some((0, window.vertex_count))
                }
            });
        let Some((first_vertex, vertex_count)) = found else {
            return Err(RenderError::BadOption {
                option: "probe",
                reason: format!("character {} has no {probed:?}", character.0),
            });
        };
        let output = cx.create_buffer(
            "probed vertices",
            vertex_count as u64 * probed.rows() as u64 * 16,
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
            character: character.slot(),
            probed,
            first_vertex,
            one_quad,
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
        let pipeline = match self.probed {
            Probed::Mesh(_) => p.mesh_probe,
            Probed::Impostor(_) if self.one_quad => p.impostor_soft_probe,
            Probed::Impostor(_) => p.impostor_probe,
        };
        c.bind_pipeline(COMPUTE, pipeline);
        c.bind_set(COMPUTE, p.probe_layout, 0, draw_set);
        if let Some(resident) = &renderer.residents[self.character] {
            c.bind_set(COMPUTE, p.probe_layout, 1, resident.set);
        }
        if let Some(gallery) = &renderer.gallery {
            c.bind_set(COMPUTE, p.probe_layout, 2, gallery.set);
        }
        c.bind_set(COMPUTE, p.probe_layout, 3, self.set);
        c.push_constants(
            p.probe_layout,
            vk::ShaderStageFlags::COMPUTE,
            &DrawConstants {
                first_vertex: self.first_vertex,
                alpha_cutoff: 0.0,
                probe_vertex_count: self.vertex_count,
                probe_instance: instance,
                probe_output: 0,
            },
        );
        c.dispatch(self.vertex_count.div_ceil(SELECT_GROUP_SIZE));
        c.barrier(Access::ComputeReadWrite, &[Access::HostRead]);
    }

    /// `rows` vectors per vertex.
    pub fn read(&self) -> Vec<Vec4> {
        self.output
            .read(self.probed.rows() * self.vertex_count as usize)
    }

    pub fn destroy(self, renderer: &Renderer) {
        // SAFETY: the caller waited for the commands; consumed, so once.
        unsafe { renderer.cx.device.destroy_descriptor_pool(self.pool, None) };
        renderer.cx.destroy_buffer(self.output);
    }
}
