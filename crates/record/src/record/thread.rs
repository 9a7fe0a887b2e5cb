//! What the thread of a source works with.

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

/// Time before a link is opened again.
const AGAIN: Duration = Duration::from_secs(1);

/// The log of everything that happens to the sources.
#[derive(Debug)]
pub struct Events<'a>(Mutex<Journal<'a>>);

impl<'a> Events<'a> {
    /// Begins `events.csv`.
    ///
    /// # Errors
    /// It is there, or cannot be written.
    pub fn create(folder: &Path, disk: &'a Disk) -> Result<Self> {
        let mut journal = Journal::create(&folder.join("events.csv"), disk)?;
        journal.append(b"unix_s,monotonic_s,source,event\n")?;
        Ok(Self(Mutex::new(journal)))
    }

    /// Adds what happened to a source.
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
        // What happens is rare, and asked for after a crash.
        journal.flush()
    }
}

/// What the thread of a source works with.
pub struct SourceThread<'a> {
    /// The source.
    pub source: &'a Source,
    /// Where files are written.
    pub folder: &'a Path,
    /// The clocks.
    pub clock: &'a Clock,
    /// What is shown of it.
    pub status: &'a Status,
    /// What happens.
    pub events: &'a Events<'a>,
    /// Where files are brought.
    pub disk: &'a Disk,
    /// Set where the recording ends.
    pub stop: &'a AtomicBool,
}

impl SourceThread<'_> {
    /// Whether the recording goes on.
    pub fn goes_on(&self) -> bool {
        !self.stop.load(Ordering::Relaxed)
    }

    /// Keeps what happened.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn event(&self, text: &str) -> Result<()> {
        self.events.add(self.clock, &self.source.name, text)
    }

    /// Keeps and shows what the sensor says.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn said(&self, word: &str) -> Result<()> {
        self.status.says(word);
        self.event(word)
    }

    /// The link ended or cannot be opened: keeps it where it is news, and waits before the next attempt.
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
