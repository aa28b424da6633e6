//! Animations become clips.

use super::data::Source;
use super::json::{Animation, Sampler};
use super::scene::Scene;
use crate::character::{Clip, Interpolation, Property, Track};
use crate::error::ImportError;
use crate::import::files;

/// Reads all animations. Tracks of morph weights are left out with a warning.
pub fn read(
    source: &Source,
    scene: &Scene,
    warnings: &mut Vec<String>,
) -> Result<Vec<Clip>, ImportError> {
    let list = &source.document.animations;
    let mut clips = Vec::with_capacity(list.len());
    let mut morphing = 0;
    for (i, animation) in list.iter().enumerate() {
        clips.push(read_clip(source, scene, i, animation, warnings)?);
        morphing += usize::from(
            animation
                .channels
                .iter()
                .any(|c| c.target.path == "weights"),
        );
    }
    if morphing > 0 {
        warnings.push(format!(
            "{morphing} clips animate morph targets, which are not drawn"
        ));
    }
    Ok(clips)
}

fn read_clip(
    source: &Source,
    scene: &Scene,
    i: usize,
    animation: &Animation,
    warnings: &mut Vec<String>,
) -> Result<Clip, ImportError> {
    let name = animation
        .name
        .as_deref()
        .map_or_else(|| i.to_string(), |n| files::shorten(n, 1024));
    let speed = animation
        .extras
        .get("ground_speed")
        .and_then(|s| s.as_f64());
    let mut clip = Clip {
        name,
        duration_s: 0.0,
        ground_speed: speed.map_or(0.0, |s| s as f32),
        tracks: Vec::new(),
    };
    if !clip.ground_speed.is_finite() {
        let place = format!("animations[{i}].extras.ground_speed");
        return Err(source.bad(place, "it is not a finite number"));
    }
    // Which properties of a node already have a track, as bits.
    let mut animated = vec![0u8; scene.nodes.len()];
    for (c, channel) in animation.channels.iter().enumerate() {
        let place = format!("animations[{i}].channels[{c}]");
        let sampler = source.get(&animation.samplers, channel.sampler, "sampler", || {
            format!("{place}.sampler")
        })?;
        let property = match channel.target.path.as_str() {
            "translation" => Property::Translation,
            "rotation" => Property::Rotation,
            "scale" => Property::Scale,
            "weights" => continue,
            path => {
                let shown = files::shorten(path, 40);
                warnings.push(format!("{place} animates '{shown}'; it is left out"));
                continue;
            }
        };
        let Some(target) = channel.target.node else {
            continue;
        };
        source.get(&source.document.nodes, target, "node", || {
            format!("{place}.target.node")
        })?;
        let node = scene.order_of[target];
        let bit = 1 << property as u32;
        if animated[node as usize] & bit != 0 {
            warnings.push(format!(
                "{place} animates a property that another channel animates; it is left out"
            ));
            continue;
        }
        animated[node as usize] |= bit;
        let place = format!("animations[{i}].samplers[{}]", channel.sampler);
        let track = read_track(source, sampler, &place, node, property)?;
        let last_s = track.times_s[track.times_s.len() - 1];
        clip.duration_s = clip.duration_s.max(last_s);
        clip.tracks.push(track);
    }
    Ok(clip)
}

fn read_track(
    source: &Source,
    sampler: &Sampler,
    place: &str,
    node: u32,
    property: Property,
) -> Result<Track, ImportError> {
    let interpolation = match sampler.interpolation.as_deref() {
        None | Some("LINEAR") => Interpolation::Linear,
        Some("STEP") => Interpolation::Step,
        Some("CUBICSPLINE") => Interpolation::CubicSpline,
        Some(other) => {
            let reason = format!(
                "interpolation '{}' does not exist",
                files::shorten(other, 16)
            );
            return Err(source.bad(place, reason));
        }
    };
    let input = format!("{place}.input");
    let times_s = source.floats(sampler.input, &["SCALAR"], &input)?.values;
    if times_s.windows(2).any(|w| w[1] < w[0]) {
        return Err(source.bad(input, "its times fall"));
    }
    let output = format!("{place}.output");
    let kind = match property {
        Property::Rotation => "VEC4",
        Property::Translation | Property::Scale => "VEC3",
    };
    let values = source.floats(sampler.output, &[kind], &output)?;
    let per_key = if interpolation == Interpolation::CubicSpline {
        3
    } else {
        1
    };
    if values.count() != per_key * times_s.len() {
        let reason = format!(
            "it has {} values for {} keys with {per_key} each",
            values.count(),
            times_s.len()
        );
        return Err(source.bad(output, reason));
    }
    Ok(Track {
        node,
        property,
        interpolation,
        times_s,
        values: values.values,
    })
}
