//! Clouds as text of other programs: a header with the columns x, y and z, then one point per line.
//!
//! The header may be `X,Y,Z,Intensity`, `"X","Y","Z","GpsTime"` (PDAL), `# x y z` (NumPy) or `//X Y Z R G B`
//! (CloudCompare), with columns in any order, separated by commas, semicolons or white space. The line before or
//! after it may hold the number of points, which must be correct. The header has no units: coordinates are assumed
//! to be metres, and the columns `GpsTime`, `gps_time`, `time` or `time_s` seconds. `Intensity` is read too; other
//! columns are ignored.
//!
//! A table that begins with its time and has no intensity may be a log of positions, and a table with angles or a
//! quaternion may be a log of poses: neither is accepted as a cloud.

use crate::cloud::PointCloud;
use crate::error::{Error, Location, Result};
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::text::lines::{Lines, Separator};
use crate::geometry::Vec3;

const TIMES: [&str; 3] = ["gpstime", "time", "times"];
const INTENSITY: &str = "intensity";
/// Columns of a trajectory.
const ATTITUDE: [&str; 11] = [
    "qx", "qy", "qz", "qw", "roll", "pitch", "yaw", "heading", "omega", "phi", "kappa",
];

pub(crate) const XYZ_TABLE: Kind = Kind {
    header: Some(is_header),
    cloud: Some(read),
    frame: Frame::Fixed(
        "metres and seconds (assumed: the header has no units); x, y, z are axes of the file, taken for the world",
    ),
    ..Kind::new("xyz-csv", "cloud (text with the columns x, y, z)")
};

/// A name without differences of spelling: `gps_time` and `GpsTime` become `gpstime`.
fn plain(name: &str) -> String {
    name.to_lowercase().replace('_', "")
}

/// Whether a table with these columns is a cloud.
fn is_header(names: &[String]) -> bool {
    let names: Vec<String> = names.iter().map(|name| plain(name)).collect();
    let has = |wanted: &str| names.iter().any(|name| name == wanted);
    let begins_with_time = names.first().is_some_and(|name| name.starts_with("time"));
    ["x", "y", "z"].iter().all(|axis| has(axis))
        && !ATTITUDE.iter().any(|name| has(name))
        && (!begins_with_time || has(INTENSITY))
}

/// The columns that are read, and the separator of lines.
struct Header {
    names: Vec<String>,
    /// Column indices of x, y, z, the time and the intensity.
    indices: [Option<usize>; 5],
    separator: Separator,
}

impl Header {
    fn of(lines: &Lines, names: Vec<String>, separator: Separator) -> Result<Self> {
        let mut indices = [None; 5];
        for (at, name) in names.iter().enumerate() {
            let slot = match plain(name).as_str() {
                "x" => 0,
                "y" => 1,
                "z" => 2,
                INTENSITY => 4,
                time if TIMES.contains(&time) => 3,
                _ => continue,
            };
            if let Some(other) = indices[slot].replace(at) {
                let found = format!(
                    "the columns {} and {name} with the same meaning",
                    names[other]
                );
                return Err(lines.error(found, "each of x, y, z, time and intensity once"));
            }
        }
        Ok(Self {
            names,
            indices,
            separator,
        })
    }

    /// The numbers of a line; absent columns and empty cells are NaN. The error holds the text found and the text
    /// expected.
    fn row(
        &self,
        text: &str,
        separator: Separator,
    ) -> std::result::Result<[f64; 5], (String, String)> {
        let mut row = [f64::NAN; 5];
        let count = separator.split(text, |at, cell| {
            let Some(slot) = self.indices.iter().position(|index| *index == Some(at)) else {
                return Ok(());
            };
            let cell = cell.trim_matches('"');
            let may_be_empty = slot > 2;
            match cell.parse::<f64>() {
                Ok(value) if value.is_finite() => row[slot] = value,
                Ok(value) if value.is_nan() && may_be_empty => {}
                _ if cell.is_empty() && may_be_empty => {}
                _ => {
                    let shown: String = cell.chars().take(40).collect();
                    let has_comma =
                        cell.contains(',') && cell.replacen(',', ".", 1).parse::<f64>().is_ok();
                    let expected = if has_comma {
                        "a decimal point, not a comma"
                    } else {
                        "a finite number"
                    };
                    let found = format!("`{shown}` in column {}", self.names[at]);
                    return Err((found, expected.to_owned()));
                }
            }
            Ok(())
        })?;
        if count == self.names.len() {
            return Ok(row);
        }
        let mut expected = format!(
            "{} as in the header ({})",
            self.names.len(),
            self.names.join(", ")
        );
        if separator == Separator::Comma && count >= 2 * self.names.len() - 1 {
            expected += ", with decimal points, not commas";
        }
        Err((format!("{count} values"), expected))
    }
}

/// The text after the mark of a comment.
fn comment(text: &str) -> Option<&str> {
    text.strip_prefix('#').or_else(|| text.strip_prefix("//"))
}

/// Reads a cloud. Times and intensities are returned only if every point has them.
///
/// # Errors
/// A line with another number of values than the header, coordinates that are not finite numbers, decimal commas, a
/// repeated column, a number of points other than the file announces.
fn read(input: &Input) -> Result<PointCloud> {
    let mut lines = Lines::open(input)?;
    let mut header: Option<Header> = None;
    let mut announced: Option<u64> = None;
    let mut cloud = PointCloud::default();
    let (mut has_time, mut has_intensity) = (true, true);
    while lines.advance()? {
        let text = lines.text();
        if text.is_empty() {
            continue;
        }
        if cloud.points.is_empty() {
            let title = comment(text).unwrap_or(text);
            let separator = Separator::of(title);
            let names = separator.names(title);
            if is_header(&names) {
                header = Some(Header::of(&lines, names, separator)?);
                continue;
            }
            if announced.is_none()
                && let Ok(count) = text.parse()
            {
                announced = Some(count);
                continue;
            }
        }
        if comment(text).is_some() {
            continue;
        }
        let Some(header) = &mut header else {
            let found: String = text.chars().take(80).collect();
            return Err(lines.error(format!("`{found}`"), "a header with x, y, z"));
        };
        if cloud.points.is_empty() {
            // NumPy writes the names in a comment as its user gave them, and may separate the numbers otherwise.
            let separator = Separator::of(text);
            if header.row(text, separator).is_ok() {
                header.separator = separator;
            }
        }
        let row = header.row(text, header.separator);
        let [x, y, z, time_s, intensity] =
            row.map_err(|(found, expected)| lines.error(found, expected))?;
        cloud.points.push(Vec3::new(x, y, z));
        has_time &= !time_s.is_nan();
        has_intensity &= !intensity.is_nan();
        if has_time {
            cloud.time_s.push(time_s);
        }
        if has_intensity {
            cloud.intensity.push(intensity as f32);
        }
    }
    if !has_time {
        cloud.time_s.clear();
    }
    if !has_intensity {
        cloud.intensity.clear();
    }
    let count = cloud.points.len() as u64;
    match announced {
        Some(n) if n != count => Err(Error::format(
            input.path(),
            Location::Whole,
            format!("{count} points"),
            format!("{n}, the number in the file"),
        )),
        _ => Ok(cloud),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
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
    fn times_and_intensities_are_kept_if_every_point_has_them() {
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
            assert!(some.time_s.is_empty() && some.intensity.is_empty());
        }
    }

    #[test]
    fn other_tables_are_not_clouds() {
        for text in [
            "time,x,y,z\n1,2,3,4\n",
            "x,y,z,roll,pitch,yaw\n1,2,3,4,5,6\n",
            "x y z qx qy qz qw\n1 2 3 0 0 0 1\n",
            "x,z\n1,2\n",
            "easting,northing,height\n1,2,3\n",
        ] {
            assert!(!is_header(
                &Separator::of(text).names(text.lines().next().unwrap())
            ));
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a.csv");
            std::fs::write(&path, text).unwrap();
            assert!(detect(&path).is_err(), "{text}");
        }
    }

    #[test]
    fn errors_name_the_line() {
        let found = message("X;Y;Z\n1,5;2,5;3,5\n");
        assert!(
            found
                .contains("line 2: found `1,5` in column X, expected a decimal point, not a comma"),
            "{found}"
        );
        let found = message("X Y Z\n1,5 2,5 3,5\n");
        assert!(
            found.contains("expected a decimal point, not a comma"),
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
        let found = message("x,y,z\n1,2,nan\n");
        assert!(
            found.contains("`nan` in column z, expected a finite number"),
            "{found}"
        );
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
