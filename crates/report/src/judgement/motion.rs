//! Verdicts on mountings that move, and on points, which are known better than such mountings.

use crate::calibration::PARAMETER_NAMES;
use crate::geometry::{Bending, Vec3};
use crate::joint::{AdjustedDrive, Joint, MovedMounting, known_m};
use crate::number;
use crate::statistics;
use crate::verdict::Verdict;

/// A parameter is named if more than this share of its variance rests on the prior of the motion.
const NOTABLE_SHARE: f64 = 0.25;

/// Drives disagree about a mounting if its means over two of them differ by more than this many times what it moves within
/// either, and than their standard deviations: the three sigmas of the other tests of mountings.
const DISAGREEING: f64 = 3.0;

/// Verdicts on the motion of mountings, on their jumps, on drives that disagree, and on the precision of points.
pub fn verdicts(joint: &Joint) -> Vec<Verdict> {
    let mut all = Vec::new();
    all.extend(moving(joint));
    all.extend(jumps(joint));
    all.extend(disagreeing(joint));
    all.extend(points(joint));
    all.extend(joint.drives.iter().filter_map(pose_errors));
    all
}

/// The verdict on the errors of poses from a file: their size and duration as the scans show them.
fn pose_errors(drive: &AdjustedDrive) -> Option<Verdict> {
    /// Names of the axes, in the order of the components.
    const AXES: [&str; 6] = ["about x", "about y", "about z", "east", "north", "up"];
    let errors = drive.pose_errors.as_ref()?;
    let size = |sigma: f64, component: usize| {
        if component < 3 {
            format!("{:.3}°", sigma.to_degrees())
        } else {
            number::length(sigma)
        }
    };
    let (mut found, mut open) = (Vec::new(), Vec::new());
    for (i, axis) in AXES.iter().enumerate() {
        if errors.is_determined[i] {
            found.push(format!(
                "{axis} {} over {:.1} s (stated: {})",
                size(errors.sigma[i], i),
                errors.correlation_s[i],
                size(errors.stated_sigma[i], i),
            ));
        } else {
            open.push(format!("{axis} {}", size(errors.stated_sigma[i], i)));
        }
    }
    let mut text = String::from("Errors of the poses");
    if !found.is_empty() {
        text += &format!(", as the scans show them: {}", found.join(", "));
    }
    if open.is_empty() {
        return Some(Verdict::note("poses.errors", text + "."));
    }
    let assumed_s = (0..6).find(|i| !errors.is_determined[*i]);
    text += &format!(
        "{} {}, each over {:.0} s, as stated and assumed, because the scans do not show them: the standard deviations of \
         the mounting are no better than these.",
        if found.is_empty() {
            " are taken to be"
        } else {
            "; the others are taken to be"
        },
        open.join(", "),
        assumed_s.map_or(f64::NAN, |i| errors.correlation_s[i]),
    );
    // Without any, all that is known of the poses is what somebody wrote.
    Some(if found.is_empty() {
        Verdict::care("poses.errors", text)
    } else {
        Verdict::note("poses.errors", text)
    })
}

/// The verdict that the mountings move, by how much, and which parameters rest on the prior.
fn moving(joint: &Joint) -> Option<Verdict> {
    let [shift_m, turn_rad] = joint.motion()?;
    let reason = joint.ladder.last().and_then(|left| left.reasons.first());
    let reason = reason.map_or(String::new(), |reason| format!(": {reason}"));
    let text = format!(
        "The mountings move along the drive, by {} and {:.3}° about each axis (root mean square){reason}. They are \
         modelled as {}; mounting.csv has them by time. Points are better known than single parameters: a motion \
         along the track and one in pitch look alike.{}",
        number::length(shift_m),
        turn_rad.to_degrees(),
        joint.rung.name(),
        assumed(joint),
    );
    Some(Verdict::care("mounting.moves", text).with_value(shift_m, None))
}

/// The parameters that rest on the prior of the motion, with the share of their variance.
fn assumed(joint: &Joint) -> String {
    let scanners = joint.mountings.iter().zip(joint.prior_shares.chunks(6));
    let named = scanners.flat_map(|(mounting, shares)| {
        let parameters = PARAMETER_NAMES.iter().zip(shares);
        let notable = parameters.filter(|(_, share)| **share > NOTABLE_SHARE);
        notable.map(|(name, share)| format!("{name} of {} ({:.0} %)", mounting.name, 1e2 * share))
    });
    let named: Vec<String> = named.collect();
    if named.is_empty() {
        String::new()
    } else {
        format!(
            " What is assumed of the motion makes a good part of the variance of {}.",
            named.join(", ")
        )
    }
}

/// The lengths of both parts of a step (δφ, δp), radians and metres.
fn lengths(step: &[f64; 6]) -> [f64; 2] {
    [&step[..3], &step[3..]].map(|part| Vec3::from_column_slice(part).norm())
}

/// A verdict for each jump of the mountings.
fn jumps(joint: &Joint) -> Vec<Verdict> {
    let drives = joint.drives.iter();
    let jumps = drives.flat_map(|drive| drive.jumps.iter().map(move |jump| (drive, jump)));
    let verdicts = jumps.map(|(drive, jump)| {
        let [turn_rad, shift_m] = lengths(&jump.step);
        let [from_s, to_s] = jump.between_s;
        let of_drive = match joint.drives.len() {
            1 => String::new(),
            _ => format!(" of drive {}", drive.name),
        };
        let text = format!(
            "Scanner {} moved all at once, between {from_s:.1} s and {to_s:.1} s{of_drive}, by {} and {:.3}°: was it \
             touched? Its mounting is the one before; mounting.csv has both.",
            joint.mountings[jump.scanner].name,
            number::length(shift_m),
            turn_rad.to_degrees(),
        );
        Verdict::care("mounting.jump", text).with_value(shift_m, None)
    });
    verdicts.collect()
}

/// The motion of a mounting during a drive, (δφ, δp).
struct Stay {
    mean: [f64; 6],
    /// Root mean squares about the mean, and standard deviations.
    spread: [f64; 6],
}

impl Stay {
    fn of(moved: &MovedMounting) -> Self {
        let column = |bending: &Bending, i: usize| -> Vec<f64> {
            bending.samples().map(|(_, offset)| offset[i]).collect()
        };
        let mean = std::array::from_fn(|i| statistics::mean(&column(&moved.offsets, i)));
        let spread = std::array::from_fn(|i| {
            let offsets = column(&moved.offsets, i).into_iter();
            let within = statistics::rms(offsets.map(|offset| offset - mean[i]));
            within.max(statistics::rms(column(&moved.sigmas, i)))
        });
        Self { mean, spread }
    }

    /// The step to the mounting of another drive, if it is far larger than the motion within both.
    fn step_to(&self, later: &Self) -> Option<[f64; 6]> {
        let step: [f64; 6] = std::array::from_fn(|i| later.mean[i] - self.mean[i]);
        let is_large = |i: usize| step[i].abs() > DISAGREEING * self.spread[i].max(later.spread[i]);
        (0..6).any(is_large).then_some(step)
    }
}

/// A verdict for each scanner that is mounted differently in two drives and hardly moves within them.
fn disagreeing(joint: &Joint) -> Vec<Verdict> {
    let mut verdicts = Vec::new();
    for (scanner, mounting) in joint.mountings.iter().enumerate() {
        let drives = joint.drives.iter();
        let stays = drives.filter_map(|d| Some((&d.name, Stay::of(d.bending.get(scanner)?))));
        let stays: Vec<(&String, Stay)> = stays.collect();
        for ((before, first), (after, second)) in stays.iter().zip(stays.iter().skip(1)) {
            let Some(step) = first.step_to(second) else {
                continue;
            };
            let [turn_rad, shift_m] = lengths(&step);
            let text = format!(
                "The drives disagree about {}: from {before} to {after} its mounting differs by {} and {:.3}°, far more \
                 than it moves within them. Was it touched between them? Calibrate these drives apart.",
                mounting.name,
                number::length(shift_m),
                turn_rad.to_degrees(),
            );
            verdicts.push(Verdict::care("mounting.drives", text).with_value(shift_m, None));
        }
    }
    verdicts
}

/// The verdict on the precision of points, by the worst scanner.
fn points(joint: &Joint) -> Option<Verdict> {
    let scanners = joint.drives.iter().flat_map(|drive| &drive.points);
    let sigmas = scanners.filter_map(|points| known_m(points));
    let worst = sigmas.reduce(|a, b| a.sup(&b))?;
    let text = format!(
        "Points are known to {} east, {} north and {} up (one standard deviation, the scanners' noise aside).",
        number::length(worst.x),
        number::length(worst.y),
        number::length(worst.z),
    );
    Some(Verdict::note("points.sigma", text).with_value(worst.norm(), None))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mounting that swings by this much about a mean along x, and whose offsets are known to 0.3 mm.
    fn stay(mean_m: f64, swing_m: f64) -> Stay {
        let sampled = |offset: &dyn Fn(f64) -> f64| {
            Bending::sampled((0.0, 60.0), 0.1, |time_s| {
                [0.0, 0.0, 0.0, offset(time_s), 0.0, 0.0]
            })
        };
        Stay::of(&MovedMounting {
            offsets: sampled(&|time_s| mean_m + swing_m * time_s.sin()),
            sigmas: sampled(&|_| 3e-4),
        })
    }

    #[test]
    fn a_scanner_touched_between_drives_is_told_from_one_that_swings_in_both() {
        let step = stay(-0.002, 0.0).step_to(&stay(0.002, 1e-4)).unwrap();
        assert!((step[3] - 0.004).abs() < 1e-5);
        assert_eq!(stay(-0.002, 0.004).step_to(&stay(0.002, 0.004)), None);
        assert_eq!(stay(0.0, 0.0).step_to(&stay(5e-4, 0.0)), None);
    }
}
