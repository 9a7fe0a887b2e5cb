//! Tracks of GPX: positions with a time of UTC.
//!
//! The height `<ele>` counts from the ellipsoid in the files of some programs and from the sea in those of others, which
//! differ by up to 100 m. It is known only where `<geoidheight>`, the height of the geoid above the ellipsoid, stands
//! beside it: then `<ele>` counts from the geoid. Points without it are left out, as those of NMEA without a separation.
//!
//! GPX has no word for fixed ambiguities: its positions count as differential (`<fix>dgps</fix>`) or single.

use std::io::Read;

use crate::error::{Error, Result};
use crate::format::cloud::gathering::counted;
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::left_out::{DAMAGED, LeftOut};
use crate::format::text::civil::unix_from_iso;
use crate::sensor::{FixQuality, GeographicFix};

pub(crate) const TRACK: Kind = Kind {
    signature: Some(|start| start.contains(b"<gpx")),
    geographic: Some(read),
    note: "geographic positions: used with `crs` in [frame] of a project",
    frame: Frame::Fixed(
        "degrees and metres, UTC, WGS 84 (the format); latitude, longitude, height",
    ),
    ..Kind::new("gpx", "positions (track of GPX)")
};

/// Reasons of track points that are not used.
const WITHOUT_TIME: &str = "without a time";
const WITHOUT_HEIGHT: &str =
    "whose height may count from the sea or from the ellipsoid (no geoidheight)";
const WITHOUT_FIX: &str = "without a height of their own (fix none or 2d)";

/// The text of the first element of this name; `None` if there is none.
fn element<'a>(point: &'a str, name: &str) -> Option<&'a str> {
    let (_, rest) = point.split_once(&format!("<{name}>"))?;
    let (text, _) = rest.split_once("</")?;
    Some(text.trim())
}

/// The value of an attribute, in quotes of either kind.
fn attribute<'a>(tag: &'a str, name: &str) -> Option<&'a str> {
    let mut at = tag.match_indices(name);
    at.find_map(|(at, _)| {
        let is_word = tag[..at].ends_with(|c: char| c.is_ascii_whitespace());
        let value = tag[at + name.len()..].trim_start().strip_prefix('=')?;
        let value = value.trim_start();
        let mark = value.chars().next().filter(|c| matches!(c, '"' | '\''))?;
        let (value, _) = value[1..].split_once(mark)?;
        is_word.then_some(value.trim())
    })
}

fn finite(text: Option<&str>) -> Option<f64> {
    text?.parse().ok().filter(|value: &f64| value.is_finite())
}

/// The position of a track point, from its attributes and its elements, or the reason why it is not used.
fn fix(attributes: &str, elements: &str) -> std::result::Result<GeographicFix, &'static str> {
    // Elements of other programs may repeat the names.
    let elements = elements.split("<extensions").next().unwrap_or_default();
    let degrees = |name: &str, most: f64| {
        let value = finite(attribute(attributes, name));
        value.filter(|v| v.abs() <= most).ok_or(DAMAGED)
    };
    let (latitude, longitude) = (degrees("lat", 90.0)?, degrees("lon", 180.0)?);
    let quality = match element(elements, "fix") {
        Some("none" | "2d") => return Err(WITHOUT_FIX),
        Some("dgps") => FixQuality::Differential,
        _ => FixQuality::Single,
    };
    let time = element(elements, "time").ok_or(WITHOUT_TIME)?;
    let number = |name: &str| {
        let text = element(elements, name).ok_or(WITHOUT_HEIGHT)?;
        finite(Some(text)).ok_or(DAMAGED)
    };
    Ok(GeographicFix {
        time_s: unix_from_iso(time).ok_or(DAMAGED)?,
        latitude_rad: latitude.to_radians(),
        longitude_rad: longitude.to_radians(),
        height_m: number("ele")? + number("geoidheight")?,
        sigma_m: None,
        quality: Some(quality),
    })
}

/// A text without its comments.
fn without_comments(text: &str) -> String {
    let mut parts = text.split("<!--");
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |all, part| {
        all + part.split_once("-->").map_or("", |(_, rest)| rest)
    })
}

/// Reads the points of all tracks, in the order of the file.
///
/// # Errors
/// No track point; more points that cannot be used than others.
fn read(input: &Input) -> Result<Vec<GeographicFix>> {
    let (mut stream, _) = input.open()?;
    let mut bytes = Vec::new();
    stream
        .read_to_end(&mut bytes)
        .map_err(|e| Error::io(input.path(), e))?;
    let text = without_comments(&String::from_utf8_lossy(&bytes));
    let mut fixes = Vec::new();
    let mut left_out = LeftOut::default();
    for point in text.split("<trkpt").skip(1) {
        let (attributes, rest) = point.split_once('>').unwrap_or((point, ""));
        let elements = if attributes.ends_with('/') {
            ""
        } else {
            rest.split("</trkpt").next().unwrap_or_default()
        };
        match fix(attributes, elements) {
            Ok(fix) => fixes.push(fix),
            Err(why) => left_out.add(why),
        }
    }
    let expected = "track points with time, ele and geoidheight; or the positions as NMEA with GGA, or as .pos of RTKLIB, \
                    whose heights are known";
    let fixes = left_out.checked(input, fixes, "track points", expected)?;
    for (tag, thing) in [("<wpt", "waypoint"), ("<rtept", "route point")] {
        let count = text.matches(tag).count() as u64;
        if count > 0 {
            input.remark(format!("left out: {}", counted(count, thing)));
        }
    }
    Ok(fixes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::detect;

    fn read_points(points: &str) -> Result<(Vec<GeographicFix>, String)> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.gpx");
        let text = format!(
            "<?xml version=\"1.0\"?>\n<gpx version=\"1.1\"><trk><trkseg>{points}</trkseg></trk></gpx>"
        );
        std::fs::write(&path, text).unwrap();
        let input = Input::from(&path);
        assert_eq!(detect(&input)?.id(), "gpx");
        Ok((read(&input)?, input.remarks().join("\n")))
    }

    const POINT: &str = "<trkpt lat=\"50.95\" lon='6.89'>\n<ele>48.3</ele><time>2023-08-09T09:15:00.5Z</time>\
        <geoidheight>46.9</geoidheight><fix>dgps</fix><extensions><time>x</time></extensions></trkpt>";

    #[test]
    fn points_with_the_height_of_the_geoid_are_read() {
        let (fixes, remarks) = read_points(&format!("{POINT}<!-- <trkpt> -->")).unwrap();
        assert_eq!((fixes.len(), remarks.as_str()), (1, ""));
        let fix = fixes[0];
        let degrees = [fix.latitude_rad, fix.longitude_rad].map(f64::to_degrees);
        assert!((degrees[0] - 50.95).abs() < 1e-12 && (degrees[1] - 6.89).abs() < 1e-12);
        assert!((fix.height_m - 95.2).abs() < 1e-9);
        assert_eq!(fix.time_s, 1_691_572_500.5);
        assert_eq!(fix.quality, Some(FixQuality::Differential));
        let other = POINT.replace("<fix>dgps</fix>", "");
        assert_eq!(
            read_points(&other).unwrap().0[0].quality,
            Some(FixQuality::Single)
        );
    }

    #[test]
    fn points_that_cannot_be_used_are_counted_by_reason() {
        let late = POINT.replace("<time>2023-08-09T09:15:00.5Z</time>", "");
        let flat = POINT.replace("dgps", "2d");
        let far = POINT.replace("50.95", "150.95");
        let all = format!("{POINT}{POINT}{POINT}{late}{flat}{far}<wpt lat=\"1\" lon=\"2\"/>");
        let (fixes, remarks) = read_points(&all).unwrap();
        assert_eq!(fixes.len(), 3);
        for expected in [
            "left out: 1 without a time, 1 without a height of their own (fix none or 2d), 1 damaged",
            "left out: 1 waypoint",
        ] {
            assert!(remarks.contains(expected), "{remarks}");
        }
        let error = read_points("<trkpt lat=\"1\" lon=\"2\"/>")
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("found 0 track points, left out: 1 without a time"),
            "{error}"
        );
        let error = read_points("").unwrap_err().to_string();
        assert!(error.contains("found 0 track points, expected"), "{error}");
    }

    #[test]
    fn damaged_files_do_not_panic() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.gpx");
        let text = format!("<gpx>{POINT}{POINT}</gpx>");
        crate::format::mutation::for_each_damaged(&path, text.as_bytes(), 500, || {
            let _ = detect(&path);
            let _ = read(&Input::from(&path));
        });
    }
}
