//! Characters from wherever the command line or a scene says: a built-in one, a baked file, a source file.

use std::path::{Path, PathBuf};

use anyhow::{Result, anyhow, bail};
use rayon::prelude::*;
use throng_bake::bake::{BakeOptions, BakeTimes, bake};
use throng_bake::baked::Baked;
use throng_bake::body_parts::apply_sidecar;
use throng_bake::character::{Character, UpAxis};
use throng_bake::{file, import, people};

use super::cache::{Cache, Subject};
use super::impostors::Plan;
use super::output::Progress;

/// What a built-in character's source begins with.
pub const BUILTIN: &str = "builtin:";

/// The axis that points up in source files that the command line names.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Up {
    /// +Y, as in glTF and most OBJ files
    #[default]
    Y,
    /// +Z, as scanners, CAD and map programs write it
    Z,
}

impl From<Up> for UpAxis {
    fn from(up: Up) -> Self {
        match up {
            Up::Y => Self::Y,
            Up::Z => Self::Z,
        }
    }
}

/// How characters that are not baked yet are baked.
#[derive(Default)]
pub struct Recipe {
    /// Of the files that the command line names; those of scenes have their own.
    pub up: Up,
    pub options: BakeOptions,
    /// Impostors, where they are wanted.
    pub impostors: Option<Plan>,
    /// Where baked characters are kept between runs.
    pub cache: Option<Cache>,
}

/// A character before baking: a built-in one, or a source file's content.
///
/// Errors where `source` is a file that is already baked.
pub fn character(source: &str, up: UpAxis, progress: &Progress) -> Result<Character> {
    if let Some(name) = source.strip_prefix(BUILTIN) {
        check_up(source, up)?;
        return builtin(name);
    }
    let (path, bytes) = read(source)?;
    if file::is_baked(&bytes) {
        bail!("{source}: it is baked already");
    }
    import_bytes(path, &bytes, up, progress)
}

/// Refuses to turn what stands as it does.
fn check_up(source: &str, up: UpAxis) -> Result<()> {
    match up {
        UpAxis::Y => Ok(()),
        UpAxis::Z => bail!("{source}: its up axis is y; z is for source files"),
    }
}

/// A character ready to draw; a source file or built-in character is baked first, unless the cache has it.
pub fn baked(source: &str, recipe: &Recipe, progress: &Progress) -> Result<Baked> {
    with_meshes(source, recipe.up.into(), recipe, progress)?.finish(source, recipe, progress)
}

/// Several, with their up axes, in the order of `sources`: meshes several at a time, impostors, which have a device to themselves, one by one.
pub fn baked_all(
    sources: &[(String, UpAxis)],
    recipe: &Recipe,
    progress: &Progress,
) -> Result<Vec<Baked>> {
    let meshes: Result<Vec<Draft>> = sources
        .par_iter()
        .map(|(s, up)| with_meshes(s, *up, recipe, progress))
        .collect();
    (sources.iter().zip(meshes?))
        .map(|((source, _), draft)| draft.finish(source, recipe, progress))
        .collect()
}

/// A character that may lack its impostors.
enum Draft {
    Done(Baked),
    /// Freshly baked, and where the cache will have it.
    Meshes(Baked, Option<PathBuf>),
}

impl Draft {
    fn finish(self, source: &str, recipe: &Recipe, progress: &Progress) -> Result<Baked> {
        let (mut baked, place) = match self {
            Self::Done(baked) => return Ok(baked),
            Self::Meshes(baked, place) => (baked, place),
        };
        if let Some(plan) = &recipe.impostors {
            plan.add_to(&mut baked, source, progress)?;
        }
        // What a machine without Vulkan left out would be missing later.
        let is_complete = recipe.impostors.is_none() || baked.impostors.is_some();
        if let (Some(cache), Some(place), true) = (&recipe.cache, place, is_complete) {
            cache.store(&place, &baked, progress);
        }
        Ok(baked)
    }
}

fn with_meshes(source: &str, up: UpAxis, recipe: &Recipe, progress: &Progress) -> Result<Draft> {
    let place = |subject: Subject, tints: &Tints| -> Result<Option<PathBuf>> {
        let Some(cache) = &recipe.cache else {
            return Ok(None);
        };
        let impostors = recipe.impostors.as_ref().map(|p| p.identity(source));
        let options = &recipe.options;
        let identity = format!("{options:?} {:?} {tints:?}", impostors.transpose()?);
        Ok(Some(cache.place(&subject, &identity)))
    };
    let cached = |place: &Option<PathBuf>| -> Option<Baked> {
        let cache = recipe.cache.as_ref()?;
        cache.load(place.as_ref()?, progress)
    };
    let (character, tints, place) = match source.strip_prefix(BUILTIN) {
        Some(name) => {
            check_up(source, up)?;
            let place = place(Subject::Builtin(name), &None)?;
            if let Some(baked) = cached(&place) {
                return Ok(Draft::Done(baked));
            }
            (builtin(name)?, None, place)
        }
        None => {
            let (path, bytes) = read(source)?;
            if file::is_baked(&bytes) {
                check_up(source, up)?;
                return Ok(Draft::Done(file::from_bytes(path, &bytes)?));
            }
            let character = import_bytes(path, &bytes, up, progress)?;
            let tints = tints(source)?;
            let place = place(Subject::Character(&character), &tints)?;
            if let Some(baked) = cached(&place) {
                return Ok(Draft::Done(baked));
            }
            (character, tints, place)
        }
    };
    let (baked, _) = bake_character(source, &character, &tints, &recipe.options, progress)?;
    Ok(Draft::Meshes(baked, place))
}

/// Bakes with a line on stderr that says how far it is. `tints` are those beside `source`, which errors name.
pub fn bake_character(
    source: &str,
    character: &Character,
    tints: &Tints,
    options: &BakeOptions,
    progress: &Progress,
) -> Result<(Baked, BakeTimes)> {
    let line = progress.spinner(&format!("Baking {}", character.name));
    let result = bake(character, options, &mut |stage| line.set_message(stage));
    line.finish_and_clear();
    let (mut baked, times) = result.map_err(|e| anyhow!("{source}: {e}"))?;
    if let Some((path, text)) = tints {
        progress.note(&format!("{source}: tints from {}", path.display()));
        apply_sidecar(path, text, &mut baked)?;
    }
    Ok((baked, times))
}

/// The file that says what a source's materials are, and its text.
pub type Tints = Option<(PathBuf, String)>;

/// What lies beside a source.
pub fn tints(source: &str) -> Result<Tints> {
    let path = Path::new(source).with_extension("tints.toml");
    if source.starts_with(BUILTIN) || !path.is_file() {
        return Ok(None);
    }
    match std::fs::read_to_string(&path) {
        Ok(text) => Ok(Some((path, text))),
        Err(e) => bail!("{}: {e}", path.display()),
    }
}

/// Refuses a source that is not there, before work is done for others.
pub fn check_exists(source: &str) -> Result<()> {
    match source.strip_prefix(BUILTIN) {
        Some(name) if !people::names().contains(&name) => builtin(name).map(|_| ()),
        Some(_) => Ok(()),
        None => match std::fs::metadata(source) {
            Ok(_) => Ok(()),
            Err(e) => bail!("{source}: cannot be read: {e}"),
        },
    }
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

fn import_bytes(path: &Path, bytes: &[u8], up: UpAxis, progress: &Progress) -> Result<Character> {
    if path.extension().is_some_and(|e| e == "throng") {
        bail!(
            "{}: header: it does not begin as a baked character does: it is cut off, or another file",
            path.display()
        );
    }
    let mut character = import::import_bytes(path, bytes)?;
    character.turn_up(up);
    for warning in &character.warnings {
        progress.warn(&format!("{}: {warning}", path.display()));
    }
    Ok(character)
}
