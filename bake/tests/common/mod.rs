//! Fixtures that several tests use.
#![allow(dead_code, reason = "each test takes what it needs")]

use glam::{Mat4, Quat, Vec2, Vec3};
use throng_bake::baked::{Baked, BodyPart, Tint};
use throng_bake::character::{
    Character, Clip, Image, Interpolation, Joint, Node, Property, Track, Transform,
};
use throng_bake::merge::used_images;
use throng_bake::mesh::{Collapse, CollapseSequence, Mesh, SubmeshInfo};
use throng_bake::sliding_tris::{self, BandForm};
use throng_bake::{palette, quantize};

/// A small deterministic generator (PCG).
pub struct Random(pub u64);

impl Random {
    /// The next number below `n`.
    pub fn below(&mut self, n: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (self.0 >> 33) as usize % n
    }
}

/// Two separate sheets of `side * side` vertices, each a submesh, bent by two joints.
pub fn sheets(side: usize) -> Mesh {
    let info = |name: &str| SubmeshInfo {
        name: name.into(),
        double_sided: false,
        alpha_cutoff: None,
    };
    let mut mesh = Mesh {
        submeshes: vec![info("front"), info("back")],
        ..Mesh::default()
    };
    for s in 0..2u8 {
        let base = mesh.positions.len() as u32;
        for y in 0..side {
            for x in 0..side {
                let (u, v) = (x as f32 / (side - 1) as f32, y as f32 / (side - 1) as f32);
                mesh.positions.push(Vec3::new(u, 2.0 * v, f32::from(s)));
                mesh.normals.push(Vec3::Z);
                mesh.uvs.push(Vec2::new(u, v));
                mesh.colors.push([200, 100, 50, 255]);
                mesh.layers.push(Mesh::UNTEXTURED);
                mesh.body_parts.push(s);
                mesh.joints.push([1, 0, 0, 0]);
                mesh.weights.push([v, 1.0 - v, 0.0, 0.0]);
                mesh.submesh.push(s);
            }
        }
        for y in 0..side as u32 - 1 {
            for x in 0..side as u32 - 1 {
                let at = |dx: u32, dy: u32| base + (y + dy) * side as u32 + x + dx;
                mesh.triangles.push([at(0, 0), at(1, 0), at(1, 1)]);
                mesh.triangles.push([at(0, 0), at(1, 1), at(0, 1)]);
            }
        }
    }
    mesh
}

/// Collapses random living vertices along living edges, until one vertex of each submesh is left.
pub fn random_sequence(mesh: &Mesh, seed: u64) -> CollapseSequence {
    let mut random = Random(seed);
    let mut now: Vec<u32> = (0..mesh.vertex_count() as u32).collect();
    let mut steps = Vec::new();
    let mut alive: Vec<u32> = now.clone();
    while alive.len() > 2 {
        let v = alive[random.below(alive.len())];
        let other = |t: &[u32; 3]| {
            t.map(|c| now[c as usize])
                .into_iter()
                .find(|&c| c != v && t.iter().any(|&d| now[d as usize] == v))
        };
        let edge = mesh.triangles.iter().find_map(other);
        let any = alive
            .iter()
            .copied()
            .find(|&c| c != v && mesh.submesh[c as usize] == mesh.submesh[v as usize]);
        let Some(target) = edge.or(any) else { continue };
        // Some steps share an error, as the wedges of one point do.
        steps.push(Collapse {
            vertex: v,
            target,
            error_m: (steps.len() / 3) as f32 * 0.01,
        });
        now.iter_mut()
            .filter(|c| **c == v)
            .for_each(|c| *c = target);
        alive.retain(|&c| c != v);
    }
    CollapseSequence {
        steps,
        replacement: None,
    }
}

/// A character of two joints, the second swinging in a clip of one second.
pub fn swinging() -> Character {
    let node = |name: &str, parent| Node {
        name: name.into(),
        parent,
        rest: Transform::IDENTITY,
    };
    let swing = Track {
        node: 1,
        property: Property::Rotation,
        interpolation: Interpolation::Linear,
        times_s: vec![0.0, 0.5, 1.0],
        values: [0.0, 1.0, 0.0]
            .iter()
            .flat_map(|&a| Quat::from_rotation_x(a).to_array())
            .collect(),
    };
    Character {
        name: "swinging".into(),
        nodes: vec![node("root", None), node("swing", Some(0))],
        joints: (0..2)
            .map(|node| Joint {
                node,
                joint_from_bind: Mat4::IDENTITY,
            })
            .collect(),
        clips: vec![Clip {
            name: "swing".into(),
            duration_s: 1.0,
            ground_speed: 1.25,
            tracks: vec![swing],
        }],
        ..Character::default()
    }
}

/// The sheets, ordered and quantised, swinging.
pub fn baked_sheets(side: usize, form: BandForm) -> Baked {
    let (mesh, character) = (sheets(side), swinging());
    let sliding = sliding_tris::order(&mesh, &random_sequence(&mesh, 7), form).unwrap();
    let (palette, clips) = palette::sample_clips(&character, &mesh, 30.0).unwrap();
    let vertices = sliding.source_vertex.iter().map(|&v| {
        let v = v as usize;
        let (joints, weights) = quantize::encode_influences(mesh.joints[v], mesh.weights[v]);
        let axis =
            |i: usize| quantize::encode_unorm16(mesh.positions[v][i], 0.0, [1.0, 2.0, 1.0][i]);
        throng_bake::baked::Vertex {
            position: [axis(0), axis(1), axis(2)],
            layer: Mesh::UNTEXTURED,
            body_part: mesh.body_parts[v],
            normal: quantize::encode_normal(mesh.normals[v]),
            uv: [0, 0],
            color: mesh.colors[v],
            joints,
            weights,
        }
    });
    let part = |name: &str| BodyPart {
        name: name.into(),
        tint: Tint::Cloth,
    };
    Baked {
        name: "sheets".into(),
        vertices: vertices.collect(),
        submeshes: sliding.submeshes,
        collapse: sliding.collapse,
        bands: sliding.bands,
        indices: sliding.indices,
        position_extent: Vec3::new(1.0, 2.0, 1.0),
        body_parts: vec![part("front"), part("back")],
        palette,
        clips,
        nodes: character.nodes,
        joints: character.joints,
        source_clips: character.clips,
        error_max: 1.0,
        impostors: None,
        ..Baked::default()
    }
}

/// A real character, or none where the models are not there.
pub fn model(name: &str) -> Option<Character> {
    let models = std::env::var_os("THRONG_MODELS").map_or_else(
        || std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/models"),
        std::path::PathBuf::from,
    );
    let path = models.join(name);
    if !path.exists() {
        eprintln!("SKIPPED: {} is not there", path.display());
        return None;
    }
    Some(throng_bake::import::import(&path).expect("import"))
}

/// The images that a character's mesh has as layers.
pub fn textures(c: &Character) -> Vec<&Image> {
    let used = used_images(c).into_iter();
    used.map(|i| &c.images[i as usize]).collect()
}
