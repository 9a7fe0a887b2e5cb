//! Is the mounting constant? The residuals' pattern along the drive tells.
//!
//! In every block of time the mean signed distance of a scanner's points to the reference is held
//! against what errors of the poses alone would give it. A rigid mounting stays within; a mounting
//! that bends with roll, pitch or acceleration leaves a pattern far larger.

use std::collections::BTreeMap;

use super::neighbourhoods::{Neighbourhoods, Placed, ScaleCloud};
use crate::cloud::StructureTensor;
use crate::geometry::Vec3;
use crate::sensor::PoseRecord;
use crate::trajectory::Trajectory;

/// Length of a block, seconds: a pass over a plane of 1 m at 10 cm/s has five.
pub const BLOCK_S: f64 = 2.0;

/// Fewest points whose mean is worth a block.
const FEWEST_POINTS: usize = 30;

/// Fewest reference members that make a plane.
const FEWEST_REFERENCE: usize = 6;

/// The block means may be this many times as large as the poses explain before the mounting
/// counts as not constant. Poses that are a little worse than they claim give 1 to 1.5;
/// millimetres of bending give 4 and more.
const SUSPICIOUS_RATIO: f64 = 2.0;

/// One block of one scanner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Block {
    /// Middle, seconds.
    pub time_s: f64,
    /// Mean signed distance to the reference, positive above it, metres.
    pub mean_m: f64,
    /// Standard deviation that the poses alone would give this mean, metres.
    pub expected_sigma_m: f64,
}

/// What the residuals along the drive say.
#[derive(Debug, Clone, PartialEq)]
pub struct Constancy {
    /// Blocks of each scanner in time order.
    pub blocks: Vec<Vec<Block>>,
    /// Root mean square of mean / expected over all blocks.
    pub ratio: f64,
    /// Root mean square of the block means, metres.
    pub rms_m: f64,
    /// Whether the mounting seems constant.
    pub constant: bool,
    /// What of the motion the residuals go with most, and how strongly (correlation).
    pub strongest: Option<(&'static str, f64)>,
}

#[derive(Clone, Default)]
struct Sums {
    n: usize,
    residual: f64,
    variance: f64,
}

/// Judges the residuals against the reference; `None` without a reference, without standard
/// deviations of the poses, or where too little of the drive meets the reference.
pub fn judge(
    cloud: &ScaleCloud,
    placed: &Placed,
    neighbourhoods: &Neighbourhoods,
    trajectory: &Trajectory,
) -> Option<Constancy> {
    let (start_s, _) = trajectory.span_s();
    // Only blocks in which there are points: a trajectory may span years.
    let mut sums: Vec<BTreeMap<u64, Sums>> = vec![BTreeMap::new(); cloud.scanners];
    let movable = cloud.movable.len();
    let mut reference = Vec::new();
    for index in 0..neighbourhoods.len() {
        reference.clear();
        reference.extend(
            neighbourhoods
                .of(index)
                .iter()
                .filter(|&&m| m as usize >= movable),
        );
        if reference.len() < FEWEST_REFERENCE {
            continue;
        }
        let centre = neighbourhoods.centres[index] as usize;
        let point = &cloud.movable[centre];
        let (node, _) = trajectory.locate(point.time_s)?;
        let shape = StructureTensor::of(&placed.world, &reference);
        let Some(normal) = upward_normal(&shape) else {
            continue;
        };
        let Some(variance) = pose_variance(
            &trajectory.nodes()[node],
            &(placed.world[centre] - point.body_m),
            &normal,
        ) else {
            continue;
        };
        let block = ((point.time_s - start_s) / BLOCK_S) as u64;
        let sum = sums[point.scanner as usize].entry(block).or_default();
        sum.n += 1;
        sum.residual += normal.dot(&(placed.world[centre] - shape.mean));
        sum.variance += variance;
    }
    let blocks: Vec<Vec<Block>> = sums
        .iter()
        .map(|scanner| {
            scanner
                .iter()
                .filter(|(_, sum)| sum.n >= FEWEST_POINTS)
                .map(|(&block, sum)| Block {
                    time_s: start_s + (block as f64 + 0.5) * BLOCK_S,
                    mean_m: sum.residual / sum.n as f64,
                    expected_sigma_m: (sum.variance / sum.n as f64).sqrt(),
                })
                .collect()
        })
        .collect();
    let all: Vec<&Block> = blocks.iter().flatten().collect();
    if all.len() < 10 {
        return None;
    }
    let mean_square = |f: &dyn Fn(&Block) -> f64| {
        (all.iter().map(|block| f(block).powi(2)).sum::<f64>() / all.len() as f64).sqrt()
    };
    let ratio = mean_square(&|block| block.mean_m / block.expected_sigma_m);
    let rms_m = mean_square(&|block| block.mean_m);
    let strongest = strongest_correlation(&blocks, trajectory);
    Some(Constancy {
        blocks,
        ratio,
        rms_m,
        constant: ratio < SUSPICIOUS_RATIO,
        strongest,
    })
}

/// The normal of a flat neighbourhood, pointing up; `None` where it is not flat enough to have one.
fn upward_normal(shape: &StructureTensor) -> Option<Vec3> {
    let eigen = shape.eigen();
    if eigen.values.z > 0.1 * eigen.values.y {
        return None;
    }
    let normal: Vec3 = eigen.vectors.column(2).into();
    Some(if normal.z < 0.0 { -normal } else { normal })
}

/// Variance along `normal` that the pose's standard deviations give a point at `arm` (world axes,
/// from the body's origin): Σ (n·e)² σ_p² + Σ (n · (e × arm))² σ_ω².
fn pose_variance(node: &PoseRecord, arm: &Vec3, normal: &Vec3) -> Option<f64> {
    let sigma = node.sigma?;
    let moment = arm.cross(normal);
    Some(
        normal.component_mul(&sigma.position_m).norm_squared()
            + moment.component_mul(&sigma.rotation_rad).norm_squared(),
    )
}

/// The part of the motion that the block means follow most, over all scanners.
fn strongest_correlation(
    blocks: &[Vec<Block>],
    trajectory: &Trajectory,
) -> Option<(&'static str, f64)> {
    let mut best: Option<(&'static str, f64)> = None;
    for scanner in blocks.iter().filter(|scanner| scanner.len() >= 10) {
        let residuals: Vec<f64> = scanner.iter().map(|block| block.mean_m).collect();
        let mut motion: [(&'static str, Vec<f64>); 4] =
            ["roll", "pitch", "acceleration along track", "time"].map(|name| (name, Vec::new()));
        for block in scanner {
            let state = motion_at(trajectory, block.time_s)?;
            for (column, value) in motion.iter_mut().zip(state) {
                column.1.push(value);
            }
        }
        for (name, values) in &motion {
            let r = correlation(&residuals, values);
            if best.is_none_or(|(_, strongest)| r.abs() > strongest.abs()) {
                best = Some((name, r));
            }
        }
    }
    best
}

/// Roll-like and pitch-like tilt (radians), acceleration along the body's x axis (m/s²), time (s).
fn motion_at(trajectory: &Trajectory, time_s: f64) -> Option<[f64; 4]> {
    let pose = trajectory.pose_at(time_s)?;
    let half_s = BLOCK_S / 4.0;
    let before = trajectory.pose_at(time_s - half_s)?.translation.vector;
    let after = trajectory.pose_at(time_s + half_s)?.translation.vector;
    let here = pose.translation.vector;
    let acceleration = (after - here * 2.0 + before) / (half_s * half_s);
    let up = pose.rotation.inverse() * Vec3::z();
    Some([
        up.y,
        up.x,
        (pose.rotation.inverse() * acceleration).x,
        time_s,
    ])
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len() as f64;
    let (mean_a, mean_b) = (a.iter().sum::<f64>() / n, b.iter().sum::<f64>() / n);
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (x, y) in a.iter().zip(b) {
        ab += (x - mean_a) * (y - mean_b);
        aa += (x - mean_a).powi(2);
        bb += (y - mean_b).powi(2);
    }
    if aa * bb > 0.0 {
        ab / (aa * bb).sqrt()
    } else {
        0.0
    }
}
