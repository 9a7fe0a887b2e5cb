//! Following of growing logs.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use crate::error::{Error, Location, Result};
use crate::feed::{Feed, log_clock};
use crate::format::{self, GrowingTable, Input};
use crate::progress::Progress;
use crate::project::Logs;
use crate::sensor::{Continued, Record};

/// Passes remarks of readers on to the user. Remarks that differ in numbers only are the same, so that a log that is
/// read in many excerpts says each thing once.
#[derive(Default)]
struct Remarks(BTreeSet<String>);

impl Remarks {
    fn warn(&mut self, name: &str, rows: &Input, progress: &dyn Progress) {
        for remark in rows.remarks() {
            let text = format!("{name}: {remark}");
            if self
                .0
                .insert(text.replace(|c: char| c.is_ascii_digit(), ""))
            {
                progress.warn(&text);
            }
        }
    }
}

/// Interval between checks for new rows.
const POLL: Duration = Duration::from_millis(20);
/// Number of bytes of a log that are read at a time.
const PIECE: u64 = 1 << 18;

/// Reads the logs until none of them has grown for `idle`.
pub(super) fn follow(
    feed: Feed<'_>,
    logs: &Logs,
    idle: Duration,
    progress: &dyn Progress,
    mut add: impl FnMut(Record) -> Result<()>,
) -> Result<()> {
    let positions = logs.positions.iter().map(|log| &log.path);
    let heading = logs.heading.as_ref().map(|log| &log.path);
    let paths = positions.chain([&logs.imu.path]).chain(heading);
    for input in paths.map(Input::from) {
        if let Ok(format) = format::detect(&input)
            && (!format.is_table() || input.is_parquet())
        {
            let expected = "a text table: other logs cannot be followed while they grow";
            let found = format.to_string();
            return Err(Error::format(
                input.path(),
                Location::Whole,
                found,
                expected,
            ));
        }
    }
    let log = |sensor, name: &str, path| Log {
        sensor,
        name: name.to_owned(),
        table: GrowingTable::in_pieces(path, PIECE),
        times: Continued::default(),
        waiting: Vec::new(),
    };
    let mut all = vec![log(Sensor::Imu, "imu", &logs.imu.path)];
    all.extend(heading.map(|path| log(Sensor::Heading, "heading", path)));
    for (sensor, position) in logs.positions.iter().enumerate() {
        let name = &logs.settings.positions[sensor].name;
        all.push(log(Sensor::Position(sensor), name, &position.path));
    }
    let mut remarks = Remarks::default();
    let mut grown = Instant::now();
    loop {
        for log in &mut all {
            log.read(feed, &mut remarks, progress)?;
        }
        // A log of which more is left to read may still have records up to its last time.
        let incomplete = all.iter().filter(|log| log.table.has_more());
        let until_s = incomplete
            .filter_map(Log::last_s)
            .fold(f64::INFINITY, f64::min);
        let mut new: Vec<Record> = all.iter_mut().flat_map(|log| log.take(until_s)).collect();
        if new.is_empty() {
            progress.check()?;
            if grown.elapsed() >= idle {
                let tables = all.iter().map(|log| &log.table);
                for table in tables.filter(|table| table.has_incomplete_line()) {
                    progress.warn(&format!(
                        "{}: the last line has no end and was left out",
                        table.path().display()
                    ));
                }
                return Ok(());
            }
            std::thread::sleep(POLL);
            continue;
        }
        grown = Instant::now();
        Record::sort(&mut new);
        new.into_iter().try_for_each(&mut add)?;
    }
}

/// The sensor of a log.
#[derive(Clone, Copy)]
enum Sensor {
    Imu,
    Heading,
    Position(usize),
}

/// A log that is followed.
struct Log {
    sensor: Sensor,
    name: String,
    table: GrowingTable,
    times: Continued,
    /// Records that wait for those of other logs.
    waiting: Vec<Record>,
}

impl Log {
    /// Reads the next records, unless some are waiting.
    fn read(
        &mut self,
        feed: Feed<'_>,
        remarks: &mut Remarks,
        progress: &dyn Progress,
    ) -> Result<()> {
        while self.waiting.is_empty() {
            let Some(rows) = self.table.new_rows()? else {
                return Ok(());
            };
            let records = self.records(feed, &rows, progress);
            self.waiting = records.map_err(|error| self.table.locate(error))?;
            remarks.warn(&self.name, &rows, progress);
        }
        Ok(())
    }

    /// The records in an excerpt of the log.
    fn records(
        &mut self,
        feed: Feed<'_>,
        rows: &Input,
        progress: &dyn Progress,
    ) -> Result<Vec<Record>> {
        let times = &mut self.times;
        Ok(match self.sensor {
            Sensor::Imu => {
                let samples = feed.imu(rows, times, log_clock)?.into_iter();
                samples.map(Record::Imu).collect()
            }
            Sensor::Heading => {
                let fixes = feed.heading(rows, times, log_clock)?.into_iter();
                fixes.map(Record::Heading).collect()
            }
            Sensor::Position(sensor) => {
                let read = feed.positions(sensor, rows, times, log_clock)?;
                for mut row in read.rejected {
                    row.line = self.table.line(row.line).unwrap_or(row.line);
                    progress.say(&format!("{}: rejected {row}", self.name));
                }
                let fixes = read.fixes.into_iter();
                fixes.map(|fix| Record::Position(sensor, fix)).collect()
            }
        })
    }

    /// The last time of the waiting records, seconds; `None` without any.
    fn last_s(&self) -> Option<f64> {
        self.waiting.iter().map(Record::time_s).reduce(f64::max)
    }

    /// Takes the waiting records up to a time.
    fn take(&mut self, until_s: f64) -> Vec<Record> {
        let waiting = std::mem::take(&mut self.waiting).into_iter();
        let (taken, later) = waiting.partition(|record| record.time_s() <= until_s);
        self.waiting = later;
        taken
    }
}
