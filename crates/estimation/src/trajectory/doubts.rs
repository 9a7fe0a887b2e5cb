//! Constants that the project takes as known, tested against the drive.

use super::estimate::estimate;
use super::settings::{Constant, TrajectorySettings};
use super::solution::{EstimatedConstant, Solution};
use super::streams::MotionLogs;
use crate::error::{Error, Result};
use crate::geometry::heading::wrap;
use crate::progress::{Progress, Silent, Steps};
use crate::stored::stored;

/// A constant is doubted where the drive finds it off by more standard deviations than this.
const MAX_SIGMAS: f64 = 5.0;
/// And by more than a careful survey leaves: metres, seconds, radians, m/s².
const LEAST_LEVER_ARM_M: f64 = 0.005;
const LEAST_LATENCY_S: f64 = 0.003;
const LEAST_OFFSET_RAD: f64 = 0.002;
const LEAST_GRAVITY_M_S2: f64 = 0.02;
/// What a rejected component of a record counts in the sum of squares.
const REJECTED_SQUARE: f64 = 16.0;
/// Least drop of the sum of squares that is no chance.
const MIN_GAIN: f64 = 40.0;
/// Least sum of squares over redundancy of a fit that is far off.
const MAX_RATIO: f64 = 3.0;
/// A constant explains enough where it leaves no more than this share of what all explain.
const LEFT_SHARE: f64 = 0.02;
/// Most constants that are doubted.
const MAX_DOUBTS: usize = 3;
/// What is likely meant matches to this many standard deviations, or to these: metres, radians.
const MATCH_SIGMAS: f64 = 4.0;
const MATCH_M: f64 = 0.02;
const MATCH_RAD: f64 = 0.035;

/// Trials of a drive that nothing contradicts, and the units of their progress.
const TRIALS: u64 = 1;
const PROGRESS_UNITS: u64 = 1000;

/// A constant of the project that the drive contradicts.
#[derive(Debug, Clone, PartialEq)]
pub struct Doubt {
    /// Which.
    pub constant: Constant,
    /// Its name in the project.
    pub name: String,
    /// Its components with the project's values and those found.
    pub values: Vec<EstimatedConstant>,
    /// How far the worst component is off, in standard deviations.
    pub sigmas: f64,
    /// Whether the value found is used, and not the project's.
    pub is_used: bool,
}

/// The constants that the drive contradicts, those first that explain most. `solution` is that of the
/// logs with these settings.
///
/// All constants that are held are freed at once; where that does not fit better, nothing is doubted.
/// Otherwise, and where nothing fits yet, they are freed one at a time, and the one that fits best stays free for the tests of the
/// others (Wald tests, forward selection), until nothing is left to explain, or until none explains its part: what
/// fits badly for another reason fits a little better with every constant.
///
/// # Errors
/// [`Error::Cancelled`].
pub fn doubts(
    logs: &MotionLogs<'_>,
    settings: &TrajectorySettings,
    solution: &Solution,
    progress: &dyn Progress,
) -> Result<Vec<Doubt>> {
    let stage = progress.stage("testing the constants", PROGRESS_UNITS);
    let trials = Steps::new(progress, TRIALS, PROGRESS_UNITS);
    let freed_too = |more: &[Constant]| -> Result<Option<Solution>> {
        progress.check()?;
        let mut trial = settings.clone();
        trial.estimate.extend(more);
        let found = estimate(logs, &trial, &Silent);
        trials.advance(1);
        match found {
            Ok(estimate) => Ok(Some(estimate.solution)),
            Err(Error::Cancelled) => Err(Error::Cancelled),
            // The drive does not determine it.
            Err(_) => Ok(None),
        }
    };
    let held = candidates(logs, settings);
    let mut now = squares(solution);
    let redundancy: f64 = solution
        .sensors
        .iter()
        .map(|sensor| sensor.redundancy)
        .sum();
    // From a fit that is far off, the way to all of them at once is long and may end elsewhere.
    let is_far_off = now >= MAX_RATIO * redundancy;
    let least = if is_far_off {
        0.0
    } else {
        freed_too(&held)?.map_or(0.0, |solution| squares(&solution))
    };
    let (mut freed, mut found) = (Vec::new(), Vec::new());
    while now - least > MIN_GAIN && freed.len() < MAX_DOUBTS {
        let enough = least + MIN_GAIN.max(LEFT_SHARE * (now - least));
        // Of constants that together leave a fit as good as its redundancy, one explains this or more.
        let part = if is_far_off {
            (now - redundancy) / MAX_DOUBTS as f64
        } else {
            0.0
        };
        let most = now - MIN_GAIN.max(part);
        let mut best: Option<(f64, Constant, Solution)> = None;
        for constant in held.iter().filter(|constant| !freed.contains(*constant)) {
            let Some(solution) = freed_too(&[&freed[..], &[*constant]].concat())? else {
                continue;
            };
            let squares = squares(&solution);
            let better = best.as_ref().map_or(most, |(least, ..)| *least);
            if squares < better && doubt(*constant, settings, &solution).is_some() {
                best = Some((squares, *constant, solution));
            }
            if best.as_ref().is_some_and(|(squares, ..)| *squares < enough) {
                break;
            }
        }
        let Some((squares, constant, solution)) = best else {
            break;
        };
        now = squares;
        freed.push(constant);
        let all = freed.iter();
        found = all
            .filter_map(|constant| doubt(*constant, settings, &solution))
            .collect();
    }
    drop(stage);
    Ok(found)
}

/// The constants that are held; those first whose mistakes are the largest.
fn candidates(logs: &MotionLogs<'_>, settings: &TrajectorySettings) -> Vec<Constant> {
    let sensors = 0..settings.positions.len();
    let of_positions = sensors.flat_map(|i| [Constant::LeverArm(i), Constant::TimeOffset(i)]);
    let has_heading = !logs.heading.is_empty();
    let offset = has_heading.then_some(Constant::HeadingOffset);
    let latency = has_heading.then_some(Constant::HeadingTimeOffset);
    let all = offset.into_iter().chain(of_positions).chain(latency);
    let all = all.chain([Constant::Gravity]);
    all.filter(|constant| !settings.estimate.contains(constant))
        .collect()
}

/// What the drive says about a constant that was freed, if it is significantly off.
fn doubt(constant: Constant, settings: &TrajectorySettings, solution: &Solution) -> Option<Doubt> {
    let name = constant.name(&settings.positions);
    let is_own = |found: &&EstimatedConstant| {
        found.name == name
            || found
                .name
                .strip_prefix(&name)
                .is_some_and(|rest| rest.starts_with('.'))
    };
    let values: Vec<EstimatedConstant> =
        solution.constants.iter().filter(is_own).cloned().collect();
    let least = match constant {
        Constant::LeverArm(_) => LEAST_LEVER_ARM_M,
        Constant::TimeOffset(_) | Constant::HeadingTimeOffset => LEAST_LATENCY_S,
        Constant::HeadingOffset => LEAST_OFFSET_RAD,
        _ => LEAST_GRAVITY_M_S2,
    };
    let sigmas = |found: &EstimatedConstant| {
        let off = off(constant, found).abs();
        found.sigma.filter(|_| off > least).map(|sigma| off / sigma)
    };
    let worst = values.iter().filter_map(sigmas).fold(0.0, f64::max);
    (solution.converged && worst > MAX_SIGMAS).then_some(Doubt {
        constant,
        name,
        values,
        sigmas: worst,
        is_used: false,
    })
}

/// How far a value is from the project's.
fn off(constant: Constant, found: &EstimatedConstant) -> f64 {
    let off = found.value - found.start;
    match constant {
        Constant::HeadingOffset => wrap(off),
        _ => off,
    }
}

/// How badly all records fit: squares of those used, and a large one for each that was rejected.
fn squares(solution: &Solution) -> f64 {
    let of_sensor = solution
        .sensors
        .iter()
        .map(|sensor| sensor.chi_square + REJECTED_SQUARE * sensor.rejected as f64);
    of_sensor.sum()
}

impl Doubt {
    /// How far the worst component is off, in its unit.
    pub fn off(&self) -> f64 {
        let all = self.values.iter();
        all.map(|found| off(self.constant, found).abs())
            .fold(0.0, f64::max)
    }

    /// What the drive finds, what it is likely to be, and what to write.
    pub fn describe(&self) -> String {
        let name = &self.name;
        let list = |of: &dyn Fn(&EstimatedConstant) -> String| {
            self.values.iter().map(of).collect::<Vec<_>>().join(", ")
        };
        let first = self.values.first();
        let (factor, unit) = first.map_or((1.0, ""), EstimatedConstant::shown_in);
        let digits = match unit {
            "ms" => 1,
            "°" => 2,
            _ => 4,
        };
        let with_sigma = |found: &EstimatedConstant| {
            let sigma = found.sigma.unwrap_or(f64::NAN) * factor;
            format!("{:.digits$} ± {sigma:.digits$}", found.value * factor)
        };
        let given = |found: &EstimatedConstant| format!("{:.digits$}", found.start * factor);
        let likely = self.likely();
        let likely = likely.map_or(String::new(), |what| format!(" Is it {what}?"));
        let then = if self.is_used {
            "; the value found is used here".to_owned()
        } else {
            format!(", or let it be estimated with trajectory.estimate = [\"{name}\"]")
        };
        format!(
            "the drive contradicts `{name}`: it finds {} {unit} instead of {}, {:.0} standard \
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
        let value = self.values.first().map_or(f64::NAN, |found| found.value);
        match self.constant {
            Constant::LeverArm(_) => {
                let list = |values: &[f64]| {
                    let values = values.iter().map(|value| (1e4 * value).round() / 1e4);
                    let values = values.map(|value| value.to_string());
                    values.collect::<Vec<_>>().join(", ")
                };
                // What was meant is known better than what the drive finds.
                if let Some((_, meant)) = self.likely_lever_arm() {
                    return format!("Then write [{table}] lever_arm_m = [{}]", list(&meant));
                }
                let found: Vec<f64> = self.values.iter().map(|found| found.value).collect();
                format!(
                    "Measure it again: [{table}] lever_arm_m = [{}] is what the drive finds, and no better \
                     known than that",
                    list(&found)
                )
            }
            Constant::TimeOffset(_) | Constant::HeadingTimeOffset => {
                format!("Check the clocks; {value:+.4} added to [{table}] time_offset_s fits")
            }
            Constant::HeadingOffset => format!(
                "Check it; [{table}] mounting_offset_deg = {:.2} fits",
                value.to_degrees()
            ),
            _ => format!("Check it; [{table}] gravity_m_s2 = {value:.4} fits"),
        }
    }

    /// What the mistake is likely to be.
    fn likely(&self) -> Option<String> {
        match self.constant {
            Constant::LeverArm(_) => self.likely_lever_arm().map(|(what, _)| what),
            Constant::HeadingOffset => {
                let found = self.values.first()?;
                let within = MATCH_RAD.max(MATCH_SIGMAS * found.sigma?);
                let is_at = |rad: f64| wrap(found.value - rad).abs() < within;
                let turn = |deg: f64| found.start + deg.to_radians();
                if is_at(turn(180.0)) {
                    Some("180°: the antennas exchanged".into())
                } else if is_at(turn(90.0)) || is_at(turn(-90.0)) {
                    Some("90°: the antennas across the direction of travel".into())
                } else if found.start.abs() > within && is_at(-found.start) {
                    Some("the sign of the offset".into())
                } else {
                    None
                }
            }
            _ => None,
        }
    }

    /// The mistake in words, and the lever arm that was meant.
    fn likely_lever_arm(&self) -> Option<(String, [f64; 3])> {
        let [x, y, z] = self.values.as_slice() else {
            return None;
        };
        let matches = |found: &EstimatedConstant, value: f64| {
            let within = MATCH_M.max(MATCH_SIGMAS * found.sigma.unwrap_or(0.0));
            (found.value - value).abs() < within
        };
        let is_flipped = |found: &EstimatedConstant| {
            !matches(found, found.start) && matches(found, -found.start)
        };
        let all = [("x", x), ("y", y), ("z", z)];
        let flipped = all.iter().filter(|(_, found)| is_flipped(found));
        let flipped: Vec<&str> = flipped.map(|(axis, _)| *axis).collect();
        let is_kept = |(_, found): &(&str, &EstimatedConstant)| matches(found, found.start);
        if all.iter().all(|one| is_kept(one) || is_flipped(one.1)) {
            let what = match flipped.as_slice() {
                [] => return None,
                ["y", "z"] => "the sign of y and z, as of FLU in the place of FRD".into(),
                axes => format!("the sign of {}", axes.join(" and ")),
            };
            let meant = all.map(|(_, found)| {
                if is_flipped(found) {
                    -found.start
                } else {
                    found.start
                }
            });
            return Some((what, meant));
        }
        let exchanged = matches(x, y.start) && matches(y, x.start) && matches(z, z.start);
        exchanged.then(|| ("x and y exchanged".into(), [y.start, x.start, z.start]))
    }
}

stored!(struct Doubt { constant, name, values, sigmas, is_used });

#[cfg(test)]
mod tests {
    use super::*;

    fn values(of: &[(f64, f64)]) -> Vec<EstimatedConstant> {
        let names = [
            "prism.lever_arm.x",
            "prism.lever_arm.y",
            "prism.lever_arm.z",
        ];
        of.iter()
            .zip(names)
            .map(|(&(start, value), name)| EstimatedConstant {
                name: name.into(),
                unit: "m",
                start,
                value,
                sigma: Some(0.004),
            })
            .collect()
    }

    fn lever_arm(of: &[(f64, f64); 3]) -> Doubt {
        Doubt {
            constant: Constant::LeverArm(0),
            name: "prism.lever_arm".into(),
            values: values(of),
            sigmas: 50.0,
            is_used: false,
        }
    }

    #[test]
    fn likely_mistakes_in_a_lever_arm_are_named() {
        for (of, likely) in [
            (
                [(0.1, -0.101), (0.05, -0.051), (-0.55, -0.549)],
                Some("the sign of x and y"),
            ),
            (
                [(0.1, 0.1), (0.05, -0.05), (-0.55, 0.56)],
                Some("the sign of y and z, as of FLU in the place of FRD"),
            ),
            (
                [(0.1, 0.052), (0.05, 0.098), (-0.55, -0.55)],
                Some("x and y exchanged"),
            ),
            ([(0.1, 0.3), (0.05, 0.05), (-0.55, -0.55)], None),
        ] {
            assert_eq!(lever_arm(&of).likely().as_deref(), likely);
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
