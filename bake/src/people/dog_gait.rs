//! How a dog idles, walks in four beats and trots in diagonal pairs.

use std::f32::consts::TAU;

use glam::{Quat, Vec3};

use super::dog::{CHEST, FORE, FORELEG, HEAD, HIND, HINDLEG, HIPS, NECK, SPINE, TAIL, first_joint};
use super::figure::SIDES;
use super::ik::{Foot, FootPose, Pose, Rig, Step, lowest_drop};
use crate::character::Clip;

const CYCLE_KEYS: usize = 40;
/// The most of a leg's length that a step may take.
const REACH: f32 = 0.985;

/// `idle`, `walk` and `run` in the dog's final size; speeds in metres per second.
pub fn clips(rig: &Rig, walk_speed: f32, run_speed: f32, scale: f32) -> Vec<Clip> {
    vec![
        idle(rig, scale),
        cycle("walk", rig, &walk(walk_speed / scale), scale),
        cycle("run", rig, &trot(run_speed / scale), scale),
    ]
}

/// A gait: how feet step, when, and how the body follows.
struct Style {
    hind: Step,
    fore: Step,
    /// Phases of left hind, right hind, left fore, right fore.
    phases: [f32; 4],
    bob: f32,
    /// Turn of the hips and the chest with their legs.
    yaw: f32,
    /// Rise and fall of the head.
    nod: f32,
    wag: f32,
}

/// Four beats: left hind, left fore, right hind, right fore.
fn walk(speed: f32) -> Style {
    let stride = 0.66 * (speed / 1.1).powf(0.55);
    let step = Step {
        speed,
        duration_s: stride / speed,
        duty: 0.61,
        strike_pitch: 0.0,
        push_pitch: 0.60,
        air_pitch: 0.75,
        lift: 0.035,
        lead: -0.015,
    };
    Style {
        hind: Step {
            push_pitch: 0.55,
            air_pitch: 0.55,
            lead: -0.005,
            ..step
        },
        fore: Step {
            push_pitch: 0.75,
            air_pitch: 1.25,
            lead: -0.010,
            ..step
        },
        phases: [0.0, 0.5, 0.75, 0.25],
        bob: 0.006,
        yaw: 0.06,
        nod: 0.06,
        wag: 0.30,
    }
}

/// Two beats: diagonal pairs, with a moment in the air between them.
fn trot(speed: f32) -> Style {
    let duration_s = 0.52 - 0.030 * speed;
    let step = Step {
        speed,
        duration_s,
        duty: (0.30 + 0.035 * speed) / (speed * duration_s),
        strike_pitch: 0.0,
        push_pitch: 0.85,
        air_pitch: 1.0,
        lift: 0.060,
        lead: -0.040,
    };
    Style {
        hind: Step {
            push_pitch: 0.70,
            air_pitch: 0.70,
            ..step
        },
        fore: Step {
            push_pitch: 0.90,
            air_pitch: 1.70,
            lift: 0.075,
            ..step
        },
        phases: [0.0, 0.5, 0.5, 0.0],
        bob: -0.018,
        yaw: 0.05,
        nod: 0.03,
        wag: 0.12,
    }
}

fn feet() -> [Foot; 2] {
    let foot = |ankle: [f32; 3], ball: [f32; 3]| {
        let (ankle, ball) = (Vec3::from(ankle), Vec3::from(ball));
        Foot {
            ankle,
            heel: ball - ankle,
            ball: ball - ankle,
            tip: Vec3::new(0.0, -0.020, 0.032),
        }
    };
    [foot(HINDLEG[2], HINDLEG[3]), foot(FORELEG[3], FORELEG[4])]
}

fn cycle(name: &str, rig: &Rig, style: &Style, scale: f32) -> Clip {
    let drop = lowest_drop(CYCLE_KEYS, REACH, |drop, phase| {
        stride(rig, style, drop, phase).1
    });
    let speed = style.hind.speed * scale;
    rig.clip(
        name,
        style.hind.duration_s,
        speed,
        CYCLE_KEYS,
        scale,
        |phase| stride(rig, style, drop, phase).0,
    )
}

fn stride(rig: &Rig, style: &Style, drop: f32, phase: f32) -> (Pose, f32) {
    let wave = |at: f32| (TAU * (phase - at)).cos();
    let hind = wave(style.phases[0]);
    let fore = wave(style.phases[2]);
    let twice = (2.0 * TAU * (phase - 0.5 * style.hind.duty)).cos();
    let mut pose = rig.rest();
    pose.origin += Vec3::new(0.004 * wave(0.3), style.bob * twice - drop, 0.0);
    let pitch = Quat::from_rotation_x(0.012 * (2.0 * TAU * phase).sin());
    let hips = pitch
        * Quat::from_rotation_y(-style.yaw * hind)
        * Quat::from_rotation_z(0.035 * wave(style.phases[0] + 0.5 * style.hind.duty));
    let chest = pitch * Quat::from_rotation_y(-0.6 * style.yaw * fore);
    body_pose(
        &mut pose,
        hips,
        chest,
        style.nod * twice,
        style.wag * wave(0.1),
        0.0,
    );
    let reach = plant(rig, &mut pose, |leg, foot| {
        let step = if leg < 2 { &style.hind } else { &style.fore };
        step.foot(foot, phase - style.phases[leg])
    });
    (pose, reach)
}

fn body_pose(pose: &mut Pose, hips: Quat, chest: Quat, nod: f32, wag: f32, look: f32) {
    pose.rotations[HIPS] = hips;
    pose.rotations[SPINE] = hips.slerp(chest, 0.5);
    pose.rotations[CHEST] = chest;
    pose.rotations[NECK] = chest * Quat::from_rotation_x(0.10 + nod);
    pose.rotations[HEAD] = Quat::from_rotation_y(look) * Quat::from_rotation_x(0.06 - 0.5 * nod);
    let mut tail = hips;
    for i in 0..3 {
        tail *= Quat::from_rotation_y(wag * (0.6 + 0.2 * i as f32)) * Quat::from_rotation_x(0.10);
        pose.rotations[TAIL + i] = tail;
    }
}

/// Puts all four feet where `foot` says (legs in the order of [`Style::phases`]); returns the longest reach.
fn plant(rig: &Rig, pose: &mut Pose, foot: impl Fn(usize, &Foot) -> FootPose) -> f32 {
    let feet = feet();
    let mut longest = 0f32;
    for leg in 0..4 {
        let side = SIDES[leg % 2];
        let mut shape = feet[leg / 2];
        shape.ankle.x *= side;
        let made = foot(leg, &shape);
        let (upper, pole) = if leg < 2 {
            (first_joint(HIND, 4, side), Vec3::new(side * 0.08, 0.0, 1.0))
        } else {
            // The scapula swings with its leg.
            let scapula = first_joint(FORE, 5, side);
            let swing = (made.ankle.z - shape.ankle.z) * 1.3;
            pose.rotations[scapula] = pose.rotations[CHEST] * Quat::from_rotation_x(-swing);
            (scapula + 1, Vec3::new(side * 0.08, 0.0, -1.0))
        };
        longest = longest.max(rig.reach(pose, upper, made.ankle, pole));
        pose.rotations[upper + 2] = made.rotation();
        pose.rotations[upper + 3] = made.toe_rotation();
    }
    longest
}

fn idle(rig: &Rig, scale: f32) -> Clip {
    rig.clip("idle", 4.0, 0.0, 40, scale, |phase| {
        let slow = (TAU * phase).sin();
        let breath = (3.0 * TAU * phase).sin();
        let mut pose = rig.rest();
        pose.origin += Vec3::new(0.004 * slow, -0.012, 0.0);
        let hips = Quat::from_rotation_z(0.015 * slow);
        let chest = Quat::from_rotation_x(0.006 * breath);
        let wag = 0.35 * (6.0 * TAU * phase).sin();
        body_pose(
            &mut pose,
            hips,
            chest,
            -0.02 + 0.02 * breath,
            wag,
            0.22 * (TAU * phase + 0.6).sin(),
        );
        plant(rig, &mut pose, |_, foot| FootPose {
            ankle: foot.ankle,
            pitch: 0.0,
            toe_pitch: 0.0,
        });
        pose
    })
}
