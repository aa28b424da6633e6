//! What a frame in flight owns for the occlude stage: the occluders' depth and the pyramid over it.

use ash::vk;
use gpu_allocator::MemoryLocation;

use super::bindings::{self, Kind};
use super::commands::{Access, Commands};
use super::context::Context;
use super::descriptors::{allocate_set, descriptor_pool};
use super::memory::{Buffer, Image, ImageDesc, ImageShape};
use super::pipeline::Pipelines;
use super::record_buffers::{FLOAT, create_records};
use crate::error::RenderError;
use crate::reference::occlude::{Pyramid, depth_size, pyramid_texels};

/// Format of the occluders' depth.
pub(super) const DEPTH: vk::Format = vk::Format::D32_SFLOAT;

/// The depth of the larger agents' coarse meshes.
pub(crate) struct Occluders {
    /// Size of the picture that they are for.
    pub size_px: [u32; 2],
    pub depth: Image,
    /// Levels of farthest depth.
    pub pyramid: Buffer,
    /// For tests: the depth, then the pyramid.
    readback: Option<Buffer>,
    pub set: vk::DescriptorSet,
    pool: vk::DescriptorPool,
}

impl Occluders {
    /// For pictures of `size_px`.
    pub fn new(
        cx: &Context,
        pipelines: &Pipelines,
        index: usize,
        size_px: [u32; 2],
        constants: &Buffer,
        keep: bool,
    ) -> Result<Self, RenderError> {
        let name = |what: &str| format!("{what} of frame {index}");
        let [width, height] = depth_size(size_px);
        let depth = cx.create_image(
            &name("occluder depth"),
            &ImageDesc {
                format: DEPTH,
                extent: vk::Extent2D { width, height },
                mips: 1,
                layers: 1,
                shape: ImageShape::Plain,
                usage: vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT
                    | vk::ImageUsageFlags::SAMPLED
                    | if keep {
                        vk::ImageUsageFlags::TRANSFER_SRC
                    } else {
                        vk::ImageUsageFlags::empty()
                    },
                aspect: vk::ImageAspectFlags::DEPTH,
            },
        )?;
        let pyramid = match Self::pyramid_buffer(cx, index, pyramid_texels(size_px), keep) {
            Ok(pyramid) => pyramid,
            Err(e) => {
                cx.destroy_image(depth);
                return Err(e);
            }
        };
        let mut occluders = Self {
            size_px,
            depth,
            pyramid,
            readback: None,
            set: vk::DescriptorSet::null(),
            pool: vk::DescriptorPool::null(),
        };
        match occluders.fill(cx, pipelines, &name, constants, keep) {
            Ok(()) => Ok(occluders),
            Err(e) => {
                occluders.destroy(cx);
                Err(e)
            }
        }
    }

    /// A pyramid of so many texels.
    pub fn pyramid_buffer(
        cx: &Context,
        index: usize,
        texels: u64,
        keep: bool,
    ) -> Result<Buffer, RenderError> {
        let mut usage = vk::BufferUsageFlags::STORAGE_BUFFER;
        if keep {
            usage |= vk::BufferUsageFlags::TRANSFER_SRC;
        }
        create_records(
            cx,
            &format!("occluder pyramid of frame {index}"),
            4 * texels.max(4),
            usage,
            MemoryLocation::GpuOnly,
            FLOAT,
            "draw a smaller picture",
        )
    }

    fn fill(
        &mut self,
        cx: &Context,
        pipelines: &Pipelines,
        name: &dyn Fn(&str) -> String,
        constants: &Buffer,
        keep: bool,
    ) -> Result<(), RenderError> {
        if keep {
            let texels = self.depth.extent.width as u64 * self.depth.extent.height as u64;
            self.readback = Some(cx.create_buffer(
                &name("occluder readback"),
                4 * texels + self.pyramid.size_bytes,
                vk::BufferUsageFlags::TRANSFER_DST,
                MemoryLocation::GpuToCpu,
            )?);
        }
        self.pool = descriptor_pool(cx, &name("occluder set"), 1, 1)?;
        self.set = allocate_set(cx, &name("occluder set"), self.pool, pipelines.reduce_set)?;
        let buffer = |b: &Buffer| {
            [vk::DescriptorBufferInfo {
                buffer: b.handle,
                offset: 0,
                range: vk::WHOLE_SIZE,
            }]
        };
        let (constants, pyramid) = (buffer(constants), buffer(&self.pyramid));
        let depth = [vk::DescriptorImageInfo {
            sampler: vk::Sampler::null(),
            image_view: self.depth.view,
            image_layout: vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL,
        }];
        let writes: Vec<_> = (0u32..)
            .zip(bindings::REDUCE)
            .map(|(binding, kind)| {
                let write = vk::WriteDescriptorSet::default()
                    .dst_set(self.set)
                    .dst_binding(binding)
                    .descriptor_type(kind.descriptor_type());
                match kind {
                    Kind::Image => write.image_info(&depth),
                    Kind::Uniform => write.buffer_info(&constants),
                    _ => write.buffer_info(&pyramid),
                }
            })
            .collect();
        // SAFETY: everything named is alive; the set is new.
        unsafe { cx.device.update_descriptor_sets(&writes, &[]) };
        Ok(())
    }

    /// Records what lets occluders be drawn.
    pub fn begin(&self, c: &mut Commands, far: f32) {
        use vk::{AccessFlags2 as A, ImageLayout as L, PipelineStageFlags2 as S};
        let tests = S::EARLY_FRAGMENT_TESTS | S::LATE_FRAGMENT_TESTS;
        c.image_barrier(
            &self.depth,
            (L::UNDEFINED, S::COMPUTE_SHADER | S::ALL_TRANSFER, A::NONE),
            (
                L::DEPTH_ATTACHMENT_OPTIMAL,
                tests,
                A::DEPTH_STENCIL_ATTACHMENT_READ | A::DEPTH_STENCIL_ATTACHMENT_WRITE,
            ),
            vk::ImageAspectFlags::DEPTH,
        );
        c.begin_depth_rendering(&self.depth, far);
        let texel = crate::gpu_types::OCCLUDER_TEXEL_PX as f32;
        c.set_viewport_in(
            [0, 0],
            self.size_px.map(|side| side as f32 / texel),
            self.depth.extent,
        );
    }

    /// Records what lets the depth be read after they are drawn.
    pub fn end(&self, c: &mut Commands) {
        use vk::{AccessFlags2 as A, ImageLayout as L, PipelineStageFlags2 as S};
        c.end_rendering();
        c.image_barrier(
            &self.depth,
            (
                L::DEPTH_ATTACHMENT_OPTIMAL,
                S::EARLY_FRAGMENT_TESTS | S::LATE_FRAGMENT_TESTS,
                A::DEPTH_STENCIL_ATTACHMENT_WRITE,
            ),
            (
                L::SHADER_READ_ONLY_OPTIMAL,
                S::COMPUTE_SHADER,
                A::SHADER_SAMPLED_READ,
            ),
            vk::ImageAspectFlags::DEPTH,
        );
    }

    /// Records the copies for tests, after the last reader.
    pub fn record_readback(&self, c: &mut Commands) {
        use vk::{AccessFlags2 as A, ImageLayout as L, PipelineStageFlags2 as S};
        let Some(readback) = &self.readback else {
            return;
        };
        c.image_barrier(
            &self.depth,
            (L::SHADER_READ_ONLY_OPTIMAL, S::COMPUTE_SHADER, A::NONE),
            (L::TRANSFER_SRC_OPTIMAL, S::ALL_TRANSFER, A::TRANSFER_READ),
            vk::ImageAspectFlags::DEPTH,
        );
        c.copy_aspect_from_image(
            &self.depth,
            readback,
            self.depth.extent.height,
            vk::ImageAspectFlags::DEPTH,
        );
        let region = vk::BufferCopy {
            src_offset: 0,
            dst_offset: readback.size_bytes - self.pyramid.size_bytes,
            size: self.pyramid.size_bytes,
        };
        c.barrier(Access::ComputeReadWrite, &[Access::TransferRead]);
        c.copy_buffer(&self.pyramid, readback, region);
        c.barrier(Access::TransferWrite, &[Access::HostRead]);
    }

    /// The depth, `[depth_size]`, and the pyramid, of finished commands; `None` where they are not kept.
    pub fn read(&self) -> Option<(Vec<f32>, Pyramid)> {
        let readback = self.readback.as_ref()?;
        let mut all: Vec<f32> = readback.read(readback.size_bytes as usize / 4);
        let texels = all.split_off(all.len() - self.pyramid.size_bytes as usize / 4);
        let pyramid = Pyramid {
            size_px: self.size_px,
            texels,
        };
        Some((all, pyramid))
    }

    /// Destroys everything; no pending command may use any of it.
    pub fn destroy(self, cx: &Context) {
        // SAFETY: the caller's promise; null is ignored; consumed, so once.
        unsafe { cx.device.destroy_descriptor_pool(self.pool, None) };
        cx.destroy_image(self.depth);
        cx.destroy_buffer(self.pyramid);
        if let Some(readback) = self.readback {
            cx.destroy_buffer(readback);
        }
    }
}
