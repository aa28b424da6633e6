//! The `.throng` file: a header, a section table, then the arrays of [`Baked`] as they are, little-endian.
//!
//! | bytes | what |
//! |---|---|
//! | 0..8 | magic `THRONG\r\n` |
//! | 8..12 | version |
//! | 12..16 | number of sections |
//! | 16..24 | length of the file |
//! | 24..28 | CRC-32 of everything from byte 32 |
//! | 28..32 | zero |
//! | 32.. | sections: id (4 bytes), zero (4 bytes), offset (8), length in bytes (8) |
//!
//! Section payloads begin at multiples of 16. `META` is JSON: names, records and extents; `INDX` is packed, see
//! [`crate::indices`]; the others are arrays that upload without parsing. A character with impostors has five sections more. Reading checks every index, count and number before anything else may use them.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

use bytemuck::Pod;
use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};

use crate::baked::{Baked, BakedClip, BodyPart, Submesh, TextureArray};
use crate::character::{Clip, Interpolation, Joint, Node, Property, Track};
use crate::error::FileError;
use crate::impostor::file::{self as impostor_file, ImpostorMeta};
use crate::indices;
use crate::validate;

/// First bytes of every baked character.
pub const MAGIC: [u8; 8] = *b"THRONG\r\n";
/// Version that this build reads and writes.
pub const VERSION: u32 = 7;

const HEADER_BYTES: usize = 32;
const ENTRY_BYTES: usize = 24;
const ALIGNMENT: usize = 16;

/// Everything that is not a large array.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Meta {
    name: String,
    submeshes: Vec<Submesh>,
    position_min: Vec3,
    position_extent: Vec3,
    uv_min: Vec2,
    uv_extent: Vec2,
    error_max: f32,
    index_count: u64,
    body_parts: Vec<BodyPart>,
    clips: Vec<BakedClip>,
    nodes: Vec<Node>,
    joints: Vec<Joint>,
    source_clips: Vec<ClipMeta>,
    texture_size: [u32; 2],
    texture_layers: u32,
    texture_mips: u32,
    impostors: Option<ImpostorMeta>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ClipMeta {
    name: String,
    duration_s: f32,
    ground_speed: f32,
    tracks: Vec<TrackMeta>,
}

/// Keys and values stand one track after the other in the section `KEYS`.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct TrackMeta {
    node: u32,
    property: Property,
    interpolation: Interpolation,
    key_count: u32,
}

/// True if `bytes` begin as a baked character does.
pub fn is_baked(bytes: &[u8]) -> bool {
    bytes.starts_with(&MAGIC)
}

/// The file's bytes. The same character gives the same bytes.
pub fn to_bytes(baked: &Baked) -> Vec<u8> {
    let (clip_meta, keys) = split_clips(&baked.source_clips);
    let impostors = baked.impostors.as_ref().map(impostor_file::split);
    let (impostor_meta, impostor_arrays) = impostors.unzip();
    let meta = Meta {
        impostors: impostor_meta,
        name: baked.name.clone(),
        submeshes: baked.submeshes.clone(),
        position_min: baked.position_min,
        position_extent: baked.position_extent,
        uv_min: baked.uv_min,
        uv_extent: baked.uv_extent,
        error_max: baked.error_max,
        index_count: baked.indices.len() as u64,
        body_parts: baked.body_parts.clone(),
        clips: baked.clips.clone(),
        nodes: baked.nodes.clone(),
        joints: baked.joints.clone(),
        source_clips: clip_meta,
        texture_size: [baked.textures.width, baked.textures.height],
        texture_layers: baked.textures.layer_count,
        texture_mips: baked.textures.mip_count,
    };
    let meta = serde_json::to_vec(&meta).expect("plain records always become JSON");
    let indices = indices::pack(&baked.indices);
    let mut sections: Vec<(&[u8], &[u8])> = vec![
        (b"META", &meta),
        (b"VERT", bytemuck::cast_slice(&baked.vertices)),
        (b"COLL", bytemuck::cast_slice(&baked.collapse)),
        (b"BAND", bytemuck::cast_slice(&baked.bands)),
        (b"INDX", &indices),
        (b"PALT", bytemuck::cast_slice(&baked.palette)),
        (b"KEYS", bytemuck::cast_slice(&keys)),
        (b"TEXR", bytemuck::cast_slice(&baked.textures.pixels)),
    ];
    if let Some(arrays) = &impostor_arrays {
        let named = impostor_file::SECTIONS.iter().zip(arrays);
        sections.extend(named.map(|(id, array)| (id.as_bytes(), &array[..])));
    }
    let mut out =
        vec![0; (HEADER_BYTES + ENTRY_BYTES * sections.len()).next_multiple_of(ALIGNMENT)];
    for (i, (id, payload)) in sections.iter().enumerate() {
        let (at, offset) = (HEADER_BYTES + ENTRY_BYTES * i, out.len());
        out[at..at + 4].copy_from_slice(id);
        out[at + 8..at + 16].copy_from_slice(&(offset as u64).to_le_bytes());
        out[at + 16..at + 24].copy_from_slice(&(payload.len() as u64).to_le_bytes());
        out.extend_from_slice(payload);
        out.resize(out.len().next_multiple_of(ALIGNMENT), 0);
    }
    out[..8].copy_from_slice(&MAGIC);
    out[8..12].copy_from_slice(&VERSION.to_le_bytes());
    out[12..16].copy_from_slice(&(sections.len() as u32).to_le_bytes());
    let length = out.len() as u64;
    out[16..24].copy_from_slice(&length.to_le_bytes());
    let checksum = crc32fast::hash(&out[HEADER_BYTES..]);
    out[24..28].copy_from_slice(&checksum.to_le_bytes());
    out
}

/// Writes the file whole or not at all: to a temporary file beside it, which is then renamed.
///
/// Errors: [`FileError::Io`].
pub fn write(path: &Path, baked: &Baked) -> Result<(), FileError> {
    write_whole(path, &to_bytes(baked))
}

/// Writes `bytes` to `path` whole or not at all. What a link leads to is replaced, not the link; a device or a pipe, such
/// as `/dev/stdout`, is written to as it is. Whatever ends the process meanwhile leaves the old file, and on Linux nothing else
/// (where the file system has files without a name).
///
/// Errors: [`FileError::Io`].
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    let io = |action| {
        move |source| FileError::Io {
            path: path.to_path_buf(),
            action,
            source,
        }
    };
    let is_stream = std::fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir());
    if is_stream {
        let opened = std::fs::OpenOptions::new().write(true).open(path);
        let written = opened.and_then(|mut f| f.write_all(bytes));
        return written.map_err(io("cannot be written"));
    }
    let target = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
    let mut name = std::ffi::OsString::from(".");
    name.push(target.file_name().unwrap_or_default());
    name.push(format!(".{}.part", std::process::id()));
    let part = target.with_file_name(name);
    let result = create_whole(&part, bytes)
        .map_err(io("cannot be written"))
        .and_then(|()| std::fs::rename(&part, &target).map_err(io("cannot be put in place")));
    if result.is_err() {
        // Already failing: the first error is the one to tell.
        let _ = std::fs::remove_file(&part);
    }
    result
}

/// Makes a file that has its name only once it is written.
#[cfg(target_os = "linux")]
fn create_whole(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    use rustix::fs::{AtFlags, CWD, Mode, OFlags};
    use std::os::fd::AsRawFd;
    let folder = path.parent().filter(|f| !f.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new("."));
    let flags = OFlags::WRONLY | OFlags::TMPFILE | OFlags::CLOEXEC;
    let Ok(file) = rustix::fs::open(folder, flags, Mode::from_raw_mode(0o666)) else {
        return create_named(path, bytes);
    };
    let mut file = std::fs::File::from(file);
    file.write_all(bytes)?;
    file.sync_all()?;
    let open_file = format!("/proc/self/fd/{}", file.as_raw_fd());
    let named = rustix::fs::linkat(CWD, open_file, CWD, path, AtFlags::SYMLINK_FOLLOW);
    named.or_else(|_| create_named(path, bytes))
}

#[cfg(not(target_os = "linux"))]
use create_named as create_whole;

/// Makes a file by its name, which a process that ends meanwhile leaves.
fn create_named(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut file = std::fs::File::create(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

/// Reads and checks a baked character.
///
/// Errors: [`FileError`] with the section and the reason.
pub fn read(path: &Path) -> Result<Baked, FileError> {
    let bytes = std::fs::read(path).map_err(|source| FileError::Io {
        path: path.to_path_buf(),
        action: "cannot be read",
        source,
    })?;
    from_bytes(path, &bytes)
}

/// The character in `bytes`; `path` is for error messages.
///
/// Errors: [`FileError::Malformed`] with the section and the reason.
pub fn from_bytes(path: &Path, bytes: &[u8]) -> Result<Baked, FileError> {
    let malformed = |place: &str, reason: String| FileError::Malformed {
        path: path.to_path_buf(),
        place: place.into(),
        reason,
    };
    let sections = sections(bytes).map_err(|reason| malformed("header", reason))?;
    let find = |id: &'static str| {
        sections
            .get(id.as_bytes())
            .copied()
            .ok_or_else(|| malformed(id, "the section is missing".into()))
    };
    let meta: Meta =
        serde_json::from_slice(find("META")?).map_err(|e| malformed("META", e.to_string()))?;
    let indices = indices::unpack(find("INDX")?, meta.index_count);
    let impostors = match meta.impostors {
        None => None,
        Some(records) => {
            let mut arrays = [&[][..]; 5];
            for (array, id) in arrays.iter_mut().zip(impostor_file::SECTIONS) {
                *array = find(id)?;
            }
            let joined = impostor_file::join(records, arrays);
            Some(joined.map_err(|(place, reason)| malformed(place, reason))?)
        }
    };
    let keys = array::<f32>(find("KEYS")?).map_err(|e| malformed("KEYS", e))?;
    let baked = Baked {
        vertices: array(find("VERT")?).map_err(|e| malformed("VERT", e))?,
        collapse: array(find("COLL")?).map_err(|e| malformed("COLL", e))?,
        bands: array(find("BAND")?).map_err(|e| malformed("BAND", e))?,
        indices: indices.map_err(|e| malformed("INDX", e))?,
        palette: array(find("PALT")?).map_err(|e| malformed("PALT", e))?,
        textures: TextureArray {
            width: meta.texture_size[0],
            height: meta.texture_size[1],
            layer_count: meta.texture_layers,
            mip_count: meta.texture_mips,
            pixels: array(find("TEXR")?).map_err(|e| malformed("TEXR", e))?,
        },
        source_clips: join_clips(meta.source_clips, &keys).map_err(|e| malformed("KEYS", e))?,
        name: meta.name,
        submeshes: meta.submeshes,
        position_min: meta.position_min,
        position_extent: meta.position_extent,
        uv_min: meta.uv_min,
        uv_extent: meta.uv_extent,
        body_parts: meta.body_parts,
        clips: meta.clips,
        nodes: meta.nodes,
        joints: meta.joints,
        error_max: meta.error_max,
        impostors,
    };
    validate::validate(&baked).map_err(|(place, reason)| malformed(&place, reason))?;
    Ok(baked)
}

/// Checks the header and cuts the file into its sections.
fn sections(bytes: &[u8]) -> Result<BTreeMap<[u8; 4], &[u8]>, String> {
    if !is_baked(bytes) {
        return Err("this is not a baked character".into());
    }
    let word = |at: usize| {
        bytes
            .get(at..at + 4)
            .map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
            .ok_or("the file is cut off")
    };
    let long = |at: usize| Ok::<u64, String>(u64::from(word(at)?) | u64::from(word(at + 4)?) << 32);
    let version = word(8)?;
    if version != VERSION {
        return Err(format!(
            "it has version {version}, and this build reads version {VERSION}: bake the character again"
        ));
    }
    let (count, length, checksum) = (word(12)? as usize, long(16)?, word(24)?);
    if length != bytes.len() as u64 {
        return Err(format!(
            "it says that it has {length} bytes, and it has {}",
            bytes.len()
        ));
    }
    if word(28)? != 0 || crc32fast::hash(&bytes[HEADER_BYTES..]) != checksum {
        return Err("its checksum does not match: the file is damaged".into());
    }
    if count > (bytes.len() - HEADER_BYTES) / ENTRY_BYTES {
        return Err(format!("it cannot hold {count} sections"));
    }
    let mut found = BTreeMap::new();
    for i in 0..count {
        let at = HEADER_BYTES + ENTRY_BYTES * i;
        let id = word(at)?.to_le_bytes();
        let (offset, length) = (long(at + 8)?, long(at + 16)?);
        let payload = usize::try_from(offset)
            .ok()
            .zip(
                offset
                    .checked_add(length)
                    .and_then(|end| usize::try_from(end).ok()),
            )
            .and_then(|(from, to)| bytes.get(from..to))
            .ok_or_else(|| format!("section {i} lies outside the file"))?;
        if found.insert(id, payload).is_some() {
            return Err(format!("section {i} is there twice"));
        }
    }
    Ok(found)
}

/// The section as records.
pub(crate) fn array<T: Pod>(payload: &[u8]) -> Result<Vec<T>, String> {
    if !payload.len().is_multiple_of(size_of::<T>()) {
        return Err(format!(
            "{} bytes are no whole number of records of {}",
            payload.len(),
            size_of::<T>()
        ));
    }
    Ok(bytemuck::pod_collect_to_vec(payload))
}

fn split_clips(clips: &[Clip]) -> (Vec<ClipMeta>, Vec<f32>) {
    let mut keys = Vec::new();
    let mut track_meta = |t: &Track| {
        keys.extend_from_slice(&t.times_s);
        keys.extend_from_slice(&t.values);
        TrackMeta {
            node: t.node,
            property: t.property,
            interpolation: t.interpolation,
            key_count: t.times_s.len() as u32,
        }
    };
    let meta = clips
        .iter()
        .map(|c| ClipMeta {
            name: c.name.clone(),
            duration_s: c.duration_s,
            ground_speed: c.ground_speed,
            tracks: c.tracks.iter().map(&mut track_meta).collect(),
        })
        .collect();
    (meta, keys)
}

fn join_clips(meta: Vec<ClipMeta>, mut keys: &[f32]) -> Result<Vec<Clip>, String> {
    let mut take = |n: usize| {
        let (head, tail) = keys
            .split_at_checked(n)
            .ok_or("there are fewer keys than the tracks say")?;
        keys = tail;
        Ok::<_, String>(head.to_vec())
    };
    let mut clips = Vec::with_capacity(meta.len());
    for c in meta {
        let mut tracks = Vec::with_capacity(c.tracks.len());
        for t in c.tracks {
            let n = t.key_count as usize;
            let width = t.property.width()
                * if t.interpolation == Interpolation::CubicSpline {
                    3
                } else {
                    1
                };
            let values = n.checked_mul(width).ok_or("a track has too many keys")?;
            tracks.push(Track {
                node: t.node,
                property: t.property,
                interpolation: t.interpolation,
                times_s: take(n)?,
                values: take(values)?,
            });
        }
        clips.push(Clip {
            name: c.name,
            duration_s: c.duration_s,
            ground_speed: c.ground_speed,
            tracks,
        });
    }
    if keys.is_empty() {
        Ok(clips)
    } else {
        Err("there are more keys than the tracks say".into())
    }
}
