//! Compiled modules as the stages of pipelines, and pipelines of one compute stage.

use std::ffi::CStr;

use ash::vk;

use super::bindings::{Kind, STORAGE_SUFFIX};
use super::context::Context;
use super::record_buffers;
use super::shaders::{MODULES, Module};
use crate::error::RenderError;

/// Entry point of every module.
const MAIN: &CStr = c"main";

/// What `make` makes of a vertex module and, where there is one, a fragment module, which only live so long.
pub(super) fn with_stages(
    cx: &Context,
    modules: &[&str],
    specialization: &vk::SpecializationInfo,
    make: impl FnOnce(&[vk::PipelineShaderStageCreateInfo]) -> Result<vk::Pipeline, RenderError>,
) -> Result<vk::Pipeline, RenderError> {
    let kinds = [vk::ShaderStageFlags::VERTEX, vk::ShaderStageFlags::FRAGMENT];
    let mut stages = Vec::new();
    let mut made = Ok(vk::Pipeline::null());
    for (name, kind) in modules.iter().zip(kinds) {
        match shader(cx, name) {
            Ok(module) => stages.push(stage(module, kind, specialization)),
            Err(e) => made = Err(e),
        }
    }
    if made.is_ok() {
        made = make(&stages);
    }
    for stage in stages {
        // SAFETY: modules may go once the pipeline is made.
        unsafe { cx.device.destroy_shader_module(stage.module, None) };
    }
    made
}

fn stage<'a>(
    module: vk::ShaderModule,
    stage: vk::ShaderStageFlags,
    specialization: &'a vk::SpecializationInfo<'a>,
) -> vk::PipelineShaderStageCreateInfo<'a> {
    vk::PipelineShaderStageCreateInfo::default()
        .stage(stage)
        .module(module)
        .name(MAIN)
        .specialization_info(specialization)
}

/// A compiled module; where texel buffers are small, the one that reads storage buffers in their place, if there is one.
fn shader(cx: &Context, name: &str) -> Result<vk::ShaderModule, RenderError> {
    let find = |name: &str| MODULES.iter().find(|m: &&Module| m.name == name);
    let storage = match record_buffers::kind(cx) {
        Kind::Storage => find(&format!("{name}{STORAGE_SUFFIX}")),
        _ => None,
    };
    let spirv = storage.or_else(|| find(name)).map_or(&[][..], |m| m.spirv);
    let info = vk::ShaderModuleCreateInfo::default().code(spirv);
    // SAFETY: build.rs compiled the words for this Vulkan version; spirv-val checks them in the tests.
    unsafe { cx.device.create_shader_module(&info, None) }.map_err(RenderError::vulkan(
        cx.full_name(name),
        "vkCreateShaderModule",
    ))
}

pub(super) fn compute(
    cx: &Context,
    name: &str,
    layout: vk::PipelineLayout,
) -> Result<vk::Pipeline, RenderError> {
    let module = shader(cx, name)?;
    let info = vk::ComputePipelineCreateInfo::default()
        .stage(
            vk::PipelineShaderStageCreateInfo::default()
                .stage(vk::ShaderStageFlags::COMPUTE)
                .module(module)
                .name(MAIN),
        )
        .layout(layout);
    // SAFETY: module and layout are alive; the module may go once the pipeline is made.
    let made = unsafe {
        let made = cx
            .device
            .create_compute_pipelines(vk::PipelineCache::null(), &[info], None);
        cx.device.destroy_shader_module(module, None);
        made
    };
    let pipeline = made.map_err(|(_, e)| RenderError::Vulkan {
        object: cx.full_name(name),
        call: "vkCreateComputePipelines",
        source: e,
    })?[0];
    cx.set_name(pipeline, name);
    Ok(pipeline)
}
