//! The cloud of one scale and its neighbourhoods.

use rayon::prelude::*;

use super::parameters::Mounting;
use super::sample::SamplePoint;
use crate::cloud::NeighbourIndex;
use crate::geometry::{Mat3, Vec3};

/// A scanner point ready to be moved: x_m = t_mb + R_mb (t_bs + R_bs x_s).
#[derive(Debug, Clone, Copy)]
pub struct MovablePoint {
    /// Index of the scanner.
    pub scanner: u32,
    /// Seconds.
    pub time_s: f64,
    /// x_s, metres.
    pub position_m: Vec3,
    /// R_mb.
    pub world_from_body: Mat3,
    /// t_mb, metres.
    pub body_m: Vec3,
}

/// The points of one scale: those of all scanners, which move with the mountings, and those of the
/// reference, which stay.
#[derive(Debug, Clone)]
pub struct ScaleCloud {
    /// Scanner points.
    pub movable: Vec<MovablePoint>,
    /// Reference points in the world, metres.
    pub fixed: Vec<Vec3>,
    /// How many scanners there are.
    pub scanners: usize,
    /// s: thickness below which flatness says nothing about alignment, metres.
    pub floor_m: f64,
}

/// Where the points of a [`ScaleCloud`] are for given mountings.
#[derive(Debug, Clone)]
pub struct Placed {
    /// World coordinates of all points: the movable ones, then the fixed ones.
    pub world: Vec<Vec3>,
    /// v = R_bs x_s of the movable points, body axes.
    pub arm: Vec<Vec3>,
}

/// The k nearest neighbours (the centre among them) of chosen scanner points, found once and kept
/// while the points move little.
#[derive(Debug, Clone)]
pub struct Neighbourhoods {
    /// Neighbours in each neighbourhood.
    pub k: usize,
    /// Centres: indices of movable points, neighbours in the list being neighbours in space.
    pub centres: Vec<u32>,
    /// `k` indices a centre, movable points first, then fixed ones.
    pub members: Vec<u32>,
}

impl ScaleCloud {
    /// Joins the scanners' samples and the reference.
    pub fn new(samples: &[Vec<SamplePoint>], fixed: Vec<Vec3>, floor_m: f64) -> Self {
        let movable = samples
            .iter()
            .enumerate()
            .flat_map(|(scanner, points)| {
                points.iter().map(move |point| MovablePoint {
                    scanner: scanner as u32,
                    time_s: point.time_s,
                    position_m: point.position_m,
                    world_from_body: *point.world_from_body.rotation.to_rotation_matrix().matrix(),
                    body_m: point.world_from_body.translation_m,
                })
            })
            .collect();
        Self {
            movable,
            fixed,
            scanners: samples.len(),
            floor_m,
        }
    }

    /// Places every point with these mountings (equation (1)).
    pub fn place(&self, mountings: &[Mounting]) -> Placed {
        let parts: Vec<(Mat3, Vec3)> = mountings
            .iter()
            .map(|mounting| {
                let pose = &mounting.body_from_scanner;
                (
                    *pose.rotation.to_rotation_matrix().matrix(),
                    pose.translation_m,
                )
            })
            .collect();
        let (arm, mut world): (Vec<Vec3>, Vec<Vec3>) = self
            .movable
            .par_iter()
            .map(|point| {
                let (rotation, translation) = &parts[point.scanner as usize];
                let arm = rotation * point.position_m;
                (
                    arm,
                    point.body_m + point.world_from_body * (translation + arm),
                )
            })
            .unzip();
        world.extend_from_slice(&self.fixed);
        Placed { world, arm }
    }
}

/// Finds the neighbourhoods of every `stride`-th scanner point among all points.
pub fn find(cloud: &ScaleCloud, placed: &Placed, k: usize, stride: usize) -> Neighbourhoods {
    let k = k.min(placed.world.len());
    let index = NeighbourIndex::new(&placed.world);
    let centres: Vec<u32> = (0..cloud.movable.len() as u32)
        .step_by(stride.max(1))
        .collect();
    let places: Vec<Vec3> = centres
        .iter()
        .map(|&centre| placed.world[centre as usize])
        .collect();
    let members = index.nearest_of_all(&places, k);
    Neighbourhoods {
        k,
        centres,
        members,
    }
}

impl Neighbourhoods {
    /// Members of neighbourhood `index`.
    pub fn of(&self, index: usize) -> &[u32] {
        &self.members[index * self.k..(index + 1) * self.k]
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.centres.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.centres.is_empty()
    }
}

/// The farthest that any movable point lies from where it was, metres.
pub fn farthest_move(before: &Placed, after: &Placed) -> f64 {
    let movable = before.arm.len();
    before.world[..movable]
        .par_iter()
        .zip(&after.world[..movable])
        .map(|(a, b)| (a - b).norm_squared())
        .reduce(|| 0.0, f64::max)
        .sqrt()
}
