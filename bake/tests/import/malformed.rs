//! Broken files are refused with the file, the place and the reason.

use std::path::Path;

use serde_json::{Value, json};
use throng_bake::error::ImportError;
use throng_bake::import::import_bytes;

use crate::sample::{self, INDICES, INVERSE_BIND, JOINTS, POSITION, Sample, TIMES, WEIGHTS};

/// The message with which `file` is refused.
fn refusal(file: &[u8]) -> String {
    let error = import_bytes(Path::new("test.glb"), file).expect_err("it should be refused");
    let text = error.to_string();
    assert!(text.contains("test.glb"), "the file is not named: {text}");
    text
}

#[test]
fn each_broken_property_is_named() {
    let huge = json!(u64::MAX);
    let cases: Vec<(&str, Value, &str, &str)> = vec![
        (
            "/accessors/0/count",
            json!(4_000_000_000u64),
            "accessors[0]",
            "more than the file has data for",
        ),
        (
            "/accessors/0/count",
            json!(1000),
            "accessors[0]",
            "do not fit",
        ),
        (
            "/accessors/0/count",
            huge.clone(),
            "accessors[0]",
            "more than the file has data for",
        ),
        (
            "/accessors/0/count",
            json!(5),
            "meshes[0].primitives[0].indices",
            "vertex 5 does not exist: there are 5",
        ),
        ("/accessors/0/count", json!(0), "accessors[0]", "count is 0"),
        (
            "/accessors/0/count",
            json!(-1),
            "accessors[0].count",
            "invalid value",
        ),
        (
            "/accessors/0/count",
            json!("six"),
            "accessors[0].count",
            "invalid type",
        ),
        (
            "/accessors/0/count",
            json!(6.5),
            "accessors[0].count",
            "invalid type",
        ),
        (
            "/accessors/1/count",
            json!(5),
            "attributes.JOINTS_0",
            "5 elements where there are 6",
        ),
        (
            "/accessors/0/byteOffset",
            huge.clone(),
            "accessors[0]",
            "do not fit",
        ),
        (
            "/accessors/0/componentType",
            json!(5130),
            "accessors[0]",
            "5130 does not exist",
        ),
        (
            "/accessors/1/componentType",
            json!(5120),
            "accessors[1]",
            "unsigned integer",
        ),
        (
            "/accessors/0/type",
            json!("VEC2"),
            "accessors[0] (meshes[0].primitives[0].attributes.POSITION)",
            "VEC3 is needed",
        ),
        (
            "/accessors/0/bufferView",
            json!(99),
            "accessors[0]",
            "buffer view 99 does not exist",
        ),
        (
            "/accessors/0/sparse",
            json!({"count": 7, "indices": {"bufferView": 0, "componentType": 5123}, "values": {"bufferView": 0}}),
            "accessors[0].sparse",
            "count of 7",
        ),
        (
            "/accessors/0/sparse",
            json!({"count": 2, "indices": {"bufferView": 0, "componentType": 5126}, "values": {"bufferView": 0}}),
            "accessors[0]",
            "sparse indices",
        ),
        (
            "/accessors/3/componentType",
            json!(5126),
            "accessors[3]",
            "unsigned integer",
        ),
        (
            "/accessors/3/count",
            json!(60_000),
            "accessors[3]",
            "do not fit",
        ),
        (
            "/bufferViews/0/byteLength",
            huge.clone(),
            "bufferViews[0]",
            "do not fit into buffer 0",
        ),
        (
            "/bufferViews/0/byteOffset",
            huge.clone(),
            "bufferViews[0]",
            "do not fit into buffer 0",
        ),
        (
            "/bufferViews/0/buffer",
            json!(7),
            "bufferViews[0]",
            "buffer 7 does not exist",
        ),
        (
            "/bufferViews/0/byteStride",
            json!(2),
            "accessors[0]",
            "2 bytes apart",
        ),
        (
            "/bufferViews/0/byteStride",
            huge.clone(),
            "accessors[0]",
            "do not fit",
        ),
        (
            "/buffers/0/byteLength",
            huge.clone(),
            "buffers[0]",
            "bytes long and says",
        ),
        (
            "/buffers/0/uri",
            json!("missing.bin"),
            "buffers[0]",
            "'missing.bin' cannot be read",
        ),
        (
            "/buffers/0/uri",
            json!("../up.bin"),
            "buffers[0]",
            "does not stay in the folder",
        ),
        (
            "/buffers/0/uri",
            json!("data:;base64,@@@@"),
            "buffers[0]",
            "base64",
        ),
        (
            "/buffers/0/uri",
            json!("data:;base64,AAAA"),
            "buffers[0]",
            "3 bytes long",
        ),
        (
            "/nodes/2/children",
            json!([1]),
            "nodes[",
            "its own ancestor",
        ),
        (
            "/nodes/2/children",
            json!([2]),
            "nodes[2].children[0]",
            "two parents",
        ),
        (
            "/nodes/1/children",
            json!([2, 2]),
            "nodes[1].children[1]",
            "two parents",
        ),
        (
            "/nodes/1/children",
            json!([99]),
            "nodes[1].children[0]",
            "node 99 does not exist",
        ),
        (
            "/nodes/0/mesh",
            json!(5),
            "nodes[0].mesh",
            "mesh 5 does not exist",
        ),
        (
            "/nodes/0/skin",
            json!(5),
            "nodes[0].skin",
            "skin 5 does not exist",
        ),
        (
            "/nodes/1/translation",
            json!([0, 1e39, 0]),
            "nodes[1]",
            "not finite",
        ),
        (
            "/nodes/1/matrix",
            json!([1, 2, 3]),
            "nodes[1].matrix",
            "invalid length",
        ),
        ("/nodes", json!({}), "nodes", "invalid type"),
        ("/scene", json!(3), "scene", "scene 3 does not exist"),
        (
            "/scenes/0/nodes",
            json!([0, 17]),
            "scenes[0].nodes[1]",
            "node 17 does not exist",
        ),
        ("/scenes/0/nodes", json!([1]), "meshes", "no triangles"),
        ("/skins/0/joints", json!([]), "JOINTS_0", "names joint"),
        (
            "/skins/0/joints",
            json!([1]),
            "attributes.JOINTS_0",
            "vertex 3 names joint 1",
        ),
        (
            "/skins/0/joints",
            json!([1, 99]),
            "skins[0].joints[1]",
            "node 99 does not exist",
        ),
        (
            "/skins/0/inverseBindMatrices",
            json!(POSITION),
            "skins[0].inverseBindMatrices",
            "MAT4 is needed",
        ),
        (
            "/accessors/4/count",
            json!(1),
            "skins[0].inverseBindMatrices",
            "1 matrices for 2 joints",
        ),
        (
            "/meshes/0/primitives/0/indices",
            json!(42),
            "meshes[0].primitives[0].indices",
            "accessor 42 does not exist",
        ),
        (
            "/meshes/0/primitives/0/mode",
            json!(9),
            "meshes[0].primitives[0]",
            "mode 9",
        ),
        (
            "/meshes/0/primitives/0/material",
            json!(3),
            "meshes[0].primitives[0].material",
            "material 3",
        ),
        (
            "/meshes/0/primitives/0/attributes",
            json!([]),
            "meshes[0].primitives[0].attributes",
            "invalid type",
        ),
        ("/meshes/0/primitives", json!([]), "meshes", "no triangles"),
        (
            "/animations/0/channels/0/sampler",
            json!(9),
            "animations[0].channels[0].sampler",
            "sampler 9",
        ),
        (
            "/animations/0/channels/0/target/node",
            json!(77),
            "animations[0].channels[0].target.node",
            "node 77",
        ),
        (
            "/animations/0/samplers/0/interpolation",
            json!("SMOOTH"),
            "animations[0].samplers[0]",
            "'SMOOTH'",
        ),
        (
            "/animations/0/samplers/0/interpolation",
            json!("CUBICSPLINE"),
            "animations[0].samplers[0].output",
            "2 values for 2 keys with 3",
        ),
        (
            "/animations/0/samplers/0/output",
            json!(POSITION),
            "animations[0].samplers[0].output",
            "VEC4 is needed",
        ),
        (
            "/animations/0/samplers/0/input",
            json!(POSITION),
            "animations[0].samplers[0].input",
            "SCALAR is needed",
        ),
        (
            "/materials/0/alphaMode",
            json!("GLASS"),
            "materials[0]",
            "'GLASS'",
        ),
        (
            "/materials/0/pbrMetallicRoughness",
            json!({"baseColorTexture": {"index": 4}}),
            "materials[0]",
            "texture 4 does not exist",
        ),
        (
            "/materials/0/pbrMetallicRoughness",
            json!({"baseColorFactor": [1, 1, 1]}),
            "materials[0].pbrMetallicRoughness.baseColorFactor",
            "invalid length",
        ),
        (
            "/asset/version",
            json!("1.0"),
            "asset.version",
            "glTF 1.0 is not supported",
        ),
        (
            "/extensionsRequired",
            json!(["FOO_bar"]),
            "extensionsRequired",
            "FOO_bar is not supported",
        ),
        (
            "/extensionsRequired",
            json!(["KHR_draco_mesh_compression"]),
            "extensionsRequired",
            "KHR_draco_mesh_compression is not supported; decompress",
        ),
    ];
    for (at, value, place, reason) in cases {
        let mut sample = Sample::skinned();
        sample.set(at, value.clone());
        let text = refusal(&sample.glb());
        assert!(
            text.contains(place) && text.contains(reason),
            "{at} = {value}: expected '{place}' and '{reason}' in: {text}"
        );
    }
}

#[test]
fn broken_data_is_named() {
    let inf = f32::INFINITY.to_le_bytes();
    let nan = f32::NAN.to_le_bytes();
    let minus = (-0.5f32).to_le_bytes();
    type Poke<'a> = (usize, usize, &'a [u8], &'a str, &'a str);
    let cases: [Poke; 7] = [
        (POSITION, 16, &inf, "POSITION", "element 1 is infinite"),
        (WEIGHTS, 16, &nan, "WEIGHTS_0", "element 1 is infinite"),
        (
            WEIGHTS,
            32,
            &minus,
            "WEIGHTS_0",
            "vertex 2 has a negative weight",
        ),
        (JOINTS, 4, &[9], "JOINTS_0", "vertex 1 names joint 9"),
        (
            INDICES,
            2,
            &[6, 0],
            "primitives[0].indices",
            "vertex 6 does not exist: there are 6",
        ),
        (
            INVERSE_BIND,
            64,
            &nan,
            "inverseBindMatrices",
            "element 1 is infinite",
        ),
        (
            TIMES,
            4,
            &minus,
            "animations[0].samplers[0].input",
            "times fall",
        ),
    ];
    for (accessor, at, data, place, reason) in cases {
        let text = refusal(&Sample::skinned().poke(accessor, at, data).glb());
        assert!(text.contains(place) && text.contains(reason), "{text}");
    }
}

#[test]
fn every_cut_of_a_binary_file_is_refused() {
    let file = Sample::skinned().glb();
    assert!(import_bytes(Path::new("test.glb"), &file).is_ok());
    for end in 0..file.len() {
        refusal(&file[..end]);
    }
}

#[test]
fn every_cut_of_a_text_file_is_refused() {
    let file = Sample::skinned().gltf();
    let path = Path::new("test.gltf");
    assert!(import_bytes(path, &file).is_ok());
    for end in 0..file.len() {
        assert!(import_bytes(path, &file[..end]).is_err(), "{end}");
    }
}

#[test]
fn deep_json_is_refused() {
    let (open, close) = ("[".repeat(1_000_000), "]".repeat(1_000_000));
    let animation = format!("{{\"channels\":[],\"samplers\":[],\"extras\":{open}{close}}}");
    let json = format!("{{\"asset\":{{\"version\":\"2.0\"}},\"animations\":[{animation}]}}");
    let text = refusal(&sample::glb(json.as_bytes(), &[]));
    assert!(
        text.contains("animations[0]") && text.contains("recursion limit"),
        "{text}"
    );
}

#[test]
fn many_references_to_one_accessor_stop_at_a_limit() {
    // 40,000 vertices, drawn again and again by a file that stays short.
    let mut sample = Sample::rigid();
    let count = 40_000;
    let position = sample.add(&vec![0; 12 * count], sample::F32, "VEC3", count);
    let primitive = json!({"attributes": {"POSITION": position}});
    sample.set("/meshes/0/primitives", json!(vec![primitive; 10_000]));
    let text = refusal(&sample.glb());
    assert!(
        text.contains("primitives[") && text.contains("more than the file has data for"),
        "{text}"
    );
}

#[test]
fn zeros_without_data_stop_at_a_limit() {
    let mut sample = Sample::rigid();
    sample.set(
        "/accessors/0",
        json!({"componentType": 5126, "type": "VEC3", "count": 1_200_000}),
    );
    assert!(refusal(&sample.glb()).contains("without a buffer view"));
}

#[test]
fn broken_images_are_named() {
    let texture = json!({"baseColorTexture": {"index": 0}});
    let mut sample = Sample::skinned();
    sample
        .set("/materials/0/pbrMetallicRoughness", texture)
        .set("/textures", json!([{"source": 0}]));
    let mut with = |image: Value| {
        sample.set("/images", json!([image]));
        import_bytes(Path::new("test.glb"), &sample.glb()).unwrap_err()
    };
    let error = with(json!({"uri": "nowhere.png"}));
    assert!(matches!(error, ImportError::Malformed { .. }), "{error}");
    assert!(
        error
            .to_string()
            .contains("images[0]: 'nowhere.png' cannot be read")
    );
    let error = with(json!({"uri": "data:image/png;base64,AAAA", "name": "skin"})).to_string();
    assert!(
        error.contains("images[0] 'skin'") && error.contains("neither PNG nor JPEG"),
        "{error}"
    );
    let error = with(json!({})).to_string();
    assert!(error.contains("images[0]: it has neither"), "{error}");
    // A PNG that promises 16384 x 4096 pixels in a few bytes.
    let mut png = Vec::new();
    let image = image::RgbaImage::new(1, 1);
    image
        .write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png)
        .unwrap();
    png[16..24].copy_from_slice(&[0, 0, 0x40, 0, 0, 0, 0x10, 0]);
    let hex: String = png.iter().map(|b| format!("%{b:02x}")).collect();
    let error = with(json!({"uri": format!("data:image/png,{hex}")})).to_string();
    assert!(error.contains("images[0]"), "{error}");
}
