//! Pictures: supersampling and PNG files.

use std::io::Cursor;
use std::path::Path;

use anyhow::{Result, anyhow};
use image::{ExtendedColorType, ImageEncoder};
use rayon::prelude::*;

use super::output::write_file;
use throng::bake::texture::{linear_from_srgb, srgb_from_linear};

/// Averages blocks of `factor` x `factor` pixels as light adds up: sRGB to linear, mean, back to sRGB. Alpha, which is
/// linear, is averaged as it is.
///
/// Shapes: `pixels` [factor * height][factor * width] RGBA; the result [height][width].
pub fn average(pixels: &[[u8; 4]], width: usize, height: usize, factor: usize) -> Vec<[u8; 4]> {
    if factor <= 1 || width == 0 {
        return pixels.to_vec();
    }
    let linear: Vec<f32> = (0..=255u8).map(linear_from_srgb).collect();
    let samples = (factor * factor) as f32;
    let mut averaged = vec![[0; 4]; width * height];
    averaged
        .par_chunks_mut(width)
        .enumerate()
        .for_each(|(y, row)| {
            for (x, pixel) in row.iter_mut().enumerate() {
                let mut sum = [0.0; 4];
                for sample_y in y * factor..(y + 1) * factor {
                    let first = sample_y * width * factor + x * factor;
                    for &[r, g, b, a] in &pixels[first..first + factor] {
                        sum[0] += linear[usize::from(r)];
                        sum[1] += linear[usize::from(g)];
                        sum[2] += linear[usize::from(b)];
                        sum[3] += f32::from(a);
                    }
                }
                let [r, g, b] = [sum[0], sum[1], sum[2]].map(|s| srgb_from_linear(s / samples));
                *pixel = [r, g, b, (sum[3] / samples).round() as u8];
            }
        });
    averaged
}

/// Writes a PNG without alpha, whole or not at all.
pub fn write_png(path: &Path, pixels: &[[u8; 4]], width: u32, height: u32) -> Result<()> {
    let opaque: Vec<u8> = pixels.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect();
    let mut file = Cursor::new(Vec::new());
    image::codecs::png::PngEncoder::new(&mut file)
        .write_image(&opaque, width, height, ExtendedColorType::Rgb8)
        .map_err(|e| anyhow!("{}: {e}", path.display()))?;
    write_file(path, file.get_ref())
}

/// Writes a PNG with alpha, whole or not at all. Shape: `pixels` [height][width].
pub fn write_rgba(path: &Path, pixels: &[[u8; 4]], width: u32) -> Result<()> {
    let height = pixels.len() as u32 / width.max(1);
    let mut file = Cursor::new(Vec::new());
    image::codecs::png::PngEncoder::new(&mut file)
        .write_image(
            pixels.as_flattened(),
            width,
            height,
            ExtendedColorType::Rgba8,
        )
        .map_err(|e| anyhow!("{}: {e}", path.display()))?;
    write_file(path, file.get_ref())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flat_picture_stays_as_it_is() {
        for v in 0..=255 {
            let averaged = average(&[[v, v, v, v]; 16], 2, 2, 2);
            assert_eq!(averaged, [[v, v, v, v]; 4]);
        }
    }

    /// Half black, half white is half the light: sRGB 188, not 128.
    #[test]
    fn light_is_averaged_not_its_code() {
        let (k, w) = ([0, 0, 0, 255], [255, 255, 255, 255]);
        let red = [255, 0, 0, 255];
        #[rustfmt::skip]
        let pixels = [
            k, w, red, red,
            w, k, red, red,
        ];
        assert_eq!(average(&pixels, 2, 1, 2), [[188, 188, 188, 255], red]);
    }
}
