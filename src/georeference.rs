//! Equation (1) of the paper for streams of laser points: x_m = t_mb(t) + R_mb(t) (t_bs + R_bs x_s).

use crate::error::{Error, Result};
use crate::geometry::{Pose, Vec3, transform};
use crate::sensor::{ScanPoint, check_overlap};
use crate::trajectory::{PoseCursor, Trajectory};

/// Places the points of one scanner in the world, in the order they were measured.
#[derive(Debug, Clone)]
pub struct Georeferencer<'a> {
    trajectory: &'a Trajectory,
    cursor: PoseCursor<'a>,
    body_from_scanner: Pose,
    time_offset_s: f64,
    last: Option<(f64, Option<Pose>)>,
    read: u64,
    outside: u64,
    span_s: (f64, f64),
}

impl<'a> Georeferencer<'a> {
    /// For a scanner mounted at `body_from_scanner` whose times become the trajectory's by adding
    /// `time_offset_s`.
    pub fn new(trajectory: &'a Trajectory, body_from_scanner: Pose, time_offset_s: f64) -> Self {
        Self {
            trajectory,
            cursor: trajectory.cursor(),
            body_from_scanner,
            time_offset_s,
            last: None,
            read: 0,
            outside: 0,
            span_s: (f64::INFINITY, f64::NEG_INFINITY),
        }
    }

    /// The common time of `point` and the pose world_from_body there; `None` outside the
    /// trajectory's span, where there is no pose and nothing is extrapolated.
    #[inline]
    pub fn body_at(&mut self, point: &ScanPoint) -> (f64, Option<Pose>) {
        let time_s = point.time_s + self.time_offset_s;
        let pose = match self.last {
            Some((at, pose)) if at == time_s => pose,
            _ => self.cursor.pose_at(time_s),
        };
        self.last = Some((time_s, pose));
        self.read += 1;
        self.outside += u64::from(pose.is_none());
        self.span_s = (self.span_s.0.min(time_s), self.span_s.1.max(time_s));
        (time_s, pose)
    }

    /// How many points were asked for.
    pub fn read(&self) -> u64 {
        self.read
    }

    /// How many of them lie outside the trajectory's span.
    pub fn outside(&self) -> u64 {
        self.outside
    }

    /// Checks that the points of the scanner `name`, all shown by now, fall on the trajectory.
    ///
    /// # Errors
    /// There was no point, or none within the trajectory's span (with both spans).
    pub fn check(&self, name: &str) -> Result<()> {
        if self.read == 0 {
            return Err(Error::data(
                format!("scanner `{name}` has no points"),
                "check that the profile file is the right one and not empty",
            ));
        }
        if self.outside < self.read {
            return Ok(());
        }
        let profiles = format!("the profiles of scanner `{name}`");
        let poses = ("the trajectory", self.trajectory.span_s());
        check_overlap((&profiles, self.span_s), poses)?;
        Err(Error::data(
            format!("no profile of scanner `{name}` falls on a pose of the trajectory"),
            "check the clocks; `time_offset_s` shifts a scanner",
        ))
    }

    /// Where `point` is in the world, metres; `None` outside the trajectory's span.
    #[inline]
    pub fn place(&mut self, point: &ScanPoint) -> Option<Vec3> {
        let (_, world_from_body) = self.body_at(point);
        world_from_body.map(|pose| {
            transform(
                &pose,
                &transform(&self.body_from_scanner, &point.position_m),
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Rotation;
    use crate::sensor::PoseRecord;

    #[test]
    fn equation_1_by_hand() {
        // The body turns a quarter about z at (10, 0, 2); the scanner sits 1 m ahead.
        let record = |time_s: f64| PoseRecord {
            time_s,
            world_from_body: crate::geometry::pose(
                Rotation::from_euler_angles(0.0, 0.0, std::f64::consts::FRAC_PI_2),
                Vec3::new(10.0, 0.0, 2.0),
            ),
            velocity_m_s: None,
            bias: None,
            sigma: None,
        };
        let trajectory = Trajectory::new(vec![record(0.0), record(1.0)]).expect("two nodes");
        let mounting = crate::geometry::pose(Rotation::identity(), Vec3::new(1.0, 0.0, 0.0));
        let mut place = Georeferencer::new(&trajectory, mounting, 0.5);
        let point = |time_s: f64| ScanPoint {
            time_s,
            position_m: Vec3::new(0.2, 0.0, -1.0),
            intensity: 0.0,
        };
        let found = place.place(&point(0.0)).expect("0.5 s is inside");
        assert!(
            (found - Vec3::new(10.0, 1.2, 1.0)).norm() < 1e-12,
            "{found}"
        );
        assert_eq!(place.place(&point(0.6)), None);
        assert_eq!((place.read(), place.outside()), (2, 1));
        assert!(place.check("left").is_ok());
    }
}
