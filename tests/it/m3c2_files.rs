//! `boresight compare` on files: in one piece and tile by tile, with all outputs.

use std::path::{Path, PathBuf};

use boresight::cloud::PointCloud;
use boresight::comparison::ComparisonSettings;
use boresight::format;
use boresight::geometry::Vec3;
use boresight::pipeline::{Options, compare};
use boresight::progress::Silent;
use boresight::tiles::{Comparison, NormalSource, Orientation};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

/// Writes a rough surface at UTM coordinates, and one 6 mm above it with a gap, as LAZ.
fn clouds(folder: &Path) -> [PathBuf; 2] {
    let mut rng = ChaCha8Rng::seed_from_u64(31);
    let mut write = |name: &str, offset: f64, gap: f64| {
        let mut point = || {
            let (x, y): (f64, f64) = (rng.random_range(0.0..4.0), rng.random_range(0.0..3.0));
            let z = 0.1 * (2.0 * x).sin() + rng.random_range(-0.004..0.004) + offset;
            Vec3::new(x, y, z)
        };
        let mut points: Vec<Vec3> = (0..120_000).map(|_| point()).collect();
        points.retain(|p| (p.x - 2.0).abs() > gap);
        let origin = Vec3::new(362_000.0, 5_157_000.0, 100.0);
        let cloud = PointCloud {
            points: points.iter().map(|p| p + origin).collect(),
            ..PointCloud::default()
        };
        let path = folder.join(name);
        format::cloud_to_las(&cloud, &path, &[], None, &mut |_, _| Ok(true), &Silent).unwrap();
        path
    };
    [
        write("cloud.laz", 0.006, 0.3),
        write("reference.laz", 0.0, -1.0),
    ]
}

fn run(comparison: &Comparison, out: &Path) -> (Value, String) {
    let options = Options {
        out: out.to_owned(),
        seed: None,
        fresh: false,
        kept: Vec::new(),
    };
    let outcome = compare(comparison, &options, &Silent).unwrap();
    let names = ["m3c2.laz", "m3c2.csv", "compare.html"];
    assert_eq!(outcome.files, names.map(|name| out.join(name)));
    let table = std::fs::read_to_string(out.join("m3c2.csv")).unwrap();
    (outcome.result, table)
}

#[test]
fn tiles_give_the_same_bytes_as_one_piece() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let [cloud, reference] = clouds(folder.path());
    let whole = Comparison {
        cloud,
        reference,
        core: None,
        normals: NormalSource::Core {
            orientation: Orientation::Direction(Vec3::z()),
        },
        settings: ComparisonSettings {
            core_spacing_m: 0.05,
            normal_radii_m: vec![0.03, 0.06],
            max_distance_m: 0.05,
            ..ComparisonSettings::default()
        }
        .into(),
        memory_bytes: Some(4 << 30),
    };
    let in_tiles = |comparison: &Comparison| Comparison {
        memory_bytes: Some(0),
        ..comparison.clone()
    };
    let (result, table) = run(&whole, &at("whole"));
    let (by_tiles, tiled_table) = run(&in_tiles(&whole), &at("tiles"));
    assert_eq!(result["tiles"], 1);
    assert!(by_tiles["tiles"].as_u64().unwrap() >= 4, "{by_tiles}");
    assert!(table == tiled_table, "tables differ");
    let laz = |folder: &str| std::fs::read(at(folder).join("m3c2.laz")).unwrap();
    assert!(laz("whole") == laz("tiles"), "clouds differ");
    for stage in ["read", "index", "compare", "write"] {
        assert!(result["stages"][stage]["seconds"].as_f64().unwrap() > 0.0);
        assert!(by_tiles["stages"][stage]["seconds"].as_f64().unwrap() > 0.0);
    }
    // The cloud lies 6 mm above the reference, and has a gap.
    assert!((result["median_m"].as_f64().unwrap() - 0.006).abs() < 5e-4);
    assert!(result["n"].as_u64() < result["core_points"].as_u64());
    assert!(!at("tiles").join("reference-tiles").exists());

    // What is given, or not needed, is not measured.
    assert!(result["measured"].is_null() && by_tiles["measured"].is_null());

    // The table can be read as core points with normals, which gives the same numbers again.
    let known: String =
        table
            .lines()
            .filter(|line| !line.contains("NaN"))
            .fold(String::new(), |mut text, line| {
                text.push_str(line);
                text.push('\n');
                text
            });
    std::fs::write(at("core.csv"), &known).unwrap();
    let again = Comparison {
        core: Some(at("core.csv")),
        ..whole.clone()
    };
    let numbers = |text: &str| -> Vec<Vec<f64>> {
        let row = |line: &str| line.split(',').map(|cell| cell.parse().unwrap()).collect();
        text.lines().skip(1).map(row).collect()
    };
    let (_, given) = run(&again, &at("given"));
    let (_, given_tiled) = run(&in_tiles(&again), &at("given-tiles"));
    assert!(given == given_tiled, "tables with given normals differ");
    let (given, known) = (numbers(&given), numbers(&known));
    assert_eq!(given.len(), known.len());
    for (given, known) in given.iter().zip(&known) {
        assert_eq!(
            (given[..3].to_vec(), &given[11..]),
            (known[..3].to_vec(), &known[11..])
        );
        assert!(given[8].is_nan());
        assert!((given[3] - known[3]).abs() < 1e-15);
    }
    // If normals of the reference are requested, those in the file are not used.
    let recomputed = Comparison {
        normals: NormalSource::Reference {
            orientation: Orientation::Direction(Vec3::z()),
        },
        ..again
    };
    let (_, recomputed) = run(&recomputed, &at("recomputed"));
    assert_eq!(numbers(&recomputed), known);
}

#[test]
fn distances_of_walls_under_an_upward_orientation_are_said_to_have_arbitrary_signs() {
    let folder = tempfile::tempdir().unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut write = |name: &str, offset: f64| {
        let wall = |_| {
            let mut noise = || rng.random_range(-0.002..0.002);
            let (along, up) = (noise() * 500.0, noise() * 500.0);
            Vec3::new(offset + noise(), along, up)
        };
        let cloud = PointCloud {
            points: (0..40_000).map(wall).collect(),
            ..PointCloud::default()
        };
        let path = folder.path().join(name);
        format::cloud_to_las(&cloud, &path, &[], None, &mut |_, _| Ok(true), &Silent).unwrap();
        path
    };
    let [cloud, reference] = [write("cloud.laz", 0.01), write("reference.laz", 0.0)];
    let summary_of = |orientation: Vec3| {
        let comparison = Comparison {
            cloud: cloud.clone(),
            reference: reference.clone(),
            core: None,
            normals: NormalSource::Core {
                orientation: Orientation::Direction(orientation),
            },
            settings: ComparisonSettings {
                core_spacing_m: 0.1,
                normal_radii_m: vec![0.15],
                ..ComparisonSettings::default()
            }
            .into(),
            memory_bytes: Some(4 << 30),
        };
        let options = Options {
            out: folder.path().join("out"),
            seed: None,
            fresh: false,
            kept: Vec::new(),
        };
        let outcome = compare(&comparison, &options, &Silent).unwrap();
        let across = outcome.result["normals_across_orientation"]
            .as_u64()
            .unwrap();
        (
            across,
            outcome.result["n"].as_u64().unwrap(),
            outcome.summary,
        )
    };
    let (across, distances, summary) = summary_of(Vec3::z());
    assert_eq!(across, distances);
    assert!(summary.contains("signs are arbitrary"), "{summary}");
    let (across, _, summary) = summary_of(Vec3::x());
    assert_eq!(across, 0);
    assert!(!summary.contains("arbitrary"), "{summary}");
}
