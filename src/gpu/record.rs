//! A frame's commands: what the host's command buffer gets from the stages.

use std::time::Instant;

use ash::vk;

use super::commands::{Access, Commands};
use super::renderer::{Drawing, Renderer, no_slot};
use super::slot::{Recorded, Slot, SlotBuffers, Stamp, list_bytes};
use crate::error::RenderError;
use crate::frame::{FrameOptions, Method, View};

/// Heights of the tallest agent by which the eye may be above all heads, for hidden agents to be looked for.
const EYE_ABOVE_HEADS: f32 = 0.5;

impl Renderer {
    /// Records the select stage, and before it the occlude stage where hidden agents are looked for. Outside rendering;
    /// the occlude stage begins and ends one of its own, into a depth image of the library's.
    ///
    /// # Safety
    /// `cmd` is recording, is outside rendering, and runs before the one that `record_draw` records into, and behind the one
    /// that `record_uploads` recorded into.
    ///
    /// Errors: [`RenderError::BadOption`], [`RenderError::Memory`] for a picture of another size, and [`RenderError::Order`]
    /// before `set_agents`, where characters were added or removed since, or where a character's upload was never recorded.
    pub unsafe fn record_select(
        &mut self,
        cmd: vk::CommandBuffer,
        frame: usize,
        view: &View,
        options: &FrameOptions,
    ) -> Result<(), RenderError> {
        let start = Instant::now();
        view.validate()?;
        options.validate()?;
        let tables = &self.tables;
        let slot = self.slots.get(frame).ok_or_else(|| no_slot(frame))?;
        if !slot.begun || slot.buffers.is_none() {
            return Err(RenderError::Order {
                call: "record_select",
                reason: "begin_frame and set_agents come first",
            });
        }
        self.check_crowd(slot, "record_select")?;
        let slot = &mut self.slots[frame];
        // Seen from well above all heads, agents hide but the ground behind them.
        let among_heads = view.eye().y <= slot.highest + EYE_ABOVE_HEADS * slot.tallest;
        let occlusion = options.looks_for_hidden() && among_heads && !slot.agents.is_empty();
        if occlusion {
            if !self.uploads.is_empty() {
                return Err(RenderError::Order {
                    call: "record_select",
                    reason: "record_uploads comes first: there are characters that were not uploaded",
                });
            }
            let (size_px, keep) = (view.size_px, self.keep_lists);
            slot.reserve_occluders(&self.cx, &self.pipelines, frame, size_px, keep)?;
        }
        if let Some(tables) = &self.table_buffers {
            slot.update_sets(&self.cx, tables);
        }
        let mut constants = crate::select::frame_constants(
            view,
            options,
            slot.agents.len() as u32,
            tables,
            self.pipelines.reversed_depth(),
        );
        constants.plain_slices = crate::select::plain_slices(slot.longest, view);
        slot.constants.write(0, &[constants]);
        let made_for = Some((options.method, options.pixel_error, self.table_version));
        if slot.ranges_made_for != made_for {
            slot.ranges = tables.ranges(options, &self.costs);
            slot.ranges_made_for = made_for;
        }
        if let Some(buffers) = &mut slot.buffers {
            buffers.ranges.write(0, &slot.ranges);
        }
        let mut cpu = None;
        if options.method == Method::Uninstanced {
            let selection = crate::reference::select::select(
                tables,
                &slot.ranges,
                &slot.agents,
                &constants,
                None,
            );
            slot.write_cpu_lists(&self.cx, frame, &selection)?;
            cpu = Some(selection);
        }
        // SAFETY: this function's contract.
        let mut commands = unsafe { Commands::new(&self.cx, cmd) };
        let c = &mut commands;
        slot.reset_queries(c);
        stamp(c, slot, Stamp::OccludeBegin);
        let drawing = Drawing {
            pipelines: &self.pipelines,
            residents: &self.residents,
            gallery: self.gallery.as_ref(),
            slot,
        };
        count_vertices(c, slot, 2, &mut |c| {
            if occlusion {
                c.label("occlude", |c| {
                    crate::select::record_occluders(c, &drawing);
                    crate::occlude::record(c, &drawing);
                });
            }
        });
        stamp(c, slot, Stamp::SelectBegin);
        if cpu.is_none() {
            c.label("select", |c| crate::select::record(c, &drawing, occlusion));
            if let Some(b) = &slot.buffers {
                copy_lists(c, slot, b, self.keep_lists);
            }
            if let Some(occluders) = slot.occluders.as_ref().filter(|_| occlusion) {
                occluders.record_readback(c);
            }
        }
        stamp(c, slot, Stamp::SelectEnd);
        let draw_calls = c.draw_calls;
        slot.recorded = Some(Recorded {
            options: *options,
            view: *view,
            cpu,
            drawn: false,
            draw_calls,
            occlusion,
            upload_ms: slot.upload_ms,
            record_ms: start.elapsed().as_secs_f64() * 1e3,
            bands: tables.bands.clone(),
            plain_slices: constants.plain_slices,
            coarsest_error: slot.coarsest_error(view.eye(), constants.error_per_metre),
        });
        Ok(())
    }

    /// Records the draws, with viewport and scissor over the view's offset and size. Inside a dynamic rendering scope with the formats
    /// of the description; leaves pipeline, sets, index buffer, viewport and scissor changed.
    ///
    /// # Safety
    /// `cmd` is recording and inside rendering; what `record_select` recorded for this frame runs before it.
    ///
    /// Errors: [`RenderError::Order`] before `record_select`, where characters were added or removed since `set_agents`, or
    /// where a character's upload was never recorded.
    pub unsafe fn record_draw(
        &mut self,
        cmd: vk::CommandBuffer,
        frame: usize,
    ) -> Result<(), RenderError> {
        if !self.uploads.is_empty() {
            return Err(RenderError::Order {
                call: "record_draw",
                reason: "record_uploads comes first: there are characters that were not uploaded",
            });
        }
        let start = Instant::now();
        let slot = self.slots.get(frame).ok_or_else(|| no_slot(frame))?;
        if slot.recorded.is_some() {
            self.check_crowd(slot, "record_draw")?;
        }
        let slot = &mut self.slots[frame];
        let Some(mut recorded) = slot.recorded.take() else {
            return Err(RenderError::Order {
                call: "record_draw",
                reason: "record_select comes first",
            });
        };
        // SAFETY: this function's contract.
        let mut commands = unsafe { Commands::new(&self.cx, cmd) };
        let c = &mut commands;
        let drawing = Drawing {
            pipelines: &self.pipelines,
            residents: &self.residents,
            gallery: self.gallery.as_ref(),
            slot,
        };
        stamp(c, slot, Stamp::DrawBegin);
        c.set_viewport(recorded.view.offset_px, recorded.view.size_px);
        count_vertices(c, slot, 0, &mut |c| {
            c.label("mesh", |c| crate::mesh::record(c, &drawing, &recorded))
        });
        stamp(c, slot, Stamp::MeshEnd);
        if recorded.options.ground {
            c.label("ground", |c| crate::ground::record(c, &drawing));
        }
        stamp(c, slot, Stamp::GroundEnd);
        if recorded.options.ground && recorded.options.shadows {
            c.label("shadow", |c| {
                crate::shadow::record(c, &drawing, recorded.cpu.as_ref(), recorded.bands.len())
            });
        }
        stamp(c, slot, Stamp::ShadowEnd);
        if recorded.options.sky {
            c.label("sky", |c| crate::sky::record(c, &drawing));
        }
        stamp(c, slot, Stamp::SkyEnd);
        // After everything else, because their edges let it through.
        count_vertices(c, slot, 1, &mut |c| {
            if recorded.cpu.is_none() {
                c.label("impostor", |c| {
                    crate::impostor::record(c, &drawing, &recorded)
                });
            }
        });
        stamp(c, slot, Stamp::ImpostorEnd);
        recorded.draw_calls += c.draw_calls;
        recorded.drawn = true;
        recorded.record_ms += start.elapsed().as_secs_f64() * 1e3;
        slot.recorded = Some(recorded);
        Ok(())
    }
}

pub(super) fn stamp(c: &mut Commands, slot: &Slot, stamp: Stamp) {
    if slot.timestamps != vk::QueryPool::null() {
        c.write_timestamp(slot.timestamps, stamp as u32);
    }
}

/// Counts the vertex-shader runs of what `draw` records, where the device can.
fn count_vertices(c: &mut Commands, slot: &Slot, query: u32, draw: &mut dyn FnMut(&mut Commands)) {
    let statistics = slot.statistics != vk::QueryPool::null();
    if statistics {
        c.begin_query(slot.statistics, query);
    }
    draw(c);
    if statistics {
        c.end_query(slot.statistics, query);
    }
}

/// Copies the tally, and the lists where tests want them, to where the host reads.
fn copy_lists(c: &mut Commands, slot: &Slot, b: &SlotBuffers, keep_lists: bool) {
    let bytes = list_bytes(slot.shape);
    let mut offset = bytes[0];
    for (from, size) in [&b.tally, &b.draws, &b.instances, &b.shadows]
        .into_iter()
        .zip(bytes)
        .take(if keep_lists { 4 } else { 1 })
    {
        let size = size.min(from.size_bytes);
        let region = vk::BufferCopy {
            src_offset: 0,
            dst_offset: offset,
            size,
        };
        c.copy_buffer(from, &b.readback, region);
        offset += size;
    }
    c.barrier(Access::TransferWrite, &[Access::HostRead]);
}
