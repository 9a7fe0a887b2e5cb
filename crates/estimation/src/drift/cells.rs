//! Spots of the ground that two scanners saw in one pass: the distance between their points along the normal, and
//! its derivatives.

use nalgebra::{Matrix3, SymmetricEigen};
use rayon::prelude::*;

use crate::calibration::{Mounting, ScannerFromScanner, ScannerSample, relative};
use crate::cloud::voxel::{VoxelKey, voxel_key};
use crate::geometry::{Bending, Mat3, Vec3};

/// Longest time between consecutive points of a pass over a spot, seconds.
pub const LAG_S: f64 = 10.0;
/// Fewest points of either scanner on a spot.
const MIN_POINTS: usize = 4;
/// Least ratio of the smaller to the larger variance within the plane: points in a line define no plane.
const MIN_WIDTH: f64 = 0.05;
/// Largest ratio of the variance along the normal to the smaller variance within the plane: leaves define no plane.
const MAX_THICKNESS: f64 = 0.3;
/// Least share of the points' information that remains for the distance once a plane is estimated: if the scanners
/// saw different parts of the spot, a tilt of the plane cannot be told from a distance.
const MIN_SHARED: f64 = 0.2;
/// Least standard deviation of a distance, metres: otherwise spots that fit by chance would dominate.
const LEAST_SIGMA_M: f64 = 5e-5;

/// Origins of the grids of cells, in cells: the cell centres of each grid lie between those of the others.
pub const GRIDS: [[f64; 3]; 4] = [
    [0.0, 0.0, 0.0],
    [0.5, 0.5, 0.0],
    [0.5, 0.0, 0.5],
    [0.0, 0.5, 0.5],
];

/// The distance between two scanners on one spot.
#[derive(Debug, Clone, Copy)]
pub struct Spot {
    /// The scanners, in the order of the drive.
    pub scanners: [usize; 2],
    /// Mean of the two times at which the scanners saw the spot, seconds.
    pub time_s: f64,
    /// Time between the two, seconds.
    pub lag_s: f64,
    /// Height of the second scanner's points above the first's along the normal, metres.
    pub distance_m: f64,
    /// Standard deviation of the distance from the scatter of the points about the plane, metres.
    pub sigma_m: f64,
    /// Derivatives of the distance by (δp, δφ) of each scanner, in the axes of the first scanner of the drive.
    pub by: [[f64; 6]; 2],
    /// Change of these derivatives when noise of the points tilts the plane about each of its two axes by one
    /// standard deviation.
    pub by_noise: [[[f64; 6]; 2]; 2],
    /// The spot as each scanner sees it.
    pub sides: [Side; 2],
}

/// A spot as one of its scanners sees it, in axes of the first scanner of the drive.
#[derive(Debug, Clone, Copy, Default)]
pub struct Side {
    /// Mean vector from the scanner's origin to its points, metres.
    pub arm_m: Vec3,
    pub normal: Vec3,
    pub up: Vec3,
}

/// A point in the world, with the data to move it with its scanner.
struct Point {
    cell: VoxelKey,
    scanner: usize,
    time_s: f64,
    /// Index in its sample, which orders points of the same time.
    number: u32,
    world_m: Vec3,
    /// Vector from the scanner to the point in the axes of the first scanner, metres.
    arm_m: Vec3,
    profile: u32,
}

/// The points of a drive, which can be placed for any mountings of the scanners in the frame of the first.
pub struct Scene<'a> {
    samples: &'a [ScannerSample],
    /// Pose of the first scanner's frame in the world at each profile of each scanner, with the bending of that
    /// scanner's mounting, if mountings bend.
    frames: Vec<Vec<(Mat3, Vec3)>>,
}

impl<'a> Scene<'a> {
    pub fn new(mountings: &[Mounting], samples: &'a [ScannerSample], bending: &[Bending]) -> Self {
        let first = &mountings[0].body_from_scanner;
        let frames = |(number, (mounting, sample)): (usize, (&Mounting, &ScannerSample))| {
            let mean = &mounting.body_from_scanner;
            let scanner_from_first = relative(first, mean).inverse();
            let frame = |profile: &crate::surface::Profile| {
                let bent = bending.get(number);
                let now = bent.map_or(*mean, |bending| bending.apply(mean, profile.time_s));
                let body_from_first = now * scanner_from_first;
                let rotation = profile.world_from_body.rotation * body_from_first.rotation;
                let origin_m = profile.world_from_body.map(&body_from_first.translation_m);
                (*rotation.to_rotation_matrix().matrix(), origin_m)
            };
            sample.profiles.iter().map(frame).collect()
        };
        let all = mountings.iter().zip(samples).enumerate();
        Self {
            samples,
            frames: all.map(frames).collect(),
        }
    }

    /// The spots that two scanners saw in cells of this edge, in the order of grids, cells and passes. Which points
    /// share a cell is a matter of chance, which several [grids](GRIDS) average out.
    pub fn spots(&self, at: &[ScannerFromScanner], cell_m: f64, grids: usize) -> Vec<Spot> {
        let grids = GRIDS.iter().take(grids);
        let in_grid =
            |shift: &[f64; 3]| self.spots_in_grid(at, cell_m, &(cell_m * Vec3::from(*shift)));
        grids.flat_map(in_grid).collect()
    }

    fn spots_in_grid(&self, at: &[ScannerFromScanner], cell_m: f64, shift_m: &Vec3) -> Vec<Spot> {
        let mut points = self.placed(at, cell_m, shift_m);
        points.par_sort_unstable_by(|a, b| {
            let key = |p: &Point| (p.cell, p.scanner, p.number);
            let by_cell = a.cell.cmp(&b.cell).then(a.time_s.total_cmp(&b.time_s));
            by_cell.then_with(|| key(a).cmp(&key(b)))
        });
        let cells: Vec<&[Point]> = points.chunk_by(|a, b| a.cell == b.cell).collect();
        let spots_in_cell = |cell: &&[Point]| {
            let passes = cell.chunk_by(|a, b| b.time_s - a.time_s <= LAG_S);
            passes.flat_map(|pass| self.pairs(pass)).collect::<Vec<_>>()
        };
        cells.par_iter().flat_map_iter(spots_in_cell).collect()
    }

    fn placed(&self, at: &[ScannerFromScanner], cell_m: f64, shift_m: &Vec3) -> Vec<Point> {
        let samples = self.samples.iter().zip(at).enumerate();
        let place_sample =
            |(scanner, (sample, pose)): (usize, (&ScannerSample, &ScannerFromScanner))| {
                let turn = *pose.rotation.to_rotation_matrix().matrix();
                let place = move |(number, point): (usize, &crate::surface::ProfilePoint)| {
                    let (rotation, origin_m) = &self.frames[scanner][point.profile as usize];
                    let arm_m = turn * point.position_m;
                    let world_m = origin_m + rotation * (pose.translation_m + arm_m);
                    Point {
                        cell: voxel_key(&(world_m + shift_m), cell_m),
                        scanner,
                        time_s: sample.profiles[point.profile as usize].time_s,
                        number: number as u32,
                        world_m,
                        arm_m,
                        profile: point.profile,
                    }
                };
                let points: Vec<Point> = sample.points.par_iter().enumerate().map(place).collect();
                points
            };
        samples.flat_map(place_sample).collect()
    }

    /// The spots of all pairs of scanners in one pass over a cell.
    fn pairs(&self, pass: &[Point]) -> Vec<Spot> {
        let mut spots = Vec::new();
        for second in 1..self.samples.len() {
            for first in 0..second {
                spots.extend(self.spot(pass, [first, second]));
            }
        }
        spots
    }

    fn spot(&self, pass: &[Point], scanners: [usize; 2]) -> Option<Spot> {
        let [a, b] = scanners.map(|scanner| pass.iter().filter(|p| p.scanner == scanner).count());
        if a < MIN_POINTS || b < MIN_POINTS {
            return None;
        }
        let points: Vec<&Point> = pass
            .iter()
            .filter(|point| scanners.contains(&point.scanner))
            .collect();
        let origin_m = points[0].world_m;
        let (count, shares) = (points.len() as f64, [a as f64, b as f64]);
        let mut means = [Vec3::zeros(); 2];
        let mut times_s = [0.0; 2];
        for point in &points {
            let side = usize::from(point.scanner == scanners[1]);
            means[side] += (point.world_m - origin_m) / shares[side];
            times_s[side] += point.time_s / shares[side];
        }
        // The plane of the points of both scanners, each about their own mean: a distance between them does not
        // tilt it.
        let mut scatter = Matrix3::zeros();
        for point in &points {
            let side = usize::from(point.scanner == scanners[1]);
            let off = point.world_m - origin_m - means[side];
            scatter += off * off.transpose();
        }
        let eigen = SymmetricEigen::new(scatter);
        let mut order = [0, 1, 2];
        order.sort_by(|&i, &j| eigen.eigenvalues[j].total_cmp(&eigen.eigenvalues[i]));
        let [along, across, thick] = order.map(|i| eigen.eigenvalues[i].max(0.0));
        let [u, v, mut normal] = order.map(|i| eigen.eigenvectors.column(i).into_owned());
        // If both axes have the same variance, their directions are arbitrary, but the results do not depend on them.
        if across < MIN_WIDTH * along || thick > MAX_THICKNESS * across || across <= 0.0 {
            return None;
        }
        if normal.z < 0.0 {
            normal = -normal;
        }
        // Least squares of a + b u + c v + d [second]: with coordinates about each scanner's own mean, the points
        // within each scanner give b and c, and d = (h̄₂ − h̄₁) − b (ū₂ − ū₁) − c (v̄₂ − v̄₁).
        let apart = means[1] - means[0];
        let tilt = [(u, apart.dot(&u) / along), (v, apart.dot(&v) / across)];
        let untilted = 1.0 / shares[0] + 1.0 / shares[1];
        let tilted = tilt
            .iter()
            .map(|(axis, t)| t * apart.dot(axis))
            .sum::<f64>();
        if untilted < MIN_SHARED * (untilted + tilted) {
            return None;
        }
        // The axes are those of the scatter, so that b = c = 0 and d = h̄₂ − h̄₁.
        let distance_m = normal.dot(&apart);
        let variance = thick / (count - 4.0).max(1.0) * (untilted + tilted);
        // The tilt of the plane along its axes due to noise.
        let noise = (thick / (count - 4.0).max(1.0)).sqrt();
        let directions = [
            normal,
            u * (noise / along.sqrt()),
            v * (noise / across.sqrt()),
        ];
        let mut rows = [[[0.0; 6]; 2]; 3];
        let mut sides = [Side::default(); 2];
        for point in &points {
            let side = usize::from(point.scanner == scanners[1]);
            let sign = [-1.0, 1.0][side];
            let off = point.world_m - origin_m - means[side];
            let tilt_weight: f64 = tilt.iter().map(|(axis, t)| t * off.dot(axis)).sum();
            let weight = sign / shares[side] - tilt_weight;
            let (rotation, _) = &self.frames[point.scanner][point.profile as usize];
            for (row, direction) in rows.iter_mut().zip(&directions) {
                let direction = rotation.tr_mul(direction);
                let moment = point.arm_m.cross(&direction);
                for axis in 0..3 {
                    row[side][axis] += weight * direction[axis];
                    row[side][3 + axis] += weight * moment[axis];
                }
            }
            sides[side] = Side {
                arm_m: sides[side].arm_m + point.arm_m / shares[side],
                normal: rotation.tr_mul(&normal),
                up: rotation.row(2).transpose(),
            };
        }
        let [by, by_noise @ ..] = rows;
        Some(Spot {
            scanners,
            time_s: 0.5 * (times_s[0] + times_s[1]),
            lag_s: (times_s[1] - times_s[0]).abs(),
            distance_m,
            sigma_m: variance.sqrt().hypot(LEAST_SIGMA_M),
            by,
            by_noise,
            sides,
        })
    }
}
