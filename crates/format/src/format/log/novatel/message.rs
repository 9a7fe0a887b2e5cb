//! One message of a log: its header, its fields and its checksum.

use crate::format::text::civil::unix_from_gps_s;

/// A message whose checksum is right.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Message<'a> {
    pub(super) name: &'a str,
    /// Seconds of the Unix epoch; `None` if the clock of the receiver was not set yet.
    pub(super) time_s: Option<f64>,
    pub(super) fields: Vec<&'a str>,
}

/// What a line is.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Line<'a> {
    Message(Message<'a>),
    /// The name of a message with a wrong checksum.
    WrongChecksum(&'a str),
    /// No message, or a part of one.
    Other,
}

/// Names of the header, before the semicolon.
const HEADER: usize = 10;
const WEEK_S: f64 = 604_800.0;
/// Weeks of GPS time until 2095.
const MOST_WEEK: u32 = 6000;

/// `#NAME, port, sequence, idle time, status of the time, GPS week, its second, status, reserved, version` of the header,
/// whose checksum is not looked at: the name, the status of the time, the time in seconds since 1980.
fn header(text: &str) -> Option<(&str, &str, f64)> {
    let cells: Vec<&str> = text.split(',').collect();
    let [name, _, _, _, status, week, second, ..] = cells[..] else {
        return None;
    };
    let is_name = name.ends_with('A') && name.bytes().all(|b| b.is_ascii_alphanumeric());
    let week = week.parse::<u32>().ok().filter(|week| *week <= MOST_WEEK)?;
    let second_s: f64 = second.parse().ok()?;
    let gps_s = f64::from(week) * WEEK_S + second_s;
    // Headers of other makers have a number here.
    let is_status = !status.is_empty() && status.bytes().all(|b| b.is_ascii_uppercase());
    let is_header = is_name && is_status && (0.0..=WEEK_S).contains(&second_s);
    (is_header && cells.len() == HEADER).then_some((name, status, gps_s))
}

/// Whether a line begins like a message, whole or not.
pub(super) fn is_start(line: &str) -> bool {
    let text = line.strip_prefix('#').and_then(|text| text.split_once(';'));
    text.is_some_and(|(head, _)| header(head).is_some())
}

pub(super) fn parse(line: &str) -> Line<'_> {
    let Some(text) = line.strip_prefix('#') else {
        return Line::Other;
    };
    let Some((text, checksum)) = text.rsplit_once('*') else {
        return Line::Other;
    };
    let Some((head, body)) = text.split_once(';') else {
        return Line::Other;
    };
    let Some((name, status, gps_s)) = header(head) else {
        return Line::Other;
    };
    if u32::from_str_radix(checksum, 16) != Ok(sum(text.as_bytes())) {
        return Line::WrongChecksum(name);
    }
    // Only a fine time is accurate to a microsecond.
    let is_fine = status.starts_with("FINE");
    Line::Message(Message {
        name,
        time_s: is_fine.then(|| unix_from_gps_s(gps_s)),
        fields: body.split(',').collect(),
    })
}

/// The 32-bit checksum of the format: that of zip, but with zeros before the first byte and not inverted.
pub(super) fn sum(bytes: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new_with_initial(u32::MAX);
    hasher.update(bytes);
    !hasher.finalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Examples of the maker's documentation.
    const EXAMPLES: [&str; 2] = [
        "#INSPVAXA,USB1,0,65.5,FINESTEERING,2209,490782.000,02000020,46eb,16809;INS_SOLUTION_GOOD,INS_PPP,51.15043710672,\
         -114.03067871892,1097.3598,-17.0001,-0.0016,0.0002,0.0029,-0.308665944,0.297893298,157.960833016,0.1816,0.1816,\
         0.1808,0.0018,0.0018,0.0016,0.0292,0.0292,0.0582,13000045,0*a74644a2",
        "#BESTGNSSPOSA,USB1,0,65.0,FINESTEERING,2209,487877.000,02000020,c292,16809;SOL_COMPUTED,PPP,51.15043712234,\
         -114.03067870773,1097.3556,-17.0001,WGS84,0.0176,0.0123,0.0317,\"TSTR\",17.000,0.000,42,38,38,37,00,00,3f,37\
         *5fea7d4b",
    ];

    #[test]
    fn checksums_are_those_of_the_maker() {
        for example in EXAMPLES {
            assert!(is_start(example));
            let Line::Message(message) = parse(example) else {
                panic!("{example}");
            };
            assert!(example[1..].starts_with(message.name));
            let damaged = example.replace("51.1", "51.2");
            assert_eq!(parse(&damaged), Line::WrongChecksum(message.name));
        }
        let Line::Message(message) = parse(EXAMPLES[0]) else {
            panic!();
        };
        // 2022-05-13 16:19:42 of GPS time, 18 s ahead of UTC.
        assert_eq!(message.time_s, Some(1_652_458_782.0 - 18.0));
        assert_eq!(message.fields.len(), 23);
    }

    #[test]
    fn other_lines_are_no_messages() {
        for line in [
            "",
            "#time,x;y*00000000",
            "#BESTNAVA,97,GPS,FINE,2190,365174000,0,0,18,15;SOL_COMPUTED*12345678",
            "$GPGGA,1*00",
        ] {
            assert_eq!(parse(line), Line::Other, "{line}");
        }
    }
}
