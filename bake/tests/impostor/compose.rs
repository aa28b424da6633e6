//! Draws impostors on the CPU as a renderer would, and measures them against the mesh.

use glam::{Mat2, Vec2, Vec3};
use throng_bake::baked::{Baked, PaletteEntry};
use throng_bake::impostor::capture::{CaptureBatch, CaptureView};
use throng_bake::impostor::{Impostors, Kind, NO_JOINT, Tile};

use crate::capture::capture;

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
    fn project(&self, p: Vec3) -> Vec2 {
        let p = p - self.center;
        let half = self.size as f32 * 0.5;
        Vec2::new(
            half + p.dot(self.right) * self.scale,
            half - p.dot(self.up) * self.scale,
        )
    }
}

/// Added to the mip that has a texel for each pixel; for tuning.
fn mip_bias() -> f32 {
    std::env::var("MIP_BIAS").map_or(0.0, |v| v.parse().unwrap())
}

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

/// The quads of a kind; `pose` is the captured pose for quads in model space.
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
    for quad in &i.quads[kind.first_quad as usize..][..kind.quad_count as usize] {
        let set = &i.view_sets[quad.view_set as usize];
        let (model_from_quad, pose) = if quad.joint == NO_JOINT {
            (glam::Affine3A::IDENTITY, pose)
        } else {
            (palette[quad.joint as usize].to_affine(), 0)
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
        let texels_per_pixel = f32::from(tile.size[0]) / across.length();
        let mip = (texels_per_pixel.log2() + mip_bias())
            .round()
            .clamp(0.0, (i.atlas.mip_count - 1) as f32) as u32;
        for y in low.y as u32..high.y as u32 {
            for x in low.x as u32..high.x as u32 {
                let at = tile_from_pixel * (Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - origin);
                if !(0.0..1.0).contains(&at.x) || !(0.0..1.0).contains(&at.y) {
                    continue;
                }
                let (color, surface) = fetch(i, tile, mip, at);
                if color[3] < 127.5 {
                    continue;
                }
                let z = (surface[3] / 255.0 * 2.0 - 1.0) * quad.depth_extent;
                let plane = Vec2::new(
                    tile.min[0] + (tile.max[0] - tile.min[0]) * at.x,
                    tile.max[1] - (tile.max[1] - tile.min[1]) * at.y,
                );
                let depth = place(plane.x, plane.y, z).dot(camera.direction);
                let pixel = (y * camera.size + x) as usize;
                if depth > depths[pixel] {
                    depths[pixel] = depth;
                    out[pixel] = [color[0] as u8, color[1] as u8, color[2] as u8, 255];
                }
            }
        }
    }
    out
}

/// Bilinear within one mip.
fn fetch(i: &Impostors, tile: &Tile, mip: u32, at: Vec2) -> ([f32; 4], [f32; 4]) {
    let (width, height, first) = i.atlas.mip(mip);
    let scale = 1.0 / (1 << mip) as f32;
    let corner = Vec2::new(tile.texel[0].into(), tile.texel[1].into()) * scale;
    let size = Vec2::new(tile.size[0].into(), tile.size[1].into()) * scale;
    let place = corner + at * size - 0.5;
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
