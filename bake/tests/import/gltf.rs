//! What a glTF file may say, feature by feature, on small files.

use std::path::Path;

use glam::{Affine3A, Mat4, Quat, Vec3};
use serde_json::json;
use throng_bake::character::{Alpha, Character, Interpolation};
use throng_bake::import::import_bytes;
use throng_bake::pose;

use crate::sample::{CORNERS, F32, POSITION, Sample, U8, U16, bytes};

pub fn read(sample: &Sample) -> Character {
    import_bytes(Path::new("test.glb"), &sample.glb()).unwrap()
}

/// Positions of all vertices of all parts at a time of the first clip, or at rest.
pub fn posed(c: &Character, time_s: Option<f32>) -> Vec<Vec3> {
    let clip = time_s.map(|_| &c.clips[0]);
    let palette = pose::palette(c, clip, time_s.unwrap_or(0.0));
    let skin = |part: &throng_bake::character::Part| -> Vec<Vec3> {
        let at =
            |v: usize| pose::skin(&palette, part.joints[v], part.weights[v], part.positions[v]);
        (0..part.positions.len()).map(at).collect()
    };
    c.parts.iter().flat_map(skin).collect()
}

pub fn assert_near(a: &[Vec3], b: &[Vec3], most: f32) {
    assert_eq!(a.len(), b.len());
    for (i, (a, b)) in a.iter().zip(b).enumerate() {
        assert!(a.distance(*b) <= most, "point {i}: {a} and {b}");
    }
}

fn corners() -> Vec<Vec3> {
    CORNERS.map(Vec3::from).to_vec()
}

#[test]
fn the_sample_bends_at_its_joint() {
    let sample = Sample::skinned();
    let c = read(&sample);
    assert_eq!(c.name, "test");
    assert_eq!(c.parts[0].name, "body");
    assert_eq!((c.joints.len(), c.nodes.len()), (2, 2));
    assert_eq!(
        (c.clips[0].name.as_str(), c.clips[0].duration_s),
        ("bend", 1.0)
    );
    assert_eq!(c.clips[0].ground_speed, 1.5);
    assert!(c.warnings.is_empty(), "{:?}", c.warnings);
    assert_near(&posed(&c, None), &corners(), 1e-6);
    let turn = Affine3A::from_translation(Vec3::Y)
        * Affine3A::from_rotation_z(std::f32::consts::FRAC_PI_2)
        * Affine3A::from_translation(-Vec3::Y);
    let bent: Vec<Vec3> = (0..6)
        .map(|v| {
            if v < 3 {
                corners()[v]
            } else {
                turn.transform_point3(corners()[v])
            }
        })
        .collect();
    assert_near(&posed(&c, Some(1.0)), &bent, 1e-6);
    // The same from text with the buffer inside.
    let text = import_bytes(Path::new("test.gltf"), &sample.gltf()).unwrap();
    assert_eq!(text, c);
}

#[test]
fn external_buffers_are_found_beside_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let mut sample = Sample::skinned();
    sample.set("/buffers/0/uri", json!("a%20b.bin"));
    std::fs::write(folder.path().join("a b.bin"), &sample.binary).unwrap();
    let path = folder.path().join("x.gltf");
    std::fs::write(&path, sample.json.to_string()).unwrap();
    let c = throng_bake::import::import(&path).unwrap();
    assert_near(&posed(&c, None), &corners(), 1e-6);
}

#[test]
fn missing_weights_bind_to_the_first_joint() {
    let mut sample = Sample::skinned();
    sample.poke(crate::sample::WEIGHTS, 16 * 4, &bytes(&[0.0f32]));
    let c = read(&sample);
    assert_near(&posed(&c, None), &corners(), 1e-6);
    assert!(
        c.warnings[0].contains("1 vertices have no weights"),
        "{:?}",
        c.warnings
    );
}

#[test]
fn interleaved_and_sparse_data_read_alike() {
    let mut sample = Sample::skinned();
    let mut rows = Vec::new();
    for corner in CORNERS {
        rows.extend(bytes(&[7.0f32, 8.0]));
        rows.extend(bytes(&corner));
    }
    let view = sample.add_view(&rows, json!({"byteStride": 20}));
    let at = sample.add_accessor(json!({
        "bufferView": view, "byteOffset": 8, "componentType": F32, "type": "VEC3", "count": 6
    }));
    sample.set("/meshes/0/primitives/0/attributes/POSITION", json!(at));
    assert_near(&posed(&read(&sample), None), &corners(), 1e-6);

    // Zeros, of which all but the second are replaced; then one moved.
    let indices = sample.add_view(&[0, 2, 3, 4, 5], json!({}));
    let values: Vec<[f32; 3]> = [0, 2, 3, 4, 5].map(|i: usize| CORNERS[i]).to_vec();
    let values = sample.add_view(&bytes(&values), json!({}));
    let at = sample.add_accessor(json!({
        "componentType": F32, "type": "VEC3", "count": 6, "sparse": {
            "count": 5, "indices": {"bufferView": indices, "componentType": U8},
            "values": {"bufferView": values}
        }
    }));
    sample.set("/meshes/0/primitives/0/attributes/POSITION", json!(at));
    let mut expected = corners();
    expected[1] = Vec3::ZERO;
    assert_near(&posed(&read(&sample), None), &expected, 1e-6);
}

#[test]
fn quantised_positions_come_out_in_scene_units() {
    // Signed 16-bit, normalised: x and y of -1..1 stand for -4..4; the inverse bind matrices undo it.
    let mut sample = Sample::skinned();
    let quantised = CORNERS.map(|[x, y, _]| [x, y, 0.0, 0.0].map(|c| (c / 4.0 * 32767.0) as i16));
    let view = sample.add_view(&bytes(&quantised), json!({"byteStride": 8}));
    let at = sample.add_accessor(json!({
        "bufferView": view, "componentType": 5122, "normalized": true, "type": "VEC3", "count": 6
    }));
    let scale = Mat4::from_scale(Vec3::splat(4.0));
    let down = Mat4::from_translation(-Vec3::Y);
    let matrices = [scale.to_cols_array(), (down * scale).to_cols_array()];
    let bind = sample.add(&bytes(&matrices), F32, "MAT4", 2);
    sample
        .set("/extensionsRequired", json!(["KHR_mesh_quantization"]))
        .set("/meshes/0/primitives/0/attributes/POSITION", json!(at))
        .set("/skins/0/inverseBindMatrices", json!(bind));
    let c = read(&sample);
    assert_near(&c.parts[0].positions, &corners(), 1e-3);
    assert_near(
        &posed(&c, Some(0.5)),
        &posed(&read(&Sample::skinned()), Some(0.5)),
        1e-3,
    );
}

#[test]
fn a_skin_scaled_by_a_hundred_binds_in_metres_and_shares_joints() {
    // The second part: the same ribbon in centimetres, its skin's matrices shrink it again.
    let mut sample = Sample::skinned();
    let at = sample.add(
        &bytes(&CORNERS.map(|c| c.map(|x| 100.0 * x))),
        F32,
        "VEC3",
        6,
    );
    let shrink = Mat4::from_scale(Vec3::splat(0.01));
    let down = Mat4::from_translation(-Vec3::Y);
    let matrices = [shrink.to_cols_array(), (down * shrink).to_cols_array()];
    let bind = sample.add(&bytes(&matrices), F32, "MAT4", 2);
    let mut mesh = sample.json["meshes"][0].clone();
    mesh["primitives"][0]["attributes"]["POSITION"] = json!(at);
    let first = sample.json["meshes"][0].clone();
    let skin = sample.json["skins"][0].clone();
    sample.set("/meshes", json!([first, mesh])).set(
        "/skins",
        json!([skin, {"joints": [1, 2], "inverseBindMatrices": bind}]),
    );
    // A skinned node's own place means nothing.
    let nodes = sample.json["nodes"].as_array_mut().unwrap();
    nodes.push(json!({"mesh": 1, "skin": 1, "scale": [100, 100, 100], "translation": [5, 5, 5]}));
    sample.set("/scenes/0/nodes", json!([0, 1, 3]));
    let c = read(&sample);
    assert_eq!((c.parts.len(), c.joints.len()), (2, 2));
    assert_near(&c.parts[1].positions, &c.parts[0].positions, 1e-5);
    let both = posed(&c, Some(0.7));
    assert_near(&both[..6], &both[6..], 1e-5);
}

#[test]
fn bind_space_is_the_rest_pose_where_the_armature_is_scaled_and_turned() {
    let mut sample = Sample::skinned();
    let turn = Quat::from_rotation_x(-std::f32::consts::FRAC_PI_2);
    sample
        .set("/nodes/1/rotation", json!(turn.to_array()))
        .set("/nodes/1/scale", json!([2, 2, 2]));
    let c = read(&sample);
    let expected: Vec<Vec3> = corners().iter().map(|&p| turn * (2.0 * p)).collect();
    assert_near(&c.parts[0].positions, &expected, 1e-5);
    assert_near(&posed(&c, None), &expected, 1e-5);
    let normal = turn * Vec3::Z;
    assert!(c.parts[0].normals.iter().all(|n| n.distance(normal) < 1e-5));
}

#[test]
fn rigid_parts_follow_the_node_above_them_that_moves() {
    let mut sample = Sample::skinned();
    sample.set(
        "/nodes/0",
        json!({"mesh": 0, "translation": [0, 1, 0], "name": "flag"}),
    );
    sample.set("/scenes/0/nodes", json!([1]));
    sample.set("/nodes/2/children", json!([0]));
    let c = read(&sample);
    assert_eq!(c.joints.len(), 1);
    assert_eq!(c.nodes[c.joints[0].node as usize].name, "tip");
    let expected: Vec<Vec3> = corners().iter().map(|&p| p + 2.0 * Vec3::Y).collect();
    assert_near(&posed(&c, None), &expected, 1e-6);
    let turned: Vec<Vec3> = corners()
        .iter()
        .map(|p| Vec3::new(-(p.y + 1.0), p.x + 1.0, 0.0))
        .collect();
    assert_near(&posed(&c, Some(1.0)), &turned, 1e-6);
}

#[test]
fn a_mirrored_node_turns_the_winding() {
    let mut sample = Sample::rigid();
    sample.set("/nodes/0/scale", json!([-1, 1, 1]));
    let c = read(&sample);
    let part = &c.parts[0];
    for t in &part.triangles {
        let [a, b, c] = t.map(|v| part.positions[v as usize]);
        assert!((b - a).cross(c - a).z > 0.0);
    }
    assert!(part.normals.iter().all(|n| n.z > 0.99));
    assert_eq!(part.positions[0].x, 0.5);
}

#[test]
fn matrices_and_scales_of_zero_are_read() {
    let mut sample = Sample::rigid();
    let place = Mat4::from_scale_rotation_translation(
        Vec3::new(1.0, 2.0, 3.0),
        Quat::from_rotation_y(0.3),
        Vec3::new(4.0, 5.0, 6.0),
    );
    sample.set("/nodes/0/matrix", json!(place.to_cols_array()));
    let expected: Vec<Vec3> = corners()
        .iter()
        .map(|&p| place.transform_point3(p))
        .collect();
    assert_near(&posed(&read(&sample), None), &expected, 1e-5);
    // Hidden at rest, and still a shape that a clip may show.
    sample.set("/nodes/0", json!({"mesh": 0, "scale": [0, 0, 0]}));
    let c = read(&sample);
    assert_near(&c.parts[0].positions, &corners(), 1e-6);
}

#[test]
fn strips_and_fans_keep_their_winding() {
    for (mode, order) in [(5, vec![0u16, 1, 2, 3, 4, 5]), (6, vec![2, 0, 1, 3, 5, 4])] {
        let mut sample = Sample::skinned();
        let at = sample.add(&bytes(&order), U16, "SCALAR", order.len());
        sample
            .set("/meshes/0/primitives/0/mode", json!(mode))
            .set("/meshes/0/primitives/0/indices", json!(at));
        let c = read(&sample);
        let part = &c.parts[0];
        assert_eq!(part.triangles.len(), 4);
        assert!(part.normals.iter().all(|n| n.z > 0.99), "mode {mode}");
    }
    let mut sample = Sample::skinned();
    let primitive = sample.json["meshes"][0]["primitives"][0].clone();
    let mut lines = primitive.clone();
    lines["mode"] = json!(1);
    sample.set("/meshes/0/primitives", json!([lines, primitive]));
    let c = read(&sample);
    assert_eq!(c.parts.len(), 1);
    assert!(c.warnings[0].contains("points or lines"));
}

#[test]
fn made_normals_are_smooth_and_keep_sharp_edges() {
    // Two squares that meet at a right angle, over shared vertices: the edge's two are doubled.
    let mut sample = Sample::rigid();
    let corners: [[f32; 3]; 6] = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [1.0, 1.0, 0.0],
        [0.0, 1.0, -1.0],
        [1.0, 1.0, -1.0],
    ];
    let at = sample.add(&bytes(&corners), F32, "VEC3", 6);
    sample.set("/meshes/0/primitives/0/attributes/POSITION", json!(at));
    let part = &read(&sample).parts[0];
    assert_eq!(part.positions.len(), 8);
    for (v, n) in part.normals.iter().enumerate() {
        assert!(n.z > 0.99 || n.y > 0.99, "vertex {v} has {n}");
    }
    for t in &part.triangles {
        let [a, b, c] = t.map(|v| part.positions[v as usize]);
        let face = (b - a).cross(c - a).normalize();
        assert!(t.iter().all(|&v| part.normals[v as usize].dot(face) > 0.99));
    }
}

#[test]
fn degenerate_triangles_and_unused_vertices_go() {
    let mut sample = Sample::skinned();
    let triangles: [u16; 9] = [2, 3, 5, 2, 2, 5, 5, 4, 5];
    let at = sample.add(&bytes(&triangles), U16, "SCALAR", 9);
    sample.set("/meshes/0/primitives/0/indices", json!(at));
    let part = &read(&sample).parts[0];
    assert_eq!(part.triangles, [[0, 1, 2]]);
    assert_near(
        &part.positions,
        &[2, 3, 5].map(|v| Vec3::from(CORNERS[v])),
        1e-6,
    );
}

#[test]
fn more_than_four_influences_become_four_without_moving_the_vertex() {
    // Six joints of which three move as one: four influences can say the same.
    let mut sample = Sample::skinned();
    let joints: [[u8; 4]; 6] = [[0, 1, 2, 3]; 6];
    let more: [[u8; 4]; 6] = [[4, 5, 0, 0]; 6];
    let sets = [
        ("JOINTS_0", sample.add(&bytes(&joints), U8, "VEC4", 6)),
        ("JOINTS_1", sample.add(&bytes(&more), U8, "VEC4", 6)),
        (
            "WEIGHTS_0",
            sample.add(&bytes(&[[0.3f32, 0.2, 0.15, 0.15]; 6]), F32, "VEC4", 6),
        ),
        (
            "WEIGHTS_1",
            sample.add(&bytes(&[[0.1f32, 0.1, 0.0, 0.0]; 6]), F32, "VEC4", 6),
        ),
    ];
    for (key, at) in sets {
        sample.set(
            &format!("/meshes/0/primitives/0/attributes/{key}"),
            json!(at),
        );
    }
    let nodes = sample.json["nodes"].as_array_mut().unwrap();
    for i in 0..4 {
        nodes.push(json!({"name": format!("extra{i}")}));
    }
    sample
        .set("/nodes/2/children", json!([3, 4]))
        .set("/nodes/1/children", json!([2, 5, 6]));
    let mut matrices = [Mat4::IDENTITY.to_cols_array(); 6];
    for m in &mut matrices[1..4] {
        m[13] = -1.0;
    }
    let bind = sample.add(&bytes(&matrices), F32, "MAT4", 6);
    let skin = json!([{"joints": [1, 2, 3, 4, 5, 6], "inverseBindMatrices": bind}]);
    sample.set("/skins", skin);
    let c = read(&sample);
    let part = &c.parts[0];
    assert!(
        part.weights
            .iter()
            .all(|w| (w.iter().sum::<f32>() - 1.0).abs() < 1e-5)
    );
    // Half of every vertex stays, half turns.
    let stays = corners();
    let turns = corners()
        .into_iter()
        .map(|p| Vec3::new(1.0 - p.y, p.x + 1.0, 0.0));
    let expected: Vec<Vec3> = stays
        .iter()
        .zip(turns)
        .map(|(a, b)| (*a + b) / 2.0)
        .collect();
    assert_near(&posed(&c, Some(1.0)), &expected, 2e-3);
    assert!(
        c.warnings[0].contains("6 vertices have more than 4"),
        "{:?}",
        c.warnings
    );
}

#[test]
fn cubic_and_normalised_keys_are_read() {
    let mut sample = Sample::skinned();
    let keys = [
        [0i16; 4],
        [0, 0, 0, 32767],
        [0; 4],
        [0; 4],
        [0, 0, 23170, 23170],
        [0; 4],
    ];
    let view = sample.add_view(&bytes(&keys), json!({}));
    let at = sample.add_accessor(json!({
        "bufferView": view, "componentType": 5122, "normalized": true, "type": "VEC4", "count": 6
    }));
    sample
        .set("/animations/0/samplers/0/output", json!(at))
        .set(
            "/animations/0/samplers/0/interpolation",
            json!("CUBICSPLINE"),
        );
    let c = read(&sample);
    assert_eq!(
        c.clips[0].tracks[0].interpolation,
        Interpolation::CubicSpline
    );
    let plain = read(&Sample::skinned());
    assert_near(&posed(&c, Some(1.0)), &posed(&plain, Some(1.0)), 1e-4);
    assert_near(&posed(&c, Some(0.5)), &posed(&plain, Some(0.5)), 1e-3);
}

#[test]
fn clips_without_names_or_effect() {
    let mut sample = Sample::skinned();
    let mut clip = sample.json["animations"][0].clone();
    clip.as_object_mut().unwrap().remove("name");
    let mut nothing = clip.clone();
    nothing["channels"][0]["target"] = json!({"node": 0, "path": "translation"});
    nothing["samplers"][0]["output"] = json!(POSITION);
    nothing["samplers"][0]["input"] = json!(crate::sample::TIMES);
    let two = sample.add(&bytes(&[[0.0f32; 3]; 2]), F32, "VEC3", 2);
    nothing["samplers"][0]["output"] = json!(two);
    sample.set("/animations", json!([nothing, clip]));
    let c = read(&sample);
    assert_eq!(c.clips.len(), 1);
    assert_eq!(c.clips[0].name, "1");
    assert!(
        c.warnings[0].contains("1 clips move nothing"),
        "{:?}",
        c.warnings
    );
}

#[test]
fn only_the_default_scene_is_drawn() {
    let mut sample = Sample::skinned();
    sample
        .set("/scenes", json!([{"nodes": [0, 1]}, {"nodes": [3]}]))
        .set("/scene", json!(1));
    let nodes = sample.json["nodes"].as_array_mut().unwrap();
    nodes.push(json!({"mesh": 0, "translation": [0, 0, 9]}));
    let c = read(&sample);
    assert_eq!(c.parts.len(), 1);
    assert_eq!(c.parts[0].positions[0].z, 9.0);
}

#[test]
fn materials_colours_and_textures() {
    let mut png = Vec::new();
    let image = image::RgbaImage::from_pixel(2, 1, image::Rgba([255, 128, 0, 64]));
    let mut cursor = std::io::Cursor::new(&mut png);
    image
        .write_to(&mut cursor, image::ImageFormat::Png)
        .unwrap();
    let mut sample = Sample::skinned();
    let view = sample.add_view(&png, json!({}));
    let uvs: [[u16; 2]; 6] = [
        [0, 0],
        [65535, 0],
        [0, 32768],
        [65535, 32768],
        [0, 65535],
        [65535, 65535],
    ];
    let uv_view = sample.add_view(&bytes(&uvs), json!({}));
    let uv = sample.add_accessor(json!({
        "bufferView": uv_view, "componentType": U16, "normalized": true, "type": "VEC2", "count": 6
    }));
    let color_view = sample.add_view(&bytes(&[[255u8, 51, 0, 9]; 6]), json!({"byteStride": 4}));
    let color = sample.add_accessor(json!({
        "bufferView": color_view, "componentType": U8, "normalized": true, "type": "VEC3", "count": 6
    }));
    let quarter = std::f32::consts::FRAC_PI_2;
    sample
        .set("/meshes/0/primitives/0/attributes/TEXCOORD_3", json!(uv))
        .set("/meshes/0/primitives/0/attributes/COLOR_0", json!(color))
        .set("/images", json!([{"bufferView": view, "mimeType": "image/png", "name": "dots"}]))
        .set("/textures", json!([{"source": 0}]))
        .set("/materials", json!([{
            "name": "cloth", "alphaMode": "BLEND", "doubleSided": true,
            "pbrMetallicRoughness": {
                "baseColorFactor": [0.5, 0.25, 1, 1],
                "baseColorTexture": {"index": 0, "texCoord": 1, "extensions": {
                    "KHR_texture_transform": {
                        "texCoord": 3, "offset": [0, 1], "rotation": quarter, "scale": [0.5, 0.5]
                    }
                }}
            }
        }]));
    let c = read(&sample);
    let material = &c.materials[0];
    assert_eq!(material.base_color, [0.5, 0.25, 1.0, 1.0]);
    assert_eq!(
        (material.alpha, material.double_sided),
        (Alpha::Mask(0.5), true)
    );
    assert!(
        c.warnings[0].contains("'cloth' is blended"),
        "{:?}",
        c.warnings
    );
    let image = &c.images[material.base_color_image.unwrap() as usize];
    assert_eq!(
        (image.name.as_str(), image.width, image.height),
        ("dots", 2, 1)
    );
    assert_eq!(image.pixels[1], [255, 128, 0, 64]);
    let part = &c.parts[0];
    assert_eq!(part.colors[2], [1.0, 0.2, 0.0, 1.0]);
    // The extension's own example: the lower left quadrant (v runs down).
    let expected = [
        [0.0, 1.0],
        [0.0, 0.5],
        [0.25, 1.0],
        [0.25, 0.5],
        [0.5, 1.0],
        [0.5, 0.5],
    ];
    for (uv, expected) in part.uvs.iter().zip(expected) {
        assert!(uv.distance(expected.into()) < 1e-4, "{uv}");
    }
}

#[test]
fn specular_glossiness_gives_its_diffuse_colour_and_no_material_is_white() {
    let mut sample = Sample::skinned();
    let extension = json!({"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [1, 0, 0, 1]}});
    sample
        .set(
            "/materials",
            json!([{"extensions": extension, "alphaMode": "MASK", "alphaCutoff": 0.3}]),
        )
        .set(
            "/extensionsRequired",
            json!(["KHR_materials_pbrSpecularGlossiness"]),
        );
    let c = read(&sample);
    assert_eq!(c.materials[0].base_color, [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(c.materials[0].alpha, Alpha::Mask(0.3));
    let primitive = sample.json["meshes"][0]["primitives"][0]
        .as_object_mut()
        .unwrap();
    primitive.remove("material");
    assert_eq!(read(&sample).materials[0].base_color, [1.0; 4]);
}

#[test]
fn uvs_that_are_not_finite_are_left_out() {
    let mut sample = Sample::skinned();
    let uv = sample.add(&bytes(&[[f32::NAN; 2]; 6]), F32, "VEC2", 6);
    sample.set("/meshes/0/primitives/0/attributes/TEXCOORD_0", json!(uv));
    let c = read(&sample);
    assert!(c.parts[0].uvs.is_empty());
    assert!(c.warnings[0].contains("TEXCOORD_0 is not finite"));
}
