//! Real characters. Skipped with a message where they are not there.

use std::path::PathBuf;

use glam::Vec3;
use throng_bake::character::Character;
use throng_bake::import::import;
use throng_bake::pose;

/// The folder of the real characters: `THRONG_MODELS`, else beside the repository.
pub fn models() -> Option<PathBuf> {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/models");
    let folder = std::env::var_os("THRONG_MODELS").map_or_else(beside, PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!(
        "SKIPPED: no characters in {}; set THRONG_MODELS",
        folder.display()
    );
    None
}

fn load(folder: &std::path::Path, name: &str) -> Character {
    import(&folder.join(name)).unwrap_or_else(|e| panic!("{e}"))
}

/// The box around all vertices at a time of a clip, or at rest.
fn bounds(c: &Character, clip: Option<(usize, f32)>) -> (Vec3, Vec3) {
    let palette = match clip {
        Some((clip, time_s)) => pose::palette(c, Some(&c.clips[clip]), time_s),
        None => pose::palette(c, None, 0.0),
    };
    let mut bounds = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for part in &c.parts {
        for v in 0..part.positions.len() {
            let p = pose::skin(&palette, part.joints[v], part.weights[v], part.positions[v]);
            bounds = (bounds.0.min(p), bounds.1.max(p));
        }
    }
    bounds
}

/// What a file must come out as.
struct Expected {
    file: &'static str,
    parts: usize,
    triangles: usize,
    joints: usize,
    clips: usize,
    images: usize,
    /// Height of the bind pose in the file's units, within a tenth.
    height: f32,
}

const fn expect(
    file: &'static str,
    [parts, triangles, joints, clips, images]: [usize; 5],
    height: f32,
) -> Expected {
    Expected {
        file,
        parts,
        triangles,
        joints,
        clips,
        images,
        height,
    }
}

const FILES: [Expected; 22] = [
    expect("glb/bull.glb", [7, 2418, 36, 12, 0], 4.6),
    expect("glb/horse_flat.glb", [8, 2182, 45, 13, 0], 4.8),
    expect("glb/horse_textured.glb", [1, 3414, 51, 14, 1], 2.0),
    expect("glb/kaykit_rogue.glb", [12, 6377, 22, 76, 1], 2.2),
    expect("glb/khronos_fox.glb", [1, 576, 22, 3, 1], 79.0),
    expect("glb/mannequin_50clips.glb", [3, 13721, 53, 50, 0], 1.83),
    expect("glb/ped_man_hoodie.glb", [10, 6206, 48, 7, 0], 1.87),
    expect("glb/ped_man_suit.glb", [10, 6634, 48, 7, 0], 1.86),
    expect("glb/ped_man_worker.glb", [13, 5240, 48, 7, 0], 1.87),
    expect("glb/ped_woman_casual.glb", [9, 6396, 50, 7, 0], 1.85),
    expect("glb/ped_woman_dress.glb", [10, 6130, 50, 7, 0], 1.84),
    expect("glb/robot.glb", [19, 3234, 36, 14, 0], 4.56),
    expect("glb/wolf.glb", [4, 1962, 46, 12, 0], 2.7),
    expect("glb/woman_adventurer.gltf", [17, 6812, 59, 24, 0], 1.83),
    expect("awkward/Donkey_interleaved.glb", [8, 2000, 45, 13, 0], 3.95),
    expect("awkward/MorphStressTest.gltf", [2, 2412, 1, 0, 2], 0.6),
    expect("awkward/ShibaInu_step.glb", [6, 1950, 41, 12, 0], 3.1),
    expect("awkward/Wolf_meshopt.glb", [4, 1962, 46, 12, 0], 2.7),
    expect("awkward/Wolf_quantized.glb", [4, 1962, 46, 12, 0], 2.7),
    expect(
        "awkward/mh_male_163joints_8infl.glb",
        [4, 32336, 124, 1, 0],
        1.75,
    ),
    expect("obj/WusonOBJ.obj", [1, 3732, 1, 0, 0], 1.52),
    expect("obj/spider.obj", [19, 1312, 1, 0, 5], 79.7),
];

#[test]
fn every_file_comes_out_as_it_should() {
    let Some(folder) = models() else { return };
    for e in &FILES {
        let c = load(&folder, e.file);
        let counts = (
            c.parts.len(),
            c.triangle_count(),
            c.joints.len(),
            c.clips.len(),
            c.images.len(),
        );
        assert_eq!(
            counts,
            (e.parts, e.triangles, e.joints, e.clips, e.images),
            "{}",
            e.file
        );
        let (low, high) = bounds(&c, None);
        let bind = c.parts.iter().flat_map(|p| &p.positions);
        let (bind_low, bind_high) = bind.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| {
            (l.min(*p), h.max(*p))
        });
        let height = bind_high.y - bind_low.y;
        assert!(
            (height / e.height - 1.0).abs() < 0.1,
            "{}: {height}",
            e.file
        );
        // Clips move the character and do not tear it: no pose is more than three times its size.
        let size = (bind_high - bind_low).length().max((high - low).length());
        for clip in 0..c.clips.len() {
            let middle_s = c.clips[clip].duration_s / 2.0;
            let (low, high) = bounds(&c, Some((clip, middle_s)));
            assert!(
                (high - low).length() < 3.0 * size,
                "{} {}",
                e.file,
                c.clips[clip].name
            );
        }
    }
}

#[test]
fn the_compressed_wolf_has_the_quantised_wolfs_shape() {
    let Some(folder) = models() else { return };
    let packed = load(&folder, "awkward/Wolf_meshopt.glb");
    let plain = load(&folder, "awkward/Wolf_quantized.glb");
    let original = load(&folder, "glb/wolf.glb");
    for clip in 0..plain.clips.len() {
        let time_s = plain.clips[clip].duration_s / 3.0;
        let (low, high) = bounds(&plain, Some((clip, time_s)));
        let size = (high - low).length();
        for (other, most) in [(&packed, 2e-3), (&original, 5e-3)] {
            let b = bounds(other, Some((clip, time_s)));
            let apart = b.0.distance(low).max(b.1.distance(high));
            assert!(apart < most * size, "clip {clip}: {}", apart / size);
        }
    }
}

#[test]
fn draco_is_refused_by_name() {
    let Some(folder) = models() else { return };
    let error = import(&folder.join("awkward/Husky_draco.glb"))
        .unwrap_err()
        .to_string();
    assert!(error.contains("Husky_draco.glb") && error.contains("KHR_draco_mesh_compression"));
}

#[test]
fn morph_targets_are_left_out_with_a_warning() {
    let Some(folder) = models() else { return };
    let c = load(&folder, "awkward/MorphStressTest.gltf");
    assert!(
        c.warnings.iter().any(|w| w.contains("8 morph targets")),
        "{:?}",
        c.warnings
    );
}

#[test]
fn eight_influences_become_four_that_hardly_move_a_vertex() {
    let Some(folder) = models() else { return };
    let c = load(&folder, "awkward/mh_male_163joints_8infl.glb");
    assert!(
        c.warnings
            .iter()
            .any(|w| w.contains("3412 vertices have more than 4")),
        "{:?}",
        c.warnings
    );
}

#[test]
fn props_follow_the_hand() {
    let Some(folder) = models() else { return };
    let c = load(&folder, "glb/kaykit_rogue.glb");
    let knife = c
        .parts
        .iter()
        .find(|p| p.name.contains("Knife"))
        .expect("a knife");
    let joint = knife.joints[0][0] as usize;
    assert!(knife.joints.iter().all(|j| j[0] as usize == joint));
    let name = &c.nodes[c.joints[joint].node as usize].name;
    assert!(name.contains("hand"), "the knife hangs in {name}");
}
