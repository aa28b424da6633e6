//! The GPU's stages against their CPU twins, and the comparators against corrupted output.

mod common;

use common::{
    assert_silent, baked_mascot, baked_mascot_with_impostors, crowd, headless, options, view,
};
use throng::bake::baked::Baked;
use throng::gpu::Headless;
use throng::gpu_types::{AgentState, FLAT_BIN, Instance, QUAD_BIN, SLICE_COUNT};
use throng::impostor::draw_of;
use throng::reference::impostor::place_quad;
use throng::reference::mesh::{Skinned, mesh};
use throng::reference::select::{Selection, select};
use throng::{Agent, FrameOptions, Method, View};

const SIZE: [u32; 2] = [256, 256];
/// Positions are metres and angles are short: single precision leaves less than this.
const POSITION_TOLERANCE: f32 = 1e-4;
const NORMAL_TOLERANCE: f32 = 1e-3;
/// Colours: the random numbers of tints are fractions of numbers in the thousands.
const COLOR_TOLERANCE: f32 = 4e-3;

fn twin(headless: &Headless, agents: &[Agent], view: &View, options: &FrameOptions) -> Selection {
    let tables = headless.tables();
    let states: Vec<AgentState> = agents.iter().map(AgentState::from).collect();
    let frame = throng::select::frame_constants(view, options, agents.len() as u32, tables, true);
    let pyramid = headless.occlusion().map(|(_, pyramid)| pyramid);
    select(
        tables,
        &tables.ranges(options, &headless.costs()),
        &states,
        &frame,
        pyramid.as_ref(),
    )
}

/// How two selections differ. Integers are equal, but for live vertices, bands and pose choices of agents whose error is
/// within rounding of a threshold: `slack` is how many of those there may be.
fn difference(gpu: &Selection, cpu: &Selection, slack: usize) -> Option<String> {
    if gpu.visible.abs_diff(cpu.visible) > slack as u64 {
        return Some(format!("{} visible against {}", gpu.visible, cpu.visible));
    }
    let mut off = 0;
    let entries = |s: &Selection| {
        let mut all: Vec<(u32, u32, u32)> = Vec::new();
        for (bin, d) in (0..).zip(&s.draws) {
            for i in &s.instances[d.first_instance as usize..][..d.instance_count as usize] {
                all.push((i.agent(), bin, i.live_vertex_count));
            }
        }
        all.sort_unstable();
        all
    };
    let (a, b) = (entries(gpu), entries(cpu));
    let set: std::collections::BTreeSet<_> = a.iter().collect();
    off += b.iter().filter(|e| !set.contains(e)).count();
    off += a.len().abs_diff(b.len());
    for (g, c) in gpu.draws.iter().zip(&cpu.draws) {
        if (g.index_count, g.first_index, g.vertex_offset)
            != (c.index_count, c.first_index, c.vertex_offset)
        {
            return Some(format!("{g:?} against {c:?}"));
        }
    }
    let by_agent = |s: &Selection| {
        let mut all = std::collections::BTreeMap::new();
        for (bin, d) in s.draws.iter().enumerate() {
            for i in &s.instances[d.first_instance as usize..][..d.instance_count as usize] {
                all.insert((i.agent(), bin), *i);
            }
        }
        all
    };
    let (g, c) = (by_agent(gpu), by_agent(cpu));
    off += c
        .iter()
        .filter(|(key, c)| g.get(key).is_none_or(|g| !alike(g, c)))
        .count();
    // Shadows by their places, of which no two are the same.
    let radii = |s: &Selection| -> std::collections::BTreeMap<[u32; 3], f32> {
        let of = |&[x, y, z, radius]: &[f32; 4]| ([x, y, z].map(f32::to_bits), radius);
        s.shadows.iter().map(of).collect()
    };
    let (g, c) = (radii(gpu), radii(cpu));
    off += gpu.shadows.len().abs_diff(cpu.shadows.len());
    off += c
        .iter()
        .filter(|(place, c)| g.get(*place).is_none_or(|g| (g - *c).abs() > 1e-4))
        .count();
    (off > slack).then(|| format!("{off} entries differ"))
}

fn alike(g: &Instance, c: &Instance) -> bool {
    let n = c.sample_count() as usize;
    let near = |a: f32, b: f32| (a - b).abs() < 1e-4;
    g.position == c.position
        && g.tint_seed == c.tint_seed
        && near(g.heading_cos, c.heading_cos)
        && near(g.heading_sin, c.heading_sin)
        && g.packed == c.packed
        && g.sample_entries[..n] == c.sample_entries[..n]
        && (0..n).all(|i| near(g.sample_weight(i), c.sample_weight(i)))
}

fn render(headless: &mut Headless, agents: &[Agent], options: &FrameOptions) -> Selection {
    headless
        .render(agents, &view(SIZE), options)
        .expect("a frame");
    headless.selection().expect("the lists are kept")
}

#[test]
fn select_writes_what_its_twin_writes() {
    let mut headless = headless(SIZE);
    let a = headless.add_character(&baked_mascot()).expect("it uploads");
    let b = headless.add_character(&baked_mascot()).expect("twice");
    for count in [0, 1, 63, 64, 65, 1000] {
        for pixel_error in [0.0, 1.0, 8.0] {
            let agents = crowd(count, &[a, b]);
            let options = FrameOptions {
                pixel_error,
                ..options(Method::Lod)
            };
            let gpu = render(&mut headless, &agents, &options);
            let cpu = twin(&headless, &agents, &view(SIZE), &options);
            assert_eq!(
                difference(&gpu, &cpu, count / 200),
                None,
                "{count} agents, {pixel_error} px"
            );
        }
    }
    let without_shadows = FrameOptions {
        shadows: false,
        ..options(Method::Lod)
    };
    let agents = crowd(100, &[a, b]);
    let with = render(&mut headless, &agents, &options(Method::Lod));
    assert!(!with.shadows.is_empty());
    assert!(
        render(&mut headless, &agents, &without_shadows)
            .shadows
            .is_empty()
    );
    for options in [
        without_shadows,
        options(Method::Full),
        FrameOptions {
            animate: false,
            ..options(Method::Lod)
        },
    ] {
        let agents = crowd(500, &[a, b]);
        let gpu = render(&mut headless, &agents, &options);
        let cpu = twin(&headless, &agents, &view(SIZE), &options);
        assert_eq!(difference(&gpu, &cpu, 2), None, "{options:?}");
    }
    assert_silent(&headless);
}

/// Agents at the edges of a wide picture are as fine as perspective stretches them.
#[test]
fn wide_views_are_selected_as_by_the_twin() {
    let mut headless = headless(SIZE);
    let id = headless
        .add_character(&baked_mascot_with_impostors())
        .expect("it uploads");
    let mut agents = crowd(1000, &[id]);
    for agent in &mut agents {
        // Over a field as wide as the view.
        agent.position.x *= 2.5;
    }
    let narrow = view(SIZE);
    let mut wide = narrow;
    wide.clip_from_view = glam::Mat4::perspective_infinite_reverse_rh(2.1, 1.0, wide.near);
    for method in [Method::Lod, Method::Hybrid] {
        let options = options(method);
        let report = headless.render(&agents, &wide, &options).expect("a frame");
        let gpu = headless.selection().expect("the lists are kept");
        let cpu = twin(&headless, &agents, &wide, &options);
        assert_eq!(difference(&gpu, &cpu, 5), None, "{method:?}");
        // Without a share for the corners, nobody is finer than for its distance.
        let tables = headless.tables();
        let states: Vec<AgentState> = agents.iter().map(AgentState::from).collect();
        let mut frame =
            throng::select::frame_constants(&wide, &options, agents.len() as u32, tables, true);
        assert!(frame.stretch_share_min < 0.5);
        frame.stretch_share_min = 1.0;
        let ranges = tables.ranges(&options, &headless.costs());
        let pyramid = headless.occlusion().map(|(_, pyramid)| pyramid);
        let coarse = select(tables, &ranges, &states, &frame, pyramid.as_ref());
        assert!(difference(&gpu, &coarse, 50).is_some(), "{method:?}");
        assert_eq!(report.visible, gpu.visible);
    }
    assert_silent(&headless);
}

#[test]
fn representations_are_chosen_as_their_twin_chooses() {
    let mut headless = headless(SIZE);
    let a = headless
        .add_character(&baked_mascot_with_impostors())
        .expect("it uploads");
    let b = headless.add_character(&baked_mascot()).expect("twice");
    let agents = crowd(1500, &[a, b]);
    for method in [Method::Flat, Method::Quad, Method::Hybrid] {
        for pixel_error in [0.3, 0.6, 1.0, 3.0] {
            let options = FrameOptions {
                pixel_error,
                ..options(method)
            };
            let gpu = render(&mut headless, &agents, &options);
            let cpu = twin(&headless, &agents, &view(SIZE), &options);
            assert_eq!(
                difference(&gpu, &cpu, 8),
                None,
                "{method:?}, {pixel_error} px"
            );
            assert!(gpu.meshes.abs_diff(cpu.meshes) <= 8);
            // Whoever has no impostors keeps the mesh, and nobody is lost or doubled: a fade has a share in each of two.
            let report = headless
                .render(&agents, &view(SIZE), &options)
                .expect("a frame");
            let drawn: u64 = report.representations.iter().map(|r| r.agents).sum();
            assert!(drawn >= report.visible, "{:?}", report.representations);
            let fades = gpu.instances.iter().filter(|i| {
                let bits = i.live_vertex_count;
                bits & throng::gpu_types::IMPOSTOR_FADES_OUT != 0
                    || (1..255).contains(&((bits >> throng::gpu_types::IMPOSTOR_FADE_SHIFT) & 0xff))
            });
            assert!(drawn <= report.visible + fades.count() as u64);
            if method != Method::Hybrid {
                assert_eq!(drawn, report.visible, "{:?}", report.representations);
            } else if pixel_error == 0.6 {
                assert!(
                    report.representations.iter().all(|r| r.agents > 0),
                    "all kinds are chosen somewhere: {:?}",
                    report.representations
                );
            }
        }
    }
    assert_silent(&headless);
}

/// Soft edges blend over who stands behind: whoever is in a later slice is nearer, and all slices are drawn.
#[test]
fn impostors_are_listed_from_far_to_near() {
    let mut headless = headless(SIZE);
    let id = headless
        .add_character(&baked_mascot_with_impostors())
        .expect("it uploads");
    let agents = crowd(1500, &[id]);
    for (method, bin) in [(Method::Flat, FLAT_BIN), (Method::Quad, QUAD_BIN)] {
        let options = options(method);
        let lists = render(&mut headless, &agents, &options);
        let tables = headless.tables();
        let frame = throng::select::frame_constants(&view(SIZE), &options, 1500, tables, true);
        let eye = glam::Vec3::from(frame.eye);
        let (mut slices, mut nearest_before) = (0, f32::INFINITY);
        for slice in bin..bin + SLICE_COUNT {
            let draw = lists.draws[slice as usize];
            let list =
                &lists.instances[draw.first_instance as usize..][..draw.instance_count as usize];
            // Slices are of the distance to bounds, whose size varies by clip and scale.
            let distances = list.iter().map(|i| eye.distance(i.position.into()));
            let (mut near, mut far) = (f32::INFINITY, 0.0f32);
            for d in distances {
                (near, far) = (near.min(d), far.max(d));
            }
            slices += (draw.instance_count > 0) as u32;
            assert!(
                far < nearest_before + 1.0,
                "{far} m behind {nearest_before} m"
            );
            nearest_before = nearest_before.min(near);
        }
        assert!(slices > 80, "{slices} slices have somebody");
        let all = draw_of(&lists.draws, bin..bin + SLICE_COUNT);
        assert_eq!(all.instance_count as u64, lists.visible, "{method:?}");
    }
    assert_silent(&headless);
}

#[test]
fn a_corrupted_selection_is_found() {
    let mut headless = headless(SIZE);
    let id = headless.add_character(&baked_mascot()).expect("it uploads");
    let agents = crowd(100, &[id]);
    let options = options(Method::Lod);
    let good = render(&mut headless, &agents, &options);
    assert_eq!(difference(&good, &good, 0), None);
    let corrupt = |change: &dyn Fn(&mut Selection)| {
        let mut bad = good.clone();
        change(&mut bad);
        assert!(difference(&bad, &good, 0).is_some());
    };
    corrupt(&|s| s.visible += 1);
    corrupt(&|s| s.instances[0].packed ^= 1 << 6);
    corrupt(&|s| s.instances[0].packed ^= 1);
    corrupt(&|s| s.instances[0].position[1] += 0.1);
    corrupt(&|s| s.instances[0].live_vertex_count += 1);
    corrupt(&|s| s.draws[0].first_index += 3);
    corrupt(&|s| {
        let drawn = s
            .draws
            .iter_mut()
            .find(|d| d.instance_count > 0)
            .expect("one is drawn");
        drawn.instance_count -= 1;
    });
    corrupt(&|s| s.instances[0].sample_weights[0] += 0.01);
    corrupt(&|s| s.instances[0].sample_entries[0] += 1);
    corrupt(&|s| s.shadows[0][3] += 0.01);
    corrupt(&|s| s.shadows.truncate(s.shadows.len() - 1));
}

/// The largest difference of positions, of normals and of colours.
fn differences(gpu: &[Skinned], cpu: &[Skinned]) -> (f32, f32, f32) {
    assert_eq!(gpu.len(), cpu.len());
    gpu.iter().zip(cpu).fold((0.0, 0.0, 0.0), |worst, (g, c)| {
        (
            worst.0.max(distance(g.position, c.position)),
            worst.1.max(distance(g.normal, c.normal)),
            worst.2.max(distance(g.color, c.color)),
        )
    })
}

/// Infinite where a number is missing, so that it never passes for small.
fn distance(a: glam::Vec3, b: glam::Vec3) -> f32 {
    let d = a.distance(b);
    if d.is_nan() { f32::INFINITY } else { d }
}

fn compare_meshes(headless: &mut Headless, baked: &Baked, agents: &[Agent], pixel_error: f32) {
    let character = agents[0].character;
    let options = FrameOptions {
        pixel_error,
        ..options(Method::Lod)
    };
    let lists = render(headless, agents, &options);
    let mut influences = std::collections::BTreeSet::new();
    let mut first_band = (FLAT_BIN + SLICE_COUNT) as usize;
    for (s, submesh) in baked.submeshes.iter().enumerate() {
        for draw in &lists.draws[first_band..first_band + submesh.band_count as usize] {
            // One instance of every band that is drawn.
            if draw.instance_count == 0 {
                continue;
            }
            let instance = lists.instances[draw.first_instance as usize];
            influences.insert((instance.influence_count(), instance.sample_count()));
            let cpu = mesh(baked, s, &instance);
            // The probe reads the lists in the GPU's order, so it may draw another agent of the same band: find it.
            let gpu = headless
                .probe_mesh(character, s, draw.first_instance)
                .expect("a probe");
            let candidates = lists.instances[draw.first_instance as usize..]
                [..draw.instance_count as usize]
                .iter();
            let best = candidates
                .map(|i| differences(&gpu, &mesh(baked, s, i)))
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .expect("the list is not empty");
            assert!(
                best.0 < POSITION_TOLERANCE,
                "positions differ by {} m",
                best.0
            );
            assert!(best.1 < NORMAL_TOLERANCE, "normals differ by {}", best.1);
            assert!(best.2 < COLOR_TOLERANCE, "colours differ by {}", best.2);
            // The comparator is not blind.
            let mut bad = cpu.clone();
            bad[0].position.x += 1e-3;
            assert!(differences(&bad, &cpu).0 > POSITION_TOLERANCE);
            bad[0].normal = -bad[0].normal;
            assert!(differences(&bad, &cpu).1 > NORMAL_TOLERANCE);
            bad[0].color.y += 0.01;
            assert!(differences(&bad, &cpu).2 > COLOR_TOLERANCE);
            bad[0].position.x = f32::NAN;
            assert!(differences(&bad, &cpu).0 > POSITION_TOLERANCE);
        }
        first_band += submesh.band_count as usize;
    }
    assert!(
        influences.len() > 1 || agents.len() < 10,
        "{influences:?}: every case was the same"
    );
}

#[test]
fn mesh_moves_vertices_where_its_twin_moves_them() {
    let mut headless = headless(SIZE);
    let baked = baked_mascot();
    let id = headless.add_character(&baked).expect("it uploads");
    compare_meshes(&mut headless, &baked, &crowd(200, &[id]), 1.0);
    assert_silent(&headless);
}

#[test]
fn mesh_agrees_on_a_real_character() {
    let Some(baked) = common::real_character("glb/horse_textured.glb") else {
        return;
    };
    let mut headless = headless(SIZE);
    let id = headless.add_character(&baked).expect("it uploads");
    compare_meshes(&mut headless, &baked, &crowd(100, &[id]), 2.0);
    assert_silent(&headless);
}

#[test]
fn with_bands_a_vertex_shader_run_follows_few_parents() {
    /// Mean over the vertices of a level, at the worst of them.
    fn parents(baked: &throng::bake::baked::Baked) -> f64 {
        let worst_of = |s: usize| {
            let hops = |k: u32| throng::reference::mesh::mean_hops(baked, s, k);
            let levels = (3..baked.submeshes[s].vertex_count).step_by(7);
            levels.map(hops).fold(0.0, f64::max)
        };
        (0..baked.submeshes.len()).map(worst_of).fold(0.0, f64::max)
    }
    let character = throng::bake::people::build("man_suit").expect("built in");
    let bake = |single_window| {
        let options = throng::bake::bake::BakeOptions {
            single_window,
            ..Default::default()
        };
        let (baked, _) =
            throng::bake::bake::bake(&character, &options, &mut |_| {}).expect("bakes");
        parents(&baked)
    };
    let (banded, single) = (bake(false), bake(true));
    assert!(banded <= 2.0, "{banded} parents at the worst level");
    assert!(
        single > banded,
        "the paper's single window follows {single}"
    );
    println!("parents at the worst level: {banded:.2} with bands, {single:.2} in one window");
    for file in ["glb/ped_woman_casual.glb", "glb/kaykit_rogue.glb"] {
        if let Some(baked) = common::real_character(file) {
            let parents = parents(&baked);
            println!("{file}: {parents:.2} parents at the worst level");
            assert!(
                parents <= 2.0,
                "{file}: {parents} parents at the worst level"
            );
        }
    }
}

#[test]
fn impostors_stand_where_their_twin_puts_them() {
    let baked = baked_mascot_with_impostors();
    let impostors = baked.impostors.as_ref().expect("the fixture has them");
    let mut headless = headless(SIZE);
    let first = headless.add_character(&baked).expect("it uploads");
    headless
        .render(&crowd(3, &[first]), &view(SIZE), &options(Method::Quad))
        .expect("a frame");
    // Behind another one, and added after a frame: nothing stands at the table's beginning, and the gallery has grown.
    let id = headless.add_character(&baked).expect("it uploads");
    let agents = crowd(300, &[id]);
    let tables = headless.tables();
    let kinds = tables.representations[id.0 as usize].kinds.clone();
    let clip = tables.characters[id.0 as usize].first_clip as usize;
    let first_pose = tables.clips[clip].first_pose;
    let tiles = throng::impostor::trimmed_tiles(impostors);
    let (mut compared, mut moved) = (0, 0);
    for (kind, method) in [Method::Flat, Method::Quad].into_iter().enumerate() {
        let options = options(method);
        let lists = render(&mut headless, &agents, &options);
        let frame = throng::select::frame_constants(
            &view(SIZE),
            &options,
            agents.len() as u32,
            headless.tables(),
            true,
        );
        let bin = kinds[kind].bin;
        let draw = draw_of(&lists.draws, bin..bin + SLICE_COUNT);
        assert!(draw.instance_count > 50, "{draw:?}");
        for i in (0..draw.instance_count).step_by(7) {
            let gpu = headless
                .probe_impostor(id, kind, draw.first_instance + i)
                .expect("a probe");
            let info = &impostors.kinds[kind];
            assert_eq!(gpu.len(), 4 * info.quad_count as usize);
            // The probe reads the lists in the GPU's order: the twin's entry is whichever agent that is.
            let list =
                &lists.instances[draw.first_instance as usize..][..draw.instance_count as usize];
            let worst = |instance: &Instance| {
                (0..info.quad_count as usize)
                    .flat_map(|q| {
                        let quad = info.first_quad as usize + q;
                        let cpu = place_quad(
                            &baked, impostors, &tiles, &frame, instance, quad, first_pose,
                        );
                        let gpu = &gpu[4 * q..][..4];
                        cpu.into_iter()
                            .zip(gpu)
                            .map(|(c, g)| {
                                distance(c.corner, g.corner)
                                    .max(distance(c.towards, g.towards))
                                    .max((c.uv - g.uv).length() * 0.01)
                                    .max((c.shift - g.shift).length() * 0.01)
                                    .max((c.depth_extent - g.depth_extent).abs())
                                    .max((c.depth - g.depth).abs())
                                    .max((c.mip - g.mip).abs() * 0.1)
                                    .max((c.sharpness - g.sharpness).abs() * 0.01)
                            })
                            .collect::<Vec<_>>()
                    })
                    .fold(0.0, f32::max)
            };
            let best = list.iter().map(worst).fold(f32::INFINITY, f32::min);
            compared += 1;
            // A direction on the border of two cells may fall to either.
            moved += (best > 2e-3) as u32;
        }
    }
    assert!(
        compared > 30 && moved * 20 <= compared,
        "{moved} of {compared} differ"
    );
    assert_silent(&headless);
}
