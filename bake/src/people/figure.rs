//! The human figure: landmarks, joints and the bare body. Built 1.75 m tall; the finished character is scaled to its height.

use std::sync::Arc;

use glam::{Mat3, Vec3};

use super::field::{Bind, Prim, Ring, Shape, frame, smoothstep};
use super::params::Body;

/// Height that all constants here are for.
pub const STANDARD_HEIGHT: f32 = 1.75;
/// Arms hang this far below the horizontal in the rest pose.
const ARM_ANGLE: f32 = 0.89;

pub const HIPS: usize = 0;
pub const SPINE: usize = 1;
pub const CHEST: usize = 2;
pub const NECK: usize = 3;
pub const HEAD: usize = 4;
/// First joint of the left arm: clavicle, upper arm, forearm, hand, fingers. The right arm follows.
pub const ARM: usize = 5;
/// First joint of the left leg: thigh, shin, foot, toes. The right leg follows.
pub const LEG: usize = 15;
/// All joints.
pub const JOINT_COUNT: usize = 23;

/// Distances along the arm from the shoulder joint.
pub const ELBOW: f32 = 0.285;
pub const WRIST: f32 = 0.535;
pub const KNUCKLES: f32 = 0.625;

/// A human's proportions.
pub struct Figure {
    pub body: Body,
}

/// `left` is +x: the figure faces +z.
pub const SIDES: [f32; 2] = [1.0, -1.0];

impl Figure {
    /// Name, parent and rest position of every joint, in the order of the constants above.
    pub fn joints(&self) -> Vec<(String, Option<usize>, Vec3)> {
        let mut out: Vec<(String, Option<usize>, Vec3)> = vec![
            ("hips".into(), None, Vec3::new(0.0, 0.95, 0.0)),
            ("spine".into(), Some(HIPS), Vec3::new(0.0, 1.06, -0.005)),
            ("chest".into(), Some(SPINE), Vec3::new(0.0, 1.22, -0.01)),
            ("neck".into(), Some(CHEST), Vec3::new(0.0, 1.465, -0.02)),
            ("head".into(), Some(NECK), Vec3::new(0.0, 1.55, 0.0)),
        ];
        for (side, suffix) in SIDES.into_iter().zip(["l", "r"]) {
            let first = out.len();
            let names = ["clavicle", "upper_arm", "forearm", "hand", "fingers"];
            let places = [
                Vec3::new(side * 0.025, 1.43, 0.0),
                self.arm(side, 0.0),
                self.arm(side, ELBOW),
                self.arm(side, WRIST),
                self.arm(side, KNUCKLES),
            ];
            for (i, (name, place)) in names.into_iter().zip(places).enumerate() {
                let parent = if i == 0 { CHEST } else { first + i - 1 };
                out.push((format!("{name}_{suffix}"), Some(parent), place));
            }
        }
        for (side, suffix) in SIDES.into_iter().zip(["l", "r"]) {
            let first = out.len();
            let names = ["thigh", "shin", "foot", "toes"];
            for (i, name) in names.into_iter().enumerate() {
                let parent = if i == 0 { HIPS } else { first + i - 1 };
                let place = self.leg(side, i);
                out.push((format!("{name}_{suffix}"), Some(parent), place));
            }
        }
        out
    }

    /// A point of the straight arm, `along` from the shoulder joint.
    pub fn arm(&self, side: f32, along: f32) -> Vec3 {
        let b = &self.body;
        let x = (0.187 - 0.024 * b.curves) * b.shoulders + 0.012 * (b.girth - 1.0);
        let shoulder = Vec3::new(side * x, 1.418, -0.012);
        shoulder + self.arm_direction(side) * along
    }

    pub fn arm_direction(&self, side: f32) -> Vec3 {
        Vec3::new(side * ARM_ANGLE.cos(), -ARM_ANGLE.sin(), 0.0)
    }

    /// Thigh, shin, foot or toe joint.
    pub fn leg(&self, side: f32, joint: usize) -> Vec3 {
        let hip = 0.090 + 0.03 * (self.body.girth - 1.0).max(0.0) + 0.004 * self.body.curves;
        let p = [
            Vec3::new(hip, 0.905, 0.0),
            Vec3::new(hip + 0.001, 0.495, 0.010),
            Vec3::new(hip, 0.085, -0.020),
            Vec3::new(hip + 0.008, 0.022, 0.100),
        ][joint];
        Vec3::new(side * p.x, p.y, p.z)
    }

    /// Index of the side's first arm joint.
    pub fn arm_joint(side: f32) -> usize {
        if side > 0.0 { ARM } else { ARM + 5 }
    }

    /// Index of the side's first leg joint.
    pub fn leg_joint(side: f32) -> usize {
        if side > 0.0 { LEG } else { LEG + 4 }
    }

    pub fn trunk_bind(&self) -> Bind {
        chain(
            Vec3::ZERO,
            Vec3::Y,
            &[HIPS, SPINE, CHEST, NECK, HEAD],
            &[(1.06, 0.06), (1.22, 0.07), (1.475, 0.03), (1.555, 0.025)],
        )
    }

    pub fn arm_bind(&self, side: f32) -> Bind {
        let j = Self::arm_joint(side);
        chain(
            self.arm(side, 0.0),
            self.arm_direction(side),
            &[j, j + 1, j + 2, j + 3, j + 4],
            &[
                (0.0, 0.06),
                (ELBOW, 0.045),
                (WRIST, 0.022),
                (KNUCKLES, 0.012),
            ],
        )
    }

    /// Chest to clavicle, for what lies on top of the shoulders.
    pub fn shoulder_bind(&self, side: f32) -> Bind {
        let j = Self::arm_joint(side);
        chain(
            Vec3::ZERO,
            Vec3::X * side,
            &[CHEST, j, j + 1],
            &[(0.08, 0.06), (self.arm(1.0, 0.0).x + 0.01, 0.05)],
        )
    }

    pub fn leg_bind(&self, side: f32) -> Bind {
        let j = Self::leg_joint(side);
        chain(
            Vec3::ZERO,
            Vec3::NEG_Y,
            &[HIPS, j, j + 1, j + 2],
            &[(-0.915, 0.07), (-0.495, 0.055), (-0.075, 0.03)],
        )
    }

    pub fn foot_bind(&self, side: f32) -> Bind {
        let j = Self::leg_joint(side) + 2;
        chain(Vec3::ZERO, Vec3::Z, &[j, j + 1], &[(0.086, 0.014)])
    }

    /// Cross-sections of the trunk from crotch to neck, each half-width and depths grown by `extra`.
    pub fn trunk(&self, extra: f32) -> Vec<Prim> {
        let b = &self.body;
        let c = b.curves;
        let g = 1.0 + 0.85 * (b.girth - 1.0);
        // y, half-width, front, back; then what curves add to each, then what a belly adds to the front.
        const RINGS: [([f32; 4], [f32; 3], f32); 11] = [
            ([0.875, 0.140, 0.085, 0.090], [0.010, -0.004, 0.004], 0.0),
            ([0.915, 0.160, 0.092, 0.104], [0.014, -0.004, 0.006], 0.02),
            ([0.965, 0.163, 0.098, 0.102], [0.012, -0.006, 0.006], 0.06),
            ([1.020, 0.153, 0.100, 0.086], [-0.002, -0.010, -0.006], 0.10),
            ([1.080, 0.143, 0.099, 0.076], [-0.020, -0.018, -0.006], 0.11),
            ([1.150, 0.145, 0.103, 0.082], [-0.022, -0.020, -0.006], 0.08),
            ([1.230, 0.156, 0.110, 0.096], [-0.020, -0.018, -0.010], 0.03),
            ([1.310, 0.163, 0.109, 0.106], [-0.020, -0.016, -0.014], 0.0),
            ([1.380, 0.148, 0.086, 0.104], [-0.020, -0.010, -0.014], 0.0),
            ([1.430, 0.105, 0.058, 0.088], [-0.014, -0.006, -0.010], 0.0),
            ([1.460, 0.066, 0.040, 0.072], [-0.010, -0.004, -0.008], 0.0),
        ];
        let rings = RINGS
            .iter()
            .map(|&([at, w, f, r], [dw, df, dr], belly)| Ring {
                at,
                half_width: (w + dw * c) * g + extra,
                front: (f + df * c) * g + belly * b.belly + extra,
                back: (r + dr * c) * g + extra,
            })
            .collect();
        let bind = self.trunk_bind();
        let mut out = vec![loft(Vec3::ZERO, Vec3::Y, Vec3::Z, rings, 2.35, 0.0, &bind)];
        for side in SIDES {
            let x = side * (0.078 + 0.004 * c) * g;
            let buttock = Vec3::new(0.080 * g, 0.088, 0.074 * g) + extra;
            out.push(ellipsoid(
                Vec3::new(x, 0.905, -0.058),
                buttock,
                0.05,
                &self.leg_bind(side),
            ));
            let chest = if c > 0.5 {
                ellipsoid(
                    Vec3::new(side * 0.073 * g, 1.258, 0.078 * g),
                    Vec3::new(0.064, 0.066, 0.060) * (0.75 + 0.25 * g) + extra,
                    0.035,
                    &bind,
                )
            } else {
                ellipsoid(
                    Vec3::new(side * 0.078 * g, 1.305, 0.070 * g),
                    Vec3::new(0.082, 0.062, 0.048) * g + extra,
                    0.05,
                    &bind,
                )
            };
            out.push(chest);
            out.push(cone(
                Vec3::new(side * 0.035, 1.475, -0.035),
                self.arm(side, 0.0) + Vec3::new(-side * 0.03, 0.008, -0.005),
                0.036 * g + extra,
                0.044 * g + extra,
                0.05,
                &self.shoulder_bind(side),
            ));
        }
        out
    }

    pub fn neck(&self) -> Prim {
        let r = (0.053 - 0.009 * self.body.curves) * (0.5 + 0.5 * self.body.girth);
        cone(
            Vec3::new(0.0, 1.43, -0.025),
            Vec3::new(0.0, 1.60, 0.004),
            r + 0.004,
            r,
            0.04,
            &self.trunk_bind(),
        )
    }

    /// One arm from shoulder to wrist, grown by `extra`; `loose` widens towards the wrist, as a sleeve.
    pub fn arm_prim(&self, side: f32, extra: f32, loose: f32) -> Prim {
        const RINGS: [[f32; 3]; 10] = [
            [-0.010, 0.052, 0.054],
            [0.045, 0.055, 0.058],
            [0.110, 0.048, 0.052],
            [0.180, 0.043, 0.046],
            [0.250, 0.038, 0.040],
            [0.290, 0.037, 0.039],
            [0.335, 0.040, 0.043],
            [0.400, 0.036, 0.038],
            [0.480, 0.027, 0.030],
            [0.550, 0.021, 0.027],
        ];
        let g = self.body.girth * (1.0 - 0.16 * self.body.curves);
        let rings = RINGS
            .iter()
            .map(|&[at, w, d]| {
                let slack = extra + loose * smoothstep(0.05, 0.5, at);
                Ring {
                    at,
                    half_width: w * g + slack,
                    front: d * g + slack,
                    back: d * g + slack,
                }
            })
            .collect();
        let at = self.arm(side, 0.0);
        let direction = self.arm_direction(side);
        loft(
            at,
            direction,
            Vec3::Z,
            rings,
            2.0,
            0.04,
            &self.arm_bind(side),
        )
    }

    /// One leg from hip to ankle; `loose` as [`Figure::arm_prim`], from the knee down.
    pub fn leg_prim(&self, side: f32, extra: f32, loose: f32) -> Prim {
        const RINGS: [[f32; 4]; 12] = [
            [-0.020, 0.078, 0.080, 0.088],
            [0.060, 0.083, 0.087, 0.092],
            [0.180, 0.076, 0.080, 0.080],
            [0.300, 0.063, 0.066, 0.062],
            [0.385, 0.053, 0.057, 0.050],
            [0.430, 0.052, 0.055, 0.052],
            [0.490, 0.053, 0.047, 0.066],
            [0.550, 0.054, 0.043, 0.072],
            [0.630, 0.047, 0.039, 0.060],
            [0.720, 0.036, 0.034, 0.044],
            [0.790, 0.033, 0.036, 0.040],
            [0.830, 0.034, 0.040, 0.042],
        ];
        let g = self.body.girth;
        let thigh = 1.0 + 0.06 * self.body.curves;
        let rings = RINGS
            .iter()
            .map(|&[at, w, f, r]| {
                let upper = if at < 0.35 { thigh } else { 1.0 };
                let slack = extra + loose * smoothstep(0.2, 0.62, at);
                // A loose leg hangs straight: it follows neither calf nor ankle.
                let straight = smoothstep(0.40, 0.60, at) * (loose / 0.02).min(1.0);
                let mix = |v: f32, to: f32| v + (to - v) * straight;
                Ring {
                    at,
                    half_width: mix(w * g * upper, 0.046 * g) + slack,
                    front: mix(f * g * upper, 0.046 * g) + slack,
                    back: mix(r * g * upper, 0.054 * g) + slack,
                }
            })
            .collect();
        let (hip, ankle) = (self.leg(side, 0), self.leg(side, 2));
        let bind = self.leg_bind(side);
        let prim = loft(hip, ankle - hip, Vec3::Z, rings, 2.0, 0.045, &bind);
        // Skin stays behind cloth where thighs touch.
        apart(prim, side, 0.80, (0.011 - 0.5 * extra).max(0.004))
    }

    /// One bare foot, for low shoes.
    pub fn foot(&self, side: f32) -> Prim {
        let (ankle, ball) = (self.leg(side, 2), self.leg(side, 3));
        let bind = self.foot_bind(side);
        let heel = ankle + Vec3::new(0.0, -0.040, -0.016);
        cone(heel, ball + Vec3::Y * 0.012, 0.038, 0.025, 0.03, &bind)
    }

    /// One hand: palm, four fingers and a thumb.
    pub fn hand(&self, side: f32) -> Vec<Prim> {
        let d = self.arm_direction(side);
        // Palms face the thighs; thumbs point forward.
        let palm = d.cross(Vec3::Z) * side;
        let bind = self.arm_bind(side);
        let size = 1.0 - 0.10 * self.body.curves;
        let at = |along: f32, across: f32, out: f32| {
            self.arm(side, WRIST) + (d * along + Vec3::Z * across + palm * out) * size
        };
        let ring = |at: f32, thick: f32, wide: f32| Ring {
            at: at * size,
            half_width: thick * size,
            front: wide * size,
            back: wide * size,
        };
        let rings = vec![
            ring(-0.012, 0.018, 0.025),
            ring(0.020, 0.017, 0.031),
            ring(0.060, 0.0165, 0.040),
            ring(0.092, 0.0135, 0.040),
        ];
        let mut out = vec![loft(
            self.arm(side, WRIST),
            d,
            Vec3::Z,
            rings,
            2.3,
            0.02,
            &bind,
        )];
        for (i, length) in [0.076, 0.086, 0.080, 0.062].into_iter().enumerate() {
            let across = 0.0292 - 0.0196 * i as f32;
            let spread = across * 0.12;
            let knuckle = at(0.082, across, 0.0);
            let middle = at(0.082 + 0.55 * length, across + 0.6 * spread, 0.006);
            let tip = at(0.082 + 0.97 * length, across + spread, 0.017);
            out.push(cone(
                knuckle,
                middle,
                0.0105 * size,
                0.0095 * size,
                0.006,
                &bind,
            ));
            out.push(cone(
                middle,
                tip,
                0.0095 * size,
                0.0078 * size,
                0.002,
                &bind,
            ));
        }
        let hand = rigid(Self::arm_joint(side) + 3);
        let base = at(0.018, 0.026, 0.008);
        let joint = at(0.058, 0.056, 0.016);
        let tip = at(0.098, 0.064, 0.022);
        out.push(cone(
            base,
            joint,
            0.0145 * size,
            0.0115 * size,
            0.014,
            &hand,
        ));
        out.push(cone(joint, tip, 0.0115 * size, 0.0090 * size, 0.003, &hand));
        out
    }
}

/// A leg that joins the trunk and stays `gap` away from the middle below `crotch`.
pub fn apart(mut leg: Prim, side: f32, crotch: f32, gap: f32) -> Prim {
    leg.fade = Some((crotch - 0.01, crotch + 0.07));
    leg.clipped(move |p| (gap - side * p.x).min(crotch - p.y))
}

/// Weights that pass from one joint of a chain to the next around each bound, (place along `axis`, half the width).
pub fn chain(origin: Vec3, axis: Vec3, joints: &[usize], bounds: &[(f32, f32)]) -> Bind {
    let (joints, bounds) = (joints.to_vec(), bounds.to_vec());
    Arc::new(move |p, scale, out| {
        let s = (p - origin).dot(axis);
        let mut rest = scale;
        for (&joint, &(at, half)) in joints.iter().zip(&bounds) {
            let past = smoothstep(at - half, at + half, s);
            out[joint] += rest * (1.0 - past);
            rest *= past;
        }
        out[joints[joints.len() - 1]] += rest;
    })
}

pub fn rigid(joint: usize) -> Bind {
    Arc::new(move |_, scale, out| out[joint] += scale)
}

pub fn cone(a: Vec3, b: Vec3, ra: f32, rb: f32, blend: f32, bind: &Bind) -> Prim {
    Prim::new(Shape::RoundCone { a, b, ra, rb }, blend, bind)
}

pub fn ellipsoid(center: Vec3, radii: Vec3, blend: f32, bind: &Bind) -> Prim {
    tilted(center, radii, Mat3::IDENTITY, blend, bind)
}

pub fn tilted(center: Vec3, radii: Vec3, local_from_model: Mat3, blend: f32, bind: &Bind) -> Prim {
    let shape = Shape::Ellipsoid {
        center,
        radii,
        local_from_model,
    };
    Prim::new(shape, blend, bind)
}

/// A loft whose cross-sections are near superellipses of `power`.
pub fn loft(
    origin: Vec3,
    along: Vec3,
    front: Vec3,
    rings: Vec<Ring>,
    power: f32,
    blend: f32,
    bind: &Bind,
) -> Prim {
    // The squircle that passes through the superellipse's corners.
    let corner = 2f32.powf(2.0 / power) - 1.0;
    let shape = Shape::Loft {
        origin,
        local_from_model: frame(along, front),
        rings,
        squareness: 1.0 - corner * corner,
    };
    Prim::new(shape, blend, bind)
}
