//! A crowd of 100,000.

mod common;

use common::{assert_silent, baked_mascot, crowd, headless, options, view};
use throng::Method;

const SIZE: [u32; 2] = [64, 48];

/// A crowd of 100,000 draws, twice alike, with the calls of a hundred who reach as far.
#[test]
fn a_hundred_thousand_agents_are_held() {
    let mut headless = headless(SIZE);
    let id = headless.add_character(&baked_mascot()).expect("it uploads");
    let mut draw = |count: usize| {
        let agents = crowd(count, &[id]);
        let report = headless.render(&agents, &view(SIZE), &options(Method::Lod));
        (
            report.expect("a frame"),
            headless.read_image().expect("a picture"),
        )
    };
    let (few, _) = draw(100);
    let (many, picture) = draw(100_000);
    assert_eq!(many.agents, 100_000);
    assert_eq!(many.visible + many.culled + many.occluded, 100_000);
    assert_eq!(many.draw_calls, few.draw_calls);
    assert_eq!(draw(100_000).1, picture);
    assert_silent(&headless);
}
