//! A tiny picture of points from above, of characters with eight dots each.

/// Characters of a line at most, and lines.
const COLUMNS: usize = 60;
const LINES: usize = 15;
/// Dots of a character across and down.
const ACROSS: usize = 2;
const DOWN: usize = 4;
/// Points that are kept: of more, every second one is dropped again and again.
const MOST_POINTS: usize = 40_000;
/// The first of the 256 characters with eight dots, and the bit of each dot, line by line.
const EMPTY: u32 = 0x2800;
const BITS: [[u32; ACROSS]; DOWN] = [[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]];

/// Collects points while a file is read.
pub(super) struct Picture {
    /// Places of both coordinates among the values of a record.
    places: [usize; 2],
    points: Vec<[f64; 2]>,
    every: u64,
    seen: u64,
}

impl Picture {
    /// Of the coordinates among these names, if there are any.
    pub(super) fn of(names: &[&str]) -> Option<Self> {
        let place = |wanted: &str| names.iter().position(|name| *name == wanted);
        let pairs = [("east_m", "north_m"), ("x_m", "y_m")];
        let places = pairs
            .iter()
            .find_map(|(x, y)| Some([place(x)?, place(y)?]))?;
        Some(Self {
            places,
            points: Vec::new(),
            every: 1,
            seen: 0,
        })
    }

    pub(super) fn see(&mut self, values: &[f64]) {
        self.seen += 1;
        let point = self
            .places
            .map(|place| values.get(place).copied().unwrap_or(f64::NAN));
        if !self.seen.is_multiple_of(self.every) || !point.iter().all(|x| x.is_finite()) {
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

    /// The lines from top to bottom, to one scale; none of points that have no extent in both directions.
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
        let of = |value: f64, from: f64| ((value - from) / step).round() as usize;
        let lines = of(high[1], low[1]) / DOWN + 1;
        let mut cells = vec![[0u32; COLUMNS]; lines];
        for [x, y] in &self.points {
            let (right, down) = (of(*x, low[0]), of(high[1], *y));
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
        let mut picture = Picture::of(&["x_m", "y_m", "z_m"]).unwrap();
        for i in 0..200_000 {
            let t = f64::from(i) / 50_000.0;
            let (side, along) = (t as usize, t.fract());
            let [x, y] = [
                [along, 0.0],
                [1.0, along],
                [1.0 - along, 1.0],
                [0.0, 1.0 - along],
            ][side];
            picture.see(&[x, y, 5.0]);
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
        let mut picture = Picture::of(&["east_m", "north_m"]).unwrap();
        (0..5).for_each(|i| picture.see(&[f64::from(i), 1.0]));
        assert!(picture.lines().is_empty());
        assert!(Picture::of(&["x_m", "z_m"]).is_none());
        let mut tiny = Picture::of(&["x_m", "y_m"]).unwrap();
        [0.0, 5e-324, 1e-322]
            .iter()
            .for_each(|x| tiny.see(&[*x, *x]));
        assert!(tiny.lines().is_empty());
    }
}
