//! The thread of a sensor that sends by itself.

use std::io::{ErrorKind, Read};
use std::path::Path;
use std::time::Duration;

use super::clock::Stamp;
use super::counter::{Counter, LONGEST_LINE};
use super::field::Kind;
use super::geocom::Link;
use super::journal::StampedJournal;
use super::thread::SourceThread;
use crate::error::{Error, Result};

/// Longest time without looking whether the recording ends.
const PATIENCE: Duration = Duration::from_millis(200);

/// Records what a sensor sends until told to stop: bytes as they are, with the times of their arrival beside them;
/// lines below the header of their table.
///
/// # Errors
/// A file cannot be written. A link that ends is opened again.
pub fn record(thread: &SourceThread<'_>) -> Result<()> {
    let (folder, source) = (thread.folder, thread.source);
    let mut journal =
        StampedJournal::create(folder, &source.name, source.kind.extension(), thread.disk)?;
    let is_timed_here = source.kind.is_timed_here();
    if let Kind::Lines(header) = &source.kind {
        let time = if is_timed_here { "time_s," } else { "" };
        journal.append(format!("{time}{header}\n").as_bytes(), thread.clock.now())?;
    }
    let mut begun_line = Vec::new();
    let mut said = String::new();
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
                    match is_timed_here {
                        true => {
                            let rows = timed(&buffer[..count], &mut begun_line, thread, at);
                            if !rows.is_empty() {
                                journal.append(&rows, at)?;
                            }
                        }
                        false => journal.append(&buffer[..count], at)?,
                    }
                    let (records, damaged) = counter.take(&buffer[..count]);
                    thread.status.arrived(records, count, at);
                    thread.status.damaged(damaged);
                    let word = counter.word();
                    if word != said {
                        thread.said(&word)?;
                        said = word;
                    }
                }
                Err(error) => match error.kind() {
                    ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted => {
                        journal.write_if_due()?;
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

/// Whole lines with the time of their arrival before them; the beginning of one is kept for later.
fn timed(bytes: &[u8], begun: &mut Vec<u8>, thread: &SourceThread<'_>, at: Stamp) -> Vec<u8> {
    let time_s = thread.clock.common_s(&at);
    let mut rows = Vec::new();
    for part in bytes.split_inclusive(|byte| *byte == b'\n') {
        begun.extend_from_slice(part);
        if begun.ends_with(b"\n") || begun.len() >= LONGEST_LINE {
            let line = begun.trim_ascii_end();
            if !line.is_empty() {
                rows.extend_from_slice(format!("{time_s:.6},").as_bytes());
                rows.extend_from_slice(line);
                rows.push(b'\n');
            }
            begun.clear();
        }
    }
    rows
}
