//! Impostors of a freshly baked character: what the command line may say about them, the capture, and their error curves.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Result, anyhow, bail};
use throng::RenderError;
use throng::calibrate::error_curves;
use throng::gpu::{Headless, HeadlessDesc};
use throng_bake::baked::Baked;
use throng_bake::impostor::Kind;
use throng_bake::impostor::build::{ImpostorOptions, build};
use throng_bake::impostor::groups::Groups;

use super::output::Progress;
use super::shot::Switch;

/// A kind as the command line names it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum KindName {
    /// None: far agents are drawn as meshes
    None,
    /// A quad for every group of joints: any clip plays on the same pictures
    Flat,
    /// One quad for the whole body, captured in poses of the clips
    Quad,
}

/// What a bake may be told of impostors.
#[derive(clap::Args)]
#[command(next_help_heading = "Impostors, the pictures that far agents are drawn as")]
pub struct Options {
    /// Kinds to capture; needs Vulkan, and is left out where there is none
    #[arg(
        long,
        value_name = "KIND,...",
        value_delimiter = ',',
        default_value = "flat,quad"
    )]
    impostors: Vec<KindName>,
    /// Texels along the character's height for flat impostors
    #[arg(long, value_name = "N", default_value_t = ImpostorOptions::default().texels_per_height)]
    flat_texels: f32,
    /// Texels along the character's height for quad impostors, at most
    #[arg(long, value_name = "N", default_value_t = ImpostorOptions::default().quad_texels_per_height)]
    quad_texels: f32,
    /// Heads of flat impostors get finer texels by this factor
    #[arg(long, value_name = "X", default_value_t = ImpostorOptions::default().head_boost)]
    head_boost: f32,
    /// Flat impostors are seen from the 10 N^2 + 2 corners of an icosahedron with every edge in N parts
    #[arg(long, value_name = "N", default_value_t = ImpostorOptions::default().body_view_cuts, value_parser = clap::value_parser!(u32).range(1..=8))]
    flat_views: u32,
    /// The same for their heads
    #[arg(long, value_name = "N", default_value_t = ImpostorOptions::default().head_view_cuts, value_parser = clap::value_parser!(u32).range(1..=8))]
    head_views: u32,
    /// The same for quad impostors
    #[arg(long, value_name = "N", default_value_t = ImpostorOptions::default().quad_view_cuts, value_parser = clap::value_parser!(u32).range(1..=8))]
    quad_views: u32,
    /// Poses of a clip for quad impostors, at most
    #[arg(long, value_name = "N", default_value_t = ImpostorOptions::default().quad_poses_per_clip, value_parser = clap::value_parser!(u32).range(1..=256))]
    quad_poses: u32,
    /// Bytes that all pictures of a character may take before they are compressed; texels grow coarser until they fit
    #[arg(long, value_name = "BYTES", default_value_t = ImpostorOptions::default().memory_limit_bytes)]
    impostor_memory: u64,
    /// Keep the pictures in BC7 blocks, at a quarter of the bytes
    #[arg(long, value_name = "SWITCH", default_value = "off")]
    compress: Switch,
    /// Groups of joints, a TOML table of lists of joint names; INPUT.groups.toml beside the input where there is one
    #[arg(long, value_name = "FILE")]
    groups: Option<PathBuf>,
}

impl Options {
    /// As the library takes them; `None` where nothing is to be captured.
    pub fn to_plan(&self, device: Option<&str>) -> Result<Option<Plan>> {
        let has = |kind| self.impostors.contains(&kind);
        if has(KindName::None) {
            if self.impostors.len() > 1 {
                bail!("--impostors: none stands alone");
            }
            return Ok(None);
        }
        let kinds = [(KindName::Flat, Kind::Flat), (KindName::Quad, Kind::Quad)];
        let options = ImpostorOptions {
            kinds: (kinds.iter())
                .filter(|(name, _)| has(*name))
                .map(|(_, kind)| *kind)
                .collect(),
            texels_per_height: self.flat_texels,
            quad_texels_per_height: self.quad_texels,
            head_boost: self.head_boost,
            body_view_cuts: self.flat_views,
            head_view_cuts: self.head_views,
            quad_view_cuts: self.quad_views,
            quad_poses_per_clip: self.quad_poses,
            memory_limit_bytes: self.impostor_memory,
            compress: self.compress == Switch::On,
            ..ImpostorOptions::default()
        };
        Ok(Some(Plan {
            options,
            groups: self.groups.clone(),
            device: device.map(str::to_string),
        }))
    }
}

/// What to capture, and where.
#[derive(Debug, Clone, Default)]
pub struct Plan {
    options: ImpostorOptions,
    groups: Option<PathBuf>,
    device: Option<String>,
}

/// What became of a plan.
#[derive(Debug, Clone, Default)]
pub struct Added {
    /// Milliseconds of the capture.
    pub capture_ms: f64,
    /// Milliseconds of measuring error curves.
    pub calibrate_ms: f64,
    /// What the memory limit has made coarser, one sentence each.
    pub limits: Vec<String>,
}

impl Plan {
    /// The defaults on a device.
    pub fn on(device: Option<&str>) -> Self {
        Self {
            device: device.map(str::to_string),
            ..Self::default()
        }
    }

    /// Captures a character's impostors and measures their error curves. Where there is no Vulkan the character stays as it
    /// is, and a warning says so. Errors and warnings name `source`. That the memory limit sets the texels is no warning
    /// unless somebody asked for something else than the defaults, which want the most that fits.
    pub fn add_to(&self, baked: &mut Baked, source: &str, progress: &Progress) -> Result<Added> {
        let error = |e: &dyn std::fmt::Display| anyhow!("{source}: {e}");
        let groups = self.groups_of(baked, source, progress)?;
        let desc = HeadlessDesc {
            device: self.device.clone(),
            size_px: [16, 16],
            ..HeadlessDesc::default()
        };
        let mut headless = match Headless::new(&desc) {
            Ok(headless) => headless,
            Err(e @ (RenderError::NoVulkan { .. } | RenderError::MissingFeature { .. })) => {
                progress.warn(&format!("{source}: left out its impostors: {e}"));
                return Ok(Added::default());
            }
            Err(e) => return Err(error(&e)),
        };
        /// Steps of a progress bar.
        const STEPS: f32 = 100.0;
        let bar = progress.bar(&format!("Capturing {}", baked.name), STEPS as u64);
        let start = Instant::now();
        let built = {
            let mut capturer = headless.capturer(baked).map_err(|e| error(&e))?;
            build(
                baked,
                &groups,
                &self.options,
                &mut |batch| capturer.capture(batch),
                &mut |share| bar.set_position((share * STEPS) as u64),
            )
        };
        let built = built.map_err(|e| error(&e))?;
        bar.finish_and_clear();
        let defaults = ImpostorOptions {
            kinds: self.options.kinds.clone(),
            compress: self.options.compress,
            ..ImpostorOptions::default()
        };
        if self.options != defaults {
            for warning in &built.warnings {
                progress.warn(&format!("{source}: {warning}"));
            }
        }
        baked.impostors = Some(built.impostors);
        let capture_ms = start.elapsed().as_secs_f64() * 1e3;

        let bar = progress.bar(&format!("Calibrating {}", baked.name), STEPS as u64);
        let start = Instant::now();
        let curves = error_curves(&mut headless, baked, &mut |share| {
            bar.set_position((share * STEPS) as u64)
        });
        let curves = curves.map_err(|e| error(&e))?;
        bar.finish_and_clear();
        if let Some(impostors) = &mut baked.impostors {
            for (kind, curve) in impostors.kinds.iter_mut().zip(curves) {
                kind.errors = curve;
            }
        }
        Ok(Added {
            capture_ms,
            calibrate_ms: start.elapsed().as_secs_f64() * 1e3,
            limits: built.warnings,
        })
    }

    /// What the pictures of a source follow from, besides the character itself: the options, the device that was asked for,
    /// and the text of the file of groups.
    pub fn identity(&self, source: &str) -> Result<String> {
        let groups = match self.groups_file(source) {
            Some(path) => Some(
                std::fs::read_to_string(&path).map_err(|e| anyhow!("{}: {e}", path.display()))?,
            ),
            None => None,
        };
        let (options, device) = (&self.options, &self.device);
        Ok(format!("{options:?} {device:?} {groups:?}"))
    }

    /// The file of groups that the command line says, or the one beside the source.
    fn groups_file(&self, source: &str) -> Option<PathBuf> {
        let sidecar = Path::new(source).with_extension("groups.toml");
        self.groups
            .clone()
            .or_else(|| sidecar.is_file().then_some(sidecar))
    }

    /// The groups that the command line or a file beside the source says, else those by rule.
    fn groups_of(&self, baked: &Baked, source: &str, progress: &Progress) -> Result<Groups> {
        match self.groups_file(source) {
            Some(path) => {
                if self.groups.is_none() {
                    progress.note(&format!(
                        "{source}: groups of joints from {}",
                        path.display()
                    ));
                }
                Ok(Groups::from_sidecar(&path, baked)?)
            }
            None => Ok(Groups::by_rule(baked)),
        }
    }
}
