//! The motion of the body: the unknowns behind the poses of a drive, and all observations of them except
//! scans.

mod chain;
mod corrections;
mod gauss_markov;
mod knots;

pub use chain::{ChainMotion, CorrelatedError};
pub use corrections::CorrectedPoses;
pub use gauss_markov::{GaussMarkov, MAX_FACTOR, rows_together};
pub use knots::{AT_BRIDGE, BRIDGE, Knot, NodeGradient, StepPoses};

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use super::row::RowBatch;
use crate::geometry::Vec3;
use crate::sensor::PoseRecord;
use nalgebra::DMatrix;

/// The places of a motion's unknowns and groups in the whole problem.
#[derive(Debug, Clone, Copy)]
pub struct Places<'a> {
    /// Its first own block.
    pub first_block: usize,
    /// The block of each of its constants.
    pub constants: &'a [usize],
    /// The group of its first kind of observation.
    pub first_group: usize,
}

/// The motion of the body during a drive at its present values.
///
/// Steps run from node to node; poses within a step depend on its two nodes.
pub trait Motion: Send + Sync {
    /// Sizes of its own blocks of unknowns.
    fn blocks(&self) -> Vec<usize>;

    /// Names of its groups of observations.
    fn groups(&self) -> Vec<String>;

    /// Number of steps.
    fn steps(&self) -> usize;

    /// The step that holds a time; `None` outside the drive.
    fn step_at(&self, time_s: f64) -> Option<usize>;

    /// The own blocks of the nodes of a step whose leading unknowns the poses depend on.
    fn pose_blocks(&self, step: usize) -> [usize; 2];

    /// The own block of the bridge of a step: the deviation of the attitude between its nodes.
    fn bridge_block(&self, _step: usize) -> Option<usize> {
        None
    }

    /// The poses within a step, from node to node, with their derivatives.
    fn poses(&self, step: usize) -> Cow<'_, StepPoses>;

    /// Adds the rows of everything but scanners in a step; `step` = steps() asks for priors.
    fn rows(&self, step: usize, places: &Places<'_>, batch: &mut RowBatch);

    /// The motion after a step of its own blocks (one after the other) and of its constants.
    fn moved(&self, step: &[f64], constants: &[f64]) -> Box<dyn Motion>;

    /// Uncertainty of the start values of the own blocks, the unit of the damping.
    fn damping_sigma(&self) -> Vec<f64>;

    /// The poses; with `covariance` of two own blocks also their standard deviations.
    fn records(
        &self,
        covariance: Option<&(dyn Fn(usize, usize) -> Option<DMatrix<f64>> + Sync)>,
    ) -> Vec<PoseRecord>;

    /// The constants that are unknowns of their own, with their values.
    fn constants(&self) -> Vec<ConstantValue>;

    /// A copy.
    fn boxed(&self) -> Box<dyn Motion>;

    /// The errors of its poses whose size and duration the adjustment estimates; `None` if there are none.
    fn errors(&self) -> Option<&GaussMarkov> {
        None
    }

    /// The same, to be changed.
    fn errors_mut(&mut self) -> Option<&mut GaussMarkov> {
        None
    }

    /// The residuals of its position sensors in blocks of this many seconds; empty without such
    /// sensors.
    fn position_blocks(&self, _block_s: f64) -> Vec<PositionBlocks> {
        Vec::new()
    }

    /// The residuals of its position sensors one by one; empty without such sensors.
    fn position_residuals(&self) -> Vec<PositionResiduals> {
        Vec::new()
    }
}

/// Means of a position sensor's residuals over blocks of time: white residuals average out, residuals due to
/// a wrong model do not.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PositionBlocks {
    /// Name of the sensor.
    pub sensor: String,
    /// Length of a block, seconds.
    pub block_s: f64,
    /// Number of blocks.
    pub blocks: usize,
    /// Root mean square of the means, in their standard deviations: east, north, up.
    pub rms: [f64; 3],
}

/// The residuals of a position sensor along a drive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PositionResiduals {
    /// Name of the sensor.
    pub sensor: String,
    /// Time (seconds) and predicted − measured (world, metres) of every record that is used.
    pub records: Vec<(f64, Vec3)>,
}

/// One value of a constant that is estimated along with the motion.
#[derive(Debug, Clone, PartialEq)]
pub struct ConstantValue {
    /// Name as in the project, with the component: `prism.lever_arm.x`.
    pub name: String,
    /// SI unit.
    pub unit: &'static str,
    /// The value to which `correction` is added.
    pub base: f64,
    /// The correction estimated so far.
    pub correction: f64,
    /// Standard deviation of the prior about `base`.
    pub prior_sigma: f64,
}
