//! ground: the paved plane y = 0 out to the horizon, a square and rings around it in one draw. Host side of hlsl/ground.hlsl.

use ash::vk;

use crate::gpu::{Commands, Drawing};

/// Rings around the innermost square, each four times as wide: out to 20 km.
const RINGS: u32 = 7;

/// Records the draw.
pub(crate) fn record(c: &mut Commands, drawing: &Drawing) {
    const GRAPHICS: vk::PipelineBindPoint = vk::PipelineBindPoint::GRAPHICS;
    let pipelines = drawing.pipelines;
    c.bind_pipeline(GRAPHICS, pipelines.ground);
    c.bind_set(GRAPHICS, pipelines.draw_layout, 0, drawing.slot.draw_set);
    c.draw(6 * (1 + 4 * RINGS), 1);
}
