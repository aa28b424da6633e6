//! A level of detail of a baked character as an ordinary character, to write as glTF.

use std::collections::{BTreeMap, HashMap};

use crate::baked::{Baked, Submesh};
use crate::character::{Alpha, Character, Image, Material, Part};
use crate::mesh::Mesh;
use crate::quantize::{decode_normal, decode_position, decode_uv, decode_weights};
use crate::sliding_tris::{band_at, live_count, triangles_at};
use crate::texture::linear_from_srgb;

/// Which level of detail.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Level {
    /// The finest with at most this share of the full mesh's triangles.
    Fraction(f64),
    /// The finest with at most this many triangles.
    Triangles(usize),
    /// The one drawn at this LOD error, bind-space units.
    Error(f32),
}

/// An exported level.
#[derive(Debug, Clone)]
pub struct Exported {
    /// The level, animated as the source was; normals, colours and weights as drawn.
    pub character: Character,
    /// Its LOD error.
    pub error: f32,
    /// Its triangles.
    pub triangle_count: usize,
}

/// The level as a character, its parts split by body part and texture layer.
pub fn export(baked: &Baked, level: Level) -> Exported {
    let error = match level {
        Level::Error(e) => e,
        Level::Triangles(n) => error_for(baked, n),
        Level::Fraction(f) => {
            // Below every collapse error: the full mesh.
            let full: usize = submesh_triangles(baked, -1.0)
                .iter()
                .map(|(_, t)| t.len())
                .sum();
            error_for(
                baked,
                (full as f64 * f.clamp(0.0, 1.0) + 0.5).floor() as usize,
            )
        }
    };
    let drawn = submesh_triangles(baked, error);
    let triangle_count = drawn.iter().map(|(_, t)| t.len()).sum();
    let mut character = Character {
        name: baked.name.clone(),
        images: layer_images(baked),
        nodes: baked.nodes.clone(),
        joints: baked.joints.clone(),
        clips: baked.source_clips.clone(),
        ..Character::default()
    };
    for (submesh, triangles) in drawn {
        add_parts(baked, submesh, &triangles, &mut character);
    }
    Exported {
        character,
        error,
        triangle_count,
    }
}

/// The least LOD error at which at most `triangle_count` triangles are left; the coarsest where none is that small.
fn error_for(baked: &Baked, triangle_count: usize) -> f32 {
    let mut errors: Vec<f32> = baked
        .collapse
        .iter()
        .map(|c| c.error)
        .filter(|e| e.is_finite())
        .collect();
    errors.sort_by(f32::total_cmp);
    errors.dedup();
    errors.insert(0, -1.0);
    let count = |e: f32| {
        submesh_triangles(baked, e)
            .iter()
            .map(|(_, t)| t.len())
            .sum::<usize>()
    };
    let at = errors.partition_point(|&e| count(e) > triangle_count);
    errors[at.min(errors.len() - 1)]
}

/// Triangles of each submesh at an LOD error, local vertex numbers.
fn submesh_triangles(baked: &Baked, error: f32) -> Vec<(&Submesh, Vec<[u32; 3]>)> {
    let of = |s: &Submesh| {
        let range = s.first_vertex as usize..(s.first_vertex + s.vertex_count) as usize;
        let (collapse, vertices) = (&baked.collapse[range.clone()], &baked.vertices[range]);
        let bands = &baked.bands[s.first_band as usize..][..s.band_count as usize];
        let band = band_at(bands, live_count(collapse, error));
        let window = band.map_or(&[][..], |b| {
            &baked.indices[b.first_index as usize..][..b.index_count as usize]
        });
        let same_place =
            |a: u32, b: u32| vertices[a as usize].position == vertices[b as usize].position;
        triangles_at(collapse, window, same_place, error)
    };
    baked.submeshes.iter().map(|s| (s, of(s))).collect()
}

fn layer_images(baked: &Baked) -> Vec<Image> {
    let t = &baked.textures;
    let size = t.width as usize * t.height as usize;
    (0..t.layer_count as usize)
        .map(|i| Image {
            name: format!("layer {i}"),
            width: t.width,
            height: t.height,
            pixels: t.pixels[i * size..][..size].to_vec(),
        })
        .collect()
}

fn add_parts(baked: &Baked, submesh: &Submesh, triangles: &[[u32; 3]], character: &mut Character) {
    let vertices =
        &baked.vertices[submesh.first_vertex as usize..][..submesh.vertex_count as usize];
    // A triangle belongs to the body part and the layer of its first corner.
    let mut groups: BTreeMap<(u8, u8), Vec<[u32; 3]>> = BTreeMap::new();
    for &t in triangles {
        let first = &vertices[t[0] as usize];
        groups
            .entry((first.body_part, first.layer))
            .or_default()
            .push(t);
    }
    for ((body_part, layer), triangles) in groups {
        let name = baked.body_parts[body_part as usize].name.clone();
        character.materials.push(Material {
            name: name.clone(),
            base_color_image: (layer != Mesh::UNTEXTURED).then_some(u32::from(layer)),
            alpha: submesh.info.alpha_cutoff.map_or(Alpha::Opaque, Alpha::Mask),
            double_sided: submesh.info.double_sided,
            ..Material::default()
        });
        let mut part = Part {
            name,
            material: character.materials.len() as u32 - 1,
            ..Part::default()
        };
        let mut local: HashMap<u32, u32> = HashMap::new();
        let mut used: Vec<u32> = Vec::new();
        for t in triangles {
            part.triangles.push(t.map(|v| {
                *local.entry(v).or_insert_with(|| {
                    used.push(v);
                    used.len() as u32 - 1
                })
            }));
        }
        for v in used.into_iter().map(|v| &vertices[v as usize]) {
            part.positions.push(decode_position(
                v,
                baked.position_min,
                baked.position_extent,
            ));
            part.normals.push(decode_normal(v.normal));
            if layer != Mesh::UNTEXTURED {
                part.uvs.push(decode_uv(v, baked.uv_min, baked.uv_extent));
            }
            let [r, g, b, a] = v.color;
            let linear = [
                linear_from_srgb(r),
                linear_from_srgb(g),
                linear_from_srgb(b),
                f32::from(a) / 255.0,
            ];
            part.colors.push(linear);
            part.joints.push(v.joints.map(u16::from));
            part.weights.push(decode_weights(v.weights));
        }
        character.parts.push(part);
    }
}
