//! Charts as inline SVG: a plot area with axes.
//!
//! Colours come from the classes of the page's style, so that charts follow its light, dark and
//! print themes. Values that are not finite become gaps.

use super::axis::Axis;
use super::html::escape;

/// A chart being drawn.
#[derive(Debug)]
pub struct Plot {
    width: f64,
    pub(super) height: f64,
    left: f64,
    pub(super) x: Axis,
    pub(super) y: Axis,
    pub(super) body: String,
}

pub(super) const TOP: f64 = 14.0;
const RIGHT: f64 = 14.0;
pub(super) const BOTTOM: f64 = 42.0;
/// Width of a digit at the size of the tick labels.
const DIGIT: f64 = 7.2;

impl Plot {
    /// A chart of `width` × `height` units with grid, ticks and labels.
    pub fn new(width: f64, height: f64, x: Axis, y: Axis) -> Self {
        let mut plot = Self::bare(width, height, x, y);
        plot.draw_x_axis();
        plot
    }

    /// A chart of rows with names, `row_height` units each, over a common x axis; row i is at y = i.
    pub fn rows(width: f64, row_height: f64, names: &[String], x: Axis) -> Self {
        let last = names.len().max(1) as f64 - 0.5;
        let y = Axis {
            label: String::new(),
            // The first row is at the top.
            min: last,
            max: -0.5,
            log: false,
        };
        let longest = names.iter().map(|name| name.chars().count()).max();
        let mut plot = Self {
            width,
            height: row_height * (last + 0.5) + TOP + BOTTOM,
            left: 16.0 + DIGIT * longest.unwrap_or(1) as f64,
            x,
            y,
            body: String::new(),
        };
        for (row, name) in names.iter().enumerate() {
            let (x0, x1, y) = (plot.left, plot.width - RIGHT, plot.py(row as f64));
            plot.body.push_str(&format!(
                "<path class=\"grid\" d=\"M{x0:.1} {y:.1}H{x1:.1}\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>\n",
                x0 - 8.0,
                y + 4.0,
                escape(name)
            ));
        }
        plot.draw_x_axis();
        plot
    }

    /// As [`Plot::new`], without ticks along x.
    pub fn bare(width: f64, height: f64, x: Axis, y: Axis) -> Self {
        let mut plot = Self {
            width,
            height,
            left: left_margin(&y, height),
            x,
            y,
            body: String::new(),
        };
        plot.draw_y_axis();
        plot
    }

    /// A map: both axes at one scale, `width` units wide and at most `max_height` high.
    pub fn map(width: f64, max_height: f64, mut x: Axis, mut y: Axis) -> Self {
        let inner_width = width - left_margin(&y, max_height) - RIGHT;
        let max_inner = max_height - TOP - BOTTOM;
        widen(&mut x, 0.03);
        widen(&mut y, 0.03);
        let mut unit = inner_width / (x.max - x.min);
        if (y.max - y.min) * unit > max_inner {
            unit = max_inner / (y.max - y.min);
            let spare = inner_width / unit - (x.max - x.min);
            x.min -= 0.5 * spare;
            x.max += 0.5 * spare;
        }
        // A drive straight east would leave no height for labels.
        let inner_height = ((y.max - y.min) * unit).max(90.0);
        let spare = inner_height / unit - (y.max - y.min);
        y.min -= 0.5 * spare;
        y.max += 0.5 * spare;
        // The margin depends on the tick texts. Both axes keep the same scale only if the margin is kept.
        let left = width - RIGHT - inner_width;
        let mut plot = Self {
            width,
            height: inner_height + TOP + BOTTOM,
            left,
            x,
            y,
            body: String::new(),
        };
        plot.draw_y_axis();
        plot.draw_x_axis();
        plot
    }

    /// Horizontal position of `value`.
    pub fn px(&self, value: f64) -> f64 {
        self.left + self.x.share(value) * (self.width - self.left - RIGHT)
    }

    /// Vertical position of `value`.
    pub fn py(&self, value: f64) -> f64 {
        self.height - BOTTOM - self.y.share(value) * (self.height - TOP - BOTTOM)
    }

    fn draw_y_axis(&mut self) {
        let (x0, x1) = (self.left, self.width - RIGHT);
        for (value, text) in self.y.ticks(y_ticks(self.height)) {
            let y = self.py(value);
            self.body.push_str(&format!(
                "<path class=\"grid\" d=\"M{x0:.1} {y:.1}H{x1:.1}\"/><text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{text}</text>\n",
                x0 - 6.0,
                y + 4.0
            ));
        }
        let middle = 0.5 * (TOP + self.height - BOTTOM);
        let label = escape(&self.y.label);
        self.body.push_str(&format!(
            "<text class=\"label\" transform=\"translate(13 {middle:.1}) rotate(-90)\" text-anchor=\"middle\">{label}</text>\n"
        ));
    }

    fn draw_x_axis(&mut self) {
        let (top, bottom) = (TOP, self.height - BOTTOM);
        let inner = self.width - self.left - RIGHT;
        // The largest number of ticks whose texts have room.
        let widest = |ticks: &[(f64, String)]| {
            let longest = ticks.iter().map(|(_, text)| text.chars().count()).max();
            longest.unwrap_or(1) as f64 * DIGIT + 24.0
        };
        let mut wanted = 10.0;
        let mut ticks = self.x.ticks(wanted);
        while wanted > 2.0 && ticks.len() as f64 * widest(&ticks) > inner {
            wanted -= 1.0;
            ticks = self.x.ticks(wanted);
        }
        for (value, text) in ticks {
            let x = self.px(value);
            self.body.push_str(&format!(
                "<path class=\"grid\" d=\"M{x:.1} {top:.1}V{bottom:.1}\"/><text class=\"tick\" x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{text}</text>\n",
                bottom + 17.0
            ));
        }
        self.x_label();
    }

    /// Writes the label of the x axis.
    pub fn x_label(&mut self) {
        let label = escape(&self.x.label);
        self.body.push_str(&format!(
            "<text class=\"label\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{label}</text>\n",
            0.5 * (self.left + self.width - RIGHT),
            self.height - 6.0
        ));
    }

    /// The finished SVG element; `title` is its accessible name.
    pub fn finish(self, title: &str) -> String {
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {:.0} {:.0}\" role=\"img\" aria-label=\"{}\">\n{}</svg>\n",
            self.width,
            self.height,
            escape(title),
            self.body
        )
    }
}

/// Number of ticks along y for a chart of this height.
fn y_ticks(height: f64) -> f64 {
    ((height - TOP - BOTTOM) / 38.0).clamp(2.0, 8.0)
}

/// Room for the tick texts and the label of the y axis.
fn left_margin(y: &Axis, height: f64) -> f64 {
    let ticks = y.ticks(y_ticks(height));
    let longest = ticks.iter().map(|(_, text)| text.chars().count()).max();
    30.0 + DIGIT * longest.unwrap_or(1) as f64
}

/// Extends an axis by this share of its length at either end.
fn widen(axis: &mut Axis, share: f64) {
    let spare = share * (axis.max - axis.min);
    axis.min -= spare;
    axis.max += spare;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_keeps_one_scale_on_both_axes() {
        for (dx, dy) in [(10.0, 2.0), (2.0, 10.0), (7.5, 6.0), (10.0, 0.01)] {
            let plot = Plot::map(
                800.0,
                500.0,
                Axis::over("", [0.0, dx]),
                Axis::over("", [0.0, dy]),
            );
            let x = plot.px(1.0) - plot.px(0.0);
            let y = plot.py(0.0) - plot.py(1.0);
            assert!((x / y - 1.0).abs() < 1e-9, "{dx} {dy}: {x} {y}");
        }
    }
}
