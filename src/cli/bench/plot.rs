//! Plots as SVG.

use std::path::Path;

use anyhow::{Result, anyhow};
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;

use crate::cli::output::write_file;

const SIZE_PX: (u32, u32) = (900, 560);

/// A line of a plot.
pub struct Curve {
    pub name: String,
    /// Both greater than 0.
    pub points: Vec<(f64, f64)>,
    /// In pixels: a wide curve shows behind a thin one.
    pub width: u32,
}

/// Curves over two logarithmic axes, with a legend in the upper corner that they leave free.
pub fn curves(path: &Path, title: &str, axes: [&str; 2], curves: &[Curve]) -> Result<()> {
    let x = range(curves, |p| p.0);
    let y = range(curves, |p| p.1);
    let y = y.start * 0.8..y.end * 1.3;
    draw(path, |root| {
        let chart = chart(root, title, x.log_scale(), y.log_scale())?;
        draw_curves(chart, axes, curves)
    })
}

/// The same over two linear axes; the vertical one begins at 0.
pub fn linear_curves(path: &Path, title: &str, axes: [&str; 2], curves: &[Curve]) -> Result<()> {
    let x = range(curves, |p| p.0);
    let y = 0.0..range(curves, |p| p.1).end * 1.3;
    draw(path, |root| {
        draw_curves(chart(root, title, x, y)?, axes, curves)
    })
}

/// From the least to the greatest of all points.
fn range(curves: &[Curve], of: fn(&(f64, f64)) -> f64) -> std::ops::Range<f64> {
    let all = curves.iter().flat_map(|c| &c.points).map(of);
    let (low, high) = all.fold((f64::MAX, f64::MIN), |(low, high), x| {
        (low.min(x), high.max(x))
    });
    if low < high { low..high } else { 0.5..2.0 }
}

fn draw_curves<'a, 'b: 'a, X, Y>(
    mut chart: ChartContext<'a, SVGBackend<'b>, Cartesian2d<X, Y>>,
    axes: [&str; 2],
    curves: &[Curve],
) -> Result<()>
where
    X: Ranged<ValueType = f64> + ValueFormatter<f64>,
    Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
{
    chart
        .configure_mesh()
        .x_desc(axes[0])
        .y_desc(axes[1])
        .x_label_formatter(&|x| format!("{x:.0}"))
        .y_label_formatter(&|y| short(*y))
        .draw()
        .map_err(bad)?;
    for (i, curve) in curves.iter().enumerate() {
        let style = color(i).stroke_width(curve.width);
        chart
            .draw_series(LineSeries::new(curve.points.iter().copied(), style))
            .map_err(bad)?
            .label(&curve.name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], style));
    }
    let ends = curves
        .iter()
        .filter_map(|c| Some(c.points.last()?.1 - c.points.first()?.1));
    let falls = ends.sum::<f64>() < 0.0;
    chart
        .configure_series_labels()
        .position(match falls {
            true => SeriesLabelPosition::UpperRight,
            false => SeriesLabelPosition::UpperLeft,
        })
        .border_style(BLACK)
        .background_style(WHITE)
        .draw()
        .map_err(bad)
}

/// A bar.
pub struct Bar {
    pub name: String,
    /// Its length, greater than 0.
    pub value: f64,
    /// The least and the 95th percentile, as a line over its end.
    pub whisker: [f64; 2],
}

/// Bars beside each other over a logarithmic axis.
pub fn bars(path: &Path, title: &str, axis: &str, bars: &[Bar]) -> Result<()> {
    let low = bars
        .iter()
        .map(|b| b.whisker[0])
        .fold(f64::MAX, f64::min)
        .min(1e6)
        * 0.5;
    let high = bars.iter().map(|b| b.whisker[1]).fold(low * 4.0, f64::max) * 1.5;
    draw(path, |root| {
        let count = bars.len().max(1);
        let mut chart = chart(root, title, 0.0..count as f64, (low..high).log_scale())?;
        let name = |x: &f64| {
            let is_middle = (x.fract() - 0.5).abs() < 0.1;
            let bar = bars.get(*x as usize).filter(|_| is_middle);
            bar.map_or_else(String::new, |b| format!("{} {}", b.name, short(b.value)))
        };
        chart
            .configure_mesh()
            .disable_x_mesh()
            .y_desc(axis)
            .x_labels(2 * count + 1)
            .x_label_formatter(&name)
            .y_label_formatter(&|y| short(*y))
            .draw()
            .map_err(bad)?;
        for (i, bar) in bars.iter().enumerate() {
            let left = i as f64;
            let body = Rectangle::new(
                [(left + 0.2, low), (left + 0.8, bar.value)],
                color(i).filled(),
            );
            chart.draw_series([body]).map_err(bad)?;
            let whisker = bar.whisker.map(|y| (left + 0.5, y));
            let line = PathElement::new(whisker, BLACK.stroke_width(1));
            chart.draw_series([line]).map_err(bad)?;
        }
        Ok(())
    })
}

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;
type Chart<'a, 'b, X, Y> = ChartContext<
    'a,
    SVGBackend<'b>,
    Cartesian2d<<X as AsRangedCoord>::CoordDescType, <Y as AsRangedCoord>::CoordDescType>,
>;

fn chart<'a, 'b, X, Y>(root: &'a Area<'b>, title: &str, x: X, y: Y) -> Result<Chart<'a, 'b, X, Y>>
where
    X: AsRangedCoord<Value = f64>,
    Y: AsRangedCoord<Value = f64>,
    X::CoordDescType: ValueFormatter<f64>,
    Y::CoordDescType: ValueFormatter<f64>,
{
    ChartBuilder::on(root)
        .caption(title, ("sans-serif", 16))
        .margin(12)
        .margin_right(40)
        .x_label_area_size(44)
        .y_label_area_size(64)
        .build_cartesian_2d(x, y)
        .map_err(bad)
}

/// Errors name the file.
fn draw(path: &Path, fill: impl FnOnce(&Area) -> Result<()>) -> Result<()> {
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, SIZE_PX).into_drawing_area();
        let drawn = root.fill(&WHITE).map_err(bad);
        let drawn = drawn.and_then(|()| fill(&root));
        let drawn = drawn.and_then(|()| root.present().map_err(bad));
        drawn.map_err(|e| anyhow!("{}: {e}", path.display()))?;
    }
    write_file(path, svg.as_bytes())
}

fn bad(e: impl std::fmt::Display) -> anyhow::Error {
    anyhow!("{e}")
}

fn color(i: usize) -> RGBColor {
    [
        BLUE,
        RED,
        RGBColor(0, 140, 0),
        BLACK,
        RGBColor(200, 120, 0),
        MAGENTA,
        CYAN,
        RGBColor(120, 120, 120),
    ][i % 8]
}

/// Three digits or so.
fn short(x: f64) -> String {
    match x {
        x if x >= 100.0 => format!("{x:.0}"),
        x if x >= 10.0 => format!("{x:.1}"),
        x => format!("{x:.2}"),
    }
}
