//! The system clock of a recording: `clock.csv`.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::format::file::nothing_in;
use crate::format::input::Input;
use crate::format::text::lines::Lines;

/// The system clock counts as synchronised if chrony reports at most this root mean square offset, seconds.
const GOOD_RMS_S: f64 = 1e-3;
/// A kill or a power cut costs the checks of the last seconds. A recording that continues for longer after its last
/// check, and for more than this many intervals between checks, is not known to have had the right time. Seconds.
const UNCHECKED_S: f64 = 10.0;
const UNCHECKED_INTERVALS: f64 = 3.0;

/// State of the system clock during a recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordingClock {
    /// UTC when the monotonic clock was zero, from the first check, seconds since 1970.
    pub begin_s: f64,
    /// Number of checks, one per second.
    pub checks: usize,
    /// Number of checks that chrony answered.
    pub answered: usize,
    /// Number of checks at which the clock was synchronised to a source.
    pub locked: usize,
    /// The largest root mean square of its offsets while it was synchronised, seconds.
    pub worst_rms_s: f64,
    /// The last source to which it was synchronised.
    pub reference: String,
    /// The settings of the clock during the recording.
    pub steps: Vec<ClockStep>,
    /// Time of the last check by the monotonic clock, seconds.
    pub last_s: f64,
    /// Number of damaged rows.
    pub damaged: usize,
}

/// A setting of the system clock.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ClockStep {
    /// By how much it was set, seconds.
    pub set_s: f64,
    /// When, seconds since the beginning.
    pub at_s: f64,
}

/// A row of the file.
struct Check {
    unix_s: f64,
    monotonic_s: f64,
    /// Whether chrony answered.
    is_answered: bool,
    /// The root mean square of the clock's offsets, seconds, and its reference, if it was synchronised.
    locked: Option<(f64, String)>,
    set_s: Option<f64>,
}

impl Check {
    /// The check in a row; `None` if the row is damaged.
    fn read(row: &str) -> Option<Self> {
        let cells: Vec<&str> = row.split(',').map(str::trim_ascii).collect();
        let &[unix, monotonic, reference, _, rms, locked, set] = cells.as_slice() else {
            return None;
        };
        let number = |cell: &str| cell.parse().ok().filter(|x: &f64| x.is_finite());
        Some(Self {
            unix_s: number(unix)?,
            monotonic_s: number(monotonic)?,
            is_answered: !locked.is_empty(),
            locked: match locked {
                "1" => Some((number(rms)?, reference.to_owned())),
                "0" | "" => None,
                _ => return None,
            },
            set_s: match set {
                "" => None,
                set => Some(number(set)?),
            },
        })
    }
}

impl RecordingClock {
    /// Reads `clock.csv`, without a last row that a crash cut off. Damaged rows are left out and counted.
    ///
    /// # Errors
    /// The file cannot be read, or has no row.
    pub fn read(path: &Path) -> Result<Self> {
        let mut lines = Lines::open(&Input::from(path))?;
        let (mut clock, mut damaged): (Option<Self>, usize) = (None, 0);
        let mut is_header = true;
        loop {
            let check = match lines.next_content() {
                Ok(false) => break,
                Ok(true) if is_header => {
                    is_header = false;
                    continue;
                }
                Ok(true) => Check::read(lines.text()),
                Err(Error::Format { .. }) => None,
                Err(error) => return Err(error),
            };
            let Some(check) = check else {
                damaged += 1;
                continue;
            };
            let clock = clock.get_or_insert(Self {
                begin_s: check.unix_s - check.monotonic_s,
                checks: 0,
                answered: 0,
                locked: 0,
                worst_rms_s: 0.0,
                reference: String::new(),
                steps: Vec::new(),
                last_s: check.monotonic_s,
                damaged: 0,
            });
            // One of two rows in the wrong order is wrong.
            damaged += usize::from(check.monotonic_s < clock.last_s);
            clock.last_s = check.monotonic_s;
            clock.checks += 1;
            clock.answered += usize::from(check.is_answered);
            if let Some((rms_s, reference)) = check.locked {
                clock.locked += 1;
                clock.worst_rms_s = clock.worst_rms_s.max(rms_s);
                clock.reference = reference;
            }
            let at_s = check.monotonic_s;
            let step = check.set_s.map(|set_s| ClockStep { set_s, at_s });
            clock.steps.extend(step);
        }
        let clock = clock.ok_or_else(|| nothing_in(path, "check of the clock"))?;
        Ok(Self { damaged, ..clock })
    }

    /// Whether UTC was right up to a common time (seconds since 1970): at every check the clock was synchronised well
    /// enough, it was never set, no check is damaged, and the checks do not end long before.
    pub fn is_synchronised(&self, until_s: f64) -> bool {
        let is_good = self.locked == self.checks && self.worst_rms_s <= GOOD_RMS_S;
        is_good && self.steps.is_empty() && self.damaged == 0 && self.unchecked_s(until_s) == 0.0
    }

    /// For how long the recording continues after its last check up to a common time, seconds; 0 if that is no longer
    /// than usual.
    pub fn unchecked_s(&self, until_s: f64) -> f64 {
        let interval_s = self.last_s / self.checks as f64;
        let usual_s = (UNCHECKED_INTERVALS * interval_s).max(UNCHECKED_S);
        let unchecked_s = until_s - self.common_s(self.last_s);
        if unchecked_s > usual_s {
            unchecked_s
        } else {
            0.0
        }
    }

    /// Converts a time of the monotonic clock to the common time, seconds since 1970.
    pub fn common_s(&self, monotonic_s: f64) -> f64 {
        self.begin_s + monotonic_s
    }
}
