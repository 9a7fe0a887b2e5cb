//! Do the streams overlap in time?

use crate::error::Result;
use crate::sensor::{Timed, check_overlap};
use crate::trajectory::gaps::MAX_IMU_GAP_S;
use crate::trajectory::streams::MIN_FIXES;

/// Counts in `apart` how many of the newest records in a row were far from the IMU's newest sample when
/// they arrived. `imu_s` are the IMU's first and newest time.
///
/// # Errors
/// There are as many as a start needs, all outside the IMU's span: waiting longer would not help.
pub fn check_overlap_so_far<T: Timed>(
    apart: &mut usize,
    imu_s: (f64, f64),
    name: &str,
    records: &[T],
) -> Result<()> {
    let newest_s = records.last().map_or(imu_s.1, T::time_s);
    if (newest_s - imu_s.1).abs() <= MAX_IMU_GAP_S {
        *apart = 0;
        return Ok(());
    }
    *apart += 1;
    if *apart < MIN_FIXES {
        return Ok(());
    }
    let last = records.iter().rev().take(MIN_FIXES).map(T::time_s);
    let records_s = last.fold((f64::INFINITY, f64::NEG_INFINITY), |(from, to), time_s| {
        (from.min(time_s), to.max(time_s))
    });
    check_overlap(("IMU log", imu_s), (name, records_s))
}
