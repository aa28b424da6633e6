//! glTF 2.0: `.glb` and `.gltf`, with buffers and images inside, as data URIs or in files beside it.
//!
//! Read: triangles, strips and fans; sparse, interleaved, quantised and meshopt-compressed data; skins, rigid meshes;
//! step, linear and cubic clips; base colours, textures, alpha modes. Left out with a warning: points and lines, morph
//! targets. Refused by name: Draco compression and any other required extension that changes what the data means.

mod bind;
mod clips;
mod data;
mod json;
mod materials;
mod meshopt;
mod primitives;
mod scene;

use std::path::Path;

use self::data::Source;
use self::json::{Document, Header};
use self::primitives::Primitives;
use super::influences;
use crate::character::{Character, Clip, Node};
use crate::error::ImportError;

/// Required extensions that are read, or that can be ignored without changing geometry.
const KNOWN_EXTENSIONS: [&str; 5] = [
    "KHR_mesh_quantization",
    "EXT_meshopt_compression",
    "KHR_meshopt_compression",
    "KHR_texture_transform",
    "KHR_lights_punctual",
];

/// Reads a binary file: its JSON chunk and the binary chunk behind it.
pub fn import_glb(path: &Path, bytes: &[u8]) -> Result<Character, ImportError> {
    let bad = |place: &str, reason: String| ImportError::malformed(path, place, reason);
    let word = |at: usize| {
        let four = bytes.get(at..at + 4)?;
        Some(u32::from_le_bytes([four[0], four[1], four[2], four[3]]) as usize)
    };
    let version = word(4).ok_or_else(|| bad("header", "the file ends in it".into()))?;
    if version != 2 {
        return Err(bad("header", format!("its version is {version}, not 2")));
    }
    let length = word(8).ok_or_else(|| bad("header", "the file ends in it".into()))?;
    if length > bytes.len() {
        let reason = format!("it says {length} bytes and the file has {}", bytes.len());
        return Err(bad("header", reason));
    }
    let (mut json, mut binary) = (None, None);
    let mut at = 12;
    while at + 8 <= length {
        let (size, kind) = (word(at).unwrap_or(0), word(at + 4).unwrap_or(0));
        let chunk = bytes.get(at + 8..).and_then(|b| b.get(..size));
        let chunk = chunk.ok_or_else(|| {
            let reason = format!("{size} bytes at {at} go beyond the end of the file");
            bad("chunk", reason)
        })?;
        match kind {
            0x4E4F_534A if json.is_none() => json = Some(chunk),
            0x004E_4942 if binary.is_none() => binary = Some(chunk),
            _ => {}
        }
        at += 8 + size;
    }
    let json = json.ok_or_else(|| bad("chunk", "there is no JSON chunk".into()))?;
    import_document(path, json, binary)
}

/// Reads a text file.
pub fn import_json(path: &Path, bytes: &[u8]) -> Result<Character, ImportError> {
    import_document(path, bytes, None)
}

/// The error for Draco-compressed geometry at `place`.
fn draco(path: &Path, place: &str) -> ImportError {
    ImportError::Unsupported {
        path: path.to_path_buf(),
        place: place.into(),
        feature: "KHR_draco_mesh_compression".into(),
        hint: "decompress it first, for example with glTF-Transform: gltf-transform copy IN.glb OUT.glb"
            .into(),
    }
}

fn parse<'de, T: serde::Deserialize<'de>>(path: &Path, json: &'de [u8]) -> Result<T, ImportError> {
    let mut deserializer = serde_json::Deserializer::from_slice(json);
    serde_path_to_error::deserialize(&mut deserializer).map_err(|e| {
        let place = match e.path().to_string() {
            p if p == "." => "JSON".to_string(),
            p => p,
        };
        ImportError::malformed(path, place, e.inner().to_string())
    })
}

fn import_document(
    path: &Path,
    json: &[u8],
    chunk: Option<&[u8]>,
) -> Result<Character, ImportError> {
    let header: Header = parse(path, json)?;
    if !header.asset.version.starts_with("2.") {
        return Err(ImportError::Unsupported {
            path: path.to_path_buf(),
            place: "asset.version".into(),
            feature: format!("glTF {}", super::files::shorten(&header.asset.version, 16)),
            hint: "convert it to glTF 2.0".into(),
        });
    }
    let document: Document = parse(path, json)?;
    check_extensions(path, &document)?;
    let source = Source::new(path, document, chunk)?;
    let scene = scene::read(&source)?;
    let mut primitives = Primitives::default();
    for &node in &scene.shown {
        let index = scene.source_of[node as usize];
        primitives.read_node(&source, index, node)?;
    }
    let mut warnings = std::mem::take(&mut primitives.warnings);
    if scene.sheared_count > 0 {
        warnings.push(format!(
            "{} nodes have a matrix with shear, which is lost",
            scene.sheared_count
        ));
    }
    for draft in &mut primitives.drafts {
        draft.surface.drop_degenerate();
        draft.surface.drop_unused();
    }
    primitives.drafts.retain(|d| {
        let empty = d.surface.triangles.is_empty();
        if empty {
            warnings.push(format!(
                "mesh '{}' has a primitive without triangles; it is left out",
                d.surface.name
            ));
        }
        !empty
    });
    let clips = clips::read(&source, &scene, &mut warnings)?;
    let mut animated = vec![false; scene.nodes.len()];
    for track in clips.iter().flat_map(|c| &c.tracks) {
        animated[track.node as usize] = true;
    }
    let joints = bind::unify(&source, &scene, &animated, &mut primitives.drafts)?;
    let mut character = Character {
        nodes: scene.nodes,
        joints: joints.joints,
        materials: primitives.materials.materials,
        images: primitives.materials.images,
        ..Character::default()
    };
    warnings.append(&mut primitives.materials.warnings);
    let mut all_influences = Vec::with_capacity(primitives.drafts.len());
    let mut lost_normals = 0;
    for mut draft in primitives.drafts {
        lost_normals += draft.surface.complete_normals();
        let (part, part_influences) = draft.surface.into_part();
        character.parts.push(part);
        all_influences.push(part_influences);
    }
    if lost_normals > 0 {
        warnings.push(format!(
            "{lost_normals} normals have no direction; they are made from the faces"
        ));
    }
    character.clips = clips;
    character.warnings = warnings;
    influences::reduce(&mut character, &all_influences);
    prune(&mut character);
    Ok(character)
}

/// Refuses the file where it requires an extension that is not read.
fn check_extensions(path: &Path, document: &Document) -> Result<(), ImportError> {
    for extension in &document.extensions_required {
        if extension == "KHR_draco_mesh_compression" {
            return Err(draco(path, "extensionsRequired"));
        }
        let known = KNOWN_EXTENSIONS.contains(&extension.as_str())
            || extension.starts_with("KHR_materials_");
        if !known {
            return Err(ImportError::Unsupported {
                path: path.to_path_buf(),
                place: "extensionsRequired".into(),
                feature: super::files::shorten(extension, 80),
                hint: String::new(),
            });
        }
    }
    Ok(())
}

/// Drops joints that no vertex uses, nodes that no joint hangs in, and what animates only those.
fn prune(character: &mut Character) {
    let mut used = vec![false; character.joints.len()];
    for part in &character.parts {
        for (joints, weights) in part.joints.iter().zip(&part.weights) {
            for (&joint, &weight) in joints.iter().zip(weights) {
                used[joint as usize] |= weight > 0.0;
            }
        }
    }
    let new_joint = renumber(&used);
    for part in &mut character.parts {
        for (joints, weights) in part.joints.iter_mut().zip(&part.weights) {
            for (joint, &weight) in joints.iter_mut().zip(weights) {
                *joint = if weight > 0.0 {
                    new_joint[*joint as usize] as u16
                } else {
                    0
                };
            }
        }
    }
    let mut keep = used.iter();
    character.joints.retain(|_| *keep.next().unwrap_or(&false));

    let mut kept = vec![false; character.nodes.len()];
    for joint in &character.joints {
        kept[joint.node as usize] = true;
    }
    for i in (0..kept.len()).rev() {
        if let Some(parent) = character.nodes[i].parent {
            kept[parent as usize] |= kept[i];
        }
    }
    let new_node = renumber(&kept);
    for joint in &mut character.joints {
        joint.node = new_node[joint.node as usize];
    }
    let mut keep = kept.iter();
    character.nodes.retain(|_| *keep.next().unwrap_or(&false));
    for Node { parent, .. } in &mut character.nodes {
        *parent = parent.map(|p| new_node[p as usize]);
    }
    for Clip { tracks, .. } in &mut character.clips {
        tracks.retain(|t| kept[t.node as usize]);
        for track in tracks {
            track.node = new_node[track.node as usize];
        }
    }
    let still: Vec<&str> = character
        .clips
        .iter()
        .filter(|clip| clip.tracks.is_empty())
        .map(|clip| clip.name.as_str())
        .collect();
    if !still.is_empty() {
        character.warnings.push(format!(
            "{} clips move nothing that is drawn; they are left out: {}",
            still.len(),
            super::files::shorten(&still.join(", "), 200)
        ));
    }
    character.clips.retain(|clip| !clip.tracks.is_empty());
}

/// New indices of the entries that are kept.
fn renumber(kept: &[bool]) -> Vec<u32> {
    let mut next = 0;
    let number = |&keep: &bool| {
        let index = next;
        next += u32::from(keep);
        index
    };
    kept.iter().map(number).collect()
}
