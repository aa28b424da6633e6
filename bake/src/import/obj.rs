//! Wavefront OBJ through `tobj`: a static character with one joint and no clips.

use std::path::Path;

use crate::character::Character;
use crate::error::ImportError;

/// Reads an OBJ file and the material library and textures that it names.
pub(super) fn import(path: &Path, _bytes: &[u8]) -> Result<Character, ImportError> {
    Err(ImportError::malformed(path, "file", "not yet"))
}
