//! Gaps where joints bend: what a silhouette of quads lacks of the mesh's, and is more than a frayed edge.

use std::collections::VecDeque;

use glam::Vec2;
use throng_bake::baked::{Baked, PaletteEntry};
use throng_bake::impostor::groups::Groups;

use crate::compose::{Camera, Pixels};

/// Pixels that a gap is away from its joint at most: in a picture 32 pixels high a limb is 2 to 4 wide.
const REACH_PX: f32 = 4.0;

/// Pixels side by side that the mesh covers and the impostor does not, wider than a pixel, next to a joint where groups meet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Gap {
    /// All of them.
    pub pixels: u32,
    /// One of them.
    pub at: [i32; 2],
    pub kind: GapKind,
}

/// What a gap does to the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GapKind {
    /// One looks through the body: none of its pixels is at the body's edge.
    Hole,
    /// It cuts something off: without it the body is in more pieces than it is.
    Cut,
    /// It nibbles at the edge: an error of the silhouette, but no hole.
    Notch,
}

/// Where joints stand in the picture at which one group hangs in another.
pub fn borders(
    baked: &Baked,
    groups: &Groups,
    palette: &[PaletteEntry],
    camera: &Camera,
) -> Vec<Vec2> {
    let joint_of = |node: u32| baked.joints.iter().position(|j| j.node == node);
    let above = |joint: usize| {
        let parent = |&node: &u32| baked.nodes[node as usize].parent;
        let own = baked.joints[joint].node;
        std::iter::successors(parent(&own), parent).find_map(joint_of)
    };
    let is_border = |&j: &usize| above(j).is_some_and(|a| groups.of_joint[a] != groups.of_joint[j]);
    let place = |j: usize| {
        let bind = baked.joints[j].joint_from_bind.inverse().w_axis.truncate();
        camera.project(palette[j].to_affine().transform_point3(bind))
    };
    (0..baked.joints.len())
        .filter(is_border)
        .map(place)
        .collect()
}

/// A picture of pixels that are there or not; nothing is outside.
#[derive(Clone)]
struct Bits {
    size: i32,
    there: Vec<bool>,
}

impl Bits {
    fn new(size: u32, there: impl Iterator<Item = bool>) -> Self {
        Self {
            size: size as i32,
            there: there.collect(),
        }
    }

    fn get(&self, [x, y]: [i32; 2]) -> bool {
        let inside = (0..self.size).contains(&x) && (0..self.size).contains(&y);
        inside && self.there[(y * self.size + x) as usize]
    }

    /// What hangs together, corners included, by its pixels.
    fn pieces(&self) -> Vec<Vec<[i32; 2]>> {
        let mut left = self.clone();
        let mut pieces = Vec::new();
        for first in 0..self.there.len() as i32 {
            let first = [first % self.size, first / self.size];
            let mut piece = Vec::new();
            let mut next = VecDeque::from([first]);
            while let Some(at) = next.pop_front() {
                if left.get(at) {
                    left.there[(at[1] * self.size + at[0]) as usize] = false;
                    piece.push(at);
                    next.extend(around(at));
                }
            }
            if !piece.is_empty() {
                pieces.push(piece);
            }
        }
        pieces
    }
}

fn around([x, y]: [i32; 2]) -> impl Iterator<Item = [i32; 2]> {
    (-1..=1).flat_map(move |dy| (-1..=1).map(move |dx| [x + dx, y + dy]))
}

/// The gaps of an impostor's picture next to the places.
pub fn gaps(mesh: &Pixels, impostor: &Pixels, size: u32, places: &[Vec2]) -> Vec<Gap> {
    let body = Bits::new(size, mesh.iter().map(|p| p[3] > 0));
    let lacking = mesh
        .iter()
        .zip(impostor)
        .map(|(m, i)| m[3] > 0 && i[3] == 0);
    let lacking = Bits::new(size, lacking);
    let in_square = |[x, y]: [i32; 2]| {
        let squares = [[x - 1, y - 1], [x, y - 1], [x - 1, y], [x, y]];
        squares.into_iter().any(|[x, y]| {
            [[x, y], [x + 1, y], [x, y + 1], [x + 1, y + 1]]
                .iter()
                .all(|&at| lacking.get(at))
        })
    };
    let all = (0..(size * size) as i32).map(|i| [i % size as i32, i / size as i32]);
    let wide = Bits::new(size, all.map(in_square));
    let near = |&[x, y]: &[i32; 2]| {
        let middle = Vec2::new(x as f32, y as f32) + 0.5;
        places.iter().any(|p| p.distance(middle) <= REACH_PX)
    };
    let wide_pieces = wide.pieces();
    let near_pieces = wide_pieces.iter().filter(|piece| piece.iter().any(near));
    let kind_of = |piece: &[[i32; 2]]| {
        if piece.iter().all(|&at| around(at).all(|a| body.get(a))) {
            return GapKind::Hole;
        }
        // Frayed edges beside it belong to what cuts.
        let mut rest = body.clone();
        let whole = lacking.pieces().into_iter().find(|p| p.contains(&piece[0]));
        for at in whole.iter().flatten() {
            rest.there[(at[1] * rest.size + at[0]) as usize] = false;
        }
        match rest.pieces().len() > body.pieces().len() {
            true => GapKind::Cut,
            false => GapKind::Notch,
        }
    };
    near_pieces
        .map(|piece| Gap {
            pixels: piece.len() as u32,
            at: piece[0],
            kind: kind_of(piece),
        })
        .collect()
}

/// Two pictures from one drawing: `#` is covered by both, `-` by the mesh alone, `.` by none.
fn drawn(rows: &[&str]) -> (Pixels, Pixels, u32) {
    let of = |shown: &str| -> Pixels {
        let letters = rows.iter().flat_map(|r| r.chars());
        letters
            .map(|c| [0, 0, 0, 255 * u8::from(shown.contains(c))])
            .collect()
    };
    (of("#-"), of("#"), rows.len() as u32)
}

#[test]
fn gaps_are_told_from_frayed_edges() {
    let kinds = |rows: &[&str]| -> Vec<GapKind> {
        let (mesh, impostor, size) = drawn(rows);
        let middle = Vec2::splat(size as f32 * 0.5);
        let found = gaps(&mesh, &impostor, size, &[middle]);
        // None is anybody's where no joint is near.
        assert_eq!(gaps(&mesh, &impostor, size, &[middle * 9.0]), []);
        found.into_iter().map(|g| g.kind).collect()
    };
    let whole = ["......", ".####.", ".####.", ".####.", ".####.", "......"];
    assert_eq!(kinds(&whole), []);
    let thin = ["..##..", "..##..", "..--..", "..##..", "..##..", "..##.."];
    assert_eq!(kinds(&thin), []);
    let cut = ["..##..", "..##..", "..--..", "..--..", "..##..", "..##.."];
    assert_eq!(kinds(&cut), [GapKind::Cut]);
    let hole = ["######", "######", "##--##", "##--##", "######", "######"];
    assert_eq!(kinds(&hole), [GapKind::Hole]);
    let notch = [".####.", ".####.", ".--##.", ".--##.", ".####.", ".####."];
    assert_eq!(kinds(&notch), [GapKind::Notch]);
    // The mesh lets one look through there, too.
    let bent = [".####.", ".####.", ".#..#.", ".#..#.", ".####.", ".####."];
    assert_eq!(kinds(&bent), []);
}
