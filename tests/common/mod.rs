//! Fixtures that several tests use.
#![allow(dead_code, reason = "each test takes what it needs")]

use std::path::PathBuf;

use glam::{Mat4, Quat, Vec2, Vec3};
use throng::bake::baked::Baked;
use throng::bake::character::{
    Alpha, Character, Clip, Image, Interpolation, Joint, Material, Node, Part, Property, Track,
    Transform,
};
use throng::bake::impostor::{
    Atlas, ErrorSample, Impostors, Kind, KindInfo, NO_JOINT, PoseRange, Quad, Tile, ViewSet,
};
use throng::gpu::{Headless, HeadlessDesc};
use throng::representation::CostModel;
use throng::{Agent, CharacterId, FrameOptions, View};

/// A tube of two joints, 1.8 m high, with a hat (another body part), and a textured, see-through, two-sided flag on its
/// back: two submeshes, two clips, every pipeline variant but two.
pub fn mascot() -> Character {
    let mut tube = Part {
        name: "tube".into(),
        material: 0,
        ..Part::default()
    };
    rings(&mut tube, 0.0, 1.5, 0.25, 16);
    let mut hat = Part {
        name: "hat".into(),
        material: 1,
        ..Part::default()
    };
    rings(&mut hat, 1.5, 1.8, 0.32, 3);
    let mut flag = Part {
        name: "flag".into(),
        material: 2,
        ..Part::default()
    };
    sheet(&mut flag);
    let node = |name: &str, parent: Option<u32>, y: f32| Node {
        name: name.into(),
        parent,
        rest: Transform {
            translation: Vec3::new(0.0, y, 0.0),
            ..Transform::IDENTITY
        },
    };
    let turn = |axis: Vec3, angle: f32| Quat::from_axis_angle(axis, angle).to_array();
    let track = |node: u32, keys: &[(f32, [f32; 4])]| Track {
        node,
        property: Property::Rotation,
        interpolation: Interpolation::Linear,
        times_s: keys.iter().map(|k| k.0).collect(),
        values: keys.iter().flat_map(|k| k.1).collect(),
    };
    let still = Quat::IDENTITY.to_array();
    let clip = |name: &str, axis: Vec3| Clip {
        name: name.into(),
        duration_s: 1.0,
        ground_speed: 0.0,
        tracks: vec![track(
            1,
            &[
                (0.0, still),
                (0.25, turn(axis, 0.9)),
                (0.75, turn(axis, -0.9)),
                (1.0, still),
            ],
        )],
    };
    let material = |name: &str, base_color: [f32; 4]| Material {
        name: name.into(),
        base_color,
        ..Material::default()
    };
    let character = Character {
        name: "mascot".into(),
        parts: vec![tube, hat, flag],
        materials: vec![
            material("shirt", [0.6, 0.2, 0.1, 1.0]),
            material("hat", [0.1, 0.3, 0.6, 1.0]),
            Material {
                base_color_image: Some(0),
                alpha: Alpha::Mask(0.5),
                double_sided: true,
                ..material("flag", [1.0; 4])
            },
        ],
        images: vec![checkers()],
        nodes: vec![node("hips", None, 0.0), node("chest", Some(0), 0.9)],
        joints: vec![
            Joint {
                node: 0,
                joint_from_bind: Mat4::IDENTITY,
            },
            Joint {
                node: 1,
                joint_from_bind: Mat4::from_translation(Vec3::new(0.0, -0.9, 0.0)),
            },
        ],
        clips: vec![clip("bow", Vec3::X), clip("sway", Vec3::Z)],
        warnings: Vec::new(),
    };
    character
        .validate(std::path::Path::new("mascot"))
        .expect("the fixture is valid");
    character
}

/// The mascot as everything after the bake sees it.
pub fn baked_mascot() -> Baked {
    let (baked, _) = throng::bake::bake::bake(&mascot(), &Default::default(), &mut |_| {})
        .expect("the fixture bakes");
    baked
}

/// The mascot with impostors that nobody captured: every tile is a rectangle of its own, filled with one colour.
pub fn baked_mascot_with_impostors() -> Baked {
    // With a rim that is one empty texel in the coarsest mip.
    const TILE: u16 = 16;
    const RIM: u32 = 4;
    const COLUMNS: u32 = 32;
    let view_sets = vec![ViewSet::icosahedral(1, -1.0), ViewSet::icosahedral(2, -0.3)];
    let views: Vec<u32> = view_sets
        .iter()
        .map(|s| s.directions.len() as u32)
        .collect();
    let quad = |name: &str, joint, y, first_tile, view_set| Quad {
        name: name.into(),
        joint,
        center: Vec3::new(0.02, y, -0.01),
        depth_extent: 0.4,
        first_tile,
        view_set,
    };
    let poses = 2 * 3;
    let tile_count = 2 * views[0] + poses * views[1];
    let rows = tile_count.div_ceil(COLUMNS) * TILE as u32;
    let (width, height) = (COLUMNS * TILE as u32, rows.next_power_of_two());
    let tiles = (0..tile_count).map(|i| {
        let y = 0.3 + 0.001 * i as f32;
        Tile {
            min: [-0.6, -2.0 * y],
            max: [0.5, 2.0 * y + 0.02],
            texel: [(i % COLUMNS) as u16 * TILE, (i / COLUMNS) as u16 * TILE],
            size: [TILE, TILE],
            lean: [0.1, -0.2, 0.05],
        }
    });
    let kind = |kind, first_quad, quad_count| KindInfo {
        kind,
        first_quad,
        quad_count,
        errors: [8.0, 64.0]
            .map(|height_px| ErrorSample {
                height_px,
                error_px: height_px / if kind == Kind::Flat { 80.0 } else { 9.0 },
            })
            .to_vec(),
    };
    let color = (0..3).flat_map(|mip| {
        let is_rim = move |at: u32| {
            let (at, tile, rim) = (at % (TILE as u32 >> mip), TILE as u32 >> mip, RIM >> mip);
            at < rim || at >= tile - rim
        };
        let places = (0..height >> mip).flat_map(move |y| (0..width >> mip).map(move |x| (x, y)));
        places.map(move |(x, y)| match is_rim(x) || is_rim(y) {
            true => [200, 120, 40, 0],
            false => [200, 120, 40, 255],
        })
    });
    let color: Vec<_> = color.collect();
    let impostors = Impostors {
        kinds: vec![kind(Kind::Flat, 0, 2), kind(Kind::Quad, 2, 1)],
        quads: vec![
            quad("lower", 0, 0.45, 0, 0),
            quad("upper", 1, 1.3, views[0], 0),
            quad("whole", NO_JOINT, 0.9, 2 * views[0], 1),
        ],
        clip_poses: [0, 3]
            .map(|first_pose| PoseRange {
                first_pose,
                pose_count: 3,
            })
            .to_vec(),
        tiles: tiles.collect(),
        atlas: Atlas {
            width,
            height,
            mip_count: 3,
            surface: vec![[128, 128, 0, 128]; color.len()],
            color,
            blocks: None,
        },
        view_sets,
    };
    Baked {
        impostors: Some(impostors),
        ..baked_mascot()
    }
}

/// Stacked rings of 20 vertices, closed at the top, bound to the joint below or above y = 0.9.
fn rings(part: &mut Part, bottom: f32, top: f32, radius: f32, count: u32) {
    const SIDES: u32 = 20;
    for ring in 0..=count {
        let y = bottom + (top - bottom) * ring as f32 / count as f32;
        let above = ((y - 0.7) / 0.4).clamp(0.0, 1.0);
        for side in 0..SIDES {
            let (sin, cos) = (side as f32 / SIDES as f32 * std::f32::consts::TAU).sin_cos();
            let bulge = radius * (1.0 + 0.2 * (y * 7.0).sin());
            part.positions.push(Vec3::new(bulge * cos, y, bulge * sin));
            part.normals.push(Vec3::new(cos, 0.0, sin));
            let weights = if above >= 0.5 {
                ([1, 0, 0, 0], [above, 1.0 - above, 0.0, 0.0])
            } else {
                ([0, 1, 0, 0], [1.0 - above, above, 0.0, 0.0])
            };
            part.joints.push(weights.0);
            part.weights.push(weights.1);
        }
    }
    let at = |ring: u32, side: u32| ring * SIDES + side % SIDES;
    for ring in 0..count {
        for side in 0..SIDES {
            part.triangles
                .push([at(ring, side), at(ring + 1, side), at(ring + 1, side + 1)]);
            part.triangles
                .push([at(ring, side), at(ring + 1, side + 1), at(ring, side + 1)]);
        }
    }
    for side in 1..SIDES - 1 {
        part.triangles
            .push([at(count, 0), at(count, side + 1), at(count, side)]);
    }
}

fn sheet(part: &mut Part) {
    for y in 0..5 {
        for x in 0..5 {
            let (u, v) = (x as f32 / 4.0, y as f32 / 4.0);
            part.positions
                .push(Vec3::new(u - 0.5, 1.0 + 0.6 * (1.0 - v), -0.4));
            part.normals.push(Vec3::NEG_Z);
            part.uvs.push(Vec2::new(u, v));
            part.joints.push([1, 0, 0, 0]);
            part.weights.push([1.0, 0.0, 0.0, 0.0]);
        }
    }
    for y in 0..4 {
        for x in 0..4 {
            let at = |dx: u32, dy: u32| (y + dy) * 5 + x + dx;
            part.triangles.push([at(0, 0), at(1, 0), at(1, 1)]);
            part.triangles.push([at(0, 0), at(1, 1), at(0, 1)]);
        }
    }
}

/// 4x4 squares of 8 pixels in two colours, the middle four see-through.
fn checkers() -> Image {
    let pixels = (0..32 * 32)
        .map(|i| {
            let (x, y) = (i % 32 / 8, i / 32 / 8);
            match (x, y) {
                (1..=2, 1..=2) => [0, 0, 0, 0],
                _ if (x + y) % 2 == 0 => [230, 200, 40, 255],
                _ => [40, 120, 60, 255],
            }
        })
        .collect();
    Image {
        name: "checkers".into(),
        width: 32,
        height: 32,
        pixels,
    }
}

/// Costs with which `hybrid` draws something as every kind: quads where they have no relief yet, flat impostors of larger agents.
pub const COSTS_OF_EVERY_KIND: CostModel = CostModel {
    mesh: 4000.0,
    triangle: 75.0,
    impostor: 1.0,
    quad: 1000.0,
    quad_pixel: 1.0,
    relief_pixel: 1000.0,
    pixel_block: 4.0,
};

/// A device with the validation layer on, that keeps its lists and draws every kind.
pub fn headless(size_px: [u32; 2]) -> Headless {
    Headless::new(&HeadlessDesc {
        size_px,
        validation: true,
        keep_lists: true,
        costs: Some(COSTS_OF_EVERY_KIND),
        ..Default::default()
    })
    .expect("a Vulkan device and the validation layer (tools/test installs them)")
}

/// Fails where the validation layer has said anything.
pub fn assert_silent(headless: &Headless) {
    assert_eq!(headless.messages(), Vec::<String>::new());
}

/// `count` agents of `characters` in rows in front of a camera at the origin that looks along -Z; some of them outside.
pub fn crowd(count: usize, characters: &[CharacterId]) -> Vec<Agent> {
    let mut random = Random(7);
    (0..count)
        .map(|i| {
            let depth = 2.0 + 60.0 * random.unit();
            Agent {
                position: Vec3::new((random.unit() - 0.5) * 1.6 * depth, 0.0, -depth),
                heading: random.unit() * 6.0,
                scale: 0.8 + 0.4 * random.unit(),
                character: characters[i % characters.len()],
                clips: [(i % 2) as u32, ((i + 1) % 2) as u32],
                phases: [random.unit(), random.unit()],
                blend: [0.0, 0.0, 0.3, 1.0][i % 4],
                tint_seed: i as u32,
            }
        })
        .collect()
}

/// A camera 2 m above the origin that looks along -Z.
pub fn view(size_px: [u32; 2]) -> View {
    View::perspective(
        Vec3::new(0.0, 2.0, 0.0),
        Vec3::new(0.0, 1.2, -6.0),
        0.9,
        0.1,
        size_px,
    )
}

/// The defaults with a method.
pub fn options(method: throng::Method) -> FrameOptions {
    FrameOptions {
        method,
        ..Default::default()
    }
}

/// A small deterministic generator (xorshift).
pub struct Random(pub u32);

impl Random {
    /// In [0, 1).
    pub fn unit(&mut self) -> f32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        (self.0 >> 8) as f32 / (1 << 24) as f32
    }
}

/// A real character, or `None` (said aloud) where shared/models is missing.
pub fn real_character(file: &str) -> Option<Baked> {
    let root = std::env::var_os("THRONG_MODELS").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/models"),
        PathBuf::from,
    );
    let path = root.join(file);
    if !path.exists() {
        eprintln!(
            "SKIPPED: {} is missing; THRONG_MODELS names the folder of the models",
            path.display()
        );
        return None;
    }
    let character = throng::bake::import::import(&path).expect("a real character imports");
    let (baked, _) = throng::bake::bake::bake(&character, &Default::default(), &mut |_| {})
        .expect("a real character bakes");
    Some(baked)
}
