//! Motion as a closed formula: where someone who walks at constant speed is after some distance.

use std::f32::consts::{PI, TAU};

use glam::Vec2;

/// Smallest radius of a curve that people walk, metres.
const RADIUS_MIN: f32 = 0.8;

/// Numbers that look random and follow from what they are seeded with (SplitMix64).
#[derive(Debug, Clone)]
pub(super) struct Random(u64);

impl Random {
    /// A sequence of its own for each pair.
    pub fn new(seed: u64, stream: u64) -> Self {
        let mut r = Self(seed ^ stream.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        r.next_u64();
        r
    }

    pub fn next_u64(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// From 0 (included) to 1 (not).
    pub fn unit(&mut self) -> f32 {
        (self.next_u64() >> 40) as f32 / (1u64 << 24) as f32
    }

    pub fn between(&mut self, min: f32, max: f32) -> f32 {
        min + (max - min) * self.unit()
    }
}

/// A rectangle on the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rect {
    pub min: Vec2,
    pub max: Vec2,
}

impl Rect {
    pub fn contains(&self, center: Vec2, half: Vec2) -> bool {
        (center - half).cmpge(self.min).all() && (center + half).cmple(self.max).all()
    }
}

/// The path that an agent walks, on the ground: (x, z).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Walk {
    /// Stays.
    Still { position: Vec2, heading: f32 },
    /// Straight on, for ever or wrapped in a rectangle.
    Line {
        start: Vec2,
        heading: f32,
        wrap: Option<Rect>,
    },
    /// Two straights of `2 * half_straight` joined by half circles; a circle where that is 0.
    Stadium {
        center: Vec2,
        /// Unit vector along the straights.
        axis: Vec2,
        half_straight: f32,
        radius: f32,
        /// 1 or -1: which way round.
        side: f32,
        /// Distance along the path at the start.
        start: f32,
    },
}

/// Unit vector that a heading faces.
pub(super) fn facing(heading: f32) -> Vec2 {
    Vec2::new(heading.sin(), heading.cos())
}

/// Heading that faces along a vector.
pub(super) fn heading_of(direction: Vec2) -> f32 {
    direction.x.atan2(direction.y)
}

impl Walk {
    /// Position and heading after `distance` metres.
    pub fn at(&self, distance: f32) -> (Vec2, f32) {
        match *self {
            Self::Still { position, heading } => (position, heading),
            Self::Line {
                start,
                heading,
                wrap,
            } => {
                let p = start + facing(heading) * distance;
                match wrap {
                    Some(r) => {
                        let size = r.max - r.min;
                        (r.min + (p - r.min).rem_euclid(size), heading)
                    }
                    None => (p, heading),
                }
            }
            Self::Stadium {
                center,
                axis,
                half_straight,
                radius,
                side,
                start,
            } => {
                let perimeter = 4.0 * half_straight + TAU * radius;
                let s = (start + distance).rem_euclid(perimeter);
                let (p, d) = stadium(half_straight, radius, s);
                let across = axis.perp() * side;
                let world = |v: Vec2| axis * v.x + across * v.y;
                (center + world(p), heading_of(world(d)))
            }
        }
    }

    /// A closed path through `position` in a box, by its centre and half extents, that is `inside`; where `position` leaves no
    /// room for one, a small circle towards `middle`.
    pub fn wander(
        position: Vec2,
        middle: Vec2,
        inside: impl Fn(Vec2, Vec2) -> bool,
        random: &mut Random,
    ) -> Self {
        for attempt in 0..12 {
            let shrink = 1.0 / (1 + attempt / 3) as f32;
            let radius = RADIUS_MIN + random.between(0.0, 3.2) * shrink;
            let half_straight = random.between(0.0, 7.0) * shrink;
            let axis = facing(random.between(0.0, TAU));
            let side = if random.unit() < 0.5 { -1.0 } else { 1.0 };
            let start = random.unit() * (4.0 * half_straight + TAU * radius);
            let (p, _) = stadium(half_straight, radius, start);
            let center = position - (axis * p.x + axis.perp() * side * p.y);
            if inside(center, axis.abs() * half_straight + Vec2::splat(radius)) {
                return Self::Stadium {
                    center,
                    axis,
                    half_straight,
                    radius,
                    side,
                    start,
                };
            }
        }
        let inward = (middle - position).normalize_or(Vec2::X);
        Self::around(
            position,
            position + inward * RADIUS_MIN,
            random.unit() < 0.5,
        )
    }

    /// A circle around `center` through `position`; around a point farther off where `center` is too near to walk around.
    pub fn around(position: Vec2, center: Vec2, clockwise: bool) -> Self {
        let out = (position - center).normalize_or(Vec2::X);
        let radius = position.distance(center).max(RADIUS_MIN);
        // A path starts at (0, -radius) of its own frame.
        Self::Stadium {
            center: position - out * radius,
            axis: if clockwise { out.perp() } else { -out.perp() },
            half_straight: 0.0,
            radius,
            side: if clockwise { 1.0 } else { -1.0 },
            start: 0.0,
        }
    }
}

/// Position and direction on a stadium in its own frame at `s` of its perimeter.
fn stadium(half_straight: f32, radius: f32, s: f32) -> (Vec2, Vec2) {
    let (straight, arc) = (2.0 * half_straight, PI * radius);
    let (half, sign) = if s < straight + arc {
        (s, 1.0)
    } else {
        (s - straight - arc, -1.0)
    };
    let (p, d) = if half < straight {
        (Vec2::new(half - half_straight, -radius), Vec2::X)
    } else {
        let (sin, cos) = ((half - straight) / radius).sin_cos();
        (
            Vec2::new(half_straight + radius * sin, -radius * cos),
            Vec2::new(cos, sin),
        )
    };
    // The second half is the first one turned by half a circle.
    (p * sign, d * sign)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bounds() -> Rect {
        Rect {
            min: Vec2::new(-20.0, -10.0),
            max: Vec2::new(20.0, 10.0),
        }
    }

    /// Speed is constant and the heading is the direction of movement, on every kind of path, including its seams.
    #[test]
    fn walkers_move_at_constant_speed_where_they_face() {
        for seed in 0..200 {
            let mut random = Random::new(seed, 1);
            let p = Vec2::new(random.between(-19.0, 19.0), random.between(-9.0, 9.0));
            for walk in [
                Walk::wander(p, Vec2::ZERO, |c, h| bounds().contains(c, h), &mut random),
                Walk::around(p, Vec2::ZERO, seed % 2 == 0),
                Walk::Line {
                    start: p,
                    heading: 1.0,
                    wrap: None,
                },
            ] {
                assert!((walk.at(0.0).0 - p).length() < 1e-4, "{walk:?}");
                for i in 0..400 {
                    let s = i as f32 * 0.17;
                    let step = 0.01;
                    let ((a, heading), (b, _)) = (walk.at(s), walk.at(s + step));
                    let moved = (b - a) / step;
                    assert!((moved.length() - 1.0).abs() < 0.02, "{walk:?} at {s}");
                    assert!((moved - facing(heading)).length() < 0.03, "{walk:?} at {s}");
                }
            }
        }
    }

    #[test]
    fn wanderers_stay_in_bounds() {
        let slack = 1.7;
        for seed in 0..500 {
            let mut random = Random::new(seed, 2);
            let p = Vec2::new(random.between(-20.0, 20.0), random.between(-10.0, 10.0));
            let walk = Walk::wander(p, Vec2::ZERO, |c, h| bounds().contains(c, h), &mut random);
            for i in 0..200 {
                let (q, _) = walk.at(i as f32 * 0.5);
                assert!(
                    q.abs().cmple(Vec2::new(20.0 + slack, 10.0 + slack)).all(),
                    "{q} {walk:?}"
                );
            }
        }
    }

    #[test]
    fn straight_walkers_come_back_inside() {
        let walk = Walk::Line {
            start: Vec2::ZERO,
            heading: 0.3,
            wrap: Some(bounds()),
        };
        for i in 0..1000 {
            let (q, _) = walk.at(i as f32);
            assert!(q.cmpge(bounds().min).all() && q.cmple(bounds().max).all());
        }
    }
}
