//! Times of arrival, and the state of the system's clock.

use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// A time of arrival.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Stamp {
    /// Since the recording began, by a clock that nobody sets, nanoseconds.
    pub monotonic_ns: u64,
    /// Since 1970, UTC as the system has it, nanoseconds.
    pub unix_ns: i64,
}

impl Stamp {
    /// Seconds since the recording began.
    pub fn monotonic_s(&self) -> f64 {
        1e-9 * self.monotonic_ns as f64
    }

    /// Seconds since 1970 by the system's clock.
    pub fn unix_s(&self) -> f64 {
        1e-9 * self.unix_ns as f64
    }
}

/// The clocks of a recording.
#[derive(Debug, Clone)]
pub struct Clock {
    begun: Instant,
    /// UTC when it began, nanoseconds.
    begun_unix_ns: i64,
    /// Its seconds in one of ours: more than one where a recording is played faster.
    speed: f64,
    /// Whether UTC is the system's; else it is that of a recording that is played.
    is_systems: bool,
    /// Added to UTC: tests set the clock with it.
    set_by_ns: Arc<AtomicI64>,
}

impl Default for Clock {
    fn default() -> Self {
        Self {
            begun: Instant::now(),
            begun_unix_ns: system_ns(),
            speed: 1.0,
            is_systems: true,
            set_by_ns: Arc::default(),
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
    /// The clocks of a recording that is played from this UTC on, so many times faster than it was made.
    pub fn played(begins_unix_s: f64, speed: f64) -> Self {
        Self {
            begun_unix_ns: (1e9 * begins_unix_s) as i64,
            speed,
            is_systems: false,
            ..Self::default()
        }
    }

    /// Its seconds in one of ours.
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
            unix_ns: unix_ns + self.set_by_ns.load(Ordering::Relaxed),
        }
    }

    /// The common time of the recording, seconds: UTC when it began, and evenly on from there, whatever is done to UTC.
    pub fn common_s(&self, stamp: &Stamp) -> f64 {
        1e-9 * self.begun_unix_ns as f64 + stamp.monotonic_s()
    }

    /// What is known of the system's clock.
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

    /// Sets UTC forward by so many nanoseconds, as somebody could set the system's clock.
    pub fn set_by(&self, nanoseconds: i64) {
        self.set_by_ns.fetch_add(nanoseconds, Ordering::Relaxed);
    }
}

/// UTC that moves against the monotonic clock by more than this between two looks was set, seconds: a disciplined
/// clock is slewed by less than a millisecond a second.
const STEP_S: f64 = 0.005;

/// Watches whether UTC is set.
#[derive(Debug, Default)]
pub struct StepWatch {
    last: Option<Stamp>,
}

impl StepWatch {
    /// By how much UTC was set since the last look, seconds; `None` where it was not.
    pub fn look(&mut self, now: Stamp) -> Option<f64> {
        let last = self.last.replace(now)?;
        let by_utc_s = 1e-9 * (now.unix_ns - last.unix_ns) as f64;
        let passed_s = 1e-9 * (now.monotonic_ns - last.monotonic_ns) as f64;
        let set_s = by_utc_s - passed_s;
        (set_s.abs() > STEP_S.max(1e-3 * passed_s)).then_some(set_s)
    }
}

/// The state of the system's clock, as chrony knows it.
#[derive(Debug, Clone, PartialEq)]
pub struct ClockState {
    /// What it follows, such as `PPS`.
    pub reference: String,
    /// Off what it follows, seconds; positive where it is fast.
    pub offset_s: f64,
    /// Root mean square of its offsets, seconds.
    pub rms_s: f64,
    /// Whether it follows anything.
    pub is_locked: bool,
}

impl ClockState {
    /// Asks chrony; `None` where there is none.
    pub fn ask() -> Option<Self> {
        let mut child = Command::new("chronyc")
            .args(["-c", "tracking"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .ok()?;
        // It answers at once, or not at all.
        let patience = Instant::now() + Duration::from_millis(500);
        while child.try_wait().ok()?.is_none() {
            if Instant::now() > patience {
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
            // chrony says how far the clock is slow.
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
    fn a_clock_that_is_set_is_seen_and_one_that_is_slewed_is_not() {
        let at = |seconds: f64, offset_s: f64| Stamp {
            monotonic_ns: (1e9 * seconds) as u64,
            unix_ns: (1e9 * (1.7e9 + seconds + offset_s)) as i64,
        };
        let mut watch = StepWatch::default();
        assert_eq!(watch.look(at(0.0, 0.0)), None);
        assert_eq!(watch.look(at(1.0, 0.0005)), None);
        let set_s = watch.look(at(2.0, 0.5005)).unwrap();
        assert!((set_s - 0.5).abs() < 1e-6, "{set_s}");
        assert_eq!(watch.look(at(3.0, 0.5005)), None);
        assert!(watch.look(at(4.0, 0.0)).unwrap() < -0.4);
    }

    #[test]
    fn answers_of_chrony_are_read() {
        let line = "50505300,PPS,1,1763900000.123456789,0.000000012,-0.000000003,0.000000210,\
                    -12.345,0.001,0.004,0.000000001,0.000012000,16.0,Normal\n";
        let found = ClockState::parse(line).unwrap();
        assert_eq!((found.reference.as_str(), found.is_locked), ("PPS", true));
        assert_eq!((found.offset_s, found.rms_s), (-1.2e-8, 2.1e-7));
        let line = "00000000,,0,0.0,0.0,0.0,0.0,0.0,0.0,0.0,1.0,1.0,0.0,Not synchronised";
        assert!(!ClockState::parse(line).unwrap().is_locked);
        assert_eq!(ClockState::parse("506 Cannot talk to daemon"), None);
    }
}
