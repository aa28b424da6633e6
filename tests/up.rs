//! Source files with another axis up.

#[path = "common/program.rs"]
mod program;

use program::*;

/// An OBJ file lies down where z is up in it, unless the command line or a scene says so.
#[test]
fn a_source_file_may_have_z_up() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let pole = path("pole.obj");
    let text = "v 0 0 0\nv 0.2 0 0\nv 0 0.2 0\nv 0 0 2\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";
    std::fs::write(&pole, text).unwrap();
    let drawn = |name: &str, arguments: &[&str]| {
        let out = path(name);
        let size = ["--size", "64x64", "--method", "lod", "-o", &out];
        succeed(&[&["render"], arguments, &size].concat());
        std::fs::read(out).unwrap()
    };
    let standing = drawn("a.png", &["-c", &pole, "--up", "z"]);
    assert_ne!(drawn("b.png", &["-c", &pole]), standing);
    let baked = path("pole.throng");
    let none = ["--impostors", "none", "-o", &baked];
    succeed(&[&["bake", &pole, "--up", "z"][..], &none].concat());
    assert_eq!(drawn("c.png", &["-c", &baked]), standing);

    let scene = |up: &str| {
        let scene = path("scene.toml");
        let text = format!(
            "[[character]]\nsource = 'pole.obj'\n{up}\n[[crowd]]\npositions = [[0, 0, 0]]\nheading_deg = 0\n\
             [[camera]]\nposition = [0, 1, 6]\ntarget = [0, 1, 0]"
        );
        std::fs::write(&scene, text).unwrap();
        drawn("d.png", &[&scene])
    };
    assert_ne!(scene(""), scene("up = 'z'"));
    assert_eq!(scene(""), scene("up = 'y'"));

    let message = refuse(&["inspect", &baked, "--up", "z"]);
    assert!(message.contains("for source files"), "{message}");
    let message = refuse(&["bake", "builtin:dog", "--up", "z", "-o", &baked]);
    assert!(
        message.contains("builtin:dog: its up axis is y"),
        "{message}"
    );
}
