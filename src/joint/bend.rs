//! Mountings that move: with the load on the frame, and with time.
//!
//! The mounting of scanner s at time t is its mean, perturbed by
//!
//!   δ(t) = C_s (ℓ(t) − ℓ̄) + m_s(t),
//!
//! (δφ, δp) in body axes, with the load ℓ, the compliance C_s (6 × 4) and a Gauss-Markov process m_s at
//! knots. The loads are the parts of the specific force in the body: gravity and acceleration, this smoothed
//! over half a second, along x and y each, as along z they hardly change. Both bend a frame, but not where
//! masses beside it swing.

use std::sync::Arc;

use super::motion::{GaussMarkov, Motion};
use crate::calibration::Mounting;
use crate::geometry::Vec3;
use crate::sensor::{PoseRecord, STANDARD_GRAVITY_M_S2};
use crate::statistics::Series;
use crate::trajectory::Trajectory;

/// Components of a load, in units of gravity: the direction up along the body's x and y axes, and its
/// acceleration along them.
pub const LOADS: usize = 4;
/// Unknowns of a compliance: δ by each load, one after the other.
pub const COMPLIANCE: usize = 6 * LOADS;
/// Standard deviations of the prior of a compliance: a degree of tilt bends by some tenths of a degree and
/// some millimetres. Radians per g, metres per g.
pub const COMPLIANCE_SIGMA: [f64; 2] = [0.3, 0.5];

/// Loads are tabulated at this step, seconds.
const STEP_S: f64 = 0.1;
/// Accelerations are second differences over this time to both sides, which smooth over it, seconds.
const SMOOTH_S: f64 = 0.5;

/// How a mounting follows the load on the frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Compliance {
    /// (δφ, δp) in body axes by each load, one after the other: radians and metres per g.
    pub by_load: [f64; COMPLIANCE],
    /// Standard deviations.
    pub sigma: [f64; COMPLIANCE],
    /// The load at which the mounting is its mean, in g.
    pub mean_load: [f64; LOADS],
}

impl Compliance {
    /// None, beside that of another scanner.
    pub fn rigid_beside(other: Self) -> Self {
        Self {
            by_load: [0.0; COMPLIANCE],
            sigma: [0.0; COMPLIANCE],
            ..other
        }
    }

    /// (δφ, δp) under a load.
    pub fn offset(&self, load: &[f64; LOADS]) -> [f64; 6] {
        let off = std::array::from_fn(|axis| load[axis] - self.mean_load[axis]);
        under(&self.by_load, &off)
    }
}

/// How much a mounting may move: each rung includes those before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Rung {
    /// Not at all.
    Rigid,
    /// Linearly with the load.
    Compliance,
    /// And slowly with time.
    SlowKnots,
    /// And as fast as the trajectory is known.
    DenseKnots,
}

impl Rung {
    /// The next one up.
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

    /// Spacing and correlation time of its knots, seconds, and standard deviations of rotations (radians)
    /// and positions (metres).
    fn knots(self) -> Option<(f64, f64, [f64; 2])> {
        match self {
            Self::Rigid | Self::Compliance => None,
            Self::SlowKnots => Some((2.0, 30.0, [1.5e-3, 2e-3])),
            Self::DenseKnots => Some((0.5, 5.0, [1.5e-3, 2e-3])),
        }
    }
}

/// The load at a time: −Rᵀ g / |g| and Rᵀ a / |g| along x and y, with a from second differences.
pub fn load_at(trajectory: &Trajectory, time_s: f64) -> Option<[f64; LOADS]> {
    let (first_s, last_s) = trajectory.span_s();
    // At the ends of a drive the body is taken to move on as it does half a second from there.
    let [low_s, high_s] = match last_s - first_s > 2.0 * SMOOTH_S {
        true => [first_s + SMOOTH_S, last_s - SMOOTH_S],
        false => [0.5 * (first_s + last_s); 2],
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

/// ℓ − ℓ̄ along a drive.
fn loads(trajectory: &Trajectory, mean: &[f64; LOADS]) -> Series<LOADS> {
    Series::sampled(trajectory.span_s(), STEP_S, |time_s| {
        let load = load_at(trajectory, time_s).unwrap_or(*mean);
        std::array::from_fn(|axis| load[axis] - mean[axis])
    })
}

/// Values of all that moves mountings.
#[derive(Debug, Clone)]
pub struct Bends {
    /// How much they may move.
    pub rung: Rung,
    /// ℓ̄, over all drives.
    pub mean_load: [f64; LOADS],
    /// ℓ − ℓ̄ along each drive.
    pub loads: Arc<Vec<Series<LOADS>>>,
    /// C of each scanner, column by column.
    pub compliance: Vec<[f64; COMPLIANCE]>,
    /// What is known of it beforehand: values and standard deviations.
    pub prior: Vec<[[f64; COMPLIANCE]; 2]>,
    /// m of each scanner of each drive; empty without knots.
    pub knots: Vec<Vec<GaussMarkov>>,
}

impl Bends {
    /// Bent as another adjustment found, or not yet; `None` where mountings stay rigid or a drive has no
    /// trajectory.
    pub fn new(
        rung: Rung,
        motions: &[Box<dyn Motion>],
        mountings: &[Mounting],
        known: &[Compliance],
    ) -> Option<Self> {
        if rung == Rung::Rigid {
            return None;
        }
        let records = motions.iter().map(|motion| motion.records(None));
        let drives: Vec<Trajectory> = records
            .map(|records: Vec<PoseRecord>| Trajectory::new(records).ok())
            .collect::<Option<_>>()?;
        let mut all = Vec::new();
        for drive in &drives {
            let (first_s, last_s) = drive.span_s();
            let count = ((last_s - first_s) / STEP_S) as usize;
            all.extend((0..=count).filter_map(|i| load_at(drive, first_s + STEP_S * i as f64)));
        }
        let mean_load = known.first().map(|known| known.mean_load);
        let mean_load = mean_load.unwrap_or_else(|| {
            std::array::from_fn(|axis| {
                all.iter().map(|load| load[axis]).sum::<f64>() / all.len().max(1) as f64
            })
        });
        // A position or rotation that is fixed as a whole does not bend either.
        let sigma = |mounting: &Mounting, i: usize| {
            let [turns, shifts] = [&mounting.fixed[3..], &mounting.fixed[..3]];
            let fixed = if i % 6 < 3 { turns } else { shifts };
            match fixed == [true; 3] {
                true => 0.0,
                false => COMPLIANCE_SIGMA[i % 6 / 3],
            }
        };
        let prior = mountings.iter().enumerate().map(|(scanner, mounting)| {
            let unknown = [
                [0.0; COMPLIANCE],
                std::array::from_fn(|i| sigma(mounting, i)),
            ];
            let known = known.get(scanner);
            known.map_or(unknown, |known| [known.by_load, known.sigma])
        });
        let prior: Vec<_> = prior.collect();
        let loads = drives.iter().map(|drive| loads(drive, &mean_load));
        let knots = rung.knots().map(|(spacing_s, correlation_s, sigma)| {
            let [turn, shift] = sigma;
            let sigma = vec![turn, turn, turn, shift, shift, shift];
            let of_drive = |motion: &dyn Motion| {
                let times = knot_times(motion, spacing_s);
                let process = GaussMarkov::at_knots(times, sigma.clone(), correlation_s);
                vec![process; mountings.len()]
            };
            motions.iter().map(AsRef::as_ref).map(of_drive).collect()
        });
        Some(Self {
            rung,
            mean_load,
            loads: Arc::new(loads.collect()),
            compliance: prior.iter().map(|[value, _]| *value).collect(),
            prior,
            knots: knots.unwrap_or_default(),
        })
    }

    /// (δφ, δp) of a scanner at a time of a drive.
    pub fn offset(&self, drive: usize, scanner: usize, time_s: f64) -> [f64; 6] {
        let load = self.loads[drive].at(time_s);
        let mut offset = under(&self.compliance[scanner], &load);
        if let Some(process) = self.knots.get(drive).map(|of_drive| &of_drive[scanner]) {
            let (knot, u) = process.locate(time_s);
            let (before, after) = (process.of_knot(knot), process.of_knot(knot + 1));
            for (i, value) in offset.iter_mut().enumerate() {
                *value += before[i] * (1.0 - u) + after[i] * u;
            }
        }
        offset
    }
}

/// Nodes of a motion at least so far apart, with both ends: no row lies across one.
fn knot_times(motion: &dyn Motion, spacing_s: f64) -> Vec<f64> {
    let nodes = (0..motion.steps()).map(|step| motion.poses(step).knots);
    let ends: Vec<(f64, f64)> = nodes
        .map(|knots| (knots[0].time_s, knots[knots.len() - 1].time_s))
        .collect();
    let mut times = Vec::new();
    for (begin_s, end_s) in ends {
        let last_s = *times.last().unwrap_or(&f64::NEG_INFINITY);
        // Nodes are as far apart as asked for but for rounding.
        if begin_s - last_s > 0.99 * spacing_s {
            times.push(begin_s);
        }
        if end_s - times[times.len() - 1] > 0.99 * spacing_s {
            times.push(end_s);
        }
    }
    let last_s = motion
        .poses(motion.steps() - 1)
        .knots
        .last()
        .map(|knot| knot.time_s);
    if times.len() < 2 || last_s.is_some_and(|last_s| last_s > times[times.len() - 1]) {
        times.extend(last_s);
    }
    times
}

/// C ℓ.
pub fn under(compliance: &[f64; COMPLIANCE], load: &[f64; LOADS]) -> [f64; 6] {
    std::array::from_fn(|i| {
        (0..LOADS)
            .map(|axis| compliance[6 * axis + i] * load[axis])
            .sum()
    })
}
