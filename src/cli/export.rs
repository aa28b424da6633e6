//! `throng export`: one level of detail as a standard glTF file.

use std::path::PathBuf;

use anyhow::{Result, anyhow, bail};
use throng_bake::{export, glb};

use super::cache;
use super::output::{Progress, check_output, grouped, say, write_file};
use super::source;

/// Write one level of detail as a skinned, animated glTF file
#[derive(clap::Args)]
#[command(
    long_about = "Writes one level of detail of a character as a standard glTF file (.glb) with its skeleton and \
                  animations, to check it or to use it elsewhere. A source file or builtin:NAME is baked first.",
    after_help = "Examples:\n  \
                  throng export fox.throng --fraction 0.2 -o fox_20.glb\n  \
                  throng export fox.glb --triangles 300 -o fox_300.glb\n  \
                  throng export fox.throng --error 0.01 -o fox_1cm.glb"
)]
pub struct Arguments {
    /// A baked file, a source file, or builtin:NAME
    file: String,
    #[command(flatten)]
    level: LevelArguments,
    /// The .glb file to write
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// The axis that points up in a source file: OBJ files do not say it
    #[arg(long, value_name = "AXIS", default_value = "y")]
    up: source::Up,
    #[command(flatten)]
    cache: cache::Options,
}

#[derive(clap::Args)]
#[group(required = true, multiple = false)]
struct LevelArguments {
    /// The finest level with at most this share of the triangles, from 0 to 1
    #[arg(long, value_name = "F")]
    fraction: Option<f64>,
    /// The finest level with at most this many triangles
    #[arg(long, value_name = "N")]
    triangles: Option<usize>,
    /// The level whose surface is at most this far off, in metres (in the file's own unit where that is another)
    #[arg(long, value_name = "METRES")]
    error: Option<f32>,
}

impl LevelArguments {
    fn to_level(&self) -> Result<export::Level> {
        match (self.fraction, self.triangles, self.error) {
            (Some(f), _, _) if !(0.0..=1.0).contains(&f) => {
                bail!("--fraction {f}: it is not from 0 to 1")
            }
            (Some(f), _, _) => Ok(export::Level::Fraction(f)),
            (_, Some(n), _) => Ok(export::Level::Triangles(n)),
            (_, _, Some(e)) if !(e >= 0.0 && e.is_finite()) => {
                bail!("--error {e}: it is not a distance")
            }
            (_, _, Some(e)) => Ok(export::Level::Error(e)),
            // The argument group asks for one of them.
            (None, None, None) => bail!("no level was named"),
        }
    }
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    let level = arguments.level.to_level()?;
    check_output(&arguments.output, "glb", [arguments.file.as_str()])?;
    let progress = Progress::default();
    let recipe = source::Recipe {
        cache: arguments.cache.open(),
        up: arguments.up,
        ..source::Recipe::default()
    };
    let baked = source::baked(&arguments.file, &recipe, &progress)?;
    let exported = export::export(&baked, level);
    if exported.triangle_count == 0 {
        bail!(
            "{}: no triangles are left of it at that level",
            arguments.file
        );
    }
    let bytes = glb::write_glb(&exported.character)
        .map_err(|e| anyhow!("{}: cannot be written as glTF: {e}", arguments.file))?;
    write_file(&arguments.output, &bytes)?;
    say(format_args!(
        "{}: {} triangles, error {:.5} m\n",
        arguments.output.display(),
        grouped(exported.triangle_count as u64),
        // The full mesh's is below every collapse error.
        exported.error.max(0.0)
    ))?;
    Ok(())
}
