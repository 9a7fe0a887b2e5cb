//! Verdicts on mountings that move, and on points, which are known better than such mountings.

use crate::calibration::PARAMETER_NAMES;
use crate::geometry::Vec3;
use crate::joint::{Joint, known_m};
use crate::number;
use crate::verdict::Verdict;

/// A parameter is named if more than this share of its variance rests on the prior of the motion.
const NOTABLE_SHARE: f64 = 0.25;

/// Verdicts on the motion of mountings, on their jumps, and on the precision of points.
pub fn verdicts(joint: &Joint) -> Vec<Verdict> {
    let mut all = Vec::new();
    all.extend(moving(joint));
    all.extend(jumps(joint));
    all.extend(points(joint));
    all
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

/// A verdict for each jump of the mountings.
fn jumps(joint: &Joint) -> Vec<Verdict> {
    let drives = joint.drives.iter();
    let jumps = drives.flat_map(|drive| drive.jumps.iter().map(move |jump| (drive, jump)));
    let verdicts = jumps.map(|(drive, jump)| {
        let [turn, shift] = [&jump.step[..3], &jump.step[3..]].map(Vec3::from_column_slice);
        let [from_s, to_s] = jump.between_s;
        let of_drive = match joint.drives.len() {
            1 => String::new(),
            _ => format!(" of drive {}", drive.name),
        };
        let text = format!(
            "Scanner {} moved all at once, between {from_s:.1} s and {to_s:.1} s{of_drive}, by {} and {:.3}°: was it \
             touched? Its mounting is the one before; mounting.csv has both.",
            joint.mountings[jump.scanner].name,
            number::length(shift.norm()),
            turn.norm().to_degrees(),
        );
        Verdict::care("mounting.jump", text).with_value(shift.norm(), None)
    });
    verdicts.collect()
}

/// The verdict on the precision of points, by the worst scanner.
fn points(joint: &Joint) -> Option<Verdict> {
    let scanners = joint.drives.iter().flat_map(|drive| &drive.points);
    let sigmas = scanners.filter_map(|points| known_m(points));
    let worst = sigmas.reduce(|a, b| a.sup(&b))?;
    let text = format!(
        "Points are known to {} east, {} north and {} up (one standard deviation, the scanners' noise aside{}).",
        number::length(worst.x),
        number::length(worst.y),
        number::length(worst.z),
        if joint.held.is_empty() {
            ""
        } else {
            ", and what nothing determines of the mountings"
        },
    );
    Some(Verdict::note("points.sigma", text).with_value(worst.norm(), None))
}
