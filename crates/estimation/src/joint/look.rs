//! Evaluation of the scans at one state, before the next step: the distances of rows from their scanner,
//! their noise and trust, and start values of the surfels.

use rayon::prelude::*;

use super::components::{Component, MAX_STEP};
use super::motion::Motion;
use super::problem::JointProblem;
use super::row::{row_trust, surfel_trust};
use super::scan::{Mean, StepScans};
use super::state::State;
use super::surfel::ScanRow;
use crate::geometry::{Mat3, Vec3};
use crate::statistics::{SIGMAS_PER_MAD, median};

/// If residuals exceed their standard deviations by this factor, their noise is far from known.
const FAR_LARGER: f64 = 2.0;
/// Fewest residuals whose median says something about the noise: it is then known to 20 %.
const MIN_RESIDUALS: usize = 30;

impl JointProblem<'_> {
    /// Evaluates a function of the mean of each row of each drive at a state, in the order of the rows.
    pub fn each_mean<T: Send>(
        &self,
        state: &State,
        evaluate: impl Fn(usize, &ScanRow, &Mean) -> T + Sync,
    ) -> Vec<T> {
        self.each_row(state, |drive, row, scans| {
            evaluate(drive, row, &scans.mean(row))
        })
    }

    /// As [`Self::each_mean`], of the residual of each row in standard deviations.
    fn each_residual(&self, state: &State) -> Vec<f64> {
        self.each_row(state, |drive, row, scans| {
            scans.residual_m(row) / self.noise(state, drive, row).1
        })
    }

    fn each_row<T: Send>(
        &self,
        state: &State,
        evaluate: impl Fn(usize, &ScanRow, &StepScans<'_>) -> T + Sync,
    ) -> Vec<T> {
        let drives = state.motions.iter().map(AsRef::as_ref).enumerate();
        let of_drive = |(drive, motion): (usize, &dyn Motion)| {
            let context = self.scan_context(drive, state);
            let of_step = |step: usize| {
                let poses = motion.poses(step);
                let rows = context.rows.of_step(step);
                let scans = StepScans::new(&context, &poses, rows);
                let of_row = |row| evaluate(drive, row, &scans);
                rows.iter().map(of_row).collect::<Vec<T>>()
            };
            let steps = (0..motion.steps()).into_par_iter();
            steps.map(of_step).collect::<Vec<_>>()
        };
        drives.flat_map(of_drive).flatten().collect()
    }

    /// Computes for each row the distance of its points from the scanner, its sensitivity to a motion of the
    /// mounting, and the number of rows that share this motion.
    pub fn find_depths(&mut self, state: &State) {
        let depths = self.each_mean(state, |_, _, mean| {
            let square = |by: &[f64]| by.iter().map(|x| x * x).sum::<f64>();
            let [turn, shift] = [&mean.by_mounting[..3], &mean.by_mounting[3..]];
            (mean.depth_m, [square(turn), square(shift)])
        });
        for (row, (depth_m, by_motion)) in self.association.rows_mut().zip(depths) {
            (row.depth_m, row.by_motion) = (depth_m, by_motion);
        }
        for drive in &mut self.association.drives {
            drive.count_rows_in_steps(state.mountings.len());
        }
    }

    /// Estimates the noise of groups of scan rows from the medians of their residuals, and returns whether any has
    /// changed: a start for the estimate by variance components, which approaches a noise that is far off only slowly.
    /// A surfel takes three of its rows to itself.
    ///
    /// With knots the noise only rises, as in [`rescale`](super::components::rescale).
    pub fn guess_noise(&mut self, state: &State) -> bool {
        let mut rows = vec![0_u32; self.association.surfels.len()];
        for row in self.association.rows() {
            rows[row.surfel as usize] += 1;
        }
        let mut residuals = self.each_residual(state).into_iter();
        let mut by_group = vec![(Vec::new(), Component::default()); self.groups.names.len()];
        for (drive, all) in self.association.drives.iter().enumerate() {
            for (row, residual) in all.rows.iter().zip(residuals.by_ref()) {
                let prior = &self.association.surfels[row.surfel as usize].prior;
                let seen = rows[row.surfel as usize] + prior.as_ref().map_or(0, |_| 3);
                let redundancy = 1.0 - 3.0 / f64::from(seen);
                if redundancy > 0.0 {
                    let (group, _) = self.noise(state, drive, row);
                    let (residuals, component) = &mut by_group[group];
                    residuals.push(residual.abs() / redundancy.sqrt());
                    component.redundancy += redundancy;
                    component.squares += redundancy * redundancy;
                }
            }
        }
        let least = if self.layout.knots.is_empty() {
            0.0
        } else {
            FAR_LARGER
        };
        let mut has_changed = false;
        for (group, (residuals, component)) in by_group.into_iter().enumerate() {
            let is_known = residuals.len() >= MIN_RESIDUALS;
            let sigmas = SIGMAS_PER_MAD * median(residuals).unwrap_or(0.0);
            if is_known && sigmas > least {
                let ratio = sigmas * sigmas;
                let factor = component.newton(ratio, ratio.ln().min(-MAX_STEP));
                self.groups.scale[group] *= factor;
                has_changed = true;
            }
        }
        if has_changed {
            self.forget_factor();
        }
        has_changed
    }

    /// Computes the trust in each scan row from its residual at a state and from those of its surfel.
    pub fn find_trust(&mut self, state: &State) {
        let residuals = self.each_residual(state);
        // Sums of squares and degrees of freedom.
        let surfels = self.association.surfels.iter().zip(&state.shapes);
        let mut by_surfel: Vec<(f64, f64)> = surfels
            .map(|(surfel, shape)| {
                surfel.prior.as_ref().map_or((0.0, -3.0), |prior| {
                    let rows = self.reference_rows(surfel, prior, shape, state);
                    (rows.iter().map(|row| row.residual.powi(2)).sum(), 0.0)
                })
            })
            .collect();
        for (row, residual) in self.association.rows().zip(&residuals) {
            let (squares, free) = &mut by_surfel[row.surfel as usize];
            *squares += residual * residual;
            *free += 1.0;
        }
        let by_surfel: Vec<f64> = by_surfel
            .iter()
            .map(|(squares, free)| surfel_trust((squares / free.max(1.0)).sqrt()))
            .collect();
        for (row, residual) in self.association.rows_mut().zip(residuals) {
            row.trust = row_trust(residual).min(by_surfel[row.surfel as usize]);
        }
        self.forget_factor();
    }

    /// Fits the surfels to the scans from these poses.
    pub fn fit_shapes(&self, state: &mut State) {
        let now: &State = state;
        let observations = self.each_mean(now, |drive, row, mean| {
            let (_, sigma_m) = self.noise(now, drive, row);
            let by = Vec3::from(mean.by_shape) / sigma_m;
            (row.surfel, by, mean.residual_m / sigma_m)
        });
        let mut normal: Vec<(Mat3, Vec3)> = self
            .association
            .surfels
            .iter()
            .zip(&state.shapes)
            .map(|(surfel, shape)| {
                let Some(prior) = &surfel.prior else {
                    let squares = surfel.assumed.information();
                    let slopes = self.slopes_of_plane(surfel, state);
                    let [b, c] = slopes.map_or([0.0; 2], |slopes| slopes.map(|slope| slope.value));
                    let apart = shape - Vec3::new(0.0, b, c);
                    return (
                        Mat3::from_diagonal(&squares),
                        -squares.component_mul(&apart),
                    );
                };
                let rows = self.reference_rows(surfel, prior, shape, state);
                let weights = Vec3::from_fn(|i, _| rows[i].weight);
                let residuals = Vec3::from_fn(|i, _| rows[i].residual);
                let squares = weights.component_mul(&weights);
                (
                    Mat3::from_diagonal(&squares),
                    -weights.component_mul(&residuals),
                )
            })
            .collect();
        for (surfel, by, residual) in observations {
            let (matrix, side) = &mut normal[surfel as usize];
            *matrix += by * by.transpose();
            *side -= by * residual;
        }
        for (shape, (matrix, side)) in state.shapes.iter_mut().zip(normal) {
            *shape += matrix.cholesky().map_or(Vec3::zeros(), |c| c.solve(&side));
        }
    }

    /// Displacement of points from one state to another, root mean square, metres.
    pub fn moved_m(&self, from: &State, to: &State) -> f64 {
        let places = [from, to].map(|state| {
            let mut places = Vec::new();
            for (drive, motion) in state.motions.iter().enumerate() {
                let rows = &self.association.drives[drive];
                let context = self.scan_context(drive, state);
                for step in (0..motion.steps()).filter(|&step| !rows.of_step(step).is_empty()) {
                    let poses = motion.poses(step);
                    let row = &rows.of_step(step)[0];
                    let scans = StepScans::new(&context, &poses, std::slice::from_ref(row));
                    places.push(scans.first_point_m(row));
                }
            }
            places
        });
        let squares = places[0]
            .iter()
            .zip(&places[1])
            .map(|(a, b)| (b - a).norm_squared());
        (squares.sum::<f64>() / places[0].len().max(1) as f64).sqrt()
    }
}
