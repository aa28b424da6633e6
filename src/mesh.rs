//! mesh: one indirect multi-draw per submesh, a sub-draw per band, and one for its smallest bands where those are drawn packed. Host side of hlsl/mesh.hlsl; twin in
//! [`crate::reference::mesh`].

use ash::vk;

use crate::frame::Method;
use crate::gpu::{Commands, DRAW_STAGES, Drawing, Recorded, packed_command};
use crate::gpu_types::{BIN_NONE, DrawConstants, PACKED_COMMANDS};

/// How much further off than the first of them some agent may be, for small meshes to have a draw of their own. A few agents are not
/// worth one, and without it they are drawn with the others.
const PACKED_FROM: f32 = 1.25;

/// Agents that may be small meshes before a CPU driver gets what was drawn of them: each time costs as much as drawing some hundred.
const PACKED_HAND_OVER: u32 = 4096;

const GRAPHICS: vk::PipelineBindPoint = vk::PipelineBindPoint::GRAPHICS;

/// Records the crowd's draws: from the GPU's lists, or, where the CPU selected, one draw per agent and submesh.
pub(crate) fn record(c: &mut Commands, drawing: &Drawing, recorded: &Recorded) {
    let cpu = recorded.cpu.as_ref();
    let (slot, pipelines) = (drawing.slot, drawing.pipelines);
    let Some(buffers) = &slot.buffers else { return };
    let layout = pipelines.draw_layout;
    let instances = match (cpu, &slot.cpu_lists) {
        (Some(_), Some(lists)) => &lists.instances,
        _ => &buffers.instances,
    };
    let mut bound = None;
    let (mut handed_over, mut waiting) = (0, 0);
    // The smallest meshes come last, many agents to an instance. The CPU's lists are drawn one by one, and full detail has none.
    let packs = cpu.is_none() && recorded.options.method != Method::Full;
    for packed in [false, true] {
        for (character, resident) in drawing.residents.iter().enumerate() {
            let Some(resident) = resident
                .as_ref()
                .filter(|_| slot.may_draw(character, BIN_NONE))
            else {
                continue;
            };
            let mut is_first = true;
            for draw in &resident.draws {
                let end = draw.first_band + draw.band_count;
                let packs = packs && recorded.coarsest_error >= PACKED_FROM * draw.packed_error;
                let split = end - if packs { draw.packed_band_count } else { 0 };
                let bands = match packed {
                    false => draw.first_band..split,
                    true => split..end,
                };
                if bands.is_empty() {
                    continue;
                }
                let variant = match packed {
                    false => draw.variant(),
                    true => draw.packed_variant(),
                };
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
                if std::mem::take(&mut is_first) {
                    c.bind_set(GRAPHICS, layout, 1, resident.set);
                    c.bind_indices(&resident.indices, resident.index_type);
                }
                let constants = DrawConstants {
                    first_vertex: draw.first_vertex,
                    alpha_cutoff: draw.alpha_cutoff.unwrap_or(0.0),
                    ..bytemuck::Zeroable::zeroed()
                };
                c.push_constants(layout, DRAW_STAGES, &constants);
                let (first_bin, count) = (resident.first_bin + bands.start, bands.len() as u32);
                match cpu {
                    None => {
                        let (first, count) = match packed {
                            false => (first_bin, count),
                            true => (
                                packed_command(recorded.bands.len() as u32, first_bin),
                                PACKED_COMMANDS * count,
                            ),
                        };
                        c.draw_indexed_indirect(&buffers.draws, first, count);
                        waiting += slot.agent_counts[character];
                        if !packed || waiting >= PACKED_HAND_OVER {
                            slot.hand_over(c, &mut handed_over);
                            waiting = 0;
                        }
                    }
                    Some(selection) => {
                        for d in &selection.draws[first_bin as usize..][..count as usize] {
                            for instance in d.first_instance..d.first_instance + d.instance_count {
                                c.draw_indexed(d.index_count, d.first_index, instance);
                            }
                        }
                    }
                }
            }
        }
    }
}
