//! Whether the mounting of a joint adjustment suits the poses as they were given.
//!
//! With poses from a file, the adjustment corrects the poses of one drive, while the mounting is used with those of
//! others, which nobody corrects. Two steps fit the mounting to the given poses.

use nalgebra::{DMatrix, DVector};

use super::placed::on_given_poses;
use crate::calibration::{Calibration, ScannerSample, change};
use crate::comparison::PassCells;
use crate::geometry::BodyFromScanner;
use crate::joint::Joint;
use crate::number;
use crate::statistics::chi_square_bounds_95;

/// The reason to prefer the mounting of two steps: passes lie closer together with it on the poses of the samples,
/// and the adjustment does not contradict it. `None` if the adjustment is as good or knows better. Passes are compared
/// in cells with this edge, metres.
pub fn reason_for_two_steps(
    samples: &[ScannerSample],
    cell_m: f64,
    two_steps: &Calibration,
    joint: &Joint,
) -> Option<String> {
    if contradicts(joint, two_steps) {
        return None;
    }
    let placed = |mountings: &[BodyFromScanner]| on_given_poses(samples, mountings);
    let [by_two_steps, by_joint] = [placed(&two_steps.poses()), placed(&joint.poses())];
    let cells = PassCells::new(&by_two_steps, cell_m);
    let (of_two_steps, of_joint) = (cells.distances(&by_two_steps)?, cells.distances(&by_joint)?);
    of_joint.is_worse_than(&of_two_steps)?.then(|| {
        format!(
            "on the poses as they were given, passes lie {} apart with it (root mean square) and {} with two steps, \
             from which it does not differ beyond its own standard deviations",
            number::length(of_joint.rms_m),
            number::length(of_two_steps.rms_m),
        )
    })
}

/// Whether the mountings of two steps lie farther from those of the adjustment than its covariance C explains: dᵀ C⁻¹ d
/// above the 97.5 % quantile of χ². Parameters that are fixed are the same in both.
fn contradicts(joint: &Joint, two_steps: &Calibration) -> bool {
    let differences = change(&joint.mountings, &two_steps.mountings);
    let free: Vec<usize> = (0..differences.len())
        .filter(|&row| !joint.mountings[row / 6].fixed[row % 6])
        .collect();
    let d = DVector::from_fn(free.len(), |i, _| differences[free[i]]);
    let covariance = DMatrix::from_fn(free.len(), free.len(), |i, j| {
        joint.covariance[(free[i], free[j])]
    });
    let Some(factor) = covariance.cholesky() else {
        return true;
    };
    let [_, most] = chi_square_bounds_95(free.len() as f64);
    d.dot(&factor.solve(&d)) > most
}
