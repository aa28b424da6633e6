//! Impostors' pictures in blocks: the driver reads them as the bake's decoder does, whatever was added beside them.

mod common;

use common::{Random, assert_silent, baked_mascot_with_impostors, options, view};
use glam::Vec3;
use throng::gpu::{Headless, HeadlessDesc};
use throng::{Agent, CharacterId, FrameOptions, Method, RenderError};
use throng_bake::baked::Baked;

const SIZE: [u32; 2] = [256, 192];

/// A character whose pictures are compressed noise: every block is another.
fn compressed(seed: u32) -> Baked {
    let mut baked = baked_mascot_with_impostors();
    let atlas = &mut baked.impostors.as_mut().expect("it has them").atlas;
    let mut random = Random(seed);
    let mut byte = || (random.unit() * 256.0) as u8;
    for (color, surface) in atlas.color.iter_mut().zip(&mut atlas.surface) {
        *color = [byte(), byte(), byte(), 255 - byte() / 4];
        *surface = [byte(), byte(), byte() % 3, 100 + byte() / 5];
    }
    atlas.compress();
    baked
}

/// The same as texels.
fn as_texels(mut baked: Baked) -> Baked {
    baked.impostors.as_mut().expect("it has them").atlas.blocks = None;
    baked
}

fn headless(block_textures: bool) -> Headless {
    let desc = HeadlessDesc {
        size_px: SIZE,
        validation: true,
        block_textures,
        ..HeadlessDesc::default()
    };
    Headless::new(&desc)
        .expect("a Vulkan device and the validation layer (tools/test installs them)")
}

fn picture(headless: &mut Headless, character: CharacterId, method: Method) -> Vec<[u8; 4]> {
    let agents = [-1.2, 0.0, 1.2].map(|x| Agent {
        position: Vec3::new(x, 0.0, -4.0),
        heading: 3.0 * x,
        character,
        ..Agent::default()
    });
    let options = FrameOptions {
        ground: false,
        shadows: false,
        sky: false,
        ..options(method)
    };
    headless
        .render(&agents, &view(SIZE), &options)
        .expect("a frame");
    headless.read_image().expect("a picture")
}

/// Pixels that differ by more than rounding.
fn differing(a: &[[u8; 4]], b: &[[u8; 4]]) -> usize {
    let far = |(a, b): &(&[u8; 4], &[u8; 4])| (0..4).any(|c| a[c].abs_diff(b[c]) > 1);
    a.iter().zip(b).filter(far).count()
}

#[test]
fn the_driver_decodes_as_the_bake_does() {
    let all = [compressed(1), compressed(2), compressed(3)];
    for method in [Method::Quad, Method::Flat] {
        let (mut blocks, mut texels) = (headless(true), headless(false));
        let mut ids = Vec::new();
        // One after the other, so that the gallery grows around those that are there.
        for baked in &all {
            let (a, b) = (blocks.add_character(baked), texels.add_character(baked));
            let id = a.expect("it uploads");
            assert_eq!(id, b.expect("it uploads"));
            ids.push(id);
            let (a, b) = (
                picture(&mut blocks, ids[0], method),
                picture(&mut texels, ids[0], method),
            );
            assert_eq!(
                differing(&a, &b),
                0,
                "{method:?}: with {} characters",
                ids.len()
            );
        }
        let [first, last] = [ids[0], ids[2]].map(|id| picture(&mut blocks, id, method));
        assert!(differing(&first, &last) > 500, "the comparison can fail");
        let decoded = picture(&mut texels, ids[2], method);
        assert_eq!(differing(&last, &decoded), 0, "{method:?}");
        assert_silent(&blocks);
        assert_silent(&texels);
    }
}

#[test]
fn characters_without_blocks_stay_among_themselves() {
    let (plain, baked) = (as_texels(compressed(1)), compressed(2));
    // Blocks first: texels do not fit.
    let mut blocks = headless(true);
    blocks.add_character(&baked).expect("it uploads");
    let error = blocks.add_character(&plain).expect_err("it is refused");
    assert!(matches!(error, RenderError::BadCharacter { .. }), "{error}");
    assert!(error.to_string().contains("--compress on"), "{error}");
    let id = blocks.add_character(&baked).expect("it is as before");

    // Texels first: blocks are decoded.
    let mut texels = headless(true);
    texels.add_character(&plain).expect("it uploads");
    let decoded = texels.add_character(&baked).expect("it uploads");
    for method in [Method::Quad, Method::Flat] {
        let pictures = (
            picture(&mut blocks, id, method),
            picture(&mut texels, decoded, method),
        );
        assert_eq!(differing(&pictures.0, &pictures.1), 0, "{method:?}");
    }
    assert_silent(&blocks);
    assert_silent(&texels);
}
