//! Impostors in the `.throng` file: records in `META`, arrays in sections of their own.

use bytemuck::Pod;
use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::blocks::Blocks;
use super::{Atlas, Impostors, KindInfo, PoseRange, Quad, ViewSet, validate};
use crate::bc7::Block;

/// Everything that is not a large array.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ImpostorMeta {
    kinds: Vec<KindInfo>,
    quads: Vec<Quad>,
    /// Directions of each view set.
    view_counts: Vec<u32>,
    clip_poses: Vec<PoseRange>,
    atlas_size: [u32; 2],
    atlas_mips: u32,
    /// Colour and surface are blocks.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    atlas_blocks: bool,
}

/// Sections of impostors: directions and right axes, cells, tiles, colour, surface.
pub(crate) const SECTIONS: [&str; 5] = ["IVEW", "ICEL", "ITIL", "ICOL", "ISUR"];

/// The records, and the arrays in the order of [`SECTIONS`].
pub(crate) fn split(impostors: &Impostors) -> (ImpostorMeta, [Vec<u8>; 5]) {
    let sets = &impostors.view_sets;
    let meta = ImpostorMeta {
        kinds: impostors.kinds.clone(),
        quads: impostors.quads.clone(),
        view_counts: sets.iter().map(|s| s.directions.len() as u32).collect(),
        clip_poses: impostors.clip_poses.clone(),
        atlas_size: [impostors.atlas.width, impostors.atlas.height],
        atlas_mips: impostors.atlas.mip_count,
        atlas_blocks: impostors.atlas.blocks.is_some(),
    };
    let axes: Vec<Vec3> = sets
        .iter()
        .flat_map(|s| [&s.directions[..], &s.rights].concat())
        .collect();
    let cells: Vec<[u16; 4]> = sets.iter().flat_map(|s| s.cells.clone()).collect();
    let atlas = &impostors.atlas;
    let [color, surface] = match &atlas.blocks {
        Some(blocks) => [&blocks.color, &blocks.surface].map(|b| bytemuck::cast_slice(b).to_vec()),
        None => [&atlas.color, &atlas.surface].map(|p| bytemuck::cast_slice(p).to_vec()),
    };
    let arrays = [
        bytemuck::cast_slice(&axes).to_vec(),
        bytemuck::cast_slice(&cells).to_vec(),
        bytemuck::cast_slice(&impostors.tiles).to_vec(),
        color,
        surface,
    ];
    (meta, arrays)
}

/// The impostors; `arrays` in the order of [`SECTIONS`]. Not valid yet.
///
/// Errors: the section and the reason.
pub(crate) fn join(
    meta: ImpostorMeta,
    arrays: [&[u8]; 5],
) -> Result<Impostors, (&'static str, String)> {
    let [axes, cells, tiles, color, surface] = arrays;
    let (mut axes, mut cells) = (array::<Vec3>(axes, 0)?, array::<[u16; 4]>(cells, 1)?);
    let set_count = meta.view_counts.len();
    if set_count.checked_mul(super::CUBE_TEXELS) != Some(cells.len()) {
        return Err((
            SECTIONS[1],
            "its length is not that of the view sets' cubes".into(),
        ));
    }
    let axis_count: u64 = meta.view_counts.iter().map(|&n| 2 * u64::from(n)).sum();
    if axis_count != axes.len() as u64 {
        return Err((
            SECTIONS[0],
            "its length is not that of the view sets' axes".into(),
        ));
    }
    let mut view_sets = Vec::with_capacity(set_count);
    // From the last, so that each set is split off the end.
    for &count in meta.view_counts.iter().rev() {
        let count = count as usize;
        let rights = axes.split_off(axes.len() - count);
        let directions = axes.split_off(axes.len() - count);
        let cells = cells.split_off(cells.len() - super::CUBE_TEXELS);
        view_sets.push(ViewSet {
            directions,
            rights,
            cells,
        });
    }
    view_sets.reverse();
    let mut atlas = Atlas {
        width: meta.atlas_size[0],
        height: meta.atlas_size[1],
        mip_count: meta.atlas_mips,
        ..Atlas::default()
    };
    match meta.atlas_blocks {
        true => show_blocks(&mut atlas, array(color, 3)?, array(surface, 4)?)?,
        false => (atlas.color, atlas.surface) = (array(color, 3)?, array(surface, 4)?),
    }
    Ok(Impostors {
        kinds: meta.kinds,
        quads: meta.quads,
        view_sets,
        clip_poses: meta.clip_poses,
        tiles: array(tiles, 2)?,
        atlas,
    })
}

/// Gives an atlas its blocks, and the pixels that they decode to.
fn show_blocks(
    atlas: &mut Atlas,
    color: Vec<Block>,
    surface: Vec<Block>,
) -> Result<(), (&'static str, String)> {
    // Before anything is as large as it says.
    validate::size(atlas).map_err(|(place, reason)| (SECTIONS[3], format!("{place}: {reason}")))?;
    let count = atlas.block_mip(atlas.mip_count).2;
    for (section, blocks) in [(3, &color), (4, &surface)] {
        if blocks.len() != count {
            let reason = format!(
                "it has {} blocks, and the atlas's size needs {count}",
                blocks.len()
            );
            return Err((SECTIONS[section], reason));
        }
    }
    let blocks = Blocks { color, surface };
    atlas.show(&blocks).map_err(|(picture, index)| {
        let reason = format!("block {index} has a mode that no baked character has");
        (SECTIONS[3 + picture], reason)
    })?;
    atlas.blocks = Some(blocks);
    Ok(())
}

fn array<T: Pod>(payload: &[u8], section: usize) -> Result<Vec<T>, (&'static str, String)> {
    crate::file::array(payload).map_err(|reason| (SECTIONS[section], reason))
}
