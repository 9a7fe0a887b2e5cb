//! The standard deviations of GNSS positions whose ambiguities are not fixed.

use crate::geometry::{Mat3, Vec3};
use crate::sensor::{FixQuality, PositionFix};
use crate::statistics::median;

/// Standard deviations of GNSS positions by the solution behind them, east, north, up, metres, and how long their errors
/// last. Positions with fixed ambiguities have those of the sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QualityNoise {
    /// With ambiguities that are not resolved.
    pub float_m: Vec3,
    /// By code with corrections.
    pub differential_m: Vec3,
    /// By code alone.
    pub single_m: Vec3,
    /// The time over which these errors stay alike, seconds.
    pub correlation_s: f64,
}

/// Ambiguities that are not resolved leave some decimetres, as makers of receivers state.
pub(in crate::project) const FLOAT_SIGMA_M: [f64; 3] = [0.4, 0.4, 0.8];
/// EGNOS, Open Service Definition: 3 m in the plane and 4 m in height at 95 %.
pub(in crate::project) const DIFFERENTIAL_SIGMA_M: [f64; 3] = [1.2, 1.2, 2.0];
/// GPS, Standard Positioning Service Performance Standard (2020): 8 m in the plane and 13 m in height at 95 %.
pub(in crate::project) const SINGLE_SIGMA_M: [f64; 3] = [3.3, 3.3, 6.6];

/// Receivers give a position every second unless they are set otherwise, seconds. Of a log that grows, one position may be
/// known at a time.
const USUAL_STEP_S: f64 = 1.0;

impl QualityNoise {
    fn sigma_m(&self, quality: FixQuality) -> Option<Vec3> {
        match quality {
            FixQuality::Fixed => None,
            FixQuality::Float => Some(self.float_m),
            FixQuality::Differential => Some(self.differential_m),
            FixQuality::Single => Some(self.single_m),
        }
    }

    /// Gives fixes whose ambiguities are not fixed the standard deviation of their quality, or the receiver's own, but
    /// none below `fixed_m`, that of fixed ones. As their errors last, all fixes within the correlation time together
    /// tell no more than one: each has the variance of one, times their number.
    ///
    /// Returns a sentence on the qualities; `None` if all are fixed.
    pub fn apply(
        &self,
        fixes: &mut [PositionFix],
        qualities: &[FixQuality],
        fixed_m: &Vec3,
    ) -> Option<String> {
        let all_fixed = qualities
            .iter()
            .all(|quality| *quality == FixQuality::Fixed);
        if all_fixed || qualities.len() != fixes.len() {
            return None;
        }
        let steps_s = fixes.windows(2).map(|pair| pair[1].time_s - pair[0].time_s);
        let step_s = median(steps_s.filter(|step_s| *step_s > 0.0));
        let alike = (self.correlation_s / step_s.unwrap_or(USUAL_STEP_S)).max(1.0);
        for (fix, quality) in fixes.iter_mut().zip(qualities) {
            let Some(sigma_m) = self.sigma_m(*quality) else {
                continue;
            };
            let least = |axis: usize| fixed_m[axis] * fixed_m[axis];
            let mut covariance_m2 = fix
                .covariance_m2
                .unwrap_or_else(|| Mat3::from_diagonal(&sigma_m.component_mul(&sigma_m)));
            for axis in 0..3 {
                let variance = &mut covariance_m2[(axis, axis)];
                *variance = variance.max(least(axis));
            }
            fix.covariance_m2 = Some(covariance_m2 * alike);
        }
        let used = FixQuality::ALL
            .into_iter()
            .filter(|quality| qualities.contains(quality));
        let sigmas = used.filter_map(|quality| {
            let sigma_m = self.sigma_m(quality)?;
            let [east, north, up] = sigma_m.into();
            Some(format!("{east}, {north}, {up} m for {}", quality.name()))
        });
        let sigmas: Vec<String> = sigmas.collect();
        Some(format!(
            "solutions of the receiver: {}; standard deviations east, north, up: {}, or those of the receiver, with \
             errors that last {} s",
            FixQuality::counts(qualities.iter().copied()),
            sigmas.join("; "),
            self.correlation_s
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fixes_without_fixed_ambiguities_count_as_one_in_their_correlation_time() {
        let noise = QualityNoise {
            float_m: Vec3::new(0.4, 0.4, 0.8),
            differential_m: Vec3::repeat(1.0),
            single_m: Vec3::repeat(3.0),
            correlation_s: 20.0,
        };
        let fix =
            |i: u32, sigma_m| PositionFix::with_sigma(0.2 * f64::from(i), Vec3::zeros(), sigma_m);
        let mut fixes = [
            fix(0, None),
            fix(1, None),
            fix(2, Some(0.001)),
            fix(3, Some(0.001)),
            fix(4, Some(0.5)),
        ];
        use FixQuality::{Fixed, Float, Single};
        let qualities = [Fixed, Float, Fixed, Single, Single];
        let fixed_m = Vec3::repeat(0.02);
        let text = noise.apply(&mut fixes, &qualities, &fixed_m).unwrap();
        assert!(text.contains("2 fixed, 1 float, 2 single"), "{text}");
        let up = |i: usize| fixes[i].covariance_m2.map(|c| c.m33.sqrt());
        let near = |i: usize, expected: f64| (up(i).unwrap() - expected).abs() < 1e-12;
        // 100 fixes in 20 s: ten times the standard deviation.
        assert_eq!(up(0), None);
        assert!(near(1, 8.0) && near(3, 0.2) && near(4, 5.0), "{fixes:?}");
        // What the receiver says of a fixed one stands.
        assert!(near(2, 0.001));
        assert_eq!(noise.apply(&mut fixes, &[Fixed; 5], &fixed_m), None);
        assert_eq!(noise.apply(&mut fixes, &[], &fixed_m), None);
    }
}
