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
    fn warn(
        &mut self,
        name: &str,
        remarks: impl IntoIterator<Item = String>,
        progress: &dyn Progress,
    ) {
        for remark in remarks {
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
    let log = |sensor, name: &str, path, offset_s| Log {
        sensor,
        name: name.to_owned(),
        offset_s,
        table: GrowingTable::in_pieces(path, PIECE),
        times: Continued::default(),
        waiting: Vec::new(),
    };
    let imu = &logs.imu;
    let mut all = vec![log(Sensor::Imu, "imu", &imu.path, imu.time_offset_s)];
    let heading = logs.heading.as_ref();
    all.extend(heading.map(|of| log(Sensor::Heading, "heading", &of.path, of.time_offset_s)));
    for (sensor, position) in logs.positions.iter().enumerate() {
        let name = &logs.settings.positions[sensor].name;
        let offset_s = position.time_offset_s;
        all.push(log(
            Sensor::Position(sensor),
            name,
            &position.path,
            offset_s,
        ));
    }
    let mut remarks = Remarks::default();
    let mut grown = Instant::now();
    let mut imu_s = None;
    loop {
        for log in &mut all {
            match (log.sensor, imu_s) {
                (Sensor::Imu, _) => {
                    log.read(feed, &mut remarks, progress)?;
                    imu_s = log.last_s().or(imu_s);
                }
                (_, Some(imu_s)) => {
                    log.join(imu_s);
                    remarks.warn(&log.name, log.times.remark_on_side(), progress);
                    log.read(feed, &mut remarks, progress)?;
                }
                (_, None) => {
                    if log.read_on(feed, &mut remarks, progress)? {
                        grown = Instant::now();
                    }
                }
            }
        }
        // A log of which more is left to read may still have records up to its last time.
        let incomplete = all.iter().filter(|log| log.table.has_more());
        let until_s = incomplete
            .filter_map(Log::last_s)
            .fold(f64::INFINITY, f64::min);
        // Before the IMU begins, it is open on which side of midnight the others are.
        let until_s = imu_s.map_or(f64::NEG_INFINITY, |_| until_s);
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
                let mut rest = all.iter_mut().flat_map(|log| log.take(f64::INFINITY));
                return rest.try_for_each(&mut add);
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
    /// Common time = time in the log + this, seconds.
    offset_s: f64,
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
        while self.waiting.is_empty() && self.read_on(feed, remarks, progress)? {}
        Ok(())
    }

    /// Reads the next records to those that are waiting; returns whether the log has grown.
    fn read_on(
        &mut self,
        feed: Feed<'_>,
        remarks: &mut Remarks,
        progress: &dyn Progress,
    ) -> Result<bool> {
        let Some(rows) = self.table.new_rows()? else {
            return Ok(false);
        };
        let records = self.records(feed, &rows, progress);
        let records = records.map_err(|error| self.table.locate(error))?;
        self.waiting.extend(records);
        remarks.warn(&self.name, rows.remarks(), progress);
        Ok(true)
    }

    /// Puts the log on the side of midnight, or of the end of the week, on which that of the IMU is at this time, seconds.
    fn join(&mut self, imu_s: f64) {
        let shift_s = self.times.join(imu_s - self.offset_s);
        for record in &mut self.waiting {
            *record.time_s_mut() += shift_s;
        }
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
