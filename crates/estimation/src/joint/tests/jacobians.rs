//! Every derivative of every row against central differences.

use super::case::Case;
use super::rows::{Dense, residuals};
use crate::calibration::Mounting;
use crate::geometry::{EulerConvention, Vec3};
use crate::joint::problem::JointProblem;
use crate::joint::state::State;
use crate::joint::{JointInput, Rung};
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeMap;

/// Metres, radians, seconds, slopes.
const STEP: f64 = 1e-5;

/// Central differences of all residuals by one unknown.
fn differences(problem: &JointProblem<'_>, state: &State, unknown: usize) -> DVector<f64> {
    let mut step = vec![0.0; problem.unknowns()];
    let mut at = |h: f64| {
        step[unknown] = h;
        residuals(problem, &problem.retracted(state, &step))
    };
    (at(STEP) - at(-STEP)) / (2.0 * STEP)
}

/// Of the kinds of which a drive has many blocks, every third component of a block is compared, another one of the next
/// block.
fn is_compared(kind: &str, block: usize, component: usize) -> bool {
    let is_frequent = ["node", "bias", "correction", "surfel"].contains(&kind);
    !is_frequent || (block + component).is_multiple_of(3)
}

/// The kind of unknowns of a block.
fn kind(problem: &JointProblem<'_>, block: usize) -> &'static str {
    let layout = &problem.layout;
    let has_biases = problem.groups.names[0] == "imu";
    match block {
        b if b < layout.first_surfel => match layout.sizes[b] {
            9 => "node",
            6 if has_biases => "bias",
            6 => "correction",
            _ => "error or bridge",
        },
        b if b < layout.first_patch => "surfel",
        b if b < layout.first_plane => "patch",
        b if b < layout.first_plane + problem.association.planes.len() => "plane",
        b if layout.compliance.contains(&b) => "bending",
        b if layout.knots.iter().flatten().any(|&first| b >= first) && b < layout.last() => {
            "bending"
        }
        b if Some(b) == layout.reference => "reference",
        b if layout.mountings.contains(&b) => "mounting",
        b if layout.of_scanners.late.contains(&Some(b)) => "latency",
        _ => "constant",
    }
}

/// Metres of a surfel's height per unit of a row's residual; 1 for rows without a surfel. The weights of scan rows
/// depend on the variance that knots leave out, derivatives of heights do not.
fn height_per_unit(problem: &JointProblem<'_>, dense: &Dense, row: usize) -> f64 {
    let layout = &problem.layout;
    let heights = (layout.first_surfel..layout.first_patch).map(|block| problem.offset(block));
    let by_height = heights.map(|column| dense.jacobian[(row, column)].abs());
    match by_height.fold(0.0, f64::max) {
        0.0 => 1.0,
        by_height => by_height.recip(),
    }
}

/// Largest error of a derivative, as a share of the largest derivative of rows of the same group by
/// the same component of the same kind of unknown, and both.
type Worst = BTreeMap<(String, &'static str), (f64, f64, f64)>;

fn worst(problem: &JointProblem<'_>, state: &State) -> Worst {
    let dense = Dense::new(problem, state);
    let units: Vec<f64> = (0..dense.groups.len())
        .map(|row| height_per_unit(problem, &dense, row))
        .collect();
    let mut of_component: BTreeMap<(String, &'static str, usize), (f64, f64)> = BTreeMap::new();
    for (block, &size) in problem.layout.sizes.iter().enumerate() {
        let kind = kind(problem, block);
        for component in (0..size).filter(|&component| is_compared(kind, block, component)) {
            let column = problem.offset(block) + component;
            let numeric = differences(problem, state, column);
            for (row, &group) in dense.groups.iter().enumerate() {
                let analytic = dense.jacobian[(row, column)];
                let error = (analytic - numeric[row]).abs();
                // Neglected derivatives count in standard deviations.
                let unit = if kind == "bias" { 1.0 } else { units[row] };
                let [error, analytic] = [error, analytic.abs()].map(|x| x * unit);
                let name = problem.groups.names[group].clone();
                let entry = of_component.entry((name, kind, component));
                let entry = entry.or_default();
                *entry = (entry.0.max(error), entry.1.max(analytic));
            }
        }
    }
    let mut all = Worst::new();
    for ((group, kind, _), (error, size)) in of_component {
        let entry = all.entry((group, kind)).or_default();
        let share = if error > 0.0 { error / size } else { 0.0 };
        if share >= entry.0 {
            *entry = (share, error, size);
        }
    }
    all
}

/// A state away from the start by this many metres and radians, which reveals derivatives that are exact only for a
/// zero correction.
fn off(problem: &JointProblem<'_>, state: &State, by: f64) -> State {
    let step: Vec<f64> = (0..problem.unknowns())
        .map(|i| by * (1.7 * i as f64).sin())
        .collect();
    problem.retracted(state, &step)
}

/// Differences of residuals of up to 1e5 per unit are rounded to some 1e-10 of the largest.
const ROUNDING: f64 = 1e-8;
/// Derivatives of poses between nodes assume that the closing error of the IMU's sums is small, and those of
/// corrected poses that the correction is small. Neighbours are off by twice as much, in each of three components,
/// and velocities by the difference of positions over a fifth of a second: ten times the offset in all.
const PER_OFFSET: f64 = 10.0;
/// Between samples of the IMU, δ = 0.01 s apart, shares of the nodes are straight lines. That of a node's velocity is
/// some t (1 − t/T)², off by δ²/8 · 4/T: metres of a row per m/s, in the first step, whose T is 0.1037 s. The others
/// are twice as long.
const BETWEEN_SAMPLES_M: f64 = 4.9e-4;
/// Between poses, derivatives are interpolated as if the poses did not turn. They turn by 0.05 rad from pose to
/// pose of the file, of which there are four in a step.
const TURNED_IN_FILE: f64 = 1e-2;
/// The change of a row's depth with a bending is neglected: a residual over the depth, millimetres over decimetres.
const BENT: f64 = 1e-2;
/// Positions between samples of the IMU are on a cubic, while velocities are joined by straight lines.
const BY_TIME: f64 = 2e-3;
/// The wide priors of mountings, 1 m and 1 rad, assume a small change from the start: it is some milliradians.
const BY_CHANGE: f64 = 2e-3;
/// The same for the prior of the first node, whose change is some hundredths of a radian.
const FROM_START: f64 = 5e-2;

#[test]
fn every_row_meets_finite_differences() {
    let mut failed = Vec::new();
    let moving = ("mountings that move", Case::moving());
    for (name, case) in Case::all().into_iter().chain([moving]) {
        let input = case.input();
        let (problem, start) = case.problem_with_plane(&input);
        for by in [0.0, 1e-3] {
            let state = off(&problem, &start, by);
            for ((group, kind), (share, error, size)) in worst(&problem, &state) {
                let what = format!("{name}, off by {by}, {group} by {kind}");
                if error > 0.0 {
                    println!("{what}: {share:.1e}, {error:.2e} of {size:.2e}");
                }
                let of_scans = ["left", "lidar"].contains(&group.as_str());
                let allowed = match (of_scans, kind) {
                    (true, "node" | "error or bridge") => {
                        BETWEEN_SAMPLES_M / size + PER_OFFSET * by
                    }
                    (true, "bending") => BENT + PER_OFFSET * by,
                    // Derivatives by rotations of the mean neglect its bending.
                    (true, "mounting") if case.settings.mounting.least > Rung::Rigid => {
                        ROUNDING + PER_OFFSET * by
                    }
                    (true, "correction") => TURNED_IN_FILE + PER_OFFSET * by,
                    // For a velocity along the normal of some centimetres per second.
                    (true, "latency") => BY_TIME + 10.0 * PER_OFFSET * by,
                    (true, "bias") => {
                        // Neglected. During an adjustment, biases change by 1e-3 rad/s or 1e-2 m/s² at
                        // most, which changes a row by less than a twentieth of its standard
                        // deviation.
                        assert!(error * 1e-2 < 0.05, "{what}: {error}");
                        continue;
                    }
                    // Held if its errors are assumed to be zero.
                    (false, "patch") if case.surface_m == 0.0 => continue,
                    (false, "mounting") => BY_CHANGE,
                    (false, "node") if group == "assumed" => FROM_START,
                    _ => ROUNDING,
                };
                if share >= allowed {
                    failed.push(format!("{what}: {share:e} > {allowed:e}"));
                }
            }
        }
    }
    assert!(failed.is_empty(), "{failed:#?}");
}

/// Longer ranges move the points of a row along their own rays, which differ by some degrees from the mean.
#[test]
fn the_derivative_by_ranges_meets_finite_differences() {
    let case = Case::plain();
    let input = case.input();
    let (mut problem, state) = case.problem(&input);
    let by_range = problem.each_mean(&state, |_, row, mean| (row.depth_m, mean.by_range));
    let mut at = |longer_m: f64| {
        for drive in &mut problem.association.drives {
            for point in &mut drive.points {
                point.position_m += point.position_m.normalize() * longer_m;
            }
        }
        problem.each_mean(&state, |_, _, mean| mean.residual_m * mean.depth_m)
    };
    let (plus, minus) = (at(STEP), at(-2.0 * STEP));
    for ((plus, minus), (depth_m, by_range)) in plus.iter().zip(&minus).zip(by_range) {
        let numeric = (plus - minus) / (2.0 * STEP * depth_m);
        assert!((numeric - by_range).abs() < 0.01, "{numeric} {by_range}");
    }
}

#[test]
fn an_angle_that_is_held_meets_finite_differences_far_from_its_start() {
    for convention in [EulerConvention::Zyx, EulerConvention::Bonn] {
        let mut case = Case::plain();
        for mounting in &mut case.mountings {
            *mounting = Mounting {
                convention,
                fixed: [false, true, false, true, false, true],
                ..mounting.clone()
            };
        }
        let input = case.input();
        let (problem, mut state) = case.problem(&input);
        // As a step would move them if the angles were not held.
        for mounting in &mut state.mountings {
            turn(
                mounting,
                Vec3::new(0.03, -0.02, 0.04),
                Vec3::new(0.01, 0.02, 0.03),
            );
        }
        assert_held(&problem, &state, 1e8);
    }
}

#[test]
fn priors_of_mountings_meet_finite_differences_far_from_initial_values() {
    let case = Case::plain();
    let mut initial = case.mountings.clone();
    for mounting in &mut initial {
        turn(
            mounting,
            Vec3::new(0.06, -0.1, 0.08),
            Vec3::new(0.05, 0.02, 0.0),
        );
    }
    let held = [DVector::from_fn(12, |row, _| 0.3 * (row as f64 - 4.0))];
    let input = JointInput {
        initial: &initial,
        held: &held,
        ..case.input()
    };
    let (mut problem, state) = case.problem(&input);
    assert_held(&problem, &state, 1e4);
    // A held direction is off by as much as initial values are, and takes the other unknowns along.
    problem.factorise(&state).expect("a factor");
    let side = &problem.sides_of_held(&state)[0];
    let mountings = problem.layout.mountings.iter();
    let parts = mountings.flat_map(|&block| {
        let first = problem.offset(block);
        [3, 4, 5, 0, 1, 2].map(|i| side[first + i])
    });
    let off = held[0].dot(&DVector::from_iterator(12, parts));
    // The turns of 0.1 rad from initial values change what is held by a part of this.
    assert!((off - 1.0).abs() < 0.1, "{off}");
}

fn turn(mounting: &mut Mounting, turn: Vec3, shift: Vec3) {
    let pose = &mut mounting.body_from_scanner;
    *pose = pose.perturbed(&turn, &shift);
}

/// Moves all mountings at once, and compares the assumed rows, of which those of what is held have this weight.
fn assert_held(problem: &JointProblem<'_>, state: &State, weight: f64) {
    let dense = Dense::new(problem, state);
    let rows = dense.groups.iter().enumerate();
    let rows = rows.filter(|(_, group)| **group == problem.groups.assumed);
    let rows: Vec<usize> = rows.map(|(row, _)| row).collect();
    for unknown in 0..6 {
        let at = |h: f64| {
            let mut state = state.clone();
            let mut step = [0.0; 6];
            step[unknown] = h;
            let [by, shift] = [0, 3].map(|first| Vec3::from_column_slice(&step[first..first + 3]));
            state.mountings.iter_mut().for_each(|m| turn(m, by, shift));
            residuals(problem, &state)
        };
        let numeric = (at(STEP) - at(-STEP)) / (2.0 * STEP);
        for &row in &rows {
            let blocks = problem.layout.mountings.iter();
            let by = blocks.map(|&block| dense.jacobian[(row, problem.offset(block) + unknown)]);
            let analytic: f64 = by.sum();
            let error = (numeric[row] - analytic).abs();
            // Angles are in degrees: rounding of 1e-14 over a step of 1e-5.
            let wide = analytic.abs() <= 1.0 && numeric[row].abs() < 2.0;
            let allowed = if wide { 0.1 } else { 1e-8 * weight };
            assert!(error < allowed, "{unknown} {row}: {error} {analytic}");
        }
    }
}

/// A mounting that another adjustment knows, with its covariance.
#[test]
fn the_prior_of_known_mountings_meets_finite_differences() {
    let sigma = DMatrix::from_fn(12, 12, |i, j| {
        let off = 0.3 / (1.0 + (i as f64 - j as f64).abs());
        1e-8 * if i == j { 1.0 } else { off }
    });
    let case = Case {
        known: Some(sigma.clone()),
        ..Case::plain()
    };
    let input = case.input();
    let (problem, state) = case.problem(&input);
    // At the start, where the change is zero.
    let known = worst(&problem, &state);
    let (share, ..) = known[&("assumed".to_owned(), "mounting")];
    assert!(share < ROUNDING, "{share:e}");
    // Apart from this there is only the wide prior.
    let dense = Dense::new(&problem, &state);
    let first = problem.offset(problem.layout.mountings[0]);
    let rows = (0..dense.groups.len()).filter(|&row| dense.groups[row] == problem.groups.assumed);
    let rows: Vec<_> = rows
        .map(|row| dense.jacobian.row(row).columns(first, 12).into_owned())
        .collect();
    let all = DMatrix::from_rows(&rows);
    let information = all.tr_mul(&all) - DMatrix::identity(12, 12);
    // (δφ, δp) against (δp, δφ).
    let swap = |i: usize| 6 * (i / 6) + (i + 3) % 6;
    let expected = sigma.try_inverse().expect("positive definite");
    let expected = DMatrix::from_fn(12, 12, |i, j| expected[(swap(i), swap(j))]);
    let off = (information - &expected).amax() / expected.amax();
    // The covariance has (10 nm)² added, a hundred-millionth of it.
    assert!(off < 1e-7, "{off:e}");
}
