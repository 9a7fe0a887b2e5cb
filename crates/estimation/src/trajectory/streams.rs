//! The logs as recorded, prepared for the adjustment: values checked, records out of time order dropped
//! and listed, gaps of the IMU bridged.

use super::gaps::{check_interval, median_interval_s};
use super::imu_series::ImuSeries;
use super::logs::{ClockCorrection, MotionLogs, Stream};
use super::settings::TrajectorySettings;
use super::solution::{Rejection, RejectionReason};
use crate::error::{Error, Problem, Result};
use crate::geometry::{Mat3, Vec3, is_finite};
use crate::sensor::{
    HeadingFix, ImuSample, PositionFix, Timed, check_overlap, longest_increasing, time_unit_within,
};
use crate::statistics::median;

/// A position that is written so often in a row, to the last digit, was measured once at most: loggers repeat the last
/// fix, or write zeros, while lock is lost.
const MAX_SAME: usize = 4;

/// Fewest position fixes within the IMU's span: with fewer, there are not even start values.
pub const MIN_FIXES: usize = 5;

/// A record and its number in the log (from 0).
#[derive(Debug, Clone, Copy)]
pub struct Numbered<T> {
    pub record: usize,
    pub value: T,
}

/// The logs in time order.
#[derive(Debug, Clone)]
pub struct Streams {
    pub imu: ImuSeries,
    /// Within the IMU's span.
    pub positions: Vec<Vec<Numbered<PositionFix>>>,
    /// Within the IMU's span.
    pub heading: Vec<Numbered<HeadingFix>>,
    /// Records that are not used, in the order of the streams and of time.
    pub dropped: Vec<Rejection>,
}

impl Streams {
    /// Checks the logs, corrects their clocks and puts them in order.
    ///
    /// # Errors
    /// Values that are not finite, streams that do not overlap, too few positions, IMU gaps of
    /// minutes.
    pub fn new(
        logs: &MotionLogs<'_>,
        settings: &TrajectorySettings,
        corrections: &[ClockCorrection],
    ) -> Result<Self> {
        check_settings(logs, settings)?;
        let names = Names(settings);
        check_values("IMU log", logs.imu, |s| {
            is_finite(&s.gyro_rad_s) && is_finite(&s.accel_m_s2)
        })?;
        for (sensor, fixes) in logs.positions.iter().enumerate() {
            let name = names.log(Stream::Position(sensor));
            check_values(&name, fixes, is_valid_fix)?;
        }
        check_values("heading log", logs.heading, is_valid_heading)?;

        let mut dropped = Vec::new();
        let imu = ordered(logs.imu, Stream::Imu, &names, corrections, &mut dropped);
        let imu: Vec<ImuSample> = imu.into_iter().map(|s| s.value).collect();
        if imu.len() < 2 {
            return Err(Error::of(
                Problem::TooFew,
                format!("the IMU log holds {} samples", imu.len()),
                "a trajectory needs at least two",
            ));
        }
        let interval_s = median_interval_s(&imu);
        check_interval(interval_s)?;
        let imu = ImuSeries::new(imu, interval_s, &settings.imu)?;
        let span = imu.span_s();
        let mut positions = Vec::with_capacity(logs.positions.len());
        for (sensor, fixes) in logs.positions.iter().enumerate() {
            let stream = Stream::Position(sensor);
            let fixes = ordered(fixes, stream, &names, corrections, &mut dropped);
            let (fixes, repeated) = measured(fixes);
            let repeated = repeated.iter();
            dropped.extend(
                repeated.map(|fix| names.rejection(stream, fix, RejectionReason::Repeated)),
            );
            positions.push(within(fixes, span, stream, &names, &mut dropped)?);
        }
        let count: usize = positions.iter().map(Vec::len).sum();
        if count < MIN_FIXES {
            return Err(Error::of(
                Problem::TooFew,
                format!(
                    "only {count} {} fixes lie within the IMU's span ({:.3} s to {:.3} s)",
                    settings.positions[0].name, span.0, span.1
                ),
                format!("a trajectory needs at least {MIN_FIXES}; check the log"),
            ));
        }
        let heading = ordered(
            logs.heading,
            Stream::Heading,
            &names,
            corrections,
            &mut dropped,
        );
        let heading = within(heading, span, Stream::Heading, &names, &mut dropped)?;
        Ok(Self {
            imu,
            positions,
            heading,
            dropped,
        })
    }

    /// First and last time, seconds.
    pub fn span_s(&self) -> (f64, f64) {
        self.imu.span_s()
    }
}

/// The names of the streams.
pub struct Names<'a>(pub &'a TrajectorySettings);

impl Names<'_> {
    pub fn sensor(&self, stream: Stream) -> String {
        match stream {
            Stream::Imu => "imu".into(),
            Stream::Position(sensor) => self.0.positions[sensor].name.clone(),
            Stream::Heading => "heading".into(),
        }
    }

    /// A record of this stream that is not used.
    fn rejection<T: Timed>(
        &self,
        stream: Stream,
        record: &Numbered<T>,
        reason: RejectionReason,
    ) -> Rejection {
        Rejection {
            sensor: self.sensor(stream),
            record: record.record + 1,
            time_s: record.value.time_s(),
            reason,
            normalised: None,
        }
    }

    fn log(&self, stream: Stream) -> String {
        match stream {
            Stream::Imu => "IMU log".into(),
            Stream::Position(_) | Stream::Heading => format!("{} log", self.sensor(stream)),
        }
    }
}

fn is_sigma(sigma: Option<f64>) -> bool {
    sigma.is_none_or(|s| s.is_finite() && s > 0.0)
}

/// Whether a fix holds a finite position and, if any, a positive definite covariance.
pub fn is_valid_fix(fix: &PositionFix) -> bool {
    let covariance = |c: &Mat3| c.cholesky().is_some() && c.iter().all(|x| x.is_finite());
    is_finite(&fix.position_m) && fix.covariance_m2.as_ref().is_none_or(covariance)
}

/// Whether a heading holds finite angles and, if any, positive standard deviations.
pub fn is_valid_heading(fix: &HeadingFix) -> bool {
    fix.heading_rad.is_finite()
        && fix.pitch_rad.is_none_or(f64::is_finite)
        && is_sigma(fix.sigma_rad)
        && is_sigma(fix.pitch_sigma_rad)
}

pub fn check_settings(logs: &MotionLogs<'_>, settings: &TrajectorySettings) -> Result<()> {
    if logs.positions.is_empty() || logs.positions.len() != settings.positions.len() {
        return Err(Error::data(
            format!(
                "there are {} position logs, but settings for {}",
                logs.positions.len(),
                settings.positions.len()
            ),
            "give one log for each prism or antenna, and at least one",
        ));
    }
    let imu = &settings.imu;
    let mut positive = vec![
        ("gravity".to_owned(), settings.gravity_m_s2),
        ("gyro noise".into(), imu.gyro_density),
        ("accelerometer noise".into(), imu.accel_density),
        ("gyro bias walk".into(), imu.gyro_bias_walk),
        ("accelerometer bias walk".into(), imu.accel_bias_walk),
        ("heading sigma".into(), settings.heading.sigma_rad),
        ("pitch sigma".into(), settings.heading.pitch_sigma_rad),
    ];
    for sensor in &settings.positions {
        let sigma = format!("{} sigma", sensor.name);
        positive.extend(sensor.sigma_m.iter().map(|s| (sigma.clone(), *s)));
    }
    match positive.iter().find(|(_, x)| !(x.is_finite() && *x > 0.0)) {
        Some((name, x)) => Err(Error::data(
            format!("{name} is {x}"),
            "give a positive number",
        )),
        None => Ok(()),
    }
}

/// Checks that times are finite and values valid.
fn check_values<T: Timed>(name: &str, stream: &[T], valid: impl Fn(&T) -> bool) -> Result<()> {
    if let Some(row) = stream.iter().position(|r| !r.time_s().is_finite()) {
        return Err(Error::data(
            format!("{name}: the time of record {} is not finite", row + 1),
            "remove the record",
        ));
    }
    match stream.iter().position(|r| !valid(r)) {
        Some(row) => Err(Error::data(
            format!(
                "{name}: record {} at {:.6} s holds a value that is not finite, or a standard \
                 deviation that is not positive",
                row + 1,
                stream[row].time_s()
            ),
            "remove the record or correct the value",
        )),
        None => Ok(()),
    }
}

/// Leaves out the few records at either end that lie hours from all others, as one with the time 0 of a clock that was not
/// set yet: they are in order, but not of the drive. `kept` are the indices of records in time order.
fn without_wild_ends(kept: &mut Vec<usize>, times_s: &[f64]) {
    const FEW: usize = 3;
    const MANY: usize = 100 * FEW;
    const HOURS_S: f64 = 3600.0;
    if kept.len() < MANY {
        return;
    }
    let is_jump = |pair: &[usize]| times_s[pair[1]] - times_s[pair[0]] > HOURS_S;
    if let Some(at) = kept.windows(2).take(FEW).rposition(is_jump) {
        kept.drain(..=at);
    }
    let last = kept.len() - 1 - FEW;
    if let Some(at) = kept[last..].windows(2).position(is_jump) {
        kept.truncate(last + at + 1);
    }
}

/// The largest set of records whose times increase strictly, after the corrections of the clock; the
/// others are dropped and listed. One wild stamp costs one record, however far off it is.
fn ordered<T: Timed + Copy>(
    records: &[T],
    stream: Stream,
    names: &Names<'_>,
    corrections: &[ClockCorrection],
    dropped: &mut Vec<Rejection>,
) -> Vec<Numbered<T>> {
    let corrected: Vec<Numbered<T>> = records
        .iter()
        .enumerate()
        .map(|(record, value)| {
            let mut value = *value;
            let shift: f64 = corrections
                .iter()
                .filter(|c| c.stream == stream && c.record <= record)
                .map(|c| c.shift_s * c.course.share(value.time_s()))
                .sum();
            *value.time_s_mut() += shift;
            Numbered { record, value }
        })
        .collect();
    let times: Vec<f64> = corrected.iter().map(|r| r.value.time_s()).collect();
    let mut increasing = longest_increasing(&times);
    without_wild_ends(&mut increasing, &times);
    let mut next = increasing.iter().copied().peekable();
    for record in &corrected {
        if next.next_if_eq(&record.record).is_none() {
            dropped.push(names.rejection(stream, record, RejectionReason::TimeOrder));
        }
    }
    let kept = increasing.iter().map(|&record| corrected[record]);
    kept.collect()
}

/// The fixes that were measured, and those that repeat the one before, or zeros. Positions with few digits repeat too: all
/// count as measured unless most steps change all three coordinates.
fn measured(
    fixes: Vec<Numbered<PositionFix>>,
) -> (Vec<Numbered<PositionFix>>, Vec<Numbered<PositionFix>>) {
    let at = |fix: &Numbered<PositionFix>| fix.value.position_m;
    let steps = fixes.windows(2).map(|pair| at(&pair[1]) - at(&pair[0]));
    let steps: Vec<Vec3> = steps.filter(|step| *step != Vec3::zeros()).collect();
    let in_full = steps.iter().filter(|step| step.iter().all(|x| *x != 0.0));
    if 2 * in_full.count() < steps.len() {
        return (fixes, Vec::new());
    }
    let (mut kept, mut repeated) = (Vec::with_capacity(fixes.len()), Vec::new());
    for same in fixes.chunk_by(|a, b| at(a) == at(b)) {
        let measured = match same.len() {
            0..=MAX_SAME => same.len(),
            _ if at(&same[0]) == Vec3::zeros() => 0,
            _ => 1,
        };
        kept.extend_from_slice(&same[..measured]);
        repeated.extend_from_slice(&same[measured..]);
    }
    (kept, repeated)
}

/// Refuses times whose span is that of the IMU log times a power of 1000, in steps that no sensor of
/// a drive takes.
fn check_unit(
    name: &str,
    log_s: (f64, f64),
    steps_s: impl Iterator<Item = f64>,
    imu: (f64, f64),
) -> Result<()> {
    const LONGEST_USUAL_STEP_S: f64 = 20.0;
    const TOLERANCE_FACTOR: f64 = 4.0;
    let span_s = log_s.1 - log_s.0;
    // One wild stamp changes the span but not the median step.
    let step_s = median(steps_s).unwrap_or(0.0);
    let unit = time_unit_within(span_s / (imu.1 - imu.0), TOLERANCE_FACTOR);
    match unit.filter(|_| step_s > LONGEST_USUAL_STEP_S) {
        Some(unit) => Err(Error::data(
            format!("time steps of {step_s:.3} s in the {name}: are these {unit}?"),
            format!(
                "give its times in seconds: the IMU log spans {:.3} s, and this log {span_s:.3} s",
                imu.1 - imu.0
            ),
        )),
        None => Ok(()),
    }
}

/// The records inside the IMU's span; the others are dropped and listed.
fn within<T: Timed>(
    records: Vec<Numbered<T>>,
    span: (f64, f64),
    stream: Stream,
    names: &Names<'_>,
    dropped: &mut Vec<Rejection>,
) -> Result<Vec<Numbered<T>>> {
    let time_s = |r: &Numbered<T>| r.value.time_s();
    if let (Some(first), Some(last)) = (records.first(), records.last()) {
        let log_s = (time_s(first), time_s(last));
        check_overlap(("IMU log", span), (&names.log(stream), log_s))?;
        let steps = records
            .windows(2)
            .map(|pair| time_s(&pair[1]) - time_s(&pair[0]));
        check_unit(&names.log(stream), log_s, steps, span)?;
    }
    let (inside, outside): (Vec<_>, Vec<_>) = records
        .into_iter()
        .partition(|r| (span.0..=span.1).contains(&time_s(r)));
    let outside = outside.iter();
    dropped.extend(outside.map(|r| names.rejection(stream, r, RejectionReason::OutsideImu)));
    Ok(inside)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_few_records_hours_from_all_others_are_not_of_the_drive() {
        let right: Vec<f64> = (0..400).map(|i| 36_000.0 + 0.01 * f64::from(i)).collect();
        for (at, time_s) in [(0, 0.0), (1, 5.0), (399, 1.7e9)] {
            let mut times_s = right.clone();
            times_s[0] = if at == 1 { 0.0 } else { times_s[0] };
            times_s[at] = time_s;
            let mut kept: Vec<usize> = (0..400).collect();
            without_wild_ends(&mut kept, &times_s);
            let expected: Vec<usize> = match at {
                399 => (0..399).collect(),
                _ => (at + 1..400).collect(),
            };
            assert_eq!(kept, expected);
        }
        // A pause in the middle is none of these.
        let mut kept: Vec<usize> = (0..400).collect();
        let times_s: Vec<f64> = right
            .iter()
            .enumerate()
            .map(|(i, t)| t + if i < 200 { 0.0 } else { 9e3 })
            .collect();
        without_wild_ends(&mut kept, &times_s);
        assert_eq!(kept.len(), 400);
    }

    /// The records that are kept of a sensor at these positions.
    fn kept(positions_m: &[[f64; 3]]) -> Vec<usize> {
        let fix = |(record, position_m): (usize, &[f64; 3])| Numbered {
            record,
            value: PositionFix::with_sigma(record as f64, Vec3::from(*position_m), None),
        };
        let (kept, repeated) = measured(positions_m.iter().enumerate().map(fix).collect());
        assert_eq!(kept.len() + repeated.len(), positions_m.len());
        kept.iter().map(|fix| fix.record).collect()
    }

    #[test]
    fn positions_repeated_while_lock_is_lost_are_left_out() {
        let at = |i: usize| [0.1 * i as f64, 0.2 * i as f64, 1.0 - 0.01 * i as f64];
        let mut positions_m: Vec<[f64; 3]> = (1..20).map(at).collect();
        assert_eq!(kept(&positions_m).len(), 19);
        positions_m[5..12].fill(at(6));
        assert_eq!(
            kept(&positions_m),
            [0, 1, 2, 3, 4, 5, 12, 13, 14, 15, 16, 17, 18]
        );
        positions_m[5..12].fill([0.0; 3]);
        assert_eq!(
            kept(&positions_m),
            [0, 1, 2, 3, 4, 12, 13, 14, 15, 16, 17, 18]
        );
    }

    #[test]
    fn positions_with_few_digits_are_all_used() {
        // 2 mm between fixes, written in steps of 10 cm; the height does not change.
        let at = |i: usize| [0.1 * (i / 50) as f64, 0.1 * (i / 37) as f64, 1.0];
        let positions_m: Vec<[f64; 3]> = (0..500).map(at).collect();
        assert_eq!(kept(&positions_m).len(), 500);
    }
}
