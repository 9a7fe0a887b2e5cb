//! Following of growing logs.
//!
//! Complete new lines, with the log's own header, are passed to the reader of the log's format, so
//! that all formats can be followed.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::record::{Record, merged};
use crate::error::{Error, Location, Result};
use crate::format;
use crate::pipeline::job::Job;
use crate::progress::Progress;
use crate::project::{Logs, Project};
use crate::sensor::Positions;

/// Interval between checks for new rows.
const POLL: Duration = Duration::from_millis(20);

/// Reads the logs until none of them has grown for `idle`.
pub(super) fn follow(
    project: &Project,
    logs: &Logs,
    idle: Duration,
    (job, progress): (&Job<'_>, &dyn Progress),
    mut add: impl FnMut(Record) -> Result<()>,
) -> Result<()> {
    let positions = logs.positions.iter().map(|log| &log.path);
    let all = positions
        .chain([&logs.imu.path])
        .chain(logs.heading.as_ref().map(|log| &log.path));
    for path in all {
        if let Ok(format) = format::detect(path)
            && (!format.is_table() || format::is_parquet(path))
        {
            let expected = "a text table: other logs cannot be followed while they grow";
            return Err(Error::format(
                path,
                Location::Whole,
                format.to_string(),
                expected,
            ));
        }
    }
    // A temporary file in the staging folder, not a result.
    let scratch = job.path("new-rows.csv");
    let outcome = (|| {
        let mut imu = Tail::new(&logs.imu.path);
        let mut heading = logs.heading.as_ref().map(|log| (log, Tail::new(&log.path)));
        let mut positions: Vec<Tail> = logs.positions.iter().map(|p| Tail::new(&p.path)).collect();
        let mut grown = Instant::now();
        loop {
            let mut new = Vec::new();
            if imu.read_new_rows(&scratch)? {
                let samples = imu.locate(format::read_imu(&scratch))?;
                new.extend(samples.into_iter().map(|mut sample| {
                    sample.time_s += logs.imu.time_offset_s;
                    Record::Imu(sample)
                }));
            }
            if let Some((log, tail)) = &mut heading
                && tail.read_new_rows(&scratch)?
            {
                let fixes = tail.locate(format::read_heading(&scratch))?;
                new.extend(fixes.into_iter().map(|mut fix| {
                    fix.time_s += log.time_offset_s;
                    Record::Heading(fix)
                }));
            }
            for (sensor, (log, tail)) in logs.positions.iter().zip(&mut positions).enumerate() {
                if tail.read_new_rows(&scratch)? {
                    let read = format::read_new_positions(&scratch, &log.observations);
                    let Positions { fixes, rejected } = tail.locate(read)?;
                    for mut row in rejected {
                        row.source = log.path.display().to_string();
                        row.line = tail.line(row.line);
                        let name = &logs.settings.positions[sensor].name;
                        progress.say(&format!("{name}: rejected {row}"));
                    }
                    new.extend(fixes.into_iter().map(|mut fix| {
                        fix.time_s += log.time_offset_s;
                        fix.position_m -= project.origin_m;
                        Record::Position(sensor, fix)
                    }));
                }
            }
            if new.is_empty() {
                progress.check()?;
                if grown.elapsed() >= idle {
                    let heading = heading.iter().map(|(_, tail)| tail);
                    let tails = [&imu].into_iter().chain(heading).chain(&positions);
                    for tail in tails.filter(|tail| !tail.partial.trim_ascii().is_empty()) {
                        let path = tail.path.display();
                        progress.warn(&format!(
                            "{path}: the last line has no end and was left out"
                        ));
                    }
                    return Ok(());
                }
                std::thread::sleep(POLL);
                continue;
            }
            grown = Instant::now();
            merged(new).into_iter().try_for_each(&mut add)?;
        }
    })();
    // A remaining file would become a result.
    let _ = std::fs::remove_file(&scratch);
    outcome
}

/// A growing log and the position up to which it has been read.
struct Tail {
    path: PathBuf,
    read: u64,
    /// An incomplete last line.
    partial: Vec<u8>,
    /// Lines up to the first that is not a comment.
    header: Vec<u8>,
    header_lines: u64,
    has_header: bool,
    /// Number of lines before the last rows that were read, including the header.
    lines: u64,
    new_lines: u64,
}

impl Tail {
    fn new(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
            read: 0,
            partial: Vec::new(),
            header: Vec::new(),
            header_lines: 0,
            has_header: false,
            lines: 0,
            new_lines: 0,
        }
    }

    /// Writes the header and the new rows to `scratch`; false without new rows.
    fn read_new_rows(&mut self, scratch: &Path) -> Result<bool> {
        let fail = |error| Error::io(&self.path, error);
        let mut file = File::open(&self.path).map_err(fail)?;
        let length = file.metadata().map_err(fail)?.len();
        if length < self.read {
            return Err(Error::format(
                &self.path,
                Location::Whole,
                "a file that has become shorter",
                "a log that only grows",
            ));
        }
        if length == self.read {
            return Ok(false);
        }
        file.seek(SeekFrom::Start(self.read)).map_err(fail)?;
        let before = self.partial.len();
        file.take(length - self.read)
            .read_to_end(&mut self.partial)
            .map_err(fail)?;
        self.read += (self.partial.len() - before) as u64;
        self.lines += self.new_lines;
        self.new_lines = 0;
        let Some(end) = self.partial.iter().rposition(|&byte| byte == b'\n') else {
            return Ok(false);
        };
        let rest = self.partial.split_off(end + 1);
        let lines = std::mem::replace(&mut self.partial, rest);
        let mut rows = Vec::with_capacity(lines.len());
        for line in lines.split_inclusive(|&byte| byte == b'\n') {
            let text = line.trim_ascii();
            let remark = text.is_empty() || text.starts_with(b"#");
            if self.has_header {
                rows.extend_from_slice(line);
                self.new_lines += 1;
                continue;
            }
            // If a comment names the columns, the first row consists of numbers.
            let starts = text
                .first()
                .is_some_and(|c| c.is_ascii_digit() || b"+-.".contains(c));
            if !remark && starts && self.header_lines > 0 {
                self.has_header = true;
                rows.extend_from_slice(line);
                self.new_lines += 1;
                continue;
            }
            self.header.extend_from_slice(line);
            self.header_lines += 1;
            self.lines += 1;
            self.has_header = !remark;
        }
        if rows.iter().all(u8::is_ascii_whitespace) {
            return Ok(false);
        }
        let text = [self.header.as_slice(), &rows].concat();
        std::fs::write(scratch, text).map_err(|error| Error::io(scratch, error))?;
        Ok(true)
    }

    /// The line number in the log of a line number in `scratch`.
    fn line(&self, line: u64) -> u64 {
        line.saturating_sub(self.header_lines) + self.lines
    }

    /// Makes errors of reading `scratch` name the log and its line.
    fn locate<T>(&self, read: Result<T>) -> Result<T> {
        read.map_err(|error| match error {
            Error::Format {
                at: Location::Line(line),
                found,
                expected,
                ..
            } => Error::format(&self.path, Location::Line(self.line(line)), found, expected),
            Error::Format {
                at,
                found,
                expected,
                ..
            } => Error::format(&self.path, at, found, expected),
            other => other,
        })
    }
}
