//! The thread of a sensor that sends by itself.

use std::io::{ErrorKind, Read};
use std::path::Path;
use std::time::Duration;

use super::field::Kind;
use super::geocom::Link;
use super::journal::StampedJournal;
use super::thread::SourceThread;
use crate::error::{Error, Result};

/// Longest time without looking whether the recording ends.
const PATIENCE: Duration = Duration::from_millis(200);
/// Longest line: one without an end is cut there.
const LONGEST_LINE: usize = 4096;

/// Records what a sensor sends until told to stop: bytes as they are, with the times of their arrival beside them;
/// lines below the header of their table.
///
/// # Errors
/// A file cannot be written. A link that ends is opened again.
pub fn record(thread: &SourceThread<'_>) -> Result<()> {
    let (folder, source) = (thread.folder, thread.source);
    let mut journal = StampedJournal::create(folder, &source.name, source.kind.extension())?;
    if let Kind::Lines(header) = &source.kind {
        journal.append(format!("{header}\n").as_bytes(), thread.clock.now())?;
    }
    let mut counter = Counter::new(&source.kind);
    let mut buffer = vec![0; 1 << 16];
    while thread.goes_on() {
        let mut wire = match source.place.open() {
            Ok(wire) => wire,
            Err(error) => {
                thread.failed(&error)?;
                continue;
            }
        };
        let failed = |error| Error::io(Path::new(&source.place.to_string()), error);
        if let Err(error) = wire.set_timeout(PATIENCE) {
            thread.failed(&failed(error))?;
            continue;
        }
        thread.status.opened();
        thread.event("connected")?;
        while thread.goes_on() {
            match wire.read(&mut buffer) {
                Ok(0) => {
                    thread.failed(&failed(ErrorKind::UnexpectedEof.into()))?;
                    break;
                }
                Ok(count) => {
                    let at = thread.clock.now();
                    journal.append(&buffer[..count], at)?;
                    thread
                        .status
                        .arrived(counter.records_in(&buffer[..count]), count, at);
                }
                Err(error) => match error.kind() {
                    ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted => {
                        journal.flush_if_due()?;
                    }
                    _ => {
                        thread.failed(&failed(error))?;
                        break;
                    }
                },
            }
        }
    }
    journal.flush()
}

/// Counts records as they arrive, for the view.
struct Counter {
    is_text: bool,
    last: u8,
    since_end: usize,
}

impl Counter {
    fn new(kind: &Kind) -> Self {
        Self {
            is_text: *kind != Kind::Sbg,
            last: 0,
            since_end: 0,
        }
    }

    /// Ends of lines, or beginnings of frames of sbgECom.
    fn records_in(&mut self, bytes: &[u8]) -> u64 {
        let mut count = 0;
        for &byte in bytes {
            let is_one = match self.is_text {
                true => byte == b'\n' || self.since_end >= LONGEST_LINE,
                false => (self.last, byte) == (0xff, 0x5a),
            };
            self.since_end = if is_one { 0 } else { self.since_end + 1 };
            count += u64::from(is_one);
            self.last = byte;
        }
        count
    }
}
