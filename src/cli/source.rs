//! Characters from wherever the command line or a scene says: a built-in one, a baked file, a source file.

use std::path::Path;

use anyhow::{Result, anyhow, bail};
use rayon::prelude::*;
use throng_bake::bake::{BakeOptions, BakeTimes, bake};
use throng_bake::baked::Baked;
use throng_bake::character::Character;
use throng_bake::{file, import, people};

use super::output::Progress;

/// What a built-in character's source begins with.
pub const BUILTIN: &str = "builtin:";

/// A character before baking: a built-in one, or a source file's content.
///
/// Errors where `source` is a file that is already baked.
pub fn character(source: &str, progress: &Progress) -> Result<Character> {
    if let Some(name) = source.strip_prefix(BUILTIN) {
        return builtin(name);
    }
    let (path, bytes) = read(source)?;
    if file::is_baked(&bytes) {
        bail!("{source}: it is baked already");
    }
    import_bytes(path, &bytes, progress)
}

/// A character ready to draw; a source file or built-in character is baked first.
pub fn baked(source: &str, options: &BakeOptions, progress: &Progress) -> Result<Baked> {
    let character = match source.strip_prefix(BUILTIN) {
        Some(name) => builtin(name)?,
        None => {
            let (path, bytes) = read(source)?;
            if file::is_baked(&bytes) {
                return Ok(file::from_bytes(path, &bytes)?);
            }
            import_bytes(path, &bytes, progress)?
        }
    };
    Ok(bake_character(source, &character, options, progress)?.0)
}

/// Several at a time, in the order of `sources`.
pub fn baked_all(
    sources: &[String],
    options: &BakeOptions,
    progress: &Progress,
) -> Result<Vec<Baked>> {
    sources
        .par_iter()
        .map(|s| baked(s, options, progress))
        .collect()
}

/// Bakes with a line on stderr that says how far it is. Errors name `source`.
pub fn bake_character(
    source: &str,
    character: &Character,
    options: &BakeOptions,
    progress: &Progress,
) -> Result<(Baked, BakeTimes)> {
    let line = progress.spinner(&format!("Baking {}", character.name));
    let result = bake(character, options, &mut |stage| line.set_message(stage));
    line.finish_and_clear();
    result.map_err(|e| anyhow!("{source}: {e}"))
}

fn builtin(name: &str) -> Result<Character> {
    Ok(people::build(name)?)
}

fn read(source: &str) -> Result<(&Path, Vec<u8>)> {
    let path = Path::new(source);
    match std::fs::read(path) {
        Ok(bytes) => Ok((path, bytes)),
        Err(e) => bail!("{source}: cannot be read: {e}"),
    }
}

fn import_bytes(path: &Path, bytes: &[u8], progress: &Progress) -> Result<Character> {
    let character = import::import_bytes(path, bytes)?;
    for warning in &character.warnings {
        progress.warn(&format!("{}: {warning}", path.display()));
    }
    Ok(character)
}
