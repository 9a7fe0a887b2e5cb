//! Test of a constant mounting, from the pattern of the residuals along the drive.
//!
//! In every block of time, the median signed distance of a scanner's points to the reference is compared with its
//! standard deviation, due to pose errors and to the scatter of its points. The residuals of a rigid mounting agree with
//! it; a mounting that bends with roll, pitch or acceleration causes far larger ones. Medians do not follow leaves that
//! stand above the ground and returns from nothing, which are no motion of a mounting.

use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::cloud::StructureTensor;
use crate::geometry::Vec3;
use crate::statistics::{SIGMAS_PER_MAD, correlation, median, rms};
use crate::surface::Surface;
use crate::trajectory::Trajectory;

/// Length of a block, seconds: a pass over a plane of 1 m at 10 cm/s has five blocks.
const BLOCK_S: f64 = 2.0;

/// Minimum number of points in a block.
const MIN_POINTS: usize = 30;

/// Minimum number of reference points in a neighbourhood to fit a plane.
const MIN_REFERENCE_POINTS: usize = 6;

/// Minimum number of blocks for a test.
const MIN_BLOCKS: usize = 10;

/// Ratio of block medians to expected standard deviations above which the mounting counts as not
/// constant. Poses slightly worse than their standard deviations give 1 to 1.5; bending by
/// millimetres gives 4 and more.
const MAX_RATIO: f64 = 2.0;

/// One block of one scanner.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Block {
    /// Time at its middle, seconds.
    pub time_s: f64,
    /// Median signed distance to the reference, positive above it, metres.
    pub median_m: f64,
    /// Standard deviation of this median, metres: √(σ² + π/2 s² / n), with σ of the pose errors that all points share,
    /// and s the normalised median absolute deviation of the n points, from their noise and the roughness of the ground.
    pub expected_sigma_m: f64,
}

/// Result of the test of a constant mounting.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Constancy {
    /// Blocks of each scanner in time order.
    pub blocks: Vec<Vec<Block>>,
    /// Root mean square of median / expected standard deviation over all blocks.
    pub ratio: f64,
    /// Root mean square of the block medians, metres.
    pub rms_m: f64,
    /// Whether the mounting appears constant.
    pub constant: bool,
    /// The strongest correlation of the residuals with a component of the motion.
    pub strongest: Option<Correlation>,
    /// The jump that explains most of the residuals of a scanner.
    pub jump: Option<Jump>,
}

/// A correlation of the residuals of a scanner.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Correlation {
    /// The component of the motion.
    pub with: String,
    /// The correlation coefficient.
    pub coefficient: f64,
}

/// A change of the residuals from one value to another.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Jump {
    /// Index of the scanner.
    pub scanner: usize,
    /// Time between the last block before the jump and the first block after it, seconds.
    pub time_s: f64,
    /// Size of the jump, metres.
    pub step_m: f64,
    /// Correlation of the residuals with the jump.
    pub correlation: f64,
}

impl Jump {
    /// The jump that leaves the least sum of squares of a scanner's blocks; `None` if there are too few
    /// blocks.
    fn strongest(scanner: usize, blocks: &[Block]) -> Option<Self> {
        let count = blocks.len() as f64;
        let values = || blocks.iter().map(|block| block.median_m);
        let mean = values().sum::<f64>() / count;
        let all: f64 = values().map(|value| (value - mean).powi(2)).sum();
        let mut before = 0.0;
        let mut best: Option<Self> = None;
        for (index, pair) in blocks.windows(2).enumerate() {
            before += pair[0].median_m - mean;
            let (left, right) = ((index + 1) as f64, count - (index + 1) as f64);
            if left.min(right) < MIN_BLOCKS as f64 / 2.0 || all == 0.0 {
                continue;
            }
            // Σ (x − mean)² = within both parts + (Σ left)² (1/left + 1/right).
            let step_m = -before * (1.0 / left + 1.0 / right);
            let correlation = (before * before * (1.0 / left + 1.0 / right) / all).sqrt();
            if best.is_none_or(|best| correlation > best.correlation) {
                best = Some(Self {
                    scanner,
                    time_s: 0.5 * (pair[0].time_s + pair[1].time_s),
                    step_m,
                    correlation,
                });
            }
        }
        best
    }
}

/// The distance of one scanner point to the reference.
struct Residual {
    scanner: usize,
    time_s: f64,
    distance_m: f64,
    /// Variance of the distance due to pose errors.
    variance_m2: f64,
}

/// The points of one block.
#[derive(Clone, Default)]
struct Points {
    distances_m: Vec<f64>,
    variance_m2: f64,
}

impl Points {
    /// Adds the distance of a point and its variance due to pose errors.
    fn add(&mut self, distance_m: f64, variance_m2: f64) {
        self.distances_m.push(distance_m);
        self.variance_m2 += variance_m2;
    }

    /// The median distance and its standard deviation, metres; `None` if there are too few points.
    fn median_m(&self) -> Option<(f64, f64)> {
        let distances = || self.distances_m.iter().copied();
        let n = self.distances_m.len();
        let median_m = median(distances()).filter(|_| n >= MIN_POINTS)?;
        let deviation_m = SIGMAS_PER_MAD * median(distances().map(|d| (d - median_m).abs()))?;
        let n = n as f64;
        let scatter_m2 = FRAC_PI_2 * deviation_m.powi(2) / n;
        Some((median_m, (self.variance_m2 / n + scatter_m2).sqrt()))
    }
}

impl Constancy {
    /// Tests the distances to the reference; `None` without a reference, without standard
    /// deviations of the poses, or if too little of the drive covers the reference.
    pub fn test(surface: &Surface, trajectory: &Trajectory) -> Option<Self> {
        let (start_s, _) = trajectory.span_s();
        let mut points = vec![BTreeMap::<u64, Points>::new(); surface.cloud.scanners];
        let residuals: Vec<Residual> = (0..surface.planes.len())
            .into_par_iter()
            .filter_map(|index| Residual::of_centre(surface, trajectory, index))
            .collect();
        for residual in residuals {
            let block = ((residual.time_s - start_s) / BLOCK_S) as u64;
            let block = points[residual.scanner].entry(block).or_default();
            block.add(residual.distance_m, residual.variance_m2);
        }
        let block = |(&index, points): (&u64, &Points)| {
            let (median_m, expected_sigma_m) = points.median_m()?;
            Some(Block {
                time_s: start_s + (index as f64 + 0.5) * BLOCK_S,
                median_m,
                expected_sigma_m,
            })
        };
        let blocks: Vec<Vec<Block>> = points
            .iter()
            .map(|scanner| scanner.iter().filter_map(block).collect())
            .collect();
        let all: Vec<&Block> = blocks.iter().flatten().collect();
        if all.len() < MIN_BLOCKS {
            return None;
        }
        let ratio = rms(all
            .iter()
            .map(|block| block.median_m / block.expected_sigma_m));
        Some(Self {
            ratio,
            rms_m: rms(all.iter().map(|block| block.median_m)),
            constant: ratio < MAX_RATIO,
            strongest: strongest_correlation(&blocks, trajectory),
            jump: blocks
                .iter()
                .enumerate()
                .filter_map(|(scanner, blocks)| Jump::strongest(scanner, blocks))
                .max_by(|a, b| a.correlation.total_cmp(&b.correlation)),
            blocks,
        })
    }
}

impl Residual {
    /// The residual of the centre of neighbourhood `index`; `None` if the reference has no plane
    /// there or the pose has no standard deviations.
    fn of_centre(surface: &Surface, trajectory: &Trajectory, index: usize) -> Option<Self> {
        let Surface { cloud, placed, .. } = surface;
        let movable = cloud.movable.len();
        let members = surface.neighbourhoods.members(index).iter().copied();
        let reference: Vec<u32> = members.filter(|&m| m as usize >= movable).collect();
        if reference.len() < MIN_REFERENCE_POINTS {
            return None;
        }
        let centre = surface.neighbourhoods.centres()[index] as usize;
        let profile = cloud.profile(&cloud.movable[centre]);
        let (node, _) = trajectory.locate(profile.time_s)?;
        let shape = StructureTensor::of(&placed.world, &reference);
        let normal = upward_normal(&shape)?;
        let sigma = trajectory.poses()[node].sigma?;
        let by_pose = surface.pose_row(centre, &normal);
        // Standard deviations of rotations are about world axes.
        let moment = profile.rotation * by_pose.rotation;
        Some(Self {
            scanner: profile.scanner as usize,
            time_s: profile.time_s,
            distance_m: normal.dot(&(placed.world[centre] - shape.mean)),
            variance_m2: normal.component_mul(&sigma.position_m).norm_squared()
                + moment.component_mul(&sigma.rotation_rad).norm_squared(),
        })
    }
}

/// Largest ratio of the third to the second eigenvalue of a flat neighbourhood: three times as wide as thick, it has a
/// normal to within a few degrees for any noise.
const FLAT: f64 = 0.1;

/// The upward normal of a neighbourhood; `None` if it is not flat.
pub fn upward_normal(shape: &StructureTensor) -> Option<Vec3> {
    let eigen = shape.eigen();
    if eigen.values.z > FLAT * eigen.values.y {
        return None;
    }
    let normal: Vec3 = eigen.vectors.column(2).into();
    Some(if normal.z < 0.0 { -normal } else { normal })
}

/// The component of the motion with the strongest correlation with the block medians of any scanner.
fn strongest_correlation(blocks: &[Vec<Block>], trajectory: &Trajectory) -> Option<Correlation> {
    let mut best: Option<Correlation> = None;
    for scanner in blocks.iter().filter(|scanner| scanner.len() >= MIN_BLOCKS) {
        let residuals: Vec<f64> = scanner.iter().map(|block| block.median_m).collect();
        let mut motion: [(&'static str, Vec<f64>); 4] =
            ["roll", "pitch", "acceleration along track", "time"].map(|name| (name, Vec::new()));
        for block in scanner {
            let state = motion_at(trajectory, block.time_s)?;
            for (column, value) in motion.iter_mut().zip(state) {
                column.1.push(value);
            }
        }
        for (name, values) in &motion {
            let coefficient = correlation(&residuals, values);
            let is_stronger = |best: &Correlation| coefficient.abs() > best.coefficient.abs();
            if best.as_ref().is_none_or(is_stronger) {
                let with = (*name).to_owned();
                best = Some(Correlation { with, coefficient });
            }
        }
    }
    best
}

/// Roll-like and pitch-like tilt (radians), acceleration along the body's x axis (m/s²), time (s).
fn motion_at(trajectory: &Trajectory, time_s: f64) -> Option<[f64; 4]> {
    let pose = trajectory.pose_at(time_s)?;
    let half_s = BLOCK_S / 4.0;
    let before = trajectory.pose_at(time_s - half_s)?.translation_m;
    let after = trajectory.pose_at(time_s + half_s)?.translation_m;
    let here = pose.translation_m;
    let acceleration = (after - here * 2.0 + before) / (half_s * half_s);
    let up = pose.rotation.inverse() * Vec3::z();
    Some([
        up.y,
        up.x,
        (pose.rotation.inverse() * acceleration).x,
        time_s,
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_standard_deviation_of_a_block_is_that_of_poses_and_scatter() {
        let mut points = Points::default();
        for i in 0..99 {
            points.add(0.001 + 1e-4 * f64::from(i - 49), 4e-6);
        }
        let scatter_m2 = FRAC_PI_2 * (1.4826 * 25e-4_f64).powi(2) / 99.0;
        let (median_m, sigma_m) = points.median_m().unwrap();
        assert!((median_m - 0.001).abs() < 1e-12);
        assert!(
            (sigma_m - (4e-6 + scatter_m2).sqrt()).abs() < 1e-12,
            "{sigma_m}"
        );

        // Five leaves, 13 cm above the ground, raise the mean by 6 mm.
        (0..5).for_each(|_| points.add(0.13, 4e-6));
        let (median_m, _) = points.median_m().unwrap();
        assert!((median_m - 0.001).abs() < 3e-4, "{median_m}");
    }

    #[test]
    fn a_jump_is_found_where_it_is() {
        let blocks: Vec<Block> = (0..40)
            .map(|i| Block {
                time_s: 2.0 * f64::from(i),
                median_m: if i < 25 { 1e-3 } else { -2e-3 } + 1e-4 * f64::from(i % 3 - 1),
                expected_sigma_m: 1e-3,
            })
            .collect();
        let jump = Jump::strongest(1, &blocks).unwrap();
        assert_eq!((jump.scanner, jump.time_s), (1, 49.0));
        assert!((jump.step_m + 3e-3).abs() < 2e-5, "{}", jump.step_m);
        assert!(jump.correlation > 0.99);
        assert_eq!(Jump::strongest(0, &blocks[..9]), None);
    }
}
