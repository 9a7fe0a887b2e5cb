//! Parameters of mountings that the project fixes, tested against the drive.

use super::adjust::{Outcome, at_rung};
use super::bend::Rung;
use super::input::{JointDrive, JointInput};
use super::model::contradictions;
use super::result::Joint;
use super::settings::JointSettings;
use crate::calibration::{Mounting, PARAMETER_NAMES};
use crate::error::{Error, Problem, Result, unless_cancelled};
use crate::progress::Progress;

/// A fixed parameter is contradicted where the drive finds it off by more standard deviations than this, as a constant of
/// the project is.
const MAX_SIGMAS: f64 = 5.0;

/// Where a drive contradicts the lowest rung, and fits it with the fixed parameters free: an error that names those that are
/// off. Otherwise mountings would move to make up for a value that is wrong.
///
/// # Errors
/// Fixed parameters that are off; [`Error::Cancelled`].
pub fn check(
    input: &JointInput<'_>,
    settings: &JointSettings,
    surfel_m: f64,
    rung: Rung,
    progress: &dyn Progress,
) -> Result<()> {
    let any_fixed = input.mountings.iter().any(|m| m.fixed.contains(&true));
    if !any_fixed || input.known.is_some() {
        return Ok(());
    }
    let freed = freed(input);
    let outcome = at_rung(&freed, settings, surfel_m, rung, false, &mut None, progress);
    let Some(Outcome::Found(joint)) = unless_cancelled(outcome)? else {
        return Ok(());
    };
    let off = off(&joint, &input.mountings);
    if off.is_empty() || !contradictions(&joint).is_empty() {
        return Ok(());
    }
    Err(Error::of(
        Problem::Contradicted,
        format!(
            "the drive contradicts values that the project fixes: {}",
            off.join(", ")
        ),
        "free them, or write the right ones",
    ))
}

/// The same data with all parameters free.
fn freed<'a>(input: &JointInput<'a>) -> JointInput<'a> {
    let drive = |drive: &JointDrive<'a>| JointDrive {
        name: drive.name.clone(),
        motion: drive.motion.boxed(),
        scans: drive.scans.clone(),
        frame: drive.frame.clone(),
    };
    let free = |mounting: &Mounting| Mounting {
        fixed: [false; 6],
        ..mounting.clone()
    };
    JointInput {
        mountings: input.mountings.iter().map(free).collect(),
        estimate_latency: input.estimate_latency.clone(),
        drives: input.drives.iter().map(drive).collect(),
        ..*input
    }
}

/// The fixed parameters that an adjustment with free ones finds off, in words. Angles are compared about the axes of the
/// body.
fn off(joint: &Joint, fixed: &[Mounting]) -> Vec<String> {
    let mut texts = Vec::new();
    for (scanner, (found, fixed)) in joint.mountings.iter().zip(fixed).enumerate() {
        let (turn_rad, shift_m) = found
            .body_from_scanner
            .perturbation_from(&fixed.body_from_scanner);
        let off = shift_m.iter().chain(turn_rad.iter());
        for (parameter, off) in off.enumerate().filter(|(i, _)| fixed.fixed[*i]) {
            let place = 6 * scanner + parameter;
            let sigma = joint.covariance[(place, place)].sqrt();
            if off.abs() < MAX_SIGMAS * sigma {
                continue;
            }
            let (factor, unit) = if parameter < 3 {
                (1e3, " mm")
            } else {
                (1f64.to_degrees(), "°")
            };
            texts.push(format!(
                "{} of `{}` is off by {:+.2} ± {:.2}{unit}",
                PARAMETER_NAMES[parameter],
                fixed.name,
                -off * factor,
                sigma * factor,
            ));
        }
    }
    texts
}
