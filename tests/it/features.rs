//! `boresight features`: in one piece and tile by tile; partly with the real binary.

use std::fs;
use std::path::Path;

use crate::common::{self, Run, boresight, names};
use boresight::cloud::{NeighbourIndex, Neighbourhood, PointCloud, Surroundings};
use boresight::format::{self, ExtraDimension, ExtraKind};
use boresight::geometry::Vec3;
use boresight::progress::Silent;
use boresight::tiles::{self, TileStore};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn clouds_hard_to_tile() -> Vec<(&'static str, Vec<Vec3>)> {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut uniform = |n: usize, size: f64| -> Vec<Vec3> {
        (0..n)
            .map(|_| {
                let mut at = || rng.random_range(0.0..size);
                Vec3::new(at(), at(), 0.05 * at())
            })
            .collect()
    };
    let utm = Vec3::new(362_328.5, 5_157_700.25, 108.5);
    // A dense patch in a sparse scene, with outliers kilometres away.
    let mut uneven = uniform(1200, 100.0);
    uneven.extend(
        uniform(2500, 0.5)
            .iter()
            .map(|p| p + Vec3::new(40.0, 30.0, 0.0)),
    );
    uneven.extend((1..5).map(|i| Vec3::new(3e3 * f64::from(i), -7e3, 20.0)));
    let uneven = uneven.iter().map(|p| p + utm).collect();
    // Ties everywhere, and tile borders exactly on points.
    let grid = (0..50 * 60)
        .map(|i| {
            let (column, row) = (f64::from(i % 50), f64::from(i / 50));
            Vec3::new(0.25 * column, 0.25 * row, 0.0)
        })
        .collect();
    // Each point many times, in mixed order.
    let mut duplicates = Vec::new();
    for (i, p) in uniform(250, 3.0).iter().enumerate() {
        duplicates.extend(std::iter::repeat_n(*p, 1 + i % 23));
    }
    let n = duplicates.len();
    let duplicates = (0..n).map(|i| duplicates[i * 7919 % n]).collect();
    // A mast, which no tile border can divide.
    let mut mast: Vec<Vec3> = (0..900)
        .map(|i| Vec3::new(5.0, 5.0, 0.01 * f64::from(i)))
        .collect();
    mast.extend(uniform(900, 10.0));
    let line = (0..2000)
        .map(|i| Vec3::new(7.0, 0.01 * f64::from(i), 1.0))
        .collect();
    vec![
        ("uneven", uneven),
        ("grid", grid),
        ("duplicates", duplicates),
        ("mast", mast),
        ("line", line),
        ("few", uniform(9, 1.0)),
    ]
}

#[test]
fn tiles_give_the_same_numbers_as_one_piece() {
    let folder = tempfile::tempdir().unwrap();
    let mut deferred = 0;
    for (name, points) in clouds_hard_to_tile() {
        for neighbourhood in [
            Neighbourhood::Nearest(1),
            Neighbourhood::Nearest(12),
            Neighbourhood::Nearest(50),
            Neighbourhood::Within(0.25),
        ] {
            let copy = |_: usize, near: &Surroundings| *near;
            let whole = NeighbourIndex::new(&points)
                .surroundings(&points, neighbourhood, &Silent, copy)
                .unwrap();
            for most in [150, 700, 100_000] {
                let place = folder.path().join("tiles");
                let store = TileStore::write(&place, most, &mut |each| {
                    points.chunks(1000).try_for_each(&mut *each)
                })
                .unwrap();
                let mut results = vec![None; points.len()];
                let take = |index: u64, near: Surroundings| {
                    assert!(
                        results[index as usize].replace(near).is_none(),
                        "{name}: twice"
                    );
                    Ok(())
                };
                let work =
                    tiles::surroundings(&store, neighbourhood, most, &Silent, |near| *near, take)
                        .unwrap();
                assert!(most > 700 || points.len() < 100 || work.tiles > 1, "{name}");
                deferred += work.deferred;
                for (index, (result, expected)) in results.iter().zip(&whole).enumerate() {
                    assert_eq!(
                        result.as_ref(),
                        Some(expected),
                        "{name}, {neighbourhood:?}, {} tiles, point {index}",
                        work.tiles
                    );
                }
            }
        }
    }
    assert!(deferred > 100, "only {deferred} points were deferred");
}

/// Writes a surface of `n` points with outliers as LAZ with an extra dimension.
fn write_surface(path: &Path, n: usize) {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut points: Vec<Vec3> = (0..n)
        .map(|_| {
            let (x, y): (f64, f64) = (rng.random_range(0.0..20.0), rng.random_range(0.0..5.0));
            let z = (0.8 * x).sin() * 0.3 + rng.random_range(-0.01..0.01);
            Vec3::new(5000.0 + x, 7000.0 + y, 100.0 + z)
        })
        .collect();
    // One point far to the side, and one high above the middle, whose neighbours lie beyond any halo.
    points.push(Vec3::new(9000.0, 7000.0, 150.0));
    points.push(Vec3::new(5010.0, 7002.5, 150.0));
    let cloud = PointCloud {
        time_s: (0..points.len()).map(|i| i as f64 * 0.001).collect(),
        intensity: (0..points.len()).map(|i| (i % 999) as f32).collect(),
        points,
    };
    let ring = [ExtraDimension::new(
        "ring",
        ExtraKind::U32,
        "of the scanner",
    )];
    let mut row = |index: u64, values: &mut [f64]| {
        values[0] = (index % 32) as f64;
        Ok(true)
    };
    format::cloud_to_las(&cloud, path, &ring, None, &mut row, &Silent).unwrap();
}

fn features(input: &Path, out: &Path, more: &[&str]) -> Run {
    let mut arguments = vec![
        "features",
        input.to_str().unwrap(),
        "--out",
        out.to_str().unwrap(),
    ];
    arguments.extend(more);
    boresight(&arguments)
}

#[test]
fn bytes_do_not_depend_on_tiles_or_threads() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("surface.laz");
    write_surface(&input, 90_000);
    let run = |name: &str, more: &[&str]| {
        let out = folder.path().join(name);
        let mut arguments = vec!["--features", "all", "--neighbours", "20", "--json"];
        arguments.extend(more);
        let run = features(&input, &out, &arguments);
        assert_eq!(run.code, 0, "{}", run.err);
        assert_eq!(names(&out), ["log.txt", "surface-features.laz"]);
        let result: serde_json::Value = serde_json::from_str(&run.out).unwrap();
        assert_eq!(result["points"], 90_002);
        for stage in ["read", "features", "write"] {
            assert!(result["stages"][stage]["seconds"].is_number());
        }
        let bytes = fs::read(out.join("surface-features.laz")).unwrap();
        let number = |name: &str| result[name].as_u64().unwrap();
        (bytes, number("tiles"), number("points_beyond_halo"))
    };
    let (one, tiles, _) = run("one", &["--threads", "1"]);
    assert_eq!(tiles, 1);
    let (two, _, _) = run("two", &["--threads", "2"]);
    assert!(one == two, "threads change bytes");
    let (tiled, tiles, beyond) = run("tiled", &["--threads", "2", "--memory-mb", "1"]);
    assert!(
        tiles > 4 && beyond > 0,
        "{tiles} tiles, {beyond} points beyond their halo"
    );
    assert!(one == tiled, "tiles change bytes");
}

#[test]
fn the_output_has_all_fields_of_the_input_and_the_features() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("surface.laz");
    write_surface(&input, 3000);
    let run = features(&input, folder.path(), &[]);
    assert_eq!(run.code, 0, "{}", run.err);
    let output = folder.path().join("surface-features.laz");
    assert_eq!(
        format::read_cloud(&output).unwrap(),
        format::read_cloud(&input).unwrap()
    );
    let inspection = format::inspect(&output).unwrap();
    assert_eq!(
        inspection.columns,
        [
            "ring",
            "omnivariance",
            "linearity",
            "planarity",
            "sphericity",
            "verticality",
            "change_of_curvature",
            "normal_x",
            "normal_y",
            "normal_z"
        ]
    );
    // Applied to the output again: dimensions are replaced, not duplicated.
    let again = folder.path().join("again");
    let run = features(&output, &again, &["--features", "omnivariance,radius"]);
    assert_eq!(run.code, 0, "{}", run.err);
    let inspection = format::inspect(&again.join("surface-features-features.laz")).unwrap();
    assert_eq!(inspection.columns.len(), 11);
    assert_eq!(inspection.columns[9..], ["omnivariance", "radius_m"]);
}

#[test]
fn extra_dimensions_of_the_input_are_retained() {
    let truck = common::data("boresight_truck/Truck.adc.laz");
    let folder = tempfile::tempdir().unwrap();
    let run = features(&truck, folder.path(), &["--neighbours", "20"]);
    assert_eq!(run.code, 0, "{}", run.err);
    let output = folder.path().join("Truck.adc-features.laz");
    assert_eq!(
        format::read_cloud(&output).unwrap(),
        format::read_cloud(&truck).unwrap()
    );
    let (before, after) = (
        format::inspect(&truck).unwrap(),
        format::inspect(&output).unwrap(),
    );
    let n = before.columns.len();
    assert_eq!(after.columns[..n], before.columns);
    assert_eq!(after.columns.len(), n + 9);
    // The pose of each point can still be read, and is the same.
    assert_eq!(
        format::read_trajectory(&output).unwrap(),
        format::read_trajectory(&truck).unwrap()
    );
}

#[test]
fn text_clouds_give_the_same_features_in_one_piece_and_in_tiles() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("grid.xyz");
    let mut text = String::new();
    for i in 0..45_000 {
        text.push_str(&format!(
            "{} {} {}\n",
            0.1 * f64::from(i % 300),
            i / 300,
            i % 7
        ));
    }
    fs::write(&input, text).unwrap();
    let mut outputs = Vec::new();
    for more in [
        &["--radius-m", "1.5"][..],
        &["--radius-m", "1.5", "--memory-mb", "1"],
    ] {
        let run = features(&input, &folder.path().join("out"), more);
        assert_eq!(run.code, 0, "{}", run.err);
        outputs.push(fs::read(folder.path().join("out/grid-features.laz")).unwrap());
    }
    assert!(outputs[0] == outputs[1]);
}

#[test]
fn wrong_use_and_bad_files_end_in_one_error() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("surface.laz");
    write_surface(&input, 60_000);
    let out = folder.path().join("out");
    for (more, expected) in [
        (
            &["--features", "omnivarance"][..],
            "did you mean `omnivariance`?",
        ),
        (
            &["--features", "normal,xyzzyplugh"],
            "there are omnivariance, linearity",
        ),
        (&["--neighbours", "0"], "0 is not in 1.."),
        (&["--radius-m", "0"], "expected metres above 0"),
        (
            &["--neighbours", "5", "--radius-m", "1"],
            "cannot be used with",
        ),
    ] {
        let run = features(&input, &out, more);
        assert_eq!(run.code, 2, "{more:?}");
        assert!(run.err.contains(expected), "{more:?}: {}", run.err);
    }
    let run = features(&folder.path().join("none.laz"), &out, &[]);
    assert_eq!(run.code, 1);
    assert!(run.err.contains("none.laz"), "{}", run.err);
    // Cut off or changed in the middle: an error, and nothing but the log is left.
    let whole = fs::read(&input).unwrap();
    let damaged = folder.path().join("damaged.laz");
    let middle = whole.len() / 2;
    let mut changed = whole.clone();
    changed[middle..middle + 2000].fill(0xA5);
    for (bytes, more) in [
        (whole[..middle].to_vec(), &[][..]),
        (whole[..middle].to_vec(), &["--memory-mb", "1"]),
        (whole[..300].to_vec(), &["--memory-mb", "1"]),
    ] {
        fs::write(&damaged, bytes).unwrap();
        let run = features(&damaged, &out, more);
        assert_eq!(run.code, 1, "{}", run.err);
        assert_eq!(run.err.matches("error: ").count(), 1, "{}", run.err);
        assert!(!run.err.contains("panicked"), "{}", run.err);
        assert!(
            !out.exists() || names(&out) == ["log.txt"],
            "{:?}",
            names(&out)
        );
    }
    // Damaged content that still decodes may be accepted; there must be no incomplete file.
    fs::write(&damaged, changed).unwrap();
    let run = features(&damaged, &out, &["--memory-mb", "1"]);
    let left = if run.code == 0 {
        vec!["damaged-features.laz", "log.txt"]
    } else {
        vec!["log.txt"]
    };
    assert_eq!(names(&out), left, "{}", run.err);
    // The output would replace the input.
    fs::copy(&input, out.join("a-features.laz")).unwrap();
    fs::copy(&input, out.join("a.laz")).unwrap();
    let link = folder.path().join("a.laz");
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(out.join("a-features.laz"), &link).unwrap();
        let run = features(&link, &out, &[]);
        assert_eq!(run.code, 1);
        assert!(run.err.contains("would be overwritten"), "{}", run.err);
    }
}

#[test]
fn a_cloud_with_fewer_points_than_neighbours_gives_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("few.xyz");
    fs::write(&input, "0 0 0\n1 0 0\n0 1 0\n1 1 0.5\n").unwrap();
    let run = features(&input, folder.path(), &["--features", "neighbours,radius"]);
    assert_eq!(run.code, 0, "{}", run.err);
    assert!(run.err.contains("the cloud has 4 points"), "{}", run.err);
}
