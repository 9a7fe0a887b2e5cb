//! Absolute and relative errors, and their spread.

use serde::Serialize;

use super::association::PosePair;
use crate::geometry::so3::log;
use crate::geometry::{Transform, Vec3, World};
use crate::statistics::{mean, quantile, rms};

/// The error of a pose after the alignment.
#[derive(Debug, Clone, Copy)]
pub struct PoseError {
    /// Time of the reference, seconds.
    pub time_s: f64,
    /// Length of the reference's path so far, metres.
    pub path_m: f64,
    /// Position of the reference, metres.
    pub reference_m: Vec3,
    /// Position of the aligned estimate minus that of the reference, in the world, metres.
    pub offset_m: Vec3,
    /// Angle between the attitudes, radians.
    pub rotation_rad: f64,
}

/// The spread of errors that are not negative.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// Root mean square.
    pub rmse: f64,
    /// Mean.
    pub mean: f64,
    /// Median.
    pub median: f64,
    /// Standard deviation about the mean, √(rmse² − mean²).
    pub std: f64,
    /// Smallest.
    pub min: f64,
    /// Largest.
    pub max: f64,
}

impl Spread {
    /// The spread of values, of which there is at least one.
    pub(super) fn of(values: impl IntoIterator<Item = f64>) -> Self {
        let mut values: Vec<f64> = values.into_iter().collect();
        values.sort_unstable_by(f64::total_cmp);
        let (rmse, mean) = (rms(values.iter().copied()), mean(&values));
        Self {
            rmse,
            mean,
            median: quantile(&values, 0.5),
            std: (rmse * rmse - mean * mean).max(0.0).sqrt(),
            min: quantile(&values, 0.0),
            max: quantile(&values, 1.0),
        }
    }
}

/// What relative errors are taken over.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Over {
    /// Seconds.
    Time(f64),
    /// Metres of the reference's path.
    Distance(f64),
}

/// Relative errors.
#[derive(Debug, Clone, Copy)]
pub struct RelativeErrors {
    /// Number of pairs of poses.
    pub count: usize,
    /// Median of what the pairs are apart, seconds or metres.
    pub apart: f64,
    /// Translations, metres.
    pub translation_m: Spread,
    /// Rotations, radians.
    pub rotation_rad: Spread,
}

/// Two poses farther apart than this many times what is asked for have a gap between them and are not compared.
const FARTHEST: f64 = 1.5;
/// What rounding of times may take from an interval.
const ROUNDING: f64 = 1e-6;

pub(super) fn absolute(pairs: &[PosePair], alignment: &Transform<World, World>) -> Vec<PoseError> {
    let paths_m = paths_m(pairs);
    let pairs = pairs.iter().zip(paths_m);
    let errors = pairs.map(|(pair, path_m)| {
        let estimate = *alignment * pair.estimate;
        let reference = pair.reference;
        let turn = reference.rotation.inverse() * estimate.rotation;
        PoseError {
            time_s: pair.time_s,
            path_m,
            reference_m: reference.translation_m,
            offset_m: estimate.translation_m - reference.translation_m,
            rotation_rad: log(&turn).norm(),
        }
    });
    errors.collect()
}

/// Length of the reference's path from the first pair to each.
fn paths_m(pairs: &[PosePair]) -> Vec<f64> {
    let mut path_m = 0.0;
    let mut last = pairs.first().map(|pair| pair.reference.translation_m);
    let lengths = pairs.iter().map(|pair| {
        let here = pair.reference.translation_m;
        path_m += last.map_or(0.0, |last| (here - last).norm());
        last = Some(here);
        path_m
    });
    lengths.collect()
}

pub(super) fn relative(pairs: &[PosePair], over: Over) -> Option<RelativeErrors> {
    let (place, delta): (Vec<f64>, f64) = match over {
        Over::Time(delta_s) => (pairs.iter().map(|pair| pair.time_s).collect(), delta_s),
        Over::Distance(delta_m) => (paths_m(pairs), delta_m),
    };
    let (mut apart, mut translations, mut rotations) = (Vec::new(), Vec::new(), Vec::new());
    for (i, from) in pairs.iter().enumerate() {
        let least = place[i] + delta * (1.0 - ROUNDING);
        let j = i + place[i..].partition_point(|place| *place < least);
        let Some(to) = pairs.get(j) else {
            break;
        };
        if place[j] - place[i] > FARTHEST * delta {
            continue;
        }
        let reference = from.reference.inverse() * to.reference;
        let estimate = from.estimate.inverse() * to.estimate;
        let error = reference.inverse() * estimate;
        apart.push(place[j] - place[i]);
        translations.push(error.translation_m.norm());
        rotations.push(log(&error.rotation).norm());
    }
    apart.sort_unstable_by(f64::total_cmp);
    (!apart.is_empty()).then(|| RelativeErrors {
        count: apart.len(),
        apart: quantile(&apart, 0.5),
        translation_m: Spread::of(translations),
        rotation_rad: Spread::of(rotations),
    })
}
