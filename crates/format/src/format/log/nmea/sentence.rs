//! NMEA 0183 sentences: framing, checksums and dates.

use std::io::{BufRead, BufReader, Read};

use super::fields::{Sentence, Useless, digits, second_s};
use super::heading::{avr, hdt, heading_of_ksxt, pashr, ths};
use super::place::{gga, ggk, gst, place_of_ksxt};
use crate::error::{Error, Result};
use crate::format::input::Input;
use crate::format::log::novatel;
use crate::format::text::civil::days_since_1970;

/// Sentences have at most 82 characters; the limit keeps binary files from filling the memory.
const LONGEST_LINE: u64 = 1 << 16;

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

/// Whether a checksum is that of a sentence: the exclusive or of its bytes, or for receivers of ComNav, which write eight
/// digits, the checksum of NovAtel's messages. `None` if it is no number.
fn is_sum(body: &[u8], digits: &[u8]) -> Option<bool> {
    let count = digits.iter().take_while(|b| b.is_ascii_hexdigit()).count();
    let digits = digits.get(..if count == 8 { 8 } else { 2 })?;
    // The conversion also accepts a sign.
    let digits = std::str::from_utf8(digits).ok().filter(|_| count >= 2)?;
    let sum = u32::from_str_radix(digits, 16).ok()?;
    Some(if digits.len() == 8 {
        sum == novatel::sum(body)
    } else {
        sum == body.iter().fold(0, |sum, byte| sum ^ u32::from(*byte))
    })
}

/// Verifies the checksum of a sentence, if it has one, and parses the sentence. The first value tells
/// whether it has a checksum. Only KSXT has two contents, a position and a heading.
pub(super) fn parse(
    piece: &[u8],
) -> (
    bool,
    std::result::Result<(Sentence, Option<Sentence>), Useless>,
) {
    let star = piece.iter().position(|byte| *byte == b'*');
    let (body, sum) = match star {
        Some(star) => (&piece[..star], &piece[star + 1..]),
        None => (piece, &piece[..0]),
    };
    let Ok(body) = std::str::from_utf8(body) else {
        return (false, Err(Useless::Other));
    };
    let mut fields = body.split(',');
    let address = fields.next().unwrap_or_default();
    let is_address =
        matches!(address.len(), 4..=5) && address.bytes().all(|b| b.is_ascii_alphanumeric());
    if !is_address {
        return (false, Err(Useless::Other));
    }
    if star.is_some() {
        match is_sum(body.as_bytes(), sum) {
            None => return (false, Err(Useless::Damaged)),
            Some(false) => return (true, Err(Useless::WrongChecksum)),
            Some(true) => {}
        }
    }
    let fields: Vec<&str> = fields.map(str::trim_ascii).collect();
    let sentence = match (address, address.get(2..).unwrap_or_default()) {
        ("KSXT", _) => {
            let both = place_of_ksxt(&fields).zip(heading_of_ksxt(&fields).map(Some));
            return (star.is_some(), both.ok_or(Useless::Damaged));
        }
        ("PTNL", _) if fields.first() == Some(&"AVR") => avr(&fields),
        ("PTNL", _) if fields.first() == Some(&"GGK") => ggk(&fields),
        ("PASHR", _) if fields.get(2) == Some(&"T") => pashr(&fields),
        // Proprietary sentences begin with P and have no talker.
        (proprietary, _) if proprietary.starts_with('P') => {
            return (star.is_some(), Err(Useless::Other));
        }
        (short, _) if short.len() == 4 => return (star.is_some(), Err(Useless::Other)),
        (_, "GGA") => gga(&fields),
        (_, "GST") => gst(&fields),
        (_, "HDT") => hdt(&fields),
        (_, "THS") => ths(&fields),
        (_, "ZDA") => zda(&fields),
        (_, "RMC") => rmc(&fields),
        _ => return (star.is_some(), Err(Useless::Other)),
    };
    let sentence = sentence.map(|sentence| (sentence, None));
    (star.is_some(), sentence.ok_or(Useless::Damaged))
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
