//! Tables of numbers without a header that are no lines of x y z.

use crate::format::plausible::MOST_TIME_S;
use crate::format::poses::navigation;

/// Fewest rows from which the content of columns is guessed by their values alone.
const FEW: usize = 4;
/// Rows that are looked at.
pub(crate) const ROWS: usize = 1000;
/// Seconds of a week, and the largest number of a GPS week before 2060.
const WEEK_S: f64 = 604_800.0;
const MOST_WEEK: f64 = 4200.0;
/// No height of a place on Earth is larger, metres, also in millimetres taken for metres; northings of zones are.
const MOST_HEIGHT_M: f64 = 1e5;
/// Distances of places on Earth from its centre, metres: geocentric coordinates have them.
const EARTH_RADII_M: std::ops::Range<f64> = 6.3e6..6.5e6;
/// Times since 1970 or 1980, also less a billion seconds, are larger; no coordinate on Earth is.
const LEAST_DATE_S: f64 = 1e8;
/// Smallest time of the day or the week that is told from a coordinate, seconds, and how many times the coordinates
/// behind it are smaller: eastings without northings of their size do not occur.
const LEAST_TIME_S: f64 = 1e4;
const TIMES_SMALLER: f64 = 10.0;
/// Largest extent of a site in degrees, and how much larger its heights spread, metres: things of this size are measured
/// in millimetres.
const SITE_DEG: f64 = 0.005;
const HEIGHTS_PER_DEG: f64 = 10.0;
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
const TIMES_FIRST: Likeness = Likeness {
    found: "times and coordinates",
    expected: "a header that names the columns, such as `time_s,east_m,north_m,up_m` for a log of positions or \
               `time_s,x,y,z,intensity` for a cloud",
};
const CODED_POINTS: Likeness = Likeness {
    found: "points with their names and codes",
    expected: "a header that names the columns in their order, such as `id,easting,northing,height,code` or \
               `id,northing,easting,height,code`",
};

const ANGLES_FIRST: Likeness = Likeness {
    found: "time, roll, pitch, yaw and position",
    expected: navigation::EXPECTED,
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
        let is_angle_first = (1..4).all(|at| is_within(at, -360.0, 360.0));
        let is_on_map = (4..6).all(|at| rows.iter().all(|row| row[at].abs() >= MOST_HEIGHT_M));
        if is_angle_first && is_on_map {
            return Some(ANGLES_FIRST);
        }
    }
    let never_falls = |at: usize| rows.windows(2).all(|pair| pair[0][at] <= pair[1][at]);
    let has_times = width >= 4 && never_falls(0) && !is_constant(rows, 0);
    if has_times && is_within(0, LEAST_DATE_S, MOST_TIME_S) {
        return Some(TIMES_FIRST);
    }
    // The second column of a raster is whole or has one value, and its first one repeats in each line.
    let is_numbered = counts() || rows.len() >= FEW && is_whole(0) && are_distinct(rows);
    if width >= 4 && is_whole(0) && is_numbered && !is_whole(1) && !is_constant(rows, 1) {
        return Some(POINTS);
    }
    // The third column is no height if it is a northing.
    let is_northing = |row: &Vec<f64>| {
        let from_centre = (row[0].powi(2) + row[1].powi(2) + row[2].powi(2)).sqrt();
        row[2].abs() >= MOST_HEIGHT_M && !EARTH_RADII_M.contains(&from_centre)
    };
    if width >= 4 && rows.iter().all(is_northing) {
        let is_numbered = is_whole(0) && are_distinct(rows);
        return Some(if is_numbered { POINTS } else { TIMES_FIRST });
    }
    let are_small = |row: &Vec<f64>| {
        row[0] >= LEAST_TIME_S
            && [row[1], row[2]]
                .iter()
                .all(|v| v.abs() <= row[0] / TIMES_SMALLER)
    };
    if has_times
        && is_within(0, LEAST_TIME_S, WEEK_S)
        && rows.len() >= FEW
        && rows.iter().all(are_small)
    {
        return Some(TIMES_FIRST);
    }
    if are_degrees(rows) {
        return Some(like("latitudes and longitudes in degrees"));
    }
    let is_week = is_whole(0) && is_within(0, 1.0, MOST_WEEK) && is_constant(rows, 0);
    if width >= 5 && is_week && is_within(1, 0.0, WEEK_S) && ascends(1) {
        return Some(like(
            "GPS weeks and seconds of the week in the first two columns",
        ));
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

/// Whether no two rows have the same first value.
fn are_distinct(rows: &[Vec<f64>]) -> bool {
    let mut values: Vec<f64> = rows.iter().map(|row| row[0]).collect();
    values.sort_by(f64::total_cmp);
    values.windows(2).all(|pair| pair[0] < pair[1])
}

/// Whether the rows begin with longitude and latitude, or the other way round: they hardly differ, which in metres would
/// be less than the size of anything that is scanned, while heights stay the same or differ much more.
fn are_degrees(rows: &[Vec<f64>]) -> bool {
    let [x, y, z] = [0, 1, 2].map(|at| {
        let values = rows.iter().map(|row| row[at]);
        let bounds =
            values.clone().fold(f64::INFINITY, f64::min)..values.fold(f64::NEG_INFINITY, f64::max);
        (
            bounds.end - bounds.start,
            bounds.start.abs().max(bounds.end.abs()),
        )
    });
    let extent = x.0.max(y.0);
    let is_flat = |(spread, _): (f64, f64)| spread == 0.0 || spread > HEIGHTS_PER_DEG * extent;
    rows.len() >= FEW
        && x.0 > 0.0
        && y.0 > 0.0
        && extent <= SITE_DEG
        && (x.1 > 1.0 && y.1 > 1.0 && x.1.min(y.1) <= 90.0 && x.1.max(y.1) <= 180.0)
        && is_flat(z)
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
        let clouds: [&dyn Fn(usize) -> Vec<f64>; 9] = [
            // A line of a scan in a zone, in local coordinates, geocentric, and a small thing.
            &|i| {
                vec![
                    364_500.0 + 0.01 * at(i),
                    5_621_000.0 + 0.02 * at(i),
                    61.0,
                    7.5,
                ]
            },
            &|i| vec![0.01 * at(i), 0.02 * at(i), 1.5, 7.5],
            &|i| vec![3_980_000.5 + at(i), 500_000.0 + at(i % 5), 4_960_000.0, 3.0],
            &|i| {
                vec![
                    12.0 + 1e-4 * at(i),
                    7.0 + 2e-4 * at(i % 3),
                    1.0 + 1e-4 * at(i),
                ]
            },
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
        let others: [&dyn Fn(usize) -> Vec<f64>; 11] = [
            &|i| vec![292_500.0 + 0.01 * at(i), 1.0 + 0.1 * at(i), 2.0, 3.0],
            &|i| vec![375_550_000.0 + at(i), 1.0, 2.0, 3.0],
            &|i| vec![292_500.0 + at(i), 364_500.0 + at(i), 5_621_000.2, 61.0],
            &|i| {
                vec![
                    100.0 + at(i),
                    0.1,
                    0.2,
                    0.5 * at(i),
                    364_500.5,
                    5_621_000.2,
                    61.0,
                ]
            },
            &|i| {
                vec![
                    100.0 + 10.0 * at(i),
                    364_500.0 + 0.1 * at(i),
                    5_621_000.2,
                    61.0,
                ]
            },
            &|i| vec![at(4 * i % 9), 12.5 + 0.1 * at(i), 8.2, 1.0],
            &|i| vec![6.895 + 1e-6 * at(i), 50.95 + 1e-5 * at(i), 100.0],
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
