//! The compiled shaders.

/// One compiled entry point; its SPIR-V name is `main`.
#[derive(Debug, Clone, Copy)]
pub struct Module {
    /// `<stage>`, or `<stage>_<entry>`.
    pub name: &'static str,
    /// HLSL file that it was compiled from.
    pub source: &'static str,
    /// SPIR-V 1.3 for Vulkan 1.1.
    pub spirv: &'static [u32],
}

include!(concat!(env!("OUT_DIR"), "/shaders.rs"));
