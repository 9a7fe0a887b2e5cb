//! Sentences with positions and their accuracy.

use super::fields::{KSXT, Place, Sentence, date_and_second, digits, number, second_s};
use crate::format::text::civil::days_since_1970;
use crate::geometry::Vec3;
use crate::sensor::FixQuality;

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

/// Latitude and longitude in degrees.
fn place_deg([lat, ns, lon, ew]: [&str; 4]) -> Option<[f64; 2]> {
    Some([
        degrees(lat, ns, ["N", "S"], 90.0)?,
        degrees(lon, ew, ["E", "W"], 180.0)?,
    ])
}

/// `time, latitude, N, longitude, E, quality, satellites, HDOP, altitude, M, separation, M, …`
pub(super) fn gga(fields: &[&str]) -> Option<Sentence> {
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
    let quality = match quality {
        // Without a fix, by dead reckoning, or entered by hand: not measured.
        0 | 6 | 7 => return Some(Sentence::NoPosition),
        4 => FixQuality::Fixed,
        5 => FixQuality::Float,
        // 9 is SBAS of receivers by NovAtel.
        2 | 9 => FixQuality::Differential,
        _ => FixQuality::Single,
    };
    let place_deg = place_deg([lat, ns, lon, ew])?;
    if m != "M" {
        return None;
    }
    let separation_m = match (separation, rest.first()) {
        ("", _) => None,
        (separation, Some(&"M")) => Some(number(separation)?),
        _ => return None,
    };
    Some(Sentence::Position(Place {
        kind: 0,
        second_s: second_s(time)?,
        date: None,
        place_deg,
        altitude_m: number(altitude)?,
        separation_m,
        quality,
    }))
}

/// `PTNL,GGK, time, mmddyy, latitude, N, longitude, E, quality, satellites, DOP, EHT…, M`: the height is above the
/// ellipsoid.
pub(super) fn ggk(fields: &[&str]) -> Option<Sentence> {
    let &[
        _,
        time,
        date,
        lat,
        ns,
        lon,
        ew,
        quality,
        _,
        _,
        height,
        m,
        ..,
    ] = fields
    else {
        return None;
    };
    let quality = match digits::<u8>(quality)? {
        0 => return Some(Sentence::NoPosition),
        3 | 7 | 9 => FixQuality::Fixed,
        2 | 6 | 8 => FixQuality::Float,
        4 | 5 | 13 => FixQuality::Differential,
        // The corrections of other services have no fixed ambiguities that the sentence would tell.
        10..=12 | 14 | 15 => FixQuality::Float,
        _ => FixQuality::Single,
    };
    let height_m = number(height.strip_prefix("EHT")?).filter(|_| m == "M")?;
    let part = |from: usize| digits::<i64>(date.get(from..from + 2)?);
    let (month, day, year) = (part(0)?, part(2)?, part(4)?);
    Some(Sentence::Position(Place {
        kind: 1,
        second_s: second_s(time)?,
        date: Some(days_since_1970(2000 + year, month, day)?),
        place_deg: place_deg([lat, ns, lon, ew])?,
        altitude_m: height_m,
        separation_m: Some(0.0),
        quality,
    }))
}

/// The position of `yyyymmddhhmmss.ss, longitude, latitude, height, heading, pitch, track, speed, roll, quality of the
/// position, of the heading, …` of receivers with two antennas by Unicore and ComNav. The height is that of GGA, above the
/// sea: so it is in recordings of both sentences.
pub(super) fn place_of_ksxt(fields: &[&str]) -> Option<Sentence> {
    let &[
        time,
        longitude,
        latitude,
        height,
        _,
        _,
        _,
        _,
        _,
        quality,
        ..,
    ] = fields
    else {
        return None;
    };
    let quality = match quality {
        "" | "0" => return Some(Sentence::NoPosition),
        "2" => FixQuality::Float,
        "3" => FixQuality::Fixed,
        other => {
            digits::<u8>(other)?;
            FixQuality::Single
        }
    };
    let (date, second_s) = date_and_second(time)?;
    let angle = |text: &str, most: f64| number(text).filter(|angle| angle.abs() <= most);
    Some(Sentence::Position(Place {
        kind: KSXT,
        second_s,
        date: Some(date),
        place_deg: [angle(latitude, 90.0)?, angle(longitude, 180.0)?],
        altitude_m: number(height)?,
        separation_m: None,
        quality,
    }))
}

/// `time, rms, semi-major, semi-minor, orientation, σ of latitude, of longitude, of altitude`: standard deviations of
/// the position with the same time, metres.
pub(super) fn gst(fields: &[&str]) -> Option<Sentence> {
    let &[time, _, _, _, _, north, east, up, ..] = fields else {
        return None;
    };
    if [time, north, east, up].contains(&"") {
        return Some(Sentence::NoAccuracy);
    }
    let sigma_m = Vec3::new(number(east)?, number(north)?, number(up)?);
    if sigma_m.min() <= 0.0 {
        return Some(Sentence::NoAccuracy);
    }
    Some(Sentence::Accuracy(second_s(time)?, sigma_m))
}
