//! The command line from outside: what it prints, what it refuses, what it leaves behind.

#[path = "common/program.rs"]
mod program;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

use program::*;

#[test]
fn help_teaches_every_command() {
    let help = succeed(&["--help"]);
    let commands = [
        "bake",
        "inspect",
        "export",
        "render",
        "demo",
        "characters",
        "bench",
    ];
    for command in commands {
        assert!(help.contains(command), "{command}");
        let help = succeed(&[command, "--help"]);
        assert!(help.contains("Examples:"), "{command}: {help}");
        assert!(help.contains("Usage:"), "{command}");
    }
    assert!(succeed(&["--version"]).starts_with("throng "));
}

#[test]
fn wrong_usage_ends_with_2_and_says_what_is_wrong() {
    assert!(refuse(&["bake", "a.glb", "-o", "b", "--sead", "3"]).contains("--sead"));
    assert!(refuse(&["dance"]).contains("dance"));
    assert!(refuse(&["export", "a.throng", "-o", "b.glb"]).contains("--fraction"));
    let both = ["--fraction", "0.5", "--triangles", "9"];
    assert!(
        refuse(&[&["export", "a.throng", "-o", "b.glb"], &both[..]].concat())
            .contains("cannot be used with")
    );
    assert!(
        refuse(&["export", "a.throng", "-o", "b.glb", "--fraction", "7"]).contains("--fraction 7")
    );
    assert!(refuse(&["bake", "a.glb", "-o", "b", "--frame-rate", "nan"]).contains("--frame-rate"));
    // A negative number is a wrong value, not an unknown option.
    for option in ["--agents", "--pixel-error", "--runs", "--frame"] {
        let message = refuse(&["render", "-o", "a.png", option, "-5"]);
        assert!(!message.contains("unexpected"), "{message}");
        assert!(message.contains(option), "{message}");
    }
}

#[test]
fn missing_files_are_named() {
    for arguments in [
        &["bake", "no/such.glb", "-o", "out.throng"][..],
        &["inspect", "no/such.glb"],
        &["export", "no/such.glb", "--error", "0", "-o", "out.glb"],
    ] {
        let message = refuse(arguments);
        assert!(
            message.starts_with("throng: no/such.glb: cannot be read: "),
            "{message}"
        );
    }
}

/// What is read stays, whatever the output is called; and nothing is baked for an output that cannot be.
#[test]
fn an_output_never_takes_the_place_of_an_input() {
    let folder = tempfile::tempdir().unwrap();
    let source = tetrahedron(folder.path(), "tetra", 3);
    let before = std::fs::read(&source).unwrap();
    let name = source.to_str().unwrap();
    let plain = folder.path().join("tetra");
    std::fs::copy(&source, &plain).unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let baked = path("baked");
    succeed(&["bake", name, "--impostors", "none", "-o", &baked]);
    let copy = path("x/../baked");
    std::fs::create_dir(folder.path().join("x")).unwrap();
    for (arguments, reason) in [
        (&["bake", name, "-o", name][..], "no .gltf file"),
        (&["bake", name, "-o", &baked, "--report", name], "no .gltf"),
        (&["export", name, "--error", "0", "-o", name], "no .gltf"),
        (&["export", &baked, "--error", "0", "-o", &copy], "is read"),
        (&["render", "-c", &baked, "-o", &baked], "is read"),
        (&["render", "-c", name, "-o", "a.jpg"], "name it .png"),
        (&["render", "-c", name, "-o", "a", "--report", "a"], "both"),
        (&["render", "-c", name, "-o", &path("x")], "is a folder"),
        (
            &["bake", name, "no.glb", "-o", &path("x")],
            "no.glb: cannot",
        ),
    ] {
        let message = refuse(arguments);
        assert!(message.contains(reason), "{arguments:?}: {message}");
    }
    assert_eq!(std::fs::read(&source).unwrap(), before);
    assert_eq!(
        std::fs::read_dir(folder.path().join("x")).unwrap().count(),
        0
    );
}

/// A level without triangles is no glTF that anybody could read.
#[test]
fn an_export_has_triangles_and_no_error_below_zero() {
    let folder = tempfile::tempdir().unwrap();
    let source = tetrahedron(folder.path(), "tetra", 3);
    let (source, out) = (source.to_str().unwrap(), folder.path().join("a.glb"));
    let out = out.to_str().unwrap();
    let message = refuse(&["export", source, "--triangles", "0", "-o", out]);
    assert!(message.contains("no triangles are left"), "{message}");
    let said = succeed(&["export", source, "--triangles", "99", "-o", out]);
    assert!(said.contains("4 triangles, error 0.00000 m"), "{said}");
}

#[test]
fn malformed_files_leave_no_output() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.throng");
    let out_name = out.to_str().unwrap();
    let spoilt = tetrahedron(folder.path(), "spoilt", 99);
    let message = refuse(&["bake", spoilt.to_str().unwrap(), "-o", out_name]);
    assert!(
        message.starts_with("throng: ") && message.contains("spoilt.gltf: "),
        "{message}"
    );
    let text = folder.path().join("text.throng");
    std::fs::write(&text, "THRONG\r\nbut no more").unwrap();
    let message = refuse(&["inspect", text.to_str().unwrap()]);
    assert!(message.contains("text.throng: "), "{message}");
    std::fs::write(&text, "THR").unwrap();
    let message = refuse(&["inspect", text.to_str().unwrap()]);
    assert!(
        message.contains("text.throng: header: ") && message.contains("cut off"),
        "{message}"
    );
    assert!(!out.exists());
}

#[test]
fn bake_inspect_and_export_agree() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let source = tetrahedron(folder.path(), "tetra", 3);
    let source = source.to_str().unwrap();
    let (baked, report) = (path("new/tetra.throng"), path("report.json"));
    succeed(&["bake", source, "-o", &baked, "--report", &report]);
    let contents = json(&succeed(&["inspect", &baked, "--json"]));
    assert_eq!(contents["triangle_count"], 4);
    let report = json(&std::fs::read_to_string(report).unwrap());
    assert_eq!(report[0]["bytes"], contents["bytes"]);
    assert!(report[0]["bake_ms"].as_f64().unwrap() > 0.0);
    assert!(succeed(&["inspect", &baked]).contains("tetra: 4 triangles"));
    // A source file stands where a baked one does.
    assert_eq!(json(&succeed(&["inspect", source, "--json"])), contents);

    let exported = path("tetra_half.glb");
    let said = succeed(&["export", &baked, "--fraction", "1", "-o", &exported]);
    assert!(said.contains("4 triangles"), "{said}");
    let again = json(&succeed(&["inspect", &exported, "--json"]));
    assert_eq!(again["triangle_count"], 4);
}

#[test]
fn the_same_input_gives_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let source = tetrahedron(folder.path(), "tetra", 3);
    let bake = |name: &str| {
        let out = folder.path().join(name);
        succeed(&[
            "bake",
            source.to_str().unwrap(),
            "-o",
            out.to_str().unwrap(),
        ]);
        std::fs::read(out).unwrap()
    };
    assert_eq!(bake("a.throng"), bake("b.throng"));
}

/// A machine without any driver bakes all but impostors, and says so.
#[test]
fn without_vulkan_only_impostors_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let source = tetrahedron(folder.path(), "tetra", 3);
    let baked = folder.path().join("tetra.throng");
    let output = Command::new(env!("CARGO_BIN_EXE_throng"))
        .args([
            "bake",
            source.to_str().unwrap(),
            "-o",
            baked.to_str().unwrap(),
        ])
        .env("VK_ICD_FILENAMES", "/nonexistent")
        .env("VK_DRIVER_FILES", "/nonexistent")
        .output()
        .expect("the binary runs");
    let said = stderr(&output);
    assert!(output.status.success(), "{said}");
    assert!(said.contains("left out its impostors"), "{said}");
    let baked = baked.to_str().unwrap();
    let contents = json(&succeed(&["inspect", baked, "--json"]));
    assert_eq!(contents["triangle_count"], 4);
    assert!(contents["impostors"].is_null());
    assert!(refuse(&["inspect", baked, "--atlas", "a.png"]).contains("no impostors"));

    succeed(&["bake", source.to_str().unwrap(), "-o", baked]);
    let atlas = folder.path().join("new/atlas.png");
    let said = succeed(&["inspect", baked, "--atlas", atlas.to_str().unwrap()]);
    assert!(said.contains("flat") && said.contains("quad") && said.contains("atlas"));
    let (color, surface) = (
        pixels(&atlas),
        pixels(&atlas.with_file_name("atlas_surface.png")),
    );
    assert_eq!(color.dimensions(), surface.dimensions());
    let message = refuse(&["bake", baked, "-o", "b", "--impostors", "none,flat"]);
    assert!(message.contains("none stands alone"), "{message}");
}

#[test]
fn several_inputs_go_into_a_folder() {
    let folder = tempfile::tempdir().unwrap();
    let a = tetrahedron(folder.path(), "a", 3);
    let b = tetrahedron(folder.path(), "b", 3);
    let (a, b) = (a.to_str().unwrap(), b.to_str().unwrap());
    let out = folder.path().join("baked");
    succeed(&["bake", a, b, "-o", out.to_str().unwrap()]);
    assert!(out.join("a.throng").is_file() && out.join("b.throng").is_file());
    let message = refuse(&["bake", a, a, "-o", out.to_str().unwrap()]);
    assert!(message.contains("another input"), "{message}");
    let message = refuse(&["bake", a, b, "-o", a]);
    assert!(message.contains("folder"), "{message}");
}

fn pixels(path: &Path) -> image::RgbImage {
    image::open(path).expect("a picture").to_rgb8()
}

#[test]
fn pictures_of_a_scene_come_with_a_report() {
    let (folder, scene) = scene_of_tetrahedra();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let (picture, report) = (path("new/a.png"), path("a.json"));
    let size = ["--size", "96x64"];
    let draw = |more: &[&str]| {
        let fixed = ["render", &scene, "-o", &picture, "--report", &report];
        succeed(&[&fixed[..], &size, more].concat());
        json(&std::fs::read_to_string(&report).unwrap())
    };
    let lod = draw(&["--method", "lod", "--runs", "3"]);
    assert_eq!(pixels(Path::new(&picture)).dimensions(), (96, 64));
    assert_eq!(lod["agents"], 40);
    assert_eq!(lod["visible"], 40);
    assert_eq!(lod["frame_ms"]["runs"], 3);
    assert!(lod["frame_ms"]["p95"].as_f64() >= lod["frame_ms"]["median"].as_f64());
    assert!(lod["fps"].as_f64().unwrap() > 0.0);
    for key in [
        "device",
        "driver",
        "stage_ms",
        "representations",
        "culled",
        "occluded",
    ] {
        assert!(!lod[key].is_null(), "{key}");
    }
    // One draw for the submesh, at most three for its impostors, and what does not depend on the crowd.
    let few = draw(&["--runs", "1"]);
    let more = draw(&["--agents", "1000", "--runs", "1"]);
    assert_eq!(more["draw_calls"], few["draw_calls"]);
    assert_eq!(more["agents"], 1000);
    assert!(few["draw_calls"].as_u64().unwrap() <= lod["draw_calls"].as_u64().unwrap() + 3);
    let full = draw(&["--method", "full", "--runs", "1"]);
    assert_eq!(full["triangles"], 4 * 40);
    let calls = full["draw_calls"].as_u64().unwrap();
    assert_eq!(lod["draw_calls"], calls, "seen from above all heads");
    // Another draw for those who hide others.
    let level = ["--method", "lod", "--camera", "level", "--runs", "1"];
    assert_eq!(draw(&level)["draw_calls"], calls + 1);
    let unhidden = draw(&[&level[..], &["--occlusion", "off"]].concat());
    assert_eq!(unhidden["draw_calls"], calls);
    assert_eq!(unhidden["occluded"], 0);
    let one_by_one = draw(&["--method", "uninstanced", "--runs", "1"]);
    assert_eq!(one_by_one["draw_calls"], 40 + calls - 1);
}

#[test]
fn the_same_scene_gives_the_same_picture_and_options_change_it() {
    let (folder, scene) = scene_of_tetrahedra();
    let picture = folder.path().join("a.png");
    let draw = |more: &[&str]| {
        let fixed = ["render", &scene, "-o", picture.to_str().unwrap()];
        succeed(&[&fixed[..], &["--size", "96x64"], more].concat());
        std::fs::read(&picture).unwrap()
    };
    let first = draw(&[]);
    assert_eq!(first, draw(&[]));
    for option in [
        &["--seed", "5"][..],
        &["--camera", "far"],
        &["--view", "top"],
        &["--supersample", "2"],
        &["--agents", "3"],
    ] {
        assert_ne!(first, draw(option), "{option:?}");
    }
}

/// One character without a scene: the camera finds it, and it fills the picture without leaving it.
#[test]
fn a_character_alone_is_framed() {
    let folder = tempfile::tempdir().unwrap();
    let source = tetrahedron(folder.path(), "tetra", 3);
    let picture = folder.path().join("a.png");
    for view in ["front", "side", "back", "three-quarter"] {
        let (source, out) = (source.to_str().unwrap(), picture.to_str().unwrap());
        succeed(&[
            "render",
            "--character",
            source,
            "--view",
            view,
            "--size",
            "64x64",
            "-o",
            out,
        ]);
        let image = pixels(&picture);
        // The tetrahedron is as white as the light makes it; a horizontal scan through its lower half meets two edges.
        let row: Vec<_> = (0..64).map(|x| image.get_pixel(x, 44).0).collect();
        let steps = row
            .windows(2)
            .filter(|w| w[0][0].abs_diff(w[1][0]) > 12)
            .count();
        assert!(steps >= 2, "{view}: {row:?}");
    }
}

/// Files in centimetres and in kilometres stand beside each other as large as one in metres, and people the plaza as such;
/// a scene that says a scale is obeyed.
#[test]
fn characters_of_other_units_are_drawn_in_metres() {
    let (folder, scene) = scene_of_tetrahedra();
    let metres = folder.path().join("tetra.gltf");
    let picture = folder.path().join("a.png");
    let out = picture.to_str().unwrap();
    let scaled = |name: &str, factor: f32| {
        let text = std::fs::read_to_string(&metres).unwrap();
        let mut text = json(&text);
        text["nodes"][0]["scale"] = serde_json::json!([factor, factor, factor]);
        let path = folder.path().join(name);
        std::fs::write(&path, text.to_string()).unwrap();
        path.to_str().unwrap().to_string()
    };
    let (centimetres, kilometres) = (scaled("cm.gltf", 100.0), scaled("km.gltf", 0.001));
    let draw = |source: &str, more: &[&str]| {
        let fixed = ["render", "-c", source, "--size", "64x64", "-o", out];
        let drawn = throng(&[&fixed[..], more].concat());
        assert_eq!(drawn.status.code(), Some(0), "{}", stderr(&drawn));
        (pixels(&picture), stderr(&drawn))
    };
    for more in [&[][..], &["--agents", "300"]] {
        let (expected, said) = draw(metres.to_str().unwrap(), more);
        assert_eq!(said.matches("as large").count(), 0, "{said}");
        for (source, factor) in [
            (&centimetres, "drawn 0.01 times"),
            (&kilometres, "drawn 1000"),
        ] {
            let (drawn, said) = draw(source, more);
            assert_eq!(said.matches(factor).count(), 1, "{said}");
            let differ = drawn.pixels().zip(expected.pixels());
            let differ = differ.filter(|(a, b)| (0..3).any(|i| a.0[i].abs_diff(b.0[i]) > 8));
            assert!(differ.count() < 64 * 64 / 100, "{source}");
        }
    }
    let text = std::fs::read_to_string(&scene).unwrap();
    std::fs::write(&scene, text.replace("tetra.gltf", "cm.gltf")).unwrap();
    let drawn = throng(&["render", &scene, "--size", "64x64", "-o", out]);
    assert_eq!(stderr(&drawn), "");
}

#[test]
fn frames_are_numbered() {
    let (folder, scene) = scene_of_tetrahedra();
    let out = folder.path().join("film/a.png");
    let report = folder.path().join("r.json");
    let fixed = [
        "render", &scene, "--size", "32x32", "--runs", "1", "--frames", "8-10",
    ];
    let files = [
        "-o",
        out.to_str().unwrap(),
        "--report",
        report.to_str().unwrap(),
    ];
    let said = succeed(&[&fixed[..], &files].concat());
    assert_eq!(said.lines().count(), 3);
    for n in 8..=10 {
        assert!(folder.path().join(format!("film/a_{n:04}.png")).is_file());
    }
    let reports = json(&std::fs::read_to_string(report).unwrap());
    assert_eq!(reports.as_array().unwrap().len(), 3);
    let time = reports[2]["time_s"].as_f64().unwrap();
    assert!((time - 10.0 / 30.0).abs() < 1e-6);
}

#[test]
fn what_cannot_be_drawn_is_refused_by_name() {
    let (folder, scene) = scene_of_tetrahedra();
    let out = folder.path().join("a.png");
    let draw = |more: &[&str]| refuse(&[&["render", "-o", out.to_str().unwrap()], more].concat());
    assert!(draw(&["moon"]).contains("moon: there is no such built-in scene; there are street, "));
    assert!(draw(&["moon.toml"]).contains("moon.toml: cannot be read"));
    assert!(draw(&[&scene, "--camera", "x"]).contains("--camera x: the scene has near, far"));
    assert!(draw(&[&scene, "--device", "toaster"]).contains("toaster"));
    assert!(draw(&[&scene, "--size", "9"]).contains("WIDTHxHEIGHT"));
    assert!(draw(&[&scene, "--size", "60000x60000"]).contains("60000x60000"));
    assert!(draw(&[&scene, "--pixel-error", "nan"]).contains("--pixel-error"));
    assert!(draw(&[&scene, "--frame", "1", "--time", "2"]).contains("--time"));
    assert!(draw(&["-c", "no/such.glb"]).contains("no/such.glb: cannot be read"));
    assert!(draw(&["-c", "builtin:nobody"]).contains("nobody"));
    assert!(
        draw(&[&scene, "--clip", "dance"]).contains("--clip dance: there is none; tetra has rest")
    );
    let negative = draw(&[&scene, "--agents", "-3"]);
    assert!(
        negative.contains("--agents") && negative.contains("invalid value '-3'"),
        "{negative}"
    );
    assert!(draw(&[&scene, "--agents", "10000001"]).contains("the most is 10000000"));
    let text = std::fs::read_to_string(&scene).unwrap();
    std::fs::write(
        &scene,
        text.replace("height = 1.5", "").replace("source", "#"),
    )
    .unwrap();
    assert!(draw(&[&scene]).contains("missing field `source`"));
    std::fs::write(&scene, &text[text.find("[[crowd]]").unwrap()..]).unwrap();
    assert!(draw(&[&scene]).contains("the scene has no [[character]]"));
    std::fs::write(&scene, text.replace("\"far\"", "\"near\"")).unwrap();
    assert!(draw(&[&scene]).contains("scene.toml: camera 2 'near': another camera"));
    let two = text.replace(
        "[[crowd]]",
        "[[character]]\nsource = \"b/tetra.glb\"\n[[crowd]]\ncharacters = [\"tetra\"]",
    );
    std::fs::write(&scene, two).unwrap();
    assert!(draw(&[&scene]).contains("crowd 1: 2 characters are called 'tetra'"));
    std::fs::write(&scene, text.replace("count", "cuont")).unwrap();
    let message = draw(&[&scene]);
    assert!(
        message.contains("scene.toml: line 6: ") && message.contains("cuont"),
        "{message}"
    );
    assert!(!out.exists());
}

/// The whole way of a built-in character: made, written, baked, looked at, exported, drawn.
#[test]
fn a_built_in_character_goes_all_the_way() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let models = path("models");
    let written = succeed(&["characters", "dog", "--write", &models]);
    assert_eq!(written.trim(), path("models/dog.glb"));
    let (glb, baked) = (path("models/dog.glb"), path("dog.throng"));
    succeed(&["bake", &glb, "-o", &baked]);
    let contents = json(&succeed(&["inspect", &baked, "--json"]));
    assert_eq!(contents["name"], "dog");
    assert!((3000..=8000).contains(&contents["triangle_count"].as_u64().unwrap()));
    let per_vertex = contents["bytes_per_vertex"]["total"].as_f64().unwrap();
    assert!(per_vertex <= 80.0, "{per_vertex}");

    // Whoever writes dog.groups.toml finds its joints' names, and which go together by rule.
    let joints = contents["joints"].as_array().unwrap();
    assert_eq!(contents["joint_count"], joints.len());
    let quads = contents["impostors"]["kinds"][0]["quads"]
        .as_array()
        .unwrap();
    let group_of = |joint: &serde_json::Value| {
        let group = joint["flat_group"].as_str().expect("by rule, all have one");
        assert!(quads.iter().any(|q| q["name"] == group), "{group}");
        group.to_string()
    };
    let groups: BTreeSet<String> = joints.iter().map(group_of).collect();
    assert_eq!(groups.len(), quads.len());
    let head = joints.iter().find(|j| j["name"] == "head").unwrap();
    let above = &head["parent"];
    assert!(joints.iter().any(|j| j["name"] == *above), "{above}");
    let said = succeed(&["inspect", &baked, "--joints"]);
    assert!(said.contains("  head "), "{said}");
    assert!(!succeed(&["inspect", &baked]).contains("  head "));

    let few = path("dog_40.glb");
    succeed(&["export", &baked, "--triangles", "40", "-o", &few]);
    let fewer = json(&succeed(&["inspect", &few, "--json"]));
    let triangle_count = fewer["triangle_count"].as_u64().unwrap();
    assert!((20..=40).contains(&triangle_count), "{triangle_count}");
    // Joints that no vertex of the level follows any more do not come back.
    assert!(fewer["joint_count"].as_u64() <= contents["joint_count"].as_u64());
    assert_eq!(fewer["clips"].as_array().unwrap().len(), 3);

    let (picture, report) = (path("dogs.png"), path("dogs.json"));
    let drawn = [
        "--agents", "300", "--size", "160x120", "--report", &report, "--runs", "1",
    ];
    succeed(
        &[
            &["render", "plaza", "-c", &baked, "-o", &picture][..],
            &drawn,
        ]
        .concat(),
    );
    let report = json(&std::fs::read_to_string(report).unwrap());
    assert_eq!(report["agents"], 300);
    assert!(report["draw_calls"].as_u64().unwrap() <= 32);
    assert!(refuse(&["characters", "unicorn"]).contains("unicorn"));
}

/// The demo, small: every built-in character is made, baked and drawn, and the table has its rows.
#[test]
fn the_demo_draws_and_says_what_it_cost() {
    let folder = tempfile::tempdir().unwrap();
    let (picture, report) = (
        folder.path().join("out/demo.png"),
        folder.path().join("r.json"),
    );
    let said = succeed(&[
        "demo",
        "--agents",
        "400",
        "--runs",
        "2",
        "--size",
        "160x120",
        "-o",
        picture.to_str().unwrap(),
        "--report",
        report.to_str().unwrap(),
    ]);
    for row in [
        "device",
        "agents",
        "visible",
        "draw calls",
        "triangles",
        "vertex-shader runs",
        "select ms",
        "mesh ms",
        "frames per second",
    ] {
        assert!(said.contains(row), "{row}: {said}");
    }
    assert_eq!(pixels(&picture).dimensions(), (160, 120));
    let report = json(&std::fs::read_to_string(report).unwrap());
    assert_eq!(report["agents"], 400);
    assert!(report["draw_calls"].as_u64().unwrap() <= 32);
    assert!(report["triangles"].as_u64().unwrap() > 0);
}

/// A source file is baked once; what is damaged in the cache is baked again and said, and without the cache it is not touched.
#[test]
fn baked_characters_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let source = tetrahedron(folder.path(), "kept", 3);
    let cache = folder.path().join("cache");
    let files = || -> Vec<PathBuf> {
        let entries = std::fs::read_dir(cache.join("throng"))
            .into_iter()
            .flatten();
        entries.map(|e| e.unwrap().path()).collect()
    };
    let export = |out: &str, more: &[&str]| {
        let out = folder.path().join(out);
        let mut arguments = vec!["export", source.to_str().unwrap(), "--fraction", "1", "-o"];
        arguments.push(out.to_str().unwrap());
        arguments.extend(more);
        let output = throng_with_cache(&cache, &arguments);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        (std::fs::read(&out).unwrap(), stderr(&output))
    };
    let fresh = export("a.glb", &["--no-cache"]).0;
    assert_eq!(files(), Vec::<PathBuf>::new());
    assert_eq!(export("b.glb", &[]).0, fresh);
    let kept = files();
    assert_eq!(kept.len(), 1, "{kept:?}");
    let bytes = std::fs::read(&kept[0]).unwrap();
    assert_eq!(export("c.glb", &[]), (fresh.clone(), String::new()));
    std::fs::write(&kept[0], &bytes[..bytes.len() / 2]).unwrap();
    let (again, said) = export("d.glb", &[]);
    assert_eq!(again, fresh);
    assert!(said.contains("baking it again"), "{said}");
    assert_eq!(std::fs::read(&kept[0]).unwrap(), bytes);
    // Another character, though only the file beside the source changed, is another file.
    tetrahedron(folder.path(), "kept", 0);
    export("e.glb", &[]);
    assert_eq!(files().len(), 2);
}
