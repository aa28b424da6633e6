//! What goes into a frame and what comes out of it: agents, the view, options and the report.

use glam::{Mat3, Mat4, Vec3, Vec4};
use serde::Serialize;

use crate::error::RenderError;
use crate::gpu_types::AgentState;

/// A character that a renderer knows; given by `add_character`, in rising order from 0 while none is removed. That of a
/// character that was removed is never given again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
pub struct CharacterId(pub u32);

impl CharacterId {
    const SLOT_BITS: u32 = 16;
    /// Characters that may have a place one after the other.
    pub(crate) const GENERATIONS: u32 = 1 << (32 - Self::SLOT_BITS);

    /// The character that takes a place after `generation` others had it; `None` where ids do not reach so far.
    pub(crate) fn new(slot: usize, generation: u32) -> Option<Self> {
        let slot = u32::try_from(slot).ok()?;
        let fits = slot < 1 << Self::SLOT_BITS && generation < Self::GENERATIONS;
        fits.then_some(Self(generation << Self::SLOT_BITS | slot))
    }

    /// Its place in the renderer's tables; that of a character that was removed may be another's by now.
    pub fn slot(self) -> usize {
        (self.0 & ((1 << Self::SLOT_BITS) - 1)) as usize
    }
}

/// One member of the crowd. World space is right-handed, +Y up, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Agent {
    /// Where its model space origin stands (for people: the ground between their feet).
    pub position: Vec3,
    /// Radians about +Y, counter-clockwise seen from above; 0 faces +Z.
    pub heading: f32,
    /// Metres per bind-space unit; greater than 0.
    pub scale: f32,
    /// What it looks like.
    pub character: CharacterId,
    /// Two clips of the character; the second only counts where `blend` is greater than 0.
    pub clips: [u32; 2],
    /// Time within each clip as a fraction of its duration, in [0, 1); other values wrap.
    pub phases: [f32; 2],
    /// Weight of the second clip, in [0, 1].
    pub blend: f32,
    /// Same seed, same colours.
    pub tint_seed: u32,
}

impl Default for Agent {
    fn default() -> Self {
        Self {
            position: Vec3::ZERO,
            heading: 0.0,
            scale: 1.0,
            character: CharacterId(0),
            clips: [0, 0],
            phases: [0.0, 0.0],
            blend: 0.0,
            tint_seed: 0,
        }
    }
}

impl From<&Agent> for AgentState {
    /// The GPU's form of an agent; its second clip is the first where it does not count.
    fn from(agent: &Agent) -> Self {
        let (heading_sin, heading_cos) = agent.heading.sin_cos();
        let second = agent.clips[(agent.blend > 0.0) as usize];
        Self {
            position: agent.position.into(),
            heading_cos,
            heading_sin,
            scale: agent.scale,
            character: agent.character.slot() as u32,
            clips: agent.clips[0] | (second << 16),
            phase0: agent.phases[0],
            phase1: agent.phases[1],
            blend: agent.blend.clamp(0.0, 1.0),
            tint_seed: agent.tint_seed,
        }
    }
}

/// The camera. Clip space is Direct3D's: +Y up, depth 0 to 1; the shaders turn it over for Vulkan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Rigid, neither scaled nor mirrored; right-handed, looking along -Z.
    pub view_from_world: Mat4,
    /// Perspective; depth is reversed (near is 1) where [`crate::gpu::RendererDesc::reversed_depth`] says so.
    pub clip_from_view: Mat4,
    /// Distance of the near plane, greater than 0; distances for the level of detail are not taken below it.
    pub near: f32,
    /// Size of the picture in pixels; with the projection it makes pixel errors out of metres.
    pub size_px: [u32; 2],
    /// Where the picture's left and top edge are in its attachment, in pixels: for hosts that draw several views into one. Nothing
    /// is drawn outside the picture.
    pub offset_px: [u32; 2],
}

impl View {
    /// A camera with reversed, infinite depth, whose picture begins in its attachment's corner.
    ///
    /// `fov_y` is the full vertical angle in radians; `near` in metres. Looking straight up or down works.
    pub fn perspective(eye: Vec3, target: Vec3, fov_y: f32, near: f32, size_px: [u32; 2]) -> Self {
        let forward = (target - eye).normalize_or(Vec3::NEG_Z);
        let up = if forward.y.abs() > 0.999 {
            Vec3::NEG_Z
        } else {
            Vec3::Y
        };
        let aspect = size_px[0].max(1) as f32 / size_px[1].max(1) as f32;
        Self {
            view_from_world: Mat4::look_to_rh(eye, forward, up),
            clip_from_view: Mat4::perspective_infinite_reverse_rh(fov_y, aspect, near),
            near,
            size_px,
            offset_px: [0, 0],
        }
    }

    /// Where the camera stands.
    pub fn eye(&self) -> Vec3 {
        self.view_from_world.inverse().w_axis.truncate()
    }

    /// World to clip space.
    pub fn clip_from_world(&self) -> Mat4 {
        self.clip_from_view * self.view_from_world
    }

    /// Metres that one pixel of height covers at one metre of distance: `2 tan(fov_y / 2) / height`.
    pub fn pixel_angle(&self) -> f32 {
        2.0 / (self.clip_from_view.y_axis.y.abs() * self.size_px[1] as f32)
    }

    pub(crate) fn validate(&self) -> Result<(), RenderError> {
        let bad = |reason: &str| RenderError::BadOption {
            option: "view",
            reason: reason.into(),
        };
        if !(self.clip_from_world().is_finite() && self.eye().is_finite()) {
            return Err(bad("its matrices are not finite"));
        }
        let axes = Mat3::from_mat4(self.view_from_world);
        if !(axes * axes.transpose()).abs_diff_eq(Mat3::IDENTITY, 1e-3) || axes.determinant() < 0.0
        {
            return Err(bad("its view_from_world scales, shears or mirrors"));
        }
        if self.clip_from_view.row(3) != Vec4::NEG_Z {
            return Err(bad("its clip_from_view is no perspective along -Z"));
        }
        if !(self.near > 0.0 && self.near.is_finite()) {
            return Err(bad("its near plane is not a distance greater than 0"));
        }
        if self.size_px.contains(&0) || self.clip_from_view.y_axis.y == 0.0 {
            return Err(bad("its picture has no size"));
        }
        // Farther out no attachment reaches, and no number for a rectangle's corner.
        let ends = self.offset_px.iter().zip(&self.size_px);
        if !ends
            .clone()
            .all(|(o, s)| o.saturating_add(*s) <= i32::MAX as u32)
        {
            return Err(bad("its picture is outside of every attachment"));
        }
        Ok(())
    }
}

/// How a crowd is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// By projected height the cheapest representation whose error is allowed: meshes near, impostors far.
    #[default]
    Hybrid,
    /// Meshes only: continuous levels of detail, one instanced indirect draw per submesh.
    Lod,
    /// Impostors with a quad per group of joints, for every character that has them.
    Flat,
    /// Impostors of one quad, for every character that has them.
    Quad,
    /// The same draws with every vertex: the finest band, all influences, all frames interpolated.
    Full,
    /// Full detail, one draw per agent and submesh recorded by the CPU: what crowds cost without instancing.
    Uninstanced,
}

/// The sun, the sky and the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// Towards the sun, world space; need not be of unit length.
    pub to_sun: Vec3,
    /// Linear colour of sunlight.
    pub sun: Vec3,
    /// Linear colour of the light from straight above.
    pub sky: Vec3,
    /// Linear colour of the light that the ground throws back.
    pub ground: Vec3,
}

impl Default for Light {
    fn default() -> Self {
        Self {
            to_sun: Vec3::new(0.45, 0.8, 0.4),
            sun: Vec3::new(0.95, 0.88, 0.76),
            sky: Vec3::new(0.36, 0.42, 0.52),
            ground: Vec3::new(0.20, 0.18, 0.16),
        }
    }
}

/// Options of one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameOptions {
    /// How the crowd is drawn.
    pub method: Method,
    /// Largest error of a representation in pixels at the picture's middle, at least 0, of agents whom nobody hides; `Full` and
    /// `Uninstanced` have none. Perspective stretches what is off the view's axis, and with it errors, to 1.5 times at most.
    pub pixel_error: f32,
    /// False freezes every agent in its clips' first frame without interpolation or blending (paper figure 3a).
    pub animate: bool,
    /// Draws the ground plane (y = 0).
    pub ground: bool,
    /// Linear colour of the ground, each channel from 0 to 1 and kept in 255 steps of its root; paved where absent.
    pub ground_color: Option<Vec3>,
    /// Draws a soft contact shadow under every agent, where the ground is drawn. Where shadows overlap, the darkest counts.
    pub shadows: bool,
    /// Draws the sky behind everything.
    pub sky: bool,
    /// Leaves out agents whom nearer ones hide. Those of whom only a share shows may have `pixel_error` times the inverse of its
    /// root, 3 at most, as meshes. `Full` and `Uninstanced`, to which others are compared, never do either.
    pub occlusion: bool,
    /// Light.
    pub light: Light,
}

impl Default for FrameOptions {
    fn default() -> Self {
        Self {
            method: Method::Hybrid,
            pixel_error: 1.0,
            animate: true,
            ground: true,
            ground_color: None,
            shadows: true,
            sky: true,
            occlusion: true,
            light: Light::default(),
        }
    }
}

impl FrameOptions {
    /// Agents whom others hide are looked for.
    pub fn looks_for_hidden(&self) -> bool {
        self.occlusion && !matches!(self.method, Method::Full | Method::Uninstanced)
    }

    pub(crate) fn validate(&self) -> Result<(), RenderError> {
        if !(self.pixel_error >= 0.0 && self.pixel_error.is_finite()) {
            return Err(RenderError::BadOption {
                option: "pixel_error",
                reason: format!("{} is not a number of at least 0", self.pixel_error),
            });
        }
        if let Some(c) = self.ground_color
            && !(c.min_element() >= 0.0 && c.max_element() <= 1.0 && c.is_finite())
        {
            return Err(RenderError::BadOption {
                option: "ground_color",
                reason: format!("a channel of {c} is not from 0 to 1"),
            });
        }
        let l = &self.light;
        if !(l.to_sun.is_finite() && l.sun.is_finite() && l.sky.is_finite() && l.ground.is_finite())
        {
            return Err(RenderError::BadOption {
                option: "light",
                reason: "a colour or direction is not finite".into(),
            });
        }
        Ok(())
    }
}

/// Milliseconds of one stage.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct StageTime {
    /// The stage's verb, as in its HLSL file, or `upload` (CPU: writing the agents) or `record` (CPU: recording commands).
    pub stage: &'static str,
    /// Milliseconds.
    pub ms: f64,
}

/// Agents that one representation drew.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Representation {
    /// `mesh`, or the impostor kind.
    pub kind: &'static str,
    /// Agents.
    pub agents: u64,
}

/// What one frame did. Serialises to the names that reports use.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct FrameReport {
    /// Name of the device.
    pub device: String,
    /// Name and version of the driver.
    pub driver: String,
    /// Agents handed in.
    pub agents: u64,
    /// Agents whose bounds touch the frustum, and whom no others were found to hide.
    pub visible: u64,
    /// Agents outside.
    pub culled: u64,
    /// Agents inside whom others hide.
    pub occluded: u64,
    /// Agents that were drawn as depth first, so that they hide others.
    pub occluders: u64,
    /// API draw calls recorded: one per submesh of every character that has agents, another one as depth where hidden
    /// agents are looked for, and one where some agent is far enough for its smallest levels; one per impostor kind that some
    /// agent may show; plus ground, shadow and sky.
    pub draw_calls: u64,
    /// Instances over all submeshes: entries of the instance lists.
    pub instances: u64,
    /// Triangles handed to the rasteriser, before it culls any; without the occluders'.
    pub triangles: u64,
    /// Triangles of the occluders.
    pub occluder_triangles: u64,
    /// Sum over all instances of their live vertices, without those that wait for coarser levels to use them.
    pub live_vertices: u64,
    /// Vertex shader runs of the crowd, occluders included, where the device counts them.
    pub vertex_invocations: Option<u64>,
    /// Milliseconds from recording to finished work; only a host that waits knows it, such as [`crate::gpu::Headless`].
    pub frame_ms: Option<f64>,
    /// Milliseconds by stage, in the order of the frame; GPU stages only where the device has timestamps.
    pub stage_ms: Vec<StageTime>,
    /// Agents by representation.
    pub representations: Vec<Representation>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_of_the_ground_are_from_0_to_1() {
        for (channel, good) in [(0.0, true), (1.0, true), (-0.1, false), (f32::NAN, false)] {
            let options = FrameOptions {
                ground_color: Some(Vec3::new(0.5, channel, 0.5)),
                ..FrameOptions::default()
            };
            assert_eq!(options.validate().is_ok(), good, "{channel}");
        }
    }

    /// Projections that levels of detail cannot be chosen for are refused by name, not drawn wrongly.
    #[test]
    fn views_are_rigid_and_perspective() {
        let good = View::perspective(Vec3::new(3.0, 2.0, 9.0), Vec3::Y, 0.8, 0.1, [64, 48]);
        good.validate().unwrap();
        let down = View::perspective(Vec3::Y, Vec3::ZERO, 0.8, 0.1, [64, 48]);
        down.validate().unwrap();
        let off_axis = View {
            clip_from_view: Mat4::frustum_rh(-0.1, 0.2, -0.1, 0.1, 0.1, 100.0),
            ..good
        };
        off_axis.validate().unwrap();
        let split = View {
            offset_px: [64, 0],
            ..good
        };
        split.validate().unwrap();
        let reason = |view: View| view.validate().unwrap_err().to_string();
        let scaled = View {
            view_from_world: Mat4::from_scale(Vec3::splat(2.0)) * good.view_from_world,
            ..good
        };
        assert!(reason(scaled).contains("scales"));
        let mirrored = View {
            view_from_world: Mat4::from_scale(Vec3::new(-1.0, 1.0, 1.0)) * good.view_from_world,
            ..good
        };
        assert!(reason(mirrored).contains("mirrors"));
        let orthographic = View {
            clip_from_view: Mat4::orthographic_rh(-5.0, 5.0, -5.0, 5.0, 0.1, 100.0),
            ..good
        };
        let outside = View {
            offset_px: [0, u32::MAX - 40],
            ..good
        };
        assert!(reason(outside).contains("outside"));
        assert!(reason(orthographic).contains("perspective"));
        let left_handed = View {
            clip_from_view: Mat4::perspective_lh(0.8, 1.0, 0.1, 100.0),
            ..good
        };
        assert!(reason(left_handed).contains("perspective"));
    }
}
