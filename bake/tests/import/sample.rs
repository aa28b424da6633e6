//! A small skinned, animated glTF that tests take apart, and ways to write it.

use serde_json::{Value, json};

/// A glTF file as JSON and one binary buffer.
#[derive(Clone)]
pub struct Sample {
    pub json: Value,
    pub binary: Vec<u8>,
}

/// Accessors of [`Sample::skinned`].
pub const POSITION: usize = 0;
pub const JOINTS: usize = 1;
pub const WEIGHTS: usize = 2;
pub const INDICES: usize = 3;
pub const INVERSE_BIND: usize = 4;
pub const TIMES: usize = 5;
pub const ROTATIONS: usize = 6;

pub const F32: u32 = 5126;
pub const U16: u32 = 5123;
pub const U8: u32 = 5121;

/// The positions of [`Sample::skinned`].
pub const CORNERS: [[f32; 3]; 6] = [
    [-0.5, 0.0, 0.0],
    [0.5, 0.0, 0.0],
    [-0.5, 1.0, 0.0],
    [0.5, 1.0, 0.0],
    [-0.5, 2.0, 0.0],
    [0.5, 2.0, 0.0],
];

/// Little-endian bytes of numbers.
pub fn bytes<T: bytemuck::NoUninit>(values: &[T]) -> Vec<u8> {
    bytemuck::cast_slice(values).to_vec()
}

impl Sample {
    /// A ribbon of four triangles, 1 wide and 2 high, on two joints (nodes 1 and 2); a clip of one second turns the upper
    /// one, which sits at height 1, by a quarter turn about Z.
    pub fn skinned() -> Self {
        let mut sample = Self {
            json: json!({
                "asset": {"version": "2.0"},
                "scene": 0,
                "scenes": [{"nodes": [0, 1]}],
                "nodes": [
                    {"mesh": 0, "skin": 0, "name": "body"},
                    {"children": [2], "name": "root"},
                    {"translation": [0, 1, 0], "name": "tip"}
                ],
                "meshes": [{"name": "ribbon", "primitives": [{
                    "attributes": {"POSITION": POSITION, "JOINTS_0": JOINTS, "WEIGHTS_0": WEIGHTS},
                    "indices": INDICES, "material": 0
                }]}],
                "materials": [{"name": "paint"}],
                "skins": [{"joints": [1, 2], "inverseBindMatrices": INVERSE_BIND}],
                "animations": [{
                    "name": "bend",
                    "channels": [{"sampler": 0, "target": {"node": 2, "path": "rotation"}}],
                    "samplers": [{"input": TIMES, "output": ROTATIONS}],
                    "extras": {"ground_speed": 1.5}
                }],
                "accessors": [], "bufferViews": [], "buffers": [{"byteLength": 0}]
            }),
            binary: Vec::new(),
        };
        sample.add(&bytes(&CORNERS), F32, "VEC3", 6);
        let joints: [[u8; 4]; 6] = std::array::from_fn(|v| [u8::from(v >= 3), 0, 0, 0]);
        sample.add(&bytes(&joints), U8, "VEC4", 6);
        sample.add(&bytes(&[[1.0f32, 0.0, 0.0, 0.0]; 6]), F32, "VEC4", 6);
        let triangles: [u16; 12] = [0, 1, 3, 0, 3, 2, 2, 3, 5, 2, 5, 4];
        sample.add(&bytes(&triangles), U16, "SCALAR", 12);
        let mut matrices = [glam::Mat4::IDENTITY.to_cols_array(); 2];
        matrices[1][13] = -1.0;
        sample.add(&bytes(&matrices), F32, "MAT4", 2);
        sample.add(&bytes(&[0.0f32, 1.0]), F32, "SCALAR", 2);
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let turns = [[0.0f32, 0.0, 0.0, 1.0], [0.0, 0.0, half, half]];
        sample.add(&bytes(&turns), F32, "VEC4", 2);
        sample
    }

    /// The ribbon without its skin: nodes 1 and 2 stay.
    pub fn rigid() -> Self {
        let mut sample = Self::skinned();
        sample.json["nodes"][0] = json!({"mesh": 0});
        sample
    }

    /// Appends an accessor with a view of its own; returns its index.
    pub fn add(&mut self, data: &[u8], component: u32, kind: &str, count: usize) -> usize {
        let view = self.add_view(data, json!({}));
        self.add_accessor(json!({
            "bufferView": view, "componentType": component, "type": kind, "count": count
        }))
    }

    /// Appends an accessor; returns its index.
    pub fn add_accessor(&mut self, accessor: Value) -> usize {
        let list = self.json["accessors"].as_array_mut().unwrap();
        list.push(accessor);
        list.len() - 1
    }

    /// Appends `data` and a view of it with more properties; returns its index.
    pub fn add_view(&mut self, data: &[u8], more: Value) -> usize {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let mut view = json!({
            "buffer": 0, "byteOffset": self.binary.len(), "byteLength": data.len()
        });
        view.as_object_mut()
            .unwrap()
            .extend(more.as_object().unwrap().clone());
        self.binary.extend(data);
        self.json["buffers"][0]["byteLength"] = json!(self.binary.len());
        let list = self.json["bufferViews"].as_array_mut().unwrap();
        list.push(view);
        list.len() - 1
    }

    /// Replaces what the JSON pointer `at` leads to; the last key may be new.
    pub fn set(&mut self, at: &str, value: Value) -> &mut Self {
        let (parent, key) = at.rsplit_once('/').unwrap();
        let parent = self.json.pointer_mut(parent).expect(at);
        match parent {
            Value::Array(list) => list[key.parse::<usize>().unwrap()] = value,
            other => other[key] = value,
        }
        self
    }

    /// Overwrites bytes of the data of an accessor, `at` bytes from its start.
    pub fn poke(&mut self, accessor: usize, at: usize, data: &[u8]) -> &mut Self {
        let view = self.json["accessors"][accessor]["bufferView"]
            .as_u64()
            .unwrap();
        let start = self.json["bufferViews"][view as usize]["byteOffset"]
            .as_u64()
            .unwrap();
        self.binary[start as usize + at..][..data.len()].copy_from_slice(data);
        self
    }

    /// As a binary file.
    pub fn glb(&self) -> Vec<u8> {
        glb(self.json.to_string().as_bytes(), &self.binary)
    }

    /// As a text file with the buffer inside.
    pub fn gltf(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        let hex: String = self.binary.iter().map(|b| format!("%{b:02x}")).collect();
        json["buffers"][0]["uri"] = json!(format!("data:application/octet-stream,{hex}"));
        json.to_string().into_bytes()
    }
}

/// Joins the two chunks to a binary file.
pub fn glb(json: &[u8], binary: &[u8]) -> Vec<u8> {
    let mut json = json.to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut binary = binary.to_vec();
    binary.resize(binary.len().next_multiple_of(4), 0);
    let words = |values: [usize; 2]| values.map(|v| (v as u32).to_le_bytes()).concat();
    let mut file = b"glTF".to_vec();
    file.extend(words([2, 28 + json.len() + binary.len()]));
    file.extend(words([json.len(), 0x4E4F_534A]));
    file.extend(json);
    file.extend(words([binary.len(), 0x004E_4942]));
    file.extend(binary);
    file
}
