//! A panel: lines over an axis, with a title, a legend in its corner and round tick labels.

use std::ops::Range;

use plotters::chart::{ChartBuilder, LabelAreaPosition};
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
    pub x_label: fn(&f64) -> String,
    /// Labels along y.
    pub y_label: fn(&f64) -> String,
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
            x_label: short,
            y_label: short,
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
        let mut mesh = chart.configure_mesh();
        mesh.light_line_style(FAINT.mix(0.0))
            .bold_line_style(FAINT.stroke_width(2))
            .axis_style(GREY.stroke_width(2))
            .label_style(text(14, GREY))
            .x_labels(6)
            .y_labels(5)
            .x_label_formatter(&self.x_label)
            .y_label_formatter(&self.y_label);
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

/// A number as short as it can be written: `0.25`, `12`, `1.5 M`.
pub fn short(value: &f64) -> String {
    let (scaled, unit) = match value.abs() {
        v if v >= 999_999.5 => (value / 1e6, " M"),
        v if v >= 9_999.5 => (value / 1e3, " k"),
        _ => (*value, ""),
    };
    let digits = format!("{scaled:.3}");
    let digits = digits.trim_end_matches('0').trim_end_matches('.');
    let digits = if digits == "-0" { "0" } else { digits };
    format!("{digits}{unit}")
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
            assert_eq!(short(&value), written);
        }
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
