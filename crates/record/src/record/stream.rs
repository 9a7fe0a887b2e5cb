//! The thread of a sensor that sends on its own.

use std::io::{ErrorKind, Read};
use std::path::Path;
use std::time::Duration;

use super::counter::{Counter, LONGEST_LINE};
use super::field::Kind;
use super::geocom::Link;
use super::journal::StampedJournal;
use super::place::Place;
use super::thread::SourceThread;
use crate::error::{Error, Result};
use crate::format::WholeLines;

/// Longest interval between checks whether the recording has ended.
const PATIENCE: Duration = Duration::from_millis(200);

/// Records what a sensor sends until the recording ends: the bytes as they arrive, and their arrival times in a second
/// file. For a table, only whole lines are recorded, below its header.
///
/// # Errors
/// A file cannot be written. A lost link is not an error: it is opened again.
pub fn record(thread: &SourceThread<'_>) -> Result<()> {
    let (folder, source) = (thread.folder, thread.source);
    let mut journal =
        StampedJournal::create(folder, &source.name, source.kind.extension(), thread.disk)?;
    let is_table = matches!(source.kind, Kind::Lines(_));
    let is_timed_here = source.kind.is_timed_here();
    if let Kind::Lines(header) = &source.kind {
        let time = if is_timed_here { "time_s," } else { "" };
        journal.append(format!("{time}{header}\n").as_bytes(), thread.clock.now())?;
    }
    let mut lines = WholeLines::default();
    let mut sensor_status = String::new();
    let mut counter = Counter::new(&source.kind);
    let mut buffer = vec![0; 1 << 16];
    while thread.goes_on() {
        // The link may be down for a long time: write the bytes that arrived before.
        journal.write_if_due()?;
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
        counter.reopened();
        // A serial line may be opened in the middle of a row, and so may a server that passes one on. A datagram begins
        // with a row.
        let is_cut = !matches!(source.place, Place::Udp(_));
        thread.status.damaged(lines.interrupt(is_cut));
        while thread.goes_on() {
            match wire.read(&mut buffer) {
                Ok(0) => {
                    thread.failed(&failed(ErrorKind::UnexpectedEof.into()))?;
                    break;
                }
                Ok(count) => {
                    let at = thread.clock.now();
                    let (records, mut damaged) = counter.take(&buffer[..count]);
                    if is_table {
                        let (mut rows, cut_off) = lines.take(&buffer[..count]);
                        damaged += cut_off;
                        if lines.begun().len() >= LONGEST_LINE {
                            rows.extend(lines.end_line());
                        }
                        if is_timed_here {
                            rows = stamped(&rows, thread.clock.common_s(&at));
                        }
                        if !rows.is_empty() {
                            journal.append(&rows, at)?;
                        }
                    } else {
                        journal.append(&buffer[..count], at)?;
                    }
                    thread.status.arrived(records, count, at);
                    thread.status.damaged(damaged);
                    let new_status = counter.sensor_status();
                    if new_status != sensor_status {
                        thread.report_sensor_status(&new_status)?;
                        sensor_status = new_status;
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

/// Puts the time before each line as its first cell. Empty lines are left out.
fn stamped(lines: &[u8], time_s: f64) -> Vec<u8> {
    let mut rows = Vec::with_capacity(lines.len());
    for line in lines.split_inclusive(|byte| *byte == b'\n') {
        let line = line.trim_ascii_end();
        if !line.is_empty() {
            rows.extend_from_slice(format!("{time_s:.6},").as_bytes());
            rows.extend_from_slice(line);
            rows.push(b'\n');
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_gets_its_time() {
        assert_eq!(stamped(b"7\r\n\n8", 1.5), b"1.500000,7\n1.500000,8\n");
        assert_eq!(stamped(b"", 1.5), b"");
    }
}
