//! The looks of vertices with which a level looks most like the full mesh, from all pictures at once.

use glam::Vec3;
use rayon::prelude::*;

use super::super::surface::Surface;
use super::raster::raster;
use super::{ALL, CHANNEL, NOTHING, POSES, Pictures, SIZE, double_sided, part_value};

/// What holds a fitted colour where it was, as a share of what pictures say of a wedge on average.
const HOLD: f32 = 0.03;
/// Rounds of the fit of colours.
const SOLVE_ROUNDS: usize = 40;

impl Pictures {
    /// The colours (gamma space) and body parts of wedges with which the level that `faces` are looks most like the full mesh.
    /// Where pictures show little of a wedge, it stays nearly as it is.
    pub fn fit_looks(&self, surface: &Surface, faces: &[u32]) -> Vec<(u32, Vec3, u8)> {
        let mut wedges: Vec<u32> = (faces.iter())
            .flat_map(|&f| surface.faces[f as usize].wedges)
            .collect();
        wedges.sort_unstable();
        wedges.dedup();
        let n = wedges.len();
        let index = |w: u32| wedges.binary_search(&w).unwrap_or(0);
        let lights: Vec<[f32; POSES]> = wedges.iter().map(|&w| self.lights(surface, w)).collect();
        let parts: Vec<f32> = (0..=u8::MAX).map(part_value).collect();
        let fits = self.views.par_iter().map(|view| {
            let mut fit = LookFit::new(n);
            let mut shown: Vec<(f32, u32, [f32; 3])> = vec![(NOTHING, 0, [0.0; 3]); SIZE * SIZE];
            for &f in faces {
                let face = &surface.faces[f as usize];
                let corners = face.points.map(|p| view.places[p as usize]);
                raster(
                    corners,
                    double_sided(surface, face.wedges[0]),
                    ALL,
                    |span| {
                        for i in 0..span.len {
                            let b = [0, 1, 2].map(|k| span.at[k] + span.step[k] * i as f32);
                            let depth = (0..3).map(|k| corners[k][2] * b[k]).sum();
                            let pixel = &mut shown[span.first + i];
                            if depth > pixel.0 {
                                *pixel = (depth, f, b);
                            }
                        }
                    },
                );
            }
            for (i, &(depth, f, b)) in shown.iter().enumerate() {
                let full = &view.full[i];
                if depth == NOTHING || full.depth == NOTHING {
                    continue;
                }
                let at = surface.faces[f as usize].wedges.map(index);
                let a = [0, 1, 2].map(|k| b[k] * lights[at[k]][view.slot]);
                let weight = view.weight * view.counts[i];
                let part = parts.iter().position(|&p| p == full.color.w).unwrap_or(0);
                fit.add(
                    at,
                    a,
                    b,
                    weight,
                    full.color.truncate() / CHANNEL,
                    part as u8,
                );
            }
            fit
        });
        let fits: Vec<LookFit> = fits.collect();
        let mut all = LookFit::new(n);
        fits.iter().for_each(|f| all.merge(f));
        let now = |w: u32| {
            let [r, g, b, _] = surface.mesh.colors[w as usize].map(|c| f32::from(c) / 255.0);
            Vec3::new(r, g, b)
        };
        let colors = all.solve(wedges.iter().map(|&w| now(w)).collect());
        (wedges.iter().zip(colors).enumerate())
            .map(|(i, (&w, color))| {
                let part = all.part(i).unwrap_or(surface.mesh.body_parts[w as usize]);
                (w, color, part)
            })
            .collect()
    }
}

/// Normal equations of wedges' colours.
struct LookFit {
    matrix: Vec<f32>,
    right: Vec<Vec3>,
    parts: Vec<Vec<(u8, f32)>>,
}

impl LookFit {
    fn new(n: usize) -> Self {
        Self {
            matrix: vec![0.0; n * n],
            right: vec![Vec3::ZERO; n],
            parts: vec![Vec::new(); n],
        }
    }

    /// A pixel with the colour and body part of the full mesh, where wedges `at` have `a` as factors of their colours.
    fn add(
        &mut self,
        at: [usize; 3],
        a: [f32; 3],
        b: [f32; 3],
        weight: f32,
        color: Vec3,
        part: u8,
    ) {
        let n = self.right.len();
        for i in 0..3 {
            for k in 0..3 {
                self.matrix[at[i] * n + at[k]] += weight * a[i] * a[k];
            }
            self.right[at[i]] += weight * a[i] * color;
            self.count(at[i], part, weight * b[i]);
        }
    }

    fn count(&mut self, wedge: usize, part: u8, weight: f32) {
        let parts = &mut self.parts[wedge];
        match parts.iter_mut().find(|p| p.0 == part) {
            Some(p) => p.1 += weight,
            None => parts.push((part, weight)),
        }
    }

    fn merge(&mut self, other: &Self) {
        self.matrix
            .iter_mut()
            .zip(&other.matrix)
            .for_each(|(a, b)| *a += b);
        self.right
            .iter_mut()
            .zip(&other.right)
            .for_each(|(a, b)| *a += *b);
        for (wedge, parts) in other.parts.iter().enumerate() {
            for &(part, weight) in parts {
                self.count(wedge, part, weight);
            }
        }
    }

    fn part(&self, wedge: usize) -> Option<u8> {
        let parts = self.parts[wedge].iter();
        parts
            .max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)))
            .map(|p| p.0)
    }

    /// The best colours near `start`, 0 to 1.
    fn solve(&self, start: Vec<Vec3>) -> Vec<Vec3> {
        let n = start.len();
        let trace: f32 = (0..n).map(|i| self.matrix[i * n + i]).sum();
        let hold = HOLD * trace / n.max(1) as f32 + f32::MIN_POSITIVE;
        let mut x = start.clone();
        for _ in 0..SOLVE_ROUNDS {
            for i in 0..n {
                let row = &self.matrix[i * n..][..n];
                let mut rest = self.right[i] + hold * start[i];
                for (k, &m) in row.iter().enumerate() {
                    if k != i && m != 0.0 {
                        rest -= m * x[k];
                    }
                }
                x[i] = (rest / (row[i] + hold)).clamp(Vec3::ZERO, Vec3::ONE);
            }
        }
        x
    }
}
