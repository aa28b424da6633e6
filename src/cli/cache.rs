//! Baked characters kept between runs, so that built-in characters and source files are baked once and not every time.
//!
//! A file's name holds a key of everything that its content follows from: the character, the options, and the code that
//! bakes (build.rs). What nobody asked for in a long time goes when the folder grows large.

use std::collections::hash_map::DefaultHasher;
use std::fs::{File, OpenOptions};
use std::hash::{Hash, Hasher};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use throng_bake::baked::Baked;
use throng_bake::character::{Alpha, Character, Clip, Image, Material, Part, Track};
use throng_bake::file;

use super::output::Progress;

/// Key of the code that baked characters follow from.
const CODE: &str = env!("THRONG_BAKE_CODE");
/// Bytes that the folder's characters may take together.
const SIZE_LIMIT_BYTES: u64 = 1 << 30;

/// What a command may be told of the cache.
#[derive(clap::Args)]
pub struct Options {
    /// Bake anew, neither reading nor writing the cache of baked characters
    #[arg(long)]
    no_cache: bool,
}

impl Options {
    /// The user's cache; `None` where it is not wanted or the system has no place for it.
    pub fn open(&self) -> Option<Cache> {
        let absolute = |name| {
            let path = PathBuf::from(std::env::var_os(name)?);
            path.is_absolute().then_some(path)
        };
        let folder = absolute("XDG_CACHE_HOME")
            .or_else(|| Some(absolute("HOME")?.join(".cache")))
            .or_else(|| absolute("LOCALAPPDATA"))?;
        (!self.no_cache).then(|| Cache {
            folder: folder.join("throng"),
            size_limit_bytes: SIZE_LIMIT_BYTES,
        })
    }
}

/// A folder of baked characters.
pub struct Cache {
    folder: PathBuf,
    size_limit_bytes: u64,
}

/// What is baked: a built-in character is known by its name, as the code makes the rest.
pub enum Subject<'a> {
    Builtin(&'a str),
    Character(&'a Character),
}

impl Cache {
    /// Where a character, baked with options that `recipe` tells apart, is kept.
    pub fn place(&self, subject: &Subject, recipe: &str) -> PathBuf {
        // Two hashers, as 64 bits are few for "never two alike".
        let keys = [0u8, 1].map(|salt| {
            let mut hasher = DefaultHasher::new();
            (salt, CODE, recipe).hash(&mut hasher);
            match subject {
                Subject::Builtin(name) => (0u8, name).hash(&mut hasher),
                Subject::Character(character) => {
                    hasher.write_u8(1);
                    hash_character(character, &mut hasher);
                }
            }
            hasher.finish()
        });
        let name = match subject {
            Subject::Builtin(name) => name,
            Subject::Character(character) => character.name.as_str(),
        };
        let name: String = name
            .chars()
            .map(|c| if c.is_ascii_alphanumeric() { c } else { '_' })
            .take(40)
            .collect();
        let [a, b] = keys;
        self.folder.join(format!("{name}-{a:016x}{b:016x}.throng"))
    }

    /// What is kept there; `None`, and for a damaged file a note, where nothing is.
    pub fn load(&self, place: &Path, progress: &Progress) -> Option<Baked> {
        let bytes = std::fs::read(place).ok()?;
        match file::from_bytes(place, &bytes) {
            Ok(baked) => {
                // Only for the order in which files go; that of a folder that cannot be written does not matter.
                let _ = OpenOptions::new()
                    .write(true)
                    .open(place)
                    .and_then(|f: File| f.set_modified(SystemTime::now()));
                Some(baked)
            }
            Err(e) => {
                progress.note(&format!("{e}: baking it again"));
                None
            }
        }
    }

    /// Keeps a character; where that fails, a note says so.
    pub fn store(&self, place: &Path, baked: &Baked, progress: &Progress) {
        if let Err(e) = std::fs::create_dir_all(&self.folder) {
            progress.note(&format!("{}: no cache: {e}", self.folder.display()));
        } else if let Err(e) = file::write(place, baked) {
            progress.note(&format!("not cached: {e}"));
        } else {
            self.trim(place);
        }
    }

    /// Removes the characters that were not used for the longest time until the others are within the limit, but never
    /// `newest`.
    fn trim(&self, newest: &Path) {
        let mut files: Vec<(SystemTime, u64, PathBuf)> = std::fs::read_dir(&self.folder)
            .into_iter()
            .flatten()
            .flatten()
            .filter_map(|entry| {
                let (path, meta) = (entry.path(), entry.metadata().ok()?);
                let is_ours = path.extension().is_some_and(|e| e == "throng") && meta.is_file();
                is_ours.then(|| Some((meta.modified().ok()?, meta.len(), path)))?
            })
            .collect();
        files.sort();
        let mut total: u64 = files.iter().map(|f| f.1).sum();
        for (_, bytes, path) in files {
            if total <= self.size_limit_bytes {
                return;
            }
            // Another process may have removed it already.
            if path != newest && std::fs::remove_file(&path).is_ok() {
                total -= bytes;
            }
        }
    }
}

/// Everything of a character that a bake may depend on. All fields are named, so that a new one cannot be forgotten.
fn hash_character(character: &Character, h: &mut DefaultHasher) {
    let Character {
        name,
        parts,
        materials,
        images,
        nodes,
        joints,
        clips,
        warnings: _,
    } = character;
    name.hash(h);
    each(parts, h, |part, h| {
        let Part {
            name,
            material,
            positions,
            normals,
            uvs,
            colors,
            joints,
            weights,
            triangles,
        } = part;
        (name, material).hash(h);
        array(positions, h);
        array(normals, h);
        array(uvs, h);
        array(colors, h);
        array(joints, h);
        array(weights, h);
        array(triangles, h);
    });
    each(materials, h, |material, h| {
        let Material {
            name,
            base_color,
            base_color_image,
            alpha,
            double_sided,
        } = material;
        (name, base_color_image, double_sided).hash(h);
        array(base_color, h);
        match alpha {
            Alpha::Opaque => h.write_u8(0),
            Alpha::Mask(cutoff) => (1u8, cutoff.to_bits()).hash(h),
        }
    });
    each(images, h, |image, h| {
        let Image {
            name,
            width,
            height,
            pixels,
        } = image;
        (name, width, height).hash(h);
        array(pixels, h);
    });
    each(nodes, h, |node, h| {
        (&node.name, node.parent).hash(h);
        array(&[node.rest.translation, node.rest.scale], h);
        array(&[node.rest.rotation], h);
    });
    each(joints, h, |joint, h| {
        joint.node.hash(h);
        array(&[joint.joint_from_bind], h);
    });
    each(clips, h, |clip, h| {
        let Clip {
            name,
            duration_s,
            ground_speed,
            tracks,
        } = clip;
        (name, duration_s.to_bits(), ground_speed.to_bits()).hash(h);
        each(tracks, h, |track, h| {
            let Track {
                node,
                property,
                interpolation,
                times_s,
                values,
            } = track;
            (node, *property as u32, *interpolation as u32).hash(h);
            array(times_s, h);
            array(values, h);
        });
    });
}

fn each<T>(items: &[T], h: &mut DefaultHasher, hash: impl Fn(&T, &mut DefaultHasher)) {
    h.write_usize(items.len());
    items.iter().for_each(|item| hash(item, h));
}

fn array<T: bytemuck::Pod>(items: &[T], h: &mut DefaultHasher) {
    let bytes: &[u8] = bytemuck::cast_slice(items);
    bytes.hash(h);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cache(folder: &Path) -> Cache {
        Cache {
            folder: folder.join("throng"),
            size_limit_bytes: 100,
        }
    }

    #[test]
    fn a_place_depends_on_everything() {
        let cache = cache(Path::new("/cache"));
        let mut character = Character {
            name: "a/b".into(),
            parts: vec![Part::default()],
            ..Character::default()
        };
        let place = |c: &Character, recipe| cache.place(&Subject::Character(c), recipe);
        let first = place(&character, "r");
        assert_eq!(first, place(&character, "r"));
        let name = first.file_name().expect("a file").to_string_lossy();
        assert!(
            name.starts_with("a_b-") && name.ends_with(".throng"),
            "{name}"
        );
        assert_ne!(first, place(&character, "s"));
        character.parts[0].positions.push(glam::Vec3::ZERO);
        let second = place(&character, "r");
        assert_ne!(first, second);
        character.parts[0].normals = std::mem::take(&mut character.parts[0].positions);
        assert_ne!(second, place(&character, "r"));
        let builtin = |name| cache.place(&Subject::Builtin(name), "r");
        assert_ne!(builtin("dog"), builtin("man_suit"));
    }

    #[test]
    fn what_was_not_used_for_long_goes() {
        let folder = tempfile::tempdir().expect("a folder");
        let cache = cache(folder.path());
        std::fs::create_dir_all(&cache.folder).expect("a folder");
        let write = |name: &str, seconds: u64| {
            let path = cache.folder.join(name);
            std::fs::write(&path, [0; 40]).expect("it is written");
            let time = SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(seconds);
            let file = OpenOptions::new().write(true).open(&path).expect("opens");
            file.set_modified(time).expect("a time");
            path
        };
        let (old, young) = (write("a.throng", 10), write("b.throng", 20));
        let (other, newest) = (write("notes.txt", 1), write("c.throng", 5));
        cache.trim(&newest);
        assert!(!old.exists() && young.exists() && other.exists() && newest.exists());
    }
}
