//! Rows and surfels against loops over all points.

use super::case::{Case, SURFEL_M};
use crate::cloud::voxel::{VoxelKey, voxel_key};
use crate::geometry::{Mat3, Vec3};
use crate::joint::keyframes::thinned;
use crate::joint::problem::JointProblem;
use crate::joint::state::State;
use crate::joint::surfel::{Association, ScanRow};
use std::collections::{BTreeMap, BTreeSet};

/// Distance of the points of a row from their scanner along the normal, with the pose of the middle profile.
fn depth_m(problem: &JointProblem<'_>, state: &State, step: usize, row: &ScanRow) -> f64 {
    let points = problem.association.drives[0].points_of(row);
    let scanner = row.scanner as usize;
    let sample = problem.input.drives[0].scans.samples[scanner];
    let middle = points[points.len() / 2].profile as usize;
    let time_s = sample.profiles[middle].time_s - state.late_s[scanner];
    let pose = state.motions[0].poses(step).at(time_s).world_from_body;
    let mounting = state.mountings[scanner].body_from_scanner;
    let depths = points.iter().map(|point| {
        let arm_m = pose.rotation * (mounting.rotation * point.position_m);
        point.weight * problem.association.surfels[row.surfel as usize].axes[0].dot(&arm_m)
    });
    depths.sum::<f64>() / points.iter().map(|point| point.weight).sum::<f64>()
}

/// Residuals of the scan rows, metres, one point after the other; the points were sorted at `start`.
fn one_by_one(problem: &JointProblem<'_>, start: &State, state: &State) -> Vec<f64> {
    let motion = state.motions[0].as_ref();
    let drive = &problem.association.drives[0];
    let samples = &problem.input.drives[0].scans.samples;
    let mut all = Vec::new();
    for step in 0..motion.steps() {
        let poses = motion.poses(step);
        for row in drive.of_step(step) {
            let scanner = row.scanner as usize;
            let surfel = &problem.association.surfels[row.surfel as usize];
            let shape = state.shapes[row.surfel as usize];
            let distances = drive.points_of(row).iter().map(|point| {
                let profile = &samples[scanner].profiles[point.profile as usize];
                let pose = poses.at(profile.time_s - state.late_s[scanner]);
                let mounting = state.mountings[scanner].body_from_scanner;
                let world_m = pose.world_from_body.map(&mounting.map(&point.position_m));
                let [n, u, v] = surfel
                    .axes
                    .map(|axis| axis.dot(&(world_m - surfel.centre_m)));
                point.weight * (n - (shape.x + shape.y * u + shape.z * v))
            });
            let weight: f64 = drive.points_of(row).iter().map(|point| point.weight).sum();
            let [before_m, now_m] = [start, state].map(|state| depth_m(problem, state, step, row));
            all.push(distances.sum::<f64>() / weight * before_m / now_m);
        }
    }
    all
}

#[test]
fn a_row_is_the_mean_of_its_points() {
    for case in [Case::full(), Case::from_file()] {
        let input = case.input();
        let (problem, state) = case.problem(&input);
        let step: Vec<f64> = (0..problem.unknowns())
            .map(|i| 1e-3 * (1.7 * i as f64).sin())
            .collect();
        let start = state;
        let state = problem.retracted(&start, &step);
        let slow = one_by_one(&problem, &start, &state);
        let mut fast = Vec::new();
        let of_scans = problem.groups.first_scan..problem.groups.first_reference;
        problem.visit(&state, |batch| {
            let rows = batch.rows().filter(|row| of_scans.contains(&row.group));
            fast.extend(rows.map(|row| row.residual));
        });
        let sigmas_m = problem.association.drives[0]
            .rows
            .iter()
            .map(|row| problem.noise(&state, 0, row).1);
        assert_eq!(fast.len(), slow.len());
        for ((fast, sigma_m), slow) in fast.iter().zip(sigmas_m).zip(&slow) {
            // Rounding of sums of about a metre.
            assert!((fast * sigma_m - slow).abs() < 1e-14, "{slow}");
        }
    }
}

struct Point {
    world_m: Vec3,
    /// Step and scanner; `None` for a point of the reference.
    seen: Option<(u32, u32)>,
}

fn normal_axis(points: &[&Point]) -> Option<usize> {
    let (_, covariance) = moments(points);
    let eigen = covariance.symmetric_eigen();
    let least = eigen.eigenvalues.imin();
    (points.len() >= 12).then(|| eigen.eigenvectors.column(least).iamax())
}

fn moments(points: &[&Point]) -> (Vec3, Mat3) {
    let n = points.len() as f64;
    let mean = points.iter().map(|p| p.world_m).sum::<Vec3>() / n;
    let offsets = points.iter().map(|p| p.world_m - mean);
    (mean, offsets.map(|d| d * d.transpose()).sum::<Mat3>() / n)
}

/// Sets of voxels that hold one surface: each pair of voxels is tested whether one continues the other, and
/// connected voxels form a set.
fn surfaces(cells: &BTreeMap<VoxelKey, Vec<&Point>>) -> Vec<BTreeSet<VoxelKey>> {
    let normal_of = |key: &VoxelKey| cells.get(key).and_then(|points| normal_axis(points));
    let scanned = |key: &VoxelKey| {
        cells
            .get(key)
            .is_some_and(|points| points.iter().any(|p| p.seen.is_some()))
    };
    let moved = |key: &VoxelKey, axis: usize, by: i64| {
        let mut next = *key;
        next[axis] += by;
        next
    };
    let keys: Vec<VoxelKey> = cells.keys().copied().filter(scanned).collect();
    let axis: BTreeMap<VoxelKey, usize> = keys
        .iter()
        .filter_map(|key| {
            let across = |axis: &usize| {
                [-1, 1].iter().any(|&by| {
                    let next = moved(key, *axis, by);
                    scanned(&next) && normal_of(&next) == Some(*axis)
                })
            };
            Some((*key, normal_of(key).or_else(|| (0..3).rev().find(across))?))
        })
        .collect();
    let mut left: BTreeSet<VoxelKey> = axis.keys().copied().collect();
    let mut surfaces = Vec::new();
    while let Some(first) = left.pop_first() {
        let mut members = BTreeSet::from([first]);
        loop {
            let next = left.iter().copied().find(|key| {
                let joins = |by| {
                    let beside = moved(key, axis[key], by);
                    members.contains(&beside) && axis[&beside] == axis[key]
                };
                joins(-1) || joins(1)
            });
            let Some(next) = next else { break };
            left.remove(&next);
            members.insert(next);
        }
        surfaces.push(members);
    }
    surfaces
}

#[test]
fn surfels_and_rows_are_those_of_a_loop_over_all_points() {
    let misfit_m = 0.005;
    for case in [Case::plain(), Case::from_file()] {
        let input = case.input();
        let state = case.state();
        let motion = state.motions[0].as_ref();
        let mut points: Vec<Point> = case
            .reference
            .iter()
            .map(|&world_m| Point {
                world_m,
                seen: None,
            })
            .collect();
        for (scanner, sample) in case.samples.iter().enumerate() {
            for point in &sample.points {
                let time_s = sample.profiles[point.profile as usize].time_s;
                let Some(step) = motion.step_at(time_s) else {
                    continue;
                };
                let pose = motion.poses(step).at(time_s).world_from_body;
                let mounting = state.mountings[scanner].body_from_scanner;
                points.push(Point {
                    world_m: pose.map(&mounting.map(&point.position_m)),
                    seen: Some((step as u32, scanner as u32)),
                });
            }
        }
        let mut cells: BTreeMap<VoxelKey, Vec<&Point>> = BTreeMap::new();
        for point in &points {
            let key = voxel_key(&point.world_m, SURFEL_M);
            cells.entry(key).or_default().push(point);
        }

        // Centre, roughness, and the rows: step, scanner, points.
        type Members = Vec<(u32, u32, u32)>;
        let mut expected: Vec<(Vec3, f64, Members)> = Vec::new();
        for keys in surfaces(&cells) {
            let all: Vec<&Point> = keys.iter().flat_map(|k| cells[k].iter().copied()).collect();
            let (scanned, known): (Vec<&Point>, Vec<&Point>) =
                all.iter().partition(|p| p.seen.is_some());
            let has_reference = known.len() >= 12;
            let fitted = if has_reference { &known } else { &scanned };
            if fitted.len() < 12 {
                continue;
            }
            let (centre_m, covariance) = moments(fitted);
            let eigen = covariance.symmetric_eigen();
            let mut order = [0, 1, 2];
            order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
            let [roughness_m, width_m, _] = order.map(|i| eigen.eigenvalues[i].max(0.0).sqrt());
            let normal = eigen.eigenvectors.column(order[0]).into_owned();
            let misfit = if has_reference { 0.0 } else { misfit_m };
            if width_m < 0.12 * SURFEL_M || roughness_m > 0.4 * width_m + misfit {
                continue;
            }
            let gate_m = (4.0 * roughness_m.hypot(misfit_m)).min(0.6 * SURFEL_M);
            let mut rows: BTreeMap<(u32, u32), u32> = BTreeMap::new();
            for point in &scanned {
                let distance_m = normal.dot(&(point.world_m - centre_m)).abs();
                if let (Some(seen), true) = (point.seen, distance_m < gate_m) {
                    *rows.entry(seen).or_default() += 1;
                }
            }
            let rows: Vec<(u32, u32, u32)> = rows
                .into_iter()
                .filter(|(_, count)| *count >= 3)
                .map(|((step, scanner), count)| (step, scanner, count))
                .collect();
            if rows.len() >= if has_reference { 1 } else { 4 } {
                expected.push((centre_m, roughness_m, rows));
            }
        }

        let association = case.associated(&input, misfit_m);
        assert_eq!(association.surfels.len(), expected.len());
        assert!(expected.len() > 40, "{}", expected.len());
        let mut rows_of: Vec<Vec<(u32, u32, u32)>> = vec![Vec::new(); expected.len()];
        for step in 0..motion.steps() {
            for row in association.drives[0].of_step(step) {
                rows_of[row.surfel as usize].push((step as u32, row.scanner, row.count));
            }
        }
        for (surfel, mut rows) in association.surfels.iter().zip(rows_of) {
            rows.sort_unstable();
            let near = expected
                .iter()
                .find(|(centre_m, ..)| (centre_m - surfel.centre_m).norm() < 1e-9);
            let (_, roughness_m, expected) = near.expect("a surface at the same place");
            // Sums about the centre of a voxel against those about the mean: squares of decimetres
            // rounded to 1e-16, against a tenth of a millimetre squared.
            assert!((roughness_m - surfel.roughness_m).abs() < 1e-9);
            assert_eq!(&rows, expected);
        }
    }
}

#[test]
fn between_keyframes_a_scanner_has_no_rows() {
    let case = Case::full();
    let input = case.input();
    let all = case.associated(&input, 0.002);
    let association = case.associated_at(&input, 0.002, vec![1, 4]);
    let rows_of = |step: usize, scanner: u32, association: &Association| {
        let rows = association.drives[0].of_step(step).iter();
        rows.filter(|row| row.scanner == scanner).count()
    };
    let steps = all.drives[0].step_start.len() - 1;
    let mut with_rows = 0;
    for first in (0..steps).step_by(4) {
        let window = first..(first + 4).min(steps);
        let keyframes = window
            .clone()
            .filter(|&step| rows_of(step, 1, &association) > 0);
        assert!(keyframes.clone().count() <= 1);
        for keyframe in keyframes {
            with_rows += 1;
            let most = window.clone().map(|step| rows_of(step, 1, &all)).max();
            assert_eq!(Some(rows_of(keyframe, 1, &all)), most);
        }
    }
    assert!(with_rows > 2, "{with_rows} keyframes");
    let of_left = |association: &Association| {
        (0..steps)
            .map(|step| rows_of(step, 0, association))
            .sum::<usize>()
    };
    assert!(of_left(&association) > of_left(&all) * 9 / 10);
}

#[test]
fn keyframes_are_taken_from_the_scanner_that_sees_surfels_from_the_most_steps() {
    let case = Case::full();
    let input = case.input();
    let mut association = case.associated(&input, 0.002);
    let rows = &mut association.drives[0].rows;
    rows.iter_mut().for_each(|row| row.scanner = 0);
    // The second scanner sees one surfel from five steps, and the first, which has more rows, each from one.
    rows.truncate(12);
    (0..).zip(rows.iter_mut()).for_each(|(at, row)| {
        row.scanner = u32::from(at >= 7);
        row.surfel = at.min(7);
    });
    assert_eq!(thinned(&association, &[1, 1]), Some(vec![1, 2]));
    assert_eq!(thinned(&association, &[1, 64]), Some(vec![2, 64]));
    assert_eq!(thinned(&association, &[64, 64]), None);
}

#[test]
fn a_sparse_scanner_has_its_own_noise_where_a_better_one_sees_the_same() {
    const NOISE_M: f64 = 0.005;
    let mut case = Case::plain();
    let sparse = &mut case.samples[1];
    let points = std::mem::take(&mut sparse.points);
    for (k, mut point) in points.into_iter().step_by(40).enumerate() {
        let range_m = point.position_m.norm();
        let added_m = if k % 2 == 0 { NOISE_M } else { -NOISE_M };
        point.position_m *= 1.0 + added_m / range_m;
        sparse.points.push(point);
    }
    let input = case.input();
    let association = case.associated(&input, NOISE_M);
    let of = |scanner: u32| association.rows().filter(move |row| row.scanner == scanner);
    let surfel = |row: &ScanRow| &association.surfels[row.surfel as usize];
    assert!(of(0).count() > 50 && of(1).count() > 20);
    assert!(of(0).all(|row| row.scatter_m == surfel(row).scatter_m));
    // Along the normal, the noise is less by the cosine of the incidence.
    let is_own = |row: &ScanRow| (0.5 * NOISE_M..1.5 * NOISE_M).contains(&row.scatter_m);
    assert!(of(1).all(|row| is_own(row) && surfel(row).scatter_m < 0.2 * NOISE_M));
}
