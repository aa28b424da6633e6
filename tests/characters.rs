//! Characters that come and go while others stay.

mod common;

use common::{
    COSTS_OF_EVERY_KIND, assert_silent, baked_mascot, baked_mascot_with_impostors, crowd, options,
    view,
};
use throng::bake::baked::Baked;
use throng::gpu::{Headless, HeadlessDesc};
use throng::{CharacterId, FrameReport, Method, RenderError};

const SIZE: [u32; 2] = [96, 64];

fn headless() -> Headless {
    Headless::new(&HeadlessDesc {
        size_px: SIZE,
        costs: Some(COSTS_OF_EVERY_KIND),
        validation: true,
        ..HeadlessDesc::default()
    })
    .expect("a Vulkan device and the validation layer (tools/test installs them)")
}

/// A picture of a crowd of these characters, and its report without times and names.
fn draw(headless: &mut Headless, ids: &[CharacterId]) -> (Vec<[u8; 4]>, FrameReport) {
    let report = headless
        .render(&crowd(120, ids), &view(SIZE), &options(Method::Hybrid))
        .expect("a frame");
    let report = FrameReport {
        frame_ms: None,
        stage_ms: Vec::new(),
        ..report
    };
    (headless.read_image().expect("a picture"), report)
}

/// The mascot with impostors of another colour, in an atlas of another size.
fn other_mascot() -> Baked {
    let mut baked = baked_mascot_with_impostors();
    let impostors = baked.impostors.as_mut().expect("it has them");
    let atlas = &mut impostors.atlas;
    atlas.height *= 2;
    let texels = (atlas.width * atlas.height) as usize;
    let texels = texels + texels / 4 + texels / 16;
    atlas.color = vec![[40, 90, 220, 255]; texels];
    atlas.surface = vec![[128, 128, 0, 128]; texels];
    baked
}

/// Whether two frames are the same but for a few pixels: where an atlas stands in the gallery changes what the device rounds.
#[track_caller]
fn assert_same(a: &(Vec<[u8; 4]>, FrameReport), b: &(Vec<[u8; 4]>, FrameReport)) {
    assert_eq!(a.1, b.1);
    let count = a.0.iter().zip(&b.0).filter(|(a, b)| a != b).count();
    assert!(count <= 6, "{count} pixels differ");
}

/// Whatever came and went before, a crowd looks as in a renderer that only ever had its characters, and is counted so.
#[test]
fn others_look_as_if_the_removed_had_never_been() {
    let (first, second, plain) = (
        baked_mascot_with_impostors(),
        other_mascot(),
        baked_mascot(),
    );
    let mut fresh = headless();
    let ids = [&first, &plain].map(|b| fresh.add_character(b).expect("it uploads"));
    let alone = draw(&mut fresh, &ids);
    assert!(alone.1.representations.iter().all(|r| r.agents > 0));

    let mut headless = headless();
    let add = |headless: &mut Headless, b| headless.add_character(b).expect("it uploads");
    let large = add(&mut headless, &second);
    let mascot = add(&mut headless, &first);
    let pole = add(&mut headless, &plain);
    draw(&mut headless, &[large, mascot, pole]);
    headless.remove_character(large).expect("it is there");
    assert_same(&draw(&mut headless, &[mascot, pole]), &alone);

    // Its place is the next one's, whose gallery is smaller, and larger again.
    let small = add(&mut headless, &first);
    assert_eq!((small.slot(), large.slot()), (0, 0));
    assert_same(&draw(&mut headless, &[mascot, pole]), &alone);
    assert_same(&draw(&mut headless, &[small, pole]), &alone);
    let large = add(&mut headless, &second);
    let mixed = draw(&mut headless, &[large, pole]);
    assert_same(&draw(&mut headless, &[small, pole]), &alone);
    headless.remove_character(small).expect("it is there");
    headless.remove_character(mascot).expect("it is there");
    assert_same(&draw(&mut headless, &[large, pole]), &mixed);

    // Without any impostors there is no gallery; with the first there is one again.
    headless.remove_character(large).expect("it is there");
    draw(&mut headless, &[pole]);
    let mascot = add(&mut headless, &first);
    assert_same(&draw(&mut headless, &[mascot, pole]), &alone);
    assert_silent(&headless);
    assert_silent(&fresh);
}

#[test]
fn ids_of_the_removed_are_refused_for_good() {
    let mut headless = headless();
    let baked = baked_mascot();
    let stays = headless.add_character(&baked).expect("it uploads");
    let mut old = Vec::new();
    for _ in 0..5 {
        let id = headless.add_character(&baked).expect("it uploads");
        assert!(!old.contains(&id) && id != stays);
        draw(&mut headless, &[stays, id]);
        headless.remove_character(id).expect("it is there");
        old.push(id);
        for &id in &old {
            let error = headless
                .render(&crowd(3, &[stays, id]), &view(SIZE), &options(Method::Lod))
                .unwrap_err();
            assert!(
                matches!(error, RenderError::BadAgent { index: 1, .. }),
                "{error}"
            );
            assert!(error.to_string().contains("no character"), "{error}");
            let again = headless.remove_character(id).unwrap_err();
            assert!(matches!(again, RenderError::BadOption { .. }), "{again}");
        }
        draw(&mut headless, &[stays]);
    }
    // One that was never drawn, and so never uploaded, goes like any other.
    let unseen = headless.add_character(&baked).expect("it uploads");
    headless.remove_character(unseen).expect("it is there");
    headless.remove_character(stays).expect("it is there");
    let report = headless
        .render(&[], &view(SIZE), &options(Method::Hybrid))
        .expect("a frame of nobody");
    assert_eq!(report.agents, 0);
    assert_silent(&headless);
}
