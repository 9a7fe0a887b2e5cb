//! Trajectories as text exported by Inertial Explorer: lines about the project, a line that names the columns, a line with
//! their units in brackets, and numbers between blanks.
//!
//! The columns `GPSTime`, `Latitude`, `Longitude`, `H-Ell`, `Roll`, `Pitch` and `Heading` are needed, latitudes and
//! longitudes in degrees with decimals; an export profile may have others, in any order. Headings count clockwise from
//! true north, roll is positive with the right side down, pitch with the nose up. Times are seconds of the GPS week.

use super::layout::{Layout, all};
use crate::error::{Error, Result};
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind, Start};
use crate::format::left_out::LeftOut;
use crate::format::poses::order::Order;
use crate::format::text::lines::Lines;
use crate::sensor::GeographicPose;

pub(crate) const EXPORT: Kind = Kind {
    signature: Some(looks_like),
    geographic_poses: Some(read),
    has_navigation_angles: true,
    note: "geographic positions: used with `crs` in [frame] of a project",
    frame: Frame::Fixed(
        "degrees and metres (named in the file); latitude, longitude, ellipsoidal height; headings clockwise from true \
         north (the format); body x forward, y left, z up, turned to the axes of the project",
    ),
    ..Kind::new(
        "inertial-explorer",
        "trajectory (Inertial Explorer text export, geographic)",
    )
};

/// The columns that are needed, with their units.
const NEEDED: [(&str, &str); 7] = [
    ("GPSTime", "(sec)"),
    ("Latitude", "(deg)"),
    ("Longitude", "(deg)"),
    ("H-Ell", "(m)"),
    ("Roll", "(deg)"),
    ("Pitch", "(deg)"),
    ("Heading", "(deg)"),
];
/// Columns with velocities east, north and up, and with standard deviations.
const VELOCITY: [(&str, &str); 3] = [("VEast", "(m/s)"), ("VNorth", "(m/s)"), ("VUp", "(m/s)")];
const SIGMA: [(&str, &str); 6] = [
    ("SDEast", "(m)"),
    ("SDNorth", "(m)"),
    ("SDHeight", "(m)"),
    ("RollSD", "(deg)"),
    ("PitchSD", "(deg)"),
    ("HdngSD", "(deg)"),
];
/// Most columns without a unit behind the others.
const UNITLESS: usize = 2;
const EXPECTED: &str = "the columns GPSTime (sec), Latitude (deg), Longitude (deg), H-Ell (m), Roll (deg), Pitch (deg) and \
     Heading (deg): choose them in the export profile, with degrees that have decimals";

fn looks_like(start: &Start<'_>) -> bool {
    start.contains(b"Inertial Explorer") && start.contains(b"GPSTime")
}

/// The layout that two lines with names and units give; the error is a column that is missing or has another unit.
fn layout(names: &[&str], units: &[&str]) -> std::result::Result<Layout, String> {
    // The last columns may have no unit, such as the quality.
    let has_units = units.len() >= names.len().saturating_sub(UNITLESS);
    if !has_units || units.len() > names.len() {
        return Err(format!(
            "{} names of columns above {} units",
            names.len(),
            units.len()
        ));
    }
    let find = |(name, unit): (&str, &str)| {
        let at = names.iter().position(|known| *known == name);
        let at = at.ok_or_else(|| format!("no column {name}"))?;
        match units.get(at) {
            Some(found) if *found == unit => Ok(at),
            found => Err(format!(
                "the column {name} in {}",
                found.unwrap_or(&"no unit")
            )),
        }
    };
    let mut needed = [0; 7];
    for (at, wanted) in needed.iter_mut().zip(NEEDED) {
        *at = find(wanted)?;
    }
    Ok(Layout {
        width: names.len(),
        needed,
        velocity: all(VELOCITY.map(|wanted| find(wanted).ok())),
        sigma: all(SIGMA.map(|wanted| find(wanted).ok())),
    })
}

/// Reads the poses, in the order of the file.
///
/// # Errors
/// A column that is missing or in another unit, rows with another number of values than the header, latitudes beyond the
/// poles, as many times out of order as in it, no pose, more rows that are not numbers than poses.
fn read(input: &Input) -> Result<Vec<GeographicPose>> {
    let mut lines = Lines::open(input)?;
    let layout = read_header(&mut lines)?;
    let (mut cells, mut poses) = (Vec::with_capacity(layout.width), Vec::new());
    let (mut order, mut left_out) = (Order::default(), LeftOut::default());
    let expected = || format!("{} numbers, as the header names", layout.width);
    while lines.next_row(&mut cells, |row| row.len() == layout.width, expected)? {
        if layout.needed.iter().any(|at| !cells[*at].is_finite()) {
            left_out.add("with values that are no numbers");
            continue;
        }
        layout.add(&cells, &lines, &mut order, &mut poses)?;
    }
    order.finish()?;
    input.remark("times are as in the file, seconds of the GPS week".to_owned());
    left_out.checked(input, poses, "poses", "rows of poses")
}

/// Reads the lines up to the units below the names of the columns.
fn read_header(lines: &mut Lines) -> Result<Layout> {
    let wrong = |lines: &Lines, found: String| -> Error { lines.error(found, EXPECTED) };
    while lines.advance()? {
        let names: Vec<String> = lines
            .text()
            .split_ascii_whitespace()
            .map(str::to_owned)
            .collect();
        if !names.iter().any(|name| name == NEEDED[0].0) {
            continue;
        }
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        if !lines.advance()? {
            break;
        }
        let units: Vec<&str> = lines.text().split_ascii_whitespace().collect();
        return layout(&names, &units).map_err(|found| wrong(lines, found));
    }
    Err(wrong(lines, "no line that names the columns".to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::{detect, read_geographic_poses};
    use crate::sensor::NavigationAngles;

    const TEXT: &str = "Project:     a field\nProgram:     Inertial Explorer Version 8.90\nDatum:       WGS84\n\
        \x20     GPSTime       Latitude      Longitude        H-Ell           Roll          Pitch        Heading Q\n\
        \x20       (sec)          (deg)          (deg)          (m)          (deg)          (deg)          (deg)  \n\
        292500.000  50.9542508700   6.8955022100     95.277   0.1200000  -0.4300000  341.3300000 1\n\
        292500.005  50.9542508800   6.8955022200     95.277   0.1200000  -0.4300000  341.3300000 1\n";

    fn read_text(text: &str) -> Result<Vec<GeographicPose>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ie.txt");
        std::fs::write(&path, text).unwrap();
        assert_eq!(detect(&path).unwrap().id(), "inertial-explorer");
        read_geographic_poses(&path)
    }

    #[test]
    fn columns_are_found_by_their_names() {
        let poses = read_text(TEXT).unwrap();
        assert_eq!(poses.len(), 2);
        assert_eq!((poses[1].time_s, poses[1].height_m), (292_500.005, 95.277));
        assert!((poses[0].latitude_rad.to_degrees() - 50.954_250_87).abs() < 1e-12);
        let expected = NavigationAngles::from_deg([0.12, -0.43, 341.33]);
        assert_eq!(poses[0].angles, expected);
        assert!(poses[0].sigma.is_none());
    }

    #[test]
    fn other_columns_and_units_are_named() {
        for (from, to, expected) in [
            ("Latitude ", "Northing ", "no column Latitude"),
            (
                "(deg)          (deg)          (m)",
                "(rad)          (deg)          (m)",
                "Latitude in (rad)",
            ),
            (
                "(deg)          (deg)          (m)",
                "(+/-D M S) (+/-D M S) (m)",
                "names of columns above",
            ),
        ] {
            let error = read_text(&TEXT.replacen(from, to, 1))
                .unwrap_err()
                .to_string();
            assert!(
                error.contains(expected) && error.contains("export profile"),
                "{error}"
            );
        }
    }
}
