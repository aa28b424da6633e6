//! Buffers that shaders read as records: through texel views where the device's texel buffers are large, else as storage.

use ash::vk;
use gpu_allocator::MemoryLocation;

use super::bindings::Kind;
use super::context::Context;
use super::memory::Buffer;
use crate::error::RenderError;

pub(super) const UINT4: vk::Format = vk::Format::R32G32B32A32_UINT;
pub(super) const UINT2: vk::Format = vk::Format::R32G32_UINT;
pub(super) const UINT: vk::Format = vk::Format::R32_UINT;
pub(super) const FLOAT4: vk::Format = vk::Format::R32G32B32A32_SFLOAT;
pub(super) const FLOAT: vk::Format = vk::Format::R32_SFLOAT;

/// What to do where a buffer of the crowd is too large.
pub(super) const FEWER_AGENTS: &str = "draw fewer agents with one renderer, or split the crowd";

/// How shaders read records on a device.
pub(super) fn kind(cx: &Context) -> Kind {
    match cx.capabilities.reads_texels() {
        true => Kind::Texels,
        false => Kind::Storage,
    }
}

/// A buffer that shaders read as records of a format; `usage` says what else it is for.
///
/// Errors: [`RenderError::Limit`] with the hint where the device allows none so large.
pub(super) fn create_records(
    cx: &Context,
    name: &str,
    bytes: u64,
    usage: vk::BufferUsageFlags,
    location: MemoryLocation,
    texel: vk::Format,
    hint: &'static str,
) -> Result<Buffer, RenderError> {
    use vk::BufferUsageFlags as U;
    let usage = match kind(cx) {
        Kind::Texels => usage | U::UNIFORM_TEXEL_BUFFER,
        _ => usage | U::STORAGE_BUFFER,
    };
    if usage.contains(U::STORAGE_BUFFER) {
        check_range(cx, name, bytes, hint)?;
    }
    if !usage.contains(U::UNIFORM_TEXEL_BUFFER) {
        return cx.create_buffer(name, bytes, usage, location);
    }
    let texel_bytes = bytes_of(texel);
    if bytes / texel_bytes > cx.capabilities.texel_count {
        return Err(RenderError::Limit {
            object: cx.full_name(name),
            needed: bytes / texel_bytes,
            limit: cx.capabilities.texel_count,
            unit: "texels in a buffer",
            hint,
        });
    }
    let mut buffer = cx.create_buffer(name, bytes, usage, location)?;
    match cx.add_texel_view(&mut buffer, name, texel) {
        Ok(()) => Ok(buffer),
        Err(e) => {
            cx.destroy_buffer(buffer);
            Err(e)
        }
    }
}

/// The most records of a format that a buffer of a device holds.
pub(super) fn most(cx: &Context, texel: vk::Format) -> u64 {
    match kind(cx) {
        Kind::Texels => cx.capabilities.texel_count,
        _ => cx.capabilities.storage_range / bytes_of(texel),
    }
}

fn bytes_of(texel: vk::Format) -> u64 {
    match texel {
        UINT4 | FLOAT4 => 16,
        UINT2 => 8,
        _ => 4,
    }
}

/// Errors: [`RenderError::Limit`] with the hint where a storage buffer would be larger than the device allows.
pub(super) fn check_range(
    cx: &Context,
    name: &str,
    bytes: u64,
    hint: &'static str,
) -> Result<(), RenderError> {
    if bytes > cx.capabilities.storage_range {
        return Err(RenderError::Limit {
            object: cx.full_name(name),
            needed: bytes,
            limit: cx.capabilities.storage_range,
            unit: "bytes of storage buffer",
            hint,
        });
    }
    Ok(())
}
