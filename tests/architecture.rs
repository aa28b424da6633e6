//! The rules of ARCHITECTURE.md that only the sources show.

use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Files below a folder of the repository with one of the extensions.
fn files(folder: &str, extensions: &[&str]) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![root().join(folder)];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap().flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if path
                .extension()
                .is_some_and(|e| extensions.iter().any(|x| e == *x))
            {
                found.push(path);
            }
        }
    }
    assert!(!found.is_empty(), "{folder} has no such files");
    found
}

/// The first line of `text`, comments apart, that has `word` as a word of its own.
fn line_with<'a>(text: &'a str, word: &str) -> Option<&'a str> {
    text.lines().find(|line| {
        let code = line.split("//").next().unwrap_or("");
        code.split(|c: char| !c.is_alphanumeric() && c != '_')
            .any(|w| w == word)
    })
}

#[test]
fn words_are_found_in_code_and_not_in_comments() {
    let text = "use vast::x; // ash\n/// ash\nlet y = ash::vk;";
    assert_eq!(line_with(text, "ash"), Some("let y = ash::vk;"));
    assert_eq!(line_with(text, "y"), Some("let y = ash::vk;"));
    assert_eq!(line_with(text, "as"), None);
}

/// Unsafe code stands in src/gpu alone. The compiler refuses it elsewhere, but not in examples of the documentation.
#[test]
fn unsafe_stands_in_gpu_alone() {
    for folder in ["src", "bake/src"] {
        for file in files(folder, &["rs"]) {
            if file.starts_with(root().join("src/gpu")) {
                continue;
            }
            let text = std::fs::read_to_string(&file).unwrap();
            for code in ["unsafe fn", "unsafe {", "unsafe impl", "unsafe trait"] {
                assert!(!text.contains(code), "{}: {code}", file.display());
            }
        }
    }
}

/// The twins are plain Rust: what they compute cannot come from the device.
#[test]
fn twins_and_bake_never_see_vulkan() {
    for folder in ["src/reference", "src/scene", "bake/src"] {
        for file in files(folder, &["rs"]) {
            let text = std::fs::read_to_string(&file).unwrap();
            for word in ["ash", "vk", "gpu", "gpu_allocator"] {
                let found = line_with(&text, word);
                assert_eq!(found, None, "{} names {word}", file.display());
            }
        }
    }
    let manifest = std::fs::read_to_string(root().join("bake/Cargo.toml")).unwrap();
    for word in ["ash", "gpu-allocator", "throng ="] {
        assert!(!manifest.contains(word), "bake depends on {word}");
    }
}

/// The frame is fed with baked characters only: no source format is parsed behind the renderer's back.
#[test]
fn the_renderer_never_imports() {
    for file in files("src", &["rs"]) {
        let name = file.strip_prefix(root()).unwrap();
        if name.starts_with("src/cli") {
            continue;
        }
        let text = std::fs::read_to_string(&file).unwrap();
        for word in ["import", "people", "simplify"] {
            assert_eq!(
                line_with(&text, word),
                None,
                "{} names {word}",
                name.display()
            );
        }
    }
}

/// A stage has the same name everywhere: hlsl/NAME.hlsl and src/NAME.rs, and where the shader names a twin, it exists.
#[test]
fn every_stage_has_its_host_side_and_the_twin_that_it_names() {
    for shader in files("hlsl", &["hlsl"]) {
        let stage = shader.file_stem().unwrap().to_str().unwrap();
        if stage.ends_with("_probe") {
            continue;
        }
        let host = root().join(format!("src/{stage}.rs"));
        assert!(host.is_file(), "{stage} has no src/{stage}.rs");
        let text = std::fs::read_to_string(&shader).unwrap();
        if let Some((_, twin)) = text.split_once("Twin: ") {
            let twin = twin
                .split_whitespace()
                .next()
                .unwrap()
                .trim_end_matches('.');
            let twin = if twin.ends_with(".rs") {
                twin.to_string()
            } else {
                format!("{twin}.rs")
            };
            assert!(
                root().join(&twin).is_file(),
                "{stage}: {twin} does not exist"
            );
        }
    }
}
