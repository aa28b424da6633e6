//! Takes pictures on the CPU: an orthographic rasteriser with a depth buffer, as simple as it can be.

use glam::{Affine3A, Vec2, Vec3};
use rayon::prelude::*;
use throng_bake::baked::{Baked, PaletteEntry, Vertex};
use throng_bake::impostor::capture::{CaptureBatch, CaptureView, CapturedView};
use throng_bake::mesh::Mesh;
use throng_bake::quantize::{decode_normal, decode_position, decode_uv, decode_weights};

/// Surfaces with at least this weight in a picture's group are in front of those with less.
const OWN_WEIGHT: f32 = 0.3;

/// A triangle's corners and what its submesh says.
struct Triangle {
    corners: [u32; 3],
    double_sided: bool,
    alpha_cutoff: f32,
}

/// The level of detail that `error` allows, as triangles.
fn triangles(baked: &Baked, error: f32) -> Vec<Triangle> {
    let mut out = Vec::new();
    for s in &baked.submeshes {
        let bands = &baked.bands[s.first_band as usize..][..s.band_count as usize];
        let band = bands
            .iter()
            .rev()
            .find(|b| b.error <= error)
            .unwrap_or(&bands[0]);
        let window = &baked.indices[band.first_index as usize..][..band.index_count as usize];
        out.extend(window.chunks_exact(3).map(|t| Triangle {
            corners: [0, 1, 2].map(|k| t[k] + s.first_vertex),
            double_sided: s.info.double_sided,
            alpha_cutoff: s.info.alpha_cutoff.unwrap_or(0.0),
        }));
    }
    out
}

/// Answers a batch.
pub fn capture(baked: &Baked, batch: &CaptureBatch) -> Vec<CapturedView> {
    let triangles = triangles(baked, batch.error);
    let posed: Vec<Vec<(Vec3, Vec3)>> = batch
        .poses
        .par_chunks(baked.joints.len())
        .map(|palette| skinned(baked, palette))
        .collect();
    let take = |v: &CaptureView| picture(baked, batch, v, &triangles, &posed[v.pose as usize]);
    batch.views.par_iter().map(take).collect()
}

/// Position and normal of every vertex.
pub fn skinned(baked: &Baked, palette: &[PaletteEntry]) -> Vec<(Vec3, Vec3)> {
    let palette: Vec<Affine3A> = palette.iter().map(PaletteEntry::to_affine).collect();
    let skin = |v: &Vertex| {
        let place = decode_position(v, baked.position_min, baked.position_extent);
        let normal = decode_normal(v.normal);
        let (mut position, mut turned) = (Vec3::ZERO, Vec3::ZERO);
        for (joint, weight) in v.joints.into_iter().zip(decode_weights(v.weights)) {
            position += weight * palette[joint as usize].transform_point3(place);
            turned += weight * palette[joint as usize].transform_vector3(normal);
        }
        (position, turned.normalize_or_zero())
    };
    baked.vertices.iter().map(skin).collect()
}

fn picture(
    baked: &Baked,
    batch: &CaptureBatch,
    view: &CaptureView,
    triangles: &[Triangle],
    posed: &[(Vec3, Vec3)],
) -> CapturedView {
    let [columns, rows] = view.size.map(|n| n as usize);
    let mut out = CapturedView {
        color: vec![[0; 4]; columns * rows],
        surface: vec![[0; 4]; columns * rows],
    };
    // By pixel: whether what is there follows the picture's group, and its depth.
    let mut places = vec![(false, f32::NEG_INFINITY); columns * rows];
    let both_faces = view.group.is_some();
    let toward = view.right.cross(view.up);
    let scale = Vec2::new(columns as f32, rows as f32) / (view.max - view.min);
    let weight_of = |v: &Vertex| match view.group {
        None => 1.0,
        Some(group) => {
            let own = v.joints.iter().zip(decode_weights(v.weights));
            let own = own.filter(|(j, _)| batch.groups[**j as usize] == group);
            own.map(|(_, w)| w).sum::<f32>()
        }
    };
    for triangle in triangles {
        let vertices = triangle.corners.map(|c| &baked.vertices[c as usize]);
        let weights = vertices.map(weight_of);
        if weights == [0.0; 3] {
            continue;
        }
        let at = triangle.corners.map(|c| {
            let p = posed[c as usize].0 - view.center;
            let plane = (Vec2::new(p.dot(view.right), p.dot(view.up)) - view.min) * scale;
            Vec3::new(plane.x, rows as f32 - plane.y, p.dot(toward))
        });
        let edge =
            |a: Vec3, b: Vec3, x: f32, y: f32| (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x);
        // Rows grow downwards, so what turns counter-clockwise has a negative area here.
        let area = -edge(at[0], at[1], at[2].x, at[2].y);
        if area == 0.0 || (area < 0.0 && !triangle.double_sided && !both_faces) {
            continue;
        }
        let side = area.signum();
        let low = at[0].min(at[1]).min(at[2]);
        let high = at[0].max(at[1]).max(at[2]);
        let range = |low: f32, high: f32, n: usize| {
            (low - 0.5).ceil().max(0.0) as usize..((high + 0.5).floor().max(0.0) as usize).min(n)
        };
        for y in range(low.y, high.y, rows) {
            for x in range(low.x, high.x, columns) {
                let (px, py) = (x as f32 + 0.5, y as f32 + 0.5);
                let w = [
                    -edge(at[1], at[2], px, py) / area,
                    -edge(at[2], at[0], px, py) / area,
                    -edge(at[0], at[1], px, py) / area,
                ];
                if w.iter().any(|&w| w < 0.0) {
                    continue;
                }
                let mix = |f: &dyn Fn(usize) -> f32| (0..3).map(|k| w[k] * f(k)).sum::<f32>();
                let i = y * columns + x;
                let depth = mix(&|k| at[k].z);
                let weight = mix(&|k| weights[k]);
                let place = (weight >= OWN_WEIGHT, depth);
                if place <= places[i] || weight <= 0.0 {
                    continue;
                }
                let color = color(baked, vertices, w);
                if color[3] < triangle.alpha_cutoff {
                    continue;
                }
                places[i] = place;
                let normal = (0..3).fold(Vec3::ZERO, |n, k| {
                    n + w[k] * posed[triangle.corners[k] as usize].1
                }) * side;
                let normal = normal.normalize_or_zero();
                let axis = |a: Vec3| (128.0 + 127.0 * normal.dot(a)).round() as u8;
                let part = vertices[0].body_part;
                let rule = baked.body_parts[part as usize].tint as u8;
                let far = (depth / view.depth_extent * 0.5 + 0.5).clamp(0.0, 1.0);
                let byte = |x: f32| (x * 255.0 + 0.5) as u8;
                out.color[i] = [
                    byte(color[0]),
                    byte(color[1]),
                    byte(color[2]),
                    (1.0 + 254.0 * weight.min(1.0)).round() as u8,
                ];
                out.surface[i] = [
                    axis(view.right),
                    axis(view.up),
                    part.min(63) | rule << 6,
                    byte(far),
                ];
            }
        }
    }
    out
}

/// sRGB colour and alpha, 0 to 1, with the nearest texel of the finest mip.
fn color(baked: &Baked, vertices: [&Vertex; 3], w: [f32; 3]) -> [f32; 4] {
    let mix = |f: &dyn Fn(usize) -> f32| (0..3).map(|k| w[k] * f(k)).sum::<f32>();
    let mut color: [f32; 4] =
        std::array::from_fn(|c| mix(&|k| f32::from(vertices[k].color[c]) / 255.0));
    let layer = vertices[0].layer;
    if layer != Mesh::UNTEXTURED {
        let uv = vertices.map(|v| decode_uv(v, baked.uv_min, baked.uv_extent));
        let uv = uv[0] * w[0] + uv[1] * w[1] + uv[2] * w[2];
        let t = &baked.textures;
        let at = |x: f32, n: u32| ((x.rem_euclid(1.0) * n as f32) as u32).min(n - 1) as usize;
        let layer = layer as usize * (t.width * t.height) as usize;
        let texel = t.pixels[layer + at(uv.y, t.height) * t.width as usize + at(uv.x, t.width)];
        for (c, t) in color.iter_mut().zip(texel) {
            *c *= f32::from(t) / 255.0;
        }
    }
    color
}
