//! The clock of the device, and UTC.

use std::path::Path;

use crate::error::{Error, Location, Result};

/// No clock runs for 71 years; the limit keeps sums of times within their type for any stamps.
const LONGEST_US: i64 = 1 << 51;

/// The clock of the device with roll-overs undone.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct DeviceClock {
    last_us: Option<i64>,
}

impl DeviceClock {
    /// The time of a stamp, microseconds since the device was switched on (or since a roll-over, if the
    /// log begins more than 71.6 minutes after that). Stamps have 32 bits; each is assumed to be less
    /// than 35.8 minutes before or after the last one.
    pub(crate) fn unwrapped_us(&mut self, stamp_us: u32) -> i64 {
        let now = self.last_us.map_or(i64::from(stamp_us), |last| {
            // The low 32 bits of the last time are its stamp.
            last + i64::from(stamp_us.wrapping_sub(last as u32) as i32)
        });
        let now = now.clamp(-LONGEST_US, LONGEST_US);
        self.last_us = Some(now);
        now
    }

    /// The last time, microseconds.
    pub(crate) fn last_us(&self) -> Option<i64> {
        self.last_us
    }
}

/// Nanoseconds of the Unix epoch at a date and time (UTC); `None` if there is no such date or time.
/// The second may be 60, a leap second, which has the same time as the second after it.
pub(crate) fn unix_ns(date: [i64; 3], time: [i64; 3], nanosecond: i64) -> Option<i64> {
    let ([year, month, day], [hour, minute, second]) = (date, time);
    let is_leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    // Days before each month of a year that is not a leap year, and of the year.
    const BEFORE: [i64; 13] = [0, 31, 59, 90, 120, 151, 181, 212, 243, 273, 304, 334, 365];
    let month_index = usize::try_from(month).ok()?.checked_sub(1)?;
    let (before, next) = (*BEFORE.get(month_index)?, *BEFORE.get(month_index + 1)?);
    let days = next - before + i64::from(is_leap && month == 2);
    let is_valid = (1970..2100).contains(&year)
        && (1..=days).contains(&day)
        && (0..24).contains(&hour)
        && (0..60).contains(&minute)
        && (0..=60).contains(&second)
        && (0..1_000_000_000).contains(&nanosecond);
    if !is_valid {
        return None;
    }
    let past = year - 1;
    let leap_days = past / 4 - past / 100 + past / 400 - 477 + i64::from(is_leap && month > 2);
    let days = (year - 1970) * 365 + leap_days + before + day - 1;
    let seconds = ((days * 24 + hour) * 60 + minute) * 60 + second;
    Some(seconds * 1_000_000_000 + nanosecond)
}

/// Seconds of a time in nanoseconds, rounded once: an `f64` holds times of the Unix epoch only to
/// 0.24 µs.
pub(crate) fn seconds(ns: i64) -> f64 {
    const SECOND: i64 = 1_000_000_000;
    ns.div_euclid(SECOND) as f64 + ns.rem_euclid(SECOND) as f64 / 1e9
}

/// Reliability of UTC; greater is better.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Trust {
    /// The leap seconds are known.
    pub(super) leap_seconds: bool,
    /// Aligned to the pulse per second of the receiver.
    pub(super) accurate: bool,
}

/// A time on both clocks.
#[derive(Debug, Clone, Copy)]
struct Pair {
    /// Byte offset in the file.
    at: u64,
    /// Clock of the device, microseconds.
    device_us: i64,
    /// Unix epoch less device clock, nanoseconds.
    offset_ns: i64,
}

/// The relation of UTC to the clock of the device.
#[derive(Debug, Default)]
pub(super) struct Utc {
    /// Reliability of the pairs.
    trust: Option<Trust>,
    /// Pairs in the order of the log.
    pairs: Vec<Pair>,
}

impl Utc {
    /// Adds a time on both clocks, from byte `at` of the file. Only pairs of the highest reliability are
    /// kept: the first pairs of a log may be off by milliseconds, or by whole seconds.
    pub(super) fn add(&mut self, at: u64, device_us: i64, unix_ns: i64, trust: Trust) {
        if Some(trust) > self.trust {
            self.trust = Some(trust);
            self.pairs.clear();
        }
        if Some(trust) < self.trust {
            return;
        }
        // One pair per second is enough; the last pair is always kept.
        const INTERVAL_US: i64 = 1_000_000;
        if let [.., before, _] = self.pairs[..]
            && (0..INTERVAL_US).contains(&(device_us - before.device_us))
        {
            self.pairs.pop();
        }
        self.pairs.push(Pair {
            at,
            device_us,
            offset_ns: unix_ns - 1000 * device_us,
        });
    }

    /// Whether the log has valid UTC.
    pub(super) fn is_known(&self) -> bool {
        !self.pairs.is_empty()
    }

    /// Checks that UTC runs at the rate of the device's clock, without steps.
    pub(super) fn check(&self, path: &Path) -> Result<()> {
        // A crystal may be off by 1e-4 while no receiver disciplines it.
        let allowed_ns = |us: i64| 500_000_000 + us.abs() / 10;
        let mut steps = self.pairs.windows(2).map(|pair| (pair[0], pair[1]));
        let step = steps.find(|(a, b)| {
            (b.offset_ns - a.offset_ns).abs() > allowed_ns(b.device_us - a.device_us)
        });
        let Some((before, after)) = step else {
            return Ok(());
        };
        let step_s = seconds(after.offset_ns - before.offset_ns);
        Err(Error::format(
            path,
            Location::Byte(after.at),
            format!("UTC that steps by {step_s:.3} s against the clock of the device"),
            "no step (a restart of the device, a leap second): split the log there",
        ))
    }

    /// Seconds of the Unix epoch, or of the device clock if UTC is not known. The offset is linear
    /// between pairs and constant before the first and after the last.
    pub(super) fn time_s(&self, device_us: i64) -> f64 {
        let next = self.pairs.partition_point(|p| p.device_us <= device_us);
        let offset_ns = match (
            next.checked_sub(1).map(|i| self.pairs[i]),
            self.pairs.get(next),
        ) {
            (Some(a), Some(b)) => {
                let part = (device_us - a.device_us) as f64 / (b.device_us - a.device_us) as f64;
                a.offset_ns + (part * (b.offset_ns - a.offset_ns) as f64).round() as i64
            }
            (Some(pair), None) => pair.offset_ns,
            (None, Some(pair)) => pair.offset_ns,
            (None, None) => 0,
        };
        seconds(1000 * device_us + offset_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_seconds_of_the_unix_epoch() {
        for (date, time, expected) in [
            ([1970, 1, 1], [0, 0, 0], Some(0)),
            ([2000, 2, 29], [0, 0, 0], Some(951_782_400)),
            ([2000, 3, 1], [0, 0, 0], Some(951_868_800)),
            ([2001, 9, 9], [1, 46, 40], Some(1_000_000_000)),
            ([2024, 2, 29], [23, 59, 59], Some(1_709_251_199)),
            ([2016, 12, 31], [23, 59, 60], Some(1_483_228_800)),
            ([2099, 12, 31], [0, 0, 0], Some(4_102_358_400)),
            ([2023, 2, 29], [0, 0, 0], None),
            ([2024, 13, 1], [0, 0, 0], None),
            ([2024, 0, 1], [0, 0, 0], None),
            ([2024, 1, 1], [24, 0, 0], None),
            ([i64::MAX, 1, 1], [0, 0, 0], None),
        ] {
            let expected = expected.map(|s: i64| s * 1_000_000_000);
            assert_eq!(unix_ns(date, time, 0), expected, "{date:?}");
        }
        assert_eq!(unix_ns([2024, 1, 1], [0, 0, 0], -1), None);
        assert_eq!(seconds(1_709_251_199_250_000_000), 1_709_251_199.25);
        assert_eq!(seconds(-250_000_000), -0.25);
    }

    #[test]
    fn stamps_roll_over_and_may_go_back_a_little() {
        let mut clock = DeviceClock::default();
        let stamps = [u32::MAX - 1, 5, u32::MAX, 10, 1 << 30, 2 << 30, 3 << 30, 7];
        let times = stamps.map(|stamp| clock.unwrapped_us(stamp));
        let turn = 1_i64 << 32;
        let expected = [
            turn - 2,
            turn + 5,
            turn - 1,
            turn + 10,
            turn + (1 << 30),
            turn + (2 << 30),
            turn + (3 << 30),
            2 * turn + 7,
        ];
        assert_eq!(times, expected);
    }

    #[test]
    fn the_offset_is_interpolated_between_trusted_pairs() {
        let trust = |accurate| Trust {
            leap_seconds: true,
            accurate,
        };
        let mut utc = Utc::default();
        assert_eq!(utc.time_s(1_500_000), 1.5);
        utc.add(0, 0, 900_000_000_000, trust(false));
        utc.add(1, 1_000_000, 101_000_000_000, trust(true));
        utc.add(2, 1_500_000, 101_500_999_000, trust(true));
        utc.add(3, 3_000_000, 103_000_020_000, trust(true));
        utc.add(4, 3_500_000, 990_000_000_000, trust(false));
        utc.add(5, 3_500_000, 103_500_020_000, trust(true));
        assert_eq!(utc.pairs.len(), 4);
        for (us, expected) in [(0, 100.0), (4_000_000, 104.000_02), (1_000_000, 101.0)] {
            assert!((utc.time_s(us) - expected).abs() < 1e-9, "{us}");
        }
        let middle = 102.25 + 0.5 * (0.000_999 + 0.000_020);
        assert!((utc.time_s(2_250_000) - middle).abs() < 1e-9);
        assert!(utc.check(Path::new("a")).is_ok());
        utc.add(6, 5_000_000, 106_000_000_000, trust(true));
        let error = utc.check(Path::new("a")).unwrap_err().to_string();
        assert!(
            error.contains("a, byte 6") && error.contains("by 1.000 s"),
            "{error}"
        );
    }
}
