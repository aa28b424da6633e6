//! The nearest block to given texels, by lines through their principal axes and rounds of least squares.

use glam::Vec4;

use super::{Block, STEPS_2, STEPS_4, Texels, mixed, rotate};

/// How much texels and channels matter to an encoder.
#[derive(Debug, Clone, Copy)]
pub struct Weights {
    /// Of each texel in all channels.
    pub texels: [f32; 16],
    /// Of each channel's square of difference.
    pub channels: Vec4,
}

/// Rounds in which ends are fitted to the steps chosen before.
const ROUNDS: usize = 3;

/// Writes a block, the lowest bits first.
pub(super) struct Writer {
    bits: u128,
    at: u32,
}

impl Writer {
    pub fn new(mode: u32) -> Self {
        Self {
            bits: 1 << mode,
            at: mode + 1,
        }
    }

    pub fn put(&mut self, n: u32, count: u32) {
        self.bits |= u128::from(n) << self.at;
        self.at += count;
    }

    pub fn put_indices(&mut self, indices: &[usize; 16], width: u32) {
        for (i, &index) in indices.iter().enumerate() {
            self.put(index as u32, width - u32::from(i == 0));
        }
    }

    pub fn block(self) -> Block {
        debug_assert_eq!(self.at, 128);
        Block(self.bits.to_le_bytes())
    }
}

/// The nearest block that this encoder finds.
pub fn encode(texels: &Texels, weights: &Weights) -> Block {
    let mut best = encode_6(texels, weights, None);
    for rotation in 0..4 {
        let block = encode_5(texels, weights, rotation, None);
        if block.0 < best.0 {
            best = block;
        }
    }
    best.1
}

/// The nearest block that this encoder finds of those that keep the third channel, whose values are labels, of which nothing
/// lies between: exactly, wherever a block can. Where it has more labels than a block can hold, `cost` says what it costs to
/// show the second in the place of the first, for a texel of weight 1.
pub fn encode_labels(texels: &Texels, weights: &Weights, cost: &dyn Fn(u8, u8) -> f32) -> Block {
    /// The channel of labels, and the rotation that holds it apart.
    const LABELS: usize = 2;
    let mut labels: Vec<(u8, f32)> = Vec::new();
    for (texel, weight) in texels.iter().zip(weights.texels) {
        match labels.iter_mut().find(|l| l.0 == texel[LABELS]) {
            Some(l) => l.1 += weight,
            None => labels.push((texel[LABELS], weight)),
        }
    }
    labels.sort_by(|a, b| b.1.total_cmp(&a.1));
    let ends = label_ends(&labels, cost);
    let values = label_values(ends);
    let indices = texels.map(|texel| nearest_label(texel[LABELS], &values, cost).1);
    let mut weights = *weights;
    weights.channels[LABELS] = 0.0;
    let apart = encode_5(texels, &weights, LABELS + 1, Some((ends, indices)));
    match labels[..] {
        [(label, _)] => {
            let along = encode_6(texels, &weights, Some((LABELS, label)));
            if along.0 < apart.0 { along } else { apart }.1
        }
        _ => apart.1,
    }
}

/// What a block of mode 5 can hold in the channel that it holds apart.
fn label_values(ends: [u8; 2]) -> [u8; 4] {
    STEPS_2.map(|step| mixed(ends[0].into(), ends[1].into(), step))
}

/// The cost and the place of the value that stands for a label.
fn nearest_label(label: u8, values: &[u8; 4], cost: &dyn Fn(u8, u8) -> f32) -> (f32, usize) {
    match values.iter().position(|&v| v == label) {
        Some(exact) => (0.0, exact),
        None => (0..4)
            .map(|i| (cost(label, values[i]), i))
            .fold((f32::INFINITY, 0), |a, b| if b.0 < a.0 { b } else { a }),
    }
}

/// The two ends between which labels are found at the least cost; `labels` with their weights, the heaviest first.
fn label_ends(labels: &[(u8, f32)], cost: &dyn Fn(u8, u8) -> f32) -> [u8; 2] {
    /// More than these are not tried as ends.
    const TRIED: usize = 5;
    let heaviest = [labels[0].0, labels.get(1).unwrap_or(&labels[0]).0];
    if labels.len() < 3 {
        return heaviest;
    }
    let total = |ends: [u8; 2]| -> f32 {
        let values = label_values(ends);
        let costs = labels.iter();
        costs
            .map(|l| l.1 * nearest_label(l.0, &values, cost).0)
            .sum()
    };
    let mut best = (total(heaviest), heaviest);
    let several = &labels[..labels.len().min(TRIED)];
    for a in several {
        for b in several.iter().filter(|b| b.0 != a.0) {
            // Two labels at two of the four steps fix the ends, but for rounding.
            for (i, j) in [(0, 3), (0, 1), (0, 2), (1, 2)] {
                let (s, t) = (STEPS_2[i] as f32 / 64.0, STEPS_2[j] as f32 / 64.0);
                let slope = (f32::from(b.0) - f32::from(a.0)) / (t - s);
                let low = f32::from(a.0) - slope * s;
                let [low, high] = [low, low + slope].map(|e| e.round() as i32);
                for (dl, dh) in [(0, 0), (0, 1), (0, -1), (1, 0), (-1, 0)] {
                    if let (Ok(low), Ok(high)) = (u8::try_from(low + dl), u8::try_from(high + dh)) {
                        let cost = total([low, high]);
                        if cost < best.0 {
                            best = (cost, [low, high]);
                        }
                    }
                }
            }
        }
    }
    best.1
}

/// A block of mode 6 and its weighted square of difference. `fixed`: a channel that is the same number everywhere, exactly.
fn encode_6(texels: &Texels, weights: &Weights, fixed: Option<(usize, u8)>) -> (f32, Block) {
    let points = texels.map(|t| Vec4::from(t.map(f32::from)));
    let quantize = |end: Vec4| {
        let with = |last: u32| {
            end.to_array()
                .map(|x| (((x - last as f32) * 0.5 + 0.5).clamp(0.0, 127.0) as u32) << 1 | last)
        };
        let mut best = (f32::INFINITY, [0; 4]);
        for last in 0..2 {
            let mut n = with(last);
            if let Some((channel, value)) = fixed {
                if u32::from(value & 1) != last {
                    continue;
                }
                n[channel] = value.into();
            }
            let d = Vec4::from(n.map(|n| n as f32)) - end;
            let error = (d * d).dot(weights.channels);
            if error < best.0 {
                best = (error, n);
            }
        }
        best.1
    };
    let line = fit::<16>(&points, weights, &STEPS_4, &quantize);
    let Line {
        mut ends,
        mut indices,
        error,
    } = line;
    if indices[0] >= 8 {
        ends.swap(0, 1);
        indices = indices.map(|i| 15 - i);
    }
    let mut w = Writer::new(6);
    for channel in 0..4 {
        for end in ends {
            w.put(end[channel] >> 1, 7);
        }
    }
    for end in ends {
        w.put(end[0] & 1, 1);
    }
    w.put_indices(&indices, 4);
    (error, w.block())
}

/// A block of mode 5 and its weighted square of difference. `labels`: ends and indices of the channel that is held apart.
fn encode_5(
    texels: &Texels,
    weights: &Weights,
    rotation: usize,
    labels: Option<([u8; 2], [usize; 16])>,
) -> (f32, Block) {
    let texels = texels.map(|mut texel| {
        rotate(&mut texel, rotation);
        texel
    });
    let mut channels = weights.channels.to_array();
    if rotation > 0 {
        channels.swap(3, rotation - 1);
    }
    let of_three = Weights {
        channels: Vec4::from(channels) * Vec4::new(1.0, 1.0, 1.0, 0.0),
        ..*weights
    };
    let points = texels.map(|t| Vec4::new(t[0].into(), t[1].into(), t[2].into(), 0.0));
    let three = fit::<4>(&points, &of_three, &STEPS_2, &|end| {
        end.to_array().map(|x| {
            let n = (x * (127.0 / 255.0) + 0.5).clamp(0.0, 127.0) as u32;
            n << 1 | n >> 6
        })
    });
    let one = match labels {
        Some((ends, indices)) => Line {
            ends: ends.map(|end| [end.into(); 4]),
            indices,
            error: 0.0,
        },
        None => {
            let of_one = Weights {
                channels: Vec4::splat(0.25 * channels[3]),
                ..*weights
            };
            let points = texels.map(|t| Vec4::splat(t[3].into()));
            fit::<4>(&points, &of_one, &STEPS_2, &|end| {
                end.to_array().map(|x| (x + 0.5).clamp(0.0, 255.0) as u32)
            })
        }
    };
    let error = three.error + one.error;
    let [three, one] = [three, one].map(|mut line| {
        if line.indices[0] >= 2 {
            line.ends.swap(0, 1);
            line.indices = line.indices.map(|i| 3 - i);
        }
        line
    });
    let mut w = Writer::new(5);
    w.put(rotation as u32, 2);
    for channel in 0..3 {
        for end in three.ends {
            w.put(end[channel] >> 1, 7);
        }
    }
    for end in one.ends {
        w.put(end[0], 8);
    }
    w.put_indices(&three.indices, 2);
    w.put_indices(&one.indices, 2);
    (error, w.block())
}

/// A line through the texels: ends as they are decoded, and a step for each texel.
struct Line {
    ends: [[u32; 4]; 2],
    indices: [usize; 16],
    error: f32,
}

/// The best line found whose ends `quantize` can say, with `STEPS` steps.
fn fit<const STEPS: usize>(
    points: &[Vec4; 16],
    weights: &Weights,
    steps: &[u32; STEPS],
    quantize: &dyn Fn(Vec4) -> [u32; 4],
) -> Line {
    let mut ends = principal_ends(points, weights);
    let mut best = Line {
        ends: [[0; 4]; 2],
        indices: [0; 16],
        error: f32::INFINITY,
    };
    for _ in 0..ROUNDS {
        let whole = ends.map(quantize);
        let line = assign(points, weights, steps, whole);
        let better = line.error < best.error;
        if better {
            best = line;
        }
        if !better || best.error == 0.0 {
            break;
        }
        let Some(next) = least_squares(points, weights, &best.indices, steps) else {
            break;
        };
        ends = next;
    }
    best
}

/// The nearest step for every texel.
fn assign<const STEPS: usize>(
    points: &[Vec4; 16],
    weights: &Weights,
    steps: &[u32; STEPS],
    ends: [[u32; 4]; 2],
) -> Line {
    let values: [Vec4; STEPS] = std::array::from_fn(|s| {
        Vec4::from_array(std::array::from_fn(|c| {
            mixed(ends[0][c], ends[1][c], steps[s]).into()
        }))
    });
    let along = (values[STEPS - 1] - values[0]) * weights.channels;
    let length = along.dot(values[STEPS - 1] - values[0]);
    let scale = if length > 0.0 {
        (STEPS - 1) as f32 / length
    } else {
        0.0
    };
    let mut error = 0.0;
    let indices = std::array::from_fn(|i| {
        // Steps are even but for rounding, so the nearest is at most one from where they would be.
        let guess = ((points[i] - values[0]).dot(along) * scale + 0.5).max(0.0) as usize;
        let guess = guess.min(STEPS - 1);
        let near = (guess.saturating_sub(1)..STEPS).take(3);
        let best = near
            .map(|s| {
                let d = points[i] - values[s];
                ((d * d).dot(weights.channels), s)
            })
            .fold((f32::INFINITY, 0), |a, b| if b.0 < a.0 { b } else { a });
        error += weights.texels[i] * best.0;
        best.1
    });
    Line {
        ends,
        indices,
        error,
    }
}

/// Ends of the line along which the texels differ most.
fn principal_ends(points: &[Vec4; 16], weights: &Weights) -> [Vec4; 2] {
    let weighted = || points.iter().zip(weights.texels);
    let total: f32 = weights.texels.iter().sum();
    let mean = weighted().map(|(p, w)| *p * w).sum::<Vec4>() / total.max(1e-6);
    // Stretched by the channels' weights, then back.
    let stretch = Vec4::from(weights.channels.to_array().map(f32::sqrt));
    let mut covariance = glam::Mat4::ZERO;
    for (p, w) in weighted() {
        let d = (*p - mean) * stretch;
        for c in 0..4 {
            *covariance.col_mut(c) += d * (d[c] * w);
        }
    }
    let mut axis = (0..4).map(|c| covariance.col(c)).fold(Vec4::ZERO, |a, b| {
        if b.length_squared() > a.length_squared() {
            b
        } else {
            a
        }
    });
    for _ in 0..6 {
        let next = covariance * axis;
        axis = next * next.length_recip();
        if !axis.is_finite() {
            return [mean; 2];
        }
    }
    let (mut low, mut high) = (0.0f32, 0.0f32);
    for (p, w) in weighted() {
        if w > 0.0 {
            let t = ((*p - mean) * stretch).dot(axis);
            (low, high) = (low.min(t), high.max(t));
        }
    }
    let back = |t: f32| {
        let x = axis * t;
        mean + Vec4::from_array(std::array::from_fn(|c| {
            if stretch[c] > 0.0 {
                x[c] / stretch[c]
            } else {
                0.0
            }
        }))
    };
    [back(low), back(high)]
}

/// The ends that are nearest to the texels with these steps; `None` where all have the same.
fn least_squares<const STEPS: usize>(
    points: &[Vec4; 16],
    weights: &Weights,
    indices: &[usize; 16],
    steps: &[u32; STEPS],
) -> Option<[Vec4; 2]> {
    let (mut aa, mut ab, mut bb) = (0.0f32, 0.0f32, 0.0f32);
    let (mut ap, mut bp) = (Vec4::ZERO, Vec4::ZERO);
    for (i, point) in points.iter().enumerate() {
        let b = steps[indices[i]] as f32 / 64.0;
        let (a, w) = (1.0 - b, weights.texels[i]);
        aa += w * a * a;
        ab += w * a * b;
        bb += w * b * b;
        ap += *point * (w * a);
        bp += *point * (w * b);
    }
    let determinant = aa * bb - ab * ab;
    (determinant > 1e-4).then(|| {
        [
            (ap * bb - bp * ab) / determinant,
            (bp * aa - ap * ab) / determinant,
        ]
    })
}
