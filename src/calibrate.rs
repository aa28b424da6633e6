//! Error curves of impostors: how far each kind is from the character, measured by drawing it beside the mesh.
//!
//! The unit is that of levels of detail, so that one pixel error means the same for every representation. A sheet of agents
//! in many poses, headings and camera pitches is drawn at a number of heights: many-sampled in fine detail (the reference),
//! as meshes of rising pixel error, and as each kind. A kind's error at a height is the pixel error of the mesh that is as
//! far from the reference as the kind is; 0 where the kind is nearer than the finest mesh, which is drawn with one sample
//! per pixel while impostors are averaged beforehand.

use glam::{Vec2, Vec3};
use rayon::prelude::*;
use throng_bake::baked::Baked;
use throng_bake::impostor::{ErrorSample, Kind};
use throng_bake::texture::linear_from_srgb;

use crate::error::RenderError;
use crate::frame::{CharacterId, FrameOptions, Method};
use crate::gpu::Headless;
use crate::sheet::{Sheet, SheetDesc, bounds_height};

/// Projected heights that are measured, pixels.
const HEIGHTS_PX: [f32; 9] = [6.0, 9.0, 13.0, 20.0, 30.0, 45.0, 64.0, 96.0, 128.0];
/// Pixel errors of the meshes that kinds are compared with.
const PIXEL_ERRORS: [f32; 8] = [0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0];
/// Camera pitches, radians above the horizon: on a street, on a balcony, on a roof.
const PITCHES: [f32; 3] = [0.05, 0.4, 0.9];
/// Samples per pixel of the reference along each side.
const SUPERSAMPLE: u32 = 4;
/// Level of detail of the reference, in its samples: at a sixteenth of a pixel curves come out as with full detail.
const REFERENCE_ERROR: f32 = 0.25;
/// Agents of a sheet, and the pixels that it may take; tall agents are fewer.
const SHEET_AGENTS: f32 = 160.0;
const SHEET_PIXELS: f32 = 100_000.0;
/// Measures the error curve of every kind of the character's impostors, in their order.
///
/// Leaves the character in `headless` and another size of its target. `progress` hears the share done, rising to 1.
/// Errors: those of [`Headless::add_character`], [`Headless::resize`] and [`Headless::render`].
pub fn error_curves(
    headless: &mut Headless,
    baked: &Baked,
    progress: &mut dyn FnMut(f32),
) -> Result<Vec<Vec<ErrorSample>>, RenderError> {
    let kinds: Vec<Kind> = baked
        .impostors
        .iter()
        .flat_map(|i| i.kinds.iter().map(|k| k.kind))
        .collect();
    let character = headless.add_character(baked)?;
    let mut curves = vec![Vec::new(); kinds.len()];
    for (i, &height_px) in HEIGHTS_PX.iter().enumerate() {
        progress(i as f32 / HEIGHTS_PX.len() as f32);
        let sheets = PITCHES.map(|pitch| sheet_of(baked, character, height_px, pitch));
        let differences = differences(headless, &sheets, &kinds)?;
        let (meshes, impostors) = differences.split_at(PIXEL_ERRORS.len());
        for (curve, &difference) in curves.iter_mut().zip(impostors) {
            curve.push(ErrorSample {
                height_px,
                error_px: equal_error(meshes, difference),
            });
        }
    }
    progress(1.0);
    curves.iter_mut().for_each(|c| rise(c));
    Ok(curves)
}

/// The nearest curve that never falls: texels and view cells are as coarse at every height, so a fall is noise. Pools
/// adjacent violators.
fn rise(curve: &mut [ErrorSample]) {
    // Sum and number of errors that became one.
    let mut pools: Vec<(f32, usize)> = Vec::new();
    for sample in curve.iter() {
        let mut last = (sample.error_px, 1);
        while let Some(&(sum, count)) = pools.last()
            && sum / count as f32 > last.0 / last.1 as f32
        {
            last = (last.0 + sum, last.1 + count);
            pools.pop();
        }
        pools.push(last);
    }
    let means = pools
        .iter()
        .flat_map(|&(sum, count)| std::iter::repeat_n(sum / count as f32, count));
    for (sample, mean) in curve.iter_mut().zip(means) {
        sample.error_px = mean;
    }
}

/// Mean distances from the reference: of the meshes by pixel error, then of the kinds.
fn differences(
    headless: &mut Headless,
    sheets: &[Sheet],
    kinds: &[Kind],
) -> Result<Vec<f64>, RenderError> {
    let methods: Vec<(Method, f32)> = PIXEL_ERRORS
        .iter()
        .map(|&e| (Method::Lod, e))
        .chain(kinds.iter().map(|k| (method_of(*k), 1.0)))
        .collect();
    let mut sums = vec![0.0; methods.len()];
    let references = draw_references(headless, sheets)?;
    for (sheet, reference) in sheets.iter().zip(&references) {
        headless.resize(sheet.size_px)?;
        for (sum, &(method, pixel_error)) in sums.iter_mut().zip(&methods) {
            let pixels = draw(headless, sheet, method, pixel_error, 1)?;
            *sum += reference.distance(&Seen::new(
                &linear(&pixels, sheet.size_px, 1),
                sheet.size_px,
            ));
        }
    }
    Ok(sums)
}

fn draw_references(headless: &mut Headless, sheets: &[Sheet]) -> Result<Vec<Seen>, RenderError> {
    let mut references = Vec::with_capacity(sheets.len());
    for sheet in sheets {
        headless.resize(sheet.size_px.map(|s| s * SUPERSAMPLE))?;
        let pixels = draw(headless, sheet, Method::Lod, REFERENCE_ERROR, SUPERSAMPLE)?;
        let averaged = linear(&pixels, sheet.size_px, SUPERSAMPLE);
        references.push(Seen::new(&averaged, sheet.size_px));
    }
    Ok(references)
}

fn method_of(kind: Kind) -> Method {
    match kind {
        Kind::Flat => Method::Flat,
        Kind::Quad => Method::Quad,
    }
}

/// The pixel error at which meshes are as far from the reference; between measured errors by their logarithms.
fn equal_error(meshes: &[f64], difference: f64) -> f32 {
    // Noise apart, a coarser mesh is never nearer.
    let mut worst = 0.0f64;
    let rising: Vec<f64> = meshes
        .iter()
        .map(|&d| {
            worst = worst.max(d);
            worst
        })
        .collect();
    let after = rising.partition_point(|&d| d < difference);
    if after == 0 {
        return 0.0;
    }
    if after == rising.len() {
        let beyond = (difference / worst.max(1e-12)) as f32;
        return PIXEL_ERRORS[after - 1] * beyond;
    }
    let (a, b) = (rising[after - 1], rising[after]);
    let t = ((difference - a) / (b - a).max(1e-12)) as f32;
    let (low, high) = (PIXEL_ERRORS[after - 1], PIXEL_ERRORS[after]);
    low * (high / low).powf(t)
}

/// The sheet of a height and a pitch: as many agents as its pixels allow, far enough apart for any pose.
fn sheet_of(baked: &Baked, character: CharacterId, height_px: f32, pitch: f32) -> Sheet {
    let radius = baked.clips.iter().map(|c| c.sphere_radius);
    let radius_px = radius.fold(1e-6, f32::max) * height_px / bounds_height(baked);
    let cell_px = (2.0 * radius_px).ceil() + 4.0;
    let count = (SHEET_PIXELS / (cell_px * cell_px)).clamp(6.0, SHEET_AGENTS);
    let columns = count.sqrt().ceil();
    let grid = [columns as u32, (count / columns) as u32];
    Sheet::new(
        baked,
        character,
        &SheetDesc {
            height_px,
            pitch,
            grid,
            cell_px: [cell_px; 2],
            size_px: grid.map(|n| n * cell_px as u32),
        },
    )
}

fn draw(
    headless: &mut Headless,
    sheet: &Sheet,
    method: Method,
    pixel_error: f32,
    supersample: u32,
) -> Result<Vec<[u8; 4]>, RenderError> {
    let options = FrameOptions {
        method,
        pixel_error,
        ground: false,
        shadows: false,
        sky: false,
        occlusion: false,
        ..FrameOptions::default()
    };
    headless.render(&sheet.agents, &sheet.view(supersample), &options)?;
    headless.read_image()
}

/// Linear colours, means of squares of `factor` pixels. Shapes: `pixels` [factor * height][factor * width].
fn linear(pixels: &[[u8; 4]], size_px: [u32; 2], factor: u32) -> Vec<Vec3> {
    let table: Vec<f32> = (0..=255).map(linear_from_srgb).collect();
    let value = |p: &[u8; 4]| Vec3::from([p[0], p[1], p[2]].map(|byte| table[byte as usize]));
    let [width, height] = size_px.map(|s| s as usize);
    let n = factor as usize;
    let mut out = vec![Vec3::ZERO; width * height];
    let rows = out
        .par_chunks_mut(width)
        .zip(pixels.par_chunks(n * n * width));
    rows.for_each(|(out, samples)| {
        for row in samples.chunks_exact(n * width) {
            for (out, samples) in out.iter_mut().zip(row.chunks_exact(n)) {
                *out += samples.iter().map(value).sum::<Vec3>();
            }
        }
        for out in out {
            *out /= (n * n) as f32;
        }
    });
    out
}

/// A picture as somebody sees it: blurred as far as the eye blurs single pixels, evenly spaced in lightness.
struct Seen {
    pixels: Vec<Vec3>,
}

impl Seen {
    fn new(linear: &[Vec3], size_px: [u32; 2]) -> Self {
        let [width, height] = size_px.map(|s| s as usize);
        // Binomial, a standard deviation of one pixel: the eye's at 67 pixels per degree (Andersson et al. 2020, FLIP).
        const WEIGHTS: [f32; 5] = [1.0 / 16.0, 4.0 / 16.0, 6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0];
        let near = |at: usize, length: usize| {
            let places = WEIGHTS.iter().enumerate();
            places.map(move |(k, &w)| ((at + k).saturating_sub(2).min(length - 1), w))
        };
        let mut blurred = vec![Vec3::ZERO; linear.len()];
        let rows = blurred.par_chunks_mut(width).zip(linear.par_chunks(width));
        rows.for_each(|(out, row)| {
            for (x, out) in out.iter_mut().enumerate() {
                *out = near(x, width).map(|(x, w)| w * row[x]).sum();
            }
        });
        let mut pixels = vec![Vec3::ZERO; linear.len()];
        let rows = pixels.par_chunks_mut(width).enumerate();
        rows.for_each(|(y, out)| {
            for (y, w) in near(y, height) {
                for (out, &p) in out.iter_mut().zip(&blurred[y * width..][..width]) {
                    *out += w * p;
                }
            }
            for out in out {
                *out = opponent(*out);
            }
        });
        Self { pixels }
    }

    /// Mean distance of two pictures of one size.
    fn distance(&self, other: &Self) -> f64 {
        /// Pixels that are summed in order, so that the sum does not depend on threads.
        const CHUNK: usize = 4096;
        let pairs = self.pixels.par_chunks(CHUNK);
        let sums: Vec<f64> = pairs
            .zip(other.pixels.par_chunks(CHUNK))
            .map(|(a, b)| a.iter().zip(b).map(|(a, b)| difference(*a, *b)).sum())
            .collect();
        let sum: f64 = sums.iter().sum();
        sum / self.pixels.len().max(1) as f64
    }
}

/// Lightness and colour add up (HyAB), and small differences count for more than their size.
fn difference(a: Vec3, b: Vec3) -> f64 {
    let d = a - b;
    f64::from((d.x.abs() + Vec2::new(d.y, d.z).length()).powf(0.7))
}

/// Lightness, red against green, yellow against blue, on a square-root scale.
fn opponent(linear: Vec3) -> Vec3 {
    let c = Vec3::from(linear.max(Vec3::ZERO).to_array().map(f32::sqrt));
    Vec3::new(
        c.dot(Vec3::new(0.25, 0.65, 0.1)),
        0.5 * (c.x - c.y),
        0.3 * (0.5 * (c.x + c.y) - c.z),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// However flat somebody is: a carpet's sheets are as large as those of somebody who lies down.
    #[test]
    fn sheets_of_flat_characters_are_no_larger_than_a_device_can_draw() {
        use throng_bake::baked::BakedClip;
        for thickness in [0.0, 0.005, 0.3, 2.0] {
            let half = Vec3::new(1.0, 0.5 * thickness, 1.0);
            let baked = Baked {
                clips: vec![BakedClip {
                    name: "lie".into(),
                    first_frame: 0,
                    frame_count: 1,
                    duration_s: 0.0,
                    ground_speed: 0.0,
                    box_min: -half,
                    box_max: half,
                    sphere_center: Vec3::ZERO,
                    sphere_radius: half.length(),
                    ground: -half.y,
                }],
                ..Baked::default()
            };
            for height_px in HEIGHTS_PX {
                let [width, height] = sheet_of(&baked, CharacterId(0), height_px, 0.4).size_px;
                let samples = [width, height].map(|s| s * SUPERSAMPLE);
                assert!(
                    samples[0].max(samples[1]) <= 8192,
                    "{thickness}: {samples:?}"
                );
                assert!(width * height <= 1_300_000, "{thickness}: {width}x{height}");
            }
        }
    }

    #[test]
    fn equal_errors_lie_between_the_measured_ones() {
        let meshes = [1.0, 2.0, 3.0, 5.0, 4.0, 6.0, 7.0, 8.0];
        assert_eq!(equal_error(&meshes, 0.5), 0.0);
        assert_eq!(equal_error(&meshes, 2.0), 0.5);
        assert!((equal_error(&meshes, 2.5) - 0.5f32.sqrt()).abs() < 1e-6);
        // The dip at 4 pixels is noise.
        assert_eq!(equal_error(&meshes, 5.0), 2.0);
        assert_eq!(equal_error(&meshes, 16.0), 64.0);
    }

    #[test]
    fn curves_rise_and_keep_their_mean() {
        let errors = [0.0, 2.0, 1.0, 3.0, 2.0, 1.0, 5.0];
        let mut curve = errors.map(|error_px| ErrorSample {
            height_px: 0.0,
            error_px,
        });
        rise(&mut curve);
        let risen = curve.map(|s| s.error_px);
        assert_eq!(risen, [0.0, 1.5, 1.5, 2.0, 2.0, 2.0, 5.0]);
    }

    #[test]
    fn a_picture_is_no_distance_from_itself_and_further_the_more_it_is_off() {
        let size = [16, 12];
        let flat = vec![Vec3::splat(0.5); 16 * 12];
        let mut dot = flat.clone();
        dot[100] = Vec3::ZERO;
        let mut square = dot.clone();
        square[101] = Vec3::ZERO;
        square[117] = Vec3::ZERO;
        let [flat, dot, square] = [flat, dot, square].map(|p| Seen::new(&p, size));
        assert_eq!(flat.distance(&flat), 0.0);
        assert!(flat.distance(&dot) > 0.0);
        assert!(flat.distance(&square) > 2.0 * flat.distance(&dot));
    }

    #[test]
    fn averages_are_of_squares_in_linear_light() {
        let (k, w) = ([0, 0, 0, 255], [255; 4]);
        #[rustfmt::skip]
        let pixels = [
            k, w, w, w,
            w, k, w, w,
        ];
        let expected = [Vec3::splat(0.5), Vec3::splat(1.0)];
        assert_eq!(linear(&pixels, [2, 1], 2), expected);
        assert_eq!(linear(&pixels, [4, 2], 1).len(), 8);
    }
}
