//! A character's arrays on the device, and the staging buffer that fills them.

use ash::vk;
use gpu_allocator::MemoryLocation;
use throng_bake::baked::Baked;

use super::bindings::{self, Kind};
use super::commands::{Access, Commands};
use super::context::Context;
use super::descriptors::{allocate_set, descriptor_pool, write_buffers, write_images};
use super::gallery::{self, AtlasCopies};
use super::memory::{Buffer, Image, ImageDesc, ImageShape};
use super::pipeline::{MeshVariant, Pipelines};
use super::record_buffers::{self, FLOAT4, UINT, UINT4, create_records};
use crate::error::RenderError;
use crate::gpu_types::PACKED_COMMANDS;
use crate::prepare::{self, SubmeshDraw};

/// Uploaded once, read by every frame.
pub(crate) struct Resident {
    pub draws: Vec<SubmeshDraw>,
    /// First of its bands in the tables.
    pub first_bin: u32,
    /// First of its submeshes in the tables.
    pub first_submesh: u32,
    pub indices: Buffer,
    /// 16 bits wide where all fit.
    pub index_type: vk::IndexType,
    pub set: vk::DescriptorSet,
    /// Vertices, parents and palette.
    records: Vec<Buffer>,
    textures: Image,
    constants: Buffer,
    pool: vk::DescriptorPool,
}

/// What to do where a character's array is too large for a device.
const SMALLER: &str = "bake it smaller: fewer vertices or frames, or smaller textures";

/// Copies that the next `record_uploads` records.
pub(crate) struct Upload {
    staging: Buffer,
    /// Of the character that the copies are for.
    character: usize,
    indices: vk::BufferCopy,
    records: Vec<vk::BufferCopy>,
    textures: Vec<vk::BufferImageCopy>,
    /// Of its impostors.
    atlas: Option<AtlasCopies>,
}

impl SubmeshDraw {
    pub(crate) fn variant(&self) -> MeshVariant {
        MeshVariant {
            textured: self.textured,
            double_sided: self.double_sided,
            alpha_tested: self.alpha_cutoff.is_some(),
            packed: false,
        }
    }

    /// For the bands that are drawn packed.
    pub(crate) fn packed_variant(&self) -> MeshVariant {
        MeshVariant {
            packed: true,
            ..self.variant()
        }
    }
}

/// Bytes of the staging buffer and where each array goes.
#[derive(Default)]
pub(super) struct Staging {
    pub bytes: Vec<u8>,
}

impl Staging {
    /// Appends at a multiple of 16 and returns the offset.
    pub fn push<T: bytemuck::Pod>(&mut self, data: &[T]) -> u64 {
        self.bytes.resize(self.bytes.len().next_multiple_of(16), 0);
        let offset = self.bytes.len() as u64;
        self.bytes.extend_from_slice(bytemuck::cast_slice(data));
        offset
    }
}

pub(super) fn copy(offset: u64, mip: u32, size: [u32; 2], layer: u32) -> vk::BufferImageCopy {
    vk::BufferImageCopy {
        buffer_offset: offset,
        buffer_row_length: 0,
        buffer_image_height: 0,
        image_subresource: vk::ImageSubresourceLayers {
            aspect_mask: vk::ImageAspectFlags::COLOR,
            mip_level: mip,
            base_array_layer: layer,
            layer_count: 1,
        },
        image_offset: vk::Offset3D::default(),
        image_extent: vk::Extent3D {
            width: size[0],
            height: size[1],
            depth: 1,
        },
    }
}

/// Makes a validated character's objects; the upload fills them. Its bands and submeshes begin at places in the tables; the
/// last pair is the square of its impostors in the gallery, and whether they are blocks there.
pub(crate) fn make(
    cx: &Context,
    pipelines: &mut Pipelines,
    baked: &Baked,
    character: usize,
    (first_bin, first_submesh): (u32, u32),
    (square, blocks): (u32, bool),
) -> Result<(Resident, Upload), RenderError> {
    let draws = prepare::submesh_draws(baked);
    for draw in &draws {
        pipelines.add_mesh(cx, draw.variant())?;
        if draw.packed_band_count > 0 {
            pipelines.add_mesh(cx, draw.packed_variant())?;
        }
        let commands = draw
            .band_count
            .max(PACKED_COMMANDS * draw.packed_band_count);
        if commands > cx.capabilities.draw_indirect_count {
            return Err(RenderError::Limit {
                object: format!("character '{}'", baked.name),
                needed: commands as u64,
                limit: cx.capabilities.draw_indirect_count as u64,
                unit: "bands in a submesh",
                hint: "bake it with fewer bands",
            });
        }
    }
    let mut staging = Staging::default();
    let mut made = Made {
        cx,
        images: Vec::new(),
        buffers: Vec::new(),
        pool: vk::DescriptorPool::null(),
    };
    let name = |what: &str| format!("{} {what}", baked.name);
    use vk::BufferUsageFlags as U;

    let vertices = prepare::vertex_texels(baked);
    let parents: Vec<u32> = baked.collapse.iter().map(|entry| entry.parent).collect();
    let mut records = Vec::new();
    for (what, texel, bytes) in [
        ("vertices", UINT4, bytemuck::cast_slice::<_, u8>(&vertices)),
        ("parents", UINT, bytemuck::cast_slice(&parents)),
        ("palette", FLOAT4, bytemuck::cast_slice(&baked.palette)),
    ] {
        let size = bytes.len() as u64;
        let buffer = create_records(
            cx,
            &name(what),
            size,
            U::TRANSFER_DST,
            MemoryLocation::GpuOnly,
            texel,
            SMALLER,
        )?;
        made.buffers.push(buffer);
        records.push(vk::BufferCopy {
            src_offset: staging.push(bytes),
            dst_offset: 0,
            size,
        });
    }
    let (size, mips, layers, textures) = stage_textures(&mut staging, baked);
    made.image(
        &name("textures"),
        vk::Format::R8G8B8A8_UNORM,
        size,
        mips,
        layers,
        ImageShape::Array,
    )?;
    let impostors = baked.impostors.as_ref();
    let atlas = impostors.map(|i| gallery::stage_atlas(&mut staging, &i.atlas, square, blocks));

    let indices = prepare::indices(baked);
    let (index_offset, index_bytes, index_type) = stage_indices(&mut staging, &indices);
    made.buffer(
        &name("indices"),
        index_bytes,
        U::INDEX_BUFFER | U::TRANSFER_DST,
        MemoryLocation::GpuOnly,
    )?;
    made.buffer(
        &name("constants"),
        size_of::<crate::gpu_types::CharacterConstants>() as u64,
        U::UNIFORM_BUFFER,
        MemoryLocation::CpuToGpu,
    )?;
    made.buffer(
        &name("staging"),
        staging.bytes.len() as u64,
        U::TRANSFER_SRC,
        MemoryLocation::CpuToGpu,
    )?;
    made.pool = descriptor_pool(cx, &name("sets"), 1, 3)?;
    let set = allocate_set(cx, &name("set"), made.pool, pipelines.character_set)?;

    // Nothing below fails, so `made` gives up what it guards.
    let (mut images, mut buffers, pool) = made.take();
    let (Some(mut staging_buffer), Some(mut constants), Some(indices), Some(resident_textures)) =
        (buffers.pop(), buffers.pop(), buffers.pop(), images.pop())
    else {
        unreachable!("three buffers and an image were made above");
    };
    staging_buffer.write(0, &staging.bytes);
    constants.write(0, &[prepare::constants(baked)]);
    let written = std::iter::once((Kind::Uniform, &constants));
    let read = buffers
        .iter()
        .map(|buffer| (record_buffers::kind(cx), buffer));
    write_buffers(cx, set, &written.chain(read).collect::<Vec<_>>());
    let image = std::slice::from_ref(&resident_textures);
    write_images(cx, set, bindings::CHARACTER, image, &[pipelines.sampler]);
    let resident = Resident {
        draws,
        first_bin,
        first_submesh,
        indices,
        index_type,
        set,
        records: buffers,
        textures: resident_textures,
        constants,
        pool,
    };
    let upload = Upload {
        staging: staging_buffer,
        character,
        indices: vk::BufferCopy {
            src_offset: index_offset,
            dst_offset: 0,
            size: index_bytes,
        },
        records,
        textures,
        atlas,
    };
    Ok((resident, upload))
}

/// Stages vertex numbers, 16 bits each where all fit: where, how many bytes, and which type.
fn stage_indices(staging: &mut Staging, indices: &[u32]) -> (u64, u64, vk::IndexType) {
    let narrow: Option<Vec<u16>> = indices.iter().map(|&i| u16::try_from(i).ok()).collect();
    match narrow {
        Some(narrow) => (
            staging.push(&narrow),
            size_of_val(&narrow[..]) as u64,
            vk::IndexType::UINT16,
        ),
        None => (
            staging.push(indices),
            size_of_val(indices) as u64,
            vk::IndexType::UINT32,
        ),
    }
}

/// Stages all mips of all layers and one more layer of white; a character without textures gets one white pixel.
fn stage_textures(
    staging: &mut Staging,
    baked: &Baked,
) -> ([u32; 2], u32, u32, Vec<vk::BufferImageCopy>) {
    const WHITE: [u8; 4] = [255; 4];
    let t = &baked.textures;
    if t.layer_count == 0 {
        let offset = staging.push(&[WHITE]);
        return ([1, 1], 1, 1, vec![copy(offset, 0, [1, 1], 0)]);
    }
    let mut copies = Vec::new();
    let mut first = 0;
    for mip in 0..t.mip_count {
        let size = [(t.width >> mip).max(1), (t.height >> mip).max(1)];
        let pixels = size[0] as usize * size[1] as usize;
        for layer in 0..t.layer_count {
            let offset = staging.push(&t.pixels[first..][..pixels]);
            copies.push(copy(offset, mip, size, layer));
            first += pixels;
        }
        let offset = staging.push(&vec![WHITE; pixels]);
        copies.push(copy(offset, mip, size, t.layer_count));
    }
    ([t.width, t.height], t.mip_count, t.layer_count + 1, copies)
}

/// Layout, stages and access of an image: new, being filled, read by shaders.
pub(super) type ImageState = (vk::ImageLayout, vk::PipelineStageFlags2, vk::AccessFlags2);
pub(super) const FRESH: ImageState = (
    vk::ImageLayout::UNDEFINED,
    vk::PipelineStageFlags2::NONE,
    vk::AccessFlags2::NONE,
);
pub(super) const FILLING: ImageState = (
    vk::ImageLayout::TRANSFER_DST_OPTIMAL,
    vk::PipelineStageFlags2::ALL_TRANSFER,
    vk::AccessFlags2::TRANSFER_WRITE,
);
pub(super) const READABLE: ImageState = (
    vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL,
    vk::PipelineStageFlags2::from_raw(
        vk::PipelineStageFlags2::VERTEX_SHADER.as_raw()
            | vk::PipelineStageFlags2::FRAGMENT_SHADER.as_raw()
            | vk::PipelineStageFlags2::COMPUTE_SHADER.as_raw(),
    ),
    vk::AccessFlags2::SHADER_SAMPLED_READ,
);

/// Records the copies that fill a new image, which shaders then read.
pub(super) fn record_fill(
    c: &mut Commands,
    staging: &Buffer,
    image: &Image,
    copies: &[vk::BufferImageCopy],
) {
    let color = vk::ImageAspectFlags::COLOR;
    c.image_barrier(image, FRESH, FILLING, color);
    c.copy_to_image(staging, image, copies);
    c.image_barrier(image, FILLING, READABLE, color);
}

impl Resident {
    /// Puts another palette, made of records, in the place of the clips'; no pending command may use the set.
    pub fn write_palette(&self, cx: &Context, palette: &Buffer) {
        let kind = record_buffers::kind(cx);
        let [vertices, parents] = [0, 1].map(|i| (kind, &self.records[i]));
        let written = [
            (Kind::Uniform, &self.constants),
            vertices,
            parents,
            (kind, palette),
        ];
        write_buffers(cx, self.set, &written);
    }

    /// Destroys everything; no pending command may use any of it.
    pub fn destroy(self, cx: &Context) {
        // SAFETY: the caller's promise; consumed, so once.
        unsafe { cx.device.destroy_descriptor_pool(self.pool, None) };
        cx.destroy_image(self.textures);
        for buffer in self.records {
            cx.destroy_buffer(buffer);
        }
        cx.destroy_buffer(self.indices);
        cx.destroy_buffer(self.constants);
    }
}

impl Upload {
    /// Records the copies; the staging buffer, which comes back, has to live until they are done.
    pub fn record(self, commands: &mut Commands, resident: &Resident) -> Buffer {
        record_fill(commands, &self.staging, &resident.textures, &self.textures);
        let records = resident.records.iter().zip(self.records);
        let indices = (&resident.indices, self.indices);
        for (buffer, copy) in records.chain([indices]) {
            if copy.size > 0 {
                commands.copy_buffer(&self.staging, buffer, copy);
            }
        }
        commands.barrier(Access::TransferWrite, &[Access::AnyRead]);
        self.staging
    }

    /// Place of the character that it is of.
    pub fn character(&self) -> usize {
        self.character
    }

    /// Its staging buffer and where its impostors' pictures stand there.
    pub fn atlas(&self) -> Option<(&Buffer, &AtlasCopies)> {
        self.atlas.as_ref().map(|atlas| (&self.staging, atlas))
    }

    /// Destroys an upload that was never recorded.
    pub fn destroy(self, cx: &Context) {
        cx.destroy_buffer(self.staging);
    }
}

/// Objects of a character that is being made; destroys them where a later step fails.
struct Made<'a> {
    cx: &'a Context,
    images: Vec<Image>,
    buffers: Vec<Buffer>,
    pool: vk::DescriptorPool,
}

impl Made<'_> {
    fn image(
        &mut self,
        name: &str,
        format: vk::Format,
        size: [u32; 2],
        mips: u32,
        layers: u32,
        shape: ImageShape,
    ) -> Result<(), RenderError> {
        let capabilities = &self.cx.capabilities;
        for (needed, limit, unit) in [
            (
                size[0].max(size[1]),
                capabilities.image_size,
                "texels in a row or column",
            ),
            (layers, capabilities.image_layers, "layers"),
        ] {
            if needed > limit {
                return Err(RenderError::Limit {
                    object: self.cx.full_name(name),
                    needed: needed as u64,
                    limit: limit as u64,
                    unit,
                    hint: SMALLER,
                });
            }
        }
        let desc = ImageDesc::sampled(format, size, mips, layers, shape);
        let image = self.cx.create_image(name, &desc)?;
        self.images.push(image);
        Ok(())
    }

    fn buffer(
        &mut self,
        name: &str,
        size_bytes: u64,
        usage: vk::BufferUsageFlags,
        location: MemoryLocation,
    ) -> Result<(), RenderError> {
        let buffer = self.cx.create_buffer(name, size_bytes, usage, location)?;
        self.buffers.push(buffer);
        Ok(())
    }

    fn take(mut self) -> (Vec<Image>, Vec<Buffer>, vk::DescriptorPool) {
        (
            std::mem::take(&mut self.images),
            std::mem::take(&mut self.buffers),
            std::mem::take(&mut self.pool),
        )
    }
}

impl Drop for Made<'_> {
    fn drop(&mut self) {
        // SAFETY: these objects were never handed to a command buffer; null is ignored.
        unsafe { self.cx.device.destroy_descriptor_pool(self.pool, None) };
        for image in self.images.drain(..) {
            self.cx.destroy_image(image);
        }
        for buffer in self.buffers.drain(..) {
            self.cx.destroy_buffer(buffer);
        }
    }
}
