//! A drive with given poses: corrections of the poses that are correlated in time.

use std::borrow::Cow;
use std::sync::Arc;

use nalgebra::DMatrix;

use super::gauss_markov::GaussMarkov;
use super::knots::{Knot, PoseDerivative, StepPoses};
use super::{ConstantValue, Motion, Places};
use crate::geometry::Vec3;
use crate::joint::row::RowBatch;
use crate::sensor::{PoseRecord, PoseSigma};
use crate::trajectory::Trajectory;

/// Unknowns of a knot: δφ in body axes, δp in world axes.
const SIZE: usize = 6;

/// Knots per correlation time.
const KNOTS: f64 = 10.0;
/// Longest time between knots, seconds: errors may turn out to last much shorter than was assumed.
const MAX_KNOT_S: f64 = 0.5;
/// Most knots per pose.
const KNOTS_PER_POSE: f64 = 4.0;

/// Poses and their corrections. The corrections are a Gauss-Markov process that starts with the poses' standard
/// deviations and a correlation time that is assumed; the adjustment estimates both where the scans determine them.
#[derive(Debug, Clone)]
pub struct CorrectedPoses {
    poses: Arc<Trajectory>,
    process: GaussMarkov,
}

impl CorrectedPoses {
    /// Poses with standard deviations; `None` if some poses have none. Errors are assumed to be equally
    /// large along the drive, with the root mean square of each component.
    pub fn new(trajectory: &Trajectory, correlation_s: f64) -> Option<Self> {
        let poses = trajectory.poses();
        let mut squares = [0.0; SIZE];
        for pose in poses {
            let sigma = pose.sigma?;
            // Rotations are given about the world's axes; with the same figure for all three they
            // are the same about the body's.
            let level = (sigma.rotation_rad.norm_squared() / 3.0).sqrt();
            let all = [Vec3::repeat(level), sigma.position_m].map(<[f64; 3]>::from);
            for (square, sigma) in squares.iter_mut().zip(all.as_flattened()) {
                *square += sigma * sigma;
            }
        }
        let sigma = squares.map(|square| (square / poses.len() as f64).sqrt());
        let span_s = trajectory.span_s();
        // At most a few knots per pose, however long the span of the poses.
        let count = ((span_s.1 - span_s.0) / (correlation_s / KNOTS).min(MAX_KNOT_S))
            .ceil()
            .clamp(1.0, KNOTS_PER_POSE * poses.len() as f64);
        // Rounding must not move the last knot beyond the last pose.
        let knot = |k: usize| {
            let time_s = span_s.0 + (span_s.1 - span_s.0) * k as f64 / count;
            time_s.min(span_s.1)
        };
        let knot_s = (0..=count as usize).map(knot).collect();
        Some(Self {
            process: GaussMarkov::at_knots(knot_s, sigma.to_vec(), correlation_s),
            poses: Arc::new(trajectory.clone().without_limits()),
        })
    }

    /// The correction (δφ, δp) at a time.
    fn correction(&self, time_s: f64) -> (Vec3, Vec3) {
        let at = |component: usize| self.process.at(time_s, component);
        (Vec3::from_fn(|i, _| at(i)), Vec3::from_fn(|i, _| at(3 + i)))
    }

    fn corrected(&self, pose: &PoseRecord) -> PoseRecord {
        let (dphi_rad, dp_m) = self.correction(pose.time_s);
        PoseRecord {
            world_from_body: pose.world_from_body.perturbed(&dphi_rad, &dp_m),
            ..*pose
        }
    }

    /// The pose at a time without its correction.
    fn uncorrected(&self, time_s: f64) -> Option<PoseRecord> {
        let (index, u) = self.poses.locate(time_s)?;
        let (a, b) = (&self.poses.poses()[index], &self.poses.poses()[index + 1]);
        let velocities = a.velocity_m_s.zip(b.velocity_m_s);
        Some(PoseRecord {
            velocity_m_s: velocities.map(|(a, b)| a * (1.0 - u) + b * u),
            ..PoseRecord::new(time_s, self.poses.pose_at(time_s)?)
        })
    }

    /// The poses of a step: those within it, and those at its two ends.
    fn within(&self, step: usize) -> Vec<PoseRecord> {
        let (from_s, to_s) = (self.process.knot_s[step], self.process.knot_s[step + 1]);
        let poses = self.poses.poses();
        let first = poses.partition_point(|pose| pose.time_s <= from_s);
        let end = poses.partition_point(|pose| pose.time_s < to_s);
        let mut within: Vec<_> = self.uncorrected(from_s).into_iter().collect();
        within.extend_from_slice(&poses[first.min(end)..end]);
        within.extend(self.uncorrected(to_s));
        within
    }
}

impl Motion for CorrectedPoses {
    fn blocks(&self) -> Vec<usize> {
        vec![SIZE; self.process.knot_s.len()]
    }

    fn groups(&self) -> Vec<String> {
        vec!["poses".into()]
    }

    fn steps(&self) -> usize {
        self.process.knot_s.len() - 1
    }

    fn step_at(&self, time_s: f64) -> Option<usize> {
        let knot_s = &self.process.knot_s;
        let within = knot_s[0] <= time_s && time_s <= knot_s[knot_s.len() - 1];
        within.then(|| self.process.locate(time_s).0)
    }

    fn pose_blocks(&self, step: usize) -> [usize; 2] {
        [step, step + 1]
    }

    /// The derivative of Exp(δφ) by δφ is the identity to first order of the correction.
    fn poses(&self, step: usize) -> Cow<'_, StepPoses> {
        let (from_s, to_s) = (self.process.knot_s[step], self.process.knot_s[step + 1]);
        let knots = self.within(step).into_iter().map(|pose| {
            let corrected = self.corrected(&pose);
            let share = (pose.time_s - from_s) / (to_s - from_s);
            let by: PoseDerivative = std::array::from_fn(|row| {
                std::array::from_fn(|column| match column {
                    c if c == row => 1.0 - share,
                    c if c == SIZE + row => share,
                    _ => 0.0,
                })
            });
            Knot {
                time_s: pose.time_s,
                world_from_body: corrected.world_from_body,
                velocity_m_s: corrected.velocity_m_s,
                by,
            }
        });
        Cow::Owned(StepPoses {
            knots: knots.collect(),
            width: SIZE,
        })
    }

    fn rows(&self, step: usize, places: &Places<'_>, batch: &mut RowBatch) {
        self.process
            .rows(step, places.first_block, places.first_group, batch);
    }

    fn moved(&self, step: &[f64], _constants: &[f64]) -> Box<dyn Motion> {
        let mut moved = self.clone();
        let values = moved.process.value.iter_mut();
        values.zip(step).for_each(|(x, d)| *x += d);
        Box::new(moved)
    }

    fn damping_sigma(&self) -> Vec<f64> {
        let sigma = self.process.sigma.iter().map(|s| s.max(f64::MIN_POSITIVE));
        sigma.collect::<Vec<_>>().repeat(self.process.knot_s.len())
    }

    fn records(
        &self,
        covariance: Option<&(dyn Fn(usize, usize) -> Option<DMatrix<f64>> + Sync)>,
    ) -> Vec<PoseRecord> {
        let poses = self.poses.poses().iter().map(|pose| {
            let mut record = self.corrected(pose);
            let (knot, u) = self.process.locate(pose.time_s);
            if let Some(block) = covariance
                && let (Some(a), Some(b), Some(c)) = (
                    block(knot, knot),
                    block(knot + 1, knot + 1),
                    block(knot, knot + 1),
                )
            {
                let (v, w) = (1.0 - u, u);
                let all = a * (v * v) + b * (w * w) + (&c + c.transpose()) * (v * w);
                let world = record.world_from_body.rotation.to_rotation_matrix();
                let turn =
                    world.matrix() * all.fixed_view::<3, 3>(0, 0) * world.matrix().transpose();
                let root = |x: f64| x.max(0.0).sqrt();
                record.sigma = Some(PoseSigma {
                    position_m: Vec3::from_fn(|i, _| root(all[(3 + i, 3 + i)])),
                    rotation_rad: Vec3::from_fn(|i, _| root(turn[(i, i)])),
                });
            }
            record
        });
        poses.collect()
    }

    fn constants(&self) -> Vec<ConstantValue> {
        Vec::new()
    }

    fn errors(&self) -> Option<&GaussMarkov> {
        Some(&self.process)
    }

    fn errors_mut(&mut self) -> Option<&mut GaussMarkov> {
        Some(&mut self.process)
    }

    fn boxed(&self) -> Box<dyn Motion> {
        Box::new(self.clone())
    }
}
