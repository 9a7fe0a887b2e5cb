//! The ladder of rungs: mountings move only as much as sensors and scans require.

use super::adjust::{Outcome, at_rung};
use super::bend::Rung;
use super::conclude::not_determined;
use super::fixed;
use super::input::{JointDrive, JointInput};
use super::late;
use super::model::{IMU, contradictions};
use super::result::{Climb, Joint};
use super::score::Score;
use super::settings::{JointSettings, MountingMotion};
use crate::error::{Error, Result};
use crate::progress::{Progress, Steps};

/// Usual number of iterations, searches for surfels and estimates of the noise of an adjustment.
const STEPS: u64 = 12;
/// Units of progress of an adjustment.
const PROGRESS_UNITS: u64 = 1000;

/// Adjusts mountings and trajectories together.
///
/// # Errors
/// Too few surfels that scans or the reference check; unknowns that nothing determines; fixed parameters that the drive
/// contradicts; [`Error::Cancelled`].
pub fn adjust(
    input: &JointInput<'_>,
    settings: &JointSettings,
    surfel_m: f64,
    progress: &dyn Progress,
) -> Result<Joint> {
    let _stage = progress.stage("joint adjustment", PROGRESS_UNITS);
    let first_steps = Steps::new(progress, STEPS, PROGRESS_UNITS);
    // A known compliance is not questioned.
    let least = match input.compliance {
        [] => settings.mounting.least,
        _ => settings.mounting.least.max(Rung::Compliance),
    };
    let most = highest(input, settings).max(least);
    let mut sorted = None;
    let mut at = |input: &JointInput<'_>, rung: Rung, may_climb: bool| {
        // Higher rungs take as long again, and more.
        let stage = format!("{} mountings", rung.name());
        let has_climbed = rung > least;
        let _stage = has_climbed.then(|| progress.stage(&stage, PROGRESS_UNITS));
        let of_rung = has_climbed.then(|| Steps::new(progress, STEPS, PROGRESS_UNITS));
        let steps = of_rung.as_ref().unwrap_or(&first_steps);
        at_rung(
            input,
            settings,
            surfel_m,
            rung,
            may_climb,
            &mut sorted,
            steps,
        )
    };
    let (mut rung, mut ladder): (Rung, Vec<Climb>) = (least, Vec::new());
    let mut joint = loop {
        let next = rung.next().filter(|next| *next <= most);
        let outcome = match (at(input, rung, next.is_some()), ladder.pop()) {
            (Err(Error::Cancelled), _) => return Err(Error::Cancelled),
            // The rung below was contradicted, but could at least be adjusted.
            (Err(error), Some(below)) => {
                let name = rung.name();
                progress.say(&format!("{name} mountings cannot be adjusted: {error}"));
                rung = below.rung;
                match at(input, rung, false)? {
                    Outcome::Found(joint) => break *joint,
                    contradicted => contradicted,
                }
            }
            (outcome, below) => {
                ladder.extend(below);
                outcome?
            }
        };
        let (reasons, is_scanner_late) = match &outcome {
            Outcome::Found(joint) => {
                let mut late = joint.late_scores.iter().flatten();
                (contradictions(joint), late.any(Score::is_late))
            }
            Outcome::Contradicted(by) => (by.reasons.clone(), by.is_scanner_late),
        };
        if ladder.is_empty() && !reasons.is_empty() {
            fixed::check(input, |freed| at(freed, rung, false))?;
            if is_scanner_late
                && let Some(joint) =
                    late::explained(input, |freed| at(freed, rung, next.is_some()))?
            {
                progress.say(&format!(
                    "the mountings are {}, but scanners are late",
                    rung.name()
                ));
                break joint;
            }
        }
        match (outcome, next) {
            (_, Some(next)) if !reasons.is_empty() => {
                let name = rung.name();
                progress.say(&format!("the mountings are not {name}: {}", reasons[0]));
                ladder.push(Climb { rung, reasons });
                rung = next;
            }
            (Outcome::Found(joint), _) => break *joint,
            (Outcome::Contradicted(_), _) => return Err(not_determined()),
        }
    };
    joint.ladder = ladder;
    Ok(joint)
}

/// The highest rung to try. Without an IMU in all drives it is the first, because poses then follow the scans as
/// moving mountings would.
fn highest(input: &JointInput<'_>, settings: &JointSettings) -> Rung {
    let MountingMotion { least, most } = settings.mounting;
    let has_imu = |drive: &JointDrive<'_>| drive.motion.groups()[0].ends_with(IMU);
    if input.drives.iter().all(has_imu) {
        most
    } else {
        least
    }
}
