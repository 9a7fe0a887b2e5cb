//! A tiny picture of points from above, of characters with eight dots each.

/// Most characters in a line, and most lines.
const COLUMNS: usize = 60;
const LINES: usize = 15;
/// Dots of a character, across and down.
const ACROSS: usize = 2;
const DOWN: usize = 4;
/// Most points in memory: whenever there are more, every second one is dropped.
const MOST_POINTS: usize = 40_000;
/// The first of the 256 characters with eight dots, and the bit of each dot, line by line.
const EMPTY: u32 = 0x2800;
const BITS: [[u32; ACROSS]; DOWN] = [[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]];

/// Collects points while a file is read.
pub(super) struct Picture {
    /// Indices of both coordinates among the values of a record.
    indices: [usize; 2],
    points: Vec<[f64; 2]>,
    /// One of this many points is taken.
    every: u64,
    added: u64,
}

impl Picture {
    /// A picture of the horizontal coordinates among these names; `None` if there are none.
    pub(super) fn of_columns(names: &[&str]) -> Option<Self> {
        let index = |wanted: &str| names.iter().position(|name| *name == wanted);
        let pairs = [("east_m", "north_m"), ("x_m", "y_m")];
        let indices = pairs
            .iter()
            .find_map(|(x, y)| Some([index(x)?, index(y)?]))?;
        Some(Self {
            indices,
            points: Vec::new(),
            every: 1,
            added: 0,
        })
    }

    pub(super) fn add(&mut self, values: &[f64]) {
        self.added += 1;
        let point = self
            .indices
            .map(|index| values.get(index).copied().unwrap_or(f64::NAN));
        if !self.added.is_multiple_of(self.every) || !point.iter().all(|x| x.is_finite()) {
            return;
        }
        if self.points.len() == MOST_POINTS {
            let mut keep = false;
            self.points.retain(|_| {
                keep = !keep;
                keep
            });
            self.every *= 2;
        }
        self.points.push(point);
    }

    /// The lines from top to bottom, in the same scale in both directions; none if the points have no extent in
    /// one of them.
    pub(super) fn lines(&self) -> Vec<String> {
        let bound = |axis: usize, start: f64, choose: fn(f64, f64) -> f64| {
            self.points
                .iter()
                .map(|point| point[axis])
                .fold(start, choose)
        };
        let [low, high] = [
            [0, 1].map(|axis| bound(axis, f64::INFINITY, f64::min)),
            [0, 1].map(|axis| bound(axis, f64::NEG_INFINITY, f64::max)),
        ];
        let dots = [COLUMNS * ACROSS - 1, LINES * DOWN - 1].map(|n| n as f64);
        let step = ((high[0] - low[0]) / dots[0]).max((high[1] - low[1]) / dots[1]);
        let has_extent = (0..2).all(|axis| high[axis] - low[axis] > 0.0);
        if !has_extent || !step.is_normal() {
            return Vec::new();
        }
        let dot = |value: f64, from: f64| ((value - from) / step).round() as usize;
        let lines = dot(high[1], low[1]) / DOWN + 1;
        let mut cells = vec![[0u32; COLUMNS]; lines];
        for [x, y] in &self.points {
            let (right, down) = (dot(*x, low[0]), dot(high[1], *y));
            cells[down / DOWN][right / ACROSS] |= BITS[down % DOWN][right % ACROSS];
        }
        let line = |cells: &[u32; COLUMNS]| {
            let dots = cells.iter().filter_map(|bits| char::from_u32(EMPTY + bits));
            dots.collect::<String>()
                .trim_end_matches('\u{2800}')
                .to_owned()
        };
        cells.iter().map(line).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_is_drawn_to_scale() {
        let mut picture = Picture::of_columns(&["x_m", "y_m", "z_m"]).unwrap();
        for i in 0..200_000 {
            let t = f64::from(i) / 50_000.0;
            let (side, along) = (t as usize, t.fract());
            let [x, y] = [
                [along, 0.0],
                [1.0, along],
                [1.0 - along, 1.0],
                [0.0, 1.0 - along],
            ][side];
            picture.add(&[x, y, 5.0]);
        }
        assert!(picture.points.len() <= MOST_POINTS);
        let lines = picture.lines();
        // 60 dots a side: 15 lines of 30 characters.
        assert_eq!(lines.len(), 15);
        assert!(lines.iter().all(|line| line.chars().count() == 30));
        assert!(
            lines[7].starts_with('⡇') && lines[7].ends_with('⢸'),
            "{}",
            lines[7]
        );
    }

    #[test]
    fn points_on_a_line_along_an_axis_have_no_picture() {
        let mut picture = Picture::of_columns(&["east_m", "north_m"]).unwrap();
        (0..5).for_each(|i| picture.add(&[f64::from(i), 1.0]));
        assert!(picture.lines().is_empty());
        assert!(Picture::of_columns(&["x_m", "z_m"]).is_none());
        let mut tiny = Picture::of_columns(&["x_m", "y_m"]).unwrap();
        [0.0, 5e-324, 1e-322]
            .iter()
            .for_each(|x| tiny.add(&[*x, *x]));
        assert!(tiny.lines().is_empty());
    }
}
