//! One picture in the making: supersampled capture in, texels with their distance from the outline out, then mips.
//!
//! Source: Green 2007, "Improved Alpha-Tested Magnification for Vector Textures and Special Effects", for the distances.

use std::sync::LazyLock;

use glam::{UVec2, Vec2, Vec3};

use super::capture::CapturedView;
use crate::tint::mean_of_tints;

/// Outlines are known to this many texels away.
const OUTLINE_REACH: f32 = 2.0;

/// A texel of a picture. Colour and surface mean nothing where the coverage is 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Texel {
    /// Share of the texel that is covered.
    pub coverage: f32,
    /// Distance of its middle from the outline in texels, at most [`OUTLINE_REACH`]; below 0 outside.
    pub outline: f32,
    /// Linear, the mean over all tints.
    pub color: Vec3,
    /// Normal along right and up, and depth, 0 to 255.
    pub shape: Vec3,
    /// Body part and tint rule as the atlas packs them.
    pub part: u8,
}

impl Default for Texel {
    /// Far from anything.
    fn default() -> Self {
        Self {
            coverage: 0.0,
            outline: -OUTLINE_REACH,
            color: Vec3::ZERO,
            shape: Vec3::ZERO,
            part: 0,
        }
    }
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
        let mut shown = vec![false; columns * size.y as usize * step];
        for row in 0..size.y as usize {
            for column in 0..size.x as usize {
                let at = texels.len();
                let mut samples = Samples::default();
                for y in row * step..(row + 1) * step {
                    for x in column * step..(column + 1) * step {
                        let i = y * columns + x;
                        let color = captured.color[i];
                        if color[3] > 0 && keep(at, color[3]) {
                            shown[i] = true;
                            let [x, y, part, depth] = captured.surface[i];
                            let shape = Vec3::new(x.into(), y.into(), depth.into());
                            samples.add(1.0, mean_of_tints(linear(color), part), shape, part);
                        }
                    }
                }
                texels.push(samples.texel((step * step) as f32));
            }
        }
        let outlines = outlines(&shown, columns, step);
        for (texel, outline) in texels.iter_mut().zip(outlines) {
            texel.outline = outline;
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
        // The margin knows how far it is from the outline, where it was in the picture.
        let texels = (0..size.y).flat_map(|y| (0..size.x).map(move |x| UVec2::new(x, y)));
        let texels = texels.map(|to| {
            let from = (min + to).checked_sub(inset);
            let from = from.filter(|f| f.x < self.size.x && f.y < self.size.y);
            from.map_or(Texel::default(), |f| {
                self.texels[(f.y * self.size.x + f.x) as usize]
            })
        });
        let texels = texels.collect();
        let shift = min.as_vec2() - inset.as_vec2();
        Self {
            corner: self.corner + Vec2::new(shift.x, -shift.y) * self.texel,
            texel: self.texel,
            size,
            texels,
        }
    }

    /// The next mip: 2x2 texels become one, by coverage. What covers a part of its texel is that far from the outline: a straight
    /// edge is, and what is thinner than a texel keeps its area.
    pub fn halved(&self) -> Self {
        let size = self.size / 2;
        let mut texels = Vec::with_capacity((size.x * size.y) as usize);
        for y in 0..size.y {
            for x in 0..size.x {
                let mut samples = Samples::default();
                let mut outline = 0.0;
                for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let t = &self.texels[((2 * y + dy) * self.size.x + 2 * x + dx) as usize];
                    outline += t.outline / 8.0;
                    if t.coverage > 0.0 {
                        samples.add(t.coverage, t.color, t.shape, t.part);
                    }
                }
                let mut texel = samples.texel(4.0);
                texel.outline = match texel.coverage {
                    0.0 => outline.min(-0.5),
                    1.0 => outline.max(0.5),
                    coverage => coverage - 0.5,
                };
                texels.push(texel);
            }
        }
        Self {
            corner: self.corner,
            texel: self.texel * 2.0,
            size,
            texels,
        }
    }

    /// Colour with outline, and surface, as the atlas holds them; uncovered texels with what their neighbours show, so that
    /// filtering finds no fringe.
    pub fn encoded(&self) -> (Vec<[u8; 4]>, Vec<[u8; 4]>) {
        let texels = self.dilated();
        let encode = |t: &Texel| {
            let [r, g, b] = roots(t.color);
            let alpha = t.outline.clamp(-1.0, 1.0) * 0.5 + 0.5;
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
                            outline: texels[at].outline,
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

/// The distance of every texel's middle from the outline, in texels: half a sample less than to the nearest sample of the other
/// kind. `shown` are rows of `columns` samples, `step` of them along each side of a texel; beyond them nothing is shown.
fn outlines(shown: &[bool], columns: usize, step: usize) -> Vec<f32> {
    let rows = shown.len() / columns.max(1);
    let nearest = [false, true].map(|kind| nearest_in_rows(shown, columns, kind));
    let reach = (OUTLINE_REACH * step as f32) as isize + 1;
    // Middles lie between samples where their number is even: so far beside the nearest ones.
    let middle = 0.5 * (step as f32 - 1.0);
    let beside = middle.fract();
    let mut out = Vec::with_capacity(shown.len() / (step * step).max(1));
    for row in 0..rows / step {
        for column in 0..columns / step {
            let (x, y) = (
                (column * step) as f32 + middle,
                (row * step) as f32 + middle,
            );
            let near = y as isize - reach..=y as isize + 1 + reach;
            // Squares, by kind.
            let mut squares = [f32::INFINITY; 2];
            for sample_row in near {
                let dy = sample_row as f32 - y;
                for (kind, square) in squares.iter_mut().enumerate() {
                    let dx = if (0..rows as isize).contains(&sample_row) {
                        let first = sample_row as usize * columns;
                        let (before, _) = nearest[kind][first + x as usize];
                        let (_, after) = nearest[kind][first + (x + beside) as usize];
                        (x - before).min(after - x)
                    } else if kind == 0 {
                        beside
                    } else {
                        f32::INFINITY
                    };
                    *square = square.min(dx * dx + dy * dy);
                }
            }
            let [hidden, shown] = squares.map(|s| (s - beside * beside).max(0.0).sqrt());
            let distance = match shown <= hidden {
                true => hidden - 0.5,
                false => 0.5 - shown,
            };
            out.push((distance / step as f32).clamp(-OUTLINE_REACH, OUTLINE_REACH));
        }
    }
    out
}

/// For each sample the columns of the nearest ones in its row that are shown, or are not: at or before it, and at or after it. Beyond
/// a row's ends nothing is shown.
fn nearest_in_rows(shown: &[bool], columns: usize, kind: bool) -> Vec<(f32, f32)> {
    let (before, after) = match kind {
        true => (f32::NEG_INFINITY, f32::INFINITY),
        false => (-1.0, columns as f32),
    };
    let mut out = vec![(before, after); shown.len()];
    for (row, out) in shown
        .chunks(columns.max(1))
        .zip(out.chunks_mut(columns.max(1)))
    {
        let mut last = before;
        for (x, (&s, out)) in row.iter().zip(out.iter_mut()).enumerate() {
            last = if s == kind { x as f32 } else { last };
            out.0 = last;
        }
        let mut next = after;
        for (x, (&s, out)) in row.iter().zip(out.iter_mut()).enumerate().rev() {
            next = if s == kind { x as f32 } else { next };
            out.1 = next;
        }
    }
    out
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

    /// Averages, but for the outline; the part is the one with the most weight.
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
            ..Texel::default()
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

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: u32 = 4;
    const SIZE: UVec2 = UVec2::new(24, 20);

    /// A picture of what `shows`, in texels from the top left.
    fn picture(shows: impl Fn(Vec2) -> bool) -> Picture {
        let [columns, rows] = (SIZE * STEP).to_array();
        let at = |i: u32| (Vec2::new((i % columns) as f32, (i / columns) as f32) + 0.5) / 4.0;
        let alpha = (0..columns * rows).map(|i| if shows(at(i)) { 255 } else { 0 });
        let captured = CapturedView {
            color: alpha.map(|a| [a; 4]).collect(),
            surface: vec![[128, 128, 0, 128]; (columns * rows) as usize],
        };
        Picture::average(&captured, Vec2::ZERO, 1.0, SIZE, STEP, |_, _| true)
    }

    /// The most that texels' outlines are off from true distances in texels, as far as the atlas tells them.
    fn off(picture: &Picture, distance: impl Fn(Vec2) -> f32) -> f32 {
        let texels = picture.texels.iter().zip(0u32..);
        let offs = texels.map(|(t, i)| {
            let at = UVec2::new(i % picture.size.x, i / picture.size.x).as_vec2() + 0.5;
            let truth = distance(at * picture.texel) / picture.texel;
            (t.outline.clamp(-1.0, 1.0) - truth.clamp(-1.0, 1.0)).abs()
        });
        offs.fold(0.0, f32::max)
    }

    #[test]
    fn texels_know_how_far_they_are_from_the_outline() {
        let straight = |slope: f32| move |p: Vec2| (11.3 - p.x + slope * p.y) / slope.hypot(1.0);
        let disc = |p: Vec2| 7.4 - p.distance(Vec2::new(12.2, 9.7));
        for slope in [0.0, 0.3, 1.0] {
            let made = picture(|p| straight(slope)(p) > 0.0);
            // Beyond the picture's edge nothing shows, so that only texels far from it are compared.
            let inner =
                |p: Vec2| p.cmpgt(Vec2::splat(3.0)).all() && p.cmplt(SIZE.as_vec2() - 3.0).all();
            let far = |p: Vec2| match inner(p) {
                true => straight(slope)(p),
                false => made.texels[(p.y as u32 * SIZE.x + p.x as u32) as usize].outline,
            };
            assert!(off(&made, far) < 0.2, "{slope}: {}", off(&made, far));
        }
        let made = picture(|p| disc(p) > 0.0);
        assert!(off(&made, disc) < 0.2, "{}", off(&made, disc));
        // In coarser mips distances are in their own texels.
        assert!(
            off(&made.halved(), disc) < 0.3,
            "{}",
            off(&made.halved(), disc)
        );
        // What is cut off around it changes nothing.
        let cropped = made.cropped(1, 2);
        let shift = Vec2::new(cropped.corner.x, -cropped.corner.y);
        assert!(off(&cropped, |p| disc(p + shift)) < 0.2);
        assert!(cropped.size.x < SIZE.x);
        // It is the half of what the atlas holds.
        let on = |t: &&Texel| t.outline.abs() < 0.02;
        let count = made.texels.iter().filter(on).count();
        let encoded = made.encoded().0;
        let half = encoded
            .iter()
            .filter(|c| (125..=130).contains(&c[3]))
            .count();
        assert!(count > 0 && half >= count, "{count} {half}");
    }

    #[test]
    fn what_is_thinner_than_a_texel_keeps_its_area_in_coarser_mips() {
        // A line of half a texel, a quarter of one in the coarser mip.
        for offset in [0.0, 0.25, 0.5, 1.0, 1.5] {
            let made = picture(|p| (p.x - 12.25 - offset).abs() < 0.25);
            let coarse = made.halved();
            let row = &coarse.texels[(5 * coarse.size.x) as usize..][..coarse.size.x as usize];
            let covered = row.iter().map(|t| (t.outline + 0.5).clamp(0.0, 1.0));
            let covered: f32 = covered.sum();
            assert!((covered - 0.25).abs() < 0.01, "{offset}: {covered}");
        }
    }
}
