//! M3C2 compared with other programs on the same data; for its definition see `m3c2_options.rs`.

use std::path::Path;

use crate::common;
use crate::common::kernels::read_las;
use crate::common::tables::numbers;
use boresight::comparison::{
    ComparisonSettings, CoreDistance, Histogram, M3c2, Normals, Statistics, core_points, m3c2,
};
use boresight::geometry::Vec3;
use boresight::progress::Silent;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const UP: Vec3 = Vec3::new(0.0, 0.0, 1.0);

#[test]
fn m3c2_does_not_depend_on_the_number_of_threads() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut cloud = || -> Vec<Vec3> {
        let mut point = |_| Vec3::new(rng.random(), rng.random(), 0.01 * rng.random::<f64>());
        (0..20_000).map(&mut point).collect()
    };
    let (reference, compared) = (cloud(), cloud());
    let settings = ComparisonSettings::default();
    let core = core_points(&reference, &settings);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let run = || {
            m3c2(
                &reference,
                &compared,
                &core,
                Normals::UPWARDS,
                &settings,
                &Silent,
            )
            .unwrap()
        };
        format!("{:?}", pool.install(run))
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn clouds_and_settings_that_cannot_be_compared_are_refused() {
    let settings = ComparisonSettings::default();
    let plane: Vec<Vec3> = (0..400)
        .map(|i| Vec3::new(f64::from(i % 20), f64::from(i / 20), 0.0) * 0.01)
        .collect();
    let above: Vec<Vec3> = plane.iter().map(|p| p + UP).collect();
    let run = |a: &[Vec3], b: &[Vec3], normals: Normals<'_>, settings: &ComparisonSettings| {
        m3c2(a, b, &plane, normals, settings, &Silent)
    };
    for (a, b, name) in [
        (&plane[..], &[][..], "compared"),
        (&[][..], &plane[..], "reference"),
    ] {
        assert!(
            run(a, b, Normals::UPWARDS, &settings)
                .unwrap_err()
                .to_string()
                .contains(name)
        );
    }
    assert!(
        run(&plane, &plane, Normals::Given(&[UP]), &settings)
            .unwrap_err()
            .to_string()
            .contains("400")
    );
    let zero = ComparisonSettings {
        cylinder_radius_m: 0.0,
        ..settings.clone()
    };
    assert!(
        run(&plane, &plane, Normals::UPWARDS, &zero)
            .unwrap_err()
            .to_string()
            .contains("cylinder_radius_m")
    );
    let negative = ComparisonSettings {
        registration_error_m: -0.001,
        ..settings.clone()
    };
    assert!(run(&plane, &plane, Normals::UPWARDS, &negative).is_err());
    let no_radii = ComparisonSettings {
        normal_radii_m: vec![],
        ..settings.clone()
    };
    assert!(run(&plane, &plane, Normals::UPWARDS, &no_radii).is_err());

    let apart = run(&plane, &above, Normals::UPWARDS, &settings).unwrap();
    let message = Statistics::of(&apart).unwrap_err().to_string();
    assert!(
        message.contains("do not overlap") && message.contains("400"),
        "{message}"
    );
}

#[test]
fn statistics_of_known_distances_are_right() {
    let distances = [f64::NAN, 0.001, 0.002, -0.001, 0.004, 0.004];
    let entry = |distance_m| CoreDistance {
        point: Vec3::zeros(),
        normal: UP,
        normal_radius_m: 0.04,
        distance_m,
        level_of_detection_m: if distance_m < 0.0 { f64::NAN } else { 0.0015 },
        reference_spread_m: 0.0,
        compared_spread_m: 0.0,
        reference_count: 2,
        compared_count: 2,
    };
    let comparison = M3c2 {
        core: distances.map(entry).to_vec(),
    };
    let statistics = Statistics::of(&comparison).unwrap();
    assert_eq!((statistics.n, statistics.core_points), (5, 6));
    assert!((statistics.mean_m - 0.002).abs() < 1e-18);
    // Σ(d − 2 mm)² = 1 + 0 + 9 + 4 + 4 mm², Σd² = 1 + 4 + 1 + 16 + 16 mm².
    assert!((statistics.std_m - 1e-3 * (18.0f64 / 4.0).sqrt()).abs() < 1e-15);
    assert!((statistics.rmse_m - 1e-3 * (38.0f64 / 5.0).sqrt()).abs() < 1e-15);
    assert_eq!(statistics.median_m, 0.002);
    assert_eq!(statistics.significant_share, 3.0 / 4.0);
    let histogram = Histogram::of(comparison.distances_m(), (0.0, 0.004), 4);
    assert_eq!(
        (histogram.below, &histogram.counts[..], histogram.above),
        (1, &[0, 1, 1, 0][..], 2)
    );
    let json = serde_json::to_value(&statistics).unwrap();
    assert_eq!(json["n"], 5);
    assert!(json["m3c2_rmse_m"].is_number());
}

#[test]
fn m3c2_equals_py4dgeo() {
    agrees_with_py4dgeo(&common::data("m3c2_case"), 1051);
}

#[test]
fn m3c2_equals_py4dgeo_on_the_whole_clouds() {
    if let Some(folder) = common::external_data("m3c2_case") {
        agrees_with_py4dgeo(&folder, 20_000);
    }
}

fn agrees_with_py4dgeo(folder: &Path, core_points: usize) {
    let rows = |name: &str| numbers(&folder.join(format!("{name}.npy")));
    let points = |name: &str| -> Vec<Vec3> {
        let rows = rows(name);
        rows.iter().map(|r| Vec3::from_column_slice(r)).collect()
    };
    let column = |name: &str| rows(name).concat();
    let (first, second) = (points("epoch1"), points("epoch2"));
    let (core, normals) = (points("corepoints"), points("normals"));
    assert_eq!(core.len(), core_points);
    let settings = ComparisonSettings {
        core_spacing_m: f64::NAN,
        normal_radii_m: vec![0.03, 0.06],
        cylinder_radius_m: 0.02,
        max_distance_m: 0.05,
        registration_error_m: 0.001,
        ..ComparisonSettings::default()
    };

    // With py4dgeo's normals all numbers are the same.
    let given = m3c2(
        &first,
        &second,
        &core,
        Normals::Given(&normals),
        &settings,
        &Silent,
    )
    .unwrap();
    let [n1, n2] = ["num_samples1", "num_samples2"].map(column);
    let expected = ["distance", "lodetection", "spread1", "spread2"].map(column);
    let mut worst = [0.0f64; 4];
    for (i, at) in given.core.iter().enumerate() {
        assert_eq!(
            (at.reference_count.into(), at.compared_count.into()),
            (n1[i], n2[i])
        );
        let ours = [
            at.distance_m,
            at.level_of_detection_m,
            at.reference_spread_m,
            at.compared_spread_m,
        ];
        for quantity in 0..4 {
            let theirs = expected[quantity][i];
            // Without points the spread is -0.0 in py4dgeo and NaN here.
            if quantity >= 2 && [&n1, &n2][quantity - 2][i] == 0.0 {
                assert!(ours[quantity].is_nan());
                continue;
            }
            assert_eq!(ours[quantity].is_nan(), theirs.is_nan(), "core point {i}");
            if theirs.is_finite() {
                worst[quantity] = worst[quantity].max((ours[quantity] - theirs).abs());
            }
        }
    }
    println!("given normals: distance, LoD and spreads within {worst:?} m, counts equal");
    // Both sum tens of heights of a few centimetres in double precision.
    assert!(worst.iter().all(|difference| *difference < 1e-15));

    // With our own normals.
    let with_own_normals =
        m3c2(&first, &second, &core, Normals::UPWARDS, &settings, &Silent).unwrap();
    let radii = column("normal_radius_used");
    let (mut turned, mut other_radius, mut worst_angle) = (0, 0, 0.0f64);
    for (i, at) in with_own_normals.core.iter().enumerate() {
        let angle_deg = at
            .normal
            .cross(&normals[i])
            .norm()
            .atan2(at.normal.dot(&normals[i]))
            .to_degrees();
        other_radius += usize::from(at.normal_radius_m != radii[i]);
        worst_angle = worst_angle.max(angle_deg);
        if angle_deg > 0.01 {
            turned += 1;
            println!(
                "core point {i}: {angle_deg}°, radius {} against {}",
                at.normal_radius_m, radii[i]
            );
        }
    }
    println!(
        "own normals: {turned} of {} differ, {other_radius} by the radius, worst {worst_angle:.2e}°",
        core.len()
    );
    assert!(turned * 1000 <= core.len());
}

#[test]
fn m3c2_scatters_around_cloudcompare_no_more_than_pdal() {
    let folder = common::data("autzen_m3c2");
    let reference = read_las(&folder.join("autzen-bmx-2010.las"));
    let compared = read_las(&folder.join("autzen-bmx-2023.las"));
    let theirs = numbers(&folder.join("autzen-bmx-cc.txt"));
    let pdal = numbers(&folder.join("autzen-bmx-m3c2.txt"));
    let core: Vec<Vec3> = theirs
        .iter()
        .map(|row| Vec3::from_column_slice(&row[..3]))
        .collect();
    let settings = ComparisonSettings {
        core_spacing_m: f64::NAN,
        normal_radii_m: vec![1.390432],
        cylinder_radius_m: 2.890432,
        max_distance_m: 5.5,
        registration_error_m: 0.0,
        ..ComparisonSettings::default()
    };
    let ours = m3c2(
        &reference,
        &compared,
        &core,
        Normals::UPWARDS,
        &settings,
        &Silent,
    )
    .unwrap();

    // The files have three decimals, and our values are rounded to as many, so that rounding favours
    // neither. Core points without a normal are 0 with an uncertainty of 0 there, and NaN here.
    let rounded = |x: f64| (x * 1000.0).round() / 1000.0;
    let (mut ours_off, mut pdal_off, mut lod_off) = (vec![], vec![], vec![]);
    let (mut same_counts, mut pdal_same_counts, mut without_normal) = (0, 0, 0);
    for ((at, cc), pdal) in ours.core.iter().zip(&theirs).zip(&pdal) {
        let [n1, n2, lod, distance] = [cc[18], cc[19], cc[23], cc[24]];
        if distance == 0.0 && lod == 0.0 {
            assert!(at.normal.x.is_nan() && at.distance_m.is_nan());
            without_normal += 1;
            continue;
        }
        assert_eq!(at.distance_m.is_nan(), distance.is_nan());
        if distance.is_nan() {
            continue;
        }
        ours_off.push((rounded(at.distance_m) - distance).abs());
        pdal_off.push((pdal[21] - distance).abs());
        pdal_same_counts += usize::from(pdal[26] == n1 && pdal[27] == n2);
        if (f64::from(at.reference_count), f64::from(at.compared_count)) == (n1, n2) {
            same_counts += 1;
            if lod.is_finite() {
                // CloudCompare and PDAL divide squared deviations by n, we by n - 1.
                let mean_variance = |spread: f64, n: f64| spread.powi(2) * (n - 1.0) / (n * n);
                let variance = mean_variance(at.reference_spread_m, n1)
                    + mean_variance(at.compared_spread_m, n2);
                lod_off.push((rounded(1.96 * variance.sqrt()) - lod).abs());
            }
        }
    }
    let scatter = |off: &mut Vec<f64>| {
        off.sort_by(f64::total_cmp);
        let rms = (off.iter().map(|d| d * d).sum::<f64>() / off.len() as f64).sqrt();
        [off[off.len() / 2], rms, off[off.len() - 1]]
    };
    let n = ours_off.len();
    let (ours, pdal) = (scatter(&mut ours_off), scatter(&mut pdal_off));
    let lod = scatter(&mut lod_off);
    println!(
        "against CloudCompare at {n} core points ({without_normal} more without normal), feet, \
         median, rms, max: ours {ours:.4?}, PDAL {pdal:.4?}; counts equal at {same_counts} and \
         {pdal_same_counts}; level of detection {lod:.4?}",
    );
    // Tolerance for the rounding of the differences.
    for (ours, pdal) in ours.iter().zip(pdal) {
        assert!(*ours <= pdal + 1e-9);
    }
    assert!(same_counts >= pdal_same_counts);
    // CloudCompare's coordinates have single precision: about 1e-3 of these spreads.
    assert!(lod[1] <= 1e-3);
}
