//! `limit` and `floor`: a frame's triangles and quads, transformed before, show the picture that the method showed.

mod common;

use common::{
    assert_silent, baked_mascot, baked_mascot_with_impostors, crowd, headless, options, view,
};
use throng::{CharacterId, Method, RenderError};

const SIZE: [u32; 2] = [256, 192];

/// Pixels that differ by more than two steps in some channel.
fn differing(a: &[[u8; 4]], b: &[[u8; 4]]) -> usize {
    let differs = |(a, b): (&[u8; 4], &[u8; 4])| a.iter().zip(b).any(|(x, y)| x.abs_diff(*y) > 2);
    a.iter().zip(b).filter(|&(a, b)| differs((a, b))).count()
}

#[test]
fn the_limit_shows_what_the_method_shows() {
    let mut headless = headless(SIZE);
    let characters = [baked_mascot(), baked_mascot_with_impostors()];
    let ids: Vec<CharacterId> = characters
        .iter()
        .map(|c| headless.add_character(c).expect("it uploads"))
        .collect();
    let agents = crowd(300, &ids);
    let view = view(SIZE);
    for method in [
        Method::Lod,
        Method::Full,
        Method::Flat,
        Method::Quad,
        Method::Hybrid,
    ] {
        let options = options(method);
        let frozen = headless
            .freeze(&agents, &view, &options, &characters)
            .expect("it is kept");
        let report = headless.render(&agents, &view, &options).expect("a frame");
        let seen = headless.read_image().expect("a picture");
        // Another frame in between leaves what was kept alone.
        headless
            .render(&agents[..7], &view, &common::options(Method::Lod))
            .expect("a frame");
        let limit = headless.render_frozen(&frozen, false).expect("a frame");
        let differ = differing(&seen, &headless.read_image().expect("a picture"));
        assert!(
            differ <= seen.len() / 500,
            "{method:?}: {differ} pixels differ"
        );

        assert_eq!(
            (limit.agents, limit.visible),
            (report.agents, report.visible)
        );
        assert!(
            limit.triangles > 0 && limit.triangles <= report.triangles,
            "{method:?}"
        );
        if method == Method::Full {
            assert_eq!(limit.triangles, report.triangles, "nothing has collapsed");
        }
        // The method also draws a submesh of each character as depth, to find who is hidden, and the smallest levels of
        // both submeshes on their own, because some agents are far enough.
        let depth_draws = u64::from(options.looks_for_hidden()) * characters.len() as u64;
        let small_draws = match method {
            Method::Full => 0,
            // Who has no impostors is a mesh.
            Method::Flat | Method::Quad => 2,
            _ => 4,
        };
        assert_eq!(
            limit.draw_calls + depth_draws + small_draws,
            report.draw_calls,
            "{method:?}"
        );
        if let (Some(runs), Some(of_method)) = (limit.vertex_invocations, report.vertex_invocations)
        {
            // Drivers cut indices into groups, in each of which a vertex runs again.
            assert!(
                runs > 0 && runs <= of_method + of_method / 20,
                "{method:?}: {runs} of {of_method}"
            );
        }
        // And the comparison can fail: the floor shows the same shapes in one colour.
        let floor = headless.render_frozen(&frozen, true).expect("a frame");
        let differ = differing(&seen, &headless.read_image().expect("a picture"));
        assert!(
            differ > seen.len() / 100,
            "{method:?}: {differ} pixels differ"
        );
        assert_eq!(
            (floor.triangles, floor.draw_calls),
            (limit.triangles, limit.draw_calls)
        );
        headless.release(frozen);
    }
    assert_silent(&headless);
}

#[test]
fn what_cannot_be_kept_is_refused_and_the_next_frame_works() {
    let mut headless = headless(SIZE);
    let characters = [baked_mascot()];
    let id = headless.add_character(&characters[0]).expect("it uploads");
    let (agents, view) = (crowd(9, &[id]), view(SIZE));
    let mut refused = |method, characters: &[_]| match headless.freeze(
        &agents,
        &view,
        &options(method),
        characters,
    ) {
        Err(RenderError::BadOption { option, .. }) => option,
        _ => "",
    };
    assert_eq!(refused(Method::Lod, &[]), "characters");
    let other = common::real_character("khronos_fox.glb");
    if let Some(other) = other {
        assert_eq!(refused(Method::Lod, &[other]), "characters");
    }
    assert_eq!(refused(Method::Uninstanced, &characters), "method");
    let empty = headless
        .freeze(&[], &view, &options(Method::Lod), &characters)
        .expect("nobody");
    let report = headless.render_frozen(&empty, false).expect("a frame");
    assert_eq!((report.agents, report.triangles), (0, 0));
    headless.resize([64, 64]).expect("a size");
    assert!(matches!(
        headless.render_frozen(&empty, false),
        Err(RenderError::BadOption { option: "view", .. })
    ));
    headless.release(empty);
    headless.resize(SIZE).expect("a size");
    headless
        .render(&agents, &view, &options(Method::Lod))
        .expect("a frame");
    assert_silent(&headless);
}
