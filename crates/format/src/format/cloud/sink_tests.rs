//! Tests that every cloud writer must pass.

use std::io::BufReader;
use std::path::Path;

use crate::error::Result;
use crate::format::binary::{Bytes, Number};
use crate::format::cloud::ply;
use crate::format::cloud::sink::{CloudPoint, CloudShape, CloudSink};
use crate::format::input::Input;
use crate::format::las::columns::extra_columns;
use crate::format::las::file::LasFile;
use crate::format::{
    ExtraDimension, ExtraKind, ExtraValue, copc_sink, e57_sink, ply_sink, read_cloud,
};
use crate::geometry::Vec3;

type Open = fn(&Path, &CloudShape) -> Result<Box<dyn CloudSink>>;
type Read = fn(&Path) -> Vec<Row>;

/// A point as written or read back: position, time, intensity and extra dimensions.
#[derive(Debug, Clone)]
struct Row {
    position: Vec3,
    time_s: f64,
    intensity: f64,
    values: Vec<f64>,
}

struct Writer {
    name: &'static str,
    open: Open,
    read: Read,
    /// Largest error of a coordinate.
    step_m: f64,
}

const WRITERS: [Writer; 3] = [
    Writer {
        name: "a.ply",
        open: ply_sink,
        read: read_ply,
        step_m: 0.0,
    },
    Writer {
        name: "a.e57",
        open: e57_sink,
        read: read_e57,
        step_m: 0.0,
    },
    Writer {
        name: "a.copc.laz",
        open: copc_sink,
        read: read_copc,
        step_m: 0.5e-5 + 1e-9,
    },
];

fn shape(low: Vec3, high: Vec3) -> CloudShape {
    CloudShape {
        low,
        high,
        has_time: true,
        has_intensity: true,
        dimensions: vec![
            ExtraDimension::new("distance", ExtraKind::F32, "m"),
            ExtraDimension::new("exact", ExtraKind::F64, ""),
            ExtraDimension::new("scanner", ExtraKind::U32, ""),
        ],
        wkt: Some("LOCAL_CS[\"plant\",UNIT[\"metre\",1]]".to_owned()),
        ..CloudShape::default()
    }
}

/// Points around `centre` with different values; the first has NaN in two dimensions.
fn rows(centre: Vec3, count: usize) -> Vec<Row> {
    (0..count)
        .map(|i| {
            let t = i as f64;
            let offset = Vec3::new((t * 0.37).sin() * 20.0, (t * 0.11).cos() * 15.0, t * 1e-3);
            let values = vec![(t * 0.3).cos() * 0.01, t / 7.0, f64::from(i as u32 % 3)];
            Row {
                position: centre + offset,
                time_s: 300_000.0 + t * 1e-4,
                intensity: f64::from(i as u32 * 7 % 65_536),
                values: match i {
                    0 => vec![f64::NAN, f64::NAN, 2.0],
                    _ => values,
                },
            }
        })
        .collect()
}

fn push_all(sink: &mut dyn CloudSink, rows: &[Row]) -> Result<()> {
    rows.iter().try_for_each(|row| {
        sink.push(&CloudPoint {
            position: row.position,
            time_s: row.time_s,
            intensity: row.intensity as f32,
            values: &row
                .values
                .iter()
                .copied()
                .map(ExtraValue::Number)
                .collect::<Vec<_>>(),
        })
    })
}

fn write(writer: &Writer, path: &Path, shape: &CloudShape, rows: &[Row]) -> Result<()> {
    let mut sink = (writer.open)(path, shape)?;
    push_all(&mut *sink, rows)?;
    sink.finish()
}

fn bounds(rows: &[Row]) -> (Vec3, Vec3) {
    let first = rows[0].position;
    rows.iter().fold((first, first), |(low, high), row| {
        (low.inf(&row.position), high.sup(&row.position))
    })
}

fn read_ply(path: &Path) -> Vec<Row> {
    let mut bytes = Bytes::open(&Input::from(path)).unwrap();
    let header = ply::read_header(&mut bytes).unwrap();
    let names = [
        "x",
        "y",
        "z",
        "time_s",
        "intensity",
        "distance",
        "exact",
        "scanner",
    ];
    assert!(
        header
            .numbers()
            .map(|property| property.name.as_str())
            .eq(names)
    );
    let (f64, f32, u32) = (Number::F64, Number::F32, Number::U32);
    let types = [f64, f64, f64, f64, f32, f32, f64, u32];
    let rows = (0..header.vertices.count).map(|_| {
        let values = types.map(|kind| {
            let mut value = vec![0; kind.size()];
            bytes.take(&mut value, "a value").unwrap();
            kind.read(&value, false)
        });
        Row {
            position: Vec3::new(values[0], values[1], values[2]),
            time_s: values[3],
            intensity: values[4],
            values: values[5..].to_vec(),
        }
    });
    rows.collect()
}

fn read_e57(path: &Path) -> Vec<Row> {
    let file = std::fs::File::open(path).unwrap();
    let mut reader = ::e57::E57Reader::new(BufReader::new(file)).unwrap();
    let wkt = reader.coordinate_metadata().unwrap();
    assert_eq!(wkt, "LOCAL_CS[\"plant\",UNIT[\"metre\",1]]");
    let clouds = reader.pointclouds();
    if clouds.is_empty() {
        return Vec::new();
    }
    assert_eq!(clouds.len(), 1);
    let types: Vec<_> = clouds[0].prototype.iter().map(|r| &r.data_type).collect();
    let points = reader.pointcloud_raw(&clouds[0]).unwrap();
    let rows = points.map(|point| {
        let point = point.unwrap();
        let values: Vec<f64> = point
            .iter()
            .zip(&types)
            .map(|(value, kind)| value.to_f64(kind).unwrap())
            .collect();
        Row {
            position: Vec3::new(values[0], values[1], values[2]),
            time_s: values[3],
            intensity: values[4],
            values: values[5..].to_vec(),
        }
    });
    rows.collect()
}

fn read_copc(path: &Path) -> Vec<Row> {
    let mut file = LasFile::open(&Input::from(path)).unwrap();
    let wkt = file.header().get_wkt_crs_bytes().unwrap();
    assert_eq!(wkt, b"LOCAL_CS[\"plant\",UNIT[\"metre\",1]]\0");
    let names: Vec<String> = extra_columns(&file).into_iter().map(|c| c.0).collect();
    assert_eq!(names, ["distance", "exact", "scanner"]);
    let mut rows = Vec::new();
    let take = |_, point: crate::format::las::file::LasPoint<'_>| {
        let extra = point.extra;
        let values = vec![
            Number::F32.read(extra, false),
            Number::F64.read(&extra[4..], false),
            Number::U32.read(&extra[12..], false),
        ];
        // The scanner is also stored as the point source and the user data.
        assert_eq!(values[2], Number::U16.read(&point.record[20..], false));
        assert_eq!(values[2], f64::from(point.record[17]));
        rows.push(Row {
            position: point.position,
            time_s: point.time_s,
            intensity: f64::from(point.intensity),
            values,
        });
        Ok(())
    };
    if file.header().number_of_points() > 0 {
        file.read(usize::MAX >> 1, take).unwrap();
    }
    rows.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    rows
}

/// Exact equality, with NaN equal to NaN.
fn same(a: f64, b: f64) -> bool {
    a == b || a.is_nan() && b.is_nan()
}

#[test]
fn written_points_are_read_back() {
    let dir = tempfile::tempdir().unwrap();
    for centre in [Vec3::zeros(), Vec3::new(500_000.0, 5_500_000.0, -120.0)] {
        let rows = rows(centre, 10_000);
        let (low, high) = bounds(&rows);
        for writer in &WRITERS {
            let path = dir.path().join(writer.name);
            write(writer, &path, &shape(low, high), &rows).unwrap();
            let points = (writer.read)(&path);
            assert_eq!(points.len(), rows.len(), "{}", writer.name);
            for (point, row) in points.iter().zip(&rows) {
                let about = format!("{}: {point:?} {row:?}", writer.name);
                let error = (point.position - row.position).amax();
                assert!(error <= writer.step_m, "{about}");
                assert_eq!(point.time_s, row.time_s, "{about}");
                assert_eq!(point.intensity, row.intensity, "{about}");
                let distance = f64::from(row.values[0] as f32);
                assert!(same(point.values[0], distance), "{about}");
                assert!(same(point.values[1], row.values[1]), "{about}");
                assert_eq!(point.values[2], row.values[2], "{about}");
            }
            let cloud = read_cloud(&path).unwrap();
            assert_eq!(cloud.points.len(), rows.len());
            assert_eq!(cloud.intensity.len(), rows.len());
        }
    }
}

#[test]
fn the_same_points_give_the_same_bytes_and_other_points_give_others() {
    let dir = tempfile::tempdir().unwrap();
    let mut rows = rows(Vec3::zeros(), 5000);
    let (low, high) = bounds(&rows);
    for writer in &WRITERS {
        let bytes = |rows: &[Row]| {
            let path = dir.path().join(writer.name);
            write(writer, &path, &shape(low, high), rows).unwrap();
            std::fs::read(&path).unwrap()
        };
        let first = bytes(&rows);
        assert!(first == bytes(&rows), "{}", writer.name);
        rows[77].values[1] += 1.0;
        assert!(first != bytes(&rows), "{}", writer.name);
        rows[77].values[1] -= 1.0;
    }
}

#[test]
fn identifiers_of_an_e57_file_depend_on_its_content() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.e57");
    let mut rows = rows(Vec3::zeros(), 10);
    let (low, high) = bounds(&rows);
    let ids = |rows: &[Row]| {
        write(&WRITERS[1], &path, &shape(low, high), rows).unwrap();
        let reader = ::e57::E57Reader::from_file(&path).unwrap();
        let cloud_id = reader.pointclouds()[0].guid.clone().unwrap();
        (reader.guid().to_owned(), cloud_id)
    };
    let (file, cloud) = ids(&rows);
    assert_ne!(file, cloud);
    for id in [&file, &cloud] {
        assert_eq!(id.len(), 38, "{id}");
        assert!(&id[15..16] == "8" && "89AB".contains(&id[20..21]), "{id}");
    }
    rows[3].time_s += 1.0;
    let (other_file, other_cloud) = ids(&rows);
    assert!(file != other_file && cloud != other_cloud);
}

#[test]
fn an_empty_cloud_is_a_file_without_points() {
    let dir = tempfile::tempdir().unwrap();
    for writer in &WRITERS {
        let path = dir.path().join(writer.name);
        write(writer, &path, &shape(Vec3::zeros(), Vec3::zeros()), &[]).unwrap();
        assert!((writer.read)(&path).is_empty(), "{}", writer.name);
    }
}

#[test]
fn a_cloud_without_times_intensities_and_dimensions_is_written() {
    let dir = tempfile::tempdir().unwrap();
    let rows = rows(Vec3::zeros(), 100);
    let (low, high) = bounds(&rows);
    let plain = CloudShape {
        low,
        high,
        ..CloudShape::default()
    };
    for writer in &WRITERS {
        let path = dir.path().join(writer.name);
        write(writer, &path, &plain, &rows).unwrap();
        let cloud = read_cloud(&path).unwrap();
        assert_eq!(cloud.points.len(), 100, "{}", writer.name);
        assert!(cloud.time_s.iter().all(|t| *t == 0.0), "{}", writer.name);
    }
}

#[test]
fn points_that_are_not_finite_are_refused_and_the_others_are_written() {
    let dir = tempfile::tempdir().unwrap();
    let mut rows = rows(Vec3::zeros(), 3);
    let (low, high) = bounds(&rows);
    let good = rows.clone();
    rows[1].position.y = f64::NAN;
    for writer in &WRITERS {
        let path = dir.path().join(writer.name);
        let mut sink = (writer.open)(&path, &shape(low, high)).unwrap();
        let error = push_all(&mut *sink, &rows).unwrap_err().to_string();
        assert!(error.contains("NaN") && error.contains("remedy"), "{error}");
        push_all(&mut *sink, &good[1..]).unwrap();
        sink.finish().unwrap();
        assert_eq!((writer.read)(&path).len(), 3, "{}", writer.name);
    }
}

#[test]
fn names_that_clash_are_refused_before_a_file_is_made() {
    let dir = tempfile::tempdir().unwrap();
    let refused = |writer: &Writer, names: [&str; 2]| {
        let path = dir.path().join(writer.name);
        let dimensions = names.map(|name| ExtraDimension::new(name, ExtraKind::F32, ""));
        let shape = CloudShape {
            dimensions: dimensions.to_vec(),
            ..CloudShape::default()
        };
        let is_refused = (writer.open)(&path, &shape).is_err();
        assert_eq!(is_refused, !path.exists());
        let _ = std::fs::remove_file(&path);
        is_refused
    };
    for writer in &WRITERS {
        assert!(refused(writer, ["a", "a"]), "{}", writer.name);
        assert!(!refused(writer, ["a b", "7c"]), "{}", writer.name);
    }
    assert!(refused(&WRITERS[0], ["a b", "A_b"]));
    assert!(refused(&WRITERS[0], ["X", "a"]));
    assert!(refused(&WRITERS[1], ["a b", "a_b"]));
}

#[test]
fn a_sink_that_is_dropped_leaves_no_complete_file() {
    let dir = tempfile::tempdir().unwrap();
    let rows = rows(Vec3::zeros(), 10_000);
    let (low, high) = bounds(&rows);
    for writer in &WRITERS {
        let path = dir.path().join(writer.name);
        let mut sink = (writer.open)(&path, &shape(low, high)).unwrap();
        push_all(&mut *sink, &rows).unwrap();
        drop(sink);
        let count = read_cloud(&path).map(|cloud| cloud.points.len());
        assert!(!matches!(count, Ok(n) if n > 0), "{}", writer.name);
    }
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_is_an_error() {
    let rows = rows(Vec3::zeros(), 100_000);
    let (low, high) = bounds(&rows);
    for writer in &WRITERS {
        let full = Path::new("/dev/full");
        let error = write(writer, full, &shape(low, high), &rows).unwrap_err();
        let text = error.to_string();
        assert!(text.starts_with("/dev/full"), "{}: {text}", writer.name);
        assert!(text.contains("No space left"), "{}: {text}", writer.name);
    }
}
