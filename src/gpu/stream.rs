//! Frames that overlap: the host records the next one while the device still works on those before.

use std::time::Instant;

use ash::vk;

use super::headless::{Headless, Target, check_size, dropped};
use crate::error::RenderError;
use crate::frame::{Agent, FrameOptions, View};

/// What one frame in flight needs of its host.
struct Flight {
    cmd: vk::CommandBuffer,
    fence: vk::Fence,
    target: Target,
    pending: bool,
}

impl Headless {
    /// Draws frames, each into a target that is thrown away, `in_flight` of them at once. Returns for every frame the
    /// milliseconds from the end of the one before it, or from the start, to its own end.
    ///
    /// Errors: [`RenderError::BadOption`] where `in_flight` is 0 or more than [`super::HeadlessDesc::frames_in_flight`];
    /// those of [`Headless::render`]. Nothing is pending then.
    pub fn stream(
        &mut self,
        frames: &[(Vec<Agent>, View)],
        options: &FrameOptions,
        in_flight: usize,
    ) -> Result<Vec<f64>, RenderError> {
        let slots = self.renderer.as_ref().ok_or_else(dropped)?.slots.len();
        if !(1..=slots).contains(&in_flight) {
            return Err(RenderError::BadOption {
                option: "in_flight",
                reason: format!("{in_flight} is not in 1 to {slots}"),
            });
        }
        let target = self.target.as_ref().ok_or_else(dropped)?;
        for (_, view) in frames {
            check_size(view, target)?;
        }
        let size_px = target.size_px;
        let mut flights = Vec::new();
        let result = self
            .make_flights(in_flight, size_px, &mut flights)
            .and_then(|()| {
                let mut ends = Vec::with_capacity(frames.len());
                let start = Instant::now();
                let drawn = self.fly(&mut flights, frames, options, &mut ends);
                // Whatever happened, nothing stays pending. The oldest comes first.
                let oldest = frames.len() % flights.len();
                let (newer, older) = flights.split_at_mut(oldest);
                let mut landed = Ok(());
                for flight in older.iter_mut().chain(newer) {
                    landed = landed.and(self.land(flight, &mut ends));
                }
                drawn.and(landed)?;
                let mut before = start;
                Ok(ends
                    .into_iter()
                    .map(|end| {
                        let ms = (end - before).as_secs_f64() * 1e3;
                        before = end;
                        ms
                    })
                    .collect())
            });
        if let Some(renderer) = &self.renderer {
            let device = self.core.device();
            for flight in flights {
                // SAFETY: it was waited for; each stands here once.
                unsafe {
                    device.destroy_fence(flight.fence, None);
                    device.free_command_buffers(self.core.pool, &[flight.cmd]);
                }
                flight.target.destroy(renderer);
            }
        }
        result
    }

    fn make_flights(
        &self,
        count: usize,
        size_px: [u32; 2],
        flights: &mut Vec<Flight>,
    ) -> Result<(), RenderError> {
        let renderer = self.renderer.as_ref().ok_or_else(dropped)?;
        for _ in 0..count {
            let target = Target::new(renderer, size_px)?;
            match self.core.new_submission() {
                Ok((cmd, fence)) => flights.push(Flight {
                    cmd,
                    fence,
                    target,
                    pending: false,
                }),
                Err(e) => {
                    target.destroy(renderer);
                    return Err(e);
                }
            }
        }
        Ok(())
    }

    /// Records and submits every frame as soon as its flight is free.
    fn fly(
        &mut self,
        flights: &mut [Flight],
        frames: &[(Vec<Agent>, View)],
        options: &FrameOptions,
        ends: &mut Vec<Instant>,
    ) -> Result<(), RenderError> {
        for (i, (agents, view)) in frames.iter().enumerate() {
            let slot = i % flights.len();
            let flight = &mut flights[slot];
            self.land(flight, ends)?;
            let renderer = self.renderer.as_mut().ok_or_else(dropped)?;
            // SAFETY: the flight's commands were waited for, and those of the others are in other slots; the command buffer
            // is recorded in the order that the renderer's contract asks for.
            unsafe {
                renderer.begin_frame(slot)?;
                renderer.set_agents(slot, agents)?;
                self.core.begin_on(flight.cmd)?;
                let (target, device) = (&flight.target, self.core.device());
                let recorded = target.record(flight.cmd, device, renderer, slot, (view, options));
                self.core.submit(flight.cmd, flight.fence)?;
                flight.pending = true;
                recorded?;
            }
        }
        Ok(())
    }

    /// Waits for a flight's frame, if it has one.
    fn land(&self, flight: &mut Flight, ends: &mut Vec<Instant>) -> Result<(), RenderError> {
        if std::mem::take(&mut flight.pending) {
            self.core.wait(flight.fence)?;
            ends.push(Instant::now());
        }
        Ok(())
    }
}
