//! After the host's fence: what a frame did.

use ash::vk;

use super::renderer::{Renderer, no_slot};
use super::slot::{Recorded, Slot, Stamp, list_bytes};
use crate::error::RenderError;
use crate::frame::{FrameReport, Representation, StageTime};
use crate::gpu_types::{
    DrawCommand, FLAT_BIN, Instance, QUAD_BIN, SLICE_COUNT, TALLY_BINS, TALLY_LIVE_VERTICES_HIGH,
    TALLY_LIVE_VERTICES_LOW, TALLY_MESHES, TALLY_OCCLUDED, TALLY_VISIBLE,
};
use crate::reference::occlude::Pyramid;
use crate::reference::select::Selection;

impl Renderer {
    /// What the frame in slot `frame` did. Never waits.
    ///
    /// # Safety
    /// The commands recorded for the frame are finished (the host's fence is signalled).
    ///
    /// Errors: [`RenderError::Order`] where nothing was drawn in the slot.
    pub unsafe fn report(&self, frame: usize) -> Result<FrameReport, RenderError> {
        let mut report = FrameReport::default();
        // SAFETY: this function's contract.
        unsafe { self.report_into(frame, &mut report) }.map(|()| report)
    }

    /// As [`Renderer::report`], into the memory of an earlier report: allocates nothing once that is large enough.
    ///
    /// # Safety
    /// As for [`Renderer::report`].
    ///
    /// Errors: as [`Renderer::report`]; `report` is then as before.
    pub unsafe fn report_into(
        &self,
        frame: usize,
        report: &mut FrameReport,
    ) -> Result<(), RenderError> {
        let slot = self.slots.get(frame).ok_or_else(|| no_slot(frame))?;
        let recorded = slot
            .recorded
            .as_ref()
            .filter(|r| r.drawn)
            .ok_or(RenderError::Order {
                call: "report",
                reason: "record_select and record_draw come first",
            })?;
        // Behind the occluders'.
        let first = list_bytes(slot.shape)[0] as usize / 4;
        let tally = |word: usize| tallied(slot, first + word);
        let count = |bin: usize| match &recorded.cpu {
            Some(selection) => selection.draws.get(bin).map_or(0, |d| d.instance_count) as u64,
            None => tally(TALLY_BINS + bin),
        };
        let (visible, occluded, meshes, live_vertices) = match &recorded.cpu {
            Some(s) => (s.visible, s.occluded, s.meshes, s.live_vertices),
            None => (
                tally(TALLY_VISIBLE),
                tally(TALLY_OCCLUDED),
                tally(TALLY_MESHES),
                tally(TALLY_LIVE_VERTICES_LOW) + (tally(TALLY_LIVE_VERTICES_HIGH) << 32),
            ),
        };
        let (mut instances, mut triangles, mut waiting) = (0, 0, 0);
        for (bin, band) in recorded.bands.iter().enumerate() {
            let count = count(bin);
            instances += count;
            triangles += count * (band.index_count / 3) as u64;
            waiting += count * band.waiting_vertex_count as u64;
        }
        let agents = slot.agents.len() as u64;
        replace(&mut report.device, self.device_name());
        replace(&mut report.driver, self.driver());
        report.agents = agents;
        report.visible = visible;
        report.culled = agents - visible - occluded;
        report.occluded = occluded;
        (report.occluders, report.occluder_triangles) = self.occluders(slot, recorded);
        report.draw_calls = recorded.draw_calls;
        report.instances = instances;
        report.triangles = triangles;
        report.live_vertices = live_vertices.saturating_sub(waiting);
        report.vertex_invocations = self.vertex_invocations(slot);
        report.frame_ms = None;
        report.stage_ms.clear();
        for (stage, ms) in [
            ("upload", recorded.upload_ms),
            ("record", recorded.record_ms),
        ] {
            report.stage_ms.push(StageTime { stage, ms });
        }
        self.add_stage_times(slot, &mut report.stage_ms);
        report.representations.clear();
        let representations = self.representations(meshes, &count);
        report.representations.extend(representations);
        Ok(())
    }

    /// The lists of the frame in slot `frame`, sorted by agent; `None` where the renderer does not keep them.
    ///
    /// # Safety
    /// As for [`Renderer::report`].
    pub unsafe fn selection(&self, frame: usize) -> Option<Selection> {
        let slot = self.slots.get(frame)?;
        let recorded = slot.recorded.as_ref()?;
        if let Some(selection) = &recorded.cpu {
            return Some(selection.clone());
        }
        let buffers = slot.buffers.as_ref().filter(|_| self.keep_lists)?;
        let [tally_bytes, draw_bytes, instance_bytes, shadow_bytes] = list_bytes(slot.shape);
        let bytes = 2 * tally_bytes + draw_bytes + instance_bytes + shadow_bytes;
        let all: Vec<u8> = buffers.readback.read(bytes as usize);
        let bins = recorded.bands.len();
        let tally: Vec<u32> =
            bytemuck::pod_collect_to_vec(&all[tally_bytes as usize..][..4 * (TALLY_BINS + bins)]);
        let rest = &all[2 * tally_bytes as usize..];
        let mut draws: Vec<DrawCommand> =
            bytemuck::pod_collect_to_vec(&rest[..(bins + 1) * size_of::<DrawCommand>()]);
        let shadow_count = draws.pop().map_or(0, |d| d.instance_count);
        let rest = &rest[draw_bytes as usize..];
        let instance_count: u64 = draws.iter().map(|d| d.instance_count as u64).sum();
        let mut instances: Vec<Instance> =
            bytemuck::pod_collect_to_vec(&rest[..instance_count as usize * size_of::<Instance>()]);
        for draw in &draws {
            let list = draw.first_instance as usize
                ..draw.first_instance as usize + draw.instance_count as usize;
            if let Some(list) = instances.get_mut(list) {
                list.sort_unstable_by_key(|i| i.agent());
            }
        }
        let rest = &rest[instance_bytes as usize..];
        let mut shadows: Vec<[f32; 4]> =
            bytemuck::pod_collect_to_vec(&rest[..shadow_count as usize * size_of::<[f32; 4]>()]);
        shadows.sort_unstable_by_key(|s| s.map(f32::to_bits));
        Some(Selection {
            instances,
            draws,
            shadows,
            visible: tally[TALLY_VISIBLE] as u64,
            occluded: tally[TALLY_OCCLUDED] as u64,
            meshes: tally[TALLY_MESHES] as u64,
            live_vertices: tally[TALLY_LIVE_VERTICES_LOW] as u64
                + ((tally[TALLY_LIVE_VERTICES_HIGH] as u64) << 32),
        })
    }

    /// The occluders' depth and the pyramid over it, of the frame in slot `frame`; `None` where the renderer does not keep
    /// them, or did not look for hidden agents.
    ///
    /// # Safety
    /// As for [`Renderer::report`].
    pub unsafe fn occlusion(&self, frame: usize) -> Option<(Vec<f32>, Pyramid)> {
        let slot = self.slots.get(frame)?;
        slot.recorded.as_ref().filter(|r| r.occlusion)?;
        slot.occluders.as_ref()?.read()
    }

    /// Occluders and their triangles.
    fn occluders(&self, slot: &Slot, recorded: &Recorded) -> (u64, u64) {
        if !recorded.occlusion {
            return (0, 0);
        }
        let bands = recorded.bands.iter().enumerate();
        let triangles = bands
            .map(|(bin, band)| tallied(slot, TALLY_BINS + bin) * (band.index_count / 3) as u64);
        (tallied(slot, TALLY_MESHES), triangles.sum())
    }

    /// Agents by representation, from the lengths of the lists; one that fades counts for both.
    fn representations(&self, meshes: u64, count: &dyn Fn(usize) -> u64) -> [Representation; 3] {
        let slices = |bin: u32| (bin..bin + SLICE_COUNT).map(|b| count(b as usize)).sum();
        let [flat, quad] = [FLAT_BIN, QUAD_BIN].map(slices);
        [("mesh", meshes), ("flat", flat), ("quad", quad)]
            .map(|(kind, agents)| Representation { kind, agents })
    }

    pub(super) fn vertex_invocations(&self, slot: &Slot) -> Option<u64> {
        if slot.statistics == vk::QueryPool::null() {
            return None;
        }
        // Of the meshes, of the impostors and of the occluders.
        let mut counts = [0u64; 3];
        // SAFETY: the pool is alive and its commands are finished (`report`'s contract); without WAIT this returns at once.
        unsafe {
            self.cx.device.get_query_pool_results(
                slot.statistics,
                0,
                &mut counts,
                vk::QueryResultFlags::TYPE_64,
            )
        }
        .ok()?;
        Some(counts.iter().sum())
    }

    /// Appends the device's stages, where it has timestamps.
    pub(super) fn add_stage_times(&self, slot: &Slot, times: &mut Vec<StageTime>) {
        let Some(period_ns) = self.cx.capabilities.timestamp_ns else {
            return;
        };
        let mut ticks = [0u64; Stamp::Count as usize];
        // SAFETY: as in `vertex_invocations`.
        let read = unsafe {
            self.cx.device.get_query_pool_results(
                slot.timestamps,
                0,
                &mut ticks,
                vk::QueryResultFlags::TYPE_64,
            )
        };
        if read.is_ok() {
            for (stage, from, to) in [
                ("occlude", Stamp::OccludeBegin, Stamp::SelectBegin),
                ("select", Stamp::SelectBegin, Stamp::SelectEnd),
                ("mesh", Stamp::DrawBegin, Stamp::MeshEnd),
                ("ground", Stamp::MeshEnd, Stamp::GroundEnd),
                ("shadow", Stamp::GroundEnd, Stamp::ShadowEnd),
                ("sky", Stamp::ShadowEnd, Stamp::SkyEnd),
                ("impostor", Stamp::SkyEnd, Stamp::ImpostorEnd),
            ] {
                let ticks = ticks[to as usize].saturating_sub(ticks[from as usize]);
                times.push(StageTime {
                    stage,
                    ms: ticks as f64 * period_ns * 1e-6,
                });
            }
        }
    }
}

/// Gives a string other content in the same memory.
fn replace(text: &mut String, by: &str) {
    text.clear();
    text.push_str(by);
}

/// A word of what the frame counted: of the occluders, and behind them of all agents.
fn tallied(slot: &Slot, word: usize) -> u64 {
    let buffers = slot.buffers.as_ref();
    let word: Option<u32> = buffers.and_then(|b| b.readback.value(word));
    word.map_or(0, u64::from)
}
