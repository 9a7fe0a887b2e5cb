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

/// Cells of a header, before the semicolon.
const HEADER: usize = 10;
const WEEK_S: f64 = 604_800.0;
/// Weeks of GPS time until 2095.
const MOST_WEEK: u32 = 6000;

/// Seconds of GPS time since 1980, of a week and its second; `None` if they are no time.
pub(super) fn gps_s(week: &str, second: &str) -> Option<f64> {
    let week = week.parse::<u32>().ok().filter(|week| *week <= MOST_WEEK)?;
    let second_s: f64 = second.parse().ok()?;
    let is_of_week = (0.0..=WEEK_S).contains(&second_s);
    is_of_week.then(|| f64::from(week) * WEEK_S + second_s)
}

/// Whether the time system of a header is that of GPS.
fn is_gps(system: &str) -> bool {
    matches!(system, "GPS" | "GPST")
}

/// Whether the time system of a header is that of BeiDou.
fn is_beidou(system: &str) -> bool {
    matches!(system, "BDS" | "BDST" | "BDT")
}

/// Seconds of GPS time, of the week and the second of BeiDou, whose time is 14 s behind that of GPS and whose weeks count
/// from 2006. A week that would lie behind 2031 counts from 1980, as that of GPS.
fn gps_of_beidou_s(counted_s: f64) -> f64 {
    const BEHIND_S: f64 = 14.0;
    const FIRST_WEEK_S: f64 = 1356.0 * WEEK_S;
    let from_1980_s = if counted_s < FIRST_WEEK_S {
        counted_s + FIRST_WEEK_S
    } else {
        counted_s
    };
    from_1980_s + BEHIND_S
}

/// What a header holds.
struct Header<'a> {
    name: &'a str,
    gps_s: f64,
    has_fine_time: bool,
}

/// The header of a line up to its semicolon, and the rest, without a look at the checksum. Headers are:
/// - `#NAME, port, sequence, idle time, status of the time, GPS week, its second, status, reserved, version` of NovAtel;
/// - `%NAME, GPS week, its second` of NovAtel, for messages of high rate;
/// - `#NAME, idle time, GPS, status of the time, GPS week, its millisecond, reserved, version, leap seconds, delay` of
///   Unicore, and the same with `BDS` in the place of `GPS` and a week of BeiDou.
fn header(line: &str) -> Option<(Header<'_>, &str)> {
    let (head, body) = line.get(1..)?.split_once(';')?;
    let cells: Vec<&str> = head.split(',').collect();
    let (status, gps_s) = match (line.as_bytes()[0], &cells[..]) {
        (b'#', [_, _, system, status, week, millisecond, ..])
            if cells.len() == HEADER && (is_gps(system) || is_beidou(system)) =>
        {
            let second_s = f64::from(millisecond.parse::<u32>().ok()?) / 1e3;
            let counted_s = gps_s(week, &second_s.to_string())?;
            (
                *status,
                if is_gps(system) {
                    counted_s
                } else {
                    gps_of_beidou_s(counted_s)
                },
            )
        }
        (b'#', [_, _, _, _, status, week, second, ..]) if cells.len() == HEADER => {
            (*status, gps_s(week, second)?)
        }
        // Its week is 0 until the time is known.
        (b'%', [_, "0", second]) => ("UNKNOWN", gps_s("0", second)?),
        (b'%', [_, week, second]) => ("FINE", gps_s(week, second)?),
        _ => return None,
    };
    let name = cells[0];
    let is_name = name.ends_with('A') && name.bytes().all(|b| b.is_ascii_alphanumeric());
    // Headers of other makers have a number here.
    let is_status = !status.is_empty() && status.bytes().all(|b| b.is_ascii_uppercase());
    let header = Header {
        name,
        gps_s,
        // Only a fine time is accurate to a microsecond.
        has_fine_time: status.starts_with("FINE"),
    };
    (is_name && is_status).then_some((header, body))
}

/// Whether a line begins like a message, whole or not.
pub(super) fn is_start(line: &str) -> bool {
    header(line).is_some()
}

pub(super) fn parse(line: &str) -> Line<'_> {
    let Some((text, checksum)) = line.rsplit_once('*') else {
        return Line::Other;
    };
    let Some((header, body)) = header(text) else {
        return Line::Other;
    };
    if u32::from_str_radix(checksum, 16) != Ok(sum(&text.as_bytes()[1..])) {
        return Line::WrongChecksum(header.name);
    }
    Line::Message(Message {
        name: header.name,
        time_s: header.has_fine_time.then(|| unix_from_gps_s(header.gps_s)),
        fields: body.split(',').collect(),
    })
}

/// The 32-bit checksum of the format: that of zip, but with zeros before the first byte and not inverted.
pub(in crate::format::log) fn sum(bytes: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new_with_initial(u32::MAX);
    hasher.update(bytes);
    !hasher.finalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lines of receivers: examples of NovAtel's documentation (the first three, the last), and recordings in the tests
    /// of public programs (satpulse for BESTNAVA, node packages for UNIHEADINGA, the ROS driver of SwRI for HEADING2A).
    const EXAMPLES: [&str; 6] = [
        "#INSPVAXA,USB1,0,65.5,FINESTEERING,2209,490782.000,02000020,46eb,16809;INS_SOLUTION_GOOD,INS_PPP,51.15043710672,\
         -114.03067871892,1097.3598,-17.0001,-0.0016,0.0002,0.0029,-0.308665944,0.297893298,157.960833016,0.1816,0.1816,\
         0.1808,0.0018,0.0018,0.0016,0.0292,0.0292,0.0582,13000045,0*a74644a2",
        "#BESTGNSSPOSA,USB1,0,65.0,FINESTEERING,2209,487877.000,02000020,c292,16809;SOL_COMPUTED,PPP,51.15043712234,\
         -114.03067870773,1097.3556,-17.0001,WGS84,0.0176,0.0123,0.0317,\"TSTR\",17.000,0.000,42,38,38,37,00,00,3f,37\
         *5fea7d4b",
        "#INSPVAA,USB1,0,67.5,FINESTEERING,2209,490558.000,02000020,18bc,16809;2209,490558.000000000,51.15043714042,\
         -114.03067871718,1080.3548,0.0051,-0.0014,-0.0012,-0.296402993,0.311887972,157.992156267,INS_SOLUTION_GOOD\
         *cc698020",
        "#UNIHEADINGA,93,GPS,FINE,2385,326588000,0,0,18,10;SOL_COMPUTED,NARROW_FLOAT,5.5208,219.9783,24.6813,0.0000,\
         16.4390,35.3287,\"999\",21,9,9,5,3,00,3,13*53e4320d",
        "#HEADING2A,COM1,0,39.5,FINESTEERING,1622,422892.200,02040000,f9bf,6521;SOL_COMPUTED,NARROW_INT,0.927607417,\
         178.347869873,-1.3037414550,0,0.261901051,0.391376048,\"R222\",\"AAAA\",18,17,17,16,0,01,0,33*8c48d77c",
        "%INSPVASA,1264,144059.000;1264,144059.002135700,51.116680071,-114.037929194,515.286704183,277.896368884,\
         84.915188605,-8.488207941,0.759619515,-2.892414901,6.179554750,INS_ALIGNMENT_COMPLETE*855d6f76",
    ];

    #[test]
    fn checksums_are_those_of_the_makers() {
        let lengths = [23, 21, 12, 17, 18, 12];
        for (example, length) in EXAMPLES.into_iter().zip(lengths) {
            assert!(is_start(example));
            let Line::Message(message) = parse(example) else {
                panic!("{example}");
            };
            assert!(example[1..].starts_with(message.name));
            assert_eq!(message.fields.len(), length, "{example}");
            let damaged = example.replacen("1.", "2.", 1);
            let damaged = damaged.replacen("5.", "6.", 1);
            assert_eq!(parse(&damaged), Line::WrongChecksum(message.name));
        }
    }

    #[test]
    fn weeks_and_their_seconds_are_utc() {
        // 2022-05-13 16:19:42, 2025-09-24 18:43:08 and 2004-03-29 16:00:59 of GPS time, 18, 18 and 13 s ahead of UTC.
        for (at, unix_s) in [
            (0, 1_652_458_782.0 - 18.0),
            (3, 1_758_739_388.0 - 18.0),
            (5, 1_080_576_059.0 - 13.0),
        ] {
            let Line::Message(message) = parse(EXAMPLES[at]) else {
                panic!();
            };
            assert_eq!(message.time_s, Some(unix_s), "{at}");
        }
    }

    #[test]
    fn other_lines_are_no_messages() {
        for line in [
            "",
            "#",
            "é;",
            "#time,x;y*00000000",
            "#BESTNAVA,97,GLO,FINE,834,365174000,0,0,18,15;SOL_COMPUTED*12345678",
            "$GPGGA,1*00",
        ] {
            assert_eq!(parse(line), Line::Other, "{line}");
        }
    }
}
