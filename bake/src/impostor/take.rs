//! Takes the planned pictures, in batches, and decides what of a group's surface they show.
//!
//! A group's picture may show surface that only partly follows its joint: what lies inside the body's silhouette in enough
//! of the ways in which the body may lie around the group. So a bent elbow neither gapes nor sticks out.
//!
//! Source: Izquierdo 2014, §4.2.1 and §4.2.2, where a swept area decides; here it is a share of the realisations.

use super::build::{BuildError, ImpostorOptions};
use super::capture::{Capture, CaptureBatch, CapturedView};
use super::groups::Groups;
use super::picture::Picture;
use super::plan::{LEAST_WEIGHT, Plan, Shot};
use super::{PoseRange, pose, realise};
use crate::baked::{Baked, PaletteEntry};

/// Bytes of pictures that one batch asks for at most.
const BATCH_BYTES: u64 = 64 << 20;
/// Bytes of a pixel of an answer.
const PIXEL_BYTES: u64 = 8;
/// Palette entries of a batch, at which it is full.
const BATCH_ENTRIES: usize = 1 << 17;
/// Surface with this weight in a group is always in its pictures.
const OWN_WEIGHT: f32 = 0.9;
/// Without realisations: half, less an overlap that closes bent joints.
const PLAIN_WEIGHT: f32 = 0.35;
/// Surface that follows the group in part is shown where the share of the realisations that have the body there and its
/// weight sum to at least this: the less it follows the group, the surer it must be.
const SHOWN_SUM: f32 = 1.1;

/// One picture to ask for.
struct Question {
    shot: usize,
    /// Names a palette to whoever makes them; equal ones stand together.
    pose: usize,
    group: Option<u8>,
    supersample: u32,
}

/// Whom all questions are about.
struct Subject<'a> {
    baked: &'a Baked,
    groups: &'a Groups,
    shots: &'a [Shot],
}

/// Takes the pictures and averages them to cropped pictures, parallel to the plan's shots.
pub(super) fn take<E>(
    baked: &Baked,
    groups: &Groups,
    options: &ImpostorOptions,
    plan: &Plan,
    capture: &mut Capture<E>,
    progress: &mut dyn FnMut(f32),
) -> Result<Vec<Picture>, BuildError<E>> {
    let shots = &plan.shots;
    let sample_count = options.mask_samples as usize;
    let flat = |shot: &&Shot| shot.group.is_some();
    let mask_count = shots.iter().filter(flat).count() * sample_count;
    let total = (mask_count + shots.len()).max(1) as f32;
    let subject = Subject {
        baked,
        groups,
        shots,
    };
    let masks = masks(&subject, options, capture, &mut |n| {
        progress(n as f32 / total)
    })?;
    let questions: Vec<Question> = shots
        .iter()
        .enumerate()
        .map(|(shot, s)| Question {
            shot,
            pose: s.pose.map_or(0, |p| p as usize + 1),
            group: s.group,
            supersample: options.supersample,
        })
        .collect();
    let mut pictures = vec![Picture::default(); shots.len()];
    let palette = |pose: usize| match pose.checked_sub(1) {
        Some(pose) => pose_palette(baked, &plan.clip_poses, pose as u32),
        None => pose::bind_palette(baked),
    };
    let mut answer = |q: &Question, captured: &CapturedView| {
        let shot = &shots[q.shot];
        let picture = average(shot, captured, options.supersample, masks.get(q.shot));
        pictures[q.shot] = picture.cropped(options.margin(), options.multiple());
    };
    let mut heard = |n: usize| progress((mask_count + n) as f32 / total);
    ask(
        &subject,
        &questions,
        &palette,
        capture,
        &mut answer,
        &mut heard,
    )?;
    Ok(pictures)
}

/// How many of the realisations have the body at each texel of each group's pictures, `[shot][texel]`; empty without
/// realisations. Shots of groups come first.
fn masks<E>(
    subject: &Subject,
    options: &ImpostorOptions,
    capture: &mut Capture<E>,
    progress: &mut dyn FnMut(usize),
) -> Result<Vec<Vec<f32>>, BuildError<E>> {
    let count = options.mask_samples as usize;
    if count == 0 {
        return Ok(Vec::new());
    }
    let poses = realise::realisations(subject.baked, subject.groups, options.mask_samples);
    let mut questions = Vec::new();
    let mut shares = Vec::new();
    for (shot, s) in subject.shots.iter().enumerate() {
        let Some(group) = s.group else { break };
        shares.push(vec![0.0; (s.size.x * s.size.y) as usize]);
        questions.extend((0..count).map(|k| Question {
            shot,
            pose: group as usize * count + k,
            group: None,
            supersample: 1,
        }));
    }
    let palette = |pose: usize| poses[pose / count][pose % count].clone();
    let mut answer = |q: &Question, captured: &CapturedView| {
        for (share, color) in shares[q.shot].iter_mut().zip(&captured.color) {
            *share += f32::from(u8::from(color[3] > 0)) / count as f32;
        }
    };
    ask(
        subject,
        &questions,
        &palette,
        capture,
        &mut answer,
        progress,
    )?;
    Ok(shares)
}

/// Asks all questions in their order, in bounded batches; `answer` hears each answer, `progress` how many there were.
fn ask<E>(
    subject: &Subject,
    questions: &[Question],
    palette: &dyn Fn(usize) -> Vec<PaletteEntry>,
    capture: &mut Capture<E>,
    answer: &mut dyn FnMut(&Question, &CapturedView),
    progress: &mut dyn FnMut(usize),
) -> Result<(), BuildError<E>> {
    let mut next = 0;
    while next < questions.len() {
        progress(next);
        let mut batch = CaptureBatch {
            groups: subject.groups.of_joint.clone(),
            error: f32::INFINITY,
            ..CaptureBatch::default()
        };
        let mut asked = Vec::new();
        let mut bytes = 0;
        // By pose: where its palette stands in the batch.
        let mut posed = std::collections::HashMap::new();
        while let Some(question) = questions.get(next) {
            let shot = &subject.shots[question.shot];
            let samples = u64::from(question.supersample * question.supersample);
            let size = u64::from(shot.size.x * shot.size.y) * samples * PIXEL_BYTES;
            // The level of detail is one of the batch's: pictures of other texels wait for the next.
            let error = shot.texel * 0.5;
            let other = batch.error.is_finite() && (batch.error - error).abs() > 0.1 * error;
            let full = bytes + size > BATCH_BYTES || batch.poses.len() > BATCH_ENTRIES;
            if !asked.is_empty() && (other || full) {
                break;
            }
            next += 1;
            if size == 0 {
                continue;
            }
            bytes += size;
            batch.error = batch.error.min(error);
            let pose = *posed.entry(question.pose).or_insert_with(|| {
                batch.poses.extend(palette(question.pose));
                (batch.poses.len() / subject.baked.joints.len()) as u32 - 1
            });
            batch
                .views
                .push(shot.view(pose, question.group, question.supersample));
            asked.push(question);
        }
        if asked.is_empty() {
            continue;
        }
        let answers = capture(&batch).map_err(BuildError::Capture)?;
        check_answers(&batch, &answers)?;
        for (question, captured) in asked.into_iter().zip(&answers) {
            answer(question, captured);
        }
    }
    Ok(())
}

/// The palette of a pose of the clips.
fn pose_palette(baked: &Baked, clip_poses: &[PoseRange], pose: u32) -> Vec<PaletteEntry> {
    let clip = clip_poses
        .partition_point(|r| r.first_pose <= pose)
        .saturating_sub(1);
    let range = clip_poses[clip];
    pose::palette_at(
        baked,
        clip,
        (pose - range.first_pose) as f32 / range.pose_count as f32,
    )
}

fn check_answers<E>(batch: &CaptureBatch, answers: &[CapturedView]) -> Result<(), BuildError<E>> {
    if answers.len() != batch.views.len() {
        return Err(BuildError::Answer {
            picture: answers.len(),
            reason: "the pictures differ from those asked for in number",
        });
    }
    for (picture, (answer, view)) in answers.iter().zip(&batch.views).enumerate() {
        let pixels = view.size[0] as usize * view.size[1] as usize;
        if answer.color.len() != pixels || answer.surface.len() != pixels {
            return Err(BuildError::Answer {
                picture,
                reason: "its pixels and its size differ",
            });
        }
    }
    Ok(())
}

fn average(
    shot: &Shot,
    captured: &CapturedView,
    supersample: u32,
    shares: Option<&Vec<f32>>,
) -> Picture {
    let alpha = |weight: f32| (1.0 + 254.0 * weight) as u8;
    let (least, own, plain) = (alpha(LEAST_WEIGHT), alpha(OWN_WEIGHT), alpha(PLAIN_WEIGHT));
    let weight = |alpha: u8| (f32::from(alpha) - 1.0) / 254.0;
    let keep = |texel: usize, alpha: u8| match (shot.group, shares) {
        (None, _) => true,
        (Some(_), None) => alpha >= plain,
        (Some(_), Some(shares)) => {
            alpha >= own || (alpha >= least && shares[texel] + weight(alpha) >= SHOWN_SUM)
        }
    };
    Picture::average(
        captured,
        shot.corner,
        shot.texel,
        shot.size,
        supersample,
        keep,
    )
}
