//! Clothes: layers around the body with hems, collars, belts and soles.

use std::sync::Arc;

use glam::Vec3;

use super::field::{Bind, Layer, Paint, Prim, Ring, smoothstep};
use super::figure::{Figure, HIPS, SIDES, apart, cone, loft};
use super::params::{Bottom, Clothes, Shoes, Top};
use super::tops;

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
pub fn shade(paint: Paint, by: f32) -> Paint {
    Paint {
        tint: paint.tint.map(|t| (t * by).min(1.0)),
        ..paint
    }
}

pub fn layers(figure: &Figure, clothes: &Clothes, paints: &Paints) -> Vec<Layer> {
    let mut out = bottom(figure, clothes.bottom, paints);
    let tops = tops::top(figure, clothes.top, paints);
    if let Some(paint) = paints.belt {
        // A dress or coat is belted at the waist, trousers and skirts at the hips, where a loose top would hide it.
        let (around, y) = match clothes.top {
            Top::Dress | Top::Coat => (tops.first(), 1.090),
            Top::Suit | Top::Blouse => (out.first(), 1.022),
            _ => (None, 0.0),
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
pub fn drape(figure: &Figure, bind: &Bind, extra: f32, rings: &[[f32; 4]]) -> Prim {
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
pub fn skirt_bind(figure: &Figure) -> Bind {
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
                prims.push(apart(prim, side, 0.78, 0.005));
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
