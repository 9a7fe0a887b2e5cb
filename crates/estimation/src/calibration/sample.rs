//! Thinning of hundreds of millions of laser points to the few that the adjustment needs.
//!
//! One point is kept per voxel, scanner and pass. A pass ends when the scanner has not seen the
//! voxel for a while. Passes are kept apart because the calibration minimises the disagreement
//! between them, which one point per voxel would hide.

use super::parameters::Mounting;
use super::settings::CalibrationSettings;
use crate::cloud::voxel::{VoxelKey, VoxelMap, voxel_key};
use crate::error::{Error, Result};
use crate::format::ProfileReader;
use crate::geometry::{BodyFromScanner, Vec3};
use crate::georeference::{ExcludedPoints, Georeferencer};
use crate::progress::Progress;
use crate::sensor::ScanPoint;
use crate::statistics::drawn;
use crate::surface::{Profile, ProfilePoint};
use crate::trajectory::Trajectory;

/// The thinned points of a scanner.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ScannerSample {
    /// Profiles in time order.
    pub profiles: Vec<Profile>,
    /// Points in the order of their profiles.
    pub points: Vec<ProfilePoint>,
    /// Number of laser points read.
    pub read: u64,
    /// Number of laser points left out because they lie outside the trajectory's span.
    pub outside: u64,
    /// Laser points left out because their poses exceed the trajectory's limits.
    pub excluded: ExcludedPoints,
}

impl ScannerSample {
    /// The points of the profiles at certain times (seconds), with all profiles.
    pub fn within(&self, is_within: impl Fn(f64) -> bool) -> Self {
        let mut part = self.clone();
        let is_kept =
            |point: &ProfilePoint| is_within(self.profiles[point.profile as usize].time_s);
        part.points.retain(is_kept);
        part
    }

    /// Thins `points_m` (scanner frame, metres), measured at `times_s` (seconds on the trajectory's
    /// clock, in time order), on the finest grid of `settings`.
    ///
    /// # Errors
    /// Different numbers of times and points, values that are not finite, times out of order, or no
    /// point within the trajectory's span.
    pub fn from_points(
        mounting: &Mounting,
        times_s: &[f64],
        points_m: &[Vec3],
        trajectory: &Trajectory,
        settings: &CalibrationSettings,
    ) -> Result<Self> {
        let name = &mounting.name;
        let wrong = |problem, remedy: &str| {
            let problem = format!("scanner `{name}`: {problem}");
            Err(Error::data(problem, remedy))
        };
        if times_s.len() != points_m.len() {
            let (times, points) = (times_s.len(), points_m.len());
            let problem = format!("{times} times for {points} points");
            return wrong(problem, "give one time for each point");
        }
        let points = times_s.iter().zip(points_m);
        let finite = |(time_s, point): (&f64, &Vec3)| (time_s + point.sum()).is_finite();
        if let Some(index) = points.clone().position(|point| !finite(point)) {
            let problem = format!("the coordinates or the time of point {index} are not finite");
            return wrong(problem, "leave out points that were not measured");
        }
        if let Some(pair) = times_s.windows(2).find(|pair| pair[1] < pair[0]) {
            let problem = format!("time goes back from {} s to {} s", pair[0], pair[1]);
            return wrong(problem, "sort the points by time");
        }
        let mut sampler = Sampler::new(mounting, 0.0, trajectory, settings)?;
        for (&time_s, &position_m) in points {
            sampler.add(&ScanPoint {
                time_s,
                position_m,
                intensity: 0.0,
            });
        }
        sampler.finish()
    }

    /// Positions of the points in the world for this mounting, metres.
    pub fn placed(&self, body_from_scanner: &BodyFromScanner) -> impl Iterator<Item = Vec3> {
        self.placed_each(1, body_from_scanner)
    }

    /// As [`Self::placed`], for every `every`-th point only.
    pub(super) fn placed_each(
        &self,
        every: usize,
        body_from_scanner: &BodyFromScanner,
    ) -> impl Iterator<Item = Vec3> {
        self.points.iter().step_by(every).map(|point| {
            let pose = &self.profiles[point.profile as usize].world_from_body;
            pose.map(&body_from_scanner.map(&point.position_m))
        })
    }

    /// Indices of the points kept on a grid of `voxel_m` for this mounting, sorted by profile.
    pub(super) fn thinned(
        &self,
        body_from_scanner: &BodyFromScanner,
        voxel_m: f64,
        pass_gap_s: f64,
    ) -> Vec<u32> {
        let profile = |index: u32| self.points[index as usize].profile;
        let mut thinner = Thinner::new(voxel_m, pass_gap_s);
        for (index, world) in (0..).zip(self.placed(body_from_scanner)) {
            let time_s = self.profiles[profile(index) as usize].time_s;
            thinner.add(index, time_s, &world);
        }
        let mut indices: Vec<u32> = thinner.points.into_iter().map(|(index, _)| index).collect();
        indices.sort_by_key(|&index| profile(index));
        indices
    }
}

/// Keeps one point per voxel and pass, drawn at random. To keep the point nearest to the centre would select
/// by noise: if many points share a voxel, planes would be biased towards the centres of the voxels.
///
/// First a moment is drawn, in the same order of preference for all voxels, then one of its points. Neighbouring
/// voxels that a scanner sees for a long time therefore keep points of the same moments. Points are added in time
/// order.
struct Thinner<Point> {
    voxel_m: f64,
    pass_gap_s: f64,
    latest: VoxelMap<VoxelKey, Latest>,
    /// The kept points, each with the number of points in its voxel and pass.
    points: Vec<(Point, u32)>,
    seen: u64,
}

/// Length of a moment, seconds: one revolution of a lidar, and at most one step of the trajectory.
const MOMENT_S: f64 = 0.1;

/// The latest pass of a voxel.
struct Latest {
    /// Index of its kept point.
    point: usize,
    seen_s: f64,
    /// Preference of the moment of the kept point.
    moment: u32,
    /// Number of points of this moment so far.
    moment_points: u64,
}

impl<Point> Thinner<Point> {
    fn new(voxel_m: f64, pass_gap_s: f64) -> Self {
        Self {
            voxel_m,
            pass_gap_s,
            latest: VoxelMap::default(),
            points: Vec::new(),
            seen: 0,
        }
    }

    fn add(&mut self, point: Point, time_s: f64, world: &Vec3) {
        let moment = ((time_s / MOMENT_S).floor() as i64).trailing_zeros();
        let next = self.points.len();
        let first = Latest {
            point: next,
            seen_s: time_s,
            moment,
            moment_points: 0,
        };
        let key = voxel_key(world, self.voxel_m);
        let pass = self.latest.entry(key).or_insert(first);
        if time_s - pass.seen_s > self.pass_gap_s {
            pass.point = next;
        }
        pass.seen_s = time_s;
        self.seen += 1;
        if pass.point == next {
            (pass.moment, pass.moment_points) = (moment, 1);
            self.points.push((point, 1));
            return;
        }
        let (place, count) = &mut self.points[pass.point];
        *count += 1;
        if moment < pass.moment {
            return;
        }
        if moment > pass.moment {
            (pass.moment, pass.moment_points) = (moment, 0);
        }
        pass.moment_points += 1;
        // The k-th point of a moment replaces the kept one with probability 1/k (Vitter 1985).
        if drawn(self.seen).is_multiple_of(pass.moment_points) {
            *place = point;
        }
    }
}

/// Thins a stream of scanner points.
struct Sampler<'a> {
    mounting: &'a Mounting,
    trajectory: &'a Trajectory,
    georeferencer: Georeferencer<'a>,
    /// Times and positions in the scanner frame.
    thinner: Thinner<(f64, Vec3)>,
}

impl<'a> Sampler<'a> {
    fn new(
        mounting: &'a Mounting,
        time_offset_s: f64,
        trajectory: &'a Trajectory,
        settings: &CalibrationSettings,
    ) -> Result<Self> {
        let (_, finest_m) = settings.scales()?;
        let pose = mounting.body_from_scanner;
        Ok(Self {
            mounting,
            trajectory,
            georeferencer: Georeferencer::new(trajectory, pose, time_offset_s),
            thinner: Thinner::new(finest_m, settings.pass_gap_s),
        })
    }

    fn add(&mut self, point: &ScanPoint) {
        if let (time_s, Some(pose)) = self.georeferencer.body_at(point) {
            let body = self.mounting.body_from_scanner.map(&point.position_m);
            let timed = (time_s, point.position_m);
            self.thinner.add(timed, time_s, &pose.map(&body));
        }
    }

    fn finish(self) -> Result<ScannerSample> {
        self.georeferencer.check(&self.mounting.name)?;
        let mut thinned = self.thinner.points;
        thinned.sort_by(|(a, _), (b, _)| a.0.total_cmp(&b.0));
        let mut profiles: Vec<Profile> = Vec::new();
        let mut cursor = self.trajectory.cursor();
        // Every kept point has a pose, the same as when it was added.
        let points = thinned
            .into_iter()
            .filter_map(|((time_s, position_m), count)| {
                if profiles.last().is_none_or(|last| last.time_s != time_s) {
                    let world_from_body = cursor.pose_at(time_s)?;
                    profiles.push(Profile {
                        time_s,
                        world_from_body,
                    });
                }
                Some(ProfilePoint {
                    profile: profiles.len() as u32 - 1,
                    position_m,
                    count,
                })
            });
        Ok(ScannerSample {
            points: points.collect(),
            profiles,
            read: self.georeferencer.read(),
            outside: self.georeferencer.outside(),
            excluded: self.georeferencer.excluded().clone(),
        })
    }
}

/// Reads a scanner's profiles once, in bounded memory, and thins them on the finest grid of
/// `settings`.
///
/// The points are placed with the initial `mounting`: within a pass a wrong mounting shifts all
/// points alike, so the density is still right. `time_offset_s` is added to the sensor's times.
///
/// # Errors
/// Errors of the reader; no point within the trajectory's span (with both spans).
pub fn sample_profiles(
    mounting: &Mounting,
    readers: Vec<Box<dyn ProfileReader>>,
    time_offset_s: f64,
    trajectory: &Trajectory,
    settings: &CalibrationSettings,
    progress: &dyn Progress,
) -> Result<ScannerSample> {
    let mut sampler = Sampler::new(mounting, time_offset_s, trajectory, settings)?;
    let mut chunk: Vec<ScanPoint> = Vec::new();
    for mut reader in readers {
        let mut bytes = 0;
        while reader.next_chunk(&mut chunk)? {
            chunk.iter().for_each(|point| sampler.add(point));
            progress.advance(reader.bytes_read() - bytes);
            progress.check()?;
            bytes = reader.bytes_read();
        }
    }
    sampler.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::small_case::at_rest;

    /// Points on a line, (time, x), from a body at rest.
    fn sampled(points: &[(f64, f64)], voxel_m: f64) -> Result<ScannerSample> {
        let (times, points): (Vec<f64>, Vec<Vec3>) = points
            .iter()
            .map(|&(time_s, x)| (time_s, Vec3::new(x, 0.5, 0.5)))
            .unzip();
        let settings = CalibrationSettings {
            voxel_sizes_m: vec![voxel_m],
            ..CalibrationSettings::default()
        };
        let mounting = Mounting::new("left", BodyFromScanner::identity());
        ScannerSample::from_points(&mounting, &times, &points, &at_rest(), &settings)
    }

    fn times_and_positions(
        sample: &ScannerSample,
        indices: impl IntoIterator<Item = u32>,
    ) -> Vec<(f64, f64)> {
        let point = |index: u32| {
            let point = &sample.points[index as usize];
            let profile = &sample.profiles[point.profile as usize];
            (profile.time_s, point.position_m.x)
        };
        indices.into_iter().map(point).collect()
    }

    /// Voxel [0, 1): seen at 0–0.3 s, again at 10 s; voxel [1, 2) once, with the time of another.
    const SEEN: [(f64, f64); 6] = [
        (0.0, 0.1),
        (0.1, 0.45),
        (0.2, 0.9),
        (0.2, 1.2),
        (0.3, 0.7),
        (10.0, 0.8),
    ];

    #[test]
    fn each_pass_keeps_one_point() {
        let sample = sampled(&SEEN, 1.0).unwrap();
        let [first, second, third] = times_and_positions(&sample, 0..3)[..] else {
            panic!("{} points", sample.points.len());
        };
        assert!(first.0 < 0.4 && first.1 < 1.0);
        assert_eq!((second, third), ((0.2, 1.2), (10.0, 0.8)));
        let all = sampled(&SEEN, 0.01).unwrap();
        assert_eq!(times_and_positions(&all, 0..6), SEEN);
        assert_eq!(all.profiles.len(), 5);
        let thinned = all.thinned(&BodyFromScanner::identity(), 1.0, 3.0);
        assert_eq!(
            times_and_positions(&all, thinned),
            times_and_positions(&sample, 0..3)
        );
    }

    #[test]
    fn kept_points_lie_where_all_points_do() {
        // Fifty points in each voxel, all in the upper half of it.
        let points: Vec<_> = (0..100_000)
            .map(|i| {
                let x = f64::from(i / 50) + 0.5 + f64::from(i % 50) / 100.0;
                (1e-5 * f64::from(i), x)
            })
            .collect();
        let sample = sampled(&points, 1.0).unwrap();
        let mean = |x: &mut dyn Iterator<Item = f64>| {
            let (count, sum) = x.fold((0.0, 0.0), |(n, sum), x| (n + 1.0, sum + x.fract()));
            (count, sum / count)
        };
        let (count, kept) = mean(&mut sample.points.iter().map(|p| p.position_m.x));
        let (_, all) = mean(&mut points.iter().map(|p| p.1));
        assert_eq!(count, 2000.0);
        // The standard deviation of one point is 0.144.
        assert!(
            (kept - all).abs() < 4.0 * 0.144 / count.sqrt(),
            "{kept} and {all}"
        );
    }

    #[test]
    fn voxels_that_stay_in_view_keep_points_of_the_same_moment() {
        // Eight voxels, each seen now and then for 20 s.
        let at = |i: u32| (0.013 * f64::from(i), f64::from(i % 8) + 0.5);
        let points: Vec<_> = (0..1600).map(at).collect();
        let sample = sampled(&points, 1.0).unwrap();
        let times: Vec<f64> = times_and_positions(&sample, 0..8)
            .iter()
            .map(|point| point.0)
            .collect();
        let (first, last) = (times[0], times[7]);
        assert!(last - first < MOMENT_S, "{times:?}");
    }

    #[test]
    fn a_standing_scanner_makes_one_pass_however_long_it_stands() {
        let points: Vec<_> = (0..100).map(|i| (f64::from(i), 0.5)).collect();
        assert_eq!(sampled(&points, 1.0).unwrap().points.len(), 1);
    }

    #[test]
    fn invalid_arrays_are_refused() {
        for (points, named) in [
            (&[(0.0, 0.1), (1.0, f64::NAN)][..], "point 1 are not finite"),
            (&[(1.0, 0.1), (0.5, 0.1)], "goes back from 1 s to 0.5 s"),
            (&[(101.0, 0.1)], "the gap is 1.000 s"),
            (&[], "has no points"),
        ] {
            let error = sampled(points, 1.0).unwrap_err().to_string();
            assert!(error.contains(named) && error.contains("left"), "{error}");
        }
    }
}
