//! A sheet of agents of one character, all of one projected height, in poses of all its clips and in all headings: what
//! representations are compared on, by picture and by cost.

use glam::Vec3;
use throng_bake::baked::Baked;

use crate::frame::{Agent, CharacterId, View};

/// Height that agents are scaled to, metres, so that haze is as thin as it is around people.
const AGENT_HEIGHT: f32 = 1.8;
/// Distance of the camera in heights of the sheet: nearly parallel rays, little haze.
const DISTANCE: f32 = 5.0;

/// What a sheet shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SheetDesc {
    /// Projected height of the character's bounds ([`bounds_height`]), pixels.
    pub height_px: f32,
    /// The camera looks down by this angle, radians, from 0 to less than a right angle.
    pub pitch: f32,
    /// Columns and rows of agents.
    pub grid: [u32; 2],
    /// From one agent to the next, pixels.
    pub cell_px: [f32; 2],
    /// Size of the picture.
    pub size_px: [u32; 2],
}

/// Agents on a plane that faces the camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Sheet {
    /// Row by row.
    pub agents: Vec<Agent>,
    /// Size of the picture.
    pub size_px: [u32; 2],
    eye: Vec3,
}

/// Height of a character's bounds over all clips, of what lies at least half of its length, bind-space units: what projected
/// heights are of.
pub fn bounds_height(baked: &Baked) -> f32 {
    let extents = baked.clips.iter().map(|c| c.box_max - c.box_min);
    let heights = extents.map(|e| e.y.max(0.5 * e.max_element()));
    heights.fold(1e-6, f32::max)
}

impl Sheet {
    /// Places the agents. The same arguments give the same agents.
    pub fn new(baked: &Baked, character: CharacterId, desc: &SheetDesc) -> Self {
        /// Steps whose multiples fill [0, 1) evenly however many there are: powers of the plastic number.
        const STEPS: [f32; 2] = [0.754_877_7, 0.569_840_3];
        let scale = AGENT_HEIGHT / bounds_height(baked);
        let metres_per_px = AGENT_HEIGHT / desc.height_px;
        let to_eye = Vec3::new(0.0, desc.pitch.sin(), desc.pitch.cos());
        let axes = [Vec3::X, to_eye.cross(Vec3::X)];
        let [columns, rows] = desc.grid;
        let agents = (0..columns * rows).map(|i| {
            let along = |axis: usize, place: u32| {
                let from_middle = place as f32 - 0.5 * (desc.grid[axis] - 1) as f32;
                axes[axis] * (from_middle * desc.cell_px[axis] * metres_per_px)
            };
            // Other pitches show other poses and headings.
            let seed = i as f32 + 10.0 * desc.pitch;
            let fraction = |k: usize| (seed * STEPS[k]).fract();
            let clip = (7 * i + (40.0 * desc.pitch) as u32) % baked.clips.len().max(1) as u32;
            let heading = std::f32::consts::TAU * fraction(0);
            let (sin, cos) = heading.sin_cos();
            let bounds = baked.clips.get(clip as usize);
            let c = scale * bounds.map_or(Vec3::ZERO, |c| c.sphere_center);
            let center = Vec3::new(cos * c.x + sin * c.z, c.y, cos * c.z - sin * c.x);
            Agent {
                position: along(0, i % columns) + along(1, i / columns) - center,
                heading,
                scale,
                character,
                clips: [clip; 2],
                phases: [fraction(1); 2],
                tint_seed: i,
                ..Agent::default()
            }
        });
        Self {
            agents: agents.collect(),
            size_px: desc.size_px,
            eye: DISTANCE * desc.size_px[1] as f32 * metres_per_px * to_eye,
        }
    }

    /// The camera for a picture with `supersample` times as many pixels along each side.
    pub fn view(&self, supersample: u32) -> View {
        let fov_y = 2.0 * (0.5 / DISTANCE).atan();
        let near = 0.5 * self.eye.length();
        let size_px = self.size_px.map(|s| s * supersample);
        View::perspective(self.eye, Vec3::ZERO, fov_y, near, size_px)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use throng_bake::baked::BakedClip;

    #[test]
    fn agents_have_the_height_and_the_distance_that_were_asked_for() {
        let baked = Baked {
            clips: vec![BakedClip {
                name: "stand".into(),
                first_frame: 0,
                frame_count: 1,
                duration_s: 0.0,
                ground_speed: 0.0,
                box_min: Vec3::new(-30.0, 0.0, -30.0),
                box_max: Vec3::new(30.0, 170.0, 30.0),
                sphere_center: Vec3::new(0.0, 85.0, 0.0),
                sphere_radius: 95.0,
                ground: 0.0,
            }],
            ..Baked::default()
        };
        let desc = SheetDesc {
            height_px: 20.0,
            pitch: 0.0,
            grid: [8, 5],
            cell_px: [30.0, 40.0],
            size_px: [240, 200],
        };
        let sheet = Sheet::new(&baked, CharacterId(0), &desc);
        assert_eq!(sheet.agents.len(), 40);
        let view = sheet.view(1);
        let px = |p: Vec3| {
            let clip = view.clip_from_world() * p.extend(1.0);
            clip.truncate() / clip.w * Vec3::new(120.0, 100.0, 1.0)
        };
        let (a, b) = (&sheet.agents[18], &sheet.agents[19]);
        let foot = px(a.position);
        let head = px(a.position + Vec3::Y * 170.0 * a.scale);
        assert!((head.y - foot.y - 20.0).abs() < 0.1);
        assert!((px(b.position).x - foot.x - 30.0).abs() < 0.1);
        let below = px(sheet.agents[10].position);
        assert!((foot.y - below.y - 40.0).abs() < 0.2);
    }
}
