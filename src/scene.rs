//! Scenes: which characters stand where, what they do, and who looks at them; read from TOML.
//!
//! [`Scene::load`] or [`Scene::builtin`] -> [`Scene::populate`] with the baked characters -> [`Crowd::agents_at`] a time.
//! Pure: it draws nothing, and the same scene, characters and time always give the same agents.
//!
//! Metres, seconds, +Y up; a heading of 0 faces +Z and grows towards +X. The ground is y = 0. Colours are linear RGB.

use std::path::{Path, PathBuf};

use glam::{Vec2, Vec3};
use serde::Deserialize;
use throng_bake::character::UpAxis;

use crate::frame::Light;

mod check;
mod clips;
mod crowd;
mod motion;

pub use clips::{find_clip, standing_clip};
use crowd::ring_starts;
pub use crowd::{Crowd, ground_of, standing_height};

/// The most agents that one scene may ask for.
pub const AGENT_LIMIT: usize = 10_000_000;

/// Scenes inside the program: name and TOML.
const BUILTIN: [(&str, &str); 9] = [
    ("street", include_str!("../assets/scenes/street.toml")),
    ("plaza", include_str!("../assets/scenes/plaza.toml")),
    ("plaza_air", include_str!("../assets/scenes/plaza_air.toml")),
    ("stampede", include_str!("../assets/scenes/stampede.toml")),
    ("file", include_str!("../assets/scenes/file.toml")),
    ("scale", include_str!("../assets/scenes/scale.toml")),
    ("foxes", include_str!("../assets/scenes/foxes.toml")),
    (
        "pedestrians",
        include_str!("../assets/scenes/pedestrians.toml"),
    ),
    ("lineup", include_str!("../assets/scenes/lineup.toml")),
];

/// Why a scene could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// The file could not be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// It is not TOML, or a key is unknown, missing or of the wrong type.
    #[error("{}: line {line}: {reason}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Counted from 1.
        line: usize,
        /// What the parser says.
        reason: String,
    },
    /// A value makes no sense.
    #[error("{}: {place}: {reason}", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// The table and key.
        place: String,
        /// What is wrong with it.
        reason: String,
    },
    /// There is no built-in scene of that name.
    #[error("{name}: there is no such built-in scene; there are {}", builtin_names().join(", "))]
    Unknown {
        /// What was asked for.
        name: String,
    },
}

/// A scene as its file states it, checked.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Everything random in the scene follows from it.
    #[serde(default)]
    pub seed: u64,
    /// Frame F shows the time F / this.
    #[serde(default = "default_frames_per_second")]
    pub frames_per_second: f32,
    /// Scales characters that take the place of the scene's own ([`Scene::set_characters`]): a scene that is laid out for
    /// models in other units says so here.
    #[serde(default = "one")]
    pub stand_in_scale: f32,
    /// Who may appear.
    #[serde(rename = "character", default)]
    pub characters: Vec<SceneCharacter>,
    /// Groups of agents.
    #[serde(rename = "crowd")]
    pub crowds: Vec<SceneCrowd>,
    /// Views; the first is the default. Without any the program frames the crowd.
    #[serde(rename = "camera", default)]
    pub cameras: Vec<SceneCamera>,
    /// Sun and sky.
    #[serde(default)]
    pub light: SceneLight,
    /// The ground plane y = 0 is drawn.
    #[serde(default = "yes")]
    pub ground: bool,
    /// Linear colour of the ground, each channel from 0 to 1; paved where absent.
    pub ground_color: Option<Vec3>,
    /// The sky is drawn.
    #[serde(default = "yes")]
    pub sky: bool,
}

/// A character of the scene.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneCharacter {
    /// How crowds refer to it; the source's name without folder and extension where empty.
    #[serde(default)]
    pub name: String,
    /// `builtin:NAME`, or a file (baked or source) relative to the scene's folder.
    pub source: String,
    /// The axis that points up in a source file, `y` or `z`: OBJ files do not say it.
    #[serde(default)]
    pub up: UpAxis,
    /// How many agents get it, relative to the others.
    #[serde(default = "one")]
    pub share: f32,
    /// Scales the character to this standing height.
    pub height: Option<f32>,
    /// Scales the character, after `height`.
    #[serde(default = "one")]
    pub scale: f32,
    /// Lifts the character so that what it stands on in its idle clip (in its first clip where it has no idle) is on the
    /// ground, where that is more than 3 % of its height above or 15 % below: for characters whose origin is not between their
    /// feet.
    #[serde(default)]
    pub stand: bool,
}

/// A group of agents that are placed and move alike.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneCrowd {
    /// Agents in `area`; left out where `positions` says it.
    pub count: Option<u32>,
    /// Where agents start, evenly spread.
    pub area: Option<Area>,
    /// One agent at each, in place of `count` and `area`; characters take turns.
    #[serde(default)]
    pub positions: Vec<Vec3>,
    /// Names of the characters it consists of; all where empty.
    #[serde(default)]
    pub characters: Vec<String>,
    /// What agents do; each draws one entry by share. A clip without speed stays on its spot. The character's idle clip
    /// where empty, or where it has none by that name; its first where it has no idle one.
    #[serde(default)]
    pub clips: Vec<SceneClip>,
    /// How agents move.
    #[serde(default)]
    pub motion: Motion,
    /// Where agents face, and walk to where they walk straight; random where absent.
    pub heading_deg: Option<f32>,
    /// Agents face this point (x, z) where they start, in place of `heading_deg`.
    pub look_at: Option<Vec2>,
    /// Agents' sizes differ by up to this fraction, up and down.
    #[serde(default)]
    pub size_spread: f32,
}

/// Where a crowd's agents start. Points are (x, z) on the ground.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Area {
    /// Evenly spread, with some disorder, over a rectangle along the axes.
    Rectangle {
        /// Its middle.
        #[serde(default)]
        center: Vec2,
        /// Extents along x and z.
        size: Vec2,
    },
    /// Evenly spread, with some disorder, between two circles.
    Ring {
        /// Of both circles.
        #[serde(default)]
        center: Vec2,
        /// 0 for a disc.
        radius_min: f32,
        /// Greater than `radius_min`.
        radius_max: f32,
    },
    /// Rows along x, one behind the other along z; characters take turns.
    Grid {
        /// The grid's middle.
        #[serde(default)]
        center: Vec2,
        /// Between neighbours along x and z.
        spacing: Vec2,
        /// Agents in a row.
        columns: u32,
    },
    /// From near to far over a sector of a circle, at a density: more agents reach farther out.
    Fan {
        /// The sector's corner.
        #[serde(default)]
        center: Vec2,
        /// Direction of its middle, as agents' headings.
        #[serde(default)]
        heading_deg: f32,
        /// Angle between its sides, less than 180.
        angle_deg: f32,
        /// Nearer to the corner there is nobody.
        radius_min: f32,
        /// Agents per square metre.
        density: f32,
    },
    /// Circles around a point, filled from the inside; characters take turns. Those who `wander` follow their circle, every
    /// other circle the other way round.
    Rings {
        /// Of all circles.
        #[serde(default)]
        center: Vec2,
        /// Between circles, and the radius of the first.
        ring_spacing: f32,
        /// Least distance along a circle from one agent to the next.
        spacing: f32,
    },
}

/// How the agents of a crowd move. Always a closed formula of time, at constant speed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Motion {
    /// On the spot.
    #[default]
    Still,
    /// Along their heading; whoever leaves the area comes back at its other side.
    Straight,
    /// Each along a closed path of its own, straights joined by curves, inside the area; in a ring around its centre.
    Wander,
}

/// A clip that a crowd plays.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneClip {
    /// Name; see [`find_clip`] for how it is looked up.
    pub name: String,
    /// How many agents play it, relative to the crowd's other clips.
    #[serde(default = "one")]
    pub share: f32,
    /// Metres per second that agents walk at; a clip that states its ground speed plays faster or slower to fit. Where
    /// absent they walk at the clip's ground speed.
    pub speed: Option<f32>,
    /// All agents stand at this time of the clip and stay there; where absent each starts somewhere and time passes.
    pub time: Option<f32>,
}

/// A view.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneCamera {
    /// What `--camera` calls it.
    #[serde(default)]
    pub name: String,
    /// Eye.
    #[serde(default)]
    pub position: Vec3,
    /// A point in the middle of the picture.
    #[serde(default)]
    pub target: Vec3,
    /// `position` and `target` are multiples of the radius of the first ring outside of all agents in `rings`.
    #[serde(default)]
    pub by_rings: bool,
    /// Angle between the picture's lower and upper edge.
    #[serde(default = "default_fov_y_deg")]
    pub fov_y_deg: f32,
    /// A flight in place of `position` and `target`: at least two keys by rising time.
    #[serde(default)]
    pub path: Vec<CameraKey>,
}

/// Where a flight is at some time.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraKey {
    /// Seconds.
    pub time: f32,
    /// Eye.
    pub position: Vec3,
    /// A point in the middle of the picture.
    pub target: Vec3,
}

/// A sun, and light from all around that goes from one colour above to one below. Colours are linear RGB.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SceneLight {
    /// Where the sun stands: 0 along +Z, 90 along +X.
    pub sun_azimuth_deg: f32,
    /// 0 at the horizon, 90 overhead.
    pub sun_elevation_deg: f32,
    /// Sunlight.
    pub sun_color: Vec3,
    /// Light from straight above.
    pub sky_color: Vec3,
    /// Light that the ground throws back.
    pub ground_color: Vec3,
}

impl Default for SceneLight {
    fn default() -> Self {
        let light = Light::default();
        Self {
            sun_azimuth_deg: light.to_sun.x.atan2(light.to_sun.z).to_degrees(),
            sun_elevation_deg: light.to_sun.normalize().y.asin().to_degrees(),
            sun_color: light.sun,
            sky_color: light.sky,
            ground_color: light.ground,
        }
    }
}

impl SceneLight {
    /// As the renderer takes it.
    pub fn to_light(&self) -> Light {
        let (azimuth, elevation) = (
            self.sun_azimuth_deg.to_radians(),
            self.sun_elevation_deg.to_radians(),
        );
        Light {
            to_sun: Vec3::new(
                elevation.cos() * azimuth.sin(),
                elevation.sin(),
                elevation.cos() * azimuth.cos(),
            ),
            sun: self.sun_color,
            sky: self.sky_color,
            ground: self.ground_color,
        }
    }
}

fn yes() -> bool {
    true
}

fn one() -> f32 {
    1.0
}

fn default_frames_per_second() -> f32 {
    30.0
}

fn default_fov_y_deg() -> f32 {
    45.0
}

/// Names that [`Scene::builtin`] takes.
pub fn builtin_names() -> Vec<&'static str> {
    BUILTIN.iter().map(|&(name, _)| name).collect()
}

impl Scene {
    /// Reads and checks a scene file.
    ///
    /// Errors: [`SceneError`], with the file, the line or table, and the reason.
    pub fn load(path: &Path) -> Result<Self, SceneError> {
        let text = std::fs::read_to_string(path).map_err(|source| SceneError::Io {
            path: path.to_path_buf(),
            source,
        })?;
        Self::parse(&text, path)
    }

    /// A scene inside the program, see [`builtin_names`].
    ///
    /// Errors: [`SceneError::Unknown`].
    pub fn builtin(name: &str) -> Result<Self, SceneError> {
        match BUILTIN.iter().find(|&&(n, _)| n == name) {
            Some(&(name, text)) => Self::parse(text, Path::new(name)),
            None => Err(SceneError::Unknown { name: name.into() }),
        }
    }

    /// Reads and checks a scene; `path` is for messages, and its folder is what file names are relative to.
    ///
    /// Errors: [`SceneError::Syntax`], [`SceneError::Invalid`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, SceneError> {
        let mut scene: Self = toml::from_str(text).map_err(|e| {
            let start = e.span().map_or(0, |s| s.start).min(text.len());
            SceneError::Syntax {
                path: path.to_path_buf(),
                line: text.as_bytes()[..start]
                    .iter()
                    .filter(|&&b| b == b'\n')
                    .count()
                    + 1,
                reason: e.message().trim().replace('\n', " "),
            }
        })?;
        scene.resolve(path.parent().unwrap_or(Path::new("")));
        scene
            .check()
            .map_err(|(place, reason)| SceneError::Invalid {
                path: path.to_path_buf(),
                place,
                reason,
            })?;
        Ok(scene)
    }

    /// Agents of all crowds.
    pub fn agent_count(&self) -> usize {
        self.crowds
            .iter()
            .map(|c| c.positions.len() + c.count.unwrap_or(0) as usize)
            .sum()
    }

    /// Changes the crowds' counts in proportion so that the scene has `count` agents; crowds of explicit positions keep
    /// theirs, and the largest of the others takes what rounding leaves.
    ///
    /// Nothing happens in a scene where every position is explicit.
    pub fn set_agent_count(&mut self, count: usize) {
        let count = count.min(AGENT_LIMIT);
        let fixed: usize = self.crowds.iter().map(|c| c.positions.len()).sum();
        let before = self.agent_count() - fixed;
        let wanted = count.saturating_sub(fixed);
        let mut left = wanted;
        for crowd in &mut self.crowds {
            if let Some(n) = &mut crowd.count {
                *n = (u64::from(*n) * wanted as u64 / before.max(1) as u64) as u32;
                left = left.saturating_sub(*n as usize);
            }
        }
        let largest = self.crowds.iter_mut().filter_map(|c| c.count.as_mut());
        if let Some(n) = largest.max_by_key(|n| **n) {
            *n += left as u32;
        }
    }

    /// Eye and target of a camera at a time; `None` where there is no such camera.
    pub fn camera_at(&self, camera: usize, time: f32) -> Option<(Vec3, Vec3)> {
        let camera = self.cameras.get(camera)?;
        let (position, target) = camera.at(time);
        let unit = if camera.by_rings {
            self.outer_radius()
        } else {
            1.0
        };
        Some((position * unit, target * unit))
    }

    /// Radius of the first ring outside of all agents, metres.
    fn outer_radius(&self) -> f32 {
        let outer = |crowd: &SceneCrowd| match crowd.area {
            Some(Area::Rings {
                ring_spacing,
                spacing,
                ..
            }) => {
                let rings = ring_starts(crowd.count? as usize, ring_spacing, spacing).len();
                Some((rings + 1) as f32 * ring_spacing)
            }
            _ => None,
        };
        self.crowds.iter().filter_map(outer).fold(1.0, f32::max)
    }

    /// Replaces the characters by others of equal share that every crowd consists of.
    pub fn set_characters(&mut self, sources: &[String]) {
        self.characters = sources
            .iter()
            .map(|source| SceneCharacter {
                name: stem(source),
                source: source.clone(),
                up: UpAxis::Y,
                share: 1.0,
                height: None,
                scale: self.stand_in_scale,
                stand: true,
            })
            .collect();
        for crowd in &mut self.crowds {
            crowd.characters.clear();
        }
    }

    /// Fills in names, and makes file names relative to `folder`.
    fn resolve(&mut self, folder: &Path) {
        for character in &mut self.characters {
            if character.name.is_empty() {
                character.name = stem(&character.source);
            }
            if !character.source.starts_with("builtin:") {
                character.source = folder
                    .join(&character.source)
                    .to_string_lossy()
                    .into_owned();
            }
        }
    }
}

impl SceneCamera {
    /// Eye and target at a time; a flight eases from key to key (Catmull-Rom) and rests at its ends.
    pub fn at(&self, time: f32) -> (Vec3, Vec3) {
        let keys = &self.path;
        let (Some(first), Some(last)) = (keys.first(), keys.last()) else {
            return (self.position, self.target);
        };
        if time <= first.time {
            return (first.position, first.target);
        }
        if time >= last.time {
            return (last.position, last.target);
        }
        let b = keys
            .partition_point(|k| k.time <= time)
            .clamp(1, keys.len() - 1);
        let (k1, k2) = (&keys[b - 1], &keys[b]);
        let (k0, k3) = (
            &keys[b.saturating_sub(2)],
            &keys[(b + 1).min(keys.len() - 1)],
        );
        let u = (time - k1.time) / (k2.time - k1.time);
        let spline = |p0: Vec3, p1: Vec3, p2: Vec3, p3: Vec3| {
            let (a, b) = (p2 - p0, 2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3);
            let c = 3.0 * (p1 - p2) + p3 - p0;
            p1 + 0.5 * u * (a + u * (b + u * c))
        };
        (
            spline(k0.position, k1.position, k2.position, k3.position),
            spline(k0.target, k1.target, k2.target, k3.target),
        )
    }
}

/// A character's name from its source: without `builtin:`, folder and extension.
pub fn stem(source: &str) -> String {
    match source.strip_prefix("builtin:") {
        Some(name) => name.to_string(),
        None => Path::new(source)
            .file_stem()
            .map_or_else(String::new, |s| s.to_string_lossy().into_owned()),
    }
}

#[cfg(test)]
mod tests;
