//! What a build makes of pictures of real and built-in characters.

use std::convert::Infallible;
use std::path::Path;
use std::sync::OnceLock;

use throng_bake::bake::{BakeOptions, bake};
use throng_bake::baked::Baked;
use throng_bake::impostor::build::{Built, ImpostorOptions, build};
use throng_bake::impostor::capture::{CaptureBatch, CapturedView};
use throng_bake::impostor::groups::Groups;
use throng_bake::people;

use crate::capture::capture;

/// A built-in character, a model of the folder of real characters by file, or a file of a baked one.
pub fn baked(name: &str) -> Option<Baked> {
    if name.ends_with(".throng") {
        let read = throng_bake::file::read(Path::new(name));
        return Some(read.unwrap_or_else(|e| panic!("{e}")));
    }
    let character = if name.contains('.') {
        let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/models");
        let folder = std::env::var_os("THRONG_MODELS").map_or_else(beside, Into::into);
        if !folder.is_dir() {
            eprintln!(
                "SKIPPED: no characters in {}; set THRONG_MODELS",
                folder.display()
            );
            return None;
        }
        throng_bake::import::import(&folder.join(name)).unwrap_or_else(|e| panic!("{e}"))
    } else {
        people::build(name).unwrap()
    };
    Some(
        bake(&character, &BakeOptions::default(), &mut |_| ())
            .unwrap()
            .0,
    )
}

pub fn built(baked: &Baked, options: &ImpostorOptions) -> Built {
    let groups = Groups::by_rule(baked);
    let mut take = |batch: &_| Ok::<_, Infallible>(capture(baked, batch));
    build(baked, &groups, options, &mut take, &mut |_| ()).unwrap()
}

/// A built-in person with few views, and its impostors.
fn person() -> &'static (Baked, Built) {
    static PERSON: OnceLock<(Baked, Built)> = OnceLock::new();
    PERSON.get_or_init(|| {
        let baked = baked("man_suit").unwrap();
        let options = ImpostorOptions {
            body_view_cuts: 2,
            head_view_cuts: 2,
            mask_samples: 4,
            ..ImpostorOptions::default()
        };
        let built = built(&baked, &options);
        (baked, built)
    })
}

#[test]
fn a_person_fits_the_memory_and_every_tile_shows_its_part() {
    let baked = baked("man_suit").unwrap();
    let groups = Groups::by_rule(&baked);
    let mut heard = Vec::new();
    let mut take = |batch: &CaptureBatch| {
        let pixels: u64 = batch
            .views
            .iter()
            .map(|v| u64::from(v.size[0] * v.size[1]))
            .sum();
        assert!(pixels * 8 <= 64 << 20, "batches are bounded");
        Ok::<_, Infallible>(capture(&baked, batch))
    };
    let options = ImpostorOptions {
        body_view_cuts: 2,
        mask_samples: 4,
        ..ImpostorOptions::default()
    };
    let built = build(&baked, &groups, &options, &mut take, &mut |x| heard.push(x)).unwrap();
    assert!(heard.is_sorted() && heard.last() == Some(&1.0));
    let i = &built.impostors;
    assert!(i.atlas.size_bytes() <= 16_000_000 && i.atlas.size_bytes() > 8_000_000);
    assert_eq!(i.kinds.len(), 2);
    assert_eq!(i.clip_poses.len(), baked.clips.len());
    let with_impostors = Baked {
        impostors: Some(i.clone()),
        ..baked.clone()
    };
    throng_bake::validate::validate(&with_impostors).unwrap();
    // Tiles do not overlap, and their outermost texels show nothing.
    let (width, height, _) = i.atlas.mip(0);
    let mut taken = vec![false; (width * height) as usize];
    for t in i.tiles.iter().filter(|t| t.size[0] > 0) {
        let (left, top) = (u32::from(t.texel[0]), u32::from(t.texel[1]));
        let (columns, rows) = (u32::from(t.size[0]), u32::from(t.size[1]));
        for y in 0..rows {
            for x in 0..columns {
                let at = ((top + y) * width + left + x) as usize;
                assert!(
                    !std::mem::replace(&mut taken[at], true),
                    "two tiles share a texel"
                );
                if x == 0 || y == 0 || x == columns - 1 || y == rows - 1 {
                    let outline = i.atlas.color[at][3];
                    assert!(
                        outline <= 64,
                        "a tile's rim is half a texel outside: {outline}"
                    );
                }
            }
        }
        // It lies on its side.
        let texel = (t.max[0] - t.min[0]) / rows as f32;
        assert!(
            ((t.max[1] - t.min[1]) / columns as f32 - texel).abs() < texel * 1e-3,
            "texels are square"
        );
    }
    let body = &i.quads[i.kinds[1].first_quad as usize];
    let views = i.view_sets[body.view_set as usize].directions.len();
    assert!(
        i.tiles[body.first_tile as usize..]
            .iter()
            .all(|t| t.size[0] > 0),
        "bodies have pictures"
    );
    assert_eq!(
        i.tiles.len() - body.first_tile as usize,
        views
            * i.clip_poses
                .iter()
                .map(|p| p.pose_count as usize)
                .sum::<usize>()
    );
}

#[test]
fn in_every_mip_as_many_texels_show_as_the_finest_has() {
    let i = &person().1.impostors;
    let shown = |mip: u32| {
        let (width, height, first) = i.atlas.mip(mip);
        let texels = &i.atlas.color[first..first + (width * height) as usize];
        (texels.iter().filter(|c| c[3] >= 128).count() << (2 * mip)) as f32
    };
    for mip in 1..i.atlas.mip_count {
        let ratio = shown(mip) / shown(0);
        assert!((0.9..1.1).contains(&ratio), "mip {mip}: {ratio}");
    }
}

#[test]
fn faults_of_the_renderer_and_of_the_options_are_told() {
    let baked = crate::common::baked_sheets(4, throng_bake::sliding_tris::BandForm::SingleWindow);
    let groups = Groups::by_rule(&baked);
    let options = ImpostorOptions {
        body_view_cuts: 1,
        ..ImpostorOptions::default()
    };
    type Answer = Result<Vec<CapturedView>, std::fmt::Error>;
    let run = |options: &ImpostorOptions, take: &mut dyn FnMut(&CaptureBatch) -> Answer| {
        build(&baked, &groups, options, take, &mut |_| ())
            .unwrap_err()
            .to_string()
    };
    let fails = run(&options, &mut |_| Err(std::fmt::Error));
    assert_eq!(fails, std::fmt::Error.to_string());
    assert!(run(&options, &mut |_| Ok(Vec::new())).contains("in number"));
    let empty = |batch: &CaptureBatch| Ok(vec![CapturedView::default(); batch.views.len()]);
    assert!(run(&options, &mut |b| empty(b)).contains("its pixels and its size differ"));
    let zero = ImpostorOptions {
        supersample: 0,
        ..options
    };
    assert!(run(&zero, &mut |b| empty(b)).contains("samples"));
}

#[test]
#[ignore = "prints; for tuning"]
fn look() {
    let names = std::env::var("LOOK").unwrap_or_else(|_| "man_suit".into());
    for name in names.split(',') {
        let Some(baked) = baked(name) else { return };
        let groups = Groups::by_rule(&baked);
        println!(
            "== {name}: {} joints, {} clips",
            baked.joints.len(),
            baked.clips.len()
        );
        for (g, group) in groups.groups.iter().enumerate() {
            let joints: Vec<&str> = (0..baked.joints.len())
                .filter(|&j| groups.of_joint[j] == g as u8)
                .map(|j| baked.nodes[baked.joints[j].node as usize].name.as_str())
                .collect();
            println!("  {} head={} {joints:?}", group.name, group.is_head);
        }
        if std::env::var_os("GROUPS").is_some() {
            continue;
        }
        let start = std::time::Instant::now();
        let built = built(&baked, &ImpostorOptions::default());
        let i = &built.impostors;
        println!(
            "  {:.1} s, atlas {}x{} {} bytes, {} tiles, texels {}, poses {:?} {:?}",
            start.elapsed().as_secs_f32(),
            i.atlas.width,
            i.atlas.height,
            i.atlas.size_bytes(),
            i.tiles.len(),
            i.tiles
                .iter()
                .map(|t| t.size[0] as u64 * t.size[1] as u64)
                .sum::<u64>(),
            i.clip_poses
                .iter()
                .map(|p| p.pose_count)
                .collect::<Vec<_>>(),
            built.warnings
        );
        let rgba: Vec<u8> = i.atlas.color[..(i.atlas.width * i.atlas.height) as usize].concat();
        let mut shown = image::RgbaImage::from_raw(i.atlas.width, i.atlas.height, rgba).unwrap();
        for p in shown.pixels_mut() {
            if p[3] < 128 {
                *p = image::Rgba([p[0] / 3, p[1] / 3, 90, 255]);
            }
            p[3] = 255;
        }
        shown
            .save(std::env::temp_dir().join(format!("throng_atlas_{}.png", name.replace('/', "_"))))
            .unwrap();
    }
}
