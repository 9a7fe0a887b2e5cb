//! Sentences with headings.

use super::fields::{Heading, Sentence, date_and_second, digits, number, second_s};

/// A heading in degrees, 0 to 360.
fn heading_deg(text: &str) -> Option<f64> {
    number(text).filter(|heading| (0.0..=360.0).contains(heading))
}

/// An empty field is valid, an unreadable field is damage.
fn angle_deg(text: &str) -> Option<Option<f64>> {
    match text {
        "" => Some(None),
        text => number(text).filter(|angle| angle.abs() <= 90.0).map(Some),
    }
}

fn heading(kind: usize, text: &str) -> Option<Sentence> {
    let heading = Heading {
        heading_deg: heading_deg(text)?,
        ..Heading::default()
    };
    Some(Sentence::Heading(kind, heading))
}

/// `heading, T`
pub(super) fn hdt(fields: &[&str]) -> Option<Sentence> {
    match fields {
        ["", "T" | "", ..] => Some(Sentence::NoHeading),
        [text, "T", ..] => heading(0, text),
        _ => None,
    }
}

/// `heading, mode`: autonomous and estimated headings are measurements; manual, simulated and
/// invalid ones are not.
pub(super) fn ths(fields: &[&str]) -> Option<Sentence> {
    match fields {
        [_, "M" | "S" | "V", ..] | ["", "", ..] => Some(Sentence::NoHeading),
        [text, "A" | "E", ..] => heading(1, text),
        _ => None,
    }
}

/// `time, heading, T, roll, pitch, heave, sigma of roll, of pitch, of heading, quality, …`
pub(super) fn pashr(fields: &[&str]) -> Option<Sentence> {
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
    // Zero stands for an unknown accuracy.
    let accuracy = |text| Some(angle_deg(text)?.filter(|sigma| *sigma > 0.0));
    let pitch_deg = angle_deg(pitch)?;
    let heading = Heading {
        second_s: Some(second_s(time)?),
        date: None,
        heading_deg: heading_deg(heading)?,
        sigma_deg: accuracy(sigma)?,
        pitch_deg,
        pitch_sigma_deg: accuracy(pitch_sigma)?.filter(|_| pitch_deg.is_some()),
    };
    Some(Sentence::Heading(2, heading))
}

/// `PTNL,AVR, time, yaw, Yaw, tilt, Tilt, roll, Roll, range, quality, …`: yaw is the heading of the baseline, tilt its
/// pitch. Only quality 3 has fixed ambiguities.
pub(super) fn avr(fields: &[&str]) -> Option<Sentence> {
    let &[_, time, yaw, "Yaw", tilt, _, _, _, _, quality, ..] = fields else {
        return None;
    };
    match digits::<u8>(quality)? {
        0 => return Some(Sentence::NoHeading),
        3 => {}
        _ => return Some(Sentence::NotFixed),
    }
    let yaw_deg = number(yaw).filter(|yaw| yaw.abs() <= 360.0)?;
    let heading = Heading {
        second_s: Some(second_s(time)?),
        heading_deg: yaw_deg.rem_euclid(360.0),
        pitch_deg: angle_deg(tilt)?,
        ..Heading::default()
    };
    Some(Sentence::Heading(3, heading))
}

/// The heading of KSXT, see [`place_of_ksxt`](super::place::place_of_ksxt). Only quality 3 has fixed ambiguities.
pub(super) fn heading_of_ksxt(fields: &[&str]) -> Option<Sentence> {
    let &[time, _, _, _, heading, pitch, _, _, _, _, quality, ..] = fields else {
        return None;
    };
    match (heading, quality) {
        ("", _) | (_, "" | "0") => return Some(Sentence::NoHeading),
        (_, "3") => {}
        _ => return Some(Sentence::NotFixed),
    }
    let (date, second_s) = date_and_second(time)?;
    let heading = Heading {
        second_s: Some(second_s),
        date: Some(date),
        heading_deg: heading_deg(heading)?,
        pitch_deg: angle_deg(pitch)?,
        ..Heading::default()
    };
    Some(Sentence::Heading(4, heading))
}
