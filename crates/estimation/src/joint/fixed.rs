//! Parameters of mountings that the project fixes, tested against the drive.

use super::adjust::{Outcome, holding};
use super::input::JointInput;
use super::result::Joint;
use crate::calibration::{Mounting, PARAMETER_NAMES, change};
use crate::error::{Error, Problem, Result};
use crate::trajectory::Doubt;

/// Where a drive contradicts the lowest rung, and fits it with the fixed parameters free: an error that names those that are
/// off. Otherwise mountings would move to make up for a value that is wrong. `at_lowest` adjusts at that rung.
///
/// # Errors
/// Fixed parameters that are off; [`Error::Cancelled`].
pub fn check(
    input: &JointInput<'_>,
    at_lowest: impl FnOnce(&JointInput<'_>) -> Result<Outcome>,
) -> Result<()> {
    let any_fixed = input.mountings.iter().any(|m| m.fixed.contains(&true));
    if !any_fixed || input.known.is_some() {
        return Ok(());
    }
    let Some(joint) = holding(at_lowest(&freed(input)))? else {
        return Ok(());
    };
    let off = off(&joint, &input.mountings);
    if off.is_empty() {
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
    let mut freed = input.clone();
    let mountings = freed.mountings.iter_mut();
    mountings.for_each(|mounting| mounting.fixed = [false; 6]);
    freed
}

/// The fixed parameters that an adjustment with free ones finds off, in words, beyond what a constant of the project may be.
/// Angles are compared about the axes of the body.
fn off(joint: &Joint, fixed: &[Mounting]) -> Vec<String> {
    let found = change(fixed, &joint.mountings);
    let sigma = |place: usize| joint.covariance[(place, place)].sqrt();
    let is_off = |place: &usize| {
        fixed[place / 6].fixed[place % 6]
            && found[*place].abs() >= Doubt::MAX_SIGMAS * sigma(*place)
    };
    let describe = |place: usize| {
        let (factor, unit) = match place % 6 {
            0..3 => (1e3, " mm"),
            _ => (1f64.to_degrees(), "°"),
        };
        format!(
            "{} of `{}` is off by {:+.2} ± {:.2}{unit}",
            PARAMETER_NAMES[place % 6],
            fixed[place / 6].name,
            -found[place] * factor,
            sigma(place) * factor,
        )
    };
    (0..found.len()).filter(is_off).map(describe).collect()
}
