//! Verdicts on the reference: where it disagrees with the scans, its height, and which of its errors the standard
//! deviations include.

use crate::calibration::{Calibration, Method};
use crate::joint::{Joint, JointReport};
use crate::number;
use crate::results::Calibrations;
use crate::verdict::{Verdict, capitalised};

/// Verdicts on disagreements between scans and reference, with their places in world coordinates.
pub fn disagreements(calibrations: &Calibrations) -> Vec<Verdict> {
    let Some(joint) = calibrations.joint_found() else {
        return Vec::new();
    };
    let regions = joint.regions.iter().map(|region| {
        let text = capitalised(&region.describe(&calibrations.origin_m));
        Verdict::care("reference.region", text).with_value(region.offset_m, None)
    });
    let shift = joint.reference.and_then(|reference| reference.describe());
    let shift = shift.map(|text| Verdict::care("reference.shift", capitalised(&text)));
    regions.chain(shift).collect()
}

/// The verdict on a reference that is higher or lower than the drive implies.
pub fn height(joint: &Joint) -> Option<Verdict> {
    joint.reference_height().map(|height| {
        let text = format!(
            "The reference lies {:.1} mm {} where the drive puts it (± {:.1} mm, by the slopes of boards): \
             check the height of the total station, the lever arm of the prism, and the registration. All \
             of it is in tz.",
            1e3 * height.value.abs(),
            if height.value > 0.0 { "above" } else { "below" },
            1e3 * height.sigma
        );
        Verdict::fault("reference.height", text).with_value(height.value, Some(height.sigma))
    })
}

/// The verdict on a drive that fits together without the reference, and not with it.
pub fn misplaced() -> Verdict {
    Verdict::care(
        "reference.placement",
        "Without the reference the drive fits together, and no sensor contradicts it; with it, mountings would have to \
         move, or no adjustment holds: is the reference in the coordinates of the total station, and was nothing moved \
         since it was scanned?",
    )
}

/// The errors of the whole reference that the standard deviations include; `None` without any.
pub fn included(result: &Calibration, joint: Option<&JointReport>) -> Option<String> {
    let joint = joint?
        .accepted()
        .filter(|_| result.method == Method::Joint)?;
    let sigma = joint.reference.as_ref()?.prior;
    let assumed = if sigma.assumed {
        " (assumed: give reference.sigma_m and reference.sigma_deg)"
    } else {
        ""
    };
    (sigma.shift_m > 0.0 || sigma.tilt_rad > 0.0).then(|| {
        format!(
            "The standard deviations include a shift of the whole reference by ± {} and a tilt by \
             ± {}°{assumed}: a shift up goes one to one into the heights of the scanners.",
            number::length(sigma.shift_m),
            number::shortest(sigma.tilt_rad.to_degrees())
        )
    })
}
