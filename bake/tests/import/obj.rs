//! OBJ files.

use std::path::Path;

use throng_bake::character::{Alpha, Character, UpAxis};
use throng_bake::error::ImportError;
use throng_bake::import::{import, import_bytes};
use throng_bake::pose;

use crate::sample::Sample;

fn read(text: &str) -> Result<Character, ImportError> {
    import_bytes(Path::new("dir/thing.obj"), text.as_bytes())
}

const QUAD: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n";

#[test]
fn a_quad_becomes_two_triangles_on_one_joint() {
    let c = read(&format!("{QUAD}f 1/1 2/2 3/3 4/4\n")).unwrap();
    assert_eq!(c.name, "thing");
    assert_eq!((c.joints.len(), c.nodes.len(), c.clips.len()), (1, 1, 0));
    let part = &c.parts[0];
    assert_eq!(part.triangles, [[0, 1, 2], [0, 2, 3]]);
    assert!(
        part.normals
            .iter()
            .all(|n| n.distance(glam::Vec3::Z) < 1e-6)
    );
    // v runs from the bottom in OBJ, from the top here.
    assert_eq!(part.uvs[0].to_array(), [0.0, 1.0]);
    assert_eq!(part.uvs[2].to_array(), [1.0, 0.0]);
    assert_eq!(part.weights[3], [1.0, 0.0, 0.0, 0.0]);
}

#[test]
fn a_missing_library_is_a_warning() {
    let c = read(&format!("mtllib none.mtl\n{QUAD}usemtl red\nf 1 2 3\n")).unwrap();
    assert!(c.warnings[0].contains("none.mtl"), "{:?}", c.warnings);
    assert_eq!(c.materials.len(), 1);
}

#[test]
fn libraries_are_found_whatever_path_they_are_named_by() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write(
        "a b.mtl",
        "newmtl red\nKd 1 0.5 0\nnewmtl glass\nd 0.4\nmap_Kd C:\\pictures\\gone.png\n",
    );
    let text = "mtllib C:\\work\\a b.mtl\n";
    let faces = "usemtl red\nf 1 2 3\nusemtl glass\nf 1 3 4\nf 1 2\np 1\n";
    write("x.obj", &format!("{text}{QUAD}{faces}"));
    let c = import(&folder.path().join("x.obj")).unwrap();
    assert_eq!(c.materials[0].base_color, [1.0, 0.5, 0.0, 1.0]);
    // Glass would vanish behind a mask of a half, so it is opaque.
    assert_eq!(c.materials[1].alpha, Alpha::Opaque);
    assert_eq!(c.materials[1].base_color[3], 1.0);
    assert_eq!(c.triangle_count(), 2);
    let warnings = c.warnings.join("\n");
    assert!(
        warnings.contains("gone.png") && warnings.contains("'glass' is blended"),
        "{warnings}"
    );
}

#[test]
fn broken_files_are_refused_with_the_line() {
    for (text, place) in [
        ("v 0 0 0\nv 1 x 0\nv 0 1 0\nf 1 2 3\n", "line 2"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "line 4"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -9\n", "line 4"),
        ("v 0 0 0\nv 1 0 0\nv inf 1 0\nf 1 2 3\n", "object"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\n", "meshes"),
        ("", "meshes"),
    ] {
        let error = read(text).unwrap_err().to_string();
        assert!(
            error.contains("thing.obj") && error.contains(place),
            "{error}"
        );
    }
}

#[test]
fn broken_libraries_and_images_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("x.obj", &format!("mtllib x.mtl\n{QUAD}usemtl a\nf 1 2 3\n"));
    write("x.mtl", "newmtl a\nKd red\n");
    let error = import(&folder.path().join("x.obj"))
        .unwrap_err()
        .to_string();
    assert!(error.contains("x.mtl"), "{error}");
    write("x.mtl", "newmtl a\nmap_Kd t.png\n");
    std::fs::write(folder.path().join("t.png"), b"\x89PNG\r\n\x1a\nrubbish").unwrap();
    let error = import(&folder.path().join("x.obj"))
        .unwrap_err()
        .to_string();
    assert!(error.contains("t.png"), "{error}");
}

/// What stands along z stands along y then, and looks the right way, with its skeleton and its clips.
#[test]
fn characters_with_z_up_stand_up() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 -1 2\nvn 0 -1 0\nf 1//1 2//1 3//1\n";
    let mut c = read(text).unwrap();
    let as_read = c.clone();
    c.turn_up(UpAxis::Y);
    assert_eq!(c, as_read);
    c.turn_up(UpAxis::Z);
    c.validate(Path::new("thing.obj")).unwrap();
    let near = |a: glam::Vec3, b: [f32; 3]| a.distance(b.into()) < 1e-5;
    let part = &c.parts[0];
    assert!(near(part.positions[1], [1.0, 0.0, 0.0]));
    assert!(near(part.positions[2], [0.0, 2.0, 1.0]));
    assert!(near(part.normals[0], [0.0, 0.0, 1.0]));

    // Any pose of an animated one is that of before, turned.
    let glb = Sample::skinned().glb();
    let ribbon = import_bytes(Path::new("ribbon.glb"), &glb).unwrap();
    let mut turned = ribbon.clone();
    turned.turn_up(UpAxis::Z);
    turned.validate(Path::new("ribbon.glb")).unwrap();
    let turn = glam::Quat::from_rotation_x(-std::f32::consts::FRAC_PI_2);
    for time in [0.0, 0.3, 0.9] {
        let pose = |c: &Character| -> Vec<glam::Vec3> {
            let palette = pose::palette(c, c.clips.first(), time);
            let part = &c.parts[0];
            let skinned =
                |v| pose::skin(&palette, part.joints[v], part.weights[v], part.positions[v]);
            (0..part.positions.len()).map(skinned).collect()
        };
        assert!(pose(&ribbon) != pose(&turned));
        for (a, b) in pose(&ribbon).into_iter().zip(pose(&turned)) {
            assert!((turn * a).distance(b) < 1e-4, "{a} became {b}");
        }
    }
}
