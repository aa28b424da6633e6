//! shadow: a soft dark spot under every agent that is near enough to show one, one draw over their list. Host side of
//! hlsl/shadow.hlsl.

use ash::vk;

use crate::gpu::{Commands, Drawing};
use crate::gpu_types::DrawCommand;
use crate::reference::select::Selection;

/// Records the draw: from the arguments behind the GPU's `bins` draws, or of the list that the CPU made.
pub(crate) fn record(c: &mut Commands, drawing: &Drawing, cpu: Option<&Selection>, bins: usize) {
    const GRAPHICS: vk::PipelineBindPoint = vk::PipelineBindPoint::GRAPHICS;
    let (slot, pipelines) = (drawing.slot, drawing.pipelines);
    let Some(buffers) = &slot.buffers else { return };
    c.bind_pipeline(GRAPHICS, pipelines.shadow);
    c.bind_set(GRAPHICS, pipelines.draw_layout, 0, slot.draw_set);
    match (cpu, &slot.cpu_lists) {
        (Some(selection), Some(lists)) => {
            c.bind_instances(&lists.shadows);
            c.draw(4, selection.shadows.len() as u32);
        }
        _ => {
            c.bind_instances(&buffers.shadows);
            c.draw_indirect(&buffers.draws, (bins * size_of::<DrawCommand>()) as u64);
        }
    }
}
