//! occlude: the larger agents' coarse meshes as depth, and a pyramid of the farthest depth over it, against which the select
//! stage tests everybody. Host side of hlsl/occlude.hlsl; twin in [`crate::reference::occlude`].

use ash::vk;

use crate::gpu::{Access, Commands, DRAW_STAGES, Drawing};
use crate::gpu_types::{DrawConstants, REDUCE_BLOCK, REDUCE_GROUP_SIZE};
use crate::reference::occlude::padded_size;

const COMPUTE: vk::PipelineBindPoint = vk::PipelineBindPoint::COMPUTE;
const GRAPHICS: vk::PipelineBindPoint = vk::PipelineBindPoint::GRAPHICS;

/// Records the draws of the occluders that `select` listed, and the pyramid. Outside rendering.
pub(crate) fn record(c: &mut Commands, drawing: &Drawing) {
    let Some(occluders) = &drawing.slot.occluders else {
        return;
    };
    occluders.begin(
        c,
        if drawing.pipelines.reversed_depth() {
            0.0
        } else {
            1.0
        },
    );
    draw(c, drawing);
    occluders.end(c);

    let pipelines = drawing.pipelines;
    let [width, height] = padded_size(occluders.size_px);
    let blocks = (width / REDUCE_BLOCK) * (height / REDUCE_BLOCK);
    c.bind_set(COMPUTE, pipelines.reduce_layout, 0, occluders.set);
    c.bind_pipeline(COMPUTE, pipelines.reduce);
    c.dispatch(blocks.div_ceil(REDUCE_GROUP_SIZE));
    c.barrier(Access::ComputeReadWrite, &[Access::ComputeReadWrite]);
    // A thread of the second pass reduces a square of four blocks each way.
    c.bind_pipeline(COMPUTE, pipelines.reduce_top);
    c.dispatch(blocks.div_ceil(16).div_ceil(REDUCE_GROUP_SIZE));
    c.barrier(Access::ComputeReadWrite, &[Access::ComputeReadWrite]);
}

/// A draw per submesh through which nothing can be seen.
fn draw(c: &mut Commands, drawing: &Drawing) {
    let (slot, pipelines) = (drawing.slot, drawing.pipelines);
    let Some(buffers) = &slot.buffers else { return };
    let layout = pipelines.draw_layout;
    let mut bound = None;
    for (resident, &agents) in drawing.residents.iter().zip(&slot.agent_counts) {
        let Some(resident) = resident else { continue };
        let mut first = true;
        let solid = |d: &&crate::prepare::SubmeshDraw| d.alpha_cutoff.is_none() && agents > 0;
        for draw in resident.draws.iter().filter(solid) {
            if bound != Some(draw.double_sided) {
                let pipeline = pipelines.occluders[usize::from(draw.double_sided)];
                c.bind_pipeline(GRAPHICS, pipeline);
                if bound.is_none() {
                    c.bind_instances(&buffers.instances);
                    c.bind_set(GRAPHICS, layout, 0, slot.draw_set);
                }
                bound = Some(draw.double_sided);
            }
            if first {
                c.bind_set(GRAPHICS, layout, 1, resident.set);
                c.bind_indices(&resident.indices, resident.index_type);
                first = false;
            }
            let constants = DrawConstants {
                first_vertex: draw.first_vertex,
                alpha_cutoff: 0.0,
                probe_vertex_count: 0,
                probe_instance: 0,
                probe_output: 0,
            };
            c.push_constants(layout, DRAW_STAGES, &constants);
            let first_bin = resident.first_bin + draw.first_band;
            c.draw_indexed_indirect(&buffers.draws, first_bin, draw.band_count);
        }
    }
}
