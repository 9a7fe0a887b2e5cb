//! Alignment of clouds that may lie apart, on coarse scales.
//!
//! Neighbourhoods of the nearest points are flat where the clouds agree, but also where they have separated, so that
//! each contains points of only one cloud, and where a turn of the fan out of its plane has reduced the relief; coarse
//! ones also where a small board no longer lies above the ground. Their thickness alone therefore leads astray. Here a
//! neighbourhood holds points of every cloud around its centre, a cloud being one pass of one scanner, or the reference;
//! and only what the means of the clouds deviate from their common plane counts, in units of the scatter within the
//! clouds:
//!
//!   Σ √(1 + v_b / (v_w + s²)),  v_b = Σ_c (n_c/k) (n·(x̄_c − x̄))²
//!
//! with the normal n and the variance v_w along it from the scatter of points about the means of their clouds, n_c
//! points of cloud c among the k of the neighbourhood, and s the floor of the thickness. With n, v_w and the weight
//! w = 1/√((v_w + s²) (v_b + v_w + s²)) held, these are reweighted least squares of the n·(x̄_c − x̄). The root does not
//! let a few clouds that already agree outweigh many that lie apart, as a logarithm would. Separated clouds are drawn
//! together, a single cloud draws nowhere, and relief that shrinks lowers both variances.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::cost::NormalEquations;
use super::observability::LEVER_M;
use super::parameters::{Mounting, change, free_basis, poses, stepped};
use super::patch::{Patch, patches};
use super::scale::ScaleProblem;
use super::settings::initial_sigma;
use crate::error::Result;
use crate::progress::Progress;
use crate::statistics::{mean, rms};
use crate::surface::{Placed, SurfaceCloud};

/// Share of the information on a direction below which it is not aligned.
const HELD_SHARE: f64 = 1e-2;
/// Most steps.
const MAX_STEPS: usize = 20;
/// The clouds are aligned when a step moves no point by more than this share of a voxel.
const ALIGNED_SHARE: f64 = 0.02;
/// So many steps back that do not lower the objective beyond chance end the alignment: they go to and fro along what the
/// clouds hardly determine. Towards clouds that lie apart, steps go on in one direction before it falls.
const PATIENCE: usize = 4;

/// Stretches of the scans whose contradictions show how certain a step is: several for each of the 24 parameters of four
/// scanners.
const BLOCKS: usize = 64;

/// Mountings with which the clouds agree.
pub struct Aligned {
    /// The mountings.
    pub mountings: Vec<Mounting>,
    /// The mean ln(v_b + v_w + s²) of the neighbourhoods before every step: their thickness, as in the
    /// [cost](super::cost). Empty if there are none.
    pub costs: Vec<f64>,
    /// Number of neighbourhoods before the last step.
    pub neighbourhoods: usize,
    /// Number of steps.
    pub steps: usize,
}

/// Moves the mountings from `start` until the clouds of `problem` agree; what the clouds do not determine stays at the
/// `initial` values, or goes back to them.
///
/// # Errors
/// [`Error::Cancelled`](crate::error::Error::Cancelled).
pub fn align(
    problem: &ScaleProblem,
    initial: &[Mounting],
    start: &[Mounting],
    progress: &dyn Progress,
) -> Result<Aligned> {
    let cloud = &problem.cloud;
    let centres_m = cloud.centres_m();
    let mut aligned = Aligned {
        mountings: start.to_vec(),
        costs: Vec::new(),
        neighbourhoods: 0,
        steps: 0,
    };
    let mut best = Best::new(start);
    while aligned.steps < MAX_STEPS {
        progress.check()?;
        progress.advance(1);
        let now = &aligned.mountings;
        let placed = cloud.place(&poses(now));
        let patches = patches(problem, &placed);
        aligned.steps += 1;
        aligned.neighbourhoods = patches.len();
        if patches.is_empty() {
            break;
        }
        let variances = patches
            .iter()
            .map(|patch| patch.variances(&patch.offsets(&placed.world), problem.floor_m));
        let variances: Vec<[f64; 2]> = variances.collect();
        let costs = variances.iter().map(|[_, all]| all.ln());
        aligned.costs.push(mean(&costs.collect::<Vec<f64>>()));
        let blocks = normal_equations(&patches, cloud, &placed, problem.floor_m);
        let Some(step) = step(&blocks, initial, now) else {
            break;
        };
        if best.is_stale(misfit(&variances), now, &step) {
            break;
        }
        let stepped = |step: &DVector<f64>| stepped(now, step, &centres_m);
        let step_m = cloud.largest_displacement(&poses(now), &poses(&stepped(&step)));
        // Farther away there are other neighbours.
        aligned.mountings = stepped(&(step * (problem.voxel_m / step_m).min(1.0)));
        if step_m < ALIGNED_SHARE * problem.voxel_m {
            return Ok(aligned);
        }
    }
    if best.stale > 0 {
        aligned.mountings = best.mountings;
    }
    Ok(aligned)
}

/// The mean of √(1 + v_b / (v_w + s²)) over patches with these [variances](Patch::variances), and its standard deviation by
/// [`BLOCKS`] stretches of the scans.
fn misfit(variances: &[[f64; 2]]) -> [f64; 2] {
    let blocks = variances.chunks(variances.len().div_ceil(BLOCKS).max(1));
    let means = blocks.map(|block| {
        let roots = block.iter().map(|[within, all]| (all / within).sqrt());
        mean(&roots.collect::<Vec<f64>>())
    });
    let means: Vec<f64> = means.collect();
    let of_all = mean(&means);
    let scatter = rms(means.iter().map(|x| x - of_all));
    [of_all, scatter / (means.len() as f64).sqrt()]
}

/// The product of two steps, with rotations in metres.
fn weighted_product(a: &DVector<f64>, b: &DVector<f64>) -> f64 {
    let terms = a.iter().zip(b).enumerate();
    let scale = |i: usize| if i % 6 < 3 { 1.0 } else { LEVER_M * LEVER_M };
    terms.map(|(i, (a, b))| scale(i) * a * b).sum()
}

/// The mountings with the lowest objective so far.
struct Best {
    mountings: Vec<Mounting>,
    misfit: f64,
    last_step: DVector<f64>,
    /// Steps back since then.
    stale: usize,
}

impl Best {
    fn new(start: &[Mounting]) -> Self {
        Self {
            mountings: start.to_vec(),
            misfit: f64::INFINITY,
            last_step: DVector::zeros(6 * start.len()),
            stale: 0,
        }
    }

    /// Takes mountings, before a step, that are better beyond chance; whether none have been for [`PATIENCE`] steps back.
    fn is_stale(
        &mut self,
        [misfit, sigma]: [f64; 2],
        mountings: &[Mounting],
        step: &DVector<f64>,
    ) -> bool {
        if misfit < self.misfit - sigma {
            (self.mountings, self.misfit, self.stale) = (mountings.to_vec(), misfit, 0);
        } else {
            self.stale += usize::from(weighted_product(&self.last_step, step) < 0.0);
        }
        self.last_step = step.clone();
        self.stale == PATIENCE
    }
}

/// Normal equations of the patches of each of [`BLOCKS`] stretches of the scans.
fn normal_equations(
    patches: &[Patch],
    cloud: &SurfaceCloud,
    placed: &Placed,
    floor_m: f64,
) -> Vec<NormalEquations> {
    let blocks = patches.par_chunks(patches.len().div_ceil(BLOCKS).max(1));
    let sums = blocks.map(|block| {
        let mut equations = NormalEquations::zeros(6 * cloud.scanners);
        for patch in block {
            patch.add_to(&mut equations, cloud, placed, floor_m);
        }
        equations
    });
    sums.collect()
}

/// The Gauss-Newton step, as far as it is certain; `None` if nothing is free.
///
/// Directions of which less than [`HELD_SHARE`] of the information remains stay near the initial values: the offsets there
/// are due to relief. Where clouds end or see different relief, offsets of neighbouring patches err alike, so that the
/// normal equations say nothing about the covariance of the change δ from the initial values. It is estimated from the
/// changes δ_b without one of the B blocks each (jackknife),
///
///   C = (B − 1)/B Σ_b (δ_b − δ) (δ_b − δ)ᵀ,
///
/// and the change is Σ (Σ + C)⁻¹ δ with the covariance Σ of initial values. Without the only block that sees a direction,
/// the change along it is none: nothing confirms that block.
fn step(
    blocks: &[NormalEquations],
    initial: &[Mounting],
    now: &[Mounting],
) -> Option<DVector<f64>> {
    let equations = NormalEquations::sum(6 * now.len(), blocks);
    let basis = free_basis(now);
    let so_far = change(initial, now);
    let ridge = DMatrix::from_diagonal(&(&equations.uncentred * HELD_SHARE));
    // In coordinates of the basis.
    let estimate = |matrix: &DMatrix<f64>, gradient: &DVector<f64>| {
        let factor = (basis.transpose() * (matrix + &ridge) * &basis).cholesky()?;
        Some(factor.solve(&(basis.transpose() * (matrix * &so_far - gradient))))
    };
    let best = estimate(&equations.matrix, &equations.gradient)?;
    let without = |block: &NormalEquations| {
        let matrix = &equations.matrix - &block.matrix;
        Some(estimate(&matrix, &(&equations.gradient - &block.gradient))? - &best)
    };
    let columns: Option<Vec<DVector<f64>>> = blocks.iter().map(without).collect();
    let spread = DMatrix::from_columns(&columns?);
    let count = blocks.len() as f64;
    let covariance = &spread * spread.transpose() * ((count - 1.0) / count);
    let prior = DMatrix::from_diagonal(&initial_variances(now.len()));
    let prior = basis.transpose() * prior * &basis;
    let sum = (&prior + covariance).cholesky()?;
    Some(&basis * (prior * sum.solve(&best)) - so_far)
}

/// Variances of initial values, (δp, δφ) of each mounting.
fn initial_variances(mountings: usize) -> DVector<f64> {
    DVector::from_fn(6 * mountings, |row, _| initial_sigma(row).powi(2))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::calibration::adjust::minimise;
    use crate::calibration::observability::Observability;
    use crate::calibration::parameters::moved;
    use crate::calibration::scale::Ending;
    use crate::calibration::settings::INITIAL_SIGMA_M;
    use crate::calibration::{aligned, flattened};
    use crate::geometry::{BodyFromScanner, Rotation, Vec3, WorldFromBody};
    use crate::progress::Silent;
    use crate::surface::{Profile, ProfilePoint};

    const VOXEL_M: f64 = 0.03;

    /// The height of the ground at a place.
    type Ground = fn(f64, f64) -> f64;

    fn waves_m(x: f64, y: f64) -> f64 {
        0.06 * (3.0 * x).sin() + 0.05 * (4.0 * y + 1.0).cos()
    }

    /// Flat ground with three boards of 0.3 m, tilted by 45° towards different sides.
    fn boards_m(x: f64, y: f64) -> f64 {
        let boards = [(-0.4, -0.3, 0.0), (0.1, 0.35, 2.1), (0.45, -0.2, 4.2)];
        let heights = boards
            .iter()
            .filter_map(|(east, north, azimuth): &(f64, f64, f64)| {
                let (x, y) = (x - east, y - north);
                let up = x * azimuth.cos() + y * azimuth.sin();
                let aside = y * azimuth.cos() - x * azimuth.sin();
                (up.abs() < 0.1 && aside.abs() < 0.15).then_some(0.25 + up)
            });
        heights.sum()
    }

    /// Scanners that look down from 1 m, each on the given passes: start, direction along x.
    fn problem(ground_m: Ground, passes: &[&[f64]]) -> (ScaleProblem, Vec<Mounting>) {
        let mut cloud = SurfaceCloud::new(Vec::new());
        let mut mountings = Vec::new();
        for (scanner, passes) in passes.iter().enumerate() {
            let translation_m = Vec3::new(0.2, 0.3 * scanner as f64 - 0.15, 0.0);
            let mounting = BodyFromScanner::new(Rotation::identity(), translation_m);
            let (mut profiles, mut points) = (Vec::new(), Vec::new());
            for (pass, &yaw) in passes.iter().enumerate() {
                for step in 0..60 {
                    let along = 0.025 * f64::from(step) - 0.75;
                    let turn = Rotation::from_scaled_axis(Vec3::z() * yaw);
                    let place = turn * Vec3::new(along, 0.0, 0.0) + Vec3::z();
                    let pose = WorldFromBody::new(turn, place);
                    for ray in 0..40 {
                        let across = 0.03 * f64::from(ray) - 0.6;
                        // The point below (the fan is parallel, the scanner upright).
                        let level = pose.map(&mounting.map(&Vec3::new(0.0, across, 0.0)));
                        let depth = ground_m(level.x, level.y) - level.z;
                        points.push(ProfilePoint {
                            profile: profiles.len() as u32,
                            position_m: Vec3::new(0.0, across, depth),
                            count: 1,
                        });
                    }
                    profiles.push(Profile {
                        time_s: 100.0 * pass as f64 + 0.1 * f64::from(step),
                        world_from_body: pose,
                    });
                }
            }
            cloud.add_scanner(&profiles, points);
            mountings.push(Mounting::new(format!("scanner-{scanner}"), mounting));
        }
        let problem = ScaleProblem {
            cloud: Arc::new(cloud),
            voxel_m: VOXEL_M,
            floor_m: 0.002,
            k: 30,
            stride: 1,
            max_iterations: 30,
            pass_gap_s: 3.0,
        };
        (problem, mountings)
    }

    /// Root mean square of the heights above the ground, metres; nothing determines their mean.
    fn scatter_m(ground_m: Ground, problem: &ScaleProblem, mountings: &[Mounting]) -> f64 {
        let placed = problem.cloud.place(&poses(mountings));
        let heights = placed.world.iter().map(|p| p.z - ground_m(p.x, p.y));
        let heights: Vec<f64> = heights.collect();
        let mean = heights.iter().sum::<f64>() / heights.len() as f64;
        rms(heights.iter().map(|height| height - mean))
    }

    #[test]
    fn clouds_that_lie_apart_come_together() {
        let passes: &[&[f64]] = &[&[0.0, 1.6, 3.1], &[0.0, 1.6, 3.1]];
        let (problem, truth) = problem(waves_m, passes);
        let mut start = truth.clone();
        let off = (Vec3::new(0.02, -0.03, 0.02), Vec3::new(0.02, -0.03, 0.1));
        let pose = &mut start[1].body_from_scanner;
        *pose = pose.perturbed(&off.0, &off.1);
        let end = align(&problem, &start, &start, &Silent).unwrap();
        let [before, after] =
            [&start, &end.mountings].map(|mountings| scatter_m(waves_m, &problem, mountings));
        println!("{:.1} mm, then {:.1} mm", 1e3 * before, 1e3 * after);
        // The scale that follows corrects half a voxel.
        assert!(before > 1.5 * VOXEL_M && after < 0.5 * VOXEL_M);
    }

    #[test]
    fn small_boards_on_flat_ground_hold_the_mountings() {
        let passes: &[&[f64]] = &[&[0.0, 1.6, 3.1], &[0.0, 1.6, 3.1]];
        let (problem, truth) = problem(boards_m, passes);
        let mut begin = truth.clone();
        let pose = &mut begin[1].body_from_scanner;
        *pose = pose.perturbed(&Vec3::new(0.02, -0.03, 0.02), &Vec3::new(0.02, -0.03, 0.1));
        let aligned = align(&problem, &begin, &begin, &Silent).unwrap().mountings;
        // Neighbourhoods of 30 points are as wide as half a board.
        let start = problem.at(begin.clone());
        let all = Observability::new(&start.equations, &start.mountings);
        let flattest = minimise(&problem, start, &all, &Silent).unwrap();
        let flattest = flattest.state.mountings;
        let [before, aligned, flattest] = [&begin, &aligned, &flattest]
            .map(|mountings| 1e3 * scatter_m(boards_m, &problem, mountings));
        println!("{before:.1} mm, aligned {aligned:.1} mm, flattest {flattest:.1} mm");
        // Most of what remains are points at the edges of boards, a quarter of a metre too high or too low.
        assert!(aligned < 0.5 * before && flattest > 0.9 * before);
    }

    /// Eight blocks of which each wants another shift along x, of which the mean is 0.1 m.
    #[test]
    fn a_step_is_taken_as_far_as_blocks_agree() {
        let start = vec![Mounting::new("scanner", BodyFromScanner::identity())];
        let shift_m = |spread_m: f64| {
            let blocks: Vec<NormalEquations> = (0..8)
                .map(|block| {
                    let wanted_m = 0.1 + if block % 2 == 0 { spread_m } else { -spread_m };
                    let mut equations = NormalEquations::zeros(6);
                    equations.matrix.fill_with_identity();
                    equations.gradient[0] = -wanted_m;
                    equations
                })
                .collect();
            step(&blocks, &start, &start).unwrap()[0]
        };
        assert!((shift_m(0.0) - 0.1).abs() < 1e-12);
        // The mean of eight that are three standard deviations of initial values off has the variance 9/7 of theirs.
        let expected_m = 0.1 / (1.0 + 9.0 / 7.0);
        assert!((shift_m(3.0 * INITIAL_SIGMA_M) - expected_m).abs() < 1e-12);
    }

    /// Eight blocks, of which some see that the scanner is 0.1 m off along x, and all that it is not along y.
    #[test]
    fn a_block_that_no_other_confirms_moves_less_than_initial_values_are_off() {
        let start = vec![Mounting::new("scanner", BodyFromScanner::identity())];
        let shift_m = |seeing: usize| {
            let blocks: Vec<NormalEquations> = (0..8)
                .map(|block| {
                    let mut equations = NormalEquations::zeros(6);
                    equations.uncentred.fill(1e-6);
                    equations.matrix.fill_with_identity();
                    if block < seeing {
                        equations.gradient[0] = -0.1;
                    } else {
                        equations.matrix[(0, 0)] = 0.0;
                    }
                    equations
                })
                .collect();
            step(&blocks, &start, &start).unwrap()[0]
        };
        // Without it, there is no change: (7/8) (0.1 m)² beside the square of a quarter of that.
        let expected_m = 0.1 / (1.0 + 7.0 / 8.0 * 16.0);
        assert!((shift_m(1) - expected_m).abs() < 1e-6, "{}", shift_m(1));
        assert!((shift_m(2) - 0.1).abs() < 1e-6, "{}", shift_m(2));
    }

    #[test]
    fn steps_to_and_fro_end_and_steps_ahead_do_not() {
        let at = |x_m: f64| {
            let pose = BodyFromScanner::new(Rotation::identity(), Vec3::x() * x_m);
            vec![Mounting::new("scanner", pose)]
        };
        let step = |x_m: f64| DVector::from_fn(6, |i, _| if i == 0 { x_m } else { 0.0 });
        let mut best = Best::new(&at(0.0));
        assert!((0..10).all(|i| !best.is_stale([1.0, 0.1], &at(f64::from(i)), &step(1.0))));
        let mut best = Best::new(&at(0.0));
        let steps = [
            (0.0, 1.2),
            (1.0, 1.0),
            (0.0, 0.95),
            (1.0, 0.95),
            (0.0, 0.95),
            (1.0, 0.95),
        ];
        let ends = steps
            .map(|(x_m, misfit)| best.is_stale([misfit, 0.1], &at(x_m), &step(1.0 - 2.0 * x_m)));
        assert_eq!(ends, [false, false, false, false, false, true]);
        assert_eq!(best.mountings, at(1.0));
    }

    #[test]
    fn a_cloud_alone_stays() {
        let (problem, truth) = problem(waves_m, &[&[0.0]]);
        let (end, course) = aligned(&problem, &truth, truth.clone(), &Silent).unwrap();
        assert_eq!((end, course.ending), (truth, Ending::Aligned));
    }

    #[test]
    fn clouds_without_a_common_neighbourhood_stay() {
        let (problem, mut start) = problem(waves_m, &[&[0.0], &[0.0]]);
        start[1].body_from_scanner.translation_m.y += 5.0;
        let (end, course) = aligned(&problem, &start, start.clone(), &Silent).unwrap();
        assert_eq!((end, course.ending), (start.clone(), Ending::Apart));
        let (end, course) = flattened(&problem, &start, start.clone(), &Silent).unwrap();
        assert_eq!((end.state.mountings, course.ending), (start, Ending::Apart));
    }

    #[test]
    fn the_gradient_matches_finite_differences() {
        let (problem, mut mountings) = problem(waves_m, &[&[0.0, 1.6], &[0.4]]);
        let pose = &mut mountings[1].body_from_scanner;
        *pose = pose.perturbed(&Vec3::new(0.01, 0.02, -0.01), &Vec3::new(0.0, 0.01, 0.03));
        let cloud = &problem.cloud;
        let placed = cloud.place(&poses(&mountings));
        let patches = patches(&problem, &placed);
        let parts = normal_equations(&patches, cloud, &placed, problem.floor_m);
        let gradient = NormalEquations::sum(12, &parts).gradient;
        let cost = |mountings: &[Mounting]| -> f64 {
            let placed = cloud.place(&poses(mountings));
            let each = patches.iter().map(|patch| {
                let offsets = patch.offsets(&placed.world);
                let [within, all] = patch.variances(&offsets, problem.floor_m);
                (all / within).sqrt()
            });
            each.sum()
        };
        assert!(patches.len() > 100);
        for parameter in 0..12 {
            let at = |step: f64| {
                let mut delta = DVector::zeros(12);
                delta[parameter] = step;
                cost(&moved(&mountings, &delta))
            };
            // Central differences of 1e-6 on a cost of order 1e4 are good to about 1e-6 of it.
            let numeric = (at(1e-6) - at(-1e-6)) / 2e-6;
            let error = (numeric - gradient[parameter]).abs();
            assert!(error < 1e-5 * gradient.amax(), "{parameter}: {error}");
        }
    }
}
