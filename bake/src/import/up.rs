//! Characters whose file has another axis up than +Y.

use glam::{Mat4, Quat};

use crate::character::{Character, Node, Transform, UpAxis};

impl Character {
    /// Turns a character as it was imported so that +Y is up, with its skeleton, rest pose and clips.
    pub fn turn_up(&mut self, up: UpAxis) {
        let turn = match up {
            UpAxis::Y => return,
            UpAxis::Z => Quat::from_rotation_x(-std::f32::consts::FRAC_PI_2),
        };
        for part in &mut self.parts {
            for v in part.positions.iter_mut().chain(&mut part.normals) {
                *v = turn * *v;
            }
        }
        // All nodes hang in one that is turned, and bind space is turned back before the joints.
        let back = Mat4::from_quat(turn.inverse());
        for joint in &mut self.joints {
            joint.node += 1;
            joint.joint_from_bind *= back;
        }
        for track in self.clips.iter_mut().flat_map(|c| &mut c.tracks) {
            track.node += 1;
        }
        for node in &mut self.nodes {
            node.parent = Some(node.parent.map_or(0, |p| p + 1));
        }
        let root = Node {
            name: "up".into(),
            parent: None,
            rest: Transform {
                rotation: turn,
                ..Transform::IDENTITY
            },
        };
        self.nodes.insert(0, root);
    }
}
