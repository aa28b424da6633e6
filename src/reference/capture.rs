//! Twin of hlsl/capture.hlsl: one picture of a character by a plain rasteriser. Pixels are sampled at their centres and edges
//! belong to triangles by the top-left rule; pixels on the edges of triangles may come out differently on a device.

use glam::{Vec2, Vec3, Vec4};
use throng_bake::baked::{Baked, TextureArray, Vertex};
use throng_bake::impostor::capture::{CaptureBatch, CaptureView, CapturedView};
use throng_bake::mesh::Mesh;
use throng_bake::quantize::{decode_uv, decode_weights};
use throng_bake::sliding_tris::band_at;

use super::mesh::{living_ancestor, skin_vertex};
use crate::gpu_types::{CAPTURE_DEPTH_REACH, CAPTURE_WEIGHT_MIN, CAPTURE_WEIGHT_OWN, Instance};

/// Devices snap corners to this share of a pixel.
const SUBPIXEL: f32 = 1.0 / 256.0;

/// One of a batch's views; the batch is valid ([`crate::capture::validate`]).
pub fn capture(baked: &Baked, batch: &CaptureBatch, view: &CaptureView) -> CapturedView {
    let pixel_count = view.size[0] as usize * view.size[1] as usize;
    let mut target = Target {
        view,
        places: vec![(false, -CAPTURE_DEPTH_REACH); pixel_count],
        picture: CapturedView {
            color: vec![[0; 4]; pixel_count],
            surface: vec![[0; 4]; pixel_count],
        },
    };
    for submesh in &baked.submeshes {
        let first = submesh.first_vertex as usize;
        let material = Material {
            textures: &baked.textures,
            double_sided: submesh.info.double_sided,
            alpha_cutoff: submesh.info.alpha_cutoff.unwrap_or(f32::NEG_INFINITY),
        };
        let collapse = &baked.collapse[first..][..submesh.vertex_count as usize];
        let live = match batch.error > 0.0 {
            true => collapse
                .iter()
                .take_while(|c| c.error > batch.error)
                .count() as u32,
            false => submesh.vertex_count,
        };
        let bands = &baked.bands[submesh.first_band as usize..][..submesh.band_count as usize];
        let window = band_at(bands, live).map_or(&[][..], |b| {
            &baked.indices[b.first_index as usize..][..b.index_count as usize]
        });
        for triangle in window.chunks_exact(3) {
            let [a, b, c] = [triangle[0], triangle[1], triangle[2]]
                .map(|v| living_ancestor(baked, first, v, live).0);
            if a != b && b != c && c != a {
                let corners = [a, b, c].map(|v| shade(baked, batch, view, first + v as usize));
                target.draw(&corners, &material);
            }
        }
    }
    target.picture
}

/// What a corner hands to the pixels.
#[derive(Clone, Copy)]
struct Corner {
    /// Pixels from the left and top edge.
    position: Vec2,
    /// Towards the eye in depth extents.
    depth: f32,
    /// In the picture's frame.
    normal: Vec3,
    color: Vec4,
    weight: f32,
    uv: Vec2,
    layer: u8,
    part: u8,
}

struct Material<'a> {
    textures: &'a TextureArray,
    double_sided: bool,
    alpha_cutoff: f32,
}

struct Target<'a> {
    view: &'a CaptureView,
    /// By pixel: whether what is there follows the picture's group, and its depth.
    places: Vec<(bool, f32)>,
    picture: CapturedView,
}

fn shade(baked: &Baked, batch: &CaptureBatch, view: &CaptureView, vertex: usize) -> Corner {
    let v = &baked.vertices[vertex];
    let pose = Instance {
        position: [0.0; 3],
        heading_cos: 1.0,
        tint_seed: 0,
        live_vertex_count: 0,
        packed: Instance::pack(4, 1, 0),
        heading_sin: 0.0,
        sample_entries: [view.pose * baked.joints.len() as u32, 0, 0, 0],
        sample_weights: [1.0, 0.0, 0.0],
        padding0: 0,
    };
    let skinned = skin_vertex(baked, &batch.poses, v, &pose);
    let to_eye = view.right.cross(view.up);
    let p = skinned.position - view.center;
    let size = Vec2::new(view.size[0] as f32, view.size[1] as f32);
    let fraction =
        (Vec2::new(p.dot(view.right), p.dot(view.up)) - view.min) / (view.max - view.min);
    let position = Vec2::new(fraction.x, 1.0 - fraction.y) * size;
    let n = skinned.normal;
    Corner {
        position: (position / SUBPIXEL).round() * SUBPIXEL,
        depth: p.dot(to_eye) / view.depth_extent,
        normal: Vec3::new(n.dot(view.right), n.dot(view.up), n.dot(to_eye)),
        color: Vec4::from(v.color.map(f32::from)) / 255.0,
        weight: weight_in_group(v, batch, view.group),
        uv: decode_uv(v, baked.uv_min, baked.uv_extent),
        layer: v.layer,
        part: baked.body_parts[v.body_part as usize].code(v.body_part),
    }
}

fn weight_in_group(vertex: &Vertex, batch: &CaptureBatch, group: Option<u8>) -> f32 {
    let Some(group) = group else { return 1.0 };
    let influences = vertex.joints.iter().zip(decode_weights(vertex.weights));
    influences
        .filter(|(j, _)| batch.groups[**j as usize] == group)
        .map(|(_, w)| w)
        .sum::<f32>()
        .min(1.0)
}

/// Twice the signed area of a triangle; positive where it turns counter-clockwise on the screen, whose y goes down.
fn area(a: Vec2, b: Vec2, c: Vec2) -> f32 {
    (c - a).perp_dot(b - a)
}

/// The edge from `a` to `b`, with the triangle on its left, owns the samples on it.
fn owns(a: Vec2, b: Vec2) -> bool {
    let d = b - a;
    // Left edges go down the screen, top edges go left.
    d.y > 0.0 || (d.y == 0.0 && d.x < 0.0)
}

impl Target<'_> {
    fn draw(&mut self, corners: &[Corner; 3], material: &Material) {
        let signed = area(
            corners[0].position,
            corners[1].position,
            corners[2].position,
        );
        let front = signed > 0.0;
        let both_faces = material.double_sided || self.view.group.is_some();
        if signed == 0.0 || !(front || both_faces) {
            return;
        }
        let part = corners[0].part;
        let [a, b, c] = match front {
            true => *corners,
            false => [corners[0], corners[2], corners[1]],
        };
        let p = [a.position, b.position, c.position];
        let level = mip_level(&[a, b, c], signed.abs(), material.textures);
        let [width, height] = self.view.size;
        let low = p[0].min(p[1]).min(p[2]);
        let high = p[0].max(p[1]).max(p[2]);
        // Float to integer conversion clamps at 0.
        let [x0, y0] = [low.x as u32, low.y as u32];
        let [x1, y1] = [(high.x + 1.0) as u32, (high.y + 1.0) as u32];
        for y in y0..y1.min(height) {
            for x in x0..x1.min(width) {
                let s = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let edges = [
                    area(p[1], p[2], s),
                    area(p[2], p[0], s),
                    area(p[0], p[1], s),
                ];
                let on = [owns(p[1], p[2]), owns(p[2], p[0]), owns(p[0], p[1])];
                if (0..3).all(|i| edges[i] > 0.0 || (edges[i] == 0.0 && on[i])) {
                    let shares = edges.map(|e| e / signed.abs());
                    let corner = mix(&[a, b, c], shares);
                    let pixel = (y * width + x) as usize;
                    self.pixel(pixel, &corner, part, front, level, material);
                }
            }
        }
    }

    fn pixel(
        &mut self,
        pixel: usize,
        at: &Corner,
        part: u8,
        front: bool,
        level: u32,
        material: &Material,
    ) {
        let place = (at.weight >= CAPTURE_WEIGHT_OWN, at.depth);
        if place < self.places[pixel]
            || at.depth > CAPTURE_DEPTH_REACH
            || at.weight < CAPTURE_WEIGHT_MIN
        {
            return;
        }
        let mut color = at.color;
        if at.layer != Mesh::UNTEXTURED {
            color *= sample(material.textures, at.layer, at.uv, level);
        }
        if color.w < material.alpha_cutoff {
            return;
        }
        let mut normal = if front { at.normal } else { -at.normal };
        normal.z = normal.z.max(0.0);
        let normal = normal.normalize_or_zero();
        let byte = |x: f32| x.clamp(0.0, 255.0).round() as u8;
        self.places[pixel] = place;
        self.picture.color[pixel] = [
            byte(color.x * 255.0),
            byte(color.y * 255.0),
            byte(color.z * 255.0),
            byte(1.0 + 254.0 * at.weight.clamp(0.0, 1.0)),
        ];
        self.picture.surface[pixel] = [
            byte(128.0 + 127.0 * normal.x),
            byte(128.0 + 127.0 * normal.y),
            part,
            byte(255.0 * (0.5 + 0.5 * at.depth)),
        ];
    }
}

fn mix(corners: &[Corner; 3], shares: [f32; 3]) -> Corner {
    let mut at = Corner {
        position: Vec2::ZERO,
        depth: 0.0,
        normal: Vec3::ZERO,
        color: Vec4::ZERO,
        weight: 0.0,
        uv: Vec2::ZERO,
        ..corners[0]
    };
    for (c, share) in corners.iter().zip(shares) {
        at.depth += share * c.depth;
        at.normal += share * c.normal;
        at.color += share * c.color;
        at.weight += share * c.weight;
        at.uv += share * c.uv;
    }
    at
}

/// The mip whose texels are nearest to a pixel in size.
fn mip_level(corners: &[Corner; 3], area: f32, textures: &TextureArray) -> u32 {
    if textures.layer_count == 0 || corners[0].layer == Mesh::UNTEXTURED {
        return 0;
    }
    let size = Vec2::new(textures.width as f32, textures.height as f32);
    let [a, b, c] = corners;
    let (p1, p2) = (b.position - a.position, c.position - a.position);
    let (t1, t2) = ((b.uv - a.uv) * size, (c.uv - a.uv) * size);
    let per_x = (t1 * p2.y - t2 * p1.y) / area;
    let per_y = (t2 * p1.x - t1 * p2.x) / area;
    let texels = per_x.length().max(per_y.length());
    (texels.log2().round().max(0.0) as u32).min(textures.mip_count - 1)
}

/// Linear within a mip; coordinates repeat.
fn sample(textures: &TextureArray, layer: u8, uv: Vec2, level: u32) -> Vec4 {
    let side = |full: u32, mip: u32| (full >> mip).max(1) as usize;
    let first: usize = (0..level)
        .map(|m| side(textures.width, m) * side(textures.height, m))
        .sum::<usize>()
        * textures.layer_count as usize;
    let (w, h) = (side(textures.width, level), side(textures.height, level));
    let pixels = &textures.pixels[first + w * h * layer as usize..][..w * h];
    let texel = |x: f32, y: f32| {
        let (x, y) = (x.rem_euclid(w as f32), y.rem_euclid(h as f32));
        Vec4::from(pixels[(y as usize).min(h - 1) * w + (x as usize).min(w - 1)].map(f32::from))
    };
    let at = uv * Vec2::new(w as f32, h as f32) - 0.5;
    let (low, part) = (at.floor(), at - at.floor());
    let top = texel(low.x, low.y).lerp(texel(low.x + 1.0, low.y), part.x);
    let bottom = texel(low.x, low.y + 1.0).lerp(texel(low.x + 1.0, low.y + 1.0), part.x);
    top.lerp(bottom, part.y) / 255.0
}
