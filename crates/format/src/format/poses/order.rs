//! Poses in time order.

use crate::error::{Error, Location, Result};
use crate::format::file::nothing_in;
use crate::format::input::Input;
use crate::sensor::{Continued, PoseRecord, longest_increasing};

/// The poses of a file in time order. Times that start again at midnight or at the end of the week are continued; poses
/// that repeat a time or are out of order are left out and counted.
///
/// # Errors
/// No poses; fewer than half of them in time order.
pub(crate) fn in_time_order(input: &Input, mut poses: Vec<PoseRecord>) -> Result<Vec<PoseRecord>> {
    if poses.is_empty() {
        return Err(nothing_in(input.path(), "pose"));
    }
    if let Some(text) = Continued::default().continue_times(&mut poses) {
        input.remark(text);
    }
    let times_s: Vec<f64> = poses.iter().map(|pose| pose.time_s).collect();
    let kept = longest_increasing(&times_s);
    let left_out = poses.len() - kept.len();
    if left_out == 0 {
        return Ok(poses);
    }
    if kept.len() < left_out {
        let later = times_s.windows(2).find(|pair| pair[1] <= pair[0]);
        let [before_s, after_s] = later.map_or([f64::NAN; 2], |pair| [pair[0], pair[1]]);
        return Err(Error::format(
            input.path(),
            Location::Whole,
            format!(
                "{left_out} of {} poses out of the order of time, such as {after_s} s after {before_s} s",
                poses.len()
            ),
            "times that increase",
        ));
    }
    let repeated = times_s.windows(2).filter(|pair| pair[0] == pair[1]);
    let repeated = repeated.count().min(left_out);
    let why = [
        (repeated, "with the time of the pose before"),
        (left_out - repeated, "out of the order of time"),
    ];
    let why = why.iter().filter(|(count, _)| *count > 0);
    let why: Vec<String> = why.map(|(count, why)| format!("{count} {why}")).collect();
    let all = poses.len();
    input.remark(format!(
        "{left_out} of {all} poses left out: {}",
        why.join(", ")
    ));
    Ok(kept.into_iter().map(|index| poses[index]).collect())
}
