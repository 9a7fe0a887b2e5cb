//! Position logs: coordinates of a prism or a GNSS antenna, and polar observations of a total
//! station.

use std::path::Path;

use crate::error::{Error, Location, Result};
use crate::format::file::nothing_in;
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::log::old_distance::{OldDistances, PolarRow, without_range};
use crate::format::log::tables::{TableWriter, sigma};
use crate::format::poses::navigation;
use crate::format::text::lines::header_names;
use crate::format::text::table::{Columns, Table};
use crate::geometry::{Mat3, Vec3};
use crate::sensor::{
    Observations, PolarObservation, PositionFix, Positions, RejectedRow, TotalStation,
    VerticalAngle,
};

pub(crate) const POSITIONS: Columns = Columns {
    needed: &["time_s", "east_m", "north_m", "up_m"],
    optional: &[
        "sigma_m",
        "sigma_east_m",
        "sigma_north_m",
        "sigma_up_m",
        "cov_ee_m2",
        "cov_nn_m2",
        "cov_uu_m2",
        "cov_en_m2",
        "cov_eu_m2",
        "cov_nu_m2",
    ],
};
/// Groups of optional columns.
const SIGMAS: std::ops::Range<usize> = 5..8;
const COVARIANCES: std::ops::Range<usize> = 8..14;

pub(crate) const POLAR: Columns = Columns {
    needed: &[
        "time_s",
        "slope_distance_m",
        "horizontal_deg",
        "vertical_deg",
    ],
    optional: &["status"],
};
/// Logs of Leica total stations as recorded by drone and robotics groups: coordinates relative to
/// the instrument (y along its horizontal zero, x to the right of it, z up) together with the
/// observations they come from (horizontal angle clockwise, vertical angle from the horizon).
pub(crate) const TPS: Columns = Columns {
    needed: &[
        "sec_of_day",
        "x_m",
        "y_m",
        "z_m",
        "slope_dist_m",
        "hz_deg",
        "v_deg",
        "status",
    ],
    optional: &[],
};

pub(crate) const POSITION_TABLE: Kind = Kind {
    columns: Some(POSITIONS),
    positions: Some(read_positions),
    cloud: Some(crate::format::cloud::table::read_table),
    frame: Frame::Fixed(
        "metres (named in the header); world: east, north, up (named in the header)",
    ),
    ..Kind::new("prism-csv", "position log (table)")
};

pub(crate) const POLAR_TABLE: Kind = Kind {
    columns: Some(POLAR),
    positions: Some(read_positions),
    note: "polar observations: the project must give station_m and station_orientation_deg",
    frame: Frame::Fixed(
        "metres and degrees or gon (named in the header); polar about the instrument, clockwise from its zero",
    ),
    ..Kind::new("polar-csv", "total station log (table, polar)")
};

pub(crate) const TPS_TABLE: Kind = Kind {
    columns: Some(TPS),
    positions: Some(read_positions),
    note: "coordinates and polar observations: choose in the project with observations = \"cartesian\" or \
           \"polar\"; vertical angles count from the horizon (vertical_angle = \"elevation\")",
    frame: Frame::Fixed("metres and degrees (named in the header); axes of the instrument"),
    ..Kind::new(
        "tps-csv",
        "total station log (Leica, coordinates and polar)",
    )
};

/// Reads a position log in one of its forms, rows in the order of the file:
///
/// - coordinates, `time_s, east_m, north_m, up_m`, with `sigma_m`, or `sigma_east_m, sigma_north_m,
///   sigma_up_m`, or `cov_ee_m2, cov_nn_m2, cov_uu_m2, cov_en_m2, cov_eu_m2, cov_nu_m2`, or none;
/// - polar, `time_s, slope_distance_m, horizontal_deg, vertical_deg` and optionally `status`;
/// - both, `sec_of_day, x_m, y_m, z_m, slope_dist_m, hz_deg, v_deg, status`.
///
/// `observations` selects coordinates or polar observations if the file contains both, and gives the
/// instrument for polar observations. A row without a range, or with an earlier one beside new angles, is rejected; it
/// is not an error. Its status is reported but not interpreted, because its meaning depends on the instrument.
///
/// # Errors
/// Missing columns, cells that are not finite numbers, standard deviations or covariances that are
/// not positive, geographic coordinates, vertical angles outside the instrument's convention, polar
/// observations without an instrument; of a whole file also no rows, no row with a range.
pub(crate) fn read_positions(input: &Input, observations: &Observations) -> Result<Positions> {
    let positions = read_all(input, observations)?;
    let counts = [positions.fixes.len(), positions.rejected.len()];
    check_measured(input, counts, "position", "a range")?;
    Ok(positions)
}

/// Checks that a log has a measurement, given the numbers of measurements and of rejected rows, what a measurement is
/// called and what a row needs for it. New rows of a log that grows may all lack it.
pub(crate) fn check_measured(
    input: &Input,
    [measured, rejected]: [usize; 2],
    what: &str,
    needed: &str,
) -> Result<()> {
    if measured > 0 || input.is_excerpt() {
        return Ok(());
    }
    if rejected == 0 {
        return Err(nothing_in(input.path(), what));
    }
    let found = format!("{rejected} rows, none with {needed}");
    Err(error(input.path(), found, &format!("at least one {what}")))
}

fn read_all(input: &Input, observations: &Observations) -> Result<Positions> {
    // A missing header is reported by the reader of coordinates.
    let names = header_names(input).unwrap_or_default();
    let [is_cartesian, is_polar, is_tps] =
        [&POSITIONS, &POLAR, &TPS].map(|columns| columns.are_in(&names));
    if let Some(name) = names.iter().find(|name| is_geographic(name))
        && !(is_cartesian || is_polar || is_tps)
    {
        return Err(error(
            input.path(),
            format!("the geographic column {name}"),
            "projected or local coordinates east_m, north_m, up_m: latitude and longitude are not \
             read; export them in a projected system",
        ));
    }
    let instrument = match observations {
        Observations::AsFound if is_tps || is_polar && is_cartesian => {
            return Err(error(
                input.path(),
                "coordinates and polar observations",
                "a choice in the project: observations = \"cartesian\" or \"polar\"",
            ));
        }
        Observations::AsFound | Observations::Cartesian => None,
        Observations::Polar(instrument) => Some(instrument),
    };
    let mut old = OldDistances::default();
    match instrument {
        None if is_tps => read(input, &TPS, |row: &[f64; 8], _| {
            let position_m = Vec3::new(row[1], row[2], row[3]);
            let fix = PositionFix::with_sigma(row[0], position_m, None);
            Ok(match without_range(row[4]) {
                Some(reason) => Err(with_status(reason, row[7])),
                None => fresh(fix, row[4], row[7], &mut old),
            })
        }),
        None if is_polar && !is_cartesian => Err(error(
            input.path(),
            "polar observations only",
            "the instrument's pose in the project (station_m and station_orientation_deg), or \
             coordinates",
        )),
        None => read(input, &POSITIONS, |row: &[f64; 14], table| {
            cartesian(row, table).map(Ok)
        }),
        Some(instrument) if is_tps => read(input, &TPS, |row: &[f64; 8], table| {
            let fix = polar(instrument, [row[0], row[4], row[5], row[6], row[7]], table)?;
            Ok(fix.and_then(|fix| fresh(fix, row[4], row[7], &mut old)))
        }),
        Some(_) if is_cartesian && !is_polar => Err(error(
            input.path(),
            "coordinates",
            "polar observations, since the project gives station_orientation_deg: columns time_s, \
             slope_distance_m, horizontal_deg, vertical_deg",
        )),
        Some(instrument) => read(input, &POLAR, |row: &[f64; 5], table| {
            let fix = polar(instrument, *row, table)?;
            Ok(fix.and_then(|fix| fresh(fix, row[1], row[4], &mut old)))
        }),
    }
}

fn error(path: &Path, found: impl Into<String>, expected: &str) -> Error {
    Error::format(path, Location::Whole, found, expected)
}

fn is_geographic(name: &str) -> bool {
    let first = name.to_lowercase();
    let first = first.split('_').next().unwrap_or_default();
    ["lat", "latitude", "lon", "lng", "long", "longitude"].contains(&first)
}

/// Reads all rows of a table; `record` returns a fix, or the reason for its rejection.
fn read<const N: usize>(
    input: &Input,
    columns: &Columns,
    mut record: impl FnMut(&[f64; N], &Table) -> Result<std::result::Result<PositionFix, String>>,
) -> Result<Positions> {
    let mut table = Table::open(input, columns)?;
    if let Some(remark) = navigation::remark_on_angles(table.names()) {
        input.remark(remark);
    }
    let mut positions = Positions::default();
    let mut row = [0.0; N];
    while table.next_row(&mut row)? {
        match record(&row, &table)? {
            Ok(fix) => positions.fixes.push(fix),
            Err(reason) => positions.rejected.push(RejectedRow {
                source: input.path().display().to_string(),
                line: table.number(),
                time_s: row[0],
                reason,
            }),
        }
    }
    Ok(positions)
}

fn with_status(reason: String, status: f64) -> String {
    if status.is_nan() {
        return reason;
    }
    format!("{reason} (status {status})")
}

/// A fix whose distance was measured with its angles, or the reason why it was not.
fn fresh(
    fix: PositionFix,
    slope_distance_m: f64,
    status: f64,
    old: &mut OldDistances,
) -> std::result::Result<PositionFix, String> {
    let row = PolarRow {
        time_s: fix.time_s,
        slope_distance_m,
        position_m: fix.position_m,
        status,
    };
    let reason = old.reason(row);
    reason.map_or(Ok(fix), |reason| Err(with_status(reason, status)))
}

/// A row of time, slope distance, horizontal and vertical angle in degrees, and status.
fn polar(
    instrument: &TotalStation,
    [
        time_s,
        slope_distance_m,
        horizontal_deg,
        vertical_deg,
        status,
    ]: [f64; 5],
    table: &Table,
) -> Result<std::result::Result<PositionFix, String>> {
    if let Some(reason) = without_range(slope_distance_m) {
        return Ok(Err(with_status(reason, status)));
    }
    let (is_in_range, expected) = match instrument.vertical {
        VerticalAngle::Zenith => (
            (0.0..=360.0).contains(&vertical_deg),
            "0 to 360 from the zenith; for angles from the horizon set vertical_angle = \
             \"elevation\" in the project",
        ),
        VerticalAngle::Elevation => (
            (-90.0..=90.0).contains(&vertical_deg) || (270.0..=360.0).contains(&vertical_deg),
            "-90 to 90 from the horizon; for angles from the zenith set vertical_angle = \
             \"zenith\" in the project",
        ),
    };
    if !is_in_range {
        return Err(table.error(
            format!("a vertical angle of {vertical_deg} degrees"),
            expected,
        ));
    }
    let fix = instrument.position_fix(&PolarObservation {
        time_s,
        slope_distance_m,
        horizontal_rad: horizontal_deg.to_radians(),
        vertical_rad: vertical_deg.to_radians(),
    });
    Ok(Ok(fix))
}

/// A row of coordinates with its standard deviations or covariances, if any.
fn cartesian(row: &[f64; 14], table: &Table) -> Result<PositionFix> {
    let given = |range: std::ops::Range<usize>| row[range].iter().filter(|v| !v.is_nan()).count();
    let (one, three, six) = (given(4..5), given(SIGMAS), given(COVARIANCES));
    let covariance_m2 = match (one, three, six) {
        (0, 0, 0) => None,
        (1, 0, 0) => sigma(row[4], "sigma_m", table)?.map(|s| Mat3::identity() * (s * s)),
        (0, 3, 0) => {
            let mut variances = Vec3::zeros();
            for (slot, i) in SIGMAS.enumerate() {
                let name = POSITIONS.optional[i - 4];
                variances[slot] = sigma(row[i], name, table)?.map_or(0.0, |s| s * s);
            }
            Some(Mat3::from_diagonal(&variances))
        }
        (0, 0, 6) => {
            let [ee, nn, uu, en, eu, nu] = [8, 9, 10, 11, 12, 13].map(|i| row[i]);
            let covariance = Mat3::new(ee, en, eu, en, nn, nu, eu, nu, uu);
            if covariance.cholesky().is_none() {
                return Err(table.error(
                    format!("the covariance {ee}, {nn}, {uu}, {en}, {eu}, {nu} m2"),
                    "a positive definite covariance",
                ));
            }
            Some(covariance)
        }
        _ => {
            return Err(table.error(
                format!(
                    "{one} of sigma_m, {three} of sigma_east_m, sigma_north_m, sigma_up_m and \
                     {six} of the six cov_*_m2"
                ),
                "all values of exactly one group",
            ));
        }
    };
    Ok(PositionFix {
        time_s: row[0],
        position_m: Vec3::new(row[1], row[2], row[3]),
        covariance_m2,
    })
}

/// Writes a log of coordinates that `read_positions`(crate::format::read_positions) reads back exactly: with
/// `sigma_m` if one standard deviation describes each covariance, else with three standard deviations or six
/// covariances.
///
/// # Errors
/// The file cannot be written.
pub fn write_positions(path: &Path, fixes: &[PositionFix]) -> Result<()> {
    let known = || fixes.iter().filter_map(|fix| fix.covariance_m2);
    let used = if known().next().is_none() {
        0..0
    } else if known().all(|c| c == Mat3::identity() * c.m11) {
        0..1
    } else if known().all(|c| c == Mat3::from_diagonal(&c.diagonal())) {
        1..4
    } else {
        4..10
    };
    let mut header = POSITIONS.needed.to_vec();
    header.extend(&POSITIONS.optional[used.clone()]);
    let mut sheet = TableWriter::create(path, &header)?;
    for fix in fixes {
        let c = fix.covariance_m2.unwrap_or(Mat3::repeat(f64::NAN));
        let [e, n, u] = [c.m11, c.m22, c.m33].map(f64::sqrt);
        let noise = [e, e, n, u, c.m11, c.m22, c.m33, c.m12, c.m13, c.m23];
        let p = &fix.position_m;
        let more = noise[used.clone()].iter().copied();
        sheet.row([fix.time_s, p.x, p.y, p.z].into_iter().chain(more))?;
    }
    sheet.finish()
}
