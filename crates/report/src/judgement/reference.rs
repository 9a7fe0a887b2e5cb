//! Verdicts on the reference: where it disagrees with the scans, its height, and which of its errors the standard
//! deviations include.

use crate::calibration::{Calibration, Method};
use crate::geometry::Vec3;
use crate::joint::{Joint, JointReport, Region};
use crate::number;
use crate::results::Calibrations;
use crate::verdict::{Verdict, capitalised};

/// Up to this many regions on the same side are named one by one: boards that were moved. More have one cause.
const FEW_REGIONS: usize = 3;

/// Verdicts on disagreements between scans and reference, with their places in world coordinates.
pub fn disagreements(calibrations: &Calibrations) -> Vec<Verdict> {
    let Some(joint) = calibrations.joint_found() else {
        return Vec::new();
    };
    let (below, above): (Vec<&Region>, Vec<&Region>) =
        joint.regions.iter().partition(|r| r.offset_m < 0.0);
    let sides = [below, above].into_iter();
    let regions = sides.flat_map(|side| regions(&side, &calibrations.origin_m));
    let shift = joint.reference.and_then(|reference| reference.describe());
    let shift = shift.map(|text| Verdict::care("reference.shift", capitalised(&text)));
    regions.chain(shift).collect()
}

/// Verdicts on the regions in which the scans lie below the reference, or on those in which they lie above.
fn regions(side: &[&Region], origin_m: &Vec3) -> Vec<Verdict> {
    let worst = side
        .iter()
        .max_by(|a, b| a.offset_m.abs().total_cmp(&b.offset_m.abs()));
    if let Some(worst) = worst
        && side.len() > FEW_REGIONS
    {
        let place = worst.centre_m + origin_m;
        let (lie, cause) = if worst.offset_m < 0.0 {
            (
                "below",
                "did plants stand there when the reference was scanned, or has the ground settled since?",
            )
        } else {
            (
                "above",
                "have plants grown since the reference was scanned, or was something put there?",
            )
        };
        let text = format!(
            "In {} regions the scans lie {lie} the reference, far more than elsewhere, by up to {} around east {:.1} m, \
             north {:.1} m: {cause}",
            side.len(),
            number::length(worst.offset_m.abs()),
            place.x,
            place.y
        );
        return vec![Verdict::care("reference.region", text).with_value(worst.offset_m, None)];
    }
    let verdicts = side.iter().map(|region| {
        let text = capitalised(&region.describe(origin_m));
        Verdict::care("reference.region", text).with_value(region.offset_m, None)
    });
    verdicts.collect()
}

/// The verdict on a reference that is higher or lower than the drive implies.
pub fn height(joint: &Joint) -> Option<Verdict> {
    joint.reference_height().map(|height| {
        let text = format!(
            "The reference lies {:.1} mm {} where the drive puts it (± {:.1} mm, by the slopes of boards): \
             check the height of the total station, the lever arm of the prism, and the registration. \
             The whole error goes into tz.",
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moved_boards_are_named_one_by_one_and_plants_once() {
        let region = |i: usize| Region {
            centre_m: Vec3::new(i as f64, 0.0, 0.0),
            offset_m: -1e-3 * i as f64,
            surfels: 4,
        };
        let origin_m = Vec3::new(100.0, 0.0, 0.0);
        let said = |count: usize| -> Vec<String> {
            let found: Vec<Region> = (1..=count).map(region).collect();
            let verdicts = regions(&found.iter().collect::<Vec<_>>(), &origin_m);
            verdicts.into_iter().map(|verdict| verdict.text).collect()
        };
        assert_eq!(said(0).len(), 0);
        assert_eq!(said(3).len(), 3);
        assert!(
            said(3)[2].starts_with("Around east 103.0 m"),
            "{:?}",
            said(3)
        );
        let one = said(12);
        assert_eq!(one.len(), 1);
        for part in ["12 regions", "below", "12 mm around east 112.0 m", "plants"] {
            assert!(one[0].contains(part), "{part}: {}", one[0]);
        }
    }
}
