//! The impostors of all characters on the device. Made anew, as large as is needed then, when characters with impostors were
//! added; the atlases that are there already are copied on the device.

use ash::vk;
use gpu_allocator::MemoryLocation;
use throng_bake::bc7::{self, Block};
use throng_bake::impostor::{Atlas, CUBE_SIZE, Impostors};

use super::bindings;
use super::commands::{Access, Commands};
use super::context::Context;
use super::descriptors::{allocate_set, descriptor_pool, write_buffers, write_images};
use super::memory::{Buffer, Image, ImageDesc, ImageShape};
use super::pipeline::Pipelines;
use super::record_buffers::{self, FLOAT4, create_records};
use super::resident::{self, FILLING, FRESH, READABLE, Staging};
use crate::error::RenderError;
use crate::gpu_types::{AGENTS_PER_INSTANCE, IMPOSTOR_POSE_MASK};
use crate::impostor;

/// What the impostor stage reads.
pub(crate) struct Gallery {
    pub set: vk::DescriptorSet,
    /// Of as many quads as any kind has.
    pub indices: Buffer,
    table: Buffer,
    /// Cells, colours, surfaces.
    images: Vec<Image>,
    /// Of table, cells and indices, until they are copied.
    staging: Option<Staged>,
    side: u32,
    grid: [u32; 2],
    mip_count: u32,
    /// Squares that have atlases.
    squares: Vec<u32>,
    pool: vk::DescriptorPool,
}

struct Staged {
    buffer: Buffer,
    table: vk::BufferCopy,
    cells: Vec<vk::BufferImageCopy>,
    indices: vk::BufferCopy,
    /// Blocks of a square that shows nothing, where pictures are blocks: those cannot be cleared.
    empty: Option<u64>,
}

/// Where a character's pictures stand in its staging buffer, by mip, and which atlas of the gallery they become.
pub(crate) struct AtlasCopies {
    square: u32,
    colors: Vec<vk::BufferImageCopy>,
    surfaces: Vec<vk::BufferImageCopy>,
}

/// What to do where impostors are too many for a device.
const FEWER_IMPOSTORS: &str = "bake it with fewer impostors, or none";
/// Texels of the table that it can itself name, as floats.
const EXACT_TEXELS: u64 = 1 << 24;
/// Places of the pictures in `Gallery::images`.
const CELLS: usize = 0;
const COLORS: usize = 1;
const SURFACES: usize = 2;

/// Whether one more character's impostors fit.
///
/// Errors: [`RenderError::Limit`]; [`RenderError::BadCharacter`] where the others' pictures are blocks and these are not.
pub(super) fn check(
    cx: &Context,
    name: &str,
    gallery: &impostor::Gallery,
    impostors: &Impostors,
    palette_len: usize,
) -> Result<(), RenderError> {
    let limits = &cx.capabilities;
    let atlas = &impostors.atlas;
    if gallery.blocks && atlas.blocks.is_none() {
        return Err(RenderError::BadCharacter {
            character: name.into(),
            place: "impostors".into(),
            reason: "its pictures are not compressed, and those of the characters before it are: \
                     bake all of them with --compress on, or none"
                .into(),
        });
    }
    let block_size = impostor::Gallery::block_size(impostors, palette_len);
    let before = gallery.block_place(block_size);
    let texels = before + block_size;
    let poses = before + u64::from(impostor::pose_texels(impostors));
    let atlas_count = gallery.atlas_count.max(gallery.next_square() + 1);
    let picture = impostor::Gallery::picture_size(atlas_count, gallery.side_with(atlas));
    let cubes = u64::from(gallery.view_set_count()) + impostors.view_sets.len() as u64;
    for (needed, limit, unit) in [
        (
            texels,
            record_buffers::most(cx, FLOAT4).min(EXACT_TEXELS),
            "texels of all impostors' tables",
        ),
        (
            poses,
            u64::from(IMPOSTOR_POSE_MASK),
            "texels before the last pose in all impostors' tables",
        ),
        (
            picture[0].max(picture[1]),
            u64::from(limits.image_size),
            "texels in a row or column of all impostors",
        ),
        (
            6 * cubes,
            u64::from(limits.image_layers),
            "sides of view cells' cube maps",
        ),
    ] {
        if needed > limit {
            return Err(RenderError::Limit {
                object: format!("character '{name}'"),
                needed,
                limit,
                unit,
                hint: FEWER_IMPOSTORS,
            });
        }
    }
    Ok(())
}

/// Stages a character's pictures for a square of the gallery, as blocks or as texels.
pub(super) fn stage_atlas(
    staging: &mut Staging,
    atlas: &Atlas,
    square: u32,
    blocks: bool,
) -> AtlasCopies {
    let mut texels = |pixels: &[[u8; 4]]| -> Vec<_> {
        let mips = (0..atlas.mip_count).map(|mip| {
            let (width, height, first) = atlas.mip(mip);
            let count = width as usize * height as usize;
            let offset = staging.push(&pixels[first..][..count]);
            resident::copy(offset, 0, [width, height], 0)
        });
        mips.collect()
    };
    let (colors, surfaces) = match &atlas.blocks {
        Some(all) if blocks => {
            let mut whole = |blocks: &[Block]| -> Vec<_> {
                let mips = (0..atlas.mip_count).map(|mip| {
                    let (columns, rows, first) = atlas.block_mip(mip);
                    let count = columns as usize * rows as usize;
                    let offset = staging.push(&blocks[first..][..count]);
                    resident::copy(offset, 0, [4 * columns, 4 * rows], 0)
                });
                mips.collect()
            };
            (whole(&all.color), whole(&all.surface))
        }
        _ => (texels(&atlas.color), texels(&atlas.surface)),
    };
    AtlasCopies {
        square,
        colors,
        surfaces,
    }
}

impl Gallery {
    /// Makes the objects of a gallery that has at least one atlas; `record` fills them.
    ///
    /// Errors: [`RenderError::Vulkan`], [`RenderError::Memory`].
    pub fn new(
        cx: &Context,
        pipelines: &Pipelines,
        tables: &impostor::Gallery,
    ) -> Result<Self, RenderError> {
        use vk::BufferUsageFlags as U;
        let location = MemoryLocation::GpuOnly;
        let table = create_records(
            cx,
            "impostors' table",
            size_of_val(&tables.texels[..]) as u64,
            U::TRANSFER_DST,
            location,
            FLOAT4,
            FEWER_IMPOSTORS,
        )?;
        let usage = U::INDEX_BUFFER | U::TRANSFER_DST;
        let indices = match cx.create_buffer("quad indices", index_bytes(tables), usage, location) {
            Ok(indices) => indices,
            Err(e) => {
                cx.destroy_buffer(table);
                return Err(e);
            }
        };
        let mut gallery = Self {
            set: vk::DescriptorSet::null(),
            indices,
            table,
            images: Vec::new(),
            staging: None,
            side: tables.side,
            grid: impostor::Gallery::grid(tables.atlas_count),
            mip_count: tables.mip_count,
            squares: (0..tables.atlas_count)
                .filter(|&square| tables.has_atlas(square))
                .collect(),
            pool: vk::DescriptorPool::null(),
        };
        match gallery.fill(cx, pipelines, tables) {
            Ok(()) => Ok(gallery),
            Err(e) => {
                gallery.destroy(cx);
                Err(e)
            }
        }
    }

    fn fill(
        &mut self,
        cx: &Context,
        pipelines: &Pipelines,
        tables: &impostor::Gallery,
    ) -> Result<(), RenderError> {
        let mut staging = Staging::default();
        let mut texels = tables.texels.to_vec();
        let [width, height] = self.grid.map(|n| n * tables.side);
        texels[0] = [
            width as f32,
            height as f32,
            tables.side as f32,
            self.grid[0] as f32,
        ];
        let table_offset = staging.push(&texels);
        // Halves hold whole numbers up to 2,048.
        let halves: Vec<[u16; 4]> = tables.cells.iter().map(|t| t.map(half)).collect();
        let side = (CUBE_SIZE * CUBE_SIZE) as usize;
        let cells: Vec<_> = (0..)
            .zip(halves.chunks_exact(side))
            .map(|(i, side)| resident::copy(staging.push(side), 0, [CUBE_SIZE; 2], i))
            .collect();
        let index_offset = staging.push(&impostor::indices(index_quads(tables)));

        use vk::Format as F;
        let (halves, sides) = (F::R16G16B16A16_SFLOAT, cells.len() as u32);
        let (plain, cubes) = ((ImageShape::Plain, 1), (ImageShape::CubeArray, sides));
        let picture = impostor::Gallery::picture_size(tables.atlas_count, tables.side);
        let picture = picture.map(|n| n as u32);
        let bytes = match tables.blocks {
            true => F::BC7_UNORM_BLOCK,
            false => F::R8G8B8A8_UNORM,
        };
        for (name, format, size, (shape, layers)) in [
            ("impostors' cells", halves, [CUBE_SIZE; 2], cubes),
            ("impostors' colours", bytes, picture, plain),
            ("impostors' surfaces", bytes, picture, plain),
        ] {
            let mut desc = ImageDesc::sampled(format, size, 1, layers, shape);
            // A larger gallery takes its atlases from this one.
            desc.usage |= vk::ImageUsageFlags::TRANSFER_SRC;
            self.images.push(cx.create_image(name, &desc)?);
        }
        let empty = tables.blocks.then(|| {
            let squares = (tables.side / 4) as usize;
            staging.push(&vec![bc7::ZERO; squares * squares])
        });
        let mut buffer = cx.create_buffer(
            "impostors' staging",
            staging.bytes.len() as u64,
            vk::BufferUsageFlags::TRANSFER_SRC,
            MemoryLocation::CpuToGpu,
        )?;
        buffer.write(0, &staging.bytes);
        self.staging = Some(Staged {
            buffer,
            table: vk::BufferCopy {
                src_offset: table_offset,
                dst_offset: 0,
                size: self.table.size_bytes,
            },
            cells,
            empty,
            indices: vk::BufferCopy {
                src_offset: index_offset,
                dst_offset: 0,
                size: index_bytes(tables),
            },
        });
        self.pool = descriptor_pool(cx, "impostors' sets", 1, 1)?;
        self.set = allocate_set(cx, "impostors' set", self.pool, pipelines.gallery_set)?;
        let samplers = [pipelines.nearest_sampler, pipelines.linear_sampler];
        write_buffers(cx, self.set, &[(record_buffers::kind(cx), &self.table)]);
        write_images(cx, self.set, bindings::GALLERY, &self.images, &samplers);
        Ok(())
    }

    /// First texel of a square in a mip: the grid's coarser mips stand below it, side by side.
    fn origin(&self, square: u32, mip: u32) -> vk::Offset3D {
        let [columns, rows] = self.grid;
        let width = columns * self.side;
        let [x, y] = match mip {
            0 => [0, 0],
            _ => [width - (width >> (mip - 1)), rows * self.side],
        };
        let in_grid = |i: u32| (i * self.side) >> mip;
        vk::Offset3D {
            x: (x + in_grid(square % columns)) as i32,
            y: (y + in_grid(square / columns)) as i32,
            z: 0,
        }
    }

    /// Copies of the square that shows nothing to all squares of a mip.
    fn empty(&self, offset: u64, mip: u32) -> impl Iterator<Item = vk::BufferImageCopy> {
        (0..self.grid[0] * self.grid[1]).map(move |square| vk::BufferImageCopy {
            image_offset: self.origin(square, mip),
            ..resident::copy(offset, 0, [self.side >> mip; 2], 0)
        })
    }

    /// Records what fills the gallery: the atlases of the one before it, and the pictures of new characters from their staging
    /// buffers. Outside rendering; a barrier from transfers to everything that reads has to follow.
    pub fn record(
        &self,
        c: &mut Commands,
        before: Option<&Gallery>,
        new: &[(&Buffer, &AtlasCopies)],
    ) {
        let Some(staged) = &self.staging else { return };
        resident::record_fill(c, &staged.buffer, &self.images[CELLS], &staged.cells);
        c.copy_buffer(&staged.buffer, &self.table, staged.table);
        c.copy_buffer(&staged.buffer, &self.indices, staged.indices);
        let color = vk::ImageAspectFlags::COLOR;
        for place in [COLORS, SURFACES] {
            let image = &self.images[place];
            c.image_barrier(image, FRESH, FILLING, color);
            // What no atlas covers is filtered into the edges of those beside it.
            match staged.empty {
                Some(offset) => {
                    let squares = (0..self.mip_count).flat_map(|mip| self.empty(offset, mip));
                    c.copy_to_image(&staged.buffer, image, &squares.collect::<Vec<_>>());
                }
                None => c.clear_image(image),
            }
            // The copies do not overlap, but the validation layer takes blocks for larger than they are: so each waits for
            // the one before it, for any memory and not for this picture's.
            let in_order = |c: &mut Commands| {
                c.barrier(Access::TransferWrite, &[Access::TransferWrite]);
            };
            in_order(c);
            // A square that a new character took is not what it was.
            let is_new = |square: &u32| new.iter().any(|(_, copies)| copies.square == *square);
            let kept = |before: &Gallery| {
                let kept = self.squares.iter().copied();
                kept.filter(|s| !is_new(s) && before.squares.contains(s))
                    .collect::<Vec<u32>>()
            };
            if let Some(before) = before
                && let kept = kept(before)
                && !kept.is_empty()
            {
                use vk::{AccessFlags2 as A, ImageLayout as L, PipelineStageFlags2 as S};
                let from = &before.images[place];
                let source = (L::TRANSFER_SRC_OPTIMAL, S::ALL_TRANSFER, A::TRANSFER_READ);
                c.image_barrier(from, READABLE, source, color);
                // Smaller where what asked for the size is gone: all that stay fit.
                let (mips, side) = (
                    before.mip_count.min(self.mip_count),
                    before.side.min(self.side),
                );
                let copies = kept.into_iter().flat_map(|square| {
                    (0..mips).map(move |mip| {
                        let (from, to) = (before.origin(square, mip), self.origin(square, mip));
                        (from, to, [(side >> mip).max(1); 2])
                    })
                });
                c.copy_image(from, image, copies);
                in_order(c);
            }
            for (staging, copies) in new {
                let mips = match place {
                    COLORS => &copies.colors,
                    _ => &copies.surfaces,
                };
                let mips = (0..).zip(mips).map(|(mip, copy)| vk::BufferImageCopy {
                    image_offset: self.origin(copies.square, mip),
                    ..*copy
                });
                c.copy_to_image(staging, image, &mips.collect::<Vec<_>>());
                in_order(c);
            }
            c.image_barrier(image, FILLING, READABLE, color);
        }
    }

    /// The staging buffer of a gallery that was recorded; it has to live until the copies are done.
    pub fn take_staging(&mut self) -> Option<Buffer> {
        self.staging.take().map(|s| s.buffer)
    }

    /// Destroys everything; no pending command may use any of it.
    pub fn destroy(mut self, cx: &Context) {
        // SAFETY: the caller's promise; null is ignored; consumed, so once.
        unsafe { cx.device.destroy_descriptor_pool(self.pool, None) };
        if let Some(staging) = self.take_staging() {
            cx.destroy_buffer(staging);
        }
        for image in self.images {
            cx.destroy_image(image);
        }
        cx.destroy_buffer(self.table);
        cx.destroy_buffer(self.indices);
    }
}

/// Quads of an instance of any draw.
fn index_quads(tables: &impostor::Gallery) -> u32 {
    tables.quad_count.max(AGENTS_PER_INSTANCE)
}

fn index_bytes(tables: &impostor::Gallery) -> u64 {
    6 * u64::from(index_quads(tables)) * size_of::<u32>() as u64
}

const _: () = assert!(throng_bake::impostor::views::MAX_VIEWS <= 2048);

/// A whole number below 2,048 as a half.
fn half(n: u16) -> u16 {
    match n {
        0 => 0,
        n => {
            let exponent = 15 - n.leading_zeros() as u16;
            ((exponent + 15) << 10) | ((n << (10 - exponent)) & 0x3ff)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::half;

    #[test]
    fn whole_numbers_become_halves() {
        // By the definition of binary16: 1 is exponent 15, and the fraction has 10 bits.
        assert_eq!(
            [0, 1, 2, 3, 92, 1023, 2047].map(half),
            [0, 0x3c00, 0x4000, 0x4200, 0x55c0, 0x63fe, 0x67ff]
        );
    }
}
