//! Draws impostors on the CPU as a renderer would, and measures them against the mesh.

use glam::{Mat2, Vec2, Vec3};
use throng_bake::baked::{Baked, PaletteEntry};
use throng_bake::impostor::capture::{CaptureBatch, CaptureView};
use throng_bake::impostor::{Impostors, Kind, NO_JOINT, Tile};

use crate::capture::capture;

/// What the renderer draws of a tile.
struct Shown {
    min: [f32; 2],
    max: [f32; 2],
    texel: Vec2,
    size: Vec2,
    lean: [f32; 3],
}

/// A small orthographic view of a whole character.
#[derive(Clone, Copy)]
pub struct Camera {
    /// Towards the eye.
    pub direction: Vec3,
    pub right: Vec3,
    pub up: Vec3,
    /// What is in the middle.
    pub center: Vec3,
    /// Pixels per unit of model space.
    pub scale: f32,
    /// Columns and rows.
    pub size: u32,
}

impl Camera {
    pub fn new(direction: Vec3, center: Vec3, scale: f32, size: u32) -> Self {
        let right = Vec3::Y.cross(direction).try_normalize().unwrap_or(Vec3::X);
        Self {
            direction,
            right,
            up: direction.cross(right),
            center,
            scale,
            size,
        }
    }

    /// Pixels, rows downwards.
    pub fn project(&self, p: Vec3) -> Vec2 {
        let p = p - self.center;
        let half = self.size as f32 * 0.5;
        Vec2::new(
            half + p.dot(self.right) * self.scale,
            half - p.dot(self.up) * self.scale,
        )
    }
}

/// As the renderer's: `IMPOSTOR_MIP_BIAS`, `SOFT_EDGE` and its outline, `SHARPNESS_MIN` and `SHARPNESS_MAX`, `CORE`, `RIM_BEHIND` and `MIN_SLANT` of its shaders.
const MIP_BIAS: f32 = -0.75;
const SOFT_EDGE: f32 = 0.2;
const SOFT_EDGE_OUTLINE: u8 = 89;
const SHARPNESS: [f32; 2] = [0.5, 3.75];
const CORE: f32 = 0.75;
const RIM_BEHIND: f32 = 2.0;
const MIN_SLANT: f32 = 0.4;

/// What a pixel shows; alpha 0 for nothing.
pub type Pixels = Vec<[u8; 4]>;

/// The mesh itself.
pub fn mesh(baked: &Baked, palette: &[PaletteEntry], camera: &Camera) -> Pixels {
    let half = Vec2::splat(camera.size as f32 * 0.5 / camera.scale);
    let batch = CaptureBatch {
        poses: palette.to_vec(),
        groups: vec![0; baked.joints.len()],
        error: 0.0,
        views: vec![CaptureView {
            pose: 0,
            group: None,
            center: camera.center,
            right: camera.right,
            up: camera.up,
            min: -half,
            max: half,
            depth_extent: 1.0,
            size: [camera.size; 2],
        }],
    };
    capture(baked, &batch).remove(0).color
}

/// The quads of a kind, each as the nearest view; `pose` is the captured pose for quads in model space. A pixel shows what
/// covers at least half of it.
pub fn impostor(
    i: &Impostors,
    kind: Kind,
    palette: &[PaletteEntry],
    pose: u32,
    camera: &Camera,
) -> Pixels {
    let kind = i.kinds.iter().find(|k| k.kind == kind).unwrap();
    let pixels = (camera.size * camera.size) as usize;
    let (mut out, mut depths) = (vec![[0; 4]; pixels], vec![f32::NEG_INFINITY; pixels]);
    let mut shares = vec![0.0; pixels];
    for quad in &i.quads[kind.first_quad as usize..][..kind.quad_count as usize] {
        let is_soft = quad.joint == NO_JOINT;
        let set = &i.view_sets[quad.view_set as usize];
        let (model_from_quad, pose) = match is_soft {
            true => (glam::Affine3A::IDENTITY, pose),
            false => (palette[quad.joint as usize].to_affine(), 0),
        };
        let seen_from = model_from_quad
            .inverse()
            .transform_vector3(camera.direction)
            .normalize();
        let view = set.lookup(seen_from)[0] as usize;
        let tile = &i.tiles[quad.first_tile as usize + pose as usize * set.directions.len() + view];
        if tile.size[0] == 0 {
            continue;
        }
        let tile = trimmed(i, tile);
        let (right, up, toward) = (set.rights[view], set.up(view), set.directions[view]);
        let place = |x: f32, y: f32, z: f32| {
            model_from_quad.transform_point3(quad.center + right * x + up * y + toward * z)
        };
        let [a, b, c] = tile.lean;
        let leaning = |x: f32, y: f32| place(x, y, a * x + b * y + c);
        let origin = camera.project(leaning(tile.min[0], tile.max[1]));
        let across = camera.project(leaning(tile.max[0], tile.max[1])) - origin;
        let down = camera.project(leaning(tile.min[0], tile.min[1])) - origin;
        let tile_from_pixel = Mat2::from_cols(across, down).inverse();
        let ray = Vec2::new(seen_from.dot(right), seen_from.dot(up));
        let slant = (seen_from.dot(toward) - a * ray.x - b * ray.y).max(MIN_SLANT);
        let extent = Vec2::from(tile.max) - Vec2::from(tile.min);
        // Shares of the tile by depth before its plane.
        let shift = ray / slant / Vec2::new(extent.x, -extent.y);
        let corners = [
            origin,
            origin + across,
            origin + down,
            origin + across + down,
        ];
        let low = corners
            .into_iter()
            .reduce(Vec2::min)
            .unwrap()
            .floor()
            .max(Vec2::ZERO);
        let high = corners.into_iter().reduce(Vec2::max).unwrap().ceil();
        let high = high.min(Vec2::splat(camera.size as f32));
        let texels_per_pixel = tile.size.y / extent.x / camera.scale;
        let mip = (texels_per_pixel.max(1.0).log2() + MIP_BIAS)
            .round()
            .clamp(0.0, (i.atlas.mip_count - 1) as f32) as u32;
        let sharpness = (1u32 << mip) as f32 / texels_per_pixel;
        let sharpness = sharpness.clamp(SHARPNESS[0], SHARPNESS[1]);
        let depth_of = |surface: [f32; 4]| (surface[3] / 255.0 * 2.0 - 1.0) * quad.depth_extent;
        for y in low.y as u32..high.y as u32 {
            for x in low.x as u32..high.x as u32 {
                let mut at = tile_from_pixel * (Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - origin);
                if !(0.0..1.0).contains(&at.x) || !(0.0..1.0).contains(&at.y) {
                    continue;
                }
                let plane = Vec2::new(tile.min[0] + extent.x * at.x, tile.max[1] - extent.y * at.y);
                if is_soft {
                    let surface = fetch(i, &tile, mip, at, true).1;
                    let before = depth_of(surface) - (a * plane.x + b * plane.y + c);
                    at = (at + before * shift).clamp(Vec2::ZERO, Vec2::ONE);
                }
                let (color, surface) = fetch(i, &tile, mip, at, false);
                let coverage = ((color[3] / 255.0 - 0.5) * 2.0 * sharpness + 0.5).clamp(0.0, 1.0);
                if coverage < SOFT_EDGE {
                    continue;
                }
                // A rim blends, and stands behind so that it hides none of the body.
                let is_core = is_soft || coverage >= CORE;
                let behind = if is_core {
                    0.0
                } else {
                    RIM_BEHIND * quad.depth_extent
                };
                let depth = place(plane.x, plane.y, depth_of(surface) - behind);
                let depth = depth.dot(camera.direction);
                let pixel = (y * camera.size + x) as usize;
                if depth > depths[pixel] {
                    let covered = if is_core && !is_soft { 1.0 } else { coverage };
                    depths[pixel] = depth;
                    shares[pixel] += (1.0 - shares[pixel]) * covered;
                    out[pixel] = [color[0] as u8, color[1] as u8, color[2] as u8, 255];
                }
            }
        }
    }
    for (pixel, share) in out.iter_mut().zip(shares) {
        if share < 0.5 {
            *pixel = [0; 4];
        }
    }
    out
}

/// The tile without the texels around it that show nothing, but for half of one on each side, as the renderer draws it.
fn trimmed(i: &Impostors, tile: &Tile) -> Shown {
    let [columns, rows] = tile.size.map(u32::from);
    let (mut first, mut last) = ([columns, rows], [0, 0]);
    for (y, x) in (0..rows).flat_map(|y| (0..columns).map(move |x| (y, x))) {
        let at = (u32::from(tile.texel[1]) + y) * i.atlas.width + u32::from(tile.texel[0]) + x;
        if i.atlas.color[at as usize][3] >= SOFT_EDGE_OUTLINE {
            first = [first[0].min(x), first[1].min(y)];
            last = [last[0].max(x + 1), last[1].max(y + 1)];
        }
    }
    if first[0] >= last[0] {
        (first, last) = ([0, 0], [columns, rows]);
    }
    let first = first.map(|x| (x as f32 - 0.5).max(0.0));
    let last = [
        (last[0] as f32 + 0.5).min(columns as f32),
        (last[1] as f32 + 0.5).min(rows as f32),
    ];
    let side = (tile.max[0] - tile.min[0]) / rows as f32;
    Shown {
        min: [tile.min[0] + first[1] * side, tile.max[1] - last[0] * side],
        max: [tile.min[0] + last[1] * side, tile.max[1] - first[0] * side],
        texel: Vec2::new(tile.texel[0].into(), tile.texel[1].into()) + Vec2::from(first),
        size: Vec2::from(last) - Vec2::from(first),
        lean: tile.lean,
    }
}

/// Colour and surface within one mip, bilinear, or of the nearest texel.
fn fetch(i: &Impostors, tile: &Shown, mip: u32, at: Vec2, nearest: bool) -> ([f32; 4], [f32; 4]) {
    let (width, height, first) = i.atlas.mip(mip);
    let scale = 1.0 / (1 << mip) as f32;
    let (corner, size) = (tile.texel * scale, tile.size * scale);
    // It lies on its side.
    let place = corner + Vec2::new(at.y, at.x) * size - 0.5;
    let place = if nearest { place.round() } else { place };
    let low = place.floor();
    let part = place - low;
    let (mut color, mut surface) = ([0.0; 4], [0.0; 4]);
    for (dx, dy, weight) in [
        (0.0, 0.0, (1.0 - part.x) * (1.0 - part.y)),
        (1.0, 0.0, part.x * (1.0 - part.y)),
        (0.0, 1.0, (1.0 - part.x) * part.y),
        (1.0, 1.0, part.x * part.y),
    ] {
        let x = (low.x + dx).clamp(0.0, width as f32 - 1.0) as usize;
        let y = (low.y + dy).clamp(0.0, height as f32 - 1.0) as usize;
        let texel = first + y * width as usize + x;
        for c in 0..4 {
            color[c] += weight * f32::from(i.atlas.color[texel][c]);
            surface[c] += weight * f32::from(i.atlas.surface[texel][c]);
        }
    }
    (color, surface)
}

/// How two silhouettes differ.
#[derive(Debug, Clone, Copy)]
pub struct Difference {
    /// Intersection over union.
    pub iou: f32,
    /// Pixels that the mesh covers with all their neighbours, and the impostor does not: holes wider than a pixel.
    pub holes: u32,
    /// Pixels of the impostor that are further than a pixel from the mesh.
    pub stray: u32,
    /// Pixels of the impostor less those of the mesh, as a share of the mesh's.
    pub bias: f32,
}

pub fn compare(mesh: &Pixels, impostor: &Pixels, size: u32) -> Difference {
    let size = size as i32;
    let covers = |p: &Pixels, x: i32, y: i32| {
        (0..size).contains(&x) && (0..size).contains(&y) && p[(y * size + x) as usize][3] > 0
    };
    let around =
        |x: i32, y: i32| (-1..=1).flat_map(move |dy| (-1..=1).map(move |dx| (x + dx, y + dy)));
    let area = |p: &Pixels| p.iter().filter(|p| p[3] > 0).count().max(1) as f32;
    let (mut both, mut either, mut holes, mut stray) = (0, 0, 0, 0);
    for y in 0..size {
        for x in 0..size {
            let (a, b) = (covers(mesh, x, y), covers(impostor, x, y));
            both += u32::from(a && b);
            either += u32::from(a || b);
            holes += u32::from(!b && around(x, y).all(|(x, y)| covers(mesh, x, y)));
            stray += u32::from(b && around(x, y).all(|(x, y)| !covers(mesh, x, y)));
        }
    }
    Difference {
        iou: both as f32 / (either as f32).max(1.0),
        holes,
        stray,
        bias: area(impostor) / area(mesh) - 1.0,
    }
}

/// `count` directions, evenly over the sphere above `lowest_y`.
pub fn directions(count: usize, lowest_y: f32) -> impl Iterator<Item = Vec3> {
    (0..count).map(move |i| {
        let y = lowest_y + (1.0 - lowest_y) * (i as f32 + 0.5) / count as f32;
        let turn = i as f32 * 2.399_963;
        let r = (1.0 - y * y).sqrt();
        Vec3::new(r * turn.sin(), y, r * turn.cos())
    })
}
