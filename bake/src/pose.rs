//! Poses a character: a clip at a time becomes node transforms, then the skinning palette.

use glam::{Affine3A, Mat4, Quat, Vec3, Vec4};

use crate::character::{Character, Clip, Interpolation, Property, Track, Transform};

/// The skinning palette of `character` at `time_s` of `clip` (the rest pose where there is none):
/// `model_from_bind = model_from_joint * joint_from_bind`, `[joint_count]`.
///
/// Times before the first key and after the last read that key; wrapping a loop is the caller's part.
pub fn palette(character: &Character, clip: Option<&Clip>, time_s: f32) -> Vec<Affine3A> {
    let model_from_node = model_from_nodes(character, clip, time_s);
    character
        .joints
        .iter()
        .map(|j| {
            Affine3A::from_mat4(Mat4::from(model_from_node[j.node as usize]) * j.joint_from_bind)
        })
        .collect()
}

/// `model_from_node` of every node at `time_s` of `clip`, `[node_count]`.
pub fn model_from_nodes(character: &Character, clip: Option<&Clip>, time_s: f32) -> Vec<Affine3A> {
    let mut local: Vec<Transform> = character.nodes.iter().map(|n| n.rest).collect();
    for track in clip.map_or(&[][..], |c| &c.tracks) {
        let value = sample(track, time_s);
        let node = &mut local[track.node as usize];
        match track.property {
            Property::Translation => node.translation = value.truncate(),
            Property::Rotation => node.rotation = Quat::from_vec4(value),
            Property::Scale => node.scale = value.truncate(),
        }
    }
    let mut model: Vec<Affine3A> = Vec::with_capacity(local.len());
    for (node, local) in character.nodes.iter().zip(&local) {
        let parent_from_node = local.to_affine();
        model.push(match node.parent {
            Some(p) => model[p as usize] * parent_from_node,
            None => parent_from_node,
        });
    }
    model
}

/// One value of a track; rotations come back as unit quaternions, the others with `w` 0.
pub fn sample(track: &Track, time_s: f32) -> Vec4 {
    let times = &track.times_s;
    let after = times.partition_point(|&t| t <= time_s);
    let a = after.saturating_sub(1);
    let b = (a + 1).min(times.len() - 1);
    let span_s = times[b] - times[a];
    let u = if b == a || time_s <= times[a] || span_s <= 0.0 {
        0.0
    } else {
        ((time_s - times[a]) / span_s).min(1.0)
    };
    let width = track.property.width();
    let read = |i: usize| {
        let v = &track.values[i * width..][..width];
        Vec4::new(v[0], v[1], v[2], if width == 4 { v[3] } else { 0.0 })
    };
    let rotation = track.property == Property::Rotation;
    let value = match track.interpolation {
        Interpolation::Step => read(a),
        Interpolation::Linear if rotation => {
            let (from, to) = (unit_quaternion(read(a)), unit_quaternion(read(b)));
            return Vec4::from(from.slerp(to, u));
        }
        Interpolation::Linear => read(a).lerp(read(b), u),
        Interpolation::CubicSpline => {
            let (u2, u3) = (u * u, u * u * u);
            let (from, out_tangent) = (read(3 * a + 1), read(3 * a + 2));
            let (to, in_tangent) = (read(3 * b + 1), read(3 * b));
            from * (2.0 * u3 - 3.0 * u2 + 1.0)
                + out_tangent * (span_s * (u3 - 2.0 * u2 + u))
                + to * (3.0 * u2 - 2.0 * u3)
                + in_tangent * (span_s * (u3 - u2))
        }
    };
    if rotation {
        Vec4::from(unit_quaternion(value))
    } else {
        value
    }
}

/// The rotation that `v` stands for; the identity where its length says nothing.
fn unit_quaternion(v: Vec4) -> Quat {
    let length = v.length();
    if length > 1e-12 && length.is_finite() {
        Quat::from_vec4(v / length)
    } else {
        Quat::IDENTITY
    }
}

/// Linear blend skinning of one position.
pub fn skin(palette: &[Affine3A], joints: [u16; 4], weights: [f32; 4], position: Vec3) -> Vec3 {
    let mut sum = Vec3::ZERO;
    for (joint, weight) in joints.into_iter().zip(weights) {
        if weight > 0.0 {
            sum += weight * palette[joint as usize].transform_point3(position);
        }
    }
    sum
}
