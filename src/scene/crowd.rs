//! A scene's agents: who each one is, and where and in which pose at a time.

use std::f32::consts::{FRAC_PI_2, TAU};

use glam::{Vec2, Vec3};
use rayon::prelude::*;
use throng_bake::baked::{Baked, BakedClip};

use super::motion::{Random, Rect, Walk, facing, heading_of};
use crate::frame::{Agent, CharacterId};

use super::clips::{Heard, look_up_clips, standing_clip};
use super::{Area, Motion, Scene, SceneClip, SceneCrowd};

/// Everything about a scene's agents that does not change with time.
#[derive(Debug, Clone, PartialEq)]
pub struct Crowd {
    agents: Vec<Walker>,
    /// What could not be done as the scene says, for the user.
    pub warnings: Vec<String>,
    /// Which clips were taken for names that are not theirs, for the user; one a character.
    pub notes: Vec<String>,
}

#[derive(Debug, Clone, PartialEq)]
struct Walker {
    walk: Walk,
    height: f32,
    /// Metres per second.
    speed: f32,
    /// Fraction of the clip per second.
    rate: f32,
    start: Agent,
}

impl Scene {
    /// Places and casts all agents. `characters[i]` is the baked `self.characters[i]`, and its [`CharacterId`] is i: so a
    /// renderer has to be given exactly these characters in this order.
    ///
    /// Nobody is placed where there are no characters.
    pub fn populate(&self, characters: &[&Baked]) -> Crowd {
        let mut crowd = Crowd {
            agents: Vec::with_capacity(self.agent_count()),
            warnings: Vec::new(),
            notes: Vec::new(),
        };
        let mut heard = Heard::default();
        for (i, group) in self.crowds.iter().enumerate() {
            let seed = Random::new(self.seed, i as u64).next_u64();
            self.populate_group(group, characters, seed, &mut crowd, &mut heard);
        }
        crowd.notes = heard.notes();
        crowd.warnings = heard.warnings;
        crowd
    }

    fn populate_group(
        &self,
        group: &SceneCrowd,
        characters: &[&Baked],
        seed: u64,
        crowd: &mut Crowd,
        heard: &mut Heard,
    ) {
        let cast: Vec<usize> = (0..self.characters.len().min(characters.len()))
            .filter(|&i| {
                group.characters.is_empty() || group.characters.contains(&self.characters[i].name)
            })
            .collect();
        if cast.is_empty() {
            return;
        }
        let shares: Vec<f32> = cast.iter().map(|&i| self.characters[i].share).collect();
        let clips: Vec<Vec<usize>> = cast
            .iter()
            .map(|&i| look_up_clips(group, characters[i], heard))
            .collect();
        let lifts: Vec<f32> = cast
            .iter()
            .map(|&i| match self.characters[i].stand {
                true => lift_onto_ground(characters[i]),
                false => 0.0,
            })
            .collect();
        let clip_shares: Vec<f32> = group.clips.iter().map(|c| c.share).collect();
        let places = Places::new(group, seed);
        for i in 0..places.count {
            let random = &mut Random::new(seed, 1 + i as u64);
            let (position, position_heading) = places.at(i, random);
            // Drawn whether it is used or not, so that one choice does not change all that follow.
            let drawn = draw(&shares, random.unit());
            let in_turn = matches!(
                group.area,
                None | Some(Area::Grid { .. } | Area::Rings { .. })
            );
            let who = if !in_turn { drawn } else { i % cast.len() };
            let choice = draw(&clip_shares, random.unit());
            let stated = group.clips.get(choice);
            let character = characters[cast[who]];
            let clip_index = match clips[who].get(choice) {
                Some(&clip) => clip,
                None => standing_clip(character),
            };
            let entry = &self.characters[cast[who]];
            let scale = entry.scale
                * entry.height.map_or(1.0, |h| h / standing_height(character))
                * (1.0 + group.size_spread * random.between(-1.0, 1.0));
            let position = position + Vec3::Y * (scale * lifts[who]);
            let heading = position_heading.unwrap_or(random.between(0.0, TAU));
            let clip = character.clips.get(clip_index);
            let (speed, rate) = match stated {
                Some(c) if c.time.is_some() => (0.0, 0.0),
                _ => pace(group.motion, stated, clip, scale),
            };
            let duration = clip.map_or(0.0, |c| c.duration_s);
            let phase = match stated.and_then(|c| c.time) {
                Some(time) => wrap(time / duration.max(f32::MIN_POSITIVE)),
                None => random.unit(),
            };
            let ground = Vec2::new(position.x, position.z);
            let walk = places.walk(i, ground, heading, speed, random);
            crowd.agents.push(Walker {
                walk,
                height: position.y,
                speed,
                rate: rate / duration.max(f32::MIN_POSITIVE),
                start: Agent {
                    position,
                    heading,
                    scale,
                    character: CharacterId(cast[who] as u32),
                    clips: [clip_index as u32; 2],
                    phases: [phase; 2],
                    blend: 0.0,
                    tint_seed: (random.next_u64() >> 32) as u32,
                },
            });
        }
    }
}

impl Crowd {
    /// Number of agents.
    pub fn len(&self) -> usize {
        self.agents.len()
    }

    /// There is nobody.
    pub fn is_empty(&self) -> bool {
        self.agents.is_empty()
    }

    /// All agents at `time` seconds, always in the same order. Cost: some 100 ns an agent, on all cores.
    pub fn agents_at(&self, time: f32) -> Vec<Agent> {
        self.agents.par_iter().map(|a| a.at(time)).collect()
    }
}

impl Walker {
    fn at(&self, time: f32) -> Agent {
        let (ground, heading) = self.walk.at(self.speed * time);
        Agent {
            position: Vec3::new(ground.x, self.height, ground.y),
            heading,
            phases: [wrap(self.start.phases[0] + self.rate * time); 2],
            ..self.start
        }
    }
}

/// The fraction of a number; 0 where it has none.
fn wrap(x: f32) -> f32 {
    let fraction = x.rem_euclid(1.0);
    if fraction < 1.0 { fraction } else { 0.0 }
}

/// Speed over the ground and clip seconds per second: feet do not slide where the clip states its ground speed.
fn pace(
    motion: Motion,
    stated: Option<&SceneClip>,
    clip: Option<&BakedClip>,
    scale: f32,
) -> (f32, f32) {
    if motion == Motion::Still {
        return (0.0, 1.0);
    }
    let natural = clip.map_or(0.0, |c| c.ground_speed * scale);
    match stated.and_then(|c| c.speed) {
        Some(speed) if natural > 0.0 => (speed, speed / natural),
        Some(speed) => (speed, 1.0),
        None => (natural, 1.0),
    }
}

/// Height of a character that stands: from its idle clip's box, or the first clip's where it has no idle.
pub fn standing_height(character: &Baked) -> f32 {
    match character.clips.get(standing_clip(character)) {
        Some(c) if c.box_max.y > c.box_min.y => c.box_max.y - c.box_min.y,
        _ => 1.0,
    }
}

/// Height of what a character stands on, in bind space: 0 for most people, far below for those whose origin is their hip.
pub fn ground_of(character: &Baked) -> f32 {
    let clip = character.clips.get(standing_clip(character));
    clip.map_or(0.0, |c| c.ground)
}

/// How far, in bind-space units, a character has to be lifted to stand on the ground; 0 where it stands less than 3 % of its
/// height above it, or less than 15 % below: soles and paws sink into it, and what hands hold may reach through it.
fn lift_onto_ground(character: &Baked) -> f32 {
    let ground = ground_of(character);
    if !(-0.15..=0.03).contains(&(ground / standing_height(character))) {
        -ground
    } else {
        0.0
    }
}

/// Index that `unit`, from 0 to 1, falls on when each has a stretch as long as its share.
fn draw(shares: &[f32], unit: f32) -> usize {
    let mut left = unit * shares.iter().sum::<f32>();
    for (i, share) in shares.iter().enumerate() {
        left -= share;
        if left < 0.0 {
            return i;
        }
    }
    shares.len().saturating_sub(1)
}

/// Where the agents of one crowd start.
struct Places<'a> {
    group: &'a SceneCrowd,
    count: usize,
    /// Start of the sequence that spreads agents evenly.
    offset: Vec2,
    bounds: Option<Rect>,
    /// Index of the first agent of each ring, where there are rings.
    ring_starts: Vec<usize>,
}

impl<'a> Places<'a> {
    fn new(group: &'a SceneCrowd, seed: u64) -> Self {
        let count = group.positions.len() + group.count.unwrap_or(0) as usize;
        let mut random = Random::new(seed, 0);
        let bounds = group.area.and_then(|area| {
            let (center, half) = match area {
                Area::Fan { .. } | Area::Rings { .. } => return None,
                Area::Rectangle { center, size } => (center, size / 2.0),
                Area::Ring {
                    center, radius_max, ..
                } => (center, Vec2::splat(radius_max)),
                Area::Grid {
                    center,
                    spacing,
                    columns,
                } => {
                    let rows = count.div_ceil(columns as usize);
                    (
                        center,
                        spacing * Vec2::new(columns as f32, rows as f32) / 2.0,
                    )
                }
            };
            Some(Rect {
                min: center - half,
                max: center + half,
            })
        });
        Self {
            group,
            count,
            offset: Vec2::new(random.unit(), random.unit()),
            bounds,
            ring_starts: match group.area {
                Some(Area::Rings {
                    ring_spacing,
                    spacing,
                    ..
                }) => ring_starts(count, ring_spacing, spacing),
                _ => Vec::new(),
            },
        }
    }

    /// Position of agent `index`, and its heading where the scene says it.
    fn at(&self, index: usize, random: &mut Random) -> (Vec3, Option<f32>) {
        // Roberts' R2 sequence: any first n points cover the unit square evenly. Some disorder hides its lattice.
        let spread = 0.3 / (self.count.max(1) as f32).sqrt();
        let disorder = Vec2::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0)) * spread;
        let sequence = |start: f32, step: f64| {
            (f64::from(start) + (index as f64 + 1.0) * step).rem_euclid(1.0) as f32
        };
        let unit = (Vec2::new(
            sequence(self.offset.x, 0.754_877_666_246_692_7),
            sequence(self.offset.y, 0.569_840_290_998_053_3),
        ) + disorder)
            .rem_euclid(Vec2::ONE);
        let position = match self.group.area {
            Some(Area::Rectangle { center, size }) => ground(center + (unit - 0.5) * size),
            Some(Area::Ring {
                center,
                radius_min,
                radius_max,
            }) => {
                // Equal areas get equal numbers.
                let (min, max) = (radius_min * radius_min, radius_max * radius_max);
                let radius = (min + (max - min) * unit.x).sqrt();
                ground(center + Vec2::from_angle(unit.y * TAU) * radius)
            }
            Some(Area::Grid {
                center,
                spacing,
                columns,
            }) => {
                let columns = columns as usize;
                let rows = self.count.div_ceil(columns);
                let cell = Vec2::new((index % columns) as f32, (index / columns) as f32);
                let last = Vec2::new(
                    columns.min(self.count) as f32 - 1.0,
                    rows.saturating_sub(1) as f32,
                );
                ground(center + (cell - last / 2.0) * spacing)
            }
            Some(Area::Fan {
                center,
                heading_deg,
                angle_deg,
                radius_min,
                density,
            }) => {
                // A Fibonacci lattice of equal areas: every further agent stands farther out than those before.
                let angle = angle_deg.to_radians();
                let across = sequence(self.offset.x, 0.618_033_988_749_894_9) - 0.5;
                let area = (index as f32 + 0.5) / density;
                let radius = (radius_min * radius_min + 2.0 * area / angle).sqrt();
                let spread = 0.3 / density.sqrt();
                let disorder =
                    Vec2::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0)) * spread;
                let direction = heading_deg.to_radians() + across * angle;
                ground(center + facing(direction) * radius + disorder)
            }
            Some(Area::Rings {
                center,
                ring_spacing,
                ..
            }) => {
                let ring = self.ring_of(index);
                let first = self.ring_starts[ring];
                let end = self.ring_starts.get(ring + 1).unwrap_or(&self.count);
                let angle = (index - first) as f32 / (end - first) as f32 * TAU;
                let radius = (ring + 1) as f32 * ring_spacing;
                ground(center + Vec2::from_angle(angle) * radius)
            }
            None => self
                .group
                .positions
                .get(index)
                .copied()
                .unwrap_or(Vec3::ZERO),
        };
        let on_ground = Vec2::new(position.x, position.z);
        let heading = match (self.group.look_at, self.group.area) {
            (Some(point), _) => Some(heading_of(point - on_ground)),
            (None, Some(Area::Rings { center, .. })) => {
                let side = if self.is_clockwise(index) { -1.0 } else { 1.0 };
                Some(heading_of(on_ground - center) + side * FRAC_PI_2)
            }
            _ => self.group.heading_deg.map(f32::to_radians),
        };
        (position, heading)
    }

    /// The ring, counted from 0, that an agent stands on.
    fn ring_of(&self, index: usize) -> usize {
        self.ring_starts
            .partition_point(|&first| first <= index)
            .saturating_sub(1)
    }

    /// Agents of the innermost ring and every other one walk clockwise, seen from above.
    fn is_clockwise(&self, index: usize) -> bool {
        self.ring_of(index).is_multiple_of(2)
    }

    fn walk(
        &self,
        index: usize,
        position: Vec2,
        heading: f32,
        speed: f32,
        random: &mut Random,
    ) -> Walk {
        let motion = if speed > 0.0 {
            self.group.motion
        } else {
            Motion::Still
        };
        match (motion, self.group.area) {
            (Motion::Still, _) => Walk::Still { position, heading },
            (Motion::Straight, _) => Walk::Line {
                start: position,
                heading,
                wrap: self.bounds,
            },
            (Motion::Wander, Some(Area::Ring { center, .. })) => {
                Walk::around(position, center, random.unit() < 0.5)
            }
            (Motion::Wander, Some(Area::Rings { center, .. })) => {
                Walk::around(position, center, self.is_clockwise(index))
            }
            (
                Motion::Wander,
                Some(Area::Fan {
                    center,
                    heading_deg,
                    angle_deg,
                    radius_min,
                    ..
                }),
            ) => {
                let axis = facing(heading_deg.to_radians());
                let cos_side = (angle_deg.to_radians() / 2.0).cos();
                let holds = |p: Vec2| {
                    let radius = (p - center).length();
                    radius >= radius_min && (p - center).dot(axis) >= radius * cos_side
                };
                let inside = |middle: Vec2, half: Vec2| {
                    let corners = [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]];
                    (corners.iter()).all(|&corner| holds(middle + half * Vec2::from(corner)))
                };
                let middle = center + axis * position.distance(center);
                Walk::wander(position, middle, inside, random)
            }
            (Motion::Wander, _) => {
                let around = Rect {
                    min: position - 6.0,
                    max: position + 6.0,
                };
                let bounds = self.bounds.unwrap_or(around);
                let middle = (bounds.min + bounds.max) / 2.0;
                let inside = |center, half| bounds.contains(center, half);
                Walk::wander(position, middle, inside, random)
            }
        }
    }
}

/// Index of the first agent of each ring that has any of `count`, from the inside.
pub(super) fn ring_starts(count: usize, ring_spacing: f32, spacing: f32) -> Vec<usize> {
    let mut starts = Vec::new();
    let mut next = 0usize;
    while next < count {
        starts.push(next);
        let circumference = TAU * starts.len() as f32 * ring_spacing;
        next = next.saturating_add((circumference / spacing).max(1.0) as usize);
    }
    starts
}

fn ground(p: Vec2) -> Vec3 {
    Vec3::new(p.x, 0.0, p.y)
}
