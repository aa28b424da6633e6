use std::path::Path;

use glam::{Vec2, Vec3};
use throng_bake::baked::{Baked, BakedClip};

use super::*;

const SMALL: &str = r#"
seed = 7

[[character]]
source = "builtin:ann"
height = 1.8

[[character]]
name = "dog"
source = "models/dog.glb"
share = 0.5

[[crowd]]
count = 300
area.rectangle = { center = [5, 0], size = [40, 20] }
motion = "wander"
clips = [{ name = "walk", share = 3 }, { name = "run", speed = 3.0 }]

[[crowd]]
count = 100
characters = ["ann"]
area.ring = { radius_min = 2, radius_max = 4 }
look_at = [0, 0]

[[crowd]]
positions = [[1, 0, 2], [3, 0.5, 4]]
clips = [{ name = "idle", time = 0.25 }]

[[camera]]
position = [0, 10, 30]
"#;

fn parse(text: &str) -> Result<Scene, SceneError> {
    Scene::parse(text, Path::new("scenes/s.toml"))
}

fn character(name: &str) -> Baked {
    let clip = |name: &str, ground_speed: f32| BakedClip {
        name: name.into(),
        first_frame: 0,
        frame_count: 2,
        duration_s: 1.0,
        ground_speed,
        box_min: Vec3::new(-0.5, 0.0, -0.5),
        box_max: Vec3::new(0.5, 1.6, 0.5),
        sphere_center: Vec3::Y,
        sphere_radius: 1.0,
        ground: 0.0,
    };
    Baked {
        name: name.into(),
        clips: vec![
            clip("Idle", 0.0),
            clip("Man_Walk", 1.25),
            clip("Man_Run", 3.5),
        ],
        ..Baked::default()
    }
}

fn crowd(scene: &Scene) -> Crowd {
    let (ann, dog) = (character("ann"), character("dog"));
    scene.populate(&[&ann, &dog])
}

#[test]
fn a_scene_reads_with_defaults_and_paths_relative_to_it() {
    let scene = parse(SMALL).unwrap();
    assert_eq!(scene.agent_count(), 402);
    assert_eq!(scene.characters[0].name, "ann");
    assert_eq!(scene.characters[1].source, "scenes/models/dog.glb");
    assert_eq!(scene.cameras[0].fov_y_deg, 45.0);
    assert_eq!(scene.light, SceneLight::default());
}

/// Whatever comes first in a file: nobody bites or dies because a scene names no clip, or one that they have not got.
#[test]
fn who_is_not_told_what_to_do_stands() {
    let mut wolf = character("wolf");
    wolf.clips.swap(0, 2);
    let mut cow = wolf.clone();
    cow.clips.truncate(2);
    for clips in ["", "clips = [{ name = \"swim\" }]"] {
        let text = format!(
            "[[character]]\nsource = 'wolf.glb'\n[[character]]\nsource = 'cow.glb'\n\
             [[crowd]]\npositions = [[0, 0, 0], [1, 0, 0]]\n{clips}"
        );
        let crowd = parse(&text).unwrap().populate(&[&wolf, &cow]);
        let agents = crowd.agents_at(0.0);
        assert_eq!(agents[0].clips, [2, 2], "the idle one");
        assert_eq!(agents[1].clips, [0, 0], "the first where there is none");
        assert_eq!(crowd.warnings.len(), if clips.is_empty() { 0 } else { 2 });
    }
}

#[test]
fn every_builtin_scene_reads() {
    for name in builtin_names() {
        let scene = Scene::builtin(name).unwrap_or_else(|e| panic!("{e}"));
        assert!(!scene.characters.is_empty() && scene.agent_count() > 0);
    }
    let message = Scene::builtin("moon").unwrap_err().to_string();
    assert!(message.contains("moon") && message.contains("plaza"));
}

/// Each fault is refused, and the message names the file, the place and what is wrong.
#[test]
fn faults_are_refused_with_their_place() {
    for (from, to, expect) in [
        ("seed = 7", "sead = 7", &["line 2", "sead"][..]),
        ("seed = 7", "seed = ", &["line 2"]),
        ("share = 0.5", "shares = 0.5", &["line 11", "shares"]),
        ("share = 0.5", "share = -1", &["character 2 'dog'", "share"]),
        ("share = 0.5", "share = inf", &["character 2 'dog'"]),
        ("count = 300", "count = -300", &["line 14"]),
        ("count = 300", "count = 99999999999", &["line 14"]),
        ("count = 300", "count = 4000000000", &["10,000,000"]),
        ("count = 300\n", "", &["crowd 1", "count"]),
        ("size = [40, 20]", "size = [40, 0]", &["crowd 1", "area"]),
        ("size = [40, 20]", "size = [40]", &["line 15"]),
        ("size =", "sise =", &["line 15", "sise"]),
        ("rectangle", "triangle", &["line 15", "triangle"]),
        ("\"wander\"", "\"fly\"", &["line 16", "fly"]),
        ("[\"ann\"]", "[\"bob\"]", &["crowd 2", "bob"]),
        ("radius_max = 4", "radius_max = 1", &["crowd 2", "area"]),
        ("speed = 3.0", "speed = nan", &["crowd 1", "run"]),
        ("[3, 0.5, 4]", "[3, nan, 4]", &["crowd 3", "position"]),
        ("[0, 10, 30]", "[0, 0, 0]", &["camera 1", "target"]),
        ("position = [0, 10, 30]", "fov_y_deg = 0", &["camera 1"]),
        ("stand_in_scale = 0.01", "stand_in_scale = 0", &["stand_in"]),
        ("stand_in_scale", "ground_color = [0, 2, 0] #", &["ground_"]),
        ("density = 0.5", "density = 0", &["crowd 1", "area"]),
        ("angle_deg = 60", "angle_deg = 180", &["crowd 1", "area"]),
        (", spacing = 2", ", spacing = 3", &["crowd 2", "area"]),
    ] {
        let whole = if SMALL.contains(from) { SMALL } else { GROWING };
        let text = whole.replace(from, to);
        assert_ne!(text, whole, "{from}");
        let message = parse(&text).expect_err(to).to_string();
        assert!(message.starts_with("scenes/s.toml: "), "{to}: {message}");
        for part in expect {
            assert!(message.contains(part), "{to}: {message}");
        }
    }
    assert!(parse("").is_err());
}

#[test]
fn a_missing_file_is_named() {
    let message = Scene::load(Path::new("no/such.toml"))
        .unwrap_err()
        .to_string();
    assert!(message.starts_with("no/such.toml: cannot be read"));
}

#[test]
fn the_same_scene_gives_the_same_agents_and_another_seed_others() {
    let mut scene = parse(SMALL).unwrap();
    let first = crowd(&scene).agents_at(3.0);
    assert_eq!(first, crowd(&scene).agents_at(3.0));
    scene.seed += 1;
    assert_ne!(first, crowd(&scene).agents_at(3.0));
}

#[test]
fn agents_are_where_and_who_the_scene_says() {
    let scene = parse(SMALL).unwrap();
    let crowd = crowd(&scene);
    assert_eq!(crowd.warnings, [] as [&str; 0]);
    for time in [0.0, 1.7, 1000.0] {
        let states = crowd.agents_at(time);
        assert_eq!(states.len(), 402);
        for s in &states[..300] {
            assert!((s.position.x - 5.0).abs() <= 22.0 && s.position.z.abs() <= 12.0);
            assert!(s.clips[0] == 1 || s.clips[0] == 2);
        }
        for s in &states[300..400] {
            let r = s.position.length();
            assert!((1.999..4.001).contains(&r) && s.character.0 == 0);
            let facing = Vec3::new(s.heading.sin(), 0.0, s.heading.cos());
            assert!(
                (facing + s.position / r).length() < 1e-4,
                "faces the middle"
            );
        }
        assert_eq!(states[401].position, Vec3::new(3.0, 0.5, 4.0));
        assert_eq!(states[401].phases[0], 0.25);
        for s in &states {
            assert!((0.0..1.0).contains(&s.phases[0]) && s.position.is_finite());
            let scale = if s.character.0 == 0 { 1.8 / 1.6 } else { 1.0 };
            assert!((s.scale - scale).abs() < 1e-5);
        }
    }
    let states = crowd.agents_at(0.0);
    assert_eq!((states[400].character.0, states[401].character.0), (0, 1));
    let dogs = states[..300].iter().filter(|s| s.character.0 == 1).count();
    assert!((70..130).contains(&dogs), "a third of 300: {dogs}");
    let runners = states[..300].iter().filter(|s| s.clips[0] == 2).count();
    assert!((50..100).contains(&runners), "a quarter of 300: {runners}");
}

/// Whoever walks covers the distance that the clip's feet cover in the same time.
#[test]
fn feet_do_not_slide() {
    let scene = parse(SMALL).unwrap();
    let crowd = crowd(&scene);
    let dt = 0.001;
    for (a, b) in crowd
        .agents_at(0.0)
        .iter()
        .zip(crowd.agents_at(dt))
        .take(300)
    {
        let ground_speed = if a.clips[0] == 1 { 1.25 } else { 3.5 };
        let clip_seconds = (b.phases[0] - a.phases[0]).rem_euclid(1.0);
        let moved = b.position.distance(a.position);
        assert!((moved - clip_seconds * ground_speed * a.scale).abs() < 2e-5);
    }
}

#[test]
fn agents_start_apart_from_each_other() {
    let scene = parse(SMALL).unwrap();
    let states = crowd(&scene).agents_at(0.0);
    let starts: Vec<_> = states[..300].iter().map(|s| s.position).collect();
    // 300 on 800 square metres: 1.6 m to a neighbour on average.
    for (i, p) in starts.iter().enumerate() {
        let nearest = starts
            .iter()
            .enumerate()
            .filter(|&(j, _)| j != i)
            .map(|(_, q)| p.distance(*q))
            .fold(f32::MAX, f32::min);
        assert!((0.1..4.0).contains(&nearest), "{nearest}");
    }
}

#[test]
fn agent_counts_change_in_proportion() {
    let mut scene = parse(SMALL).unwrap();
    for count in [2, 3, 402, 1000, 100_000] {
        scene.set_agent_count(count);
        assert_eq!(scene.agent_count(), count);
        assert_eq!(crowd(&scene).len(), count);
    }
    scene.set_agent_count(usize::MAX);
    assert_eq!(scene.agent_count(), AGENT_LIMIT);
}

#[test]
fn other_characters_take_every_part() {
    let mut scene = parse(SMALL).unwrap();
    scene.set_characters(&["a/wolf.glb".into()]);
    let wolf = character("wolf");
    let states = scene.populate(&[&wolf]).agents_at(0.0);
    assert_eq!(states.len(), 402);
    assert!(states.iter().all(|s| s.character.0 == 0));
    assert!(scene.populate(&[]).is_empty());
}

/// A character whose origin is its hip, dropped into a scene, stands on its feet; where a scene names it, as the scene says.
#[test]
fn whoever_is_dropped_in_stands_on_the_ground() {
    let mut scene = parse(SMALL).unwrap();
    let mut wolf = character("wolf");
    for clip in &mut wolf.clips {
        clip.box_min.y -= 0.7;
        clip.box_max.y -= 0.7;
        clip.ground = -0.7;
    }
    let heights = |scene: &Scene, who: &Baked| -> Vec<f32> {
        let states = scene.populate(&[who, who]).agents_at(0.5);
        states.iter().map(|s| s.position.y / s.scale).collect()
    };
    assert_eq!(heights(&scene, &wolf)[0], 0.0);
    scene.set_characters(&["a/wolf.glb".into()]);
    let lifted = heights(&scene, &wolf);
    assert!((lifted[0] - 0.7).abs() < 1e-6);
    // The scene's own heights count on top: the last stands on a step of half a metre.
    assert!((lifted[401] - 1.2).abs() < 1e-6, "{}", lifted[401]);
    // Soles that sink in a little are left alone.
    for clip in &mut wolf.clips {
        clip.ground = -0.02;
    }
    assert_eq!(heights(&scene, &wolf)[0], 0.0);
    // A bow in the hand reaches through the ground: its bearer does not float for it.
    let mut archer = character("archer");
    archer.clips.iter_mut().for_each(|c| c.box_min.y -= 0.4);
    assert_eq!(heights(&scene, &archer)[0], 0.0);
}

#[test]
fn clips_are_found_by_the_nearest_name() {
    let names = ["Man_Walk_Carry", "Man_Walk", "Man_Idle", "walk", "Walk"];
    let find = |n: usize, name: &str| find_clip(names[..n].iter().copied(), name);
    assert_eq!(find(5, "Walk"), Some(4));
    assert_eq!(find(5, "walk"), Some(3));
    assert_eq!(find(3, "walk"), Some(1));
    assert_eq!(find(1, "walk"), Some(0));
    assert_eq!(find(5, "IDLE"), Some(2));
    assert_eq!(find(5, "swim"), None);
    // Names as makers of characters give them, and which is meant.
    let robot = "Robot_Dance Robot_Idle Robot_WalkJump Robot_Running Robot_Walking";
    let rogue = "Jump_Idle Running_B Running_A Walking_Backwards Walking_A Unarmed_Idle Idle";
    let wolf = "Animal|Eating Animal|Gallop_Jump Animal|Gallop Animal|Idle_2 Animal|Walk";
    let mannequin = "Jog_Fwd_Loop Push_Loop Sprint_Loop Walk_Loop Walk_Formal_Loop Grunt";
    for (names, name, meant) in [
        (robot, "walk", Some("Robot_Walking")),
        (robot, "run", Some("Robot_Running")),
        (robot, "walkjump", Some("Robot_WalkJump")),
        (rogue, "walk", Some("Walking_A")),
        (rogue, "run", Some("Running_B")),
        (rogue, "idle", Some("Idle")),
        (wolf, "run", Some("Animal|Gallop")),
        (wolf, "walk", Some("Animal|Walk")),
        (wolf, "idle", Some("Animal|Idle_2")),
        (wolf, "canter", Some("Animal|Gallop")),
        (mannequin, "run", Some("Sprint_Loop")),
        (mannequin, "walk", Some("Walk_Loop")),
        ("Kick Trot Gallop", "walk", Some("Trot")),
        ("Kick Trot Gallop", "run", Some("Gallop")),
        ("Kick Catwalk", "walk", Some("Catwalk")),
        ("Drunk Prune", "run", Some("Drunk")),
        ("Bite Gallop", "walk", None),
        ("Bite", "", Some("Bite")),
    ] {
        let all: Vec<&str> = names.split(' ').collect();
        let found = find_clip(all.iter().copied(), name).map(|i| all[i]);
        assert_eq!(found, meant, "{name} of {names}");
    }
    let mut scene = parse(SMALL).unwrap();
    scene.crowds[0].clips[0].name = "swim".into();
    let warnings = crowd(&scene).warnings;
    assert_eq!(warnings.len(), 2, "one a character: {warnings:?}");
    assert!(warnings[0].contains("ann") && warnings[0].contains("swim"));
}

#[test]
fn clips_of_other_names_are_told_once_a_character() {
    let mut scene = parse(SMALL).unwrap();
    let again = scene.crowds[0].clone();
    scene.crowds.push(again);
    // `Idle` for `idle` needs no word.
    let notes = crowd(&scene).notes;
    assert_eq!(
        notes,
        ["ann", "dog"].map(|name| format!(
            "{name}: its clip 'Man_Walk' is taken for 'walk', its clip 'Man_Run' is taken for 'run'"
        ))
    );
}

#[test]
fn a_flight_passes_through_its_keys() {
    let key = |time: f32, x: f32| CameraKey {
        time,
        position: Vec3::new(x, 1.0, 5.0),
        target: Vec3::ZERO,
    };
    let camera = SceneCamera {
        name: String::new(),
        by_rings: false,
        position: Vec3::ZERO,
        target: Vec3::ZERO,
        fov_y_deg: 45.0,
        path: vec![key(0.0, 0.0), key(2.0, 4.0), key(3.0, 9.0)],
    };
    for k in &camera.path {
        assert!(camera.at(k.time).0.distance(k.position) < 1e-4);
    }
    assert_eq!(camera.at(-1.0).0, camera.path[0].position);
    assert_eq!(camera.at(99.0).0, camera.path[2].position);
    let middle = camera.at(1.0).0.x;
    assert!((1.0..3.0).contains(&middle), "{middle}");
}

const GROWING: &str = r#"
stand_in_scale = 0.01

[[character]]
source = "builtin:ann"

[[crowd]]
count = 300
area.fan = { center = [1, 2], heading_deg = 180, angle_deg = 60, radius_min = 5, density = 0.5 }
motion = "wander"
clips = [{ name = "walk" }]

[[crowd]]
count = 300
area.rings = { ring_spacing = 2, spacing = 2 }
motion = "wander"
clips = [{ name = "walk" }]

[[camera]]
by_rings = true
position = [1, 0.4, 1.2]
target = [0.2, 0, 0.24]
"#;

/// A fan keeps its density however many it holds, and everybody stays between its sides.
#[test]
fn a_fan_reaches_farther_the_more_it_holds() {
    let mut scene = parse(GROWING).unwrap();
    scene.crowds.truncate(1);
    for count in [10, 300, 4000] {
        scene.set_agent_count(count);
        let crowd = crowd(&scene);
        // A sixth of a ring's area holds half an agent per square metre.
        let radius_max = (25.0 + count as f32 * 2.0 / (std::f32::consts::PI / 6.0)).sqrt();
        for time in [0.0, 7.3, 60.0] {
            for a in crowd.agents_at(time) {
                let p = Vec2::new(a.position.x - 1.0, a.position.z - 2.0);
                let side = p.angle_to(Vec2::NEG_Y).abs();
                assert!(p.length() > 4.0 && p.length() < radius_max + 20.0, "{p}");
                assert!(side < 31f32.to_radians() || p.length() * side.sin() < 7.0);
            }
        }
        let starts = crowd.agents_at(0.0);
        let first = starts[0].position - Vec3::new(1.0, 0.0, 2.0);
        let last = starts[count - 1].position - Vec3::new(1.0, 0.0, 2.0);
        assert!(first.length() < 6.5 && (last.length() - radius_max).abs() < 1.0);
    }
}

#[test]
fn rings_are_filled_from_the_inside_and_walked_around() {
    let mut scene = parse(GROWING).unwrap();
    scene.crowds.remove(0);
    // 6, 12, 18, 25, ... agents 2 m apart on rings 2 m apart.
    for (count, radius_max) in [(1, 2.0), (6, 2.0), (7, 4.0), (36, 6.0), (37, 8.0)] {
        scene.set_agent_count(count);
        let crowd = crowd(&scene);
        let [start, later] = [0.0, 0.1].map(|t| crowd.agents_at(t));
        assert_eq!(start.len(), count);
        for (a, b) in start.iter().zip(&later) {
            let radius = a.position.length();
            assert!((radius / 2.0 - (radius / 2.0).round()).abs() < 1e-3);
            assert!((b.position.length() - radius).abs() < 1e-3, "stays on it");
            let facing = Vec3::new(a.heading.sin(), 0.0, a.heading.cos());
            let moved = (b.position - a.position).normalize();
            assert!(moved.dot(facing) > 0.99, "walks where it faces");
            let clockwise = a.position.cross(moved).y < 0.0;
            assert_eq!(
                clockwise,
                (radius / 2.0).round() as u32 % 2 == 1,
                "{radius}"
            );
        }
        assert!((start[count - 1].position.length() - radius_max).abs() < 1e-3);
        // The camera stands off by the next ring's radius.
        let (eye, target) = scene.camera_at(0, 0.0).unwrap();
        let unit = radius_max + 2.0;
        assert!(eye.distance(Vec3::new(1.0, 0.4, 1.2) * unit) < 1e-3);
        assert!(target.distance(Vec3::new(0.2, 0.0, 0.24) * unit) < 1e-3);
    }
    scene.set_characters(&["a/fox.glb".into()]);
    assert_eq!(scene.characters[0].scale, 0.01, "a stand-in in other units");
    assert!(scene.camera_at(1, 0.0).is_none());
}
