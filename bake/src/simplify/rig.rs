//! How a character's joints make limbs: groups of joints in a tree, by names and by how much surface they move.

use glam::Vec3;

use crate::character::Character;
use crate::impostor::groups::{Extremity, grouped_by_name, hanging_in};
use crate::impostor::pose::{joint_parents, joint_places};
use crate::mesh::Mesh;

/// Share of the surface below which a group goes with the one that it hangs in.
const LEAST_SHARE: f64 = 0.012;

/// Groups of joints in a tree.
#[derive(Debug, Clone, Default)]
pub struct Rig {
    /// Group of each palette joint.
    pub of_joint: Vec<usize>,
    /// The groups, those above first.
    pub groups: Vec<RigGroup>,
}

/// Joints that move a part of a limb, or of the trunk.
#[derive(Debug, Clone)]
pub struct RigGroup {
    /// What it hangs in.
    pub parent: Option<usize>,
    /// Where it is joined to that, bind space.
    pub origin: Vec3,
    /// It is a head.
    pub is_head: bool,
}

impl Rig {
    /// The groups of `character`, whose surface is `mesh`.
    pub fn of(character: &Character, mesh: &Mesh) -> Self {
        let joints = &character.joints;
        let mut shares = vec![0.0f64; joints.len()];
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
            let area = f64::from((b - a).cross(c - a).length() / 6.0);
            for v in t.map(|v| v as usize) {
                for (joint, weight) in mesh.joints[v].into_iter().zip(mesh.weights[v]) {
                    if let Some(share) = shares.get_mut(joint as usize) {
                        *share += area * f64::from(weight);
                    }
                }
            }
        }
        let total = shares.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        shares.iter_mut().for_each(|s| *s /= total);
        let parents = joint_parents(&character.nodes, joints);
        let places = joint_places(joints);
        let mut of = grouped_by_name(&character.nodes, joints, shares.clone());
        let ancestors = |j: usize| std::iter::successors(Some(j), |&j| parents[j]);
        let mut order: Vec<usize> = (0..joints.len()).collect();
        order.sort_by_key(|&j| ancestors(j).take(joints.len()).count());
        // Small groups go with those above, the lowest first.
        for &group in order.iter().rev() {
            let members: Vec<usize> = (0..of.len()).filter(|&j| of[j] == group).collect();
            let share: f64 = members.iter().map(|&j| shares[j]).sum();
            let above = members
                .iter()
                .find_map(|&j| ancestors(j).map(|a| of[a]).find(|&a| a != group));
            if share < LEAST_SHARE
                && let Some(above) = above
            {
                members.iter().for_each(|&j| of[j] = above);
            }
        }
        let heads = hanging_in(Extremity::Head, &character.nodes, joints);
        let mut numbers = vec![None; joints.len()];
        let mut groups = Vec::new();
        for &joint in &order {
            let group = of[joint];
            if numbers[group].is_some() {
                continue;
            }
            numbers[group] = Some(groups.len());
            groups.push(RigGroup {
                parent: ancestors(joint)
                    .map(|a| of[a])
                    .find(|&a| a != group)
                    .and_then(|a| numbers[a]),
                origin: places[joint],
                is_head: heads[joint],
            });
        }
        Self {
            of_joint: of.iter().map(|&g| numbers[g].unwrap_or(0)).collect(),
            groups,
        }
    }
}
