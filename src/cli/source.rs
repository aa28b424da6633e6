//! Characters from wherever the command line or a scene says: a built-in one, a baked file, a source file.

use std::path::Path;

use anyhow::{Result, anyhow, bail};
use rayon::prelude::*;
use throng_bake::bake::{BakeOptions, BakeTimes, bake};
use throng_bake::baked::Baked;
use throng_bake::character::Character;
use throng_bake::{file, import, people};

use super::impostors::Plan;
use super::output::Progress;

/// What a built-in character's source begins with.
pub const BUILTIN: &str = "builtin:";

/// How characters that are not baked yet are baked.
#[derive(Default)]
pub struct Recipe {
    pub options: BakeOptions,
    /// Impostors, where they are wanted.
    pub impostors: Option<Plan>,
}

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
pub fn baked(source: &str, recipe: &Recipe, progress: &Progress) -> Result<Baked> {
    let (mut baked, is_fresh) = with_meshes(source, &recipe.options, progress)?;
    if let (Some(plan), true) = (&recipe.impostors, is_fresh) {
        plan.add_to(&mut baked, source, progress)?;
    }
    Ok(baked)
}

/// Several, in the order of `sources`: meshes several at a time, impostors, which have a device to themselves, one by one.
pub fn baked_all(sources: &[String], recipe: &Recipe, progress: &Progress) -> Result<Vec<Baked>> {
    let meshes: Result<Vec<(Baked, bool)>> = sources
        .par_iter()
        .map(|s| with_meshes(s, &recipe.options, progress))
        .collect();
    let mut all = Vec::with_capacity(sources.len());
    for (source, (mut baked, is_fresh)) in sources.iter().zip(meshes?) {
        if let (Some(plan), true) = (&recipe.impostors, is_fresh) {
            plan.add_to(&mut baked, source, progress)?;
        }
        all.push(baked);
    }
    Ok(all)
}

/// A character without impostors and true, or as its baked file has it and false.
fn with_meshes(source: &str, options: &BakeOptions, progress: &Progress) -> Result<(Baked, bool)> {
    let character = match source.strip_prefix(BUILTIN) {
        Some(name) => builtin(name)?,
        None => {
            let (path, bytes) = read(source)?;
            if file::is_baked(&bytes) {
                return Ok((file::from_bytes(path, &bytes)?, false));
            }
            import_bytes(path, &bytes, progress)?
        }
    };
    Ok((
        bake_character(source, &character, options, progress)?.0,
        true,
    ))
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
