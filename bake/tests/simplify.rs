//! Merging and simplification on meshes made by hand: what must hold for any character.

mod common;

use std::collections::{HashMap, HashSet};

use glam::{Affine3A, Mat4, Quat, Vec2, Vec3};
use throng_bake::character::{Alpha, Character, Image, Joint, Material, Node, Part, Transform};
use throng_bake::error::BakeError;
use throng_bake::merge::{merge, used_images};
use throng_bake::mesh::{CollapseSequence, Mesh};
use throng_bake::simplify::{Pose, PoseSet, simplify, triangles_at};

use common::{model, textures};

/// A character of one part per `(material, triangles soup)` with `joint_count` joints and no clips.
fn character(parts: Vec<Part>, materials: Vec<Material>, joint_count: usize) -> Character {
    let node = |parent| Node {
        name: String::new(),
        parent,
        rest: Transform::IDENTITY,
    };
    let c = Character {
        name: "hand-made".into(),
        parts,
        materials,
        nodes: vec![node(None); joint_count],
        joints: (0..joint_count as u32)
            .map(|node| Joint {
                node,
                joint_from_bind: Mat4::IDENTITY,
            })
            .collect(),
        ..Default::default()
    };
    c.validate("hand-made".as_ref()).expect("valid");
    c
}

/// A tube of `rings` rings of `sides` vertices along Y from 0 to 2 with closed ends, bending at its middle from joint 0 to
/// joint 1 (joint `first` and `first + 1`), its seam duplicated with UVs 0 and 1.
fn tube(sides: usize, rings: usize, at: Vec3, radius: f32, first: u16) -> Part {
    let mut p = Part::default();
    for r in 0..rings {
        for s in 0..=sides {
            let y = 2.0 * r as f32 / (rings - 1) as f32;
            let angle = std::f32::consts::TAU * (s % sides) as f32 / sides as f32;
            let normal = Vec3::new(angle.cos(), 0.0, -angle.sin());
            let bend = ((y - 0.8) / 0.4).clamp(0.0, 1.0);
            p.positions.push(at + normal * radius + Vec3::Y * y);
            p.normals.push(normal);
            p.uvs.push(Vec2::new(s as f32 / sides as f32, y / 2.0));
            p.joints.push([first, first + 1, 0, 0]);
            p.weights.push([1.0 - bend, bend, 0.0, 0.0]);
        }
    }
    let row = sides as u32 + 1;
    for r in 0..rings as u32 - 1 {
        for s in 0..sides as u32 {
            let a = r * row + s;
            p.triangles.push([a, a + 1, a + row]);
            p.triangles.push([a + 1, a + row + 1, a + row]);
        }
    }
    for s in 1..sides as u32 - 1 {
        p.triangles.push([0, s + 1, s]);
        let top = (rings as u32 - 1) * row;
        p.triangles.push([top, top + s, top + s + 1]);
    }
    p
}

/// Rest, and the second of each pair of joints bent by 90 degrees.
fn bent(joint_count: usize) -> PoseSet {
    let pose = |angle: f32| Pose {
        palette: (0..joint_count)
            .map(|j| {
                let turn = Quat::from_rotation_x(if j % 2 == 1 { angle } else { 0.0 });
                Affine3A::from_translation(Vec3::Y)
                    * Affine3A::from_quat(turn)
                    * Affine3A::from_translation(-Vec3::Y)
            })
            .collect(),
        weight: 0.5,
    };
    PoseSet {
        poses: vec![pose(0.0), pose(1.57)],
        ..PoseSet::default()
    }
}

/// Everything that the documentation of `simplify` guarantees.
fn check(mesh: &Mesh, s: &CollapseSequence) {
    let mut dead = vec![false; mesh.vertex_count()];
    let mut error = 0.0;
    for step in &s.steps {
        let (v, t) = (step.vertex as usize, step.target as usize);
        assert_ne!(v, t);
        assert!(!dead[v] && !dead[t], "{step:?}: both ends are alive");
        assert_eq!(mesh.submesh[v], mesh.submesh[t], "{step:?}");
        assert!(step.error_m >= error && step.error_m.is_finite());
        error = step.error_m;
        dead[v] = true;
    }
    for submesh in 0..mesh.submeshes.len() {
        let roots = (0..dead.len()).filter(|&v| !dead[v] && mesh.submesh[v] as usize == submesh);
        assert_eq!(roots.count(), 1);
    }
    assert!(triangles_at(mesh, s, s.steps.len()).is_empty());
    assert_eq!(triangles_at(mesh, s, 0), mesh.triangles);
    if let Some(r) = &s.replacement {
        assert!(s.steps[r.step - 1].error_m < s.steps[r.step].error_m);
        let all: HashSet<u32> = mesh.triangles.iter().flatten().copied().collect();
        let new: HashSet<u32> = r.triangles.iter().flatten().copied().collect();
        assert!(all.is_disjoint(&new), "they wait until then");
        assert!(r.triangles.len() <= triangles_at(mesh, s, r.step).len());
    }
}

/// Edges by position that do not have a face on either side.
fn open_edges(mesh: &Mesh, triangles: &[[u32; 3]]) -> usize {
    let at = |v: u32| mesh.positions[v as usize].to_array().map(f32::to_bits);
    let mut edges = HashMap::new();
    for t in triangles {
        for i in 0..3 {
            let (a, b) = (at(t[i]), at(t[(i + 1) % 3]));
            *edges.entry((a.min(b), a.max(b))).or_insert(0i32) += if a < b { 1 } else { -1 };
        }
    }
    edges.values().filter(|&&n| n != 0).count()
}

/// Steps after which at most `count` triangles are left.
fn steps_for(mesh: &Mesh, s: &CollapseSequence, count: usize) -> usize {
    (0..=s.steps.len())
        .find(|&k| triangles_at(mesh, s, k).len() <= count)
        .expect("everything collapses in the end")
}

#[test]
fn a_flat_grid_becomes_two_triangles_without_error() {
    let n = 9;
    let mut p = Part::default();
    for i in 0..n * n {
        let at = Vec3::new((i % n) as f32, (i / n) as f32, 0.0);
        p.positions.push(at);
        p.normals.push(Vec3::Z);
        p.joints.push([0; 4]);
        p.weights.push([1.0, 0.0, 0.0, 0.0]);
    }
    for y in 0..n as u32 - 1 {
        for x in 0..n as u32 - 1 {
            let a = y * n as u32 + x;
            p.triangles.push([a, a + 1, a + n as u32 + 1]);
            p.triangles.push([a, a + n as u32 + 1, a + n as u32]);
        }
    }
    let mut mesh = merge(&character(vec![p], vec![Material::default()], 1)).expect("merge");
    assert_eq!((mesh.vertex_count(), mesh.triangles.len()), (81, 128));
    let s = simplify(&mut mesh, &bent(1), &[]);
    check(&mesh, &s);
    let k = steps_for(&mesh, &s, 2);
    assert!(s.steps[k - 1].error_m < 1e-3, "{}", s.steps[k - 1].error_m);
    let triangles = triangles_at(&mesh, &s, k);
    assert_eq!(triangles.len(), 2);
    let area: f32 = triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
            0.5 * (b - a).cross(c - a).z
        })
        .sum();
    assert!((area - 64.0).abs() < 1e-3, "the corners stay: {area}");
}

#[test]
fn a_tube_keeps_its_bend() {
    let mut mesh = merge(&character(
        vec![tube(12, 33, Vec3::ZERO, 0.2, 0)],
        vec![Material::default()],
        2,
    ))
    .expect("merge");
    assert_eq!(
        mesh.vertex_count(),
        12 * 33,
        "the seam is not visible without a texture"
    );
    let s = simplify(&mut mesh, &bent(2), &[]);
    check(&mesh, &s);
    let k = steps_for(&mesh, &s, 80);
    let triangles = triangles_at(&mesh, &s, k);
    assert_eq!(open_edges(&mesh, &triangles), 0);
    // What is straight in every pose needs no ring between its ends; the bend does.
    let heights: Vec<f32> = triangles
        .iter()
        .flatten()
        .map(|&v| mesh.positions[v as usize].y)
        .collect();
    let within = |low: f32, high: f32| heights.iter().filter(|&&y| y > low && y < high).count();
    assert!(within(0.7, 1.3) > 4 * (within(0.1, 0.7) + within(1.3, 1.9)));
}

/// A tube of so many rings, cut in the middle: the upper half has the second material.
fn halves(rings: usize) -> [Part; 2] {
    let whole = tube(16, rings, Vec3::ZERO, 0.3, 0);
    let mut halves = [whole.clone(), whole.clone()];
    halves[1].material = 1;
    for (i, half) in halves.iter_mut().enumerate() {
        half.triangles.retain(|t| {
            let middle: f32 = t.iter().map(|&v| whole.positions[v as usize].y).sum();
            (middle / 3.0 > 1.0) == (i == 1)
        });
    }
    halves
}

#[test]
fn submeshes_that_touch_do_not_crack() {
    // The two halves of a tube in two materials, one of them double-sided: two submeshes with a common border.
    let halves = halves(17);
    let double = Material {
        name: "double".into(),
        double_sided: true,
        ..Default::default()
    };
    let mut mesh = merge(&character(
        halves.into(),
        vec![Material::default(), double],
        2,
    ))
    .expect("merge");
    assert_eq!(mesh.submeshes.len(), 2);
    assert_eq!(open_edges(&mesh, &mesh.triangles), 0);
    let s = simplify(&mut mesh, &bent(2), &[]);
    check(&mesh, &s);
    for k in 0..s.steps.len() {
        // Steps with the same error happen at once.
        if k > 0 && s.steps[k].error_m > s.steps[k - 1].error_m {
            assert_eq!(
                open_edges(&mesh, &triangles_at(&mesh, &s, k)),
                0,
                "step {k}"
            );
        }
    }
}

#[test]
fn a_coarse_tube_is_as_thick_as_the_full_one() {
    let part = tube(24, 25, Vec3::ZERO, 0.3, 0);
    let mut mesh = merge(&character(vec![part], vec![Material::default()], 2)).expect("merge");
    let full = mesh.vertex_count();
    let s = simplify(&mut mesh, &bent(2), &[]);
    check(&mesh, &s);
    assert!(mesh.vertex_count() > full, "vertices for coarse levels");
    let volume = |triangles: &[[u32; 3]]| -> f32 {
        let at = |v: u32| mesh.positions[v as usize];
        let parts = triangles.iter().map(|t| {
            let [a, b, c] = t.map(at);
            a.dot(b.cross(c)) / 6.0
        });
        parts.sum()
    };
    let level = triangles_at(&mesh, &s, steps_for(&mesh, &s, 60));
    // Of a prism with its corners on the tube, as half-edge collapses leave it, a tenth to a third is missing.
    let share = volume(&level) / volume(&mesh.triangles);
    assert!((0.93..1.07).contains(&share), "{share} of the volume");
    // And nothing stands out of the box of the full mesh.
    for &v in level.iter().flatten() {
        let p = mesh.positions[v as usize];
        let radius = 0.3 + 1e-4;
        assert!(p.x.abs() <= radius && p.z.abs() <= radius && (-1e-4..=2.0001).contains(&p.y));
    }
}

#[test]
fn coarse_levels_show_body_parts_by_their_area() {
    // A tube in two colours, split along its middle: no vertex of a coarse level mixes them.
    let halves = halves(33);
    let colored = |r: f32, b: f32| Material {
        base_color: [r, 0.0, b, 1.0],
        ..Default::default()
    };
    let materials = vec![colored(1.0, 0.0), colored(0.0, 1.0)];
    let mut mesh = merge(&character(halves.into(), materials, 2)).expect("merge");
    assert_eq!(mesh.submeshes.len(), 1);
    let s = simplify(&mut mesh, &bent(2), &[]);
    check(&mesh, &s);
    let level = triangles_at(&mesh, &s, steps_for(&mesh, &s, 60));
    let mut both = [false; 2];
    for &v in level.iter().flatten() {
        let part = mesh.body_parts[v as usize] as usize;
        both[part] = true;
        let pure = [[255, 0, 0, 255], [0, 0, 255, 255]][part];
        assert_eq!(mesh.colors[v as usize], pure);
    }
    assert_eq!(both, [true; 2]);
}

/// Colour, 0 to 1, of the surface of `triangles` in gamma space, mean by area, and the share of them that has a texture.
fn mean_color(mesh: &Mesh, triangles: &[[u32; 3]], images: &[&Image]) -> (Vec3, f32) {
    let (mut sum, mut total, mut textured) = (Vec3::ZERO, 0.0, 0);
    for t in triangles {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
        let area = (b - a).cross(c - a).length();
        let of = |v: u32| Vec3::from([0, 1, 2].map(|i| mesh.colors[v as usize][i] as f32 / 255.0));
        let mut color = (of(t[0]) + of(t[1]) + of(t[2])) / 3.0;
        let layers = t.map(|v| mesh.layers[v as usize]);
        assert!(
            layers.iter().all(|&l| l == layers[0]),
            "a triangle shows one texture, or none: {layers:?}"
        );
        if let Some(image) = images.get(layers[0] as usize) {
            textured += 1;
            let uv = (t.map(|v| mesh.uvs[v as usize]).iter().sum::<Vec2>() / 3.0).fract_gl();
            let x = (uv.x * image.width as f32) as usize;
            let y = (uv.y * image.height as f32) as usize;
            let texel = image.pixels[(y * image.width as usize + x).min(image.pixels.len() - 1)];
            color *= Vec3::from([0, 1, 2].map(|i| texel[i] as f32 / 255.0));
        }
        sum += color * area;
        total += area;
    }
    (sum / total, textured as f32 / triangles.len() as f32)
}

#[test]
fn coarse_levels_have_colours_in_place_of_textures() {
    // A tube whose texture is red on one side of its seam and blue on the other: what lies between is neither.
    let mut image = Image {
        name: String::new(),
        width: 4,
        height: 1,
        pixels: vec![[255, 0, 0, 255]; 4],
    };
    image.pixels[2..].fill([0, 0, 255, 255]);
    let parts = vec![tube(24, 24, Vec3::ZERO, 0.4, 0)];
    let mut c = character(parts, vec![Material::default()], 2);
    c.materials[0].base_color_image = Some(0);
    c.images.push(image);
    let mut mesh = merge(&c).expect("merge");
    let images: Vec<&Image> = c.images.iter().collect();
    let s = simplify(&mut mesh, &bent(2), &images);
    check(&mesh, &s);
    coarse_levels_are_colored("tube", &mesh, &s, &images);
}

/// Every level has one texture or none in each triangle; those of at most 120 triangles have none, and 40 triangles show
/// what the full mesh shows.
fn coarse_levels_are_colored(name: &str, mesh: &Mesh, s: &CollapseSequence, images: &[&Image]) {
    let (full, _) = mean_color(mesh, &mesh.triangles, images);
    // Steps of one error are one level.
    let level = |mut k: usize| {
        while k > 0 && k < s.steps.len() && s.steps[k].error_m == s.steps[k - 1].error_m {
            k += 1;
        }
        triangles_at(mesh, s, k)
    };
    for i in 0..20 {
        mean_color(mesh, &level(s.steps.len() * i / 20), images);
    }
    for count in [120, 80, 40] {
        let k: Vec<usize> = (0..=s.steps.len()).collect();
        let k = k.partition_point(|&k| triangles_at(mesh, s, k).len() > count);
        let (color, textured) = mean_color(mesh, &level(k), images);
        println!("{name}, {count} triangles: {color} for {full}");
        assert_eq!(textured, 0.0, "{name}, {count} triangles");
        assert!(
            (color - full).abs().max_element() < 0.1,
            "{name}, {count} triangles: {color} for {full}"
        );
    }
}

#[test]
fn coarse_levels_of_textured_characters_span_no_seams() {
    for name in ["glb/khronos_fox.glb", "glb/horse_textured.glb"] {
        let Some(c) = model(name) else { continue };
        let mut mesh = merge(&c).expect("merge");
        let images = textures(&c);
        let poses = PoseSet::choose(&c, &mesh, 4);
        let s = simplify(&mut mesh, &poses, &images);
        check(&mesh, &s);
        coarse_levels_are_colored(name, &mesh, &s, &images);
    }
}

#[test]
fn pieces_vanish_smallest_first() {
    let parts = vec![
        tube(12, 9, Vec3::ZERO, 0.4, 0),
        tube(12, 9, Vec3::X * 3.0, 0.02, 0),
    ];
    let mut mesh = merge(&character(parts, vec![Material::default()], 2)).expect("merge");
    let s = simplify(&mut mesh, &bent(2), &[]);
    check(&mesh, &s);
    let left = triangles_at(&mesh, &s, steps_for(&mesh, &s, 12));
    assert!(left.len() >= 8);
    let thick = left
        .iter()
        .filter(|t| mesh.positions[t[0] as usize].x < 1.5)
        .count();
    assert!(thick >= 8, "{thick} of {}", left.len());
}

#[test]
fn same_input_same_sequence() {
    let parts = vec![
        tube(10, 9, Vec3::ZERO, 0.4, 0),
        tube(10, 9, Vec3::X, 0.1, 2),
    ];
    let c = character(parts, vec![Material::default()], 4);
    let run = || {
        let mut mesh = merge(&c).expect("merge");
        simplify(&mut mesh, &bent(4), &[]).steps
    };
    assert_eq!(run(), run());
}

#[test]
fn colours_and_textures_merge_and_states_do_not() {
    let image = |alpha| Image {
        name: String::new(),
        width: 1,
        height: 1,
        pixels: vec![[255, 255, 255, alpha]],
    };
    let materials = vec![
        Material {
            base_color: [1.0, 0.0, 0.0, 1.0],
            ..Default::default()
        },
        Material {
            base_color_image: Some(1),
            alpha: Alpha::Mask(0.5),
            ..Default::default()
        },
        Material {
            base_color_image: Some(2),
            alpha: Alpha::Mask(0.5),
            ..Default::default()
        },
    ];
    let parts = (0..3u16)
        .map(|m| {
            let mut p = tube(6, 3, Vec3::X * m as f32, 0.2, 0);
            p.material = m as u32;
            p
        })
        .collect();
    let mut c = character(parts, vec![Material::default(); 3], 2);
    c.materials = materials;
    c.images = vec![image(255), image(255), image(0)];
    let mut mesh = merge(&c).expect("merge");
    assert_eq!(used_images(&c), [1, 2]);
    let states: Vec<_> = mesh.submeshes.iter().map(|s| s.alpha_cutoff).collect();
    assert_eq!(
        states,
        [None, Some(0.5)],
        "an alpha test that always passes is dropped"
    );
    let layers: Vec<u8> = [0, 1, 2]
        .iter()
        .map(|&part| {
            let v = mesh.body_parts.iter().position(|&b| b == part);
            mesh.layers[v.expect("every part is there")]
        })
        .collect();
    assert_eq!(layers, [Mesh::UNTEXTURED, 0, 1]);
    assert_eq!(mesh.colors[0], [255, 0, 0, 255]);
    let seam = |part: u8| mesh.body_parts.iter().filter(|&&b| b == part).count();
    assert_eq!(
        (seam(0), seam(1)),
        (18, 21),
        "only a texture needs its seam"
    );
    let s = simplify(&mut mesh, &bent(2), &[]);
    check(&mesh, &s);
}

#[test]
fn too_much_of_something_is_refused() {
    let c = character(
        vec![tube(6, 3, Vec3::ZERO, 0.2, 0)],
        vec![Material::default()],
        257,
    );
    let error = merge(&c).expect_err("too many joints");
    assert!(
        matches!(error, BakeError::Limit { count: 257, .. }),
        "{error}"
    );
    let mut flat = tube(6, 3, Vec3::ZERO, 0.2, 0);
    flat.positions.fill(Vec3::ONE);
    let c = character(vec![flat], vec![Material::default()], 2);
    assert!(matches!(merge(&c), Err(BakeError::Empty { .. })));
}

#[test]
fn repeats_of_a_texture_move_home() {
    let mut p = tube(6, 3, Vec3::ZERO, 0.2, 0);
    p.uvs.iter_mut().for_each(|uv| *uv += Vec2::new(-40.0, 7.0));
    let textured = Material {
        base_color_image: Some(0),
        ..Default::default()
    };
    let mut c = character(vec![p], vec![Material::default()], 2);
    c.materials = vec![textured];
    c.images = vec![Image {
        name: String::new(),
        width: 1,
        height: 1,
        pixels: vec![[255; 4]],
    }];
    let mesh = merge(&c).expect("merge");
    for uv in &mesh.uvs {
        assert!(
            uv.cmpge(Vec2::ZERO).all() && uv.cmple(Vec2::ONE).all(),
            "{uv}"
        );
    }
}

#[test]
fn real_characters_reach_few_triangles_and_pay_for_positions_not_for_seams() {
    // Dozens of separate pieces, and a pedestrian with split normals everywhere.
    for name in ["glb/kaykit_rogue.glb", "glb/ped_man_worker.glb"] {
        let Some(c) = model(name) else { continue };
        let mut mesh = merge(&c).expect("merge");
        let images = textures(&c);
        let poses = PoseSet::choose(&c, &mesh, PoseSet::DEFAULT_COUNT);
        let s = simplify(&mut mesh, &poses, &images);
        check(&mesh, &s);
        for share in [0.06, 0.02] {
            let count = (mesh.triangles.len() as f64 * share) as usize;
            // Triangles only ever become fewer.
            let k = (0..=s.steps.len()).collect::<Vec<_>>();
            let k = k.partition_point(|&k| triangles_at(&mesh, &s, k).len() > count);
            let level = triangles_at(&mesh, &s, k);
            assert!(
                level.len() + 8 >= count,
                "{name}: {} of {count}",
                level.len()
            );
            let vertices: HashSet<u32> = level.iter().flatten().copied().collect();
            let points: HashSet<_> = vertices
                .iter()
                .map(|&v| {
                    let v = v as usize;
                    let weights = mesh.weights[v].map(f32::to_bits);
                    (
                        mesh.positions[v].to_array().map(f32::to_bits),
                        mesh.joints[v],
                        weights,
                    )
                })
                .collect();
            let ratio = vertices.len() as f64 / points.len() as f64;
            println!(
                "{name} {share}: {} vertices, {} points",
                vertices.len(),
                points.len()
            );
            assert!(ratio < 1.2, "{name}: {ratio} vertices per point at {share}");
        }
    }
}

#[test]
fn few_triangles_are_not_spent_on_layers_that_have_come_together() {
    // Skin under clothes: where layers fall into one, several faces are one triangle, and others lie inside.
    let Some(c) = model("glb/ped_woman_casual.glb") else {
        return;
    };
    let mut mesh = merge(&c).expect("merge");
    let poses = PoseSet::choose(&c, &mesh, PoseSet::DEFAULT_COUNT);
    let s = simplify(&mut mesh, &poses, &[]);
    let place = |v: u32| mesh.positions[v as usize].to_array().map(f32::to_bits);
    let drawn = |k: usize| -> HashSet<Vec<[u32; 3]>> {
        let triangles = triangles_at(&mesh, &s, k).into_iter().map(|t| {
            let first = (0..3).min_by_key(|&i| place(t[i])).expect("three");
            (0..3).map(|i| place(t[(first + i) % 3])).collect()
        });
        triangles.collect()
    };
    let k = (0..=s.steps.len()).collect::<Vec<_>>();
    let level = drawn(k.partition_point(|&k| drawn(k).len() > 40));
    let points: HashSet<_> = level.iter().flatten().collect();
    assert!(level.len() >= 36, "{} triangles", level.len());
    // A closed surface of 40 triangles has 22; there were 16.
    assert!(points.len() >= 20, "{} points", points.len());
}

#[test]
fn where_a_skeleton_says_what_limbs_are_coarse_levels_are_built_of_them() {
    let c = throng_bake::people::build("man_suit").expect("built in");
    let mut mesh = merge(&c).expect("merge");
    let poses = PoseSet::choose(&c, &mesh, PoseSet::DEFAULT_COUNT);
    let s = simplify(&mut mesh, &poses, &[]);
    check(&mesh, &s);
    let replaced = s.replacement.as_ref().expect("it looks better");
    assert!((36..=40).contains(&replaced.triangles.len()));
    // Arms, legs, head and trunk follow joints of their own.
    let first = |v: u32| mesh.joints[v as usize][0];
    let moved: HashSet<u8> = replaced
        .triangles
        .iter()
        .flatten()
        .map(|&v| first(v))
        .collect();
    assert!(moved.len() >= 8, "{moved:?}");
    // It goes on from there, down to nothing.
    let left = |k: usize| triangles_at(&mesh, &s, k).len();
    let counts: Vec<usize> = (replaced.step + 1..=s.steps.len()).map(left).collect();
    assert!(counts.is_sorted_by(|a, b| a >= b), "{counts:?}");
    assert!(counts.iter().any(|n| (10..20).contains(n)), "{counts:?}");

    // A mesh of no more points than the level has is no different.
    let level = triangles_at(&mesh, &s, replaced.step + 1);
    mesh.triangles = level;
    let s = simplify(&mut mesh, &poses, &[]);
    check(&mesh, &s);
}

#[test]
fn every_built_in_character_gives_a_sequence_that_keeps_its_rules() {
    // Real surfaces lose wedges and edges in ways that small meshes do not: a twin of a dead wedge once came out.
    for name in throng_bake::people::names() {
        let c = throng_bake::people::build(name).expect("built in");
        let mut mesh = merge(&c).expect("merge");
        let poses = PoseSet::choose(&c, &mesh, 4);
        let s = simplify(&mut mesh, &poses, &[]);
        check(&mesh, &s);
        // At a pixel of error nobody vanishes who is more than two or three pixels high.
        let last = (0..s.steps.len())
            .rev()
            .find(|&n| !triangles_at(&mesh, &s, n).is_empty())
            .expect("there are triangles at first");
        let (low, high) = mesh
            .positions
            .iter()
            .fold((f32::MAX, f32::MIN), |(l, h), p| (l.min(p.y), h.max(p.y)));
        let gone = s.steps[last].error_m / (high - low);
        assert!(gone > 0.4, "{name}: {gone}");
    }
}
