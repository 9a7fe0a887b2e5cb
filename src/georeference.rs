//! Equation (1) of the paper for streams of laser points: x_m = t_mb(t) + R_mb(t) (t_bs + R_bs x_s).

use std::fmt;

use crate::error::{Error, Result};
use crate::geometry::{Pose, Vec3, transform};
use crate::sensor::{ScanPoint, check_overlap, unit_of_times_within};
use crate::trajectory::PoseLimits;
use crate::trajectory::{PoseCursor, Trajectory};

/// Points that no pose is good enough for: the project bounds the sigmas of poses.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Refused {
    /// How many.
    pub points: u64,
    /// First and last time of each run of them, seconds on the common clock.
    pub spans_s: Vec<(f64, f64)>,
    /// The bounds.
    pub limits: PoseLimits,
}

/// Spans that are told one by one.
const SPANS_TOLD: usize = 5;

impl fmt::Display for Refused {
    /// `1200 points from 12.1 s to 14.0 s, whose poses have sigmas above 0.02 m`
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} points", self.points)?;
        for (index, (first, last)) in self.spans_s.iter().take(SPANS_TOLD).enumerate() {
            let comma = if index == 0 { "" } else { "," };
            write!(f, "{comma} from {first:.3} s to {last:.3} s")?;
        }
        if let Some((_, last)) = self.spans_s[self.spans_s.len().min(SPANS_TOLD)..].last() {
            let more = self.spans_s.len() - SPANS_TOLD;
            write!(f, " and in {more} more spans up to {last:.3} s")?;
        }
        let bounds = [
            self.limits
                .position_m
                .map(|m| format!("{m} m (max_sigma_position_m)")),
            self.limits
                .rotation_rad
                .map(|r| format!("{:.6}° (max_sigma_rotation_deg)", r.to_degrees())),
        ];
        let bounds: Vec<String> = bounds.into_iter().flatten().collect();
        write!(f, ", whose poses have sigmas above {}", bounds.join(" or "))
    }
}

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
    refused: Refused,
    /// The point before this one was refused.
    in_refused: bool,
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
            refused: Refused {
                limits: trajectory.limits(),
                ..Refused::default()
            },
            in_refused: false,
            span_s: (f64::INFINITY, f64::NEG_INFINITY),
        }
    }

    /// The common time of `point` and the pose world_from_body there; `None` outside the
    /// trajectory's span, where there is no pose and nothing is extrapolated, and where the pose
    /// is known less well than the trajectory's limits demand.
    #[inline]
    pub fn body_at(&mut self, point: &ScanPoint) -> (f64, Option<Pose>) {
        let time_s = point.time_s + self.time_offset_s;
        let pose = match self.last {
            Some((at, pose)) if at == time_s => pose,
            _ => self.cursor.pose_at(time_s),
        };
        self.last = Some((time_s, pose));
        self.read += 1;
        if pose.is_none() {
            self.count_missing(time_s);
        } else {
            self.in_refused = false;
        }
        self.span_s = (self.span_s.0.min(time_s), self.span_s.1.max(time_s));
        (time_s, pose)
    }

    #[cold]
    fn count_missing(&mut self, time_s: f64) {
        let (first, last) = self.trajectory.span_s();
        if !(first..=last).contains(&time_s) {
            self.outside += 1;
            self.in_refused = false;
            return;
        }
        self.refused.points += 1;
        match self.refused.spans_s.last_mut() {
            Some((_, last)) if self.in_refused => *last = time_s,
            _ => self.refused.spans_s.push((time_s, time_s)),
        }
        self.in_refused = true;
    }

    /// How many points were asked for.
    pub fn read(&self) -> u64 {
        self.read
    }

    /// How many of them lie outside the trajectory's span.
    pub fn outside(&self) -> u64 {
        self.outside
    }

    /// Those whose pose is known less well than the trajectory's limits demand.
    pub fn refused(&self) -> &Refused {
        &self.refused
    }

    /// Checks that the points of the scanner `name`, all shown by now, fall on the trajectory.
    ///
    /// # Errors
    /// There was no point, or none within the trajectory's span (with both spans), or none with a
    /// pose that is known well enough; times of poses or points that are not in seconds.
    pub fn check(&self, name: &str) -> Result<()> {
        if self.read == 0 {
            return Err(Error::data(
                format!("scanner `{name}` has no points"),
                "check that the profile file is the right one and not empty",
            ));
        }
        let refused = &self.refused;
        if self.outside + refused.points < self.read {
            return self.check_units(name);
        }
        if refused.points > 0 {
            return Err(Error::data(
                format!("no point of scanner `{name}` can be placed: {refused}"),
                "raise the bound, or mend the trajectory where its sigmas grow",
            ));
        }
        let profiles = format!("the profiles of scanner `{name}`");
        let poses = ("the trajectory", self.trajectory.span_s());
        check_overlap((&profiles, self.span_s), poses)?;
        Err(Error::data(
            format!("no profile of scanner `{name}` falls on a pose of the trajectory"),
            "check the clocks; `time_offset_s` shifts a scanner",
        ))
    }

    /// Where the times of points and poses, both from zero on, are in different units, some points
    /// fall on the trajectory all the same.
    fn check_units(&self, name: &str) -> Result<()> {
        /// Slower poses place no points.
        const LONGEST_STEP_S: f64 = 1.0;
        const MOST_OUTSIDE: f64 = 0.99;
        const ALIKE: f64 = 4.0;
        let length = |(first, last): (f64, f64)| last - first;
        let (points_s, poses_s) = (length(self.span_s), length(self.trajectory.span_s()));
        let usual_step_s = || {
            let nodes = self.trajectory.nodes().windows(2);
            let mut steps: Vec<f64> = nodes.map(|w| w[1].time_s - w[0].time_s).collect();
            let middle = steps.len() / 2;
            // There are two nodes at least.
            *steps.select_nth_unstable_by(middle, f64::total_cmp).1
        };
        let spans = format!("the profiles span {points_s:.3} s, and the trajectory {poses_s:.3} s");
        if let Some(unit) = unit_of_times_within(poses_s / points_s, ALIKE) {
            let step_s = usual_step_s();
            if step_s > LONGEST_STEP_S {
                return Err(Error::data(
                    format!(
                        "time steps of {step_s:.3} s between poses: are these {unit}? ({spans})"
                    ),
                    "give the times of the trajectory in seconds",
                ));
            }
        }
        if let Some(unit) = unit_of_times_within(points_s / poses_s, ALIKE)
            && self.outside as f64 > MOST_OUTSIDE * self.read as f64
        {
            return Err(Error::data(
                format!("the times of scanner `{name}`: are these {unit}? ({spans})"),
                "give the times of the profiles in seconds",
            ));
        }
        Ok(())
    }

    /// Where `point` is in the world, metres; `None` as [`Self::body_at`].
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

    #[test]
    fn what_is_refused_is_counted_with_its_times() {
        let node = |time_s: f64, sigma: f64| PoseRecord {
            time_s,
            world_from_body: Pose::identity(),
            velocity_m_s: None,
            bias: None,
            sigma: Some(crate::sensor::PoseSigma {
                position_m: Vec3::repeat(sigma),
                rotation_rad: Vec3::zeros(),
            }),
        };
        // Intervals 2 to 3, 3 to 4 and 6 to 7, 7 to 8 touch a bad node.
        let nodes = (0..10).map(|i| node(f64::from(i), if i % 4 == 3 { 0.2 } else { 0.01 }));
        let limits = PoseLimits {
            position_m: Some(0.1),
            rotation_rad: None,
        };
        let trajectory = Trajectory::new(nodes.collect()).unwrap();
        let trajectory = trajectory.with_limits(limits).unwrap();
        let mut place = Georeferencer::new(&trajectory, Pose::identity(), 0.0);
        let at = |time_s: f64| ScanPoint {
            time_s,
            position_m: Vec3::x(),
            intensity: 0.0,
        };
        let placed = (-4..40).filter(|i| place.place(&at(f64::from(*i) * 0.25)).is_some());
        // 0 to 1.75, 4 to 5.75, 8 to 9 s; outside are −1 to −0.25 and 9.25 to 9.75 s.
        assert_eq!(placed.count(), 8 + 8 + 5);
        let refused = place.refused();
        assert_eq!((place.outside(), refused.points), (7, 16));
        assert_eq!(refused.spans_s, [(2.0, 3.75), (6.0, 7.75)]);
        assert_eq!(
            refused.to_string(),
            "16 points from 2.000 s to 3.750 s, from 6.000 s to 7.750 s, whose poses have sigmas \
             above 0.1 m (max_sigma_position_m)"
        );
        let mut place = Georeferencer::new(&trajectory, Pose::identity(), 0.0);
        place.place(&at(2.5));
        let error = place.check("left").unwrap_err().to_string();
        assert!(
            error.contains("scanner `left` can be placed: 1 points from 2.5"),
            "{error}"
        );
    }
}
