//! Heads: skull, face, hair, beards and hats.

use glam::{Mat3, Vec2, Vec3};

use super::field::{Layer, Paint, Prim, Ring, Shape};
use super::figure::{CHEST, Figure, HEAD, SIDES, chain, cone, ellipsoid, loft, tilted};
use super::params::{Beard, Hair, Hat, Head};

/// The head's frame: the origin is between the eyes' height and the skull's middle, 23 cm from chin to crown.
#[derive(Clone, Copy)]
pub struct HeadFrame {
    size: f32,
}

impl HeadFrame {
    pub fn new(figure: &Figure) -> Self {
        Self {
            size: figure.body.head_size,
        }
    }

    /// Model position of a point of the head.
    pub fn at(self, x: f32, y: f32, z: f32) -> Vec3 {
        Vec3::new(0.0, 1.525, 0.012) + Vec3::new(x, y + 0.111, z) * self.size
    }

    /// The inverse of [`HeadFrame::at`].
    pub fn local(self, p: Vec3) -> Vec3 {
        (p - Vec3::new(0.0, 1.525, 0.012)) / self.size - Vec3::new(0.0, 0.111, 0.0)
    }

    fn cone(self, a: [f32; 3], b: [f32; 3], ra: f32, rb: f32, blend: f32) -> Prim {
        let at = |p: [f32; 3]| self.at(p[0], p[1], p[2]);
        let s = self.size;
        cone(
            at(a),
            at(b),
            ra * s,
            rb * s,
            blend * s,
            &super::figure::rigid(HEAD),
        )
    }

    fn ellipsoid(self, center: [f32; 3], radii: [f32; 3], blend: f32) -> Prim {
        let at = self.at(center[0], center[1], center[2]);
        let s = self.size;
        ellipsoid(
            at,
            Vec3::from(radii) * s,
            blend * s,
            &super::figure::rigid(HEAD),
        )
    }

    fn tilted(self, center: [f32; 3], radii: [f32; 3], turn: Mat3, blend: f32) -> Prim {
        let at = self.at(center[0], center[1], center[2]);
        let bind = super::figure::rigid(HEAD);
        tilted(
            at,
            Vec3::from(radii) * self.size,
            turn,
            blend * self.size,
            &bind,
        )
    }
}

const EYE: Vec3 = Vec3::new(0.0305, -0.001, 0.075);

/// Skull, face and ears; `curves` makes the jaw and brow finer.
pub fn skull(f: HeadFrame, curves: f32) -> Vec<Prim> {
    let jaw = 1.0 - 0.13 * curves;
    let brow = 1.0 - 0.5 * curves;
    let mut out = vec![
        f.ellipsoid([0.0, 0.033, -0.016], [0.0745, 0.079, 0.093], 0.0),
        f.ellipsoid([0.0, 0.020, 0.028], [0.063, 0.066, 0.058], 0.03),
        f.ellipsoid([0.0, -0.036, 0.026], [0.050 * jaw, 0.066, 0.058], 0.03),
        // Chin and mouth.
        f.ellipsoid([0.0, -0.093, 0.062], [0.021 * jaw, 0.017, 0.020], 0.028),
        f.ellipsoid([0.0, -0.056, 0.064], [0.027, 0.026, 0.024], 0.022),
    ];
    for side in SIDES {
        out.push(f.cone(
            [side * 0.047 * jaw, -0.054, 0.006],
            [side * 0.015 * jaw, -0.094, 0.060],
            0.017,
            0.014,
            0.026,
        ));
        out.push(f.ellipsoid([side * 0.034, -0.052, 0.046], [0.022, 0.030, 0.026], 0.026));
        // Cheekbone, brow, temple.
        out.push(f.ellipsoid([side * 0.041, -0.022, 0.056], [0.022, 0.018, 0.024], 0.024));
        out.push(f.cone(
            [side * 0.012, 0.019, 0.080],
            [side * 0.044, 0.018, 0.062],
            0.010 * brow + 0.003,
            0.008 * brow + 0.003,
            0.016,
        ));
    }
    for side in SIDES {
        let socket = f.ellipsoid([side * 0.031, -0.002, 0.098], [0.019, 0.012, 0.017], 0.012);
        out.push(socket.carve());
    }
    for side in SIDES {
        // The lidded eyeball.
        out.push(f.ellipsoid(
            [side * EYE.x, EYE.y, EYE.z],
            [0.0145, 0.0125, 0.0130],
            0.005,
        ));
    }
    out.push(f.cone(
        [0.0, 0.012, 0.083],
        [0.0, -0.026, 0.103],
        0.0065,
        0.0095,
        0.014,
    ));
    out.push(f.ellipsoid([0.0, -0.030, 0.103], [0.0105, 0.0095, 0.0100], 0.008));
    for side in SIDES {
        out.push(f.ellipsoid(
            [side * 0.0125, -0.035, 0.093],
            [0.0075, 0.0070, 0.0095],
            0.007,
        ));
        // Lips, thicker at the middle.
        out.push(f.cone(
            [side * 0.002, -0.0585, 0.0880],
            [side * 0.023, -0.0635, 0.0745],
            0.0052,
            0.0030,
            0.006,
        ));
        out.push(f.cone(
            [side * 0.002, -0.0685, 0.0862],
            [side * 0.020, -0.0660, 0.0755],
            0.0056,
            0.0030,
            0.005,
        ));
        let lean = Mat3::from_rotation_x(0.20) * Mat3::from_rotation_y(side * 0.40);
        out.push(f.tilted(
            [side * 0.076, -0.008, -0.010],
            [0.0085, 0.030, 0.019],
            lean,
            0.008,
        ));
        let shell = f.tilted(
            [side * 0.086, -0.002, -0.004],
            [0.007, 0.016, 0.010],
            lean,
            0.006,
        );
        out.push(shell.carve());
    }
    out
}

/// Eyes and lips, painted on the skin.
pub fn paint_face(layer: &mut Layer, f: HeadFrame, eyes: Paint, iris: Paint, curves: f32) {
    let lips = Paint {
        material: layer.paint.material,
        tint: [0.82, 0.52 - 0.10 * curves, 0.50 - 0.08 * curves],
    };
    layer.mark(lips, move |p| {
        let q = f.local(p);
        if q.z < 0.06 {
            return 1.0;
        }
        let x = q.x.abs() / 0.0255;
        // A bow above, a fuller curve below.
        let upper = -0.0555 - 0.007 * x * x + 0.0012 * (x * 6.0).min(1.0);
        let lower = -0.0735 + 0.0095 * x * x;
        (q.y - upper).max(lower - q.y).max((x - 1.0) * 0.02)
    });
    let eye = move |p: Vec3| {
        let q = f.local(p);
        (q.z > 0.05).then(|| Vec2::new(q.x.abs() - EYE.x, q.y - EYE.y))
    };
    layer.mark(eyes, move |p| {
        eye(p).map_or(1.0, |q| {
            let u = q.x / 0.0150;
            let open = 0.0074 * (1.0 - u * u);
            // The outer corner is a little higher than the inner one.
            (q.y - 0.05 * q.x).abs() - open
        })
    });
    layer.mark(iris, move |p| {
        eye(p).map_or(1.0, |q| {
            let u = q.x / 0.0150;
            let lid = (q.y - 0.05 * q.x).abs() - 0.0074 * (1.0 - u * u);
            lid.max((q - Vec2::new(0.0, 0.0008)).length() - 0.0067)
        })
    });
}

/// The lower edge of the hair by depth: (z, y).
const HAIRLINE: [(f32, f32); 7] = [
    (-0.110, -0.062),
    (-0.045, -0.052),
    (-0.026, -0.010),
    (0.016, 0.000),
    (0.022, 0.028),
    (0.060, 0.056),
    (0.100, 0.070),
];

fn interpolate(line: &[(f32, f32)], x: f32) -> f32 {
    let last = line.len() - 1;
    let i = line[1..last].iter().take_while(|p| p.0 <= x).count();
    let (a, b) = (line[i], line[i + 1]);
    let t = ((x - a.0) / (b.0 - a.0)).clamp(0.0, 1.0);
    a.1 + (b.1 - a.1) * t
}

/// Brows, hair and beard: one layer of hair.
pub fn hair(f: HeadFrame, head: &Head, paint: Paint, skin: &[Prim], curves: f32) -> Vec<Layer> {
    let mut out = Vec::new();
    let thin = 1.0 - 0.3 * curves;
    let mut brows = Vec::new();
    for side in SIDES {
        brows.push(f.cone(
            [side * 0.0125, 0.0190, 0.0905],
            [side * 0.0330, 0.0245, 0.0850],
            0.0046 * thin,
            0.0042 * thin,
            0.0,
        ));
        brows.push(f.cone(
            [side * 0.0330, 0.0245, 0.0850],
            [side * 0.0500, 0.0175, 0.0690],
            0.0042 * thin,
            0.0030,
            0.004,
        ));
    }
    out.push(Layer::new(paint, 0.0, brows));
    if head.beard != Beard::None {
        out.push(beard(f, head.beard, paint, skin));
    }
    let cap = |grow: f32| {
        vec![
            f.ellipsoid(
                [0.0, 0.036, -0.016],
                [0.0745 + grow, 0.079 + grow, 0.093 + grow],
                0.0,
            ),
            f.ellipsoid(
                [0.0, 0.024, 0.026],
                [0.063 + grow, 0.066 + grow, 0.058 + grow],
                0.03,
            ),
            f.ellipsoid(
                [0.0, -0.020, -0.045],
                [0.060 + grow, 0.055, 0.050 + grow],
                0.03,
            ),
        ]
    };
    let mut hairline = 0.0;
    let mut low = false;
    let mut prims = match head.hair {
        Hair::Bald => return out,
        Hair::Fringe => {
            // What is left to an old man: sides and back.
            let mut layer = Layer::new(paint, 0.0, cap(0.007));
            layer.trim(move |p| {
                let q = f.local(p);
                (interpolate(&HAIRLINE, q.z) - q.y)
                    .max(q.y - (0.030 - 0.25 * q.z.max(-0.06)))
                    .max(q.z - 0.030)
            });
            out.push(layer);
            return out;
        }
        Hair::Short => cap(0.009),
        Hair::Afro => {
            hairline = -0.004;
            let mut prims = cap(0.020);
            prims.push(f.ellipsoid([0.0, 0.058, -0.018], [0.108, 0.098, 0.115], 0.02));
            prims
        }
        Hair::SideParted => {
            let mut prims = cap(0.010);
            // Swept from a parting on the left over the top.
            prims.push(f.cone(
                [0.028, 0.098, 0.052],
                [-0.040, 0.092, 0.060],
                0.020,
                0.026,
                0.02,
            ));
            prims.push(f.cone(
                [0.020, 0.108, 0.0],
                [-0.035, 0.098, -0.02],
                0.020,
                0.024,
                0.02,
            ));
            prims
        }
        Hair::Bob | Hair::Long => {
            low = true;
            let mut prims = cap(0.013);
            let end = if head.hair == Hair::Bob {
                -0.085
            } else {
                -0.185
            };
            for side in SIDES {
                prims.push(f.cone(
                    [side * 0.020, 0.098, 0.030],
                    [side * 0.066, 0.040, 0.036],
                    0.017,
                    0.019,
                    0.02,
                ));
                prims.push(f.cone(
                    [side * 0.070, 0.045, 0.020],
                    [side * 0.079, -0.050, 0.006],
                    0.020,
                    0.022,
                    0.02,
                ));
                prims.push(f.cone(
                    [side * 0.074, 0.000, -0.022],
                    [side * 0.076, -0.085, -0.026],
                    0.022,
                    0.022,
                    0.015,
                ));
                prims.push(f.cone(
                    [side * 0.079, -0.050, 0.006],
                    [side * 0.074, end + 0.010, -0.010],
                    0.022,
                    0.020,
                    0.015,
                ));
            }
            prims.push(curtain(f, end));
            prims
        }
        Hair::Bun => {
            let mut prims = cap(0.008);
            prims.push(f.ellipsoid([0.0, 0.075, -0.105], [0.036, 0.034, 0.032], 0.008));
            prims
        }
        Hair::Ponytail => {
            let mut prims = cap(0.008);
            prims.push(f.cone(
                [0.0, 0.060, -0.100],
                [0.0, 0.035, -0.135],
                0.018,
                0.025,
                0.01,
            ));
            prims.push(f.cone(
                [0.0, 0.035, -0.135],
                [0.0, -0.050, -0.145],
                0.025,
                0.026,
                0.02,
            ));
            prims.push(f.cone(
                [0.0, -0.050, -0.145],
                [0.0, -0.130, -0.128],
                0.026,
                0.010,
                0.02,
            ));
            prims
        }
    };
    if head.hat != Hat::None {
        // A hat presses the crown down.
        prims.retain(|p| p.distance(f.at(0.0, 0.135, 0.0)) > 0.0);
    }
    let mut layer = Layer::new(paint, 0.0, prims);
    let hat = head.hat != Hat::None;
    layer.trim(move |p| {
        let q = f.local(p);
        let front = interpolate(&HAIRLINE, q.z) + hairline - q.y;
        let edge = if low {
            // Long hair falls: only the face and the throat stay free.
            let low = q.y.min(-0.02) + 0.02;
            let face = Vec3::new(
                q.x / (0.057 - 0.10 * low),
                (q.y + 0.020 - low) / 0.084,
                (q.z - 0.105) / 0.100,
            );
            0.05 * (1.0 - face.length())
        } else {
            front * 0.75
        };
        if hat { edge.max(q.y - 0.045) } else { edge }
    });
    out.push(layer);
    out
}

/// Hair down the back of the head, as low as `end`; below the neck it goes with the chest.
fn curtain(f: HeadFrame, end: f32) -> Prim {
    let ring = |y: f32, half_width: f32, front: f32, back: f32| Ring {
        at: y,
        half_width,
        front,
        back,
    };
    let rings = vec![
        ring(end, 0.070, 0.020, 0.030),
        ring(end * 0.5 - 0.02, 0.080, 0.034, 0.046),
        ring(-0.01, 0.080, 0.045, 0.056),
        ring(0.05, 0.074, 0.045, 0.050),
    ];
    let bind = chain(Vec3::ZERO, Vec3::Y, &[CHEST, HEAD], &[(1.475, 0.06)]);
    loft(
        f.at(0.0, 0.0, -0.055),
        Vec3::Y,
        Vec3::Z,
        rings,
        2.2,
        0.02,
        &bind,
    )
}

fn beard(f: HeadFrame, beard: Beard, paint: Paint, skin: &[Prim]) -> Layer {
    if beard == Beard::Moustache {
        let prims = SIDES
            .iter()
            .map(|side| {
                f.cone(
                    [side * 0.004, -0.0490, 0.0935],
                    [side * 0.024, -0.0570, 0.0800],
                    0.0068,
                    0.0042,
                    0.004,
                )
            })
            .collect();
        return Layer::new(paint, 0.0, prims);
    }
    let mut layer = Layer::new(paint, 0.0055, skin.to_vec());
    layer.trim(move |p| {
        let q = f.local(p);
        // Below a line from the sideburns to the moustache, above the throat, around the mouth.
        let cheek = -0.047 + 0.55 * (q.x.abs() - 0.020).max(0.0);
        let mouth = 0.0105 - Vec2::new(q.x * 0.42, q.y + 0.0640).length();
        (q.y - cheek.min(-0.005))
            .max(mouth)
            .max(-0.118 - q.y)
            .max(0.012 - q.z)
            .max(0.030 - q.z - 0.6 * (q.y + 0.062).abs())
    });
    layer
}

/// Cap, helmet or flat cap.
pub fn hat(f: HeadFrame, hat: Hat, paint: Paint, trim: Paint) -> Vec<Layer> {
    let dome = |grow: f32, lift: f32| {
        vec![
            f.ellipsoid(
                [0.0, 0.036 + lift, -0.016],
                [0.0745 + grow, 0.079 + grow, 0.093 + grow],
                0.0,
            ),
            f.ellipsoid(
                [0.0, 0.024 + lift, 0.024],
                [0.064 + grow, 0.070 + grow, 0.060 + grow],
                0.03,
            ),
        ]
    };
    match hat {
        Hat::None => Vec::new(),
        Hat::Cap => {
            let mut crown = Layer::new(paint, 0.0, dome(0.014, 0.0));
            crown.trim(move |p| {
                let q = f.local(p);
                0.034 + 0.12 * q.z - q.y
            });
            crown.mark(trim, move |p| {
                let q = f.local(p);
                Vec2::new(q.x, q.y - 0.082).length().max(0.06 - q.z) - 0.020
            });
            let tilt = Mat3::from_rotation_x(-0.22);
            let mut visor = Layer::new(
                Paint {
                    tint: [0.8; 3],
                    ..paint
                },
                0.0,
                vec![f.tilted([0.0, 0.043, 0.098], [0.066, 0.0075, 0.066], tilt, 0.0)],
            );
            visor.trim(move |p| 0.03 - f.local(p).z);
            vec![crown, visor]
        }
        Hat::Flat => {
            let mut prims = dome(0.013, -0.006);
            let tilt = Mat3::from_rotation_x(-0.25);
            prims.push(f.tilted([0.0, 0.074, 0.022], [0.092, 0.036, 0.112], tilt, 0.02));
            prims.push(f.tilted([0.0, 0.046, 0.092], [0.066, 0.009, 0.048], tilt, 0.012));
            let mut layer = Layer::new(paint, 0.0, prims);
            layer.trim(move |p| {
                let q = f.local(p);
                0.026 + 0.10 * q.z - q.y
            });
            vec![layer]
        }
        Hat::Helmet => {
            let mut prims = dome(0.026, 0.012);
            for x in [-0.022, 0.022] {
                prims.push(f.cone([x, 0.118, 0.070], [x, 0.128, -0.080], 0.012, 0.012, 0.008));
            }
            let mut shell = Layer::new(paint, 0.0, prims);
            shell.trim(move |p| 0.036 - f.local(p).y);
            let brim = Shape::Torus {
                center: f.at(0.0, 0.040, 0.004),
                local_from_model: Mat3::from_rotation_x(0.06),
                radius_x: 0.098,
                radius_z: 0.124,
                minor: 0.020,
                height: 0.0065,
            };
            let bind = super::figure::rigid(HEAD);
            let mut prims = vec![Prim::new(brim, 0.0, &bind)];
            let tilt = Mat3::from_rotation_x(-0.14);
            prims.push(f.tilted([0.0, 0.041, 0.112], [0.070, 0.0075, 0.058], tilt, 0.008));
            let mut brim = Layer::new(paint, 0.0, prims);
            brim.trim(move |p| 0.02 - f.local(p).y);
            vec![shell, brim]
        }
    }
}
