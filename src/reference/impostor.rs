//! Twin of hlsl/impostor.hlsli: which picture of a quad an instance shows, and where it stands.

use glam::{Vec2, Vec2Swizzles, Vec3, Vec4};
use throng_bake::baked::Baked;
use throng_bake::impostor::{Impostors, Kind, NO_JOINT, ViewSet};

use super::select::stretch_share;
use crate::gpu_types::{
    FrameConstants, IMPOSTOR_MIP_BIAS, IMPOSTOR_POSE_MASK, Instance, SHARPNESS_MAX, SHARPNESS_MIN,
};
use crate::impostor::Shown;

/// Least cosine between the eye's ray and a picture's plane that pixels are shifted for.
const MIN_SLANT: f32 = 0.4;

/// A corner of a picture in world space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// World space.
    pub corner: Vec3,
    /// Towards the eye, but for the width of a view cell; unit length.
    pub towards: Vec3,
    /// Texels of the atlas.
    pub uv: Vec2,
    /// Half the depth that the picture holds, metres.
    pub depth_extent: f32,
    /// Of the corner before the quad's centre, metres.
    pub depth: f32,
    /// Texels, to where the eye's ray meets what lies a depth extent before the plane.
    pub shift: Vec2,
    /// Of its atlas; a whole number.
    pub mip: f32,
    /// Pixels in a texel of that mip.
    pub sharpness: f32,
}

/// The four corners of a quad of an instance: left bottom, right bottom, left top, right top. `tiles` are
/// [`crate::impostor::trimmed_tiles`]; `first_pose` is the texel of the character's first pose in the gallery's table.
pub fn place_quad(
    baked: &Baked,
    impostors: &Impostors,
    tiles: &[Shown],
    frame: &FrameConstants,
    instance: &Instance,
    quad: usize,
    first_pose: u32,
) -> [Placed; 4] {
    let q = &impostors.quads[quad];
    let set = &impostors.view_sets[q.view_set as usize];
    let mut rows = [Vec4::X, Vec4::Y, Vec4::Z];
    let (mut pose, mut number) = (0, 0);
    if q.joint == NO_JOINT {
        pose = ((instance.live_vertex_count & IMPOSTOR_POSE_MASK) - first_pose) as usize;
    }
    if q.joint != NO_JOINT {
        let flat = impostors.kinds.iter().find(|k| k.kind == Kind::Flat);
        number = quad as u32 - flat.map_or(0, |k| k.first_quad);
        rows = [Vec4::ZERO; 3];
        for s in 0..instance.sample_count() as usize {
            let entry = &baked.palette[(instance.sample_entries[s] + q.joint) as usize];
            for (row, from) in rows.iter_mut().zip(entry.rows) {
                *row += instance.sample_weight(s) * Vec4::from_array(from);
            }
        }
    }
    let (cos, sin) = (instance.heading_cos, instance.heading_sin);
    let scale = cos.hypot(sin);
    let e = Vec3::from(frame.eye) - Vec3::from(instance.position);
    let eye = Vec3::new(cos * e.x - sin * e.z, scale * e.y, sin * e.x + cos * e.z)
        / (scale * scale)
        - Vec3::from(rows.map(|r| r.dot(q.center.extend(1.0))));
    let direction =
        (rows[0].truncate() * eye.x + rows[1].truncate() * eye.y + rows[2].truncate() * eye.z)
            .normalize();
    let view = view_of(set, direction, random(instance.agent(), number));
    let tile = &tiles[q.first_tile as usize + pose * set.directions.len() + view as usize];
    let (towards, right) = (set.directions[view as usize], set.rights[view as usize]);
    let up = towards.cross(right);
    let turn = |m: Vec3| Vec3::new(cos * m.x + sin * m.z, scale * m.y, cos * m.z - sin * m.x);
    let stretch = stretch_share(frame, instance.position.into());
    let pixel = frame.pixel_angle * eye.length() * stretch;
    let texel = (tile.max[0] - tile.min[0]) / tile.size[1].max(1.0);
    let ray = Vec3::new(
        direction.dot(right),
        direction.dot(up),
        direction.dot(towards),
    );
    let slant = ray.z - tile.lean[0] * ray.x - tile.lean[1] * ray.y;
    let extent = Vec2::from(tile.max) - Vec2::from(tile.min);
    let size = Vec2::new(-tile.size[0], tile.size[1]);
    let shift = Vec2::new(ray.y, ray.x) * size / extent.yx().max(Vec2::splat(1e-12))
        * (q.depth_extent / slant.max(MIN_SLANT));
    let mip = (pixel / texel.max(1e-12)).max(1.0).log2() + IMPOSTOR_MIP_BIAS;
    let last_mip = impostors.atlas.mip_count.saturating_sub(1) as f32;
    let mip = (mip.clamp(0.0, last_mip) + 0.5).floor();
    let sharpness = (texel * mip.exp2() / pixel.max(1e-12)).clamp(SHARPNESS_MIN, SHARPNESS_MAX);
    [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]].map(|[x, y]| {
        let at =
            Vec2::from(tile.min) + Vec2::new(x, y) * (Vec2::from(tile.max) - Vec2::from(tile.min));
        let depth = tile.lean[0] * at.x + tile.lean[1] * at.y + tile.lean[2];
        let p = (q.center + right * at.x + up * at.y + towards * depth).extend(1.0);
        let texel = Vec2::new(
            tile.texel[0] + (1.0 - y) * tile.size[0],
            tile.texel[1] + x * tile.size[1],
        );
        Placed {
            corner: Vec3::from(instance.position) + turn(Vec3::from(rows.map(|r| r.dot(p)))),
            towards: turn(Vec3::from(rows.map(|r| r.truncate().dot(towards)))).normalize_or_zero(),
            uv: texel,
            depth_extent: q.depth_extent * scale,
            depth: depth * scale,
            shift,
            mip,
            sharpness,
        }
    })
}

/// The view whose picture stands for a direction: one of the three around it, each for the share of `random` that the
/// direction's barycentric coordinates give it.
pub fn view_of(set: &ViewSet, direction: Vec3, random: f32) -> u16 {
    let [v0, v1, v2, _] = set.lookup(direction);
    let [a, b, c] = [v0, v1, v2].map(|v| set.directions[v as usize]);
    let sign = a.dot(b.cross(c)).signum();
    let w = [b.cross(c), c.cross(a), a.cross(b)].map(|n| (direction.dot(n) * sign).max(0.0));
    let most = w[0].max(w[1]).max(w[2]);
    let w = w.map(|w| (w - 0.8 * most).max(0.0));
    let sum: f32 = w.iter().sum();
    let at = random * sum;
    if at < w[0] || sum <= 0.0 {
        v0
    } else if at < w[0] + w[1] {
        v1
    } else {
        v2
    }
}

/// Steady over frames, different for every agent and quad; in [0, 1).
fn random(agent: u32, quad: u32) -> f32 {
    (hash(agent ^ quad.wrapping_mul(0x9e37_79b9)) >> 8) as f32 / 16_777_216.0
}

fn hash(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}
