//! Decodes PNG and JPEG images within limits.

use std::io::Cursor;

use image::{ImageFormat, ImageReader, Limits};

use crate::character::Image;

/// Greatest width and height of an image, in pixels.
const MAX_SIDE: u32 = 16_384;
/// Greatest number of pixels of an image: 256 MiB as RGBA.
const MAX_PIXELS: u64 = 1 << 26;

/// Why an image cannot be used.
pub(super) enum ImageFault {
    /// It is of a format that is not read here.
    Format,
    /// It is broken or too large: the reason.
    Content(String),
}

/// Decodes `bytes` to 8-bit RGBA; the format goes by the content.
pub(super) fn decode(name: &str, bytes: &[u8]) -> Result<Image, ImageFault> {
    let content = |e: image::ImageError| ImageFault::Content(format!("it cannot be decoded: {e}"));
    let format = match image::guess_format(bytes) {
        Ok(f @ (ImageFormat::Png | ImageFormat::Jpeg)) => f,
        _ => return Err(ImageFault::Format),
    };
    let (width, height) = ImageReader::with_format(Cursor::new(bytes), format)
        .into_dimensions()
        .map_err(content)?;
    let pixel_count = u64::from(width) * u64::from(height);
    if width > MAX_SIDE || height > MAX_SIDE || pixel_count > MAX_PIXELS || pixel_count == 0 {
        return Err(ImageFault::Content(format!(
            "its size of {width}x{height} pixels is zero or above the limit of {MAX_SIDE} a side and {MAX_PIXELS} in all"
        )));
    }
    // Deflate packs at most 1032:1, so a PNG that promises more than its bytes can hold is refused before it allocates.
    if format == ImageFormat::Png && pixel_count / 8 > bytes.len() as u64 * 1032 {
        return Err(ImageFault::Content(
            "it is too short for its size in pixels".into(),
        ));
    }
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits.max_alloc = Some(MAX_PIXELS * 8 + (1 << 20));
    reader.limits(limits);
    let decoded = reader.decode().map_err(content)?.into_rgba8();
    Ok(Image {
        name: name.to_string(),
        width,
        height,
        pixels: decoded.pixels().map(|p| p.0).collect(),
    })
}
