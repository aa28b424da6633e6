//! What the surface looks like at a place: the colour that a pixel shows there, its coverage and its normal.

use glam::{Vec2, Vec3, Vec4};

use crate::character::Image;
use crate::mesh::Mesh;

/// Texels in a row and a column of the copies of textures that looks are compared in. Detail finer than this belongs to
/// levels whose texture coordinates are exact anyway.
const TEXELS: usize = 128;
/// Contrast of a normal turned by a radian against black and white.
const NORMAL_CONTRAST: f32 = 0.1;
/// Contrast of one body part against another of the same colour: an agent's tint may dye them apart.
const PART_CONTRAST: f32 = 0.2;

/// Colour in gamma space and coverage, 0 to 1, and the unit normal in bind space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Look {
    pub color: Vec4,
    pub normal: Vec3,
    /// Body parts that it is interpolated from, with their shares.
    parts: [(u8, f32); 3],
}

impl Look {
    /// Squared contrast between two looks, about 0 to 1: black and white are 1 apart.
    pub fn contrast_squared(&self, other: &Self) -> f32 {
        let nc = NORMAL_CONTRAST;
        let normal = nc * nc * self.normal.distance_squared(other.normal);
        self.colors_apart(other) + normal
    }

    /// The same without what normals add.
    pub fn colors_apart(&self, other: &Self) -> f32 {
        let d = self.color - other.color;
        let color = d.truncate().length_squared() * (1.0 / 3.0) + d.w * d.w;
        let part = PART_CONTRAST * PART_CONTRAST * self.parts_apart(other);
        color + part
    }

    /// Half the squared distance of both looks' shares of body parts: 0 for the same, 1 for different ones.
    fn parts_apart(&self, other: &Self) -> f32 {
        let product = |a: &[(u8, f32); 3], b: &[(u8, f32); 3]| -> f32 {
            let pairs = a.iter().flat_map(|a| b.iter().map(move |b| (a, b)));
            pairs
                .filter(|(a, b)| a.0 == b.0)
                .map(|(a, b)| a.1 * b.1)
                .sum()
        };
        let (a, b) = (&self.parts, &other.parts);
        0.5 * (product(a, a) + product(b, b)) - product(a, b)
    }
}

/// The textures of a mesh, from which its faces have their looks.
#[derive(Clone)]
pub(super) struct Looks {
    /// `[layer][TEXELS * TEXELS]`, gamma space.
    layers: Vec<Vec<Vec4>>,
}

impl Looks {
    /// `images` are the layers of the mesh; where one is missing its texture counts as white.
    pub fn new(images: &[&Image]) -> Self {
        Self {
            layers: images.iter().map(|i| shrink(i)).collect(),
        }
    }

    /// The look at a place of the triangle of three wedges.
    pub fn at(&self, m: &Mesh, wedges: [u32; 3], barycentric: [f32; 3]) -> Look {
        let mut color = Vec4::ZERO;
        let mut normal = Vec3::ZERO;
        let mut uv = Vec2::ZERO;
        for (w, share) in wedges.into_iter().zip(barycentric) {
            let w = w as usize;
            let [r, g, b, a] = m.colors[w].map(f32::from);
            color += Vec4::new(r, g, b, a) * (share / 255.0);
            normal += m.normals[w] * share;
            uv += m.uvs[w] * share;
        }
        // All corners of a face have one layer.
        let first = wedges[0] as usize;
        if let Some(texels) = self.layers.get(m.layers[first] as usize) {
            color *= texels[texel(uv)];
        }
        if m.submeshes[m.submesh[first] as usize]
            .alpha_cutoff
            .is_none()
        {
            color.w = 1.0;
        }
        Look {
            parts: [0, 1, 2].map(|i| (m.body_parts[wedges[i] as usize], barycentric[i])),
            color,
            normal: normal.normalize_or_zero(),
        }
    }

    /// The look of a wedge.
    pub fn of(&self, mesh: &Mesh, wedge: u32) -> Look {
        self.at(mesh, [wedge; 3], [1.0, 0.0, 0.0])
    }
}

/// Index of the texel at `uv`, which repeats.
fn texel(uv: Vec2) -> usize {
    let uv = uv - uv.floor();
    let at = |x: f32| ((x * TEXELS as f32) as usize).min(TEXELS - 1);
    at(uv.y) * TEXELS + at(uv.x)
}

/// An image's mean colours in a grid of [`TEXELS`] by [`TEXELS`].
fn shrink(image: &Image) -> Vec<Vec4> {
    let (width, height) = (image.width as usize, image.height as usize);
    // At least one pixel for each texel, at most eight by eight: enough for a mean.
    let range = |i: usize, size: usize| {
        let first = i * size / TEXELS;
        let last = ((i + 1) * size)
            .div_ceil(TEXELS)
            .clamp(first + 1, size.max(1));
        (first..last).step_by((last - first).div_ceil(8))
    };
    let mut out = Vec::with_capacity(TEXELS * TEXELS);
    for row in 0..TEXELS {
        for column in 0..TEXELS {
            let (mut sum, mut count) = (Vec4::ZERO, 0.0);
            for y in range(row, height) {
                for x in range(column, width) {
                    let Some(pixel) = image.pixels.get(y * width + x) else {
                        continue;
                    };
                    let [r, g, b, a] = pixel.map(f32::from);
                    sum += Vec4::new(r, g, b, a) / 255.0;
                    count += 1.0;
                }
            }
            out.push(if count > 0.0 { sum / count } else { Vec4::ONE });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_texture_is_looked_up_where_its_coordinates_say() {
        let mut pixels = vec![[255, 0, 0, 255]; 4 * 4];
        pixels[3] = [0, 0, 255, 255];
        let image = Image {
            name: String::new(),
            width: 4,
            height: 4,
            pixels,
        };
        let texels = shrink(&image);
        assert_eq!(texels.len(), TEXELS * TEXELS);
        assert_eq!(
            texels[texel(Vec2::new(0.9, 0.1))],
            Vec4::new(0.0, 0.0, 1.0, 1.0)
        );
        assert_eq!(
            texels[texel(Vec2::new(-0.1, 3.1))],
            Vec4::new(0.0, 0.0, 1.0, 1.0)
        );
        assert_eq!(
            texels[texel(Vec2::new(0.1, 0.1))],
            Vec4::new(1.0, 0.0, 0.0, 1.0)
        );
    }
}
