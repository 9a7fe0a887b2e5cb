//! The content of sentences, and the numbers in their fields.

use crate::format::text::civil::{days_since_1970, second_of_day};
use crate::geometry::Vec3;
use crate::sensor::FixQuality;

/// The reason why a sentence is skipped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Useless {
    Other,
    WrongChecksum,
    Damaged,
}

/// A heading with the other values of its sentence.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Heading {
    /// Second of the day; `None` for a sentence without a time.
    pub(super) second_s: Option<f64>,
    /// Days since 1970, of a sentence with a date.
    pub(super) date: Option<i64>,
    pub(super) heading_deg: f64,
    pub(super) sigma_deg: Option<f64>,
    pub(super) pitch_deg: Option<f64>,
    pub(super) pitch_sigma_deg: Option<f64>,
}

/// The number of KSXT among the sentences with positions.
pub(super) const KSXT: usize = 2;

/// A position with the other values of its sentence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    /// Its sentence: 0 for GGA, 1 for GGK, 2 for KSXT.
    pub(super) kind: usize,
    /// Second of the day.
    pub(super) second_s: f64,
    /// Days since 1970, of a sentence with a date.
    pub(super) date: Option<i64>,
    /// Latitude and longitude.
    pub(super) place_deg: [f64; 2],
    pub(super) altitude_m: f64,
    /// Of geoid and ellipsoid.
    pub(super) separation_m: Option<f64>,
    pub(super) quality: FixQuality,
}

/// The content of a sentence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Sentence {
    /// A position with a fix.
    Position(Place),
    /// GST: second of the day and standard deviations to the east, to the north and upwards in metres.
    Accuracy(f64, Vec3),
    /// ZDA or a valid RMC: second of the day and days since 1970.
    Date(f64, i64),
    /// A heading with its sentence: 0 for HDT, 1 for THS, 2 for PASHR, 3 for PTNL,AVR, 4 for KSXT.
    Heading(usize, Heading),
    /// A position or heading that its sentence marks as invalid.
    NoPosition,
    NoHeading,
    /// A heading from carrier phases whose ambiguities are not fixed.
    NotFixed,
    /// A GST without standard deviations.
    NoAccuracy,
    /// An RMC that its receiver marks as invalid.
    NoDate,
}

/// A decimal number without exponent.
pub(super) fn number(text: &str) -> Option<f64> {
    let plain = text
        .bytes()
        .all(|b| b.is_ascii_digit() || matches!(b, b'.' | b'+' | b'-'));
    let value = text.parse().ok().filter(|value: &f64| value.is_finite());
    value.filter(|_| plain)
}

pub(super) fn digits<T: std::str::FromStr>(text: &str) -> Option<T> {
    text.parse()
        .ok()
        .filter(|_| text.bytes().all(|b| b.is_ascii_digit()))
}

/// Parses `hhmmss.ss` to the second of the day.
pub(super) fn second_s(text: &str) -> Option<f64> {
    let (hour, minute, second) = (text.get(..2)?, text.get(2..4)?, text.get(4..)?);
    let second_s = number(second).filter(|_| second.len() == 2 || second.get(2..3) == Some("."))?;
    second_of_day(digits(hour)?, digits(minute)?, second_s)
}

/// Parses `yyyymmddhhmmss.ss` to the days since 1970 and the second of the day.
pub(super) fn date_and_second(text: &str) -> Option<(i64, f64)> {
    let (date, time) = text.split_at_checked(8)?;
    let part = |from: usize, to: usize| digits::<i64>(date.get(from..to)?);
    let date = days_since_1970(part(0, 4)?, part(4, 6)?, part(6, 8)?)?;
    Some((date, second_s(time)?))
}
