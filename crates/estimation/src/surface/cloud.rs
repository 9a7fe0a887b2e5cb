//! Points of all scanners and of a reference, and their positions for given mountings.

use std::sync::Arc;

use rayon::prelude::*;

use super::profile::{Profile, ProfilePoint};
use super::rows::Row;
use crate::geometry::{BodyFromScanner, Mat3, Vec3, product};
use crate::statistics::median;

/// A profile of one of several scanners, with its pose as a rotation matrix and a translation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PosedProfile {
    /// Index of the scanner.
    pub scanner: u32,
    /// Seconds.
    pub time_s: f64,
    /// R_mb.
    pub rotation: Mat3,
    /// t_mb, metres.
    pub translation_m: Vec3,
}

/// Points of all scanners, which move with the mountings and the poses, and fixed points of a
/// reference. Indices count the movable points first, then the fixed ones.
#[derive(Debug, Clone, Default)]
pub struct SurfaceCloud {
    /// Number of scanners.
    pub scanners: usize,
    /// The profiles of the first scanner in time order, then those of the next.
    pub profiles: Arc<Vec<PosedProfile>>,
    /// Scanner points in the order of their profiles.
    pub movable: Vec<ProfilePoint>,
    /// Reference points in the world, metres.
    pub fixed: Vec<Vec3>,
}

/// Positions of the points of a [`SurfaceCloud`] for given mountings.
#[derive(Debug, Clone)]
pub struct Placed {
    /// World coordinates, metres.
    pub world: Vec<Vec3>,
    mountings: Vec<Mounted>,
}

/// The mounting of a scanner as a rotation matrix and a translation.
#[derive(Debug, Clone, Copy)]
struct Mounted {
    rotation: Mat3,
    translation_m: Vec3,
}

impl Mounted {
    fn all(mountings: &[BodyFromScanner]) -> Vec<Self> {
        let ready = |mounting: &BodyFromScanner| Self {
            rotation: *mounting.rotation.to_rotation_matrix().matrix(),
            translation_m: mounting.translation_m,
        };
        mountings.iter().map(ready).collect()
    }

    /// R_bs x_s.
    #[inline]
    fn arm(&self, point: &ProfilePoint) -> Vec3 {
        product(&self.rotation, &point.position_m)
    }

    /// t_bs + R_bs x_s.
    #[inline]
    fn lever(&self, point: &ProfilePoint) -> Vec3 {
        self.translation_m + self.arm(point)
    }
}

impl SurfaceCloud {
    /// The mean of the points of each scanner, scanner frame, metres; zero for a scanner without any.
    pub fn centres_m(&self) -> Vec<Vec3> {
        let mut sums = vec![(0.0, Vec3::zeros()); self.scanners];
        for point in &self.movable {
            let (count, sum) = &mut sums[self.profile(point).scanner as usize];
            *count += 1.0;
            *sum += point.position_m;
        }
        sums.iter()
            .map(|(count, sum)| sum / f64::max(*count, 1.0))
            .collect()
    }

    /// A cloud of reference points only.
    pub fn new(fixed: Vec<Vec3>) -> Self {
        Self {
            fixed,
            ..Self::default()
        }
    }

    /// Adds a scanner: `points` sorted by profile. Profiles without points are left out.
    pub fn add_scanner(
        &mut self,
        profiles: &[Profile],
        points: impl IntoIterator<Item = ProfilePoint>,
    ) {
        let table = Arc::make_mut(&mut self.profiles);
        let mut last = None;
        for point in points {
            if last != Some(point.profile) {
                last = Some(point.profile);
                let profile = &profiles[point.profile as usize];
                let pose = &profile.world_from_body;
                table.push(PosedProfile {
                    scanner: self.scanners as u32,
                    time_s: profile.time_s,
                    rotation: *pose.rotation.to_rotation_matrix().matrix(),
                    translation_m: pose.translation_m,
                });
            }
            self.movable.push(ProfilePoint {
                profile: table.len() as u32 - 1,
                ..point
            });
        }
        self.scanners += 1;
    }

    /// The points with these indices, which must be in ascending order.
    pub fn subset(&self, indices: &[u32]) -> Self {
        let movable = self.movable.len();
        let split = indices.partition_point(|&index| (index as usize) < movable);
        let (moving, fixed) = indices.split_at(split);
        let (moving, fixed) = (moving.iter(), fixed.iter());
        Self {
            scanners: self.scanners,
            profiles: Arc::clone(&self.profiles),
            movable: moving.map(|&index| self.movable[index as usize]).collect(),
            fixed: fixed
                .map(|&index| self.fixed[index as usize - movable])
                .collect(),
        }
    }

    /// The profile of a movable point.
    #[inline]
    pub fn profile(&self, point: &ProfilePoint) -> &PosedProfile {
        &self.profiles[point.profile as usize]
    }

    /// Places every point for these mountings: x_m = t_mb + R_mb (t_bs + R_bs x_s).
    pub fn place(&self, mountings: &[BodyFromScanner]) -> Placed {
        let mountings = Mounted::all(mountings);
        let place = |point: &ProfilePoint| {
            let profile = self.profile(point);
            let lever = mountings[profile.scanner as usize].lever(point);
            profile.translation_m + product(&profile.rotation, &lever)
        };
        let mut world = Vec::with_capacity(self.movable.len() + self.fixed.len());
        self.movable
            .par_iter()
            .map(place)
            .collect_into_vec(&mut world);
        world.extend_from_slice(&self.fixed);
        Placed { world, mountings }
    }

    /// Derivatives of the coordinate of movable point `index` along `direction` (world axes) by its pose.
    pub(crate) fn pose_row(&self, placed: &Placed, index: usize, direction: &Vec3) -> Row {
        let point = &self.movable[index];
        let profile = self.profile(point);
        let lever = placed.mountings[profile.scanner as usize].lever(point);
        Row::by_pose(direction, &profile.rotation, &lever)
    }

    /// Those by its mounting.
    #[inline]
    pub(crate) fn mounting_row(&self, placed: &Placed, index: usize, direction: &Vec3) -> Row {
        let point = &self.movable[index];
        let profile = self.profile(point);
        let arm = placed.mountings[profile.scanner as usize].arm(point);
        Row::by_mounting(direction, &profile.rotation, &arm)
    }

    /// The median displacement of the points of each scanner between two sets of mountings, metres; zero without points.
    pub fn median_displacements(
        &self,
        from: &[BodyFromScanner],
        to: &[BodyFromScanner],
    ) -> Vec<f64> {
        let (from, to) = (Mounted::all(from), Mounted::all(to));
        let of_scanner = |scanner: usize| {
            let points = self.movable.iter();
            let own = points.filter(|point| self.profile(point).scanner as usize == scanner);
            let moved = own.map(|p| (to[scanner].lever(p) - from[scanner].lever(p)).norm());
            median(moved).unwrap_or(0.0)
        };
        (0..self.scanners).map(of_scanner).collect()
    }

    /// Largest displacement of a point between two sets of mountings, metres; it does not depend on
    /// the poses.
    pub fn largest_displacement(&self, from: &[BodyFromScanner], to: &[BodyFromScanner]) -> f64 {
        let (from, to) = (Mounted::all(from), Mounted::all(to));
        self.movable
            .par_iter()
            .map(|point| {
                let scanner = self.profile(point).scanner as usize;
                (to[scanner].lever(point) - from[scanner].lever(point)).norm_squared()
            })
            .reduce(|| 0.0, f64::max)
            .sqrt()
    }
}
