//! Before the first frame: validates a baked character and makes the arrays that the GPU reads.

use glam::{Affine3A, Vec3, Vec4};
use throng_bake::baked::{Baked, BakedClip, PaletteEntry, Vertex};
use throng_bake::mesh::Mesh;
use throng_bake::quantize::{decode_position, decode_weights};

use crate::error::RenderError;
use crate::gpu_types::{BandInfo, CharacterConstants, CharacterInfo, ClipInfo, SubmeshInfo};
use crate::impostor;

/// The tables of the select stage: all characters one after the other. Grows, never shrinks.
#[derive(Debug, Clone, Default)]
pub struct Tables {
    /// By `CharacterId`.
    pub characters: Vec<CharacterInfo>,
    /// Clips of all characters.
    pub clips: Vec<ClipInfo>,
    /// Clips of each character.
    pub clip_counts: Vec<u32>,
    /// Submeshes of all characters.
    pub submeshes: Vec<SubmeshInfo>,
    /// Bands of all submeshes, and behind those of a character the windows of its impostor kinds; the place here is the bin.
    pub bands: Vec<BandInfo>,
    /// Collapse errors of all vertices.
    pub collapse_errors: Vec<f32>,
}

impl Tables {
    /// Largest number of submeshes of a character, at least 1: entries of the selected buffer per agent.
    pub fn submesh_stride(&self) -> u32 {
        self.characters
            .iter()
            .map(|c| c.submesh_count)
            .max()
            .unwrap_or(1)
            .max(1)
    }

    /// Appends a validated character.
    pub fn append(&mut self, baked: &Baked) {
        let first_error = self.collapse_errors.len() as u32;
        let first_bin = self.bands.len() as u32;
        let joint_count = baked.joints.len() as u32;
        let errors = SkinningErrors::measure(baked);
        self.characters.push(CharacterInfo {
            first_submesh: self.submeshes.len() as u32,
            submesh_count: baked.submeshes.len() as u32,
            first_clip: self.clips.len() as u32,
            joint_count,
            influences1_error: errors.influences[0],
            influences2_error: errors.influences[1],
            influences3_error: errors.influences[2],
            padding: 0,
        });
        self.clip_counts.push(baked.clips.len() as u32);
        for (clip, &nearest_error) in baked.clips.iter().zip(&errors.nearest) {
            let center = (clip.box_min + clip.box_max) * 0.5;
            self.clips.push(ClipInfo {
                sphere_center: clip.sphere_center.into(),
                sphere_radius: clip.sphere_radius,
                box_center: center.into(),
                first_frame: clip.first_frame,
                box_half_extent: (clip.box_max - center).into(),
                frame_count: clip.frame_count,
                nearest_error,
                padding0: 0,
                padding1: 0,
                padding2: 0,
            });
        }
        self.submeshes
            .extend(baked.submeshes.iter().map(|s| SubmeshInfo {
                first_error: first_error + s.first_vertex,
                vertex_count: s.vertex_count,
                first_bin: first_bin + s.first_band,
                band_count: s.band_count,
            }));
        self.bands.extend(baked.bands.iter().map(|b| BandInfo {
            first_index: b.first_index,
            index_count: b.index_count,
            vertex_count: b.vertex_count,
            padding: 0,
        }));
        self.collapse_errors
            .extend(baked.collapse.iter().map(|c| c.error));
        self.bands.extend(impostor::windows(baked));
    }
}

/// A submesh's draw state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SubmeshDraw {
    /// First of its vertices within the character.
    pub first_vertex: u32,
    /// First of its bands within the character.
    pub first_band: u32,
    /// Its bands.
    pub band_count: u32,
    /// Some vertex has a texture.
    pub textured: bool,
    /// Both faces are drawn.
    pub double_sided: bool,
    /// Alpha below this is not drawn.
    pub alpha_cutoff: Option<f32>,
}

/// Draw state of each submesh.
pub fn submesh_draws(baked: &Baked) -> Vec<SubmeshDraw> {
    baked
        .submeshes
        .iter()
        .map(|s| SubmeshDraw {
            first_vertex: s.first_vertex,
            first_band: s.first_band,
            band_count: s.band_count,
            textured: baked.vertices[s.first_vertex as usize..][..s.vertex_count as usize]
                .iter()
                .any(|v| v.layer != Mesh::UNTEXTURED),
            double_sided: s.info.double_sided,
            alpha_cutoff: s.info.alpha_cutoff,
        })
        .collect()
}

/// The vertex texture: the baked vertex in 7 words and its body part's tint rule in the 8th, `[vertex_count]`.
/// Vertices without a texture get the layer behind the last, which is white.
pub fn vertex_texels(baked: &Baked) -> Vec<[u32; 8]> {
    baked
        .vertices
        .iter()
        .map(|v| {
            let mut v = *v;
            let rule = baked.body_parts[v.body_part as usize].tint as u32;
            if v.layer == Mesh::UNTEXTURED {
                v.layer = baked.textures.layer_count as u8;
            }
            let words: [u32; 7] = bytemuck::cast(v);
            let mut texels = [0; 8];
            texels[..7].copy_from_slice(&words);
            texels[7] = rule;
            texels
        })
        .collect()
}

/// Constants of the character's draws.
pub fn constants(baked: &Baked) -> CharacterConstants {
    let texels = impostor::texels(baked.impostors.as_ref());
    let atlas = baked.impostors.as_ref().map(|i| &i.atlas);
    CharacterConstants {
        position_min: baked.position_min.into(),
        first_view_texel: texels.first_view,
        position_extent: baked.position_extent.into(),
        first_tile_texel: texels.first_tile,
        uv_min: baked.uv_min.into(),
        uv_extent: baked.uv_extent.into(),
        atlas_size: atlas.map_or([1.0; 2], |a| [a.width as f32, a.height as f32]),
        last_mip: atlas.map_or(0.0, |a| a.mip_count.saturating_sub(1) as f32),
        padding: 0.0,
    }
}

/// How far cheaper skinning is off, in bind-space units: root mean square over vertices, worst over frames.
#[derive(Debug, Clone, PartialEq)]
struct SkinningErrors {
    /// With 1, 2 and 3 influences.
    influences: [f32; 3],
    /// With the nearest frame instead of two, by clip.
    nearest: Vec<f32>,
}

impl SkinningErrors {
    /// Vertices and frames that are looked at: enough to be within a tenth on real characters, and cheap.
    const VERTICES: usize = 256;
    const FRAMES_PER_CLIP: usize = 12;

    fn measure(baked: &Baked) -> Self {
        let step = baked.vertices.len().div_ceil(Self::VERTICES).max(1);
        let vertices: Vec<(Vec3, &Vertex)> = baked
            .vertices
            .iter()
            .step_by(step)
            .map(|v| {
                (
                    decode_position(v, baked.position_min, baked.position_extent),
                    v,
                )
            })
            .collect();
        let mut influences = [0.0f32; 3];
        let mut nearest = Vec::with_capacity(baked.clips.len());
        for clip in &baked.clips {
            let mut worst = 0.0f32;
            let step = (clip.frame_count as usize)
                .div_ceil(Self::FRAMES_PER_CLIP)
                .max(1);
            for frame in (0..clip.frame_count as usize).step_by(step) {
                let palette = frame_palette(baked, clip, frame);
                let next =
                    frame_palette(baked, clip, (frame + 1).min(clip.frame_count as usize - 1));
                let exact: Vec<Vec3> = vertices
                    .iter()
                    .map(|(p, v)| skin(&palette, v, *p, 4))
                    .collect();
                for (n, error) in influences.iter_mut().enumerate() {
                    *error = error
                        .max(rms(vertices.iter().zip(&exact).map(|((p, v), e)| {
                            skin(&palette, v, *p, n + 1).distance_squared(*e)
                        })));
                }
                worst = worst.max(
                    0.5 * rms(vertices
                        .iter()
                        .zip(&exact)
                        .map(|((p, v), e)| skin(&next, v, *p, 4).distance_squared(*e))),
                );
            }
            nearest.push(worst);
        }
        Self {
            influences,
            nearest,
        }
    }
}

fn rms(squares: impl ExactSizeIterator<Item = f32>) -> f32 {
    let n = squares.len().max(1) as f32;
    (squares.sum::<f32>() / n).sqrt()
}

fn frame_palette(baked: &Baked, clip: &BakedClip, frame: usize) -> Vec<Affine3A> {
    let n = baked.joints.len();
    baked.palette[(clip.first_frame as usize + frame) * n..][..n]
        .iter()
        .map(affine)
        .collect()
}

fn affine(entry: &PaletteEntry) -> Affine3A {
    let [a, b, c] = entry.rows.map(Vec4::from_array);
    Affine3A::from_cols(
        Vec3::new(a.x, b.x, c.x).into(),
        Vec3::new(a.y, b.y, c.y).into(),
        Vec3::new(a.z, b.z, c.z).into(),
        Vec3::new(a.w, b.w, c.w).into(),
    )
}

fn skin(palette: &[Affine3A], vertex: &Vertex, position: Vec3, influences: usize) -> Vec3 {
    let weights = decode_weights(vertex.weights);
    let mut sum = Vec3::ZERO;
    let mut total = 0.0;
    for (&joint, &weight) in vertex.joints.iter().zip(&weights).take(influences) {
        if weight > 0.0 {
            sum += weight * palette[joint as usize].transform_point3(position);
            total += weight;
        }
    }
    sum / total
}

/// Checks everything that a shader or an upload relies on.
///
/// Errors: [`RenderError::BadCharacter`] with the place and the reason.
pub fn validate(baked: &Baked) -> Result<(), RenderError> {
    if baked.clips.len() > 1 << 16 {
        return Err(RenderError::BadCharacter {
            character: baked.name.clone(),
            place: "clips".into(),
            reason: "there are more than 65,536".into(),
        });
    }
    throng_bake::validate::validate(baked).map_err(|(place, reason)| RenderError::BadCharacter {
        character: baked.name.clone(),
        place,
        reason,
    })
}
