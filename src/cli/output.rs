//! What the program says: progress bars, numbers, tables and files.

use std::fmt::{Display, Write as _};
use std::io::{ErrorKind, Write as _};
use std::path::Path;
use std::time::Duration;

use anyhow::{Result, anyhow, bail};
use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use serde::Serialize;

/// Progress bars on stderr; silent where that is no terminal.
#[derive(Default)]
pub struct Progress {
    bars: MultiProgress,
}

impl Progress {
    /// A line that says what is being done, for work whose length is not known.
    pub fn spinner(&self, what: &str) -> ProgressBar {
        let bar = self.bars.add(ProgressBar::new_spinner());
        if let Ok(style) = ProgressStyle::with_template("{spinner} {prefix} {msg:.dim} ({elapsed})")
        {
            bar.set_style(style);
        }
        bar.set_prefix(what.to_string());
        bar.enable_steady_tick(Duration::from_millis(100));
        bar
    }

    /// A bar for `length` steps.
    pub fn bar(&self, what: &str, length: u64) -> ProgressBar {
        let bar = self.bars.add(ProgressBar::new(length));
        if let Ok(style) =
            ProgressStyle::with_template("{prefix} {bar:40} {pos}/{len} {msg:.dim} ({eta} left)")
        {
            bar.set_style(style);
        }
        bar.set_prefix(what.to_string());
        bar
    }

    /// Warns the user without tearing the bars.
    pub fn warn(&self, message: &str) {
        self.note(&format!("warning: {message}"));
    }

    /// Tells the user something without tearing the bars.
    pub fn note(&self, message: &str) {
        self.bars.suspend(|| eprintln!("throng: {message}"));
    }
}

/// Prints a result. A reader that has seen enough, such as `head`, is no error and stops nothing.
pub fn say(result: impl Display) -> Result<()> {
    match std::io::stdout().write_all(result.to_string().as_bytes()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(anyhow!("standard output: {e}")),
        _ => Ok(()),
    }
}

/// A whole number with its thousands apart: 12,345.
pub fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::with_capacity(digits.len() + digits.len() / 3);
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// Columns side by side: the first flush left, the others flush right.
pub struct Table {
    rows: Vec<Vec<String>>,
}

impl Table {
    /// A table with a first row.
    pub fn new<const N: usize>(heads: [&str; N]) -> Self {
        Self::with_heads(heads)
    }

    /// A table whose number of columns is known only now.
    pub fn with_heads(heads: impl IntoIterator<Item = impl Into<String>>) -> Self {
        Self {
            rows: vec![heads.into_iter().map(Into::into).collect()],
        }
    }

    /// Adds a row.
    pub fn row<const N: usize>(&mut self, cells: [String; N]) {
        self.push(cells.to_vec());
    }

    /// Adds a row.
    pub fn push(&mut self, cells: Vec<String>) {
        self.rows.push(cells);
    }
}

impl Display for Table {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let column_count = self.rows.iter().map(Vec::len).max().unwrap_or(0);
        let widths: Vec<usize> = (0..column_count)
            .map(|c| {
                let cells = self.rows.iter().filter_map(|r| r.get(c));
                cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
            })
            .collect();
        for row in &self.rows {
            let mut line = String::new();
            for (c, (cell, &width)) in row.iter().zip(&widths).enumerate() {
                if c == 0 {
                    write!(line, "  {cell:width$}")?;
                } else {
                    write!(line, "  {cell:>width$}")?;
                }
            }
            writeln!(f, "{}", line.trim_end())?;
        }
        Ok(())
    }
}

/// Writes a report as JSON, whole or not at all.
pub fn write_json(path: &Path, report: &impl Serialize) -> Result<()> {
    let mut text = serde_json::to_string_pretty(report)?;
    text.push('\n');
    write_file(path, text.as_bytes())
}

/// Writes a file, whole or not at all, and the folders it lies in.
pub fn write_file(path: &Path, bytes: &[u8]) -> Result<()> {
    create_folder(path.parent())?;
    Ok(throng_bake::file::write_whole(path, bytes)?)
}

/// Kinds of files that somebody would be surprised to find something else in.
const KNOWN_KINDS: [&str; 17] = [
    "bmp", "exr", "fbx", "gif", "glb", "gltf", "jpeg", "jpg", "json", "obj", "png", "svg",
    "throng", "tif", "tiff", "toml", "webp",
];

/// Refuses, before any work is done for it, an output that is a folder, that is named as another kind of file than it will
/// be, or that would take the place of one of the files it is made from.
pub fn check_output<'a>(
    path: &Path,
    kind: &str,
    inputs: impl IntoIterator<Item = &'a str>,
) -> Result<()> {
    if path.is_dir() || path.as_os_str().to_string_lossy().ends_with('/') {
        bail!("{}: it is a folder; name a file", path.display());
    }
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    if let Some(e) = extension.filter(|e| e != kind && KNOWN_KINDS.contains(&e.as_str())) {
        bail!(
            "{}: what is written is no .{e} file; name it .{kind}",
            path.display()
        );
    }
    let output = path.canonicalize().ok();
    for input in inputs {
        if output.is_some() && Path::new(input).canonicalize().ok() == output {
            bail!(
                "{}: it is what is read, and would be overwritten",
                path.display()
            );
        }
    }
    Ok(())
}

/// Makes sure that a folder exists.
pub fn create_folder(folder: Option<&Path>) -> Result<()> {
    match folder {
        Some(f) if !f.as_os_str().is_empty() => std::fs::create_dir_all(f)
            .map_err(|e| anyhow!("{}: cannot be created: {e}", f.display())),
        _ => Ok(()),
    }
}

/// The middle value, and the one that 95 % are not above; 0 where there are none.
pub fn median_p95(values: &[f64]) -> (f64, f64) {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| {
        let index = (share * sorted.len() as f64).ceil() as usize;
        sorted.get(index.saturating_sub(1)).copied().unwrap_or(0.0)
    };
    let n = sorted.len();
    let median = if n > 0 && n.is_multiple_of(2) {
        (sorted[n / 2 - 1] + sorted[n / 2]) / 2.0
    } else {
        at(0.5)
    };
    (median, at(0.95))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_grouped_by_thousands() {
        for (n, text) in [
            (0, "0"),
            (999, "999"),
            (1000, "1,000"),
            (1234567, "1,234,567"),
        ] {
            assert_eq!(grouped(n), text);
        }
    }

    #[test]
    fn tables_line_up() {
        let mut t = Table::new(["band", "vertices"]);
        t.row(["0".into(), "12".into()]);
        assert_eq!(t.to_string(), "  band  vertices\n  0           12\n");
    }

    #[test]
    fn medians_and_percentiles() {
        assert_eq!(median_p95(&[]), (0.0, 0.0));
        assert_eq!(median_p95(&[3.0]), (3.0, 3.0));
        assert_eq!(median_p95(&[4.0, 1.0, 2.0]), (2.0, 4.0));
        assert_eq!(median_p95(&[4.0, 1.0]), (2.5, 4.0));
        let hundred: Vec<f64> = (1..=100).map(f64::from).collect();
        assert_eq!(median_p95(&hundred), (50.5, 95.0));
    }
}
