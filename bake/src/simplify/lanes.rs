//! Arithmetic on several poses at once. glam's four-component vectors are vector registers; here each component is a pose.

use std::ops::{Add, Sub};

use glam::Vec4;

/// Poses that are computed together.
pub(super) const LANES: usize = 4;

/// One number in each of [`LANES`] poses.
pub(super) type Lanes = Vec4;

/// Group `group` of `[pose_count]` numbers.
#[inline(always)]
pub(super) fn read(values: &[f32], group: usize) -> Lanes {
    Lanes::from_slice(&values[group * LANES..])
}

/// A vector in each pose.
#[derive(Debug, Clone, Copy)]
pub(super) struct Vec3Lanes {
    pub x: Lanes,
    pub y: Lanes,
    pub z: Lanes,
}

impl Vec3Lanes {
    /// Group `group` of `[3][pose_count]` numbers.
    #[inline(always)]
    pub fn read(values: &[f32], pose_count: usize, group: usize) -> Self {
        Self {
            x: read(values, group),
            y: read(&values[pose_count..], group),
            z: read(&values[2 * pose_count..], group),
        }
    }

    #[inline(always)]
    pub fn dot(self, o: Self) -> Lanes {
        self.x * o.x + self.y * o.y + self.z * o.z
    }

    #[inline(always)]
    pub fn cross(self, o: Self) -> Self {
        Self {
            x: self.y * o.z - self.z * o.y,
            y: self.z * o.x - self.x * o.z,
            z: self.x * o.y - self.y * o.x,
        }
    }

    #[inline(always)]
    pub fn scale(self, s: Lanes) -> Self {
        Self {
            x: self.x * s,
            y: self.y * s,
            z: self.z * s,
        }
    }
}

impl Add for Vec3Lanes {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self {
            x: self.x + o.x,
            y: self.y + o.y,
            z: self.z + o.z,
        }
    }
}

impl Sub for Vec3Lanes {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Self {
            x: self.x - o.x,
            y: self.y - o.y,
            z: self.z - o.z,
        }
    }
}

/// A triangle in each pose, prepared for distances to many points: a frame in its plane, and its corners in that frame at
/// (0, 0), (`base`, 0) and `apex`.
pub(super) struct TriangleLanes {
    origin: Vec3Lanes,
    along: Vec3Lanes,
    up: Vec3Lanes,
    normal: Vec3Lanes,
    base: Lanes,
    apex: [Lanes; 2],
    /// From the second corner to the third.
    side: [Lanes; 2],
    /// One over the squared lengths of `apex` and `side`.
    inverse: [Lanes; 2],
}

impl TriangleLanes {
    #[inline(always)]
    pub fn new(a: Vec3Lanes, b: Vec3Lanes, c: Vec3Lanes) -> Self {
        let (ab, ac) = (b - a, c - a);
        let base = sqrt(ab.dot(ab));
        let along = ab.scale(inverse(base));
        let turn = along.cross(ac);
        let apex_up = sqrt(turn.dot(turn));
        let mut t = Self {
            origin: a,
            along,
            normal: turn.scale(inverse(apex_up)),
            up: along,
            base,
            apex: [along.dot(ac), apex_up],
            side: [along.dot(ac) - base, apex_up],
            inverse: [base; 2],
        };
        for i in 0..LANES {
            // Written so that a height that is not a number counts as flat, too.
            let thick = t.apex[1][i] > 1e-6 * t.base[i] && t.base[i] > 1e-12;
            if !thick {
                t.flatten(ac, i);
            }
        }
        t.up = t.normal.cross(t.along);
        let squared = |v: [Lanes; 2]| v[0] * v[0] + v[1] * v[1];
        t.inverse = [inverse(squared(t.apex)), inverse(squared(t.side))];
        t
    }

    /// A frame for pose `i`, in which the triangle has no area: any that contains its longest edge.
    #[cold]
    fn flatten(&mut self, ac: Vec3Lanes, i: usize) {
        let to_apex = [ac.x[i], ac.y[i], ac.z[i]];
        let length = to_apex.iter().map(|x| x * x).sum::<f32>().sqrt();
        let mut along = [self.along.x[i], self.along.y[i], self.along.z[i]];
        if self.base[i] <= 1e-12 {
            along = if length > 1e-12 {
                to_apex.map(|x| x / length)
            } else {
                [1.0, 0.0, 0.0]
            };
        }
        // Across the smallest component: never parallel.
        let smallest = (0..3)
            .min_by(|&a, &b| along[a].abs().total_cmp(&along[b].abs()))
            .unwrap_or(0);
        let mut axis = [0.0; 3];
        axis[smallest] = 1.0;
        let across = [
            along[1] * axis[2] - along[2] * axis[1],
            along[2] * axis[0] - along[0] * axis[2],
            along[0] * axis[1] - along[1] * axis[0],
        ];
        let n_length = across.iter().map(|x| x * x).sum::<f32>().sqrt();
        let apex: f32 = (0..3).map(|k| along[k] * to_apex[k]).sum();
        for (k, (a, n)) in [
            (&mut self.along.x, &mut self.normal.x),
            (&mut self.along.y, &mut self.normal.y),
            (&mut self.along.z, &mut self.normal.z),
        ]
        .into_iter()
        .enumerate()
        {
            a[i] = along[k];
            n[i] = across[k] / n_length;
        }
        self.apex[0][i] = apex;
        self.apex[1][i] = 0.0;
        self.side[0][i] = apex - self.base[i];
        self.side[1][i] = 0.0;
    }

    /// Squared distance of `p` in every pose.
    #[inline(always)]
    pub fn distance_squared(&self, p: Vec3Lanes) -> Lanes {
        let d = p - self.origin;
        let (x, y, h) = (d.dot(self.along), d.dot(self.up), d.dot(self.normal));
        let (zero, one) = (Lanes::ZERO, Lanes::ONE);
        let past = x - x.max(zero).min(self.base);
        let to_base = past * past + y * y;
        let to_apex = {
            let t = (x * self.apex[0] + y * self.apex[1]) * self.inverse[0];
            let t = t.max(zero).min(one);
            let (u, v) = (x - self.apex[0] * t, y - self.apex[1] * t);
            u * u + v * v
        };
        let to_side = {
            let x = x - self.base;
            let t = (x * self.side[0] + y * self.side[1]) * self.inverse[1];
            let t = t.max(zero).min(one);
            let (u, v) = (x - self.side[0] * t, y - self.side[1] * t);
            u * u + v * v
        };
        let inside = y
            .min(x * self.apex[1] - y * self.apex[0])
            .min((self.base - x) * self.side[1] + y * self.side[0]);
        let border = to_base.min(to_apex).min(to_side);
        Lanes::select(inside.cmpgt(zero), zero, border) + h * h
    }
}

/// One over a length; of nothing a number that what it multiplies, nothing too, survives.
#[inline(always)]
fn inverse(x: Lanes) -> Lanes {
    x.max(Lanes::splat(1e-30)).recip()
}

#[inline(always)]
fn sqrt(x: Lanes) -> Lanes {
    Lanes::new(x.x.sqrt(), x.y.sqrt(), x.z.sqrt(), x.w.sqrt())
}
