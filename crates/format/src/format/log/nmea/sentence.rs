//! NMEA 0183 sentences: framing, checksums and the fields that are used.

use std::io::{BufRead, BufReader, Read};

use crate::error::{Error, Result};
use crate::format::input::Input;
use crate::format::text::civil::{days_since_1970, second_of_day};

/// Sentences have at most 82 characters; the limit keeps binary files from filling the memory.
const LONGEST_LINE: u64 = 1 << 16;

/// Numbers of the sentences of a log that were skipped, by reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct NmeaSkipped {
    /// Sentences of other types, and lines that are not sentences.
    pub other: u64,
    /// Sentences with a wrong checksum.
    pub wrong_checksum: u64,
    /// Sentences that are cut off or have unreadable fields, and sentences without a checksum in a
    /// log that has checksums.
    pub damaged: u64,
    /// Positions and headings that the receiver marks as invalid or leaves empty.
    pub without_fix: u64,
    /// Positions without the separation of geoid and ellipsoid.
    pub without_separation: u64,
    /// Headings before the first time, or after another heading with the same time.
    pub without_time: u64,
}

impl std::fmt::Display for NmeaSkipped {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{} sentences of other types, {} with a wrong checksum, {} damaged, {} without a fix, \
             {} without a geoid separation, {} headings without a time of their own",
            self.other,
            self.wrong_checksum,
            self.damaged,
            self.without_fix,
            self.without_separation,
            self.without_time
        )
    }
}

/// The reason why a sentence is skipped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Useless {
    Other,
    WrongChecksum,
    Damaged,
}

/// A heading with the other values of its sentence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Heading {
    /// Second of the day; `None` for a sentence without a time.
    pub(super) second_s: Option<f64>,
    pub(super) heading_deg: f64,
    pub(super) sigma_deg: Option<f64>,
    pub(super) pitch_deg: Option<f64>,
    pub(super) pitch_sigma_deg: Option<f64>,
}

/// The content of a sentence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Sentence {
    /// GGA with a fix: second of the day, latitude and longitude in degrees, altitude and
    /// separation in metres.
    Position(f64, [f64; 2], f64, Option<f64>),
    /// ZDA or a valid RMC: second of the day and days since 1970.
    Date(f64, i64),
    /// A heading with its sentence: 0 for HDT, 1 for THS, 2 for PASHR.
    Heading(usize, Heading),
    /// A position or heading that its sentence marks as invalid.
    NoPosition,
    NoHeading,
    /// An RMC that its receiver marks as invalid.
    NoDate,
}

/// Splits a log at line ends and dollar signs and passes every piece to `take`: a sentence without its
/// dollar sign, or other data. `take` also gets the end of the piece's line, in bytes from the start of
/// the file.
pub(super) fn for_each_piece(input: &Input, mut take: impl FnMut(u64, &[u8])) -> Result<()> {
    let (file, _) = input.open()?;
    let mut reader = BufReader::with_capacity(1 << 18, file);
    let (mut line, mut end) = (Vec::new(), 0);
    loop {
        line.clear();
        let read = (&mut reader)
            .take(LONGEST_LINE)
            .read_until(b'\n', &mut line)
            .map_err(|e| Error::io(input.path(), e))?;
        if read == 0 {
            return Ok(());
        }
        end += read as u64;
        pieces(&line, |piece| take(end, piece));
    }
}

/// Like [`for_each_piece`] for bytes in memory. Text before a dollar sign in the same line, such as the
/// time of a logger, is dropped.
pub(super) fn pieces(bytes: &[u8], mut take: impl FnMut(&[u8])) {
    for line in bytes.split(|byte| matches!(byte, b'\r' | b'\n')) {
        let mut parts = line.split(|byte| *byte == b'$').map(<[u8]>::trim_ascii);
        let before = parts.next().unwrap_or_default();
        let mut is_sentence = false;
        for part in parts {
            is_sentence = true;
            take(part);
        }
        if !is_sentence && !before.is_empty() {
            take(before);
        }
    }
}

/// Verifies the checksum of a sentence, if it has one, and parses the sentence. The first value tells
/// whether it has a checksum.
pub(super) fn parse(piece: &[u8]) -> (bool, std::result::Result<Sentence, Useless>) {
    let star = piece.iter().position(|byte| *byte == b'*');
    let (body, sum) = match star {
        Some(star) => (&piece[..star], piece.get(star + 1..star + 3)),
        None => (piece, None),
    };
    let Ok(body) = std::str::from_utf8(body) else {
        return (false, Err(Useless::Other));
    };
    let mut fields = body.split(',');
    let address = fields.next().unwrap_or_default();
    let is_address = address.len() == 5 && address.bytes().all(|b| b.is_ascii_alphanumeric());
    if !is_address {
        return (false, Err(Useless::Other));
    }
    if star.is_some() {
        let sum = sum.and_then(|sum| std::str::from_utf8(sum).ok());
        // The conversion also accepts a sign.
        let sum = sum.filter(|sum| sum.bytes().all(|b| b.is_ascii_hexdigit()));
        let Some(sum) = sum.and_then(|sum| u8::from_str_radix(sum, 16).ok()) else {
            return (false, Err(Useless::Damaged));
        };
        if sum != body.bytes().fold(0, |sum, byte| sum ^ byte) {
            return (true, Err(Useless::WrongChecksum));
        }
    }
    let fields: Vec<&str> = fields.map(str::trim_ascii).collect();
    let sentence = match (address, &address[2..]) {
        ("PASHR", _) if fields.get(2) == Some(&"T") => pashr(&fields),
        // Proprietary sentences begin with P and have no talker.
        (proprietary, _) if proprietary.starts_with('P') => {
            return (star.is_some(), Err(Useless::Other));
        }
        (_, "GGA") => gga(&fields),
        (_, "HDT") => hdt(&fields),
        (_, "THS") => ths(&fields),
        (_, "ZDA") => zda(&fields),
        (_, "RMC") => rmc(&fields),
        _ => return (star.is_some(), Err(Useless::Other)),
    };
    (star.is_some(), sentence.ok_or(Useless::Damaged))
}

/// A decimal number without exponent.
fn number(text: &str) -> Option<f64> {
    let plain = text
        .bytes()
        .all(|b| b.is_ascii_digit() || matches!(b, b'.' | b'+' | b'-'));
    let value = text.parse().ok().filter(|value: &f64| value.is_finite());
    value.filter(|_| plain)
}

fn digits<T: std::str::FromStr>(text: &str) -> Option<T> {
    text.parse()
        .ok()
        .filter(|_| text.bytes().all(|b| b.is_ascii_digit()))
}

/// Parses `hhmmss.ss` to the second of the day.
fn second_s(text: &str) -> Option<f64> {
    let (hour, minute, second) = (text.get(..2)?, text.get(2..4)?, text.get(4..)?);
    let second_s = number(second).filter(|_| second.len() == 2 || second.get(2..3) == Some("."))?;
    second_of_day(digits(hour)?, digits(minute)?, second_s)
}

/// Parses `dddmm.mmm` and a hemisphere to degrees, positive to the north and east.
fn degrees(
    text: &str,
    hemisphere: &str,
    [positive, negative]: [&str; 2],
    most: f64,
) -> Option<f64> {
    let point = text.find('.').unwrap_or(text.len());
    let (whole, minutes) = text.split_at_checked(point.checked_sub(2)?)?;
    let minutes = number(minutes).filter(|minutes| (0.0..60.0).contains(minutes))?;
    let angle_deg = f64::from(digits::<u16>(whole)?) + minutes / 60.0;
    let sign = if hemisphere == positive {
        1.0
    } else if hemisphere == negative {
        -1.0
    } else {
        return None;
    };
    (angle_deg <= most).then_some(sign * angle_deg)
}

/// `time, latitude, N, longitude, E, quality, satellites, HDOP, altitude, M, separation, M, …`
fn gga(fields: &[&str]) -> Option<Sentence> {
    let &[
        time,
        lat,
        ns,
        lon,
        ew,
        quality,
        _,
        _,
        altitude,
        m,
        separation,
        ref rest @ ..,
    ] = fields
    else {
        return None;
    };
    rest.first()?;
    let quality: u8 = digits(quality).or(quality.is_empty().then_some(0))?;
    if quality == 0 {
        return Some(Sentence::NoPosition);
    }
    let position_deg = [
        degrees(lat, ns, ["N", "S"], 90.0)?,
        degrees(lon, ew, ["E", "W"], 180.0)?,
    ];
    if m != "M" {
        return None;
    }
    let separation = match (separation, rest.first()) {
        ("", _) => None,
        (separation, Some(&"M")) => Some(number(separation)?),
        _ => return None,
    };
    let (second_s, altitude_m) = (second_s(time)?, number(altitude)?);
    Some(Sentence::Position(
        second_s,
        position_deg,
        altitude_m,
        separation,
    ))
}

/// A heading in degrees, 0 to 360.
fn heading_deg(text: &str) -> Option<f64> {
    number(text).filter(|heading| (0.0..=360.0).contains(heading))
}

fn heading(kind: usize, text: &str) -> Option<Sentence> {
    let heading = Heading {
        second_s: None,
        heading_deg: heading_deg(text)?,
        sigma_deg: None,
        pitch_deg: None,
        pitch_sigma_deg: None,
    };
    Some(Sentence::Heading(kind, heading))
}

/// `heading, T`
fn hdt(fields: &[&str]) -> Option<Sentence> {
    match fields {
        ["", "T" | "", ..] => Some(Sentence::NoHeading),
        [text, "T", ..] => heading(0, text),
        _ => None,
    }
}

/// `heading, mode`: autonomous and estimated headings are measurements; manual, simulated and
/// invalid ones are not.
fn ths(fields: &[&str]) -> Option<Sentence> {
    match fields {
        [_, "M" | "S" | "V", ..] | ["", "", ..] => Some(Sentence::NoHeading),
        [text, "A" | "E", ..] => heading(1, text),
        _ => None,
    }
}

/// `time, heading, T, roll, pitch, heave, sigma of roll, of pitch, of heading, quality, …`
fn pashr(fields: &[&str]) -> Option<Sentence> {
    let &[
        time,
        heading,
        _,
        _,
        pitch,
        _,
        _,
        pitch_sigma,
        sigma,
        quality,
        ..,
    ] = fields
    else {
        return None;
    };
    if heading.is_empty() || quality == "0" {
        return Some(Sentence::NoHeading);
    }
    digits::<u8>(quality)?;
    // An empty field is valid, an unreadable field is damage; zero stands for an unknown accuracy.
    let angle = |text: &str| match text {
        "" => Some(None),
        text => number(text).filter(|angle| angle.abs() <= 90.0).map(Some),
    };
    let accuracy = |text| Some(angle(text)?.filter(|sigma| *sigma > 0.0));
    let pitch_deg = angle(pitch)?;
    let heading = Heading {
        second_s: Some(second_s(time)?),
        heading_deg: heading_deg(heading)?,
        sigma_deg: accuracy(sigma)?,
        pitch_deg,
        pitch_sigma_deg: accuracy(pitch_sigma)?.filter(|_| pitch_deg.is_some()),
    };
    Some(Sentence::Heading(2, heading))
}

/// `time, day, month, year, …`
fn zda(fields: &[&str]) -> Option<Sentence> {
    let &[time, day, month, year, ..] = fields else {
        return None;
    };
    if [time, day, month, year].contains(&"") {
        return Some(Sentence::NoDate);
    }
    let [day, month, year] = [digits(day)?, digits(month)?, digits(year)?];
    Some(Sentence::Date(
        second_s(time)?,
        days_since_1970(year, month, day)?,
    ))
}

/// `time, status, latitude, N, longitude, E, speed, course, ddmmyy, …`
fn rmc(fields: &[&str]) -> Option<Sentence> {
    let &[time, status, _, _, _, _, _, _, date, ..] = fields else {
        return None;
    };
    if status != "A" {
        return (status == "V").then_some(Sentence::NoDate);
    }
    let part = |from: usize| digits::<i64>(date.get(from..from + 2)?);
    let (day, month, year) = (part(0)?, part(2)?, part(4)?);
    if date.len() != 6 {
        return None;
    }
    // Satellite navigation began in 1980.
    let year = if year < 80 { 2000 + year } else { 1900 + year };
    Some(Sentence::Date(
        second_s(time)?,
        days_since_1970(year, month, day)?,
    ))
}
