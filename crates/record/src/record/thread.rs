//! The context of the thread that records a source.

use std::path::Path;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use super::clock::Clock;
use super::field::Source;
use super::journal::{Disk, Journal};
use super::status::Status;
use crate::error::{Error, Result};

/// Pause before a link is opened again.
const AGAIN: Duration = Duration::from_secs(1);

/// The log of everything that happens to the sources.
#[derive(Debug)]
pub struct Events<'a>(Mutex<Journal<'a>>);

impl<'a> Events<'a> {
    /// Creates `events.csv`.
    ///
    /// # Errors
    /// A file that exists already or cannot be written.
    pub fn create(folder: &Path, disk: &'a Disk) -> Result<Self> {
        let mut journal = Journal::create(&folder.join("events.csv"), disk)?;
        journal.append(b"unix_s,monotonic_s,source,event\n")?;
        Ok(Self(Mutex::new(journal)))
    }

    /// Adds an event of a source.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn add(&self, clock: &Clock, source: &str, event: &str) -> Result<()> {
        let now = clock.now();
        let event = event.replace('"', "'").replace('\n', "; ");
        let row = format!(
            "{:.6},{:.6},{source},\"{event}\"\n",
            now.unix_s(),
            now.monotonic_s()
        );
        let mut journal = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        journal.append(row.as_bytes())?;
        // Events are rare, and needed after a crash.
        journal.flush()
    }
}

/// The context of the thread that records a source.
pub struct SourceThread<'a> {
    /// The source.
    pub source: &'a Source,
    /// Folder of the recording.
    pub folder: &'a Path,
    /// The clocks.
    pub clock: &'a Clock,
    /// The state of the source for the view.
    pub status: &'a Status,
    /// The log of events.
    pub events: &'a Events<'a>,
    /// Syncs the files of the recording.
    pub disk: &'a Disk,
    /// Set when the recording ends.
    pub stop: &'a AtomicBool,
}

impl SourceThread<'_> {
    /// Whether the recording goes on.
    pub fn goes_on(&self) -> bool {
        !self.stop.load(Ordering::Relaxed)
    }

    /// Logs an event.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn event(&self, text: &str) -> Result<()> {
        self.events.add(self.clock, &self.source.name, text)
    }

    /// Logs and shows a status that the sensor reports.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn report_sensor_status(&self, sensor_status: &str) -> Result<()> {
        self.status.set_sensor_status(sensor_status);
        self.event(sensor_status)
    }

    /// After the link ended or could not be opened: logs the error if it is new, and waits before the next attempt.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn failed(&self, error: &Error) -> Result<()> {
        let text = error.to_string();
        if self.status.closed(&text) {
            self.event(&text)?;
        }
        let mut left = AGAIN;
        while self.goes_on() && !left.is_zero() {
            let step = left.min(Duration::from_millis(100));
            std::thread::sleep(step);
            left -= step;
        }
        Ok(())
    }
}
