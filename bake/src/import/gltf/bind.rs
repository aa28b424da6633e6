//! One bind space for all parts of a character.
//!
//! A file's parts stand in spaces of their own: each skin has a bind space that its inverse bind matrices define, often
//! scaled by a hundred or quantised to integers, and a rigid mesh has its node's. Here each of them gets a change of
//! space, so that all parts lie in model space near the rest pose, and skins of one armature share their joints.

use std::collections::{BTreeMap, HashMap};

use glam::{DAffine3, DMat3, DMat4, DVec3, Mat4};

use super::data::Source;
use super::primitives::Draft;
use super::scene::Scene;
use crate::character::Joint;
use crate::error::ImportError;

/// Two joints of one node are one where their matrices move no vertex apart by more than this share of the size of the
/// character.
const SAME_JOINT: f64 = 1e-5;
/// Greatest number of joints of a character.
const MAX_JOINTS: usize = 4096;
/// Joints of a skin that are tried as the one that defines its bind space, by falling weight.
const MAX_CANDIDATES: usize = 64;

/// The joints of the character, as they are found.
#[derive(Default)]
pub struct Joints {
    pub joints: Vec<Joint>,
    of_node: HashMap<u32, Vec<u32>>,
    exact: Vec<DAffine3>,
}

/// A joint of a skin: where it is, and which vertices it moves.
struct SkinJoint {
    node: u32,
    joint_from_skin: DAffine3,
    /// Sum of its weights.
    weight: f64,
    /// Weighted mean of its vertices, in the skin's bind space.
    center: DVec3,
}

/// Moves every draft into the common bind space and makes its influences index the joints that come back.
///
/// `animated` says of each node whether a clip moves it. A rigid part hangs in the nearest node above it that moves: one
/// joint serves everything that moves as one.
/// Errors: a skin is broken, or there are too many joints.
pub fn unify(
    source: &Source,
    scene: &Scene,
    animated: &[bool],
    drafts: &mut [Draft],
) -> Result<Joints, ImportError> {
    let mut joints = Joints::default();
    let mut of_skin: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (i, draft) in drafts.iter().enumerate() {
        if let Some(skin) = draft.skin {
            of_skin.entry(skin).or_default().push(i);
        }
    }
    for (&skin, members) in &of_skin {
        let skin_joints = read_skin(source, scene, skin, members.iter().map(|&i| &drafts[i]))?;
        let size = extent(scene, &skin_joints);
        let bind_from_skin = choose_space(scene, &joints, &skin_joints, size);
        let skin_from_bind = bind_from_skin.inverse();
        let mut index_of = Vec::with_capacity(skin_joints.len());
        for (k, joint) in skin_joints.iter().enumerate() {
            let joint_from_bind = joint.joint_from_skin * skin_from_bind;
            let center = bind_from_skin.transform_point3(joint.center);
            // Vertices without weights follow the first joint.
            index_of.push(if joint.weight > 0.0 || k == 0 {
                joints.find(scene, joint.node, joint_from_bind, center, size)
            } else {
                0
            });
        }
        check_count(source, &joints)?;
        for &i in members {
            let surface = &mut drafts[i].surface;
            surface.transform(&bind_from_skin);
            for (joint, _) in &mut surface.influences.of_vertices {
                *joint = index_of[*joint as usize];
            }
        }
    }
    let mut still = None;
    for draft in drafts.iter_mut().filter(|d| d.skin.is_none()) {
        let carrier = carrier(scene, animated, draft.node)
            .unwrap_or_else(|| *still.get_or_insert(draft.node));
        let model_from_node = scene.model_from_node[draft.node as usize];
        let model_from_carrier = scene.model_from_node[carrier as usize];
        let (bind_from_node, carrier_from_bind) = if is_invertible(&model_from_node) {
            (model_from_node, model_from_carrier.inverse())
        } else {
            (DAffine3::IDENTITY, DAffine3::IDENTITY)
        };
        let rigid = is_invertible(&model_from_carrier) && is_invertible(&model_from_node);
        let node = if rigid { carrier } else { draft.node };
        draft.surface.transform(&bind_from_node);
        let (low, high) = draft.surface.bounds();
        let (center, size) = ((low + high) / 2.0, (high - low).length());
        let joint = joints.find(scene, node, carrier_from_bind, center, size);
        draft.surface.influences.width = 1;
        draft.surface.influences.of_vertices = vec![(joint, 1.0); draft.surface.positions.len()];
        check_count(source, &joints)?;
    }
    Ok(joints)
}

/// `node` or the nearest one above it that a clip moves; none where all of them stand still.
fn carrier(scene: &Scene, animated: &[bool], node: u32) -> Option<u32> {
    let mut at = Some(node);
    while let Some(node) = at {
        if animated[node as usize] {
            return Some(node);
        }
        at = scene.nodes[node as usize].parent;
    }
    None
}

fn check_count(source: &Source, joints: &Joints) -> Result<(), ImportError> {
    if joints.joints.len() > MAX_JOINTS {
        let reason = format!("there are more than {MAX_JOINTS} joints");
        return Err(source.bad("skins", reason));
    }
    Ok(())
}

impl Joints {
    /// The joint of `node` with this matrix: a known one where it moves the points around `center` alike.
    fn find(
        &mut self,
        scene: &Scene,
        node: u32,
        joint_from_bind: DAffine3,
        center: DVec3,
        size: f64,
    ) -> u32 {
        let known = self.of_node.entry(node).or_default();
        let model = scene.model_from_node[node as usize];
        let same = |&&j: &&u32| {
            let other = model * self.exact[j as usize];
            let own = model * joint_from_bind;
            distance(&own, &other, center, size) <= SAME_JOINT * size
        };
        if let Some(&j) = known.iter().find(same) {
            return j;
        }
        let j = self.joints.len() as u32;
        known.push(j);
        self.joints.push(Joint {
            node,
            joint_from_bind: DMat4::from(joint_from_bind).as_mat4(),
        });
        self.exact.push(joint_from_bind);
        j
    }
}

/// How far apart two maps put points at and around `center`, as far as `size`.
fn distance(a: &DAffine3, b: &DAffine3, center: DVec3, size: f64) -> f64 {
    let at_center = a.transform_point3(center) - b.transform_point3(center);
    let linear: DMat3 = a.matrix3 - b.matrix3;
    let around = [linear.x_axis, linear.y_axis, linear.z_axis].map(DVec3::length);
    at_center.length() + around.iter().sum::<f64>() * size
}

/// The joints of skin `index`, with the vertices of `drafts` that use them.
fn read_skin<'a>(
    source: &Source,
    scene: &Scene,
    index: usize,
    drafts: impl Iterator<Item = &'a Draft>,
) -> Result<Vec<SkinJoint>, ImportError> {
    let skin = &source.document.skins[index];
    let place = format!("skins[{index}]");
    let matrices = match skin.inverse_bind_matrices {
        None => None,
        Some(accessor) => {
            let place = format!("{place}.inverseBindMatrices");
            let matrices = source.floats(accessor, &["MAT4"], &place)?;
            if matrices.count() < skin.joints.len() {
                let reason = format!(
                    "it has {} matrices for {} joints",
                    matrices.count(),
                    skin.joints.len()
                );
                return Err(source.bad(place, reason));
            }
            Some(matrices.values)
        }
    };
    if skin.joints.is_empty() {
        return Err(source.bad(place, "it has no joints"));
    }
    let mut joints = Vec::with_capacity(skin.joints.len());
    for (k, &node) in skin.joints.iter().enumerate() {
        let nodes = &source.document.nodes;
        source.get(nodes, node, "node", || format!("{place}.joints[{k}]"))?;
        let joint_from_skin = matrices.as_ref().map_or(DAffine3::IDENTITY, |m| {
            let matrix = Mat4::from_cols_slice(&m[16 * k..][..16]);
            DAffine3::from_mat4(matrix.as_dmat4())
        });
        joints.push(SkinJoint {
            node: scene.order_of[node],
            joint_from_skin,
            weight: 0.0,
            center: DVec3::ZERO,
        });
    }
    for draft in drafts {
        for (v, position) in draft.surface.positions.iter().enumerate() {
            for &(j, weight) in draft.surface.influences.of(v) {
                let joint = &mut joints[j as usize];
                joint.weight += f64::from(weight);
                joint.center += f64::from(weight) * position.as_dvec3();
            }
        }
    }
    for joint in joints.iter_mut().filter(|j| j.weight > 0.0) {
        joint.center /= joint.weight;
    }
    Ok(joints)
}

/// Size in model space of what the joints' vertices span at rest: the diagonal of their centres' box.
fn extent(scene: &Scene, joints: &[SkinJoint]) -> f64 {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for joint in joints.iter().filter(|j| j.weight > 0.0) {
        let p = rest(scene, joint).transform_point3(joint.center);
        (low, high) = (low.min(p), high.max(p));
    }
    (high - low).max(DVec3::ZERO).length()
}

/// Where the joint puts the skin's bind space at rest.
fn rest(scene: &Scene, joint: &SkinJoint) -> DAffine3 {
    scene.model_from_node[joint.node as usize] * joint.joint_from_skin
}

/// The change from the skin's bind space to the common one.
///
/// Where another skin already moves some of the same nodes, the change that makes those joints agree, if there is one.
/// Else the rest pose of one joint: the one that leaves all vertices nearest to where they are at rest.
fn choose_space(scene: &Scene, known: &Joints, joints: &[SkinJoint], size: f64) -> DAffine3 {
    let mut heaviest: Vec<&SkinJoint> = joints.iter().filter(|j| j.weight > 0.0).collect();
    heaviest.sort_by(|a, b| b.weight.total_cmp(&a.weight));
    let shared = heaviest.iter().filter_map(|joint| {
        let others = known.of_node.get(&joint.node)?;
        Some(
            others
                .iter()
                .map(|&other| (*joint, known.exact[other as usize])),
        )
    });
    // Change of space -> how many of the joints it makes agree with known ones.
    let agreeing = |change: &DAffine3| {
        let inverse = change.inverse();
        let agrees = |joint: &&&SkinJoint| {
            let others = known.of_node.get(&joint.node).into_iter().flatten();
            let model = scene.model_from_node[joint.node as usize];
            let own = model * joint.joint_from_skin * inverse;
            let center = change.transform_point3(joint.center);
            others.into_iter().any(|&other| {
                let other = model * known.exact[other as usize];
                distance(&own, &other, center, size) <= SAME_JOINT * size
            })
        };
        heaviest.iter().filter(agrees).count()
    };
    let best_shared = shared
        .flatten()
        .take(MAX_CANDIDATES)
        .filter(|(_, other)| is_invertible(other))
        .map(|(joint, other)| other.inverse() * joint.joint_from_skin)
        .filter(is_invertible)
        .map(|change| (agreeing(&change), change))
        .fold(None, |best: Option<(usize, DAffine3)>, next| match best {
            Some(best) if best.0 >= next.0 => Some(best),
            _ => Some(next),
        });
    if let Some((count, change)) = best_shared
        && count > 1
    {
        return change;
    }
    let cost = |change: &DAffine3| -> f64 {
        let moved = heaviest.iter().map(|joint| {
            let at_rest = rest(scene, joint).transform_point3(joint.center);
            joint.weight * (change.transform_point3(joint.center) - at_rest).length()
        });
        moved.sum()
    };
    heaviest
        .iter()
        .take(MAX_CANDIDATES)
        .map(|joint| rest(scene, joint))
        .filter(is_invertible)
        .map(|change| (cost(&change), change))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map_or(DAffine3::IDENTITY, |best| best.1)
}

/// Whether `map` has an inverse that means something: no axis shrinks to nothing beside the others.
fn is_invertible(map: &DAffine3) -> bool {
    let m = &map.matrix3;
    let volume = m.x_axis.length() * m.y_axis.length() * m.z_axis.length();
    map.is_finite() && volume > 1e-30 && (m.determinant() / volume).abs() > 1e-6
}
