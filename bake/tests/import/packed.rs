//! `EXT_meshopt_compression`, packed here by the same crate's encoders.

use std::path::Path;

use glam::Vec3;
use serde_json::json;
use throng_bake::import::import_bytes;

use crate::gltf::{assert_near, posed, read};
use crate::sample::{CORNERS, POSITION, Sample};

/// Puts packed data of an accessor behind `EXT_meshopt_compression`.
fn pack(sample: &mut Sample, accessor: usize, packed: &[u8], extension: serde_json::Value) {
    let raw = sample.add_view(packed, json!({}));
    let range = sample.json["bufferViews"][raw].clone();
    let mut extension = extension;
    for key in ["buffer", "byteOffset", "byteLength"] {
        extension[key] = range[key].clone();
    }
    let view = sample.json["accessors"][accessor]["bufferView"]
        .as_u64()
        .unwrap();
    let at = format!("/bufferViews/{view}/extensions");
    sample.set(&at, json!({"EXT_meshopt_compression": extension}));
    // The plain bytes are no longer there.
    sample.set(&format!("/bufferViews/{view}/buffer"), json!(1));
}

fn meshopt_sample() -> Sample {
    let mut sample = Sample::skinned();
    sample.set("/extensionsRequired", json!(["EXT_meshopt_compression"]));
    let fallback = json!({"EXT_meshopt_compression": {"fallback": true}});
    let buffers = sample.json["buffers"].as_array_mut().unwrap();
    buffers.push(json!({"byteLength": 4096, "extensions": fallback}));
    sample
}

#[test]
fn meshopt_data_unpacks_to_the_same() {
    let plain = read(&Sample::skinned());
    let mut sample = meshopt_sample();
    let packed = meshopt::encode_vertex_buffer(&CORNERS).unwrap();
    let attributes = |stride: usize, count: usize, filter: &str| json!({"mode": "ATTRIBUTES", "byteStride": stride, "count": count, "filter": filter});
    pack(&mut sample, POSITION, &packed, attributes(12, 6, "NONE"));
    let triangles: [u32; 12] = [0, 1, 3, 0, 3, 2, 2, 3, 5, 2, 5, 4];
    let packed = meshopt::encode_index_buffer(&triangles, 6).unwrap();
    let indices = json!({"mode": "TRIANGLES", "byteStride": 2, "count": 12});
    pack(&mut sample, crate::sample::INDICES, &packed, indices);
    let c = read(&sample);
    assert_near(&posed(&c, Some(0.4)), &posed(&plain, Some(0.4)), 1e-6);
    assert_eq!(c.parts[0].triangles.len(), 4);

    // The sequence codec and the exponential filter.
    let packed = meshopt::encode_index_sequence(&triangles, 6).unwrap();
    let indices = json!({"mode": "INDICES", "byteStride": 2, "count": 12});
    pack(&mut sample, crate::sample::INDICES, &packed, indices);
    let mode = meshopt::EncodeExpMode::Separate;
    let filtered = meshopt::encode_filter_exp(&CORNERS, 20, mode);
    let packed = meshopt::encode_vertex_buffer(&filtered).unwrap();
    pack(
        &mut sample,
        POSITION,
        &packed,
        attributes(12, 6, "EXPONENTIAL"),
    );
    let c = read(&sample);
    assert_eq!(c.parts[0].triangles, plain.parts[0].triangles);
    assert_near(&posed(&c, Some(0.4)), &posed(&plain, Some(0.4)), 1e-4);
}

#[test]
fn meshopt_filters_give_unit_normals_and_rotations() {
    let mut sample = meshopt_sample();
    let normals: Vec<Vec3> = (0..6)
        .map(|i| Vec3::new(i as f32 - 2.5, 1.0, 0.5 * i as f32 - 1.0).normalize())
        .collect();
    let four: Vec<[f32; 4]> = normals.iter().map(|n| n.extend(0.0).to_array()).collect();
    let words: Vec<[i16; 4]> = meshopt::encode_filter_oct(&four, 16);
    let view = sample.add_view(&[0; 48], json!({"byteStride": 8}));
    let normal = sample.add_accessor(json!({
        "bufferView": view, "componentType": 5122, "normalized": true, "type": "VEC3", "count": 6
    }));
    let packed = meshopt::encode_vertex_buffer(&words).unwrap();
    let octahedral =
        json!({"mode": "ATTRIBUTES", "byteStride": 8, "count": 6, "filter": "OCTAHEDRAL"});
    pack(&mut sample, normal, &packed, octahedral);
    sample.set("/meshes/0/primitives/0/attributes/NORMAL", json!(normal));

    let half = std::f32::consts::FRAC_1_SQRT_2;
    let turns = [[0.0f32, 0.0, 0.0, 1.0], [0.0, 0.0, half, half]];
    let words = meshopt::encode_filter_quat(&turns, 16);
    let view = sample.add_view(&[0; 16], json!({}));
    let rotations = sample.add_accessor(json!({
        "bufferView": view, "componentType": 5122, "normalized": true, "type": "VEC4", "count": 2
    }));
    let packed = meshopt::encode_vertex_buffer(&words).unwrap();
    let quaternion =
        json!({"mode": "ATTRIBUTES", "byteStride": 8, "count": 2, "filter": "QUATERNION"});
    pack(&mut sample, rotations, &packed, quaternion);
    sample.set("/animations/0/samplers/0/output", json!(rotations));

    let c = read(&sample);
    for (n, expected) in c.parts[0].normals.iter().zip(&normals) {
        assert!(n.distance(*expected) < 1e-3, "{n} and {expected}");
    }
    let plain = read(&Sample::skinned());
    assert_near(&posed(&c, Some(1.0)), &posed(&plain, Some(1.0)), 1e-3);
}

#[test]
fn broken_meshopt_data_is_named() {
    let cases = [
        (
            json!({"mode": "ATTRIBUTES", "byteStride": 12, "count": 6_000_000}),
            "cannot come from",
        ),
        (
            json!({"mode": "ATTRIBUTES", "byteStride": 13, "count": 6}),
            "13 bytes does not exist",
        ),
        (
            json!({"mode": "ATTRIBUTES", "byteStride": 12, "count": 7}),
            "broken",
        ),
        (
            json!({"mode": "TRIANGLES", "byteStride": 2, "count": 7}),
            "not a multiple of 3",
        ),
        (
            json!({"mode": "TRIANGLES", "byteStride": 4, "count": 6}),
            "broken",
        ),
        (
            json!({"mode": "MAGIC", "byteStride": 4, "count": 6}),
            "'MAGIC'",
        ),
        (
            json!({"mode": "ATTRIBUTES", "byteStride": 12, "count": 6, "filter": "OCTAHEDRAL"}),
            "'OCTAHEDRAL'",
        ),
        (
            json!({"mode": "ATTRIBUTES", "byteStride": 12, "count": u64::MAX}),
            "512 MiB",
        ),
        (
            json!({"mode": "ATTRIBUTES", "byteStride": 12}),
            "missing field `count`",
        ),
    ];
    for (extension, reason) in cases {
        let mut sample = meshopt_sample();
        let packed = meshopt::encode_vertex_buffer(&CORNERS).unwrap();
        pack(&mut sample, POSITION, &packed, extension.clone());
        let error = import_bytes(Path::new("test.glb"), &sample.glb())
            .unwrap_err()
            .to_string();
        let place = "bufferViews[0].extensions.EXT_meshopt_compression";
        assert!(
            error.contains(place) && error.contains(reason),
            "{extension}: {error}"
        );
    }
}
