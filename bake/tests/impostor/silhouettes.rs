//! Silhouettes of impostors against those of the mesh.

use glam::Vec3;
use throng_bake::baked::{Baked, PaletteEntry};
use throng_bake::impostor::build::{Built, ImpostorOptions};
use throng_bake::impostor::groups::Groups;
use throng_bake::impostor::pose::palette_at;
use throng_bake::impostor::{Impostors, Kind};

use crate::build::{baked, built};
use crate::capture::skinned;
use crate::compose::{Camera, Difference, compare, directions, impostor, mesh};
use crate::gaps::{Gap, GapKind, borders, gaps};

const HEIGHT_PX: f32 = 32.0;
const SIZE_PX: u32 = 96;

fn bounds(baked: &Baked, palette: &[PaletteEntry]) -> (Vec3, Vec3) {
    let points = skinned(baked, palette);
    let first = points[0].0;
    points
        .iter()
        .fold((first, first), |(a, b), p| (a.min(p.0), b.max(p.0)))
}

/// Pixels per unit, so that the first pose is as high as said.
fn scale(baked: &Baked) -> f32 {
    let (min, max) = bounds(baked, &palette_at(baked, 0, 0.0));
    HEIGHT_PX / (max.y - min.y)
}

fn camera(baked: &Baked, palette: &[PaletteEntry], direction: Vec3) -> Camera {
    let (min, max) = bounds(baked, palette);
    Camera::new(direction, (min + max) * 0.5, scale(baked), SIZE_PX)
}

/// Poses over all clips from `first` on.
fn poses(baked: &Baked, first: usize, count: usize) -> Vec<Vec<PaletteEntry>> {
    let clips = baked.clips.len() - first;
    (0..count)
        .map(|i| palette_at(baked, first + i % clips, (i as f32 * 0.618).fract()))
        .collect()
}

fn views() -> usize {
    std::env::var("VIEWS").map_or(40, |v| v.parse().unwrap())
}

struct Figures {
    mean_iou: f32,
    worst_iou: f32,
    holes: u32,
    stray: u32,
    bias: f32,
}

fn figures(all: &[Difference]) -> Figures {
    Figures {
        mean_iou: all.iter().map(|d| d.iou).sum::<f32>() / all.len() as f32,
        worst_iou: all.iter().map(|d| d.iou).fold(1.0, f32::min),
        holes: all.iter().map(|d| d.holes).sum(),
        stray: all.iter().map(|d| d.stray).sum(),
        bias: all.iter().map(|d| d.bias).sum::<f32>() / all.len() as f32,
    }
}

/// A pose, a direction, and what differs there.
type Measured = (usize, Vec3, Difference);

/// Differences, and gaps where joints of the flat impostors bend.
fn measure_flat(
    baked: &Baked,
    groups: &Groups,
    i: &Impostors,
    poses: &[Vec<PaletteEntry>],
    views: usize,
) -> (Vec<Measured>, Vec<(usize, Vec3, Gap)>) {
    let (mut out, mut found) = (Vec::new(), Vec::new());
    for (p, palette) in poses.iter().enumerate() {
        for direction in directions(views, -0.3) {
            let camera = camera(baked, palette, direction);
            let shown = impostor(i, Kind::Flat, palette, 0, &camera);
            let mesh = mesh(baked, palette, &camera);
            out.push((p, direction, compare(&mesh, &shown, SIZE_PX)));
            let joints = borders(baked, groups, palette, &camera);
            let gaps = gaps(&mesh, &shown, SIZE_PX, &joints);
            found.extend(gaps.into_iter().map(|g| (p, direction, g)));
        }
    }
    (out, found)
}

/// How many gaps there are of each kind, and their pixels.
fn count(gaps: &[(usize, Vec3, Gap)]) -> [(usize, u32); 3] {
    [GapKind::Hole, GapKind::Cut, GapKind::Notch].map(|kind| {
        let of_kind = || gaps.iter().filter(|g| g.2.kind == kind);
        (of_kind().count(), of_kind().map(|g| g.2.pixels).sum())
    })
}

fn measure_quad(baked: &Baked, i: &Impostors) -> Vec<Measured> {
    let mut out = Vec::new();
    for n in 0..20 {
        let clip = n % baked.clips.len();
        let range = i.clip_poses[clip];
        let phase = (n as f32 * 0.618).fract();
        let pose = (phase * range.pose_count as f32).round() as u32 % range.pose_count;
        let palette = palette_at(baked, clip, phase);
        for direction in directions(views(), -0.2) {
            let camera = camera(baked, &palette, direction);
            let shown = impostor(i, Kind::Quad, &palette, range.first_pose + pose, &camera);
            out.push((
                n,
                direction,
                compare(&mesh(baked, &palette, &camera), &shown, SIZE_PX),
            ));
        }
    }
    out
}

fn show(
    baked: &Baked,
    i: &Impostors,
    name: &str,
    poses: &[Vec<PaletteEntry>],
    pick: &[(usize, Vec3)],
) {
    let side = SIZE_PX * 4;
    let mut image = image::RgbImage::new(side * pick.len() as u32, side * 2);
    for (n, (p, direction)) in pick.iter().enumerate() {
        let palette = &poses[*p];
        let mut camera = camera(baked, palette, *direction);
        (camera.scale, camera.size) = (camera.scale * 8.0, side);
        for (row, pixels) in [
            mesh(baked, palette, &camera),
            impostor(i, Kind::Flat, palette, 0, &camera),
        ]
        .iter()
        .enumerate()
        {
            for (k, p) in pixels.iter().enumerate() {
                let (x, y) = (k as u32 % side, k as u32 / side);
                let color = if p[3] > 0 {
                    [p[0], p[1], p[2]]
                } else {
                    [90, 90, 200]
                };
                image.put_pixel(
                    n as u32 * side + x,
                    row as u32 * side + y,
                    image::Rgb(color),
                );
            }
        }
    }
    image
        .save(
            std::env::temp_dir().join(format!("throng_silhouettes_{}.png", name.replace('/', "_"))),
        )
        .unwrap();
}

/// The character with its first clips only.
fn with_clips(baked: &Baked, count: usize) -> Baked {
    let mut fewer = baked.clone();
    fewer.clips.truncate(count);
    let frames: u32 = fewer.clips.iter().map(|c| c.frame_count).sum();
    fewer.palette.truncate(frames as usize * fewer.joints.len());
    fewer
}

/// Clips that the masks never saw, from directions all around: one in trousers, and one in a dress, whose skirt hangs between
/// the groups of both legs and the hips.
#[test]
fn flat_impostors_keep_the_silhouette_in_clips_unseen_at_capture() {
    for (name, mean_iou, worst_iou) in [("man_suit", 0.9, 0.75), ("woman_dress", 0.87, 0.65)] {
        let baked = baked(name).unwrap();
        let known = with_clips(&baked, 2);
        let options = ImpostorOptions {
            kinds: vec![Kind::Flat],
            memory_limit_bytes: ImpostorOptions::default().memory_limit_bytes / 6,
            ..ImpostorOptions::default()
        };
        let (groups, i) = (Groups::by_rule(&known), built(&known, &options).impostors);
        let unseen = baked.clips.len() - 1;
        let poses: Vec<_> = (0..10)
            .map(|p| palette_at(&baked, unseen, p as f32 / 10.0))
            .collect();
        let (all, gaps) = measure_flat(&baked, &groups, &i, &poses, 20);
        let f = figures(&all.iter().map(|d| d.2).collect::<Vec<_>>());
        let said = format!(
            "{name}: mean {:.3}, worst {:.3}, gaps {:?}",
            f.mean_iou,
            f.worst_iou,
            count(&gaps)
        );
        println!("{said}");
        assert!(f.mean_iou >= mean_iou && f.worst_iou >= worst_iou, "{said}");
        let [holes, cuts, _] = count(&gaps);
        assert_eq!([holes.0, cuts.0], [0, 0], "{said}");
        // The measures see what they should: without a thigh the outline is worse, and the leg hangs in nothing.
        let mut maimed = i.clone();
        let thigh = |q: &throng_bake::impostor::Quad| q.name == "thigh_l";
        let lost = (i.quads.iter().position(thigh)).expect("a group of its own");
        let view_count = i.view_sets[i.quads[lost].view_set as usize]
            .directions
            .len();
        for tile in &mut maimed.tiles[i.quads[lost].first_tile as usize..][..view_count] {
            tile.size = [0; 2];
        }
        let (all, gaps) = measure_flat(&baked, &groups, &maimed, &poses[..4], 20);
        let worse = figures(&all.iter().map(|d| d.2).collect::<Vec<_>>());
        assert!(worse.mean_iou < f.mean_iou - 0.01, "{name}");
        if name == "man_suit" {
            let [holes, cuts, notches] = count(&gaps);
            assert!(holes.0 + cuts.0 + notches.0 > 10, "{name}");
        }
    }
}

/// Options with what `CONFIG` says, such as `quad_view_cuts=4 quad_texels_per_height=32`.
fn options() -> ImpostorOptions {
    let mut o = ImpostorOptions::default();
    let config = std::env::var("CONFIG").unwrap_or_default();
    for (key, value) in config.split_whitespace().filter_map(|w| w.split_once('=')) {
        let number: f32 = value.parse().unwrap();
        match key {
            "body_view_cuts" => o.body_view_cuts = number as u32,
            "head_view_cuts" => o.head_view_cuts = number as u32,
            "quad_view_cuts" => o.quad_view_cuts = number as u32,
            "quad_lowest_y" => o.quad_lowest_y = number,
            "texels_per_height" => o.texels_per_height = number,
            "quad_texels_per_height" => o.quad_texels_per_height = number,
            "quad_poses_per_clip" => o.quad_poses_per_clip = number as u32,
            "mask_samples" => o.mask_samples = number as u32,
            "memory" => o.memory_limit_bytes = number as u64,
            "mips" => o.mip_count = number as u32,
            other => panic!("{other}"),
        }
    }
    o
}

/// Of the characters in `LOOK`: `flat` in clips that its masks never saw, `quad` in all clips.
#[test]
#[ignore = "prints; for tuning"]
fn print_figures() {
    let names = std::env::var("LOOK").unwrap_or_else(|_| "man_suit".into());
    let kinds = std::env::var("KINDS").unwrap_or_else(|_| "fq".into());
    for name in names.split(',') {
        let Some(baked) = baked(name) else { return };
        if kinds.contains('f') {
            let clips = baked.clips.len();
            let known = clips.div_ceil(2);
            // As much memory as it gets beside the other kind.
            let options = ImpostorOptions {
                kinds: vec![Kind::Flat],
                memory_limit_bytes: options().memory_limit_bytes / 6,
                ..options()
            };
            let fewer = with_clips(&baked, known);
            let (groups, built) = (Groups::by_rule(&fewer), built(&fewer, &options));
            let first_unseen = if known < clips { known } else { 0 };
            let poses = poses(&baked, first_unseen, 20);
            let (all, mut gaps) = measure_flat(&baked, &groups, &built.impostors, &poses, views());
            let worst = say(name, "flat", &built, &all);
            let [holes, cuts, notches] = count(&gaps);
            println!("     holes and their pixels {holes:?}, cuts {cuts:?}, notches {notches:?}");
            // The worst, then gaps: holes and cuts first, the largest first.
            gaps.sort_by_key(|g| (g.2.kind == GapKind::Notch, std::cmp::Reverse(g.2.pixels)));
            for (pose, direction, gap) in gaps.iter().take(6) {
                println!("     pose {pose} from {direction:.2}: {gap:?}");
            }
            let worst = [0, 1, all.len() / 50].map(|n| (worst[n].0, worst[n].1));
            let gaps = gaps.iter().take(5).map(|g| (g.0, g.1));
            let pick: Vec<_> = worst.into_iter().chain(gaps).collect();
            show(&baked, &built.impostors, name, &poses, &pick);
        }
        if kinds.contains('q') {
            let options = ImpostorOptions {
                kinds: vec![Kind::Quad],
                memory_limit_bytes: options().memory_limit_bytes * 5 / 6,
                ..options()
            };
            let built = built(&baked, &options);
            let all = measure_quad(&baked, &built.impostors);
            say(name, "quad", &built, &all);
        }
    }
}

/// Prints, and sorts by overlap.
fn say(name: &str, kind: &str, built: &Built, all: &[Measured]) -> Vec<Measured> {
    let f = figures(&all.iter().map(|d| d.2).collect::<Vec<_>>());
    println!(
        "{name} {kind}: mean IoU {:.3}, worst {:.3}, holes {}, stray {}, bias {:.3}; {} tiles, {} bytes {:?}",
        f.mean_iou,
        f.worst_iou,
        f.holes,
        f.stray,
        f.bias,
        built.impostors.tiles.len(),
        built.impostors.atlas.size_bytes(),
        built.warnings
    );
    let mut worst = all.to_vec();
    worst.sort_by(|a, b| a.2.iou.total_cmp(&b.2.iou));
    for (p, d, x) in &worst[..2] {
        println!("     pose {p} from {d:.2}: {x:?}");
    }
    worst
}
