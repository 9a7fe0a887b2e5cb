//! Uncertainties if mountings move. Points on the ground are known better than poses and mountings, whose errors
//! compensate each other, and part of what is known of the mountings rests on their priors alone.

use rayon::prelude::*;

use super::covariance::Covariance;
use super::problem::JointProblem;
use super::result::KnownPoint;
use super::row::RowBatch;
use super::scan::StepScans;
use super::state::State;
use crate::geometry::Vec3;

/// Number of points of each scanner of a drive whose uncertainty is computed.
const POINTS: usize = 400;

/// Standard deviations of points spread evenly over the rows of a drive, of each scanner.
///
/// A point x_m = t_mb + R_mb (t_bs + R_bs x_s) has the covariance J P Jᵀ with the derivatives J by all unknowns
/// that place it. Its row couples all of these unknowns, so P is among the selected parts of the inverse.
pub fn known_points(
    covariance: &Covariance<'_>,
    state: &State,
    drive: usize,
) -> Vec<Vec<KnownPoint>> {
    let problem = covariance.problem;
    let motion = state.motions[drive].as_ref();
    let context = problem.scan_context(drive, state);
    let blocks = problem.scan_blocks(drive, &covariance.slow.blocks(problem, drive));
    let count = state.mountings.len();
    let rows = (0..motion.steps()).flat_map(|step| {
        context
            .rows
            .of_step(step)
            .iter()
            .map(move |row| (step, row))
    });
    let mut rows_by_scanner = vec![Vec::new(); count];
    rows.for_each(|(step, row)| rows_by_scanner[row.scanner as usize].push((step, row)));
    let known = rows_by_scanner
        .into_iter()
        .enumerate()
        .map(|(scanner, rows)| {
            let every = rows.len().div_ceil(POINTS).max(1);
            let chosen: Vec<_> = rows.into_iter().step_by(every).collect();
            let known = chosen.into_par_iter().filter_map(|(step, row)| {
                let point = &context.rows.points_of(row)[..1];
                let poses = motion.poses(step);
                let scans = StepScans::new(&context, &poses, std::slice::from_ref(row));
                let blocks = blocks.of_step(motion, step);
                let mut variance = Vec3::zeros();
                let mut time_s = 0.0;
                for axis in 0..3 {
                    let direction = Vec3::ith(axis, 1.0);
                    let (_, _, mean) = scans.along(scanner, &direction, &Vec3::zeros(), point);
                    time_s = mean.time_s;
                    let mut batch = RowBatch::default();
                    batch.begin(0, 1.0, 0.0);
                    scans.place(scanner, &mean, 1.0, &blocks, &mut batch);
                    variance[axis] = covariance.of_row(&batch.rows().next()?, drive)?;
                }
                Some(KnownPoint {
                    time_s,
                    in_scanner_m: point[0].position_m,
                    sigma_m: variance.map(|x| x.max(0.0).sqrt()),
                })
            });
            known.collect()
        });
    known.collect()
}

/// The share of each variance of all mountings, (δp, δφ), that rests on the priors of compliance and of the
/// motion in time; empty if mountings are rigid.
///
/// With the rows J of these priors, their errors contribute ‖J H⁻¹ g‖² to the variance gᵀ H⁻¹ g.
pub fn prior_shares(problem: &JointProblem<'_>, state: &State) -> Vec<f64> {
    let (Some(factor), true) = (problem.factor(), state.bends.is_some()) else {
        return Vec::new();
    };
    let unknowns = problem.unknowns();
    let mountings = problem.layout.mountings.iter();
    // The unknowns are (δφ, δp).
    let places =
        mountings.flat_map(|&block| (0..6).map(move |i| problem.offset(block) + (i + 3) % 6));
    let places: Vec<usize> = places.collect();
    let mut sides = vec![0.0; unknowns * places.len()];
    for (side, place) in sides.chunks_exact_mut(unknowns).zip(&places) {
        side[*place] = 1.0;
    }
    factor.solve(&mut sides, places.len());
    let mut batch = RowBatch::default();
    problem.bending(state, &mut batch);
    let mut row_places = Vec::new();
    let mut shares = vec![0.0; places.len()];
    for row in batch.rows() {
        problem.places(&row, &mut row_places);
        for (share, side) in shares.iter_mut().zip(sides.chunks_exact(unknowns)) {
            let terms = row_places
                .iter()
                .zip(row.by)
                .map(|(place, by)| by * side[*place]);
            *share += terms.sum::<f64>().powi(2);
        }
    }
    let variances = sides.chunks_exact(unknowns).zip(&places);
    let variances = variances.map(|(side, place)| side[*place]);
    shares
        .iter()
        .zip(variances)
        .map(|(share, variance)| share / variance)
        .collect()
}
