//! Logs of quantities that may bend the frame besides tilt and acceleration: temperatures, loads, pressures.

/// Largest number of log columns that a mounting may depend on.
pub const MAX_FRAME_COLUMNS: usize = 2;

/// Columns of a log as functions of time, in any units.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FrameLog {
    /// Rows in ascending order of time: seconds, and a value of each column; absent columns are zero.
    pub rows: Vec<(f64, [f64; MAX_FRAME_COLUMNS])>,
    /// Number of columns.
    pub columns: usize,
}

impl FrameLog {
    /// The values at a time: linear between rows, constant before the first and after the last; zero if
    /// there are no rows.
    pub fn at(&self, time_s: f64) -> [f64; MAX_FRAME_COLUMNS] {
        let next = self.rows.partition_point(|(row_s, _)| *row_s <= time_s);
        let row = |index: usize| self.rows.get(index);
        match (next.checked_sub(1).and_then(row), row(next)) {
            (Some((from_s, from)), Some((to_s, to))) => {
                let u = (time_s - from_s) / (to_s - from_s);
                std::array::from_fn(|i| from[i] * (1.0 - u) + to[i] * u)
            }
            (Some((_, held)), None) | (None, Some((_, held))) => *held,
            (None, None) => Default::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_linear_between_rows_and_constant_outside() {
        let log = FrameLog {
            rows: vec![(1.0, [20.0, 0.0]), (3.0, [24.0, 1.0])],
            columns: 2,
        };
        let at = [0.0, 1.0, 1.5, 3.0, 9.0].map(|t| log.at(t));
        assert_eq!(
            at,
            [
                [20.0, 0.0],
                [20.0, 0.0],
                [21.0, 0.25],
                [24.0, 1.0],
                [24.0, 1.0]
            ]
        );
        assert_eq!(FrameLog::default().at(1.0), [0.0; 2]);
    }
}
