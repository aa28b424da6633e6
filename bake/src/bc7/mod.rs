//! BC7 blocks: 4x4 texels of four channels in 16 bytes, a quarter of what they take as they are.
//!
//! Two of the format's eight modes are written, and nothing else is read. Mode 6 has 16 steps along one line through all
//! four channels. Mode 5 has 4 steps along a line through three channels, and 4 more for the one that is left, whichever it
//! is, with ends of 8 bits: so that one channel may hold numbers that must not be mixed.
//!
//! Source: Khronos Data Format Specification 1.3, §20.4 (BPTC).

mod encode;

pub use encode::{Weights, encode, encode_labels};

/// A block as the device reads it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub struct Block(pub [u8; 16]);

/// 4x4 texels, rows from the top.
pub type Texels = [[u8; 4]; 16];

/// Shares of the second end in sixty-fourths, for indices of 2 and of 4 bits.
const STEPS_2: [u32; 4] = [0, 21, 43, 64];
const STEPS_4: [u32; 16] = [0, 4, 9, 13, 17, 21, 26, 30, 34, 38, 43, 47, 51, 55, 60, 64];
/// The block whose channels are all 0.
pub const ZERO: Block = {
    let mut bytes = [0; 16];
    bytes[0] = 1 << 6;
    Block(bytes)
};

/// The texels of a block; `None` where its mode is neither 5 nor 6.
pub fn decode(block: &Block) -> Option<Texels> {
    let mut bits = Bits(u128::from_le_bytes(block.0));
    let mode = bits.0.trailing_zeros();
    bits.take(mode + 1);
    match mode {
        5 => Some(decode_5(bits)),
        6 => Some(decode_6(bits)),
        _ => None,
    }
}

fn decode_5(mut bits: Bits) -> Texels {
    let rotation = bits.take(2) as usize;
    let mut ends = [[0; 4]; 2];
    for channel in 0..3 {
        for end in &mut ends {
            let n = bits.take(7);
            end[channel] = n << 1 | n >> 6;
        }
    }
    for end in &mut ends {
        end[3] = bits.take(8);
    }
    let three = bits.indices::<2>();
    let one = bits.indices::<2>();
    std::array::from_fn(|i| {
        let mut texel = [0, 1, 2, 3].map(|channel| {
            let index = if channel == 3 { one[i] } else { three[i] };
            mixed(ends[0][channel], ends[1][channel], STEPS_2[index])
        });
        rotate(&mut texel, rotation);
        texel
    })
}

fn decode_6(mut bits: Bits) -> Texels {
    let mut ends = [[0; 4]; 2];
    for channel in 0..4 {
        for end in &mut ends {
            end[channel] = bits.take(7) << 1;
        }
    }
    for end in &mut ends {
        let last = bits.take(1);
        end.iter_mut().for_each(|n| *n |= last);
    }
    let indices = bits.indices::<4>();
    indices.map(|index| {
        std::array::from_fn(|channel| mixed(ends[0][channel], ends[1][channel], STEPS_4[index]))
    })
}

/// Swaps the channel that mode 5 holds apart with the last one: none, red, green or blue.
fn rotate(texel: &mut [u8; 4], rotation: usize) {
    if rotation > 0 {
        texel.swap(3, rotation - 1);
    }
}

/// What lies between two ends.
fn mixed(a: u32, b: u32, step: u32) -> u8 {
    (((64 - step) * a + step * b + 32) >> 6) as u8
}

/// The bits of a block, the lowest first.
struct Bits(u128);

impl Bits {
    fn take(&mut self, count: u32) -> u32 {
        let n = (self.0 & ((1 << count) - 1)) as u32;
        self.0 >>= count;
        n
    }

    /// Indices of `WIDTH` bits; the highest bit of the first is 0 and not stored.
    fn indices<const WIDTH: u32>(&mut self) -> [usize; 16] {
        std::array::from_fn(|i| self.take(WIDTH - u32::from(i == 0)) as usize)
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec4;

    use super::encode::Writer;
    use super::*;

    const EVEN: Weights = Weights {
        texels: [1.0; 16],
        channels: Vec4::ONE,
    };

    fn worst(a: &Texels, b: &Texels) -> u8 {
        let pairs = a.iter().flatten().zip(b.iter().flatten());
        pairs.map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0)
    }

    #[test]
    fn blocks_by_hand() {
        assert_eq!(decode(&ZERO), Some([[0; 4]; 16]));
        // Mode 6, red from 1 to 255 by last bits and seven ones, indices 1 everywhere: (60 * 1 + 4 * 255 + 32) >> 6 is 17.
        let mut w = Writer::new(6);
        for n in [0, 127, 0, 0, 0, 0, 0, 0] {
            w.put(n, 7);
        }
        w.put(1, 1);
        w.put(1, 1);
        w.put_indices(&[1; 16], 4);
        assert_eq!(decode(&w.block()), Some([[17, 1, 1, 1]; 16]));
        // Mode 5 with blue apart: its ends are 10 and 200, and step 2 of them (21 * 10 + 43 * 200 + 32) >> 6 = 138.
        let mut w = Writer::new(5);
        w.put(3, 2);
        for n in [64, 64, 0, 0, 127, 127] {
            w.put(n, 7);
        }
        w.put(10, 8);
        w.put(200, 8);
        w.put_indices(&[0; 16], 2);
        let mut indices = [2; 16];
        indices[0] = 1;
        w.put_indices(&indices, 2);
        let mut expected = [[129, 0, 138, 255]; 16];
        expected[0][2] = 72;
        assert_eq!(decode(&w.block()), Some(expected));
        // A mode that is not written is not read.
        assert_eq!(decode(&Block([1; 16])), None);
        assert_eq!(decode(&Block([0; 16])), None);
    }

    #[test]
    fn one_colour_is_exact_but_for_a_step() {
        for color in [[0, 0, 0, 0], [255; 4], [12, 200, 31, 255], [3, 4, 5, 6]] {
            let texels = [color; 16];
            let decoded = decode(&encode(&texels, &EVEN)).expect("its own mode");
            assert!(worst(&decoded, &texels) <= 1, "{color:?} {decoded:?}");
        }
    }

    #[test]
    fn what_lies_on_a_line_stays_near() {
        let texels: Texels = std::array::from_fn(|i| {
            let t = i as u8;
            [20 + 10 * t, 200 - 8 * t, 100, 255 - 5 * t]
        });
        let decoded = decode(&encode(&texels, &EVEN)).expect("its own mode");
        assert!(worst(&decoded, &texels) <= 2, "{decoded:?}");
    }

    #[test]
    fn an_edge_of_coverage_does_not_cost_the_colour() {
        // Coverage has nothing to do with the colour: one channel is held apart.
        let texels: Texels = std::array::from_fn(|i| {
            let t = i as u8;
            [60 + 5 * t, 80 + 5 * t, 40, if i % 4 < 2 { 255 } else { 0 }]
        });
        let decoded = decode(&encode(&texels, &EVEN)).expect("its own mode");
        assert!(worst(&decoded, &texels) <= 14, "{decoded:?}");
        assert!((0..16).all(|i| decoded[i][3] == texels[i][3]));
    }

    #[test]
    fn labels_are_exact() {
        let cost = |_: u8, shown: u8| f32::from(shown);
        // One label, two, and three or four that lie as steps do.
        for labels in [
            &[131][..],
            &[3, 192],
            &[64, 65, 67],
            &[10, 11, 12, 13],
            &[66, 2, 23],
        ] {
            let texels: Texels = std::array::from_fn(|i| {
                let t = i as u8;
                [100 + 6 * t, 128 + t, labels[i % labels.len()], 90 + 2 * t]
            });
            let decoded = decode(&encode_labels(&texels, &EVEN, &cost)).expect("its own mode");
            let exact = (0..16).all(|i| decoded[i][2] == texels[i][2]);
            assert!(exact, "{labels:?}: {decoded:?}");
        }
        // Three that do not: the heaviest two stay, the third becomes what costs least.
        let texels: Texels =
            std::array::from_fn(|i| [0, 0, if i == 5 { 250 } else { [7, 93][i % 2] }, 0]);
        let decoded = decode(&encode_labels(&texels, &EVEN, &cost)).expect("its own mode");
        assert_eq!(decoded[5][2], 7);
        assert!((0..16).all(|i| i == 5 || decoded[i][2] == texels[i][2]));
    }

    #[test]
    fn every_block_that_is_written_is_read() {
        // A generator of our own: 32 bits of a linear congruence.
        let mut state = 1u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        };
        let mut sum = 0.0;
        for _ in 0..500 {
            let texels: Texels = std::array::from_fn(|_| std::array::from_fn(|_| next()));
            let decoded = decode(&encode(&texels, &EVEN)).expect("its own mode");
            let pairs = decoded.iter().flatten().zip(texels.iter().flatten());
            sum += pairs
                .map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2))
                .sum::<f64>();
        }
        // Noise is the worst there is: a single colour for a block would be off by 71 in the mean of squares' root.
        let rms = (sum / (500.0 * 64.0)).sqrt();
        assert!(rms < 60.0, "{rms}");
    }
}
