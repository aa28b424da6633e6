//! Everything that the library asks of a device, in one place. A host enables what [`Features`] lists.

use std::ffi::CStr;

use ash::vk;

use super::bindings::{Kind, SELECT_STORAGE};
use crate::error::RenderError;
use crate::gpu_types::SCAN_GROUP_SIZE;

/// Vulkan version of instance and device.
pub const API_VERSION: u32 = vk::API_VERSION_1_3;

/// Feature structs with exactly the required features on, to chain into a `VkDeviceCreateInfo`.
#[derive(Debug, Clone, Copy)]
pub struct Features {
    /// Core features.
    pub core: vk::PhysicalDeviceFeatures,
    /// `dynamicRendering` and `synchronization2`.
    pub vulkan13: vk::PhysicalDeviceVulkan13Features<'static>,
}

/// Features that the library does without where a device has not got them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct OptionalFeatures {
    /// `pipelineStatisticsQuery`: reports count vertex-shader runs.
    pub pipeline_statistics: bool,
    /// `textureCompressionBC`: impostors' pictures that were baked in blocks stay in them, and take a quarter of the memory.
    pub block_textures: bool,
}

impl OptionalFeatures {
    /// Those of them that a device has.
    pub fn among(core: &vk::PhysicalDeviceFeatures) -> Self {
        Self {
            pipeline_statistics: core.pipeline_statistics_query == vk::TRUE,
            block_textures: core.texture_compression_bc == vk::TRUE,
        }
    }
}

/// The features that a host has to enable, and those of the optional ones that it likes to.
pub fn features(optional: OptionalFeatures) -> Features {
    Features {
        core: vk::PhysicalDeviceFeatures::default()
            .image_cube_array(true)
            .multi_draw_indirect(true)
            .draw_indirect_first_instance(true)
            .pipeline_statistics_query(optional.pipeline_statistics)
            .texture_compression_bc(optional.block_textures),
        vulkan13: vk::PhysicalDeviceVulkan13Features::default()
            .dynamic_rendering(true)
            .synchronization2(true),
    }
}

/// Limits and options of a device that the library adapts to.
#[derive(Debug, Clone)]
pub(crate) struct Capabilities {
    pub device: String,
    pub driver: String,
    pub storage_range: u64,
    pub texel_count: u64,
    pub image_size: u32,
    pub image_layers: u32,
    pub draw_indirect_count: u32,
    pub workgroups: u32,
    pub timestamp_ns: Option<f64>,
    /// A CPU driver.
    pub software: bool,
}

impl Capabilities {
    /// Texel buffers hold sixteen million entries of instance lists, which are the largest; Vulkan only promises 65,536 texels.
    pub fn reads_texels(&self) -> bool {
        self.texel_count >= 1 << 26
    }
}

/// How many storage buffers a set binds.
fn storage_buffers(set: &[Kind]) -> u32 {
    set.iter().filter(|k| **k == Kind::Storage).count() as u32
}

/// Checks `physical_device` against everything the library needs.
///
/// Errors: [`RenderError::MissingFeature`] with the first thing that is missing.
pub(crate) fn check(
    instance: &ash::Instance,
    physical_device: vk::PhysicalDevice,
    queue_family: u32,
    color_format: vk::Format,
    depth_format: vk::Format,
) -> Result<Capabilities, RenderError> {
    let mut driver = vk::PhysicalDeviceDriverProperties::default();
    let mut subgroups = vk::PhysicalDeviceSubgroupProperties::default();
    let mut properties = vk::PhysicalDeviceProperties2::default()
        .push_next(&mut driver)
        .push_next(&mut subgroups);
    let mut vulkan13 = vk::PhysicalDeviceVulkan13Features::default();
    let mut features = vk::PhysicalDeviceFeatures2::default();
    // SAFETY: the caller's promise in `Renderer::new` is that instance and physical device are alive.
    let families = unsafe {
        instance.get_physical_device_properties2(physical_device, &mut properties);
        instance.get_physical_device_queue_family_properties(physical_device)
    };
    let p = properties.properties;
    let device = text(&p.device_name);
    let missing = |feature: &str, needed_for: &str| RenderError::MissingFeature {
        device: device.clone(),
        feature: feature.into(),
        needed_for: needed_for.into(),
    };
    if p.api_version < API_VERSION {
        return Err(missing("Vulkan 1.3", "everything"));
    }
    features = features.push_next(&mut vulkan13);
    // SAFETY: as above.
    unsafe { instance.get_physical_device_features2(physical_device, &mut features) };
    let core = features.features;
    for (there, feature, needed_for) in [
        (
            core.multi_draw_indirect,
            "multiDrawIndirect",
            "one draw call per submesh",
        ),
        (
            core.image_cube_array,
            "imageCubeArray",
            "the view cells of impostors",
        ),
        (
            core.draw_indirect_first_instance,
            "drawIndirectFirstInstance",
            "instance lists",
        ),
        (
            vulkan13.dynamic_rendering,
            "dynamicRendering",
            "drawing into the host's targets",
        ),
        (vulkan13.synchronization2, "synchronization2", "barriers"),
    ] {
        if there == vk::FALSE {
            return Err(missing(feature, needed_for));
        }
    }
    let sums = vk::SubgroupFeatureFlags::ARITHMETIC | vk::SubgroupFeatureFlags::BALLOT;
    if !(subgroups.supported_operations.contains(sums)
        && subgroups
            .supported_stages
            .contains(vk::ShaderStageFlags::COMPUTE))
    {
        return Err(missing("subgroup sums and ballots in compute", "select"));
    }
    // A lane for each counter.
    if subgroups.subgroup_size < 4 {
        return Err(missing("subgroups of at least 4", "select"));
    }
    let l = &p.limits;
    for (has, needs, limit, needed_for) in [
        (
            l.max_per_stage_descriptor_storage_buffers,
            storage_buffers(SELECT_STORAGE),
            "maxPerStageDescriptorStorageBuffers",
            "select",
        ),
        (
            l.max_compute_work_group_invocations,
            SCAN_GROUP_SIZE,
            "maxComputeWorkGroupInvocations",
            "select",
        ),
        (
            l.max_compute_work_group_size[0],
            SCAN_GROUP_SIZE,
            "maxComputeWorkGroupSize",
            "select",
        ),
        (
            l.max_bound_descriptor_sets,
            3,
            "maxBoundDescriptorSets",
            "mesh",
        ),
    ] {
        if has < needs {
            return Err(missing(
                &format!("{limit} of at least {needs} (it has {has})"),
                needed_for,
            ));
        }
    }
    let sampled = vk::FormatFeatureFlags::SAMPLED_IMAGE | vk::FormatFeatureFlags::TRANSFER_DST;
    for (format, wants, needed_for) in [
        (
            vk::Format::R8G8B8A8_UNORM,
            sampled | vk::FormatFeatureFlags::SAMPLED_IMAGE_FILTER_LINEAR,
            "the texture array",
        ),
        (
            color_format,
            vk::FormatFeatureFlags::COLOR_ATTACHMENT_BLEND,
            "the colour target",
        ),
        (
            depth_format,
            vk::FormatFeatureFlags::DEPTH_STENCIL_ATTACHMENT,
            "the depth target",
        ),
        (
            super::occluders::DEPTH,
            vk::FormatFeatureFlags::DEPTH_STENCIL_ATTACHMENT
                | vk::FormatFeatureFlags::SAMPLED_IMAGE,
            "the occluders' depth",
        ),
    ] {
        // SAFETY: as above.
        let has =
            unsafe { instance.get_physical_device_format_properties(physical_device, format) };
        if !has.optimal_tiling_features.contains(wants) {
            return Err(missing(
                &format!("format {format:?} as {wants:?}"),
                needed_for,
            ));
        }
    }
    let Some(family) = families.get(queue_family as usize) else {
        return Err(missing(
            &format!("queue family {queue_family}"),
            "everything",
        ));
    };
    if !family
        .queue_flags
        .contains(vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE)
    {
        return Err(missing(
            "graphics and compute on the host's queue family",
            "everything",
        ));
    }
    let driver_name = text(&driver.driver_name);
    let driver_info = text(&driver.driver_info);
    Ok(Capabilities {
        device,
        driver: format!("{driver_name} {driver_info}"),
        texel_count: l.max_texel_buffer_elements as u64,
        storage_range: l.max_storage_buffer_range as u64,
        image_size: l.max_image_dimension2_d,
        image_layers: l.max_image_array_layers,
        draw_indirect_count: l.max_draw_indirect_count,
        workgroups: l.max_compute_work_group_count[0],
        timestamp_ns: (family.timestamp_valid_bits > 0 && l.timestamp_period > 0.0)
            .then_some(l.timestamp_period as f64),
        software: p.device_type == vk::PhysicalDeviceType::CPU,
    })
}

/// A C string in a fixed array.
pub(crate) fn text(array: &[std::ffi::c_char]) -> String {
    let bytes: &[u8] = bytemuck::cast_slice(array);
    CStr::from_bytes_until_nul(bytes)
        .map(|s| s.to_string_lossy().into_owned())
        .unwrap_or_default()
}
