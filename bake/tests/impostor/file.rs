//! Impostors in the baked file: they come back as they were, and whatever is not whole is refused.

use std::path::Path;

use throng_bake::baked::Baked;
use throng_bake::file::{from_bytes, to_bytes};
use throng_bake::impostor::blocks::Blocks;
use throng_bake::impostor::build::ImpostorOptions;
use throng_bake::impostor::{ErrorSample, Impostors};
use throng_bake::sliding_tris::BandForm;

use crate::build::built;
use crate::common::{Random, baked_sheets};

fn sheets() -> Baked {
    let mut baked = baked_sheets(8, BandForm::Collapsed { ratio: 1.5 });
    let options = ImpostorOptions {
        body_view_cuts: 1,
        quad_view_cuts: 1,
        texels_per_height: 16.0,
        quad_texels_per_height: 12.0,
        ..ImpostorOptions::default()
    };
    let mut impostors = built(&baked, &options).impostors;
    let sample = |height_px: f32| ErrorSample {
        height_px,
        error_px: 0.01 * height_px,
    };
    impostors.kinds[0].errors = vec![sample(8.0), sample(16.0)];
    baked.impostors = Some(impostors);
    baked
}

fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    let checksum = crc32fast::hash(&bytes[32..]);
    bytes[24..28].copy_from_slice(&checksum.to_le_bytes());
    bytes
}

#[test]
fn impostors_come_back_as_they_were() {
    let baked = sheets();
    let bytes = to_bytes(&baked);
    assert_eq!(from_bytes(Path::new("x"), &bytes).unwrap(), baked);
    assert_eq!(
        to_bytes(&sheets()),
        bytes,
        "same input and options, same bytes"
    );
}

#[test]
fn blocks_take_a_quarter_and_come_back_as_they_were() {
    let plain = sheets();
    let mut baked = plain.clone();
    let atlas = &mut baked.impostors.as_mut().unwrap().atlas;
    atlas.compress();
    let before = &plain.impostors.as_ref().unwrap().atlas;
    let share = before.size_bytes() as f64 / atlas.size_bytes() as f64;
    assert!((3.9..=4.0).contains(&share), "{share}");
    // What shows stays near: colours and coverage on average, and body parts but for a few.
    let shown = before.color.iter().filter(|c| c[3] > 0).count() as f64;
    let mut sum = 0.0;
    for (a, b) in before.color.iter().zip(&atlas.color) {
        let squares = a
            .iter()
            .zip(b)
            .map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2));
        sum += if a[3] > 0 {
            squares.sum::<f64>() / 4.0
        } else {
            0.0
        };
    }
    assert!((sum / shown).sqrt() < 12.0, "{}", (sum / shown).sqrt());
    let texels = before
        .color
        .iter()
        .zip(before.surface.iter().zip(&atlas.surface));
    let wrong = texels
        .filter(|(c, (a, b))| c[3] > 0 && a[2] != b[2])
        .count() as f64;
    assert!(wrong / shown < 0.02, "{}", wrong / shown);

    let bytes = to_bytes(&baked);
    assert_eq!(from_bytes(Path::new("x"), &bytes).unwrap(), baked);
}

#[test]
fn broken_blocks_are_named() {
    type Break = fn(&mut Blocks, &mut [u32; 2]);
    let broken: [(&str, Break); 4] = [
        ("ICOL: block 3 has a mode", |b, _| b.color[3].0 = [1; 16]),
        ("ISUR: block 0 has a mode", |b, _| b.surface[0].0 = [0; 16]),
        ("ISUR: it has", |b, _| b.surface.truncate(7)),
        ("ICOL: impostors, atlas: its size", |_, size| {
            *size = [1 << 31, 64]
        }),
    ];
    for (words, break_it) in broken {
        let mut baked = sheets();
        let atlas = &mut baked.impostors.as_mut().unwrap().atlas;
        atlas.compress();
        let mut size = [atlas.width, atlas.height];
        break_it(atlas.blocks.as_mut().unwrap(), &mut size);
        [atlas.width, atlas.height] = size;
        let error = from_bytes(Path::new("x"), &to_bytes(&baked))
            .unwrap_err()
            .to_string();
        assert!(error.contains(words), "{words}: {error}");
    }
}

#[test]
fn senseless_impostors_never_panic_and_what_passes_is_valid() {
    let mut compressed = sheets();
    compressed.impostors.as_mut().unwrap().atlas.compress();
    let files = [to_bytes(&sheets()), to_bytes(&compressed)];
    let mut random = Random(5);
    for i in 0..1500 {
        let mut broken = files[i % 2].clone();
        for _ in 0..1 + random.below(3) {
            // Half of them in the records, where the counts are.
            let range = if random.below(2) == 0 {
                8192
            } else {
                broken.len() - 32
            };
            let at = 32 + random.below(range.min(broken.len() - 32));
            broken[at] = random.below(256) as u8;
        }
        if let Ok(baked) = from_bytes(Path::new("x"), &sealed(broken)) {
            throng_bake::validate::validate(&baked).unwrap();
        }
    }
}

/// What spoils impostors.
type Break = fn(&mut Impostors);

#[test]
fn each_broken_rule_is_named() {
    let broken: [(&str, Break); 23] = [
        ("its mips", |i| i.atlas.mip_count = 9),
        ("size is not valid", |i| i.atlas.width = 65),
        ("its pixels", |i| i.atlas.height += 64),
        ("ISUR: 3 bytes", |_| ()),
        ("unit vectors", |i| i.view_sets[0].directions[0] *= 2.0),
        ("unit vectors", |i| i.view_sets[0].rights[3].x = f32::NAN),
        ("cell names a direction", |i| {
            i.view_sets[0].cells[77][2] = 999
        }),
        ("cubes", |i| i.view_sets[0].cells.truncate(5)),
        ("axes", |i| i.view_sets[0].rights.truncate(5)),
        ("not whole", |i| {
            let set = &mut i.view_sets[0];
            set.directions.resize(2049, glam::Vec3::X);
            set.rights.resize(2049, glam::Vec3::Y);
        }),
        ("its plane", |i| i.tiles[0].lean = [9.0, 0.0, 0.0]),
        ("not those of the clips", |i| i.clip_poses.clear()),
        ("do not follow", |i| i.clip_poses[0].pose_count = 0),
        ("tiles do not exist", |i| {
            i.clip_poses[0].pose_count = u32::MAX
        }),
        ("out of order", |i| i.kinds.swap(0, 1)),
        ("there are none", |i| {
            i.kinds.clear();
            i.clip_poses.clear();
        }),
        ("its quads do not exist", |i| i.kinds[0].quad_count = 60),
        ("error curve", |i| i.kinds[0].errors[1].height_px = 8.0),
        ("its joint does not exist", |i| i.quads[0].joint = 2),
        ("its depth", |i| i.quads[0].depth_extent = 0.0),
        ("view set does not exist", |i| i.quads[0].view_set = 9),
        ("outside the atlas", |i| i.tiles[0].texel[1] = 60_000),
        ("every mip", |i| {
            let filled = i.tiles.iter_mut().find(|t| t.size[0] > 0);
            filled.unwrap().size[0] -= 1;
        }),
    ];
    for (words, break_it) in broken {
        let mut baked = sheets();
        let impostors = baked.impostors.as_mut().unwrap();
        break_it(impostors);
        let mut bytes = to_bytes(&baked);
        if words.starts_with("ISUR") {
            // A section that is no whole number of texels.
            let entry = (0..13)
                .map(|i| 32 + 24 * i)
                .find(|&at| &bytes[at..at + 4] == b"ISUR")
                .unwrap();
            bytes[entry + 16..entry + 24].copy_from_slice(&3u64.to_le_bytes());
            bytes = sealed(bytes);
        }
        let error = from_bytes(Path::new("x.throng"), &bytes)
            .expect_err("it must be refused")
            .to_string();
        assert!(
            error.starts_with("x.throng: ") && error.contains(words),
            "{words}: {error}"
        );
    }
}
