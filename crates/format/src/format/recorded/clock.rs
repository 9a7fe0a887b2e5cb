//! The clock that took the times of a recording: `clock.csv`.

use std::path::Path;

use crate::error::Error;
use crate::error::{Location, Result};
use crate::format::file::nothing_in;
use crate::format::input::Input;
use crate::format::text::lines::{Lines, Separator};

/// The system's clock counts as disciplined if chrony reports at most this root mean square offset, seconds.
const GOOD_RMS_S: f64 = 1e-3;

/// State of the system's clock during a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordingClock {
    /// UTC at the zero of the monotonic clock according to the first check, seconds since 1970.
    pub begin_s: f64,
    /// Number of checks, one per second.
    pub looks: usize,
    /// Checks to which chrony answered.
    pub answered: usize,
    /// Checks at which the clock was synchronised to a source.
    pub locked: usize,
    /// The largest root mean square of its offsets while it was synchronised, seconds.
    pub worst_rms_s: f64,
    /// The last source that it was synchronised to.
    pub reference: String,
    /// Steps by which the clock was set, seconds, and their times, seconds since the beginning.
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
                looks: 0,
                answered: 0,
                locked: 0,
                worst_rms_s: 0.0,
                reference: String::new(),
                steps: Vec::new(),
            });
            clock.looks += 1;
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
                "times that are no numbers",
                "those of a recording",
            )),
            None => Err(nothing_in(path, "look at the clock")),
        }
    }

    /// Whether UTC was right throughout: the clock was synchronised well enough at every check, and was not set.
    pub fn is_disciplined(&self) -> bool {
        self.steps.is_empty() && self.locked == self.looks && self.worst_rms_s <= GOOD_RMS_S
    }

    /// Common time of a time of the monotonic clock, seconds since 1970.
    pub fn common_s(&self, monotonic_s: f64) -> f64 {
        self.begin_s + monotonic_s
    }
}
