//! `throng bake`: character files become baked files.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Result, bail};
use serde::Serialize;
use throng::scene::stem;
use throng_bake::bake::BakeOptions;
use throng_bake::file;

use super::impostors;
use super::inspect::Contents;
use super::output::{Progress, check_output, create_folder, grouped, say, write_json};
use super::source;

/// Bake character files: levels of detail, animation, one .throng file each
#[derive(clap::Args)]
#[command(
    long_about = "Bakes character files (.glb, .gltf, .obj; or builtin:NAME): one continuous level of detail over the \
                  whole character that holds in all of its animations, the sampled animations and their bounds, and \
                  impostors, the pictures that far agents are drawn as. INPUT.tints.toml beside an input says which of its \
                  materials are fixed, natural, cloth, skin or hair, where their names do not. The same input and options, and the same \
                  driver for the pictures, give the same bytes.",
    after_help = "Examples:\n  \
                  throng bake fox.glb -o fox.throng\n  \
                  throng bake people/*.glb -o baked/               several: into a folder\n  \
                  throng bake builtin:worker -o worker.throng --report worker.json\n  \
                  throng bake fox.glb -o fox.throng --impostors flat --head-boost 2\n  \
                  throng bake scan.obj --up z -o scan.throng       z is up in it, as scanners and CAD programs have it"
)]
pub struct Arguments {
    /// Character files, or builtin:NAME
    #[arg(required = true)]
    input: Vec<String>,
    /// The file to write; a folder for several inputs
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Also write what was baked, and how long each stage took, as JSON
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// A part of the name of the device that takes impostors' pictures, or its index; the best GPU where left out, a CPU
    /// driver where there is none
    #[arg(long, value_name = "DEVICE")]
    device: Option<String>,
    /// The axis that points up in the inputs: OBJ files do not say it
    #[arg(long, value_name = "AXIS", default_value = "y")]
    up: source::Up,
    #[command(flatten)]
    options: Options,
    #[command(flatten)]
    impostors: impostors::Options,
}

/// What a bake may be told.
#[derive(clap::Args)]
pub struct Options {
    /// Animation frames sampled per second
    #[arg(long, value_name = "HZ", default_value_t = BakeOptions::default().frame_rate_hz)]
    frame_rate: f32,
    /// Largest side of a texture
    #[arg(long, value_name = "PIXELS", default_value_t = BakeOptions::default().texture_size)]
    texture_size: u32,
    /// One index window for all levels, as the paper has it, in place of bands: smaller, and slower to draw
    #[arg(long)]
    single_window: bool,
}

impl Options {
    /// Checked, as the library takes them.
    pub fn to_bake_options(&self) -> Result<BakeOptions> {
        if !(1.0..=1000.0).contains(&self.frame_rate) {
            bail!("--frame-rate {}: it is not from 1 to 1000", self.frame_rate);
        }
        if !(1..=8192).contains(&self.texture_size) {
            bail!(
                "--texture-size {}: it is not from 1 to 8192",
                self.texture_size
            );
        }
        Ok(BakeOptions {
            frame_rate_hz: self.frame_rate,
            texture_size: self.texture_size,
            single_window: self.single_window,
            ..BakeOptions::default()
        })
    }
}

#[derive(Serialize)]
struct Report {
    input: String,
    output: String,
    bake_ms: f64,
    stage_ms: Vec<Stage>,
    /// What the memory limit has made coarser than wanted.
    impostor_limits: Vec<String>,
    #[serde(flatten)]
    contents: Contents,
}

#[derive(Serialize)]
struct Stage {
    stage: &'static str,
    ms: f64,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<()> {
    let options = arguments.options.to_bake_options()?;
    let plan = arguments.impostors.to_plan(arguments.device.as_deref())?;
    let outputs = outputs(&arguments.input, &arguments.output)?;
    let inputs = arguments.input.iter().map(String::as_str);
    for output in &outputs {
        check_output(output, "throng", inputs.clone())?;
    }
    if let Some(path) = &arguments.report {
        check_output(path, "json", inputs.clone())?;
    }
    for input in inputs {
        source::check_exists(input)?;
    }
    let progress = Progress::default();
    let mut reports = Vec::new();
    for (input, output) in arguments.input.iter().zip(&outputs) {
        let start = Instant::now();
        let character = source::character(input, arguments.up.into(), &progress)?;
        let tints = source::tints(input)?;
        let (mut baked, mut times) =
            source::bake_character(input, &character, &tints, &options, &progress)?;
        let mut impostor_limits = Vec::new();
        if let Some(plan) = &plan {
            let added = plan.add_to(&mut baked, input, &progress)?;
            times.stage_ms.push(("capture", added.capture_ms));
            times.stage_ms.push(("calibrate", added.calibrate_ms));
            impostor_limits = added.limits;
        }
        create_folder(output.parent())?;
        file::write(output, &baked)?;
        let bake_ms = start.elapsed().as_secs_f64() * 1e3;
        let contents = Contents::of(&baked);
        say(format_args!(
            "{}: {} triangles, {} vertices, {} bands, {:.1} bytes per vertex, {:.2} s\n",
            output.display(),
            grouped(contents.triangle_count),
            grouped(contents.vertex_count),
            baked.bands.len(),
            contents.bytes_per_vertex.total,
            bake_ms / 1e3
        ))?;
        let stage_ms = times.stage_ms.iter();
        reports.push(Report {
            input: input.clone(),
            output: output.display().to_string(),
            bake_ms,
            stage_ms: stage_ms.map(|&(stage, ms)| Stage { stage, ms }).collect(),
            impostor_limits,
            contents,
        });
    }
    match &arguments.report {
        Some(path) => write_json(path, &reports),
        None => Ok(()),
    }
}

/// The file of each input: `output` itself for one, files in the folder `output` for several.
fn outputs(inputs: &[String], output: &Path) -> Result<Vec<PathBuf>> {
    let is_folder = output.is_dir() || output.as_os_str().to_string_lossy().ends_with('/');
    if let ([_], false) = (inputs, is_folder) {
        return Ok(vec![output.to_path_buf()]);
    }
    if output.is_file() {
        bail!(
            "{}: it is a file, and several inputs need a folder",
            output.display()
        );
    }
    let mut files: Vec<PathBuf> = Vec::new();
    for input in inputs {
        let file = output.join(format!("{}.throng", stem(input)));
        if files.contains(&file) {
            bail!(
                "{input}: another input would be written to {}, too",
                file.display()
            );
        }
        files.push(file);
    }
    Ok(files)
}
