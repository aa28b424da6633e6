//! Impostors in the `.throng` file: records in `META`, arrays in sections of their own.

use bytemuck::Pod;
use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::{Atlas, Impostors, KindInfo, PoseRange, Quad, ViewSet};

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
    };
    let axes: Vec<Vec3> = sets
        .iter()
        .flat_map(|s| [&s.directions[..], &s.rights].concat())
        .collect();
    let cells: Vec<[u16; 4]> = sets.iter().flat_map(|s| s.cells.clone()).collect();
    let arrays = [
        bytemuck::cast_slice(&axes).to_vec(),
        bytemuck::cast_slice(&cells).to_vec(),
        bytemuck::cast_slice(&impostors.tiles).to_vec(),
        bytemuck::cast_slice(&impostors.atlas.color).to_vec(),
        bytemuck::cast_slice(&impostors.atlas.surface).to_vec(),
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
    Ok(Impostors {
        kinds: meta.kinds,
        quads: meta.quads,
        view_sets,
        clip_poses: meta.clip_poses,
        tiles: array(tiles, 2)?,
        atlas: Atlas {
            width: meta.atlas_size[0],
            height: meta.atlas_size[1],
            mip_count: meta.atlas_mips,
            color: array(color, 3)?,
            surface: array(surface, 4)?,
        },
    })
}

fn array<T: Pod>(payload: &[u8], section: usize) -> Result<Vec<T>, (&'static str, String)> {
    crate::file::array(payload).map_err(|reason| (SECTIONS[section], reason))
}
