//! How tiles lean: the plane through the surface that a picture shows.
//!
//! A picture taken from the centre of a view cell is drawn for every direction in the cell. On a plane across the direction
//! of capture a standing figure that was taken from above would come out too short from the side, by a quarter between
//! neighbouring cells; on the plane that fits its outline best, it keeps its proportions. The outline counts, not the
//! surface before it: that is nearer to the eye all over, and would shift against the outline from cell to cell.

use glam::{Vec2, Vec3};

use super::picture::Picture;
use super::{Impostors, MAX_LEAN, NO_JOINT};

/// Fits the planes of all tiles to the depths of their pictures.
pub(super) fn lean_tiles(impostors: &mut Impostors, pictures: &[Picture]) {
    let mut extents = Vec::with_capacity(pictures.len());
    for (i, quad) in impostors.quads.iter().enumerate() {
        let end = impostors
            .quads
            .get(i + 1)
            .map_or(pictures.len(), |next| next.first_tile as usize);
        extents.resize(end, (quad.depth_extent, quad.joint != NO_JOINT));
    }
    let tiles = impostors.tiles.iter_mut().zip(pictures);
    for ((tile, picture), (extent, is_limb)) in tiles.zip(extents) {
        let mut lean = lean(picture, extent);
        if is_limb {
            // Its outline runs around its axis, on which the centre lies; its ends are open, and would mislead.
            lean.z = 0.0;
        }
        tile.lean = lean.to_array();
    }
}

/// Least squares over the outline's texels: depth as a linear function of the place in the plane. Slopes along right and
/// up, and the depth at the centre, within what the picture's depths allow.
fn lean(picture: &Picture, depth_extent: f32) -> Vec3 {
    let mut points = Vec::new();
    let columns = picture.size.x as usize;
    let is_empty = |i: Option<usize>| {
        let texel = i.and_then(|i| picture.texels.get(i));
        texel.is_none_or(|t| t.coverage == 0.0)
    };
    for (i, t) in picture.texels.iter().enumerate() {
        // Rims are empty, so a row's ends are neighbours of nothing.
        let beside = [
            i.checked_sub(1),
            Some(i + 1),
            i.checked_sub(columns),
            Some(i + columns),
        ];
        if t.coverage > 0.0 && beside.into_iter().any(is_empty) {
            let at = Vec2::new(
                (i as u32 % picture.size.x) as f32 + 0.5,
                -((i as u32 / picture.size.x) as f32 + 0.5),
            );
            let at = picture.corner + at * picture.texel;
            let depth = (t.shape.z / 255.0 * 2.0 - 1.0) * depth_extent;
            let point = at.extend(depth);
            points.push((point, t.coverage));
        }
    }
    // A texel's own width keeps thin pictures from leaning anyhow.
    plane(&points, picture.texel)
}

/// Least squares over weighted points (place in the plane of a picture, depth): slopes along right and up, and the depth at the
/// centre; 0 without points. What is not wider than `ridge` hardly leans.
pub(super) fn plane(points: &[(Vec3, f32)], ridge: f32) -> Vec3 {
    let weight: f32 = points.iter().map(|p| p.1).sum();
    if weight <= 0.0 {
        return Vec3::ZERO;
    }
    let mean = points.iter().map(|&(p, w)| w * p).sum::<Vec3>() / weight;
    let (mut xx, mut xy, mut yy, mut xz, mut yz) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for &(p, w) in points {
        let d = p - mean;
        xx += w * d.x * d.x;
        xy += w * d.x * d.y;
        yy += w * d.y * d.y;
        xz += w * d.x * d.z;
        yz += w * d.y * d.z;
    }
    let ridge = weight * ridge * ridge;
    let (xx, yy) = (xx + ridge, yy + ridge);
    let determinant = xx * yy - xy * xy;
    let slope = Vec2::new(xz * yy - yz * xy, yz * xx - xz * xy) / determinant;
    let slope = slope.clamp_length_max(MAX_LEAN);
    if slope.is_finite() {
        slope.extend(mean.z - slope.dot(mean.truncate()))
    } else {
        Vec3::ZERO
    }
}

#[cfg(test)]
mod tests {
    use glam::UVec2;

    use super::super::picture::Texel;
    use super::*;

    #[test]
    fn a_picture_of_a_plane_leans_as_the_plane() {
        let plane = |at: Vec2| 0.3 * at.x - 0.5 * at.y + 0.1;
        let size = UVec2::new(20, 30);
        let (corner, texel, extent) = (Vec2::new(-0.4, 0.7), 0.05, 2.0);
        let texels = (0..size.x * size.y).map(|i| {
            let at =
                corner + Vec2::new((i % size.x) as f32 + 0.5, -((i / size.x) as f32 + 0.5)) * texel;
            Texel {
                coverage: if i % 3 == 0 { 0.0 } else { 1.0 },
                shape: Vec3::new(128.0, 128.0, (plane(at) / extent + 1.0) * 127.5),
                ..Texel::default()
            }
        });
        let picture = Picture {
            corner,
            texel,
            size,
            texels: texels.collect(),
        };
        let found = lean(&picture, extent);
        assert!(
            found.abs_diff_eq(Vec3::new(0.3, -0.5, 0.1), 0.02),
            "{found}"
        );
    }

    #[test]
    fn an_empty_picture_does_not_lean() {
        assert_eq!(lean(&Picture::default(), 1.0), Vec3::ZERO);
    }
}
