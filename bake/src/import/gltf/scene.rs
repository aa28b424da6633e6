//! The node hierarchy: checked to be a forest, ordered parents first.

use glam::{DAffine3, DMat4, Mat4, Quat, Vec3};

use super::data::Source;
use super::json;
use crate::character::{Node, Transform};
use crate::error::ImportError;
use crate::import::files;

/// The nodes of the file, parents before children; depth first, children in the file's order.
pub struct Scene {
    /// All nodes of the file, in this order.
    pub nodes: Vec<Node>,
    /// Place in `nodes` of the file's node, `[document nodes]`.
    pub order_of: Vec<u32>,
    /// Places in `nodes` that belong to the default scene, in order.
    pub shown: Vec<u32>,
    /// `model_from_node` at rest where a scale of zero counts as one, so that it can be inverted.
    pub model_from_node: Vec<DAffine3>,
    /// The file's node at each place.
    pub source_of: Vec<usize>,
    /// How many nodes have a matrix with shear, which a translation, rotation and scale cannot hold.
    pub sheared_count: usize,
}

/// Reads all nodes. Errors: a child that does not exist or has two parents, a cycle, a transform that is not finite.
pub fn read(source: &Source) -> Result<Scene, ImportError> {
    let nodes = &source.document.nodes;
    let mut parent: Vec<Option<usize>> = vec![None; nodes.len()];
    for (i, node) in nodes.iter().enumerate() {
        for (k, &child) in node.children.iter().enumerate() {
            let place = || format!("nodes[{i}].children[{k}]");
            source.get(nodes, child, "node", place)?;
            if parent[child].replace(i).is_some() {
                return Err(source.bad(place(), format!("node {child} has two parents")));
            }
        }
    }
    let mut scene = Scene {
        nodes: Vec::with_capacity(nodes.len()),
        order_of: vec![u32::MAX; nodes.len()],
        shown: Vec::new(),
        model_from_node: Vec::with_capacity(nodes.len()),
        source_of: Vec::with_capacity(nodes.len()),
        sheared_count: 0,
    };
    let mut stack: Vec<usize> = (0..nodes.len())
        .rev()
        .filter(|&i| parent[i].is_none())
        .collect();
    while let Some(i) = stack.pop() {
        stack.extend(nodes[i].children.iter().rev());
        scene.push(source, i, parent[i])?;
    }
    if let Some(i) = scene.order_of.iter().position(|&o| o == u32::MAX) {
        return Err(source.bad(format!("nodes[{i}]"), "it is its own ancestor"));
    }
    scene.shown = shown(source, &scene)?;
    Ok(scene)
}

impl Scene {
    fn push(
        &mut self,
        source: &Source,
        i: usize,
        parent: Option<usize>,
    ) -> Result<(), ImportError> {
        let node = &source.document.nodes[i];
        let rest = transform(node)
            .filter(|t| t.translation.is_finite() && t.rotation.is_finite() && t.scale.is_finite())
            .ok_or_else(|| source.bad(format!("nodes[{i}]"), "its transform is not finite"))?;
        if let Some(matrix) = node.matrix {
            let lost = Mat4::from(rest.to_affine()) - Mat4::from_cols_array(&matrix);
            let size = rest.scale.abs().max_element();
            let linear = [lost.x_axis, lost.y_axis, lost.z_axis];
            self.sheared_count += usize::from(linear.iter().any(|c| c.length() > 1e-3 * size));
        }
        let parent = parent.map(|p| self.order_of[p]);
        let scale = Vec3::select(rest.scale.cmpeq(Vec3::ZERO), Vec3::ONE, rest.scale);
        let local = DAffine3::from_scale_rotation_translation(
            scale.as_dvec3(),
            rest.rotation.as_dquat().normalize(),
            rest.translation.as_dvec3(),
        );
        let model = parent.map_or(local, |p| self.model_from_node[p as usize] * local);
        if !DMat4::from(model).as_mat4().is_finite() {
            return Err(source.bad(format!("nodes[{i}]"), "its place in the scene overflows"));
        }
        self.order_of[i] = self.nodes.len() as u32;
        self.source_of.push(i);
        self.model_from_node.push(model);
        self.nodes.push(Node {
            name: node
                .name
                .as_deref()
                .map_or_else(|| format!("node{i}"), |name| files::shorten(name, 1024)),
            parent,
            rest,
        });
        Ok(())
    }
}

/// The transform of `node`; a matrix is taken apart (shear is lost). `None` where it has no rotation or is not finite.
fn transform(node: &json::Node) -> Option<Transform> {
    if let Some(matrix) = node.matrix {
        let matrix = Mat4::from_cols_array(&matrix);
        if !matrix.is_finite() {
            return None;
        }
        let translation = matrix.w_axis.truncate();
        let columns = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(|c| c.truncate());
        if columns.iter().any(|c| c.length_squared() < 1e-30) {
            let scale = Vec3::from_array(columns.map(Vec3::length));
            return Some(Transform {
                translation,
                rotation: Quat::IDENTITY,
                scale,
            });
        }
        let (scale, rotation, translation) = matrix.to_scale_rotation_translation();
        return Some(Transform {
            translation,
            rotation: rotation.normalize(),
            scale,
        });
    }
    let rotation = node.rotation.map_or(Quat::IDENTITY, Quat::from_array);
    Some(Transform {
        translation: node.translation.map_or(Vec3::ZERO, Vec3::from_array),
        rotation: if rotation.length_squared() > 1e-12 {
            rotation.normalize()
        } else {
            Quat::IDENTITY
        },
        scale: node.scale.map_or(Vec3::ONE, Vec3::from_array),
    })
}

/// The nodes of the default scene; all nodes where the file has no scenes.
fn shown(source: &Source, scene: &Scene) -> Result<Vec<u32>, ImportError> {
    let scenes = &source.document.scenes;
    if scenes.is_empty() {
        return Ok((0..scene.nodes.len() as u32).collect());
    }
    let index = source.document.scene.unwrap_or(0);
    let roots = &source.get(scenes, index, "scene", || "scene".into())?.nodes;
    let mut is_shown = vec![false; scene.nodes.len()];
    for (k, &root) in roots.iter().enumerate() {
        let place = || format!("scenes[{index}].nodes[{k}]");
        source.get(&source.document.nodes, root, "node", place)?;
        is_shown[scene.order_of[root] as usize] = true;
    }
    // Parents come first, so one pass carries the mark to all descendants.
    for i in 0..is_shown.len() {
        if let Some(parent) = scene.nodes[i].parent {
            is_shown[i] |= is_shown[parent as usize];
        }
    }
    Ok((0..scene.nodes.len() as u32)
        .filter(|&i| is_shown[i as usize])
        .collect())
}
