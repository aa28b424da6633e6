//! Puts a human together: layers, surface, rig and clips.

use glam::{Mat4, Vec3};

use super::field::{Layer, Model, Paint, smoothstep};
use super::figure::{Figure, JOINT_COUNT, SIDES, STANDARD_HEIGHT};
use super::params::{Color, Hat, Person, Shoes, Top};
use super::{clothes, gait, head, mesh, polygonise};
use crate::character::{Character, Clip, Joint, Material, Node, Part, Transform};

/// Metres between samples of the surface, at the standard height.
const GRID_STEP: f32 = 0.005;

/// Materials by name, as paints ask for them.
#[derive(Default)]
pub struct Palette {
    pub materials: Vec<Material>,
}

impl Palette {
    pub fn paint(&mut self, name: &str, color: Color) -> Paint {
        self.materials.push(Material {
            name: name.into(),
            base_color: color.linear(),
            ..Material::default()
        });
        Paint {
            material: self.materials.len() - 1,
            tint: [1.0; 3],
        }
    }
}

pub fn build(person: &Person) -> Character {
    let figure = Figure {
        body: person.body.clone(),
    };
    let mut palette = Palette::default();
    let model = model(person, &figure, &mut palette);
    let low = Vec3::new(-0.85, -0.02, -0.36);
    let high = Vec3::new(0.85, 1.90, 0.36);
    let surface = polygonise::polygonise(&model, low, high, GRID_STEP);
    let parts = mesh::parts(
        &model,
        &surface,
        &palette.materials,
        JOINT_COUNT,
        person.triangles as usize,
        STANDARD_HEIGHT,
        // Faces are what people look at.
        |p| 1.0 + 1.8 * smoothstep(1.49, 1.53, p.y) * smoothstep(-0.10, 0.05, p.z),
    );
    let scale = person.height / STANDARD_HEIGHT;
    let joints = figure.joints();
    let clips = gait::person_clips(&figure, &person.gait, scale);
    assemble(parts, &palette.materials, &joints, clips, scale)
}

/// A character from parts and joints in metres at scale 1; clips are already scaled.
pub fn assemble(
    mut parts: Vec<Part>,
    materials: &[Material],
    joints: &[(String, Option<usize>, Vec3)],
    clips: Vec<Clip>,
    scale: f32,
) -> Character {
    // Parts are in the order of their materials; those that nothing shows are left out.
    let mut used = Vec::with_capacity(parts.len());
    for part in &mut parts {
        part.positions.iter_mut().for_each(|p| *p *= scale);
        used.push(materials[part.material as usize].clone());
        part.material = used.len() as u32 - 1;
    }
    // Node 0 stands on the ground; joint i is node i + 1.
    let mut nodes = vec![Node {
        name: "root".into(),
        parent: None,
        rest: Transform::IDENTITY,
    }];
    let mut skin = Vec::new();
    for (i, (name, parent, place)) in joints.iter().enumerate() {
        let from = parent.map_or(Vec3::ZERO, |p| joints[p].2);
        nodes.push(Node {
            name: name.clone(),
            parent: Some(parent.map_or(0, |p| p as u32 + 1)),
            rest: Transform {
                translation: (*place - from) * scale,
                ..Transform::IDENTITY
            },
        });
        skin.push(Joint {
            node: i as u32 + 1,
            joint_from_bind: Mat4::from_translation(-*place * scale),
        });
    }
    Character {
        parts,
        materials: used,
        nodes,
        joints: skin,
        clips,
        ..Character::default()
    }
}

fn model(person: &Person, figure: &Figure, palette: &mut Palette) -> Model {
    let (head, wear) = (&person.head, &person.clothes);
    let curves = figure.body.curves;
    let frame = head::HeadFrame::new(figure);
    let skin = palette.paint("Skin", head.skin);
    let hair = palette.paint("Hair", head.hair_color);
    let eyes = palette.paint("Eyes", Color([236, 232, 226]));
    let iris = palette.paint("Iris", head.eyes);
    let (top_name, accent_name, tie_name) = match wear.top {
        Top::Suit => ("Jacket", "Shirt", "Tie"),
        Top::Coat => ("Coat", "Shirt", "Scarf"),
        Top::Dress => ("Dress", "Trim", "Scarf"),
        Top::Vest => ("Vest", "Shirt", "Reflective"),
        _ => ("Shirt", "Trim", "Scarf"),
    };
    let paints = clothes::Paints {
        top: palette.paint(top_name, wear.top_color),
        accent: palette.paint(accent_name, wear.accent),
        tie: wear.tie.map(|c| palette.paint(tie_name, c)),
        bottom: palette.paint("Trousers", wear.bottom_color),
        belt: wear.belt.map(|c| palette.paint("Belt", c)),
        shoes: palette.paint("Shoes", wear.shoes_color),
        soles: palette.paint("Soles", wear.sole_color),
    };

    let skull = head::skull(frame, curves);
    let mut body = figure.trunk(0.0);
    body.push(figure.neck());
    for side in SIDES {
        body.push(figure.arm_prim(side, 0.0, 0.0));
        body.extend(figure.hand(side));
        body.push(figure.leg_prim(side, 0.0, 0.0));
        if wear.shoes == Shoes::Flats {
            body.push(figure.foot(side));
        }
    }
    // Carving eye sockets must not meet the body: the skull is a layer of its own, joined to the neck inside it.
    let mut face = skull.clone();
    face.push(figure.neck());
    let mut face = Layer::new(skin, 0.0, face);
    face.trim(|p| 1.47 - p.y);
    head::paint_face(&mut face, frame, eyes, iris, curves);
    let mut layers = vec![Layer::new(skin, 0.0, body), face];
    layers.extend(head::hair(frame, head, hair, &skull, curves));
    if head.hat != Hat::None {
        let hat = palette.paint("Hat", head.hat_color);
        layers.extend(head::hat(frame, head.hat, hat, paints.accent));
    }
    layers.extend(clothes::layers(figure, wear, &paints));
    Model { layers }
}
