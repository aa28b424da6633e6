//! Signed-distance modelling: layers of smoothly united primitives, each tied to the joints that move it.

use std::sync::Arc;

use glam::{Mat3, Vec3};

/// Adds a primitive's joint weights at a rest position, scaled, to a dense array `[joint_count]`; they sum to the scale.
pub type Bind = Arc<dyn Fn(Vec3, f32, &mut [f32]) + Send + Sync>;
/// A signed distance-like function: negative inside.
pub type Region = Arc<dyn Fn(Vec3) -> f32 + Send + Sync>;

/// One cross-section of a [`Shape::Loft`].
#[derive(Debug, Clone, Copy)]
pub struct Ring {
    /// Place along the axis.
    pub at: f32,
    /// Half the width, across the axis.
    pub half_width: f32,
    /// Depth in front of the axis.
    pub front: f32,
    /// Depth behind the axis.
    pub back: f32,
}

/// A primitive's surface.
#[derive(Debug, Clone)]
pub enum Shape {
    /// Two balls and the cone that touches both.
    RoundCone { a: Vec3, b: Vec3, ra: f32, rb: f32 },
    /// Rotated by `local_from_model`.
    Ellipsoid {
        center: Vec3,
        radii: Vec3,
        local_from_model: Mat3,
    },
    /// Rounded cross-sections along the local y axis, rounded ends. Squareness is 0 for ellipses and 1 for rectangles.
    Loft {
        origin: Vec3,
        local_from_model: Mat3,
        rings: Vec<Ring>,
        squareness: f32,
    },
    /// An elliptic ring in the local xz plane with a cross-section of `minor` by `height`.
    Torus {
        center: Vec3,
        local_from_model: Mat3,
        radius_x: f32,
        radius_z: f32,
        minor: f32,
        height: f32,
    },
}

/// What a primitive does to those before it in its layer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Op {
    /// Adds.
    Union,
    /// Takes away.
    Carve,
}

/// A shape in a layer.
#[derive(Clone)]
pub struct Prim {
    pub shape: Shape,
    pub op: Op,
    /// Width of the blend with what is there.
    pub blend: f32,
    /// Heights between which the blend falls to nothing, the lower first: legs join the trunk, never each other.
    pub fade: Option<(f32, f32)>,
    pub bind: Bind,
    /// Cuts this primitive alone.
    pub clip: Option<Region>,
    center: Vec3,
    radius: f32,
}

impl Prim {
    pub fn new(shape: Shape, blend: f32, bind: &Bind) -> Self {
        let (center, radius) = shape.bounds();
        Self {
            shape,
            op: Op::Union,
            blend,
            fade: None,
            bind: bind.clone(),
            clip: None,
            center,
            radius,
        }
    }

    /// Makes a round cone thicker by `extra`; other shapes stay as they are.
    pub fn grow(&mut self, extra: f32) {
        if let Shape::RoundCone { ra, rb, .. } = &mut self.shape {
            *ra += extra;
            *rb += extra;
            self.radius += extra;
        }
    }

    /// The same shape, taken away.
    pub fn carve(mut self) -> Self {
        self.op = Op::Carve;
        self
    }

    /// Keeps only what is inside `region`.
    pub fn clipped(mut self, region: impl Fn(Vec3) -> f32 + Send + Sync + 'static) -> Self {
        self.clip = Some(Arc::new(region));
        self
    }

    pub fn distance(&self, p: Vec3) -> f32 {
        let d = self.shape.distance(p);
        self.clip.as_ref().map_or(d, |clip| d.max(clip(p)))
    }

    fn blend_at(&self, p: Vec3) -> f32 {
        match self.fade {
            Some((low, high)) => self.blend * smoothstep(low, high, p.y),
            None => self.blend,
        }
    }

    fn below(&self, p: Vec3) -> f32 {
        p.distance(self.center) - self.radius
    }
}

/// How a surface is coloured: a material, and a tint that multiplies its colour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Paint {
    pub material: usize,
    pub tint: [f32; 3],
}

/// A solid of one material: what stands out beyond all other layers is seen.
#[derive(Clone)]
pub struct Layer {
    pub paint: Paint,
    pub prims: Vec<Prim>,
    /// Thickness added around the primitives.
    pub offset: f32,
    /// The layer is inside all of these.
    pub trims: Vec<Region>,
    /// Regions of the surface with another paint; the last that matches wins.
    pub marks: Vec<(Region, Paint)>,
}

impl Layer {
    pub fn new(paint: Paint, offset: f32, prims: Vec<Prim>) -> Self {
        Self {
            paint,
            prims,
            offset,
            trims: Vec::new(),
            marks: Vec::new(),
        }
    }

    pub fn trim(&mut self, region: impl Fn(Vec3) -> f32 + Send + Sync + 'static) -> &mut Self {
        self.trims.push(Arc::new(region));
        self
    }

    pub fn mark(
        &mut self,
        paint: Paint,
        region: impl Fn(Vec3) -> f32 + Send + Sync + 'static,
    ) -> &mut Self {
        self.marks.push((Arc::new(region), paint));
        self
    }

    /// Signed distance to the layer over the primitives in `active` (all: `None`).
    pub fn distance(&self, p: Vec3, active: Option<&[u16]>) -> f32 {
        let solid = self.solid(p, active);
        self.trims.iter().fold(solid, |d, trim| d.max(trim(p)))
    }

    /// The same before trimming.
    fn solid(&self, p: Vec3, active: Option<&[u16]>) -> f32 {
        let mut d = f32::MAX;
        match active {
            Some(list) => {
                for &i in list {
                    d = fold(d, &self.prims[i as usize], p);
                }
            }
            None => {
                for prim in &self.prims {
                    d = fold(d, prim, p);
                }
            }
        }
        d - self.offset
    }

    /// The trim that makes the surface at `p`, counted from 1; 0: the solid itself does.
    pub fn cutting_trim(&self, p: Vec3, active: Option<&[u16]>) -> usize {
        let mut best = (self.solid(p, active), 0);
        for (i, trim) in self.trims.iter().enumerate() {
            let d = trim(p);
            if d > best.0 {
                best = (d, i + 1);
            }
        }
        best.1
    }

    /// Signed distance to the solid (0) or to one trim alone.
    pub fn face_distance(&self, p: Vec3, active: Option<&[u16]>, trim: usize) -> f32 {
        match trim {
            0 => self.solid(p, active),
            _ => self.trims[trim - 1](p),
        }
    }

    /// Adds the joint weights at `p` to `out` in full measure, shared among the primitives that make the surface there:
    /// those `falloff` farther than the nearest have a share of 1/e.
    pub fn bind(&self, p: Vec3, falloff: f32, out: &mut [f32]) {
        let far = 5.0 * falloff;
        let mut near: Vec<(f32, &Prim)> = Vec::with_capacity(8);
        let mut least = f32::MAX;
        for prim in self.prims.iter().filter(|x| x.op == Op::Union) {
            if prim.below(p) < least + far {
                let d = prim.distance(p);
                least = least.min(d);
                near.push((d, prim));
            }
        }
        for (d, prim) in near.into_iter().filter(|n| n.0 < least + far) {
            (prim.bind)(p, (-(d - least) / falloff).exp(), out);
        }
        let sum: f32 = out.iter().sum();
        out.iter_mut().for_each(|w| *w /= sum);
    }

    /// Normal of the solid (0) or of one trim alone.
    pub fn normal(&self, p: Vec3, trim: usize) -> Vec3 {
        gradient(|q| self.face_distance(q, None, trim), p).normalize_or(Vec3::Y)
    }
}

fn fold(d: f32, prim: &Prim, p: Vec3) -> f32 {
    match prim.op {
        Op::Union if d == f32::MAX => prim.distance(p),
        Op::Union if prim.below(p) > d + prim.blend => d,
        Op::Union => smooth_min(d, prim.distance(p), prim.blend_at(p)),
        Op::Carve if prim.below(p) > prim.blend - d => d,
        Op::Carve => -smooth_min(-d, prim.distance(p), prim.blend),
    }
}

/// Quadratic smooth minimum; `k` is the width of the blend.
pub fn smooth_min(a: f32, b: f32, k: f32) -> f32 {
    if k <= 0.0 {
        return a.min(b);
    }
    let h = (k - (a - b).abs()).max(0.0) / k;
    a.min(b) - h * h * k * 0.25
}

/// Gradient by a tetrahedron of samples.
pub fn gradient(f: impl Fn(Vec3) -> f32, p: Vec3) -> Vec3 {
    const E: f32 = 0.0007;
    let corners = [
        Vec3::new(1.0, -1.0, -1.0),
        Vec3::new(-1.0, -1.0, 1.0),
        Vec3::new(-1.0, 1.0, -1.0),
        Vec3::new(1.0, 1.0, 1.0),
    ];
    corners.iter().map(|&c| c * f(p + c * E)).sum::<Vec3>() / (4.0 * E)
}

/// 0 below `a`, 1 above `b`, smooth between.
pub fn smoothstep(a: f32, b: f32, x: f32) -> f32 {
    let t = ((x - a) / (b - a)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Rows `x`, `y`, `z`: model directions of the local axes, where `y` is along `along` and `z` nearest to `front`.
pub fn frame(along: Vec3, front: Vec3) -> Mat3 {
    let y = along.normalize();
    let z = (front - y * front.dot(y)).normalize();
    Mat3::from_cols(y.cross(z), y, z).transpose()
}

impl Shape {
    pub fn distance(&self, p: Vec3) -> f32 {
        match self {
            Self::RoundCone { a, b, ra, rb } => {
                let ab = *b - *a;
                let t = ((p - *a).dot(ab) / ab.length_squared().max(1e-12)).clamp(0.0, 1.0);
                p.distance(*a + ab * t) - (ra + (rb - ra) * t)
            }
            Self::Ellipsoid {
                center,
                radii,
                local_from_model,
            } => ellipsoid(*local_from_model * (p - *center), *radii),
            Self::Loft {
                origin,
                local_from_model,
                rings,
                squareness,
            } => loft(*local_from_model * (p - *origin), rings, *squareness),
            Self::Torus {
                center,
                local_from_model,
                radius_x,
                radius_z,
                minor,
                height,
            } => {
                let q = *local_from_model * (p - *center);
                let around = ((q.x / radius_x).powi(2) + (q.z / radius_z).powi(2))
                    .sqrt()
                    .max(1e-6);
                let radius = (q.x * q.x + q.z * q.z).sqrt();
                let out = radius - radius / around;
                ellipsoid(Vec3::new(out, q.y, 0.0), Vec3::new(*minor, *height, *minor))
            }
        }
    }

    /// A ball that contains the surface.
    fn bounds(&self) -> (Vec3, f32) {
        match self {
            Self::RoundCone { a, b, ra, rb } => {
                ((*a + *b) * 0.5, a.distance(*b) * 0.5 + ra.max(*rb))
            }
            Self::Ellipsoid { center, radii, .. } => (*center, radii.max_element()),
            Self::Loft {
                origin,
                local_from_model,
                rings,
                ..
            } => {
                let (first, last) = (rings[0], rings[rings.len() - 1]);
                let mid = (first.at + last.at) * 0.5;
                let widest = rings
                    .iter()
                    .map(|r| r.half_width.hypot(r.front.max(r.back)))
                    .fold(0.0, f32::max);
                let cap = cap_radius(&first).max(cap_radius(&last));
                (
                    *origin + local_from_model.transpose() * Vec3::new(0.0, mid, 0.0),
                    widest.hypot((last.at - first.at) * 0.5 + cap) * 1.05,
                )
            }
            Self::Torus {
                center,
                radius_x,
                radius_z,
                minor,
                height,
                ..
            } => (*center, radius_x.max(*radius_z) + minor.max(*height)),
        }
    }
}

fn ellipsoid(q: Vec3, radii: Vec3) -> f32 {
    let k0 = (q / radii).length();
    let k1 = (q / (radii * radii)).length();
    if k1 < 1e-9 {
        return -radii.min_element();
    }
    k0 * (k0 - 1.0) / k1
}

/// Height of the rounded end of a loft.
fn cap_radius(r: &Ring) -> f32 {
    0.7 * r.half_width.min((r.front + r.back) * 0.5)
}

fn loft(q: Vec3, rings: &[Ring], squareness: f32) -> f32 {
    let last = rings.len() - 1;
    let (low, high) = (rings[0].at, rings[last].at);
    let y = q.y.clamp(low, high);
    let i = rings[1..last].iter().take_while(|r| r.at <= y).count();
    let t = (y - rings[i].at) / (rings[i + 1].at - rings[i].at);
    let [half_width, front, back] = catmull_rom(rings, i, t);
    let depth = if q.z >= 0.0 { front } else { back };
    let excess = q.y - y;
    let end = if excess < 0.0 {
        &rings[0]
    } else {
        &rings[last]
    };
    // A squircle: x^2 + z^2 - squareness x^2 z^2 = 1, scaled.
    let (x, z) = ((q.x / half_width).powi(2), (q.z / depth).powi(2));
    let sum = x + z;
    let side_squared = 0.5 * (sum + (sum * sum - 4.0 * squareness * x * z).max(0.0).sqrt());
    let e = excess / cap_radius(end);
    let k = (side_squared + e * e).sqrt();
    let length = (q.x * q.x + q.z * q.z + excess * excess).sqrt();
    if k < 1e-5 {
        return -half_width.min(depth);
    }
    // Along the ray from the axis, less where flat sides meet that ray at a slant; continuous where front meets back.
    let narrow = half_width.min(front).min(back);
    let radial = length - length / k;
    radial.max(-narrow) * (narrow / (length / k).max(narrow)).max(0.6)
}

/// Half-width, front and back between ring `i` and the next.
fn catmull_rom(rings: &[Ring], i: usize, t: f32) -> [f32; 3] {
    let value = |r: &Ring| [r.half_width, r.front, r.back];
    let (a, b) = (&rings[i], &rings[i + 1]);
    let before = &rings[i.saturating_sub(1)];
    let after = &rings[(i + 2).min(rings.len() - 1)];
    let span = b.at - a.at;
    let (t2, t3) = (t * t, t * t * t);
    let mut out = [0.0; 3];
    for (k, out) in out.iter_mut().enumerate() {
        let (va, vb) = (value(a)[k], value(b)[k]);
        let slope_a = (vb - value(before)[k]) / (b.at - before.at) * span;
        let slope_b = (value(after)[k] - va) / (after.at - a.at) * span;
        *out = (va * (2.0 * t3 - 3.0 * t2 + 1.0)
            + slope_a * (t3 - 2.0 * t2 + t)
            + vb * (3.0 * t2 - 2.0 * t3)
            + slope_b * (t3 - t2))
            .max(1e-3);
    }
    out
}

/// All layers of a character.
#[derive(Clone, Default)]
pub struct Model {
    pub layers: Vec<Layer>,
}

/// The part of a model that can matter inside a ball: layers and their primitives.
pub type Active = Vec<(u16, Vec<u16>)>;

impl Model {
    /// Signed distance to the union and the layer that makes it.
    pub fn distance(&self, p: Vec3, active: Option<&Active>) -> (f32, usize) {
        let mut best = (f32::MAX, 0);
        let mut take = |layer: usize, d: f32| {
            if d < best.0 {
                best = (d, layer);
            }
        };
        match active {
            Some(active) => {
                for (layer, prims) in active {
                    let layer = *layer as usize;
                    take(layer, self.layers[layer].distance(p, Some(prims)));
                }
            }
            None => {
                for (i, layer) in self.layers.iter().enumerate() {
                    take(i, layer.distance(p, None));
                }
            }
        }
        best
    }

    /// What can shape the surface within `margin` of a ball around `center`; `None` where the ball has no surface.
    /// Primitives are not quite exact distances: the bounds allow for gradients of up to 2, which thin ellipsoids have.
    pub fn active(
        &self,
        center: Vec3,
        radius: f32,
        margin: f32,
        within: Option<&Active>,
    ) -> Option<Active> {
        let empty = 2.0 * radius;
        let reach = 1.5 * (radius + margin);
        let all: Active;
        let within = match within {
            Some(w) => w,
            None => {
                all = (0..self.layers.len())
                    .map(|i| (i as u16, (0..self.layers[i].prims.len() as u16).collect()))
                    .collect();
                &all
            }
        };
        let distances: Vec<f32> = within
            .iter()
            .map(|(i, prims)| self.layers[*i as usize].distance(center, Some(prims)))
            .collect();
        let nearest = distances.iter().copied().fold(f32::MAX, f32::min);
        if nearest.abs() > empty {
            return None;
        }
        let mut out = Active::new();
        for ((i, prims), &d) in within.iter().zip(&distances) {
            if d > reach + reach {
                continue;
            }
            let layer = &self.layers[*i as usize];
            let kept: Vec<u16> = prims
                .iter()
                .copied()
                .filter(|&k| {
                    let prim = &layer.prims[k as usize];
                    let low = prim.below(center).max(prim.distance(center) / 1.2) - reach;
                    match prim.op {
                        // It reaches the layer as it stands, plus the blend.
                        Op::Union => low <= d + layer.offset + reach + prim.blend,
                        Op::Carve => low <= layer.offset.abs() + prim.blend + reach,
                    }
                })
                .collect();
            if !kept.is_empty() {
                out.push((*i, kept));
            }
        }
        Some(out)
    }
}
