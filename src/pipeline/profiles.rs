//! The profile files of a scanner, opened for a trajectory.

use super::open_project::OpenProject;
use crate::error::Result;
use crate::format::{self, CloudClock, Input, ProfileReader};
use crate::progress::Progress;
use crate::project::Scanner;
use crate::sensor::{ScanPoint, start_between_s};
use crate::trajectory::Trajectory;

/// The profile files of a scanner of the project, for one reading.
pub fn profile_inputs(project: &OpenProject, scanner: &Scanner) -> Vec<Input> {
    let inputs = scanner.profiles.iter().map(|path| project.input(path));
    inputs
        .map(|input| input.with_point_times(scanner.point_times.clone()))
        .collect()
}

/// The profile files of all scanners of the project, for one reading.
pub fn all_profile_inputs(project: &OpenProject) -> Vec<Vec<Input>> {
    let scanners = project.scanners.iter();
    scanners
        .map(|scanner| profile_inputs(project, scanner))
        .collect()
}

/// Opens the profile files of a scanner. If their clock started again, at midnight or at the end of the week, before they
/// or the trajectory began, their times are shifted to those of the trajectory. LAS with adjusted standard GPS time is on
/// the clock of the trajectory.
///
/// # Errors
/// A file cannot be opened.
pub fn open_profiles(
    scanner: &Scanner,
    inputs: &[Input],
    trajectory: &Trajectory,
) -> Result<Vec<Box<dyn ProfileReader>>> {
    let (first_s, last_s) = trajectory.span_s();
    let clock = CloudClock::of_span(first_s, last_s);
    let open = |input: &Input| -> Result<Box<dyn ProfileReader>> {
        Ok(Box::new(Started {
            profiles: format::open_profiles_on(input, clock)?,
            input: input.clone(),
            span_s: [first_s, last_s].map(|time_s| time_s - scanner.time_offset_s),
            shift_s: None,
        }))
    };
    inputs.iter().map(open).collect()
}

/// Warns of what the readers of a scanner's files left out or assumed.
pub fn warn_of_remarks(name: &str, inputs: &[Input], progress: &dyn Progress) {
    for input in inputs {
        for remark in input.remarks() {
            progress.warn(&format!("{name}: {remark}"));
        }
    }
}

/// Profiles with times on the same side of the start of a day or week as the trajectory.
struct Started {
    profiles: Box<dyn ProfileReader>,
    input: Input,
    /// Of the trajectory, on the scanner's clock, seconds.
    span_s: [f64; 2],
    /// What is added to the times, once the first points are known, seconds.
    shift_s: Option<f64>,
}

impl ProfileReader for Started {
    fn next_chunk(&mut self, into: &mut Vec<ScanPoint>) -> Result<bool> {
        let is_more = self.profiles.next_chunk(into)?;
        let (Some(first), Some(last)) = (into.first(), into.last()) else {
            return Ok(is_more);
        };
        let (input, span_s) = (&self.input, self.span_s);
        let shift_s = *self.shift_s.get_or_insert_with(|| {
            let shift_s = start_between_s([first.time_s, last.time_s], span_s);
            if shift_s != 0.0 {
                input.remark(format!(
                    "the profiles and the trajectory lie on both sides of the start of a day or week: {shift_s} s are added \
                     to the times"
                ));
            }
            shift_s
        });
        into.iter_mut().for_each(|point| point.time_s += shift_s);
        Ok(is_more)
    }

    fn bytes_read(&self) -> u64 {
        self.profiles.bytes_read()
    }

    fn bytes_total(&self) -> u64 {
        self.profiles.bytes_total()
    }
}
