//! Times of points of each kind.

use super::*;

#[test]
fn the_unit_of_absolute_times_follows_from_the_stamp_then_from_their_size() {
    for (time, stamp_s, expected) in [
        (1.7e9, 1.7e9, Some(1.0)),
        (1.7e12, 1.7e9, Some(1e-3)),
        (1.7e18, 1.7e9, Some(1e-9)),
        // Times since the start of the scanner, like the stamp.
        (1.2e12, 1200.0, Some(1e-9)),
        (1.2e9, 1200.0, Some(1e-6)),
        // A clock other than the stamp's, or no stamp.
        (1.7e15, 1200.0, Some(1e-6)),
        (1.7e18, 0.0, Some(1e-9)),
        (5e4, 0.0, None),
        (f64::NAN, 1.0, None),
    ] {
        assert_eq!(unit_of_absolute(time, stamp_s), expected, "{time}");
    }
}

const F32: u8 = 7;
const U32: u8 = 6;

/// The times of a cloud of three points at 100 s whose further fields have these types and values.
fn times_s(more: &[(&str, u8, [[u8; 4]; 3])], how: &PointTimes) -> Decoded<Vec<f64>> {
    let names = ["x", "y", "z"].map(|name| (name, F32));
    let more_names = more.iter().map(|(name, datatype, _)| (*name, *datatype));
    let fields = names.into_iter().chain(more_names).enumerate();
    let fields = fields.map(|(i, (name, datatype))| super::super::messages::Field {
        name: name.as_bytes(),
        offset: 4 * i as u32,
        datatype,
    });
    let mut data = Vec::new();
    for i in 0..3 {
        data.extend([1f32; 3].map(f32::to_le_bytes).concat());
        data.extend(more.iter().flat_map(|(_, _, values)| values[i]));
    }
    let point_step = 12 + 4 * more.len() as u32;
    let cloud = PointCloud2 {
        time_s: 100.0,
        height: 1,
        width: 3,
        fields: fields.collect(),
        is_big_endian: false,
        point_step,
        row_step: 3 * point_step,
        data: &data,
    };
    let points = cloud.points(1000, how)?.points;
    Ok(points.iter().map(|point| point.time_s).collect())
}

fn whole(values: [u32; 3]) -> [[u8; 4]; 3] {
    values.map(u32::to_le_bytes)
}

#[test]
fn whole_seconds_come_with_their_milliseconds() {
    let found = times_s(
        &[
            ("utc_time", U32, whole([99, 99, 100])),
            ("ms_time", U32, whole([250, 500, 0])),
        ],
        &PointTimes::default(),
    );
    assert_eq!(found, Ok(vec![99.25, 99.5, 100.0]));
}

#[test]
fn large_numbers_without_a_sign_lie_before_the_stamp() {
    let times = whole([0, 500_000_000, 250_000_000u32.wrapping_neg()]);
    let found = times_s(&[("t", U32, times)], &PointTimes::default());
    assert_eq!(found, Ok(vec![99.75, 100.0, 100.5]));
}

#[test]
fn unknown_times_are_asked_for_and_answered() {
    let unknown = [("laser_stamp", U32, whole([0, 1000, 2000]))];
    let asked = times_s(&unknown, &PointTimes::default()).unwrap_err();
    assert!(asked.is_asked && asked.found.contains("laser_stamp"));
    let answer = |field: &str, unit_s| PointTimes {
        field: Some(field.to_owned()),
        unit_s,
    };
    let found = times_s(&unknown, &answer("laser_stamp", Some(1e-3)));
    assert_eq!(found, Ok(vec![100.0, 101.0, 102.0]));
    assert_eq!(times_s(&unknown, &answer("", None)), Ok(vec![100.0; 3]));
    let missing = times_s(&unknown, &answer("other", None)).unwrap_err();
    assert!(missing.is_asked && missing.expected.contains("x, y, z, laser_stamp"));
}
