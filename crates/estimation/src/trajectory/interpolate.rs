//! Poses between nodes.

use serde::{Deserialize, Serialize};

use super::settings::PoseLimits;
use crate::error::{Error, Problem, Result};
use crate::geometry::{Rotation, Vec3, WorldFromBody};
use crate::sensor::{PoseRecord, PoseSigma};

/// Poses in strictly increasing time order, with interpolation between them.
///
/// Positions follow the cubic Hermite curve through positions and velocities where velocities are
/// known (its error is (Δt)⁴/384 times the fourth derivative: below a micrometre at IMU rate) and
/// the straight line elsewhere; attitudes turn at constant rate. Outside the span there is no
/// pose, nor between two nodes one of which is known less well than the limits demand.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Trajectory {
    nodes: Vec<PoseRecord>,
    limits: PoseLimits,
}

impl Trajectory {
    /// A trajectory through these nodes.
    ///
    /// # Errors
    /// Fewer than two nodes, or times that do not increase.
    pub fn new(nodes: Vec<PoseRecord>) -> Result<Self> {
        if nodes.len() < 2 {
            return Err(Error::of(
                Problem::TooFew,
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
        Ok(Self {
            nodes,
            limits: PoseLimits::default(),
        })
    }

    /// The same nodes; poses that are known less well than `limits` demand are withheld.
    ///
    /// # Errors
    /// There is a limit, but a pose has no standard deviations.
    pub fn with_limits(self, limits: PoseLimits) -> Result<Self> {
        let without = self.nodes.iter().find(|node| node.sigma.is_none());
        if let (false, Some(node)) = (limits.is_none(), without) {
            return Err(Error::data(
                format!(
                    "the sigmas of poses are bounded, but the pose at {:.6} s comes without \
                     standard deviations",
                    node.time_s
                ),
                "give sigma_position_m and sigma_rotation_deg in [trajectory], or leave out \
                 max_sigma_position_m and max_sigma_rotation_deg",
            ));
        }
        Ok(Self { limits, ..self })
    }

    /// The same nodes without limits.
    pub fn without_limits(self) -> Self {
        Self {
            limits: PoseLimits::default(),
            ..self
        }
    }

    /// How well a pose must be known to be given out.
    pub fn limits(&self) -> PoseLimits {
        self.limits
    }

    /// Whether both nodes of an interval are known as well as the limits demand.
    fn is_known(&self, index: usize) -> bool {
        if self.limits.is_none() {
            return true;
        }
        let within = |limit: Option<f64>, sigma: Vec3| limit.is_none_or(|most| sigma.max() <= most);
        self.nodes[index..index + 2].iter().all(|node| {
            node.sigma.is_some_and(|sigma| {
                within(self.limits.position_m, sigma.position_m)
                    && within(self.limits.rotation_rad, sigma.rotation_rad)
            })
        })
    }

    /// The poses in time order.
    pub fn poses(&self) -> &[PoseRecord] {
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

    /// The pose world_from_body at `time_s`; `None` outside the span and beyond the limits.
    pub fn pose_at(&self, time_s: f64) -> Option<WorldFromBody> {
        self.locate(time_s)
            .and_then(|(index, fraction)| self.between(index, fraction))
    }

    /// Standard deviations of the pose at `time_s`, linear between the nodes; `None` outside the span and where
    /// a node has none.
    pub fn sigma_at(&self, time_s: f64) -> Option<PoseSigma> {
        let (index, fraction) = self.locate(time_s)?;
        let (a, b) = (self.nodes[index].sigma?, self.nodes[index + 1].sigma?);
        Some(PoseSigma {
            position_m: a.position_m.lerp(&b.position_m, fraction),
            rotation_rad: a.rotation_rad.lerp(&b.rotation_rad, fraction),
        })
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

    /// `None` beyond the limits.
    fn between(&self, index: usize, u: f64) -> Option<WorldFromBody> {
        if !self.is_known(index) {
            return None;
        }
        let (a, b) = (&self.nodes[index], &self.nodes[index + 1]);
        let (pa, pb) = (
            a.world_from_body.translation_m,
            b.world_from_body.translation_m,
        );
        let translation = match (a.velocity_m_s, b.velocity_m_s) {
            (Some(va), Some(vb)) => hermite(pa, va, pb, vb, b.time_s - a.time_s, u),
            _ => pa + (pb - pa) * u,
        };
        let rotation = turn(&a.world_from_body.rotation, &b.world_from_body.rotation, u);
        Some(WorldFromBody::new(rotation, translation))
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

/// Remembers the interval of the last time asked for, so that a stream of times needs no search.
#[derive(Debug, Clone)]
pub struct PoseCursor<'a> {
    trajectory: &'a Trajectory,
    index: usize,
}

impl PoseCursor<'_> {
    /// The pose world_from_body at `time_s`; `None` outside the span and beyond the limits.
    pub fn pose_at(&mut self, time_s: f64) -> Option<WorldFromBody> {
        let nodes = &self.trajectory.nodes;
        let mut steps = 0;
        while steps < 8 && self.index + 2 < nodes.len() && nodes[self.index + 1].time_s <= time_s {
            self.index += 1;
            steps += 1;
        }
        if nodes[self.index].time_s <= time_s && time_s < nodes[self.index + 1].time_s {
            let fraction = self.trajectory.fraction(self.index, time_s);
            return self.trajectory.between(self.index, fraction);
        }
        let (index, fraction) = self.trajectory.locate(time_s)?;
        self.index = index;
        self.trajectory.between(index, fraction)
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
            world_from_body: WorldFromBody::new(
                Rotation::from_scaled_axis(Vec3::new(0.1, 0.2, -0.3) * t),
                Vec3::new(t * t * t, 1.0 - t, 2.0 * t * t),
            ),
            velocity_m_s: Some(Vec3::new(3.0 * t * t, -1.0, 4.0 * t)),
            bias: None,
            sigma: None,
        }
    }

    #[test]
    fn cubic_motion_is_reproduced_and_not_extrapolated() {
        let trajectory = Trajectory::new((0..=20).map(|i| record(f64::from(i) * 0.1)).collect())
            .expect("valid nodes");
        let mut cursor = trajectory.cursor();
        for time_s in [0.0, 0.033, 0.1, 1.987, 0.5, 2.0] {
            let truth = record(time_s).world_from_body;
            let direct = trajectory.pose_at(time_s).expect("inside");
            assert!((direct.translation_m - truth.translation_m).norm() < 1e-12);
            assert!(direct.rotation.angle_to(&truth.rotation) < 1e-7);
            assert_eq!(cursor.pose_at(time_s), Some(direct));
        }
        assert_eq!(trajectory.pose_at(-1e-9), None);
        assert_eq!(cursor.pose_at(2.0 + 1e-9), None);
    }

    #[test]
    fn standard_deviations_are_linear_between_nodes() {
        let node = |i: i32| PoseRecord {
            sigma: Some(PoseSigma {
                position_m: Vec3::repeat(0.01 * f64::from(i)),
                rotation_rad: Vec3::repeat(f64::from(i)),
            }),
            ..record(f64::from(i))
        };
        let trajectory = Trajectory::new(vec![node(1), node(3), record(4.0)]).unwrap();
        let sigma = trajectory.sigma_at(1.5).unwrap();
        assert!((sigma.position_m.x - 0.015).abs() < 1e-15);
        assert!((sigma.rotation_rad.z - 1.5).abs() < 1e-15);
        assert_eq!(trajectory.sigma_at(3.5), None);
        assert_eq!(trajectory.sigma_at(0.5), None);
    }

    #[test]
    fn poses_beyond_the_limits_are_not_given_out() {
        // Sigmas grow to 4 cm and 4° at node 4 and shrink again; nodes 0 to 8, a second apart.
        let node = |i: i32| {
            let grown = f64::from(4 - (i - 4).abs());
            PoseRecord {
                sigma: Some(PoseSigma {
                    position_m: Vec3::new(0.001, 0.01 * grown, 0.002),
                    rotation_rad: Vec3::new(0.0, 0.0, grown.to_radians()),
                }),
                ..record(f64::from(i))
            }
        };
        let trajectory = Trajectory::new((0..=8).map(node).collect()).unwrap();
        let given = |limits: PoseLimits| {
            let trajectory = trajectory.clone().with_limits(limits).unwrap();
            let mut cursor = trajectory.cursor();
            let times = (0..8).map(|i| f64::from(i) + 0.5);
            let given = |time_s| {
                let pose = trajectory.pose_at(time_s);
                assert_eq!(cursor.pose_at(time_s), pose);
                pose.is_some()
            };
            times.map(given).collect::<Vec<bool>>()
        };
        let limits = PoseLimits {
            position_m: Some(0.021),
            rotation_rad: None,
        };
        let expected = [true, true, false, false, false, false, true, true];
        assert_eq!(given(limits), expected);
        let limits = PoseLimits {
            rotation_rad: Some(1.1_f64.to_radians()),
            ..limits
        };
        let expected = [true, false, false, false, false, false, false, true];
        assert_eq!(given(limits), expected);
        assert_eq!(given(PoseLimits::default()), [true; 8]);

        let bare = Trajectory::new(vec![record(0.0), record(1.0)]).unwrap();
        assert!(bare.clone().with_limits(PoseLimits::default()).is_ok());
        let error = bare.with_limits(limits).unwrap_err().to_string();
        assert!(
            error.contains("0.000000 s comes without standard deviations"),
            "{error}"
        );
    }

    #[test]
    fn backward_time_is_refused() {
        let error = Trajectory::new(vec![record(1.0), record(1.0)]).unwrap_err();
        assert!(error.to_string().contains("increase"), "{error}");
    }
}
