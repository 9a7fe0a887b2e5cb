//! The system clock of a recording: `clock.csv`.

use std::path::Path;

use crate::error::Error;
use crate::error::{Location, Result};
use crate::format::file::nothing_in;
use crate::format::input::Input;
use crate::format::text::lines::{Lines, Separator};

/// The system clock counts as synchronised if chrony reports at most this root mean square offset, seconds.
const GOOD_RMS_S: f64 = 1e-3;

/// State of the system clock during a recording.
#[derive(Debug, Clone, PartialEq)]
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
    /// Steps by which the clock was set, and their times since the beginning, seconds.
    pub steps: Vec<(f64, f64)>,
}

impl RecordingClock {
    /// Reads `clock.csv`, without a last row that a crash cut off.
    ///
    /// # Errors
    /// The file cannot be read, or has no row.
    pub fn read(path: &Path) -> Result<Self> {
        let mut lines = Lines::open(&Input::from(path))?;
        let mut clock: Option<Self> = None;
        lines.next_content()?;
        while lines.next_content()? {
            let mut cells = Vec::new();
            let _ = Separator::Comma.split(lines.text(), |_, cell| {
                cells.push(cell.to_owned());
                Ok::<(), ()>(())
            });
            let [unix, monotonic, reference, _, rms, locked, set] = cells.as_slice() else {
                continue;
            };
            let (Ok(unix_s), Ok(monotonic_s)) = (unix.parse::<f64>(), monotonic.parse::<f64>())
            else {
                continue;
            };
            let clock = clock.get_or_insert(Self {
                begin_s: unix_s - monotonic_s,
                checks: 0,
                answered: 0,
                locked: 0,
                worst_rms_s: 0.0,
                reference: String::new(),
                steps: Vec::new(),
            });
            clock.checks += 1;
            clock.answered += usize::from(!locked.is_empty());
            if locked == "1" {
                clock.locked += 1;
                clock.worst_rms_s = clock.worst_rms_s.max(rms.parse().unwrap_or(f64::INFINITY));
                clock.reference.clone_from(reference);
            }
            clock
                .steps
                .extend(set.parse().map(|set_s| (set_s, monotonic_s)));
        }
        match clock {
            Some(clock) if clock.begin_s.is_finite() => Ok(clock),
            Some(_) => Err(Error::format(
                path,
                Location::Whole,
                "times that are not numbers",
                "the times of a recording",
            )),
            None => Err(nothing_in(path, "check of the clock")),
        }
    }

    /// Whether UTC was right throughout: at every check the clock was synchronised well enough, and it was never set.
    pub fn is_synchronised(&self) -> bool {
        self.steps.is_empty() && self.locked == self.checks && self.worst_rms_s <= GOOD_RMS_S
    }

    /// Converts a time of the monotonic clock to the common time, seconds since 1970.
    pub fn common_s(&self, monotonic_s: f64) -> f64 {
        self.begin_s + monotonic_s
    }
}
