//! Tables of numbers without a header that are no lines of x y z.

use crate::format::plausible::MOST_TIME_S;
use crate::format::poses::navigation;

/// Rows that are looked at.
pub(crate) const ROWS: usize = 1000;
/// Seconds of a week, and the largest number of a GPS week before 2060.
const WEEK_S: f64 = 604_800.0;
const MOST_WEEK: f64 = 4200.0;
/// Tolerance of the length of a normal as programs write it, with three decimals.
const UNIT: f64 = 0.01;

/// What a table without a header looks like, and what it should have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Likeness {
    pub(crate) found: &'static str,
    pub(crate) expected: &'static str,
}

/// A table with this content, of which nothing more is known.
const fn like(found: &'static str) -> Likeness {
    Likeness {
        found,
        expected: "lines that begin with x y z, or a header that names the columns",
    }
}

const POINTS: Likeness = Likeness {
    found: "points with their numbers in the first column",
    expected: "a header that names the columns in their order, such as `id,easting,northing,height` or \
               `id,northing,easting,height`",
};
const CODED_POINTS: Likeness = Likeness {
    found: "points with their names and codes",
    expected: "a header that names the columns in their order, such as `id,easting,northing,height,code` or \
               `id,northing,easting,height,code`",
};

const POSES: Likeness = Likeness {
    found: "time, position and roll, pitch, yaw",
    expected: navigation::EXPECTED,
};

/// What the first line of a table looks like if it begins with the name of a point and its coordinates.
pub(crate) fn coded_points(cells: &[String]) -> Option<Likeness> {
    let is_number = |cell: &String| cell.parse::<f64>().is_ok_and(f64::is_finite);
    let [name, coordinates @ ..] = cells else {
        return None;
    };
    // Not a date or a time of day.
    let is_name = !name.is_empty() && !name.contains([':', '/']);
    let has_coordinates = coordinates.len() >= 3 && coordinates[..3].iter().all(is_number);
    (is_name && has_coordinates).then_some(CODED_POINTS)
}

/// What the first rows of a table look like if its first three columns are not coordinates;
/// `has_commas` says whether commas separate them.
pub(crate) fn other_than_xyz(rows: &[Vec<f64>], has_commas: bool) -> Option<Likeness> {
    let width = rows.first()?.len();
    if width < 3 || rows.len() < 2 || rows.iter().any(|row| row.len() != width) {
        return None;
    }
    let is_whole = |at: usize| rows.iter().all(|row| row[at].fract() == 0.0);
    let ascends = |at: usize| rows.windows(2).all(|pair| pair[0][at] < pair[1][at]);
    let is_within = |at: usize, low: f64, high: f64| {
        let mut values = rows.iter().map(|row| row[at]);
        values.all(|value| (low..=high).contains(&value))
    };
    let counts = || rows.windows(2).all(|pair| pair[1][0] - pair[0][0] == 1.0);
    if is_within(0, MOST_TIME_S, f64::MAX) && ascends(0) {
        return Some(like(
            "times in milliseconds, microseconds or nanoseconds in the first column",
        ));
    }
    // The second column of a raster is whole or has one value.
    if width >= 4 && is_whole(0) && counts() && !is_whole(1) && !is_constant(rows, 1) {
        return Some(POINTS);
    }
    let is_week = is_whole(0) && is_within(0, 1.0, MOST_WEEK) && is_constant(rows, 0);
    if width >= 5 && is_week && is_within(1, 0.0, WEEK_S) && ascends(1) {
        return Some(like(
            "GPS weeks and seconds of the week in the first two columns",
        ));
    }
    if width == 7 && ascends(0) {
        let is_colour = (4..7).all(|at| is_whole(at) && is_within(at, 0.0, 65_535.0));
        let is_normal = rows.iter().all(|row| {
            let length = row[4..7].iter().map(|v| v * v).sum::<f64>().sqrt();
            (length - 1.0).abs() < UNIT
        });
        let is_angle = (4..7).all(|at| is_within(at, -360.0, 360.0));
        if is_angle && !is_colour && !is_normal {
            return Some(POSES);
        }
    }
    let is_fraction = |at| is_whole(at) && is_within(at, 0.0, f64::MAX);
    let are_pairs = width >= 6 && width.is_multiple_of(2) && (0..width).all(is_whole);
    if has_commas && are_pairs && (1..width).step_by(2).all(is_fraction) {
        return Some(like(
            "whole numbers between commas, which may be decimal commas",
        ));
    }
    None
}

/// Whether a column has one value.
fn is_constant(rows: &[Vec<f64>], at: usize) -> bool {
    rows.iter().all(|row| row[at] == rows[0][at])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clouds_are_told_from_other_tables() {
        let at = |i: usize| i as f64;
        let rows = |row: &dyn Fn(usize) -> Vec<f64>| (0..9).map(row).collect::<Vec<_>>();
        let clouds: [&dyn Fn(usize) -> Vec<f64>; 5] = [
            // A raster, and one with a value.
            &|i| vec![at(i), 0.5, 7.25],
            &|i| vec![at(i), 100.0, 7.25, 3.0],
            // Colours of whole numbers, and normals, along a line.
            &|i| vec![0.1 * at(i), 2.5, 7.25, 9.0, 255.0, 0.0, 4.0],
            &|i| vec![0.1 * at(i), 2.5, 7.25, 9.0, 0.6, -0.8, 0.0],
            &|i| vec![at(i * i % 7), 1.5, 2.5, 4.5],
        ];
        for cloud in clouds {
            assert_eq!(other_than_xyz(&rows(cloud), false), None);
        }
        // Rows of separators alone.
        assert_eq!(other_than_xyz(&[Vec::new(), Vec::new()], false), None);
        let others: [&dyn Fn(usize) -> Vec<f64>; 4] = [
            &|i| vec![1.4e18 + 5e6 * at(i), 2.5, 7.25],
            &|i| vec![at(i + 41), 2.5 + at(i), 7.25, 9.0],
            &|i| vec![2245.0, 345_600.0 + at(i), 50.1, 7.1, 100.0],
            &|i| vec![9.0 + at(i), 2.5, 7.25, 9.0, 0.1, -0.4, 341.0],
        ];
        for other in others {
            assert!(other_than_xyz(&rows(other), false).is_some());
        }
    }
}
