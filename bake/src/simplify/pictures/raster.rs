//! Which pixels a triangle covers.

use super::{Rectangle, SIZE};

/// A row of pixels that a triangle covers: index of the first, how many, barycentric coordinates in the middle of the first
/// and how they change from one to the next.
pub(super) struct Span {
    pub first: usize,
    pub len: usize,
    pub at: [f32; 3],
    pub step: [f32; 3],
}

/// Calls `row` for the pixels of `area` whose middle a triangle covers; not at all where it shows its back, unless it has no
/// back.
pub(super) fn raster(
    [a, b, c]: [[f32; 3]; 3],
    double_sided: bool,
    area: Rectangle,
    mut row: impl FnMut(Span),
) {
    let outside = |k: usize| {
        a[k].max(b[k]).max(c[k]) < area.low[k] as f32
            || a[k].min(b[k]).min(c[k]) > area.high[k] as f32
    };
    if outside(0) || outside(1) {
        return;
    }
    let (ab, ac) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
    let twice = ab[0] * ac[1] - ab[1] * ac[0];
    // Written so that what is not a number is not drawn.
    let visible = twice > 0.0 || (double_sided && twice < 0.0);
    if !visible {
        return;
    }
    let range = |k: usize| {
        // A number rounded down is a whole one that is not less.
        let low = (a[k].min(b[k]).min(c[k]) + 0.5).max(0.0) as usize;
        let high = (a[k].max(b[k]).max(c[k]) + 0.5).max(0.0) as usize;
        low.max(area.low[k])..high.min(area.high[k])
    };
    let inverse = 1.0 / twice;
    let (du, dv) = (ac[1] * inverse, -ab[1] * inverse);
    let step = [-du - dv, du, dv];
    let per_step = step.map(|d| 1.0 / d);
    let columns = range(0);
    let px = columns.start as f32 + 0.5 - a[0];
    let width = columns.len() as f32 - 1.0;
    for y in range(1) {
        let py = y as f32 + 0.5 - a[1];
        let u = (px * ac[1] - py * ac[0]) * inverse;
        let v = (ab[0] * py - ab[1] * px) * inverse;
        let at = [1.0 - u - v, u, v];
        // Columns in which no coordinate is negative.
        let (mut low, mut high) = (0.0f32, width);
        for k in 0..3 {
            let zero = -at[k] * per_step[k];
            if step[k] > 0.0 {
                low = low.max(zero);
            } else if step[k] < 0.0 {
                high = high.min(zero);
            } else if at[k] < 0.0 {
                high = -1.0;
            }
        }
        // The next whole number; none of them is negative.
        let whole = low as usize as f32;
        let low = if whole < low { whole + 1.0 } else { whole };
        if high >= low {
            row(Span {
                first: y * SIZE + columns.start + low as usize,
                len: (high - low) as usize + 1,
                at: [0, 1, 2].map(|k| at[k] + step[k] * low),
                step,
            });
        }
    }
}
