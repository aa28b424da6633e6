//! `throng characters`: the built-in characters, listed or written out.

use std::path::PathBuf;

use anyhow::{Result, anyhow};
use throng_bake::{glb, people};

use super::output::{Progress, Table, grouped, say, write_file};
use super::source::{self, BUILTIN};

/// List the built-in characters, or write them out as .glb files
#[derive(clap::Args)]
#[command(
    long_about = "Lists the built-in characters, which are made by code and stand wherever a character file does as \
                  builtin:NAME; or writes them out as ordinary glTF files.",
    after_help = "Examples:\n  throng characters\n  throng characters --write models/"
)]
pub struct Arguments {
    /// Write each as FOLDER/NAME.glb
    #[arg(long, value_name = "FOLDER")]
    write: Option<PathBuf>,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    let progress = Progress::default();
    let mut table = Table::new(["character", "triangles", "joints", "clips"]);
    for name in people::names() {
        let character = source::character(&format!("{BUILTIN}{name}"), &progress)?;
        match &arguments.write {
            Some(folder) => {
                let path = folder.join(format!("{name}.glb"));
                let bytes =
                    glb::write_glb(&character).map_err(|e| anyhow!("{}: {e}", path.display()))?;
                write_file(&path, &bytes)?;
                say(format_args!("{}\n", path.display()))?;
            }
            None => table.row([
                format!("{BUILTIN}{name}"),
                grouped(character.triangle_count() as u64),
                character.joints.len().to_string(),
                character
                    .clips
                    .iter()
                    .map(|c| c.name.as_str())
                    .collect::<Vec<_>>()
                    .join(", "),
            ]),
        }
    }
    if arguments.write.is_none() {
        say(table)?;
    }
    Ok(())
}
