//! Poses as world rotations: two-bone inverse kinematics, feet that roll, and clips sampled from them.

use glam::{Mat3, Quat, Vec3};

use super::field::smoothstep;
use crate::character::{Clip, Interpolation, Property, Track};

/// Joints at rest: parents come first, all rest rotations are the identity.
pub struct Rig {
    pub parents: Vec<Option<usize>>,
    pub places: Vec<Vec3>,
}

/// One pose: where joint 0 is, and each joint's rotation in the model's frame.
#[derive(Clone)]
pub struct Pose {
    pub origin: Vec3,
    pub rotations: Vec<Quat>,
}

impl Rig {
    pub fn new(joints: &[(String, Option<usize>, Vec3)]) -> Self {
        Self {
            parents: joints.iter().map(|j| j.1).collect(),
            places: joints.iter().map(|j| j.2).collect(),
        }
    }

    /// The rest pose.
    pub fn rest(&self) -> Pose {
        Pose {
            origin: self.places[0],
            rotations: vec![Quat::IDENTITY; self.places.len()],
        }
    }

    /// Place of a joint's own origin.
    pub fn place(&self, pose: &Pose, joint: usize) -> Vec3 {
        match self.parents[joint] {
            None => pose.origin,
            Some(p) => {
                self.place(pose, p) + pose.rotations[p] * (self.places[joint] - self.places[p])
            }
        }
    }

    /// Bends `upper` and the joint after it so that the joint after that reaches `target`, the middle one towards `pole`.
    /// Returns how much of the chain's length the reach takes: above 1 the target is out of reach.
    pub fn reach(&self, pose: &mut Pose, upper: usize, target: Vec3, pole: Vec3) -> f32 {
        let (lower, end) = (upper + 1, upper + 2);
        let (rest_a, rest_b) = (
            self.places[lower] - self.places[upper],
            self.places[end] - self.places[lower],
        );
        let (a, b) = (rest_a.length(), rest_b.length());
        let start = self.place(pose, upper);
        let span = target - start;
        let distance = span.length();
        let reached = distance.clamp((a - b).abs() * 1.02 + 1e-4, (a + b) * 0.9995);
        let direction = span.normalize();
        let hinge = pole.cross(direction).normalize();
        let forward = direction.cross(hinge);
        let cos = (a * a + reached * reached - b * b) / (2.0 * a * reached);
        let along = cos.clamp(-1.0, 1.0);
        let knee = (direction * along + forward * (1.0 - along * along).sqrt()) * a;
        let rest_hinge = pole_at_rest(rest_a, rest_b, pole);
        pose.rotations[upper] = turn(rest_a, rest_hinge, knee, hinge);
        pose.rotations[lower] = turn(rest_b, rest_hinge, direction * reached - knee, hinge);
        distance / (a + b)
    }

    /// A looping clip of `key_count` poses a cycle; the last key repeats the first.
    pub fn clip(
        &self,
        name: &str,
        duration_s: f32,
        ground_speed: f32,
        key_count: usize,
        scale: f32,
        pose: impl Fn(f32) -> Pose,
    ) -> Clip {
        let times_s: Vec<f32> = (0..=key_count)
            .map(|k| duration_s * (k as f32 / key_count as f32))
            .collect();
        let poses: Vec<Pose> = (0..=key_count)
            .map(|k| pose((k % key_count) as f32 / key_count as f32))
            .collect();
        let track = |joint: usize, property, values| Track {
            node: joint as u32 + 1,
            property,
            interpolation: Interpolation::Linear,
            times_s: times_s.clone(),
            values,
        };
        let origin = poses
            .iter()
            .flat_map(|p| (p.origin * scale).to_array())
            .collect();
        let mut tracks = vec![track(0, Property::Translation, origin)];
        for joint in 0..self.places.len() {
            let mut values = Vec::with_capacity(4 * poses.len());
            for pose in &poses {
                let parent = self.parents[joint].map_or(Quat::IDENTITY, |p| pose.rotations[p]);
                let local = (parent.inverse() * pose.rotations[joint]).normalize();
                let local = if local.w < 0.0 { -local } else { local };
                values.extend(local.to_array());
            }
            tracks.push(track(joint, Property::Rotation, values));
        }
        Clip {
            name: name.into(),
            duration_s,
            ground_speed,
            tracks,
        }
    }
}

/// The hinge axis of a chain at rest that is to bend towards `pole`.
fn pole_at_rest(rest_a: Vec3, rest_b: Vec3, pole: Vec3) -> Vec3 {
    let pole = Vec3::new(0.0, 0.0, pole.z.signum());
    pole.cross((rest_a + rest_b).normalize()).normalize()
}

/// The rotation that takes `from` to the direction of `to` and the hinge at rest to `hinge`.
fn turn(from: Vec3, rest_hinge: Vec3, to: Vec3, hinge: Vec3) -> Quat {
    let basis = |y: Vec3, x: Vec3| {
        let y = y.normalize();
        let x = (x - y * x.dot(y)).normalize();
        Mat3::from_cols(x, y, x.cross(y))
    };
    Quat::from_mat3(&(basis(to, hinge) * basis(from, rest_hinge).transpose())).normalize()
}

/// The least drop of the body, to within a tenth of a millimetre, that keeps all legs within `most` of their length; `reach`
/// is the longest share at a drop and a phase.
pub fn lowest_drop(key_count: usize, most: f32, reach: impl Fn(f32, f32) -> f32) -> f32 {
    let longest = |drop: f32| {
        (0..key_count)
            .map(|k| reach(drop, k as f32 / key_count as f32))
            .fold(0.0, f32::max)
    };
    let (mut too_high, mut low) = (0.0, 0.25);
    for _ in 0..12 {
        let drop = 0.5 * (too_high + low);
        if longest(drop) > most {
            too_high = drop;
        } else {
            low = drop;
        }
    }
    low
}

/// A foot: where it turns about, relative to its ankle in the flat pose.
#[derive(Clone, Copy)]
pub struct Foot {
    /// The ankle's place with the foot flat, under a body at rest.
    pub ankle: Vec3,
    /// Rear edge of the sole.
    pub heel: Vec3,
    /// The toe joint.
    pub ball: Vec3,
    /// End of the sole, from the toe joint.
    pub tip: Vec3,
}

/// How a foot steps.
#[derive(Clone, Copy)]
pub struct Step {
    /// Metres per second, in the rig's scale.
    pub speed: f32,
    /// Seconds of a cycle.
    pub duration_s: f32,
    /// Share of the cycle on the ground.
    pub duty: f32,
    /// Toes up at the strike, radians.
    pub strike_pitch: f32,
    /// Toes down at the push-off, radians.
    pub push_pitch: f32,
    /// Toes down at most while in the air.
    pub air_pitch: f32,
    /// Height that the ankle gains in the air.
    pub lift: f32,
    /// Middle of the stance, in front of the rest place.
    pub lead: f32,
}

/// Where a foot is: its ankle, and its pitch (toes up is positive); the toes stay flat by `toe_pitch`.
#[derive(Clone, Copy)]
pub struct FootPose {
    pub ankle: Vec3,
    pub pitch: f32,
    pub toe_pitch: f32,
}

impl FootPose {
    pub fn rotation(&self) -> Quat {
        Quat::from_rotation_x(-self.pitch)
    }

    pub fn toe_rotation(&self) -> Quat {
        Quat::from_rotation_x(-self.toe_pitch)
    }
}

impl Step {
    /// The foot at `phase` (0: it strikes). While it is on the ground the part that touches moves at exactly `-speed`.
    pub fn foot(&self, foot: &Foot, phase: f32) -> FootPose {
        let phase = phase.rem_euclid(1.0);
        if phase <= self.duty {
            return self.stance(foot, phase);
        }
        let s = (phase - self.duty) / (1.0 - self.duty);
        let (from, to) = (self.stance(foot, self.duty), self.stance(foot, 0.0));
        // Speeds at both ends per unit of s, so that the foot neither jerks off the ground nor onto it.
        let h = 0.002;
        let air = (1.0 - self.duty) / h;
        let leave = (from.ankle - self.stance(foot, self.duty - h).ankle) * air;
        let arrive = (self.stance(foot, h).ankle - to.ankle) * air;
        let (s2, s3) = (s * s, s * s * s);
        let mut ankle = from.ankle * (2.0 * s3 - 3.0 * s2 + 1.0)
            + leave * (s3 - 2.0 * s2 + s)
            + to.ankle * (3.0 * s2 - 2.0 * s3)
            + arrive * (s3 - s2);
        // Highest a little before the middle, flat at both ends.
        let bump = (s * (1.0 - s)).powi(2) * 16.0 * (1.35 - 0.7 * s);
        ankle.y += self.lift * bump;
        let mid = -self.air_pitch;
        let pitch = if s < 0.3 {
            let t = smoothstep(-0.3, 0.3, s) * 2.0 - 1.0;
            from.pitch + (mid - from.pitch) * t
        } else {
            let t = smoothstep(0.3, 0.92, s);
            mid + (to.pitch - mid) * t
        };
        let curl = 1.0 - smoothstep(0.0, 0.35, s);
        let toe_pitch = pitch * (1.0 - curl) + from.toe_pitch * curl;
        let mut pose = FootPose {
            ankle,
            pitch,
            toe_pitch,
        };
        // Heel, ball and tip stay clear of the ground on the way.
        let ball = pose.rotation() * foot.ball;
        let tip = ball + pose.toe_rotation() * foot.tip;
        let heel = pose.rotation() * foot.heel;
        let sole = heel.y.min(ball.y - foot.ball.y - foot.ankle.y).min(tip.y);
        let clear = 0.022 * (1.0 - (1.0 - 2.0 * s).powi(4));
        pose.ankle.y = pose.ankle.y.max(clear - sole);
        pose
    }

    fn stance(&self, foot: &Foot, phase: f32) -> FootPose {
        let u = phase / self.duty;
        let back = self.speed * self.duration_s * (phase - 0.5 * self.duty);
        let ground = foot.ankle + Vec3::Z * (self.lead - back);
        let strike = self.strike_pitch * (1.0 - smoothstep(0.0, 0.18, u)).powi(2);
        // The heel leaves ever faster.
        let rise = ((u - 0.42) / 0.58).max(0.0);
        let push = self.push_pitch * rise * rise * (1.6 - 0.6 * rise);
        if strike >= push {
            let turn = Quat::from_rotation_x(-strike);
            FootPose {
                ankle: ground + foot.heel + turn * -foot.heel,
                pitch: strike,
                toe_pitch: strike,
            }
        } else {
            let turn = Quat::from_rotation_x(push);
            FootPose {
                ankle: ground + foot.ball + turn * -foot.ball,
                pitch: -push,
                toe_pitch: 0.0,
            }
        }
    }
}
