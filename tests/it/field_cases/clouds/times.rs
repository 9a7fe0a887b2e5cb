//! Times of clouds: one base through all commands.

use std::path::Path;

use super::{case, converted, read};
use boresight::format::{inspect, read_cloud};

use crate::common::boresight;

/// The flag of adjusted standard GPS time and the first time of an uncompressed LAS file of format 6, as stored.
fn stored(path: &Path) -> (bool, f64) {
    let bytes = std::fs::read(path).unwrap();
    let data = u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize;
    let time = bytes[data + 22..data + 30].try_into().unwrap();
    (bytes[6] & 1 == 1, f64::from_le_bytes(time))
}

fn convert(from: &Path, to: &Path) -> String {
    let run = boresight(&["convert", from.to_str().unwrap(), to.to_str().unwrap()]);
    assert_eq!(run.code, 0, "{}", run.err);
    run.err
}

#[test]
fn adjusted_gps_times_are_unix_times_in_all_commands() {
    let name = "adj_las_profiles/adj.laz";
    assert_eq!(read(name).0.time_s[0], 1_700_000_000.0);
    let span_s = inspect(&case(name)).unwrap().span_s;
    assert_eq!(span_s, Some([1_700_000_000.0, 1_700_000_002.0]));
    assert!(converted(name).1[0].ends_with(",1700000000,10"));
    let mut reader = boresight::format::open_profiles(&case(name)).unwrap();
    let mut points = Vec::new();
    assert!(reader.next_chunk(&mut points).unwrap());
    assert_eq!(points[0].time_s, 1_700_000_000.0);
}

#[test]
fn adjusted_gps_times_come_back_flagged() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    convert(&case("las-gps-time/gps_std2013.las"), &at("a.csv"));
    convert(&at("a.csv"), &at("a.las"));
    assert_eq!(stored(&at("a.las")), (true, 5e7));
    // Georeferenced on poses in Unix time, and on poses in adjusted GPS time.
    for (folder, times_s) in [
        ("pg_adj_vs_unix", (true, 384_035_219.0)),
        ("pg_adj_vs_adj", (true, 384_035_219.0)),
    ] {
        let out = at(folder);
        let project = case(&format!("las-gps-time/{folder}/project.toml"));
        let run = boresight(&[
            "georeference",
            project.to_str().unwrap(),
            "--out",
            out.to_str().unwrap(),
        ]);
        assert_eq!(run.code, 0, "{folder}: {}", run.err);
        let las = out.join("a.las");
        convert(&out.join("cloud-s.laz"), &las);
        assert_eq!(stored(&las), times_s, "{folder}");
    }
    let (_, remarks) = read("las-gps-time/gps_flagstd_wkvalues.las");
    assert!(
        remarks.contains("345600.5 s is in September 2011"),
        "{remarks}"
    );
}

#[test]
fn unix_times_before_2017_are_not_flagged_as_times_of_the_week() {
    let folder = tempfile::tempdir().unwrap();
    let [las, text] = ["a.las", "a.csv"].map(|name| folder.path().join(name));
    let input = case("unix_before_2017/t15.csv");
    convert(&input, &las);
    // 2015-01-01, 16 leap seconds after 1980-01-06.
    assert_eq!(
        stored(&las),
        (true, 1_420_070_400.5 - 315_964_800.0 + 16.0 - 1e9)
    );
    convert(&las, &text);
    assert_eq!(
        read_cloud(&text).unwrap().time_s,
        read_cloud(&input).unwrap().time_s
    );
}

#[test]
fn times_and_coordinates_in_other_units_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    for (text, expected) in [
        (
            "x,y,z,GpsTime\n1,2,3,1403636579758555392\n",
            "a time of 1.4",
        ),
        (
            "x,y,z\n1,2,3\n1403636579758555392,2,3\n",
            "a coordinate of 1.4",
        ),
        (
            "east_m,north_m,up_m\n1,2,3\n1,2,-2e9\n",
            "point 1 with a coordinate of -2e9 m",
        ),
    ] {
        std::fs::write(&path, text).unwrap();
        for command in ["inspect", "thin"] {
            let mut arguments = vec![command, path.to_str().unwrap()];
            if command == "thin" {
                arguments.extend(["--voxel-m", "1"]);
            }
            let run = boresight(&arguments);
            assert!(run.code != 0 && run.err.contains(expected), "{}", run.err);
        }
    }
}
