//! Mean FLIP error of pictures, by tools/picture-error, which is Python.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Result, bail};

use crate::cli::measure::{Drawing, MethodName, Studio};
use crate::cli::render::save;
use crate::cli::shot::Shot;

/// Samples along each side of a pixel of the reference.
pub const SUPERSAMPLE: u32 = 4;

/// Mean FLIP error of every method's picture of the scene's first frame against `full` with many samples per pixel.
///
/// Errors: where tools/picture-error or what it needs is missing, or a picture cannot be drawn.
pub fn measure(
    shot: &Shot,
    studio: &mut Studio,
    device: Option<&str>,
    pixel_error: f32,
    methods: &[MethodName],
) -> Result<Vec<f64>> {
    let comparer = Comparer::new(None)?;
    let drawing = |method, supersample| Drawing {
        method,
        pixel_error,
        supersample,
        animated: true,
        time: 0.0,
        runs: 1,
    };
    let mut pictures = Vec::new();
    for &method in methods {
        studio.draw(shot, &drawing(method, 1))?;
        let path = comparer.path(method.name());
        save(studio, 1, &path)?;
        pictures.push(path);
    }
    let reference = comparer.path("reference");
    let mut large = Studio::new(shot, device, studio.size_px(), SUPERSAMPLE)?;
    large.draw(shot, &drawing(MethodName::Full, SUPERSAMPLE))?;
    save(&mut large, SUPERSAMPLE, &reference)?;
    comparer.errors(&reference, &pictures)
}

/// The tool, and a folder for the pictures that it is given.
pub struct Comparer {
    tool: PathBuf,
    folder: PathBuf,
    /// The folder is gone afterwards.
    is_temporary: bool,
}

impl Comparer {
    /// Pictures stay in `keep`, or else nowhere.
    ///
    /// Errors: where tools/picture-error is missing.
    pub fn new(keep: Option<&Path>) -> Result<Self> {
        let temporary = || std::env::temp_dir().join(format!("throng-flip-{}", std::process::id()));
        Ok(Self {
            tool: tool()?,
            folder: keep.map_or_else(temporary, Path::to_path_buf),
            is_temporary: keep.is_none(),
        })
    }

    /// Where a picture is to be written.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.join(format!("{name}.png"))
    }

    /// Mean FLIP error of each picture against the reference.
    ///
    /// Errors: with what the tool says, where what it needs is missing.
    pub fn errors(&self, reference: &Path, pictures: &[PathBuf]) -> Result<Vec<f64>> {
        let output = Command::new(&self.tool)
            .arg(reference)
            .args(pictures)
            .output();
        let output = match output {
            Ok(output) => output,
            Err(e) => bail!("{}: {e}", self.tool.display()),
        };
        if !output.status.success() {
            bail!("{}", String::from_utf8_lossy(&output.stderr).trim());
        }
        errors(&String::from_utf8_lossy(&output.stdout), pictures.len())
    }

    /// Removes a picture that is not to be kept.
    pub fn forget(&self, picture: &Path) {
        if self.is_temporary {
            // Whatever is left goes with the folder.
            let _ = std::fs::remove_file(picture);
        }
    }
}

impl Drop for Comparer {
    fn drop(&mut self) {
        if self.is_temporary {
            // What cannot be removed is the system's to clean up.
            let _ = std::fs::remove_dir_all(&self.folder);
        }
    }
}

/// The first word of each line.
fn errors(said: &str, count: usize) -> Result<Vec<f64>> {
    let words = said.lines().filter_map(|l| l.split_whitespace().next());
    let errors: Vec<f64> = words.filter_map(|w| w.parse().ok()).collect();
    if errors.len() != count {
        bail!("tools/picture-error said {said:?}, not {count} errors");
    }
    Ok(errors)
}

/// In the folder tools/ beside or above the working folder or this program.
fn tool() -> Result<PathBuf> {
    let places = [std::env::current_dir(), std::env::current_exe()];
    let found = places.iter().flatten().find_map(|place| {
        let tools = place.ancestors().map(|f| f.join("tools/picture-error"));
        tools.into_iter().find(|path| path.is_file())
    });
    match found {
        Some(path) => Ok(path),
        None => bail!(
            "tools/picture-error of the repository is neither above this folder nor above the program"
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_read_line_by_line() {
        let said = "0.01234  a.png\n0.5  b c.png\n";
        assert_eq!(errors(said, 2).unwrap(), [0.01234, 0.5]);
        assert!(errors(said, 3).is_err());
        assert!(errors("what", 1).is_err());
    }
}
