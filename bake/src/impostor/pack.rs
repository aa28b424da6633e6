//! Packs pictures into the atlas.

use glam::{UVec2, Vec2Swizzles};

use super::picture::Picture;
use super::{Atlas, Tile};

/// Largest side of the atlas in texels.
pub(crate) const MAX_ATLAS_SIZE: u32 = 8192;

/// The tiles of `pictures`, parallel to them, and the atlas that holds them; `None` where they would not fit.
///
/// Pictures lie on their side: a row of the atlas is a column of a picture, from its top down. Figures are taller than wide, so
/// that they lie in fewer rows, and a CPU driver's cache, whose lines are rows, reads fewer of them.
///
/// Tiles of falling height stand side by side on shelves. Sizes are multiples of `2^(mip_count - 1)`, so that every tile
/// begins and ends with a texel in every mip.
pub(super) fn pack(pictures: &[Picture], mip_count: u32) -> Option<(Vec<Tile>, Atlas)> {
    let area: u64 = pictures
        .iter()
        .map(|p| u64::from(p.size.x) * u64::from(p.size.y))
        .sum();
    let sizes: Vec<UVec2> = pictures.iter().map(|p| p.size.yx()).collect();
    let widest = sizes.iter().map(|s| s.x).max().unwrap_or(0);
    let side = (area as f64).sqrt().ceil() as u32;
    let width = side.max(widest).max(1).next_multiple_of(64);
    let mut order: Vec<usize> = (0..pictures.len()).filter(|&i| sizes[i].x > 0).collect();
    order.sort_by_key(|&i| (std::cmp::Reverse(sizes[i].y), std::cmp::Reverse(sizes[i].x)));
    let mut places = vec![UVec2::ZERO; pictures.len()];
    let (mut at, mut shelf) = (UVec2::ZERO, 0);
    for &i in &order {
        let size = sizes[i];
        if at.x + size.x > width {
            at = UVec2::new(0, at.y + shelf);
            shelf = 0;
        }
        shelf = shelf.max(size.y);
        places[i] = at;
        at.x += size.x;
    }
    let height = (at.y + shelf).max(1).next_multiple_of(1 << (mip_count - 1));
    if width > MAX_ATLAS_SIZE || height > MAX_ATLAS_SIZE {
        return None;
    }
    let tiles = pictures
        .iter()
        .zip(&places)
        .map(|(p, place)| tile(p, *place))
        .collect();
    let mut atlas = Atlas {
        width,
        height,
        mip_count,
        ..Atlas::default()
    };
    let mut mips: Vec<Picture> = pictures.to_vec();
    for mip in 0..mip_count {
        if mip > 0 {
            mips.iter_mut().for_each(|p| *p = p.halved());
        }
        let (columns, rows) = ((width >> mip) as usize, (height >> mip) as usize);
        let first = atlas.color.len();
        atlas.color.resize(first + columns * rows, [0; 4]);
        atlas
            .surface
            .resize(first + columns * rows, [128, 128, 0, 128]);
        for (p, place) in mips.iter().zip(&places) {
            let (color, surface) = p.encoded();
            let first = first + (place.y >> mip) as usize * columns + (place.x >> mip) as usize;
            let width = p.size.x as usize;
            for (from, (color, surface)) in color.iter().zip(&surface).enumerate() {
                let to = first + (from % width) * columns + from / width;
                atlas.color[to] = *color;
                atlas.surface[to] = *surface;
            }
        }
    }
    Some((tiles, atlas))
}

fn tile(p: &Picture, place: UVec2) -> Tile {
    let extent = p.size.as_vec2() * p.texel;
    let (left, top) = (p.corner.x, p.corner.y);
    Tile {
        min: [left, top - extent.y],
        max: [left + extent.x, top],
        texel: [place.x as u16, place.y as u16],
        size: [p.size.y as u16, p.size.x as u16],
        lean: [0.0; 3],
    }
}
