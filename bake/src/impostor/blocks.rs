//! Atlases in BC7 blocks: a quarter of the bytes.
//!
//! Colour with outline is one picture of four channels that go together. In the surface, body parts with their tint rules
//! are labels, of which nothing lies between: they are kept exactly wherever a block can hold them, and of the others those go
//! whose tints differ least.

use glam::Vec4;
use rayon::prelude::*;

use super::Atlas;
use crate::bc7::{Block, Texels, Weights, ZERO, decode, encode, encode_labels};
use crate::tint::spread;

/// Red, green, blue and outline: about how bright they are, and the outline as much as all.
const COLOR_WEIGHTS: Vec4 = Vec4::new(0.8, 1.6, 0.5, 1.6);
/// Normals light what they cover; depth shifts it a little. Parts are labels.
const SURFACE_WEIGHTS: Vec4 = Vec4::new(1.0, 1.0, 0.0, 0.4);
/// Outline of a texel that is half of one outside; what is further out is covered by nothing.
const HALF_OUTSIDE: u8 = 64;
/// What a texel that nothing covers matters: its colour is filtered into the edge, its surface is hardly ever looked up.
const UNCOVERED_COLOR: f32 = 0.5;
const UNCOVERED_SURFACE: f32 = 0.02;

/// Both pictures of an atlas in blocks: mips one after the other, each in rows of `width.div_ceil(4)`. What a block has
/// beyond the edges of its mip is not shown.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Blocks {
    /// [`Atlas::color`].
    pub color: Vec<Block>,
    /// [`Atlas::surface`].
    pub surface: Vec<Block>,
}

impl Blocks {
    /// Bytes of both pictures.
    pub fn size_bytes(&self) -> u64 {
        ((self.color.len() + self.surface.len()) * size_of::<Block>()) as u64
    }
}

impl Atlas {
    /// Columns and rows of blocks in a mip, and the first of them.
    pub fn block_mip(&self, mip: u32) -> (u32, u32, usize) {
        let size = |m: u32| [self.width >> m, self.height >> m].map(|n| n.div_ceil(4));
        let first = (0..mip).map(|m| {
            let [columns, rows] = size(m);
            columns as usize * rows as usize
        });
        let [columns, rows] = size(mip);
        (columns, rows, first.sum())
    }

    /// Makes [`Atlas::blocks`]; colour and surface become what these decode to. The same atlas gives the same blocks.
    pub fn compress(&mut self) {
        let (mut color, mut surface) = (Vec::new(), Vec::new());
        for mip in 0..self.mip_count {
            let (columns, rows, _) = self.block_mip(mip);
            let count = columns as usize * rows as usize;
            let blocks: Vec<[Block; 2]> = (0..count)
                .into_par_iter()
                .map(|i| {
                    let at = [i as u32 % columns, i as u32 / columns];
                    self.encode(mip, at)
                })
                .collect();
            color.extend(blocks.iter().map(|b| b[0]));
            surface.extend(blocks.iter().map(|b| b[1]));
        }
        let blocks = Blocks { color, surface };
        // Blocks of our own encoder have modes that our own decoder reads.
        if self.show(&blocks).is_ok() {
            self.blocks = Some(blocks);
        }
    }

    /// Colour and surface as `blocks` have them, which are as many as the atlas's size says.
    ///
    /// Errors: the first block whose mode bakers do not write: 0 for colours or 1 for surfaces, and its index.
    pub(super) fn show(&mut self, blocks: &Blocks) -> Result<(), (usize, usize)> {
        let texels = self.mip(self.mip_count).2;
        let mut shown = [vec![[0; 4]; texels], vec![[0; 4]; texels]];
        for (picture, blocks) in [&blocks.color, &blocks.surface].into_iter().enumerate() {
            for mip in 0..self.mip_count {
                let (width, height, first) = self.mip(mip);
                let (columns, rows, first_block) = self.block_mip(mip);
                for (x, y) in (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))) {
                    let index = first_block + (y * columns + x) as usize;
                    let decoded = decode(&blocks[index]).ok_or((picture, index))?;
                    for row in 0..4.min(height - 4 * y) {
                        let to = first + ((4 * y + row) * width + 4 * x) as usize;
                        let count = 4.min(width - 4 * x) as usize;
                        let from = &decoded[4 * row as usize..][..count];
                        shown[picture][to..to + count].copy_from_slice(from);
                    }
                }
            }
        }
        [self.color, self.surface] = shown;
        Ok(())
    }

    /// The block at a column and row of blocks: colour and surface.
    fn encode(&self, mip: u32, [x, y]: [u32; 2]) -> [Block; 2] {
        let (width, height, first) = self.mip(mip);
        let texels = |picture: &[[u8; 4]]| -> Texels {
            std::array::from_fn(|i| {
                // Beyond the edge of the mip as at the edge.
                let column = (4 * x + i as u32 % 4).min(width - 1);
                let row = (4 * y + i as u32 / 4).min(height - 1);
                picture[first + (row * width + column) as usize]
            })
        };
        let (color, surface) = (texels(&self.color), texels(&self.surface));
        let is_covered = color.map(|t| t[3] >= HALF_OUTSIDE);
        if !is_covered.contains(&true) {
            // The colours of such a block are never filtered into anything: what is covered has an empty texel around it.
            let weights = Weights {
                texels: [1.0; 16],
                channels: COLOR_WEIGHTS,
            };
            let color = match color.iter().all(|&t| t == [0; 4]) {
                true => ZERO,
                false => encode(&color, &weights),
            };
            return [color, encode_labels(&[surface[0]; 16], &weights, &cost)];
        }
        let weights = |uncovered: f32, channels| Weights {
            texels: is_covered.map(|covered| if covered { 1.0 } else { uncovered }),
            channels,
        };
        [
            encode(&color, &weights(UNCOVERED_COLOR, COLOR_WEIGHTS)),
            encode_labels(
                &surface,
                &weights(UNCOVERED_SURFACE, SURFACE_WEIGHTS),
                &cost,
            ),
        ]
    }
}

/// What it costs to show a texel in the tint of another part: both tints are off their mean, each by its own chance.
fn cost(part: u8, shown: u8) -> f32 {
    spread(part) + spread(shown)
}
