//! One picture in the making: supersampled capture in, texels with coverage out, then mips.

use std::sync::LazyLock;

use glam::{UVec2, Vec2, Vec3};

use super::capture::CapturedView;
use crate::tint::mean_of_tints;

/// A texel of a picture. Colour and surface mean nothing where the coverage is 0.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Texel {
    /// Share of the texel that is covered.
    pub coverage: f32,
    /// Linear, the mean over all tints.
    pub color: Vec3,
    /// Normal along right and up, and depth, 0 to 255.
    pub shape: Vec3,
    /// Body part and tint rule as the atlas packs them.
    pub part: u8,
}

/// Texels of one mip, rows from the top.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Picture {
    /// Left and top edge in the plane.
    pub corner: Vec2,
    /// Side of a texel in the plane.
    pub texel: f32,
    /// Columns and rows.
    pub size: UVec2,
    /// `[rows][columns]`.
    pub texels: Vec<Texel>,
}

impl Picture {
    /// Averages a capture of `size` texels, each of `supersample^2` samples, keeping samples whose alpha `keep` accepts for
    /// their texel.
    pub fn average(
        captured: &CapturedView,
        corner: Vec2,
        texel: f32,
        size: UVec2,
        supersample: u32,
        keep: impl Fn(usize, u8) -> bool,
    ) -> Self {
        let columns = (size.x * supersample) as usize;
        let step = supersample as usize;
        let mut texels = Vec::with_capacity((size.x * size.y) as usize);
        for row in 0..size.y as usize {
            for column in 0..size.x as usize {
                let at = texels.len();
                let mut samples = Samples::default();
                for y in row * step..(row + 1) * step {
                    for x in column * step..(column + 1) * step {
                        let i = y * columns + x;
                        let color = captured.color[i];
                        if color[3] > 0 && keep(at, color[3]) {
                            let [x, y, part, depth] = captured.surface[i];
                            let shape = Vec3::new(x.into(), y.into(), depth.into());
                            samples.add(1.0, mean_of_tints(linear(color), part), shape, part);
                        }
                    }
                }
                texels.push(samples.texel((step * step) as f32));
            }
        }
        Self {
            corner,
            texel,
            size,
            texels,
        }
    }

    /// The picture with a margin of empty texels around what it covers, of a size that is a multiple of `multiple`; empty
    /// where it covers nothing.
    pub fn cropped(&self, margin: u32, multiple: u32) -> Self {
        let (mut min, mut max) = (UVec2::MAX, UVec2::ZERO);
        for (i, t) in self.texels.iter().enumerate() {
            if t.coverage > 0.0 {
                let at = UVec2::new(i as u32 % self.size.x, i as u32 / self.size.x);
                (min, max) = (min.min(at), max.max(at + 1));
            }
        }
        if min.x >= max.x {
            return Self::default();
        }
        let content = max - min;
        let size = padded(content, margin, multiple);
        let inset = (size - content) / 2;
        let mut texels = vec![Texel::default(); (size.x * size.y) as usize];
        for y in 0..content.y {
            for x in 0..content.x {
                let from = (min.y + y) * self.size.x + min.x + x;
                let to = (inset.y + y) * size.x + inset.x + x;
                texels[to as usize] = self.texels[from as usize];
            }
        }
        let shift = min.as_vec2() - inset.as_vec2();
        Self {
            corner: self.corner + Vec2::new(shift.x, -shift.y) * self.texel,
            texel: self.texel,
            size,
            texels,
        }
    }

    /// The next mip: 2x2 texels become one, by coverage.
    pub fn halved(&self) -> Self {
        let size = self.size / 2;
        let mut texels = Vec::with_capacity((size.x * size.y) as usize);
        for y in 0..size.y {
            for x in 0..size.x {
                let mut samples = Samples::default();
                for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let t = &self.texels[((2 * y + dy) * self.size.x + 2 * x + dx) as usize];
                    if t.coverage > 0.0 {
                        samples.add(t.coverage, t.color, t.shape, t.part);
                    }
                }
                texels.push(samples.texel(4.0));
            }
        }
        Self {
            corner: self.corner,
            texel: self.texel * 2.0,
            size,
            texels,
        }
    }

    /// Colour with coverage, and surface, as the atlas holds them; uncovered texels with what their neighbours show, so that
    /// filtering finds no fringe.
    pub fn encoded(&self) -> (Vec<[u8; 4]>, Vec<[u8; 4]>) {
        let texels = self.dilated();
        let encode = |t: &Texel| {
            let [r, g, b] = roots(t.color);
            let alpha = t.coverage.min(1.0);
            let s = t.shape + 0.5;
            (
                [r, g, b, (alpha * 255.0 + 0.5) as u8],
                [s.x as u8, s.y as u8, t.part, s.z as u8],
            )
        };
        texels.iter().map(encode).unzip()
    }

    fn dilated(&self) -> Vec<Texel> {
        let mut texels = self.texels.clone();
        let mut known: Vec<bool> = texels.iter().map(|t| t.coverage > 0.0).collect();
        let (columns, rows) = (self.size.x as i32, self.size.y as i32);
        let mut edge: Vec<usize> = (0..texels.len()).filter(|&i| known[i]).collect();
        while !edge.is_empty() {
            let mut next = Vec::new();
            for &i in &edge {
                let (x, y) = (i as i32 % columns, i as i32 / columns);
                for (dx, dy) in [(1, 0), (-1, 0), (0, 1), (0, -1)] {
                    let (x, y) = (x + dx, y + dy);
                    let at = (y * columns + x) as usize;
                    if (0..columns).contains(&x) && (0..rows).contains(&y) && !known[at] {
                        known[at] = true;
                        texels[at] = Texel {
                            coverage: 0.0,
                            ..texels[i]
                        };
                        next.push(at);
                    }
                }
            }
            edge = next;
        }
        texels
    }
}

/// Size of a tile that holds `content` texels and a margin on each side.
pub(super) fn padded(content: UVec2, margin: u32, multiple: u32) -> UVec2 {
    let side = |n: u32| (n + 2 * margin).next_multiple_of(multiple);
    UVec2::new(side(content.x), side(content.y))
}

/// Samples of one texel.
#[derive(Default)]
struct Samples {
    weight: f32,
    color: Vec3,
    shape: Vec3,
    /// Weight by body part, in the order met.
    parts: Vec<(u8, f32)>,
}

impl Samples {
    fn add(&mut self, weight: f32, color: Vec3, shape: Vec3, part: u8) {
        self.weight += weight;
        self.color += weight * color;
        self.shape += weight * shape;
        match self.parts.iter_mut().find(|p| p.0 == part) {
            Some(p) => p.1 += weight,
            None => self.parts.push((part, weight)),
        }
    }

    /// Averages; the part is the one with the most weight.
    fn texel(self, full: f32) -> Texel {
        if self.weight == 0.0 {
            return Texel::default();
        }
        let most = self
            .parts
            .iter()
            .fold((0, 0.0f32), |a, &b| if b.1 > a.1 { b } else { a });
        Texel {
            coverage: self.weight / full,
            color: self.color / self.weight,
            shape: self.shape / self.weight,
            part: most.0,
        }
    }
}

fn linear(color: [u8; 4]) -> Vec3 {
    static TABLE: LazyLock<[f32; 256]> = LazyLock::new(|| {
        std::array::from_fn(|i| {
            let x = i as f32 / 255.0;
            if x <= 0.04045 {
                x / 12.92
            } else {
                ((x + 0.055) / 1.055).powf(2.4)
            }
        })
    });
    Vec3::from([0, 1, 2].map(|i| TABLE[color[i] as usize]))
}

/// Square roots: nearly as even in lightness as sRGB, and cheap to undo.
fn roots(color: Vec3) -> [u8; 3] {
    let root = |x: f32| (x.clamp(0.0, 1.0).sqrt() * 255.0 + 0.5) as u8;
    color.to_array().map(root)
}
