//! What each descriptor set binds, by binding number from 0: pipelines are made from it, tests compare it with the shaders.

use ash::vk;

/// Kind of a binding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// `ConstantBuffer`.
    Uniform,
    /// `StructuredBuffer`, `RWStructuredBuffer`.
    Storage,
    /// `Buffer`: a buffer read through a view with a format.
    Texels,
    /// `Texture2D`, `Texture2DArray`, `TextureCubeArray`.
    Image,
    /// `SamplerState`.
    Sampler,
}

impl Kind {
    pub(crate) fn descriptor_type(self) -> vk::DescriptorType {
        match self {
            Self::Uniform => vk::DescriptorType::UNIFORM_BUFFER,
            Self::Storage => vk::DescriptorType::STORAGE_BUFFER,
            Self::Texels => vk::DescriptorType::UNIFORM_TEXEL_BUFFER,
            Self::Image => vk::DescriptorType::SAMPLED_IMAGE,
            Self::Sampler => vk::DescriptorType::SAMPLER,
        }
    }
}

use Kind::{Image, Sampler, Storage, Texels, Uniform};

/// Frame constants, agents, characters, clips, submeshes, bands, levels, tally, selected, draws, instances; selected and
/// tally as the scatter pass reads them; ranges; the occluders' pyramid; contact shadows.
pub const SELECT: &[Kind] = &[
    Uniform, Texels, Texels, Texels, Texels, Storage, Texels, Storage, Storage, Storage, Storage,
    Texels, Texels, Texels, Texels, Storage,
];
/// The same for devices whose texel buffers are small.
pub const SELECT_STORAGE: &[Kind] = &[
    Uniform, Storage, Storage, Storage, Storage, Storage, Storage, Storage, Storage, Storage,
    Storage, Storage, Storage, Storage, Storage, Storage,
];
/// Frame constants, the occluders' depth and the pyramid over it.
pub const REDUCE: &[Kind] = &[Uniform, Image, Storage];
/// Frame constants; instances, for probes and as quads read them.
pub const DRAW: &[Kind] = &[Uniform, Storage, Texels];
/// The same for devices whose texel buffers are small.
pub const DRAW_STORAGE: &[Kind] = &[Uniform, Storage, Storage];
/// Character constants, vertices, parents, palette, texture array and its sampler.
pub const CHARACTER: &[Kind] = &[Uniform, Texels, Texels, Texels, Image, Sampler];
/// The same for devices whose texel buffers are small.
pub const CHARACTER_STORAGE: &[Kind] = &[Uniform, Storage, Storage, Storage, Image, Sampler];
/// The gallery's table, cells, colours and surfaces; the samplers of cells and surfaces, and of colours.
pub const GALLERY: &[Kind] = &[Texels, Image, Image, Image, Sampler, Sampler];
/// The same for devices whose texel buffers are small.
pub const GALLERY_STORAGE: &[Kind] = &[Storage, Image, Image, Image, Sampler, Sampler];
/// A probe's output, or what `limit` keeps.
pub const PROBE: &[Kind] = &[Storage];
/// The capture stage's pictures and the groups of joints.
pub const CAPTURE: &[Kind] = &[Storage, Storage];

/// Ends the names of modules that devices with small texel buffers have in place of others.
pub const STORAGE_SUFFIX: &str = "_storage";

/// The sets of a compiled module, by set number.
pub fn sets_of(module: &str) -> Vec<&'static [Kind]> {
    let (name, select, draw, character, gallery) = match module.strip_suffix(STORAGE_SUFFIX) {
        Some(name) => (
            name,
            SELECT_STORAGE,
            DRAW_STORAGE,
            CHARACTER_STORAGE,
            GALLERY_STORAGE,
        ),
        None => (module, SELECT, DRAW, CHARACTER, GALLERY),
    };
    match name {
        "occlude_reduce" | "occlude_reduce_top" => vec![REDUCE],
        name if name.starts_with("select") => vec![select],
        "mesh_probe" | "impostor_probe" | "impostor_soft_probe" => {
            vec![draw, character, gallery, PROBE]
        }
        limit if limit.starts_with("limit_") && limit.ends_with("_cs") => {
            vec![draw, character, gallery, PROBE]
        }
        "capture_vs" | "capture_ps" => vec![draw, character, CAPTURE],
        _ => vec![draw, character, gallery],
    }
}
