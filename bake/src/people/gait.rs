//! How people idle, walk and run.

use std::f32::consts::TAU;

use glam::{Quat, Vec3};

use super::figure::{CHEST, Figure, HEAD, HIPS, NECK, SIDES, SPINE};
use super::ik::{Foot, Pose, Rig, Step, lowest_drop};
use super::params::Gait;
use crate::character::Clip;

/// Keys of a walking or running cycle: dense enough that straight interpolation keeps planted feet in place.
const CYCLE_KEYS: usize = 48;
/// The most of a leg's length that a step may take, so that knees never lock.
const REACH: f32 = 0.988;

/// What distinguishes one gait from another; angles in radians, lengths at the standard height.
struct Style {
    step: Step,
    /// Rise of the hips at mid-stance (walking: over a straight leg; running: negative, into a bent one).
    bob: f32,
    /// Sideways, towards the standing leg.
    sway: f32,
    /// Turn of the hips with the leg.
    hip_yaw: f32,
    /// Drop of the hip on the swinging side.
    hip_roll: f32,
    /// Turn of the shoulders against the hips.
    chest_yaw: f32,
    /// Forward lean of hips and chest.
    lean: f32,
    arm_swing: f32,
    /// Middle of the arms' swing, forward.
    arm_forward: f32,
    elbow: f32,
    /// More bend when the arm is in front.
    elbow_swing: f32,
    /// Angle between a hanging arm and the body.
    abduction: f32,
}

/// `idle`, `walk` and `run`, in the figure's final size.
pub fn person_clips(figure: &Figure, gait: &Gait, scale: f32) -> Vec<Clip> {
    let rig = Rig::new(&figure.joints());
    vec![
        idle(figure, &rig, gait, scale),
        cycle("walk", figure, &rig, gait, &walk(gait, scale), scale),
        cycle("run", figure, &rig, gait, &run(gait, scale), scale),
    ]
}

fn walk(gait: &Gait, scale: f32) -> Style {
    let speed = gait.walk_speed / scale;
    let stride = 1.32 * (speed / 1.35).powf(0.58);
    let brisk = (speed / 1.35).clamp(0.6, 1.3);
    Style {
        step: Step {
            speed,
            duration_s: stride / speed,
            duty: 0.60,
            strike_pitch: 0.34 * brisk,
            push_pitch: 0.95 * brisk.sqrt(),
            air_pitch: 0.85 * brisk,
            lift: 0.030,
            lead: -0.045,
        },
        bob: 0.016 * brisk,
        sway: 0.022 * gait.sway,
        hip_yaw: 0.11 * brisk,
        hip_roll: 0.055 * gait.sway,
        chest_yaw: 0.12 * gait.arm_swing * brisk,
        lean: 0.02,
        arm_swing: 0.42 * gait.arm_swing * brisk,
        arm_forward: 0.04,
        elbow: 0.26,
        elbow_swing: 0.22 * gait.arm_swing,
        abduction: 0.13,
    }
}

fn run(gait: &Gait, scale: f32) -> Style {
    let speed = gait.run_speed / scale;
    let fast = (speed / 3.2).clamp(0.6, 1.4);
    let duration_s = 0.80 - 0.028 * speed;
    Style {
        step: Step {
            speed,
            duration_s,
            duty: (0.45 + 0.07 * speed) / (speed * duration_s),
            strike_pitch: 0.10,
            push_pitch: 0.95,
            air_pitch: 1.15 * fast,
            lift: 0.155 * fast,
            lead: -0.090,
        },
        bob: -0.034,
        sway: 0.010 * gait.sway,
        hip_yaw: 0.16,
        hip_roll: 0.050 * gait.sway,
        chest_yaw: 0.22,
        lean: 0.10 + 0.06 * fast,
        arm_swing: 0.62 * (0.5 + 0.5 * gait.arm_swing) * fast.sqrt(),
        arm_forward: -0.12,
        elbow: 1.35,
        elbow_swing: 0.28,
        abduction: 0.20,
    }
}

/// The feet of the figure, `width` of the hip joints' distance apart.
fn feet(figure: &Figure, width: f32) -> [Foot; 2] {
    SIDES.map(|side| {
        let (ankle, ball) = (figure.leg(side, 2), figure.leg(side, 3));
        Foot {
            ankle: Vec3::new(ankle.x * width, ankle.y, ankle.z),
            heel: Vec3::new(0.0, -ankle.y, -0.068),
            ball: ball - ankle,
            tip: Vec3::new(0.0, -ball.y, 0.075),
        }
    })
}

fn cycle(name: &str, figure: &Figure, rig: &Rig, gait: &Gait, style: &Style, scale: f32) -> Clip {
    let feet = feet(figure, gait.step_width);
    // The highest hips with both legs in reach at all times.
    let drop = lowest_drop(CYCLE_KEYS, REACH, |drop, phase| {
        stride(figure, rig, gait, style, &feet, drop, phase).1
    });
    let speed = style.step.speed * scale;
    let duration_s = style.step.duration_s;
    rig.clip(name, duration_s, speed, CYCLE_KEYS, scale, |phase| {
        stride(figure, rig, gait, style, &feet, drop, phase).0
    })
}

/// The pose at `phase` of the left foot's cycle with the hips lowered by `drop`, and the longest reach of a leg.
fn stride(
    figure: &Figure,
    rig: &Rig,
    gait: &Gait,
    style: &Style,
    feet: &[Foot; 2],
    drop: f32,
    phase: f32,
) -> (Pose, f32) {
    let step = &style.step;
    // 1 at the left foot's strike, and 1 in the middle of its stance.
    let strike = (TAU * (phase - 0.02)).cos();
    let stance = (TAU * (phase - 0.5 * step.duty)).cos();
    let twice = (2.0 * TAU * (phase - 0.5 * step.duty)).cos();
    let mut pose = rig.rest();
    pose.origin += Vec3::new(style.sway * stance, style.bob * twice - drop, 0.0);
    let lean = |share: f32| Quat::from_rotation_x(style.lean * share);
    let hips = Quat::from_rotation_y(-style.hip_yaw * strike)
        * Quat::from_rotation_z(style.hip_roll * stance)
        * lean(0.6);
    let chest = Quat::from_rotation_y(style.chest_yaw * strike)
        * Quat::from_rotation_z(-0.35 * style.hip_roll * stance)
        * Quat::from_rotation_x(gait.stoop + 0.012 * twice)
        * lean(1.25);
    trunk(
        &mut pose,
        hips,
        chest,
        gait.stoop * 0.35 + style.lean * 0.25,
    );
    for side in SIDES {
        // An arm swings with the other side's leg, a little late.
        let swing = -side * (TAU * (phase - 0.045)).cos();
        let forward = style.arm_forward + style.arm_swing * swing;
        let elbow = style.elbow + style.elbow_swing * (0.5 + 0.5 * swing);
        arm(&mut pose, figure, side, forward, style.abduction, elbow);
    }
    let mut reach = 0f32;
    for (i, side) in SIDES.into_iter().enumerate() {
        let foot = step.foot(&feet[i], phase + 0.5 * i as f32);
        let upper = Figure::leg_joint(side);
        let pole = Vec3::new(side * 0.06, 0.0, 1.0);
        reach = reach.max(rig.reach(&mut pose, upper, foot.ankle, pole));
        pose.rotations[upper + 2] = foot.rotation();
        pose.rotations[upper + 3] = foot.toe_rotation();
    }
    (pose, reach)
}

/// Rotations of hips to head; spine and neck share what is between their neighbours.
fn trunk(pose: &mut Pose, hips: Quat, chest: Quat, head_pitch: f32) {
    let head = Quat::IDENTITY.slerp(chest, 0.12) * Quat::from_rotation_x(head_pitch);
    pose.rotations[HIPS] = hips;
    pose.rotations[SPINE] = hips.slerp(chest, 0.5);
    pose.rotations[CHEST] = chest;
    pose.rotations[NECK] = chest.slerp(head, 0.55);
    pose.rotations[HEAD] = head;
}

/// One arm: swung forward, `abduction` away from hanging straight down, elbow bent.
fn arm(pose: &mut Pose, figure: &Figure, side: f32, forward: f32, abduction: f32, elbow: f32) {
    let j = Figure::arm_joint(side);
    let chest = pose.rotations[CHEST];
    let d = figure.arm_direction(side);
    let hang = d.x.abs().atan2(-d.y) - abduction;
    let clavicle =
        chest * Quat::from_rotation_z(-side * 0.05) * Quat::from_rotation_y(-side * 0.18 * forward);
    let upper = clavicle
        * Quat::from_rotation_x(-forward)
        * Quat::from_rotation_z(-side * (hang - 0.05))
        * Quat::from_axis_angle(d, side * 0.12);
    let bend = d.cross(Vec3::Z);
    // Towards the palm, which faces the body.
    let curl = d.cross(bend * side);
    // A bent forearm turns inwards, across the body.
    let inward = Quat::from_axis_angle(d, side * (0.10 + 0.28 * elbow.min(1.5)));
    let fore = upper * inward * Quat::from_axis_angle(bend, elbow);
    let hand = fore * Quat::from_axis_angle(curl, 0.10);
    pose.rotations[j] = clavicle;
    pose.rotations[j + 1] = upper;
    pose.rotations[j + 2] = fore;
    pose.rotations[j + 3] = hand;
    pose.rotations[j + 4] = hand * Quat::from_axis_angle(curl, 0.35 + 0.35 * elbow.min(1.6));
}

fn idle(figure: &Figure, rig: &Rig, gait: &Gait, scale: f32) -> Clip {
    let feet = feet(figure, 1.12);
    rig.clip("idle", 4.0, 0.0, 40, scale, |phase| {
        let shift = (TAU * phase).sin();
        let breath = (2.0 * TAU * phase).sin();
        let mut pose = rig.rest();
        pose.origin += Vec3::new(0.014 * shift, -0.0045 - 0.002 * shift * shift, 0.0);
        let hips = Quat::from_rotation_z(0.020 * shift) * Quat::from_rotation_y(0.02 * shift);
        let chest = Quat::from_rotation_z(-0.018 * shift)
            * Quat::from_rotation_x(gait.stoop * 0.9 - 0.012 * breath);
        let look = 0.10 * (TAU * phase + 0.8).sin();
        trunk(&mut pose, hips, chest, gait.stoop * 0.3 - 0.01 * breath);
        pose.rotations[HEAD] = Quat::from_rotation_y(look) * pose.rotations[HEAD];
        for (i, side) in SIDES.into_iter().enumerate() {
            let forward = 0.03 + 0.02 * side * shift + 0.6 * gait.stoop;
            arm(
                &mut pose,
                figure,
                side,
                forward,
                0.11 - 0.006 * breath,
                0.22,
            );
            let upper = Figure::leg_joint(side);
            let pole = Vec3::new(side * 0.12, 0.0, 1.0);
            rig.reach(&mut pose, upper, feet[i].ankle, pole);
            pose.rotations[upper + 2] = Quat::IDENTITY;
            pose.rotations[upper + 3] = Quat::IDENTITY;
        }
        pose
    })
}
