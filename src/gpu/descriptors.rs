//! Descriptor sets: their layouts, pools, and what is written to them.

use ash::vk;

use super::bindings::Kind;
use super::context::Context;
use super::memory::{Buffer, Image};
use crate::error::RenderError;

/// A layout with a binding of each kind, numbered from 0.
pub(super) fn set_layout(
    cx: &Context,
    name: &str,
    kinds: &[Kind],
    stages: vk::ShaderStageFlags,
) -> Result<vk::DescriptorSetLayout, RenderError> {
    let bindings: Vec<_> = (0u32..)
        .zip(kinds)
        .map(|(i, kind)| {
            vk::DescriptorSetLayoutBinding::default()
                .binding(i)
                .descriptor_type(kind.descriptor_type())
                .descriptor_count(1)
                .stage_flags(stages)
        })
        .collect();
    let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
    // SAFETY: the context's device is alive.
    let layout = unsafe { cx.device.create_descriptor_set_layout(&info, None) }.map_err(
        RenderError::vulkan(cx.full_name(name), "vkCreateDescriptorSetLayout"),
    )?;
    cx.set_name(layout, name);
    Ok(layout)
}

/// A pool for `sets` sets with room for `buffers` storage buffers and as many texel buffers, as many uniform buffers as
/// sets, and the images and samplers of a character or the gallery per set.
pub(crate) fn descriptor_pool(
    cx: &Context,
    name: &str,
    sets: u32,
    buffers: u32,
) -> Result<vk::DescriptorPool, RenderError> {
    let sizes = [
        (vk::DescriptorType::UNIFORM_BUFFER, sets),
        (vk::DescriptorType::STORAGE_BUFFER, buffers.max(1)),
        (vk::DescriptorType::UNIFORM_TEXEL_BUFFER, buffers.max(1)),
        (vk::DescriptorType::SAMPLED_IMAGE, 4 * sets),
        (vk::DescriptorType::SAMPLER, 2 * sets),
    ]
    .map(|(ty, count)| vk::DescriptorPoolSize {
        ty,
        descriptor_count: count,
    });
    let info = vk::DescriptorPoolCreateInfo::default()
        .max_sets(sets)
        .pool_sizes(&sizes);
    // SAFETY: the context's device is alive.
    let pool = unsafe { cx.device.create_descriptor_pool(&info, None) }.map_err(
        RenderError::vulkan(cx.full_name(name), "vkCreateDescriptorPool"),
    )?;
    cx.set_name(pool, name);
    Ok(pool)
}

/// One set of a pool.
pub(crate) fn allocate_set(
    cx: &Context,
    name: &str,
    pool: vk::DescriptorPool,
    layout: vk::DescriptorSetLayout,
) -> Result<vk::DescriptorSet, RenderError> {
    let layouts = [layout];
    let info = vk::DescriptorSetAllocateInfo::default()
        .descriptor_pool(pool)
        .set_layouts(&layouts);
    // SAFETY: pool and layout are alive, and only the renderer, which is borrowed, uses the pool.
    let set = unsafe { cx.device.allocate_descriptor_sets(&info) }.map_err(RenderError::vulkan(
        cx.full_name(name),
        "vkAllocateDescriptorSets",
    ))?[0];
    cx.set_name(set, name);
    Ok(set)
}

/// Writes buffers to a set's bindings from 0 up.
pub(crate) fn write_buffers(cx: &Context, set: vk::DescriptorSet, buffers: &[(Kind, &Buffer)]) {
    let infos: Vec<_> = buffers
        .iter()
        .map(|(_, buffer)| {
            [vk::DescriptorBufferInfo {
                buffer: buffer.handle,
                offset: 0,
                range: vk::WHOLE_SIZE,
            }]
        })
        .collect();
    let views: Vec<_> = buffers.iter().map(|(_, buffer)| [buffer.view]).collect();
    let writes: Vec<_> = (0u32..)
        .zip(buffers.iter().zip(infos.iter().zip(&views)))
        .map(|(i, (&(kind, _), (info, view)))| {
            let write = vk::WriteDescriptorSet::default()
                .dst_set(set)
                .dst_binding(i)
                .descriptor_type(kind.descriptor_type());
            match kind {
                Kind::Texels => write.texel_buffer_view(view),
                _ => write.buffer_info(info),
            }
        })
        .collect();
    // SAFETY: buffers are alive; no pending command uses the set (`begin_frame`'s contract, or the set is new).
    unsafe { cx.device.update_descriptor_sets(&writes, &[]) };
}

/// Writes images and samplers, each in their order, to where `kinds` has them.
pub(crate) fn write_images(
    cx: &Context,
    set: vk::DescriptorSet,
    kinds: &[Kind],
    images: &[Image],
    samplers: &[vk::Sampler],
) {
    let mut images = images.iter().map(|image| image.view);
    let mut samplers = samplers.iter().copied();
    let infos: Vec<_> = (0u32..)
        .zip(kinds)
        .filter_map(|(binding, kind)| {
            let (sampler, view) = match kind {
                Kind::Image => (None, images.next()),
                Kind::Sampler => (samplers.next(), None),
                Kind::Uniform | Kind::Storage | Kind::Texels => return None,
            };
            let info = vk::DescriptorImageInfo {
                sampler: sampler.unwrap_or_default(),
                image_view: view.unwrap_or_default(),
                image_layout: vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL,
            };
            Some((binding, kind.descriptor_type(), [info]))
        })
        .collect();
    let writes: Vec<_> = infos
        .iter()
        .map(|(binding, ty, info)| {
            vk::WriteDescriptorSet::default()
                .dst_set(set)
                .dst_binding(*binding)
                .descriptor_type(*ty)
                .image_info(info)
        })
        .collect();
    // SAFETY: views and samplers are alive; the set is new.
    unsafe { cx.device.update_descriptor_sets(&writes, &[]) };
}
