//! What a change of normal, texture coordinate or colour looks like, as a length.

use crate::mesh::Mesh;

use super::surface::{Surface, length};

/// Contrast of a normal that is off by a full turn's chord.
const NORMAL_CONTRAST: f32 = 0.25;
/// Contrast of showing the wrong texture, or texture where there is none.
const LAYER_CONTRAST: f32 = 0.6;
/// Contrast of two body parts that may be tinted differently.
const BODY_PART_CONTRAST: f32 = 0.1;
/// Contrast of neighbouring texels: how wrong a texture looks that is out of place.
const TEXTURE_CONTRAST: f32 = 0.4;
/// Of the normal's turn between two ends of an edge, what interpolation does not hide.
const SMOOTH_SHARE: f32 = 0.1;

/// Where the wedge of a dying point goes, and what that does to the looks of the faces that stay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct WedgeMove {
    pub from: u32,
    /// None: it has no face left, so it may go anywhere.
    pub to: Option<u32>,
    /// Contrast of the change, 0 to 1.
    pub contrast: f32,
    /// Area of the faces that show it.
    pub area: f32,
}

/// The moves of all wedges of `point` if it moves onto `target`; none where a submesh would be torn from its neighbour.
pub(super) fn wedge_moves(
    surface: &Surface,
    point: u32,
    target: u32,
    moves: &mut Vec<WedgeMove>,
) -> bool {
    moves.clear();
    let mesh = surface.mesh;
    for &from in &surface.wedges_of[point as usize] {
        let mut area = 0.0;
        let mut through: [Option<u32>; 2] = [None; 2];
        for &f in &surface.faces_of[point as usize] {
            let face = &surface.faces[f as usize];
            if face.wedge_at(point) != from {
                continue;
            }
            if !face.has(target) {
                area += surface.areas[f as usize];
                continue;
            }
            let w = face.wedge_at(target);
            if through[0].is_none() {
                through[0] = Some(w);
            } else if through[0] != Some(w) {
                through[1] = Some(w);
            }
        }
        if area == 0.0 {
            moves.push(WedgeMove {
                from,
                to: through[0],
                contrast: 0.0,
                area,
            });
            continue;
        }
        let along = through[0].is_some();
        let choices = surface.wedges_of[target as usize].iter().copied();
        let best = choices
            .filter(|&to| mesh.submesh[to as usize] == mesh.submesh[from as usize])
            .filter(|&to| !along || through.contains(&Some(to)))
            .map(|to| (contrast(surface, from, to, area, along), to))
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let Some((mut contrast_, to)) = best else {
            return false;
        };
        if let [Some(a), Some(b)] = through {
            // The seam runs on at the target only: the faces on one side of the edge get the other side's looks.
            contrast_ += 0.5 * contrast(surface, a, b, area, false);
        }
        moves.push(WedgeMove {
            from,
            to: Some(to),
            contrast: contrast_.min(1.0),
            area,
        });
    }
    true
}

/// How different faces of `area` look when their corner `from` becomes `to`, 0 to 1; `along`: the two are joined by an edge
/// of these faces, so that a smooth change from one to the other is already there.
pub(super) fn contrast(surface: &Surface, from: u32, to: u32, area: f32, along: bool) -> f32 {
    let m = surface.mesh;
    let (a, b) = (from as usize, to as usize);
    let color = (0..3)
        .map(|i| m.colors[a][i].abs_diff(m.colors[b][i]))
        .max()
        .unwrap_or(0);
    let mut sum = color as f32 / 255.0;
    let turn = m.normals[a].distance(m.normals[b]);
    sum += NORMAL_CONTRAST * turn * if along { SMOOTH_SHARE } else { 1.0 };
    if m.body_parts[a] != m.body_parts[b] {
        sum += BODY_PART_CONTRAST;
    }
    if m.layers[a] != m.layers[b] {
        sum += LAYER_CONTRAST;
    } else if m.layers[a] != Mesh::UNTEXTURED && !along {
        // A slip of the texture shows as far as it goes, and never more than the faces are large.
        let slip = m.uvs[a].distance(m.uvs[b]) * metres_per_uv(surface, from);
        sum += TEXTURE_CONTRAST * (slip / area.sqrt().max(f32::MIN_POSITIVE)).min(1.0);
    }
    sum.min(1.0)
}

/// Length on the surface for a unit of texture coordinate, around a wedge.
fn metres_per_uv(surface: &Surface, wedge: u32) -> f32 {
    let m = surface.mesh;
    let point = surface.point_of_wedge[wedge as usize];
    let (mut area, mut uv_area) = (0.0, 0.0);
    for &f in &surface.faces_of[point as usize] {
        let face = &surface.faces[f as usize];
        if face.wedge_at(point) != wedge {
            continue;
        }
        let [a, b, c] = face.wedges.map(|w| m.uvs[w as usize]);
        uv_area += 0.5 * (b - a).perp_dot(c - a).abs();
        area += 0.5 * length(surface.normal(face.points, 0));
    }
    // Faces that show one texel have no extent in the texture: any slip then is a jump to another texel.
    (area / uv_area.max(1e-8)).sqrt()
}
