//! The triangles of one level of a sequence, by plain loops: what every faster extraction must agree with.

use crate::mesh::{CollapseSequence, Mesh};

/// The triangles that are left of `mesh` after the first `step_count` steps of `sequence`, in their order: every corner
/// moved to its living ancestor, triangles with two corners at one position left out.
pub fn triangles_at(mesh: &Mesh, sequence: &CollapseSequence, step_count: usize) -> Vec<[u32; 3]> {
    let mut parent: Vec<u32> = (0..mesh.vertex_count() as u32).collect();
    for step in &sequence.steps[..step_count.min(sequence.steps.len())] {
        parent[step.vertex as usize] = step.target;
    }
    let living = |mut v: u32| {
        while parent[v as usize] != v {
            v = parent[v as usize];
        }
        v
    };
    let same = |a: u32, b: u32| a == b || at_one_position(mesh, a, b);
    let replaced = sequence
        .replacement
        .as_ref()
        .filter(|r| step_count > r.step);
    replaced
        .map_or(&mesh.triangles, |r| &r.triangles)
        .iter()
        .map(|t| t.map(living))
        .filter(|&[a, b, c]| !same(a, b) && !same(b, c) && !same(c, a))
        .collect()
}

/// Whether two vertices stay at one position in every pose.
pub(super) fn at_one_position(mesh: &Mesh, a: u32, b: u32) -> bool {
    let (a, b) = (a as usize, b as usize);
    mesh.positions[a] == mesh.positions[b]
        && mesh.joints[a] == mesh.joints[b]
        && mesh.weights[a] == mesh.weights[b]
}
