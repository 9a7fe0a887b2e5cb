//! E57: all scans of a file, Cartesian or spherical, each transformed by its pose.

use std::io::BufReader;
use std::path::Path;

use crate::cloud::PointCloud;
use crate::error::{Error, Location, Result};
use crate::format::binary::Number;
use crate::format::cloud::crs;
use crate::format::cloud::gathering::Gathering;
use crate::format::file::guarded;
use crate::format::input::{Input, Stream};
use crate::format::kind::{Frame, Kind};
use crate::geometry::{Rotation, Vec3, WorldFromScanner};

pub(crate) const E57: Kind = Kind {
    signature: Some(|start| start.bytes.starts_with(b"ASTM-E57")),
    extensions: &["e57"],
    cloud: Some(read),
    wkt: Some(wkt),
    frame: Frame::OfFile(describe_frame),
    ..Kind::new("e57", "cloud (E57)")
};

fn problem(path: &Path, error: impl std::fmt::Display) -> Error {
    let text = error.to_string();
    // The decoder takes a page with a wrong checksum for the end of the file.
    let found = match text.find(CHECKSUM) {
        Some(at) => {
            let page = text[at..].split(" for ").nth(1).unwrap_or("a page");
            format!("a wrong checksum of {page}: the file is damaged")
        }
        None => text,
    };
    Error::format(path, Location::Whole, found, "an undamaged E57 file")
}

/// What the decoder says of a page whose checksum is wrong.
const CHECKSUM: &str = "invalid checksum";

/// Opens a file and checks its header; also returns its size in bytes.
fn open(input: &Input) -> Result<(Stream, u64)> {
    let (mut file, size) = input.open()?;
    check_header(input.path(), &input.first_bytes(&mut file)?, size)?;
    Ok((file, size))
}

/// The `coordinateMetadata` of a file, which holds WKT.
fn wkt(input: &Input) -> Result<Option<String>> {
    let (file, _) = open(input)?;
    guarded(input.path(), "E57", || {
        let reader = e57::E57Reader::new(BufReader::new(file))
            .map_err(|e| problem(input.path(), chain(&e)))?;
        let text = reader
            .coordinate_metadata()
            .map(|text| text.trim().to_owned());
        Ok(text.filter(|text| !text.is_empty()))
    })
}

/// Units and frame of a file: metres, and the coordinate reference system that the file names, if any.
fn describe_frame(input: &Input) -> Result<String> {
    let (file, _) = open(input)?;
    let system = guarded(input.path(), "E57", || {
        let reader = e57::E57Reader::new(BufReader::new(file))
            .map_err(|e| problem(input.path(), chain(&e)))?;
        let text = reader.coordinate_metadata();
        Ok(text.and_then(|text| crs::describe(text, "but read as metres")))
    })?;
    let system = system.map_or_else(
        || "axes of the file, taken for the world".to_owned(),
        |system| format!("{system} (coordinateMetadata of the file)"),
    );
    Ok(format!(
        "metres (the format); poses of the scans applied; {system}"
    ))
}

pub(crate) fn read(input: &Input) -> Result<PointCloud> {
    let (file, size) = open(input)?;
    let mut gathering = Gathering::new(input);
    let mut names = Vec::new();
    guarded(input.path(), "E57", || {
        let mut reader = e57::E57Reader::new(BufReader::new(file))
            .map_err(|e| problem(input.path(), chain(&e)))?;
        for (number, scan) in reader.pointclouds().iter().enumerate() {
            // A point takes at least one bit, unless all points are the same.
            if scan.records > size.saturating_mul(8) {
                return Err(problem(
                    input.path(),
                    format!("{} points in a file of {size} bytes", scan.records),
                ));
            }
            let world_from_scanner = scan_pose(input, number, scan)?;
            let mut points = reader
                .pointcloud_simple(scan)
                .map_err(|e| problem(input.path(), chain(&e)))?;
            for record in &scan.prototype {
                if let Some(name) = left_out(&record.name).filter(|name| !names.contains(name)) {
                    names.push(name);
                }
            }
            let first = gathering.len();
            points.apply_pose(false);
            points.normalize_intensity(false);
            points.normalize_color(false);
            points.intensity_to_color(false);
            for point in points {
                let point = point.map_err(|e| problem(input.path(), chain(&e)))?;
                let p = match point.cartesian {
                    e57::CartesianCoordinate::Valid { x, y, z } => Vec3::new(x, y, z),
                    _ => Vec3::repeat(f64::NAN),
                };
                if p == Vec3::zeros() {
                    gathering.skip_at_scanner();
                    continue;
                }
                let intensity = point.intensity.map_or(f64::NAN, f64::from);
                gathering.push(world_from_scanner.map(&p), f64::NAN, intensity);
            }
            if scan.transform.is_some() {
                gathering.scanned_from(world_from_scanner.map(&Vec3::zeros()), first);
            }
        }
        Ok(())
    })?;
    if !names.is_empty() {
        input.remark(format!("the attributes {} are left out", names.join(", ")));
    }
    gathering.finish()
}

/// The name of an attribute of points that is not read.
fn left_out(name: &e57::RecordName) -> Option<String> {
    use e57::RecordName::{ColorBlue, ColorGreen, ColorRed, TimeStamp, Unknown};
    match name {
        ColorRed | ColorGreen | ColorBlue => Some("color".to_owned()),
        TimeStamp => Some("timeStamp".to_owned()),
        Unknown { namespace, name } => Some(format!("{namespace}:{name}")),
        _ => None,
    }
}

/// A unit quaternion written with three digits is longer or shorter by no more.
const ROUNDED_LENGTH: f64 = 1e-3;

/// The pose of a scan, counted from 0. A rotation of zeros is that of writers that have none; one of another length than 1
/// is normalised.
fn scan_pose(input: &Input, number: usize, scan: &e57::PointCloud) -> Result<WorldFromScanner> {
    let Some(t) = &scan.transform else {
        return Ok(WorldFromScanner::identity());
    };
    let q = nalgebra::Quaternion::new(t.rotation.w, t.rotation.x, t.rotation.y, t.rotation.z);
    let length = q.norm();
    let quaternion = || {
        let name = scan.name.as_deref().map(|name| format!(" `{name}`"));
        format!(
            "the quaternion ({}, {}, {}, {}) of length {length:.4} in the pose of scan {}{}",
            q.w,
            q.i,
            q.j,
            q.k,
            number + 1,
            name.unwrap_or_default()
        )
    };
    let rotation = if !length.is_finite() {
        let expected = "a unit quaternion (w, x, y, z), as a rotation is in E57";
        return Err(Error::format(
            input.path(),
            Location::Whole,
            quaternion(),
            expected,
        ));
    } else if length == 0.0 {
        input.remark(format!("{} is taken for no rotation", quaternion()));
        Rotation::identity()
    } else {
        if (length - 1.0).abs() > ROUNDED_LENGTH {
            input.remark(format!("{} is normalised", quaternion()));
        }
        Rotation::new_normalize(q)
    };
    let t = Vec3::new(t.translation.x, t.translation.y, t.translation.z);
    Ok(WorldFromScanner::new(rotation, t))
}

/// An error with its causes.
fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(cause) = source {
        let cause_text = cause.to_string();
        // Some errors of the decoder already include their causes.
        if !text.contains(&cause_text) {
            text += &format!(": {cause_text}");
        }
        source = cause.source();
    }
    text
}

/// Checks the header against the size of the file before a decoder relies on it.
fn check_header(path: &Path, head: &[u8], size: u64) -> Result<()> {
    if head.len() < 48 || !head.starts_with(b"ASTM-E57") {
        return Err(problem(path, "no E57 signature"));
    }
    let u64_at = |at: usize| {
        let low = Number::U32.read(&head[at..], false) as u64;
        let high = Number::U32.read(&head[at + 4..], false) as u64;
        low | high << 32
    };
    let (length, at, xml, page) = (u64_at(16), u64_at(24), u64_at(32), u64_at(40));
    if length > size || at.saturating_add(xml) > size || !(8..=1 << 20).contains(&page) {
        return Err(problem(
            path,
            format!(
                "a header that gives {length} bytes, {xml} bytes of XML at byte {at} and pages of \
                 {page} bytes, in a file of {size} bytes"
            ),
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_coordinate_system_is_that_of_the_file() {
        let folder = tempfile::tempdir().unwrap();
        for (metadata, expected) in [
            (
                Some(r#"PROJCS["UTM 32N",UNIT["metre",1],AUTHORITY["EPSG","25832"]]"#),
                "EPSG:25832, UTM 32N; metres",
            ),
            (None, "axes of the file, taken for the world"),
        ] {
            let path = folder.path().join("a.e57");
            let mut writer = e57::E57Writer::from_file(&path, "file").unwrap();
            writer.set_coordinate_metadata(metadata.map(str::to_owned));
            let prototype = vec![
                e57::Record::CARTESIAN_X_F64,
                e57::Record::CARTESIAN_Y_F64,
                e57::Record::CARTESIAN_Z_F64,
            ];
            let mut points = writer.add_pointcloud("scan", prototype).unwrap();
            points
                .add_point([1.0, 2.0, 3.0].map(e57::RecordValue::Double).to_vec())
                .unwrap();
            points.finalize().unwrap();
            writer.finalize().unwrap();
            let report = crate::format::inspect(&path).unwrap();
            assert_eq!(report.count, 1);
            assert!(report.frame.contains(expected), "{}", report.frame);
        }
    }
}
