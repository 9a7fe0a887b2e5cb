//! Marks drawn into a chart: lines, dots, bars, images, texts.

use super::axis::{self, Axis};
use super::chart::{BOTTOM, Plot, TOP};
use super::html::escape;

/// Maximum number of dots in a column that are drawn individually.
const CROWD: usize = 4;

impl Plot {
    /// Whether a point can be drawn.
    fn drawable(&self, p: &[f64; 2]) -> bool {
        let fits = |axis: &Axis, v: f64| v.is_finite() && !(axis.log && v <= 0.0);
        fits(&self.x, p[0]) && fits(&self.y, p[1])
    }

    /// Draws a line through `points`, with gaps at points that cannot be drawn.
    pub fn line(&mut self, class: &str, points: &[[f64; 2]]) {
        let mut path = String::new();
        for run in points.split(|p| !self.drawable(p)) {
            for (i, p) in run.iter().enumerate() {
                let command = if i == 0 { 'M' } else { 'L' };
                path.push_str(&format!(
                    "{command}{:.1} {:.1}",
                    self.px(p[0]),
                    self.py(p[1])
                ));
            }
        }
        if !path.is_empty() {
            self.body
                .push_str(&format!("<path class=\"line {class}\" d=\"{path}\"/>\n"));
        }
    }

    /// Draws a band between `low` and `high` over x, as (x, low, high), with gaps where any of the
    /// three cannot be drawn.
    pub fn band(&mut self, class: &str, points: &[[f64; 3]]) {
        let bad = |p: &[f64; 3]| !self.drawable(&[p[0], p[1]]) || !self.drawable(&[p[0], p[2]]);
        let mut polygons = String::new();
        for run in points.split(bad).filter(|run| !run.is_empty()) {
            let low = run.iter().map(|p| [p[0], p[1]]);
            let corners = low.chain(run.iter().rev().map(|p| [p[0], p[2]]));
            let corners: Vec<String> = corners
                .map(|p| format!("{:.1},{:.1}", self.px(p[0]), self.py(p[1])))
                .collect();
            polygons.push_str(&format!(
                "<polygon class=\"{class}\" points=\"{}\"/>\n",
                corners.join(" ")
            ));
        }
        self.body.push_str(&polygons);
    }

    /// Draws a dot at each point.
    pub fn dots(&mut self, class: &str, radius: f64, points: &[[f64; 2]]) {
        for p in points {
            if !self.drawable(p) {
                continue;
            }
            self.body.push_str(&format!(
                "<circle class=\"{class}\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"{radius}\"/>\n",
                self.px(p[0]),
                self.py(p[1])
            ));
        }
    }

    /// Draws many dots as one path of bounded size: more than [`CROWD`] in a row in one column
    /// become a stroke from the lowest to the highest.
    pub fn scatter(&mut self, class: &str, points: &[[f64; 2]]) {
        let mut path = String::new();
        for column in self.columns(points) {
            if column.len() <= CROWD {
                for [x, y] in column {
                    path.push_str(&format!("M{x:.1} {y:.1}h0"));
                }
            } else if let Some((high, low)) = axis::range(column.iter().map(|p| p[1])) {
                path.push_str(&format!("M{:.1} {high:.1}V{low:.1}", column[0][0]));
            }
        }
        self.path(&format!("scatter {class}"), &path);
    }

    /// Draws a cross at each point, at most two per column.
    pub fn crosses(&mut self, class: &str, points: &[[f64; 2]]) {
        let mut path = String::new();
        for column in self.columns(points) {
            let (first, last) = (column.first(), column.last());
            for [x, y] in first.into_iter().chain(last.filter(|_| column.len() > 1)) {
                path.push_str(&format!("M{:.1} {:.1}l6 6m0-6l-6 6", x - 3.0, y - 3.0));
            }
        }
        self.path(class, &path);
    }

    /// Draws triangles at the edge for points above and below the plot area, one per column.
    pub fn beyond(&mut self, class: &str, points: &[[f64; 2]]) {
        let (top, bottom) = (TOP, self.height - BOTTOM);
        let mut path = String::new();
        for column in self.columns(points) {
            if let Some(p) = column.iter().find(|p| p[1] < top - 0.05) {
                path.push_str(&format!("M{:.1} {:.1}h7l-3.5-6z", p[0] - 3.5, top + 7.0));
            }
            if let Some(p) = column.iter().find(|p| p[1] > bottom + 0.05) {
                path.push_str(&format!("M{:.1} {:.1}h7l-3.5 6z", p[0] - 3.5, bottom - 7.0));
            }
        }
        self.path(class, &path);
    }

    fn path(&mut self, class: &str, path: &str) {
        if !path.is_empty() {
            self.body
                .push_str(&format!("<path class=\"{class}\" d=\"{path}\"/>\n"));
        }
    }

    /// Positions of the drawable points, with consecutive points in one unit of width grouped.
    fn columns(&self, points: &[[f64; 2]]) -> Vec<Vec<[f64; 2]>> {
        let mut columns: Vec<Vec<[f64; 2]>> = Vec::new();
        for p in points.iter().filter(|p| self.drawable(p)) {
            let place = [self.px(p[0]), self.py(p[1])];
            match columns.last_mut() {
                Some(last) if last[0][0].floor() == place[0].floor() => last.push(place),
                _ => columns.push(vec![place]),
            }
        }
        columns
    }

    /// Shades the plot area between `x0` and `x1`, at least one hairline wide.
    pub fn shade(&mut self, class: &str, x0: f64, x1: f64) {
        let (from, to) = (x0.max(self.x.min), x1.min(self.x.max));
        if from > to || from.is_nan() || to.is_nan() {
            return;
        }
        let (left, right) = (self.px(from), self.px(to));
        self.body.push_str(&format!(
            "<rect class=\"{class}\" x=\"{left:.1}\" y=\"{TOP:.1}\" width=\"{:.1}\" height=\"{:.1}\"/>\n",
            (right - left).max(1.0),
            self.height - BOTTOM - TOP
        ));
    }

    /// Draws a bar from zero to `height` between `x0` and `x1`, in this colour.
    pub fn bar(&mut self, fill: &str, x0: f64, x1: f64, height: f64) {
        if !(height > 0.0 && height.is_finite()) {
            return;
        }
        let (left, right) = (self.px(x0), self.px(x1));
        let (top, bottom) = (self.py(height), self.py(0.0));
        self.body.push_str(&format!(
            "<rect x=\"{left:.2}\" y=\"{top:.2}\" width=\"{:.2}\" height=\"{:.2}\" fill=\"{fill}\" shape-rendering=\"crispEdges\"/>\n",
            (right - left).max(0.0),
            (bottom - top).max(0.0)
        ));
    }

    /// Draws a bar in the row `y` between `x0` and `x1`, `thickness` units thick and at least one long.
    pub fn span(&mut self, class: &str, (x0, x1): (f64, f64), y: f64, thickness: f64) {
        let (from, to) = (x0.max(self.x.min), x1.min(self.x.max));
        if from > to || from.is_nan() || to.is_nan() {
            return;
        }
        let (left, right) = (self.px(from), self.px(to));
        self.body.push_str(&format!(
            "<rect class=\"{class}\" x=\"{left:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{thickness:.1}\"/>\n",
            self.py(y) - 0.5 * thickness,
            (right - left).max(1.0)
        ));
    }

    /// Draws a piece of a colour scale just below the plot area.
    pub fn under(&mut self, fill: &str, x0: f64, x1: f64) {
        let (left, right) = (self.px(x0), self.px(x1));
        self.body.push_str(&format!(
            "<rect x=\"{left:.2}\" y=\"{:.2}\" width=\"{:.2}\" height=\"5\" fill=\"{fill}\" shape-rendering=\"crispEdges\"/>\n",
            self.bottom(),
            (right - left).max(0.0)
        ));
    }

    /// Draws an image with the corners (x0, y0) at the lower left and (x1, y1) at the upper right.
    pub fn image(&mut self, uri: &str, [x0, y0]: [f64; 2], [x1, y1]: [f64; 2]) {
        let (left, top) = (self.px(x0), self.py(y1));
        self.body.push_str(&format!(
            "<image x=\"{left:.1}\" y=\"{top:.1}\" width=\"{:.1}\" height=\"{:.1}\" preserveAspectRatio=\"none\" href=\"{uri}\"/>\n",
            self.px(x1) - left,
            self.py(y0) - top
        ));
    }

    /// Draws an arrow of this length in units of the chart, from a point towards a heading
    /// (radians, clockwise from up).
    pub fn arrow(&mut self, class: &str, from: [f64; 2], heading_rad: f64, length: f64) {
        if !self.drawable(&from) || !heading_rad.is_finite() {
            return;
        }
        self.body.push_str(&format!(
            "<path class=\"{class}\" d=\"M0 0V{:.1}M-3.5 {:.1}L0 {:.1}L3.5 {:.1}\" transform=\"translate({:.1} {:.1}) rotate({:.1})\"/>\n",
            -length,
            -length + 5.0,
            -length,
            -length + 5.0,
            self.px(from[0]),
            self.py(from[1]),
            heading_rad.to_degrees()
        ));
    }

    /// Draws a text centred at a horizontal position (units of the chart) and a height (likewise,
    /// from the top).
    pub fn text(&mut self, class: &str, x: f64, y: f64, text: &str) {
        self.body.push_str(&format!(
            "<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"middle\">{}</text>\n",
            escape(text)
        ));
    }

    /// The height of the lower end of the plot area.
    pub fn bottom(&self) -> f64 {
        self.height - BOTTOM
    }

    /// Draws a vertical line over the whole plot area.
    pub fn upright(&mut self, class: &str, x: f64) {
        let (x, bottom) = (self.px(x), self.height - BOTTOM);
        self.body.push_str(&format!(
            "<path class=\"{class}\" d=\"M{x:.1} {TOP:.1}V{bottom:.1}\"/>\n"
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_split_a_line_and_never_reach_the_path() {
        let points = [
            [0.0, 1.0],
            [1.0, f64::NAN],
            [2.0, 3.0],
            [f64::INFINITY, 1.0],
        ];
        let mut plot = Plot::new(
            400.0,
            200.0,
            Axis::over("x", points.map(|p| p[0])),
            Axis::over("y", points.map(|p| p[1])),
        );
        plot.line("s0", &points);
        let svg = plot.finish("t");
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        let path = svg.split("class=\"line s0\" d=\"").nth(1).unwrap();
        assert_eq!(path.split('"').next().unwrap().matches('M').count(), 2);
    }

    #[test]
    fn a_scatter_keeps_its_extremes_and_a_bounded_size() {
        let plot = |points: &[[f64; 2]]| {
            let axes = [0, 1].map(|i| Axis::over("", points.iter().map(|p| p[i])));
            let [x, y] = axes;
            let mut plot = Plot::new(400.0, 200.0, x, y);
            let (low, high) = (plot.py(-7.0), plot.py(9.0));
            plot.scatter("s0", points);
            (plot.finish("t"), low, high)
        };
        let mut points: Vec<[f64; 2]> = (0..200_000)
            .map(|i| [f64::from(i), f64::from(i % 10) / 10.0])
            .collect();
        points[70_000][1] = 9.0;
        points[130_000][1] = -7.0;
        points[5][1] = f64::NAN;
        let (svg, low, high) = plot(&points);
        assert!(svg.len() < 12_000, "{}", svg.len());
        assert!(svg.contains(&format!(" {high:.1}V")) && svg.contains(&format!("V{low:.1}M")));
        let (few, ..) = plot(&[[0.0, -7.0], [1.0, 9.0], [2.0, 1.0]]);
        assert_eq!(few.matches("h0").count(), 3);
    }
}
