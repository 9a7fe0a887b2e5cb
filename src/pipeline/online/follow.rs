//! Following of growing logs.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use crate::error::{Error, Location, Result};
use crate::feed::{Feed, log_clock};
use crate::format::{self, GrowingTable, Input};
use crate::progress::Progress;
use crate::project::Logs;
use crate::sensor::{Continued, Record};

/// Passes remarks of readers on to the user. Remarks that differ in numbers only are the same, so that a log that is read
/// in many excerpts says each thing once.
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
    let log = |path| (GrowingTable::new(path, u64::MAX), Continued::default());
    let mut imu = log(&logs.imu.path);
    let mut heading = heading.map(|path| log(path));
    let mut positions: Vec<_> = logs.positions.iter().map(|p| log(&p.path)).collect();
    let mut remarks = Remarks::default();
    let mut grown = Instant::now();
    loop {
        let mut new = Vec::new();
        let (table, times) = &mut imu;
        if let Some(rows) = table.new_rows()? {
            let samples = feed.imu(&rows, times, log_clock);
            let samples = samples.map_err(|e| table.locate(e))?;
            remarks.warn("imu", &rows, progress);
            new.extend(samples.into_iter().map(Record::Imu));
        }
        if let Some((table, times)) = &mut heading
            && let Some(rows) = table.new_rows()?
        {
            let fixes = feed.heading(&rows, times, log_clock);
            let fixes = fixes.map_err(|e| table.locate(e))?;
            remarks.warn("heading", &rows, progress);
            new.extend(fixes.into_iter().map(Record::Heading));
        }
        for (sensor, (table, times)) in positions.iter_mut().enumerate() {
            let Some(rows) = table.new_rows()? else {
                continue;
            };
            let read = feed.positions(sensor, &rows, times, log_clock);
            let read = read.map_err(|e| table.locate(e))?;
            let name = &logs.settings.positions[sensor].name;
            remarks.warn(name, &rows, progress);
            for mut row in read.rejected {
                row.line = table.line(row.line).unwrap_or(row.line);
                progress.say(&format!("{name}: rejected {row}"));
            }
            let fixes = read.fixes.into_iter();
            new.extend(fixes.map(|fix| Record::Position(sensor, fix)));
        }
        if new.is_empty() {
            progress.check()?;
            if grown.elapsed() >= idle {
                let tables = [&imu].into_iter().chain(&heading).chain(&positions);
                let tables = tables.map(|(table, _)| table);
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
