//! What `write_glb` writes, read back from the bytes. Set `THRONG_KEEP_GLB` to a folder to keep the files and run the Khronos
//! validator over them.

use std::path::Path;

use glam::{Mat4, Quat, Vec2, Vec3};
use serde_json::Value;
use throng_bake::character::{
    Alpha, Character, Clip, Image, Interpolation, Joint, Material, Node, Part, Property, Track,
    Transform,
};
use throng_bake::glb::write_glb;

/// Everything that the format offers in one small character: two roots, two joints on one node, an image, a mask, vertex
/// colours, all interpolations, repeated key times, a clip without tracks, a weight sum that is off.
fn awkward() -> Character {
    let node = |name: &str, parent, translation| Node {
        name: name.into(),
        parent,
        rest: Transform {
            translation,
            ..Transform::IDENTITY
        },
    };
    let joint = |node, y: f32| Joint {
        node,
        joint_from_bind: Mat4::from_translation(Vec3::new(0.0, -y, 0.0)),
    };
    let track = |node, property, interpolation, times_s: &[f32], values: &[f32]| Track {
        node,
        property,
        interpolation,
        times_s: times_s.to_vec(),
        values: values.to_vec(),
    };
    let q = Quat::from_rotation_x(0.7).to_array();
    let part = Part {
        name: "leaf".into(),
        material: 0,
        positions: vec![
            Vec3::ZERO,
            Vec3::X,
            Vec3::new(0.0, 1.1, 0.0),
            Vec3::new(1.0, 1.3, 0.1),
        ],
        normals: vec![Vec3::Z, Vec3::Z, Vec3::Z, Vec3::new(0.0, 0.0, 3.0)],
        uvs: vec![Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE],
        colors: vec![[1.0, 0.5, 0.25, 1.0]; 4],
        joints: vec![[0, 1, 2, 3], [2, 2, 0, 0], [1, 0, 3, 0], [3, 0, 0, 0]],
        weights: vec![
            [0.4, 0.3, 0.2, 0.1003],
            [0.5, 0.5, 0.0, 0.0],
            [0.7, 0.3, 0.0, 0.0],
            [1.0, 0.0, 0.0, 0.0],
        ],
        triangles: vec![[0, 1, 2], [1, 3, 2]],
    };
    let mut plain = part.clone();
    plain.name = String::new();
    plain.material = 1;
    plain.uvs.clear();
    plain.colors.clear();
    Character {
        name: "awkward".into(),
        parts: vec![part, plain],
        materials: vec![
            Material {
                name: "Leaf".into(),
                base_color: [0.5, 1.0, 1.0, 1.0],
                base_color_image: Some(0),
                alpha: Alpha::Mask(0.4),
                double_sided: true,
            },
            Material::default(),
        ],
        images: vec![Image {
            name: "dots".into(),
            width: 2,
            height: 1,
            pixels: vec![[255, 0, 0, 255], [0, 255, 0, 0]],
        }],
        nodes: vec![
            node("root", None, Vec3::ZERO),
            node("knee", Some(0), Vec3::new(0.0, 0.1 + 0.2, 0.0)),
            node("other root", None, Vec3::X),
        ],
        joints: vec![joint(0, 0.0), joint(1, 0.3), joint(1, 0.5), joint(2, 0.0)],
        clips: vec![
            Clip {
                name: "walk".into(),
                duration_s: 1.0,
                ground_speed: 1.4,
                tracks: vec![
                    track(
                        1,
                        Property::Rotation,
                        Interpolation::Linear,
                        &[0.0, 0.5, 0.5, 1.0],
                        [q, Quat::IDENTITY.to_array(), q, q].as_flattened(),
                    ),
                    track(
                        1,
                        Property::Translation,
                        Interpolation::CubicSpline,
                        &[0.0, 1.0],
                        &[0.25; 18],
                    ),
                    track(
                        0,
                        Property::Translation,
                        Interpolation::CubicSpline,
                        &[0.0],
                        &[0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0],
                    ),
                    track(2, Property::Scale, Interpolation::Step, &[0.25], &[2.0; 3]),
                ],
            },
            Clip {
                name: "hold".into(),
                duration_s: 0.5,
                ..Clip::default()
            },
        ],
        warnings: Vec::new(),
    }
}

/// A quad under one joint that does nothing.
fn statue() -> Character {
    let mut c = awkward();
    c.nodes.truncate(1);
    c.joints.truncate(1);
    c.clips.clear();
    for part in &mut c.parts {
        part.joints.fill([0; 4]);
        part.weights.fill([1.0, 0.0, 0.0, 0.0]);
    }
    c
}

fn keep(name: &str, bytes: &[u8]) {
    if let Some(folder) = std::env::var_os("THRONG_KEEP_GLB") {
        std::fs::write(Path::new(&folder).join(name), bytes).unwrap();
    }
}

/// The JSON and the binary chunk, after the header's lengths are checked.
fn chunks(bytes: &[u8]) -> (Value, &[u8]) {
    let u32_at = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!(&bytes[..4], b"glTF");
    assert_eq!((u32_at(4), u32_at(8)), (2, bytes.len()));
    let text_bytes = u32_at(12);
    let binary = 20 + text_bytes;
    assert_eq!(
        (&bytes[16..20], &bytes[binary + 4..binary + 8]),
        (&b"JSON"[..], &b"BIN\0"[..])
    );
    assert_eq!(binary + 8 + u32_at(binary), bytes.len());
    let json = serde_json::from_slice(&bytes[20..binary]).unwrap();
    (json, &bytes[binary + 8..])
}

fn floats(json: &Value, bytes: &[u8], accessor: &Value) -> Vec<f32> {
    let view = &json["accessors"][accessor.as_u64().unwrap() as usize]["bufferView"];
    let view = &json["bufferViews"][view.as_u64().unwrap() as usize];
    let [start, length] = ["byteOffset", "byteLength"].map(|k| view[k].as_u64().unwrap() as usize);
    bytes[start..start + length]
        .chunks_exact(4)
        .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
        .collect()
}

#[test]
fn positions_keys_and_matrices_come_back_bit_for_bit() {
    let c = awkward();
    c.validate(Path::new("awkward")).unwrap();
    let bytes = write_glb(&c).unwrap();
    keep("awkward.glb", &bytes);
    let (json, binary) = chunks(&bytes);
    let primitive = &json["meshes"][0]["primitives"][0];
    let read = |accessor: &Value| floats(&json, binary, accessor);
    assert_eq!(
        read(&primitive["attributes"]["POSITION"]),
        bytemuck::cast_slice::<_, f32>(&c.parts[0].positions)
    );
    assert_eq!(
        read(&primitive["attributes"]["TEXCOORD_0"]),
        bytemuck::cast_slice::<_, f32>(&c.parts[0].uvs)
    );
    let matrices = read(&json["skins"][0]["inverseBindMatrices"]);
    assert_eq!(
        &matrices[16..32],
        &c.joints[1].joint_from_bind.to_cols_array()
    );
    assert_eq!(
        json["nodes"][1]["translation"][1].as_f64().unwrap() as f32,
        c.nodes[1].rest.translation.y
    );
    let walk = &json["animations"][0];
    assert_eq!(walk["extras"]["ground_speed"].as_f64(), Some(1.4f32.into()));
    assert!(json["animations"][1].get("extras").is_none());
    let names: Vec<_> = (0..4)
        .map(|i| walk["samplers"][i]["interpolation"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["LINEAR", "CUBICSPLINE", "STEP", "STEP"]);
    assert_eq!(
        read(&walk["samplers"][0]["output"]),
        c.clips[0].tracks[0].values
    );
    assert_eq!(read(&walk["samplers"][2]["output"]), [1.0, 2.0, 3.0]);
    let times_s = read(&walk["samplers"][0]["input"]);
    assert_eq!((times_s[1], times_s[2]), (0.5, 0.5f32.next_up()));
}

#[test]
fn influences_sum_to_one_and_name_no_joint_twice() {
    let bytes = write_glb(&awkward()).unwrap();
    let (json, binary) = chunks(&bytes);
    let attributes = &json["meshes"][0]["primitives"][0]["attributes"];
    let weights = floats(&json, binary, &attributes["WEIGHTS_0"]);
    for w in weights.chunks_exact(4) {
        let sum: f64 = w.iter().map(|&x| f64::from(x)).sum();
        assert!((sum - 1.0).abs() < 2e-7, "{w:?}");
    }
    assert_eq!(&weights[4..8], [1.0, 0.0, 0.0, 0.0]);
    let joints = json["skins"][0]["joints"].as_array().unwrap();
    assert_eq!(joints.len(), 4);
    assert_eq!(json["nodes"][1]["children"][0], joints[2]);
    let mut distinct = joints
        .iter()
        .map(|j| j.as_u64().unwrap())
        .collect::<Vec<_>>();
    distinct.sort_unstable();
    distinct.dedup();
    assert_eq!(distinct.len(), 4);
}

#[test]
fn a_static_character_has_no_skin() {
    let bytes = write_glb(&statue()).unwrap();
    keep("statue.glb", &bytes);
    let (json, _) = chunks(&bytes);
    assert!(json.get("skins").is_none() && json.get("animations").is_none());
    let attributes = &json["meshes"][0]["primitives"][0]["attributes"];
    assert!(attributes.get("JOINTS_0").is_none());
}

#[test]
fn same_character_same_bytes() {
    assert_eq!(
        write_glb(&awkward()).unwrap(),
        write_glb(&awkward()).unwrap()
    );
}
