//! A panel: lines over an axis, with a title, a legend in its corner and round tick labels.

use std::ops::Range;

use plotters::chart::{ChartBuilder, LabelAreaPosition};
use plotters::coord::ranged1d::{BoldPoints, Ranged};
use plotters::coord::types::RangedCoordf64;
use plotters::element::{PathElement, Rectangle};
use plotters::style::{Color, RGBColor, ShapeStyle};

use super::ReportError;
use super::canvas::{Area, Canvas, FAINT, GREY, INK, px, text, write};

/// A curve; a value that is not finite interrupts it.
pub struct Line {
    /// Name in the legend; none if empty.
    pub name: String,
    /// Its colour.
    pub colour: RGBColor,
    /// Width, samples.
    pub width: u32,
    /// x and y.
    pub points: Vec<(f64, f64)>,
}

impl Line {
    /// A curve through `points`, `width` samples wide.
    pub fn new(name: &str, colour: RGBColor, width: u32, points: Vec<(f64, f64)>) -> Self {
        Self {
            name: name.to_owned(),
            colour,
            width,
            points,
        }
    }
}

/// Width of pictures of an evaluation, pixels.
pub const WIDTH: u32 = 1260;
/// Height of their title, pixels.
const HEAD: u32 = 76;

/// A picture of a title, what is `below` it, and `height` pixels that `draw` fills.
///
/// # Errors
/// Those of `draw`, and [`ReportError::Draw`].
pub fn framed(
    height: u32,
    title: &str,
    below: &str,
    draw: impl FnOnce(&Area<'_>) -> Result<(), ReportError>,
) -> Result<Canvas, ReportError> {
    let mut canvas = Canvas::new(WIDTH, HEAD + height);
    canvas.draw(|area| {
        write(area, title, &text(24, INK), (px(12), px(8)))?;
        write(area, below, &text(15, GREY), (px(12), px(46)))?;
        draw(&area.split_vertically(px(HEAD as i32)).1)
    })?;
    Ok(canvas)
}

/// How a tick is labelled: its value, and how far it is to the next.
pub type Label = fn(f64, f64) -> String;
/// Ticks along an axis, about.
const TICKS: [usize; 2] = [6, 5];

/// A chart.
pub struct Panel<'a> {
    /// What is shown, with the unit.
    pub title: &'a str,
    /// Title below the horizontal axis; none if empty.
    pub below: &'a str,
    /// Range along x; that of the lines if none.
    pub x: Option<Range<f64>>,
    /// Range along y; one that holds the lines if none.
    pub y: Option<Range<f64>>,
    /// Labels along x.
    pub x_label: Label,
    /// Labels along y.
    pub y_label: Label,
    /// The curves.
    pub lines: Vec<Line>,
    /// Filled rectangles behind the curves: corners and colour.
    pub blocks: Vec<([(f64, f64); 2], RGBColor)>,
}

impl Default for Panel<'_> {
    fn default() -> Self {
        Self {
            title: "",
            below: "",
            x: None,
            y: None,
            x_label: tick,
            y_label: tick,
            lines: Vec::new(),
            blocks: Vec::new(),
        }
    }
}

impl Panel<'_> {
    /// Draws the panel over the whole of `area`.
    ///
    /// # Errors
    /// [`ReportError::Draw`].
    pub fn draw(&self, area: &Area<'_>) -> Result<(), ReportError> {
        let finite = |axis: fn(&(f64, f64)) -> f64| self.lines.iter().flat_map(move |l| l.points.iter().map(axis));
        let x = self.x.clone().unwrap_or_else(|| range(finite(|p| p.0), 0.0));
        let y = self.y.clone().unwrap_or_else(|| range(finite(|p| p.1), 0.06));
        self.head(area)?;
        let (title, below) = (px(26), if self.below.is_empty() { 0 } else { px(20) });
        let mut chart = ChartBuilder::on(area)
            .margin_top(title)
            .margin_right(px(14))
            .margin_bottom(px(2))
            .set_label_area_size(LabelAreaPosition::Left, px(58))
            .set_label_area_size(LabelAreaPosition::Bottom, px(24) + below)
            .build_cartesian_2d(x.clone(), y.clone())
            .map_err(ReportError::draw)?;
        let (x_step, y_step) = (step(&x, TICKS[0]), step(&y, TICKS[1]));
        let x_label = |value: &f64| (self.x_label)(*value, x_step);
        let y_label = |value: &f64| (self.y_label)(*value, y_step);
        let mut mesh = chart.configure_mesh();
        mesh.light_line_style(FAINT.mix(0.0))
            .bold_line_style(FAINT.stroke_width(2))
            .axis_style(GREY.stroke_width(2))
            .label_style(text(14, GREY))
            .x_labels(TICKS[0])
            .y_labels(TICKS[1])
            .x_label_formatter(&x_label)
            .y_label_formatter(&y_label);
        if !self.below.is_empty() {
            mesh.x_desc(self.below).axis_desc_style(text(14, INK));
        }
        mesh.draw().map_err(ReportError::draw)?;
        let blocks = self
            .blocks
            .iter()
            .map(|(corners, c)| Rectangle::new(*corners, c.filled()));
        chart.draw_series(blocks).map_err(ReportError::draw)?;
        for line in &self.lines {
            let style: ShapeStyle = line.colour.stroke_width(line.width);
            // Segment by segment: plotters' joints of thick lines shoot far over sharp corners.
            let finite = |pair: &&[(f64, f64)]| pair.iter().all(|(x, y)| x.is_finite() && y.is_finite());
            let pairs = line.points.windows(2).filter(finite);
            chart
                .draw_series(pairs.map(|pair| PathElement::new(pair, style)))
                .map_err(ReportError::draw)?;
        }
        Ok(())
    }

    /// The title and, to the right, the names of the lines in their colours.
    fn head(&self, area: &Area<'_>) -> Result<(), ReportError> {
        let x = write(area, self.title, &text(16, INK), (px(10), px(4)))?;
        let mut x = x + px(14);
        for line in self.lines.iter().filter(|line| !line.name.is_empty()) {
            x = write(area, &line.name, &text(14, line.colour), (x, px(6)))? + px(10);
        }
        Ok(())
    }
}

/// A range that holds the finite values with a `margin`; values that are nowhere negative start at zero.
fn range(values: impl Iterator<Item = f64>, margin: f64) -> Range<f64> {
    let (low, high) = values
        .filter(|v| v.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if low > high {
        return 0.0..1.0;
    }
    let low = if low >= 0.0 { 0.0 } else { low - margin * (high - low) };
    let high = high + margin * (high - low);
    if high - low > f64::EPSILON * high.abs().max(1e-9) {
        low..high
    } else {
        low..low + 1.0
    }
}

/// How far it is from one of about `count` ticks over `range` to the next.
fn step(range: &Range<f64>, count: usize) -> f64 {
    let ticks = RangedCoordf64::from(range.clone()).key_points(BoldPoints(count));
    ticks.windows(2).next().map_or(f64::NAN, |pair| pair[1] - pair[0])
}

/// A number as short as it can be written: `0.25`, `12`, `1.5 M`.
pub fn short(value: f64) -> String {
    written(value, |_| 3)
}

/// The label of a tick: as short as it can be written, and another one than that of the tick `step` further.
pub fn tick(value: f64, step: f64) -> String {
    let whole = |x: f64| x > 0.5 && (x - x.round()).abs() < 1e-3;
    // More have no room beside an axis.
    let decimals = |unit: f64| (0..6).find(|&decimals| whole(step / unit * 10f64.powi(decimals)));
    // Ticks are sums, so that nought is not always met.
    let value = if value.abs() < 1e-6 * step { 0.0 } else { value };
    let fine = step.is_finite() && decimals(1.0).is_none();
    if value != 0.0 && (fine || value.abs() >= 1e12) {
        let digits = ((value / step).abs().log10().ceil() + 1.0).clamp(1.0, 9.0) as usize;
        return format!("{value:.digits$e}");
    }
    written(value, |unit| decimals(unit).map_or(6, |decimals| decimals as usize))
}

/// The value in its unit, with the decimals that are given for that.
fn written(value: f64, decimals: impl Fn(f64) -> usize) -> String {
    let (unit, name) = match value.abs() {
        v if v >= 999_999.5 => (1e6, " M"),
        v if v >= 9_999.5 => (1e3, " k"),
        _ => (1.0, ""),
    };
    let digits = format!("{:.*}", decimals(unit), value / unit);
    let digits = match digits.contains('.') {
        true => digits.trim_end_matches('0').trim_end_matches('.'),
        false => &digits,
    };
    let digits = if digits == "-0" { "0" } else { digits };
    format!("{digits}{name}")
}

/// Mean of the points within half of `window` of each; only where the whole window holds points.
pub fn running_mean(points: &[(f64, f64)], window: f64) -> Vec<(f64, f64)> {
    let (Some(first), Some(last)) = (points.first(), points.last()) else {
        return Vec::new();
    };
    let half = window / 2.0 + 1e-9;
    let whole = |&&(t, _): &&(f64, f64)| t - half >= first.0 - 1e-6 && t + half <= last.0 + 1e-6;
    let mean = |&(t, _): &(f64, f64)| {
        let from = points.partition_point(|p| p.0 < t - half);
        let to = points.partition_point(|p| p.0 <= t + half);
        let sum: f64 = points[from..to].iter().map(|p| p.1).sum();
        (t, sum / (to - from).max(1) as f64)
    };
    points.iter().filter(whole).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_written_short() {
        let cases = [
            (0.25, "0.25"),
            (-0.0001, "0"),
            (12.0, "12"),
            (1.5e6, "1.5 M"),
            (20_000.0, "20 k"),
        ];
        for (value, written) in cases {
            assert_eq!(short(value), written);
        }
    }

    #[test]
    fn every_tick_has_a_label_of_its_own() {
        for range in [
            0.0..0.0025,
            0.0..0.012,
            0.0..1e-5,
            -1e-8..1e-8,
            0.0..1.5e6,
            9.9e6..1.01e7,
            -3.0..400.0,
            1.0..1.001,
            1.0..1.000001,
            0.0..1e300,
            1e6..1_000_004.0,
        ] {
            let step = step(&range, 5);
            let ticks = RangedCoordf64::from(range.clone()).key_points(BoldPoints(5));
            let mut labels: Vec<String> = ticks.iter().map(|value| tick(*value, step)).collect();
            assert!(labels.iter().all(|label| label.len() <= 12), "{range:?}: {labels:?}");
            let all = labels.len();
            labels.dedup();
            assert!(all > 2 && labels.len() == all, "{range:?}: {labels:?}");
        }
        assert_eq!(
            (tick(0.0015, 0.0005), tick(0.001, 0.0005)),
            ("0.0015".into(), "0.001".into())
        );
        assert_eq!((tick(20.0, 10.0), tick(1e6, 5e5)), ("20".into(), "1 M".into()));
    }

    #[test]
    fn a_range_holds_its_values_and_is_never_empty() {
        assert_eq!(range([1.0, f64::NAN, 2.0].into_iter(), 0.0), 0.0..2.0);
        assert_eq!(range([-1.0, 1.0].into_iter(), 0.5), -2.0..2.5);
        for values in [vec![], vec![0.0], vec![f64::NAN], vec![-3.0]] {
            let range = range(values.into_iter(), 0.0);
            assert!(range.start < range.end, "{range:?}");
        }
    }
}
