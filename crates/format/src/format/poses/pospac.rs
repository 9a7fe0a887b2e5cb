//! Trajectories as text exported by POSPac MMS: free text, a line that names the columns between commas, a line in
//! brackets that states their units, and numbers between blanks.
//!
//! Positions are latitude and longitude (degrees) and ellipsoidal height, so a trajectory needs a projection. Eastings
//! and northings are passed over: their system is not stated in a form that can be relied on, and headings count from
//! true north as in SBET, not from the north of the grid. Roll is positive with the right side down, pitch with the nose
//! up. Times are those of the file, most often seconds of the GPS week.

use super::layout::{Layout, all};
use crate::error::Result;
use crate::format::file::nothing_in;
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind, Start};
use crate::format::poses::order::Order;
use crate::format::text::lines::{Lines, Separator};
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
    ..Kind::new("pospac-text", "trajectory (POSPac text export, geographic)")
};

/// The columns that are needed, after the time.
const NEEDED: [&str; 5] = ["LATITUDE", "LONGITUDE", "ROLL", "PITCH", "HEADING"];
const HEIGHT: &str = "ELLIPSOID HEIGHT";
const VELOCITY: [&str; 3] = ["EAST VELOCITY", "NORTH VELOCITY", "UP VELOCITY"];
const SIGMA: [&str; 6] = [
    "EAST SD",
    "NORTH SD",
    "HEIGHT SD",
    "ROLL SD",
    "PITCH SD",
    "HEADING SD",
];

/// What the line of the units must state, in lower case.
const UNITS: [&str; 3] = [
    "position in meters",
    "lat, long in degrees",
    "orientation angles and sd in degrees",
];

/// The same, if the columns have velocities and standard deviations of positions.
const VELOCITY_UNIT: &str = "velocity in meter/sec";
const SIGMA_UNIT: &str = "position sd in meters";

/// Whether a line names the columns of a trajectory.
fn is_header(names: &[String]) -> bool {
    let has = |wanted: &&str| names.iter().any(|name| name == wanted);
    names.first().is_some_and(|name| name == "TIME") && ["ROLL", "PITCH", "HEADING"].iter().all(has)
}

fn is_units(line: &str) -> bool {
    line.starts_with("(time in")
}

fn looks_like(start: &Start<'_>) -> bool {
    let text = String::from_utf8_lossy(start.bytes);
    let mut lines = text
        .split(['\r', '\n'])
        .map(str::trim)
        .filter(|line| !line.is_empty());
    let has_header = lines.any(|line| is_header(&Separator::Comma.names(line)));
    has_header && lines.next().is_some_and(is_units)
}

/// The layout that a header names. The error is the name of a column that is missing.
fn layout(names: &[String]) -> std::result::Result<Layout, &'static str> {
    let find = |wanted: &str| names.iter().position(|name| name == wanted);
    let need = |wanted: &'static str| find(wanted).ok_or(wanted);
    let [latitude, longitude, roll, pitch, heading] = NEEDED.map(need);
    let longitude = longitude?;
    // The height that belongs to latitude and longitude follows them.
    let height = Some(longitude + 1).filter(|at| names.get(*at).is_some_and(|n| n == HEIGHT));
    let time = need("TIME")?;
    let height = height.ok_or("ELLIPSOID HEIGHT behind LONGITUDE")?;
    Ok(Layout {
        width: names.len(),
        needed: [time, latitude?, longitude, height, roll?, pitch?, heading?],
        velocity: all(VELOCITY.map(find)),
        sigma: all(SIGMA.map(find)),
    })
}

/// Reads the poses, in the order of the file.
///
/// # Errors
/// A column that is missing, units other than metres and degrees, rows without as many finite numbers as the header has
/// names, latitudes beyond the poles, times out of order, no pose.
fn read(input: &Input) -> Result<Vec<GeographicPose>> {
    let mut lines = Lines::open(input)?;
    let layout = read_header(input, &mut lines)?;
    let (mut cells, mut poses) = (Vec::with_capacity(layout.width), Vec::new());
    let mut order = Order::default();
    let expected = || format!("{} finite numbers, as the header names", layout.width);
    while lines.next_numbers(&mut cells, |n| n == layout.width, expected)? {
        layout.add(&cells, &lines, &mut order, &mut poses)?;
    }
    if poses.is_empty() {
        return Err(nothing_in(input.path(), "pose"));
    }
    order.finish()?;
    Ok(poses)
}

/// Reads the lines up to the first row of numbers.
fn read_header(input: &Input, lines: &mut Lines) -> Result<Layout> {
    let mut clock = None;
    loop {
        if !lines.advance()? {
            return Err(lines.error(
                "no line that names the columns",
                "TIME, …, ROLL, PITCH, HEADING",
            ));
        }
        let line = lines.text();
        let names = Separator::Comma.names(line);
        if !is_header(&names) {
            let lower = line.to_lowercase();
            let is_clock =
                lower.contains("time") && (lower.contains("utc") || lower.contains("gps"));
            if is_clock && clock.is_none() {
                clock = Some(line.chars().take(80).collect::<String>());
            }
            continue;
        }
        let layout = layout(&names).map_err(|missing| {
            let expected = "an export with LATITUDE, LONGITUDE and ELLIPSOID HEIGHT: the heading counts from true \
                            north, and the system of easting and northing is not known";
            lines.error(format!("no column {missing}"), expected)
        })?;
        while lines.advance()? && lines.text().is_empty() {}
        let units = lines.text().to_lowercase();
        let velocity = layout.velocity.map(|_| VELOCITY_UNIT);
        let sigma = layout.sigma.map(|_| SIGMA_UNIT);
        let mut wanted = UNITS.into_iter().chain(velocity).chain(sigma);
        if let Some(missing) = wanted.find(|unit| !units.contains(unit)) {
            let found: String = lines.text().chars().take(200).collect();
            return Err(lines.error(format!("`{found}`"), format!("units with `{missing}`")));
        }
        input.remark(match clock {
            Some(clock) => format!("the times are those of the file, which says `{clock}`"),
            None => "the times are those of the file, which does not name their clock".to_owned(),
        });
        return Ok(layout);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::{detect, read_projected_trajectory, read_trajectory};
    use crate::geometry::attitude::roll_pitch_heading;
    use crate::geometry::{BodyAxes, Projection, Vec3};
    use crate::sensor::NavigationAngles;

    const TEXT: &str = "POSPac MMS\nInput File Time: GPS seconds of week\n\n\
        TIME, DISTANCE, EASTING, NORTHING, ELLIPSOID HEIGHT, LATITUDE, LONGITUDE, ELLIPSOID HEIGHT, ROLL, PITCH, \
        HEADING, EAST VELOCITY, NORTH VELOCITY, UP VELOCITY, EAST SD, NORTH SD, HEIGHT SD, ROLL SD, PITCH SD, HEADING SD\n\n\
        (time in Sec, distance in Meters, position in Meters, lat, long in Degrees, orientation angles and SD in \
        Degrees, velocity in Meter/Sec, position SD in Meters)\n\n\
        100.5 0 1 2 3 50.7 6.2 123.25 1 -2 90 4 5 6 0.01 0.02 0.03 0.1 0.2 0.3\n";

    fn read_text(text: &str) -> Result<Vec<GeographicPose>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        std::fs::write(&path, text).unwrap();
        assert_eq!(detect(&path)?.id(), "pospac-text");
        let poses = read(&Input::from(&path))?;
        let error = read_trajectory(&path).unwrap_err().to_string();
        assert!(error.contains("`crs`"), "{error}");
        Ok(poses)
    }

    #[test]
    fn poses_have_velocities_and_standard_deviations() {
        let pose = read_text(TEXT).unwrap()[0];
        assert_eq!((pose.time_s, pose.height_m), (100.5, 123.25));
        assert_eq!(pose.velocity_m_s, Some(Vec3::new(4.0, 5.0, 6.0)));
        let sigma = pose.sigma.unwrap();
        assert_eq!(sigma.position_m, Vec3::new(0.01, 0.02, 0.03));
        assert_eq!(sigma.angles, NavigationAngles::from_deg([0.1, 0.2, 0.3]));
        // Zero stands for no standard deviation.
        let unknown = read_text(&TEXT.replace(" 0.01 ", " 0 ")).unwrap()[0];
        assert_eq!(unknown.sigma, None);
    }

    #[test]
    fn headings_from_true_north_are_turned_to_grid_north() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        std::fs::write(&path, TEXT).unwrap();
        let crs = Projection::new("EPSG:25832").unwrap();
        let input = Input::from(&path);
        let pose = read_projected_trajectory(&input, BodyAxes::Flu, Some(&crs)).unwrap()[0];
        // pyproj 3.7.2, Proj("EPSG:25832")(6.2, 50.7); the meridian convergence of a sphere.
        let expected = Vec3::new(302_276.343_692_3, 5_620_204.618_403_7, 123.25);
        assert!((pose.world_from_body.translation_m - expected).norm() < 1e-6);
        let angles = roll_pitch_heading(&pose.world_from_body.rotation).map(f64::to_degrees);
        let convergence_deg = (50.7f64.to_radians().sin() * (6.2f64 - 9.0).to_radians().tan())
            .atan()
            .to_degrees();
        assert!((angles[0] - 1.0).abs() < 1e-9 && (angles[1] + 2.0).abs() < 1e-9);
        assert!(
            (angles[2] - (90.0 - convergence_deg)).abs() < 1e-3,
            "{angles:?}"
        );
        let remarks = input.remarks().join("\n");
        assert!(
            remarks.contains("`Input File Time: GPS seconds of week`"),
            "{remarks}"
        );
    }

    #[test]
    fn other_columns_and_units_are_refused() {
        for (from, to, expected) in [
            ("LATITUDE,", "LAT,", "no column LATITUDE"),
            (
                "LONGITUDE, ELLIPSOID HEIGHT",
                "LONGITUDE, ORTHOMETRIC HEIGHT",
                "ELLIPSOID HEIGHT behind",
            ),
            (
                "long in Degrees",
                "long in Radians",
                "units with `lat, long in degrees`",
            ),
            (" 0.3\n", "\n", "20 finite numbers"),
            (" 50.7 ", " 150.7 ", "latitude 150.7"),
        ] {
            let error = read_text(&TEXT.replace(from, to)).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }

    #[test]
    fn damaged_files_do_not_panic() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        crate::format::mutation::for_each_damaged(&path, TEXT.as_bytes(), 500, || {
            let _ = detect(&path);
            let _ = read(&Input::from(&path));
        });
    }
}
