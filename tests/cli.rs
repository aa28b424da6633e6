//! The command line from outside: what it prints, what it refuses, what it leaves behind.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn throng(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_throng"))
        .args(arguments)
        .output()
        .expect("the binary runs")
}

fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Runs it, and fails the test with what it said where it did not end well.
fn succeed(arguments: &[&str]) -> String {
    let output = throng(arguments);
    assert_eq!(
        output.status.code(),
        Some(0),
        "{arguments:?}: {}",
        stderr(&output)
    );
    stdout(&output)
}

/// Runs it, expects status 2, and returns what it said.
fn refuse(arguments: &[&str]) -> String {
    let output = throng(arguments);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}");
    assert_eq!(stdout(&output), "", "{arguments:?}");
    stderr(&output)
}

fn json(text: &str) -> serde_json::Value {
    serde_json::from_str(text).expect("valid JSON")
}

/// A static tetrahedron as glTF, whose `indices` accessor can be spoiled.
fn tetrahedron(folder: &Path, name: &str, index: u16) -> PathBuf {
    let positions: [f32; 12] = [0., 0., 0., 1., 0., 0., 0., 2., 0., 0., 0., 1.];
    let indices: [u16; 12] = [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, index];
    let bytes: Vec<u8> = positions
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .chain(indices.iter().flat_map(|i| i.to_le_bytes()))
        .collect();
    std::fs::write(folder.join(format!("{name}.bin")), bytes).unwrap();
    let text = serde_json::json!({
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"uri": format!("{name}.bin"), "byteLength": 72}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 24}
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 2, 1]},
            {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"}
        ]
    });
    let path = folder.join(format!("{name}.gltf"));
    std::fs::write(&path, text.to_string()).unwrap();
    path
}

#[test]
fn help_teaches_every_command() {
    let help = succeed(&["--help"]);
    let commands = ["bake", "inspect", "export"];
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
