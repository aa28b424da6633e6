//! Pipeline layouts and pipelines of all stages.

use std::collections::HashMap;
use std::mem::offset_of;

use ash::vk;

use super::bindings;
use super::context::Context;
use super::descriptors::set_layout;
use super::record_buffers;
use super::renderer::RendererDesc;
use super::shader_stages::{compute, with_stages};
use crate::error::RenderError;
use crate::gpu_types::{DrawConstants, Instance};
use crate::impostor;

/// What a mesh pipeline is specialised for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct MeshVariant {
    pub textured: bool,
    pub double_sided: bool,
    pub alpha_tested: bool,
    /// Many agents to an instance.
    pub packed: bool,
}

/// Specialisation constants by id, as hlsl/ numbers them.
pub(super) const ALPHA_TESTED: u32 = 0;
pub(super) const SRGB_TARGET: u32 = 1;
const REVERSED_DEPTH: u32 = 2;
pub(super) const TEXTURED: u32 = 3;

/// Stages that see a draw's push constants.
pub(crate) const DRAW_STAGES: vk::ShaderStageFlags = vk::ShaderStageFlags::from_raw(
    vk::ShaderStageFlags::VERTEX.as_raw() | vk::ShaderStageFlags::FRAGMENT.as_raw(),
);

/// Everything that is made once for a renderer.
#[derive(Default)]
pub(crate) struct Pipelines {
    pub select_set: vk::DescriptorSetLayout,
    pub draw_set: vk::DescriptorSetLayout,
    pub character_set: vk::DescriptorSetLayout,
    pub gallery_set: vk::DescriptorSetLayout,
    pub probe_set: vk::DescriptorSetLayout,
    pub select_layout: vk::PipelineLayout,
    pub draw_layout: vk::PipelineLayout,
    pub probe_layout: vk::PipelineLayout,
    pub count: vk::Pipeline,
    pub scan: vk::Pipeline,
    pub scatter: vk::Pipeline,
    /// The count pass of agents that nobody hides.
    pub count_unhidden: vk::Pipeline,
    pub count_occluders: vk::Pipeline,
    pub reduce_set: vk::DescriptorSetLayout,
    pub reduce_layout: vk::PipelineLayout,
    pub reduce: vk::Pipeline,
    pub reduce_top: vk::Pipeline,
    /// The depth of occluders, and of those of which both faces are drawn.
    pub occluders: [vk::Pipeline; 2],
    pub mesh_probe: vk::Pipeline,
    pub impostor_probe: vk::Pipeline,
    pub impostor_soft_probe: vk::Pipeline,
    impostor_flat: vk::Pipeline,
    impostor_soft: vk::Pipeline,
    impostor_plain: vk::Pipeline,
    pub ground: vk::Pipeline,
    pub shadow: vk::Pipeline,
    pub sky: vk::Pipeline,
    /// Of a picture that repeats and has mips.
    pub sampler: vk::Sampler,
    /// Of pictures without mips.
    pub nearest_sampler: vk::Sampler,
    pub linear_sampler: vk::Sampler,
    mesh: HashMap<MeshVariant, vk::Pipeline>,
    formats: Formats,
}

#[derive(Debug, Clone, Copy, Default)]
struct Formats {
    color: vk::Format,
    depth: vk::Format,
    reversed_depth: bool,
}

impl Formats {
    fn srgb(&self) -> bool {
        use vk::Format as F;
        [F::R8G8B8A8_SRGB, F::B8G8R8A8_SRGB, F::A8B8G8R8_SRGB_PACK32].contains(&self.color)
    }
}

/// How a graphics pipeline differs from the others.
pub(super) struct DrawState<'a> {
    pub name: &'a str,
    /// Vertex shader, and fragment shader where it draws more than depth.
    pub modules: &'a [&'a str],
    pub input: Input,
    pub constants: &'a [(u32, bool)],
    pub cull: vk::CullModeFlags,
    pub topology: vk::PrimitiveTopology,
    pub depth_write: bool,
    pub mix: Mix,
}

/// What a vertex shader reads as attributes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Input {
    None,
    /// An entry of an instance list.
    Instances,
    /// A contact shadow.
    Shadows,
    /// This many of the rows of a transformed vertex, of which it has `of`; the sixth is integers.
    Rows {
        read: u32,
        of: u32,
    },
}

/// How a draw's colour meets the target's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mix {
    Replaces,
    /// The target keeps the darker of what it has and gets, channel by channel, and its alpha.
    Darkens,
    /// Over it, premultiplied with alpha.
    Covers,
}

impl Input {
    fn description(
        self,
    ) -> (
        Vec<vk::VertexInputBindingDescription>,
        Vec<vk::VertexInputAttributeDescription>,
    ) {
        let binding = |stride, input_rate| {
            vec![vk::VertexInputBindingDescription {
                binding: 0,
                stride,
                input_rate,
            }]
        };
        match self {
            Self::None => (Vec::new(), Vec::new()),
            Self::Instances => (
                binding(size_of::<Instance>() as u32, vk::VertexInputRate::INSTANCE),
                instance_attributes().to_vec(),
            ),
            Self::Shadows => (
                binding(16, vk::VertexInputRate::INSTANCE),
                vec![vk::VertexInputAttributeDescription {
                    format: vk::Format::R32G32B32A32_SFLOAT,
                    ..Default::default()
                }],
            ),
            Self::Rows { read, of } => (
                binding(16 * of, vk::VertexInputRate::VERTEX),
                (0..read)
                    .map(|location| vk::VertexInputAttributeDescription {
                        location,
                        binding: 0,
                        format: vk::Format::R32G32B32A32_SFLOAT,
                        offset: 16 * location,
                    })
                    .collect(),
            ),
        }
    }
}

impl Pipelines {
    pub fn new(cx: &Context, desc: &RendererDesc) -> Result<Self, RenderError> {
        let mut p = Self {
            formats: Formats {
                color: desc.color_format,
                depth: desc.depth_format,
                reversed_depth: desc.reversed_depth,
            },
            ..Default::default()
        };
        match p.fill(cx) {
            Ok(()) => Ok(p),
            Err(e) => {
                p.destroy(cx);
                Err(e)
            }
        }
    }

    fn fill(&mut self, cx: &Context) -> Result<(), RenderError> {
        use vk::ShaderStageFlags as S;
        let draws = S::VERTEX | S::FRAGMENT | S::COMPUTE;
        let (select, draw, character, gallery) = match record_buffers::kind(cx) {
            bindings::Kind::Texels => (
                bindings::SELECT,
                bindings::DRAW,
                bindings::CHARACTER,
                bindings::GALLERY,
            ),
            _ => (
                bindings::SELECT_STORAGE,
                bindings::DRAW_STORAGE,
                bindings::CHARACTER_STORAGE,
                bindings::GALLERY_STORAGE,
            ),
        };
        self.select_set = set_layout(cx, "select", select, S::COMPUTE)?;
        self.draw_set = set_layout(cx, "draw", draw, draws)?;
        self.character_set = set_layout(cx, "character", character, draws)?;
        self.gallery_set = set_layout(cx, "impostors", gallery, draws)?;
        self.probe_set = set_layout(cx, "probe", bindings::PROBE, S::COMPUTE)?;
        let constants = size_of::<DrawConstants>() as u32;
        self.select_layout = pipeline_layout(cx, "select", &[self.select_set], None)?;
        self.draw_layout = pipeline_layout(
            cx,
            "draw",
            &[self.draw_set, self.character_set, self.gallery_set],
            Some((DRAW_STAGES, constants)),
        )?;
        self.probe_layout = pipeline_layout(
            cx,
            "probe",
            &[
                self.draw_set,
                self.character_set,
                self.gallery_set,
                self.probe_set,
            ],
            Some((S::COMPUTE, constants)),
        )?;
        for (to, name) in [
            (&mut self.count, "select_count"),
            (&mut self.scan, "select_scan"),
            (&mut self.scatter, "select_scatter"),
            (&mut self.count_unhidden, "select_count_unhidden"),
            (&mut self.count_occluders, "select_count_occluders"),
        ] {
            *to = compute(cx, name, self.select_layout)?;
        }
        self.reduce_set = set_layout(cx, "reduce", bindings::REDUCE, S::COMPUTE)?;
        self.reduce_layout = pipeline_layout(cx, "reduce", &[self.reduce_set], None)?;
        self.reduce = compute(cx, "occlude_reduce", self.reduce_layout)?;
        self.reduce_top = compute(cx, "occlude_reduce_top", self.reduce_layout)?;
        for (i, cull) in [vk::CullModeFlags::BACK, vk::CullModeFlags::NONE]
            .into_iter()
            .enumerate()
        {
            self.occluders[i] = self.graphics(
                cx,
                &DrawState {
                    name: "occluders",
                    modules: &["occlude_vs"],
                    input: Input::Instances,
                    constants: &[],
                    cull,
                    topology: vk::PrimitiveTopology::TRIANGLE_LIST,
                    depth_write: true,
                    mix: Mix::Replaces,
                },
            )?;
        }
        self.mesh_probe = compute(cx, "mesh_probe", self.probe_layout)?;
        self.impostor_probe = compute(cx, "impostor_probe", self.probe_layout)?;
        self.impostor_soft_probe = compute(cx, "impostor_soft_probe", self.probe_layout)?;
        let srgb = (SRGB_TARGET, self.formats.srgb());
        let impostor = DrawState {
            name: "impostor",
            modules: &["impostor_vs", "impostor_ps"],
            input: Input::Instances,
            constants: &[srgb],
            cull: vk::CullModeFlags::NONE,
            topology: vk::PrimitiveTopology::TRIANGLE_LIST,
            depth_write: true,
            mix: Mix::Covers,
        };
        self.impostor_flat = self.graphics(cx, &impostor)?;
        self.impostor_soft = self.graphics(
            cx,
            &DrawState {
                name: "impostor soft",
                modules: &["impostor_soft_vs", "impostor_soft_ps"],
                input: Input::None,
                ..impostor
            },
        )?;
        self.impostor_plain = self.graphics(
            cx,
            &DrawState {
                name: "impostor plain",
                modules: &["impostor_plain_vs", "impostor_plain_ps"],
                input: Input::None,
                ..impostor
            },
        )?;
        self.ground = self.graphics(
            cx,
            &DrawState {
                name: "ground",
                modules: &["ground_vs", "ground_ps"],
                input: Input::None,
                constants: &[srgb],
                cull: vk::CullModeFlags::NONE,
                topology: vk::PrimitiveTopology::TRIANGLE_LIST,
                depth_write: true,
                mix: Mix::Replaces,
            },
        )?;
        self.shadow = self.graphics(
            cx,
            &DrawState {
                name: "shadow",
                modules: &["shadow_vs", "shadow_ps"],
                input: Input::Shadows,
                constants: &[srgb],
                cull: vk::CullModeFlags::NONE,
                topology: vk::PrimitiveTopology::TRIANGLE_STRIP,
                depth_write: false,
                mix: Mix::Darkens,
            },
        )?;
        self.sky = self.graphics(
            cx,
            &DrawState {
                name: "sky",
                modules: &["sky_vs", "sky_ps"],
                input: Input::None,
                constants: &[srgb, (REVERSED_DEPTH, self.formats.reversed_depth)],
                cull: vk::CullModeFlags::NONE,
                topology: vk::PrimitiveTopology::TRIANGLE_LIST,
                depth_write: false,
                mix: Mix::Replaces,
            },
        )?;
        use vk::Filter as F;
        let (nearest, linear) = (&mut self.nearest_sampler, &mut self.linear_sampler);
        for (to, name, filter, has_mips) in [
            (&mut self.sampler, "sampler of mips", F::LINEAR, true),
            (nearest, "nearest sampler", F::NEAREST, false),
            (linear, "linear sampler", F::LINEAR, false),
        ] {
            *to = sampler(cx, name, filter, has_mips)?;
        }
        Ok(())
    }

    /// Makes a variant where it does not exist yet.
    pub fn add_mesh(&mut self, cx: &Context, variant: MeshVariant) -> Result<(), RenderError> {
        if self.mesh.contains_key(&variant) {
            return Ok(());
        }
        let name = format!(
            "mesh{}{}{}{}",
            if variant.textured { " textured" } else { "" },
            if variant.double_sided {
                " double-sided"
            } else {
                ""
            },
            if variant.alpha_tested {
                " alpha-tested"
            } else {
                ""
            },
            if variant.packed { " packed" } else { "" },
        );
        let module = match (variant.textured, variant.double_sided) {
            (false, false) => "mesh",
            (true, false) => "mesh_textured",
            (false, true) => "mesh_double",
            (true, true) => "mesh_textured_double",
        };
        let packed = if variant.packed { "_packed" } else { "" };
        let pipeline = self.graphics(
            cx,
            &DrawState {
                name: &name,
                modules: &[&format!("{module}{packed}_vs"), &format!("{module}_ps")],
                input: match variant.packed {
                    true => Input::None,
                    false => Input::Instances,
                },
                constants: &[
                    (ALPHA_TESTED, variant.alpha_tested),
                    (SRGB_TARGET, self.formats.srgb()),
                ],
                cull: if variant.double_sided {
                    vk::CullModeFlags::NONE
                } else {
                    vk::CullModeFlags::BACK
                },
                topology: vk::PrimitiveTopology::TRIANGLE_LIST,
                depth_write: true,
                mix: Mix::Replaces,
            },
        )?;
        self.mesh.insert(variant, pipeline);
        Ok(())
    }

    /// The target's format encodes colours.
    pub fn encodes_srgb(&self) -> bool {
        self.formats.srgb()
    }

    /// Near is depth 1.
    pub fn reversed_depth(&self) -> bool {
        self.formats.reversed_depth
    }

    /// The pipeline of a variant that `add_mesh` made.
    pub fn mesh(&self, variant: MeshVariant) -> vk::Pipeline {
        self.mesh.get(&variant).copied().unwrap_or_default()
    }

    pub fn impostor(&self, look: impostor::Look) -> vk::Pipeline {
        match look {
            impostor::Look::Plain => self.impostor_plain,
            impostor::Look::Soft => self.impostor_soft,
            impostor::Look::Flat => self.impostor_flat,
        }
    }

    pub(super) fn graphics(
        &self,
        cx: &Context,
        state: &DrawState,
    ) -> Result<vk::Pipeline, RenderError> {
        let entries: Vec<_> = (0..state.constants.len())
            .map(|i| {
                vk::SpecializationMapEntry::default()
                    .constant_id(state.constants[i].0)
                    .offset(4 * i as u32)
                    .size(4)
            })
            .collect();
        let values: Vec<u32> = state.constants.iter().map(|c| c.1 as u32).collect();
        let specialization = vk::SpecializationInfo::default()
            .map_entries(&entries)
            .data(bytemuck::cast_slice(&values));
        with_stages(cx, state.modules, &specialization, |stages| {
            self.graphics_from_stages(cx, state, stages)
        })
    }

    fn graphics_from_stages(
        &self,
        cx: &Context,
        state: &DrawState,
        stages: &[vk::PipelineShaderStageCreateInfo],
    ) -> Result<vk::Pipeline, RenderError> {
        let (bindings, attributes) = state.input.description();
        let vertex_input = vk::PipelineVertexInputStateCreateInfo::default()
            .vertex_binding_descriptions(&bindings)
            .vertex_attribute_descriptions(&attributes);
        let assembly = vk::PipelineInputAssemblyStateCreateInfo::default().topology(state.topology);
        let viewport = vk::PipelineViewportStateCreateInfo::default()
            .viewport_count(1)
            .scissor_count(1);
        let raster = vk::PipelineRasterizationStateCreateInfo::default()
            .polygon_mode(vk::PolygonMode::FILL)
            .cull_mode(state.cull)
            .front_face(vk::FrontFace::COUNTER_CLOCKWISE)
            .line_width(1.0);
        let multisample = vk::PipelineMultisampleStateCreateInfo::default()
            .rasterization_samples(vk::SampleCountFlags::TYPE_1);
        let depth = vk::PipelineDepthStencilStateCreateInfo::default()
            .depth_test_enable(true)
            .depth_write_enable(state.depth_write)
            .depth_compare_op(if self.formats.reversed_depth {
                vk::CompareOp::GREATER_OR_EQUAL
            } else {
                vk::CompareOp::LESS_OR_EQUAL
            });
        let attachment = [vk::PipelineColorBlendAttachmentState::default()
            .color_write_mask(vk::ColorComponentFlags::RGBA)
            .blend_enable(state.mix != Mix::Replaces)
            .color_blend_op(match state.mix {
                Mix::Darkens => vk::BlendOp::MIN,
                Mix::Replaces | Mix::Covers => vk::BlendOp::ADD,
            })
            .src_color_blend_factor(vk::BlendFactor::ONE)
            .dst_color_blend_factor(match state.mix {
                Mix::Covers => vk::BlendFactor::ONE_MINUS_SRC_ALPHA,
                Mix::Replaces | Mix::Darkens => vk::BlendFactor::ONE,
            })
            .src_alpha_blend_factor(vk::BlendFactor::ZERO)
            .dst_alpha_blend_factor(vk::BlendFactor::ONE)];
        let depth_only = state.modules.len() == 1;
        let colors = if depth_only { 0 } else { 1 };
        let blend =
            vk::PipelineColorBlendStateCreateInfo::default().attachments(&attachment[..colors]);
        let dynamic = vk::PipelineDynamicStateCreateInfo::default()
            .dynamic_states(&[vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR]);
        let formats = [self.formats.color];
        let mut rendering = vk::PipelineRenderingCreateInfo::default()
            .color_attachment_formats(&formats[..colors])
            .depth_attachment_format(if depth_only {
                super::occluders::DEPTH
            } else {
                self.formats.depth
            });
        let info = vk::GraphicsPipelineCreateInfo::default()
            .stages(stages)
            .vertex_input_state(&vertex_input)
            .input_assembly_state(&assembly)
            .viewport_state(&viewport)
            .rasterization_state(&raster)
            .multisample_state(&multisample)
            .depth_stencil_state(&depth)
            .color_blend_state(&blend)
            .dynamic_state(&dynamic)
            .layout(self.draw_layout)
            .push_next(&mut rendering);
        // SAFETY: every handle in the description is alive.
        let made = unsafe {
            cx.device
                .create_graphics_pipelines(vk::PipelineCache::null(), &[info], None)
        };
        let pipeline = made.map_err(|(_, e)| RenderError::Vulkan {
            object: cx.full_name(state.name),
            call: "vkCreateGraphicsPipelines",
            source: e,
        })?[0];
        cx.set_name(pipeline, state.name);
        Ok(pipeline)
    }

    /// Destroys everything; no pending command may use any of it.
    pub fn destroy(&mut self, cx: &Context) {
        // SAFETY: the caller's promise; null handles are ignored, and each is destroyed once because all are taken.
        unsafe {
            let d = &cx.device;
            for (_, pipeline) in self.mesh.drain() {
                d.destroy_pipeline(pipeline, None);
            }
            for pipeline in [
                self.count,
                self.scan,
                self.scatter,
                self.count_unhidden,
                self.count_occluders,
                self.reduce,
                self.reduce_top,
                self.occluders[0],
                self.occluders[1],
                self.mesh_probe,
                self.impostor_probe,
                self.impostor_soft_probe,
                self.impostor_flat,
                self.impostor_soft,
                self.impostor_plain,
                self.ground,
                self.shadow,
                self.sky,
            ] {
                d.destroy_pipeline(pipeline, None);
            }
            d.destroy_sampler(self.sampler, None);
            d.destroy_sampler(self.nearest_sampler, None);
            d.destroy_sampler(self.linear_sampler, None);
            for layout in [
                self.select_layout,
                self.reduce_layout,
                self.draw_layout,
                self.probe_layout,
            ] {
                d.destroy_pipeline_layout(layout, None);
            }
            for set in [
                self.select_set,
                self.reduce_set,
                self.draw_set,
                self.character_set,
                self.gallery_set,
                self.probe_set,
            ] {
                d.destroy_descriptor_set_layout(set, None);
            }
        }
        *self = Self::default();
    }
}

/// The four attributes of hlsl/mesh.hlsl's `InstanceAttributes`: 16 bytes each.
fn instance_attributes() -> [vk::VertexInputAttributeDescription; 4] {
    use vk::Format as F;
    [
        (offset_of!(Instance, position), F::R32G32B32A32_SFLOAT),
        (offset_of!(Instance, tint_seed), F::R32G32B32A32_UINT),
        (offset_of!(Instance, sample_entries), F::R32G32B32A32_UINT),
        (offset_of!(Instance, sample_weights), F::R32G32B32A32_SFLOAT),
    ]
    .iter()
    .zip(0..)
    .map(
        |(&(offset, format), location)| vk::VertexInputAttributeDescription {
            location,
            binding: 0,
            format,
            offset: offset as u32,
        },
    )
    .collect::<Vec<_>>()
    .try_into()
    .unwrap_or_default()
}

/// A sampler that takes the nearest mip of a picture that repeats, or one of a picture without mips, which holds its edges.
fn sampler(
    cx: &Context,
    name: &str,
    filter: vk::Filter,
    has_mips: bool,
) -> Result<vk::Sampler, RenderError> {
    let info = vk::SamplerCreateInfo::default()
        .mag_filter(filter)
        .min_filter(filter)
        .mipmap_mode(vk::SamplerMipmapMode::NEAREST);
    let edge = vk::SamplerAddressMode::CLAMP_TO_EDGE;
    let info = match has_mips {
        true => info.max_lod(vk::LOD_CLAMP_NONE),
        false => info.address_mode_u(edge).address_mode_v(edge),
    };
    // SAFETY: the context's device is alive.
    let sampler = unsafe { cx.device.create_sampler(&info, None) }
        .map_err(RenderError::vulkan(cx.full_name(name), "vkCreateSampler"))?;
    cx.set_name(sampler, name);
    Ok(sampler)
}

pub(super) fn pipeline_layout(
    cx: &Context,
    name: &str,
    sets: &[vk::DescriptorSetLayout],
    constants: Option<(vk::ShaderStageFlags, u32)>,
) -> Result<vk::PipelineLayout, RenderError> {
    let ranges: Vec<_> = constants
        .iter()
        .map(|&(stages, size)| {
            vk::PushConstantRange::default()
                .stage_flags(stages)
                .size(size)
        })
        .collect();
    let info = vk::PipelineLayoutCreateInfo::default()
        .set_layouts(sets)
        .push_constant_ranges(&ranges);
    // SAFETY: the set layouts are alive.
    let layout = unsafe { cx.device.create_pipeline_layout(&info, None) }.map_err(
        RenderError::vulkan(cx.full_name(name), "vkCreatePipelineLayout"),
    )?;
    cx.set_name(layout, name);
    Ok(layout)
}
