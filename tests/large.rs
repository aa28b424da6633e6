//! A crowd of 100,000.

mod common;

use common::{assert_silent, baked_mascot, crowd, headless, options, view};
use throng::{Agent, Method};

const SIZE: [u32; 2] = [64, 48];

/// A crowd of 100,000 draws, twice alike, with the calls of one who stands as far.
#[test]
fn a_hundred_thousand_agents_are_held() {
    let mut headless = headless(SIZE);
    let id = headless.add_character(&baked_mascot()).expect("it uploads");
    let agents = crowd(100_000, &[id]);
    let distance = |a: &&Agent| a.position.length();
    let farthest = agents
        .iter()
        .max_by(|a, b| distance(a).total_cmp(&distance(b)));
    let mut draw = |agents: &[Agent]| {
        let report = headless.render(agents, &view(SIZE), &options(Method::Lod));
        (
            report.expect("a frame"),
            headless.read_image().expect("a picture"),
        )
    };
    let (one, _) = draw(&[*farthest.expect("somebody")]);
    let (many, picture) = draw(&agents);
    assert_eq!(many.agents, 100_000);
    assert_eq!(many.visible + many.culled + many.occluded, 100_000);
    assert_eq!(many.draw_calls, one.draw_calls);
    assert_eq!(draw(&agents).1, picture);
    assert_silent(&headless);
}
