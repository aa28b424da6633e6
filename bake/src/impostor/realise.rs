//! Poses in a group's own frame: how the rest of the body may lie around it.
//!
//! Half of them are poses of the character's clips. The others turn the joints at the group's border on their own, each
//! within the limits that the clips show, or where these do not move it, within anatomical ones.
//!
//! Source: Izquierdo 2014, §4.2.2 and Table 4.1; limits from the clips and the low-discrepancy samples are ours.

use glam::{Affine3A, Quat, Vec3};

use super::groups::Groups;
use super::pose::affines;
use crate::baked::{Baked, PaletteEntry};
use crate::words::words;

/// Frames of all clips that limits are taken from.
const LIMIT_FRAMES: usize = 200;
/// A joint whose rotation spans less than this in all clips counts as not moved, radians.
const STILL: f32 = 0.06;
/// Limits from clips are widened by this share.
const WIDER: f32 = 0.15;

/// The poses of each group, `[group][pose][joint]`, as `group_from_bind`.
pub(super) fn realisations(
    baked: &Baked,
    groups: &Groups,
    count: u32,
) -> Vec<Vec<Vec<PaletteEntry>>> {
    let frames = sampled_frames(baked, LIMIT_FRAMES);
    let skeleton = Skeleton::of(baked);
    let from_clips = if frames.len() > 1 {
        count.div_ceil(2)
    } else {
        0
    };
    (0..groups.groups.len())
        .map(|g| {
            let driver = groups.groups[g].driver as usize;
            let borders = skeleton.borders(&groups.of_joint, g as u8, driver);
            let limits: Vec<Limits> = borders
                .iter()
                .map(|b| Limits::of(&skeleton, &frames, b, driver))
                .collect();
            (0..count)
                .map(|k| {
                    let pose = if k < from_clips {
                        let at = radical_inverse(k + 1, 2) * frames.len() as f32;
                        in_frame_of(&frames[(at as usize).min(frames.len() - 1)], driver)
                    } else {
                        skeleton.turned(&borders, &limits, k - from_clips + 1)
                    };
                    pose.iter().map(PaletteEntry::from_affine).collect()
                })
                .collect()
        })
        .collect()
}

/// Evenly chosen frames of all clips.
fn sampled_frames(baked: &Baked, most: usize) -> Vec<Vec<Affine3A>> {
    let total: usize = baked.clips.iter().map(|c| c.frame_count as usize).sum();
    let joint_count = baked.joints.len();
    (0..most.min(total))
        .map(|i| {
            let frame = i * total / most.min(total);
            affines(&baked.palette[frame * joint_count..][..joint_count])
        })
        .collect()
}

/// The pose as seen from a joint that stays in bind space.
fn in_frame_of(pose: &[Affine3A], joint: usize) -> Vec<Affine3A> {
    let inverse = pose[joint].inverse();
    if !inverse.is_finite() {
        return vec![Affine3A::IDENTITY; pose.len()];
    }
    pose.iter().map(|m| inverse * *m).collect()
}

/// The part of van der Corput's sequence that base `base` gives: fractions that fill 0 to 1 evenly.
fn radical_inverse(mut n: u32, base: u32) -> f32 {
    let (mut out, mut digit) = (0.0, 1.0 / base as f32);
    while n > 0 {
        out += (n % base) as f32 * digit;
        n /= base;
        digit /= base as f32;
    }
    out
}

/// A joint at the border of a group.
struct Border {
    /// It turns about this joint's place.
    joint: usize,
    /// It is the joint that the group hangs by: what lies above turns, not what lies below.
    is_above: bool,
}

struct Skeleton {
    names: Vec<String>,
    /// The nearest joint above.
    parents: Vec<Option<usize>>,
    /// Where the joints stand in bind space.
    places: Vec<Vec3>,
}

impl Skeleton {
    fn of(baked: &Baked) -> Self {
        let name = |j: usize| {
            let node = baked.nodes.get(baked.joints[j].node as usize);
            node.map_or_else(String::new, |n| n.name.clone())
        };
        Self {
            names: (0..baked.joints.len()).map(name).collect(),
            parents: super::pose::joint_parents(&baked.nodes, &baked.joints),
            places: super::pose::joint_places(&baked.joints),
        }
    }

    fn hangs_in(&self, joint: usize, above: usize) -> bool {
        std::iter::successors(Some(joint), |&j| self.parents[j]).any(|j| j == above)
    }

    fn borders(&self, of_joint: &[u8], group: u8, driver: usize) -> Vec<Border> {
        let mut borders = Vec::new();
        for joint in 0..self.parents.len() {
            let Some(parent) = self.parents[joint] else {
                continue;
            };
            let (own, above) = (of_joint[joint] == group, of_joint[parent] == group);
            if own && !above && self.hangs_in(driver, joint) {
                borders.push(Border {
                    joint,
                    is_above: true,
                });
            } else if !own && above {
                borders.push(Border {
                    joint,
                    is_above: false,
                });
            }
        }
        borders
    }

    /// Bind pose with every border turned within its limits; `sample` counts from 1.
    fn turned(&self, borders: &[Border], limits: &[Limits], sample: u32) -> Vec<Affine3A> {
        let mut pose = vec![Affine3A::IDENTITY; self.parents.len()];
        for (i, (border, limits)) in borders.iter().zip(limits).enumerate() {
            // Borders differ by their place in the sequence, so that they do not all turn together.
            let n = sample + 17 * i as u32;
            let share = Vec3::new(
                radical_inverse(n, 2),
                radical_inverse(n, 3),
                radical_inverse(n, 5),
            );
            let vector = limits.min + (limits.max - limits.min) * share;
            let rotation = Quat::from_scaled_axis(limits.axes * vector);
            let place = self.places[border.joint];
            let turn = Affine3A::from_translation(place)
                * Affine3A::from_quat(rotation)
                * Affine3A::from_translation(-place);
            for (joint, m) in pose.iter_mut().enumerate() {
                if self.hangs_in(joint, border.joint) != border.is_above {
                    *m = turn * *m;
                }
            }
        }
        pose
    }
}

/// Rotation vectors that a border may turn by, a box in `axes`.
struct Limits {
    axes: glam::Mat3,
    min: Vec3,
    max: Vec3,
}

impl Limits {
    fn of(skeleton: &Skeleton, frames: &[Vec<Affine3A>], border: &Border, driver: usize) -> Self {
        // What turns, seen from the group: the joint itself, or where it is the group's own, what it hangs in.
        let turning = if border.is_above {
            skeleton.parents[border.joint].unwrap_or(border.joint)
        } else {
            border.joint
        };
        let (mut min, mut max) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for frame in frames {
            let relative = frame[driver].inverse() * frame[turning];
            let (_, rotation, _) = relative.to_scale_rotation_translation();
            let short = if rotation.w < 0.0 {
                -rotation
            } else {
                rotation
            };
            let vector = short.to_scaled_axis();
            if vector.is_finite() {
                (min, max) = (min.min(vector), max.max(vector));
            }
        }
        if min.x <= max.x && (max - min).max_element() > STILL {
            let slack = (max - min) * WIDER;
            return Self {
                axes: glam::Mat3::IDENTITY,
                min: min - slack,
                max: max + slack,
            };
        }
        Self::anatomical(skeleton, border)
    }

    /// Half of the mobility of Table 4.1 (people seldom use all of it) about the bone's own axes: across it to the side,
    /// across it to the front, along it.
    fn anatomical(skeleton: &Skeleton, border: &Border) -> Self {
        let joint = border.joint;
        let end = (0..skeleton.parents.len()).find(|&j| skeleton.parents[j] == Some(joint));
        let bone = end.map_or(Vec3::ZERO, |e| skeleton.places[e] - skeleton.places[joint]);
        let bone = bone.try_normalize().unwrap_or(Vec3::NEG_Y);
        // A turn about this axis lifts the bone's end to the front.
        let lift = bone.cross(Vec3::Z).try_normalize().unwrap_or(Vec3::X);
        let side = lift.cross(bone);
        let words = words(&skeleton.names[joint]);
        let says = |list: &[&str]| words.iter().any(|w| list.contains(&w.as_str()));
        // Degrees: about `lift`, about `side`, about the bone.
        let (min, max) = if says(&["forearm", "elbow", "lowerarm"]) {
            ([0.0, 0.0, -77.0], [142.0, 0.0, 113.0])
        } else if says(&["upperarm", "arm", "shoulder"]) {
            ([-61.0, -48.0, -34.0], [188.0, 134.0, 97.0])
        } else if says(&["hand", "wrist"]) {
            ([-99.0, -47.0, 0.0], [90.0, 27.0, 0.0])
        } else if says(&["shin", "calf", "knee", "lowerleg"]) {
            ([-125.0, 0.0, -35.0], [0.0, 0.0, 43.0])
        } else if says(&["thigh", "upperleg", "upleg", "hip"]) {
            ([0.0, -31.0, -34.0], [113.0, 53.0, 39.0])
        } else if says(&["foot", "ankle"]) {
            ([-38.0, -23.0, 0.0], [35.0, 24.0, 0.0])
        } else {
            // Neck, spine and what no table knows.
            ([-30.0, -20.0, -40.0], [40.0, 20.0, 40.0])
        };
        // Seen from the group that hangs by the joint, the rest of the body turns the other way.
        let sign = if border.is_above { -1.0 } else { 1.0 };
        let half = 0.5f32.to_radians() * sign;
        let (a, b) = (Vec3::from(min) * half, Vec3::from(max) * half);
        Self {
            axes: glam::Mat3::from_cols(lift, side, bone),
            min: a.min(b),
            max: a.max(b),
        }
    }
}
