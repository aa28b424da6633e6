//! The capture stage against its twin, and the comparison against corrupted pictures.

mod common;

use common::{assert_silent, baked_mascot, headless, real_character};
use glam::{Vec2, Vec3};
use throng::bake::baked::Baked;
use throng::bake::impostor::capture::{CaptureBatch, CaptureView, CapturedView};
use throng::reference::capture::capture;

/// Pixels whose coverage may differ: samples that lie on an edge.
const COVERAGE_SHARE: f64 = 0.002;
/// Pixels that both cover and whose weight, depth, normal or colour may be further off than a step of rounding allows:
/// samples near edges, where another triangle is in front.
const PIXEL_SHARE: f64 = 0.002;
/// Steps of 255 by which weights and depths may differ.
const DEPTH_STEPS: u8 = 1;
/// Steps by which normals and colours may differ; drivers filter textures in 8 bits.
const NORMAL_STEPS: u8 = 2;
const COLOR_STEPS: u8 = 4;

/// How a picture differs from its twin's, as shares of the pixels that either covers.
#[derive(Debug, Default)]
struct Difference {
    coverage: f64,
    weight: f64,
    color: f64,
    normal: f64,
    part: f64,
    depth: f64,
}

impl Difference {
    fn of(device: &[CapturedView], twin: &[CapturedView]) -> Self {
        let (mut d, mut pixels) = (Self::default(), 0.0f64);
        assert_eq!(device.len(), twin.len());
        for (a, b) in device.iter().zip(twin) {
            assert_eq!(
                (a.color.len(), a.surface.len()),
                (b.color.len(), b.surface.len())
            );
            let surfaces = a.surface.iter().zip(&b.surface);
            for ((ca, cb), (sa, sb)) in a.color.iter().zip(&b.color).zip(surfaces) {
                if ca[3] == 0 && cb[3] == 0 {
                    assert_eq!((sa, sb), (&[0; 4], &[0; 4]), "an empty pixel has a surface");
                    continue;
                }
                pixels += 1.0;
                if (ca[3] == 0) != (cb[3] == 0) {
                    d.coverage += 1.0;
                    continue;
                }
                let off = |a: &[u8], b: &[u8], steps: u8| {
                    f64::from(a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > steps))
                };
                d.weight += off(&ca[3..], &cb[3..], DEPTH_STEPS);
                d.color += off(&ca[..3], &cb[..3], COLOR_STEPS);
                d.normal += off(&sa[..2], &sb[..2], NORMAL_STEPS);
                d.part += off(&sa[2..3], &sb[2..3], 0);
                d.depth += off(&sa[3..], &sb[3..], DEPTH_STEPS);
            }
        }
        assert!(pixels > 1000.0, "the pictures show nothing");
        for share in [
            &mut d.coverage,
            &mut d.weight,
            &mut d.color,
            &mut d.normal,
            &mut d.part,
            &mut d.depth,
        ] {
            *share /= pixels;
        }
        d
    }

    /// On Mesa's lavapipe; other drivers round corners and interpolants otherwise, so they get `slack` times as much.
    fn is_small(&self, slack: f64) -> bool {
        let worst = [self.weight, self.color, self.normal, self.part, self.depth];
        self.coverage <= slack * COVERAGE_SHARE && worst.iter().all(|&s| s <= slack * PIXEL_SHARE)
    }
}

/// Poses of all clips, every joint in one of three groups, and pictures from all sides of the whole and of each group.
fn batch(baked: &Baked, error: f32) -> CaptureBatch {
    let joint_count = baked.joints.len();
    let mut poses = Vec::new();
    let mut views = Vec::new();
    for (i, clip) in baked.clips.iter().take(3).enumerate() {
        let frame = clip.first_frame + clip.frame_count / 3;
        poses.extend_from_slice(&baked.palette[frame as usize * joint_count..][..joint_count]);
        let radius = clip.sphere_radius;
        for (k, group) in [None, Some(0), Some(1), Some(2)].into_iter().enumerate() {
            for turn in 0..3 {
                let angle = (turn * 4 + k) as f32 * 1.1 + i as f32;
                let tilt = [0.0f32, 0.6, -0.9][turn];
                let to_eye = Vec3::new(
                    angle.cos() * tilt.cos(),
                    tilt.sin(),
                    angle.sin() * tilt.cos(),
                );
                let right = Vec3::Y.cross(to_eye).normalize();
                // The last look at a part of the character only: its picture's edges cut.
                let reach = radius * [1.0, 1.0, 0.4][turn];
                views.push(CaptureView {
                    pose: i as u32,
                    group,
                    center: clip.sphere_center,
                    right,
                    up: to_eye.cross(right),
                    min: Vec2::new(-reach, -reach * 0.9),
                    max: Vec2::new(reach, reach),
                    depth_extent: radius,
                    size: [96 + 8 * turn as u32, 120],
                });
            }
        }
    }
    CaptureBatch {
        poses,
        groups: (0..joint_count).map(|j| (j % 3) as u8).collect(),
        error,
        views,
    }
}

fn compare(name: &str, baked: &Baked) {
    let mut headless = headless([16, 16]);
    let slack = match headless.driver().contains("llvmpipe") {
        true => 1.0,
        false => 8.0,
    };
    let mut capturer = headless.capturer(baked).expect("it uploads");
    for error in [0.0, baked.error_max * 0.02] {
        let batch = batch(baked, error);
        let pictures = capturer.capture(&batch).expect("pictures");
        let twins: Vec<CapturedView> = batch
            .views
            .iter()
            .map(|v| capture(baked, &batch, v))
            .collect();
        if let Some(folder) = std::env::var_os("THRONG_SHOW") {
            let folder = std::path::PathBuf::from(folder);
            sheet(
                &folder.join(format!("{name}_device.png")),
                &batch,
                &pictures,
            );
            sheet(&folder.join(format!("{name}_twin.png")), &batch, &twins);
        }
        let difference = Difference::of(&pictures, &twins);
        println!("{name} at an error of {error}: {difference:?}");
        assert!(difference.is_small(slack), "{name}: {difference:?}");
    }
    drop(capturer);
    assert_silent(&headless);
}

/// Colours above surfaces, for people.
fn sheet(path: &std::path::Path, batch: &CaptureBatch, pictures: &[CapturedView]) {
    let (w, h) = (112, 120);
    let mut out = image::RgbaImage::new(w * pictures.len() as u32, 3 * h);
    for (i, (view, p)) in batch.views.iter().zip(pictures).enumerate() {
        for (k, (c, s)) in p.color.iter().zip(&p.surface).enumerate() {
            let x = i as u32 * w + k as u32 % view.size[0];
            let y = k as u32 / view.size[0];
            out.put_pixel(x, y, image::Rgba([c[0], c[1], c[2], 255]));
            out.put_pixel(x, y + h, image::Rgba([s[0], s[1], s[2], 255]));
            out.put_pixel(x, y + 2 * h, image::Rgba([s[3], c[3], c[3], 255]));
        }
    }
    out.save(path).expect("a picture is written");
}

#[test]
fn a_textured_see_through_and_two_sided_character() {
    compare("mascot", &baked_mascot());
}

#[test]
fn a_built_in_character() {
    let character = throng::bake::people::build("woman_dress").expect("built in");
    let (baked, _) = throng::bake::bake::bake(&character, &Default::default(), &mut |_| {})
        .expect("a built-in character bakes");
    compare("woman_dress", &baked);
}

#[test]
fn a_real_textured_character() {
    if let Some(baked) = real_character("glb/horse_textured.glb") {
        compare("horse", &baked);
    }
}

#[test]
fn corrupted_pictures_are_found() {
    let baked = baked_mascot();
    let batch = batch(&baked, 0.0);
    let good: Vec<CapturedView> = batch
        .views
        .iter()
        .map(|v| capture(&baked, &batch, v))
        .collect();
    assert!(Difference::of(&good, &good).is_small(1.0));
    type Change<'a> = &'a dyn Fn(&mut CapturedView);
    let corrupt = |what: &str, change: Change| {
        let mut bad = good.clone();
        bad.iter_mut().for_each(change);
        assert!(!Difference::of(&bad, &good).is_small(8.0), "{what}");
    };
    corrupt("turned over", &|v| {
        v.color.reverse();
        v.surface.reverse();
    });
    corrupt("a pixel to the side", &|v| {
        v.color.rotate_right(1);
        v.surface.rotate_right(1);
    });
    let covered = |v: &mut CapturedView, change: &dyn Fn(&mut [u8; 4], &mut [u8; 4])| {
        for (c, s) in v.color.iter_mut().zip(&mut v.surface) {
            if c[3] > 0 {
                change(c, s);
            }
        }
    };
    corrupt("less weight", &|v| {
        covered(v, &|c, _| c[3] = (c[3] - 1) / 2 + 1)
    });
    corrupt("red and blue exchanged", &|v| {
        covered(v, &|c, _| c.swap(0, 2))
    });
    corrupt("normals turned over", &|v| {
        covered(v, &|_, s| s[1] = (256 - s[1] as u32).min(255) as u8)
    });
    corrupt("far for near", &|v| covered(v, &|_, s| s[3] = 255 - s[3]));
    corrupt("another body part", &|v| covered(v, &|_, s| s[2] ^= 1));
    // One picture taken for another.
    let mut bad = good.clone();
    bad.swap(0, 1);
    bad[0].color.resize(good[0].color.len(), [0; 4]);
    bad[0].surface.resize(good[0].surface.len(), [0; 4]);
    bad[1].color.resize(good[1].color.len(), [0; 4]);
    bad[1].surface.resize(good[1].surface.len(), [0; 4]);
    assert!(!Difference::of(&bad, &good).is_small(8.0));
}

#[test]
fn batches_that_make_no_sense_are_refused() {
    let baked = baked_mascot();
    let mut headless = headless([16, 16]);
    let mut capturer = headless.capturer(&baked).expect("it uploads");
    let good = batch(&baked, 0.0);
    let mut refuse = |change: &dyn Fn(&mut CaptureBatch), says: &str| {
        let mut bad = good.clone();
        change(&mut bad);
        let e = capturer.capture(&bad).expect_err(says).to_string();
        assert!(e.contains(says), "{e}");
    };
    refuse(&|b| b.groups.truncate(1), "groups");
    refuse(&|b| b.poses.truncate(1), "poses");
    refuse(&|b| b.poses[0].rows[0][0] = f32::NAN, "finite");
    refuse(&|b| b.error = -1.0, "error");
    refuse(&|b| b.views[3].pose = 1000, "view 3");
    // And the capturer is as before; a batch without views has no pictures.
    assert_eq!(
        capturer.capture(&good).expect("pictures").len(),
        good.views.len()
    );
    let none = CaptureBatch {
        views: Vec::new(),
        ..good.clone()
    };
    assert_eq!(capturer.capture(&none).expect("none").len(), 0);
    drop(capturer);
    assert_silent(&headless);
}

/// Prints how fast pictures are taken: `cargo test --release --test capture -- --ignored --nocapture`.
#[test]
#[ignore = "takes seconds and only prints"]
fn how_long_ten_thousand_pictures_take() {
    let mut characters = vec![("mascot", baked_mascot())];
    for name in ["glb/ped_man_suit.glb", "glb/horse_textured.glb"] {
        characters.extend(real_character(name).map(|b| (name, b)));
    }
    for (name, baked) in &characters {
        let mut headless = headless([16, 16]);
        let mut capturer = headless.capturer(baked).expect("it uploads");
        for error in [0.0, baked.clips[0].sphere_radius / 60.0] {
            let mut batch = batch(baked, error);
            let few = batch.views.clone();
            batch.views = few.iter().cycle().take(10_000).copied().collect();
            for view in &mut batch.views {
                view.size = [64, 64];
            }
            let start = std::time::Instant::now();
            let pictures = capturer.capture(&batch).expect("pictures");
            println!(
                "{name} at {error}: {} pictures in {:?}",
                pictures.len(),
                start.elapsed()
            );
        }
    }
}
