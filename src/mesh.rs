//! mesh: one indirect multi-draw per submesh, a sub-draw per band. Host side of hlsl/mesh.hlsl; twin in
//! [`crate::reference::mesh`].

use ash::vk;

use crate::gpu::{Commands, DRAW_STAGES, Drawing};
use crate::gpu_types::{BIN_NONE, DrawConstants};
use crate::reference::select::Selection;

const GRAPHICS: vk::PipelineBindPoint = vk::PipelineBindPoint::GRAPHICS;

/// Records the crowd's draws: from the GPU's lists, or, where the CPU selected, one draw per agent and submesh.
pub(crate) fn record(c: &mut Commands, drawing: &Drawing, cpu: Option<&Selection>) {
    let (slot, pipelines) = (drawing.slot, drawing.pipelines);
    let Some(buffers) = &slot.buffers else { return };
    let layout = pipelines.draw_layout;
    let instances = match (cpu, &slot.cpu_lists) {
        (Some(_), Some(lists)) => &lists.instances,
        _ => &buffers.instances,
    };
    let mut bound = None;
    let mut handed_over = 0;
    for (character, resident) in drawing.residents.iter().enumerate() {
        let Some(resident) = resident
            .as_ref()
            .filter(|_| slot.may_draw(character, BIN_NONE))
        else {
            continue;
        };
        for (i, draw) in resident.draws.iter().enumerate() {
            let variant = draw.variant();
            if bound != Some(variant) {
                c.bind_pipeline(GRAPHICS, pipelines.mesh(variant));
                if bound.is_none() {
                    // Not before there is something to draw: lavapipe of Mesa 22.3 crashes in a query that begins with
                    // vertex buffers and no pipeline.
                    c.bind_instances(instances);
                    c.bind_set(GRAPHICS, layout, 0, slot.draw_set);
                }
                bound = Some(variant);
            }
            if i == 0 {
                c.bind_set(GRAPHICS, layout, 1, resident.set);
                c.bind_indices(&resident.indices);
            }
            let constants = DrawConstants {
                first_vertex: draw.first_vertex,
                alpha_cutoff: draw.alpha_cutoff.unwrap_or(0.0),
                ..bytemuck::Zeroable::zeroed()
            };
            c.push_constants(layout, DRAW_STAGES, &constants);
            let first_bin = resident.first_bin + draw.first_band;
            match cpu {
                None => {
                    c.draw_indexed_indirect(&buffers.draws, first_bin, draw.band_count);
                    slot.hand_over(c, &mut handed_over);
                }
                Some(selection) => {
                    for d in &selection.draws[first_bin as usize..][..draw.band_count as usize] {
                        for instance in d.first_instance..d.first_instance + d.instance_count {
                            c.draw_indexed(d.index_count, d.first_index, instance);
                        }
                    }
                }
            }
        }
    }
}
