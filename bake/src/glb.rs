//! Writes a character as a standard glTF 2.0 binary, so that anyone can check it or use it elsewhere.
//!
//! What goes in is what comes out: positions, normals and keys as they are, four influences. Only what glTF forbids is
//! mended: weights are normalised, a joint named twice by one vertex becomes one influence, key times that repeat are set
//! one float apart. Same character, same bytes.

use std::collections::{BTreeMap, BTreeSet};
use std::io;

use glam::{Affine3A, Mat4, Quat, Vec2, Vec3};
use serde_json::{Value, json};

use crate::character::{
    Alpha, Character, Clip, Image, Interpolation, Material, Part, Property, Track, Transform,
};

const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const UNSIGNED_BYTE: u32 = 5121;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;

/// `character` as the bytes of a `.glb` file.
///
/// One mesh with one primitive per part; all parts share one skin. A second joint on one node, which glTF does not allow,
/// becomes a child node without a transform. A static character (one joint that moves nothing, no clips) has no skin.
/// `extras.ground_speed` of an animation holds [`Clip::ground_speed`] where that is known.
///
/// Errors: the file would be larger than the 4 GiB that the format can state, or an image does not encode. `character` must
/// satisfy [`Character::validate`].
pub fn write_glb(character: &Character) -> io::Result<Vec<u8>> {
    let mut file = File::default();
    let mut nodes = Nodes::new(character);
    let skin = (!is_static(character)).then(|| file.skin(character, &mut nodes));
    let mut root: serde_json::Map<String, Value> = serde_json::Map::new();

    let mut meshes = Vec::new();
    for part in &character.parts {
        let textured = character.materials[part.material as usize]
            .base_color_image
            .is_some();
        let primitive = file.primitive(part, skin.is_some(), textured);
        meshes.push(named(&part.name, json!({ "primitives": [primitive] })));
        let mut node = json!({ "mesh": meshes.len() - 1 });
        if skin.is_some() {
            node["skin"] = json!(0);
        }
        nodes.add_root(&part.name, node);
    }
    root.insert("meshes".into(), meshes.into());
    root.insert(
        "materials".into(),
        character.materials.iter().map(material).collect(),
    );
    if !character.images.is_empty() {
        let mut images = Vec::new();
        let mut textures = Vec::new();
        for image in &character.images {
            textures.push(json!({ "source": images.len() }));
            images.push(file.image(image)?);
        }
        root.insert("images".into(), images.into());
        root.insert("textures".into(), textures.into());
    }
    if let Some(skin) = skin {
        root.insert("skins".into(), json!([skin]));
    }
    if !character.clips.is_empty() {
        let animations = character
            .clips
            .iter()
            .map(|c| file.animation(c, &character.nodes[0].rest))
            .collect();
        root.insert("animations".into(), animations);
    }
    let scene = named(&character.name, json!({ "nodes": nodes.roots }));
    root.insert("scenes".into(), json!([scene]));
    root.insert("scene".into(), json!(0));
    root.insert("nodes".into(), nodes.into_json());
    root.insert(
        "asset".into(),
        json!({ "version": "2.0", "generator": concat!("throng ", env!("CARGO_PKG_VERSION")) }),
    );
    file.finish(root)
}

/// The skin would move nothing: one joint, the identity, and no clips.
fn is_static(character: &Character) -> bool {
    character.clips.is_empty()
        && character.joints.len() == 1
        && crate::pose::palette(character, None, 0.0)[0].abs_diff_eq(Affine3A::IDENTITY, 1e-6)
}

/// The node array under construction.
struct Nodes {
    nodes: Vec<Value>,
    children: BTreeMap<usize, Vec<usize>>,
    roots: Vec<usize>,
}

impl Nodes {
    fn new(character: &Character) -> Self {
        let mut this = Self {
            nodes: Vec::new(),
            children: BTreeMap::new(),
            roots: Vec::new(),
        };
        for (i, node) in character.nodes.iter().enumerate() {
            this.nodes.push(named(&node.name, transform(&node.rest)));
            match node.parent {
                Some(p) => this.children.entry(p as usize).or_default().push(i),
                None => this.roots.push(i),
            }
        }
        this
    }

    fn add(&mut self, name: &str, node: Value) -> usize {
        self.nodes.push(named(name, node));
        self.nodes.len() - 1
    }

    fn add_root(&mut self, name: &str, node: Value) {
        let index = self.add(name, node);
        self.roots.push(index);
    }

    /// A node of its own for every joint, and one root above all of them.
    fn joints(&mut self, character: &Character) -> Vec<usize> {
        let mut taken = BTreeSet::new();
        let mut joints = Vec::with_capacity(character.joints.len());
        for (i, joint) in character.joints.iter().enumerate() {
            let node = joint.node as usize;
            joints.push(if taken.insert(node) {
                node
            } else {
                let name = format!("{}.joint{i}", character.nodes[node].name);
                let child = self.add(&name, json!({}));
                self.children.entry(node).or_default().push(child);
                child
            });
        }
        let root_of = |mut node: usize| {
            while let Some(parent) = character.nodes[node].parent {
                node = parent as usize;
            }
            node
        };
        let roots: BTreeSet<usize> = character
            .joints
            .iter()
            .map(|j| root_of(j.node as usize))
            .collect();
        if roots.len() > 1 {
            let top = self.add("joints", json!({}));
            self.roots.retain(|r| !roots.contains(r));
            self.roots.push(top);
            self.children.insert(top, roots.into_iter().collect());
        }
        joints
    }

    fn into_json(mut self) -> Value {
        for (node, children) in self.children {
            self.nodes[node]["children"] = json!(children);
        }
        self.nodes.into()
    }
}

/// The binary chunk and the accessors into it.
#[derive(Default)]
struct File {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl File {
    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let mut view = json!({
            "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()
        });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.bytes.extend_from_slice(bytes);
        self.views.push(view);
        self.views.len() - 1
    }

    fn accessor(
        &mut self,
        bytes: &[u8],
        target: Option<u32>,
        component: u32,
        shape: &str,
        count: usize,
    ) -> usize {
        let view = self.view(bytes, target);
        self.accessors.push(json!({
            "bufferView": view, "componentType": component, "type": shape, "count": count
        }));
        self.accessors.len() - 1
    }

    /// An accessor of `[count * width]` floats, little-endian as the format wants.
    fn floats(&mut self, values: &[f32], target: Option<u32>, shape: &str, width: usize) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        self.accessor(&bytes, target, FLOAT, shape, values.len() / width)
    }

    fn set_bounds(&mut self, accessor: usize, min: Vec<f64>, max: Vec<f64>) {
        self.accessors[accessor]["min"] = json!(min);
        self.accessors[accessor]["max"] = json!(max);
    }

    fn primitive(&mut self, part: &Part, skinned: bool, textured: bool) -> Value {
        let target = Some(ARRAY_BUFFER);
        let mut attributes = json!({});
        let positions = self.floats(bytemuck::cast_slice(&part.positions), target, "VEC3", 3);
        let fold = |f: fn(Vec3, Vec3) -> Vec3| {
            let bound = part.positions.iter().copied().reduce(f);
            bound.unwrap_or_default().to_array().map(f64::from).to_vec()
        };
        self.set_bounds(positions, fold(Vec3::min), fold(Vec3::max));
        attributes["POSITION"] = json!(positions);
        let normals: Vec<Vec3> = part.normals.iter().map(|&n| unit(n)).collect();
        attributes["NORMAL"] =
            json!(self.floats(bytemuck::cast_slice(&normals), target, "VEC3", 3));
        if !part.uvs.is_empty() || textured {
            let mut uvs = part.uvs.clone();
            uvs.resize(part.positions.len(), Vec2::ZERO);
            attributes["TEXCOORD_0"] =
                json!(self.floats(bytemuck::cast_slice(&uvs), target, "VEC2", 2));
        }
        if !part.colors.is_empty() {
            attributes["COLOR_0"] =
                json!(self.floats(part.colors.as_flattened(), target, "VEC4", 4));
        }
        if skinned {
            let (joints, weights): (Vec<_>, Vec<_>) = part
                .joints
                .iter()
                .zip(&part.weights)
                .map(|(&j, &w)| influences(j, w))
                .unzip();
            attributes["JOINTS_0"] = json!(self.joint_indices(&joints));
            attributes["WEIGHTS_0"] = json!(self.floats(weights.as_flattened(), target, "VEC4", 4));
        }
        json!({
            "attributes": attributes,
            "indices": self.triangles(part),
            "material": part.material
        })
    }

    fn joint_indices(&mut self, joints: &[[u16; 4]]) -> usize {
        let (component, bytes) = if joints.iter().flatten().all(|&j| j <= u16::from(u8::MAX)) {
            let bytes = joints.iter().flatten().map(|&j| j as u8).collect();
            (UNSIGNED_BYTE, bytes)
        } else {
            let bytes = joints.iter().flatten().flat_map(|j| j.to_le_bytes());
            (UNSIGNED_SHORT, bytes.collect::<Vec<u8>>())
        };
        self.accessor(&bytes, Some(ARRAY_BUFFER), component, "VEC4", joints.len())
    }

    fn triangles(&mut self, part: &Part) -> usize {
        let indices = part.triangles.as_flattened();
        // The greatest index of a type means "restart" and may not occur.
        let (component, bytes) = if part.positions.len() <= usize::from(u16::MAX) {
            let bytes = indices.iter().flat_map(|&i| (i as u16).to_le_bytes());
            (UNSIGNED_SHORT, bytes.collect::<Vec<u8>>())
        } else {
            let bytes = indices.iter().flat_map(|i| i.to_le_bytes()).collect();
            (UNSIGNED_INT, bytes)
        };
        let target = Some(ELEMENT_ARRAY_BUFFER);
        self.accessor(&bytes, target, component, "SCALAR", indices.len())
    }

    fn skin(&mut self, character: &Character, nodes: &mut Nodes) -> Value {
        let matrices: Vec<Mat4> = character
            .joints
            .iter()
            .map(|j| {
                let mut m = j.joint_from_bind;
                for column in 0..4 {
                    m.col_mut(column).w = if column == 3 { 1.0 } else { 0.0 };
                }
                m
            })
            .collect();
        let matrices = self.floats(bytemuck::cast_slice(&matrices), None, "MAT4", 16);
        let joints = nodes.joints(character);
        json!({ "inverseBindMatrices": matrices, "joints": joints })
    }

    fn image(&mut self, image: &Image) -> io::Result<Value> {
        let mut png = io::Cursor::new(Vec::new());
        let pixels = image.pixels.as_flattened();
        let opaque: Option<Vec<u8>> = image.pixels.iter().all(|p| p[3] == 255).then(|| {
            image
                .pixels
                .iter()
                .flat_map(|p| [p[0], p[1], p[2]])
                .collect()
        });
        let (pixels, color) = match &opaque {
            Some(rgb) => (rgb.as_slice(), image::ExtendedColorType::Rgb8),
            None => (pixels, image::ExtendedColorType::Rgba8),
        };
        image::write_buffer_with_format(
            &mut png,
            pixels,
            image.width,
            image.height,
            color,
            image::ImageFormat::Png,
        )
        .map_err(|e| io::Error::other(format!("image '{}': {e}", image.name)))?;
        let view = self.view(png.get_ref(), None);
        let json = json!({ "bufferView": view, "mimeType": "image/png" });
        Ok(named(&image.name, json))
    }

    /// `rest` is where node 0 stands: a clip without tracks holds it there, as glTF has no animation without a channel.
    fn animation(&mut self, clip: &Clip, rest: &Transform) -> Value {
        let hold;
        let tracks = if clip.tracks.is_empty() {
            hold = [Track {
                node: 0,
                property: Property::Translation,
                interpolation: Interpolation::Step,
                times_s: vec![0.0, clip.duration_s],
                values: [rest.translation.to_array(); 2].as_flattened().to_vec(),
            }];
            &hold[..]
        } else {
            &clip.tracks
        };
        // Most tracks of a clip share their key times: write those once.
        let mut inputs: BTreeMap<Vec<u32>, usize> = BTreeMap::new();
        let mut samplers = Vec::new();
        let mut channels = Vec::new();
        for track in tracks {
            let times_s = rising_times(&track.times_s);
            let key = times_s.iter().map(|t| t.to_bits()).collect();
            let input = *inputs.entry(key).or_insert_with(|| {
                let input = self.floats(&times_s, None, "SCALAR", 1);
                let bound = |t: Option<&f32>| vec![f64::from(*t.unwrap_or(&0.0))];
                self.set_bounds(input, bound(times_s.first()), bound(times_s.last()));
                input
            });
            let (values, interpolation) = sampler_values(track);
            let (shape, width, path) = match track.property {
                Property::Translation => ("VEC3", 3, "translation"),
                Property::Rotation => ("VEC4", 4, "rotation"),
                Property::Scale => ("VEC3", 3, "scale"),
            };
            let output = self.floats(values, None, shape, width);
            channels.push(json!({
                "sampler": samplers.len(), "target": { "node": track.node, "path": path }
            }));
            samplers.push(json!({
                "input": input, "output": output, "interpolation": interpolation
            }));
        }
        let mut animation = json!({ "channels": channels, "samplers": samplers });
        if clip.ground_speed != 0.0 {
            animation["extras"] = json!({ "ground_speed": clip.ground_speed });
        }
        named(&clip.name, animation)
    }

    /// Header, JSON chunk padded with spaces, binary chunk padded with zeros.
    fn finish(mut self, mut root: serde_json::Map<String, Value>) -> io::Result<Vec<u8>> {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        root.insert("accessors".into(), self.accessors.into());
        root.insert("bufferViews".into(), self.views.into());
        root.insert(
            "buffers".into(),
            json!([{ "byteLength": self.bytes.len() }]),
        );
        let mut text = serde_json::to_vec(&root)?;
        text.resize(text.len().next_multiple_of(4), b' ');
        let total = 12 + 8 + text.len() + 8 + self.bytes.len();
        let too_large = |_| io::Error::other("a .glb file cannot be larger than 4 GiB");
        let length = |n: usize| u32::try_from(n).map(u32::to_le_bytes).map_err(too_large);
        let mut out = Vec::with_capacity(total);
        out.extend_from_slice(b"glTF");
        out.extend_from_slice(&2u32.to_le_bytes());
        out.extend_from_slice(&length(total)?);
        out.extend_from_slice(&length(text.len())?);
        out.extend_from_slice(b"JSON");
        out.extend_from_slice(&text);
        out.extend_from_slice(&length(self.bytes.len())?);
        out.extend_from_slice(b"BIN\0");
        out.extend_from_slice(&self.bytes);
        Ok(out)
    }
}

fn named(name: &str, mut object: Value) -> Value {
    if !name.is_empty() {
        object["name"] = json!(name);
    }
    object
}

/// Node properties; those that are glTF's defaults are left out.
fn transform(rest: &Transform) -> Value {
    let mut node = json!({});
    let exact = |v: &[f32]| -> Value { v.iter().map(|&x| f64::from(x)).collect() };
    if rest.translation != Vec3::ZERO {
        node["translation"] = exact(&rest.translation.to_array());
    }
    if rest.rotation != Quat::IDENTITY {
        let q = rest.rotation;
        let q = if q.is_normalized() {
            q
        } else {
            Quat::from_vec4(glam::Vec4::from(q).normalize_or(glam::Vec4::W))
        };
        node["rotation"] = exact(&q.to_array());
    }
    if rest.scale != Vec3::ONE {
        node["scale"] = exact(&rest.scale.to_array());
    }
    node
}

fn material(material: &Material) -> Value {
    let mut pbr = json!({ "metallicFactor": 0.0, "roughnessFactor": 1.0 });
    if material.base_color != [1.0; 4] {
        let color = material.base_color.map(|x| f64::from(x.clamp(0.0, 1.0)));
        pbr["baseColorFactor"] = json!(color);
    }
    if let Some(texture) = material.base_color_image {
        pbr["baseColorTexture"] = json!({ "index": texture });
    }
    let mut json = json!({ "pbrMetallicRoughness": pbr });
    if let Alpha::Mask(cutoff) = material.alpha {
        json["alphaMode"] = json!("MASK");
        json["alphaCutoff"] = json!(f64::from(cutoff.max(0.0)));
    }
    if material.double_sided {
        json["doubleSided"] = json!(true);
    }
    named(&material.name, json)
}

/// `normal` as it is where it is a unit vector to within float precision, else mended.
fn unit(normal: Vec3) -> Vec3 {
    if normal.is_normalized() {
        normal
    } else {
        normal.normalize_or(Vec3::Y)
    }
}

/// Influences as glTF wants them: no joint twice, joint 0 where the weight is 0, a sum of 1.
fn influences(joints: [u16; 4], weights: [f32; 4]) -> ([u16; 4], [f32; 4]) {
    let mut j = [0u16; 4];
    let mut w = [0f64; 4];
    let mut count = 0;
    for (joint, weight) in joints.into_iter().zip(weights) {
        if weight > 0.0 {
            match j[..count].iter().position(|&x| x == joint) {
                Some(i) => w[i] += f64::from(weight),
                None => {
                    j[count] = joint;
                    w[count] = f64::from(weight);
                    count += 1;
                }
            }
        }
    }
    let sum: f64 = w.iter().sum();
    if sum <= 0.0 {
        return (j, [1.0, 0.0, 0.0, 0.0]);
    }
    (j, w.map(|x| (x / sum) as f32))
}

/// Key times that rise strictly from 0 on: a repeated one is set one float later.
fn rising_times(times_s: &[f32]) -> Vec<f32> {
    let mut last = f32::NEG_INFINITY;
    let mut out = Vec::with_capacity(times_s.len());
    for &t in times_s {
        let t = t.max(0.0);
        last = if t > last { t } else { last.next_up() };
        out.push(last);
    }
    out
}

/// A track's values and the name of its interpolation. A spline through one key is a constant: glTF wants two or more.
fn sampler_values(track: &Track) -> (&[f32], &'static str) {
    let width = track.property.width();
    match track.interpolation {
        Interpolation::Step => (&track.values, "STEP"),
        Interpolation::Linear => (&track.values, "LINEAR"),
        Interpolation::CubicSpline if track.times_s.len() == 1 => {
            (&track.values[width..2 * width], "STEP")
        }
        Interpolation::CubicSpline => (&track.values, "CUBICSPLINE"),
    }
}
