//! A dog: four legs with scapulas and hocks.

use glam::{Mat3, Vec2, Vec3};

use super::field::{Bind, Layer, Model, Paint, Prim, Ring, Shape, frame, smoothstep};
use super::figure::{SIDES, chain, cone, ellipsoid, loft, rigid, tilted};
use super::ik::Rig;
use super::params::{Color, Dog};
use super::person::{Palette, assemble};
use super::{dog_gait, mesh, polygonise};
use crate::character::Character;

/// Height at the withers that all constants here are for.
const STANDARD_HEIGHT: f32 = 0.60;
const GRID_STEP: f32 = 0.0042;

pub const HIPS: usize = 0;
pub const SPINE: usize = 1;
pub const CHEST: usize = 2;
pub const NECK: usize = 3;
pub const HEAD: usize = 4;
pub const TAIL: usize = 5;
/// Left foreleg: scapula, humerus, radius, paw, toes. The right one follows.
pub const FORE: usize = 8;
/// Left hind leg: femur, tibia, metatarsus, toes. The right one follows.
pub const HIND: usize = 18;

fn side_place(side: f32, p: [f32; 3]) -> Vec3 {
    Vec3::new(side * p[0], p[1], p[2])
}

/// Places of the left foreleg's joints at rest.
pub const FORELEG: [[f32; 3]; 5] = [
    [0.050, 0.550, 0.130],
    [0.085, 0.425, 0.225],
    [0.086, 0.325, 0.120],
    [0.082, 0.110, 0.145],
    [0.082, 0.022, 0.175],
];
/// Places of the left hind leg's joints at rest.
pub const HINDLEG: [[f32; 3]; 4] = [
    [0.072, 0.490, -0.295],
    [0.082, 0.335, -0.205],
    [0.078, 0.185, -0.350],
    [0.080, 0.022, -0.320],
];

fn joints() -> Vec<(String, Option<usize>, Vec3)> {
    let mut out: Vec<(String, Option<usize>, Vec3)> = vec![
        ("hips".into(), None, Vec3::new(0.0, 0.550, -0.290)),
        ("spine".into(), Some(HIPS), Vec3::new(0.0, 0.560, -0.120)),
        ("chest".into(), Some(SPINE), Vec3::new(0.0, 0.555, 0.060)),
        ("neck".into(), Some(CHEST), Vec3::new(0.0, 0.590, 0.220)),
        ("head".into(), Some(NECK), Vec3::new(0.0, 0.745, 0.330)),
        ("tail_1".into(), Some(HIPS), Vec3::new(0.0, 0.575, -0.360)),
        ("tail_2".into(), Some(TAIL), Vec3::new(0.0, 0.570, -0.455)),
        (
            "tail_3".into(),
            Some(TAIL + 1),
            Vec3::new(0.0, 0.610, -0.540),
        ),
    ];
    let mut leg = |names: &[&str], places: &[[f32; 3]], body: usize| {
        for (side, suffix) in SIDES.into_iter().zip(["l", "r"]) {
            let first = out.len();
            for (i, (name, &place)) in names.iter().zip(places).enumerate() {
                let parent = if i == 0 { body } else { first + i - 1 };
                let name = format!("{name}_{suffix}");
                out.push((name, Some(parent), side_place(side, place)));
            }
        }
    };
    leg(
        &["scapula", "humerus", "radius", "forepaw", "foretoes"],
        &FORELEG,
        CHEST,
    );
    leg(
        &["femur", "tibia", "metatarsus", "hindtoes"],
        &HINDLEG,
        HIPS,
    );
    out
}

/// The first joint of a side's leg of `count` joints; `first` is the left one's.
pub fn first_joint(first: usize, count: usize, side: f32) -> usize {
    if side > 0.0 { first } else { first + count }
}

pub fn build(dog: &Dog) -> Character {
    let joints = joints();
    let mut palette = Palette::default();
    let model = model(dog, &mut palette);
    let surface = polygonise::polygonise(
        &model,
        Vec3::new(-0.20, -0.02, -0.66),
        Vec3::new(0.20, 0.90, 0.60),
        GRID_STEP,
    );
    let parts = mesh::parts(
        &model,
        &surface,
        &palette.materials,
        joints.len(),
        dog.triangles as usize,
        STANDARD_HEIGHT,
        |p| 1.0 + smoothstep(0.30, 0.36, p.z) * smoothstep(0.66, 0.70, p.y),
    );
    let scale = dog.height / STANDARD_HEIGHT;
    let rig = Rig::new(&joints);
    let clips = dog_gait::clips(&rig, dog.walk_speed, dog.run_speed, scale);
    assemble(parts, &palette.materials, &joints, clips, scale)
}

/// A limb's cone from joint to joint, its weights blending at both ends.
fn bone(a: Vec3, b: Vec3, ra: f32, rb: f32, blend: f32, joints: [usize; 3]) -> Prim {
    let length = a.distance(b);
    let bind = chain(
        a,
        (b - a) / length,
        &joints,
        &[(0.0, 0.035), (length, 0.025)],
    );
    cone(a, b, ra, rb, blend, &bind)
}

fn body() -> Vec<Prim> {
    // Along the spine: place, half-width, above, below.
    const RINGS: [[f32; 4]; 9] = [
        [-0.365, 0.050, 0.030, 0.060],
        [-0.320, 0.074, 0.048, 0.085],
        [-0.240, 0.082, 0.050, 0.110],
        [-0.130, 0.076, 0.045, 0.105],
        [-0.010, 0.089, 0.046, 0.148],
        [0.095, 0.100, 0.050, 0.184],
        [0.175, 0.096, 0.052, 0.188],
        [0.240, 0.078, 0.045, 0.160],
        [0.290, 0.048, 0.020, 0.105],
    ];
    let rings = RINGS
        .map(|[at, half_width, front, back]| Ring {
            at,
            half_width,
            front,
            back,
        })
        .to_vec();
    let spine = chain(
        Vec3::ZERO,
        Vec3::Z,
        &[HIPS, SPINE, CHEST],
        &[(-0.15, 0.08), (0.03, 0.08)],
    );
    let origin = Vec3::new(0.0, 0.550, 0.0);
    let mut out = vec![loft(origin, Vec3::Z, Vec3::Y, rings, 2.1, 0.0, &spine)];
    let (base, top) = (Vec3::new(0.0, 0.545, 0.205), Vec3::new(0.0, 0.735, 0.325));
    let neck = chain(
        base,
        (top - base).normalize(),
        &[CHEST, NECK, HEAD],
        &[(0.03, 0.05), (0.215, 0.03)],
    );
    out.push(cone(base, top, 0.092, 0.060, 0.05, &neck));
    out.push(cone(
        Vec3::new(0.0, 0.46, 0.235),
        Vec3::new(0.0, 0.69, 0.335),
        0.075,
        0.048,
        0.05,
        &neck,
    ));
    let tail = [
        Vec3::new(0.0, 0.565, -0.345),
        Vec3::new(0.0, 0.570, -0.455),
        Vec3::new(0.0, 0.610, -0.540),
        Vec3::new(0.0, 0.675, -0.585),
    ];
    out.push(bone(
        tail[0],
        tail[1],
        0.034,
        0.026,
        0.04,
        [HIPS, TAIL, TAIL + 1],
    ));
    out.push(bone(
        tail[1],
        tail[2],
        0.027,
        0.024,
        0.02,
        [TAIL, TAIL + 1, TAIL + 2],
    ));
    out.push(bone(
        tail[2],
        tail[3],
        0.024,
        0.010,
        0.02,
        [TAIL + 1, TAIL + 2, TAIL + 2],
    ));
    for side in SIDES {
        legs(side, &mut out);
    }
    out
}

fn legs(side: f32, out: &mut Vec<Prim>) {
    let at = |x: f32, y: f32, z: f32| Vec3::new(side * x, y, z);
    let j = first_joint(FORE, 5, side);
    let p = FORELEG.map(|p| side_place(side, p));
    let shoulder: Bind = chain(
        Vec3::ZERO,
        Vec3::NEG_Y,
        &[CHEST, j, j + 1],
        &[(-0.56, 0.05), (-0.43, 0.05)],
    );
    out.push(ellipsoid(
        at(0.074, 0.465, 0.170),
        Vec3::new(0.042, 0.115, 0.080),
        0.04,
        &shoulder,
    ));
    out.push(bone(p[1], p[2], 0.050, 0.040, 0.04, [j, j + 1, j + 2]));
    out.push(bone(p[2], p[3], 0.038, 0.022, 0.025, [j + 1, j + 2, j + 3]));
    out.push(bone(
        p[3],
        at(0.082, 0.045, 0.165),
        0.0225,
        0.023,
        0.015,
        [j + 2, j + 3, j + 3],
    ));
    paw(at(0.083, 0.0, 0.185), j + 3, side, out);

    let j = first_joint(HIND, 4, side);
    let p = HINDLEG.map(|p| side_place(side, p));
    let haunch = chain(Vec3::ZERO, Vec3::NEG_Y, &[HIPS, j], &[(-0.500, 0.06)]);
    out.push(ellipsoid(
        at(0.066, 0.450, -0.285),
        Vec3::new(0.046, 0.125, 0.088),
        0.04,
        &haunch,
    ));
    out.push(bone(p[0], p[1], 0.074, 0.052, 0.04, [HIPS, j, j + 1]));
    out.push(bone(p[1], p[2], 0.050, 0.023, 0.03, [j, j + 1, j + 2]));
    // The tendon behind the hock.
    out.push(bone(
        p[1] + Vec3::new(0.0, -0.03, -0.055),
        p[2] + Vec3::new(0.0, 0.008, -0.012),
        0.030,
        0.012,
        0.02,
        [j, j + 1, j + 2],
    ));
    out.push(bone(
        p[2],
        at(0.080, 0.045, -0.328),
        0.023,
        0.021,
        0.012,
        [j + 1, j + 2, j + 2],
    ));
    paw(at(0.081, 0.0, -0.308), j + 2, side, out);
}

/// A paw of three toes on the ground; it blends from the joint `foot` to the toes after it.
fn paw(place: Vec3, foot: usize, side: f32, out: &mut Vec<Prim>) {
    let bind = chain(place, Vec3::Z, &[foot, foot + 1], &[(-0.024, 0.010)]);
    out.push(ellipsoid(
        place + Vec3::new(0.0, 0.026, -0.004),
        Vec3::new(0.030, 0.028, 0.036),
        0.015,
        &bind,
    ));
    for (x, z) in [(-0.019, 0.016), (0.0, 0.026), (0.019, 0.016)] {
        let toe = place + Vec3::new(side * x, 0.018, z);
        out.push(ellipsoid(
            toe,
            Vec3::new(0.0125, 0.019, 0.021),
            0.006,
            &bind,
        ));
    }
}

fn head() -> Vec<Prim> {
    let bind = rigid(HEAD);
    let mut out = vec![
        ellipsoid(
            Vec3::new(0.0, 0.780, 0.350),
            Vec3::new(0.060, 0.056, 0.072),
            0.0,
            &bind,
        ),
        ellipsoid(
            Vec3::new(0.0, 0.752, 0.372),
            Vec3::new(0.054, 0.044, 0.060),
            0.03,
            &bind,
        ),
        cone(
            Vec3::new(0.0, 0.757, 0.400),
            Vec3::new(0.0, 0.742, 0.490),
            0.038,
            0.027,
            0.03,
            &bind,
        ),
        cone(
            Vec3::new(0.0, 0.730, 0.390),
            Vec3::new(0.0, 0.722, 0.478),
            0.028,
            0.020,
            0.012,
            &bind,
        ),
        // Nape and cheeks.
        ellipsoid(
            Vec3::new(0.0, 0.740, 0.320),
            Vec3::new(0.058, 0.060, 0.050),
            0.04,
            &bind,
        ),
    ];
    for side in SIDES {
        out.push(ellipsoid(
            Vec3::new(side * 0.026, 0.812, 0.398),
            Vec3::new(0.022, 0.014, 0.022),
            0.016,
            &bind,
        ));
        // Folded ears: out from the skull, then down beside the cheeks.
        let lean = Mat3::from_rotation_z(side * 0.30) * Mat3::from_rotation_x(0.10);
        out.push(cone(
            Vec3::new(side * 0.038, 0.818, 0.335),
            Vec3::new(side * 0.066, 0.818, 0.340),
            0.018,
            0.013,
            0.010,
            &bind,
        ));
        out.push(tilted(
            Vec3::new(side * 0.074, 0.776, 0.348),
            Vec3::new(0.0105, 0.052, 0.034),
            lean,
            0.006,
            &bind,
        ));
    }
    out
}

fn model(dog: &Dog, palette: &mut Palette) -> Model {
    let coat = palette.paint("Fur", dog.coat);
    let markings = palette.paint("Markings", dog.markings);
    let nose = palette.paint("Nose", Color([28, 24, 24]));
    let eyes = palette.paint("Eyes", Color([40, 22, 12]));
    let collar = palette.paint("Collar", dog.collar);
    let mut body = Layer::new(coat, 0.0, body());
    body.trim(|p| -p.y);
    body.mark(markings, |p| p.y - (0.115 + 0.02 * (p.z * 60.0).sin()));
    // Chest and belly.
    body.mark(markings, |p| {
        let chest = Vec2::new(p.x / 0.075, (p.y - 0.48) / 0.14).length() - 1.0;
        (0.06 * chest).max(0.20 - p.z)
    });
    body.mark(markings, |p| {
        (p.y - 0.425).max(0.37 - p.y).max(p.x.abs() - 0.050)
    });
    body.mark(markings, |p| {
        0.640 + 0.10 * (p.z + 0.56) - p.y + (p.z + 0.50).max(0.0) * 10.0
    });
    let mut skull = Layer::new(coat, 0.0, head());
    skull.mark(markings, |p| {
        // A blaze between the eyes that widens over the muzzle.
        let width = 0.012 + 0.9 * (p.z - 0.425).max(0.0) + 0.5 * (0.735 - p.y).max(0.0);
        (p.x.abs() - width).max(0.385 - p.z)
    });
    skull.mark(
        Paint {
            tint: [0.28, 0.22, 0.22],
            ..markings
        },
        |p| {
            let line = 0.728 + 0.10 * (p.z - 0.46) + 0.25 * (0.43 - p.z).max(0.0);
            ((p.y - line).abs() - 0.0036).max(0.405 - p.z)
        },
    );
    let bind = rigid(HEAD);
    let tip = vec![
        ellipsoid(
            Vec3::new(0.0, 0.757, 0.512),
            Vec3::new(0.0175, 0.0135, 0.0130),
            0.0,
            &bind,
        ),
        ellipsoid(
            Vec3::new(0.0, 0.747, 0.514),
            Vec3::new(0.0090, 0.0120, 0.0090),
            0.006,
            &bind,
        ),
    ];
    let eyeballs = SIDES
        .map(|side| {
            let at = Vec3::new(side * 0.0335, 0.795, 0.4085);
            ellipsoid(at, Vec3::splat(0.0125), 0.0, &bind)
        })
        .to_vec();
    let band = Shape::Torus {
        center: Vec3::new(0.0, 0.645, 0.281),
        local_from_model: frame(Vec3::new(0.0, 0.80, 0.55), Vec3::Z),
        radius_x: 0.078,
        radius_z: 0.092,
        minor: 0.011,
        height: 0.016,
    };
    let neck = rigid(NECK);
    let mut ring = Layer::new(collar, 0.0, vec![Prim::new(band, 0.0, &neck)]);
    ring.mark(
        Paint {
            tint: [0.5; 3],
            ..collar
        },
        |p| (p.x.abs() - 0.012).max(0.27 - p.z),
    );
    Model {
        layers: vec![
            body,
            skull,
            Layer::new(nose, 0.0, tip),
            Layer::new(eyes, 0.0, eyeballs),
            ring,
        ],
    }
}
