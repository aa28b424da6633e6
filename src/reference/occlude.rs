//! Twin of hlsl/occlude.hlsl and of hlsl/occlusion.hlsli: the pyramid over the occluders' depth, and the test against it.

use glam::{Mat4, Vec2, Vec3, Vec4};

use crate::gpu_types::{
    AgentState, ClipInfo, FLAG_REVERSED_DEPTH, FrameConstants, OCCLUDER_MARGIN, OCCLUDER_TEXEL_PX,
    OPEN_ERROR_MAX, PYRAMID_TOP, SHADOW_LIFT, TEST_COLUMNS, TEST_ROWS,
};

/// Levels of farthest depth, from the first, one after the other; depths rise away from the eye.
#[derive(Debug, Clone, PartialEq)]
pub struct Pyramid {
    /// Of the picture that it is for.
    pub size_px: [u32; 2],
    /// `[pyramid_texels]`.
    pub texels: Vec<f32>,
}

/// Texels of the occluders' depth for a picture.
pub fn depth_size(size_px: [u32; 2]) -> [u32; 2] {
    size_px.map(|side| side.div_ceil(OCCLUDER_TEXEL_PX))
}

/// The same rounded up to whole texels of the last level.
pub fn padded_size(size_px: [u32; 2]) -> [u32; 2] {
    depth_size(size_px).map(|side| side.next_multiple_of(1 << PYRAMID_TOP))
}

/// Texels of all levels.
pub fn pyramid_texels(size_px: [u32; 2]) -> u64 {
    let [width, height] = padded_size(size_px).map(u64::from);
    (0..=PYRAMID_TOP).map(|l| (width * height) >> (2 * l)).sum()
}

impl Pyramid {
    /// Over a depth of [`depth_size`], whose last texels stand for what is beyond.
    pub fn new(size_px: [u32; 2], depth: &[f32], reversed: bool) -> Self {
        let [width, height] = depth_size(size_px).map(|s| s as usize);
        let padded = padded_size(size_px).map(|s| s as usize);
        let mut texels = Vec::new();
        for y in 0..padded[1] {
            for x in 0..padded[0] {
                let d = depth[y.min(height - 1) * width + x.min(width - 1)];
                texels.push(if reversed { -d } else { d });
            }
        }
        let mut start = 0;
        for level in 1..=PYRAMID_TOP {
            let [w, h] = padded.map(|side| side >> level);
            let below = start;
            start = texels.len();
            for i in 0..w * h {
                let from = below + 2 * (i / w) * 2 * w + 2 * (i % w);
                let four = [from, from + 1, from + 2 * w, from + 2 * w + 1];
                texels.push(four.map(|i| texels[i]).into_iter().fold(f32::MIN, f32::max));
            }
        }
        Self { size_px, texels }
    }

    /// A texel of a level.
    fn at(&self, level: u32, x: u32, y: u32) -> f32 {
        let [width, height] = padded_size(self.size_px);
        let start: u32 = (0..level).map(|l| (width * height) >> (2 * l)).sum();
        self.texels[(start + y * (width >> level) + x) as usize]
    }
}

/// Share of an agent's bounds, in whatever frame of its clips, that no occluder covers; 0 where neither its body nor its contact
/// shadow, place and radius, can be seen, and at least the least float above it where only its shadow can.
pub fn open_share(
    pyramid: &Pyramid,
    frame: &FrameConstants,
    agent: &AgentState,
    clips: [&ClipInfo; 2],
    shadow: Option<[f32; 4]>,
) -> f32 {
    let body = share_of(pyramid, frame, &body_corners(agent, clips));
    let shadow_shows = || {
        shadow.is_some_and(|shadow| share_of(pyramid, frame, &shadow_corners(frame, shadow)) > 0.0)
    };
    match body == 0.0 && shadow_shows() {
        true => f32::MIN_POSITIVE,
        false => body,
    }
}

/// How many times the error may be that an agent's mesh has, of which a share is open.
pub fn open_error_factor(open: f32) -> f32 {
    (1.0 / open.max(1e-3).sqrt()).min(OPEN_ERROR_MAX)
}

/// Corners of a box that holds both clips.
fn body_corners(agent: &AgentState, clips: [&ClipInfo; 2]) -> Vec<Vec3> {
    let center = clips.map(|c| Vec3::from(c.box_center));
    let half = clips.map(|c| Vec3::from(c.box_half_extent));
    let low = (center[0] - half[0]).min(center[1] - half[1]);
    let high = (center[0] + half[0]).max(center[1] + half[1]);
    let corner = |i: u32| {
        let pick = |axis: usize| if i >> axis & 1 == 0 { low } else { high }[axis];
        let p = agent.scale * Vec3::new(pick(0), pick(1), pick(2));
        let (cos, sin) = (agent.heading_cos, agent.heading_sin);
        Vec3::from(agent.position) + Vec3::new(cos * p.x + sin * p.z, p.y, cos * p.z - sin * p.x)
    };
    (0..8).map(corner).collect()
}

/// Corners of a square on the ground that holds a contact shadow.
fn shadow_corners(frame: &FrameConstants, [px, _, pz, radius]: [f32; 4]) -> [Vec3; 4] {
    let eye = Vec3::from(frame.eye);
    let away = Vec2::new(px - eye.x, pz - eye.z);
    let away = away * (radius / away.length().max(1e-6));
    [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)].map(|(x, z)| {
        let offset = z * away + x * Vec2::new(-away.y, away.x);
        Vec3::new(px + offset.x, SHADOW_LIFT, pz + offset.y)
    })
}

/// Share of the rectangle of the picture that holds `points` where no occluder is in front of all of them.
fn share_of(pyramid: &Pyramid, frame: &FrameConstants, points: &[Vec3]) -> f32 {
    let clip_from_world = Mat4::from_cols_array_2d(&frame.clip_from_world);
    let eye = clip_from_world * Vec3::from(frame.eye).extend(1.0);
    let sign = if frame.flags & FLAG_REVERSED_DEPTH != 0 {
        -1.0
    } else {
        1.0
    };
    let clips: Vec<Vec4> = points
        .iter()
        .map(|p| clip_from_world * p.extend(1.0))
        .collect();
    let ndc = |c: &Vec4| Vec2::new(c.x, c.y) / c.w.max(1e-6);
    let low = clips.iter().map(ndc).fold(Vec2::MAX, Vec2::min);
    let high = clips.iter().map(ndc).fold(Vec2::MIN, Vec2::max);
    let depth = |c: &Vec4| {
        let nearer = c.lerp(eye, OCCLUDER_MARGIN);
        sign * nearer.z / nearer.w.max(1e-6)
    };
    let nearest = clips.iter().map(depth).fold(f32::MAX, f32::min);
    if clips.iter().any(|c| c.w <= frame.near) {
        return 1.0;
    }
    let size = Vec2::new(frame.width_px as f32, frame.height_px as f32);
    let texel = |ndc: Vec2, round: fn(Vec2) -> Vec2| {
        let px = (Vec2::new(ndc.x, -ndc.y) * 0.5 + 0.5) * size;
        let px = round(px).clamp(Vec2::ZERO, size - 1.0);
        [px.x as u32, px.y as u32].map(|x| x / OCCLUDER_TEXEL_PX)
    };
    let first = texel(Vec2::new(low.x, high.y), |px| (px - 1.0).floor());
    let last = texel(Vec2::new(high.x, low.y), |px| (px + 1.0).floor());
    let level = (0..=PYRAMID_TOP).find(|l| {
        (last[0] >> l) - (first[0] >> l) < TEST_COLUMNS
            && (last[1] >> l) - (first[1] >> l) < TEST_ROWS
    });
    let Some(level) = level else { return 1.0 };
    let texels = (first[1] >> level..=last[1] >> level)
        .flat_map(|y| (first[0] >> level..=last[0] >> level).map(move |x| (x, y)));
    let (mut open, mut all) = (0.0, 0.0);
    for (x, y) in texels {
        all += 1.0;
        if nearest <= pyramid.at(level, x, y) {
            open += 1.0;
        }
    }
    open / all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One texel that nobody covers keeps all above it open.
    #[test]
    fn a_pyramid_holds_the_farthest_depth() {
        let size_px = [140, 100];
        let [width, height] = depth_size(size_px);
        assert_eq!((width, height), (35, 25));
        let mut depth = vec![0.5; (width * height) as usize];
        depth[(12 * width + 9) as usize] = 0.0;
        let pyramid = Pyramid::new(size_px, &depth, true);
        assert_eq!(pyramid.texels.len() as u64, pyramid_texels(size_px));
        let open = |level: u32| {
            let [w, h] = padded_size(size_px).map(|s| s >> level);
            let all = (0..h).flat_map(|y| (0..w).map(move |x| (x, y)));
            all.filter(|&(x, y)| pyramid.at(level, x, y) == 0.0)
                .collect::<Vec<_>>()
        };
        assert_eq!(open(0), [(9, 12)]);
        assert_eq!(open(1), [(4, 6)]);
        assert_eq!(open(3), [(1, 1)]);
        assert_eq!(open(5), [(0, 0)]);
        let forward: Vec<f32> = depth.iter().map(|d| 1.0 - d).collect();
        let other = Pyramid::new(size_px, &forward, false);
        assert!(
            other
                .texels
                .iter()
                .zip(&pyramid.texels)
                .all(|(a, b)| *a == 1.0 + b)
        );
    }

    /// A wall at 4 m covers all but the right end of the picture.
    #[test]
    fn only_what_is_all_behind_is_hidden() {
        let size_px = [400, 200];
        let eye = Vec3::new(0.0, 1.7, 0.0);
        for reversed in [true, false] {
            let mut view = crate::View::perspective(eye, eye + Vec3::NEG_Z, 0.8, 0.1, size_px);
            if !reversed {
                view.clip_from_view = Mat4::perspective_rh(0.8, 2.0, 0.1, 500.0);
            }
            let options = crate::FrameOptions::default();
            let tables = crate::prepare::Tables::default();
            let frame = crate::select::frame_constants(&view, &options, 1, &tables, reversed);
            let wall = view.clip_from_world() * Vec4::new(0.0, 1.7, -4.0, 1.0);
            let [width, height] = depth_size(size_px);
            let far = if reversed { 0.0 } else { 1.0 };
            let depth: Vec<f32> = (0..width * height)
                .map(|i| if i % width < 80 { wall.z / wall.w } else { far })
                .collect();
            let pyramid = Pyramid::new(size_px, &depth, reversed);
            let clip = ClipInfo {
                box_center: [0.0, 0.9, 0.0],
                box_half_extent: [0.3, 0.9, 0.2],
                ..bytemuck::Zeroable::zeroed()
            };
            let hidden = |x: f32, z: f32, shadow_radius: f32| {
                let agent = crate::Agent {
                    position: Vec3::new(x, 0.0, z),
                    ..crate::Agent::default()
                };
                let agent = AgentState::from(&agent);
                let shadow = (shadow_radius > 0.0).then_some([x, 0.0, z, shadow_radius]);
                open_share(&pyramid, &frame, &agent, [&clip; 2], shadow) == 0.0
            };
            assert!(hidden(0.0, -8.0, 0.0) && hidden(-3.0, -5.0, 0.4));
            assert!(!hidden(0.0, -3.0, 0.0), "in front of it");
            assert!(!hidden(0.0, -4.1, 0.0), "not all of it behind");
            assert!(!hidden(6.0, -8.0, 0.0), "beside it");
            assert!(!hidden(0.0, 0.0, 0.0), "around the eye");
            // The wall ends at 60 % of the right half: 4.06 m at a distance of 8.
            assert!(hidden(3.6, -8.0, 0.2), "its shadow is hidden, too");
            // Half of it is behind the wall, and the error may grow by the root of two.
            let agent = AgentState::from(&crate::Agent {
                position: Vec3::new(4.06, 0.0, -8.0),
                ..crate::Agent::default()
            });
            let open = open_share(&pyramid, &frame, &agent, [&clip; 2], None);
            assert!((open - 0.5).abs() < 0.1, "{open}");
            assert!((open_error_factor(0.5) - 2f32.sqrt()).abs() < 1e-6);
            assert_eq!(open_error_factor(1.0), 1.0);
            assert_eq!(open_error_factor(0.0), OPEN_ERROR_MAX);
            assert!(!hidden(3.6, -8.0, 1.0), "its shadow shows");
        }
    }
}
