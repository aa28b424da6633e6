//! Levels of 40 triangles beside the full mesh, in pictures of 32 pixels of height: does a character read as itself?
//!
//! `cargo test --release -p throng-bake --test likeness -- --ignored --nocapture` prints figures of all characters; `LOOK=robot,dog`
//! takes some, `SHEET=folder` writes what was compared, full mesh and level side by side, enlarged, `TRIANGLES=80` asks for another level.

mod common;

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::{Affine3A, Vec2, Vec3};
use throng_bake::character::{Character, Image};
use throng_bake::merge::merge;
use throng_bake::mesh::Mesh;
use throng_bake::pose;
use throng_bake::simplify::{PoseSet, simplify, triangles_at};

use common::{model, textures};

/// Height of the character at rest, pixels.
const HEIGHT_PX: f32 = 32.0;
/// Samples in a row and a column of a pixel.
const SAMPLES: usize = 4;
/// Pixels in a row and a column of a picture: room for arms and jumps.
const SIZE_PX: usize = 48;
/// Turns of the character to the viewer in degrees, and how far up in radians the viewer is.
const VIEWS: [(f32, f32); 5] = [
    (0.0, 0.05),
    (90.0, 0.05),
    (40.0, 0.3),
    (180.0, 0.1),
    (-130.0, 0.2),
];
/// Poses in clips beside the one at rest.
const CLIP_POSES: usize = 5;
/// Rows from the top that a person's head takes.
const HEAD_PX: usize = 5;
/// Side of a pixel on a sheet.
const ENLARGED: usize = 6;

/// Characters among the models that others have made.
const MODELS: [&str; 17] = [
    "glb/kaykit_rogue.glb",
    "glb/mannequin_50clips.glb",
    "glb/horse_textured.glb",
    "glb/khronos_fox.glb",
    "glb/wolf.glb",
    "obj/spider.obj",
    "glb/robot.glb",
    "glb/woman_adventurer.gltf",
    "awkward/mh_male_163joints_8infl.glb",
    "glb/ped_man_suit.glb",
    "glb/ped_man_hoodie.glb",
    "glb/ped_man_worker.glb",
    "glb/ped_woman_casual.glb",
    "glb/ped_woman_dress.glb",
    "glb/bull.glb",
    "glb/horse_flat.glb",
    "awkward/ShibaInu_step.glb",
];

/// Colour with coverage, premultiplied, 0 to 1 in gamma space.
type Picture = Vec<[f32; 4]>;

struct Level {
    character: Character,
    mesh: Mesh,
    /// Of the level: as drawn.
    triangles: Vec<[u32; 3]>,
    simplify_s: f32,
}

/// How far a level's pictures are from the full mesh's.
struct Likeness {
    /// Intersection over union of coverage: mean and least over all pictures.
    overlap: f32,
    least_overlap: f32,
    /// The same in the top rows, where people have their heads.
    head_overlap: f32,
    /// Root of the mean squared difference of colour where both are, 0 to 1 (black against white).
    color: f32,
}

fn load(name: &str) -> Option<Character> {
    if throng_bake::people::names().contains(&name) {
        return Some(throng_bake::people::build(name).expect("built in"));
    }
    model(name)
}

/// The finest level with at most `count` triangles, faces that are the same triangle counted once.
fn level(character: Character, count: usize) -> Level {
    let mut mesh = merge(&character).expect("merge");
    let start = Instant::now();
    let poses = PoseSet::choose(&character, &mesh, PoseSet::DEFAULT_COUNT);
    let sequence = simplify(&mut mesh, &poses, &textures(&character));
    let simplify_s = start.elapsed().as_secs_f32();
    let drawn = |k: usize| -> Vec<[u32; 3]> {
        let mut seen = HashSet::new();
        let mut triangles = triangles_at(&mesh, &sequence, k);
        triangles.retain(|t| {
            let first = (0..3).min_by_key(|&i| t[i]).expect("three");
            seen.insert([0, 1, 2].map(|i| t[(first + i) % 3]))
        });
        triangles
    };
    let steps: Vec<usize> = (0..=sequence.steps.len()).collect();
    let k = steps.partition_point(|&k| drawn(k).len() > count);
    // Steps of one error are one level.
    let error = |k: usize| sequence.steps[k - 1].error_m;
    let k = steps.partition_point(|&i| i == 0 || error(i) <= error(k.max(1)));
    let triangles = drawn(k - 1);
    Level {
        character,
        mesh,
        triangles,
        simplify_s,
    }
}

/// The pose at rest, and others of clips that move the character about and of the others in turn.
fn poses(c: &Character) -> Vec<Vec<Affine3A>> {
    let mut clips: Vec<_> = c.clips.iter().collect();
    let moves = |name: &str| {
        let name = name.to_lowercase();
        !["walk", "run", "gallop", "idle"]
            .iter()
            .any(|w| name.contains(w))
    };
    clips.sort_by_key(|clip| moves(&clip.name));
    let mut out = vec![pose::palette(c, None, 0.0)];
    for i in 0..if clips.is_empty() { 0 } else { CLIP_POSES } {
        let clip = clips[i % clips.len()];
        let time_s = clip.duration_s * (0.31 + i as f32 * 0.618).fract();
        out.push(pose::palette(c, Some(clip), time_s));
    }
    out
}

fn skinned(mesh: &Mesh, palette: &[Affine3A]) -> Vec<Vec3> {
    (0..mesh.vertex_count())
        .map(|v| {
            let joints = mesh.joints[v].map(u16::from);
            pose::skin(palette, joints, mesh.weights[v], mesh.positions[v])
        })
        .collect()
}

fn normals(mesh: &Mesh, palette: &[Affine3A]) -> Vec<Vec3> {
    (0..mesh.vertex_count())
        .map(|v| {
            let joints = mesh.joints[v].map(u16::from);
            let at = |p| pose::skin(palette, joints, mesh.weights[v], p);
            (at(mesh.normals[v]) - at(Vec3::ZERO)).normalize_or(Vec3::Y)
        })
        .collect()
}

struct Camera {
    back: Vec3,
    right: Vec3,
    up: Vec3,
    center: Vec3,
    scale: f32,
}

impl Camera {
    fn new(mesh: &Mesh, posed: &[Vec3], rest_height: f32, (turn, tall): (f32, f32)) -> Self {
        let (sin, cos) = turn.to_radians().sin_cos();
        let back = Vec3::new(tall.cos() * sin, tall.sin(), tall.cos() * cos);
        let right = Vec3::new(cos, 0.0, -sin);
        let used = mesh.triangles.iter().flatten().map(|&v| posed[v as usize]);
        let (low, high) = used.fold((Vec3::MAX, Vec3::MIN), |(a, b), p| (a.min(p), b.max(p)));
        Self {
            back,
            right,
            up: back.cross(right),
            center: 0.5 * (low + high),
            scale: HEIGHT_PX / rest_height,
        }
    }

    fn project(&self, p: Vec3) -> Vec3 {
        let p = (p - self.center) * self.scale;
        let half = 0.5 * SIZE_PX as f32;
        Vec3::new(
            half + p.dot(self.right),
            half - p.dot(self.up),
            p.dot(self.back),
        )
    }
}

fn picture(
    mesh: &Mesh,
    images: &[&Image],
    triangles: &[[u32; 3]],
    posed: &[Vec3],
    normals: &[Vec3],
    camera: &Camera,
) -> Picture {
    let size = SIZE_PX * SAMPLES;
    let mut depth = vec![f32::MIN; size * size];
    let mut shown = vec![[0.0f32; 4]; size * size];
    for t in triangles {
        let [a, b, c] = t.map(|v| {
            let p = camera.project(posed[v as usize]);
            Vec3::new(p.x * SAMPLES as f32, p.y * SAMPLES as f32, p.z)
        });
        let (ab, ac) = ((b - a).truncate(), (c - a).truncate());
        // Rows grow downwards, so that fronts turn clockwise.
        let twice = -ab.perp_dot(ac);
        let info = &mesh.submeshes[mesh.submesh[t[0] as usize] as usize];
        if twice.is_nan() || twice == 0.0 || (twice < 0.0 && !info.double_sided) {
            continue;
        }
        let range = |low: f32, high: f32| {
            (low - 0.5).ceil().max(0.0) as usize..((high + 0.5).ceil().max(0.0) as usize).min(size)
        };
        for y in range(a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y)) {
            for x in range(a.x.min(b.x).min(c.x), a.x.max(b.x).max(c.x)) {
                let p = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - a.truncate();
                let (u, v) = (-p.perp_dot(ac) / twice, -ab.perp_dot(p) / twice);
                let shares = [1.0 - u - v, u, v];
                if shares.iter().any(|&s| s < 0.0) {
                    continue;
                }
                let z = shares[0] * a.z + u * b.z + v * c.z;
                let i = y * size + x;
                if z <= depth[i] {
                    continue;
                }
                let Some(color) = look(mesh, images, *t, normals, shares) else {
                    continue;
                };
                depth[i] = z;
                shown[i] = color;
            }
        }
    }
    let mut out = vec![[0.0; 4]; SIZE_PX * SIZE_PX];
    for (i, sample) in shown.iter().enumerate() {
        let (x, y) = (i % size / SAMPLES, i / size / SAMPLES);
        for (sum, s) in out[y * SIZE_PX + x].iter_mut().zip(sample) {
            *sum += s / (SAMPLES * SAMPLES) as f32;
        }
    }
    out
}

/// Colour at a place of a triangle, lit from above and a side; none where it is cut out.
fn look(
    mesh: &Mesh,
    images: &[&Image],
    t: [u32; 3],
    normals: &[Vec3],
    shares: [f32; 3],
) -> Option<[f32; 4]> {
    let (mut color, mut uv, mut normal) = ([0.0; 4], Vec2::ZERO, Vec3::ZERO);
    for (v, share) in t.into_iter().zip(shares) {
        let v = v as usize;
        for (c, x) in color.iter_mut().zip(mesh.colors[v]) {
            *c += f32::from(x) / 255.0 * share;
        }
        uv += mesh.uvs[v] * share;
        normal += normals[v] * share;
    }
    let first = t[0] as usize;
    if let Some(image) = images.get(mesh.layers[first] as usize) {
        let uv = uv - uv.floor();
        let at = |x: f32, n: u32| ((x * n as f32) as u32).min(n - 1);
        let texel = at(uv.y, image.height) * image.width + at(uv.x, image.width);
        for (c, x) in color.iter_mut().zip(image.pixels[texel as usize]) {
            *c *= f32::from(x) / 255.0;
        }
    }
    let cutoff = mesh.submeshes[mesh.submesh[first] as usize].alpha_cutoff;
    if cutoff.is_some_and(|cutoff| color[3] < cutoff) {
        return None;
    }
    let sun = Vec3::new(0.45, 0.75, 0.5).normalize();
    let light = 0.6 + 0.4 * normal.normalize_or(Vec3::Y).dot(sun).max(0.0);
    Some([color[0] * light, color[1] * light, color[2] * light, 1.0])
}

/// Each picture of the full mesh with the level's.
fn pictures(l: &Level) -> Vec<[Picture; 2]> {
    let images = textures(&l.character);
    let mut out = Vec::new();
    let mut rest_height = 0.0;
    for palette in poses(&l.character) {
        let posed = skinned(&l.mesh, &palette);
        let normals = normals(&l.mesh, &palette);
        if rest_height == 0.0 {
            let used = l
                .mesh
                .triangles
                .iter()
                .flatten()
                .map(|&v| posed[v as usize]);
            let (low, high) = used.fold((Vec3::MAX, Vec3::MIN), |(a, b), p| (a.min(p), b.max(p)));
            // Long animals are not higher than they are long.
            rest_height = (high - low).y.max(0.8 * (high - low).max_element());
        }
        for view in VIEWS {
            let camera = Camera::new(&l.mesh, &posed, rest_height, view);
            let show = |triangles| picture(&l.mesh, &images, triangles, &posed, &normals, &camera);
            out.push([show(&l.mesh.triangles), show(&l.triangles)]);
        }
    }
    out
}

fn overlap(a: &[[f32; 4]], b: &[[f32; 4]]) -> f32 {
    let pairs = || a.iter().zip(b).map(|(a, b)| (a[3], b[3]));
    let both: f32 = pairs().map(|(a, b)| a.min(b)).sum();
    let any: f32 = pairs().map(|(a, b)| a.max(b)).sum();
    both / any.max(1e-6)
}

fn likeness(pictures: &[[Picture; 2]]) -> Likeness {
    let (mut overlaps, mut heads, mut colors) = (Vec::new(), Vec::new(), Vec::new());
    for [full, few] in pictures {
        let top = full.iter().position(|p| p[3] > 0.5).unwrap_or(0) / SIZE_PX;
        // What stands out over the head counts, too.
        let rows = 0..(top + HEAD_PX) * SIZE_PX;
        heads.push(overlap(&full[rows.clone()], &few[rows]));
        overlaps.push(overlap(full, few));
        let (mut both, mut color) = (0.0, 0.0);
        for (a, b) in full.iter().zip(few) {
            let common = a[3].min(b[3]);
            both += common;
            if common > 0.0 {
                let d = (0..3).map(|i| a[i] / a[3] - b[i] / b[3]).map(|d| d * d);
                color += common * d.sum::<f32>() / 3.0;
            }
        }
        colors.push(color / f32::max(both, 1e-6));
    }
    let mean = |x: &[f32]| x.iter().sum::<f32>() / x.len() as f32;
    Likeness {
        overlap: mean(&overlaps),
        least_overlap: overlaps.iter().copied().fold(1.0, f32::min),
        head_overlap: mean(&heads),
        color: mean(&colors).sqrt(),
    }
}

/// All pictures as rows of a pose each, full mesh and level beside each other.
fn write_sheet(pictures: &[[Picture; 2]], path: &Path) {
    let (columns, rows) = (2 * VIEWS.len(), pictures.len() / VIEWS.len());
    let side = (SIZE_PX * ENLARGED) as u32;
    let mut sheet = image::RgbImage::new(columns as u32 * side, rows as u32 * side);
    for (i, pair) in pictures.iter().enumerate() {
        for (k, picture) in pair.iter().enumerate() {
            let column = (i % VIEWS.len() * 2 + k) as u32;
            let row = (i / VIEWS.len()) as u32;
            for y in 0..side {
                for x in 0..side {
                    let at = y as usize / ENLARGED * SIZE_PX + x as usize / ENLARGED;
                    let [r, g, b, a] = picture[at];
                    let behind = [0.62, 0.66, 0.70].map(|c| c * (1.0 - a));
                    let pixel = [r + behind[0], g + behind[1], b + behind[2]];
                    let pixel = pixel.map(|c| (c * 255.0).round() as u8);
                    sheet.put_pixel(column * side + x, row * side + y, image::Rgb(pixel));
                }
            }
        }
    }
    sheet.save(path).expect("sheet");
}

#[test]
#[ignore = "figures to look at"]
fn print_figures() {
    let look = std::env::var("LOOK").unwrap_or_default();
    let count = std::env::var("TRIANGLES").map_or(40, |n| n.parse().expect("a number"));
    let sheets = std::env::var_os("SHEET").map(PathBuf::from);
    let names = throng_bake::people::names().into_iter().chain(MODELS);
    let mut all = Vec::new();
    for name in names {
        if !look.is_empty() && !look.split(',').any(|l| name.contains(l)) {
            continue;
        }
        let Some(character) = load(name) else {
            continue;
        };
        let level = level(character, count);
        let pictures = pictures(&level);
        let l = likeness(&pictures);
        let corners: HashSet<u32> = level.triangles.iter().flatten().copied().collect();
        println!(
            "{name:36} {:3} triangles {:3} vertices  overlap {:.3}  least {:.3}  head {:.3}  colour {:.3}  {:.2} s",
            level.triangles.len(),
            corners.len(),
            l.overlap,
            l.least_overlap,
            l.head_overlap,
            l.color,
            level.simplify_s
        );
        if let Some(folder) = &sheets {
            let stem = Path::new(name).file_stem().unwrap_or_default();
            let stem = stem.to_string_lossy();
            write_sheet(&pictures, &folder.join(format!("{stem}.png")));
        }
        all.push(l);
    }
    let mean = |of: fn(&Likeness) -> f32| all.iter().map(of).sum::<f32>() / all.len() as f32;
    println!(
        "mean overlap {:.3}, of the least {:.3}, head {:.3}, colour {:.3}",
        mean(|l| l.overlap),
        mean(|l| l.least_overlap),
        mean(|l| l.head_overlap),
        mean(|l| l.color)
    );
}
