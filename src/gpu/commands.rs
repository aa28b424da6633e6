//! A recording command buffer behind safe calls, so that the stages read as their phases.

use ash::vk;

use super::context::Context;
use super::memory::{Buffer, Image};

/// How memory is used on one side of a barrier.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Access {
    TransferWrite,
    TransferRead,
    ComputeReadWrite,
    /// Arguments of an indirect dispatch.
    DispatchRead,
    /// Everything that reads lists, before they are made anew.
    ListRead,
    /// Indirect arguments and instance lists.
    DrawRead,
    /// Everything that reads an upload.
    AnyRead,
    HostRead,
}

impl Access {
    fn scope(self) -> (vk::PipelineStageFlags2, vk::AccessFlags2) {
        use vk::{AccessFlags2 as A, PipelineStageFlags2 as S};
        match self {
            Self::TransferWrite => (S::ALL_TRANSFER, A::TRANSFER_WRITE),
            Self::TransferRead => (S::ALL_TRANSFER, A::TRANSFER_READ),
            Self::ComputeReadWrite => (
                S::COMPUTE_SHADER,
                A::SHADER_SAMPLED_READ | A::SHADER_STORAGE_READ | A::SHADER_STORAGE_WRITE,
            ),
            Self::ListRead => (
                S::COMPUTE_SHADER
                    | S::DRAW_INDIRECT
                    | S::VERTEX_ATTRIBUTE_INPUT
                    | S::VERTEX_SHADER
                    | S::ALL_TRANSFER,
                A::NONE,
            ),
            Self::DispatchRead => (S::DRAW_INDIRECT, A::INDIRECT_COMMAND_READ),
            Self::DrawRead => (
                S::DRAW_INDIRECT | S::VERTEX_ATTRIBUTE_INPUT | S::VERTEX_SHADER,
                A::INDIRECT_COMMAND_READ
                    | A::VERTEX_ATTRIBUTE_READ
                    | A::SHADER_SAMPLED_READ
                    | A::SHADER_STORAGE_READ,
            ),
            Self::AnyRead => (
                S::DRAW_INDIRECT
                    | S::INDEX_INPUT
                    | S::VERTEX_SHADER
                    | S::FRAGMENT_SHADER
                    | S::COMPUTE_SHADER,
                A::INDEX_READ | A::SHADER_STORAGE_READ | A::SHADER_SAMPLED_READ,
            ),
            Self::HostRead => (S::HOST, A::HOST_READ),
        }
    }
}

/// A command buffer that is being recorded.
pub(crate) struct Commands<'a> {
    pub context: &'a Context,
    pub cmd: vk::CommandBuffer,
    /// API draw calls recorded through this.
    pub draw_calls: u64,
}

// SAFETY of every call below: `new` promises a recording command buffer of the context's device; handles come from the
// renderer, which keeps them alive until the host says that the frame is finished.
#[allow(clippy::undocumented_unsafe_blocks, reason = "one for all, above")]
impl<'a> Commands<'a> {
    /// # Safety
    /// `cmd` is recording, belongs to the context's device, and is outside or inside rendering as the caller's contract says.
    pub unsafe fn new(context: &'a Context, cmd: vk::CommandBuffer) -> Self {
        Self {
            context,
            cmd,
            draw_calls: 0,
        }
    }

    pub fn label<T>(&mut self, name: &str, record: impl FnOnce(&mut Self) -> T) -> T {
        self.context.begin_label(self.cmd, name);
        let result = record(self);
        self.context.end_label(self.cmd);
        result
    }

    pub fn barrier(&mut self, from: Access, to: &[Access]) {
        let (src_stage, src_access) = from.scope();
        let (mut dst_stage, mut dst_access) =
            (vk::PipelineStageFlags2::NONE, vk::AccessFlags2::NONE);
        for (stage, access) in to.iter().map(|a| a.scope()) {
            dst_stage |= stage;
            dst_access |= access;
        }
        let barrier = [vk::MemoryBarrier2::default()
            .src_stage_mask(src_stage)
            .src_access_mask(src_access)
            .dst_stage_mask(dst_stage)
            .dst_access_mask(dst_access)];
        let info = vk::DependencyInfo::default().memory_barriers(&barrier);
        unsafe { self.context.device.cmd_pipeline_barrier2(self.cmd, &info) };
    }

    /// Moves a whole image from one layout to another.
    pub fn image_barrier(
        &mut self,
        image: &Image,
        from: (vk::ImageLayout, vk::PipelineStageFlags2, vk::AccessFlags2),
        to: (vk::ImageLayout, vk::PipelineStageFlags2, vk::AccessFlags2),
        aspect: vk::ImageAspectFlags,
    ) {
        let barrier = [vk::ImageMemoryBarrier2::default()
            .image(image.handle)
            .old_layout(from.0)
            .src_stage_mask(from.1)
            .src_access_mask(from.2)
            .new_layout(to.0)
            .dst_stage_mask(to.1)
            .dst_access_mask(to.2)
            .subresource_range(vk::ImageSubresourceRange {
                aspect_mask: aspect,
                base_mip_level: 0,
                level_count: image.mips,
                base_array_layer: 0,
                layer_count: image.layers,
            })];
        let info = vk::DependencyInfo::default().image_memory_barriers(&barrier);
        unsafe { self.context.device.cmd_pipeline_barrier2(self.cmd, &info) };
    }

    pub fn fill_zero(&mut self, buffer: &Buffer, size_bytes: u64) {
        unsafe {
            self.context
                .device
                .cmd_fill_buffer(self.cmd, buffer.handle, 0, size_bytes, 0)
        };
    }

    pub fn copy_buffer(&mut self, from: &Buffer, to: &Buffer, region: vk::BufferCopy) {
        unsafe {
            self.context
                .device
                .cmd_copy_buffer(self.cmd, from.handle, to.handle, &[region])
        };
    }

    pub fn copy_to_image(&mut self, from: &Buffer, to: &Image, regions: &[vk::BufferImageCopy]) {
        unsafe {
            self.context.device.cmd_copy_buffer_to_image(
                self.cmd,
                from.handle,
                to.handle,
                vk::ImageLayout::TRANSFER_DST_OPTIMAL,
                regions,
            )
        };
    }

    /// Fills a colour image in TRANSFER_DST_OPTIMAL with zeros.
    pub fn clear_image(&mut self, image: &Image) {
        let all = vk::ImageSubresourceRange {
            aspect_mask: vk::ImageAspectFlags::COLOR,
            base_mip_level: 0,
            level_count: image.mips,
            base_array_layer: 0,
            layer_count: image.layers,
        };
        unsafe {
            self.context.device.cmd_clear_color_image(
                self.cmd,
                image.handle,
                vk::ImageLayout::TRANSFER_DST_OPTIMAL,
                &vk::ClearColorValue::default(),
                &[all],
            )
        };
    }

    /// Copies rectangles of a colour image in TRANSFER_SRC_OPTIMAL into one in TRANSFER_DST_OPTIMAL: mip of both, from where,
    /// to where, size.
    pub fn copy_image(
        &mut self,
        from: &Image,
        to: &Image,
        rectangles: impl Iterator<Item = (vk::Offset3D, vk::Offset3D, [u32; 2])>,
    ) {
        let regions: Vec<_> = rectangles
            .map(|(src_offset, dst_offset, [width, height])| {
                let layers = vk::ImageSubresourceLayers {
                    aspect_mask: vk::ImageAspectFlags::COLOR,
                    mip_level: 0,
                    base_array_layer: 0,
                    layer_count: 1,
                };
                vk::ImageCopy {
                    src_subresource: layers,
                    src_offset,
                    dst_subresource: layers,
                    dst_offset,
                    extent: vk::Extent3D {
                        width,
                        height,
                        depth: 1,
                    },
                }
            })
            .collect();
        unsafe {
            self.context.device.cmd_copy_image(
                self.cmd,
                from.handle,
                vk::ImageLayout::TRANSFER_SRC_OPTIMAL,
                to.handle,
                vk::ImageLayout::TRANSFER_DST_OPTIMAL,
                &regions,
            )
        };
    }

    /// Copies a single-layer colour image in TRANSFER_SRC_OPTIMAL to the start of a buffer, tightly.
    pub fn copy_from_image(&mut self, from: &Image, to: &Buffer) {
        self.copy_rows_from_image(from, to, from.extent.height);
    }

    /// As `copy_from_image`, but only the first rows.
    pub fn copy_rows_from_image(&mut self, from: &Image, to: &Buffer, rows: u32) {
        self.copy_aspect_from_image(from, to, rows, vk::ImageAspectFlags::COLOR);
    }

    /// As `copy_rows_from_image`, of any aspect.
    pub fn copy_aspect_from_image(
        &mut self,
        from: &Image,
        to: &Buffer,
        rows: u32,
        aspect_mask: vk::ImageAspectFlags,
    ) {
        let region = [vk::BufferImageCopy {
            image_subresource: vk::ImageSubresourceLayers {
                aspect_mask,
                layer_count: 1,
                ..Default::default()
            },
            image_extent: vk::Extent3D {
                width: from.extent.width,
                height: rows,
                depth: 1,
            },
            ..Default::default()
        }];
        unsafe {
            self.context.device.cmd_copy_image_to_buffer(
                self.cmd,
                from.handle,
                vk::ImageLayout::TRANSFER_SRC_OPTIMAL,
                to.handle,
                &region,
            )
        };
    }

    pub fn bind_pipeline(&mut self, point: vk::PipelineBindPoint, pipeline: vk::Pipeline) {
        unsafe {
            self.context
                .device
                .cmd_bind_pipeline(self.cmd, point, pipeline)
        };
    }

    pub fn bind_set(
        &mut self,
        point: vk::PipelineBindPoint,
        layout: vk::PipelineLayout,
        index: u32,
        set: vk::DescriptorSet,
    ) {
        unsafe {
            self.context.device.cmd_bind_descriptor_sets(
                self.cmd,
                point,
                layout,
                index,
                &[set],
                &[],
            )
        };
    }

    pub fn push_constants<T: bytemuck::Pod>(
        &mut self,
        layout: vk::PipelineLayout,
        stages: vk::ShaderStageFlags,
        constants: &T,
    ) {
        unsafe {
            self.context.device.cmd_push_constants(
                self.cmd,
                layout,
                stages,
                0,
                bytemuck::bytes_of(constants),
            )
        };
    }

    pub fn dispatch(&mut self, workgroups: u32) {
        unsafe { self.context.device.cmd_dispatch(self.cmd, workgroups, 1, 1) };
    }

    /// Workgroups along x and y.
    pub fn dispatch_rows(&mut self, workgroups: [u32; 2]) {
        let [x, y] = workgroups;
        unsafe { self.context.device.cmd_dispatch(self.cmd, x, y, 1) };
    }

    /// As many workgroups as three words of a buffer say.
    pub fn dispatch_indirect(&mut self, arguments: &Buffer, offset: u64) {
        unsafe {
            self.context
                .device
                .cmd_dispatch_indirect(self.cmd, arguments.handle, offset)
        };
    }

    /// Begins rendering to a depth image alone, all of it cleared to `far`.
    pub fn begin_depth_rendering(&mut self, depth: &Image, far: f32) {
        let attachment = vk::RenderingAttachmentInfo::default()
            .image_view(depth.view)
            .image_layout(vk::ImageLayout::DEPTH_ATTACHMENT_OPTIMAL)
            .load_op(vk::AttachmentLoadOp::CLEAR)
            .store_op(vk::AttachmentStoreOp::STORE)
            .clear_value(vk::ClearValue {
                depth_stencil: vk::ClearDepthStencilValue {
                    depth: far,
                    stencil: 0,
                },
            });
        let info = vk::RenderingInfo::default()
            .render_area(vk::Rect2D {
                offset: vk::Offset2D::default(),
                extent: depth.extent,
            })
            .layer_count(1)
            .depth_attachment(&attachment);
        unsafe { self.context.device.cmd_begin_rendering(self.cmd, &info) };
    }

    pub fn end_rendering(&mut self) {
        unsafe { self.context.device.cmd_end_rendering(self.cmd) };
    }

    /// Viewport and scissor of a picture.
    pub fn set_viewport(&mut self, offset_px: [u32; 2], size_px: [u32; 2]) {
        let [width, height] = size_px;
        self.set_viewport_in(
            offset_px,
            [width as f32, height as f32],
            vk::Extent2D { width, height },
        );
    }

    /// A viewport that may end within the last pixels of what it is in.
    pub fn set_viewport_in(&mut self, offset_px: [u32; 2], size: [f32; 2], extent: vk::Extent2D) {
        let [x, y] = offset_px;
        let viewport = vk::Viewport {
            x: x as f32,
            y: y as f32,
            width: size[0],
            height: size[1],
            min_depth: 0.0,
            max_depth: 1.0,
        };
        let scissor = vk::Rect2D {
            offset: vk::Offset2D {
                x: x as i32,
                y: y as i32,
            },
            extent,
        };
        unsafe {
            self.context
                .device
                .cmd_set_viewport(self.cmd, 0, &[viewport]);
            self.context.device.cmd_set_scissor(self.cmd, 0, &[scissor]);
        }
    }

    /// Binds an instance list, or transformed vertices, as vertex buffer 0.
    pub fn bind_instances(&mut self, buffer: &Buffer) {
        unsafe {
            self.context
                .device
                .cmd_bind_vertex_buffers(self.cmd, 0, &[buffer.handle], &[0])
        };
    }

    pub fn bind_indices(&mut self, buffer: &Buffer, kind: vk::IndexType) {
        unsafe {
            self.context
                .device
                .cmd_bind_index_buffer(self.cmd, buffer.handle, 0, kind)
        };
    }

    /// One API draw call of `count` sub-draws.
    pub fn draw_indexed_indirect(&mut self, arguments: &Buffer, first: u32, count: u32) {
        let stride = size_of::<vk::DrawIndexedIndirectCommand>() as u32;
        self.draw_calls += 1;
        unsafe {
            self.context.device.cmd_draw_indexed_indirect(
                self.cmd,
                arguments.handle,
                first as u64 * stride as u64,
                count,
                stride,
            )
        };
    }

    /// One draw of a `VkDrawIndirectCommand` at a byte offset.
    pub fn draw_indirect(&mut self, arguments: &Buffer, offset: u64) {
        self.draw_calls += 1;
        unsafe {
            self.context
                .device
                .cmd_draw_indirect(self.cmd, arguments.handle, offset, 1, 0)
        };
    }

    pub fn draw_indexed(&mut self, index_count: u32, first_index: u32, instance: u32) {
        self.draw_calls += 1;
        unsafe {
            self.context
                .device
                .cmd_draw_indexed(self.cmd, index_count, 1, first_index, 0, instance)
        };
    }

    /// One draw of several instances.
    pub fn draw_indexed_instances(
        &mut self,
        first_index: u32,
        index_count: u32,
        instances: std::ops::Range<u32>,
    ) {
        self.draw_calls += 1;
        unsafe {
            self.context.device.cmd_draw_indexed(
                self.cmd,
                index_count,
                instances.len() as u32,
                first_index,
                0,
                instances.start,
            )
        };
    }

    pub fn draw(&mut self, vertex_count: u32, instance_count: u32) {
        self.draw_calls += 1;
        unsafe {
            self.context
                .device
                .cmd_draw(self.cmd, vertex_count, instance_count, 0, 0)
        };
    }

    pub fn reset_queries(&mut self, pool: vk::QueryPool, count: u32) {
        unsafe {
            self.context
                .device
                .cmd_reset_query_pool(self.cmd, pool, 0, count)
        };
    }

    pub fn write_timestamp(&mut self, pool: vk::QueryPool, query: u32) {
        unsafe {
            self.context.device.cmd_write_timestamp2(
                self.cmd,
                vk::PipelineStageFlags2::BOTTOM_OF_PIPE,
                pool,
                query,
            )
        };
    }

    pub fn begin_query(&mut self, pool: vk::QueryPool, query: u32) {
        unsafe {
            self.context.device.cmd_begin_query(
                self.cmd,
                pool,
                query,
                vk::QueryControlFlags::empty(),
            )
        };
    }

    pub fn end_query(&mut self, pool: vk::QueryPool, query: u32) {
        unsafe { self.context.device.cmd_end_query(self.cmd, pool, query) };
    }
}
