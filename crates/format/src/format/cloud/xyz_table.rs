//! Clouds as text of other programs: a header with the three coordinates, then one point per line.
//!
//! The header may be `X,Y,Z,Intensity`, `"X","Y","Z","GpsTime"` (PDAL), `# x y z` (NumPy), `//X Y Z R G B`
//! (CloudCompare) or `Rechtswert;Hochwert;Höhe`, with columns in any order, separated by commas, semicolons or white
//! space. The line before or after it may hold the number of points, which must be correct. Coordinates are assumed to
//! be metres unless the header names a unit in brackets, and the columns `GpsTime`, `gps_time`, `time` or `time_s`
//! seconds, or dates with times of UTC. `Intensity` is read too; other columns are left out.
//!
//! A table that begins with its time and has no intensity is a log of positions, which may also be read as a cloud. A
//! table with angles or a quaternion may be a log of poses, and is not accepted. A row of units may follow the header.

use crate::cloud::PointCloud;
use crate::error::{Error, Location, Result};
use crate::format::cloud::gathering::Gathering;
use crate::format::cloud::names::{is_cloud, is_timed};
use crate::format::cloud::xyz_header::{Header, VALUES, fitting, headers};
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::left_out::LeftOut;
use crate::format::text::lines::Lines;
use crate::format::text::numerals::{DECIMAL_COMMAS, Numerals};
use crate::geometry::{Vec3, is_finite};
use crate::sensor::{Observations, PositionFix, Positions};

pub(crate) const XYZ_TABLE: Kind = Kind {
    header: Some(is_cloud),
    cloud: Some(read),
    frame: Frame::Fixed(
        "metres and seconds (assumed unless the header names units); x, y, z are axes of the file, taken for the world",
    ),
    ..Kind::new("xyz-csv", "cloud (text with the columns x, y, z)")
};

pub(crate) const TIMED_TABLE: Kind = Kind {
    header: Some(is_timed),
    positions: Some(read_positions),
    cloud: Some(read),
    frame: XYZ_TABLE.frame,
    ..Kind::new("xyz-prism-csv", "position log (text with time, x, y, z)")
};

/// The text after the mark of a comment.
fn comment(text: &str) -> Option<&str> {
    text.strip_prefix('#').or_else(|| text.strip_prefix("//"))
}

/// Reads a cloud.
///
/// # Errors
/// Those of [`each_row`].
fn read(input: &Input) -> Result<PointCloud> {
    let mut gathering = Gathering::new(input);
    each_row(input, |[x, y, z, time_s, intensity, seen_from @ ..]| {
        gathering.push(Vec3::new(x, y, z), time_s, intensity);
        gathering.seen_from(Vec3::from(seen_from));
    })?;
    gathering.finish()
}

/// Reads a log of positions.
///
/// # Errors
/// Those of [`each_row`], polar observations, no position, more rows without a position or a time than others.
fn read_positions(input: &Input, observations: &Observations) -> Result<Positions> {
    if matches!(observations, Observations::Polar(_)) {
        return Err(Error::format(
            input.path(),
            Location::Whole,
            "coordinates",
            "polar observations, since the project gives station_orientation_deg",
        ));
    }
    let mut fixes = Vec::new();
    let mut left_out = LeftOut::default();
    each_row(input, |[x, y, z, time_s, ..]| {
        let position_m = Vec3::new(x, y, z);
        if time_s.is_finite() && is_finite(&position_m) {
            fixes.push(PositionFix::with_sigma(time_s, position_m, None));
        } else {
            left_out.add("without a time or a coordinate");
        }
    })?;
    let fixes = left_out.checked(input, fixes, "positions", "rows of time, x, y, z")?;
    Ok(Positions::of(fixes))
}

/// Reads the rows of a table.
///
/// # Errors
/// A line with another number of values than the header, a repeated column, a number of points other than the file
/// announces.
fn each_row(input: &Input, mut each: impl FnMut([f64; VALUES])) -> Result<()> {
    let mut lines = Lines::open(input)?;
    let (mut titles, mut header) = (Vec::new(), None);
    let mut announced: Option<u64> = None;
    let mut numerals = Numerals::default();
    let mut rows = 0u64;
    while lines.advance()? {
        let text = lines.text();
        if text.is_empty() {
            continue;
        }
        if rows == 0 {
            let title = comment(text).unwrap_or(text);
            let found = headers(&lines, title);
            if !found.is_empty() {
                titles = found;
                continue;
            }
            if announced.is_none()
                && let Ok(count) = text.parse()
            {
                announced = Some(count);
                continue;
            }
            if titles
                .iter_mut()
                .flatten()
                .any(|header| header.take_units(title))
            {
                continue;
            }
        }
        if comment(text).is_some() {
            continue;
        }
        if rows == 0 {
            header = fitting(std::mem::take(&mut titles), text)?;
        }
        let Some(header) = &mut header else {
            let found: String = text.chars().take(80).collect();
            return Err(lines.error(format!("`{found}`"), "a header with x, y, z"));
        };
        let row = header.any_row(text, &mut numerals);
        each(row.map_err(|(found, expected)| lines.error(found, expected))?);
        rows += 1;
    }
    if let Some(n) = announced.filter(|n| *n != rows) {
        return Err(Error::format(
            input.path(),
            Location::Whole,
            format!("{rows} points"),
            format!("{n}, the number in the file"),
        ));
    }
    if numerals.has_decimal_commas {
        input.remark(DECIMAL_COMMAS);
    }
    if let Some(remark) = header.as_ref().and_then(Header::left_out) {
        input.remark(remark);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::cloud::PointCloud;
    use crate::format::text::lines::Separator;
    use crate::format::{detect, read_cloud};

    fn cloud(name: &str, text: &str) -> Result<PointCloud> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        assert_eq!(detect(&path)?.id(), "xyz-csv", "{text}");
        read_cloud(&path)
    }

    fn message(text: &str) -> String {
        cloud("a.txt", text).unwrap_err().to_string()
    }

    #[test]
    fn headers_of_other_programs_are_detected_and_read() {
        for text in [
            "x,y,z\n1,2,3\n4,5,6\n",
            "X Y Z\n1 2 3\n4 5 6\n",
            "X,Y,Z,Classification\n1,2,3,2\n4,5,6,2\n",
            "\"X\",\"Y\",\"Z\"\n1.0,2.0,3.0\n4,5,6\n",
            "\"\",\"x\",\"y\",\"z\"\n\"1\",1,2,3\n\"2\",4,5,6\n",
            "# x y z\n1 2 3\n4 5 6\n",
            "# x y z\n1,2,3\n4,5,6\n",
            "# x,y,z\n1.0e+00 2.0 3.0\n4 5 6\n",
            "//X Y Z R G B\n1 2 3 0 0 255\n4 5 6 0 0 255\n",
            "//X;Y;Z;R;G;B\n2\n1;2;3;0;0;255\n4;5;6;0;0;255\n",
            "2\n//X Y Z\n1 2 3\n4 5 6\n",
            "\u{feff}x\ty\tz\tr\tg\tb\r\n1\t2\t3\t0\t0\t0\r\n\r\n4\t5\t6\t0\t0\t0\r\n",
            "Red Z Y X\n255 3 2 1\n0 6 5 4\n",
        ] {
            for name in ["a.txt", "a.csv", "a.asc", "a.xyz"] {
                let cloud = cloud(name, text).unwrap();
                let expected = [Vec3::new(1.0, 2.0, 3.0), Vec3::new(4.0, 5.0, 6.0)];
                assert_eq!(cloud.points, expected, "{text}");
                assert!(cloud.time_s.is_empty() && cloud.intensity.is_empty());
            }
        }
    }

    #[test]
    fn times_and_intensities_are_kept_with_gaps() {
        for (time, intensity) in [
            ("GpsTime", "Intensity"),
            ("gps_time", "intensity"),
            ("time", "INTENSITY"),
        ] {
            let all = cloud(
                "a",
                &format!("x,y,z,{intensity},{time}\n1,2,3,7,0.5\n4,5,6,8,1\n"),
            )
            .unwrap();
            assert_eq!(
                (all.time_s, all.intensity),
                (vec![0.5, 1.0], vec![7.0, 8.0])
            );
            let some = cloud(
                "a",
                &format!("x,y,z,{intensity},{time}\n1,2,3,,0.5\n4,5,6,8,nan\n"),
            )
            .unwrap();
            assert_eq!((some.time_s[0], some.intensity[1]), (0.5, 8.0));
            assert!(some.time_s[1].is_nan() && some.intensity[0].is_nan());
        }
    }

    #[test]
    fn other_tables_are_not_clouds() {
        for text in [
            "x,y,z,roll,pitch,yaw\n1,2,3,4,5,6\n",
            "x y z qx qy qz qw\n1 2 3 0 0 0 1\n",
            "x,z\n1,2\n",
            "easting,northing,roll,pitch,yaw,height\n1,2,3,4,5,6\n",
        ] {
            assert!(!is_cloud(
                &Separator::of(text).names(text.lines().next().unwrap())
            ));
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a.csv");
            std::fs::write(&path, text).unwrap();
            assert!(detect(&path).is_err(), "{text}");
        }
    }

    #[test]
    fn positions_with_times_are_a_log_and_a_cloud() {
        for header in [
            "time,x,y,z",
            "time_s,X,Y,Z",
            "Timestamp [s];East_m;North_m;Up_m;Code",
        ] {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a.csv");
            let cells = |cells: [&str; 5]| {
                let columns = Separator::of(header).names(header).len();
                cells[..columns].join(if header.contains(';') { ";" } else { "," })
            };
            let rows = [
                ["1", "2", "3", "4", "7"],
                ["nan", "5", "6", "7", "7"],
                ["3", "4", "5", "6", "7"],
            ];
            let rows = rows.map(cells).join("\n");
            std::fs::write(&path, format!("{header}\n{rows}\n")).unwrap();
            assert_eq!(detect(&path).unwrap().id(), "xyz-prism-csv");
            assert_eq!(read_cloud(&path).unwrap().points.len(), 3);
            let input = Input::from(&path);
            let found = read_positions(&input, &Observations::AsFound)
                .unwrap()
                .fixes;
            assert_eq!([found[0].time_s, found[1].position_m.z], [1.0, 6.0]);
            assert!(input.remarks().join("\n").contains("1 without a time"));
        }
    }

    #[test]
    fn units_and_marks_behind_the_header_are_understood() {
        for text in [
            "X[US survey feet],Y[US survey feet],Z[US survey feet]\n3937,0,0\n",
            "x;y;z;\n1200;0;0\n",
            "x,y,z\n[mm],[mm],[mm]\n1200000,0,0\n",
            "Point,North,East,Elev.,Code\nA,0,1200,0,B7\n",
        ] {
            let found = cloud("a.txt", text).unwrap();
            assert!(
                (found.points[0] - Vec3::new(1200.0, 0.0, 0.0)).norm() < 1e-9,
                "{text}"
            );
        }
        let found = cloud("a.txt", "x,y,z,time_ns\n1,2,3,1700000000100000000\n").unwrap();
        assert!((found.time_s[0] - 1_700_000_000.1).abs() < 1e-6);
    }

    #[test]
    fn errors_name_the_line() {
        let found = message("X;Y;Z\n1,234;2,5;5,621,000\n");
        assert!(
            found.contains("line 2: found `5,621,000` in column Z, expected a number"),
            "{found}"
        );
        let found = message("x,y,z\n1,5,2,5,3,5\n");
        assert!(
            found.contains("found 6 values") && found.contains("not commas"),
            "{found}"
        );
        let found = message("x,y,z\n1,2,3\n1,2\n");
        assert!(
            found.contains("line 3: found 2 values, expected 3 as in the header"),
            "{found}"
        );
        let found = message("x,y,z\n1,2,inf\n");
        assert!(
            found.contains("`inf` in column z, expected a number"),
            "{found}"
        );
        assert!(message("x,y,z\n1,2,nan\n").contains("no point"));
        let found = message("x,y,z,X\n1,2,3,4\n");
        assert!(found.contains("the columns x and X"), "{found}");
        let found = message("//X Y Z\n3\n1 2 3\n");
        assert!(
            found.contains("found 1 points, expected 3, the number in the file"),
            "{found}"
        );
        assert!(message("x,y,z\n").contains("no point"));
    }

    /// The same 40 points as CloudCompare 2.11, NumPy and pandas wrote them; CloudCompare keeps z as f32.
    #[test]
    fn files_of_other_programs_have_the_same_points() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/text");
        let read = |name: &str| {
            let path = folder.join(name);
            assert_eq!(detect(&path).unwrap().id(), "xyz-csv");
            read_cloud(&path).unwrap()
        };
        let pandas = read("pandas_semicolon.csv");
        assert_eq!(
            pandas.points[0],
            Vec3::new(500_005.118, 5_600_006.413, 100.66)
        );
        assert_eq!(
            (pandas.intensity[0], pandas.time_s[39]),
            (13_217.0, 100_000.39)
        );
        assert_eq!(read("numpy_savetxt.txt").points, pandas.points);
        for name in ["cloudcompare_header.asc", "cloudcompare_header_count.asc"] {
            let cloud = read(name);
            assert_eq!(cloud.points.len(), 40);
            for (found, expected) in cloud.points.iter().zip(&pandas.points) {
                assert!((found - expected).norm() < 5e-6, "{found} {expected}");
            }
            assert_eq!(cloud.intensity, pandas.intensity);
            assert_eq!((cloud.time_s[0], cloud.time_s[39]), (0.0, 9.75));
        }
    }

    #[test]
    fn damaged_files_do_not_panic() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let valid = b"//X Y Z Intensity GpsTime\n2\n1 2 3 4 5.5\n-4 5e3 6 7 8.25\n";
        crate::format::mutation::for_each_damaged(&path, valid, 500, || {
            let _ = read(&Input::from(&path));
            let _ = read_cloud(&path);
        });
    }
}
