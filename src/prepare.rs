//! Before the first frame: validates a baked character and makes the arrays that the GPU reads.

use std::ops::Range;
use std::sync::Arc;

use bytemuck::Zeroable;
use glam::{Affine3A, Vec3, Vec4};
use throng_bake::baked::{Baked, BakedClip, Band, PaletteEntry, Vertex};
use throng_bake::impostor::PoseRange;
use throng_bake::mesh::Mesh;
use throng_bake::quantize::{decode_position, decode_weights};

use crate::error::RenderError;
use crate::frame::{CharacterId, FrameOptions};
use crate::gpu_types::{
    AGENTS_PER_INSTANCE, BIN_NONE, BandInfo, CharacterConstants, CharacterInfo, ClipInfo,
    LEVEL_SHIFT, LevelInfo, PACKED_VERTICES, RangeInfo, SubmeshInfo,
};
use crate::impostor::{self, Gallery};
use crate::pool::Pool;
use crate::representation::{CostModel, Representations};
use crate::scene::ground_of;

/// A contact shadow's radius as a share of the root of its character's box from above.
const SHADOW_SHARE: f32 = 1.2;

/// The tables of the select stage, of all characters. What one had is free for others once it is removed; nobody else's moves.
#[derive(Debug, Clone)]
pub struct Tables {
    /// By [`CharacterId::slot`].
    pub characters: Vec<CharacterInfo>,
    /// Clips of all characters.
    pub clips: Pool<ClipInfo>,
    /// Clips of each character.
    pub clip_counts: Vec<u32>,
    /// Submeshes of all characters.
    pub submeshes: Pool<SubmeshInfo>,
    /// The windows of impostors, for each slice of each kind, then the bands of all submeshes; the place here is the bin.
    /// Shared with the reports of frames in flight.
    pub bands: Arc<Pool<BandInfo>>,
    /// Levels of detail of all submeshes.
    pub levels: Pool<LevelInfo>,
    /// Height of each character's bounds above its origin, bind-space units, whatever it does.
    pub tops: Vec<f32>,
    /// What draws each character.
    pub representations: Vec<Representations>,
    /// Impostors of all characters.
    pub gallery: Gallery,
    /// What each character holds of the tables.
    held: Vec<Held>,
}

/// A character's place in the tables.
#[derive(Debug, Clone, Default)]
struct Held {
    /// Its id; `None` where there is nobody.
    id: Option<CharacterId>,
    /// How many characters had the place before.
    generation: u32,
    clips: Range<usize>,
    submeshes: Range<usize>,
    bands: Range<usize>,
    levels: Range<usize>,
    block: Option<impostor::Block>,
}

impl Default for Tables {
    fn default() -> Self {
        Self {
            characters: Vec::new(),
            clips: Pool::default(),
            clip_counts: Vec::new(),
            submeshes: Pool::default(),
            bands: Arc::new(Pool::from(impostor::windows())),
            levels: Pool::default(),
            tops: Vec::new(),
            representations: Vec::new(),
            gallery: Gallery::default(),
            held: Vec::new(),
        }
    }
}

impl Tables {
    /// Entries of the selected buffer per agent: the most that one may need.
    pub fn entry_stride(&self) -> u32 {
        let entries = (0..self.characters.len()).map(|c| self.entries_of(c));
        entries.max().unwrap_or(1)
    }

    /// The most list entries that an agent of a character may need: its submeshes, and with impostors one more that fades
    /// in, or two that fade into each other.
    pub fn entries_of(&self, character: usize) -> u32 {
        let submeshes = self.characters[character].submesh_count;
        match self.representations[character].kinds.len() {
            0 => submeshes.max(1),
            _ => submeshes.max(1) + 1,
        }
    }

    /// The ranges of all characters for a frame, `[character_count][MAX_RANGES]`.
    pub fn ranges(&self, options: &FrameOptions, costs: &CostModel) -> Vec<RangeInfo> {
        let ranges = |r: &Representations| r.ranges(options.method, options.pixel_error, costs);
        self.representations.iter().flat_map(ranges).collect()
    }

    /// The place of a character; `None` where there is none of that id, or no longer.
    pub fn slot_of(&self, id: CharacterId) -> Option<usize> {
        let held = self.held.get(id.slot());
        held.filter(|h| h.id == Some(id)).map(|_| id.slot())
    }

    /// The id that the next character gets; `None` where there are as many as ids tell apart.
    pub fn next_id(&self) -> Option<CharacterId> {
        // A place whose numbers are used up stays empty.
        let is_free = |h: &Held| h.id.is_none() && h.generation < CharacterId::GENERATIONS;
        let slot = self.held.iter().position(is_free);
        let slot = slot.unwrap_or(self.held.len());
        let generation = self.held.get(slot).map_or(0, |h| h.generation);
        CharacterId::new(slot, generation)
    }

    /// Where the bands and submeshes of one more character would begin.
    pub fn next_bin_and_submesh(&self, baked: &Baked) -> (u32, u32) {
        let bin = self.bands.place(baked.bands.len());
        let submesh = self.submeshes.place(baked.submeshes.len());
        (bin as u32, submesh as u32)
    }

    /// Takes in a validated character, as `id`, which is [`Self::next_id`].
    pub fn insert(&mut self, baked: &Baked, id: CharacterId) {
        let slot = id.slot();
        if slot == self.held.len() {
            self.characters.push(CharacterInfo::zeroed());
            self.clip_counts.push(0);
            self.tops.push(0.0);
            self.representations.push(Representations::default());
            self.held.push(Held::default());
        }
        let (first_bin, _) = self.next_bin_and_submesh(baked);
        let joint_count = baked.joints.len() as u32;
        let errors = SkinningErrors::measure(baked);
        let block = baked
            .impostors
            .as_ref()
            .map(|i| self.gallery.insert(i, &baked.palette));
        let mut clips = Vec::with_capacity(baked.clips.len());
        for (i, (clip, &nearest_error)) in baked.clips.iter().zip(&errors.nearest).enumerate() {
            let poses = baked.impostors.as_ref().and_then(|x| x.clip_poses.get(i));
            let poses = poses.copied().unwrap_or(PoseRange {
                first_pose: 0,
                pose_count: 0,
            });
            let center = (clip.box_min + clip.box_max) * 0.5;
            let half_extent = clip.box_max - center;
            clips.push(ClipInfo {
                sphere_center: clip.sphere_center.into(),
                sphere_radius: clip.sphere_radius,
                box_center: center.into(),
                first_pose: poses.first_pose + block.as_ref().map_or(0, |b| b.first_pose),
                box_half_extent: half_extent.into(),
                pose_count: poses.pose_count,
                first_frame: clip.first_frame,
                frame_count: clip.frame_count,
                nearest_error,
                shadow_radius: SHADOW_SHARE * (half_extent.x * half_extent.z).sqrt(),
            });
        }
        // Levels are numbered from the first of the character's, and moved to their place once their number is known.
        let (mut levels, mut submeshes) = (Vec::new(), Vec::new());
        for submesh in &baked.submeshes {
            let errors: Vec<f32> = baked.collapse[submesh.first_vertex as usize..]
                [..submesh.vertex_count as usize]
                .iter()
                .map(|c| c.error)
                .collect();
            let bands = &baked.bands[submesh.first_band as usize..][..submesh.band_count as usize];
            let first_level = levels.len() as u32;
            let first_bin = first_bin + submesh.first_band;
            let first_key = append_levels(&mut levels, &errors, bands, first_bin);
            submeshes.push(SubmeshInfo {
                first_level,
                level_count: levels.len() as u32 - first_level,
                first_key,
                vertex_count: submesh.vertex_count,
            });
        }
        let levels = self.levels.insert(levels);
        for submesh in &mut submeshes {
            submesh.first_level += levels.start as u32;
        }
        let waiting = waiting_vertex_counts(baked);
        let bands = baked.bands.iter().zip(waiting).zip(packed_windows(baked));
        let bands = bands.map(|((b, waiting), packed)| BandInfo {
            first_index: b.first_index,
            index_count: b.index_count,
            vertex_count: b.vertex_count,
            waiting_vertex_count: waiting,
            packed_first_index: packed,
        });
        let windows = Arc::make_mut(&mut self.bands);
        impostor::set_windows(windows, self.gallery.quad_count);
        let generation = self.held[slot].generation;
        let held = Held {
            id: Some(id),
            generation,
            clips: self.clips.insert(clips),
            submeshes: self.submeshes.insert(submeshes),
            bands: windows.insert(bands.collect()),
            levels,
            block,
        };
        self.characters[slot] = CharacterInfo {
            first_submesh: held.submeshes.start as u32,
            submesh_count: baked.submeshes.len() as u32,
            first_clip: held.clips.start as u32,
            joint_count,
            influences1_error: errors.influences[0],
            influences2_error: errors.influences[1],
            influences3_error: errors.influences[2],
            lowest: ground_of(baked),
            occluder_error: occluder_error(baked),
            padding0: 0,
            padding1: 0,
            padding2: 0,
        };
        self.clip_counts[slot] = baked.clips.len() as u32;
        self.tops[slot] = baked.clips.iter().fold(0.0, |top, c| c.box_max.y.max(top));
        self.representations[slot] = Representations::new(baked);
        self.held[slot] = held;
    }

    /// Frees what a character holds, whose id means nobody from now on. Returns its place; `None` where there is none.
    pub fn remove(&mut self, id: CharacterId) -> Option<usize> {
        let slot = self.slot_of(id)?;
        let nobody = Held {
            generation: self.held[slot].generation + 1,
            ..Held::default()
        };
        let held = std::mem::replace(&mut self.held[slot], nobody);
        let windows = Arc::make_mut(&mut self.bands);
        windows.remove(held.bands);
        if let Some(block) = held.block {
            self.gallery.remove(block);
            impostor::set_windows(windows, self.gallery.quad_count);
        }
        self.clips.remove(held.clips);
        self.submeshes.remove(held.submeshes);
        self.levels.remove(held.levels);
        self.characters[slot] = CharacterInfo::zeroed();
        self.clip_counts[slot] = 0;
        self.tops[slot] = 0.0;
        self.representations[slot] = Representations::default();
        Some(slot)
    }
}

/// Triangles of the finest mesh with which a character hides others.
const OCCLUDER_TRIANGLES: u32 = 40;

/// The smallest LOD error at which a character has few enough triangles to hide others.
fn occluder_error(baked: &Baked) -> f32 {
    let mut errors: Vec<f32> = baked.bands.iter().map(|b| b.error).collect();
    errors.sort_by(f32::total_cmp);
    let triangles_at = |error: f32| -> u32 {
        let of = |s: &throng_bake::baked::Submesh| {
            let bands = &baked.bands[s.first_band as usize..][..s.band_count as usize];
            let band = bands.iter().rev().find(|b| b.error <= error);
            band.or(bands.first()).map_or(0, |b| b.index_count / 3)
        };
        baked.submeshes.iter().map(of).sum()
    };
    let few = errors
        .iter()
        .find(|&&e| triangles_at(e) <= OCCLUDER_TRIANGLES);
    few.or(errors.last()).copied().unwrap_or(0.0)
}

/// The step that a LOD error is rounded down to: as many for each doubling of the error.
pub fn level_key(lod_error: f32) -> i32 {
    lod_error.to_bits() as i32 >> LEVEL_SHIFT
}

/// Appends a submesh's levels: full detail, then one for each key from the first on, which is returned. `errors` are its
/// collapse errors, which do not rise; a vertex is alive while its error is greater than the LOD error. Keys below the first
/// have the first one's level, keys behind the last have the last one's.
fn append_levels(
    levels: &mut Vec<LevelInfo>,
    errors: &[f32],
    bands: &[Band],
    first_bin: u32,
) -> i32 {
    let level = |live_vertex_count: u32| {
        let holds = |b: &Band| b.vertex_count >= live_vertex_count;
        let band = bands.iter().rposition(holds).unwrap_or(0);
        let drawn = live_vertex_count >= 3 && bands[band].index_count > 0;
        LevelInfo {
            live_vertex_count,
            bin: if drawn {
                first_bin + band as u32
            } else {
                BIN_NONE
            },
        }
    };
    levels.push(level(errors.len() as u32));
    let finite = || errors.iter().filter(|e| e.is_finite() && **e > 0.0);
    let first_key = finite().copied().reduce(f32::min).map_or(0, level_key);
    let last_key = finite().copied().reduce(f32::max).map_or(0, level_key);
    // The key below the smallest error has what it takes to be without error; the one above the greatest, what never dies.
    let (first_key, last_key) = (first_key - 1, last_key + 1);
    for key in first_key..=last_key {
        let lod_error = f32::from_bits((key.max(0) as u32) << LEVEL_SHIFT);
        let lod_error = if key == first_key { 0.0 } else { lod_error };
        levels.push(level(errors.partition_point(|&e| e > lod_error) as u32));
    }
    first_key
}

/// For each band, how many of an instance's live vertices wait for coarser levels: for the full mesh's band as many as do
/// at its level, for the others, whose instances lie anywhere down to the next band's level, the mean of both.
fn waiting_vertex_counts(baked: &Baked) -> Vec<u32> {
    let mut counts: Vec<u32> = (baked.bands.iter())
        .map(|b| b.vertex_count.saturating_sub(drawn_vertex_count(baked, b)))
        .collect();
    for s in &baked.submeshes {
        let bands = s.first_band as usize..(s.first_band + s.band_count) as usize;
        for i in bands.clone().skip(1) {
            if i + 1 < bands.end {
                counts[i] = counts[i].midpoint(counts[i + 1]);
            }
        }
    }
    counts
}

/// Vertices that a band's triangles use.
fn drawn_vertex_count(baked: &Baked, band: &Band) -> u32 {
    let mut used = vec![false; band.vertex_count as usize];
    let window = &baked.indices[band.first_index as usize..][..band.index_count as usize];
    for &v in window {
        if let Some(used) = used.get_mut(v as usize) {
            *used = true;
        }
    }
    used.into_iter().map(u32::from).sum()
}

/// The most indices of all windows that a character's agents are drawn packed with: files may have any number of bands.
const PACKED_INDICES_MAX: u64 = 1 << 20;

/// For each band where the windows stand that its agents are drawn with, many to an instance, behind the baked indices; 0 for
/// bands of too many vertices or triangles.
fn packed_windows(baked: &Baked) -> Vec<u32> {
    let mut next = baked.indices.len() as u64;
    let end = (next + PACKED_INDICES_MAX).min(u32::MAX.into());
    let place = |band: &Band| {
        let (first, count) = (
            next,
            u64::from(AGENTS_PER_INSTANCE) * u64::from(band.index_count),
        );
        match band.vertex_count <= PACKED_VERTICES && first + count <= end {
            true => {
                next += count;
                first as u32
            }
            false => 0,
        }
    };
    baked.bands.iter().map(place).collect()
}

/// The baked indices, and behind them, for each band whose agents are drawn packed, a window for each agent of an instance.
pub fn indices(baked: &Baked) -> Vec<u32> {
    let mut indices = baked.indices.clone();
    let packed = baked.bands.iter().zip(packed_windows(baked));
    for (band, _) in packed.filter(|(_, first)| *first > 0) {
        let window = &baked.indices[band.first_index as usize..][..band.index_count as usize];
        for agent in 0..AGENTS_PER_INSTANCE {
            indices.extend(window.iter().map(|v| v + PACKED_VERTICES * agent));
        }
    }
    indices
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
    /// The last of them, whose agents are drawn packed.
    pub packed_band_count: u32,
    /// The least LOD error at which an agent is in one of those; greater than any where there are none.
    pub packed_error: f32,
    /// Some vertex has a texture.
    pub textured: bool,
    /// Both faces are drawn.
    pub double_sided: bool,
    /// Alpha below this is not drawn.
    pub alpha_cutoff: Option<f32>,
}

/// How many of a submesh's last bands are drawn packed, and the least LOD error at which an agent is in one of them.
fn packed_bands(bands: &[Band], windows: &[u32]) -> (u32, f32) {
    let packed = windows.iter().rev().take_while(|&&first| first > 0).count();
    let first = bands.get(bands.len() - packed);
    (packed as u32, first.map_or(f32::INFINITY, |b| b.error))
}

/// Draw state of each submesh.
pub fn submesh_draws(baked: &Baked) -> Vec<SubmeshDraw> {
    let windows = packed_windows(baked);
    baked
        .submeshes
        .iter()
        .map(|s| {
            let bands = s.first_band as usize..(s.first_band + s.band_count) as usize;
            let (packed_band_count, packed_error) =
                packed_bands(&baked.bands[bands.clone()], &windows[bands]);
            SubmeshDraw {
                first_vertex: s.first_vertex,
                first_band: s.first_band,
                band_count: s.band_count,
                packed_band_count,
                packed_error,
                textured: baked.vertices[s.first_vertex as usize..][..s.vertex_count as usize]
                    .iter()
                    .any(|v| v.layer != Mesh::UNTEXTURED),
                double_sided: s.info.double_sided,
                alpha_cutoff: s.info.alpha_cutoff,
            }
        })
        .collect()
}

/// The vertex records: the baked vertex in 7 words and its body part's tint code in the 8th, `[vertex_count]`.
/// Vertices without a texture get the layer behind the last, which is white.
pub fn vertex_texels(baked: &Baked) -> Vec<[u32; 8]> {
    baked
        .vertices
        .iter()
        .map(|v| {
            let mut v = *v;
            let code = baked.body_parts[v.body_part as usize].code(v.body_part);
            if v.layer == Mesh::UNTEXTURED {
                v.layer = baked.textures.layer_count as u8;
            }
            let words: [u32; 7] = bytemuck::cast(v);
            let mut texels = [0; 8];
            texels[..7].copy_from_slice(&words);
            texels[7] = code.into();
            texels
        })
        .collect()
}

/// Constants of the character's draws.
pub fn constants(baked: &Baked) -> CharacterConstants {
    CharacterConstants {
        position_min: baked.position_min.into(),
        padding0: 0,
        position_extent: baked.position_extent.into(),
        padding1: 0,
        uv_min: baked.uv_min.into(),
        uv_extent: baked.uv_extent.into(),
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

#[cfg(test)]
mod tests {
    use super::*;

    fn bands(counts: &[u32]) -> Vec<Band> {
        let band = |&vertex_count| Band {
            first_index: 0,
            index_count: 3 * u32::from(vertex_count > 4),
            vertex_count,
            error: 0.0,
        };
        counts.iter().map(band).collect()
    }

    /// The level that shaders look up for an error.
    fn look_up(levels: &[LevelInfo], first_key: i32, lod_error: f32) -> LevelInfo {
        let last = levels.len() as i32 - 1;
        levels[(level_key(lod_error) - first_key + 1).clamp(1, last) as usize]
    }

    #[test]
    fn a_level_is_that_of_its_error_rounded_down() {
        let mut errors: Vec<f32> = vec![f32::INFINITY; 3];
        errors.extend((0..500).map(|i| 0.3 * 0.98f32.powi(i)));
        errors.extend([0.0; 5]);
        let bands = bands(&[508, 200, 90, 40, 3]);
        let mut levels = Vec::new();
        let first_key = append_levels(&mut levels, &errors, &bands, 10);
        assert_eq!((levels[0].live_vertex_count, levels[0].bin), (508, 10));
        for i in 0..4000 {
            let lod_error = 1e-7 * 1.005f32.powi(i);
            let step = f32::from_bits(lod_error.to_bits() >> LEVEL_SHIFT << LEVEL_SHIFT);
            assert!(step <= lod_error && lod_error <= step * (1.0 + 1.0 / 128.0));
            let live = errors.partition_point(|&e| e > step) as u32;
            let level = look_up(&levels, first_key, lod_error);
            assert_eq!(level.live_vertex_count, live, "at {lod_error}");
            let band = bands.iter().rposition(|b| b.vertex_count >= live);
            let band = band.expect("the first holds all");
            let bin = if bands[band].index_count > 0 {
                10 + band as u32
            } else {
                BIN_NONE
            };
            assert_eq!(level.bin, bin, "at {lod_error}");
        }
        assert_eq!(look_up(&levels, first_key, 0.0).live_vertex_count, 503);
        assert_eq!(look_up(&levels, first_key, 1e30).bin, BIN_NONE);
    }

    /// Of a band that is drawn packed, an instance holds the same window for each of its agents.
    #[test]
    fn packed_windows_repeat_the_bands() {
        let band = |first_index, index_count, vertex_count, error| Band {
            first_index,
            index_count,
            vertex_count,
            error,
        };
        let mut baked = Baked {
            indices: vec![70, 1, 2, 0, 1, 2, 2, 1, 3],
            bands: vec![
                band(0, 3, PACKED_VERTICES + 1, 0.0),
                band(3, 6, PACKED_VERTICES, 0.5),
                band(0, 0, 1, 1.0),
            ],
            ..Baked::default()
        };
        let all = indices(&baked);
        let firsts = packed_windows(&baked);
        let agents = AGENTS_PER_INSTANCE as usize;
        assert_eq!(firsts, [0, 9, 9 + 6 * AGENTS_PER_INSTANCE]);
        assert_eq!(all.len(), 9 + 6 * agents);
        for (agent, window) in all[9..].chunks(6).enumerate() {
            let base = agent as u32 * PACKED_VERTICES;
            assert_eq!(window, [0, 1, 2, 2, 1, 3].map(|v| base + v));
        }
        assert_eq!(packed_bands(&baked.bands, &firsts), (2, 0.5));
        baked.bands[2].vertex_count = PACKED_VERTICES + 1;
        let firsts = packed_windows(&baked);
        assert_eq!(packed_bands(&baked.bands, &firsts), (0, f32::INFINITY));
        // However many bands a file has, their windows take a few megabytes.
        baked.bands = vec![band(3, 6, 3, 0.0); 1_000_000];
        assert!(indices(&baked).len() as u64 <= 9 + PACKED_INDICES_MAX);
    }

    /// Without collapses, and with only such as cost nothing.
    #[test]
    fn a_submesh_that_never_changes_has_levels() {
        for errors in [
            vec![f32::INFINITY; 5],
            vec![f32::INFINITY, 0.0, 0.0, 0.0, 0.0],
        ] {
            let mut levels = Vec::new();
            let first_key = append_levels(&mut levels, &errors, &bands(&[5]), 0);
            assert!(levels.len() >= 2);
            let alive = errors.iter().filter(|e| **e > 0.0).count() as u32;
            for lod_error in [0.0, 1e-20, 1.0, 1e20] {
                let level = look_up(&levels, first_key, lod_error);
                assert_eq!(level.live_vertex_count, alive);
            }
        }
    }
}
