//! Small pictures of the character in some poses from some sides: what a coarse level gets wrong in them is its cost.
//!
//! Where a level has few points, distances no longer say what it looks like: a thin leg is near to nothing at all, and a head
//! is a small part of a surface. Collapses are then chosen by pictures (Lindstrom & Turk 2000): area of wrong outline and of
//! wrong colour, each collapse compared in the part of the pictures that it changes.

mod fit;
mod raster;

use std::cell::RefCell;

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use crate::mesh::Mesh;

use super::looks::Looks;
use super::surface::{Surface, cross, dot};

use raster::raster;

/// Pixels in a row and a column of a picture. The character's diagonal is as long as one.
const SIZE: usize = 48;
/// Weight of the pose at rest against the mean of the others: crowds move, but editors show it, with arms spread.
const REST_WEIGHT: f32 = 0.6;
/// Poses that are looked at: the weightiest, and the one at rest.
const POSES: usize = 6;
/// Sides from which each pose is looked at. An odd number: outlines from opposite sides are the same.
const SIDES: usize = 5;
/// Heights of the viewer above the horizon in radians, in turns.
const HEIGHTS: [f32; 3] = [0.05, 0.5, 0.2];
/// Squared contrast of the character against what is behind it; black and white are 1 apart.
const OUTLINE: f32 = 0.6;
/// Contrast of body parts that a tint may dye apart.
const PART_CONTRAST: f32 = 0.2;
/// Share of light that does not depend on where a surface faces.
const AMBIENT: f32 = 0.65;
/// Views that a thread takes at once, at least.
const VIEWS_EACH: usize = 5;
/// Share of all that is wrong that heads count for, where they show less; and most that their pixels count against others.
/// People look at faces, which are small.
const HEAD_SHARE: f32 = 0.2;
const HEAD_COUNT: f32 = 3.0;
/// Pixels around a head that count as much.
const HEAD_REACH: isize = 2;
/// What three channels count each: together they make one contrast.
const CHANNEL: f32 = 0.577;
/// Depth of a pixel that shows nothing.
const NOTHING: f32 = f32::MIN;

/// The pictures of the full mesh, and what is needed to make those of a level.
#[derive(Clone)]
pub(super) struct Pictures {
    views: Vec<View>,
    /// Poses that are looked at, by index into the surface's.
    poses: Vec<usize>,
    /// Per wedge and looked-at pose: lit colour and, in w, what stands for the body part.
    shades: Vec<[Vec4; POSES]>,
}

/// Faces that may take the place of those around some points.
#[derive(Default)]
pub(super) struct Change {
    /// Points and wedges.
    pub faces: Vec<([u32; 3], [u32; 3])>,
    /// A point that would be elsewhere, and where, `[3][pose_count]`.
    pub moved: Option<(u32, Vec<f32>)>,
}

#[derive(Clone, Copy)]
struct Pixel {
    color: Vec4,
    depth: f32,
}

const EMPTY: Pixel = Pixel {
    color: Vec4::ZERO,
    depth: NOTHING,
};

/// Pictures in the making.
struct Scratch {
    base: Vec<Pixel>,
    pixels: Vec<Pixel>,
}

impl Default for Scratch {
    fn default() -> Self {
        Self {
            base: vec![EMPTY; SIZE * SIZE],
            pixels: vec![EMPTY; SIZE * SIZE],
        }
    }
}

thread_local! {
    /// Kept, because a comparison is shorter than making them takes.
    static SCRATCH: RefCell<Scratch> = RefCell::default();
}

/// Columns and rows from the first to before the second.
#[derive(Clone, Copy)]
struct Rectangle {
    low: [usize; 2],
    high: [usize; 2],
}

/// The whole picture.
const ALL: Rectangle = Rectangle {
    low: [0; 2],
    high: [SIZE; 2],
};

#[derive(Clone)]
struct View {
    /// Index into the surface's poses, and into those that are looked at.
    pose: usize,
    slot: usize,
    weight: f32,
    right: [f32; 3],
    up: [f32; 3],
    /// Towards the viewer.
    back: [f32; 3],
    /// Place in the view's axes of the picture's corner.
    low: [f32; 2],
    /// Pixel x and y and depth of every point; empty before [`Pictures::place`].
    places: Vec<[f32; 3]>,
    full: Vec<Pixel>,
    /// What each pixel counts.
    counts: Vec<f32>,
}

impl Pictures {
    /// Pictures of the full mesh.
    pub fn new(surface: &Surface, looks: &Looks) -> Self {
        let mut poses: Vec<usize> = (0..surface.pose_count)
            .filter(|&k| surface.pose_weights[k] > 0.0)
            .collect();
        poses.sort_by(|&a, &b| surface.pose_weights[b].total_cmp(&surface.pose_weights[a]));
        poses.truncate(POSES - usize::from(surface.rest.is_some()));
        let mean = poses
            .iter()
            .map(|&k| surface.pose_weights[k].sqrt())
            .sum::<f32>()
            / poses.len() as f32;
        let weight = |k: usize| match surface.pose_weights[k] {
            0.0 => REST_WEIGHT * mean,
            weight => weight.sqrt(),
        };
        poses.extend(surface.rest);
        let total: f32 = poses.iter().map(|&k| weight(k)).sum();
        let mut pictures = Self {
            views: Vec::new(),
            poses,
            shades: Vec::new(),
        };
        for (slot, &pose) in pictures.poses.iter().enumerate() {
            for side in 0..SIDES {
                let turn = (side as f32 + slot as f32 / POSES as f32) / SIDES as f32;
                let height = HEIGHTS[(slot + side) % HEIGHTS.len()];
                let mut view = View::new(surface, pose, height, std::f32::consts::TAU * turn);
                view.slot = slot;
                view.weight = weight(pose) / (total * SIDES as f32);
                pictures.views.push(view);
            }
        }
        let lights: Vec<[f32; POSES]> = (0..surface.mesh.vertex_count() as u32)
            .map(|w| pictures.lights(surface, w))
            .collect();
        pictures.views.par_iter_mut().for_each(|view| {
            view.full = view.render_full(surface, looks, &lights);
        });
        pictures.look_at_heads(surface);
        pictures
    }

    /// Lets pixels of and around heads count more, where they are few.
    fn look_at_heads(&mut self, surface: &Surface) {
        let heads = (self.views.par_iter()).map(|view| view.head_pixels(surface));
        let heads: Vec<Vec<bool>> = heads.collect();
        let shown = self.views.iter().flat_map(|v| &v.full);
        let shown = shown.filter(|p| p.depth > NOTHING).count() as f32;
        let all_heads = heads.iter().flatten().filter(|&&h| h).count() as f32;
        let count = (HEAD_SHARE * shown / all_heads.max(1.0)).clamp(1.0, HEAD_COUNT);
        for (view, head) in self.views.iter_mut().zip(heads) {
            let near = |i: usize| {
                let (x, y) = ((i % SIZE) as isize, (i / SIZE) as isize);
                (-HEAD_REACH..=HEAD_REACH).any(|dy| {
                    (-HEAD_REACH..=HEAD_REACH).any(|dx| {
                        let (x, y) = (x + dx, y + dy);
                        let inside = 0..SIZE as isize;
                        inside.contains(&x)
                            && inside.contains(&y)
                            && head[y as usize * SIZE + x as usize]
                    })
                })
            };
            view.counts = (0..SIZE * SIZE)
                .map(|i| {
                    let counts = head[i] || view.full[i].depth == NOTHING && near(i);
                    if counts { count } else { 1.0 }
                })
                .collect();
        }
    }

    /// Learns what wedges look like that are new, or all if there are none yet.
    pub fn learn(&mut self, surface: &Surface, looks: &Looks) {
        self.shades.truncate(surface.mesh.vertex_count());
        for wedge in self.shades.len() as u32..surface.mesh.vertex_count() as u32 {
            let color = looks.of(&surface.mesh, wedge).color;
            let part = part_value(surface.mesh.body_parts[wedge as usize]);
            let lights = self.lights(surface, wedge);
            self.shades
                .push(lights.map(|light| shade(color, light, part)));
        }
    }

    /// Learns where all points are.
    pub fn place_all(&mut self, surface: &Surface) {
        for view in &mut self.views {
            let points = 0..surface.faces_of.len() as u32;
            view.places = points
                .map(|p| view.project(surface.posed_of(p), surface))
                .collect();
        }
    }

    /// Learns where new points are.
    pub fn place_new(&mut self, surface: &Surface) {
        for view in &mut self.views {
            for p in view.places.len()..surface.faces_of.len() {
                let place = view.project(surface.posed_of(p as u32), surface);
                view.places.push(place);
            }
        }
    }

    /// Forgets the points from `count` on.
    pub fn forget_places(&mut self, count: usize) {
        for view in &mut self.views {
            view.places.truncate(count);
        }
    }

    /// Learns where `point` is.
    pub fn place(&mut self, surface: &Surface, point: u32) {
        for view in &mut self.views {
            view.places[point as usize] = view.project(surface.posed_of(point), surface);
        }
    }

    /// Light on a wedge in each looked-at pose: more from above.
    fn lights(&self, surface: &Surface, wedge: u32) -> [f32; POSES] {
        let mut out = [1.0; POSES];
        for (light, &pose) in out.iter_mut().zip(&self.poses) {
            let turned = surface.step_of(wedge, pose) * surface.mesh.normals[wedge as usize];
            *light = AMBIENT + (1.0 - AMBIENT) * turned.normalize_or(Vec3::Y).y;
        }
        out
    }

    /// Forgets what wedges look like from `first` on.
    pub fn forget_looks(&mut self, first: usize) {
        self.shades.truncate(first);
    }

    /// Area of what is wrong in the pictures of the level that `faces` are, mean over all.
    pub fn wrong(&self, surface: &Surface, faces: &[u32]) -> f64 {
        let each: Vec<f64> = (self.views.par_iter())
            .map(|view| {
                let mut pixels = vec![EMPTY; SIZE * SIZE];
                for &f in faces {
                    let face = &surface.faces[f as usize];
                    let corners = face.points.map(|p| view.places[p as usize]);
                    self.draw(view, surface, corners, face.wedges, ALL, &mut pixels);
                }
                view.weight as f64 * view.wrong(&pixels, ALL)
            })
            .collect();
        each.iter().sum()
    }

    /// Change of [`Pictures::wrong`] if the faces around `points` give way to each of `changes`. `faces` are the living ones.
    pub fn compare(
        &self,
        surface: &Surface,
        faces: &[u32],
        around: &[u32],
        changes: &[Change],
    ) -> Vec<f64> {
        let gives_way = |&f: &u32| around.iter().any(|&p| surface.faces[f as usize].has(p));
        let (old, kept): (Vec<u32>, Vec<u32>) = faces.iter().copied().partition(gives_way);
        let each: Vec<Vec<f64>> = (self.views.par_iter())
            .with_min_len(VIEWS_EACH)
            .map(|view| {
                SCRATCH.with_borrow_mut(|scratch| {
                    self.compare_in(view, surface, &old, &kept, changes, scratch)
                })
            })
            .collect();
        (0..changes.len())
            .map(|i| each.iter().map(|e| e[i]).sum())
            .collect()
    }

    fn compare_in(
        &self,
        view: &View,
        surface: &Surface,
        old: &[u32],
        kept: &[u32],
        changes: &[Change],
        scratch: &mut Scratch,
    ) -> Vec<f64> {
        let project = |p: u32| view.places[p as usize];
        let mut reach = Reach::default();
        for &f in old {
            for p in surface.faces[f as usize].points {
                reach.add(project(p));
            }
        }
        let changed: Vec<Vec<[[f32; 3]; 3]>> = (changes.iter())
            .map(|change| {
                let at = |p: u32| match &change.moved {
                    Some((moved, posed)) if *moved == p => view.project(posed, surface),
                    _ => project(p),
                };
                let faces = change.faces.iter().map(|(points, _)| points.map(at));
                faces
                    .inspect(|c| c.iter().for_each(|&c| reach.add(c)))
                    .collect()
            })
            .collect();
        let Some(area) = reach.rectangle() else {
            return vec![0.0; changes.len()];
        };
        let Scratch { base, pixels } = scratch;
        for y in area.low[1]..area.high[1] {
            base[y * SIZE + area.low[0]..y * SIZE + area.high[0]].fill(EMPTY);
        }
        let draw = |f: u32, pixels: &mut [Pixel]| {
            let face = &surface.faces[f as usize];
            let corners = face.points.map(project);
            self.draw(view, surface, corners, face.wedges, area, pixels);
        };
        for &f in kept {
            draw(f, base);
        }
        let restore = |pixels: &mut [Pixel]| {
            for y in area.low[1]..area.high[1] {
                let row = y * SIZE + area.low[0]..y * SIZE + area.high[0];
                pixels[row.clone()].copy_from_slice(&base[row]);
            }
        };
        restore(pixels);
        old.iter().for_each(|&f| draw(f, pixels));
        let before = view.wrong(pixels, area);
        (changes.iter().zip(&changed))
            .map(|(change, corners)| {
                restore(pixels);
                for ((_, wedges), &corners) in change.faces.iter().zip(corners) {
                    self.draw(view, surface, corners, *wedges, area, pixels);
                }
                view.weight as f64 * (view.wrong(pixels, area) - before)
            })
            .collect()
    }

    fn draw(
        &self,
        view: &View,
        surface: &Surface,
        corners: [[f32; 3]; 3],
        wedges: [u32; 3],
        area: Rectangle,
        pixels: &mut [Pixel],
    ) {
        let sides = double_sided(surface, wedges[0]);
        let [a, b, c] = wedges.map(|w| self.shades[w as usize][view.slot]);
        raster(corners, sides, area, |span| {
            let depths = corners.map(|c| c[2]);
            let mix = |x: [f32; 3]| x[0] * depths[0] + x[1] * depths[1] + x[2] * depths[2];
            let blend = |x: [f32; 3]| a * x[0] + b * x[1] + c * x[2];
            let (mut depth, depth_step) = (mix(span.at), mix(span.step));
            let (mut color, color_step) = (blend(span.at), blend(span.step));
            for pixel in &mut pixels[span.first..span.first + span.len] {
                if depth > pixel.depth {
                    *pixel = Pixel { color, depth };
                }
                depth += depth_step;
                color += color_step;
            }
        });
    }
}

impl View {
    fn new(surface: &Surface, pose: usize, height: f32, angle: f32) -> Self {
        let (tall, turn) = (height.sin_cos(), angle.sin_cos());
        let back = [tall.1 * turn.0, tall.0, tall.1 * turn.1];
        let right = [turn.1, 0.0, -turn.0];
        let up = cross(back, right);
        let [low, high] = surface.boxes[pose];
        let center = [0, 1, 2].map(|i| 0.5 * (low[i] + high[i]));
        Self {
            pose,
            slot: 0,
            weight: 0.0,
            right,
            up,
            back,
            low: [right, up].map(|axis| dot(center, axis) - 0.5),
            places: Vec::new(),
            full: Vec::new(),
            counts: Vec::new(),
        }
    }

    /// Pixel x and y, and depth towards the viewer, of a point that stands at `posed` (`[3][pose_count]`).
    fn project(&self, posed: &[f32], surface: &Surface) -> [f32; 3] {
        let n = surface.pose_count;
        let p = [0, 1, 2].map(|axis| posed[axis * n + self.pose]);
        [
            (dot(p, self.right) - self.low[0]) * SIZE as f32,
            (dot(p, self.up) - self.low[1]) * SIZE as f32,
            dot(p, self.back),
        ]
    }

    fn render_full(&self, surface: &Surface, looks: &Looks, lights: &[[f32; POSES]]) -> Vec<Pixel> {
        let mut pixels = vec![EMPTY; SIZE * SIZE];
        for face in &surface.faces {
            let m = &surface.mesh;
            let corners = face
                .points
                .map(|p| self.project(surface.posed_of(p), surface));
            let lit = face.wedges.map(|w| lights[w as usize][self.slot]);
            let part = part_value(m.body_parts[face.wedges[0] as usize]);
            let submesh = m.submesh[face.wedges[0] as usize] as usize;
            let cutoff = m.submeshes[submesh].alpha_cutoff.unwrap_or(0.0);
            let sides = double_sided(surface, face.wedges[0]);
            raster(corners, sides, ALL, |span| {
                for (i, pixel) in pixels[span.first..span.first + span.len]
                    .iter_mut()
                    .enumerate()
                {
                    let b = [0, 1, 2].map(|k| span.at[k] + span.step[k] * i as f32);
                    let depth = (0..3).map(|k| corners[k][2] * b[k]).sum();
                    if depth > pixel.depth {
                        let color = looks.at(m, face.wedges, b).color;
                        let light = (0..3).map(|k| lit[k] * b[k]).sum();
                        if color.w >= cutoff {
                            let color = shade(color, light, part);
                            *pixel = Pixel { color, depth };
                        }
                    }
                }
            });
        }
        pixels
    }

    /// Which pixels show a head.
    fn head_pixels(&self, surface: &Surface) -> Vec<bool> {
        let mut out = vec![false; SIZE * SIZE];
        for face in surface
            .faces
            .iter()
            .filter(|f| surface.is_head(f.wedges[0]))
        {
            let corners = face
                .points
                .map(|p| self.project(surface.posed_of(p), surface));
            raster(corners, true, ALL, |span| {
                let depths = corners.map(|c| c[2]);
                for i in 0..span.len {
                    let depth: f32 = (0..3)
                        .map(|k| depths[k] * (span.at[k] + span.step[k] * i as f32))
                        .sum();
                    let at = span.first + i;
                    out[at] |= depth >= self.full[at].depth - 1e-4;
                }
            });
        }
        out
    }

    /// Area of what is wrong in a part of the picture: squared contrast times pixels.
    fn wrong(&self, pixels: &[Pixel], area: Rectangle) -> f64 {
        let mut sum = 0.0f32;
        for y in area.low[1]..area.high[1] {
            let row = y * SIZE + area.low[0]..y * SIZE + area.high[0];
            let counts = &self.counts[row.clone()];
            let pixels = pixels[row.clone()].iter().zip(&self.full[row]);
            for ((is, should), count) in pixels.zip(counts) {
                sum += count
                    * match (is.depth > NOTHING, should.depth > NOTHING) {
                        (true, true) => (is.color - should.color).length_squared(),
                        (false, false) => 0.0,
                        _ => OUTLINE,
                    };
            }
        }
        sum as f64 / (SIZE * SIZE) as f64
    }
}

/// Grows around projected points.
struct Reach {
    low: [f32; 2],
    high: [f32; 2],
}

impl Default for Reach {
    fn default() -> Self {
        Self {
            low: [f32::MAX; 2],
            high: [f32::MIN; 2],
        }
    }
}

impl Reach {
    fn add(&mut self, [x, y, _]: [f32; 3]) {
        self.low = [self.low[0].min(x), self.low[1].min(y)];
        self.high = [self.high[0].max(x), self.high[1].max(y)];
    }

    /// The pixels within; none where there are none.
    fn rectangle(&self) -> Option<Rectangle> {
        let at = |x: f32| (x.max(0.0) as usize).min(SIZE);
        let low = self.low.map(|x| at(x.floor()));
        let high = self.high.map(|x| at(x.ceil()));
        (low[0] < high[0] && low[1] < high[1]).then_some(Rectangle { low, high })
    }
}

fn shade(color: Vec4, light: f32, part: f32) -> Vec4 {
    (color.truncate() * (light * CHANNEL)).extend(part)
}

/// A number for a body part; those of different parts are apart.
fn part_value(part: u8) -> f32 {
    PART_CONTRAST * (part as f32 * 0.618_034).fract() * 2.0
}

fn double_sided(surface: &Surface, wedge: u32) -> bool {
    let Mesh {
        submesh, submeshes, ..
    } = &surface.mesh;
    submeshes[submesh[wedge as usize] as usize].double_sided
}
