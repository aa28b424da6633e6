//! Broken files of all kinds, made at random from real and small ones: an importer answers with a character or an error,
//! never with a panic, and never takes absurd memory.

use std::path::Path;
use std::sync::OnceLock;

use proptest::prelude::*;
use serde_json::Value;
use throng_bake::import::import_bytes;

use crate::models;
use crate::sample::{self, Sample};

/// Memory that importing a broken file of a few megabytes may take at most, in kB.
const MAX_MEMORY_KB: u64 = 1 << 20;

/// A file that is taken apart.
struct Seed {
    name: String,
    bytes: Vec<u8>,
}

fn seeds() -> &'static [Seed] {
    static SEEDS: OnceLock<Vec<Seed>> = OnceLock::new();
    SEEDS.get_or_init(|| {
        let own = |name: &str, bytes: Vec<u8>| Seed { name: name.into(), bytes };
        let mut seeds = vec![
            own("skinned.glb", Sample::skinned().glb()),
            own("skinned.gltf", Sample::skinned().gltf()),
            own("rigid.glb", Sample::rigid().glb()),
            own("a.obj", b"mtllib x.mtl\nv 0 0 0\nv 1 0 0 1 0 1\nv 0 1 0\nv 1 1 0\nvt 0 1\nvn 0 0 1\ng a\nusemtl b\nf 1/1/1 2/1/1 -1/1/1\nf 1 2 3 4\nf 1//1 2//1 3//1\n".to_vec()),
        ];
        let real = [
            "awkward/simple_skin.gltf",
            "awkward/Wolf_meshopt.glb",
            "awkward/Wolf_quantized.glb",
            "awkward/Donkey_interleaved.glb",
            "awkward/ShibaInu_step.glb",
            "glb/khronos_fox.glb",
            "glb/ped_man_suit.glb",
            "obj/spider.obj",
        ];
        if let Some(folder) = models::models() {
            for name in real {
                let bytes = std::fs::read(folder.join(name)).unwrap();
                let name = name.rsplit('/').next().unwrap().to_string();
                seeds.push(Seed { name, bytes });
            }
        }
        seeds
    })
}

/// The JSON of a glTF file and its binary chunk.
fn split(seed: &Seed) -> Option<(Value, Vec<u8>)> {
    if seed.bytes.starts_with(b"glTF") {
        let word =
            |at: usize| u32::from_le_bytes(seed.bytes[at..at + 4].try_into().unwrap()) as usize;
        let end = 20 + word(12);
        let json = serde_json::from_slice(&seed.bytes[20..end]).ok()?;
        return Some((json, seed.bytes.get(end + 8..)?.to_vec()));
    }
    Some((serde_json::from_slice(&seed.bytes).ok()?, Vec::new()))
}

/// All values inside `value`, as pointers.
fn pointers(value: &Value, at: String, out: &mut Vec<String>) {
    match value {
        Value::Object(map) => {
            for (key, inner) in map {
                pointers(
                    inner,
                    format!("{at}/{}", key.replace('~', "~0").replace('/', "~1")),
                    out,
                );
            }
        }
        Value::Array(list) => {
            for (i, inner) in list.iter().enumerate() {
                pointers(inner, format!("{at}/{i}"), out);
            }
        }
        _ => {}
    }
    out.push(at);
}

/// Imports, and checks what comes out.
fn survive(name: &str, bytes: &[u8]) {
    match import_bytes(Path::new(name), bytes) {
        Ok(character) => character.validate(Path::new(name)).unwrap(),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
    assert!(
        peak_memory_kb() < MAX_MEMORY_KB,
        "{} kB were taken",
        peak_memory_kb()
    );
}

/// The greatest memory that this process has held, in kB; 0 where the system does not say.
fn peak_memory_kb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    let number = line.and_then(|l| l.split_whitespace().next()?.parse().ok());
    number.unwrap_or(0)
}

/// A number that breaks things, or an ordinary small one.
fn number() -> impl Strategy<Value = Value> {
    prop_oneof![
        (0u64..200).prop_map(Value::from),
        any::<u64>().prop_map(Value::from),
        any::<i64>().prop_map(Value::from),
        any::<f64>().prop_map(Value::from),
        Just(Value::from(u32::MAX)),
        Just(Value::from(1u64 << 31)),
        Just(Value::from(5121)),
        Just(Value::from(5126)),
    ]
}

fn replacement() -> impl Strategy<Value = Value> {
    prop_oneof![
        8 => number(),
        1 => Just(Value::Null),
        1 => Just(serde_json::json!([])),
        1 => Just(serde_json::json!({})),
        1 => Just(serde_json::json!("VEC4")),
        1 => Just(serde_json::json!([0, 1, 0])),
    ]
}

/// The number of cases, or `PROPTEST_CASES`.
fn config() -> ProptestConfig {
    ProptestConfig {
        cases: std::env::var("PROPTEST_CASES").map_or(400, |n| n.parse().unwrap_or(400)),
        failure_persistence: None,
        max_shrink_iters: 200,
        ..ProptestConfig::default()
    }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn bytes_flipped(which in any::<prop::sample::Index>(), flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..20)) {
        let seed = which.get(seeds());
        let mut bytes = seed.bytes.clone();
        for (at, value) in flips {
            *at.get_mut(&mut bytes[..]) = value;
        }
        survive(&seed.name, &bytes);
    }

    #[test]
    fn cut_or_doubled(which in any::<prop::sample::Index>(), a in any::<prop::sample::Index>(), b in any::<prop::sample::Index>()) {
        let seed = which.get(seeds());
        let (a, b) = (a.index(seed.bytes.len()), b.index(seed.bytes.len()));
        survive(&seed.name, &seed.bytes[..a]);
        let mut bytes = seed.bytes[..a.max(b)].to_vec();
        bytes.extend(&seed.bytes[a.min(b)..]);
        survive(&seed.name, &bytes);
    }

    #[test]
    fn json_values_replaced(which in any::<prop::sample::Index>(), changes in prop::collection::vec((any::<prop::sample::Index>(), replacement()), 1..6)) {
        let seed = which.get(seeds());
        let Some((mut json, binary)) = split(seed) else { return Ok(()) };
        let mut all = Vec::new();
        pointers(&json, String::new(), &mut all);
        for (at, value) in changes {
            if let Some(place) = json.pointer_mut(&all[at.index(all.len())]) {
                *place = value;
            }
        }
        let text = json.to_string();
        if binary.is_empty() {
            survive(&seed.name, text.as_bytes());
        } else {
            survive(&seed.name, &sample::glb(text.as_bytes(), &binary));
        }
    }

    #[test]
    fn words_of_an_obj_replaced(which in any::<prop::sample::Index>(), changes in prop::collection::vec((any::<prop::sample::Index>(), any::<prop::sample::Index>()), 1..12)) {
        let objs: Vec<&Seed> = seeds().iter().filter(|s| s.name.ends_with(".obj")).collect();
        let seed = which.get(&objs);
        let text = String::from_utf8_lossy(&seed.bytes);
        let mut words: Vec<&str> = text.split(' ').collect();
        let odd = ["-1", "0", "1/", "//", "1//1", "nan", "1e99", "99999999999", "-99999999", "f", "\n", "\nf 1 2 3", "\nusemtl", "\ng\n", "\nv 1", "\nvt 1 1", "\nvn 0 0 0", "\nl 1 2", "\np 1", "é"];
        for (at, word) in changes {
            *at.get_mut(&mut words[..]) = odd[word.index(odd.len())];
        }
        survive(&seed.name, words.join(" ").as_bytes());
    }
}
