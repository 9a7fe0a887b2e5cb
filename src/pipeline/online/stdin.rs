//! Records of all sensors as lines of one stream.

use std::io::BufRead;
use std::path::Path;

use crate::error::{Error, Location, Result};
use crate::feed::Feed;
use crate::progress::Progress;
use crate::sensor::Record;

/// Maximum length of a line, bytes.
const MAX_LINE: usize = 4096;

/// Reads all lines as [`Feed::line`] describes them; empty lines and comments (`#`) are skipped. Remarks on
/// times that started again follow at the end.
///
/// # Errors
/// A line that is not a record, with its number.
pub(super) fn read(
    feed: Feed<'_>,
    lines: &mut dyn BufRead,
    progress: &dyn Progress,
    mut add: impl FnMut(Record) -> Result<()>,
) -> Result<()> {
    let mut times = feed.stream_times();
    // Before the IMU begins, it is open on which side of midnight the others are.
    let (mut waiting, mut has_begun) = (Vec::new(), false);
    let mut line = Vec::new();
    let mut number = 0;
    loop {
        line.clear();
        number += 1;
        let mut limited = std::io::Read::take(&mut *lines, MAX_LINE as u64);
        let read = limited
            .read_until(b'\n', &mut line)
            .map_err(|error| Error::io("stdin", error))?;
        if read == 0 {
            waiting.drain(..).try_for_each(&mut add)?;
            for (sensor, remark) in feed.remarks(&times) {
                progress.warn(&format!("{sensor}: {remark}"));
            }
            return Ok(());
        }
        let fail = |found: String, expected: String| {
            Error::format(Path::new("stdin"), Location::Line(number), found, expected)
        };
        if read == MAX_LINE {
            return Err(fail(
                format!("a line of {MAX_LINE} bytes or more"),
                "a record".into(),
            ));
        }
        let text = std::str::from_utf8(&line)
            .map_err(|_| fail("bytes that are not text".into(), "text (UTF-8)".into()))?
            .trim_ascii();
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        let record = feed.line(text, &mut times, fail)?;
        if let Record::Imu(sample) = &record {
            feed.join(&mut times, sample.time_s, &mut waiting);
            waiting.drain(..).try_for_each(&mut add)?;
            has_begun = true;
        }
        if has_begun {
            add(record)?;
        } else {
            waiting.push(record);
        }
    }
}
