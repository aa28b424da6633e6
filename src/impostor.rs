//! impostor: the quads of all agents that show an impostor kind, one indirect draw per character and
//! kind. Host side of hlsl/impostor.hlsl; twin in [`crate::reference::impostor`].

use ash::vk;
use throng_bake::baked::Baked;
use throng_bake::impostor::{Impostors, Kind, NO_JOINT, Quad, Tile};

use crate::gpu::{Commands, Drawing};
use crate::gpu_types::BandInfo;

/// Records the draws of every character that has impostors and agents.
pub(crate) fn record(c: &mut Commands, drawing: &Drawing) {
    const GRAPHICS: vk::PipelineBindPoint = vk::PipelineBindPoint::GRAPHICS;
    let (slot, pipelines) = (drawing.slot, drawing.pipelines);
    let Some(buffers) = &slot.buffers else { return };
    let layout = pipelines.draw_layout;
    // What blends comes last.
    for (soft, pipeline) in [(false, pipelines.impostor), (true, pipelines.impostor_soft)] {
        let mut bound = false;
        for (character, resident) in drawing.residents.iter().enumerate() {
            let bins = || {
                (resident.first_impostor_bin..)
                    .zip(&resident.impostor_kinds)
                    .filter(|&(bin, &k)| is_soft(k) == soft && slot.may_draw(character, bin))
            };
            if bins().next().is_none() {
                continue;
            }
            if !bound {
                c.bind_pipeline(GRAPHICS, pipeline);
                c.bind_instances(&buffers.instances);
                c.bind_set(GRAPHICS, layout, 0, slot.draw_set);
                bound = true;
            }
            c.bind_set(GRAPHICS, layout, 1, resident.set);
            c.bind_indices(&resident.indices);
            for (bin, _) in bins() {
                c.draw_indexed_indirect(&buffers.draws, bin, 1);
            }
        }
    }
}

/// A kind whose edges blend.
fn is_soft(kind: Kind) -> bool {
    match kind {
        Kind::Flat => false,
        Kind::Quad => true,
    }
}

/// The impostor texture of a character: quads and views of all view sets, two texels each, and tiles, three. A
/// character without impostors has one zero.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Texels {
    /// In the order of hlsl/impostor.hlsli.
    pub texels: Vec<[f32; 4]>,
    /// First texel of the views.
    pub first_view: u32,
    /// First texel of the tiles.
    pub first_tile: u32,
}

/// Makes the impostor texture of validated impostors.
pub fn texels(impostors: Option<&Impostors>) -> Texels {
    let Some(impostors) = impostors else {
        return Texels {
            texels: vec![[0.0; 4]],
            ..Texels::default()
        };
    };
    let mut first_views = Vec::with_capacity(impostors.view_sets.len());
    let mut views = Vec::new();
    for set in &impostors.view_sets {
        first_views.push(views.len() as u32 / 2);
        for (direction, right) in set.directions.iter().zip(&set.rights) {
            views.push(direction.extend(0.0).to_array());
            views.push(right.extend(0.0).to_array());
        }
    }
    let mut texels = Vec::new();
    for quad in &impostors.quads {
        let set = quad.view_set as usize;
        let views = impostors.view_sets[set].directions.len() as u32;
        texels.push(quad.center.extend(quad.depth_extent).to_array());
        texels.push([
            joint_texel(quad),
            quad.first_tile as f32,
            first_views[set] as f32,
            (views | (quad.view_set << 12)) as f32,
        ]);
    }
    let first_view = texels.len() as u32;
    texels.append(&mut views);
    let first_tile = texels.len() as u32;
    let atlas = [
        impostors.atlas.width.max(1) as f32,
        impostors.atlas.height.max(1) as f32,
    ];
    for tile in &trimmed_tiles(impostors) {
        let [u, v] = [0, 1].map(|i| tile.texel[i] as f32 / atlas[i]);
        let [width, height] = [0, 1].map(|i| tile.size[i] as f32 / atlas[i]);
        texels.push([tile.min[0], tile.min[1], tile.max[0], tile.max[1]]);
        // The bottom edge is the last row's.
        texels.push([u, v + height, u + width, v]);
        let [x, y, z] = tile.lean;
        texels.push([x, y, z, 0.0]);
    }
    Texels {
        texels,
        first_view,
        first_tile,
    }
}

/// The tiles without the empty texels around their pictures, but for one on each side, where edges are filtered: pixels
/// that show nothing cost as much as others.
pub fn trimmed_tiles(impostors: &Impostors) -> Vec<Tile> {
    let atlas = &impostors.atlas;
    let trim = |tile: &Tile| {
        let [columns, rows] = tile.size.map(u32::from);
        let (mut first, mut last) = ([columns, rows], [0, 0]);
        for y in 0..rows {
            for x in 0..columns {
                let column = u32::from(tile.texel[0]) + x;
                let row = u32::from(tile.texel[1]) + y;
                if atlas.color[(row * atlas.width + column) as usize][3] > 0 {
                    first = [first[0].min(x), first[1].min(y)];
                    last = [last[0].max(x + 1), last[1].max(y + 1)];
                }
            }
        }
        if first[0] >= last[0] {
            return *tile;
        }
        let first = first.map(|x| x.saturating_sub(1));
        let last = [(last[0] + 1).min(columns), (last[1] + 1).min(rows)];
        let texel = [
            (tile.max[0] - tile.min[0]) / columns as f32,
            (tile.max[1] - tile.min[1]) / rows as f32,
        ];
        Tile {
            min: [
                tile.min[0] + first[0] as f32 * texel[0],
                tile.max[1] - last[1] as f32 * texel[1],
            ],
            max: [
                tile.min[0] + last[0] as f32 * texel[0],
                tile.max[1] - first[1] as f32 * texel[1],
            ],
            texel: [
                tile.texel[0] + first[0] as u16,
                tile.texel[1] + first[1] as u16,
            ],
            size: [(last[0] - first[0]) as u16, (last[1] - first[1]) as u16],
            lean: tile.lean,
        }
    };
    impostors.tiles.iter().map(trim).collect()
}

fn joint_texel(quad: &Quad) -> f32 {
    match quad.joint {
        NO_JOINT => -1.0,
        joint => joint as f32,
    }
}

/// Two triangles for every quad, `[6 * quad_count]`.
pub fn indices(quad_count: u32) -> Vec<u32> {
    (0..quad_count)
        .flat_map(|q| [0, 1, 2, 2, 1, 3].map(|corner| 4 * q + corner))
        .collect()
}

/// The index windows of a character's kinds, one bin each; its quads' indices stand behind all others.
pub fn windows(baked: &Baked) -> Vec<BandInfo> {
    let kinds = baked.impostors.iter().flat_map(|i| &i.kinds);
    kinds
        .map(|kind| BandInfo {
            first_index: baked.indices.len() as u32 + 6 * kind.first_quad,
            index_count: 6 * kind.quad_count,
            vertex_count: 4 * kind.quad_count,
            waiting_vertex_count: 0,
        })
        .collect()
}
