//! Mountings that move: with the load on the frame, and with time.
//!
//! The mounting of scanner s at time t is its mean, perturbed by
//!
//!   δ(t) = C_s (ℓ(t) − ℓ̄) + c_s u(t) + F_s f(t) + m_s(t),
//!
//! (δφ, δp) in body axes, with the load ℓ, the compliance C_s (6 × 4), the creep c_s over a drive with u from −½
//! to ½, the same in all drives, columns f of a log (temperatures, for example) relative to their mean over all
//! drives and in shares of their range, and a Gauss-Markov process m_s at knots. The loads are the two parts of
//! the specific force in the body, gravity and acceleration, each along x and y, because along z they hardly
//! change. The acceleration is smoothed over some tenths of a second. The two parts are separate loads: both bend
//! a frame, but not alike if masses beside it swing.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::motion::{GaussMarkov, Motion};
use super::row::HELD_SIGMA;
use super::surfel::ScanRow;
use crate::calibration::Mounting;
use crate::error::Result;
use crate::geometry::Vec3;
use crate::sensor::{FrameLog, MAX_FRAME_COLUMNS, STANDARD_GRAVITY_M_S2};
use crate::statistics::{self, Series};
use crate::trajectory::Trajectory;

/// Components of a load, in units of gravity: the direction up along the body's x and y axes, and its
/// acceleration along them.
pub const LOADS: usize = 4;
/// Coefficients of a compliance: δ by each load, one after the other.
pub const COMPLIANCE: usize = 6 * LOADS;
/// Largest number of causes that mountings follow: the loads, time, and columns of a log.
pub const CAUSES: usize = LOADS + 1 + MAX_FRAME_COLUMNS;
/// Unknowns of a scanner's bending: the compliance, then the creep and the columns of a log.
pub const BENDING: usize = 6 * CAUSES;
/// Standard deviations of the prior of a compliance: a degree of tilt bends by some tenths of a degree and
/// some millimetres. Radians per g, metres per g.
pub const COMPLIANCE_SIGMA: [f64; 2] = [0.3, 0.5];
/// Standard deviations of the priors of a creep over a drive, and of the effect of a column over its range:
/// radians and metres.
pub const CREEP_SIGMA: [f64; 2] = [0.01, 0.03];

/// Standard deviations of the motion in time, radians and metres.
pub const KNOT_SIGMA: [f64; 2] = [1.5e-3, 2e-3];
/// Offsets along a drive are given at this step, seconds.
pub const BENDING_STEP_S: f64 = 0.05;

/// Time step at which loads are tabulated, seconds.
const STEP_S: f64 = 0.1;
/// Accelerations are second differences over this time to both sides, which smooth over it, seconds.
const SMOOTH_S: f64 = 0.2;

/// Compliance of a mounting: how it follows the load on the frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Compliance {
    /// (δφ, δp) in body axes by each load, one after the other: radians and metres per g.
    pub by_load: [f64; COMPLIANCE],
    /// Standard deviations.
    pub sigma: [f64; COMPLIANCE],
    /// The load at which the mounting is its mean, in g.
    pub mean_load: [f64; LOADS],
}

impl Compliance {
    /// The compliance of a rigid mounting, with the mean load of another scanner.
    pub fn rigid_beside(other: Self) -> Self {
        Self {
            by_load: [0.0; COMPLIANCE],
            sigma: [0.0; COMPLIANCE],
            ..other
        }
    }

    fn is_rigid(&self) -> bool {
        self.sigma == [0.0; COMPLIANCE] && self.by_load == [0.0; COMPLIANCE]
    }

    /// (δφ, δp) under a load.
    pub fn offset(&self, load: &[f64; LOADS]) -> [f64; 6] {
        bending(&self.by_load, &difference(load, &self.mean_load))
    }
}

/// How much a mounting may move; each rung includes those before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Rung {
    /// Not at all.
    Rigid,
    /// Linearly with the load, and with time.
    Compliance,
    /// Also slowly, in any way.
    SlowKnots,
    /// Also as fast as the trajectory is known.
    DenseKnots,
}

impl Rung {
    /// The next rung up.
    pub fn next(self) -> Option<Self> {
        match self {
            Self::Rigid => Some(Self::Compliance),
            Self::Compliance => Some(Self::SlowKnots),
            Self::SlowKnots => Some(Self::DenseKnots),
            Self::DenseKnots => None,
        }
    }

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rigid => "rigid",
            Self::Compliance => "compliant",
            Self::SlowKnots => "compliant and slowly drifting",
            Self::DenseKnots => "compliant and freely moving",
        }
    }

    /// The process of each mounting during a drive, at rest.
    fn knots(self, motion: &dyn Motion, mountings: &[Mounting]) -> Option<Vec<GaussMarkov>> {
        let (spacing_s, correlation_s) = match self {
            Self::Rigid | Self::Compliance => return None,
            Self::SlowKnots => (2.0, 30.0),
            // All nodes of a prism's usual rate.
            Self::DenseKnots => (0.1, 5.0),
        };
        let times_s = knot_times(motion, spacing_s);
        let process = |mounting: &Mounting| {
            let sigma = (0..6).map(|i| {
                if is_fixed(mounting, i) {
                    HELD_SIGMA
                } else {
                    KNOT_SIGMA[i / 3]
                }
            });
            GaussMarkov::at_knots(times_s.clone(), sigma.collect(), correlation_s)
        };
        Some(mountings.iter().map(process).collect())
    }
}

/// ℓ at a time: −Rᵀ g / |g| and Rᵀ a / |g| along x and y, with a from second differences.
fn load_at(trajectory: &Trajectory, time_s: f64) -> Option<[f64; LOADS]> {
    let (first_s, last_s) = trajectory.span_s();
    // At the ends of a drive, the body is assumed to move as it does near them.
    let [low_s, high_s] = if last_s - first_s > 2.0 * SMOOTH_S {
        [first_s + SMOOTH_S, last_s - SMOOTH_S]
    } else {
        [0.5 * (first_s + last_s); 2]
    };
    let time_s = time_s.clamp(low_s, high_s);
    let at = |late_s: f64| trajectory.pose_at((time_s + late_s).clamp(first_s, last_s));
    let (before, here, after) = (at(-SMOOTH_S)?, at(0.0)?, at(SMOOTH_S)?);
    let bend = after.translation_m - here.translation_m * 2.0 + before.translation_m;
    let to_body = here.rotation.inverse();
    let up = to_body * Vec3::z();
    let acceleration = to_body * bend / (SMOOTH_S * SMOOTH_S * STANDARD_GRAVITY_M_S2);
    Some([up.x, up.y, acceleration.x, acceleration.y])
}

/// ℓ along a drive whose poses have no limits.
pub fn loads(trajectory: &Trajectory) -> Series<LOADS> {
    Series::sampled(trajectory.span_s(), STEP_S, |time_s| {
        load_at(trajectory, time_s).unwrap_or_default()
    })
}

/// Values of all quantities that move the mountings.
#[derive(Debug, Clone)]
pub struct Bends {
    /// How much they may move.
    pub rung: Rung,
    /// ℓ̄, over all drives.
    pub mean_load: [f64; LOADS],
    /// ℓ − ℓ̄, u and f along each drive.
    pub causes: Arc<Vec<Series<CAUSES>>>,
    /// Number of causes in use.
    pub causes_used: usize,
    /// C of each scanner, column by column, c and F.
    pub compliance: Vec<[f64; BENDING]>,
    /// Their priors: values and standard deviations.
    pub prior: Vec<[[f64; BENDING]; 2]>,
    /// m of each scanner of each drive; empty without knots.
    pub knots: Vec<Vec<GaussMarkov>>,
    /// Correlation between two scanners of a drive of their changes from knot to knot, 0 to 1: of rotations and of
    /// shifts.
    pub together: [f64; 2],
}

impl Bends {
    /// Start values: the known compliance, or no bending; `None` if mountings stay rigid.
    ///
    /// # Errors
    /// A drive has no trajectory.
    pub fn new(
        rung: Rung,
        motions: &[Box<dyn Motion>],
        mountings: &[Mounting],
        known: &[Compliance],
        frames: &[Option<&FrameLog>],
    ) -> Result<Option<Self>> {
        if rung == Rung::Rigid {
            return Ok(None);
        }
        let records = motions.iter().map(|motion| motion.records(None));
        let drives: Vec<Trajectory> = records.map(Trajectory::new).collect::<Result<_>>()?;
        let loads: Vec<Series<LOADS>> = drives.iter().map(loads).collect();
        let prior: Vec<_> = (mountings.iter().enumerate())
            .map(|(scanner, mounting)| {
                let [mut value, mut sigma] = vague_prior(mounting);
                if let Some(known) = known.get(scanner) {
                    value[..COMPLIANCE].copy_from_slice(&known.by_load);
                    sigma[..COMPLIANCE].copy_from_slice(&known.sigma);
                    if known.is_rigid() {
                        sigma = [0.0; BENDING];
                    }
                }
                [value, sigma]
            })
            .collect();
        let mean_load = known.first().map_or_else(|| mean(&loads), |k| k.mean_load);
        let columns = Columns::new(frames);
        let each = loads.iter().zip(&drives).zip(frames);
        let causes = each.map(|((loads, trajectory), log)| {
            let (from_s, to_s) = trajectory.span_s();
            Series::sampled((from_s, to_s), STEP_S, |time_s| {
                let [a, b, c, d] = difference(&loads.at(time_s), &mean_load);
                let [e, f] = columns.at(*log, time_s);
                [a, b, c, d, (time_s - from_s) / (to_s - from_s) - 0.5, e, f]
            })
        });
        let knots = motions
            .iter()
            .filter_map(|m| rung.knots(m.as_ref(), mountings));
        Ok(Some(Self {
            rung,
            mean_load,
            causes: Arc::new(causes.collect()),
            causes_used: LOADS + 1 + columns.count,
            compliance: prior.iter().map(|[value, _]| *value).collect(),
            prior,
            knots: knots.collect(),
            together: [0.0; 2],
        }))
    }

    /// ℓ − ℓ̄, u and f at a time of a drive.
    pub fn causes(&self, drive: usize, time_s: f64) -> [f64; CAUSES] {
        self.causes[drive].at(time_s)
    }

    /// Number of unknowns of a scanner, apart from those of its knots.
    pub fn unknowns(&self) -> usize {
        6 * self.causes_used
    }

    /// Restarts the process with the largest jump in each drive; returns whether there is any.
    pub fn restart(&mut self) -> bool {
        let mut jumped = false;
        for of_drive in &mut self.knots {
            let jumps = (0..of_drive.len()).filter_map(|scanner| {
                let others = of_drive.iter().enumerate().filter(|(s, _)| *s != scanner);
                let others: Vec<&GaussMarkov> = others.map(|(_, process)| process).collect();
                let (sigmas, knot) = of_drive[scanner].jump(&others)?;
                Some((sigmas, scanner, knot))
            });
            if let Some((_, scanner, knot)) = jumps.max_by(|a, b| a.0.total_cmp(&b.0)) {
                of_drive[scanner].restarts.push(knot);
                jumped = true;
            }
        }
        jumped
    }

    /// Variance of a row that straight lines between the knots of its scanner leave out, m². The n rows of a scanner in
    /// a step share this error in its six components but count as independent, so each gets n/6 times the variance.
    /// The n scanners of a drive share it with the correlation ρ, which gives 1 + (n − 1) ρ times the variance. Slow
    /// knots get neither factor: if they leave out too much, the IMU must contradict them, and noise must not hide it.
    pub fn left_out(&self, drive: usize, row: &ScanRow) -> f64 {
        let Some(of_drive) = self.knots.get(drive) else {
            return 0.0;
        };
        let process = &of_drive[row.scanner as usize];
        let of_class = |class: usize| {
            let shared = match self.rung {
                Rung::DenseKnots => {
                    let others = of_drive.len() as f64 - 1.0;
                    (f64::from(row.rows_in_step) / 6.0).max(1.0)
                        * (1.0 + others * self.together[class])
                }
                _ => 1.0,
            };
            let variance = row.by_motion[class] * process.sigma[3 * class].powi(2);
            process.left_out_share(3 * class) * shared * variance
        };
        of_class(0) + of_class(1)
    }

    /// (δφ, δp) of a scanner at a time of a drive.
    pub fn offset(&self, drive: usize, scanner: usize, time_s: f64) -> [f64; 6] {
        let offset = bending(&self.compliance[scanner], &self.causes(drive, time_s));
        let process = self.knots.get(drive).map(|of_drive| &of_drive[scanner]);
        process.map_or(offset, |process| {
            std::array::from_fn(|i| offset[i] + process.at(time_s, i))
        })
    }
}

/// The columns of the logs of all drives.
struct Columns {
    count: usize,
    mean: [f64; MAX_FRAME_COLUMNS],
    /// Largest minus smallest value; infinite if a column does not vary, so that shares of it are zero.
    range: [f64; MAX_FRAME_COLUMNS],
}

impl Columns {
    fn new(frames: &[Option<&FrameLog>]) -> Self {
        let logs = || frames.iter().flatten();
        let of_column = |column: usize| -> Vec<f64> {
            let rows = logs().flat_map(|log| &log.rows);
            rows.map(|(_, values)| values[column]).collect()
        };
        let range = |column: usize| {
            let values = of_column(column);
            let largest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let range = values.iter().map(|x| largest - x).fold(0.0, f64::max);
            if range > 0.0 { range } else { f64::INFINITY }
        };
        Self {
            count: logs().map(|log| log.columns).max().unwrap_or(0),
            mean: std::array::from_fn(|column| statistics::mean(&of_column(column))),
            range: std::array::from_fn(range),
        }
    }

    /// f at a time of a drive; zero for one without a log.
    fn at(&self, log: Option<&FrameLog>, time_s: f64) -> [f64; MAX_FRAME_COLUMNS] {
        let Some(log) = log else {
            return Default::default();
        };
        let values = log.at(time_s);
        std::array::from_fn(|i| (values[i] - self.mean[i]) / self.range[i])
    }
}

/// Values and standard deviations of a scanner's bending of which nothing is known.
fn vague_prior(mounting: &Mounting) -> [[f64; BENDING]; 2] {
    let sigma = |i: usize| {
        if is_fixed(mounting, i % 6) {
            0.0
        } else if i < COMPLIANCE {
            COMPLIANCE_SIGMA[i % 6 / 3]
        } else {
            CREEP_SIGMA[i % 6 / 3]
        }
    };
    [[0.0; BENDING], std::array::from_fn(sigma)]
}

/// Whether component i of (δφ, δp) is fixed, because the position or the rotation is fixed as a whole.
pub fn is_fixed(mounting: &Mounting, i: usize) -> bool {
    let [turns, shifts] = [&mounting.fixed[3..], &mounting.fixed[..3]];
    (if i < 3 { turns } else { shifts }) == [true; 3]
}

/// The mean load over all drives.
fn mean(loads: &[Series<LOADS>]) -> [f64; LOADS] {
    std::array::from_fn(|axis| {
        let all = loads.iter().flat_map(|drive| drive.samples());
        let all: Vec<f64> = all.map(|(_, load)| load[axis]).collect();
        statistics::mean(&all)
    })
}

/// ℓ − ℓ̄.
fn difference(load: &[f64; LOADS], mean: &[f64; LOADS]) -> [f64; LOADS] {
    std::array::from_fn(|axis| load[axis] - mean[axis])
}

/// Times of nodes of a motion at least `spacing_s` apart, both ends included; no row extends across a knot.
fn knot_times(motion: &dyn Motion, spacing_s: f64) -> Vec<f64> {
    let ends = (0..motion.steps()).map(|step| {
        let knots = &motion.poses(step).knots;
        [knots[0].time_s, knots[knots.len() - 1].time_s]
    });
    let ends: Vec<[f64; 2]> = ends.collect();
    let mut times = vec![ends[0][0]];
    for [_, end_s] in &ends {
        // Spacings of nodes are equal to the requested one up to rounding.
        if end_s - times[times.len() - 1] > 0.99 * spacing_s {
            times.push(*end_s);
        }
    }
    let last_s = ends[ends.len() - 1][1];
    if last_s > times[times.len() - 1] {
        times.push(last_s);
    }
    times
}

/// The offset (δφ, δp) due to the causes: C ℓ, and the effects of creep and columns if these follow the loads.
fn bending(compliance: &[f64], causes: &[f64]) -> [f64; 6] {
    let by_each = || compliance.chunks_exact(6).zip(causes);
    std::array::from_fn(|i| by_each().map(|(by, cause)| by[i] * cause).sum())
}
