//! Every combination of the options of M3C2 compared with its definition, on clouds that are hard to
//! search: random, gridded with points on the borders, duplicated, at UTM coordinates, with outliers.

use crate::common::{kernels::naive_covariance, tables::numbers};
use boresight::comparison::{Aggregation, ComparisonSettings, Detection};
use boresight::comparison::{IndexedClouds, Normals, m3c2, reach_m};
use boresight::geometry::Vec3;
use boresight::progress::Silent;
use boresight::statistics::{NORMAL_97_5, student_97_5};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const UP: Vec3 = Vec3::new(0.0, 0.0, 1.0);

/// Middle, squared spread and number of values, from the definitions.
fn brute_sample(mut heights: Vec<f64>, aggregation: Aggregation) -> (f64, f64, usize) {
    let n = heights.len();
    if n == 0 {
        return (f64::NAN, f64::NAN, 0);
    }
    let (middle, spread) = match aggregation {
        Aggregation::Mean => {
            let mean = heights.iter().sum::<f64>() / n as f64;
            let squares = heights.iter().map(|h| (h - mean).powi(2)).sum::<f64>();
            (mean, (squares / (n as f64 - 1.0)).sqrt())
        }
        Aggregation::Median => {
            heights.sort_by(f64::total_cmp);
            // The inverse of the distribution function from below and from above.
            let quantile = |p: f64| {
                let at = p * n as f64;
                let low = heights[(at.ceil() as usize).max(1) - 1];
                let high = heights[(at.floor() as usize).min(n - 1)];
                (low + high) / 2.0
            };
            (quantile(0.5), quantile(0.75) - quantile(0.25))
        }
    };
    (middle, if n < 2 { f64::NAN } else { spread * spread }, n)
}

/// Heights of a cloud's points in the cylinder about a core point along its normal.
fn brute_heights(
    cloud: &[Vec3],
    core: &Vec3,
    normal: &Vec3,
    settings: &ComparisonSettings,
) -> Vec<f64> {
    // In plain numbers, as vectors take minutes here without optimisation.
    let ([a, b, c], [u, v, w]): ([f64; 3], [f64; 3]) = ((*core).into(), (*normal).into());
    let heights = cloud.iter().filter_map(|point| {
        let [x, y, z]: [f64; 3] = (*point).into();
        let (dx, dy, dz) = (x - a, y - b, z - c);
        let height = dx * u + dy * v + dz * w;
        let (ex, ey, ez) = (dx - u * height, dy - v * height, dz - w * height);
        let inside = ex * ex + ey * ey + ez * ez <= settings.cylinder_radius_m.powi(2)
            && height.abs() < settings.max_distance_m.max(settings.cylinder_radius_m);
        inside.then_some(height)
    });
    heights.collect()
}

/// Distance, level of detection and the two counts from the heights of both clouds.
fn brute(heights_m: &[Vec<f64>; 2], settings: &ComparisonSettings) -> (f64, f64, [usize; 2]) {
    let samples = heights_m.each_ref().map(|heights_m| {
        let is_seen = |height: &f64| !settings.one_sided || *height >= 0.0;
        let seen = heights_m.iter().copied().filter(is_seen);
        brute_sample(seen.collect(), settings.aggregation)
    });
    let [(before, v1, n1), (after, v2, n2)] = samples;
    let (a, b) = (v1 / n1 as f64, v2 / n2 as f64);
    let sampling = (a + b).sqrt();
    let mut lod = match settings.detection {
        Detection::Normal => 1.96 * (sampling + settings.registration_error_m),
        Detection::Student => {
            let freedom = (a + b).powi(2) / (a * a / (n1 as f64 - 1.0) + b * b / (n2 as f64 - 1.0));
            let t = student_97_5(freedom);
            let sampled = if sampling == 0.0 { 0.0 } else { t * sampling };
            sampled + NORMAL_97_5 * settings.registration_error_m
        }
    };
    let mut distance = after - before;
    let least = settings.min_points as usize;
    if n1.min(n2) < least {
        distance = f64::NAN;
    }
    if n1.min(n2) < least.max(2) {
        lod = f64::NAN;
    }
    (distance, lod, [n1, n2])
}

/// The normal of the most planar neighbourhood, by nalgebra's decomposition, its radius, and the lead of
/// its planarity over the next best neighbourhood.
fn brute_normal(reference: &[Vec3], core: &Vec3, radii: &[f64]) -> Option<(Vec3, f64, f64)> {
    let mut candidates: Vec<(f64, Vec3, f64)> = Vec::new();
    for &radius in radii {
        let near: Vec<Vec3> = reference
            .iter()
            .copied()
            .filter(|p| (p - core).norm_squared() <= radius * radius)
            .collect();
        if near.len() < 3 {
            continue;
        }
        let eigen = naive_covariance(&near).symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        let [low, middle, high] = order.map(|i| eigen.eigenvalues[i]);
        let normal: Vec3 = eigen.eigenvectors.column(order[0]).into();
        let planarity = (middle - low) / high;
        if planarity > 1e-9 {
            candidates.push((planarity, normal * normal.z.signum(), radius));
        }
    }
    candidates.sort_by(|a, b| b.0.total_cmp(&a.0));
    let lead = match &candidates[..] {
        [] => return None,
        [_] => 1.0,
        [first, second, ..] => first.0 - second.0,
    };
    Some((candidates[0].1, candidates[0].2, lead))
}

struct Case {
    name: &'static str,
    reference: Vec<Vec3>,
    compared: Vec<Vec3>,
    core: Vec<Vec3>,
}

fn cases() -> Vec<Case> {
    let mut rng = ChaCha8Rng::seed_from_u64(23);
    let mut surface = |n: usize, origin: Vec3, offset: f64| -> Vec<Vec3> {
        let mut point = |_| {
            let (x, y): (f64, f64) = (rng.random_range(0.0..1.2), rng.random_range(0.0..0.8));
            let z = 0.1 * (4.0 * x).sin() + 0.3 * y + rng.random_range(-0.02..0.02);
            origin + Vec3::new(x, y, z + offset)
        };
        (0..n).map(&mut point).collect()
    };
    let every = |points: &[Vec3], n: usize| -> Vec<Vec3> {
        let mut core: Vec<Vec3> = points.iter().step_by(n).copied().collect();
        core.push(points[0] + Vec3::new(0.0, 0.0, 30.0));
        core
    };
    let mut cases = Vec::new();
    let far = Vec3::new(-691_000.125, 5_334_000.5, -431.0);
    for (name, origin) in [("random", Vec3::zeros()), ("of UTM size", far)] {
        let (reference, mut compared) = (surface(1500, origin, 0.0), surface(800, origin, 0.015));
        // Some cylinders contain no point, or only one.
        compared.retain(|p| (p - origin - Vec3::new(0.7, 0.4, 0.2)).norm() > 0.22);
        let core = every(&reference, 9);
        cases.push(Case {
            name,
            reference,
            compared,
            core,
        });
    }
    // Steps that are exact in binary: points exactly at the radii, the ends and the cell borders.
    let step = 0.03125;
    let grid = |nx: i32, layers: i32, shift: f64| -> Vec<Vec3> {
        (0..nx * nx * layers)
            .map(|i| {
                let at = [i % nx, i / nx % nx, i / nx / nx];
                let [x, y, z] = at.map(|k| f64::from(k - nx / 2) * step);
                Vec3::new(x, y, z + shift)
            })
            .collect()
    };
    let reference = grid(24, 3, 0.0);
    let core = every(&reference, 13);
    cases.push(Case {
        name: "gridded",
        compared: grid(24, 5, 4.0 * step),
        reference,
        core,
    });
    // Each point three times; most core points coincide with such a triple.
    let (single, other) = (
        surface(200, Vec3::zeros(), 0.0),
        surface(150, Vec3::zeros(), 0.01),
    );
    let thrice = |points: &[Vec3]| -> Vec<Vec3> { (0..3).flat_map(|_| points.to_vec()).collect() };
    let (reference, compared) = (thrice(&single), thrice(&other));
    cases.push(Case {
        name: "duplicated",
        core: every(&single, 3),
        reference,
        compared,
    });
    // Outliers: NaN, infinity, and numbers that are too large for any lattice.
    let (mut reference, mut compared) = (
        surface(900, Vec3::zeros(), 0.0),
        surface(700, Vec3::zeros(), 0.01),
    );
    let core = every(&reference, 11);
    for cloud in [&mut reference, &mut compared] {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -3e7] {
            cloud.insert(cloud.len() / 2, Vec3::new(0.3, bad, 0.1));
            cloud.push(Vec3::new(bad, bad, bad));
        }
    }
    cases.push(Case {
        name: "with outliers",
        reference,
        compared,
        core,
    });
    cases
}

/// All combinations of options with a cylinder, except the normals.
fn options(base: &ComparisonSettings) -> Vec<ComparisonSettings> {
    let mut all = Vec::new();
    for aggregation in [Aggregation::Mean, Aggregation::Median] {
        for detection in [Detection::Normal, Detection::Student] {
            for one_sided in [false, true] {
                for min_points in [1, 4] {
                    all.push(ComparisonSettings {
                        aggregation,
                        detection,
                        one_sided,
                        min_points,
                        ..base.clone()
                    });
                }
            }
        }
    }
    all
}

fn same(a: f64, b: f64) -> bool {
    // Heights are below 1 m; the two programs sum up to 2000 of them in different orders.
    (a - b).abs() <= 1e-13 || (a.is_nan() && b.is_nan())
}

#[test]
fn all_options_agree_with_the_definition() {
    let base = ComparisonSettings {
        normal_radii_m: vec![0.09375, 0.1875],
        cylinder_radius_m: 0.0625,
        max_distance_m: 0.125,
        registration_error_m: 0.001,
        ..ComparisonSettings::default()
    };
    // Long cylinders are searched in a different way, and normals of other radii in other cells.
    let long = ComparisonSettings {
        normal_radii_m: vec![0.2],
        cylinder_radius_m: 0.03125,
        max_distance_m: 0.5,
        ..base.clone()
    };
    let thin = ComparisonSettings {
        normal_radii_m: vec![0.5],
        cylinder_radius_m: 0.03125,
        max_distance_m: 0.03125,
        ..base.clone()
    };
    let (mut compared, mut nothing, mut single, mut known) = (0, 0, 0, 0);
    for case in cases() {
        let Case {
            name,
            reference,
            compared: other,
            core,
        } = &case;
        let tilted: Vec<Vec3> = core
            .iter()
            .map(|p| Vec3::new((7.0 * p.x).sin(), (5.0 * p.y).cos(), 1.5) * 3.0)
            .collect();
        let normals = [
            Normals::UPWARDS,
            Normals::Fixed(2.0 * UP),
            Normals::Given(&tilted),
        ];
        let cylinders = [&base, &long, &thin].into_iter();
        for (cylinder, normals) in cylinders.flat_map(|c| normals.map(|normals| (c, normals))) {
            // What does not depend on the options.
            let mut expected: Vec<(Vec3, [Vec<f64>; 2])> = Vec::new();
            for settings in options(cylinder) {
                let result = m3c2(reference, other, core, normals, &settings, &Silent).unwrap();
                for (i, (at, point)) in result.core.iter().zip(core).enumerate() {
                    let what = || format!("{name}, core point {i}, {normals:?}, {settings:?}");
                    assert_eq!(at.point, *point);
                    if i == expected.len() {
                        let normal = match normals {
                            Normals::Fixed(_) => UP,
                            Normals::Given(given) => given[i] / given[i].norm(),
                            // Compared with brute force in a separate test.
                            Normals::MostPlanar { .. } | Normals::SeenFrom(_) => at.normal,
                        };
                        let clouds = [&reference[..], other];
                        let heights = |cloud| brute_heights(cloud, point, &normal, cylinder);
                        expected.push((normal, clouds.map(heights)));
                    }
                    let (normal, heights_m) = &expected[i];
                    let (distance, lod, counts) = brute(heights_m, &settings);
                    assert!(
                        (at.normal - normal).norm() <= 1e-15 || normal.x.is_nan(),
                        "{}",
                        what()
                    );
                    let ours = [at.reference_count, at.compared_count].map(|n| n as usize);
                    assert_eq!(ours, counts, "{}", what());
                    assert!(
                        same(at.distance_m, distance) && same(at.level_of_detection_m, lod),
                        "{}: {} {distance}, {} {lod}",
                        what(),
                        at.distance_m,
                        at.level_of_detection_m
                    );
                    compared += 1;
                    nothing += usize::from(counts[1] == 0);
                    single += usize::from(distance.is_finite() && lod.is_nan());
                    known += usize::from(lod > 0.0);
                }
            }
        }
    }
    println!("{compared} comparisons, {known} with a level of detection, {single} without");
    assert!(nothing > compared / 20 && single > 100 && known > compared / 3);
}

#[test]
fn normals_agree_with_the_definition() {
    let settings = ComparisonSettings {
        normal_radii_m: vec![0.09375, 0.1875],
        cylinder_radius_m: 0.0625,
        max_distance_m: 0.125,
        ..ComparisonSettings::default()
    };
    let (mut worst, mut without_normal) = (0.0f64, 0);
    for Case {
        name,
        reference,
        compared,
        core,
    } in cases()
    {
        let normals = Normals::UPWARDS;
        let result = m3c2(&reference, &compared, &core, normals, &settings, &Silent).unwrap();
        for (at, point) in result.core.iter().zip(&core) {
            let Some((normal, radius, lead)) =
                brute_normal(&reference, point, &settings.normal_radii_m)
            else {
                assert!(
                    at.normal.x.is_nan() && at.normal_radius_m.is_nan(),
                    "{name}"
                );
                assert_eq!((at.reference_count, at.compared_count), (0, 0));
                without_normal += 1;
                continue;
            };
            // On the grid, neighbourhoods have several planes of symmetry, and equal eigenvalues tie.
            if name == "gridded" || lead < 1e-6 {
                continue;
            }
            assert_eq!(at.normal_radius_m, radius, "{name}");
            worst = worst.max(at.normal.cross(&normal).norm());
        }
    }
    println!("normals within {worst:.1e} rad of nalgebra's, {without_normal} without");
    assert!(worst < 1e-12 && without_normal > 0);
}

#[test]
fn pieces_of_clouds_give_the_same_bits_as_the_whole() {
    let short = ComparisonSettings {
        normal_radii_m: vec![0.05, 0.1],
        cylinder_radius_m: 0.0625,
        max_distance_m: 0.125,
        ..ComparisonSettings::default()
    };
    let long = ComparisonSettings {
        cylinder_radius_m: 0.03125,
        max_distance_m: 0.3,
        ..short.clone()
    };
    let mut smaller = 0;
    for settings in [short, long] {
        for case in cases() {
            smaller += pieces(&case, &settings);
        }
    }
    assert!(smaller > 100, "{smaller}");
}

/// Compares pieces with the whole; returns how many pieces are smaller than the whole.
fn pieces(case: &Case, settings: &ComparisonSettings) -> usize {
    let Case {
        name,
        reference,
        compared,
        core,
    } = case;
    let halo = reach_m(settings);
    let normals = Normals::UPWARDS;
    let whole = m3c2(reference, compared, core, normals, settings, &Silent).unwrap();
    let mut smaller = 0;
    for (i, point) in core.iter().enumerate().step_by(7) {
        let near = |cloud: &[Vec3]| -> Vec<Vec3> {
            let mut near = cloud.to_vec();
            near.retain(|p| (p - point).amax() <= halo);
            near
        };
        let (before, after) = (near(reference), near(compared));
        smaller += usize::from(before.len() < reference.len());
        let clouds = IndexedClouds::of_pieces(&before, &after, normals, settings).unwrap();
        let piece = clouds.distances(&core[i..=i], normals, &Silent).unwrap();
        let [piece, whole] = [&piece, &whole].map(|result| &result.core);
        assert_eq!(
            format!("{:?}", piece[0]),
            format!("{:?}", whole[i]),
            "{name}"
        );
    }
    smaller
}

/// Makes the same points as `m3c2/robust.py`.
struct Congruential(u32);

impl Congruential {
    fn draw(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(self.0) / 4_294_967_296.0
    }

    fn surface(&mut self, n: usize, offset: f64) -> Vec<Vec3> {
        let point = |_| {
            let [x, y, noise] = [self.draw(), self.draw(), self.draw()];
            Vec3::new(x, y, 0.25 * x * x + offset + 0.03125 * (noise - 0.5))
        };
        (0..n).map(point).collect()
    }
}

#[test]
fn robust_m3c2_equals_py4dgeo() {
    let mut points = Congruential(1);
    let reference = points.surface(900, 0.0);
    let compared = points.surface(700, 0.0078125);
    let core = points.surface(120, 0.0);
    let normals: Vec<Vec3> = core
        .iter()
        .map(|point| Vec3::new(-0.5 * point.x, 0.0, 1.0))
        .collect();
    let settings = ComparisonSettings {
        cylinder_radius_m: 0.0625,
        max_distance_m: 0.125,
        registration_error_m: 0.001,
        aggregation: Aggregation::Median,
        ..ComparisonSettings::default()
    };
    let normals = Normals::Given(&normals);
    let result = m3c2(&reference, &compared, &core, normals, &settings, &Silent).unwrap();
    let table = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/m3c2/robust.csv");
    let table = numbers(&table);
    assert_eq!(table.len(), core.len());
    let mut worst = 0.0f64;
    for (at, row) in result.core.iter().zip(&table) {
        assert_eq!(
            [at.reference_count, at.compared_count].map(f64::from),
            row[4..]
        );
        let ours = [
            at.distance_m,
            at.level_of_detection_m,
            at.reference_spread_m,
            at.compared_spread_m,
        ];
        for (ours, theirs) in ours.iter().zip(row) {
            // For a single point the range is 0 in py4dgeo and NaN here.
            if ours.is_nan() {
                assert!(at.reference_count.min(at.compared_count) < 2);
            } else {
                worst = worst.max((ours - theirs).abs());
            }
        }
    }
    println!("median, range and level of detection within {worst:.1e} m, counts equal");
    assert!(worst < 1e-15);
}
