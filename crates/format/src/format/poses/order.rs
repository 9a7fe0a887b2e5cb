//! Poses in time order.

use crate::error::{Error, Location, Result};
use crate::format::file::nothing_in;
use crate::format::input::Input;
use crate::sensor::{Continued, PoseRecord, longest_increasing};

/// What a line with a time before that of the line above should have; one that repeats it is left out.
const IN_ORDER: &str = "times that increase";

/// The times of poses as they are read. A few may be out of order, which [`in_time_order`] leaves out.
#[derive(Default)]
pub(super) struct Order {
    times: Continued,
    poses: usize,
    /// Poses with an earlier time than the one before, and what is said of the first if there are too many.
    late: usize,
    first_late: Option<Error>,
}

impl Order {
    /// Adds a time; `error` makes the error at its line from what was found and what was expected.
    pub(super) fn add(&mut self, time_s: f64, error: impl FnOnce(String, &'static str) -> Error) {
        self.poses += 1;
        if let Err(found) = self.times.in_order(time_s) {
            self.late += 1;
            self.first_late
                .get_or_insert_with(|| error(found, IN_ORDER));
        }
    }

    /// Ends the poses.
    ///
    /// # Errors
    /// As many of them out of the order of time as in it.
    pub(super) fn finish(self) -> Result<()> {
        let are_many = 2 * self.late >= self.poses;
        self.first_late.filter(|_| are_many).map_or(Ok(()), Err)
    }
}

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
            IN_ORDER,
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
