//! sky: a gradient behind everything, one draw. Host side of hlsl/sky.hlsl.

use ash::vk;

use crate::gpu::{Commands, Drawing};

/// Records the draw.
pub(crate) fn record(c: &mut Commands, drawing: &Drawing) {
    const GRAPHICS: vk::PipelineBindPoint = vk::PipelineBindPoint::GRAPHICS;
    let pipelines = drawing.pipelines;
    c.bind_pipeline(GRAPHICS, pipelines.sky);
    c.bind_set(GRAPHICS, pipelines.draw_layout, 0, drawing.slot.draw_set);
    c.draw(3, 1);
}
