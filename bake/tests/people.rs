//! The built-in characters: sizes, weights, loops, feet that stay where they are planted.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::OnceLock;

use glam::Vec3;
use throng_bake::character::{Character, Clip};
use throng_bake::glb::write_glb;
use throng_bake::import::import_bytes;
use throng_bake::merge::merge;
use throng_bake::palette::sample_clips;
use throng_bake::people::{self, PeopleError};
use throng_bake::pose;

fn everybody() -> &'static [Character] {
    static ALL: OnceLock<Vec<Character>> = OnceLock::new();
    ALL.get_or_init(|| {
        people::names()
            .iter()
            .map(|n| people::build(n).unwrap())
            .collect()
    })
}

fn is_animal(c: &Character) -> bool {
    c.materials.iter().any(|m| m.name == "Fur") && !c.materials.iter().any(|m| m.name == "Skin")
}

/// Every vertex in model space at a time of a clip.
fn posed(c: &Character, clip: Option<&Clip>, time_s: f32) -> Vec<Vec3> {
    let palette = pose::palette(c, clip, time_s);
    let vertices = c.parts.iter().flat_map(|p| {
        let skin = p.joints.iter().zip(&p.weights);
        p.positions.iter().zip(skin)
    });
    vertices
        .map(|(&p, (&j, &w))| pose::skin(&palette, j, w, p))
        .collect()
}

#[test]
fn everybody_is_valid_and_within_budget() {
    let all = everybody();
    assert!(all.iter().filter(|c| !is_animal(c)).count() >= 6);
    assert!(all.iter().any(is_animal));
    for c in all {
        c.validate(Path::new(&c.name)).unwrap();
        let (triangles, joints) = (c.triangle_count(), c.joints.len());
        assert!(
            (3000..=8000).contains(&triangles),
            "{}: {triangles}",
            c.name
        );
        assert!((20..=30).contains(&joints), "{}: {joints}", c.name);
        let names: Vec<_> = c.clips.iter().map(|k| k.name.as_str()).collect();
        assert_eq!(names, ["idle", "walk", "run"], "{}", c.name);
        let speeds: Vec<f32> = c.clips.iter().map(|k| k.ground_speed).collect();
        assert!(speeds[0] == 0.0 && speeds[1] > 0.0 && speeds[2] > speeds[1]);
        for part in &c.parts {
            assert_eq!(part.uvs.len(), part.positions.len());
            assert_eq!(part.colors.len(), part.positions.len());
            assert!(part.normals.iter().all(|n| n.is_normalized()), "{}", c.name);
        }
    }
}

#[test]
fn people_differ() {
    let looks: BTreeSet<String> = everybody()
        .iter()
        .map(|c| {
            let names = c
                .materials
                .iter()
                .map(|m| format!("{} {:?}", m.name, m.base_color));
            names.collect::<Vec<_>>().join(",")
        })
        .collect();
    assert_eq!(looks.len(), everybody().len());
}

#[test]
fn the_surface_has_no_holes() {
    // Somebody's own parameters, near the ends of their ranges.
    let own = people::parameters("old_man").unwrap();
    let own = own
        .replace("girth = 1.04", "girth = 1.35\ncurves = 1.0")
        .replace("\"flat\"", "\"cap\"")
        .replace("\"trousers\"", "\"leggings\"")
        .replace("height = 1.70", "height = 1.3");
    let own = people::build_from_toml("own", &own).unwrap();
    own.validate(Path::new("own")).unwrap();
    for c in everybody().iter().chain([&own]) {
        // Parts meet at bit-equal positions: over positions, every edge has two triangles in opposite directions.
        let mut edges = std::collections::BTreeMap::new();
        for part in &c.parts {
            let key = |v: u32| part.positions[v as usize].to_array().map(f32::to_bits);
            for t in &part.triangles {
                for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                    let (a, b) = (key(a), key(b));
                    *edges.entry((a.min(b), a.max(b))).or_insert(0i32) +=
                        if a < b { 1 } else { -1 };
                }
            }
        }
        let open = edges.values().filter(|&&n| n != 0).count();
        assert_eq!(open, 0, "{}: {open} open edges of {}", c.name, edges.len());
    }
}

#[test]
fn clips_loop() {
    for c in everybody() {
        for clip in &c.clips {
            let (first, last) = (
                posed(c, Some(clip), 0.0),
                posed(c, Some(clip), clip.duration_s),
            );
            let jump = first.iter().zip(&last).map(|(a, b)| a.distance(*b));
            let jump = jump.fold(0.0, f32::max);
            assert!(jump < 1e-5, "{} {}: {jump} m", c.name, clip.name);
        }
    }
}

/// Vertices of the soles, by foot: left and right; a dog's paws are four.
fn feet(c: &Character) -> Vec<Vec<usize>> {
    let rest = posed(c, None, 0.0);
    let mut feet = vec![Vec::new(); 4];
    for (i, p) in rest.iter().enumerate().filter(|(_, p)| p.y < 0.008) {
        let fore = usize::from(is_animal(c) && p.z > 0.0);
        feet[usize::from(p.x < 0.0) + 2 * fore].push(i);
    }
    feet.retain(|f| !f.is_empty());
    feet
}

#[test]
fn planted_feet_do_not_slide() {
    for c in everybody() {
        let feet = feet(c);
        assert_eq!(feet.len(), if is_animal(c) { 4 } else { 2 }, "{}", c.name);
        for clip in &c.clips {
            let times = &clip.tracks[0].times_s;
            let poses: Vec<_> = times.iter().map(|&t| posed(c, Some(clip), t)).collect();
            // The vertex that stays lowest from key k to the next, and how high it gets.
            let lowest = |k: usize, foot: &[usize]| {
                let heights = foot
                    .iter()
                    .map(|&i| (i, poses[k][i].y.max(poses[k + 1][i].y)));
                heights.min_by(|a, b| a.1.total_cmp(&b.1)).unwrap()
            };
            let mut planted = 0;
            for (k, foot) in (1..times.len() - 2).flat_map(|k| feet.iter().map(move |f| (k, f))) {
                // The intervals in which the foot lands or leaves the ground are neither one nor the other.
                if (k - 1..=k + 1).any(|k| lowest(k, foot).1 > 0.002) {
                    continue;
                }
                planted += 1;
                let i = lowest(k, foot).0;
                let velocity = (poses[k + 1][i] - poses[k][i]) / (times[k + 1] - times[k]);
                let slip = velocity + Vec3::Z * clip.ground_speed;
                let allowed = (0.02 * clip.ground_speed).max(0.004);
                assert!(
                    slip.x.hypot(slip.z) <= allowed,
                    "{} {} at {:.3} s: a planted foot moves at {velocity}, not {}",
                    c.name,
                    clip.name,
                    times[k],
                    clip.ground_speed
                );
            }
            let share = planted as f32 / (feet.len() * (poses.len() - 1)) as f32;
            assert!(share > 0.15, "{} {}: planted {share}", c.name, clip.name);
        }
    }
}

/// Whoever does not state ground speeds gets them measured: those that feet are known to walk at here, and none where they
/// stand.
#[test]
fn ground_speeds_are_measured_where_they_are_not_stated() {
    for c in everybody() {
        let mut silent = c.clone();
        silent.clips.iter_mut().for_each(|c| c.ground_speed = 0.0);
        let mesh = merge(&silent).unwrap();
        let (_, clips) = sample_clips(&silent, &mesh, 30.0).unwrap();
        for (stated, measured) in c.clips.iter().zip(&clips) {
            let (a, b) = (stated.ground_speed, measured.ground_speed);
            assert!(
                (a - b).abs() <= 0.1 * a,
                "{} {}: {a} and {b}",
                c.name,
                stated.name
            );
        }
    }
}

/// Who stands does so on feet, although a bow in the hand reaches through the ground.
#[test]
fn feet_are_what_one_stands_on() {
    let c = people::build("man_suit").unwrap();
    let mut mesh = merge(&c).unwrap();
    let (_, plain) = sample_clips(&c, &mesh, 30.0).unwrap();
    let name = |j: u8| &c.nodes[c.joints[j as usize].node as usize].name;
    let in_hand = (0..mesh.vertex_count())
        .find(|&v| mesh.weights[v][0] > 0.999 && name(mesh.joints[v][0]).contains("hand"))
        .unwrap();
    let palette = throng_bake::pose::palette(&c, Some(&c.clips[0]), 0.0);
    let end = mesh.posed(&palette, in_hand).with_y(-0.4);
    let joint = mesh.joints[in_hand][0] as usize;
    mesh.positions[in_hand] = palette[joint].inverse().transform_point3(end);
    let (_, armed) = sample_clips(&c, &mesh, 30.0).unwrap();
    assert!(armed[0].box_min.y < -0.35);
    for (plain, armed) in plain.iter().zip(&armed) {
        assert!(plain.ground.abs() < 0.02, "{} {}", plain.name, plain.ground);
        assert_eq!(armed.ground, plain.ground, "{}", armed.name);
        assert_eq!(armed.ground_speed, plain.ground_speed, "{}", armed.name);
    }
}

#[test]
fn nobody_sinks_or_floats() {
    for c in everybody() {
        for clip in &c.clips {
            let steps = 64;
            let mut floats = 0;
            for k in 0..steps {
                let pose = posed(c, Some(clip), clip.duration_s * k as f32 / steps as f32);
                let low = pose.iter().map(|p| p.y).fold(f32::MAX, f32::min);
                assert!(
                    low > -0.015,
                    "{} {}: {low} m at frame {k}",
                    c.name,
                    clip.name
                );
                floats += usize::from(low > 0.02);
            }
            // Runners leave the ground for a while; nobody else does.
            let most = if clip.name == "run" { steps / 2 } else { 0 };
            assert!(floats <= most, "{} {}: {floats}", c.name, clip.name);
        }
    }
}

#[test]
fn same_parameters_same_bytes() {
    let again = people::build("dog").unwrap();
    let first = everybody().iter().find(|c| c.name == "dog").unwrap();
    assert!(write_glb(&again).unwrap() == write_glb(first).unwrap());
    for c in everybody() {
        let bytes = write_glb(c).unwrap();
        if let Some(folder) = std::env::var_os("THRONG_KEEP_GLB") {
            std::fs::write(Path::new(&folder).join(format!("{}.glb", c.name)), bytes).unwrap();
        }
    }
}

#[test]
fn written_and_imported_they_pose_the_same() {
    for c in everybody() {
        let bytes = write_glb(c).unwrap();
        let back = import_bytes(Path::new(&format!("{}.glb", c.name)), &bytes).unwrap();
        assert_eq!(back.name, c.name);
        assert!(back.warnings.is_empty(), "{}: {:?}", c.name, back.warnings);
        assert_eq!(back.joints.len(), c.joints.len());
        let names = |c: &Character| {
            c.materials
                .iter()
                .map(|m| m.name.clone())
                .collect::<Vec<_>>()
        };
        assert_eq!(names(&back), names(c));
        for (clip, again) in c.clips.iter().zip(&back.clips) {
            assert_eq!(
                (&again.name, again.ground_speed, again.duration_s),
                (&clip.name, clip.ground_speed, clip.duration_s)
            );
            for k in 0..4 {
                let time_s = 0.21 * k as f32 * clip.duration_s;
                let (here, there) = (surface(c, clip, time_s), surface(&back, again, time_s));
                assert_eq!(here.len(), there.len(), "{}", c.name);
                let off = here.iter().zip(&there).map(|(a, b)| a.distance(*b));
                let off = off.fold(0.0, f32::max);
                assert!(off < 1e-4, "{} {}: {off} m", c.name, clip.name);
            }
        }
    }
}

/// The corners of every triangle in model space, in order.
fn surface(c: &Character, clip: &Clip, time_s: f32) -> Vec<Vec3> {
    let all = posed(c, Some(clip), time_s);
    let mut first = 0;
    let mut corners = Vec::new();
    for part in &c.parts {
        corners.extend(
            part.triangles
                .as_flattened()
                .iter()
                .map(|&v| all[first + v as usize]),
        );
        first += part.positions.len();
    }
    corners
}

#[test]
fn wrong_parameters_are_named() {
    let unknown = people::build("nobody").unwrap_err();
    assert!(unknown.to_string().contains("man_suit"), "{unknown}");
    let text = people::parameters("jogger").unwrap();
    let cases = [
        (
            text.replace("height = 1.72", "height = 17.2"),
            "height is 17.2",
        ),
        (text.replace("girth", "girht"), "girht"),
        (text.replace("#5f3b28", "brown"), "'brown' is not a colour"),
        (text.replace("\"ponytail\"", "\"mohawk\""), "mohawk"),
        ("kind = \"cat\"".into(), "cat"),
    ];
    for (text, expected) in cases {
        let error: PeopleError = people::build_from_toml("mine", &text).unwrap_err();
        assert!(error.to_string().contains(expected), "{error}");
    }
}
