//! Verdicts on the mountings with which points are placed: where a calibration starts, and where the mountings of clouds
//! come from.

use std::path::Path;

use super::logs::{AXES, time_scales};
use crate::calibration::{Mounting, Reach};
use crate::number;
use crate::preflight::{Misplaced, Mistake, Placed, View};
use crate::results::FirstPlacement;
use crate::verdict::{Verdict, capitalised};

/// The verdicts on the first placement of the scans.
pub fn first(placement: &FirstPlacement) -> Vec<Verdict> {
    let mut verdicts = far_starts(&placement.project, &placement.start);
    verdicts.extend(misplaced(&placement.placed));
    verdicts.extend(placement.views.iter().map(view));
    verdicts
}

/// The verdicts on a first placement that is looked at by itself: if it contradicts nothing, one says so.
pub fn looked_at(placement: &FirstPlacement) -> Vec<Verdict> {
    let mut verdicts = first(placement);
    // A placement that contradicts nothing may also show nothing.
    if !verdicts.iter().any(|verdict| verdict.severity.is_marked()) {
        verdicts.push(consistent(placement.placed.apart_m()));
    }
    verdicts
}

/// The verdict on clouds that lie farther apart than rough mountings place them.
fn misplaced(placed: &Placed) -> Option<Verdict> {
    let (misplaced, apart_m) = (placed.misplaced.as_ref()?, placed.apart_m()?);
    let apart = format!("Placed with the project's mountings the clouds lie {apart_m:.2} m apart");
    Some(match misplaced {
        Misplaced::Mistake { mistake, left } => {
            let left_m = left.apart_m;
            let (code, what) = explanation(mistake);
            let text = format!("{apart}. Only {left_m:.2} m remain {what}");
            Verdict::fault(code, text).with_value(left_m, None)
        }
        Misplaced::OffReference { among_m } => {
            let text = format!(
                "{apart} from the reference, but only {among_m:.2} m from each other: is the reference in the \
                 coordinates of the total station, and are the clocks of scanners and trajectory the same?"
            );
            Verdict::care("reference.placement", text).with_value(apart_m, None)
        }
        Misplaced::Unexplained => {
            let text = format!(
                "{apart}: if the result is wrong, check translation, rotation and rotation_convention of the \
                 scanners, their files, their clocks, and where the reference lies."
            );
            Verdict::note("placement.misfit", text).with_value(apart_m, None)
        }
    })
}

/// The code of a mistake, and the mistake in words that follow "Only 0.02 m remain".
fn explanation(mistake: &Mistake) -> (&'static str, String) {
    match mistake {
        Mistake::InverseRotations { convention } => (
            "scanner.convention",
            format!(
                "with the inverse rotations: write rotation_convention = \"{}\", or invert the quaternions.",
                convention.name()
            ),
        ),
        Mistake::QuaternionsWxyz => (
            "scanner.convention",
            "with quaternions whose components are w, x, y, z: write them as x, y, z, w.".into(),
        ),
        Mistake::InverseRotation {
            scanner,
            convention,
        } => (
            "scanner.convention",
            format!(
                "with the inverse rotation of scanner `{scanner}`: write rotation_convention = \"{}\" there.",
                convention.name()
            ),
        ),
        Mistake::Swapped([first, second]) => (
            "scanner.swapped",
            format!(
                "with the profiles of `{first}` and `{second}` exchanged: the files, or the mountings, are those of the \
                 other scanner."
            ),
        ),
        Mistake::TranslationSign { scanner, axis } => (
            "scanner.translation",
            format!(
                "with the other sign of {} in the translation of scanner `{scanner}`.",
                AXES[*axis]
            ),
        ),
        Mistake::HalfTurn { scanner, axis } => (
            "scanner.rotation",
            format!(
                "with scanner `{scanner}` turned by 180° about its {} axis.",
                AXES[*axis]
            ),
        ),
        Mistake::HalfTurns { axis } => (
            "scanner.rotation",
            format!(
                "with all scanners turned by 180° about their {} axes.",
                AXES[*axis]
            ),
        ),
        Mistake::TranslationSigns { with_y } => (
            "scanner.translation",
            format!(
                "with the other sign of {} in all translations: are they given in FLU where the body is FRD, or the \
                 other way round?",
                if *with_y { "y and z" } else { "z" }
            ),
        ),
        Mistake::OtherAxes => (
            "scanner.axes",
            "with mountings whose y and z are negated: they are given in FLU and the body is FRD, or the other way \
             round."
                .into(),
        ),
        Mistake::ScannerTimes { scales, late_s } => (
            "scanner.time_offset",
            format!(
                "with {late_s:+.0} s added to the times of the scanners: {} differ by that. Write time_offset_s = \
                 {late_s:.1} for each scanner.",
                time_scales(*scales)
            ),
        ),
        Mistake::ReferenceHeight { above_m } => (
            "reference.height",
            format!(
                "with the reference {:.2} m {}: check the heights of the total station, the prism and its lever arm, of \
                 the reference, and z of the scanners.",
                above_m.abs(),
                if *above_m > 0.0 { "higher" } else { "lower" }
            ),
        ),
    }
}

/// The verdict on what a scanner sees.
fn view(view: &View) -> Verdict {
    match view {
        View::Upward { scanner, share } => {
            let text = format!(
                "As it is mounted, scanner `{scanner}` looks upwards: {:.0} % of its points lie higher than the scanner \
                 itself. Check rotation, rotation_convention and frame.body.",
                100.0 * share
            );
            Verdict::care("scanner.upward", text).with_value(*share, None)
        }
        View::Robot { scanner, share } => {
            let text = format!(
                "{:.0} % of the points of scanner `{scanner}` have the same range all along the drive, unlike those on \
                 the ground: it sees the robot. Leave these points out of the profiles.",
                100.0 * share
            );
            Verdict::care("scanner.robot", text).with_value(*share, None)
        }
    }
}

/// The verdicts on start values that are far from the mountings of the project.
fn far_starts(project: &[Mounting], start: &[Mounting]) -> Vec<Verdict> {
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
fn consistent(apart_m: Option<f64>) -> Verdict {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::EulerConvention;
    use crate::preflight::{Misfit, TimeScales};

    /// The verdict on clouds that a mistake places 0.8 m apart.
    fn on(mistake: Mistake) -> Verdict {
        let misfit = |apart_m| Misfit {
            apart_m,
            columns: 100,
        };
        let left = misfit(0.02);
        let placed = Placed {
            misfit: Some(misfit(0.8)),
            misplaced: Some(Misplaced::Mistake { mistake, left }),
        };
        misplaced(&placed).expect("clouds that lie apart")
    }

    #[test]
    fn a_mistake_is_named_with_its_remedy() {
        let scales = TimeScales::GpsUtc;
        for (mistake, code, remedy) in [
            (
                Mistake::ScannerTimes {
                    scales,
                    late_s: -18.0,
                },
                "scanner.time_offset",
                "with -18 s added to the times of the scanners: GPS and UTC differ by that. Write time_offset_s = -18.0 \
                 for each scanner.",
            ),
            (
                Mistake::ReferenceHeight { above_m: -0.5 },
                "reference.height",
                "with the reference 0.50 m lower: check the heights of the total station, the prism and its lever arm, of \
                 the reference, and z of the scanners.",
            ),
            (
                Mistake::InverseRotation {
                    scanner: "left".into(),
                    convention: EulerConvention::Bonn,
                },
                "scanner.convention",
                "with the inverse rotation of scanner `left`: write rotation_convention = \"bonn\" there.",
            ),
        ] {
            let verdict = on(mistake);
            let apart = "Placed with the project's mountings the clouds lie 0.80 m apart. Only 0.02 m remain ";
            assert_eq!(verdict.code, code);
            assert_eq!(verdict.text, format!("{apart}{remedy}"));
            assert_eq!(verdict.value, Some(0.02));
        }
    }

    #[test]
    fn a_placement_that_contradicts_nothing_is_said_to_be_consistent_or_unseen() {
        let codes = |placed: Placed| {
            let verdicts = looked_at(&FirstPlacement {
                placed,
                ..FirstPlacement::default()
            });
            verdicts.into_iter().map(|v| v.code).collect::<Vec<_>>()
        };
        let misfit = Some(Misfit {
            apart_m: 0.05,
            columns: 100,
        });
        assert_eq!(codes(Placed::default()), ["placement.unseen"]);
        let near = Placed {
            misfit,
            misplaced: None,
        };
        assert_eq!(codes(near), ["placement.consistent"]);
    }
}
