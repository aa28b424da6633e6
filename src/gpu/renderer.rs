//! The embedding contract: records a crowd into the host's command buffers.

use std::time::Instant;

use ash::vk;
use glam::Vec3;

use super::commands::Commands;
use super::context::Context;
use super::gallery::{self, Gallery};
use super::memory::Buffer;
use super::pipeline::Pipelines;
use super::requirements::OptionalFeatures;
use super::resident::{self, Resident, Upload};
use super::slot::{Shape, Slot, TableBuffers};
use crate::error::RenderError;
use crate::frame::{Agent, CharacterId};
use crate::gpu_types::{AgentState, PACKED_VERTICES, SELECT_GROUP_SIZE};
use crate::prepare::{self, Tables};
use crate::representation::CostModel;

/// The host's objects. The library only borrows them; they outlive the renderer.
#[derive(Clone, Copy)]
pub struct DeviceHandles<'a> {
    /// Vulkan 1.3 instance.
    pub instance: &'a ash::Instance,
    /// What the device was made from.
    pub physical_device: vk::PhysicalDevice,
    /// Made with [`super::requirements::features`] enabled.
    pub device: &'a ash::Device,
    /// Of the queue that will run the recorded commands: graphics and compute.
    pub queue_family: u32,
    /// The instance has `VK_EXT_debug_utils` enabled: objects get names.
    pub debug_utils: bool,
    /// Which of the optional features are enabled, too.
    pub optional: OptionalFeatures,
}

/// What a renderer is made for.
#[derive(Debug, Clone, Copy)]
pub struct RendererDesc<'a> {
    /// Prefix of every object's name.
    pub name: &'a str,
    /// Frames that the host keeps in flight, times the views that it draws in each, 1 to 64: every view has a slot of its own.
    pub frames_in_flight: u32,
    /// Agents that a frame may have; memory is only taken for those it does have.
    pub agent_capacity: u32,
    /// Format of the colour attachment; for sRGB formats the shaders leave the encoding to the device.
    pub color_format: vk::Format,
    /// Format of the depth attachment.
    pub depth_format: vk::Format,
    /// Near is depth 1 and the attachment is cleared to 0; else near is 0 and it is cleared to 1.
    pub reversed_depth: bool,
    /// Copies the instance lists back for `selection`: for tests.
    pub keep_lists: bool,
    /// Shaders read records from storage buffers, as on devices whose texel buffers are small, which CPU drivers take several times as
    /// long for: for tests.
    pub storage_records: bool,
    /// What drawing costs on the device, for [`crate::Method::Hybrid`]; `None` takes [`CostModel::CPU`] or
    /// [`CostModel::GPU`], by its kind.
    pub costs: Option<CostModel>,
}

impl Default for RendererDesc<'_> {
    fn default() -> Self {
        Self {
            name: "throng",
            frames_in_flight: 2,
            agent_capacity: 1 << 20,
            color_format: vk::Format::R8G8B8A8_UNORM,
            depth_format: vk::Format::D32_SFLOAT,
            reversed_depth: true,
            keep_lists: false,
            storage_records: false,
            costs: None,
        }
    }
}

/// Draws crowds. Never submits, presents or waits; records into command buffers of the host's single queue.
///
/// Per frame: `begin_frame`, `record_uploads`, `set_agents`, `record_select`, then `record_draw` inside rendering, and after
/// the host's fence `report`.
pub struct Renderer {
    pub(super) cx: Context,
    pub(super) pipelines: Pipelines,
    pub(super) tables: Tables,
    pub(super) table_buffers: Option<TableBuffers>,
    pub(super) table_version: u64,
    /// By [`CharacterId::slot`]; `None` where a character was removed.
    pub(super) residents: Vec<Option<Resident>>,
    /// Impostors of all characters that were uploaded.
    pub(super) gallery: Option<Gallery>,
    pub(super) uploads: Vec<Upload>,
    pub(super) slots: Vec<Slot>,
    garbage: Vec<Garbage>,
    agent_capacity: u32,
    pub(super) keep_lists: bool,
    pub(super) costs: CostModel,
}

/// What commands of some slots may still use.
struct Garbage {
    /// Bit per slot that has not begun since.
    slots: u64,
    discarded: Discarded,
}

enum Discarded {
    Buffer(Buffer),
    Gallery(Box<Gallery>),
    Resident(Box<Resident>),
}

impl Discarded {
    fn destroy(self, cx: &Context) {
        match self {
            Self::Buffer(buffer) => cx.destroy_buffer(buffer),
            Self::Gallery(gallery) => gallery.destroy(cx),
            Self::Resident(resident) => resident.destroy(cx),
        }
    }
}

/// What the stages' recording reads.
pub(crate) struct Drawing<'a> {
    pub pipelines: &'a Pipelines,
    pub residents: &'a [Option<Resident>],
    pub gallery: Option<&'a Gallery>,
    pub slot: &'a Slot,
}

impl Renderer {
    /// Makes pipelines and per-frame objects; no memory for agents yet.
    ///
    /// # Safety
    /// The handles are alive, belong together, and stay alive until [`Renderer::destroy`] returned. The required features
    /// are enabled on the device. All recorded commands run on one queue of `queue_family`.
    ///
    /// Errors: [`RenderError::MissingFeature`], [`RenderError::BadOption`], [`RenderError::Vulkan`], [`RenderError::Memory`].
    pub unsafe fn new(handles: &DeviceHandles, desc: &RendererDesc) -> Result<Self, RenderError> {
        if !(1..=64).contains(&desc.frames_in_flight) {
            return Err(RenderError::BadOption {
                option: "frames_in_flight",
                reason: format!("{} is not in 1 to 64", desc.frames_in_flight),
            });
        }
        let cx = Context::new(handles, desc)?;
        let pipelines = Pipelines::new(&cx, desc)?;
        let costs = desc.costs.unwrap_or(match cx.capabilities.software {
            true => CostModel::CPU,
            false => CostModel::GPU,
        });
        let mut renderer = Self {
            cx,
            pipelines,
            tables: Tables::default(),
            table_buffers: None,
            table_version: 0,
            residents: Vec::new(),
            gallery: None,
            uploads: Vec::new(),
            slots: Vec::new(),
            garbage: Vec::new(),
            agent_capacity: desc.agent_capacity,
            keep_lists: desc.keep_lists,
            costs,
        };
        for index in 0..desc.frames_in_flight as usize {
            match Slot::new(&renderer.cx, &renderer.pipelines, index) {
                Ok(slot) => renderer.slots.push(slot),
                Err(e) => {
                    // SAFETY: nothing was recorded yet.
                    unsafe { renderer.destroy() };
                    return Err(e);
                }
            }
        }
        Ok(renderer)
    }

    /// Name of the device.
    pub fn device_name(&self) -> &str {
        &self.cx.capabilities.device
    }

    /// Name and version of the driver.
    pub fn driver(&self) -> &str {
        &self.cx.capabilities.driver
    }

    /// What drawing is taken to cost, for [`crate::Method::Hybrid`].
    pub fn costs(&self) -> CostModel {
        self.costs
    }

    /// The characters' tables, for the CPU twins.
    pub fn tables(&self) -> &Tables {
        &self.tables
    }

    /// Validates a character and makes its objects; the next [`Renderer::record_uploads`] fills them. Between frames: a
    /// crowd that [`Renderer::set_agents`] took before is refused after it.
    ///
    /// Errors: [`RenderError::BadCharacter`], [`RenderError::Limit`], [`RenderError::Vulkan`], [`RenderError::Memory`];
    /// the renderer is then as before.
    pub fn add_character(
        &mut self,
        baked: &throng_bake::baked::Baked,
    ) -> Result<CharacterId, RenderError> {
        prepare::validate(baked)?;
        let gallery = &mut self.tables.gallery;
        if let Some(impostors) = &baked.impostors {
            if gallery.atlas_count == 0 {
                let has_blocks = impostors.atlas.blocks.is_some();
                gallery.blocks = has_blocks && self.cx.optional.block_textures;
            }
            gallery::check(
                &self.cx,
                &baked.name,
                gallery,
                impostors,
                baked.palette.len(),
            )?;
        }
        let (square, blocks) = (gallery.next_square(), gallery.blocks);
        let id = self.tables.next_id().ok_or_else(|| RenderError::Limit {
            object: format!("character '{}'", baked.name),
            needed: self.residents.len() as u64 + 1,
            limit: self.residents.len() as u64,
            unit: "characters",
            hint: "remove others before, or make another renderer",
        })?;
        let (resident, upload) = resident::make(
            &self.cx,
            &mut self.pipelines,
            baked,
            id.slot(),
            self.tables.next_bin_and_submesh(baked),
            (square, blocks),
        )?;
        if id.slot() == self.residents.len() {
            self.residents.push(None);
        }
        self.residents[id.slot()] = Some(resident);
        self.uploads.push(upload);
        self.tables.insert(baked, id);
        self.table_version += 1;
        Ok(id)
    }

    /// Removes a character. Its id means nobody from now on, and agents that still have it are refused; all others keep theirs.
    /// Between frames, as [`Renderer::add_character`].
    ///
    /// Its objects are destroyed once every slot has begun again, because commands of frames in flight may use them. Its
    /// place in the tables is free for the next character; its pictures' place in the gallery as well, which is made anew, as
    /// large as is needed then, when the next character with impostors is uploaded, and is destroyed with the last of them.
    ///
    /// Errors: [`RenderError::BadOption`] where there is no such character, or no longer.
    pub fn remove_character(&mut self, character: CharacterId) -> Result<(), RenderError> {
        let Some(slot) = self.tables.remove(character) else {
            return Err(RenderError::BadOption {
                option: "character",
                reason: format!("there is no character {}", character.0),
            });
        };
        self.table_version += 1;
        if let Some(at) = self.uploads.iter().position(|u| u.character() == slot) {
            // Never recorded, so no command uses it.
            self.uploads.remove(at).destroy(&self.cx);
        }
        if let Some(resident) = self.residents[slot].take() {
            self.discard(Discarded::Resident(Box::new(resident)));
        }
        if self.tables.gallery.atlas_count == 0
            && let Some(gallery) = self.gallery.take()
        {
            self.discard(Discarded::Gallery(Box::new(gallery)));
        }
        Ok(())
    }

    /// Starts a frame in slot `frame`, of which the library may now reuse everything.
    ///
    /// # Safety
    /// All commands recorded since the last `begin_frame` of this slot are finished.
    ///
    /// Errors: [`RenderError::BadOption`] where there is no such slot.
    pub unsafe fn begin_frame(&mut self, frame: usize) -> Result<(), RenderError> {
        let slot = self.slot_mut(frame)?;
        slot.recorded = None;
        slot.begun = true;
        slot.upload_ms = 0.0;
        let mut i = 0;
        while i < self.garbage.len() {
            self.garbage[i].slots &= !(1 << frame);
            if self.garbage[i].slots == 0 {
                let garbage = self.garbage.swap_remove(i);
                garbage.discarded.destroy(&self.cx);
            } else {
                i += 1;
            }
        }
        Ok(())
    }

    /// Records the copies of characters added since the last call; nothing where there are none. Outside rendering.
    ///
    /// # Safety
    /// `cmd` is recording, is outside rendering, belongs to the frame that `begin_frame` started last, and will be
    /// submitted: the copies are recorded once only.
    ///
    /// Errors: [`RenderError::Order`] before the first `begin_frame`; [`RenderError::Vulkan`] and [`RenderError::Memory`], after
    /// which the copies are still to be recorded.
    pub unsafe fn record_uploads(&mut self, cmd: vk::CommandBuffer) -> Result<(), RenderError> {
        if self.uploads.is_empty() {
            return Ok(());
        }
        if !self.slots.iter().any(|s| s.begun) {
            return Err(RenderError::Order {
                call: "record_uploads",
                reason: "begin_frame comes first",
            });
        }
        let pictures: Vec<_> = self.uploads.iter().filter_map(|u| u.atlas()).collect();
        let mut gallery = match pictures.is_empty() {
            true => None,
            false => Some(Gallery::new(
                &self.cx,
                &self.pipelines,
                &self.tables.gallery,
            )?),
        };
        // SAFETY: this function's contract.
        let mut commands = unsafe { Commands::new(&self.cx, cmd) };
        let c = &mut commands;
        if let Some(gallery) = &gallery {
            c.label("upload impostors", |c| {
                gallery.record(c, self.gallery.as_ref(), &pictures)
            });
        }
        let (uploads, residents) = (std::mem::take(&mut self.uploads), &self.residents);
        let staging = c.label("upload", |c| {
            uploads
                .into_iter()
                .filter_map(|u| {
                    let resident = residents[u.character()].as_ref()?;
                    Some(u.record(c, resident))
                })
                .collect::<Vec<_>>()
        });
        for buffer in staging {
            self.discard(Discarded::Buffer(buffer));
        }
        if let Some(staging) = gallery.as_mut().and_then(|g| g.take_staging()) {
            self.discard(Discarded::Buffer(staging));
        }
        if let Some(new) = gallery
            && let Some(old) = self.gallery.replace(new)
        {
            self.discard(Discarded::Gallery(Box::new(old)));
        }
        Ok(())
    }

    /// Hands in the crowd of a frame.
    ///
    /// Errors: [`RenderError::BadAgent`], [`RenderError::Limit`], [`RenderError::Memory`], and [`RenderError::Order`] before
    /// `begin_frame`.
    pub fn set_agents(&mut self, frame: usize, agents: &[Agent]) -> Result<(), RenderError> {
        let start = Instant::now();
        if !self.slot_mut(frame)?.begun {
            return Err(RenderError::Order {
                call: "set_agents",
                reason: "begin_frame comes first",
            });
        }
        let dispatchable = self
            .cx
            .capabilities
            .workgroups
            .saturating_mul(SELECT_GROUP_SIZE);
        let capacity = self.agent_capacity.min(dispatchable);
        if agents.len() > capacity as usize {
            return Err(RenderError::Limit {
                object: "crowd".into(),
                needed: agents.len() as u64,
                limit: capacity as u64,
                unit: "agents",
                hint: if capacity == dispatchable {
                    "the device takes no more at once: split the crowd"
                } else {
                    "raise RendererDesc::agent_capacity, or split the crowd"
                },
            });
        }
        self.update_tables()?;
        let slot = &mut self.slots[frame];
        slot.agent_counts.clear();
        slot.agent_counts.resize(self.residents.len(), 0);
        slot.agents.clear();
        (slot.highest, slot.tallest, slot.longest) = (f32::MIN, 0.0, 0.0);
        (slot.box_min, slot.box_max) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        slot.least_scale = f32::INFINITY;
        slot.agents.reserve(agents.len());
        for (index, agent) in agents.iter().enumerate() {
            let state = agent_state(&self.tables, index, agent)?;
            slot.agent_counts[state.character as usize] += 1;
            let character = state.character as usize;
            let top = state.scale * self.tables.tops[character];
            let representations = &self.tables.representations[character];
            slot.highest = slot.highest.max(state.position[1] + top);
            slot.box_min = slot.box_min.min(state.position.into());
            slot.box_max = slot.box_max.max(state.position.into());
            slot.least_scale = slot.least_scale.min(state.scale);
            slot.tallest = slot.tallest.max(state.scale * representations.height);
            slot.longest = slot.longest.max(state.scale * representations.length);
            slot.agents.push(state);
        }
        let entries: u64 = slot
            .agent_counts
            .iter()
            .zip(0..)
            .map(|(&count, c)| count as u64 * self.tables.entries_of(c) as u64)
            .sum();
        let shape = Shape {
            agents: agents.len().max(1) as u32,
            entries: entries.clamp(1, u32::MAX as u64) as u32,
            entry_stride: self.tables.entry_stride(),
            bins: self.tables.bands.len().max(1) as u32,
            characters: self.tables.characters.len().max(1) as u32,
        };
        // Vertex numbers say whose they are, where many agents share an instance.
        let entries_max = u64::from(i32::MAX.unsigned_abs() / PACKED_VERTICES);
        if entries > entries_max {
            return Err(RenderError::Limit {
                object: "crowd".into(),
                needed: entries,
                limit: entries_max,
                unit: "submeshes of all agents",
                hint: "split the crowd",
            });
        }
        slot.reserve(&self.cx, frame, shape, self.keep_lists)?;
        if let Some(buffers) = &mut slot.buffers {
            buffers.agents.write(0, &slot.agents);
        }
        slot.crowd_version = self.table_version;
        slot.upload_ms = start.elapsed().as_secs_f64() * 1e3;
        Ok(())
    }

    /// Errors: [`RenderError::Order`] where characters came or went since the frame's crowd was handed in.
    pub(super) fn check_crowd(&self, slot: &Slot, call: &'static str) -> Result<(), RenderError> {
        match slot.crowd_version == self.table_version {
            true => Ok(()),
            false => Err(RenderError::Order {
                call,
                reason: "characters were added or removed since set_agents: hand in the crowd again",
            }),
        }
    }

    /// Destroys every object.
    ///
    /// # Safety
    /// All commands that this renderer recorded are finished.
    pub unsafe fn destroy(mut self) {
        let cx = &self.cx;
        for slot in self.slots.drain(..) {
            slot.destroy(cx);
        }
        for resident in self.residents.drain(..).flatten() {
            resident.destroy(cx);
        }
        for upload in self.uploads.drain(..) {
            upload.destroy(cx);
        }
        for garbage in self.garbage.drain(..) {
            garbage.discarded.destroy(cx);
        }
        if let Some(gallery) = self.gallery.take() {
            gallery.destroy(cx);
        }
        if let Some(tables) = self.table_buffers.take() {
            tables
                .into_buffers()
                .into_iter()
                .for_each(|b| cx.destroy_buffer(b));
        }
        self.pipelines.destroy(cx);
        // The allocator frees its blocks here, after everything in them.
        drop(
            cx.allocator
                .lock()
                .unwrap_or_else(|e| e.into_inner())
                .take(),
        );
    }

    /// Keeps something until every slot has begun again.
    fn discard(&mut self, discarded: Discarded) {
        let slots = u64::MAX >> (64 - self.slots.len());
        self.garbage.push(Garbage { slots, discarded });
    }

    /// Makes new table buffers where characters were added.
    fn update_tables(&mut self) -> Result<(), RenderError> {
        let current = self
            .table_buffers
            .as_ref()
            .is_some_and(|t| t.version == self.table_version);
        if !current {
            let new = TableBuffers::new(&self.cx, &self.tables, self.table_version)?;
            if let Some(old) = self.table_buffers.replace(new) {
                for buffer in old.into_buffers() {
                    self.discard(Discarded::Buffer(buffer));
                }
            }
        }
        Ok(())
    }

    fn slot_mut(&mut self, frame: usize) -> Result<&mut Slot, RenderError> {
        self.slots.get_mut(frame).ok_or_else(|| no_slot(frame))
    }
}

pub(super) fn no_slot(frame: usize) -> RenderError {
    RenderError::BadOption {
        option: "frame",
        reason: format!("there is no frame in flight {frame}"),
    }
}

/// The GPU's form of an agent, checked.
fn agent_state(tables: &Tables, index: usize, agent: &Agent) -> Result<AgentState, RenderError> {
    let bad = |reason: String| Err(RenderError::BadAgent { index, reason });
    let Some(place) = tables.slot_of(agent.character) else {
        return bad(format!("there is no character {}", agent.character.0));
    };
    let clip_count = tables.clip_counts[place];
    if agent.clips[0] >= clip_count || (agent.blend > 0.0 && agent.clips[1] >= clip_count) {
        return bad(format!(
            "its clips are {:?} and its character has {clip_count}",
            agent.clips
        ));
    }
    let finite = agent.position.is_finite()
        && agent.heading.is_finite()
        && agent.scale.is_finite()
        && agent.phases.iter().all(|p| p.is_finite())
        && agent.blend.is_finite();
    if !finite || agent.scale <= 0.0 {
        return bad("a number is not finite, or its scale is not greater than 0".into());
    }
    Ok(AgentState::from(agent))
}
