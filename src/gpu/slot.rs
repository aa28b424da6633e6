//! What a frame in flight owns: its buffers, descriptor sets and queries.

use std::sync::Arc;

use ash::vk;
use glam::Vec3;
use gpu_allocator::MemoryLocation;

use super::bindings::{self, Kind};
use super::commands::Commands;
use super::context::Context;
use super::descriptors::{allocate_set, descriptor_pool, write_buffers};
use super::memory::Buffer;
use super::occluders::Occluders;
use super::pipeline::Pipelines;
use super::record_buffers::{self, FEWER_AGENTS, UINT, UINT2, UINT4, check_range, create_records};
use crate::error::RenderError;
use crate::frame::{FrameOptions, Method, View};
use crate::gpu_types::{
    AgentState, BandInfo, DrawCommand, FrameConstants, IMPOSTOR_DRAWS, Instance, MAX_RANGES,
    PACKED_COMMANDS, RangeInfo, SELECT_GROUP_SIZE, SELECT_SHARDS, SLICE_COUNT, Selected,
    TALLY_ALIGNMENT, TALLY_BINS,
};
use crate::pool::Pool;
use crate::prepare::Tables;
use crate::reference::select::Selection;
use crate::select::shard_groups;

/// Timestamps of a frame, in order.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Stamp {
    OccludeBegin,
    SelectBegin,
    SelectEnd,
    DrawBegin,
    MeshEnd,
    GroundEnd,
    ShadowEnd,
    SkyEnd,
    ImpostorEnd,
    Count,
}

/// The most timestamps between the draws of meshes.
const HAND_OVERS: u32 = 32;

/// Sizes that a slot's buffers are made for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Shape {
    pub agents: u32,
    /// The most entries that the lists can have.
    pub entries: u32,
    pub entry_stride: u32,
    pub bins: u32,
    pub characters: u32,
}

impl Shape {
    /// This shape's buffers hold everything of `other`, with the same stride.
    fn holds(&self, other: &Shape) -> bool {
        self.agents >= other.agents
            && self.entries >= other.entries
            && self.bins >= other.bins
            && self.characters >= other.characters
            && self.entry_stride == other.entry_stride
    }
}

/// Buffers whose sizes go by the crowd.
pub(crate) struct SlotBuffers {
    pub agents: Buffer,
    pub ranges: Buffer,
    pub tally: Buffer,
    pub selected: Buffer,
    pub draws: Buffer,
    pub instances: Buffer,
    /// Contact shadows.
    pub shadows: Buffer,
    /// The occluders' counts and the frame's, and behind them, for tests, draws, instances and shadows.
    pub readback: Buffer,
}

/// What was recorded into the slot's command buffer.
pub(crate) struct Recorded {
    pub options: FrameOptions,
    pub view: View,
    /// Set where the CPU selected.
    pub cpu: Option<Selection>,
    pub drawn: bool,
    pub draw_calls: u64,
    /// Agents that others hide were looked for.
    pub occlusion: bool,
    pub upload_ms: f64,
    /// What recording took on the CPU.
    pub record_ms: f64,
    /// Windows of the lists at the time of recording.
    pub bands: Arc<Pool<BandInfo>>,
    /// `FrameConstants::plain_slices`.
    pub plain_slices: u32,
    /// [`Slot::coarsest_error`] of the crowd: where smallest meshes have draws of their own.
    pub coarsest_error: f32,
}

/// Lists that the CPU made, as [`SlotBuffers`] has those of the device.
pub(crate) struct CpuLists {
    pub instances: Buffer,
    pub shadows: Buffer,
}

pub(crate) struct Slot {
    pub shape: Shape,
    pub buffers: Option<SlotBuffers>,
    /// Lists that the CPU made for [`crate::Method::Uninstanced`].
    pub cpu_lists: Option<CpuLists>,
    pub constants: Buffer,
    /// Of the last frame that looked for hidden agents.
    pub occluders: Option<Occluders>,
    /// In the pyramid's place before there is one.
    no_pyramid: Buffer,
    pub agents: Vec<AgentState>,
    /// A box that holds all agents' places.
    pub box_min: Vec3,
    pub box_max: Vec3,
    pub least_scale: f32,
    /// Height of whoever reaches highest, and of the tallest, and length of the longest, metres.
    pub highest: f32,
    pub tallest: f32,
    pub longest: f32,
    /// Agents of each character.
    pub agent_counts: Vec<u32>,
    /// Of the frame, `[character_count][MAX_RANGES]`.
    pub ranges: Vec<RangeInfo>,
    /// Method, pixel error and version of the tables that they follow from.
    pub ranges_made_for: Option<(Method, f32, u64)>,
    pub select_set: vk::DescriptorSet,
    pub draw_set: vk::DescriptorSet,
    pub cpu_draw_set: vk::DescriptorSet,
    pub timestamps: vk::QueryPool,
    /// Timestamps behind those of [`Stamp`], for [`Slot::hand_over`].
    hand_overs: u32,
    pub statistics: vk::QueryPool,
    pub recorded: Option<Recorded>,
    pub begun: bool,
    pub upload_ms: f64,
    /// Version of the tables that the crowd was checked with.
    pub crowd_version: u64,
    /// Version of the tables that the sets name.
    pub table_version: u64,
    /// The sets name the buffers that there are.
    sets_current: bool,
    pool: vk::DescriptorPool,
}

/// The select stage's tables on the device, shared by all slots.
pub(crate) struct TableBuffers {
    pub version: u64,
    buffers: [Buffer; 5],
}

impl TableBuffers {
    pub fn new(cx: &Context, tables: &Tables, version: u64) -> Result<Self, RenderError> {
        let mut made: Vec<Buffer> = Vec::new();
        use vk::BufferUsageFlags as U;
        let mut table = |name: &str, usage, texel: vk::Format, bytes: &[u8]| {
            let size = bytes.len() as u64;
            let mut buffer = create_records(
                cx,
                name,
                size,
                usage,
                MemoryLocation::CpuToGpu,
                texel,
                "add fewer characters, or remove some",
            )?;
            buffer.write(0, bytes);
            made.push(buffer);
            Ok(())
        };
        use bytemuck::cast_slice;
        let (none, scanned) = (U::empty(), U::STORAGE_BUFFER);
        let result = table("characters", none, UINT4, cast_slice(&tables.characters))
            .and_then(|()| table("clips", none, UINT4, cast_slice(&tables.clips)))
            .and_then(|()| table("submeshes", none, UINT4, cast_slice(&tables.submeshes)))
            .and_then(|()| table("bands", scanned, UINT4, cast_slice(&tables.bands)))
            .and_then(|()| table("levels", none, UINT2, cast_slice(&tables.levels)));
        match (result, made.try_into()) {
            (Ok(()), Ok(buffers)) => Ok(Self { version, buffers }),
            (Err(e), Err(made)) => {
                made.into_iter().for_each(|b| cx.destroy_buffer(b));
                Err(e)
            }
            _ => unreachable!("all five tables were made, or one failed"),
        }
    }

    pub fn into_buffers(self) -> [Buffer; 5] {
        self.buffers
    }
}

impl Slot {
    /// The character has agents, and some size at which a bin of impostors, or for `BIN_NONE` the mesh, draws them.
    pub fn may_draw(&self, character: usize, bin: u32) -> bool {
        let ranges = self.ranges.chunks_exact(MAX_RANGES as usize).nth(character);
        self.agent_counts.get(character).is_some_and(|&n| n > 0)
            && ranges.is_some_and(|r| r.iter().any(|r| r.bin == bin))
    }

    pub fn new(cx: &Context, pipelines: &Pipelines, index: usize) -> Result<Self, RenderError> {
        let name = |what: &str| format!("{what} of frame {index}");
        let constants = cx.create_buffer(
            &name("constants"),
            size_of::<FrameConstants>() as u64,
            vk::BufferUsageFlags::UNIFORM_BUFFER,
            MemoryLocation::CpuToGpu,
        )?;
        let no_pyramid = match Occluders::pyramid_buffer(cx, index, 0, false) {
            Ok(buffer) => buffer,
            Err(e) => {
                cx.destroy_buffer(constants);
                return Err(e);
            }
        };
        let mut slot = Self {
            shape: Shape::default(),
            buffers: None,
            cpu_lists: None,
            constants,
            occluders: None,
            no_pyramid,
            agents: Vec::new(),
            box_min: Vec3::INFINITY,
            box_max: Vec3::NEG_INFINITY,
            least_scale: f32::INFINITY,
            highest: f32::MIN,
            tallest: 0.0,
            longest: 0.0,
            agent_counts: Vec::new(),
            ranges: Vec::new(),
            ranges_made_for: None,
            select_set: vk::DescriptorSet::null(),
            draw_set: vk::DescriptorSet::null(),
            cpu_draw_set: vk::DescriptorSet::null(),
            timestamps: vk::QueryPool::null(),
            hand_overs: 0,
            statistics: vk::QueryPool::null(),
            recorded: None,
            begun: false,
            upload_ms: 0.0,
            crowd_version: 0,
            table_version: 0,
            sets_current: false,
            pool: vk::DescriptorPool::null(),
        };
        match slot.fill(cx, pipelines, &name) {
            Ok(()) => Ok(slot),
            Err(e) => {
                slot.destroy(cx);
                Err(e)
            }
        }
    }

    fn fill(
        &mut self,
        cx: &Context,
        pipelines: &Pipelines,
        name: &dyn Fn(&str) -> String,
    ) -> Result<(), RenderError> {
        let bindings = bindings::SELECT.len() + 2 * bindings::DRAW.len();
        self.pool = descriptor_pool(cx, &name("sets"), 3, bindings as u32)?;
        self.select_set = allocate_set(cx, &name("select set"), self.pool, pipelines.select_set)?;
        self.draw_set = allocate_set(cx, &name("draw set"), self.pool, pipelines.draw_set)?;
        self.cpu_draw_set = allocate_set(
            cx,
            &name("uninstanced draw set"),
            self.pool,
            pipelines.draw_set,
        )?;
        let pool = |what: &str, info: vk::QueryPoolCreateInfo| {
            // SAFETY: the context's device is alive.
            let pool = unsafe { cx.device.create_query_pool(&info, None) }.map_err(
                RenderError::vulkan(cx.full_name(&name(what)), "vkCreateQueryPool"),
            )?;
            cx.set_name(pool, &name(what));
            Ok::<_, RenderError>(pool)
        };
        if cx.capabilities.timestamp_ns.is_some() {
            self.hand_overs = match cx.capabilities.software {
                true => HAND_OVERS,
                false => 0,
            };
            self.timestamps = pool(
                "timestamps",
                vk::QueryPoolCreateInfo::default()
                    .query_type(vk::QueryType::TIMESTAMP)
                    .query_count(Stamp::Count as u32 + self.hand_overs),
            )?;
        }
        if cx.optional.pipeline_statistics {
            self.statistics = pool(
                "statistics",
                vk::QueryPoolCreateInfo::default()
                    .query_type(vk::QueryType::PIPELINE_STATISTICS)
                    .pipeline_statistics(vk::QueryPipelineStatisticFlags::VERTEX_SHADER_INVOCATIONS)
                    .query_count(3),
            )?;
        }
        Ok(())
    }

    /// Resets all queries, which has to come before a frame. Outside rendering.
    pub fn reset_queries(&self, c: &mut Commands) {
        for (pool, count) in [
            (self.timestamps, Stamp::Count as u32 + self.hand_overs),
            (self.statistics, 3),
        ] {
            if pool != vk::QueryPool::null() {
                c.reset_queries(pool, count);
            }
        }
    }

    /// Lets a CPU driver work on what was drawn so far: lavapipe hands it to its rasteriser threads at a timestamp, and
    /// shades the vertices of the next draw meanwhile. `done` counts the calls of a frame.
    pub fn hand_over(&self, c: &mut Commands, done: &mut u32) {
        if *done < self.hand_overs {
            c.write_timestamp(self.timestamps, Stamp::Count as u32 + *done);
            *done += 1;
        }
    }

    /// About the greatest LOD error of an agent that is nowhere hidden, bind-space units, where a metre of distance allows
    /// `error_per_metre`.
    pub fn coarsest_error(&self, eye: Vec3, error_per_metre: f32) -> f32 {
        let farthest = (self.box_min - eye).abs().max((self.box_max - eye).abs());
        match self.agents.is_empty() {
            true => 0.0,
            false => farthest.length() * error_per_metre / self.least_scale,
        }
    }

    /// Makes the buffers hold `shape`. No pending command uses the slot.
    pub fn reserve(
        &mut self,
        cx: &Context,
        index: usize,
        shape: Shape,
        keep_lists: bool,
    ) -> Result<(), RenderError> {
        let fits = self.buffers.is_some() && self.shape.holds(&shape);
        if !fits {
            // Growing by half at least keeps a slowly growing crowd from making buffers every frame.
            let grown = |needed: u32, had: u32| {
                let half_more = had.saturating_add(had / 2).min(needed.saturating_mul(2));
                if needed > had && had > 0 {
                    needed.max(half_more)
                } else {
                    needed.max(had)
                }
            };
            let shape = Shape {
                agents: grown(shape.agents, self.shape.agents),
                entries: grown(shape.entries, self.shape.entries),
                bins: shape.bins.max(self.shape.bins),
                characters: shape.characters.max(self.shape.characters),
                ..shape
            };
            let buffers = SlotBuffers::new(cx, index, shape, keep_lists)?;
            if let Some(old) = self.buffers.replace(buffers) {
                old.destroy(cx);
            }
            self.shape = shape;
            self.sets_current = false;
        }
        Ok(())
    }

    /// Makes occluders for pictures of `size_px`. No pending command uses the slot.
    pub fn reserve_occluders(
        &mut self,
        cx: &Context,
        pipelines: &Pipelines,
        index: usize,
        size_px: [u32; 2],
        keep: bool,
    ) -> Result<(), RenderError> {
        if self.occluders.as_ref().is_none_or(|o| o.size_px != size_px) {
            let new = Occluders::new(cx, pipelines, index, size_px, &self.constants, keep)?;
            if let Some(old) = self.occluders.replace(new) {
                old.destroy(cx);
            }
            self.sets_current = false;
        }
        Ok(())
    }

    /// Makes the sets name the buffers that there are and the tables. No pending command uses the slot.
    pub fn update_sets(&mut self, cx: &Context, tables: &TableBuffers) {
        if let Some(b) = &self.buffers
            && (!self.sets_current || self.table_version != tables.version)
        {
            let pyramid = match &self.occluders {
                Some(occluders) => &occluders.pyramid,
                None => &self.no_pyramid,
            };
            let [characters, clips, submeshes, bands, levels] = &tables.buffers;
            let select = [
                &self.constants,
                &b.agents,
                characters,
                clips,
                submeshes,
                bands,
                levels,
                &b.tally,
                &b.selected,
                &b.draws,
                &b.instances,
                &b.selected,
                &b.tally,
                &b.ranges,
                pyramid,
                &b.shadows,
            ];
            let kinds = match record_buffers::kind(cx) {
                Kind::Texels => bindings::SELECT,
                _ => bindings::SELECT_STORAGE,
            };
            let select: Vec<_> = kinds.iter().copied().zip(select).collect();
            write_buffers(cx, self.select_set, &select);
            write_draw_set(cx, self.draw_set, &self.constants, &b.instances);
            self.table_version = tables.version;
            self.sets_current = true;
        }
    }

    /// Puts the CPU's lists where shaders read them.
    pub fn write_cpu_lists(
        &mut self,
        cx: &Context,
        index: usize,
        selection: &Selection,
    ) -> Result<(), RenderError> {
        let fits = |lists: &CpuLists| {
            lists.instances.size_bytes >= size_of_val(&selection.instances[..]) as u64
                && lists.shadows.size_bytes >= size_of_val(&selection.shadows[..]) as u64
        };
        if !self.cpu_lists.as_ref().is_some_and(fits) {
            let lists = CpuLists::new(cx, index, selection)?;
            write_draw_set(cx, self.cpu_draw_set, &self.constants, &lists.instances);
            if let Some(old) = self.cpu_lists.replace(lists) {
                old.destroy(cx);
            }
        }
        if let Some(lists) = &mut self.cpu_lists {
            lists.instances.write(0, &selection.instances);
            lists.shadows.write(0, &selection.shadows);
        }
        Ok(())
    }

    /// Destroys everything; no pending command may use any of it.
    pub fn destroy(self, cx: &Context) {
        // SAFETY: the caller's promise; null is ignored; consumed, so once.
        unsafe {
            cx.device.destroy_query_pool(self.timestamps, None);
            cx.device.destroy_query_pool(self.statistics, None);
            cx.device.destroy_descriptor_pool(self.pool, None);
        }
        cx.destroy_buffer(self.constants);
        cx.destroy_buffer(self.no_pyramid);
        if let Some(o) = self.occluders {
            o.destroy(cx);
        }
        if let Some(b) = self.buffers {
            b.destroy(cx);
        }
        if let Some(lists) = self.cpu_lists {
            lists.destroy(cx);
        }
    }
}

/// Makes a set of [`bindings::DRAW`] name what it binds.
fn write_draw_set(cx: &Context, set: vk::DescriptorSet, constants: &Buffer, instances: &Buffer) {
    let bound = [
        (Kind::Uniform, constants),
        (Kind::Storage, instances),
        (record_buffers::kind(cx), instances),
    ];
    write_buffers(cx, set, &bound);
}

impl CpuLists {
    /// As large as the selection's.
    fn new(cx: &Context, index: usize, selection: &Selection) -> Result<Self, RenderError> {
        use vk::BufferUsageFlags as U;
        let name = |what: &str| format!("uninstanced {what} of frame {index}");
        let instances = create_records(
            cx,
            &name("instances"),
            size_of_val(&selection.instances[..]) as u64,
            U::STORAGE_BUFFER | U::VERTEX_BUFFER,
            MemoryLocation::CpuToGpu,
            UINT4,
            FEWER_AGENTS,
        )?;
        let bytes = size_of_val(&selection.shadows[..]) as u64;
        let location = MemoryLocation::CpuToGpu;
        match cx.create_buffer(&name("shadows"), bytes, U::VERTEX_BUFFER, location) {
            Ok(shadows) => Ok(Self { instances, shadows }),
            Err(e) => {
                cx.destroy_buffer(instances);
                Err(e)
            }
        }
    }

    fn destroy(self, cx: &Context) {
        cx.destroy_buffer(self.instances);
        cx.destroy_buffer(self.shadows);
    }
}

impl SlotBuffers {
    fn new(
        cx: &Context,
        index: usize,
        shape: Shape,
        keep_lists: bool,
    ) -> Result<Self, RenderError> {
        use MemoryLocation::{CpuToGpu, GpuOnly, GpuToCpu};
        use vk::BufferUsageFlags as U;
        let [tally, draws, instances, shadows] = list_bytes(shape);
        let readback = if keep_lists {
            2 * tally + draws + instances + shadows
        } else {
            2 * tally
        };
        let tallies =
            tally.next_multiple_of(4 * TALLY_ALIGNMENT as u64) * (1 + SELECT_SHARDS as u64);
        let storage = U::STORAGE_BUFFER;
        let source = storage | U::TRANSFER_SRC;
        let agents = shape.agents as u64 * size_of::<AgentState>() as u64;
        let ranges = (shape.characters * MAX_RANGES) as u64 * size_of::<RangeInfo>() as u64;
        let threads =
            shard_groups(shape.agents) as u64 * (SELECT_GROUP_SIZE * SELECT_SHARDS) as u64;
        let selected = threads * shape.entry_stride as u64 * size_of::<Selected>() as u64;
        let wanted = [
            ("agents", agents, U::empty(), CpuToGpu, Some(UINT4)),
            ("ranges", ranges, U::empty(), CpuToGpu, Some(UINT4)),
            (
                "tally",
                tallies,
                source | U::TRANSFER_DST | U::INDIRECT_BUFFER,
                GpuOnly,
                Some(UINT),
            ),
            ("selected", selected, storage, GpuOnly, Some(UINT4)),
            ("draws", draws, source | U::INDIRECT_BUFFER, GpuOnly, None),
            (
                "instances",
                instances,
                source | U::VERTEX_BUFFER,
                GpuOnly,
                Some(UINT4),
            ),
            ("shadows", shadows, source | U::VERTEX_BUFFER, GpuOnly, None),
            ("readback", readback, U::TRANSFER_DST, GpuToCpu, None),
        ];
        let mut made: Vec<Buffer> = Vec::new();
        for (what, bytes, usage, location, texel) in wanted {
            let name = format!("{what} of frame {index}");
            let buffer = match texel {
                Some(texel) => {
                    create_records(cx, &name, bytes, usage, location, texel, FEWER_AGENTS)
                }
                None if usage.contains(storage) => check_range(cx, &name, bytes, FEWER_AGENTS)
                    .and_then(|()| cx.create_buffer(&name, bytes, usage, location)),
                None => cx.create_buffer(&name, bytes, usage, location),
            };
            match buffer {
                Ok(buffer) => made.push(buffer),
                Err(e) => {
                    made.into_iter().for_each(|b| cx.destroy_buffer(b));
                    return Err(e);
                }
            }
        }
        let mut made = made.into_iter();
        let mut next = || match made.next() {
            Some(buffer) => buffer,
            None => unreachable!("a buffer was made above for every field"),
        };
        Ok(Self {
            agents: next(),
            ranges: next(),
            tally: next(),
            selected: next(),
            draws: next(),
            instances: next(),
            shadows: next(),
            readback: next(),
        })
    }

    fn destroy(self, cx: &Context) {
        for buffer in [
            self.agents,
            self.ranges,
            self.tally,
            self.selected,
            self.draws,
            self.instances,
            self.shadows,
            self.readback,
        ] {
            cx.destroy_buffer(buffer);
        }
    }
}

/// Where the commands of a mesh's bin stand that is drawn packed: behind a command for each bin, that of the shadows, and those of
/// impostors, whose bins have none of their own.
pub(crate) fn packed_command(bins: u32, bin: u32) -> u32 {
    bins + 1 + PACKED_COMMANDS * (IMPOSTOR_DRAWS + bin - 2 * SLICE_COUNT)
}

/// Bytes of the frame's part of the tally, of draws, of instances and of contact shadows, each a multiple of 16.
pub(crate) fn list_bytes(shape: Shape) -> [u64; 4] {
    [
        (TALLY_BINS as u64 + shape.bins as u64) * 4,
        // Behind them the draw of the shadows, and those of impostors and of packed meshes.
        u64::from(packed_command(shape.bins, shape.bins)) * size_of::<DrawCommand>() as u64,
        shape.entries as u64 * size_of::<Instance>() as u64,
        shape.agents as u64 * size_of::<[f32; 4]>() as u64,
    ]
    .map(|bytes| bytes.next_multiple_of(16))
}
