//! `throng characters`: the built-in characters, listed or written out.

use std::path::PathBuf;

use anyhow::{Result, anyhow};
use rayon::prelude::*;
use throng_bake::character::{Character, UpAxis};
use throng_bake::{glb, people};

use super::output::{Progress, Table, grouped, say, write_file};
use super::source::{self, BUILTIN};

/// List the built-in characters, or write them out as .glb files
#[derive(clap::Args)]
#[command(
    long_about = "Lists the built-in characters, which are made by code and stand wherever a character file does as \
                  builtin:NAME; or writes them out as ordinary glTF files.",
    after_help = "Examples:\n  throng characters\n  throng characters --write models/\n  \
                  throng characters dog --write ."
)]
pub struct Arguments {
    /// Which ones; all where left out
    #[arg(value_name = "NAME")]
    names: Vec<String>,
    /// Write each as FOLDER/NAME.glb
    #[arg(long, value_name = "FOLDER")]
    write: Option<PathBuf>,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    let progress = Progress::default();
    let names: Vec<&str> = if arguments.names.is_empty() {
        people::names()
    } else {
        arguments.names.iter().map(String::as_str).collect()
    };
    let line = progress.spinner("Making characters");
    let characters: Vec<Character> = names
        .par_iter()
        .map(|name| {
            let name = name.strip_prefix(BUILTIN).unwrap_or(name);
            source::character(&format!("{BUILTIN}{name}"), UpAxis::Y, &progress)
        })
        .collect::<Result<_>>()?;
    line.finish_and_clear();
    match &arguments.write {
        Some(folder) => characters.iter().try_for_each(|c| {
            let path = folder.join(format!("{}.glb", c.name));
            let bytes = glb::write_glb(c).map_err(|e| anyhow!("{}: {e}", path.display()))?;
            write_file(&path, &bytes)?;
            say(format_args!("{}\n", path.display()))
        }),
        None => {
            let mut table = Table::new(["character", "triangles", "joints", "clips"]);
            for c in &characters {
                let clips: Vec<&str> = c.clips.iter().map(|c| c.name.as_str()).collect();
                table.row([
                    format!("{BUILTIN}{}", c.name),
                    grouped(c.triangle_count() as u64),
                    c.joints.len().to_string(),
                    clips.join(", "),
                ]);
            }
            say(table)
        }
    }
}
