//! The adjustment as a sparse least-squares problem.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::input::JointInput;
use super::layout::{Groups, Layout, REFERENCE, ScannerBlocks, UP};
use super::motion::Places;
use super::row::{HELD_SIGMA, Row, RowBatch};
use super::scan::{self, ScanBlocks, ScanContext};
use super::settings::JointSettings;
use super::state::State;
use super::surfel::{Association, CLASSES, COVERAGES, LEAST_SIGMA_M, ScanRow};
use crate::adjustment::{BlockPattern, SparseFactor, SparseSystem};
use crate::calibration::parameters::stepped;
use crate::geometry::Vec3;

/// Steps per task.
const TASK: usize = 64;
/// Tasks whose rows are held in memory at a time.
const HELD: usize = 16;

/// Uncertainty of the start values of surfels, the unit of their damping: offset (metres) and slopes.
const SURFEL_START_SIGMA: [f64; 3] = [10.0, 0.1, 0.1];
/// Uncertainty of the start values of mountings (metres, radians), latencies (seconds), slopes of planes and
/// the reference, the unit of their damping.
const START_SIGMA: f64 = 0.02;

/// Deviation of a narrow strip of points from the plane that does not average out over its points, as a
/// share of the surfel's roughness.
const STRIP_SHARE: f64 = 0.5;

/// The problem for one association of points with surfels.
pub struct JointProblem<'a> {
    pub input: &'a JointInput<'a>,
    pub settings: &'a JointSettings,
    pub association: Association,
    pub layout: Layout,
    pub groups: Groups,
    /// σ of the reference's surface errors, metres.
    pub surface_m: f64,
    /// The mean of the points of each scanner, scanner frame, metres.
    centres_m: Vec<Vec3>,
    pub(super) system: SparseSystem,
    pub(super) factor: Option<SparseFactor>,
    /// The state at which the factor was computed without damping and with the present weights of the rows.
    pub(super) factored: Option<State>,
    /// W with Wᵀ W the inverse covariance of mountings known beforehand.
    pub known: Option<DMatrix<f64>>,
    pub(super) decrement: f64,
    /// The last step, and the derivative of the cost along it where it begins.
    pub(super) step: Vec<f64>,
    pub(super) slope: f64,
    pub(super) damping_sigma: Vec<f64>,
}

impl<'a> JointProblem<'a> {
    pub fn new(
        input: &'a JointInput<'a>,
        settings: &'a JointSettings,
        association: Association,
        groups: Groups,
        state: &State,
        surface_m: f64,
    ) -> Self {
        let has_prior = association
            .surfels
            .iter()
            .any(|surfel| surfel.prior.is_some());
        let layout = Layout::new(
            input,
            &state.motions,
            &association,
            state.bends.as_ref(),
            has_prior,
        );
        let known = input.known.map(|covariance| {
            let size = covariance.nrows();
            let least = HELD_SIGMA * HELD_SIGMA;
            let whitener = (covariance + DMatrix::identity(size, size) * least).cholesky();
            let whitener = whitener.and_then(|c| c.l().try_inverse());
            whitener.unwrap_or_else(|| DMatrix::zeros(size, size))
        });
        let mut problem = Self {
            input,
            settings,
            association,
            layout,
            groups,
            surface_m,
            centres_m: centres_m(input),
            system: BlockPattern::new(vec![1]).analyse(1),
            factor: None,
            factored: None,
            known,
            decrement: f64::INFINITY,
            step: Vec::new(),
            slope: f64::NAN,
            damping_sigma: Vec::new(),
        };
        problem.find_depths(state);
        let mut pattern = BlockPattern::new(problem.layout.sizes.clone());
        let mut blocks = Vec::new();
        problem.visit(state, |batch| {
            for row in batch.rows() {
                blocks.clear();
                blocks.extend(row.blocks.iter().map(|&b| b as usize));
                pattern.couple(&blocks);
            }
        });
        problem.system = pattern.analyse(problem.layout.last());
        problem.damping_sigma = problem.damping_sigma(state);
        problem
    }

    fn damping_sigma(&self, state: &State) -> Vec<f64> {
        let mut all: Vec<f64> = state
            .motions
            .iter()
            .flat_map(|m| m.damping_sigma())
            .collect();
        all.extend(SURFEL_START_SIGMA.repeat(self.association.surfels.len()));
        all.resize(
            all.len() + self.association.patches,
            self.surface_m.max(LEAST_SIGMA_M),
        );
        all.resize(self.system.unknowns(), START_SIGMA);
        all
    }

    /// Number of unknowns.
    pub fn unknowns(&self) -> usize {
        self.system.unknowns()
    }

    /// Number of entries of the factor of the normal equations.
    pub fn factor_entries(&self) -> usize {
        self.system.factor_entries()
    }

    /// Number of multiplications that compute the factor.
    pub fn factor_products(&self) -> f64 {
        self.system.factor_products()
    }

    /// Index of the first scalar of a block.
    pub fn offset(&self, block: usize) -> usize {
        self.system.offset(block)
    }

    /// The group and the standard deviation of a scan row, metres: σ² = s² (v/n + share² v) + σ₀² + q with
    /// the variance v of its points, n effective points, and the variance q that the knots of a moving
    /// mounting leave out.
    pub fn noise(&self, state: &State, drive: usize, row: &ScanRow) -> (usize, f64) {
        let surfel = &self.association.surfels[row.surfel as usize];
        let group = self.groups.first_scan
            + (row.scanner as usize * COVERAGES + usize::from(row.coverage)) * CLASSES
            + surfel.class;
        let variance = row.scatter_m.powi(2);
        let share = STRIP_SHARE * STRIP_SHARE + 1.0 / row.effective;
        let sigma_m = (variance * share).sqrt() * self.groups.scale[group];
        let bends = state.bends.as_ref();
        let left_out_m2 = bends.map_or(0.0, |bends| bends.left_out(drive, row));
        let variance = sigma_m * sigma_m + LEAST_SIGMA_M * LEAST_SIGMA_M + left_out_m2;
        (group, variance.sqrt())
    }

    /// The inputs of the scan factors of a drive at a state.
    pub fn scan_context<'b>(&'b self, drive: usize, state: &'b State) -> ScanContext<'b> {
        ScanContext {
            rows: &self.association.drives[drive],
            samples: &self.input.drives[drive].scans.samples,
            surfels: &self.association.surfels,
            shapes: &state.shapes,
            mountings: state.poses(),
            bends: state.bends.as_ref(),
            drive,
            late_s: &state.late_s,
        }
    }

    /// Finds the places of a row's unknowns. Held values that are not among the unknowns have places after
    /// all of these.
    pub fn places(&self, row: &Row<'_>, places: &mut Vec<usize>) {
        places.clear();
        for &block in row.blocks {
            let block = block as usize;
            match self.layout.sizes.get(block) {
                Some(size) => places.extend(self.offset(block)..self.offset(block) + size),
                None => places.push(self.unknowns() + block - self.layout.sizes.len()),
            }
        }
    }

    /// The blocks of the unknowns of a drive's scan factors, with these of the scanners' constants.
    pub fn scan_blocks(&self, drive: usize, of_scanners: &ScannerBlocks) -> ScanBlocks {
        ScanBlocks {
            first_motion: self.layout.first_motion[drive],
            first_surfel: self.layout.first_surfel,
            mountings: self.layout.mountings.clone(),
            of_scanners: of_scanners.clone(),
            compliance: self.layout.compliance.clone(),
            knots: self.layout.knots.get(drive).cloned().unwrap_or_default(),
            bending: self
                .layout
                .compliance
                .first()
                .map_or(0, |&block| self.layout.sizes[block]),
        }
    }

    /// Visits all rows in a fixed order.
    pub fn visit(&self, state: &State, visit: impl FnMut(&RowBatch)) {
        self.visit_with(state, &self.layout.of_scanners, visit);
    }

    /// As [`Self::visit`], without derivatives.
    pub fn visit_residuals(&self, state: &State, visit: impl FnMut(&RowBatch)) {
        let of_scanners = &self.layout.of_scanners;
        self.visit_batches(state, of_scanners, RowBatch::of_residuals, visit);
    }

    /// As [`Self::visit`], with these blocks of the scanners' constants.
    pub fn visit_with(
        &self,
        state: &State,
        of_scanners: &ScannerBlocks,
        visit: impl FnMut(&RowBatch),
    ) {
        self.visit_batches(state, of_scanners, RowBatch::default, visit);
    }

    fn visit_batches(
        &self,
        state: &State,
        of_scanners: &ScannerBlocks,
        empty: fn() -> RowBatch,
        mut visit: impl FnMut(&RowBatch),
    ) {
        for drive in 0..self.input.drives.len() {
            let motion = state.motions[drive].as_ref();
            let places = Places {
                first_block: self.layout.first_motion[drive],
                constants: &self.layout.constants[drive],
                first_group: self.groups.first_motion[drive],
            };
            let context = self.scan_context(drive, state);
            let blocks = self.scan_blocks(drive, of_scanners);
            let steps: Vec<usize> = (0..=motion.steps()).collect();
            for held in steps.chunks(TASK * HELD) {
                let batches: Vec<RowBatch> = held
                    .par_chunks(TASK)
                    .map(|steps| {
                        let mut batch = empty();
                        for &step in steps {
                            motion.rows(step, &places, &mut batch);
                            if step < motion.steps() {
                                let noise = |row: &ScanRow| self.noise(state, drive, row);
                                scan::rows(&context, motion, step, &blocks, &noise, &mut batch);
                            }
                        }
                        batch
                    })
                    .collect();
                batches.iter().for_each(&mut visit);
            }
        }
        let mut batch = empty();
        self.surface(state, &mut batch);
        self.bending(state, &mut batch);
        self.assumed(state, &mut batch);
        visit(&batch);
    }

    /// Change of all unknowns with an upward shift of the reference by one standard deviation. The height of
    /// the reference is held, because its estimate would depend on some ten micrometres at the slopes of
    /// boards; its uncertainty still belongs in the covariance.
    pub fn side_of_height(&self) -> Option<Vec<f64>> {
        let place = self.offset(self.layout.reference?) + UP;
        let mut side = vec![0.0; self.unknowns()];
        // Moves the prior that holds it by one standard deviation.
        side[place] = self.settings.reference.shift_m / (HELD_SIGMA * HELD_SIGMA);
        self.factor.as_ref()?.solve(&mut side, 1);
        Some(side)
    }

    /// The state at which the last factor was computed; `None` if it is damped, or if rows have been weighted
    /// differently since.
    pub fn factored(&self) -> Option<&State> {
        self.factored.as_ref()
    }

    /// The last factor.
    pub fn factor(&self) -> Option<&SparseFactor> {
        self.factor.as_ref()
    }

    /// The right-hand side −Jᵀ W r of the last assembly.
    #[cfg(test)]
    pub fn gradient(&self) -> &[f64] {
        self.system.gradient()
    }

    /// The state after a step of all unknowns.
    pub fn retracted(&self, state: &State, step: &[f64]) -> State {
        let layout = &self.layout;
        let part = |block: usize, count: usize| {
            let first = self.system.offset(block);
            &step[first..first + count]
        };
        let motions = state.motions.iter().enumerate().map(|(drive, motion)| {
            let own_size: usize = motion.blocks().iter().sum();
            let constants: Vec<f64> = layout.constants[drive]
                .iter()
                .map(|&block| part(block, 1)[0])
                .collect();
            let first = layout.first_motion[drive];
            motion.moved(part(first, own_size), &constants)
        });
        let mut delta = DVector::zeros(6 * state.mountings.len());
        for (scanner, &block) in layout.mountings.iter().enumerate() {
            let d = part(block, 6);
            for i in 0..3 {
                delta[6 * scanner + i] = d[3 + i];
                delta[6 * scanner + 3 + i] = d[i];
            }
        }
        let mut next = State {
            motions: motions.collect(),
            mountings: stepped(&state.mountings, &delta, &self.centres_m),
            bends: state.bends.clone(),
            late_s: state.late_s.clone(),
            shapes: state.shapes.clone(),
            patches: state.patches.clone(),
            planes: state.planes.clone(),
            reference: state.reference,
        };
        for (late, block) in next.late_s.iter_mut().zip(&layout.of_scanners.late) {
            *late += block.map_or(0.0, |block| part(block, 1)[0]);
        }
        if let Some(bends) = &mut next.bends {
            for (compliance, &block) in bends.compliance.iter_mut().zip(&layout.compliance) {
                let step = part(block, layout.sizes[block]);
                compliance.iter_mut().zip(step).for_each(|(x, d)| *x += d);
            }
            let knots = bends.knots.iter_mut().flatten();
            for (knots, &first) in knots.zip(layout.knots.iter().flatten()) {
                let step = part(first, knots.value.len());
                knots.value.iter_mut().zip(step).for_each(|(x, d)| *x += d);
            }
        }
        if !next.shapes.is_empty() {
            let shapes = part(layout.first_surfel, 3 * next.shapes.len());
            for (shape, d) in next.shapes.iter_mut().zip(shapes.chunks_exact(3)) {
                *shape += Vec3::from_column_slice(d);
            }
        }
        if !next.patches.is_empty() {
            let patches = part(layout.first_patch, next.patches.len());
            next.patches
                .iter_mut()
                .zip(patches)
                .for_each(|(x, d)| *x += d);
        }
        if !next.planes.is_empty() {
            let planes = part(layout.first_plane, 2 * next.planes.len());
            let slopes = next.planes.iter_mut().flatten();
            slopes.zip(planes).for_each(|(x, d)| *x += d);
        }
        if let Some(block) = layout.reference {
            next.reference
                .iter_mut()
                .zip(part(block, REFERENCE))
                .for_each(|(x, d)| *x += d);
        }
        next
    }
}

/// The mean of the points of each scanner over all drives, scanner frame, metres.
fn centres_m(input: &JointInput<'_>) -> Vec<Vec3> {
    let of_scanner = |scanner: usize| {
        let samples = input
            .drives
            .iter()
            .map(|drive| drive.scans.samples[scanner]);
        let points = samples.flat_map(|sample| &sample.points);
        let (count, sum) = points.fold((0.0, Vec3::zeros()), |(count, sum), point| {
            (count + 1.0, sum + point.position_m)
        });
        sum / f64::max(count, 1.0)
    };
    (0..input.mountings.len()).map(of_scanner).collect()
}
