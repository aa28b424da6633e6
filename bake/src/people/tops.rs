//! Tops: shirts, jackets, dresses and coats with their collars and necklines.

use glam::Vec3;

use super::clothes::{Paints, drape, shade, skirt_bind};
use super::field::{Layer, Paint, Prim, smoothstep};
use super::figure::{CHEST, Figure, SIDES, cone, ellipsoid, rigid};
use super::params::Top;

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

pub fn top(figure: &Figure, top: Top, paints: &Paints) -> Vec<Layer> {
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
            (p.x.abs() - width)
                .max(-p.z)
                .max(p.y - 1.45)
                .max(1.10 - p.y)
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
