//! Georeferencing of streams of laser points, equation (1) of the paper:
//! x_m = t_mb(t) + R_mb(t) (t_bs + R_bs x_s).

use std::fmt;

use crate::error::{Error, Problem, Result};
use crate::geometry::{Bending, BodyFromScanner, Vec3, WorldFromBody};
use crate::sensor::{ScanPoint, check_overlap, time_unit_within};
use crate::statistics::median;
use crate::trajectory::PoseLimits;
use crate::trajectory::{PoseCursor, Trajectory};

/// Points left out because the standard deviations of their poses exceed the project's limits.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ExcludedPoints {
    /// Number of points.
    pub points: u64,
    /// First and last time of each run of such points, seconds on the common clock.
    pub spans_s: Vec<(f64, f64)>,
    /// The limits.
    pub limits: PoseLimits,
}

/// Number of spans listed one by one.
const SPANS_LISTED: usize = 5;

impl fmt::Display for ExcludedPoints {
    /// `1200 points from 12.1 s to 14.0 s, whose poses have standard deviations above 0.02 m`
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} points", self.points)?;
        for (index, (first, last)) in self.spans_s.iter().take(SPANS_LISTED).enumerate() {
            let comma = if index == 0 { "" } else { "," };
            write!(f, "{comma} from {first:.3} s to {last:.3} s")?;
        }
        if let Some((_, last)) = self.spans_s[self.spans_s.len().min(SPANS_LISTED)..].last() {
            let more = self.spans_s.len() - SPANS_LISTED;
            write!(f, " and {more} more spans up to {last:.3} s")?;
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
        write!(
            f,
            ", whose poses have standard deviations above {}",
            bounds.join(" or ")
        )
    }
}

/// Places the points of one scanner in the world, in the order they were measured.
#[derive(Debug, Clone)]
pub struct Georeferencer<'a> {
    trajectory: &'a Trajectory,
    cursor: PoseCursor<'a>,
    body_from_scanner: BodyFromScanner,
    bending: Option<&'a Bending>,
    time_offset_s: f64,
    last: Option<(f64, Option<WorldFromBody>)>,
    /// The last bent mounting and its time, seconds.
    bent: Option<(f64, BodyFromScanner)>,
    read: u64,
    outside: u64,
    excluded: ExcludedPoints,
    /// Whether the previous point was excluded.
    in_excluded_span: bool,
    span_s: (f64, f64),
}

impl<'a> Georeferencer<'a> {
    /// Creates a georeferencer for a scanner mounted at `body_from_scanner`. `time_offset_s` is
    /// added to the scanner's times to get the trajectory's.
    pub fn new(
        trajectory: &'a Trajectory,
        body_from_scanner: BodyFromScanner,
        time_offset_s: f64,
    ) -> Self {
        Self {
            trajectory,
            cursor: trajectory.cursor(),
            body_from_scanner,
            bending: None,
            time_offset_s,
            last: None,
            bent: None,
            read: 0,
            outside: 0,
            excluded: ExcludedPoints {
                limits: trajectory.limits(),
                ..ExcludedPoints::default()
            },
            in_excluded_span: false,
            span_s: (f64::INFINITY, f64::NEG_INFINITY),
        }
    }

    /// Adds offsets by which the mounting bends about the given one.
    pub fn with_bending(mut self, bending: Option<&'a Bending>) -> Self {
        self.bending = bending;
        self
    }

    /// Returns the common time of `point` and the pose world_from_body at that time. The pose is
    /// `None` outside the trajectory's span (nothing is extrapolated) and where its standard
    /// deviations exceed the trajectory's limits.
    #[inline]
    pub fn body_at(&mut self, point: &ScanPoint) -> (f64, Option<WorldFromBody>) {
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
            self.in_excluded_span = false;
        }
        self.span_s = (self.span_s.0.min(time_s), self.span_s.1.max(time_s));
        (time_s, pose)
    }

    #[cold]
    fn count_missing(&mut self, time_s: f64) {
        let (first, last) = self.trajectory.span_s();
        if !(first..=last).contains(&time_s) {
            self.outside += 1;
            self.in_excluded_span = false;
            return;
        }
        self.excluded.points += 1;
        match self.excluded.spans_s.last_mut() {
            Some((_, last)) if self.in_excluded_span => *last = time_s,
            _ => self.excluded.spans_s.push((time_s, time_s)),
        }
        self.in_excluded_span = true;
    }

    /// Number of points passed in.
    pub fn read(&self) -> u64 {
        self.read
    }

    /// Number of points outside the trajectory's span.
    pub fn outside(&self) -> u64 {
        self.outside
    }

    /// Points whose pose exceeds the trajectory's limits.
    pub fn excluded(&self) -> &ExcludedPoints {
        &self.excluded
    }

    /// Checks that the points passed in so far, all points of scanner `name`, lie on the
    /// trajectory.
    ///
    /// # Errors
    /// No points at all, no point within the trajectory's span (with both spans), or no point with a
    /// pose within the limits; times of poses or points that are not in seconds.
    pub fn check(&self, name: &str) -> Result<()> {
        if self.read == 0 {
            return Err(Error::of(
                Problem::TooFew,
                format!("scanner `{name}` has no points"),
                "check that the profile file is the right one and not empty",
            ));
        }
        let excluded = &self.excluded;
        if self.outside + excluded.points < self.read {
            return self.check_units(name);
        }
        if excluded.points > 0 {
            return Err(Error::of(
                Problem::NotDetermined,
                format!("no point of scanner `{name}` can be placed: {excluded}"),
                "raise the limit, or improve the trajectory where its standard deviations grow",
            ));
        }
        let profiles = format!("the profiles of scanner `{name}`");
        let poses = ("the trajectory", self.trajectory.span_s());
        check_overlap((&profiles, self.span_s), poses)?;
        Err(Error::of(
            Problem::NoOverlap,
            format!("no profile of scanner `{name}` lies within the trajectory"),
            "check the clocks; `time_offset_s` shifts the times of a scanner",
        ))
    }

    /// Checks that points and poses have times in the same unit. If both start at zero, some points
    /// lie within the trajectory even if the units differ.
    fn check_units(&self, name: &str) -> Result<()> {
        /// Longest plausible time step between poses.
        const MAX_STEP_S: f64 = 1.0;
        const MAX_SHARE_OUTSIDE: f64 = 0.99;
        const TOLERANCE_FACTOR: f64 = 4.0;
        let length = |(first, last): (f64, f64)| last - first;
        let (points_s, poses_s) = (length(self.span_s), length(self.trajectory.span_s()));
        let poses = self.trajectory.poses().windows(2);
        // One wild stamp changes the span but not the median step.
        let step_s = median(poses.map(|pair| pair[1].time_s - pair[0].time_s)).unwrap_or(f64::NAN);
        let spans = format!("the profiles span {points_s:.3} s, and the trajectory {poses_s:.3} s");
        if let Some(unit) = time_unit_within(poses_s / points_s, TOLERANCE_FACTOR)
            && step_s > MAX_STEP_S
        {
            return Err(Error::data(
                format!("time steps of {step_s:.3} s between poses: are these {unit}? ({spans})"),
                "give the times of the trajectory in seconds",
            ));
        }
        if let Some(unit) = time_unit_within(points_s / poses_s, TOLERANCE_FACTOR)
            && self.outside as f64 > MAX_SHARE_OUTSIDE * self.read as f64
        {
            return Err(Error::data(
                format!("the times of scanner `{name}`: are these {unit}? ({spans})"),
                "give the times of the profiles in seconds",
            ));
        }
        Ok(())
    }

    /// Returns the position of `point` in the world, metres; `None` as for [`Self::body_at`].
    #[inline]
    pub fn place(&mut self, point: &ScanPoint) -> Option<Vec3> {
        let (time_s, world_from_body) = self.body_at(point);
        let mounting = match self.bending {
            Some(bending) => self.bent_at(bending, time_s),
            None => self.body_from_scanner,
        };
        world_from_body.map(|pose| pose.map(&mounting.map(&point.position_m)))
    }

    /// The bent mounting at `time_s`, computed once for all points of a profile.
    fn bent_at(&mut self, bending: &Bending, time_s: f64) -> BodyFromScanner {
        match self.bent {
            Some((at, mounting)) if at == time_s => mounting,
            _ => {
                let mounting = bending.apply(&self.body_from_scanner, time_s);
                self.bent = Some((time_s, mounting));
                mounting
            }
        }
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
            world_from_body: WorldFromBody::new(
                Rotation::from_euler_angles(0.0, 0.0, std::f64::consts::FRAC_PI_2),
                Vec3::new(10.0, 0.0, 2.0),
            ),
            velocity_m_s: None,
            bias: None,
            sigma: None,
        };
        let trajectory = Trajectory::new(vec![record(0.0), record(1.0)]).expect("two nodes");
        let mounting = BodyFromScanner::new(Rotation::identity(), Vec3::new(1.0, 0.0, 0.0));
        let mut place = Georeferencer::new(&trajectory, mounting, 0.5);
        let point = |time_s: f64| ScanPoint {
            time_s,
            position_m: Vec3::new(0.2, 0.0, -1.0),
            intensity: 0.0,
        };
        let placed = place.place(&point(0.0)).expect("0.5 s is inside");
        assert!(
            (placed - Vec3::new(10.0, 1.2, 1.0)).norm() < 1e-12,
            "{placed}"
        );
        assert_eq!(place.place(&point(0.6)), None);
        assert_eq!((place.read(), place.outside()), (2, 1));
        assert!(place.check("left").is_ok());
    }

    #[test]
    fn excluded_points_are_counted_with_their_times() {
        let node = |time_s: f64, sigma: f64| PoseRecord {
            time_s,
            world_from_body: WorldFromBody::identity(),
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
        let mut place = Georeferencer::new(&trajectory, BodyFromScanner::identity(), 0.0);
        let at = |time_s: f64| ScanPoint {
            time_s,
            position_m: Vec3::x(),
            intensity: 0.0,
        };
        let placed = (-4..40).filter(|i| place.place(&at(f64::from(*i) * 0.25)).is_some());
        // 0 to 1.75, 4 to 5.75, 8 to 9 s; outside are −1 to −0.25 and 9.25 to 9.75 s.
        assert_eq!(placed.count(), 8 + 8 + 5);
        let excluded = place.excluded();
        assert_eq!((place.outside(), excluded.points), (7, 16));
        assert_eq!(excluded.spans_s, [(2.0, 3.75), (6.0, 7.75)]);
        assert_eq!(
            excluded.to_string(),
            "16 points from 2.000 s to 3.750 s, from 6.000 s to 7.750 s, whose poses have standard deviations \
             above 0.1 m (max_sigma_position_m)"
        );
        let mut place = Georeferencer::new(&trajectory, BodyFromScanner::identity(), 0.0);
        place.place(&at(2.5));
        let error = place.check("left").unwrap_err().to_string();
        assert!(
            error.contains("scanner `left` can be placed: 1 points from 2.5"),
            "{error}"
        );
    }
}
