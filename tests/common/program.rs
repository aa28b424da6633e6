//! The program from outside: running it, and small things to give it.

#![allow(dead_code)] // each test binary uses some of them

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

pub fn throng(arguments: &[&str]) -> Output {
    throng_with_cache(Path::new(env!("CARGO_TARGET_TMPDIR")), arguments)
}

/// The user's own cache stays as it is.
pub fn throng_with_cache(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_throng"))
        .args(arguments)
        .env("XDG_CACHE_HOME", folder)
        .output()
        .expect("the binary runs")
}

pub fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Runs it, and fails the test with what it said where it did not end well.
pub fn succeed(arguments: &[&str]) -> String {
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
pub fn refuse(arguments: &[&str]) -> String {
    let output = throng(arguments);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}");
    assert_eq!(stdout(&output), "", "{arguments:?}");
    stderr(&output)
}

pub fn json(text: &str) -> serde_json::Value {
    serde_json::from_str(text).expect("valid JSON")
}

/// A static tetrahedron as glTF, whose `indices` accessor can be spoiled.
pub fn tetrahedron(folder: &Path, name: &str, index: u16) -> PathBuf {
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

/// A scene of tetrahedra, and its folder.
pub fn scene_of_tetrahedra() -> (tempfile::TempDir, String) {
    let folder = tempfile::tempdir().unwrap();
    tetrahedron(folder.path(), "tetra", 3);
    let scene = folder.path().join("scene.toml");
    let text = r#"
        [[character]]
        source = "tetra.gltf"
        height = 1.5
        [[crowd]]
        count = 40
        area.rectangle = { size = [8, 8] }
        [[camera]]
        name = "near"
        position = [0, 6, 14]
        [[camera]]
        name = "far"
        position = [0, 60, 140]
        [[camera]]
        name = "level"
        position = [0, 1.2, 14]
    "#;
    std::fs::write(&scene, text).unwrap();
    let name = scene.to_str().unwrap().to_string();
    (folder, name)
}
