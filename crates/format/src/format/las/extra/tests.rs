//! Files written with extra dimensions, read back byte by byte.

use std::path::Path;

use super::*;
use crate::cloud::PointCloud;
use crate::format::input::Input;
use crate::format::las::columns::extra_names;
use crate::format::las::file::LasFile;
use crate::format::read_cloud;
use crate::geometry::Vec3;
use crate::progress::Silent;

const F32: ExtraKind = ExtraKind::F32;
const F64: ExtraKind = ExtraKind::F64;

fn dimensions() -> [ExtraDimension; 3] {
    [
        ExtraDimension::new("omnivariance", F64, "omnivariance [m^2]"),
        ExtraDimension::new("planarity", F32, "planarity [1]"),
        ExtraDimension::new("count", ExtraKind::U32, "neighbours"),
    ]
}

/// The test value of a dimension at point `index`.
fn value(index: u64, dimension: usize) -> f64 {
    let x = index as f64;
    match dimension {
        0 => 1e-7 / (x + 3.0),
        1 if index % 5 == 2 => f64::NAN,
        1 => f64::from((x / 7.0) as f32),
        _ => x * 1000.0,
    }
}

fn fill(index: u64, values: &mut [f64]) {
    for (dimension, v) in values.iter_mut().enumerate() {
        *v = value(index, dimension);
    }
}

/// Standard bytes and extra bytes of every point.
fn records(path: &Path) -> Vec<(Vec<u8>, Vec<u8>)> {
    let mut file = LasFile::open(&Input::from(path)).unwrap();
    let mut records = Vec::new();
    while file
        .read(7, |_, point| {
            let standard = point.record.len() - point.extra.len();
            records.push((point.record[..standard].to_vec(), point.extra.to_vec()));
            Ok(())
        })
        .unwrap()
        > 0
    {}
    records
}

fn vlr(user_id: &str, record_id: u16, data: Vec<u8>) -> las::Vlr {
    las::Vlr {
        user_id: user_id.to_owned(),
        record_id,
        description: "Größe".to_owned(),
        data,
    }
}

/// 23 points of format 7 with five extra bytes of which two are described, a reference system, two
/// extended records and an index.
fn write_input(path: &Path) -> las::Header {
    let mut builder = las::Builder::from((1, 4));
    builder.point_format = las::point::Format::new(7).unwrap();
    builder.point_format.extra_bytes = 5;
    builder.point_format.is_compressed = path.extension().unwrap() == "laz";
    builder.transforms.x = las::Transform {
        scale: 0.25,
        offset: 1000.0,
    };
    builder.padding = vec![7; 3];
    builder.date = None;
    let mut described = vec![0; 192];
    described[2] = 3;
    described[4..8].copy_from_slice(b"ring");
    builder
        .vlrs
        .push(vlr("LASF_Projection", 2112, b"WKT".to_vec()));
    builder.vlrs.push(vlr("LASF_Spec", 4, described));
    builder.vlrs.push(vlr("copc", 1, vec![1; 160]));
    builder.evlrs.push(vlr("first", 1, vec![5; 70_000]));
    builder.evlrs.push(vlr("second", 2, vec![6; 3]));
    let header = builder.into_header().unwrap();
    let length = usize::from(header.point_format().len());
    let bytes: Vec<u8> = (0..23 * length)
        .map(|i| match i % length {
            // Return 1 of 1; the other fields are arbitrary.
            14 => 0x11,
            // Times must be finite.
            at @ 22..30 => [0, 0, 0, 0, 0, 0, (i / length) as u8, 0x40][at - 22],
            at => ((i / length) * 31 + at * 7) as u8,
        })
        .collect();
    let points = las::PointDataBuilder::new()
        .for_header(&header)
        .build_from_bytes(bytes)
        .unwrap();
    let file = std::fs::File::create(path).unwrap();
    let mut writer = las::Writer::new(std::io::BufWriter::new(file), header).unwrap();
    writer.write_points(&points).unwrap();
    writer.close().unwrap();
    drop(writer);
    LasFile::open(&Input::from(path)).unwrap().header().clone()
}

#[test]
fn a_copy_keeps_all_fields_and_appends_dimensions() {
    let folder = tempfile::tempdir().unwrap();
    let all = dimensions();
    for (from, to) in [("a.las", "b.laz"), ("a.laz", "b.las"), ("a.laz", "c.laz")] {
        let (input, output) = (folder.path().join(from), folder.path().join(to));
        let before = write_input(&input);
        let mut row = |index: u64, values: &mut [f64]| {
            fill(index, values);
            Ok(true)
        };
        assert_eq!(
            copy_las(&input, &output, &all, &mut row, &Silent).unwrap(),
            23
        );

        let file = LasFile::open(&Input::from(&output)).unwrap();
        let after = file.header();
        assert_eq!(after.version(), las::Version::new(1, 4));
        assert_eq!(after.transforms(), before.transforms());
        assert_eq!(after.padding(), before.padding());
        assert_eq!(after.number_of_points(), 23);
        assert_eq!(after.bounds(), before.bounds());
        let wkt = |header: &las::Header| header.vlrs().iter().find(|v| v.is_crs()).cloned();
        assert_eq!(wkt(after).unwrap().data, b"WKT");
        assert!(after.all_vlrs().all(|vlr| vlr.user_id != "copc"));
        let names = extra_names(&file);
        assert_eq!(
            names,
            [
                "ring",
                "undescribed_2",
                "omnivariance",
                "planarity",
                "count"
            ]
        );
        let bytes = std::fs::read(&output).unwrap();
        let count = u32::from_le_bytes(bytes[243..247].try_into().unwrap());
        assert_eq!(count, 2, "extended records");
        assert!(bytes.ends_with(&[6; 3]));

        let (old, new) = (records(&input), records(&output));
        assert_eq!(new.len(), 23);
        for (index, (old, new)) in old.iter().zip(&new).enumerate() {
            assert_eq!(old.0, new.0, "point {index}");
            assert_eq!(old.1, new.1[..5], "point {index}");
            let index = index as u64;
            let omnivariance = f64::from_le_bytes(new.1[5..13].try_into().unwrap());
            let planarity = f32::from_le_bytes(new.1[13..17].try_into().unwrap());
            let count = u32::from_le_bytes(new.1[17..21].try_into().unwrap());
            assert_eq!(omnivariance.to_bits(), value(index, 0).to_bits());
            assert_eq!(f64::from(planarity).is_nan(), index % 5 == 2);
            assert!(planarity.is_nan() || f64::from(planarity) == value(index, 1));
            assert_eq!(f64::from(count), value(index, 2));
        }
    }
}

#[test]
fn a_copy_holds_the_chosen_points_and_replaces_a_dimension() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    write_input(&path("a.las"));
    let mut once = |index: u64, values: &mut [f64]| {
        fill(index, values);
        Ok(index % 3 == 1)
    };
    let all = dimensions();
    assert_eq!(
        copy_las(&path("a.las"), &path("b.laz"), &all, &mut once, &Silent).unwrap(),
        8
    );
    let new = [
        ExtraDimension::new("planarity", F64, "wider"),
        ExtraDimension::new("further", F32, ""),
    ];
    let mut again = |index: u64, values: &mut [f64]| {
        values[0] = index as f64 / 3.0;
        Ok(true)
    };
    assert_eq!(
        copy_las(&path("b.laz"), &path("c.laz"), &new, &mut again, &Silent).unwrap(),
        8
    );
    let file = LasFile::open(&Input::from(&path("c.laz"))).unwrap();
    assert_eq!(
        extra_names(&file),
        [
            "ring",
            "undescribed_2",
            "omnivariance",
            "count",
            "planarity",
            "further"
        ]
    );
    let old = records(&path("a.las"));
    for (at, (standard, extra)) in records(&path("c.laz")).iter().enumerate() {
        let index = 3 * at + 1;
        assert_eq!(*standard, old[index].0);
        assert_eq!(extra[..5], old[index].1);
        assert_eq!(extra[5..13], value(index as u64, 0).to_le_bytes());
        assert_eq!(extra[13..17], (index as u32 * 1000).to_le_bytes());
        assert_eq!(extra[17..25], (at as f64 / 3.0).to_le_bytes());
        assert!(f32::from_le_bytes(extra[25..29].try_into().unwrap()).is_nan());
    }
}

#[test]
fn a_cloud_is_written_with_the_times_and_intensities_that_it_has() {
    let folder = tempfile::tempdir().unwrap();
    let origin = Vec3::new(362_328.5, 5_157_700.25, 108.5);
    let mut cloud = PointCloud {
        points: (0..40)
            .map(|i| origin + Vec3::new(f64::from(i), 0.5 * f64::from(i), -0.125 * f64::from(i)))
            .collect(),
        ..PointCloud::default()
    };
    for has_time in [false, true] {
        if has_time {
            cloud.time_s = (0..40).map(|i| 0.1 * f64::from(i)).collect();
            cloud.intensity = (0..40u16).map(f32::from).collect();
        }
        let output = folder.path().join("a.laz");
        let mut row = |index: u64, values: &mut [f64]| {
            fill(index, values);
            Ok(index != 3)
        };
        let all = dimensions();
        assert_eq!(
            cloud_to_las(&cloud, &output, &all, None, &mut row, &Silent).unwrap(),
            39
        );
        let back = read_cloud(&output).unwrap();
        assert_eq!(back.time_s.is_empty(), !has_time);
        let written = (0..40).filter(|i| *i != 3);
        for ((at, point), extra) in written.zip(&back.points).zip(records(&output)) {
            assert!((point - cloud.points[at]).amax() < 0.51e-5);
            assert_eq!(extra.1[..8], value(at as u64, 0).to_le_bytes());
        }
        if has_time {
            assert_eq!(back.time_s[3..], cloud.time_s[4..]);
            assert_eq!(back.intensity[3..], cloud.intensity[4..]);
        }
    }
}

#[test]
fn a_point_beyond_32_bits_of_the_step_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("a.las");
    let cloud = PointCloud {
        points: vec![
            Vec3::new(2e6, 0.125, 7.0),
            Vec3::new(-1e6, 0.0, 0.0),
            Vec3::new(2e6 + 42_000.0, 0.25, 8.0),
        ],
        ..PointCloud::default()
    };
    let write =
        |cloud: &PointCloud| cloud_to_las(cloud, &output, &[], None, &mut |_, _| Ok(true), &Silent);
    let error = write(&cloud).unwrap_err().to_string();
    assert!(error.contains("the point (-1000000, 0, 0) m"), "{error}");
    let near = PointCloud {
        points: vec![cloud.points[0], cloud.points[2]],
        ..PointCloud::default()
    };
    write(&near).unwrap();
    let back = read_cloud(&output).unwrap();
    for (a, b) in back.points.iter().zip(&near.points) {
        assert!((a - b).amax() <= 0.51e-5, "{a} {b}");
    }
}

#[test]
fn copies_that_las_cannot_hold_are_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    write_input(&path("a.las"));
    let with = |name: &str, text: &str, output: &str| {
        let dimension = ExtraDimension::new(name, F32, text);
        let twice = [
            dimension.clone(),
            ExtraDimension::new("b", F32, ""),
            dimension,
        ];
        let some = if text == "twice" {
            &twice[..]
        } else {
            &twice[..1]
        };
        let mut row = |_: u64, _: &mut [f64]| Ok(true);
        copy_las(&path("a.las"), &path(output), some, &mut row, &Silent)
            .unwrap_err()
            .to_string()
    };
    assert!(with("a", "twice", "b.las").contains("different names"));
    assert!(with("", "x", "b.las").contains("the extra dimension ``"));
    assert!(with("größe", "x", "b.las").contains("ASCII"));
    assert!(with("a", &"x".repeat(33), "b.las").contains("32"));
    assert!(with("a", "x", "b.ply").contains("extension `ply`"));
    let mut refuse = |index: u64, _: &mut [f64]| {
        if index < 5 {
            return Ok(true);
        }
        Err(crate::error::Error::data("enough", "stop"))
    };
    let error = copy_las(&path("a.las"), &path("b.laz"), &[], &mut refuse, &Silent).unwrap_err();
    assert!(error.to_string().starts_with("enough"));
}

/// A file without points, with this header.
fn write_header(path: &Path, builder: las::Builder) {
    let file = std::fs::File::create(path).unwrap();
    let header = builder.into_header().unwrap();
    let mut writer = las::Writer::new(std::io::BufWriter::new(file), header).unwrap();
    writer.close().unwrap();
}

#[test]
fn inputs_that_cannot_be_copied_are_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let (input, output) = (folder.path().join("a.las"), folder.path().join("b.las"));
    let refused = || {
        let mut row = |_: u64, _: &mut [f64]| Ok(true);
        copy_las(&input, &output, &dimensions(), &mut row, &Silent)
            .unwrap_err()
            .to_string()
    };
    let mut waveforms = las::Builder::from((1, 4));
    waveforms.point_format = las::point::Format::new(4).unwrap();
    write_header(&input, waveforms);
    assert!(refused().contains("points with waveforms"), "{}", refused());

    write_header(&input, las::Builder::from((1, 4)));
    assert!(refused().contains("no point"), "{}", refused());

    // The description claims eight extra bytes, and the points have two.
    let mut described = vec![0; 192];
    described[2] = 10;
    described[4..8].copy_from_slice(b"long");
    let mut builder = las::Builder::from((1, 4));
    builder.point_format.extra_bytes = 2;
    builder.vlrs.push(vlr("LASF_Spec", 4, described));
    let header = builder.into_header().unwrap();
    let file = std::fs::File::create(&input).unwrap();
    let points = las::PointDataBuilder::new()
        .for_header(&header)
        .build_from_bytes(vec![0; usize::from(header.point_format().len())])
        .unwrap();
    let mut writer = las::Writer::new(std::io::BufWriter::new(file), header).unwrap();
    writer.write_points(&points).unwrap();
    writer.close().unwrap();
    drop(writer);
    assert!(
        refused().contains("`long` at bytes 0 to 8"),
        "{}",
        refused()
    );
    assert!(!output.exists());
}
