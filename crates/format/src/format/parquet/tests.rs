use std::path::{Path, PathBuf};

use super::*;
use crate::format::cloud::sink::{CloudPoint, CloudShape};
use crate::format::mutation::for_each_damaged;
use crate::format::profiles::table::PROFILES;
use crate::format::text::table::Table;
use crate::format::{
    ExtraDimension, ExtraKind, ExtraValue, Input, detect, inspect, open_profiles, read_cloud,
    read_trajectory, salvage,
};
use crate::geometry::Vec3;

/// A file that another program wrote.
fn sample(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/parquet");
    folder.join(format!("{name}.parquet"))
}

fn message(name: &str) -> String {
    read_cloud(&sample(name)).unwrap_err().to_string()
}

#[test]
fn files_of_other_programs_are_read_exactly() {
    for name in [
        "pyarrow_none",
        "pyarrow_snappy",
        "pyarrow_gzip",
        "pyarrow_zstd",
        "pyarrow_lz4",
        "polars_zstd",
        "pandas_foreign",
    ] {
        let path = sample(name);
        assert_eq!(detect(&path).unwrap().id(), "cloud-csv", "{name}");
        let cloud = read_cloud(&path).unwrap();
        assert_eq!(cloud.points.len(), 40, "{name}");
        for (k, p) in cloud.points.iter().enumerate() {
            let f = k as f64;
            let expected = Vec3::new(500_000.0 + f / 8.0, f * -0.25, (k % 4) as f64);
            assert_eq!(*p, expected, "{name}");
            assert_eq!(cloud.time_s[k], 1.7e9 + f * 0.5, "{name}");
            assert_eq!(cloud.intensity[k], (k * 1000) as f32, "{name}");
        }
    }
}

#[test]
fn time_stamps_become_seconds_and_integers_keep_their_range() {
    let input = Input::from(&sample("pandas_timestamp"));
    let mut table = Table::open(&input, &PROFILES).unwrap();
    let mut row = [0.0; 5];
    let mut k = 0.0;
    while table.next_row(&mut row).unwrap() {
        let [time_s, x_m, z_m, ..] = row;
        assert!((time_s - (1.7e9 + k * 1.5e-3)).abs() < 3e-7, "{time_s}");
        assert_eq!([x_m, z_m], [k, 4_294_967_200.0 + k]);
        k += 1.0;
    }
    assert_eq!(k, 40.0);
    assert_eq!(table.bytes_read(), table.bytes_total());
    // As profiles, the largest integers of 32 bits are no metres.
    let mut profiles = open_profiles(&input).unwrap();
    assert!(profiles.next_chunk(&mut Vec::new()).is_err());
}

#[test]
fn errors_name_row_column_and_type() {
    let input = Input::from(&sample("pyarrow_null"));
    assert!(!read_cloud(&input).unwrap().points.is_empty());
    let remarks = input.remarks().join("\n");
    assert!(
        remarks.contains("left out: 1 record without a position"),
        "{remarks}"
    );
    let text = message("pyarrow_text");
    assert!(
        text.contains("column up_m of the type BYTE_ARRAY (String)"),
        "{text}"
    );
    let text = message("pyarrow_brotli");
    assert!(
        text.contains("column east_m with the compression BROTLI"),
        "{text}"
    );
    let profiles = open_profiles(&sample("pyarrow_snappy")).err().unwrap();
    let text = profiles.to_string();
    assert!(text.contains("without x_m"), "{text}");
    let dir = tempfile::tempdir().unwrap();
    let to = dir.path().join("a");
    let text = salvage(&sample("pyarrow_null"), &to)
        .unwrap_err()
        .to_string();
    assert!(
        text.contains("found Parquet, expected a text table"),
        "{text}"
    );
}

fn write_cloud(path: &Path) {
    let dimension = |name: &str, kind| ExtraDimension {
        name: name.to_owned(),
        kind,
        description: String::new(),
    };
    let shape = CloudShape {
        has_time: true,
        has_intensity: true,
        dimensions: vec![
            dimension("range", ExtraKind::F32),
            dimension("number", ExtraKind::U32),
        ],
        wkt: Some("LOCAL_CS[\"a\"]".to_owned()),
        ..CloudShape::default()
    };
    let mut sink = parquet_sink(path, &shape).unwrap();
    for k in 0..100_003 {
        let f = f64::from(k);
        let point = CloudPoint {
            position: Vec3::new(f / 3.0, -f, f.sqrt()),
            time_s: 1e9 + f,
            intensity: 0.5 * k as f32,
            values: &[f64::NAN, 4e9 + 1e4 * f].map(ExtraValue::Number),
        };
        sink.push(&point).unwrap();
    }
    sink.finish().unwrap();
}

#[test]
fn clouds_are_read_back_bit_for_bit() {
    let dir = tempfile::tempdir().unwrap();
    let paths = ["a", "b"].map(|name| dir.path().join(name));
    paths.iter().for_each(|path| write_cloud(path));
    let bytes = paths.each_ref().map(|path| std::fs::read(path).unwrap());
    assert!(bytes[0] == bytes[1]);
    assert!(bytes[0].windows(7).any(|w| w == b"crs_wkt"));
    let cloud = read_cloud(&paths[0]).unwrap();
    assert_eq!(cloud.points.len(), 100_003);
    for (k, p) in cloud.points.iter().enumerate() {
        let f = k as f64;
        assert_eq!(*p, Vec3::new(f / 3.0, -f, f.sqrt()));
        assert_eq!(
            (cloud.time_s[k], cloud.intensity[k]),
            (1e9 + f, 0.5 * k as f32)
        );
    }
    let mut numbers = Rows::open(&Input::from(&paths[0])).unwrap();
    numbers.select(vec![6]).unwrap();
    assert!(numbers.advance().unwrap());
    assert_eq!(numbers.cell(0), Some(4e9));
    let report = inspect(&paths[0]).unwrap();
    assert_eq!((report.count, report.columns.len()), (100_003, 7));
}

#[test]
fn tables_are_read_like_text_tables_with_the_same_columns() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("poses.parquet");
    let names = [
        "time_ms",
        "qx",
        "qy",
        "qz",
        "qw",
        "east_m",
        "north_m",
        "up_cm",
        "velocity_east_m_s",
        "velocity_north_m_s",
        "velocity_up_m_s",
    ];
    let mut table = ParquetTable::create(&path, &names).unwrap();
    for k in 0..5 {
        let f = f64::from(k);
        let velocity = if k == 3 { f64::NAN } else { f };
        let row = [f, 0.0, 0.0, 0.0, 1.0, f, 2.0, 300.0, velocity, 0.0, 0.0];
        table.row(row).unwrap();
    }
    table.finish().unwrap();
    let poses = read_trajectory(&path).unwrap();
    assert_eq!(poses.len(), 5);
    assert_eq!(poses[2].time_s, 0.002);
    assert_eq!(
        poses[2].world_from_body.translation_m,
        Vec3::new(2.0, 2.0, 3.0)
    );
    assert!(poses[3].velocity_m_s.is_none() && poses[4].velocity_m_s.is_some());
    let twice = ParquetTable::create(&path, &["a", "b", "a"]).err().unwrap();
    assert!(twice.to_string().contains("the column a twice"));
}

/// The error of a file with this footer and nothing else.
fn with_footer(footer: &[u8]) -> String {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.parquet");
    let length = (footer.len() as u32).to_le_bytes();
    std::fs::write(&path, [b"PAR1", footer, &length, b"PAR1"].concat()).unwrap();
    read_cloud(&path).unwrap_err().to_string()
}

#[test]
fn sizes_that_a_footer_claims_are_checked() {
    // Version 1, then the list of the schema's elements, each with its name and number of children.
    let element = |children: &[u8]| [&[0x48, 1, b's', 0x15], children, &[0]].concat();
    let schema = |count: &[u8], elements: &[u8]| {
        with_footer(&[&[0x15, 2, 0x19], count, elements, &[0]].concat())
    };
    let text = schema(&[0x1c], &element(&[0xfe, 0xff, 0xff, 0xff, 0x0f]));
    assert!(
        text.contains("a group with more columns than there are"),
        "{text}"
    );
    let text = schema(&[0xfc, 100], &element(&[2]).repeat(100));
    assert!(
        text.contains("columns that are nested too deeply"),
        "{text}"
    );
    let text = schema(&[0xfc, 0xff, 0xff, 0xff, 0xff, 0x0f], &element(&[2]));
    assert!(text.contains("a footer that is cut off"), "{text}");
    let text = with_footer(&[0x1c; 1000]);
    assert!(
        text.contains("structures that are nested too deeply"),
        "{text}"
    );
    let text = with_footer(&[0x19; 1000]);
    assert!(
        text.contains("nested too deeply") || text.contains("cut off"),
        "{text}"
    );
    // Row groups of one byte each, which decode to hundreds of bytes.
    let groups = [
        &[0x15, 2, 0x39, 0xfc, 0xc0, 0x84, 0x3d][..],
        &vec![0; 1_000_001],
    ]
    .concat();
    let text = with_footer(&groups);
    assert!(text.contains("a footer with 1000000 row groups"), "{text}");
}

#[test]
fn more_rows_than_the_size_of_the_file_explains_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.parquet");
    let mut table = ParquetTable::create(&path, &["east_m", "north_m", "up_m"]).unwrap();
    for _ in 0..1_100_000 {
        table.row([0.0; 3]).unwrap();
    }
    table.finish().unwrap();
    let text = read_cloud(&path).unwrap_err().to_string();
    assert!(text.contains("found 1100000 rows in"), "{text}");
}

#[test]
fn damaged_files_give_errors_or_other_values_but_no_panic() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.parquet");
    for name in [
        "pyarrow_none",
        "pyarrow_snappy",
        "pyarrow_gzip",
        "pyarrow_zstd",
        "pyarrow_lz4",
        "polars_zstd",
        "pandas_timestamp",
    ] {
        let valid = std::fs::read(sample(name)).unwrap();
        let mut refused = 0;
        for_each_damaged(&path, &valid, 400, || {
            refused += u32::from(read_cloud(&path).is_err());
            let _ = detect(&path);
        });
        assert!(refused > 200, "{name}: {refused}");
    }
}
