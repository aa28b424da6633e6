//! What is in front of the camera: a scene with its baked characters, and the view.

use std::path::Path;

use anyhow::{Result, bail};
use glam::{Mat3, Quat, Vec3};
use throng::scene::{
    AGENT_LIMIT, Crowd, Scene, SceneClip, SceneCrowd, SceneLight, find_clip, standing_clip,
};
use throng::{Agent, FrameOptions, View};
use throng_bake::baked::Baked;

use super::output::Progress;
use super::source::{self, Recipe};

/// A scene, ready to be drawn at any time.
pub struct Shot {
    pub scene: Scene,
    pub characters: Vec<Baked>,
    crowd: Crowd,
    /// Index into the scene's cameras; without one the view takes everybody in.
    camera: Option<usize>,
    side: ViewFrom,
    /// All agents are at the shot's time in their clips: one character to look at, not a crowd.
    is_portrait: bool,
    occlusion: bool,
}

/// Where the camera stands when it has to find its place itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum ViewFrom {
    /// In front of somebody who faces the scene's +Z
    Front,
    /// At the left hand
    Side,
    /// Behind
    Back,
    /// In front, to the left, a little above
    ThreeQuarter,
    /// Above
    Top,
}

impl ViewFrom {
    /// Direction from what is looked at to the camera.
    fn to_camera(self) -> Vec3 {
        match self {
            Self::Front => Vec3::new(0.0, 0.08, 1.0),
            Self::Side => Vec3::new(1.0, 0.08, 0.0),
            Self::Back => Vec3::new(0.0, 0.08, -1.0),
            Self::ThreeQuarter => Vec3::new(0.62, 0.3, 1.0),
            Self::Top => Vec3::Y,
        }
        .normalize()
    }
}

/// What the command line says about a shot.
#[derive(Default)]
pub struct Request<'a> {
    /// A file or the name of a built-in scene.
    pub scene: Option<&'a str>,
    /// In place of the scene's characters.
    pub characters: &'a [String],
    pub agents: Option<usize>,
    pub seed: Option<u64>,
    /// In place of the scene's clips.
    pub clip: Option<&'a str>,
    /// Name of one of the scene's cameras.
    pub camera: Option<&'a str>,
    /// In place of a camera.
    pub side: Option<ViewFrom>,
    /// Left out, it is on.
    pub occlusion: Option<Switch>,
}

/// An option that is on or off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Switch {
    On,
    Off,
}

impl Shot {
    /// Reads the scene, bakes what is not baked, and places everybody.
    pub fn new(request: &Request, recipe: &Recipe, progress: &Progress) -> Result<Self> {
        let is_portrait = request.scene.is_none()
            && !request.characters.is_empty()
            && request.agents.is_none_or(|n| n == 1);
        if let Some(count) = request.agents.filter(|&n| n > AGENT_LIMIT) {
            bail!("--agents {count}: the most is {AGENT_LIMIT}");
        }
        let mut scene = match request.scene {
            _ if is_portrait => portrait(),
            Some(name) => load_scene(name)?,
            None => Scene::builtin("plaza")?,
        };
        if !request.characters.is_empty() {
            scene.set_characters(request.characters);
            for entry in &mut scene.characters {
                entry.up = recipe.up.into();
            }
        }
        if let Some(name) = request.clip {
            for crowd in &mut scene.crowds {
                crowd.clips = vec![SceneClip {
                    name: name.into(),
                    share: 1.0,
                    speed: None,
                    time: None,
                }];
            }
        }
        if let Some(count) = request.agents.filter(|_| !is_portrait) {
            scene.set_agent_count(count);
            let number = scene.agent_count();
            if number != count {
                progress.warn(&format!(
                    "--agents {count}: the scene has {number} with places of their own"
                ));
            }
        }
        scene.seed = request.seed.unwrap_or(scene.seed);
        let camera = match request.camera {
            _ if request.side.is_some() => None,
            Some(name) => Some(find_camera(&scene, name)?),
            None => (!scene.cameras.is_empty()).then_some(0),
        };
        let entries = scene.characters.iter();
        let sources: Vec<_> = entries.map(|c| (c.source.clone(), c.up)).collect();
        if sources.is_empty() && scene.agent_count() > 0 {
            bail!("the scene has no [[character]]: name some with --character");
        }
        let characters = source::baked_all(&sources, recipe, progress)?;
        if let Some(name) = request.clip {
            check_clip(name, &characters)?;
        }
        if !request.characters.is_empty() && scene.stand_in_scale == 1.0 {
            for (entry, baked) in scene.characters.iter_mut().zip(&characters) {
                entry.scale = scale_to_metres(&entry.name, baked, progress);
            }
        }
        if is_portrait {
            let scales = scene.characters.iter().map(|c| c.scale);
            scene.crowds[0].positions = side_by_side(characters.iter().zip(scales));
        }
        let crowd = scene.populate(&characters.iter().collect::<Vec<_>>());
        for warning in &crowd.warnings {
            progress.warn(warning);
        }
        for note in &crowd.notes {
            progress.note(note);
        }
        Ok(Self {
            scene,
            characters,
            crowd,
            camera,
            side: request.side.unwrap_or(ViewFrom::ThreeQuarter),
            is_portrait,
            occlusion: request.occlusion != Some(Switch::Off),
        })
    }

    /// The same characters and scene with another number of agents.
    pub fn set_agent_count(&mut self, count: usize) {
        self.scene.set_agent_count(count);
        self.crowd = self
            .scene
            .populate(&self.characters.iter().collect::<Vec<_>>());
    }

    /// Looks through the camera that was asked for, or where none was, through the first that moves; its name, and how long
    /// it moves in seconds.
    ///
    /// Errors: where it stands still.
    pub fn fly(&mut self, was_asked_for: bool) -> Result<(String, f32)> {
        let cameras = &self.scene.cameras;
        let end = |i: usize| cameras.get(i)?.path.last().map(|key| key.time);
        let found = match self.camera {
            Some(i) if was_asked_for => Some(i).filter(|&i| end(i).is_some()),
            _ => (0..cameras.len()).find(|&i| end(i).is_some()),
        };
        match found.and_then(|i| Some((i, end(i)?))) {
            Some((i, end)) => {
                self.camera = Some(i);
                Ok((cameras[i].name.clone(), end))
            }
            None if was_asked_for => {
                bail!("--camera: it stands still; this needs one with a `path`")
            }
            None => bail!("the scene has no camera with a `path`"),
        }
    }

    /// All agents at a time.
    pub fn agents(&self, time: f32) -> Vec<Agent> {
        let mut agents = self.crowd.agents_at(time);
        if self.is_portrait {
            for agent in &mut agents {
                let clip = &self.characters[agent.character.0 as usize].clips;
                let duration = clip
                    .get(agent.clips[0] as usize)
                    .map_or(0.0, |c| c.duration_s);
                let phase = if duration > 0.0 {
                    (time / duration).rem_euclid(1.0)
                } else {
                    0.0
                };
                agent.phases = [phase; 2];
            }
        }
        agents
    }

    /// The camera at a time, for a picture of `size_px`.
    pub fn view(&self, time: f32, size_px: [u32; 2]) -> View {
        let default_fov_y_deg: f32 = 30.0;
        let camera = self.camera.and_then(|i| {
            let views = self.scene.camera_at(i, time)?;
            Some((self.scene.cameras.get(i)?, views))
        });
        match camera {
            Some((camera, (eye, target))) => {
                let fov_y = camera.fov_y_deg.to_radians();
                // Nearer than this nobody is recognisable.
                View::perspective(eye, target, fov_y, 0.1, size_px)
            }
            None => frame_all(
                &self.agents(0.0),
                &self.characters,
                self.side.to_camera(),
                default_fov_y_deg.to_radians(),
                size_px,
            ),
        }
    }

    /// Frame options as the scene says, for a portrait without anything around it.
    pub fn frame_options(&self) -> FrameOptions {
        FrameOptions {
            light: self.scene.light.to_light(),
            ground: self.scene.ground,
            ground_color: self.scene.ground_color,
            sky: self.scene.sky,
            occlusion: self.occlusion,
            ..FrameOptions::default()
        }
    }
}

/// A file where there is one, else a built-in scene.
fn load_scene(name: &str) -> Result<Scene> {
    let path = Path::new(name);
    let looks_like_file = path.extension().is_some() || path.components().count() > 1;
    if looks_like_file || path.is_file() {
        Ok(Scene::load(path)?)
    } else {
        Ok(Scene::builtin(name)?)
    }
}

fn find_camera(scene: &Scene, name: &str) -> Result<usize> {
    let names: Vec<&str> = scene.cameras.iter().map(|c| c.name.as_str()).collect();
    match names.iter().position(|n| *n == name) {
        Some(i) => Ok(i),
        None if names.is_empty() => bail!("--camera {name}: the scene has no cameras"),
        None => bail!("--camera {name}: the scene has {}", names.join(", ")),
    }
}

/// A scene to look at characters in: they stand at the origin until their widths are known.
fn portrait() -> Scene {
    Scene {
        seed: 0,
        frames_per_second: 30.0,
        characters: Vec::new(),
        crowds: vec![SceneCrowd {
            positions: vec![Vec3::ZERO],
            heading_deg: Some(0.0),
            ..SceneCrowd::default()
        }],
        cameras: Vec::new(),
        light: SceneLight::default(),
        ground: true,
        ground_color: None,
        stand_in_scale: 1.0,
        sky: true,
    }
}

/// A clip that was asked for by name has to be somebody's.
fn check_clip(name: &str, characters: &[Baked]) -> Result<()> {
    let names = |c: &'_ Baked| -> Vec<String> { c.clips.iter().map(|c| c.name.clone()).collect() };
    let all: Vec<Vec<String>> = characters.iter().map(names).collect();
    let is_known =
        |names: &Vec<String>| find_clip(names.iter().map(String::as_str), name).is_some();
    if all.is_empty() || all.iter().any(is_known) {
        return Ok(());
    }
    let lists = characters.iter().zip(&all);
    let lists: Vec<String> = lists
        .map(|(c, names)| format!("{} has {}", c.name, names.join(", ")))
        .collect();
    bail!("--clip {name}: there is none; {}", lists.join("; "))
}

/// What a character of unknown units is scaled by where a scene does not say it: 1 where it is from 10 cm to 15 m large,
/// else the power of ten that makes it 50 cm to 5 m large, as one modelled in centimetres is in metres.
fn scale_to_metres(name: &str, character: &Baked, progress: &Progress) -> f32 {
    let size = character
        .clips
        .get(standing_clip(character))
        .map_or(1.0, |c| (c.box_max - c.box_min).max_element());
    if (0.1..=15.0).contains(&size) || !(size.is_finite() && size > 0.0) {
        return 1.0;
    }
    let scale = 10f32.powi((5.0 / size).log10().floor() as i32);
    progress.note(&format!(
        "{name}: it would be {size:.3} m large; drawn {scale} times as large, as if in other units (`height` or `scale` in a \
         scene says it otherwise)"
    ));
    scale
}

/// Places along x, in a row around the origin, as far apart as the characters, with their scales, are wide.
fn side_by_side<'a>(characters: impl Iterator<Item = (&'a Baked, f32)>) -> Vec<Vec3> {
    let boxes = characters.map(|(c, scale)| {
        let boxes = c.clips.get(standing_clip(c)).into_iter();
        boxes.fold((0.0f32, 0.0f32), |(min, max), b| {
            (min.min(scale * b.box_min.x), max.max(scale * b.box_max.x))
        })
    });
    let mut right = 0.0;
    let mut places: Vec<Vec3> = Vec::new();
    for (min, max) in boxes {
        places.push(Vec3::new(right - min, 0.0, 0.0));
        right += 1.1 * (max - min);
    }
    let middle = right / 2.0;
    places.iter().map(|p| *p - Vec3::X * middle).collect()
}

/// The nearest view along `-to_camera` that everybody's animated bounds are in.
fn frame_all(
    agents: &[Agent],
    characters: &[Baked],
    to_camera: Vec3,
    fov_y: f32,
    size_px: [u32; 2],
) -> View {
    let right = Vec3::Y.cross(to_camera).try_normalize().unwrap_or(Vec3::X);
    let view_from_world = Mat3::from_cols(right, to_camera.cross(right), to_camera).transpose();
    let corners: Vec<Vec3> = agents
        .iter()
        .flat_map(|a| corners(a, &characters[a.character.0 as usize]))
        .map(|corner| view_from_world * corner)
        .collect();
    let (mut min, mut max) = (Vec3::splat(f32::MAX), Vec3::splat(f32::MIN));
    for c in &corners {
        (min, max) = (min.min(*c), max.max(*c));
    }
    if corners.is_empty() {
        (min, max) = (Vec3::ZERO, Vec3::ONE);
    }
    let center = (min + max) / 2.0;
    let slope_y = (fov_y / 2.0).tan() / 1.08;
    let slope_x = slope_y * size_px[0] as f32 / size_px[1].max(1) as f32;
    let distance = corners
        .iter()
        .map(|c| *c - center)
        .map(|c| c.z + (c.x.abs() / slope_x).max(c.y.abs() / slope_y))
        .fold(0.0, f32::max);
    let target = view_from_world.transpose() * center;
    let near = (distance - (max.z - center.z)).max(distance * 0.01) * 0.5;
    View::perspective(
        target + to_camera * distance,
        target,
        fov_y,
        near.max(1e-6),
        size_px,
    )
}

/// Corners of an agent's animated bounds, in world space.
fn corners(agent: &Agent, character: &Baked) -> impl Iterator<Item = Vec3> {
    let (min, max) = match character.clips.get(agent.clips[0] as usize) {
        Some(c) => (c.box_min, c.box_max),
        None => (Vec3::ZERO, Vec3::ZERO),
    };
    let world_from_model = Quat::from_rotation_y(agent.heading);
    let (position, scale) = (agent.position, agent.scale);
    (0..8).map(move |i| {
        let pick = |bit: u32, axis: usize| {
            if i >> bit & 1 == 0 {
                min[axis]
            } else {
                max[axis]
            }
        };
        position + world_from_model * (scale * Vec3::new(pick(0, 0), pick(1, 1), pick(2, 2)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use throng_bake::baked::BakedClip;

    fn somebody(box_min: Vec3, box_max: Vec3) -> Baked {
        Baked {
            clips: vec![BakedClip {
                name: "walk".into(),
                first_frame: 0,
                frame_count: 1,
                duration_s: 1.0,
                ground_speed: 0.0,
                box_min,
                box_max,
                sphere_center: Vec3::ZERO,
                sphere_radius: 1.0,
                ground: 0.0,
            }],
            ..Baked::default()
        }
    }

    /// Everybody is inside the picture, and touches its border nearly, whatever their size and wherever they stand.
    #[test]
    fn the_view_takes_everybody_in_and_no_more() {
        for size in [0.01, 1.8, 400.0] {
            let character = somebody(
                Vec3::new(-0.3, 0.0, -0.2) * size,
                Vec3::new(0.3, 1.0, 0.5) * size,
            );
            let agents = [-1.0, 0.5, 2.0].map(|x| Agent {
                position: Vec3::new(x * size, 0.0, -x * size),
                heading: x,
                ..Agent::default()
            });
            for side in [
                ViewFrom::Front,
                ViewFrom::Side,
                ViewFrom::Back,
                ViewFrom::ThreeQuarter,
                ViewFrom::Top,
            ] {
                for size_px in [[640, 480], [100, 300]] {
                    let characters = std::slice::from_ref(&character);
                    let view = frame_all(&agents, characters, side.to_camera(), 0.6, size_px);
                    let mut reach = 0.0f32;
                    for corner in agents.iter().flat_map(|a| corners(a, &character)) {
                        let clip = view.clip_from_world() * corner.extend(1.0);
                        let ndc = clip.truncate() / clip.w;
                        assert!(clip.w > view.near, "{side:?} {size}");
                        reach = reach.max(ndc.x.abs()).max(ndc.y.abs());
                    }
                    assert!((0.6..1.0).contains(&reach), "{side:?} {size}: {reach}");
                }
            }
        }
    }
}
