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
use crate::error::RenderError;
use crate::gpu_types::{PALETTE_ROW_ENTRIES, VERTEX_ROW_VERTICES};
use crate::prepare::{self, SubmeshDraw};

/// Uploaded once, read by every frame.
pub(crate) struct Resident {
    pub draws: Vec<SubmeshDraw>,
    /// First of its bands in the tables.
    pub first_bin: u32,
    /// First of its submeshes in the tables.
    pub first_submesh: u32,
    pub indices: Buffer,
    pub set: vk::DescriptorSet,
    images: Vec<Image>,
    constants: Buffer,
    pool: vk::DescriptorPool,
}

/// Copies that the next `record_uploads` records.
pub(crate) struct Upload {
    staging: Buffer,
    /// Of the character that the images and indices belong to.
    character: usize,
    indices: vk::BufferCopy,
    images: Vec<Vec<vk::BufferImageCopy>>,
    /// Of its impostors.
    atlas: Option<AtlasCopies>,
}

impl SubmeshDraw {
    pub(crate) fn variant(&self) -> MeshVariant {
        MeshVariant {
            textured: self.textured,
            double_sided: self.double_sided,
            alpha_tested: self.alpha_cutoff.is_some(),
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

    /// Appends texels in rows of `width`, the last one filled up with zeros. Returns the copy and the rows.
    pub fn push_rows<T: bytemuck::Pod>(
        &mut self,
        texels: &[T],
        width: u32,
    ) -> (Vec<vk::BufferImageCopy>, u32) {
        let offset = self.push(texels);
        let rows = (texels.len() as u32).div_ceil(width).max(1);
        let bytes = rows as usize * width as usize * size_of::<T>();
        self.bytes.resize(offset as usize + bytes, 0);
        (vec![copy(offset, 0, [width, rows], 0)], rows)
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
        if draw.band_count > cx.capabilities.draw_indirect_count {
            return Err(RenderError::Limit {
                object: format!("character '{}'", baked.name),
                needed: draw.band_count as u64,
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
    let mut images = Vec::new();
    let name = |what: &str| format!("{} {what}", baked.name);

    let vertices = prepare::vertex_texels(baked);
    let vertices: &[[u32; 4]] = bytemuck::cast_slice(&vertices);
    let palette: &[[f32; 4]] = bytemuck::cast_slice(&baked.palette);
    let rows = [
        (
            "vertices",
            vk::Format::R32G32B32A32_UINT,
            2 * VERTEX_ROW_VERTICES,
            staging.push_rows(vertices, 2 * VERTEX_ROW_VERTICES),
        ),
        (
            "collapse",
            vk::Format::R32G32_UINT,
            VERTEX_ROW_VERTICES,
            staging.push_rows(&baked.collapse, VERTEX_ROW_VERTICES),
        ),
        (
            "palette",
            vk::Format::R32G32B32A32_SFLOAT,
            3 * PALETTE_ROW_ENTRIES,
            staging.push_rows(palette, 3 * PALETTE_ROW_ENTRIES),
        ),
    ];
    for (what, format, width, (copies, height)) in rows {
        made.image(
            &name(what),
            format,
            [width, height],
            1,
            1,
            ImageShape::Plain,
        )?;
        images.push(copies);
    }
    let (size, mips, layers, copies) = stage_textures(&mut staging, baked);
    made.image(
        &name("textures"),
        vk::Format::R8G8B8A8_UNORM,
        size,
        mips,
        layers,
        ImageShape::Array,
    )?;
    images.push(copies);
    let impostors = baked.impostors.as_ref();
    let atlas = impostors.map(|i| gallery::stage_atlas(&mut staging, &i.atlas, square, blocks));

    let index_offset = staging.push(&baked.indices);
    let index_bytes = size_of_val(&baked.indices[..]) as u64;
    use vk::BufferUsageFlags as U;
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
    made.pool = descriptor_pool(cx, &name("sets"), 1, 0)?;
    let set = allocate_set(cx, &name("set"), made.pool, pipelines.character_set)?;

    // Nothing below fails, so `made` gives up what it guards.
    let (resident_images, mut buffers, pool) = made.take();
    let (Some(mut staging_buffer), Some(mut constants), Some(indices)) =
        (buffers.pop(), buffers.pop(), buffers.pop())
    else {
        unreachable!("three buffers were made above");
    };
    staging_buffer.write(0, &staging.bytes);
    constants.write(0, &[prepare::constants(baked)]);
    write_buffers(cx, set, &[(Kind::Uniform, &constants)]);
    write_images(
        cx,
        set,
        bindings::CHARACTER,
        &resident_images,
        &[pipelines.sampler],
    );
    let resident = Resident {
        draws,
        first_bin,
        first_submesh,
        indices,
        set,
        images: resident_images,
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
        images,
        atlas,
    };
    Ok((resident, upload))
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
    /// Puts another palette in the place of the clips'; no pending command may use the set.
    pub fn write_palette(&self, cx: &Context, palette: &Image) {
        const BINDING: u32 = 3;
        let info = [vk::DescriptorImageInfo {
            sampler: vk::Sampler::null(),
            image_view: palette.view,
            image_layout: vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL,
        }];
        let write = vk::WriteDescriptorSet::default()
            .dst_set(self.set)
            .dst_binding(BINDING)
            .descriptor_type(vk::DescriptorType::SAMPLED_IMAGE)
            .image_info(&info);
        // SAFETY: the view is alive; the caller's promise about the set.
        unsafe { cx.device.update_descriptor_sets(&[write], &[]) };
    }

    /// Destroys everything; no pending command may use any of it.
    pub fn destroy(self, cx: &Context) {
        // SAFETY: the caller's promise; consumed, so once.
        unsafe { cx.device.destroy_descriptor_pool(self.pool, None) };
        for image in self.images {
            cx.destroy_image(image);
        }
        cx.destroy_buffer(self.indices);
        cx.destroy_buffer(self.constants);
    }
}

impl Upload {
    /// Records the copies; the staging buffer, which comes back, has to live until they are done.
    pub fn record(self, commands: &mut Commands, resident: &Resident) -> Buffer {
        for (image, copies) in resident.images.iter().zip(&self.images) {
            record_fill(commands, &self.staging, image, copies);
        }
        if self.indices.size > 0 {
            commands.copy_buffer(&self.staging, &resident.indices, self.indices);
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
                    hint: "bake it smaller: fewer vertices or frames, or smaller textures",
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
