//! Reads character files: glTF 2.0 (`.glb`, `.gltf`) and Wavefront OBJ.
//!
//! An importer makes a [`Character`] whose bind space is the scene's own space in the scene's units, near the rest pose:
//! mesh, node and quantisation scales are folded into positions and inverse bind matrices. What is dropped or repaired
//! on the way is said in [`Character::warnings`]; what cannot be read is refused with the file, the place and the
//! reason. The content is not trusted: a number is checked before it indexes or allocates.

mod files;
mod gltf;
mod images;
mod influences;
mod obj;
mod surface;
mod up;

use std::path::Path;

use crate::character::Character;
use crate::error::ImportError;

/// Reads the character file at `path` and whatever files it names beside it.
///
/// The format goes by the content, and by the name's extension where the content does not tell.
/// Errors: [`ImportError::Io`] where the file cannot be read, [`ImportError::Malformed`] where the content breaks its
/// format's rules or names a file that cannot be read, [`ImportError::Unsupported`] where it is legal but not read here.
pub fn import(path: &Path) -> Result<Character, ImportError> {
    import_bytes(path, &files::read(path)?)
}

/// As [`import`], from the content of the file. `path` names the character, completes the errors and locates the files
/// that the content refers to.
pub fn import_bytes(path: &Path, bytes: &[u8]) -> Result<Character, ImportError> {
    let extension = path
        .extension()
        .map(|e| e.to_string_lossy().to_ascii_lowercase())
        .unwrap_or_default();
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let first = text.iter().find(|b| !b.is_ascii_whitespace());
    let mut character = if bytes.starts_with(b"glTF") {
        gltf::import_glb(path, bytes)?
    } else if first == Some(&b'{') || extension == "gltf" {
        gltf::import_json(path, text)?
    } else if extension == "glb" {
        return Err(ImportError::malformed(
            path,
            "header",
            "it does not start with 'glTF'",
        ));
    } else if extension == "obj" {
        obj::import(path, text)?
    } else {
        let kind = if extension == "fbx" || bytes.starts_with(b"Kaydara FBX") {
            "FBX".to_string()
        } else {
            format!("a file of kind '.{extension}'")
        };
        return Err(ImportError::Unsupported {
            path: path.to_path_buf(),
            place: "file".into(),
            feature: kind,
            hint: "convert it to glTF 2.0 (.glb)".into(),
        });
    };
    if character.name.is_empty() {
        character.name = path
            .file_stem()
            .map(|s| s.to_string_lossy().into_owned())
            .unwrap_or_default();
    }
    character.validate(path)?;
    Ok(character)
}
