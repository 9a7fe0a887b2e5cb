//! Verdicts on the mountings with which points are placed: where a calibration starts, and where the mountings of clouds
//! come from.

use std::path::Path;

use crate::calibration::{Mounting, Reach};
use crate::number;
use crate::verdict::{Verdict, capitalised};

/// The verdicts on start values that are far from the mountings of the project.
pub fn far_starts(project: &[Mounting], start: &[Mounting]) -> Vec<Verdict> {
    let moved = project.iter().zip(start).map(|(mounting, start)| {
        let (project, start) = (&mounting.body_from_scanner, &start.body_from_scanner);
        (&mounting.name, start.perturbation_from(project))
    });
    let far = moved.filter(|(_, moved)| Reach::ROUGH.is_exceeded(moved));
    let verdicts = far.map(|(name, (turn, shift))| {
        let (turn, shift) = (turn.norm(), shift.norm());
        let text = format!(
            "The calibration starts with scanner {name} {:.1}° and {shift:.2} m from the project's mounting, as the \
             clouds then take up much less space: is that as wrong?",
            turn.to_degrees()
        );
        Verdict::care("mounting.start", text).with_value(turn, None)
    });
    verdicts.collect()
}

/// The verdict on clouds that contradict nothing in their first placement and lie this far apart, metres; `None` if too
/// little is seen twice.
pub fn first(apart_m: Option<f64>) -> Verdict {
    match apart_m {
        Some(apart_m) => {
            let text = format!(
                "Placed with the project's mountings, scans of the same ground lie {} apart, as near as rough mountings \
                 place them.",
                number::length(apart_m)
            );
            Verdict::good("placement.consistent", text).with_value(apart_m, None)
        }
        None => Verdict::care(
            "placement.unseen",
            "Too little ground is seen twice to tell whether files, mountings and clocks belong together.",
        ),
    }
}

/// The code of verdicts on the mountings of clouds.
const MOUNTING: &str = "georeference.mounting";

/// The verdict on clouds that are placed as they should be, from a description of how.
pub fn placed(description: &str) -> Verdict {
    Verdict::good(MOUNTING, capitalised(description) + ".")
}

/// The verdict on clouds that are placed with the mountings of a project although there is a newer calibration.
pub fn newer_calibration(project: &Path, calibration: &Path) -> Verdict {
    let text = format!(
        "Placed with the mountings of {}, though {} is newer: give it with --calibration.",
        project.display(),
        calibration.display()
    );
    Verdict::care(MOUNTING, text)
}

/// The verdict on clouds that are placed with the mountings of a calibration that is marked as not usable.
pub fn unusable_calibration(calibration: &Path) -> Verdict {
    let name = calibration.file_name().unwrap_or_default();
    let text = format!(
        "Placed with the mountings of {}, which is marked as not usable: see what it says at its top.",
        name.to_string_lossy()
    );
    Verdict::fault(MOUNTING, text)
}
