//! Whole frames: golden pictures, counts that must hold, and what is refused.

mod common;

use std::path::PathBuf;

use common::{
    assert_silent, baked_mascot, baked_mascot_with_impostors, crowd, headless, options, view,
};
use glam::Vec3;
use throng::gpu::{Headless, HeadlessDesc};
use throng::{Agent, CharacterId, FrameOptions, FrameReport, Method, RenderError, View};

const SIZE: [u32; 2] = [256, 256];

/// Pixels that differ by more than `tolerance` in some channel.
fn differing(a: &[[u8; 4]], b: &[[u8; 4]], tolerance: u8) -> usize {
    assert_eq!(a.len(), b.len());
    a.iter()
        .zip(b)
        .filter(|(a, b)| {
            a.iter()
                .zip(b.iter())
                .any(|(x, y)| x.abs_diff(*y) > tolerance)
        })
        .count()
}

/// The driver that drew the goldens. Others round otherwise: lavapipe of Mesa 25.0 differs by 1 of 255 in single pixels.
const GOLDEN_DRIVER: &str = "Mesa 22.3";

/// Compares the last frame with tests/golden/`name`.png: exactly on the driver that drew it; elsewhere at most 1 % of the
/// pixels may differ by more than 8 of 255.
fn check_golden(headless: &mut Headless, name: &str) {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("tests/golden")
        .join(format!("{name}.png"));
    let pixels = headless.read_image().expect("a picture");
    let bytes: &[u8] = bytemuck::cast_slice(&pixels);
    let kind = image::ColorType::Rgba8;
    if std::env::var("THRONG_BLESS").is_ok_and(|v| v == "1") {
        image::save_buffer(&path, bytes, SIZE[0], SIZE[1], kind).expect("the golden is written");
        return;
    }
    let golden = image::open(&path)
        .unwrap_or_else(|e| {
            panic!(
                "{}: {e}; look at the picture and bless it: THRONG_BLESS=1 cargo test --release --test frames",
                path.display()
            )
        })
        .into_rgba8();
    let golden: Vec<[u8; 4]> = bytemuck::pod_collect_to_vec(golden.as_raw());
    let (tolerance, allowed) = if headless.driver().contains(GOLDEN_DRIVER) {
        (0, 0)
    } else {
        (8, golden.len() / 100)
    };
    let differ = differing(&pixels, &golden, tolerance);
    if differ > allowed {
        let seen = std::env::temp_dir().join(format!("throng_{name}.png"));
        image::save_buffer(&seen, bytes, SIZE[0], SIZE[1], kind).expect("the picture is written");
        panic!(
            "{differ} pixels differ from {}; this picture: {}",
            path.display(),
            seen.display()
        );
    }
}

fn frame(headless: &mut Headless, agents: &[Agent], options: &FrameOptions) -> FrameReport {
    headless
        .render(agents, &view(SIZE), options)
        .expect("a frame")
}

/// Nothing but agents, and all of them.
fn bare(method: Method) -> FrameOptions {
    FrameOptions {
        ground: false,
        shadows: false,
        sky: false,
        occlusion: false,
        ..options(method)
    }
}

fn with_mascot() -> (Headless, CharacterId) {
    let mut headless = headless(SIZE);
    let id = headless.add_character(&baked_mascot()).expect("it uploads");
    (headless, id)
}

/// Three near mascots: from the front, the side and behind, bowing.
fn trio(id: CharacterId) -> Vec<Agent> {
    (0..3)
        .map(|i| Agent {
            position: Vec3::new(i as f32 * 1.5 - 1.5, 0.0, -4.0),
            heading: i as f32 * 1.7,
            character: id,
            phases: [0.2, 0.0],
            tint_seed: i,
            ..Default::default()
        })
        .collect()
}

#[test]
fn goldens() {
    goldens_with(headless(SIZE));
}

/// Where a device's texel buffers are small, shaders read records from storage buffers, and the pictures are the same.
#[test]
fn goldens_with_records_in_storage_buffers() {
    let desc = HeadlessDesc {
        size_px: SIZE,
        validation: true,
        storage_records: true,
        ..Default::default()
    };
    goldens_with(Headless::new(&desc).expect("a Vulkan device and the validation layer"));
}

fn goldens_with(mut headless: Headless) {
    let id = headless.add_character(&baked_mascot()).expect("it uploads");
    for (name, agents, method) in [
        ("near_full", trio(id), Method::Full),
        ("near_lod", trio(id), Method::Lod),
        ("crowd_lod", crowd(400, &[id]), Method::Lod),
        ("crowd_full", crowd(400, &[id]), Method::Full),
        ("empty", Vec::new(), Method::Lod),
    ] {
        frame(&mut headless, &agents, &options(method));
        check_golden(&mut headless, name);
    }
    let id = headless
        .add_character(&baked_mascot_with_impostors())
        .expect("it uploads");
    for (name, method) in [("crowd_flat", Method::Flat), ("crowd_quad", Method::Quad)] {
        frame(&mut headless, &crowd(400, &[id]), &options(method));
        check_golden(&mut headless, name);
    }
    assert_silent(&headless);
}

#[test]
fn a_changed_pixel_is_found() {
    let a = vec![[1, 2, 3, 255]; 16];
    let mut b = a.clone();
    assert_eq!(differing(&a, &b, 0), 0);
    b[5][1] = 3;
    assert_eq!(differing(&a, &b, 0), 1);
    assert_eq!(differing(&a, &b, 1), 0);
}

#[test]
fn uninstanced_draws_the_same_picture_as_full() {
    let (mut headless, id) = with_mascot();
    let agents = crowd(300, &[id]);
    let full = frame(&mut headless, &agents, &options(Method::Full));
    let picture = headless.read_image().expect("a picture");
    let uninstanced = frame(&mut headless, &agents, &options(Method::Uninstanced));
    let other = headless.read_image().expect("a picture");
    assert_eq!(differing(&picture, &other, 1), 0);
    assert_eq!(full.visible, uninstanced.visible);
    assert_eq!(full.triangles, uninstanced.triangles);
    assert_eq!(uninstanced.draw_calls, uninstanced.instances + 3);
    assert_eq!(full.draw_calls, 2 + 3);
    assert_silent(&headless);
}

#[test]
fn counts_hold_for_crowds_of_any_size() {
    let (mut headless, id) = with_mascot();
    for count in [0, 1, 63, 64, 65, 1000] {
        for method in [Method::Lod, Method::Full, Method::Uninstanced] {
            let agents = crowd(count, &[id]);
            let report = frame(&mut headless, &agents, &options(method));
            assert_eq!(report.agents, count as u64);
            assert_eq!(
                report.visible + report.culled + report.occluded,
                count as u64
            );
            let lists = headless.selection().expect("the lists are kept");
            let total: u64 = lists.draws.iter().map(|d| d.instance_count as u64).sum();
            assert_eq!(total, report.instances);
            // Lists stand one after the other, each within its agents, and no agent twice in one list.
            let mut end = 0;
            for d in &lists.draws {
                assert_eq!(d.first_instance, end);
                end += d.instance_count;
                let list = &lists.instances[d.first_instance as usize..end as usize];
                assert!(list.windows(2).all(|w| w[0].agent() < w[1].agent()));
                assert!(list.iter().all(|i| (i.agent() as usize) < count));
            }
            let triangles: u64 = lists
                .draws
                .iter()
                .map(|d| d.instance_count as u64 * d.index_count as u64 / 3)
                .sum();
            assert_eq!(triangles, report.triangles);
            let live: u64 = lists
                .instances
                .iter()
                .map(|i| i.live_vertex_count as u64)
                .sum();
            let bands = &headless.tables().bands;
            let waiting: u64 = (lists.draws.iter().zip(bands.iter()))
                .map(|(d, b)| d.instance_count as u64 * b.waiting_vertex_count as u64)
                .sum();
            assert_eq!(live - waiting, report.live_vertices);
        }
    }
    assert_silent(&headless);
}

/// Nothing but impostors, or nothing at all, in a frame without ground and sky.
#[test]
fn impostors_are_drawn_alone() {
    let mut headless = headless(SIZE);
    let id = headless
        .add_character(&baked_mascot_with_impostors())
        .expect("it uploads");
    for (method, quads) in [(Method::Flat, 2), (Method::Quad, 1)] {
        let options = bare(method);
        let empty = frame(&mut headless, &[], &options);
        assert_eq!(empty.draw_calls, 0);
        assert_eq!(empty.vertex_invocations.unwrap_or(0), 0);
        let report = frame(&mut headless, &trio(id), &options);
        // One quad without relief, far away, and with it.
        assert_eq!(report.draw_calls, 3 - quads, "{method:?}");
        assert_eq!(report.triangles, 2 * quads * report.visible);
        // A corner each, or where a driver does not reuse vertices an index each; some do not count.
        if let Some(runs) = report.vertex_invocations {
            let corners = 4 * quads * report.visible;
            assert!(
                (corners..=corners / 4 * 6).contains(&runs),
                "{method:?}: {runs}"
            );
        }
    }
    // Agents of one quad share instances: none of those that are not whole is lost or drawn twice.
    for count in [1, 63, 64, 65, 400] {
        let options = bare(Method::Quad);
        let report = frame(&mut headless, &crowd(count, &[id]), &options);
        assert!(report.visible > count as u64 / 2);
        assert_eq!(report.instances, report.visible);
        if let Some(runs) = report.vertex_invocations {
            assert!(
                (4 * report.visible..=6 * report.visible).contains(&runs),
                "{count}: {runs}"
            );
        }
    }
    assert_silent(&headless);
}

/// The smallest meshes share instances: any number of them looks as each of them alone, and none runs for others.
#[test]
fn small_meshes_are_drawn_packed() {
    let (mut headless, id) = with_mascot();
    // Beside each other, a pixel and more apart, at an error at which a few triangles of each are left.
    let row: Vec<Agent> = (0..65)
        .map(|i| Agent {
            position: Vec3::new(i as f32 * 1.5 - 48.0, 0.0, -105.0),
            heading: i as f32,
            character: id,
            phases: [i as f32 * 0.1, 0.0],
            tint_seed: i,
            ..Default::default()
        })
        .collect();
    let options = bare(Method::Lod);
    frame(&mut headless, &[], &options);
    let nothing = headless.read_image().expect("a picture");
    let (mut all, mut shown) = (nothing.clone(), 0);
    for count in 1..=row.len() {
        frame(&mut headless, &row[count - 1..count], &options);
        let one = headless.read_image().expect("a picture");
        shown += usize::from(one != nothing);
        for (pixel, (one, nothing)) in all.iter_mut().zip(one.iter().zip(&nothing)) {
            *pixel = if one == nothing { *pixel } else { *one };
        }
        if ![1, 2, 63, 64, 65].contains(&count) {
            continue;
        }
        let report = frame(&mut headless, &row[..count], &options);
        let picture = headless.read_image().expect("a picture");
        assert_eq!(differing(&picture, &all, 0), 0, "{count} agents");
        assert_eq!(report.visible, count as u64);
        if let Some(runs) = report.vertex_invocations {
            assert!(runs <= 3 * report.triangles, "{count}: {runs} runs");
        }
    }
    // They have a draw of their own where some are far enough, for each of two submeshes.
    assert_eq!(frame(&mut headless, &trio(id), &options).draw_calls, 2);
    assert_eq!(frame(&mut headless, &row, &options).draw_calls, 4);
    // A pixel may miss the few triangles of one.
    assert!(shown > row.len() / 2, "{shown} show");
    assert_silent(&headless);
}

/// Every character keeps its own pictures, whatever was added before it or after the first frame, and all of them that show
/// one kind are one draw.
#[test]
fn impostors_of_all_characters_share_a_gallery() {
    let baked = baked_mascot_with_impostors();
    let mut pale = baked.clone();
    let atlas = &mut pale.impostors.as_mut().expect("the fixture has them").atlas;
    for texel in &mut atlas.color {
        let alpha = texel[3];
        *texel = texel.map(|c| 255 - c / 4);
        texel[3] = alpha;
    }
    for (method, draw_calls) in [(Method::Quad, 2), (Method::Flat, 1)] {
        let picture = |headless: &mut Headless, id| {
            frame(headless, &trio(id), &options(method));
            headless.read_image().expect("a picture")
        };
        let mut alone = headless(SIZE);
        let id = alone.add_character(&baked).expect("it uploads");
        let expected = picture(&mut alone, id);

        let mut shared = headless(SIZE);
        let first = shared.add_character(&pale).expect("it uploads");
        let pale_alone = picture(&mut shared, first);
        let count = differing(&pale_alone, &expected, 8);
        assert!(count > 2000, "the comparison can fail: {count}");
        let second = shared.add_character(&baked).expect("it uploads");
        let third = shared.add_character(&pale).expect("it uploads");
        // Where an atlas stands changes what the device rounds.
        for (id, expected) in [
            (second, &expected),
            (first, &pale_alone),
            (third, &pale_alone),
        ] {
            let count = differing(&picture(&mut shared, id), expected, 8);
            assert!(count <= 5, "{method:?}: {count} pixels");
        }

        let all: Vec<_> = [first, second, third].into_iter().flat_map(trio).collect();
        let options = bare(method);
        let draws = frame(&mut shared, &all, &options).draw_calls;
        assert_eq!(draws, draw_calls, "{method:?}");
        assert_silent(&shared);
    }
}

#[test]
fn draw_calls_do_not_depend_on_the_number_of_agents() {
    let (mut headless, id) = with_mascot();
    let calls: Vec<u64> = [100, 10_000, 100_000]
        .map(|n| frame(&mut headless, &crowd(n, &[id]), &options(Method::Lod)).draw_calls)
        .into();
    // Two submeshes and their smallest levels, the one of them that can hide others, the ground, the shadows and the sky.
    assert_eq!(calls, [8, 8, 8]);
    assert_silent(&headless);
}

#[test]
fn levels_of_detail_save_triangles_and_keep_within_their_bounds() {
    let (mut headless, id) = with_mascot();
    let agents = crowd(1000, &[id]);
    let triangles: Vec<u64> = [0.0, 0.5, 1.0, 4.0]
        .map(|pixel_error| {
            let options = FrameOptions {
                pixel_error,
                ..options(Method::Lod)
            };
            frame(&mut headless, &agents, &options).triangles
        })
        .into();
    assert!(triangles.windows(2).all(|w| w[0] >= w[1]), "{triangles:?}");
    assert!(triangles[3] * 4 < triangles[0], "{triangles:?}");
    assert_silent(&headless);
}

#[test]
fn every_vertex_shader_run_is_counted() {
    let (mut headless, id) = with_mascot();
    let report = frame(&mut headless, &trio(id), &options(Method::Full));
    let Some(runs) = report.vertex_invocations else {
        eprintln!("SKIPPED: the device has no pipeline statistics");
        return;
    };
    assert!(
        runs >= report.live_vertices,
        "{runs} of {}",
        report.live_vertices
    );
    assert!(runs <= 3 * report.triangles);
}

/// A dark surface far away has one colour, whether a texture or its vertices say it.
#[test]
fn haze_is_the_same_before_textures_and_colours() {
    use throng::bake::character::{Alpha, Image};
    let srgb = [45u8, 36, 30];
    let mut plain = common::mascot();
    for material in &mut plain.materials {
        material.name = "fixed".into();
        material.base_color = [1.0; 4];
        material.alpha = Alpha::Opaque;
    }
    let mut textured = plain.clone();
    let linear = srgb.map(|c| ((c as f32 / 255.0 + 0.055) / 1.055).powf(2.4));
    let [r, g, b] = linear;
    for material in &mut plain.materials {
        material.base_color = [r, g, b, 1.0];
        material.base_color_image = None;
    }
    let [r, g, b] = srgb;
    textured.images = vec![Image {
        name: "dark".into(),
        width: 4,
        height: 4,
        pixels: vec![[r, g, b, 255]; 16],
    }];
    for material in &mut textured.materials {
        material.base_color_image = Some(0);
    }
    for part in &mut textured.parts {
        part.uvs = vec![glam::Vec2::splat(0.5); part.positions.len()];
    }
    let mut headless = headless(SIZE);
    let full = FrameOptions {
        ground: false,
        sky: false,
        ..options(Method::Full)
    };
    let colors = [plain, textured].map(|character| {
        let (baked, _) = throng::bake::bake::bake(&character, &Default::default(), &mut |_| {})
            .expect("the fixture bakes");
        let id = headless.add_character(&baked).expect("it uploads");
        [10.0f32, 300.0].map(|distance| {
            let agent = Agent {
                position: Vec3::new(0.0, -distance * 0.3, -distance),
                scale: distance * 0.3,
                character: id,
                ..Default::default()
            };
            frame(&mut headless, &[agent], &full);
            let pixels = headless.read_image().expect("a picture");
            let background = pixels[0];
            let body: Vec<_> = pixels.iter().filter(|p| **p != background).collect();
            assert!(body.len() > 500, "{} pixels", body.len());
            let sum: f64 = body.iter().map(|p| p[1] as f64).sum();
            sum / body.len() as f64
        })
    });
    let [[near, far], [near_textured, far_textured]] = colors;
    assert!(far > near + 20.0, "there is haze: {near} {far}");
    // Light multiplies a texture's encoded colour, which makes dark ones a little lighter.
    assert!((near - near_textured).abs() < 8.0, "{near} {near_textured}");
    assert!((far - far_textured).abs() < 8.0, "{far} {far_textured}");
    println!("near {near} {near_textured}, far {far} {far_textured}");
    assert_silent(&headless);
}

#[test]
fn behind_the_camera_is_culled() {
    let (mut headless, id) = with_mascot();
    let behind = Agent {
        position: Vec3::new(0.0, 0.0, 20.0),
        character: id,
        ..Default::default()
    };
    let report = frame(&mut headless, &[behind], &options(Method::Lod));
    assert_eq!((report.visible, report.culled, report.instances), (0, 1, 0));
}

#[test]
fn what_makes_no_sense_is_refused_and_the_next_frame_works() {
    let (mut headless, id) = with_mascot();
    let good = Agent {
        character: id,
        ..Default::default()
    };
    let view = view(SIZE);
    let lod = options(Method::Lod);
    for bad in [
        Agent {
            character: CharacterId(9),
            ..good
        },
        Agent {
            clips: [9, 0],
            ..good
        },
        Agent {
            clips: [0, 9],
            blend: 0.5,
            ..good
        },
        Agent {
            position: Vec3::NAN,
            ..good
        },
        Agent { scale: 0.0, ..good },
        Agent {
            phases: [f32::INFINITY, 0.0],
            ..good
        },
    ] {
        let refused = headless.render(&[good, bad], &view, &lod);
        assert!(
            matches!(refused, Err(RenderError::BadAgent { index: 1, .. })),
            "{refused:?}"
        );
    }
    let wrong = FrameOptions {
        pixel_error: f32::NAN,
        ..lod
    };
    assert!(matches!(
        headless.render(&[good], &view, &wrong),
        Err(RenderError::BadOption {
            option: "pixel_error",
            ..
        })
    ));
    let wrong = View { near: 0.0, ..view };
    assert!(matches!(
        headless.render(&[good], &wrong, &lod),
        Err(RenderError::BadOption { option: "view", .. })
    ));
    let mut bad = baked_mascot();
    bad.indices[0] = u32::MAX;
    assert!(matches!(
        headless.add_character(&bad),
        Err(RenderError::BadCharacter { .. })
    ));
    assert!(headless.render(&[good], &view, &lod).is_ok());
    assert_silent(&headless);
}

#[test]
fn a_device_that_does_not_exist_is_named() {
    let refused = Headless::new(&throng::gpu::HeadlessDesc {
        device: Some("no such device".into()),
        ..Default::default()
    });
    let message = refused.err().expect("it is refused").to_string();
    assert!(message.contains("no such device"), "{message}");
}
