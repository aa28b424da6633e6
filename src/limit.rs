//! limit: draws triangles and quads that were transformed before, for the least that their picture can cost. Host side of
//! hlsl/limit.hlsl; what is drawn is made by [`crate::gpu::Frozen`].

use ash::vk;

use crate::gpu::{Commands, DRAW_STAGES, Drawing, Part};

/// Records one draw for each part, with the stage's pixel shader or, where `flat`, in one colour.
pub(crate) fn record<'a>(
    c: &mut Commands,
    drawing: &Drawing,
    parts: impl Iterator<Item = &'a Part>,
    flat: bool,
    handed_over: &mut u32,
) {
    const GRAPHICS: vk::PipelineBindPoint = vk::PipelineBindPoint::GRAPHICS;
    let layout = drawing.pipelines.draw_layout;
    let mut bound = None;
    for part in parts {
        let Some(resident) = &drawing.residents[part.character] else {
            continue;
        };
        let pipeline = if flat { part.floor } else { part.limit };
        if bound != Some(pipeline) {
            c.bind_pipeline(GRAPHICS, pipeline);
            c.bind_set(GRAPHICS, layout, 0, drawing.slot.draw_set);
            if let Some(gallery) = drawing.gallery {
                c.bind_set(GRAPHICS, layout, 2, gallery.set);
            }
            bound = Some(pipeline);
        }
        c.bind_set(GRAPHICS, layout, 1, resident.set);
        c.push_constants(layout, DRAW_STAGES, &part.constants);
        c.bind_instances(&part.vertices);
        c.bind_indices(&part.indices, vk::IndexType::UINT32);
        c.draw_indexed(part.index_count, 0, 0);
        drawing.slot.hand_over(c, handed_over);
    }
}
