//! Logs of NovAtel and Unicore receivers in ASCII: positions (BESTPOSA, BESTGNSSPOSA, BESTNAVA), headings of two antennas
//! (HEADINGA, HEADING2A, UNIHEADINGA) and poses (INSPVAXA, INSPVAA, and INSPVAXSA, INSPVASA with the short header).
//!
//! A line holds a header, fields, and a checksum of 32 bits. Heights are above mean sea level with the undulation of the
//! geoid beside them, whose sum is the ellipsoidal height; INSPVAA gives the ellipsoidal height itself. Roll is positive
//! with the right side down, pitch with the nose up, and azimuths count clockwise from true north. Latitudes are in the
//! datum of the receiver. The layouts are those of the makers' manuals and of recorded messages; BESTNAVA has the layout of
//! BESTPOSA, UNIHEADINGA that of HEADINGA.
//!
//! Messages without a solution, with a wrong checksum, or from before the receiver knew the time are left out and counted,
//! as are headings whose ambiguities are not fixed. Of several messages with the same measurements, the most frequent
//! one is read.
//!
//! # Times
//! Weeks of GPS or BeiDou with their seconds become seconds of the Unix epoch in UTC.

mod message;
mod records;
#[cfg(test)]
mod tests;

pub(super) use self::message::sum;
use self::message::{Line, Message, is_start, parse};
use crate::error::Result;
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind, Start};
use crate::format::left_out::{LeftOut, WRONG_CHECKSUM};
use crate::format::text::lines::Lines;
use crate::sensor::{GeographicFix, GeographicPose, HeadingFix};

pub(crate) const LOG: Kind = Kind {
    signature: Some(looks_like),
    heading: Some(read_headings),
    geographic: Some(read_positions),
    geographic_poses: Some(read_poses),
    has_navigation_angles: true,
    contents: Some(contents),
    note: "geographic positions: used with `crs` in [frame] of a project",
    frame: Frame::Fixed(
        "degrees and metres (the format); latitude, longitude, ellipsoidal height in the datum of the receiver; headings \
         clockwise from true north; body x forward, y left, z up, turned to the axes of the project",
    ),
    ..Kind::new(
        "novatel",
        "log of positions, headings and poses (NovAtel or Unicore ASCII)",
    )
};

const POSITIONS: [&str; 3] = ["BESTPOSA", "BESTGNSSPOSA", "BESTNAVA"];
const HEADINGS: [&str; 3] = ["HEADINGA", "HEADING2A", "UNIHEADINGA"];
const POSES: [&str; 4] = ["INSPVAXA", "INSPVAA", "INSPVAXSA", "INSPVASA"];

/// The reason of a message from before the receiver knew the time.
const WITHOUT_TIME: &str = "before the receiver knew the time";

fn looks_like(start: &Start<'_>) -> bool {
    let mut lines = start.bytes.split(|byte| *byte == b'\n');
    lines.any(|line| std::str::from_utf8(line).is_ok_and(is_start))
}

/// Numbers of the messages by name.
fn counts(input: &Input) -> Result<Vec<(String, u64)>> {
    let mut counts: Vec<(String, u64)> = Vec::new();
    let mut lines = Lines::open(input)?;
    while lines.advance()? {
        if let Line::Message(message) = parse(lines.text()) {
            match counts.iter_mut().find(|(name, _)| name == message.name) {
                Some((_, count)) => *count += 1,
                None => counts.push((message.name.to_owned(), 1)),
            }
        }
    }
    Ok(counts)
}

/// The messages of the log with their numbers.
fn contents(input: &Input) -> Result<String> {
    let counts = counts(input)?;
    let counts = counts.iter().map(|(name, count)| format!("{count} {name}"));
    Ok(format!(
        "messages: {}",
        counts.collect::<Vec<_>>().join(", ")
    ))
}

/// Reads the most frequent of the messages with these names, the first of equally frequent ones. `record` gives the
/// record of a message at a time, or the reason why there is none.
///
/// # Errors
/// No record; more messages that are left out than records.
fn read<T>(
    input: &Input,
    what: &str,
    names: &[&str],
    record: impl Fn(&Message<'_>, f64) -> std::result::Result<T, &'static str>,
) -> Result<Vec<T>> {
    let counts = counts(input)?;
    let of = |name: &str| counts.iter().find(|(found, _)| found == name);
    let mut found: Vec<&(String, u64)> = names.iter().filter_map(|name| of(name)).collect();
    found.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let name = found.first().map_or(names[0], |(name, _)| name);
    let others = found.iter().skip(1);
    let others: Vec<String> = others.map(|(name, n)| format!("{n} {name}")).collect();
    let mut lines = Lines::open(input)?;
    let (mut records, mut left_out) = (Vec::new(), LeftOut::default());
    while lines.advance()? {
        match parse(lines.text()) {
            Line::Message(message) if message.name == name => {
                let found = message.time_s.ok_or(WITHOUT_TIME);
                match found.and_then(|time_s| record(&message, time_s)) {
                    Ok(record) => records.push(record),
                    Err(why) => left_out.add(why),
                }
            }
            Line::WrongChecksum(found) if found == name => left_out.add(WRONG_CHECKSUM),
            Line::Message(_) | Line::WrongChecksum(_) | Line::Other => {}
        }
    }
    let expected = format!(
        "{what} in the messages {}, and fewer that cannot be used",
        names.join(", ")
    );
    let records = left_out.checked(input, records, &format!("{what} ({name})"), &expected)?;
    if !others.is_empty() {
        input.remark(format!(
            "{what} are those of {name}: left out are {}",
            others.join(", ")
        ));
    }
    Ok(records)
}

fn read_positions(input: &Input) -> Result<Vec<GeographicFix>> {
    read(input, "positions", &POSITIONS, records::position)
}

fn read_headings(input: &Input) -> Result<Vec<HeadingFix>> {
    read(input, "headings", &HEADINGS, records::heading)
}

fn read_poses(input: &Input) -> Result<Vec<GeographicPose>> {
    read(input, "poses", &POSES, records::pose)
}
