//! Numbers quantised to few bits, with the size of their steps.

use serde::{Deserialize, Serialize};

use crate::geometry::{Rotation, Transform, Vec3};

/// Steps between the ends of a [`Range16`].
const STEPS_16: f64 = u16::MAX as f64;

/// Steps between the ends of [`Bytes`]; the byte 0 stands for an unknown value.
const STEPS_8: f64 = 254.0;

/// Step of the components of a quaternion, which range from −1 to 1.
pub const ROTATION_STEP: f64 = 1.0 / (1_u32 << 30) as f64;

/// Numbers in 16 bits over their range. The error is at most half a step.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Range16 {
    /// The smallest number.
    pub low: f64,
    /// The largest number.
    pub high: f64,
    /// Steps from the smallest number; empty if all are the same.
    pub values: Vec<u16>,
}

impl Range16 {
    /// Quantises finite numbers.
    pub fn of(numbers: impl Iterator<Item = f64> + Clone) -> Self {
        let ends = |(low, high): (f64, f64), x: f64| (low.min(x), high.max(x));
        let (low, high) = numbers
            .clone()
            .fold((f64::INFINITY, f64::NEG_INFINITY), ends);
        if low >= high || !(high - low).is_finite() {
            let only = if low.is_finite() { low } else { 0.0 };
            return Self {
                low: only,
                high: only,
                values: Vec::new(),
            };
        }
        let step = |x: f64| ((x - low) / (high - low) * STEPS_16).round() as u16;
        Self {
            values: numbers.map(step).collect(),
            low,
            high,
        }
    }
}

/// Numbers in one byte each: 0 for an unknown number, 1 to 255 from the low to the high end. Numbers beyond an end are
/// clamped to it.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Bytes {
    /// The number that 1 stands for.
    pub low: f64,
    /// The number that 255 stands for.
    pub high: f64,
    /// The bytes.
    pub values: Vec<u8>,
}

impl Bytes {
    /// Quantises numbers; those that are not finite are unknown.
    pub fn of((low, high): (f64, f64), numbers: impl Iterator<Item = f64>) -> Self {
        let byte = |x: f64| {
            if x.is_finite() {
                1 + ((x - low) / (high - low) * STEPS_8)
                    .round()
                    .clamp(0.0, STEPS_8) as u8
            } else {
                0
            }
        };
        Self {
            values: numbers.map(byte).collect(),
            low,
            high,
        }
    }
}

/// The smallest multiple of `least` by a power of two for which 31 bits reach `reach`; both are positive.
pub fn step_31(least: f64, reach: f64) -> f64 {
    let mut step = least;
    while reach / step >= f64::from(i32::MAX) {
        step *= 2.0;
    }
    step
}

/// Points as whole steps from an origin, one list per axis.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Places {
    /// x, y and z.
    pub axes: [Vec<i32>; 3],
}

impl Places {
    /// Adds a point in steps of `step_m`; `point_m` is relative to the origin, metres.
    pub fn push(&mut self, point_m: &Vec3, step_m: f64) {
        for (axis, x) in self.axes.iter_mut().zip(point_m.iter()) {
            axis.push((x / step_m).round() as i32);
        }
    }
}

/// A transform for each profile of a scanner.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Track {
    /// Translations.
    pub places: Places,
    /// The components x, y, z and w of the rotations, in steps of [`ROTATION_STEP`], without sign changes between
    /// neighbours.
    pub rotations: [Vec<i32>; 4],
}

impl Track {
    /// Adds a transform; `origin_m` is the origin of the list in the frame of the transform's translation.
    pub fn push<To, From>(&mut self, pose: &Transform<To, From>, origin_m: &Vec3, step_m: f64) {
        self.places.push(&(pose.translation_m - origin_m), step_m);
        let components = self.signed(&pose.rotation);
        for (list, component) in self.rotations.iter_mut().zip(components) {
            list.push((component / ROTATION_STEP).round() as i32);
        }
    }

    /// The components of a rotation, with the sign that is closer to the last rotation.
    fn signed(&self, rotation: &Rotation) -> [f64; 4] {
        let components = <[f64; 4]>::from(rotation.coords);
        let last = self
            .rotations
            .each_ref()
            .map(|list| f64::from(list.last().copied().unwrap_or(0)));
        let dot: f64 = components.iter().zip(last).map(|(a, b)| a * b).sum();
        components.map(|component| if dot < 0.0 { -component } else { component })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_back_within_half_a_step() {
        let numbers = [-0.85, 0.3, 0.300_01, 0.59];
        let range = Range16::of(numbers.iter().copied());
        let step = (range.high - range.low) / STEPS_16;
        for (value, number) in range.values.iter().zip(numbers) {
            assert!((range.low + step * f64::from(*value) - number).abs() <= 0.5 * step);
        }
        let same = Range16::of([0.25; 3].into_iter());
        assert_eq!((same.low, same.values.len()), (0.25, 0));
        assert_eq!(Range16::of([].into_iter()), Range16::default());
        let bytes = Bytes::of((-1.0, 1.0), [f64::NAN, -1.0, 0.0, 1.0, 7.0].into_iter());
        assert_eq!(bytes.values, [0, 1, 128, 255, 255]);
        assert_eq!(step_31(1e-6, 2000.0), 1e-6);
        assert_eq!(step_31(1e-6, 5000.0), 4e-6);
    }

    #[test]
    fn rotations_do_not_jump_where_their_sign_does() {
        let mut track = Track::default();
        for angle in [3.1, 3.2] {
            let rotation = Rotation::from_euler_angles(0.0, 0.0, angle);
            let pose = Transform::<(), ()>::new(rotation, Vec3::zeros());
            track.push(&pose, &Vec3::zeros(), 1e-6);
        }
        let [_, _, z, w] = &track.rotations;
        assert!(z[0] > 0 && z[1] > 0 && w[0] > 0 && w[1] < 0);
    }
}
