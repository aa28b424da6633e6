//! Twin of hlsl/select.hlsl: culling, level of detail, instance lists.

use glam::{Vec3, Vec4};

use crate::gpu_types::{
    AgentState, BIN_NONE, ClipInfo, DrawCommand, FADE_SPAN, FLAG_FULL_DETAIL, FLAG_SHADOWS,
    FLAG_STILL, FREE_STRETCH, FrameConstants, IMPOSTOR_FADE_SHIFT, IMPOSTOR_FADES_OUT, Instance,
    MAX_RANGES, RangeInfo, SHADOW_FADE_RADII, SKINNING_ERROR_SHARE, SLICE_COUNT, SLICE_SHIFT,
    SWITCH_HEIGHT_PX, SubmeshInfo,
};
use crate::prepare::{Tables, level_key};
use crate::reference::occlude::{Pyramid, open_error_factor, open_share};

/// What the stage writes.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Selection {
    /// The lists, one after the other in the order of their bins, which begin with the impostors' slices; agents rise within
    /// each.
    pub instances: Vec<Instance>,
    /// By bin.
    pub draws: Vec<DrawCommand>,
    /// Places and radii of contact shadows, metres; in the order of their bits where the device selected, else in the agents'.
    pub shadows: Vec<[f32; 4]>,
    /// Agents whose bounds touch the frustum.
    pub visible: u64,
    /// Agents in it whom occluders hide.
    pub occluded: u64,
    /// Agents that their mesh draws.
    pub meshes: u64,
    /// Sum over all instances of their live vertices.
    pub live_vertices: u64,
}

/// The whole stage for `agents`, which name only characters and clips of `tables`; `ranges` are [`Tables::ranges`]. With a
/// pyramid, without those whom its occluders hide, and with coarser meshes of those of whom they hide most.
pub fn select(
    tables: &Tables,
    ranges: &[RangeInfo],
    agents: &[AgentState],
    frame: &FrameConstants,
    pyramid: Option<&Pyramid>,
) -> Selection {
    let mut lists: Vec<Vec<Instance>> = vec![Vec::new(); tables.bands.len()];
    let mut selection = Selection::default();
    for (index, agent) in agents.iter().enumerate() {
        let Some(true_distance) = view_agent(tables, agent, frame) else {
            continue;
        };
        let middle = agent.scale * clips_of(tables, agent)[0].sphere_center[1];
        let distance =
            true_distance * stretch_share(frame, Vec3::from(agent.position) + Vec3::Y * middle);
        let shadow = shadow_of(agent, shadow_radius(tables, agent), frame);
        let share = |p| open_share(p, frame, agent, clips_of(tables, agent), shadow);
        let open = pyramid.map_or(1.0, share);
        if open == 0.0 {
            selection.occluded += 1;
            continue;
        }
        selection.visible += 1;
        selection.shadows.extend(shadow);
        let character = &tables.characters[agent.character as usize];
        let still = frame.flags & FLAG_STILL != 0;
        let lod_error = if frame.flags & FLAG_FULL_DETAIL != 0 {
            -1.0
        } else {
            frame.error_per_metre * open_error_factor(open) * distance / agent.scale
        };
        let instance = make_instance(tables, index as u32, agent, lod_error, still);
        let submeshes = &tables.submeshes[character.first_submesh as usize..]
            [..character.submesh_count as usize];
        let mut entries = Vec::new();
        let choice = choose_range(
            &ranges[(agent.character * MAX_RANGES) as usize..][..MAX_RANGES as usize],
            frame.pixel_angle * distance / agent.scale,
            2.0 * clips_of(tables, agent)[0].box_half_extent[1],
            agent.tint_seed,
        );
        if choice.bin == BIN_NONE || choice.before == BIN_NONE {
            selection.meshes += 1;
            for submesh in submeshes {
                let (bin, live_vertex_count) = choose_band(tables, submesh, lod_error);
                if bin != BIN_NONE {
                    selection.live_vertices += live_vertex_count as u64;
                    entries.push((bin, live_vertex_count));
                }
            }
        }
        let pose = pose_of(tables, agent, still) | (choice.fade << IMPOSTOR_FADE_SHIFT);
        let slice = slice_at(true_distance / frame.near);
        if choice.bin != BIN_NONE {
            entries.push((choice.bin + slice, pose));
        }
        if choice.before != BIN_NONE && choice.before != choice.bin {
            entries.push((choice.before + slice, pose | IMPOSTOR_FADES_OUT));
        }
        for (bin, live_vertex_count) in entries {
            lists[bin as usize].push(Instance {
                live_vertex_count,
                ..instance
            });
        }
    }
    for (list, band) in lists.iter().zip(tables.bands.iter()) {
        selection.draws.push(DrawCommand {
            index_count: band.index_count,
            instance_count: list.len() as u32,
            first_index: band.first_index,
            vertex_offset: 0,
            first_instance: selection.instances.len() as u32,
        });
        selection.instances.extend(list);
    }
    selection
}

/// What to add to an impostor kind's first bin for that of a distance, in near distances.
pub(crate) fn slice_at(distance: f32) -> u32 {
    let step = (distance.max(1.0).to_bits() - 1.0f32.to_bits()) >> SLICE_SHIFT;
    SLICE_COUNT - 1 - step.min(SLICE_COUNT - 1)
}

/// A visible agent's distance, or `None` where it is culled.
fn view_agent(tables: &Tables, agent: &AgentState, frame: &FrameConstants) -> Option<f32> {
    let [clip0, clip1] = clips_of(tables, agent);
    let blended = agent.blend > 0.0;
    for plane in frame.planes.map(Vec4::from_array) {
        let mut s = support(clip0, agent, plane);
        if blended {
            s = s.max(support(clip1, agent, plane));
        }
        if s < 0.0 {
            return None;
        }
    }
    let mut distance = distance_to_sphere(clip0, agent, frame);
    if blended {
        distance = distance.min(distance_to_sphere(clip1, agent, frame));
    }
    Some(distance)
}

/// The share of its distance at which a place at the picture's middle would be as large in it: perspective stretches what is
/// off the view's axis by 1 over the cosine of the angle across the direction from the middle, and by 1 over its square along
/// it. 1 within [`FREE_STRETCH`].
pub(crate) fn stretch_share(frame: &FrameConstants, place: Vec3) -> f32 {
    let to_place = place - Vec3::from(frame.eye);
    let [x, y, z, _] = frame.clip_from_world.map(|column| column[3]);
    let forward = Vec3::new(x, y, z);
    let depth = forward.dot(to_place).max(0.0);
    let share = FREE_STRETCH * depth * depth / to_place.length_squared().max(1e-12);
    share.clamp(frame.stretch_share_min, 1.0)
}

/// What draws an agent at a projected size: bins, [`BIN_NONE`] being the mesh.
struct Choice {
    bin: u32,
    /// The representation of the range before; the same where nothing fades.
    before: u32,
    /// Share of `bin`, 255ths.
    fade: u32,
}

fn choose_range(ranges: &[RangeInfo], units: f32, height: f32, seed: u32) -> Choice {
    let last = ranges.len() - 1;
    let ends = &ranges[..last];
    let place = ends
        .iter()
        .position(|r| units < r.units_end)
        .unwrap_or(last);
    let bin = ranges[place].bin;
    let before = &ranges[place.saturating_sub(1)];
    let fade = (units / before.units_end - 1.0) / FADE_SPAN;
    let fades = place > 0 && fade < 1.0;
    if fades && height < SWITCH_HEIGHT_PX * units {
        let own = (seed.wrapping_mul(0x9e37_79b9) >> 8) as f32 * (1.0 / 16_777_216.0);
        let bin = if fade < own { before.bin } else { bin };
        Choice {
            bin,
            before: bin,
            fade: 255,
        }
    } else if fades {
        Choice {
            bin,
            before: before.bin,
            fade: (fade * 254.0) as u32 + 1,
        }
    } else {
        Choice {
            bin,
            before: bin,
            fade: 255,
        }
    }
}

/// The captured pose nearest to an agent's phase in the clip that it mostly plays.
fn pose_of(tables: &Tables, agent: &AgentState, still: bool) -> u32 {
    let second = agent.blend > 0.5 && !still;
    let clip = clips_of(tables, agent)[second as usize];
    let phase = match (still, second) {
        (true, _) => 0.0,
        (_, false) => agent.phase0,
        (_, true) => agent.phase1,
    };
    let pose = ((phase - phase.floor()) * clip.pose_count as f32 + 0.5) as u32;
    clip.first_pose + if pose < clip.pose_count { pose } else { 0 }
}

/// The clips of an agent.
fn clips_of<'a>(tables: &'a Tables, agent: &AgentState) -> [&'a ClipInfo; 2] {
    let first = tables.characters[agent.character as usize].first_clip;
    [agent.clips & 0xffff, agent.clips >> 16].map(|c| &tables.clips[(first + c) as usize])
}

/// The greatest signed distance that a vertex of the clip may have to a plane.
fn support(clip: &ClipInfo, agent: &AgentState, plane: Vec4) -> f32 {
    let n = Vec3::new(
        agent.heading_cos * plane.x - agent.heading_sin * plane.z,
        plane.y,
        agent.heading_sin * plane.x + agent.heading_cos * plane.z,
    );
    let origin = plane.truncate().dot(agent.position.into()) + plane.w;
    origin
        + agent.scale * (n.dot(clip.box_center.into()) + n.abs().dot(clip.box_half_extent.into()))
}

fn distance_to_sphere(clip: &ClipInfo, agent: &AgentState, frame: &FrameConstants) -> f32 {
    let c = Vec3::from(clip.sphere_center);
    let center = Vec3::from(agent.position)
        + agent.scale
            * Vec3::new(
                agent.heading_cos * c.x + agent.heading_sin * c.z,
                c.y,
                agent.heading_cos * c.z - agent.heading_sin * c.x,
            );
    ((center - Vec3::from(frame.eye)).length() - agent.scale * clip.sphere_radius).max(frame.near)
}

fn frame_position(clip: &ClipInfo, phase: f32) -> f32 {
    (phase - phase.floor()) * (clip.frame_count - 1) as f32
}

/// An agent's list entry, but for its live vertices.
fn make_instance(
    tables: &Tables,
    index: u32,
    agent: &AgentState,
    lod_error: f32,
    still: bool,
) -> Instance {
    let character = &tables.characters[agent.character as usize];
    let clips = clips_of(tables, agent);
    let allowed = lod_error * SKINNING_ERROR_SHARE;
    let influence_count = if allowed < character.influences3_error {
        4
    } else if allowed < character.influences2_error {
        3
    } else if allowed < character.influences1_error {
        2
    } else {
        1
    };
    let blend = if still {
        0.0
    } else {
        agent.blend.clamp(0.0, 1.0)
    };
    let shares = [1.0 - blend, blend];
    let phases = [agent.phase0, agent.phase1];
    let error = (0..2)
        .filter(|&i| shares[i] > 0.0)
        .map(|i| clips[i].nearest_error)
        .fold(0.0, f32::max);
    let nearest = still || allowed >= error;

    let mut sample_entries = [0; 4];
    let mut sample_weights = [0.0; 4];
    let mut sample_count = 0;
    for i in (0..2).filter(|&i| shares[i] > 0.0) {
        let clip = clips[i];
        let mut position = if still {
            0.0
        } else {
            frame_position(clip, phases[i])
        };
        if nearest {
            position = (position + 0.5).floor();
        }
        let first = position as u32;
        let fraction = position - first as f32;
        let mut push = |frame: u32, weight: f32| {
            sample_entries[sample_count] = (clip.first_frame + frame) * character.joint_count;
            sample_weights[sample_count] = weight;
            sample_count += 1;
        };
        push(first, shares[i] * (1.0 - fraction));
        if !nearest {
            push((first + 1).min(clip.frame_count - 1), shares[i] * fraction);
        }
    }
    Instance {
        position: agent.position,
        heading_cos: agent.heading_cos * agent.scale,
        tint_seed: agent.tint_seed,
        live_vertex_count: 0,
        packed: Instance::pack(influence_count, sample_count as u32, index),
        heading_sin: agent.heading_sin * agent.scale,
        sample_entries,
        sample_weights: [sample_weights[0], sample_weights[1], sample_weights[2]],
        padding0: 0,
    }
}

/// Metres. Whoever floats or flies casts less of it.
fn shadow_radius(tables: &Tables, agent: &AgentState) -> f32 {
    let height =
        agent.position[1] + agent.scale * tables.characters[agent.character as usize].lowest;
    (agent.scale * clips_of(tables, agent)[0].shadow_radius - height.abs()).max(0.0)
}

/// An agent's contact shadow, if anything of it is left at that distance.
fn shadow_of(agent: &AgentState, radius: f32, frame: &FrameConstants) -> Option<[f32; 4]> {
    let [x, y, z] = agent.position;
    let distance = Vec3::from(agent.position).distance(frame.eye.into());
    let casts = frame.flags & FLAG_SHADOWS != 0 && distance < 2.0 * SHADOW_FADE_RADII * radius;
    casts.then_some([x, y, z, radius])
}

/// The bin and the live vertices of a submesh at an error.
fn choose_band(tables: &Tables, submesh: &SubmeshInfo, lod_error: f32) -> (u32, u32) {
    let last = submesh.level_count as i32 - 1;
    let level = if lod_error < 0.0 {
        0
    } else {
        (level_key(lod_error) - submesh.first_key + 1).clamp(1, last)
    };
    let level = &tables.levels[submesh.first_level as usize + level as usize];
    (level.bin, level.live_vertex_count)
}

#[cfg(test)]
mod tests {
    use glam::{Mat4, Vec2};

    use super::*;
    use crate::frame::{FrameOptions, View};

    /// Wherever an agent is in the picture, its allowed error is at most `FREE_STRETCH` pixels, and no less than one.
    #[test]
    fn errors_hold_in_the_corners_of_wide_views() {
        let size_px = [1600, 900];
        for (fov_y_deg, is_usual) in [(30.0f32, true), (38.0, true), (75.0, false), (120.0, false)]
        {
            let (eye, target) = (Vec3::new(3.0, 2.0, 9.0), Vec3::new(-1.0, 0.5, 2.0));
            let view = View::perspective(eye, target, fov_y_deg.to_radians(), 0.1, size_px);
            let tables = Tables::default();
            let options = FrameOptions::default();
            let frame = crate::select::frame_constants(&view, &options, 0, &tables, true);
            assert_eq!(frame.stretch_share_min == 1.0, is_usual, "{fov_y_deg}");
            let pixels = |p: Vec3| -> Vec2 {
                let clip = view.clip_from_world() * p.extend(1.0);
                clip.truncate().truncate() / clip.w * Vec2::new(800.0, 450.0)
            };
            let world_from_clip: Mat4 = view.clip_from_world().inverse();
            let mut seen = 0.0f32;
            for (x, y) in [
                (0.0, 0.0),
                (0.5, -0.7),
                (1.0, 0.0),
                (0.0, -1.0),
                (-1.0, 1.0),
            ] {
                let place = world_from_clip.project_point3(Vec3::new(x, y, 0.002));
                let distance = place.distance(eye);
                let allowed = frame.error_per_metre * distance * stretch_share(&frame, place);
                let mut worst = 0.0f32;
                for i in 0..4000 {
                    // Directions all over a sphere.
                    let up = 1.0 - (i as f32 + 0.5) / 2000.0;
                    let (sin, cos) = (i as f32 * 2.399_963).sin_cos();
                    let across = (1.0 - up * up).sqrt();
                    let off = Vec3::new(across * cos, up, across * sin) * allowed;
                    worst = worst.max(pixels(place + off).distance(pixels(place)));
                }
                assert!(worst >= 0.95, "{fov_y_deg} at {x} {y}: {worst}");
                seen = seen.max(worst);
            }
            assert!(seen <= 1.1 * FREE_STRETCH, "{fov_y_deg}: {seen}");
        }
    }
}
