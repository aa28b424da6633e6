//! Builds all impostors of a character from pictures that a renderer takes.

use super::capture::Capture;
use super::groups::Groups;
use super::picture::Picture;
use super::plan::{Plan, height, plan_flat, plan_quad};
use super::pose::Skin;
use super::{Impostors, Kind, KindInfo, Quad, lean, pack, take};
use crate::baked::Baked;

/// Bytes of a texel of the atlas.
const TEXEL_BYTES: u64 = 8;
/// Share of the memory limit that is planned for: packing wastes some.
const PLANNED_SHARE: f64 = 0.94;
/// What `Flat` may exceed its share by once it has been captured: better than the time to take it again.
const FLAT_EXCESS: f64 = 1.25;
/// Share of what is left for `Quad` from which on its pictures are not taken again, more of them. Those are kept where they fit.
const QUAD_FILLED: f64 = 0.96;
/// The share that is planned for then.
const QUAD_AIM: f64 = 0.985;
/// The most that a plan may exceed the limit by, because pictures turn out smaller.
const QUAD_MORE: f64 = 1.15;
/// Share of the time that `Flat` takes of both, for progress.
const FLAT_TIME: f32 = 0.75;
/// Coarser texels than this are not tried.
const COARSEST: f32 = 16.0;
/// Share of the memory that `Flat` may take where `Quad` is captured, too: it has few pictures, and at a pixel of error most of
/// a hybrid crowd of characters that have both is `Quad`. With a half more it was off by 3 to 15 percent less, and `Quad` by up
/// to half a pixel more at 30 pixels of height.
const FLAT_SHARE: f64 = 0.15;

/// What a build of impostors may be told.
#[derive(Debug, Clone, PartialEq)]
pub struct ImpostorOptions {
    /// What to capture.
    pub kinds: Vec<Kind>,
    /// Cuts of the icosahedron's edges for `Flat`: `10 cuts^2 + 2` views.
    pub body_view_cuts: u32,
    /// The same for heads.
    pub head_view_cuts: u32,
    /// The same for `Quad`.
    pub quad_view_cuts: u32,
    /// `Quad` is not captured from below this height on the unit sphere of directions.
    pub quad_lowest_y: f32,
    /// Texels of `Flat` along the character's height.
    pub texels_per_height: f32,
    /// Finer texels for heads by this factor.
    pub head_boost: f32,
    /// Most texels of `Quad` along the character's height.
    pub quad_texels_per_height: f32,
    /// Most poses of a clip for `Quad`.
    pub quad_poses_per_clip: u32,
    /// Most bytes of the atlas, all kinds and mips, before it is compressed.
    pub memory_limit_bytes: u64,
    /// Poses that decide what a group shows beyond its own surface; 0 for weights alone.
    pub mask_samples: u32,
    /// Samples of a texel along each axis.
    pub supersample: u32,
    /// Mips of the atlas.
    pub mip_count: u32,
    /// The atlas is kept in blocks, at a quarter of the bytes that `memory_limit_bytes` is about.
    pub compress: bool,
}

impl Default for ImpostorOptions {
    fn default() -> Self {
        Self {
            kinds: vec![Kind::Flat, Kind::Quad],
            body_view_cuts: 3,
            head_view_cuts: 4,
            quad_view_cuts: 3,
            quad_lowest_y: -0.15,
            texels_per_height: 64.0,
            head_boost: 1.5,
            quad_texels_per_height: 40.0,
            quad_poses_per_clip: 16,
            memory_limit_bytes: 16_000_000,
            mask_samples: 6,
            supersample: 4,
            mip_count: 2,
            compress: false,
        }
    }
}

impl ImpostorOptions {
    /// Empty texels on each side of a tile: two tiles' contents are a texel apart in the coarsest mip.
    pub(super) fn margin(&self) -> u32 {
        ((1 << (self.mip_count - 1)) / 2).max(1)
    }

    /// Tiles' places and sizes are multiples of this.
    pub(super) fn multiple(&self) -> u32 {
        1 << (self.mip_count - 1)
    }

    /// Bytes of all mips for each texel of the first.
    fn bytes_per_texel(&self) -> f64 {
        (0..self.mip_count)
            .map(|m| TEXEL_BYTES as f64 / f64::from(1u32 << (2 * m)))
            .sum()
    }

    /// The first number that makes no sense.
    fn check(&self) -> Result<(), &'static str> {
        let in_range = |ok: bool, reason| if ok { Ok(()) } else { Err(reason) };
        let cuts = [
            self.body_view_cuts,
            self.head_view_cuts,
            self.quad_view_cuts,
        ];
        in_range(
            cuts.iter().all(|c| (1..=8).contains(c)),
            "view cuts are not from 1 to 8",
        )?;
        let texels = [self.texels_per_height, self.quad_texels_per_height];
        in_range(
            texels.iter().all(|t| (4.0..=1024.0).contains(t)),
            "texels per height are not from 4 to 1024",
        )?;
        in_range(
            (1.0..=8.0).contains(&self.head_boost),
            "the head's boost is not from 1 to 8",
        )?;
        in_range(
            (1..=256).contains(&self.quad_poses_per_clip),
            "poses per clip are not from 1 to 256",
        )?;
        in_range(
            (1..=8).contains(&self.supersample),
            "samples along a texel are not from 1 to 8",
        )?;
        in_range(
            (1..=6).contains(&self.mip_count),
            "mips are not from 1 to 6",
        )?;
        in_range(
            self.quad_lowest_y.is_finite(),
            "the lowest view is no number",
        )
    }
}

/// Why impostors could not be built.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError<E> {
    /// The renderer failed.
    #[error(transparent)]
    Capture(E),
    /// The renderer's answer does not fit the question: a fault of the renderer.
    #[error("captured picture {picture}: {reason}")]
    Answer {
        /// Number of the picture in its batch.
        picture: usize,
        /// What is wrong with it.
        reason: &'static str,
    },
    /// An option is out of its range.
    #[error("impostor options: {0}")]
    Options(&'static str),
    /// The pictures do not fit an atlas, however small.
    #[error("the pictures fit no atlas of {bytes} bytes")]
    TooLarge {
        /// The memory limit.
        bytes: u64,
    },
}

/// Built impostors, and what the user should know of them.
#[derive(Debug, Clone, PartialEq)]
pub struct Built {
    /// The impostors.
    pub impostors: Impostors,
    /// What is coarser than asked for, one sentence each.
    pub warnings: Vec<String>,
}

/// Builds the impostors of `baked`, which is valid. `progress` hears the share of the work done, up to 1; it
/// stands still where pictures turn out too large, or smaller than there is room for, and are taken again. The same
/// character, options and pictures give the same bytes.
///
/// Errors: [`BuildError::Capture`] with what `capture` says; the others are for options and faults of the renderer.
pub fn build<E>(
    baked: &Baked,
    groups: &Groups,
    options: &ImpostorOptions,
    capture: &mut Capture<E>,
    progress: &mut dyn FnMut(f32),
) -> Result<Built, BuildError<E>> {
    options.check().map_err(BuildError::Options)?;
    let mut furthest = 0.0f32;
    let progress = &mut |share: f32| {
        furthest = furthest.max(share);
        progress(furthest);
    };
    let mut out = Impostors::default();
    let mut warnings = Vec::new();
    let mut pictures = Vec::new();
    let skins = Skin::of(baked);
    let has = |kind| options.kinds.contains(&kind);
    let texel_limit = options.memory_limit_bytes as f64 / options.bytes_per_texel() * PLANNED_SHARE;
    let height = height(baked, &skins);
    let flat_time = if has(Kind::Quad) { FLAT_TIME } else { 1.0 };
    if has(Kind::Flat) {
        let limit = texel_limit * if has(Kind::Quad) { FLAT_SHARE } else { 1.0 };
        let mut coarser = 1.0;
        let plan = loop {
            let plan = plan_flat(baked, groups, options, height, coarser);
            if plan.expected_texels as f64 > limit && coarser < COARSEST {
                coarser *= 1.05;
                continue;
            }
            let mut heard = |share: f32| progress(share * flat_time);
            pictures = take::take(baked, groups, options, &plan, capture, &mut heard)?;
            let texels = tile_texels(&pictures) as f64;
            if texels <= (FLAT_EXCESS * limit).min(texel_limit) || coarser >= COARSEST {
                break plan;
            }
            coarser *= ((texels / limit).sqrt() as f32).max(1.05);
        };
        if coarser > 1.0 {
            warnings.push(format!(
                "flat impostors have {:.0} texels along the height, not {:.0}: more would exceed the memory limit",
                options.texels_per_height / coarser,
                options.texels_per_height
            ));
        }
        out.push(Kind::Flat, plan, 0);
    }
    if has(Kind::Quad) {
        let limit = (texel_limit as u64).saturating_sub(tile_texels(&pictures));
        let from = if has(Kind::Flat) { flat_time } else { 0.0 };
        let mut take_quads = |texel_limit: u64| {
            let mut said = Vec::new();
            let plan = plan_quad(baked, &skins, options, height, texel_limit, &mut said);
            let mut heard = |share: f32| progress(from + share * (1.0 - from));
            let taken = take::take(baked, groups, options, &plan, capture, &mut heard)?;
            Ok((plan, taken, said))
        };
        let (mut plan, mut taken, mut said) = take_quads(limit)?;
        // Pictures turn out smaller than their bodies' bounds, some by a tenth: then more of them fit.
        let share = tile_texels(&taken) as f64 / (limit as f64).max(1.0);
        if !said.is_empty() && share < QUAD_FILLED {
            let more = take_quads((limit as f64 * (QUAD_AIM / share).min(QUAD_MORE)) as u64)?;
            if tile_texels(&more.1) <= limit {
                (plan, taken, said) = more;
            }
        }
        warnings.append(&mut said);
        let first_tile = pictures.len() as u32;
        pictures.extend(taken);
        out.push(Kind::Quad, plan, first_tile);
    }
    let too_large = BuildError::TooLarge {
        bytes: options.memory_limit_bytes,
    };
    let Some((tiles, atlas)) = pack::pack(&pictures, options.mip_count) else {
        return Err(too_large);
    };
    (out.tiles, out.atlas) = (tiles, atlas);
    lean::lean_tiles(&mut out, &pictures);
    if out.atlas.size_bytes() > options.memory_limit_bytes {
        return Err(too_large);
    }
    if options.compress {
        out.atlas.compress();
    }
    progress(1.0);
    Ok(Built {
        impostors: out,
        warnings,
    })
}

/// Texels of the finest mip.
fn tile_texels(pictures: &[Picture]) -> u64 {
    let texels = |p: &Picture| u64::from(p.size.x) * u64::from(p.size.y);
    pictures.iter().map(texels).sum()
}

impl Impostors {
    /// Appends what was planned for a kind, whose tiles begin at `first_tile`.
    fn push(&mut self, kind: Kind, plan: Plan, first_tile: u32) {
        let first_set = self.view_sets.len() as u32;
        self.kinds.push(KindInfo {
            kind,
            first_quad: self.quads.len() as u32,
            quad_count: plan.quads.len() as u32,
            errors: Vec::new(),
        });
        self.quads.extend(plan.quads.into_iter().map(|q| Quad {
            first_tile: q.first_tile + first_tile,
            view_set: q.view_set + first_set,
            ..q
        }));
        self.view_sets.extend(plan.view_sets);
        self.clip_poses.extend(plan.clip_poses);
    }
}
