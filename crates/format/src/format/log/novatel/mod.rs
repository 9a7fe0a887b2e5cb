//! Logs of NovAtel receivers in ASCII: positions (BESTPOSA, BESTGNSSPOSA) and poses (INSPVAXA).
//!
//! A line holds a header, fields, and a checksum of 32 bits. Heights are above mean sea level with the undulation of the
//! geoid beside them; their sum is the ellipsoidal height. Roll is positive with the right side down, pitch with the
//! nose up, and the azimuth counts clockwise from true north. Latitudes are in the datum of the receiver.
//!
//! Messages without a solution, with a wrong checksum, or from before the receiver knew the time are left out and
//! counted. INSPVAA is not read: it has no standard deviations.
//!
//! # Times
//! GPS weeks with their seconds become seconds of the Unix epoch in UTC.

mod message;

use self::message::{Line, Message, is_start, parse};
use crate::error::{Error, Location, Result};
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind, Start};
use crate::format::text::lines::Lines;
use crate::geometry::Vec3;
use crate::sensor::{FixQuality, GeographicFix, GeographicPose, NavigationAngles, NavigationSigma};

pub(crate) const LOG: Kind = Kind {
    signature: Some(looks_like),
    geographic: Some(read_positions),
    geographic_poses: Some(read_poses),
    has_navigation_angles: true,
    contents: Some(contents),
    note: "geographic positions: used with `crs` in [frame] of a project",
    frame: Frame::Fixed(
        "degrees and metres (the format); latitude, longitude, ellipsoidal height in the datum of the receiver; headings \
         clockwise from true north; body x forward, y left, z up, turned to the axes of the project",
    ),
    ..Kind::new("novatel", "log of positions and poses (NovAtel ASCII)")
};

const POSITIONS: [&str; 2] = ["BESTPOSA", "BESTGNSSPOSA"];
const POSES: &str = "INSPVAXA";

fn looks_like(start: &Start<'_>) -> bool {
    let mut lines = start.bytes.split(|byte| *byte == b'\n');
    lines.any(|line| std::str::from_utf8(line).is_ok_and(is_start))
}

/// Numbers of the messages that are not used, by reason.
#[derive(Default)]
struct Skipped {
    wrong_checksum: u64,
    without_time: u64,
    without_solution: u64,
    /// Messages of the wanted kind with fields that are missing or are not numbers.
    damaged: u64,
}

impl Skipped {
    fn total(&self) -> u64 {
        self.wrong_checksum + self.without_time + self.without_solution + self.damaged
    }

    /// The numbers above 0 with their reasons.
    fn text(&self) -> String {
        let reasons = [
            (self.wrong_checksum, "with a wrong checksum"),
            (self.without_time, "before the receiver knew the time"),
            (self.without_solution, "without a solution"),
            (self.damaged, "damaged"),
        ];
        let reasons = reasons.iter().filter(|(count, _)| *count > 0);
        let reasons: Vec<String> = reasons.map(|(n, why)| format!("{n} {why}")).collect();
        reasons.join(", ")
    }
}

/// What a message of the wanted kind holds.
enum Content<T> {
    Record(T),
    NoSolution,
    Damaged,
}

/// Reads the messages named `name`.
///
/// # Errors
/// No record; more messages that are skipped than records.
fn read<T>(
    input: &Input,
    name: &str,
    what: &str,
    record: impl Fn(&Message<'_>, f64) -> Content<T>,
) -> Result<Vec<T>> {
    let mut lines = Lines::open(input)?;
    let (mut records, mut skipped) = (Vec::new(), Skipped::default());
    while lines.advance()? {
        let message = match parse(lines.text()) {
            Line::Message(message) if message.name == name => message,
            Line::WrongChecksum(found) if found == name => {
                skipped.wrong_checksum += 1;
                continue;
            }
            Line::Message(_) | Line::WrongChecksum(_) | Line::Other => continue,
        };
        let Some(time_s) = message.time_s else {
            skipped.without_time += 1;
            continue;
        };
        match record(&message, time_s) {
            Content::Record(record) => records.push(record),
            Content::NoSolution => skipped.without_solution += 1,
            Content::Damaged => skipped.damaged += 1,
        }
    }
    let reasons = skipped.text();
    if records.is_empty() || skipped.total() > records.len() as u64 {
        let also = if reasons.is_empty() {
            ""
        } else {
            ", left out: "
        };
        let found = format!("{} {what} ({name}){also}{reasons}", records.len());
        let expected = format!("more {what} than messages that cannot be used");
        return Err(Error::format(
            input.path(),
            Location::Whole,
            found,
            expected,
        ));
    }
    if skipped.total() > 0 {
        input.remark(format!("messages left out: {reasons}"));
    }
    Ok(records)
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

/// Finite numbers of the fields from `first` on.
fn numbers<const N: usize>(message: &Message<'_>, first: usize) -> Option<[f64; N]> {
    let mut found = [0.0_f64; N];
    for (value, at) in found.iter_mut().zip(first..) {
        *value = message.fields.get(at)?.parse().ok()?;
        if !value.is_finite() {
            return None;
        }
    }
    Some(found)
}

/// The quality of a position of this type; `None` for positions that were not measured.
fn quality(kind: &str) -> Option<FixQuality> {
    Some(match kind {
        "NONE" | "FIXEDPOS" | "FIXEDHEIGHT" | "PROPAGATED" => return None,
        "L1_INT" | "NARROW_INT" | "INS_RTKFIXED" => FixQuality::Fixed,
        // Ambiguities of the wide lane leave decimetres.
        "WIDE_INT" | "L1_FLOAT" | "NARROW_FLOAT" | "IONOFREE_FLOAT" | "FLOATCONV" | "WIDELANE"
        | "NARROWLANE" | "INS_RTKFLOAT" | "PPP" | "PPP_CONVERGING" | "INS_PPP"
        | "INS_PPP_CONVERGING" => FixQuality::Float,
        "PSRDIFF"
        | "WAAS"
        | "SBAS"
        | "CDGPS"
        | "PPP_BASIC"
        | "PPP_BASIC_CONVERGING"
        | "INS_PSRDIFF"
        | "INS_SBAS"
        | "INS_PPP_BASIC"
        | "INS_PPP_BASIC_CONVERGING" => FixQuality::Differential,
        _ => FixQuality::Single,
    })
}

/// `status, type, latitude, longitude, height, undulation, datum, standard deviations of latitude, longitude, height, …`
fn position(message: &Message<'_>, time_s: f64) -> Content<GeographicFix> {
    let [status, kind, ..] = message.fields[..] else {
        return Content::Damaged;
    };
    let Some(quality) = quality(kind).filter(|_| status == "SOL_COMPUTED") else {
        return Content::NoSolution;
    };
    let (Some([latitude, longitude, height_m, undulation_m]), Some([north, east, up])) =
        (numbers(message, 2), numbers(message, 7))
    else {
        return Content::Damaged;
    };
    if latitude.abs() > 90.0 || longitude.abs() > 360.0 {
        return Content::Damaged;
    }
    let sigma_m = Vec3::new(east, north, up);
    Content::Record(GeographicFix {
        time_s,
        latitude_rad: latitude.to_radians(),
        longitude_rad: longitude.to_radians(),
        height_m: height_m + undulation_m,
        sigma_m: (sigma_m.min() > 0.0).then_some(sigma_m),
        quality: Some(quality),
    })
}

/// Reads the positions of the more frequent of the messages BESTPOSA and BESTGNSSPOSA with their quality and standard
/// deviations.
fn read_positions(input: &Input) -> Result<Vec<GeographicFix>> {
    let counts = counts(input)?;
    let count = |wanted: &str| {
        let found = counts.iter().find(|(name, _)| name == wanted);
        found.map_or(0, |(_, count)| *count)
    };
    let [best, gnss] = POSITIONS.map(count);
    let mut names = POSITIONS;
    if gnss > best {
        names.reverse();
    }
    let [name, other] = names;
    let count = best.min(gnss);
    if count > 0 {
        input.remark(format!(
            "positions are those of {name}: {count} of {other} are left out"
        ));
    }
    read(input, name, "positions", position)
}

/// `status, type, latitude, longitude, height, undulation, velocity north, east, up, roll, pitch, azimuth, standard
/// deviations of latitude, longitude, height, of the velocity, of roll, pitch, azimuth, …`
fn pose(message: &Message<'_>, time_s: f64) -> Content<GeographicPose> {
    const SOLUTIONS: [&str; 4] = [
        "INS_SOLUTION_GOOD",
        "INS_SOLUTION_FREE",
        "INS_ALIGNMENT_COMPLETE",
        "INS_HIGH_VARIANCE",
    ];
    match message.fields.first() {
        Some(status) if SOLUTIONS.contains(status) => {}
        Some(_) => return Content::NoSolution,
        None => return Content::Damaged,
    }
    let Some(values) = numbers::<19>(message, 2) else {
        return Content::Damaged;
    };
    let [
        latitude,
        longitude,
        height_m,
        undulation_m,
        north,
        east,
        up,
        ..,
    ] = values;
    let [sigma_north, sigma_east, sigma_up] = [values[10], values[11], values[12]];
    let sigmas = [10, 11, 12, 16, 17, 18].map(|at| values[at]);
    let sigma = NavigationSigma {
        position_m: Vec3::new(sigma_east, sigma_north, sigma_up),
        angles: NavigationAngles::from_deg([values[16], values[17], values[18]]),
    };
    let pose = GeographicPose {
        time_s,
        latitude_rad: latitude.to_radians(),
        longitude_rad: longitude.to_radians(),
        height_m: height_m + undulation_m,
        angles: NavigationAngles::from_deg([values[7], values[8], values[9]]),
        velocity_m_s: Some(Vec3::new(east, north, up)),
        // Zero stands for an unknown standard deviation.
        sigma: sigmas.iter().all(|s| *s > 0.0).then_some(sigma),
    };
    pose.check()
        .map_or(Content::Damaged, |()| Content::Record(pose))
}

/// Reads the poses of the messages INSPVAXA.
fn read_poses(input: &Input) -> Result<Vec<GeographicPose>> {
    read(input, POSES, "poses", pose)
}

#[cfg(test)]
mod tests {
    use super::message::sum;
    use super::*;
    use crate::format::detect;

    const HEADER: &str = "COM1,0,73.5,FINESTEERING,2274,292500.000,00000000,471d,7397";
    const POSE: &str = "INS_SOLUTION_GOOD,INS_RTKFIXED,50.95425087,6.89550221,48.3615,46.9156,1,2,3,0.12,-0.43,341.33,\
                        0.01,0.02,0.03,0.1,0.1,0.1,0.04,0.05,0.06,00000000,0";

    fn line(name: &str, body: &str) -> String {
        let text = format!("{name},{HEADER};{body}");
        format!("#{text}*{:08x}\n", sum(text.as_bytes()))
    }

    fn best(kind: &str) -> String {
        let body = format!(
            "SOL_COMPUTED,{kind},50.95425087,6.89550221,48.3615,46.9156,WGS84,0.02,0.01,0.03,\"0\""
        );
        line("BESTPOSA", &body)
    }

    fn with<T>(text: &str, read: impl Fn(&Input) -> T) -> T {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.log");
        std::fs::write(&path, text).unwrap();
        assert_eq!(detect(&path).unwrap().id(), "novatel");
        read(&Input::from(&path))
    }

    #[test]
    fn positions_have_their_quality_and_ellipsoidal_height() {
        for (kind, quality) in [
            ("NARROW_INT", FixQuality::Fixed),
            ("WIDE_INT", FixQuality::Float),
            ("PSRDIFF", FixQuality::Differential),
            ("SINGLE", FixQuality::Single),
        ] {
            let fix = with(&best(kind), |input| read_positions(input).unwrap()[0]);
            assert_eq!(fix.quality, Some(quality), "{kind}");
            assert_eq!(fix.sigma_m, Some(Vec3::new(0.01, 0.02, 0.03)));
            assert!((fix.height_m - 95.2771).abs() < 1e-9);
            assert!((fix.latitude_rad.to_degrees() - 50.954_250_87).abs() < 1e-12);
            // 2023-08-09 09:15:00 of GPS time.
            assert_eq!(fix.time_s, 1_691_572_500.0 - 18.0);
        }
    }

    #[test]
    fn poses_have_velocities_and_standard_deviations() {
        let pose = with(&line("INSPVAXA", POSE), |input| {
            read_poses(input).unwrap()[0]
        });
        assert_eq!(
            pose.angles,
            NavigationAngles::from_deg([0.12, -0.43, 341.33])
        );
        assert_eq!(pose.velocity_m_s, Some(Vec3::new(2.0, 1.0, 3.0)));
        assert!((pose.height_m - 95.2771).abs() < 1e-9);
        let sigma = pose.sigma.unwrap();
        assert_eq!(sigma.position_m, Vec3::new(0.02, 0.01, 0.03));
        assert_eq!(sigma.angles, NavigationAngles::from_deg([0.04, 0.05, 0.06]));
    }

    #[test]
    fn messages_that_cannot_be_used_are_counted() {
        let good = line("INSPVAXA", POSE);
        let aligning = line(
            "INSPVAXA",
            &POSE.replace("INS_SOLUTION_GOOD", "INS_ALIGNING"),
        );
        let early = good.replace("FINESTEERING", "UNKNOWN");
        let text = early[1..].split('*').next().unwrap().to_owned();
        let early_but_whole = format!("#{text}*{:08x}\n", sum(text.as_bytes()));
        let both = format!("{good}{good}{aligning}{}", best("SINGLE"));
        let remarks = with(&both, |input| {
            assert_eq!(read_poses(input).unwrap().len(), 2);
            input.remarks().join("\n")
        });
        assert_eq!(remarks, "messages left out: 1 without a solution");
        let text = format!("{good}{early_but_whole}");
        let remarks = with(&text, |input| {
            assert_eq!(read_poses(input).unwrap().len(), 1);
            input.remarks().join("\n")
        });
        assert_eq!(
            remarks,
            "messages left out: 1 before the receiver knew the time"
        );
        // The time is part of what the checksum covers.
        let error = with(&format!("{good}{early}{early}"), |input| {
            read_poses(input).unwrap_err()
        });
        let error = error.to_string();
        assert!(
            error.contains("1 poses (INSPVAXA), left out: 2 with a wrong"),
            "{error}"
        );
        let error = with(&best("SINGLE"), |input| read_poses(input).unwrap_err()).to_string();
        assert!(error.contains("0 poses (INSPVAXA)"), "{error}");
        let named = with(&both, |input| contents(input).unwrap());
        assert_eq!(named, "messages: 3 INSPVAXA, 1 BESTPOSA");
    }

    #[test]
    fn the_more_frequent_positions_are_read() {
        let gnss = best("SINGLE");
        let text = gnss.trim_start_matches('#').split_once(',').unwrap().1;
        let body = text.split_once(';').unwrap().1.split_once('*').unwrap().0;
        let gnss = line("BESTGNSSPOSA", body);
        let text = format!("{gnss}{gnss}{}", best("NARROW_INT"));
        let remarks = with(&text, |input| {
            assert_eq!(read_positions(input).unwrap().len(), 2);
            input.remarks().join("\n")
        });
        assert_eq!(
            remarks,
            "positions are those of BESTGNSSPOSA: 1 of BESTPOSA are left out"
        );
    }

    #[test]
    fn damaged_files_do_not_panic() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.log");
        let text = format!("{}{}", line("INSPVAXA", POSE), best("SINGLE"));
        crate::format::mutation::for_each_damaged(&path, text.as_bytes(), 500, || {
            let _ = detect(&path);
            let _ = read_poses(&Input::from(&path));
            let _ = read_positions(&Input::from(&path));
        });
    }
}
