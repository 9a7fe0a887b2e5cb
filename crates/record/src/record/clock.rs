//! Times of arrival, and the state of the system clock.

use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// A time of arrival.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Stamp {
    /// Time since the recording began by the monotonic clock, nanoseconds.
    pub monotonic_ns: u64,
    /// Time since 1970 by the system clock (UTC), nanoseconds.
    pub unix_ns: i64,
}

impl Stamp {
    /// Seconds since the recording began.
    pub fn monotonic_s(&self) -> f64 {
        1e-9 * self.monotonic_ns as f64
    }

    /// Seconds since 1970 by the system clock.
    pub fn unix_s(&self) -> f64 {
        1e-9 * self.unix_ns as f64
    }
}

/// The clocks of a recording.
#[derive(Debug, Clone)]
pub struct Clock {
    begun: Instant,
    /// UTC at the beginning of the recording, nanoseconds.
    begun_unix_ns: i64,
    /// Seconds of the recording per second of real time: 1, or the speed at which a recording is played.
    speed: f64,
    /// Whether UTC is that of the system; otherwise it is that of a recording being played.
    is_systems: bool,
    /// Added to UTC, so that tests can step the clock.
    step_ns: Arc<AtomicI64>,
}

impl Default for Clock {
    fn default() -> Self {
        Self {
            begun: Instant::now(),
            begun_unix_ns: system_ns(),
            speed: 1.0,
            is_systems: true,
            step_ns: Arc::default(),
        }
    }
}

/// UTC of the system, nanoseconds since 1970.
fn system_ns() -> i64 {
    let unix = SystemTime::now().duration_since(UNIX_EPOCH);
    unix.map_or(0, |since| {
        i64::try_from(since.as_nanos()).unwrap_or(i64::MAX)
    })
}

impl Clock {
    /// The clocks of a recording that is played from a given UTC at `speed` times real time.
    pub fn played(begins_unix_s: f64, speed: f64) -> Self {
        Self {
            begun_unix_ns: (1e9 * begins_unix_s) as i64,
            speed,
            is_systems: false,
            ..Self::default()
        }
    }

    /// Seconds of the recording per second of real time.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// The time now.
    pub fn now(&self) -> Stamp {
        let monotonic_ns = if self.is_systems {
            u64::try_from(self.begun.elapsed().as_nanos()).unwrap_or(u64::MAX)
        } else {
            (1e9 * self.speed * self.begun.elapsed().as_secs_f64()) as u64
        };
        let unix_ns = if self.is_systems {
            system_ns()
        } else {
            self.begun_unix_ns + monotonic_ns as i64
        };
        Stamp {
            monotonic_ns,
            unix_ns: unix_ns + self.step_ns.load(Ordering::Relaxed),
        }
    }

    /// The common time of the recording, seconds: UTC at its beginning, continued by the monotonic clock, so that steps
    /// of the system clock do not affect it.
    pub fn common_s(&self, stamp: &Stamp) -> f64 {
        1e-9 * self.begun_unix_ns as f64 + stamp.monotonic_s()
    }

    /// The state of the system clock; `None` where chrony does not answer.
    pub fn state(&self) -> Option<ClockState> {
        if self.is_systems {
            ClockState::ask()
        } else {
            Some(ClockState {
                reference: "PLAYED".into(),
                offset_s: 0.0,
                rms_s: 0.0,
                is_locked: true,
            })
        }
    }

    /// Steps UTC forward, as if somebody set the system clock.
    pub fn step_by(&self, nanoseconds: i64) {
        self.step_ns.fetch_add(nanoseconds, Ordering::Relaxed);
    }
}

/// If UTC moves against the monotonic clock by more than this between two checks, it was stepped, seconds: a
/// disciplined clock is slewed by less than a millisecond per second.
const STEP_S: f64 = 0.005;

/// Detects steps of UTC.
#[derive(Debug, Default)]
pub struct StepWatch {
    last: Option<Stamp>,
}

impl StepWatch {
    /// The step of UTC since the last check, seconds; `None` if there was none.
    pub fn check(&mut self, now: Stamp) -> Option<f64> {
        let last = self.last.replace(now)?;
        let by_utc_s = 1e-9 * (now.unix_ns - last.unix_ns) as f64;
        let passed_s = 1e-9 * (now.monotonic_ns - last.monotonic_ns) as f64;
        let step_s = by_utc_s - passed_s;
        (step_s.abs() > STEP_S.max(1e-3 * passed_s)).then_some(step_s)
    }
}

/// The state of the system clock as reported by chrony.
#[derive(Debug, Clone, PartialEq)]
pub struct ClockState {
    /// Name of its reference, such as `PPS`.
    pub reference: String,
    /// Offset from the reference, seconds; positive if the clock is fast.
    pub offset_s: f64,
    /// Root mean square of the offsets, seconds.
    pub rms_s: f64,
    /// Whether the clock is synchronised to a reference.
    pub is_locked: bool,
}

impl ClockState {
    /// Asks chrony; `None` if it does not answer.
    pub fn ask() -> Option<Self> {
        let mut child = Command::new("chronyc")
            .args(["-c", "tracking"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .ok()?;
        // It answers at once, or not at all.
        let deadline = Instant::now() + Duration::from_millis(500);
        while child.try_wait().ok()?.is_none() {
            if Instant::now() > deadline {
                let _ = child.kill();
                let _ = child.wait();
                return None;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        let answer = child.wait_with_output().ok()?;
        Self::parse(std::str::from_utf8(&answer.stdout).ok()?)
    }

    /// Reads a line of `chronyc -c tracking`.
    fn parse(line: &str) -> Option<Self> {
        let cells: Vec<&str> = line.trim().split(',').collect();
        let [id, name, _, _, offset, _, rms, .., leap] = cells.as_slice() else {
            return None;
        };
        let reference = if name.is_empty() { id } else { name };
        Some(Self {
            reference: (*reference).to_owned(),
            // chrony reports how far the clock is slow.
            offset_s: -offset.parse::<f64>().ok()?,
            rms_s: rms.parse().ok()?,
            is_locked: *leap != "Not synchronised",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_of_the_clock_is_detected_and_slewing_is_not() {
        let at = |seconds: f64, offset_s: f64| Stamp {
            monotonic_ns: (1e9 * seconds) as u64,
            unix_ns: (1e9 * (1.7e9 + seconds + offset_s)) as i64,
        };
        let mut watch = StepWatch::default();
        assert_eq!(watch.check(at(0.0, 0.0)), None);
        assert_eq!(watch.check(at(1.0, 0.0005)), None);
        let step_s = watch.check(at(2.0, 0.5005)).unwrap();
        assert!((step_s - 0.5).abs() < 1e-6, "{step_s}");
        assert_eq!(watch.check(at(3.0, 0.5005)), None);
        assert!(watch.check(at(4.0, 0.0)).unwrap() < -0.4);
    }

    #[test]
    fn answers_of_chrony_are_read() {
        let line = "50505300,PPS,1,1763900000.123456789,0.000000012,-0.000000003,0.000000210,\
                    -12.345,0.001,0.004,0.000000001,0.000012000,16.0,Normal\n";
        let state = ClockState::parse(line).unwrap();
        assert_eq!((state.reference.as_str(), state.is_locked), ("PPS", true));
        assert_eq!((state.offset_s, state.rms_s), (-1.2e-8, 2.1e-7));
        let line = "00000000,,0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,1.0,1.0,0.0,Not synchronised";
        assert!(!ClockState::parse(line).unwrap().is_locked);
        assert_eq!(ClockState::parse("506 Cannot talk to daemon"), None);
    }
}
