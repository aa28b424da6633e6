//! impostor: the quads of all agents that show an impostor kind, one indirect multi-draw per character with a sub-draw per
//! kind. Host side of hlsl/impostor.hlsl; twin in [`crate::reference::impostor`].

use ash::vk;
use throng_bake::baked::Baked;
use throng_bake::impostor::{Impostors, NO_JOINT, Quad};

use crate::gpu::{Commands, Drawing};
use crate::gpu_types::{BandInfo, DrawConstants};
use crate::mesh;

/// Records the draws of every character that has impostors and agents.
pub(crate) fn record(c: &mut Commands, drawing: &Drawing) {
    const GRAPHICS: vk::PipelineBindPoint = vk::PipelineBindPoint::GRAPHICS;
    let (slot, pipelines) = (drawing.slot, drawing.pipelines);
    let Some(buffers) = &slot.buffers else { return };
    let layout = pipelines.draw_layout;
    let mut bound = false;
    for (resident, &agent_count) in drawing.residents.iter().zip(&slot.agent_counts) {
        if agent_count == 0 || resident.impostor_bin_count == 0 {
            continue;
        }
        if !bound {
            c.bind_pipeline(GRAPHICS, pipelines.impostor);
            c.bind_instances(&buffers.instances);
            c.bind_set(GRAPHICS, layout, 0, slot.draw_set);
            c.push_constants(layout, mesh::STAGES, &DrawConstants::default());
            bound = true;
        }
        c.bind_set(GRAPHICS, layout, 1, resident.set);
        c.bind_indices(&resident.indices);
        c.draw_indexed_indirect(
            &buffers.draws,
            resident.first_bin + resident.band_count,
            resident.impostor_bin_count,
        );
    }
}

/// The impostor texture of a character: quads and views of all view sets, two texels each, and
/// tiles, three. A character without impostors
/// has one zero.
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
    for tile in &impostors.tiles {
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
