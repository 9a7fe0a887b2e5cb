//! Scans of the KITTI data set (`velodyne/*.bin`): x, y, z in metres and the intensity of each point as little-endian
//! 32-bit floats, without a header.
//!
//! Nothing in such a file names its format. A file is taken for one only if its name ends with `.bin`, it holds whole
//! points and at least 64 of them, and each of its first points is plausible. Records of another number of floats have
//! negative numbers in the fourth place, and whole numbers of 32 bits or halves of 64-bit numbers are floats that are
//! too small, too large or not finite: the chance that one of them is plausible is about one in six, so that 64 points
//! of them are not. At least one coordinate must exceed a metre, which excludes zeros, normals, colours and quaternions.
//! Points with another number from 0 to 255 in the fourth place, such as a time, cannot be told apart: a remark says
//! how the numbers were interpreted.

use crate::cloud::PointCloud;
use crate::error::Result;
use crate::format::binary::{Bytes, Number};
use crate::format::cloud::gathering::Gathering;
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind, Start};
use crate::geometry::{Vec3, is_finite};

/// Bytes of a point.
const POINT: usize = 16;
/// Fewest points of a scan: a laser scanner measures as many in a millisecond.
const FEWEST: usize = 64;
/// Beyond the range of a scanner on a vehicle, metres.
const FARTHEST_M: f64 = 500.0;
/// Smaller numbers other than zero are no coordinates and no intensities.
const SMALLEST: f64 = 1e-9;
/// Intensities are fractions or bytes.
const BRIGHTEST: f64 = 255.0;

/// The description of a scan, for messages on files that are none.
pub(crate) const DESCRIPTION: &str = "points x, y, z and intensity of KITTI (32-bit floats in whole points of 16 \
                                      bytes, at least 64 of them, within 500 m, with intensities of 0 to 255)";

pub(crate) const SCAN: Kind = Kind {
    signature: Some(looks_like),
    cloud: Some(read),
    frame: Frame::Fixed(
        "metres (the format, which a file does not name); axes of the scanner, taken for the world",
    ),
    ..Kind::new("kitti-velodyne", "cloud (KITTI velodyne .bin)")
};

/// x, y, z and intensity of a point.
fn values(point: &[u8; POINT]) -> [f64; 4] {
    std::array::from_fn(|i| Number::F32.read(&point[4 * i..], false))
}

/// Whether a point may have these values: coordinates within the range of a scanner and an intensity from 0 to 255.
fn is_plausible([x, y, z, intensity]: [f64; 4]) -> bool {
    let is_usual = |value: f64| value == 0.0 || value.abs() >= SMALLEST;
    [x, y, z].iter().all(|v| v.abs() <= FARTHEST_M)
        && (0.0..=BRIGHTEST).contains(&intensity)
        && [x, y, z, intensity].into_iter().all(is_usual)
}

fn looks_like(start: &Start<'_>) -> bool {
    let points = start.bytes.as_chunks::<POINT>().0;
    let is_far = |point: &[u8; POINT]| values(point)[..3].iter().any(|v| v.abs() > 1.0);
    start.extension == "bin"
        && start.size.is_multiple_of(POINT as u64)
        && points.len() >= FEWEST
        && points.iter().all(|point| is_plausible(values(point)))
        && points.iter().any(is_far)
}

/// Reads the points. Those at the origin were not measured, those without a position neither: both are left out and
/// counted.
///
/// # Errors
/// A file that is cut off; a point that is not plausible, named with its byte.
fn read(input: &Input) -> Result<PointCloud> {
    let mut bytes = Bytes::open(input)?;
    let mut gathering = Gathering::new(input);
    let mut point = [0; POINT];
    while bytes.at < bytes.total {
        let at = bytes.at;
        bytes.take(&mut point, "a point")?;
        let [x, y, z, intensity] = values(&point);
        let position = Vec3::new(x, y, z);
        if position == Vec3::zeros() {
            gathering.skip_at_scanner();
        } else if is_finite(&position) && !is_plausible([x, y, z, intensity]) {
            bytes.at = at;
            let found = format!("the point ({x}, {y}, {z}) m with the intensity {intensity}");
            return Err(bytes.error(found, DESCRIPTION));
        } else {
            gathering.push(position, f64::NAN, intensity);
        }
    }
    input.remark("there is no header: the numbers are taken for x, y, z in metres and the intensity, as in KITTI");
    gathering.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::{detect, read_cloud};

    /// A ring of points, as the first line of a scan.
    fn ring(count: u32) -> Vec<[f32; 4]> {
        let point = |i: u32| {
            let angle = 0.05 * i as f32;
            let range_m = 20.0 + 0.5 * (i % 7) as f32;
            [
                range_m * angle.cos(),
                range_m * angle.sin(),
                -1.5,
                0.01 * (i % 90) as f32,
            ]
        };
        (0..count).map(point).collect()
    }

    fn bytes(points: &[[f32; 4]]) -> Vec<u8> {
        points
            .iter()
            .flatten()
            .flat_map(|v| v.to_le_bytes())
            .collect()
    }

    #[test]
    fn scans_are_told_by_their_points() {
        let folder = tempfile::tempdir().unwrap();
        let id = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            detect(&path).map_or("none", |format| format.id())
        };
        let scan = bytes(&ring(300));
        assert_eq!(id("a.bin", &scan), "kitti-velodyne");
        assert_eq!(id("b.dat", &scan), "none");
        assert_eq!(id("c.bin", &scan[..1016]), "bonn-profiles");
        assert_eq!(id("d.bin", &bytes(&ring(63))), "bonn-profiles");
        for other in [
            [501.0, 0.0, 0.0, 0.5],
            [5.0, 0.0, 0.0, 256.0],
            [5.0, 0.0, 0.0, -0.1],
            [5.0, f32::NAN, 0.0, 0.5],
            [5.0, f32::from_bits(1000), 0.0, 0.5],
        ] {
            let mut points = ring(300);
            points[200] = other;
            assert_eq!(id("e.bin", &bytes(&points)), "bonn-profiles", "{other:?}");
        }
        let normals = vec![[0.6, -0.8, 0.0, 0.5]; 300];
        assert_eq!(id("f.bin", &bytes(&normals)), "bonn-profiles");
    }

    #[test]
    fn points_keep_their_values_and_what_was_not_measured_is_counted() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("0000000000.bin");
        let mut points = ring(600);
        points[3] = [0.0, 0.0, 0.0, 0.0];
        points[500] = [f32::NAN, 1.0, 2.0, 0.0];
        std::fs::write(&path, bytes(&points)).unwrap();
        let input = Input::from(&path);
        let cloud = read_cloud(&input).unwrap();
        assert_eq!(cloud.points.len(), 598);
        assert_eq!(cloud.points[0], Vec3::new(20.0, 0.0, -1.5));
        assert_eq!(cloud.intensity[..4], [0.0, 0.01, 0.02, 0.04]);
        assert!(cloud.time_s.is_empty());
        let remarks = input.remarks().join("\n");
        for expected in [
            "1 record without a position",
            "1 point at the origin",
            "as in KITTI",
        ] {
            assert!(remarks.contains(expected), "{remarks}");
        }
        // Beyond the points at which detection looks.
        points[550] = [1.0, 2.0, 700.0, 0.5];
        std::fs::write(&path, bytes(&points)).unwrap();
        let error = read_cloud(&path).unwrap_err().to_string();
        assert!(
            error.contains("byte 8800: found the point (1, 2, 700) m"),
            "{error}"
        );
    }

    #[test]
    fn a_file_that_is_neither_is_refused_with_both_formats() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        let mut points = ring(300);
        points[9][3] = -2.0;
        std::fs::write(&path, bytes(&points)).unwrap();
        let error = crate::format::inspect(&path).unwrap_err().to_string();
        for expected in ["profiles of the Bonn robot", DESCRIPTION] {
            assert!(error.contains(expected), "{error}");
        }
    }
}
