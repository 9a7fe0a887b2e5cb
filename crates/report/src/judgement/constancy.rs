//! Verdicts on the constancy of the mountings, from the residuals along the drive.

use crate::calibration::{Calibration, Constancy, Correlation, Gap, Method};
use crate::number;
use crate::verdict::Verdict;

/// The test of a constant mounting; `None` if it is not possible.
pub fn verdict(calibration: &Calibration) -> Option<Verdict> {
    let constancy = calibration.constancy.as_ref()?;
    const CODE: &str = "mounting.constancy";
    let verdict = match warning(calibration) {
        Some(text) => Verdict::care(CODE, text),
        None => Verdict::good(
            CODE,
            format!(
                "The mounting appears constant{}: residuals along the drive ({}) are {:.1} times as large \
             as the standard deviations of the poses explain.",
                of_two_steps(calibration),
                number::length(constancy.rms_m),
                constancy.ratio
            ),
        ),
    };
    let verdict = verdict.with_value(constancy.ratio, None);
    Some(match calibration.method {
        Method::Joint => verdict.about("two steps"),
        Method::TwoStep | Method::Paper => verdict,
    })
}

/// A warning if the residuals along the drive show that the mounting is not constant.
pub fn warning(calibration: &Calibration) -> Option<String> {
    let constancy = calibration
        .constancy
        .as_ref()
        .filter(|constancy| !constancy.constant)?;
    let with = pattern(calibration, constancy);
    Some(format!(
        "The mounting does not appear constant{}: residuals along the drive ({}) are {:.1} times as \
         large as the standard deviations of the poses explain.{with}",
        of_two_steps(calibration),
        number::length(constancy.rms_m),
        constancy.ratio
    ))
}

/// A verdict if two scanners move relative to each other; `None` if their distance is constant. A joint adjustment has
/// its own tests.
pub fn gap(calibration: &Calibration) -> Option<Verdict> {
    let text = gap_warning(calibration)?;
    let gap_m = calibration.gap.map_or(0.0, |gap| gap.rms_m);
    Some(Verdict::care("mounting.gap", text).with_value(gap_m, None))
}

/// The warning of [`gap`] as text.
pub fn gap_warning(calibration: &Calibration) -> Option<String> {
    let gap = moving_gap(calibration)?;
    let [first, other] = gap
        .scanners
        .map(|scanner| &calibration.mountings[scanner].name);
    Some(format!(
        "The scanners {first} and {other} do not keep their distance: on spots that both saw in the same pass, \
         it changes along the drive by {}, {:.1} times as much as two rigid mountings explain. A mount has play, or \
         the frame bends.",
        number::length(gap.rms_m),
        gap.ratio
    ))
}

/// The gap of two steps, if it is not constant; mountings that follow noise leave a gap of their own.
pub fn moving_gap(calibration: &Calibration) -> Option<Gap> {
    let gap = calibration.gap.filter(|gap| !gap.constant);
    gap.filter(|_| calibration.method != Method::Joint && !calibration.is_noise())
}

/// Smaller correlations are chance; the time of a jump is chosen among many.
const CORRELATED: f64 = 0.3;
const JUMPED: f64 = 0.6;

/// The pattern of the residuals along the drive, and its likely cause.
fn pattern(calibration: &Calibration, constancy: &Constancy) -> String {
    let strongest = constancy.strongest.as_ref();
    let strongest = strongest.filter(|strongest| strongest.coefficient.abs() > CORRELATED);
    let other = strongest.map_or(0.0, |strongest| strongest.coefficient.abs());
    if let Some(jump) = constancy.jump
        && jump.correlation > JUMPED.max(other)
    {
        let name = &calibration.mountings[jump.scanner].name;
        return format!(
            " Those of scanner {name} jump by {} at {:.0} s (correlation {:.2}): was it touched then? Calibrate \
             the parts of the drive before and after on their own.",
            number::length(jump.step_m.abs()),
            jump.time_s,
            jump.correlation
        );
    }
    strongest.map_or(String::new(), |Correlation { with, coefficient }| {
        let likely = match with.as_str() {
            "time" => "a mounting creeps, or a sensor drifts",
            _ => "the frame bends under load, or a mount has play",
        };
        format!(" They follow {with} (correlation {coefficient:.2}): {likely}.")
    })
}

/// A note that the test of a constant mounting uses the residuals of two steps.
fn of_two_steps(calibration: &Calibration) -> &'static str {
    match calibration.method {
        Method::Joint => " after two steps",
        Method::TwoStep | Method::Paper => "",
    }
}
