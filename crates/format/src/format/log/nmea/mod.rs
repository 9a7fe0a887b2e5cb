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
//! Records whose date lies a month or more from that of most records are left out: their receiver did not know the date
//! yet.
//!
//! HDT and THS have no time. A receiver sends the sentences of an epoch in one burst, so that **a
//! heading has the time of the nearest GGA (with a fix), ZDA or valid RMC before it**; a receiver
//! that sends the heading first must be configured to send one of them before it. A second heading
//! without a new time in between is skipped: its time is unknown. PASHR, PTNL,AVR and KSXT have
//! their own time.

mod clock;
mod fields;
mod heading;
mod place;
mod positions;
mod sentence;
mod skipped;
#[cfg(test)]
mod tests;

use std::path::Path;

use self::clock::{Clock, Moment};
use self::fields::{Heading, KSXT, Place, Sentence, Useless};
use self::positions::{read_position_log, read_positions};
use self::sentence::{for_each_piece, parse, pieces};
use self::skipped::{Skipped, UNDATED, WITHOUT_FIX, WITHOUT_TIME};
use crate::error::{Error, Location, Result};
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::left_out::{DAMAGED, NOT_FIXED, WRONG_CHECKSUM};
use crate::format::text::civil::DAY_S;
use crate::sensor::{HeadingFix, Timed};

/// Times since 1970 are larger than those of a log without a date, seconds.
const LONGEST_LOG_S: f64 = 1e7;

pub(crate) const LOG: Kind = Kind {
    signature: Some(|start| looks_like(start.bytes)),
    heading: Some(read_heading),
    geographic: Some(read_positions),
    record_ends: Some(record_ends),
    contents: Some(contents),
    note: "a heading without a time of its own is given that of the sentence before it: if the receiver \
           sends headings first, they are one epoch early (time_offset_s)",
    frame: Frame::Fixed(
        "degrees and metres (the format); latitude, longitude, height in the datum of the receiver; headings clockwise from true north",
    ),
    ..Kind::new("nmea", "log of headings and positions (NMEA 0183)")
};

/// The content of a log.
#[derive(Debug, Clone, PartialEq)]
struct NmeaLog<T> {
    /// Records in the order of the log.
    records: Vec<T>,
    /// Numbers of skipped sentences.
    skipped: Skipped,
}

/// Passes every useful sentence of a log to `take`.
fn scan(input: &Input, mut take: impl FnMut(Sentence, &mut Skipped)) -> Result<Skipped> {
    scan_to(input, |_, sentence, skipped| take(sentence, skipped))
}

/// Like [`scan`]; also passes the end of each sentence's line, in bytes from the start of the file.
fn scan_to(input: &Input, mut take: impl FnMut(u64, Sentence, &mut Skipped)) -> Result<Skipped> {
    let mut skipped = Skipped::default();
    let mut has_checksums = false;
    for_each_piece(input, |end, piece| {
        let (has_checksum, sentence) = parse(piece);
        match sentence {
            Ok(_) if has_checksums && !has_checksum => skipped.lost.add(DAMAGED),
            Ok((sentence, other)) => {
                take(end, sentence, &mut skipped);
                if let Some(other) = other {
                    take(end, other, &mut skipped);
                }
            }
            Err(Useless::Other) => skipped.other += 1,
            Err(Useless::WrongChecksum) => skipped.lost.add(WRONG_CHECKSUM),
            Err(Useless::Damaged) => skipped.lost.add(DAMAGED),
        }
        has_checksums |= has_checksum;
    })?;
    Ok(skipped)
}

/// Whether these could be the first bytes of a log: they contain a sentence with its checksum, or
/// begin with a known sentence without one.
fn looks_like(start: &[u8]) -> bool {
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
fn no_records(path: &Path, skipped: &Skipped, expected: &str) -> Error {
    Error::format(path, Location::Whole, skipped.to_string(), expected)
}

/// Reads the headings of a log and counts skipped sentences. Of the sentences with headings, only the most frequent
/// one is used. PASHR gives standard deviations; PASHR, PTNL,AVR and KSXT give the pitch as well.
///
/// # Errors
/// No heading with a time; more headings without a time of their own than with one.
fn read_heading_log(input: &Input) -> Result<NmeaLog<HeadingFix>> {
    let mut clock = Clock::default();
    let mut epoch = None;
    let mut by_sentence: [Vec<(Moment, Heading)>; 5] = Default::default();
    let mut late = [0; 5];
    let mut skipped = scan(input, |sentence, skipped| match sentence {
        // KSXT has its own heading, and may come after that of another sentence in its burst.
        Sentence::Position(Place { kind: KSXT, .. }) => {}
        Sentence::Position(place) => epoch = Some(clock.at_maybe(place.second_s, place.date)),
        Sentence::Date(second_s, date) => epoch = Some(clock.at_date(second_s, date)),
        Sentence::Heading(kind, heading) => {
            let moment = heading.second_s.map_or(epoch, |second_s| {
                Some(clock.at_maybe(second_s, heading.date))
            });
            let last = by_sentence[kind].last().map(|(moment, _)| *moment);
            match moment.filter(|moment| last != Some(*moment)) {
                Some(moment) => by_sentence[kind].push((moment, heading)),
                None => late[kind] += 1,
            }
        }
        Sentence::NoHeading => skipped.lost.add(WITHOUT_FIX),
        Sentence::NotFixed => skipped.lost.add(NOT_FIXED),
        Sentence::NoPosition | Sentence::NoDate | Sentence::NoAccuracy | Sentence::Accuracy(..) => {
        }
    })?;
    // If two are equally frequent, the last one wins: PASHR before THS before HDT.
    let kind = (0..by_sentence.len())
        .max_by_key(|kind| (by_sentence[*kind].len(), late[*kind]))
        .unwrap_or(0);
    let without_time = late[kind];
    skipped.lost.add_all(WITHOUT_TIME, without_time);
    let headings = std::mem::take(&mut by_sentence[kind]);
    skipped.other += by_sentence
        .iter()
        .map(|other| other.len() as u64)
        .sum::<u64>();
    if headings.is_empty() {
        let expected = "headings (HDT, THS, PASHR, PTNL,AVR or KSXT) with times (GGA, ZDA or RMC before each, or \
                        their own)";
        return Err(no_records(input.path(), &skipped, expected));
    }
    if without_time > headings.len() as u64 {
        let found = format!(
            "{} headings, {} of them without a time of their own",
            headings.len() as u64 + without_time,
            without_time
        );
        let expected = "a GGA, ZDA or RMC before every heading";
        return Err(Error::format(
            input.path(),
            Location::Whole,
            found,
            expected,
        ));
    }
    let mut undated = 0;
    let headings = clock.date(headings, &mut undated);
    skipped.lost.add_all(UNDATED, undated);
    let records = headings.into_iter().map(|(time_s, heading)| HeadingFix {
        time_s,
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
fn read_heading(input: &Input) -> Result<Vec<HeadingFix>> {
    let log = read_heading_log(input)?;
    remark_on_midnight(input, &log.records);
    log.skipped.lost.remark(input, "NMEA sentences");
    Ok(log.records)
}

/// The names of the sentences with positions and with headings, by their numbers.
const PLACES: [&str; 3] = ["GGA", "PTNL,GGK", "KSXT"];
const HEADINGS: [&str; 5] = ["HDT", "THS", "PASHR", "PTNL,AVR", "KSXT"];

/// How many positions and headings the log has by their sentences. What the positions leave open is remarked, too, since
/// they are not summarised beside headings.
fn contents(input: &Input) -> Result<String> {
    let (mut places, mut headings) = ([0u64; PLACES.len()], [0u64; HEADINGS.len()]);
    scan(input, |sentence, _| match sentence {
        Sentence::Position(place) => places[place.kind] += 1,
        Sentence::Heading(kind, _) => headings[kind] += 1,
        _ => {}
    })?;
    if places.iter().any(|count| *count > 0) {
        let _ = read_position_log(input);
    }
    let listed = |what: &str, names: &[&str], counts: &[u64]| {
        let counts = names.iter().zip(counts).filter(|(_, count)| **count > 0);
        let counts: Vec<String> = counts.map(|(name, n)| format!("{n} {name}")).collect();
        (!counts.is_empty()).then(|| format!("{what}: {}", counts.join(", ")))
    };
    let all = [
        listed("positions", &PLACES, &places),
        listed("headings", &HEADINGS, &headings),
    ];
    let all: Vec<String> = all.into_iter().flatten().collect();
    Ok(if all.is_empty() {
        "no positions and no headings".to_owned()
    } else {
        all.join("; ")
    })
}

/// Says of a log without a date that it passes midnight.
fn remark_on_midnight<T: Timed>(input: &Input, records: &[T]) {
    let last_s = records
        .iter()
        .map(T::time_s)
        .fold(f64::NEG_INFINITY, f64::max);
    if (DAY_S..LONGEST_LOG_S).contains(&last_s) {
        input.remark("the log has no date and passes midnight: its times continue past 86400 s");
    }
}

/// The end of the line of each sentence with a time, in bytes from the start of the file, and that time.
fn record_ends(input: &Input) -> Result<Vec<(u64, f64)>> {
    let mut clock = Clock::default();
    let mut ends: Vec<(Moment, u64)> = Vec::new();
    scan_to(input, |end, sentence, _| {
        let moment = match sentence {
            Sentence::Position(place) => Some(clock.at_maybe(place.second_s, place.date)),
            Sentence::Date(second_s, date) => Some(clock.at_date(second_s, date)),
            Sentence::Heading(_, heading) => heading
                .second_s
                .map(|second_s| clock.at_maybe(second_s, heading.date)),
            Sentence::Accuracy(..)
            | Sentence::NoAccuracy
            | Sentence::NoPosition
            | Sentence::NoHeading
            | Sentence::NotFixed
            | Sentence::NoDate => None,
        };
        ends.extend(moment.map(|moment| (moment, end)));
    })?;
    // A KSXT has two contents.
    ends.dedup();
    let ends = clock.date(ends, &mut 0).into_iter();
    Ok(ends.map(|(time_s, end)| (end, time_s)).collect())
}
