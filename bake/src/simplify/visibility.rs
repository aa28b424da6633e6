//! How much of the full surface anybody can see: skin under clothes and the insides of heads deserve fewer triangles.

use super::surface::{Surface, cross, dot, length, sub};

/// Pixels in a row and a column of a depth image.
const PIXELS: usize = 256;
/// Depth within which a surface still counts as the nearest, as a share of the character's size.
const DEPTH_TOLERANCE: f32 = 0.005;
/// Cosine from which on a surface faces the viewer enough to ask whether it is seen.
const FACING_COSINE: f32 = 0.5;
/// What surfaces that face down count, which no viewer looks at straight.
const UNDERSIDE: f32 = 0.3;
/// Views: height of the viewer above the horizon in radians, and how many there are around.
const VIEWS: [(f32, usize); 3] = [(0.15, 8), (0.8, 6), (1.5, 1)];

/// Share of the views that see the front of each face, 0 to 1, among those that it faces; mean over two poses.
///
/// Viewers stand around the character and above it, as around crowds. Orthographic depth images; cost is linear in faces.
pub(super) fn visibility(surface: &Surface) -> Vec<f32> {
    let count = surface.faces.len();
    let (mut seen, mut asked) = (vec![0u32; count], vec![0u32; count]);
    for pose in [0, 1] {
        let normals: Vec<[f32; 3]> = (surface.faces.iter())
            .map(|f| {
                let n = surface.normal(f.points, pose);
                let long = length(n).max(f32::MIN_POSITIVE);
                n.map(|x| x / long)
            })
            .collect();
        for (height, around) in VIEWS {
            for i in 0..around {
                let angle = std::f32::consts::TAU * (i as f32 + 0.25) / around as f32;
                let view = View::new(surface, pose, height, angle);
                let depth = view.render(surface, &normals);
                for (f, face) in surface.faces.iter().enumerate() {
                    let facing = view.facing(surface, face.wedges[0], normals[f]);
                    if facing < FACING_COSINE {
                        continue;
                    }
                    let [a, b, c] = view.project(surface, face.points);
                    let center = [0, 1, 2].map(|k| (a[k] + b[k] + c[k]) / 3.0);
                    let (x, y) = (center[0] as usize, center[1] as usize);
                    let front = depth[y.min(PIXELS - 1) * PIXELS + x.min(PIXELS - 1)];
                    asked[f] += 1;
                    seen[f] += (center[2] > front - DEPTH_TOLERANCE) as u32;
                }
            }
        }
    }
    seen.iter()
        .zip(&asked)
        .map(|(&seen, &asked)| {
            if asked == 0 {
                UNDERSIDE
            } else {
                seen as f32 / asked as f32
            }
        })
        .collect()
}

/// An orthographic view of one pose.
struct View {
    pose: usize,
    right: [f32; 3],
    up: [f32; 3],
    /// Towards the viewer.
    back: [f32; 3],
    low: [f32; 2],
    pixels_per_unit: f32,
}

impl View {
    fn new(surface: &Surface, pose: usize, height: f32, angle: f32) -> Self {
        let back = [
            height.cos() * angle.sin(),
            height.sin(),
            height.cos() * angle.cos(),
        ];
        let right = [angle.cos(), 0.0, -angle.sin()];
        let up = cross(back, right);
        let (mut low, mut high) = ([f32::MAX; 2], [f32::MIN; 2]);
        for face in &surface.faces {
            for p in face.points {
                let p = surface.at(p).map(|x| x[pose]);
                for (k, axis) in [right, up].into_iter().enumerate() {
                    low[k] = low[k].min(dot(p, axis));
                    high[k] = high[k].max(dot(p, axis));
                }
            }
        }
        let size = (high[0] - low[0]).max(high[1] - low[1]).max(1e-6);
        Self {
            pose,
            right,
            up,
            back,
            low,
            pixels_per_unit: (PIXELS - 1) as f32 / size,
        }
    }

    /// Pixel x and y, and depth towards the viewer in the surface's unit, of three points.
    fn project(&self, surface: &Surface, points: [u32; 3]) -> [[f32; 3]; 3] {
        points.map(|p| {
            let p = surface.at(p).map(|x| x[self.pose]);
            [
                (dot(p, self.right) - self.low[0]) * self.pixels_per_unit,
                (dot(p, self.up) - self.low[1]) * self.pixels_per_unit,
                dot(p, self.back),
            ]
        })
    }

    /// Cosine between a face's normal and the view; both sides of a double-sided face count.
    fn facing(&self, surface: &Surface, wedge: u32, normal: [f32; 3]) -> f32 {
        let cosine = dot(normal, self.back);
        let submesh = surface.mesh.submesh[wedge as usize] as usize;
        if surface.mesh.submeshes[submesh].double_sided {
            cosine.abs()
        } else {
            cosine
        }
    }

    /// The nearest depth in every pixel.
    fn render(&self, surface: &Surface, normals: &[[f32; 3]]) -> Vec<f32> {
        let mut depth = vec![f32::MIN; PIXELS * PIXELS];
        for (face, &normal) in surface.faces.iter().zip(normals) {
            if self.facing(surface, face.wedges[0], normal) <= 0.0 {
                continue;
            }
            let [a, b, c] = self.project(surface, face.points);
            let (ab, ac) = (sub(b, a), sub(c, a));
            let area = ab[0] * ac[1] - ab[1] * ac[0];
            if area == 0.0 || !area.is_finite() {
                continue;
            }
            let range = |k: usize| {
                let low = a[k].min(b[k]).min(c[k]).ceil().max(0.0) as usize;
                let high = a[k].max(b[k]).max(c[k]).floor().max(-1.0) as isize + 1;
                low..(high as usize).min(PIXELS)
            };
            for y in range(1) {
                for x in range(0) {
                    let (px, py) = (x as f32 - a[0], y as f32 - a[1]);
                    let u = (px * ac[1] - py * ac[0]) / area;
                    let v = (ab[0] * py - ab[1] * px) / area;
                    if u >= 0.0 && v >= 0.0 && u + v <= 1.0 {
                        let pixel = &mut depth[y * PIXELS + x];
                        *pixel = pixel.max(a[2] + u * ab[2] + v * ac[2]);
                    }
                }
            }
        }
        depth
    }
}
