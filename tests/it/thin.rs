//! `boresight thin` through the real binary, on complete and truncated clouds.

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};

use crate::common::boresight;
use boresight::format::{CloudWriter, read_cloud};
use boresight::geometry::Vec3;
use serde_json::Value;

const N: usize = 120_000;

/// Point number `i` of a rough surface of 4 m by 2 m at projected coordinates, rounded to the
/// resolution of the file.
fn point(i: usize) -> Vec3 {
    let (a, b) = ((i * 7919 % N) as f64 / N as f64, (i % 997) as f64 / 997.0);
    let up = 0.05 * (5.0 * a).sin() + 0.003 * (i % 13) as f64;
    let local = Vec3::new(4.0 * a, 2.0 * b, up).map(|v| (v * 1e5).round() / 1e5);
    Vec3::new(362_328.0, 5_157_700.0, 108.0) + local
}

fn write_laz(path: &Path) {
    let mut writer = CloudWriter::create(path, point(0)).unwrap();
    for i in 0..N {
        let scanner = (i % 3) as u16;
        writer
            .write(&point(i), 0.001 * i as f64, (i % 65_536) as f32, scanner)
            .unwrap();
    }
    writer.finish().unwrap();
}

fn run(cloud: &Path, out: &Path, more: &[&str]) -> (PathBuf, Value) {
    let mut arguments = vec!["thin", cloud.to_str().unwrap(), "--out"];
    arguments.extend([out.to_str().unwrap(), "--json"]);
    arguments.extend(more);
    let run = boresight(&arguments);
    assert_eq!(run.code, 0, "{}{}", run.out, run.err);
    let document: Value = serde_json::from_str(&run.out).unwrap();
    (PathBuf::from(document["cloud"].as_str().unwrap()), document)
}

#[test]
fn one_point_per_voxel_is_written_with_all_its_attributes() {
    let folder = tempfile::tempdir().unwrap();
    let cloud = folder.path().join("scan.laz");
    write_laz(&cloud);
    let (thinned, document) = run(&cloud, &folder.path().join("out"), &["--voxel-m", "0.02"]);
    assert_eq!(thinned, folder.path().join("out/scan-thinned.laz"));
    let whole = las::Reader::from_path(&cloud).unwrap().read_all().unwrap();
    let whole: Vec<las::Point> = whole.points().map(|p| p.unwrap()).collect();
    let positions: Vec<Vec3> = whole.iter().map(|p| Vec3::new(p.x, p.y, p.z)).collect();
    let indices = boresight::cloud::voxel::thin(&positions, 0.02);
    let written = las::Reader::from_path(&thinned)
        .unwrap()
        .read_all()
        .unwrap();
    let written: Vec<las::Point> = written.points().map(|p| p.unwrap()).collect();
    assert_eq!(written.len(), indices.len());
    for (point, index) in written.iter().zip(&indices) {
        assert_eq!(point, &whole[*index as usize]);
    }
    let voxels: HashSet<[i64; 3]> = positions
        .iter()
        .map(|p| p.map(|v| (v / 0.02).floor() as i64).into())
        .collect();
    assert_eq!(written.len(), voxels.len());
    assert!(
        written.len() < N / 2 && written.len() > 1000,
        "{}",
        written.len()
    );

    assert_eq!(document["points"]["read"], N);
    assert_eq!(document["points"]["kept"], indices.len());
    assert_eq!(document["voxel_m"], 0.02);
    for stage in ["read", "thin", "write"] {
        assert!(document["stages"][stage]["seconds"].as_f64().unwrap() > 0.0);
    }
    let log = fs::read_to_string(folder.path().join("out/log.txt")).unwrap();
    assert!(log.contains("reading and thinning: "), "{log}");
}

#[test]
fn the_bytes_do_not_depend_on_the_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let cloud = folder.path().join("scan.laz");
    write_laz(&cloud);
    let bytes = |threads: &str| {
        let out = folder.path().join(threads);
        let more = ["--voxel-m", "0.01", "--threads", threads];
        fs::read(run(&cloud, &out, &more).0).unwrap()
    };
    let one = bytes("1");
    assert!(one == bytes("2") && one == bytes("3"));
}

#[test]
fn clouds_of_other_formats_are_thinned_as_well() {
    let folder = tempfile::tempdir().unwrap();
    let cloud = folder.path().join("scan.csv");
    let mut text = "east_m,north_m,up_m,time_s,intensity\n".to_owned();
    for i in 0..20_000 {
        let p = point(i);
        text.push_str(&format!("{},{},{},{},{}\n", p.x, p.y, p.z, i, i % 100));
    }
    fs::write(&cloud, text).unwrap();
    let (thinned, _) = run(&cloud, &folder.path().join("out"), &["--voxel-m", "0.05"]);
    assert!(thinned.ends_with("out/scan-thinned.laz"));
    let (whole, written) = (read_cloud(&cloud).unwrap(), read_cloud(&thinned).unwrap());
    let indices = boresight::cloud::voxel::thin(&whole.points, 0.05);
    assert_eq!(written.points.len(), indices.len());
    for (at, &index) in indices.iter().enumerate() {
        let index = index as usize;
        assert_eq!(written.time_s[at], whole.time_s[index]);
        assert_eq!(written.intensity[at], whole.intensity[index]);
        // Half the resolution of the file, and the rounding of coordinates of 5 · 10⁶ m.
        assert!((written.points[at] - whole.points[index]).amax() < 0.5e-5 + 2e-9);
    }
}

#[test]
fn broken_clouds_and_voxel_sizes_are_refused_with_one_clear_message() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let cloud = path("scan.laz");
    write_laz(cloud.as_ref());
    for voxel in ["0", "-0.01", "nan", "inf", "five"] {
        let run = boresight(&["thin", &cloud, "--voxel-m", voxel]);
        assert_eq!(run.code, 2, "{voxel}: {}", run.err);
        assert!(
            run.err.contains("--voxel-m") && run.err.contains("expected metres above 0"),
            "{}",
            run.err
        );
    }
    let run = boresight(&["thin", &cloud]);
    assert_eq!(run.code, 2);
    assert!(run.err.contains("--voxel-m <M>"), "{}", run.err);

    let bytes = fs::read(&cloud).unwrap();
    for length in [0, 100, 1000, bytes.len() / 2, bytes.len() - 1] {
        let cut = path("cut.laz");
        fs::write(&cut, &bytes[..length]).unwrap();
        let run = boresight(&["thin", &cut, "--voxel-m", "0.01"]);
        assert_eq!(run.code, 1, "{length} bytes: {}", run.out);
        assert_eq!(run.err.matches("error: ").count(), 1, "{}", run.err);
        assert!(run.err.contains("cut.laz"), "{length} bytes: {}", run.err);
        assert!(!Path::new(&path("out/cut-thinned.laz")).exists());
    }
    fs::write(path("diary.txt"), "dear diary,\nit rained\n").unwrap();
    let run = boresight(&["thin", &path("diary.txt"), "--voxel-m", "1"]);
    assert_eq!(run.code, 1);
    assert!(run.err.contains("diary.txt"), "{}", run.err);

    let run = boresight(&["thin", &path("nowhere/scan.laz"), "--voxel-m", "0.01"]);
    assert_eq!(run.code, 1);
    assert!(run.err.contains("nowhere/scan.laz"), "{}", run.err);
    assert!(!Path::new(&path("nowhere")).exists());
}
