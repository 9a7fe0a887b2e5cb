//! The thread of a sensor that sends by itself.

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

/// Longest time without looking whether the recording ends.
const PATIENCE: Duration = Duration::from_millis(200);

/// Records what a sensor sends until told to stop: bytes as they are, with the times of their arrival beside them;
/// whole lines below the header of their table.
///
/// # Errors
/// A file cannot be written. A link that ends is opened again.
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
    let mut lines = Lines::default();
    let mut said = String::new();
    let mut counter = Counter::new(&source.kind);
    let mut buffer = vec![0; 1 << 16];
    while thread.goes_on() {
        // A link may stay away for long; what arrived before must not wait for it.
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
        let is_serial = matches!(source.place, Place::Serial(..));
        thread.status.damaged(lines.opened(is_serial));
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
                        let time_s = is_timed_here.then(|| thread.clock.common_s(&at));
                        let (rows, cut_off) = lines.take(&buffer[..count], time_s);
                        damaged += cut_off;
                        if !rows.is_empty() {
                            journal.append(&rows, at)?;
                        }
                    } else {
                        journal.append(&buffer[..count], at)?;
                    }
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

/// Puts together the lines of a table from the pieces that arrive. Lines of which a part is missing are dropped, as
/// half a number is a wrong number.
#[derive(Default)]
struct Lines {
    /// The beginning of a line that has not ended yet.
    begun: Vec<u8>,
    /// Whether the beginning of the current line is missing.
    is_cut: bool,
}

impl Lines {
    /// The link was opened, perhaps in the middle of a line (`is_cut`). Drops what had begun before; returns how many
    /// bytes that was.
    fn opened(&mut self, is_cut: bool) -> u64 {
        self.is_cut = is_cut;
        let begun = std::mem::take(&mut self.begun);
        begun.len() as u64
    }

    /// Returns the lines that these bytes complete, and how many bytes were dropped because the beginning of their line is
    /// missing. With a time, each line gets it as its first cell; without one, lines stay as they arrived.
    fn take(&mut self, bytes: &[u8], time_s: Option<f64>) -> (Vec<u8>, u64) {
        let (mut rows, mut cut_off) = (Vec::new(), 0);
        for part in bytes.split_inclusive(|byte| *byte == b'\n') {
            if self.is_cut {
                self.is_cut = !part.ends_with(b"\n");
                cut_off += part.len() as u64;
                continue;
            }
            self.begun.extend_from_slice(part);
            if !self.begun.ends_with(b"\n") && self.begun.len() < LONGEST_LINE {
                continue;
            }
            let line = self.begun.trim_ascii_end();
            match time_s {
                Some(_) if line.is_empty() => {}
                Some(time_s) => {
                    rows.extend_from_slice(format!("{time_s:.6},").as_bytes());
                    rows.extend_from_slice(line);
                    rows.push(b'\n');
                }
                None => rows.extend_from_slice(&self.begun),
            }
            self.begun.clear();
        }
        (rows, cut_off)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_line_of_a_link_that_opens_in_the_middle_of_one_is_left_out() {
        let mut lines = Lines::default();
        assert_eq!(lines.opened(true), 0);
        assert_eq!(lines.take(b"3", None), (Vec::new(), 1));
        assert_eq!(
            lines.take(b".4\r\n5.6\r\n7", None),
            (b"5.6\r\n".to_vec(), 4)
        );
        assert_eq!(
            lines.take(b"\r\n\n", Some(1.5)),
            (b"1.500000,7\n".to_vec(), 0)
        );
        assert_eq!(lines.take(b"8", Some(1.5)), (Vec::new(), 0));
        assert_eq!(lines.opened(false), 1);
        assert_eq!(lines.take(b"9\n", None), (b"9\n".to_vec(), 0));
    }
}
