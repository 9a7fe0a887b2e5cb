//! A constant of the project that the drive contradicts: by how much, the likely mistake, and what to write.

use serde::{Deserialize, Serialize};

use super::settings::{Constant, TrajectorySettings};
use super::solution::{EstimatedConstant, Solution};
use crate::geometry::heading::wrap;
use std::ops::RangeInclusive;

/// A constant is doubted where it is off by more than a careful survey leaves, or the maker of a calibrated IMU: metres,
/// seconds, radians, m/s², share.
const LEAST_LEVER_ARM_M: f64 = 0.005;
const LEAST_LATENCY_S: f64 = 0.003;
const LEAST_OFFSET_RAD: f64 = 0.002;
const LEAST_GRAVITY_M_S2: f64 = 0.02;
const LEAST_GYRO_SCALE: f64 = 0.002;
/// Gravity on the ground: 9.780 m/s² at the equator, 9.832 at the poles, and 0.003 less for each kilometre of height.
const GRAVITY_M_S2: RangeInclusive<f64> = 9.76..=9.84;
/// No gyroscope is off by more than a tenth.
const GYRO_SCALE: RangeInclusive<f64> = 0.9..=1.1;
/// A likely mistake matches what the drive finds to this many standard deviations, or to these metres and
/// radians.
const MATCH_SIGMAS: f64 = 4.0;
const MATCH_M: f64 = 0.02;
const MATCH_RAD: f64 = 0.035;

/// A constant of the project that the drive contradicts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Doubt {
    /// The constant.
    pub constant: Constant,
    /// Its name in the project.
    pub name: String,
    /// Its components, with the project's values and those that the drive finds.
    pub values: Vec<EstimatedConstant>,
    /// How far the worst component is off, in standard deviations.
    pub sigmas: f64,
    /// Whether the value that the drive finds is used instead of the project's.
    pub is_used: bool,
}

/// How far an estimated value is from the project's.
fn deviation(constant: Constant, estimated: &EstimatedConstant) -> f64 {
    let off = estimated.value - estimated.start;
    match constant {
        Constant::HeadingOffset => wrap(off),
        _ => off,
    }
}

impl Doubt {
    /// And by more standard deviations than this.
    pub const MAX_SIGMAS: f64 = 5.0;

    /// The doubt about a constant that was estimated, if it is significantly off and its value is possible.
    pub(super) fn of(
        constant: Constant,
        settings: &TrajectorySettings,
        solution: &Solution,
    ) -> Option<Self> {
        let name = constant.name(&settings.positions);
        let is_component = |estimated: &&EstimatedConstant| {
            estimated.name == name
                || estimated
                    .name
                    .strip_prefix(&name)
                    .is_some_and(|suffix| suffix.starts_with('.'))
        };
        let components = solution.constants.iter().filter(is_component);
        let values: Vec<EstimatedConstant> = components.cloned().collect();
        let least = match constant {
            Constant::LeverArm(_) => LEAST_LEVER_ARM_M,
            Constant::TimeOffset(_) | Constant::TimeDrift(_) | Constant::HeadingTimeOffset => {
                LEAST_LATENCY_S
            }
            Constant::HeadingOffset => LEAST_OFFSET_RAD,
            Constant::GyroScale => LEAST_GYRO_SCALE,
            _ => LEAST_GRAVITY_M_S2,
        };
        let sigmas = |estimated: &EstimatedConstant| {
            let off = deviation(constant, estimated).abs();
            let sigma = estimated.sigma.filter(|_| off > least);
            sigma.map(|sigma| off / sigma)
        };
        let worst = values.iter().filter_map(sigmas).fold(0.0, f64::max);
        let is_possible = |estimated: &EstimatedConstant| match constant {
            Constant::Gravity => GRAVITY_M_S2.contains(&estimated.value),
            Constant::GyroScale => GYRO_SCALE.contains(&estimated.value),
            _ => true,
        };
        let is_contradicted =
            solution.converged && worst > Self::MAX_SIGMAS && values.iter().all(is_possible);
        is_contradicted.then_some(Self {
            constant,
            name,
            values,
            sigmas: worst,
            is_used: false,
        })
    }

    /// How far the worst component is off, in its unit.
    pub fn off(&self) -> f64 {
        let all = self.values.iter();
        all.map(|estimated| deviation(self.constant, estimated).abs())
            .fold(0.0, f64::max)
    }

    /// What the drive finds, which mistake is likely, and what to write.
    pub fn describe(&self) -> String {
        let name = &self.name;
        let list = |text: &dyn Fn(&EstimatedConstant) -> String| {
            self.values.iter().map(text).collect::<Vec<_>>().join(", ")
        };
        let first = self.values.first();
        let (factor, unit) = first.map_or((1.0, ""), EstimatedConstant::shown_in);
        let digits = match unit {
            "ms" => 1,
            "°" => 2,
            _ => 4,
        };
        let with_sigma = |estimated: &EstimatedConstant| {
            let value = format!("{:.digits$}", estimated.value * factor);
            match estimated.sigma {
                Some(sigma) => format!("{value} ± {:.digits$}", sigma * factor),
                None => format!("{value} (not determined)"),
            }
        };
        let unit = match unit {
            "" => String::new(),
            unit => format!(" {unit}"),
        };
        let given =
            |estimated: &EstimatedConstant| format!("{:.digits$}", estimated.start * factor);
        let likely = self.likely();
        let likely = likely.map_or(String::new(), |what| format!(" Is it {what}?"));
        let then = if self.is_used {
            "; the value found is used here".to_owned()
        } else {
            format!(", or let it be estimated with trajectory.estimate = [\"{name}\"]")
        };
        format!(
            "the drive contradicts `{name}`: it finds {}{unit} instead of {}, {:.0} standard \
             deviations off.{likely} {}{then}",
            list(&with_sigma),
            list(&given),
            self.sigmas,
            self.remedy()
        )
    }

    /// The line to write.
    fn remedy(&self) -> String {
        let name = self.name.as_str();
        let table = name.split_once('.').map_or(name, |(table, _)| table);
        let value = self.values.first().map_or(f64::NAN, |first| first.value);
        match self.constant {
            Constant::LeverArm(_) => {
                let list = |values: &[f64]| {
                    let values = values.iter().map(|value| (1e4 * value).round() / 1e4);
                    let values = values.map(|value| value.to_string());
                    values.collect::<Vec<_>>().join(", ")
                };
                // The value that was meant is more exact than the one that the drive finds.
                if let Some((_, meant)) = self.likely_lever_arm() {
                    return format!("Then write [{table}] lever_arm_m = [{}]", list(&meant));
                }
                let estimated: Vec<f64> = self.values.iter().map(|axis| axis.value).collect();
                format!(
                    "Measure it again: [{table}] lever_arm_m = [{}] is what the drive finds, no more \
                     accurate than stated",
                    list(&estimated)
                )
            }
            Constant::TimeOffset(_) | Constant::HeadingTimeOffset => {
                format!("Check the clocks; adding {value:+.4} to [{table}] time_offset_s fits")
            }
            Constant::TimeDrift(_) => {
                let change = if value < 0.0 { "gain" } else { "lose" };
                format!(
                    "Its clock runs at another rate than the IMU's: from the first record to the last, its times {change} \
                     {:.0} ms. Give both one source of time",
                    1e3 * value.abs()
                )
            }
            Constant::HeadingOffset => format!(
                "Check it; [{table}] mounting_offset_deg = {:.2} fits",
                value.to_degrees()
            ),
            Constant::GyroScale => {
                "Divide the rates about x, y and z by these, or have the gyroscope calibrated"
                    .into()
            }
            _ => format!("Check it; [{table}] gravity_m_s2 = {value:.4} fits"),
        }
    }

    /// The likely mistake.
    fn likely(&self) -> Option<String> {
        match self.constant {
            Constant::LeverArm(_) => self.likely_lever_arm().map(|(what, _)| what),
            Constant::HeadingOffset => {
                let offset = self.values.first()?;
                let within = MATCH_RAD.max(MATCH_SIGMAS * offset.sigma?);
                let is_at = |rad: f64| wrap(offset.value - rad).abs() < within;
                let turn = |deg: f64| offset.start + deg.to_radians();
                if is_at(turn(180.0)) {
                    Some("180°, with the antennas exchanged".into())
                } else if is_at(turn(90.0)) || is_at(turn(-90.0)) {
                    Some("90°, with the antennas across the direction of travel".into())
                } else if offset.start.abs() > within && is_at(-offset.start) {
                    Some("the sign of the offset".into())
                } else {
                    None
                }
            }
            _ => None,
        }
    }

    /// The likely mistake in words, and the lever arm that was meant.
    fn likely_lever_arm(&self) -> Option<(String, [f64; 3])> {
        let [x, y, z] = self.values.as_slice() else {
            return None;
        };
        let matches = |estimated: &EstimatedConstant, value: f64| {
            let within = MATCH_M.max(MATCH_SIGMAS * estimated.sigma.unwrap_or(0.0));
            (estimated.value - value).abs() < within
        };
        let is_unchanged = |estimated: &EstimatedConstant| matches(estimated, estimated.start);
        let is_flipped = |estimated: &EstimatedConstant| {
            !is_unchanged(estimated) && matches(estimated, -estimated.start)
        };
        let all = [("x", x), ("y", y), ("z", z)];
        let flipped = all.iter().filter(|(_, estimated)| is_flipped(estimated));
        let flipped: Vec<&str> = flipped.map(|(axis, _)| *axis).collect();
        let is_explained = |estimated| is_unchanged(estimated) || is_flipped(estimated);
        if all.iter().all(|(_, estimated)| is_explained(estimated)) {
            let what = match flipped.as_slice() {
                [] => return None,
                ["y", "z"] => "the sign of y and z, as in FLU in the place of FRD".into(),
                axes => format!("the sign of {}", axes.join(" and ")),
            };
            let meant = all.map(|(_, estimated)| {
                if is_flipped(estimated) {
                    -estimated.start
                } else {
                    estimated.start
                }
            });
            return Some((what, meant));
        }
        let exchanged = matches(x, y.start) && matches(y, x.start) && matches(z, z.start);
        exchanged.then(|| ("x and y exchanged".into(), [y.start, x.start, z.start]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Components with these project's values and estimates.
    fn values(pairs: &[(f64, f64)]) -> Vec<EstimatedConstant> {
        let names = [
            "prism.lever_arm.x",
            "prism.lever_arm.y",
            "prism.lever_arm.z",
        ];
        pairs
            .iter()
            .zip(names)
            .map(|(&(start, value), name)| EstimatedConstant {
                name: name.into(),
                unit: "m".into(),
                start,
                value,
                sigma: Some(0.004),
            })
            .collect()
    }

    fn lever_arm(pairs: &[(f64, f64); 3]) -> Doubt {
        Doubt {
            constant: Constant::LeverArm(0),
            name: "prism.lever_arm".into(),
            values: values(pairs),
            sigmas: 50.0,
            is_used: false,
        }
    }

    #[test]
    fn likely_mistakes_in_a_lever_arm_are_named() {
        for (pairs, likely) in [
            (
                [(0.1, -0.101), (0.05, -0.051), (-0.55, -0.549)],
                Some("the sign of x and y"),
            ),
            (
                [(0.1, 0.1), (0.05, -0.05), (-0.55, 0.56)],
                Some("the sign of y and z, as in FLU in the place of FRD"),
            ),
            (
                [(0.1, 0.052), (0.05, 0.098), (-0.55, -0.55)],
                Some("x and y exchanged"),
            ),
            ([(0.1, 0.3), (0.05, 0.05), (-0.55, -0.55)], None),
        ] {
            assert_eq!(lever_arm(&pairs).likely().as_deref(), likely);
        }
    }

    #[test]
    fn without_a_likely_mistake_the_lever_arm_is_to_be_measured_again() {
        let text = lever_arm(&[(0.1, 0.3), (0.05, 0.05), (-0.55, -0.55)]).describe();
        for part in [
            "Measure it again",
            "[prism] lever_arm_m = [0.3, 0.05, -0.55] is what the drive finds",
        ] {
            assert!(text.contains(part), "{text}");
        }
    }

    #[test]
    fn a_doubt_says_what_was_found_and_what_to_write() {
        let text = lever_arm(&[(0.1, -0.101), (0.05, -0.051), (-0.55, -0.549)]).describe();
        for part in [
            "contradicts `prism.lever_arm`",
            "-0.1010 ± 0.0040, -0.0510 ± 0.0040, -0.5490 ± 0.0040 m",
            "instead of 0.1000, 0.0500, -0.5500",
            "Is it the sign of x and y?",
            "Then write [prism] lever_arm_m = [-0.1, -0.05, -0.55]",
            "trajectory.estimate = [\"prism.lever_arm\"]",
        ] {
            assert!(text.contains(part), "{text}");
        }
    }
}
