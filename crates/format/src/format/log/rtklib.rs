//! Positions of RTKLIB (`.pos`) and of receivers by Emlid (`.LLH`), which write the same lines.
//!
//! A line holds a time, a place, the quality Q, the number of satellites and standard deviations. The place is latitude,
//! longitude and ellipsoidal height, with standard deviations to the north, to the east and upwards; or geocentric x, y
//! and z, with those along these axes and the roots of their covariances, negative for negative ones. The time is `yyyy/mm/dd hh:mm:ss.sss`, `hh:mm:ss.sss` or the GPS week and its
//! second; latitude and longitude are in degrees, or in degrees, minutes and seconds. Lines that begin with `%` are
//! comments, of which the last names the columns.
//!
//! # Times
//! Dates and weeks become seconds since 1970 in the time system of the file, which is most often GPS time. Leap seconds
//! are not added.

use crate::error::Result;
use crate::format::file::nothing_in;
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind, Start};
use crate::format::text::civil::{DAY_S, days_since_1970, second_of_day};
use crate::format::text::lines::Lines;
use crate::geometry::{Geodetic, Mat3, Vec3};
use crate::sensor::{FixQuality, GeographicFix};

pub(crate) const POSITIONS: Kind = Kind {
    signature: Some(looks_like),
    geographic: Some(read),
    frame: Frame::Fixed(
        "degrees and metres (the format); latitude, longitude, height in the datum of the solution",
    ),
    ..Kind::new("rtklib-pos", "positions (RTKLIB .pos, Emlid .LLH)")
};

/// The first second of GPS time, in seconds since 1970 without leap seconds.
const GPS_EPOCH_S: f64 = 315_964_800.0;
const WEEK_S: f64 = 604_800.0;
/// Weeks of GPS time from 1999 to 2095; a coordinate seldom is such a whole number.
const WEEKS: std::ops::RangeInclusive<u32> = 1024..=6000;

/// What the comments say of the lines below.
#[derive(Debug, Clone, Copy, Default)]
struct Layout {
    /// Whether latitude and longitude are in degrees, minutes and seconds.
    is_sexagesimal: bool,
    is_geocentric: bool,
    is_utc: bool,
    /// Content that is not read.
    unread: Option<&'static str>,
}

impl Layout {
    fn note(&mut self, comment: &str) {
        self.is_sexagesimal |= comment.contains("(d'\")");
        self.is_geocentric |= comment.contains("x-ecef");
        self.is_utc |= comment.trim_start_matches(['%', ' ']).starts_with("UTC");
        let contents = [
            ("e-baseline", "baselines"),
            ("/geodetic", "heights above the geoid"),
        ];
        let unread = contents.iter().find(|(mark, _)| comment.contains(mark));
        self.unread = self.unread.or(unread.map(|(_, content)| *content));
    }
}

/// The parts of a line between commas, semicolons or blanks.
fn cells(line: &str) -> Vec<&str> {
    let cells = line.split([',', ';', ' ', '\t']);
    cells.filter(|cell| !cell.is_empty()).collect()
}

/// The time at the beginning of a line, seconds, and the number of its cells.
fn time(cells: &[&str]) -> Option<(f64, usize)> {
    let clock = |text: &str| {
        let mut parts = text.splitn(3, ':');
        let (hour, minute) = (parts.next()?.parse().ok()?, parts.next()?.parse().ok()?);
        second_of_day(hour, minute, parts.next()?.parse().ok()?)
    };
    let [first, second, ..] = cells else {
        return None;
    };
    if let Some(second_s) = clock(first) {
        return Some((second_s, 1));
    }
    if let Ok(week) = first.parse::<u32>() {
        let second_s: f64 = second.parse().ok()?;
        let is_week = WEEKS.contains(&week) && (0.0..=WEEK_S).contains(&second_s);
        return is_week.then(|| (GPS_EPOCH_S + f64::from(week) * WEEK_S + second_s, 2));
    }
    let mut date = first.splitn(3, '/').map(str::parse::<i64>);
    let (year, month, day) = (date.next()?.ok()?, date.next()?.ok()?, date.next()?.ok()?);
    let days = days_since_1970(year, month, day)?;
    Some((days as f64 * DAY_S + clock(second)?, 2))
}

/// The numbers of a line behind its time.
struct Numbers<'a>(std::vec::IntoIter<&'a str>);

impl Numbers<'_> {
    fn next(&mut self) -> Option<f64> {
        let value: f64 = self.0.next()?.parse().ok()?;
        value.is_finite().then_some(value)
    }

    fn three(&mut self) -> Option<Vec3> {
        Some(Vec3::new(self.next()?, self.next()?, self.next()?))
    }

    fn angle_deg(&mut self, layout: Layout) -> Option<f64> {
        let degrees = self.next()?;
        if !layout.is_sexagesimal {
            return Some(degrees);
        }
        let (minutes, seconds) = (self.next()?, self.next()?);
        Some(degrees.signum() * (degrees.abs() + minutes / 60.0 + seconds / 3600.0))
    }

    fn place(&mut self, layout: Layout) -> Option<Geodetic> {
        if layout.is_geocentric {
            return Some(Geodetic::from_geocentric(&self.three()?));
        }
        let (latitude_deg, longitude_deg) = (self.angle_deg(layout)?, self.angle_deg(layout)?);
        let is_on_earth = latitude_deg.abs() <= 90.0 && longitude_deg.abs() <= 360.0;
        is_on_earth.then_some(Geodetic {
            latitude_rad: latitude_deg.to_radians(),
            longitude_rad: longitude_deg.to_radians(),
            height_m: self.next()?,
        })
    }

    /// Standard deviations to the east, to the north and upwards.
    fn sigma_m(&mut self, layout: Layout, place: &Geodetic) -> Option<Vec3> {
        let sigma_m = self.three()?;
        if !layout.is_geocentric {
            return Some(Vec3::new(sigma_m.y, sigma_m.x, sigma_m.z));
        }
        let [xx, yy, zz] = sigma_m.map(|s| s * s).into();
        let [xy, yz, zx] = self.three()?.map(|s| s * s.abs()).into();
        let turn = place.local_from_geocentric().to_rotation_matrix();
        let covariance = turn * Mat3::new(xx, xy, zx, xy, yy, yz, zx, yz, zz) * turn.transpose();
        // Rounded roots may leave a variance below zero, which is unknown.
        Some(covariance.diagonal().map(|v| v.max(0.0).sqrt()))
    }
}

/// The position in a line; `None` if it is none.
fn fix(line: &str, layout: Layout) -> Option<GeographicFix> {
    let mut cells = cells(line);
    let (time_s, taken) = time(&cells)?;
    let mut numbers = Numbers(cells.split_off(taken).into_iter());
    let place = numbers.place(layout)?;
    let quality = match numbers.next()? {
        1.0 => FixQuality::Fixed,
        // 6 is PPP, whose ambiguities are not fixed in these programs.
        2.0 | 6.0 => FixQuality::Float,
        3.0 | 4.0 => FixQuality::Differential,
        5.0 => FixQuality::Single,
        _ => return None,
    };
    let _satellites = numbers.next()?;
    let sigma_m = numbers.sigma_m(layout, &place)?;
    Some(GeographicFix {
        time_s,
        latitude_rad: place.latitude_rad,
        longitude_rad: place.longitude_rad,
        height_m: place.height_m,
        sigma_m: (sigma_m.min() > 0.0).then_some(sigma_m),
        quality: Some(quality),
    })
}

fn looks_like(start: &Start<'_>) -> bool {
    let mut layout = Layout::default();
    for line in start.bytes.split(|byte| matches!(byte, b'\r' | b'\n')) {
        let line = String::from_utf8_lossy(line);
        let line = line.trim_start_matches('\u{feff}').trim_ascii();
        if line.starts_with('%') {
            layout.note(line);
        } else if !line.is_empty() {
            let is_unread = layout.unread.is_some() && time(&cells(line)).is_some();
            return is_unread || fix(line, layout).is_some();
        }
    }
    false
}

/// Reads the positions with their quality and standard deviations, in the order of the file.
///
/// # Errors
/// Baselines and heights above the geoid; more lines that are no positions than positions; no
/// position.
fn read(input: &Input) -> Result<Vec<GeographicFix>> {
    let mut lines = Lines::open(input)?;
    let (mut layout, mut fixes) = (Layout::default(), Vec::new());
    let (mut unusable, mut first) = (0, None);
    while lines.advance()? {
        let line = lines.text();
        if line.starts_with('%') {
            layout.note(line);
            continue;
        }
        if let Some(unread) = layout.unread {
            let expected = "latitude, longitude and ellipsoidal height, or geocentric coordinates";
            return Err(lines.error(unread, expected));
        }
        match fix(line, layout) {
            _ if line.is_empty() => {}
            Some(fix) => fixes.push(fix),
            None => {
                unusable += 1;
                first.get_or_insert_with(|| {
                    let found: String = line.chars().take(80).collect();
                    lines.error(
                        format!("`{found}`"),
                        "time, place, Q, satellites and standard deviations",
                    )
                });
            }
        }
    }
    match first {
        Some(first) if unusable > fixes.len() => return Err(first),
        Some(first) => input.remark(format!("lines left out: {unusable}, the first: {first}")),
        None => {}
    }
    if fixes.is_empty() {
        return Err(nothing_in(input.path(), "position"));
    }
    if !layout.is_utc {
        input.remark(
            "the times are those of the file, most often GPS time, which has been 18 s ahead of UTC since 2017: if the other \
             logs are in UTC, write time_offset_s = -18",
        );
    }
    Ok(fixes)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROW: &str =
        "50.954250870 6.895502210 95.2771 2 15 0.5051 0.4042 1.0101 0.0012 -0.0011 0.0013 0.00 1.3";

    fn read_text(text: &str) -> Result<Vec<GeographicFix>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        std::fs::write(&path, text).unwrap();
        let input = Input::from(&path);
        assert_eq!(crate::format::detect(&input)?.id(), "rtklib-pos");
        read(&input)
    }

    #[test]
    fn times_of_each_kind_and_angles_in_minutes_are_read() {
        let unix_s = 1_691_572_500.25;
        for (time, expected_s) in [
            ("2023/08/09 09:15:00.250", unix_s),
            ("2274 292500.25", unix_s),
            ("09:15:00.25", 33_300.25),
        ] {
            let fix = read_text(&format!("{time} {ROW}\n")).unwrap()[0];
            assert_eq!(fix.time_s, expected_s, "{time}");
            assert_eq!(fix.quality, Some(FixQuality::Float));
            assert_eq!(fix.sigma_m, Some(Vec3::new(0.4042, 0.5051, 1.0101)));
            assert!((fix.latitude_rad.to_degrees() - 50.95425087).abs() < 1e-12);
            assert_eq!(fix.height_m, 95.2771);
        }
        let text = "%  GPST  latitude(d'\")  longitude(d'\")  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)\n\
                    2274 292500 -33 51 54.0 151 12 18.0 24.5 1 9 0.01 0.02 0.03\n";
        let fix = read_text(text).unwrap()[0];
        let degrees = [fix.latitude_rad, fix.longitude_rad].map(f64::to_degrees);
        assert!((degrees[0] + 33.865).abs() < 1e-12 && (degrees[1] - 151.205).abs() < 1e-12);
    }

    #[test]
    fn geocentric_positions_and_their_covariances_are_turned() {
        // A row as the program writes it, of a station in Warsaw; expected values from a second implementation.
        let text = "%  GPST                      x-ecef(m)      y-ecef(m)      z-ecef(m)   Q  ns   sdx(m)   sdy(m)   sdz(m)  \
                    sdxy(m)  sdyz(m)  sdzx(m) age(s)  ratio\n\
                    2024/05/18 00:01:00.000   3655333.8139   1403901.0395   5018037.9864   1   8   0.0117   0.0063   \
                    0.0128   0.0056   0.0048   0.0097   0.00    3.6\n";
        let fix = read_text(text).unwrap()[0];
        let degrees = [fix.latitude_rad, fix.longitude_rad].map(f64::to_degrees);
        assert!(
            (degrees[0] - 52.220_965_721_746_26).abs() < 1e-12,
            "{degrees:?}"
        );
        assert!(
            (degrees[1] - 21.010_243_419_965_757).abs() < 1e-12,
            "{degrees:?}"
        );
        assert!(
            (fix.height_m - 170.719_567_583_9).abs() < 1e-8,
            "{}",
            fix.height_m
        );
        let expected = Vec3::new(
            0.005_585_026_782_366,
            0.007_697_665_004_938,
            0.015_810_548_039_584,
        );
        assert!((fix.sigma_m.unwrap() - expected).norm() < 1e-12, "{fix:?}");
        assert_eq!(fix.quality, Some(FixQuality::Fixed));
        assert_eq!(fix.time_s, 1_715_990_460.0);
    }

    #[test]
    fn other_coordinates_are_refused_and_cut_lines_counted() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.pos");
        let row = format!("2274 292500.25 {ROW}\n");
        std::fs::write(&path, format!("{row}{row}2274 292501.25 50.9542")).unwrap();
        let input = Input::from(&path);
        assert_eq!(read(&input).unwrap().len(), 2);
        let remarks = input.remarks().join("\n");
        assert!(
            remarks.contains("lines left out: 1, the first: "),
            "{remarks}"
        );
        assert!(remarks.contains("line 3") && remarks.contains("18 s ahead of UTC"));
        let baselines =
            format!("%  GPST  e-baseline(m)  n-baseline(m)  u-baseline(m)   Q  ns\n{row}");
        let error = read_text(&baselines).unwrap_err().to_string();
        assert!(error.contains("found baselines"), "{error}");
    }
}
