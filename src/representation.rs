//! Which representation draws an agent: by projected height, the cheapest one whose error is allowed.
//!
//! The mesh meets any pixel error, at a cost that grows with it. An impostor kind costs what its quads and their pixels do, and
//! its error was measured beside the mesh. Both are known before a frame begins, so the choice for every height is a short list of ranges
//! per character, which the select stage looks up.

use throng_bake::baked::{Baked, Band};
use throng_bake::impostor::{ErrorSample, Kind};

use crate::frame::Method;
use crate::gpu_types::{BIN_NONE, FLAT_BIN, MAX_RANGES, QUAD_BIN, RangeInfo};
use crate::impostor::trimmed;
use crate::select::PLAIN_LENGTH_PX;
use crate::sheet::bounds_height;

/// What drawing costs on a device, nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CostModel {
    /// A mesh of no triangles.
    pub mesh: f32,
    /// A triangle of a mesh.
    pub triangle: f32,
    /// An impostor of no quads.
    pub impostor: f32,
    /// A quad of no pixels.
    pub quad: f32,
    /// A pixel of a quad.
    pub quad_pixel: f32,
    /// The same with relief, which `quad` is taken to have where its own agents are large enough to show it; a renderer goes by the
    /// longest of the crowd.
    pub relief_pixel: f32,
    /// Side of the squares of pixels that are shaded together, whether a quad covers all of one or a corner, pixels.
    pub pixel_block: f32,
}

impl CostModel {
    /// Mesa's lavapipe on two cores, as `throng bench height` fits it.
    pub const CPU: Self = Self {
        mesh: 410.0,
        triangle: 76.0,
        impostor: 90.0,
        quad: 600.0,
        quad_pixel: 11.5,
        relief_pixel: 15.0,
        pixel_block: 4.0,
    };
    /// A GPU: an estimate, not measured, that takes vertices and pixels for cheap alike.
    pub const GPU: Self = Self {
        mesh: 2.0,
        triangle: 0.5,
        impostor: 0.5,
        quad: 0.5,
        quad_pixel: 0.02,
        relief_pixel: 0.03,
        pixel_block: 2.0,
    };
}

/// What the choice is made from, of one character.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Representations {
    /// Height of its bounds ([`bounds_height`]), bind-space units.
    pub height: f32,
    /// Longest side of its bounds in any clip, bind-space units.
    pub length: f32,
    /// Collapse error and triangles of mesh levels, finest first, submeshes together.
    levels: Vec<(f32, f32)>,
    /// Its impostor kinds.
    pub kinds: Vec<ImpostorKind>,
}

/// An impostor kind of one character.
#[derive(Debug, Clone, PartialEq)]
pub struct ImpostorKind {
    /// Which.
    pub kind: Kind,
    /// Its instance list, which all characters share.
    pub bin: u32,
    /// Mean width and height of each of its quads over the character's height, `[quad_count][2]`.
    sizes: Vec<[f32; 2]>,
    /// The character's length over its height.
    length: f32,
    errors: Vec<ErrorSample>,
}

impl Representations {
    /// Of a validated character.
    pub fn new(baked: &Baked) -> Self {
        let height = bounds_height(baked);
        let mut errors: Vec<f32> = baked.bands.iter().map(|b| b.error).collect();
        errors.sort_by(f32::total_cmp);
        let triangles_at = |error: f32| -> f32 {
            let submeshes = baked.submeshes.iter().map(|s| {
                let bands: &[Band] = &baked.bands[s.first_band as usize..][..s.band_count as usize];
                let band = bands.iter().rev().find(|b| b.error <= error);
                band.or(bands.first()).map_or(0, |b| b.index_count / 3) as f32
            });
            submeshes.sum()
        };
        let levels = errors.iter().map(|&e| (e, triangles_at(e))).collect();
        let impostors = baked.impostors.as_ref();
        let lengths = baked.clips.iter();
        let lengths = lengths.map(|c| (c.box_max - c.box_min).max_element());
        let length = lengths.fold(0.0, f32::max);
        let kinds = impostors
            .into_iter()
            .flat_map(|i| i.kinds.iter().map(move |info| (i, info)))
            .map(|(i, info)| {
                let quads = &i.quads[info.first_quad as usize..][..info.quad_count as usize];
                let sizes = quads.iter().map(|q| {
                    let views = i.view_sets[q.view_set as usize].directions.len();
                    let mut sums = [0.0; 2];
                    for tile in &i.tiles[q.first_tile as usize..][..views] {
                        let tile = trimmed(&i.atlas, tile);
                        for (axis, sum) in sums.iter_mut().enumerate() {
                            *sum += tile.max[axis] - tile.min[axis];
                        }
                    }
                    sums.map(|sum| sum / (views.max(1) as f32 * height))
                });
                ImpostorKind {
                    kind: info.kind,
                    bin: match info.kind {
                        Kind::Quad => QUAD_BIN,
                        Kind::Flat => FLAT_BIN,
                    },
                    sizes: sizes.collect(),
                    length: length / height,
                    errors: info.errors.clone(),
                }
            });
        Self {
            height,
            length,
            levels,
            kinds: kinds.collect(),
        }
    }

    /// Triangles of the mesh at a projected height, at its error bound; none where that is larger than the character.
    fn mesh_triangles(&self, height_px: f32, pixel_error: f32) -> f32 {
        let error = pixel_error * self.height / height_px;
        let level = self.levels.partition_point(|&(e, _)| e <= error);
        let level = self.levels.get(level.saturating_sub(1));
        level.map_or(0.0, |l| l.1)
    }

    /// Nanoseconds of the mesh at a projected height, at its error bound.
    pub fn mesh_cost(&self, costs: &CostModel, height_px: f32, pixel_error: f32) -> f32 {
        costs.mesh + costs.triangle * self.mesh_triangles(height_px, pixel_error)
    }

    /// The ranges of projected size for a method: from near to far, filled up with copies of the last.
    pub fn ranges(
        &self,
        method: Method,
        pixel_error: f32,
        costs: &CostModel,
    ) -> [RangeInfo; MAX_RANGES as usize] {
        let always = |bin| {
            [RangeInfo {
                units_end: f32::INFINITY,
                bin,
            }; MAX_RANGES as usize]
        };
        let forced = |kind| self.kinds.iter().find(|k| k.kind == kind);
        match method {
            Method::Lod | Method::Full | Method::Uninstanced => always(BIN_NONE),
            Method::Flat => always(forced(Kind::Flat).map_or(BIN_NONE, |k| k.bin)),
            Method::Quad => always(forced(Kind::Quad).map_or(BIN_NONE, |k| k.bin)),
            Method::Hybrid => self.cheapest(pixel_error, costs),
        }
    }

    fn cheapest(&self, pixel_error: f32, costs: &CostModel) -> [RangeInfo; MAX_RANGES as usize] {
        // From near to far: the mesh and all kinds, with what each costs, and which of them is drawn.
        let steps: Vec<(f32, Vec<(f32, u32)>)> = (0..=STEPS)
            .map(|step| {
                let height_px = HEIGHT_MAX_PX * (-(step as f32) / STEPS_PER_OCTAVE).exp2();
                // A mesh of no triangles is cheap, but a crowd must not end where its agents grow that small: anything is better.
                let mesh = match self.mesh_triangles(height_px, pixel_error) {
                    0.0 => FORBIDDEN,
                    _ => self.mesh_cost(costs, height_px, pixel_error),
                };
                let kinds = self.kinds.iter().map(|kind| {
                    let error = kind.error(height_px);
                    let cost = match error.is_some_and(|e| e <= pixel_error) {
                        true => kind.cost(costs, height_px),
                        false => FORBIDDEN,
                    };
                    (cost, kind.bin)
                });
                let all = std::iter::once((mesh, BIN_NONE)).chain(kinds);
                (height_px, all.collect())
            })
            .collect();
        let mut drawn: Vec<usize> = steps
            .iter()
            .map(|(_, all)| {
                let costs = all.iter().map(|c| c.0).enumerate();
                let least = costs.min_by(|a, b| a.1.total_cmp(&b.1));
                least.map_or(0, |(candidate, _)| candidate)
            })
            .collect();
        loop {
            let runs: Vec<&[usize]> = drawn.chunk_by(|a, b| a == b).collect();
            if runs.len() <= MAX_RANGES as usize {
                break;
            }
            // One range too many: a run that costs the least more as one of its neighbours becomes that.
            let mut least = (f32::INFINITY, 0..0, 0);
            let mut first = 0;
            for (r, run) in runs.iter().enumerate() {
                let places = first..first + run.len();
                first = places.end;
                let before = r.checked_sub(1).and_then(|r| runs.get(r));
                for neighbor in before.into_iter().chain(runs.get(r + 1)) {
                    let more = places.clone().map(|place| {
                        let all = &steps[place].1;
                        all[neighbor[0]].0 / all[run[0]].0 - 1.0
                    });
                    let more = more.sum();
                    if more < least.0 {
                        least = (more, places.clone(), neighbor[0]);
                    }
                }
            }
            if least.1.is_empty() {
                break;
            }
            drawn[least.1].fill(least.2);
        }
        let mut ranges: Vec<RangeInfo> = Vec::new();
        for (run, (height_px, all)) in drawn.iter().zip(&steps) {
            let bin = all[*run].1;
            if ranges.last().is_some_and(|last| last.bin == bin) {
                continue;
            }
            if let Some(last) = ranges.last_mut() {
                last.units_end = self.height / height_px;
            }
            ranges.push(RangeInfo {
                units_end: f32::INFINITY,
                bin,
            });
        }
        std::array::from_fn(|i| ranges[i.min(ranges.len() - 1)])
    }
}

/// Heights at which the choice is made: 4,096 pixels down to half of one.
const HEIGHT_MAX_PX: f32 = 4096.0;
const STEPS_PER_OCTAVE: f32 = 8.0;
const STEPS: u32 = 13 * 8;

/// What is not allowed costs, nanoseconds: more than anything.
const FORBIDDEN: f32 = 1e12;

/// What an error that was measured on agents that stand alone comes to in a crowd. Soft outlines over who stands behind are nearer
/// to the truth there than a mesh's rough ones.
const QUAD_IN_CROWD: f32 = 0.41;

/// The same for who is longer than high by [`LONG`]: such bodies stand through each other, which a plane for each of them does not
/// show.
const QUAD_IN_CROWD_LONG: f32 = 0.48;
/// See [`QUAD_IN_CROWD_LONG`].
const LONG: f32 = 1.2;

/// The same for `flat`, whose quads keep both cores of a CPU driver as busy as the meshes that they would replace: with 1 in its
/// place a square of 1,000 people took 8 percent more CPU time, at the same FLIP error.
const FLAT_IN_CROWD: f32 = 2.0;

impl ImpostorKind {
    /// Nanoseconds at a projected height.
    pub fn cost(&self, costs: &CostModel, height_px: f32) -> f32 {
        // Pixels along an axis that are shaded for so many that are covered, wherever blocks of them begin; less than one
        // is covered now and then.
        let shaded = |covered: f32| match covered {
            c if c < 1.0 => c * costs.pixel_block,
            c => c + costs.pixel_block - 1.0,
        };
        let has_relief = self.kind == Kind::Quad && self.length * height_px > PLAIN_LENGTH_PX;
        let pixel = match has_relief {
            true => costs.relief_pixel,
            false => costs.quad_pixel,
        };
        let quads = self.sizes.iter().map(|size| {
            let [columns, rows] = size.map(|s| shaded(s * height_px));
            costs.quad + pixel * columns * rows
        });
        costs.impostor + quads.sum::<f32>()
    }

    /// Pixel error in a crowd at a projected height; `None` where it was not measured.
    pub fn error(&self, height_px: f32) -> Option<f32> {
        let factor = match self.kind {
            Kind::Flat => FLAT_IN_CROWD,
            Kind::Quad if self.length > LONG => QUAD_IN_CROWD_LONG,
            Kind::Quad => QUAD_IN_CROWD,
        };
        Some(factor * self.measured_error(height_px)?)
    }

    /// As measured on agents that stand alone. Outside the measured heights it grows with the height.
    fn measured_error(&self, height_px: f32) -> Option<f32> {
        let (first, last) = (self.errors.first()?, self.errors.last()?);
        if height_px <= first.height_px {
            return Some(first.error_px * height_px / first.height_px);
        }
        if height_px >= last.height_px {
            return Some(last.error_px.max(0.1) * height_px / last.height_px);
        }
        let after = self.errors.partition_point(|e| e.height_px <= height_px);
        let (a, b) = (self.errors[after - 1], self.errors[after]);
        let t = (height_px - a.height_px) / (b.height_px - a.height_px);
        Some(a.error_px + t * (b.error_px - a.error_px))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kind(kind: Kind, bin: u32, quads: usize, error_at_60: f32) -> ImpostorKind {
        let sample = |height_px, error_px| ErrorSample {
            height_px,
            error_px,
        };
        ImpostorKind {
            kind,
            bin,
            sizes: vec![[0.4, 1.0 / quads as f32]; quads],
            length: 1.0,
            errors: vec![
                sample(6.0, 0.0),
                sample(30.0, 0.0),
                sample(60.0, error_at_60),
            ],
        }
    }

    /// Numbers like a CPU driver's, so that what is asked here does not go by the latest measurement.
    const COSTS: CostModel = CostModel {
        mesh: 400.0,
        triangle: 75.0,
        impostor: 650.0,
        quad: 490.0,
        quad_pixel: 11.3,
        relief_pixel: 14.0,
        pixel_block: 4.0,
    };

    #[test]
    fn an_error_in_a_crowd_counts_more_for_who_is_long() {
        let high = kind(Kind::Quad, QUAD_BIN, 1, 1.0);
        let long = ImpostorKind {
            length: 2.0,
            ..high.clone()
        };
        let [high, long] = [high, long].map(|k| k.error(60.0).expect("it was measured"));
        assert!(high < long && long < 1.0, "{high} {long}");
    }

    /// What is drawn at a height: the bin of the first range that reaches so far.
    fn drawn(who: &Representations, height_px: f32) -> u32 {
        let ranges = who.ranges(Method::Hybrid, 1.0, &COSTS);
        let units = who.height / height_px;
        let range = ranges.iter().find(|r| units < r.units_end);
        range.expect("the last range has no end").bin
    }

    /// As a fox's: mesh and quad are the cheaper one by turns, at 7.5 pixels for a step, and at the far end a quad costs three times as much.
    #[test]
    fn the_ranges_that_matter_least_are_given_up() {
        let who = Representations {
            height: 1.0,
            length: 2.0,
            levels: vec![
                (0.0, 500.0),
                (0.11, 32.0),
                (0.122, 37.0),
                (0.14, 17.0),
                (0.2, 4.0),
            ],
            kinds: vec![ImpostorKind {
                sizes: vec![[1.3, 0.85]],
                ..kind(Kind::Quad, QUAD_BIN, 1, 4.0)
            }],
        };
        let mesh_is_cheaper = [60.0, 20.0, 8.7, 7.5, 5.0].map(|px| {
            let quad = &who.kinds[0];
            let allowed = quad.error(px).is_some_and(|e| e <= 1.0);
            !allowed || who.mesh_cost(&COSTS, px, 1.0) < quad.cost(&COSTS, px)
        });
        assert_eq!(mesh_is_cheaper, [true, false, true, false, true]);
        assert_eq!(drawn(&who, 60.0), BIN_NONE);
        assert_eq!(drawn(&who, 20.0), QUAD_BIN);
        for height_px in [5.0, 3.0, 1.0] {
            assert_eq!(drawn(&who, height_px), BIN_NONE, "{height_px} px");
        }
    }

    #[test]
    fn nobody_vanishes_however_far() {
        let mut who = Representations {
            height: 1.7,
            length: 1.7,
            levels: vec![(0.0, 5000.0), (0.05, 600.0), (0.2, 8.0), (1.0, 0.0)],
            kinds: vec![kind(Kind::Quad, QUAD_BIN, 1, 4.0)],
        };
        assert_eq!(drawn(&who, 200.0), BIN_NONE);
        assert_eq!(drawn(&who, 20.0), QUAD_BIN);
        assert_eq!(drawn(&who, 6.0), BIN_NONE, "eight triangles are cheaper");
        assert_eq!(drawn(&who, 1.0), QUAD_BIN, "none would be cheaper still");
        // Five ranges are one too many: the small meshes give theirs up.
        who.kinds.push(kind(Kind::Flat, FLAT_BIN, 10, 0.3));
        assert_eq!(drawn(&who, 80.0), FLAT_BIN);
        for height_px in [20.0, 6.0, 1.0] {
            assert_eq!(drawn(&who, height_px), QUAD_BIN, "{height_px} px");
        }
        // Without impostors the mesh is all there is.
        who.kinds.clear();
        assert_eq!(drawn(&who, 1.0), BIN_NONE);
    }
}
