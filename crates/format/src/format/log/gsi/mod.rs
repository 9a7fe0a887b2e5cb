//! GSI-8 and GSI-16 of Leica instruments: one block of words per line.
//!
//! A word of GSI-8 has 16 characters, a word of GSI-16 has 24, and a block of GSI-16 begins with
//! `*`. A word holds the index (two or three digits), flags and the unit digit in front of the sign,
//! 8 or 16 characters of data and a blank. The first word of a measurement holds the number of its
//! point and, after the index, the number of the block: `110001+00000A12 21.324+12345670
//! 22.324+10000000 31...0+00012345`.
//!
//! | index | content |
//! |---|---|
//! | 11 | point |
//! | 17 | date `DDMMYYYY` |
//! | 19 | month, day, hour, minute |
//! | 21, 22 | horizontal, vertical angle |
//! | 31 | slope distance |
//! | 58 | reflector constant |
//! | 81 to 83 | easting, northing, height of the target |
//! | 84 to 86 | easting, northing, height of the station |
//! | 87, 88 | height of the reflector, of the instrument |
//! | 560 to 562 | time `HHMMSS`, date `MMDD00`, year |
//!
//! Other words are ignored, and so are blocks without a point, which hold codes.

#[cfg(test)]
mod tests;

use std::f64::consts::TAU;

use crate::error::{Error, Location, Result};
use crate::format::file::nothing_in;
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::text::civil::{DAY_S, days_since_1970, second_of_day};
use crate::format::text::lines::Lines;
use crate::geometry::Vec3;
use crate::sensor::{Observations, PolarObservation, PositionFix, Positions};

pub(crate) const MEASUREMENTS: Kind = Kind {
    signature: Some(|start| looks_like(start.bytes)),
    positions: Some(read_positions),
    frame: Frame::Fixed(
        "units named in each word, read as metres and radians; east, north, up of the instrument, or polar about it",
    ),
    ..Kind::new("gsi", "total station log (Leica GSI)")
};

/// The international foot. Instruments set to the survey foot (2 ppm longer) write the same unit.
const FOOT_M: f64 = 0.3048;

/// One block of measurements or coordinates of a point; absent values are `None`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct GsiPoint {
    /// Number of the point without leading zeros; empty if there are only zeros.
    pub name: String,
    /// Days from 1970-01-01 to the date on the clock of the instrument.
    pub days_since_1970: Option<i64>,
    /// Seconds since midnight on the clock of the instrument; word 19 resolves only minutes.
    pub second_of_day_s: Option<f64>,
    /// Clockwise from the instrument's horizontal zero, radians.
    pub horizontal_rad: Option<f64>,
    /// From the zenith or from the horizon, as the instrument was set, radians.
    pub vertical_rad: Option<f64>,
    /// Metres, corrected as the instrument was set; `None` also for zero, which marks a missing range.
    pub slope_distance_m: Option<f64>,
    /// The additive constant of the reflector that the instrument applied, metres.
    pub reflector_constant_m: Option<f64>,
    /// Easting, northing and height of the target, metres.
    pub target_m: [Option<f64>; 3],
    /// Easting, northing and height of the station, metres.
    pub station_m: [Option<f64>; 3],
    /// Above the target, metres.
    pub reflector_height_m: Option<f64>,
    /// Above the station, metres.
    pub instrument_height_m: Option<f64>,
}

impl GsiPoint {
    /// Seconds from 1970-01-01 on the clock of the instrument, which usually shows local time;
    /// `None` if the block lacks the time or a part of the date.
    pub fn time_s(&self) -> Option<f64> {
        Some(self.days_since_1970? as f64 * DAY_S + self.second_of_day_s?)
    }
}

/// The content of a word, or the text found and the text expected.
type Outcome<T> = std::result::Result<T, (String, &'static str)>;

/// One word.
#[derive(Debug, Clone, Copy)]
struct Word<'a> {
    /// The whole word, for messages.
    text: &'a str,
    index: u16,
    unit: u8,
    is_negative: bool,
    data: &'a str,
}

const WORD: &str = "words of two or three digits of index, flags up to the sixth place, a sign, 8 \
                    characters of data (16 in lines that begin with `*`) and a blank";

impl<'a> Word<'a> {
    /// Splits a word; the first word of a block has the number of the block after its index.
    fn parse(text: &'a str, is_first: bool) -> Option<Self> {
        let (head, data) = (text.get(..7)?, text.get(7..)?);
        let bytes = head.as_bytes();
        let digits = if is_first { 2 } else { 3 };
        let index = head.get(..digits)?.trim_end_matches('.');
        let is_index = index.len() >= 2 && index.bytes().all(|b| b.is_ascii_digit());
        let has_flags = bytes[2..6].iter().all(|b| b.is_ascii_digit() || *b == b'.');
        let has_sign = matches!(bytes[6], b'+' | b'-');
        (is_index && has_flags && has_sign && !data.is_empty()).then_some(Self {
            text,
            index: index.parse().ok()?,
            unit: bytes[5],
            is_negative: bytes[6] == b'-',
            data,
        })
    }

    fn error<T>(&self, expected: &'static str) -> Outcome<T> {
        Err((format!("the word `{}`", self.text), expected))
    }

    /// The digits of the data as a number, without the sign.
    fn count(&self) -> Outcome<u64> {
        match self.data.parse() {
            Ok(count) if self.data.bytes().all(|b| b.is_ascii_digit()) => Ok(count),
            _ => self.error("digits"),
        }
    }

    fn signed(&self, value: f64) -> f64 {
        if self.is_negative { -value } else { value }
    }

    /// The data as a length, metres.
    fn length_m(&self) -> Outcome<f64> {
        let (per_unit, unit_m) = match self.unit {
            b'0' => (1e3, 1.0),
            b'1' => (1e3, FOOT_M),
            b'6' => (1e4, 1.0),
            b'7' => (1e4, FOOT_M),
            b'8' => (1e5, 1.0),
            _ => {
                return self
                    .error("a length: 0, 6 or 8 (metres), 1 or 7 (feet) in the sixth place");
            }
        };
        Ok(self.signed(self.count()? as f64 / per_unit * unit_m))
    }

    /// The data as an angle, radians.
    fn angle_rad(&self) -> Outcome<f64> {
        let count = self.count()?;
        let (value, full) = match self.unit {
            b'2' => (count as f64 / 1e5, 400.0),
            b'3' => (count as f64 / 1e5, 360.0),
            b'4' => {
                let (degrees, minutes, tenths) =
                    (count / 100_000, count / 1000 % 100, count % 1000);
                if minutes > 59 || tenths > 599 {
                    return self.error("minutes and seconds below 60");
                }
                let seconds = (degrees * 3600 + minutes * 60) as f64 + tenths as f64 / 10.0;
                (seconds, 1_296_000.0)
            }
            b'5' => (count as f64 / 1e4, 6400.0),
            _ => {
                return self.error(
                    "an angle: 2 (gon), 3 (degrees), 4 (degrees, minutes, seconds) or 5 (mil) in \
                     the sixth place",
                );
            }
        };
        Ok(self.signed(value / full * TAU))
    }

    /// The last `N` pairs of digits.
    fn pairs<const N: usize>(&self) -> Outcome<[u32; N]> {
        let mut count = self.count()?;
        let mut pairs = [0; N];
        for pair in pairs.iter_mut().rev() {
            *pair = (count % 100) as u32;
            count /= 100;
        }
        Ok(pairs)
    }
}

/// The parts of a date, which different words hold.
#[derive(Debug, Default)]
struct Date {
    year: Option<u32>,
    month_day: Option<[u32; 2]>,
}

/// Reads one block; `None` for a block of a code.
fn block(line: &str) -> Outcome<Option<GsiPoint>> {
    let (line, width) = match line.strip_prefix('*') {
        Some(line) => (line, 24),
        None => (line, 16),
    };
    let mut point = GsiPoint::default();
    let mut date = Date::default();
    let mut is_point = false;
    let mut rest = line;
    while !rest.is_empty() {
        let end = rest
            .char_indices()
            .nth(width)
            .map_or(rest.len(), |(end, _)| end);
        let (text, after) = rest.split_at(end);
        // The blank after the last word is often missing.
        let text = text.strip_suffix(' ').unwrap_or(text);
        let is_first = rest.len() == line.len();
        rest = after;
        let word = Word::parse(text, is_first).filter(|_| text.chars().count() == width - 1);
        let Some(word) = word else {
            return Err((
                format!("`{}`", text.chars().take(40).collect::<String>()),
                WORD,
            ));
        };
        if is_first {
            is_point = word.index == 11;
        }
        if is_point {
            take(&word, &mut point, &mut date)?;
        }
    }
    if let (Some(year), Some([month, day])) = (date.year, date.month_day) {
        let days = days_since_1970(year.into(), month.into(), day.into());
        let Some(days) = days else {
            return Err((format!("the date {year:04}-{month:02}-{day:02}"), "a date"));
        };
        point.days_since_1970 = Some(days);
    }
    Ok(is_point.then_some(point))
}

/// Stores the content of a word in its point.
fn take(word: &Word<'_>, point: &mut GsiPoint, date: &mut Date) -> Outcome<()> {
    let time = |hour, minute, second: u32| match second_of_day(hour, minute, second.into()) {
        Some(second_s) => Ok(Some(second_s)),
        None => word.error("a time of day"),
    };
    match word.index {
        11 => point.name = word.data.trim_start_matches('0').trim_ascii().to_owned(),
        17 => {
            let [day, month, century, year] = word.pairs()?;
            date.year = Some(100 * century + year);
            date.month_day = Some([month, day]);
        }
        19 => {
            let [month, day, hour, minute] = word.pairs()?;
            date.month_day.get_or_insert([month, day]);
            // The word 560 has the seconds as well.
            if point.second_of_day_s.is_none() {
                point.second_of_day_s = time(hour, minute, 0)?;
            }
        }
        21 => point.horizontal_rad = Some(word.angle_rad()?),
        22 => point.vertical_rad = Some(word.angle_rad()?),
        31 => point.slope_distance_m = Some(word.length_m()?).filter(|range| *range != 0.0),
        58 => point.reflector_constant_m = Some(word.length_m()?),
        index @ 81..=83 => point.target_m[usize::from(index - 81)] = Some(word.length_m()?),
        index @ 84..=86 => point.station_m[usize::from(index - 84)] = Some(word.length_m()?),
        87 => point.reflector_height_m = Some(word.length_m()?),
        88 => point.instrument_height_m = Some(word.length_m()?),
        560 => {
            let [hour, minute, second] = word.pairs()?;
            point.second_of_day_s = time(hour, minute, second)?;
        }
        561 => {
            let [month, day, _] = word.pairs()?;
            date.month_day = Some([month, day]);
        }
        562 => {
            let [century, year] = word.pairs()?;
            date.year = Some(100 * century + year);
        }
        _ => {}
    }
    Ok(())
}

/// Whether these could be the first bytes of a GSI file: the first line is a block of a point or a
/// code.
pub fn looks_like(start: &[u8]) -> bool {
    let line = start
        .split(|byte| matches!(byte, b'\r' | b'\n'))
        .find(|line| !line.trim_ascii().is_empty());
    let Some(Ok(line)) = line.map(std::str::from_utf8) else {
        return false;
    };
    let line = line.trim_start_matches('\u{feff}').trim_ascii();
    let index = line.strip_prefix('*').unwrap_or(line).get(..2);
    matches!(index, Some("11" | "41")) && block(line).is_ok()
}

/// Reads the points of a GSI file in the order of the file.
///
/// # Errors
/// Words of another width or form, units that do not fit their word, dates and times that do not
/// exist, no points.
pub fn read(input: &Input) -> Result<Vec<GsiPoint>> {
    let mut lines = Lines::open(input)?;
    let mut points = Vec::new();
    while lines.advance()? {
        match block(lines.text()) {
            Ok(point) => points.extend(point),
            Err((found, expected)) => return Err(lines.error(found, expected)),
        }
    }
    if points.is_empty() {
        return Err(nothing_in(input.path(), "point"));
    }
    Ok(points)
}

/// Reads the positions of the prism, which are those of the targets with the height of the reflector, or, with [`Observations::Polar`], their polar observations. Blocks
/// without these, such as those of the station, are left out.
///
/// # Errors
/// Those of [`read`]; a target without a time, no target.
pub fn read_positions(input: &Input, observations: &Observations) -> Result<Positions> {
    let error = |positions: String, expected: &str| {
        Err(Error::format(
            input.path(),
            Location::Whole,
            positions,
            expected,
        ))
    };
    let mut positions = Positions::default();
    let mut raised = 0;
    for point in read(input)? {
        let fix = match observations {
            Observations::Polar(instrument) => polar(&point).map(|o| instrument.position_fix(&o)),
            _ => cartesian(&point).inspect(|_| {
                raised += u64::from(
                    point
                        .reflector_height_m
                        .is_some_and(|height_m| height_m != 0.0),
                );
            }),
        };
        let Some(fix) = fix else { continue };
        let Some(time_s) = point.time_s() else {
            return error(
                match point.name.as_str() {
                    "" => "a point without a number, and without date and time".to_owned(),
                    name => format!("point {name} without date and time"),
                },
                "words 560, 561 and 562, or 17 and 19, in every block",
            );
        };
        positions.fixes.push(PositionFix { time_s, ..fix });
    }
    if raised > 0 {
        input.remark(format!(
            "the height of the reflector (word 87) is added to the heights of {raised} of {} targets, which lie below the \
             prism",
            positions.fixes.len()
        ));
    }
    match (positions.fixes.is_empty(), observations) {
        (false, _) => Ok(positions),
        (true, Observations::Polar(_)) => error(
            "no block with words 21, 22 and 31".into(),
            "angles and slope distances",
        ),
        (true, _) => error(
            "no block with words 81, 82 and 83".into(),
            "coordinates of targets; for polar observations give station_m and \
             station_orientation_deg in the project",
        ),
    }
}

/// The position of the prism: its target, which is a point on the ground, and the height of the reflector above it.
fn cartesian(point: &GsiPoint) -> Option<PositionFix> {
    let [east, north, up] = point.target_m;
    let up_m = up? + point.reflector_height_m.unwrap_or(0.0);
    let position_m = Vec3::new(east?, north?, up_m);
    Some(PositionFix::with_sigma(0.0, position_m, None))
}

fn polar(point: &GsiPoint) -> Option<PolarObservation> {
    Some(PolarObservation {
        time_s: 0.0,
        slope_distance_m: point.slope_distance_m?,
        horizontal_rad: point.horizontal_rad?,
        vertical_rad: point.vertical_rad?,
    })
}
