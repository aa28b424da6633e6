//! Where the wedges of a collapsing point go.

use super::looks::Looks;
use super::surface::Surface;

/// Squared contrast of a texture coordinate that jumps by a whole texture, beside what its colours say.
const JUMP_CONTRAST_SQUARED: f32 = 0.1;
/// Squared contrast from which a wedge stays a wedge of its own among few points: skin and hair, shirt and trousers.
const KEPT_CONTRAST_SQUARED: f32 = 0.02;

/// Where a wedge of a dying point goes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct WedgeMove {
    pub from: u32,
    /// None: it has no face left, so it may go anywhere.
    pub to: Option<u32>,
}

/// The moves of all wedges of `point` if it moves onto `target`; false where a submesh would be torn from its neighbour, or a
/// face would have corners in two textures.
///
/// A wedge goes to the target's wedge in the faces that have both; where there is none, to the one of its submesh and
/// texture that looks most like it.
pub(super) fn wedge_moves(
    surface: &Surface,
    looks: &Looks,
    point: u32,
    target: u32,
    moves: &mut Vec<WedgeMove>,
) -> bool {
    moves.clear();
    for &from in &surface.wedges_of[point as usize] {
        let mut stays = false;
        let mut through: [Option<u32>; 2] = [None; 2];
        for &f in &surface.faces_of[point as usize] {
            let face = &surface.faces[f as usize];
            if face.wedge_at(point) != from {
                continue;
            }
            if !face.has(target) {
                stays = true;
                continue;
            }
            let w = face.wedge_at(target);
            if through[0].is_none() {
                through[0] = Some(w);
            } else if through[0] != Some(w) {
                through[1] = Some(w);
            }
        }
        let to = match through {
            [to, None] if to.is_some() || !stays => to,
            [a, b] => {
                let choices = surface.wedges_of[target as usize].iter().copied();
                let best = choices
                    .filter(|&to| joins(surface, from, to))
                    .filter(|&to| a.is_none() || a == Some(to) || b == Some(to))
                    .map(|to| (difference(surface, looks, from, to), to))
                    .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                match best {
                    Some((_, to)) => Some(to),
                    None => return false,
                }
            }
        };
        moves.push(WedgeMove { from, to });
    }
    true
}

/// Lets wedges that look like none at `target` stay as they are, in place of what `moves` say: they have no `to` then.
pub(super) fn keep_looks(surface: &Surface, looks: &Looks, target: u32, moves: &mut [WedgeMove]) {
    let of = |w| looks.of(&surface.mesh, w);
    for m in moves.iter_mut().filter(|m| m.to.is_some()) {
        let choices = surface.wedges_of[target as usize].iter().copied();
        let best = choices
            .filter(|&to| joins(surface, m.from, to))
            .map(|to| (of(m.from).colors_apart(&of(to)), to))
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        m.to = best.filter(|b| b.0 <= KEPT_CONTRAST_SQUARED).map(|b| b.1);
    }
}

/// Whether corners of `from` may go to `to`: both are of one submesh and texture.
pub(super) fn joins(surface: &Surface, from: u32, to: u32) -> bool {
    let (m, from, to) = (&surface.mesh, from as usize, to as usize);
    m.submesh[from] == m.submesh[to] && m.layers[from] == m.layers[to]
}

/// How unlike two wedges are.
pub(super) fn difference(surface: &Surface, looks: &Looks, a: u32, b: u32) -> f32 {
    let uvs = &surface.mesh.uvs;
    let jump = uvs[a as usize].distance_squared(uvs[b as usize]).min(1.0);
    let of = |w| looks.of(&surface.mesh, w);
    of(a).contrast_squared(&of(b)) + JUMP_CONTRAST_SQUARED * jump
}

/// Where `moves` take a corner with `wedge`.
pub(super) fn moved(moves: &[WedgeMove], wedge: u32) -> u32 {
    moves
        .iter()
        .find(|m| m.from == wedge)
        .and_then(|m| m.to)
        .unwrap_or(wedge)
}
