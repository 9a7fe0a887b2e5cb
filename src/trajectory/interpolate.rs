//! Poses between nodes.

use crate::error::{Error, Result};
use crate::geometry::{Pose, Rotation, Vec3};
use crate::sensor::PoseRecord;

/// Poses in strictly increasing time order, with interpolation between them.
///
/// Positions follow the cubic Hermite curve through positions and velocities where velocities are
/// known (its error is (Δt)⁴/384 times the fourth derivative: below a micrometre at IMU rate) and
/// the straight line elsewhere; attitudes turn at constant rate. Outside the span there is no pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    nodes: Vec<PoseRecord>,
}

impl Trajectory {
    /// Checks and takes the nodes.
    ///
    /// # Errors
    /// Fewer than two nodes, or times that do not increase.
    pub fn new(nodes: Vec<PoseRecord>) -> Result<Self> {
        if nodes.len() < 2 {
            return Err(Error::data(
                format!("a trajectory of {} poses spans no time", nodes.len()),
                "give at least two poses",
            ));
        }
        if let Some(pair) = nodes
            .windows(2)
            .find(|pair| pair[1].time_s <= pair[0].time_s)
        {
            return Err(Error::data(
                format!(
                    "the trajectory's time goes from {:.6} s to {:.6} s",
                    pair[0].time_s, pair[1].time_s
                ),
                "times must increase strictly; remove duplicated or backward rows",
            ));
        }
        Ok(Self { nodes })
    }

    /// The nodes in time order.
    pub fn nodes(&self) -> &[PoseRecord] {
        &self.nodes
    }

    /// First and last time, seconds.
    pub fn span_s(&self) -> (f64, f64) {
        (
            self.nodes[0].time_s,
            self.nodes[self.nodes.len() - 1].time_s,
        )
    }

    /// The node at or before `time_s` that starts an interval, and the fraction (0 to 1) of the
    /// interval passed; `None` outside the span.
    pub fn locate(&self, time_s: f64) -> Option<(usize, f64)> {
        let (first, last) = self.span_s();
        if !(first..=last).contains(&time_s) {
            return None;
        }
        let after = self.nodes.partition_point(|node| node.time_s <= time_s);
        let index = (after - 1).min(self.nodes.len() - 2);
        Some((index, self.fraction(index, time_s)))
    }

    /// The pose world_from_body at `time_s`; `None` outside the span.
    pub fn pose_at(&self, time_s: f64) -> Option<Pose> {
        self.locate(time_s)
            .map(|(index, fraction)| self.between(index, fraction))
    }

    /// A cursor for times that mostly increase, as profiles do.
    pub fn cursor(&self) -> PoseCursor<'_> {
        PoseCursor {
            trajectory: self,
            index: 0,
        }
    }

    fn fraction(&self, index: usize, time_s: f64) -> f64 {
        let (a, b) = (self.nodes[index].time_s, self.nodes[index + 1].time_s);
        (time_s - a) / (b - a)
    }

    fn between(&self, index: usize, u: f64) -> Pose {
        let (a, b) = (&self.nodes[index], &self.nodes[index + 1]);
        let (pa, pb) = (
            a.world_from_body.translation.vector,
            b.world_from_body.translation.vector,
        );
        let translation = match (a.velocity_m_s, b.velocity_m_s) {
            (Some(va), Some(vb)) => hermite(pa, va, pb, vb, b.time_s - a.time_s, u),
            _ => pa + (pb - pa) * u,
        };
        let rotation = turn(&a.world_from_body.rotation, &b.world_from_body.rotation, u);
        Pose::from_parts(translation.into(), rotation)
    }
}

/// The rotation a fraction `u` of the way from `a` to `b` at constant rate.
fn turn(a: &Rotation, b: &Rotation, u: f64) -> Rotation {
    a * Rotation::from_scaled_axis((a.inverse() * b).scaled_axis() * u)
}

fn hermite(pa: Vec3, va: Vec3, pb: Vec3, vb: Vec3, dt: f64, u: f64) -> Vec3 {
    let (u2, u3) = (u * u, u * u * u);
    pa * (2.0 * u3 - 3.0 * u2 + 1.0)
        + va * (dt * (u3 - 2.0 * u2 + u))
        + pb * (3.0 * u2 - 2.0 * u3)
        + vb * (dt * (u3 - u2))
}

/// Remembers the interval of the last time asked for, so that a stream of times costs no search.
#[derive(Debug, Clone)]
pub struct PoseCursor<'a> {
    trajectory: &'a Trajectory,
    index: usize,
}

impl PoseCursor<'_> {
    /// The pose world_from_body at `time_s`; `None` outside the span.
    pub fn pose_at(&mut self, time_s: f64) -> Option<Pose> {
        let nodes = &self.trajectory.nodes;
        let mut steps = 0;
        while steps < 8 && self.index + 2 < nodes.len() && nodes[self.index + 1].time_s <= time_s {
            self.index += 1;
            steps += 1;
        }
        if nodes[self.index].time_s <= time_s && time_s < nodes[self.index + 1].time_s {
            let fraction = self.trajectory.fraction(self.index, time_s);
            return Some(self.trajectory.between(self.index, fraction));
        }
        let (index, fraction) = self.trajectory.locate(time_s)?;
        self.index = index;
        Some(self.trajectory.between(index, fraction))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(time_s: f64) -> PoseRecord {
        // Constant angular rate, cubic position: both are reproduced exactly.
        let t = time_s;
        PoseRecord {
            time_s,
            world_from_body: Pose::from_parts(
                Vec3::new(t * t * t, 1.0 - t, 2.0 * t * t).into(),
                Rotation::from_scaled_axis(Vec3::new(0.1, 0.2, -0.3) * t),
            ),
            velocity_m_s: Some(Vec3::new(3.0 * t * t, -1.0, 4.0 * t)),
            bias: None,
            sigma: None,
        }
    }

    #[test]
    fn cubic_motion_is_reproduced_and_ends_are_ends() {
        let trajectory = Trajectory::new((0..=20).map(|i| record(f64::from(i) * 0.1)).collect())
            .expect("valid nodes");
        let mut cursor = trajectory.cursor();
        for time_s in [0.0, 0.033, 0.1, 1.987, 0.5, 2.0] {
            let truth = record(time_s).world_from_body;
            let direct = trajectory.pose_at(time_s).expect("inside");
            assert!((direct.translation.vector - truth.translation.vector).norm() < 1e-12);
            assert!(direct.rotation.angle_to(&truth.rotation) < 1e-7);
            assert_eq!(cursor.pose_at(time_s), Some(direct));
        }
        assert_eq!(trajectory.pose_at(-1e-9), None);
        assert_eq!(cursor.pose_at(2.0 + 1e-9), None);
    }

    #[test]
    fn backward_time_is_refused() {
        let error = Trajectory::new(vec![record(1.0), record(1.0)]).unwrap_err();
        assert!(error.to_string().contains("increase"), "{error}");
    }
}
