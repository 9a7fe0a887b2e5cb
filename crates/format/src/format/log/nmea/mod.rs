//! Headings and positions from logs of NMEA 0183 sentences from any talker.
//!
//! Logs are recorded from a serial line: unknown sentences, binary data, half sentences and wrong
//! checksums are skipped and counted. Sentences without a checksum are read unless an earlier
//! sentence had one: then they must have been cut off.
//!
//! # Times
//! Once a ZDA or a valid RMC gives the date, all times, also earlier ones, are seconds of the Unix
//! epoch in UTC. In a log without a date they are seconds of the UTC day of the first time, and
//! continue above 86400 after midnight: a time that is more than half a day earlier than the one
//! before it belongs to the next day.
//!
//! HDT and THS have no time. A receiver sends the sentences of an epoch in one burst, so that **a
//! heading has the time of the nearest GGA (with a fix), ZDA or valid RMC before it**; a receiver
//! that sends the heading first must be configured to send one of them before it. A second heading
//! without a new time in between is skipped: its time is unknown. PASHR has its own time.

mod sentence;
#[cfg(test)]
mod tests;

use std::path::Path;

pub use self::sentence::NmeaSkipped;
use self::sentence::{Heading, Sentence, Useless, for_each_piece, parse, pieces};
use crate::error::{Error, Location, Result};
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::text::civil::DAY_S;
use crate::sensor::{GeographicFix, HeadingFix};

pub(crate) const LOG: Kind = Kind {
    signature: Some(|start| looks_like(start.bytes)),
    heading: Some(read_heading),
    geographic: Some(read_positions),
    record_ends: Some(record_ends),
    note: "a heading without a time of its own is given that of the sentence before it: if the receiver \
           sends headings first, they are one epoch early (time_offset_s)",
    frame: Frame::Fixed(
        "degrees and metres (the format); latitude, longitude, height in the datum of the receiver; headings clockwise from true north",
    ),
    ..Kind::new("nmea", "log of headings and positions (NMEA 0183)")
};

/// The content of a log.
#[derive(Debug, Clone, PartialEq)]
pub struct NmeaLog<T> {
    /// Records in the order of the log.
    pub records: Vec<T>,
    /// Numbers of skipped sentences.
    pub skipped: NmeaSkipped,
}

/// A time: the day, counted from the first day of the log, and the second of the day.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Moment {
    day: i64,
    second_s: f64,
}

/// The clock of a log.
#[derive(Debug, Default)]
struct Clock {
    last: Option<Moment>,
    /// Days from 1970 to day 0, once known.
    day_0: Option<i64>,
}

/// If a time of day is this much later than the previous time, it is a late one of the previous day.
const LATE_S: f64 = 23.0 * 3600.0;

impl Clock {
    /// The moment of the next time of day in the log.
    fn at(&mut self, second_s: f64) -> Moment {
        let day = self.last.map_or(0, |last| match second_s - last.second_s {
            step_s if step_s < -0.5 * DAY_S => last.day + 1,
            step_s if step_s > LATE_S => last.day - 1,
            _ => last.day,
        });
        let moment = Moment { day, second_s };
        self.last = Some(moment);
        moment
    }

    /// Like [`at`](Self::at), with a known date in days since 1970.
    fn at_date(&mut self, second_s: f64, date: i64) -> Moment {
        let mut moment = self.at(second_s);
        let day_0 = *self.day_0.get_or_insert(date - moment.day);
        moment.day = date - day_0;
        self.last = Some(moment);
        moment
    }

    fn time_s(&self, moment: Moment) -> f64 {
        (self.day_0.unwrap_or(0) + moment.day) as f64 * DAY_S + moment.second_s
    }
}

/// Passes every useful sentence of a log to `take`.
fn scan(input: &Input, mut take: impl FnMut(Sentence, &mut NmeaSkipped)) -> Result<NmeaSkipped> {
    scan_to(input, |_, sentence, skipped| take(sentence, skipped))
}

/// Like [`scan`]; also passes the end of each sentence's line, in bytes from the start of the file.
fn scan_to(
    input: &Input,
    mut take: impl FnMut(u64, Sentence, &mut NmeaSkipped),
) -> Result<NmeaSkipped> {
    let mut skipped = NmeaSkipped::default();
    let mut has_checksums = false;
    for_each_piece(input, |end, piece| {
        let (has_checksum, sentence) = parse(piece);
        match sentence {
            Ok(_) if has_checksums && !has_checksum => skipped.damaged += 1,
            Ok(sentence) => take(end, sentence, &mut skipped),
            Err(Useless::Other) => skipped.other += 1,
            Err(Useless::WrongChecksum) => skipped.wrong_checksum += 1,
            Err(Useless::Damaged) => skipped.damaged += 1,
        }
        has_checksums |= has_checksum;
    })?;
    Ok(skipped)
}

/// Whether these could be the first bytes of a log: they contain a sentence with its checksum, or
/// begin with a known sentence without one.
pub fn looks_like(start: &[u8]) -> bool {
    let (mut count, mut is_log) = (0, false);
    pieces(start, |piece| {
        let (has_checksum, sentence) = parse(piece);
        let intact = !matches!(sentence, Err(Useless::WrongChecksum | Useless::Damaged));
        is_log |= has_checksum && intact || count == 0 && sentence.is_ok();
        count += 1;
    });
    is_log
}

/// The error for a log without the wanted records.
fn no_records(path: &Path, skipped: &NmeaSkipped, expected: &str) -> Error {
    let found = format!("only {skipped}");
    Error::format(path, Location::Whole, found, expected)
}

/// Reads the headings of a log and counts skipped sentences. Of PASHR, THS and HDT, only the most
/// frequent sentence is used. PASHR gives standard deviations and the pitch as well.
///
/// # Errors
/// No heading with a time; more headings without a time of their own than with one.
pub fn read_heading_log(input: &Input) -> Result<NmeaLog<HeadingFix>> {
    let mut clock = Clock::default();
    let mut epoch = None;
    let mut by_sentence: [Vec<(Moment, Heading)>; 3] = Default::default();
    let mut late = [0; 3];
    let mut skipped = scan(input, |sentence, skipped| match sentence {
        Sentence::Position(second_s, ..) => epoch = Some(clock.at(second_s)),
        Sentence::Date(second_s, date) => epoch = Some(clock.at_date(second_s, date)),
        Sentence::Heading(kind, heading) => {
            let moment = heading
                .second_s
                .map_or(epoch, |second_s| Some(clock.at(second_s)));
            let last = by_sentence[kind].last().map(|(moment, _)| *moment);
            match moment.filter(|moment| last != Some(*moment)) {
                Some(moment) => by_sentence[kind].push((moment, heading)),
                None => late[kind] += 1,
            }
        }
        Sentence::NoHeading => skipped.without_fix += 1,
        Sentence::NoPosition | Sentence::NoDate => {}
    })?;
    // If two are equally frequent, the last one wins: PASHR before THS before HDT.
    let kind = (0..3)
        .max_by_key(|kind| (by_sentence[*kind].len(), late[*kind]))
        .unwrap_or(0);
    skipped.without_time = late[kind];
    let headings = std::mem::take(&mut by_sentence[kind]);
    skipped.other += by_sentence
        .iter()
        .map(|other| other.len() as u64)
        .sum::<u64>();
    if headings.is_empty() {
        let expected = "headings (HDT, THS or PASHR) behind times (GGA, ZDA or RMC)";
        return Err(no_records(input.path(), &skipped, expected));
    }
    if skipped.without_time > headings.len() as u64 {
        let found = format!(
            "{} headings, {} of them without a time of their own",
            headings.len() as u64 + skipped.without_time,
            skipped.without_time
        );
        let expected = "a GGA, ZDA or RMC before every heading";
        return Err(Error::format(
            input.path(),
            Location::Whole,
            found,
            expected,
        ));
    }
    let records = headings.into_iter().map(|(moment, heading)| HeadingFix {
        time_s: clock.time_s(moment),
        heading_rad: heading.heading_deg.to_radians(),
        sigma_rad: heading.sigma_deg.map(f64::to_radians),
        pitch_rad: heading.pitch_deg.map(f64::to_radians),
        pitch_sigma_rad: heading.pitch_sigma_deg.map(f64::to_radians),
    });
    let records = records.collect();
    Ok(NmeaLog { records, skipped })
}

/// Reads the headings of a log: see [`read_heading_log`].
///
/// # Errors
/// Those of [`read_heading_log`].
pub fn read_heading(input: &Input) -> Result<Vec<HeadingFix>> {
    Ok(read_heading_log(input)?.records)
}

/// Reads the positions of a log from its GGA sentences and counts skipped sentences.
///
/// # Errors
/// No position with a fix and the separation of geoid and ellipsoid, without which the ellipsoidal height
/// is unknown.
pub fn read_position_log(input: &Input) -> Result<NmeaLog<GeographicFix>> {
    let mut clock = Clock::default();
    let mut fixes: Vec<(Moment, GeographicFix)> = Vec::new();
    let skipped = scan(input, |sentence, skipped| match sentence {
        Sentence::Position(second_s, [lat, lon], altitude_m, separation_m) => {
            let moment = clock.at(second_s);
            let Some(separation_m) = separation_m else {
                skipped.without_separation += 1;
                return;
            };
            let fix = GeographicFix {
                time_s: 0.0,
                latitude_rad: lat.to_radians(),
                longitude_rad: lon.to_radians(),
                height_m: altitude_m + separation_m,
                sigma_m: None,
            };
            fixes.push((moment, fix));
        }
        Sentence::Date(second_s, date) => {
            clock.at_date(second_s, date);
        }
        Sentence::Heading(_, heading) => {
            heading.second_s.map(|second_s| clock.at(second_s));
        }
        Sentence::NoPosition => skipped.without_fix += 1,
        Sentence::NoHeading | Sentence::NoDate => {}
    })?;
    if fixes.is_empty() {
        let expected = "positions (GGA with a fix and a geoid separation)";
        return Err(no_records(input.path(), &skipped, expected));
    }
    let records = fixes.into_iter().map(|(moment, fix)| GeographicFix {
        time_s: clock.time_s(moment),
        ..fix
    });
    let records = records.collect();
    Ok(NmeaLog { records, skipped })
}

/// Reads the positions of a log: see [`read_position_log`].
///
/// # Errors
/// Those of [`read_position_log`].
pub fn read_positions(input: &Input) -> Result<Vec<GeographicFix>> {
    Ok(read_position_log(input)?.records)
}

/// The end of the line of each sentence with a time, in bytes from the start of the file, and that time.
fn record_ends(input: &Input) -> Result<Vec<(u64, f64)>> {
    let mut clock = Clock::default();
    let mut ends: Vec<(u64, Moment)> = Vec::new();
    scan_to(input, |end, sentence, _| {
        let moment = match sentence {
            Sentence::Position(second_s, ..) => Some(clock.at(second_s)),
            Sentence::Date(second_s, date) => Some(clock.at_date(second_s, date)),
            Sentence::Heading(_, heading) => heading.second_s.map(|second_s| clock.at(second_s)),
            Sentence::NoPosition | Sentence::NoHeading | Sentence::NoDate => None,
        };
        ends.extend(moment.map(|moment| (end, moment)));
    })?;
    let times = ends.into_iter();
    Ok(times
        .map(|(end, moment)| (end, clock.time_s(moment)))
        .collect())
}
