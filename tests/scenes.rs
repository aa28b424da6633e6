//! The built-in scenes and the built-in characters fit each other.

use throng::scene::{Scene, builtin_names};
use throng_bake::people;

#[test]
fn scenes_name_characters_that_there_are() {
    for name in builtin_names() {
        let scene = Scene::builtin(name).unwrap();
        for character in &scene.characters {
            let known = character.source.strip_prefix("builtin:");
            assert!(
                known.is_some_and(|k| people::names().contains(&k)),
                "{name}: {}",
                character.source
            );
        }
    }
}

#[test]
fn everyone_is_in_the_lineup_once() {
    let scene = Scene::builtin("lineup").unwrap();
    let shown: Vec<&str> = scene.characters.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(shown, people::names());
    assert_eq!(scene.agent_count(), shown.len());
}

#[test]
fn the_plazas_have_ten_thousand_agents() {
    for name in ["plaza", "plaza_air"] {
        assert_eq!(
            Scene::builtin(name).unwrap().agent_count(),
            10_000,
            "{name}"
        );
    }
}
