//! Candidate contractions across gaps: points of different pieces that are near each other.

use std::collections::HashMap;

use super::surface::{Surface, length, sub};

/// Farthest gap that may be contracted, as a share of the character's size.
const GAP_MAX: f32 = 0.04;

/// Links every point to the nearest point of another piece, where there is one within reach in the first pose.
///
/// A link only proposes a contraction; what it costs in all poses decides.
pub(super) fn link_pieces(surface: &mut Surface) {
    let piece = pieces(surface);
    let count = piece.len();
    let at = |p: u32| surface.at(p).map(|x| x[0]);
    let cell = |x: [f32; 3]| x.map(|v| (v / GAP_MAX).floor() as i32);
    let mut cells: HashMap<[i32; 3], Vec<u32>> = HashMap::new();
    for p in 0..count as u32 {
        if !surface.faces_of[p as usize].is_empty() {
            cells.entry(cell(at(p))).or_default().push(p);
        }
    }
    let mut links: Vec<(u32, u32)> = Vec::new();
    for p in 0..count as u32 {
        if surface.faces_of[p as usize].is_empty() {
            continue;
        }
        let here = at(p);
        let [cx, cy, cz] = cell(here);
        let mut best = (GAP_MAX, u32::MAX);
        for dx in -1..=1 {
            for dy in -1..=1 {
                for dz in -1..=1 {
                    for &q in cells
                        .get(&[cx + dx, cy + dy, cz + dz])
                        .into_iter()
                        .flatten()
                    {
                        if piece[q as usize] != piece[p as usize] {
                            let gap = length(sub(at(q), here));
                            if gap < best.0 {
                                best = (gap, q);
                            }
                        }
                    }
                }
            }
        }
        if best.1 != u32::MAX {
            links.push((p, best.1));
        }
    }
    for (a, b) in links {
        surface.links[a as usize].push(b);
        surface.links[b as usize].push(a);
    }
    for list in &mut surface.links {
        list.sort_unstable();
        list.dedup();
    }
}

/// The connected piece of each point.
fn pieces(surface: &Surface) -> Vec<u32> {
    let mut piece = vec![u32::MAX; surface.faces_of.len()];
    let mut stack = Vec::new();
    for start in 0..piece.len() as u32 {
        if piece[start as usize] != u32::MAX {
            continue;
        }
        stack.push(start);
        while let Some(p) = stack.pop() {
            if piece[p as usize] != u32::MAX {
                continue;
            }
            piece[p as usize] = start;
            for &f in &surface.faces_of[p as usize] {
                stack.extend(surface.faces[f as usize].points);
            }
        }
    }
    piece
}
