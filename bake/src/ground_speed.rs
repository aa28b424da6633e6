//! How fast a character walks in a clip that does not say it: as fast as planted feet go backwards.

use std::ops::Range;

use glam::{Affine3A, Vec2, Vec3};

use crate::mesh::Mesh;

/// Points within this share of the model's height above its lowest point in a clip may belong to a planted foot ...
pub const LEVEL: f32 = 0.03;
/// ... and in a frame those within this share of that frame's lowest: a foot that swings forward passes above.
const CONTACT: f32 = 0.006;
/// Steps from frame to frame with a foot on the ground that a walk has at least, and their least share: a gallop flies.
const LEAST_STEPS: usize = 4;
const LEAST_SHARE: f32 = 0.2;
/// Half of the steps are this near to their median, as a share of it; a fall or a blow is anything but steady.
const STEADY: f32 = 0.35;
/// A walk ends where it began, but for this share of the model's height; a jump or a roll does not.
const LOOP: f32 = 0.2;
/// Slower than this many heights a second is standing.
const LEAST_SPEED: f32 = 0.1;

/// The speed along +Z at which feet do not slide, units per second; 0 where nothing walks: where feet stay, go sideways or
/// backwards, or are not steady.
///
/// Shapes: `frames` [frame_count][joint_count], the clip's palettes, `frame_s` seconds apart. `vertices` are those that come
/// within [`LEVEL`] of its lowest point; `rows` is from there to its highest.
pub fn ground_speed(
    mesh: &Mesh,
    vertices: &[u32],
    frames: &[Vec<Affine3A>],
    frame_s: f32,
    rows: Range<f32>,
) -> f32 {
    let (lowest, height) = (rows.start, rows.end - rows.start);
    if frames.len() < LEAST_STEPS || frame_s <= 0.0 {
        return 0.0;
    }
    let places = |frame: &Vec<Affine3A>| -> Vec<Vec3> {
        let posed = |&v: &u32| mesh.posed(frame, v as usize);
        vertices.iter().map(posed).collect()
    };
    let mut steps: Vec<Vec2> = Vec::new();
    let first = frames.first().map(places).unwrap_or_default();
    let mut before = first.clone();
    for frame in frames.iter().skip(1) {
        let now = places(frame);
        let (low_before, low_now) = (low(&before), low(&now));
        if low_before.max(low_now) < lowest + LEVEL * height {
            let planted = before.iter().zip(&now).filter(|(a, b)| {
                a.y < low_before + CONTACT * height && b.y < low_now + CONTACT * height
            });
            let moved: Vec<Vec2> = planted
                .map(|(a, b)| Vec2::new(a.x - b.x, a.z - b.z) / frame_s)
                .collect();
            if !moved.is_empty() {
                let middle = |axis: usize| median(moved.iter().map(|m| m[axis]).collect());
                steps.push(Vec2::new(middle(0), middle(1)));
            }
        }
        before = now;
    }
    let jumps = first.iter().zip(&before).map(|(a, b)| a.distance(*b));
    let is_loop = jumps.fold(0.0, f32::max) < LOOP * height;
    if !is_loop
        || steps.len() < LEAST_STEPS
        || (steps.len() as f32) < LEAST_SHARE * frames.len() as f32
    {
        return 0.0;
    }
    let speed = median(steps.iter().map(|s| s.y).collect());
    let aside = median(steps.iter().map(|s| s.x.abs()).collect());
    let off = median(steps.iter().map(|s| (s.y - speed).abs()).collect());
    let walks = speed > LEAST_SPEED * height && aside < STEADY * speed && off < STEADY * speed;
    if walks { speed } else { 0.0 }
}

fn low(places: &[Vec3]) -> f32 {
    places.iter().map(|p| p.y).fold(f32::INFINITY, f32::min)
}

/// The middle value; 0 where there is none.
fn median(mut values: Vec<f32>) -> f32 {
    values.sort_by(f32::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}
