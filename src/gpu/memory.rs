//! Buffers and images with their memory. Each is destroyed by whoever owns it, explicitly.

use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme, Allocator};

use super::context::Context;
use crate::error::RenderError;

/// A buffer and its memory.
#[derive(Debug)]
pub(crate) struct Buffer {
    pub handle: vk::Buffer,
    /// Where [`Context::add_texel_view`] made one.
    pub view: vk::BufferView,
    pub size_bytes: u64,
    allocation: Option<Allocation>,
}

/// An image, a view of all of it, and its memory.
#[derive(Debug)]
pub(crate) struct Image {
    pub handle: vk::Image,
    pub view: vk::ImageView,
    pub extent: vk::Extent2D,
    pub mips: u32,
    pub layers: u32,
    allocation: Option<Allocation>,
}

/// How shaders see an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ImageShape {
    Plain,
    Array,
    /// Six layers per cube.
    CubeArray,
}

/// What to make an image of.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ImageDesc {
    pub format: vk::Format,
    pub extent: vk::Extent2D,
    pub mips: u32,
    pub layers: u32,
    pub shape: ImageShape,
    pub usage: vk::ImageUsageFlags,
    pub aspect: vk::ImageAspectFlags,
}

impl ImageDesc {
    /// A colour image that is filled once and that shaders read.
    pub fn sampled(
        format: vk::Format,
        [width, height]: [u32; 2],
        mips: u32,
        layers: u32,
        shape: ImageShape,
    ) -> Self {
        Self {
            format,
            extent: vk::Extent2D { width, height },
            mips,
            layers,
            shape,
            usage: vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::TRANSFER_DST,
            aspect: vk::ImageAspectFlags::COLOR,
        }
    }
}

impl Context {
    fn with_allocator<T>(
        &self,
        name: &str,
        call: impl FnOnce(&mut Allocator) -> Result<T, gpu_allocator::AllocationError>,
    ) -> Result<T, RenderError> {
        let mut guard = self.allocator.lock().unwrap_or_else(|e| e.into_inner());
        let allocator = guard.as_mut().ok_or(RenderError::Order {
            call: "allocate",
            reason: "the renderer is destroyed",
        })?;
        call(allocator).map_err(|source| RenderError::Memory {
            object: self.full_name(name),
            source,
        })
    }

    /// A buffer of at least 16 bytes.
    pub fn create_buffer(
        &self,
        name: &str,
        size_bytes: u64,
        usage: vk::BufferUsageFlags,
        location: MemoryLocation,
    ) -> Result<Buffer, RenderError> {
        let size_bytes = size_bytes.max(16);
        let full_name = self.full_name(name);
        let info = vk::BufferCreateInfo::default()
            .size(size_bytes)
            .usage(usage);
        // SAFETY: the device is alive as long as the context is in use (`Renderer::new`'s contract).
        let (handle, requirements) = unsafe {
            let handle = self
                .device
                .create_buffer(&info, None)
                .map_err(RenderError::vulkan(full_name.clone(), "vkCreateBuffer"))?;
            (handle, self.device.get_buffer_memory_requirements(handle))
        };
        let mut buffer = Buffer {
            handle,
            view: vk::BufferView::null(),
            size_bytes,
            allocation: None,
        };
        let bound = self
            .with_allocator(name, |a| {
                a.allocate(&AllocationCreateDesc {
                    name: &full_name,
                    requirements,
                    location,
                    linear: true,
                    allocation_scheme: AllocationScheme::GpuAllocatorManaged,
                })
            })
            .and_then(|allocation| {
                // SAFETY: fresh buffer, fresh memory of its own requirements, bound once.
                let bound = unsafe {
                    self.device
                        .bind_buffer_memory(handle, allocation.memory(), allocation.offset())
                };
                buffer.allocation = Some(allocation);
                bound.map_err(RenderError::vulkan(full_name, "vkBindBufferMemory"))
            });
        if let Err(e) = bound {
            self.destroy_buffer(buffer);
            return Err(e);
        }
        self.set_name(handle, name);
        Ok(buffer)
    }

    /// Makes the view through which shaders read all of a buffer as texels.
    pub fn add_texel_view(
        &self,
        buffer: &mut Buffer,
        name: &str,
        format: vk::Format,
    ) -> Result<(), RenderError> {
        let info = vk::BufferViewCreateInfo::default()
            .buffer(buffer.handle)
            .format(format)
            .range(vk::WHOLE_SIZE);
        // SAFETY: the buffer is alive and bound; its owner destroys the view with it.
        let view = unsafe { self.device.create_buffer_view(&info, None) };
        buffer.view = view.map_err(RenderError::vulkan(
            self.full_name(name),
            "vkCreateBufferView",
        ))?;
        self.set_name(buffer.view, name);
        Ok(())
    }

    /// A 2D image in optimal tiling and a view of it.
    pub fn create_image(&self, name: &str, desc: &ImageDesc) -> Result<Image, RenderError> {
        let full_name = self.full_name(name);
        let info = vk::ImageCreateInfo::default()
            .flags(match desc.shape {
                ImageShape::CubeArray => vk::ImageCreateFlags::CUBE_COMPATIBLE,
                _ => vk::ImageCreateFlags::empty(),
            })
            .image_type(vk::ImageType::TYPE_2D)
            .format(desc.format)
            .extent(desc.extent.into())
            .mip_levels(desc.mips)
            .array_layers(desc.layers)
            .samples(vk::SampleCountFlags::TYPE_1)
            .tiling(vk::ImageTiling::OPTIMAL)
            .usage(desc.usage);
        // SAFETY: as in `create_buffer`.
        let (handle, requirements) = unsafe {
            let handle = self
                .device
                .create_image(&info, None)
                .map_err(RenderError::vulkan(full_name.clone(), "vkCreateImage"))?;
            (handle, self.device.get_image_memory_requirements(handle))
        };
        let mut image = Image {
            handle,
            view: vk::ImageView::null(),
            extent: desc.extent,
            mips: desc.mips,
            layers: desc.layers,
            allocation: None,
        };
        let made = self
            .with_allocator(name, |a| {
                a.allocate(&AllocationCreateDesc {
                    name: &full_name,
                    requirements,
                    location: MemoryLocation::GpuOnly,
                    linear: false,
                    allocation_scheme: AllocationScheme::GpuAllocatorManaged,
                })
            })
            .and_then(|allocation| {
                let view = vk::ImageViewCreateInfo::default()
                    .image(handle)
                    .format(desc.format)
                    .view_type(match desc.shape {
                        ImageShape::Plain => vk::ImageViewType::TYPE_2D,
                        ImageShape::Array => vk::ImageViewType::TYPE_2D_ARRAY,
                        ImageShape::CubeArray => vk::ImageViewType::CUBE_ARRAY,
                    })
                    .subresource_range(vk::ImageSubresourceRange {
                        aspect_mask: desc.aspect,
                        base_mip_level: 0,
                        level_count: desc.mips,
                        base_array_layer: 0,
                        layer_count: desc.layers,
                    });
                // SAFETY: fresh image, fresh memory of its own requirements, bound once before the view is made.
                let made = unsafe {
                    self.device
                        .bind_image_memory(handle, allocation.memory(), allocation.offset())
                        .and_then(|()| self.device.create_image_view(&view, None))
                };
                image.allocation = Some(allocation);
                image.view = made.map_err(RenderError::vulkan(full_name, "vkCreateImageView"))?;
                Ok(())
            });
        if let Err(e) = made {
            self.destroy_image(image);
            return Err(e);
        }
        self.set_name(handle, name);
        self.set_name(image.view, name);
        Ok(image)
    }

    /// Destroys a buffer that no pending command uses.
    pub fn destroy_buffer(&self, mut buffer: Buffer) {
        // SAFETY: the caller's promise; the handles are destroyed once because the buffer is consumed; null is ignored.
        unsafe {
            self.device.destroy_buffer_view(buffer.view, None);
            self.device.destroy_buffer(buffer.handle, None);
        }
        self.free(buffer.allocation.take());
    }

    /// Destroys an image that no pending command uses.
    pub fn destroy_image(&self, mut image: Image) {
        // SAFETY: the caller's promise; the handles are destroyed once because the image is consumed.
        unsafe {
            self.device.destroy_image_view(image.view, None);
            self.device.destroy_image(image.handle, None);
        }
        self.free(image.allocation.take());
    }

    fn free(&self, allocation: Option<Allocation>) {
        if let Some(allocation) = allocation
            && let Err(e) = self.with_allocator("memory", |a| a.free(allocation))
        {
            tracing::error!("{e}");
        }
    }
}

impl Buffer {
    /// Copies `data` to a byte offset of a host-visible buffer that no pending command uses.
    ///
    /// Panics: where the data does not fit, which is our own bug.
    pub fn write<T: bytemuck::Pod>(&mut self, offset_bytes: usize, data: &[T]) {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let mapped = self
            .allocation
            .as_mut()
            .and_then(|a| a.mapped_slice_mut())
            .unwrap_or(&mut []);
        mapped[offset_bytes..offset_bytes + bytes.len()].copy_from_slice(bytes);
    }

    /// Reads `count` values from the start of a host-visible buffer that no pending command writes.
    pub fn read<T: bytemuck::Pod>(&self, count: usize) -> Vec<T> {
        bytemuck::pod_collect_to_vec(&self.mapped()[..count * size_of::<T>()])
    }

    /// Reads value `index` of a buffer as [`Buffer::read`] does; `None` behind its end.
    pub fn value<T: bytemuck::Pod>(&self, index: usize) -> Option<T> {
        let bytes = self.mapped().chunks_exact(size_of::<T>()).nth(index)?;
        Some(bytemuck::pod_read_unaligned(bytes))
    }

    fn mapped(&self) -> &[u8] {
        let allocation = self.allocation.as_ref();
        allocation.and_then(|a| a.mapped_slice()).unwrap_or(&[])
    }
}
