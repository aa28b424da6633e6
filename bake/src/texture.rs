//! The texture array: every image of a character as an equal-sized layer with mips, so that all of it draws at once.

use image::imageops::{FilterType, resize};
use image::{ImageBuffer, Rgba};
use rayon::prelude::*;

use crate::baked::TextureArray;
use crate::character::Image;

/// Builds the array from `images`, one layer each, in that order.
///
/// Layers are as large as the largest image, at most `max_size` pixels on a side; smaller ones are enlarged, so that
/// texture coordinates wrap as they did. Mips are averaged in linear light, weighted by alpha.
pub fn texture_array(images: &[&Image], max_size: u32) -> TextureArray {
    if images.is_empty() {
        return TextureArray::default();
    }
    let side = |f: fn(&Image) -> u32| {
        images
            .iter()
            .map(|i| f(i))
            .max()
            .unwrap_or(1)
            .clamp(1, max_size.max(1))
    };
    let (width, height) = (side(|i| i.width), side(|i| i.height));
    let mip_count = 32 - width.max(height).leading_zeros();
    let chains: Vec<Vec<Vec<[u8; 4]>>> = images
        .par_iter()
        .map(|image| {
            let mut mips = vec![fitted(image, width, height)];
            for mip in 1..mip_count {
                let above = ((width >> (mip - 1)).max(1), (height >> (mip - 1)).max(1));
                mips.push(halved(
                    &mips[mip as usize - 1],
                    above.0 as usize,
                    above.1 as usize,
                ));
            }
            mips
        })
        .collect();
    let mut pixels = Vec::new();
    for mip in 0..mip_count as usize {
        for chain in &chains {
            pixels.extend_from_slice(&chain[mip]);
        }
    }
    TextureArray {
        width,
        height,
        layer_count: images.len() as u32,
        mip_count,
        pixels,
    }
}

/// Pixels of a whole array of this size.
pub fn pixel_count(width: u32, height: u32, layer_count: u32, mip_count: u32) -> u64 {
    (0..mip_count)
        .map(|m| {
            u64::from((width >> m).max(1))
                * u64::from((height >> m).max(1))
                * u64::from(layer_count)
        })
        .sum()
}

fn fitted(image: &Image, width: u32, height: u32) -> Vec<[u8; 4]> {
    if (image.width, image.height) == (width, height) {
        return image.pixels.clone();
    }
    let flat = image.pixels.as_flattened().to_vec();
    let Some(source) = ImageBuffer::<Rgba<u8>, _>::from_raw(image.width, image.height, flat) else {
        unreachable!("an imported image has as many pixels as its size says")
    };
    resize(&source, width, height, FilterType::Triangle)
        .pixels()
        .map(|p| p.0)
        .collect()
}

fn halved(above: &[[u8; 4]], width: usize, height: usize) -> Vec<[u8; 4]> {
    let (w, h) = ((width / 2).max(1), (height / 2).max(1));
    let mut out = Vec::with_capacity(w * h);
    for y in 0..h {
        for x in 0..w {
            let at = |dx: usize, dy: usize| {
                above[(2 * y + dy).min(height - 1) * width + (2 * x + dx).min(width - 1)]
            };
            out.push(mean([at(0, 0), at(1, 0), at(0, 1), at(1, 1)]));
        }
    }
    out
}

/// Mean of four pixels in linear light; colour counts by its alpha, so that what is cut out does not bleed in.
fn mean(pixels: [[u8; 4]; 4]) -> [u8; 4] {
    let alpha: u32 = pixels.iter().map(|p| u32::from(p[3])).sum();
    let mut out = [0, 0, 0, (alpha as f32 / 4.0).round() as u8];
    for (c, value) in out.iter_mut().enumerate().take(3) {
        let sum: f32 = pixels
            .iter()
            .map(|p| linear_from_srgb(p[c]) * if alpha > 0 { f32::from(p[3]) } else { 1.0 })
            .sum();
        *value = srgb_from_linear(sum / if alpha > 0 { alpha as f32 } else { 4.0 });
    }
    out
}

/// Linear value of an sRGB byte.
pub fn linear_from_srgb(byte: u8) -> f32 {
    let s = f32::from(byte) / 255.0;
    if s <= 0.04045 {
        s / 12.92
    } else {
        ((s + 0.055) / 1.055).powf(2.4)
    }
}

/// A linear value as sRGB encodes it, both 0 to 1.
pub fn encode_srgb(linear: f32) -> f32 {
    let l = linear.clamp(0.0, 1.0);
    if l <= 0.0031308 {
        l * 12.92
    } else {
        1.055 * l.powf(1.0 / 2.4) - 0.055
    }
}

/// Nearest sRGB byte of a linear value.
pub fn srgb_from_linear(linear: f32) -> u8 {
    (encode_srgb(linear) * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    fn solid(width: u32, height: u32, pixel: [u8; 4]) -> Image {
        Image {
            name: "solid".into(),
            width,
            height,
            pixels: vec![pixel; (width * height) as usize],
        }
    }

    #[test]
    fn layers_share_the_largest_size_and_mips_go_down_to_one_pixel() {
        let (a, b) = (
            solid(8, 2, [10, 20, 30, 255]),
            solid(4, 4, [200, 100, 50, 255]),
        );
        let array = texture_array(&[&a, &b], 1024);
        assert_eq!(
            (
                array.width,
                array.height,
                array.layer_count,
                array.mip_count
            ),
            (8, 4, 2, 4)
        );
        assert_eq!(array.pixels.len() as u64, pixel_count(8, 4, 2, 4));
        assert_eq!(array.pixels[0], [10, 20, 30, 255]);
        assert_eq!(*array.pixels.last().unwrap(), [200, 100, 50, 255]);
    }

    #[test]
    fn what_is_cut_out_does_not_colour_the_mips() {
        let mut image = solid(2, 1, [255, 0, 0, 255]);
        image.pixels[1] = [0, 255, 0, 0];
        let array = texture_array(&[&image], 1024);
        assert_eq!(*array.pixels.last().unwrap(), [255, 0, 0, 128]);
    }

    #[test]
    fn bytes_survive_linear_light() {
        for byte in 0..=255 {
            assert_eq!(srgb_from_linear(linear_from_srgb(byte)), byte);
        }
    }
}
