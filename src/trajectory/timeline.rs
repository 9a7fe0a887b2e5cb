//! The logs, checked and laid out on the chain: nodes, steps, biases, and which fix hangs where.

use super::chain::ChainLayout;
use super::factors::{Ahead, HeadingFactor, PrismFactor};
use crate::error::{Error, Result};
use crate::geometry::heading::wrap;
use crate::project::TrajectorySettings;
use crate::sensor::{HeadingFix, ImuSample, PositionFix, Timed, check_overlap, span_s};

/// A longer gap between IMU samples is refused: one sample cannot stand for what happened in it.
const LONGEST_IMU_GAP_S: f64 = 1.0;
/// IMU intervals longer than this many times the median are worth a warning.
const NOTABLE_INTERVALS: f64 = 5.0;
/// Fewest prism fixes within the IMU's span: below, not even a smooth start can be made.
const FEWEST_PRISM_FIXES: usize = 5;
/// Longest time that one bias is held: where the prism is out, biases still walk.
const LONGEST_BIAS_S: f64 = 1.0;
/// Times closer than this are the same instant: the rounding of seconds since 1970 in f64.
const SAME_INSTANT_S: f64 = 1e-6;

/// The chain of one drive.
#[derive(Debug, Clone)]
pub(super) struct Timeline {
    /// Times of the nodes, seconds: every IMU sample and the end of the last.
    pub times_s: Vec<f64>,
    pub layout: ChainLayout,
    /// When each bias begins, seconds.
    pub bias_start_s: Vec<f64>,
    pub prism: Vec<PrismFactor>,
    /// Prism factors of step i: `prism[prism_start[i]..prism_start[i + 1]]`.
    pub prism_start: Vec<u32>,
    pub heading: Vec<HeadingFactor>,
    pub heading_start: Vec<u32>,
    /// Fixes outside the IMU's span.
    pub prism_ignored: usize,
    pub heading_ignored: usize,
    /// The longest IMU interval (when, how long, seconds) where it is unlike the median.
    pub imu_gap_s: Option<(f64, f64)>,
}

impl Timeline {
    pub fn steps(&self) -> usize {
        self.times_s.len() - 1
    }

    pub fn dt_s(&self, step: usize) -> f64 {
        self.times_s[step + 1] - self.times_s[step]
    }

    /// Checks the logs and lays them out.
    pub fn new(
        imu: &[ImuSample],
        prism: &[PositionFix],
        heading: &[HeadingFix],
        settings: &TrajectorySettings,
    ) -> Result<Self> {
        check_settings(settings)?;
        let imu_finite = |s: &ImuSample| all_finite(&s.gyro_rad_s) && all_finite(&s.accel_m_s2);
        check_stream("IMU log", imu, imu_finite)?;
        check_stream("prism log", prism, |f| {
            all_finite(&f.position_m) && f.covariance_m2.is_none_or(|c| is_sigma(Some(c[(0, 0)])))
        })?;
        check_stream("heading log", heading, |f| {
            f.heading_rad.is_finite() && is_sigma(f.sigma_rad)
        })?;
        let times_s = node_times(imu)?;
        let span = (times_s[0], times_s[times_s.len() - 1]);
        for (name, other) in [
            ("prism log", span_s(prism)),
            ("heading log", span_s(heading)),
        ] {
            if let Some(other) = other {
                check_overlap(("IMU log", span), (name, other))?;
            }
        }
        let (prism_used, heading_used) = (within(prism, span), within(heading, span));
        if prism_used.len() < FEWEST_PRISM_FIXES {
            return Err(Error::data(
                format!(
                    "only {} prism fixes lie within the IMU's span ({:.3} s to {:.3} s)",
                    prism_used.len(),
                    span.0,
                    span.1
                ),
                format!("a trajectory needs at least {FEWEST_PRISM_FIXES}; check the prism log"),
            ));
        }
        let ahead = |time_s: f64| {
            let step = step_at(&times_s, time_s);
            let ahead = Ahead {
                rest_s: time_s - times_s[step],
                sample: imu[step],
            };
            (step, ahead)
        };
        let mut prism_steps = Vec::with_capacity(prism_used.len());
        let mut prism_factors = Vec::with_capacity(prism_used.len());
        for fix in prism_used {
            let (step, ahead) = ahead(fix.time_s);
            prism_steps.push(step);
            prism_factors.push(PrismFactor {
                ahead,
                position_m: fix.position_m,
                sigma_m: fix
                    .covariance_m2
                    .map_or(settings.positions[0].sigma_m.x, |c| c[(0, 0)].sqrt()),
                lever_arm_m: settings.positions[0].lever_arm_m,
            });
        }
        let mut heading_steps = Vec::with_capacity(heading_used.len());
        let mut heading_factors = Vec::with_capacity(heading_used.len());
        let h = &settings.heading;
        for fix in heading_used {
            let (step, ahead) = ahead(fix.time_s);
            heading_steps.push(step);
            heading_factors.push(HeadingFactor {
                ahead,
                heading_rad: wrap(fix.heading_rad + h.mounting_offset_rad - h.grid_convergence_rad),
                sigma_rad: fix.sigma_rad.unwrap_or(h.sigma_rad),
            });
        }
        let (layout, bias_start_s) = biases(&times_s, &prism_steps, &prism_factors);
        let steps = times_s.len() - 1;
        Ok(Self {
            layout,
            bias_start_s,
            prism_start: starts(&prism_steps, steps),
            heading_start: starts(&heading_steps, steps),
            prism_ignored: prism.len() - prism_factors.len(),
            heading_ignored: heading.len() - heading_factors.len(),
            prism: prism_factors,
            heading: heading_factors,
            imu_gap_s: longest_gap(&times_s),
            times_s,
        })
    }

    pub fn prism_of(&self, step: usize) -> &[PrismFactor] {
        &self.prism[self.prism_start[step] as usize..self.prism_start[step + 1] as usize]
    }

    pub fn heading_of(&self, step: usize) -> &[HeadingFactor] {
        &self.heading[self.heading_start[step] as usize..self.heading_start[step + 1] as usize]
    }
}

fn all_finite(v: &crate::geometry::Vec3) -> bool {
    v.iter().all(|x| x.is_finite())
}

fn is_sigma(sigma: Option<f64>) -> bool {
    sigma.is_none_or(|s| s.is_finite() && s > 0.0)
}

fn check_settings(settings: &TrajectorySettings) -> Result<()> {
    let imu = &settings.imu;
    let positive = [
        ("gravity", settings.gravity_m_s2),
        ("gyro noise", imu.gyro_density),
        ("accelerometer noise", imu.accel_density),
        ("gyro bias walk", imu.gyro_bias_walk),
        ("accelerometer bias walk", imu.accel_bias_walk),
        ("prism sigma", settings.positions[0].sigma_m.x),
        ("heading sigma", settings.heading.sigma_rad),
    ];
    match positive.iter().find(|(_, x)| !(x.is_finite() && *x > 0.0)) {
        Some((name, x)) => Err(Error::data(
            format!("{name} is {x}"),
            "give a positive number",
        )),
        None => Ok(()),
    }
}

/// Strictly increasing finite times and valid values.
fn check_stream<T: Timed>(name: &str, stream: &[T], valid: impl Fn(&T) -> bool) -> Result<()> {
    if let Some(row) = stream.iter().position(|r| !r.time_s().is_finite()) {
        return Err(Error::data(
            format!("{name}: the time of record {} is not finite", row + 1),
            "remove the record",
        ));
    }
    if let Some(row) = stream.iter().position(|r| !valid(r)) {
        return Err(Error::data(
            format!(
                "{name}: record {} at {:.6} s holds a value that is not finite, or a standard \
                 deviation that is not positive",
                row + 1,
                stream[row].time_s()
            ),
            "remove the record or mend the value",
        ));
    }
    if let Some(row) = stream
        .windows(2)
        .position(|w| w[1].time_s() <= w[0].time_s())
    {
        let (a, b) = (stream[row].time_s(), stream[row + 1].time_s());
        return Err(Error::data(
            format!(
                "{name}: record {} at {b:.6} s follows one at {a:.6} s",
                row + 2
            ),
            "times must increase strictly; remove duplicated or backward records",
        ));
    }
    Ok(())
}

/// The IMU's times and the end of its last sample, which lasts the median interval.
fn node_times(imu: &[ImuSample]) -> Result<Vec<f64>> {
    if imu.len() < 2 {
        return Err(Error::data(
            format!("the IMU log holds {} samples", imu.len()),
            "a trajectory needs at least two",
        ));
    }
    let mut intervals: Vec<f64> = imu.windows(2).map(|w| w[1].time_s - w[0].time_s).collect();
    if let Some(row) = intervals.iter().position(|&dt| dt > LONGEST_IMU_GAP_S) {
        return Err(Error::data(
            format!(
                "the IMU log has a gap of {:.3} s from {:.3} s to {:.3} s",
                intervals[row],
                imu[row].time_s,
                imu[row + 1].time_s
            ),
            format!(
                "cut the drive there; gaps longer than {LONGEST_IMU_GAP_S} s cannot be bridged"
            ),
        ));
    }
    let middle = intervals.len() / 2;
    let (_, median, _) = intervals.select_nth_unstable_by(middle, f64::total_cmp);
    let mut times: Vec<f64> = imu.iter().map(|s| s.time_s).collect();
    times.push(imu[imu.len() - 1].time_s + *median);
    Ok(times)
}

/// The longest interval where it exceeds [`NOTABLE_INTERVALS`] times the last, which is the median.
fn longest_gap(times_s: &[f64]) -> Option<(f64, f64)> {
    let steps = times_s.len() - 1;
    let median = times_s[steps] - times_s[steps - 1];
    let intervals = times_s.windows(2).map(|w| (w[0], w[1] - w[0]));
    intervals
        .max_by(|a, b| a.1.total_cmp(&b.1))
        .filter(|gap| gap.1 > NOTABLE_INTERVALS * median)
}

fn within<T: Timed>(stream: &[T], (start, end): (f64, f64)) -> &[T] {
    let first = stream.partition_point(|r| r.time_s() < start);
    let last = stream.partition_point(|r| r.time_s() <= end);
    &stream[first..last]
}

/// The step whose interval holds `time_s`; the end of the last belongs to the last.
fn step_at(times_s: &[f64], time_s: f64) -> usize {
    (times_s.partition_point(|&t| t <= time_s) - 1).min(times_s.len() - 2)
}

fn starts(sorted_steps: &[usize], steps: usize) -> Vec<u32> {
    let mut starts = vec![0; steps + 1];
    for &step in sorted_steps {
        starts[step + 1] += 1;
    }
    for i in 0..steps {
        starts[i + 1] += starts[i];
    }
    starts
}

/// A new bias at the first node at or after each prism fix, and at least one a second.
fn biases(times_s: &[f64], steps: &[usize], prism: &[PrismFactor]) -> (ChainLayout, Vec<f64>) {
    let mut begins = vec![false; times_s.len()];
    for (&step, fix) in steps.iter().zip(prism) {
        begins[step + usize::from(fix.ahead.rest_s > SAME_INSTANT_S)] = true;
    }
    let mut bias_of_step = Vec::with_capacity(times_s.len() - 1);
    let mut start_s = vec![times_s[0]];
    for (&time, &begins) in times_s[..times_s.len() - 1].iter().zip(&begins) {
        let held = time - start_s[start_s.len() - 1];
        if held > 0.0 && (begins || held >= LONGEST_BIAS_S) {
            start_s.push(time);
        }
        bias_of_step.push((start_s.len() - 1) as u32);
    }
    (ChainLayout { bias_of_step }, start_s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vec3;

    fn fix(rest_s: f64) -> PrismFactor {
        PrismFactor {
            ahead: Ahead {
                rest_s,
                sample: ImuSample {
                    time_s: 0.0,
                    gyro_rad_s: Vec3::zeros(),
                    accel_m_s2: Vec3::zeros(),
                },
            },
            position_m: Vec3::zeros(),
            sigma_m: 0.005,
            lever_arm_m: Vec3::zeros(),
        }
    }

    #[test]
    fn biases_change_after_each_prism_fix_and_every_second() {
        let times: Vec<f64> = (0..=30).map(|i| f64::from(i) * 0.1).collect();
        // A fix on node 0 changes nothing, one on node 4 changes at node 4, one within step 6 at
        // node 7, one in the last step would change at the end, where no step is left.
        let fixes = [fix(0.0), fix(0.0), fix(0.05), fix(0.1)];
        let (layout, start_s) = biases(&times, &[0, 4, 6, 29], &fixes);
        let rounded: Vec<i32> = start_s.iter().map(|t| (t * 10.0).round() as i32).collect();
        assert_eq!(rounded, [0, 4, 7, 17, 27]);
        assert_eq!(layout.biases(), start_s.len());
        assert_eq!(layout.bias_of_step[3..5], [0, 1]);
        assert_eq!(layout.bias_of_step[6..8], [1, 2]);
    }

    #[test]
    fn a_fix_belongs_to_the_step_that_holds_it() {
        let times = [0.0, 0.1, 0.2, 0.3];
        let found = [0.0, 0.05, 0.1, 0.25, 0.3].map(|t| step_at(&times, t));
        assert_eq!(found, [0, 0, 1, 2, 2]);
        assert_eq!(starts(&[0, 0, 2], 3), [0, 2, 2, 3]);
    }

    #[test]
    fn only_an_unusual_interval_is_a_gap() {
        assert_eq!(longest_gap(&[0.0, 0.1, 0.25, 0.35]), None);
        assert_eq!(longest_gap(&[0.0, 0.1, 0.85, 0.95]), Some((0.1, 0.75)));
    }
}
