//! Clothes: layers around the body with hems, collars, belts and soles.

use std::sync::Arc;

use glam::Vec3;

use super::field::{Bind, Layer, Paint, Prim, Ring, smoothstep};
use super::figure::{CHEST, Figure, HIPS, SIDES, apart, cone, ellipsoid, loft, rigid};
use super::params::{Bottom, Clothes, Shoes, Top};

/// Paints of one person's clothes.
pub struct Paints {
    pub top: Paint,
    pub accent: Paint,
    pub tie: Option<Paint>,
    pub bottom: Paint,
    pub belt: Option<Paint>,
    pub shoes: Paint,
    pub soles: Paint,
}

/// The same material, darker or lighter.
fn shade(paint: Paint, by: f32) -> Paint {
    Paint {
        tint: paint.tint.map(|t| (t * by).min(1.0)),
        ..paint
    }
}

pub fn layers(figure: &Figure, clothes: &Clothes, paints: &Paints) -> Vec<Layer> {
    let mut out = bottom(figure, clothes.bottom, paints);
    let tops = top(figure, clothes.top, paints);
    if let Some(paint) = paints.belt {
        // A dress or coat is belted at the waist, trousers at the hips.
        let (around, y) = match clothes.top {
            Top::Dress | Top::Coat => (tops.first(), 1.090),
            _ => (out.first(), 1.022),
        };
        let belt = around.map(|around| belt(around, paint, y));
        out.extend(belt);
    }
    out.extend(tops);
    out.extend(shoes(figure, clothes.shoes, paints));
    out
}

/// A band around a layer at height `y`, with a buckle.
fn belt(around: &Layer, paint: Paint, y: f32) -> Layer {
    let mut layer = Layer::new(paint, 0.006, around.prims.clone());
    layer.trim(move |p| (p.y - y).abs() - 0.018);
    // Not around the sleeves.
    layer.trim(|p| p.x.abs() - 0.27);
    layer.mark(shade(paint, 0.45), move |p| {
        (p.x.abs() - 0.022).max(-p.z).max((p.y - y).abs() - 0.013)
    });
    layer
}

fn ring(at: f32, half_width: f32, front: f32, back: f32) -> Ring {
    Ring {
        at,
        half_width,
        front,
        back,
    }
}

/// Hangs from the trunk: cross-sections that blend into the body above.
fn drape(figure: &Figure, bind: &Bind, extra: f32, rings: &[[f32; 4]]) -> Prim {
    let b = &figure.body;
    let g = 1.0 + 0.85 * (b.girth - 1.0);
    let rings = rings
        .iter()
        .map(|&[y, w, f, r]| {
            let waist = (1.0 - (y - 1.06).abs() / 0.16).max(0.0);
            let narrow = b.curves * 0.016 * waist;
            ring(
                y,
                w * g + extra - narrow,
                f * g + extra + 0.10 * b.belly * waist,
                r * g + extra - 0.5 * narrow,
            )
        })
        .collect();
    loft(Vec3::ZERO, Vec3::Y, Vec3::Z, rings, 2.35, 0.03, bind)
}

/// Cloth below the hips: each side goes with its thigh, the middle with both.
fn skirt_bind(figure: &Figure) -> Bind {
    let trunk = figure.trunk_bind();
    let thighs = SIDES.map(Figure::leg_joint);
    Arc::new(move |p, scale, out| {
        let low = smoothstep(0.98, 0.80, p.y);
        trunk(p, scale * (1.0 - low), out);
        let left = smoothstep(-0.085, 0.085, p.x);
        // The hips keep a share, so that the hem swings less than the knees.
        let hold = 0.12;
        out[HIPS] += scale * low * hold;
        out[thighs[0]] += scale * low * (1.0 - hold) * left;
        out[thighs[1]] += scale * low * (1.0 - hold) * (1.0 - left);
    })
}

fn bottom(figure: &Figure, bottom: Bottom, paints: &Paints) -> Vec<Layer> {
    let legs = |extra: f32, loose: f32| {
        let mut prims = figure.trunk(extra);
        prims.extend(SIDES.map(|side| figure.leg_prim(side, extra, loose)));
        prims
    };
    let (prims, hem) = match bottom {
        Bottom::Bare => return Vec::new(),
        Bottom::Trousers => (legs(0.011, 0.016), 0.036),
        Bottom::Jeans => (legs(0.009, 0.009), 0.060),
        Bottom::Leggings => (legs(0.005, 0.0), 0.105),
        Bottom::Shorts => {
            let mut prims = figure.trunk(0.011);
            for side in SIDES {
                let (hip, knee) = (figure.leg(side, 0), figure.leg(side, 1));
                let g = figure.body.girth;
                let rings = vec![
                    ring(-0.02, 0.086 * g, 0.090 * g, 0.098 * g),
                    ring(0.10, 0.100 * g, 0.102 * g, 0.106 * g),
                    ring(0.22, 0.103 * g, 0.102 * g, 0.106 * g),
                    ring(0.34, 0.102 * g, 0.100 * g, 0.104 * g),
                ];
                let bind = figure.leg_bind(side);
                let prim = loft(hip, knee - hip, Vec3::Z, rings, 2.0, 0.03, &bind);
                prims.push(apart(prim, side, 0.78));
            }
            (prims, 0.600)
        }
        Bottom::Skirt => {
            let rings = [
                [0.50, 0.190, 0.140, 0.150],
                [0.66, 0.186, 0.133, 0.146],
                [0.82, 0.178, 0.118, 0.138],
                [0.95, 0.168, 0.100, 0.116],
                [1.04, 0.142, 0.090, 0.088],
            ];
            let mut prims = figure.trunk(0.018);
            prims.push(drape(figure, &skirt_bind(figure), 0.012, &rings));
            (prims, 0.545)
        }
    };
    let mut layer = Layer::new(paints.bottom, 0.0, prims);
    layer.trim(move |p| (hem - p.y).max(p.y - 1.045));
    match bottom {
        Bottom::Jeans | Bottom::Trousers => {
            // Side seams and the fly, as a shade.
            let seam = shade(paints.bottom, 0.78);
            layer.mark(seam, move |p| {
                (p.x.abs() - 0.006)
                    .max(-p.z)
                    .max(0.93 - p.y)
                    .max(p.y - 1.02)
            });
            if bottom == Bottom::Jeans {
                layer.mark(seam, move |p| (p.y - hem - 0.024).max(0.0) - 0.0004);
            }
        }
        Bottom::Shorts => {
            let stripe = paints.accent;
            layer.mark(stripe, move |p| {
                (p.z.abs() - 0.016).max(0.09 - p.x.abs()).max(p.y - 1.0)
            });
        }
        Bottom::Leggings => {
            let stripe = shade(paints.bottom, 0.6);
            layer.mark(stripe, move |p| (p.z.abs() - 0.014).max(0.10 - p.x.abs()));
        }
        Bottom::Skirt | Bottom::Bare => {}
    }
    vec![layer]
}

/// Distance along the nearer arm from its shoulder joint; far below 0 where there is no arm.
fn along_arm(figure: &Figure) -> impl Fn(Vec3) -> f32 + Clone + Send + Sync + 'static {
    let (shoulder, direction) = (figure.arm(1.0, 0.0), figure.arm_direction(1.0));
    move |p: Vec3| {
        let q = Vec3::new(p.x.abs(), p.y, p.z) - shoulder;
        let along = q.dot(direction);
        if (q - direction * along).length_squared() < 0.12 * 0.12 {
            along
        } else {
            -1.0
        }
    }
}

/// Trunk and sleeves of a top, with a band at the cuff where `cuff` is not 0.
fn shell(figure: &Figure, paint: Paint, extra: f32, sleeve: f32, loose: f32) -> Layer {
    let mut prims = figure.trunk(extra);
    if sleeve <= 0.0 {
        return Layer::new(paint, 0.0, prims);
    }
    prims.extend(SIDES.map(|side| figure.arm_prim(side, extra * 0.85, loose)));
    let mut layer = Layer::new(paint, 0.0, prims);
    let along = along_arm(figure);
    layer.trim(move |p| along(p) - sleeve);
    layer
}

/// A close neckline: cloth `extra` away from the neck, up to a plane through its base that is lower in front.
fn crew_neck(figure: &Figure, layer: &mut Layer, extra: f32, y: f32) {
    let mut neck = figure.neck();
    neck.grow(extra);
    layer.prims.push(neck);
    layer.trim(move |p| (p.y - y + 0.45 * p.z).min(0.125 - p.x.hypot(p.z + 0.02)));
}

/// A wide neckline that shows the collarbones.
fn scoop_neck(layer: &mut Layer, y: f32, drop: f32) {
    layer.trim(move |p| {
        let front = y - drop * smoothstep(-0.06, 0.08, p.z);
        let below = (p.y - front - 0.045).min(0.0);
        let hole = Vec3::new(p.x / 0.085, below / 0.055, (p.z + 0.01) / 0.13);
        0.05 * (1.0 - hole.length())
    });
    layer.trim(move |p| (p.y - (y + 0.030)).min(0.092 - p.x.abs()));
}

/// A shirt collar: a band around the neck, higher behind, open in front.
fn collar(figure: &Figure, paint: Paint, extra: f32, height: f32) -> Layer {
    let mut neck = figure.neck();
    neck.grow(0.004);
    let mut layer = Layer::new(paint, extra, vec![neck]);
    layer.trim(move |p| (p.y - 1.452 - height) + 0.42 * p.z);
    layer.trim(|p| 1.42 - p.y);
    // The points fall apart below the chin.
    layer.trim(move |p| (0.55 * (p.y - 1.450) - p.x.abs()).min(p.z - 0.01) * 0.8);
    layer
}

fn top(figure: &Figure, top: Top, paints: &Paints) -> Vec<Layer> {
    let paint = paints.top;
    let along = along_arm(figure);
    let trunk = figure.trunk_bind();
    let straight = |extra: f32, low: f32| {
        let rings = [
            [low - 0.04, 0.180, 0.110, 0.128],
            [0.96, 0.175, 0.109, 0.121],
            [1.06, 0.161, 0.108, 0.102],
            [1.16, 0.156, 0.110, 0.098],
            [1.26, 0.158, 0.108, 0.098],
        ];
        drape(figure, &trunk, extra, &rings)
    };
    match top {
        Top::Tshirt | Top::Blouse => {
            let blouse = top == Top::Blouse;
            let sleeve = if blouse { 0.40 } else { 0.165 };
            let mut layer = shell(figure, paint, 0.012, sleeve, 0.012);
            let hem = if blouse { 1.02 } else { 0.900 };
            layer
                .prims
                .push(straight(if blouse { -0.014 } else { 0.008 }, 0.900));
            if blouse {
                scoop_neck(&mut layer, 1.440, 0.085);
            } else {
                crew_neck(figure, &mut layer, 0.011, 1.486);
            }
            layer.trim(move |p| hem - p.y);
            if !blouse {
                layer.mark(paints.accent, |p| (p.y - 1.235).abs() - 0.030);
            }
            let band = shade(paint, 0.8);
            layer.mark(band, move |p| p.y - (hem + 0.018));
            layer.mark(band, move |p| sleeve - 0.016 - along(p));
            vec![layer]
        }
        Top::Tank => {
            let mut layer = shell(figure, paint, 0.012, 0.0, 0.0);
            layer.prims.push(straight(0.011, 0.92));
            scoop_neck(&mut layer, 1.430, 0.07);
            let x = figure.arm(1.0, 0.0).x - 0.035;
            layer.trim(move |p| 0.92 - p.y);
            layer.trim(move |p| {
                let q = Vec3::new(p.x.abs() - x - 0.045, (p.y - 1.40) * 0.55, p.z * 0.5);
                0.062 - q.length()
            });
            let accent = paints.accent;
            layer.mark(accent, move |p| {
                (p.x.abs() - 0.105).abs() - 0.012 + (p.y - 1.22).max(0.0)
            });
            vec![layer]
        }
        Top::Shirt => {
            let mut layer = shell(figure, paint, 0.013, 0.525, 0.010);
            layer.prims.push(straight(0.004, 0.90));
            layer.trim(|p| 0.905 - p.y);
            crew_neck(figure, &mut layer, 0.010, 1.488);
            buttoned(&mut layer, paint, 0.90, 1.44);
            layer.mark(shade(paint, 0.85), move |p| 0.480 - along(p));
            vec![layer, collar(figure, shade(paint, 0.93), 0.013, 0.060)]
        }
        Top::Vest => {
            let mut shirt = shell(figure, paints.accent, 0.010, 0.525, 0.010);
            shirt.trim(|p| 0.95 - p.y);
            crew_neck(figure, &mut shirt, 0.008, 1.488);
            let mut vest = shell(figure, paint, 0.024, 0.0, 0.0);
            vest.prims.push(straight(0.016, 0.90));
            vest.trim(|p| 0.905 - p.y);
            let x = figure.arm(1.0, 0.0).x;
            vest.trim(move |p| {
                let q = Vec3::new(p.x.abs() - x - 0.050, (p.y - 1.385) * 0.60, p.z * 0.45);
                0.070 - q.length()
            });
            // Open in a V at the neck.
            vest.trim(|p| {
                let v = 0.030 + 0.42 * (p.y - 1.33);
                (v - p.x.abs()).min(p.y - 1.27).min(p.z) * 0.8
            });
            crew_neck(figure, &mut vest, 0.012, 1.472);
            let band = Paint {
                tint: [1.0; 3],
                material: paints.tie.unwrap_or(paints.accent).material,
            };
            vest.mark(band, |p| (p.y - 1.115).abs() - 0.024);
            vest.mark(band, |p| (p.y - 0.990).abs() - 0.024);
            vest.mark(band, |p| {
                ((p.x.abs() - 0.098).abs() - 0.021).max(1.13 - p.y)
            });
            vest.mark(shade(paint, 0.45), |p| {
                (p.x.abs() - 0.005).max(-p.z).max(p.y - 1.28)
            });
            let collar = collar(figure, shade(paints.accent, 0.9), 0.013, 0.058);
            vec![shirt, vest, collar]
        }
        Top::Hoodie => {
            let mut layer = shell(figure, paint, 0.021, 0.545, 0.010);
            layer.prims.push(straight(0.014, 0.90));
            let bind = rigid(CHEST);
            for side in SIDES {
                // The hood lies around the neck and on the back.
                layer.prims.push(cone(
                    Vec3::new(side * 0.088, 1.452, 0.012),
                    Vec3::new(side * 0.046, 1.425, -0.125),
                    0.036,
                    0.058,
                    0.03,
                    &bind,
                ));
                layer.prims.push(cone(
                    Vec3::new(side * 0.088, 1.452, 0.012),
                    Vec3::new(side * 0.030, 1.408, 0.066),
                    0.030,
                    0.018,
                    0.02,
                    &bind,
                ));
            }
            layer.prims.push(ellipsoid(
                Vec3::new(
                    0.0,
                    1.055,
                    0.108 * figure.body.girth + 0.08 * figure.body.belly,
                ),
                Vec3::new(0.115, 0.070, 0.030),
                0.012,
                &trunk,
            ));
            layer.trim(|p| 0.895 - p.y);
            let edge = shade(paint, 0.72);
            layer.mark(edge, |p| p.y - 0.935);
            layer.mark(edge, move |p| 0.505 - along(p));
            layer.mark(edge, |p| {
                // Slanted openings of the pouch.
                let side = p.x.abs() - 0.125 + 0.6 * (p.y - 1.02).max(0.0);
                side.abs().max((p.y - 1.045).abs() - 0.065).max(0.03 - p.z) - 0.005
            });
            let accent = paints.accent;
            let strings: Vec<Prim> = SIDES
                .iter()
                .map(|side| {
                    let z = 0.124 * (0.3 + 0.7 * figure.body.girth);
                    cone(
                        Vec3::new(side * 0.032, 1.405, z - 0.008),
                        Vec3::new(side * 0.038, 1.270, z + 0.026),
                        0.0065,
                        0.0055,
                        0.0,
                        &trunk,
                    )
                })
                .collect();
            vec![layer, Layer::new(accent, 0.0, strings)]
        }
        Top::Suit => suit(figure, paints),
        Top::Dress => {
            let mut layer = shell(figure, paint, 0.009, 0.115, 0.012);
            let rings = [
                [0.46, 0.250, 0.205, 0.215],
                [0.62, 0.222, 0.172, 0.184],
                [0.78, 0.196, 0.138, 0.156],
                [0.92, 0.174, 0.108, 0.124],
                [1.02, 0.152, 0.096, 0.094],
                [1.09, 0.140, 0.094, 0.078],
            ];
            layer
                .prims
                .push(drape(figure, &skirt_bind(figure), 0.009, &rings));
            scoop_neck(&mut layer, 1.432, 0.060);
            layer.trim(|p| 0.525 - p.y);
            let accent = paints.accent;
            layer.mark(accent, |p| (p.y - 0.565).abs() - 0.014);
            layer.mark(shade(paint, 0.85), move |p| 0.100 - along(p));
            vec![layer]
        }
        Top::Coat => {
            let mut layer = shell(figure, paint, 0.026, 0.535, 0.012);
            let rings = [
                [0.50, 0.222, 0.170, 0.178],
                [0.70, 0.206, 0.152, 0.164],
                [0.86, 0.194, 0.134, 0.148],
                [1.00, 0.176, 0.120, 0.120],
                [1.10, 0.164, 0.116, 0.104],
                [1.24, 0.162, 0.112, 0.102],
            ];
            layer
                .prims
                .push(drape(figure, &skirt_bind(figure), 0.020, &rings));
            layer.trim(|p| 0.575 - p.y);
            crew_neck(figure, &mut layer, 0.018, 1.478);
            let dark = shade(paint, 0.62);
            // The overlap runs left of the middle, with two buttons a row.
            layer.mark(dark, |p| {
                ((p.x - 0.040).abs() - 0.0045).max(-p.z).max(p.y - 1.36)
            });
            for y in [1.29, 1.17, 1.05, 0.93] {
                layer.mark(shade(paint, 0.3), move |p| {
                    let q = Vec3::new(p.x + 0.005, p.y - y, 0.0);
                    q.length().max(-p.z) - 0.012
                });
            }
            layer.mark(dark, move |p| (along(p) - 0.470).abs() - 0.006);
            layer.mark(dark, |p| {
                let q = ((p.x.abs() - 0.135).abs() - 0.055).max((p.y - 0.905).abs() - 0.008);
                q.max(-p.z)
            });
            let mut out = vec![layer, collar(figure, shade(paint, 0.8), 0.026, 0.046)];
            if let Some(scarf) = paints.tie {
                let mut wrap = collar(figure, scarf, 0.024, 0.064);
                wrap.prims.push(ellipsoid(
                    Vec3::new(0.0, 1.450, 0.045),
                    Vec3::new(0.042, 0.026, 0.026),
                    0.02,
                    &trunk,
                ));
                wrap.trims.pop();
                wrap.mark(shade(scarf, 0.7), |p| (p.y * 40.0).sin() * 0.01 - 0.004);
                out.push(wrap);
            }
            out
        }
    }
}

/// A placket down the front with its buttons.
fn buttoned(layer: &mut Layer, paint: Paint, low: f32, high: f32) {
    layer.mark(shade(paint, 0.86), move |p| {
        ((p.x - 0.016).abs() - 0.0045)
            .max(-p.z)
            .max(low - p.y)
            .max(p.y - high)
    });
}

fn suit(figure: &Figure, paints: &Paints) -> Vec<Layer> {
    let paint = paints.top;
    let along = along_arm(figure);
    let mut shirt = shell(figure, paints.accent, 0.009, 0.545, 0.004);
    shirt.trim(|p| 0.98 - p.y);
    crew_neck(figure, &mut shirt, 0.008, 1.488);
    let mut jacket = shell(figure, paint, 0.020, 0.522, 0.008);
    let rings = [
        [0.78, 0.188, 0.122, 0.136],
        [0.90, 0.180, 0.116, 0.128],
        [1.00, 0.166, 0.110, 0.108],
        [1.10, 0.156, 0.106, 0.094],
        [1.24, 0.160, 0.108, 0.100],
    ];
    jacket
        .prims
        .push(drape(figure, &skirt_bind(figure), 0.014, &rings));
    // Padded shoulders.
    for side in SIDES {
        jacket.prims.push(ellipsoid(
            figure.arm(side, 0.0) + Vec3::new(-side * 0.015, 0.030, 0.0),
            Vec3::new(0.052, 0.036, 0.060),
            0.04,
            &figure.shoulder_bind(side),
        ));
    }
    jacket.trim(|p| 0.825 - p.y);
    const BUTTON: f32 = 1.135;
    let opening = |p: Vec3| {
        // Half the width of what the jacket leaves open, above and below its button.
        if p.y > BUTTON {
            0.30 * (p.y - BUTTON)
        } else {
            0.20 * (BUTTON - 0.03 - p.y).max(0.0).powf(1.4)
        }
    };
    jacket.trim(move |p| (opening(p) - p.x.abs()).min(p.z + 0.005) * 0.9);
    crew_neck(figure, &mut jacket, 0.014, 1.482);
    // Lapels widen towards the chest and end in a notch.
    jacket.mark(shade(paint, 0.66), move |p| {
        let across = p.x.abs() - opening(p);
        let width = 0.052 * smoothstep(BUTTON, 1.36, p.y);
        (across - width).max(BUTTON - p.y).max(-p.z).max(p.y - 1.42)
    });
    for y in [BUTTON - 0.012, BUTTON - 0.105] {
        jacket.mark(shade(paint, 0.3), move |p| {
            let q = Vec3::new(p.x - 0.014, p.y - y, 0.0);
            q.length().max(-p.z) - 0.0095
        });
    }
    jacket.mark(shade(paint, 0.55), |p| {
        let pocket = ((p.x.abs() - 0.118).abs() - 0.050).max((p.y - 0.985).abs() - 0.008);
        pocket.max(-p.z)
    });
    jacket.mark(shade(paint, 0.7), |p| {
        (p.x.abs() - 0.004).max(p.z).max(p.y - 1.02)
    });
    jacket.mark(shade(paint, 0.75), move |p| 0.508 - along(p));
    let mut out = vec![collar(figure, paints.accent, 0.013, 0.062)];
    if let Some(tie) = paints.tie {
        shirt.mark(tie, |p| {
            let width = 0.014 + 0.075 * (1.42 - p.y).clamp(0.0, 0.3);
            (p.x.abs() - width).max(-p.z).max(p.y - 1.45)
        });
        let trunk = figure.trunk_bind();
        let knot = ellipsoid(
            Vec3::new(0.0, 1.434, 0.052 + 0.02 * (figure.body.girth - 1.0)),
            Vec3::new(0.021, 0.020, 0.018),
            0.0,
            &trunk,
        );
        out.push(Layer::new(tie, 0.0, vec![knot]));
    }
    out.push(shirt);
    out.push(jacket);
    out
}

fn shoes(figure: &Figure, shoes: Shoes, paints: &Paints) -> Vec<Layer> {
    let mut uppers = Vec::new();
    let mut soles = Vec::new();
    for side in SIDES {
        let ball = figure.leg(side, 3);
        let bind = figure.foot_bind(side);
        // Heel to toe along z, toes a little outwards; the top is the loft's front.
        let along = Vec3::new(side * 0.07, 0.0, 1.0).normalize();
        let origin = Vec3::new(ball.x - side * 0.008, 0.036, 0.0);
        let thick = match shoes {
            Shoes::Leather => 0.016,
            Shoes::Sneakers => 0.025,
            Shoes::Boots => 0.023,
            Shoes::Flats => 0.008,
        };
        let tall = match shoes {
            Shoes::Leather => 1.0,
            Shoes::Sneakers => 1.12,
            Shoes::Boots => 1.18,
            Shoes::Flats => 0.95,
        };
        let wide = match shoes {
            Shoes::Leather => 1.0,
            Shoes::Sneakers | Shoes::Boots => 1.07,
            Shoes::Flats => 0.90,
        };
        let rings = |grow: f32, low: f32| -> Vec<Ring> {
            [
                [-0.074, 0.028, 0.046 * tall],
                [-0.050, 0.035, 0.056 * tall],
                [-0.010, 0.036, 0.056 * tall],
                [0.030, 0.037, 0.050],
                [0.080, 0.043, 0.041],
                [0.120, 0.045, 0.034],
                [0.150, 0.041, 0.029],
                [0.168, 0.032, 0.024],
            ]
            .map(|[z, w, top]| ring(z, w * wide + grow, top + grow, low))
            .to_vec()
        };
        uppers.push(loft(
            origin,
            along,
            Vec3::Y,
            rings(0.0, 0.034),
            2.3,
            0.02,
            &bind,
        ));
        let clip = move |p: Vec3| p.y - thick;
        soles
            .push(loft(origin, along, Vec3::Y, rings(0.004, 0.060), 2.6, 0.0, &bind).clipped(clip));
        if shoes == Shoes::Boots {
            let shaft = figure.leg_prim(side, 0.014, 0.004);
            uppers.push(shaft.clipped(|p| p.y - 0.20));
        } else if shoes != Shoes::Flats {
            let ankle = figure.leg(side, 2);
            uppers.push(cone(
                ankle + Vec3::new(0.0, 0.012, -0.002),
                ankle - Vec3::new(0.0, 0.030, -0.002),
                0.043,
                0.044,
                0.02,
                &bind,
            ));
        }
    }
    let mut upper = Layer::new(paints.shoes, 0.0, uppers);
    upper.trim(|p| 0.006 - p.y);
    match shoes {
        Shoes::Leather | Shoes::Boots => {
            upper.mark(shade(paints.shoes, 0.6), |p| (p.z - 0.115).abs() - 0.004);
        }
        Shoes::Sneakers => {
            let laces = paints.soles;
            upper.mark(laces, move |p| {
                // A tongue with laces across the instep.
                let middle = (p.x.abs() - 0.090 - 0.07 * p.z).abs() - 0.017;
                middle.max(0.015 - p.z).max(p.z - 0.095).max(0.045 - p.y)
            });
        }
        Shoes::Flats => {
            // Cut low over the instep.
            upper.trim(|p| (p.y - 0.040).min(0.075 + (p.y - 0.04) - p.z));
        }
    }
    let mut sole = Layer::new(paints.soles, 0.0, soles);
    sole.trim(|p| -p.y);
    vec![upper, sole]
}
