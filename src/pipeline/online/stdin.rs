//! Records of all sensors as lines of one stream.

use std::io::BufRead;
use std::path::Path;

use super::record::Record;
use crate::error::{Error, Location, Result};
use crate::geometry::Vec3;
use crate::project::{Logs, Project};
use crate::sensor::{HeadingFix, ImuSample, PositionFix};

/// Maximum length of a line, bytes.
const MAX_LINE: usize = 4096;

/// Reads all lines: `imu,time_s,gyro_x_rad_s,…,accel_z_m_s2`, the name of a position sensor with
/// `time_s,east_m,north_m,up_m` and optionally `sigma_m`, and `heading,time_s,heading_deg` with
/// optionally `sigma_deg`. Empty lines and comments (`#`) are skipped. Time offsets and the origin
/// are those of the project.
///
/// # Errors
/// A line that is not a record, with its number.
pub(super) fn read(
    project: &Project,
    logs: &Logs,
    lines: &mut dyn BufRead,
    mut add: impl FnMut(Record) -> Result<()>,
) -> Result<()> {
    let mut line = Vec::new();
    let mut number = 0;
    loop {
        line.clear();
        number += 1;
        let mut limited = std::io::Read::take(&mut *lines, MAX_LINE as u64);
        let read = limited
            .read_until(b'\n', &mut line)
            .map_err(|error| Error::io("stdin", error))?;
        if read == 0 {
            return Ok(());
        }
        let fail = |found: String, expected: String| {
            Error::format(Path::new("stdin"), Location::Line(number), found, expected)
        };
        if read == MAX_LINE {
            return Err(fail(
                format!("a line of {MAX_LINE} bytes or more"),
                "a record".into(),
            ));
        }
        let text = std::str::from_utf8(&line)
            .map_err(|_| fail("bytes that are not text".into(), "text (UTF-8)".into()))?
            .trim_ascii();
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        let record =
            parse(project, logs, text).map_err(|(found, expected)| fail(found, expected))?;
        add(record)?;
    }
}

fn parse(
    project: &Project,
    logs: &Logs,
    text: &str,
) -> std::result::Result<Record, (String, String)> {
    let (name, cells) = text.split_once(',').unwrap_or((text, ""));
    let name = name.trim_ascii();
    let numbers = |least: usize, most: usize, columns: &str| {
        let numbers: Option<Vec<f64>> = cells
            .split(',')
            .map(|cell| cell.trim_ascii().parse().ok())
            .map(|x: Option<f64>| x.filter(|x| x.is_finite()))
            .collect();
        numbers
            .filter(|values| (least..=most).contains(&values.len()))
            .ok_or_else(|| {
                let found = text.chars().take(80).collect::<String>();
                (format!("`{found}`"), format!("{name},{columns}"))
            })
    };
    let sensor = logs.settings.positions.iter().position(|p| p.name == name);
    match (name, sensor) {
        ("imu", _) => {
            let x = numbers(
                7,
                7,
                "time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,\
                 accel_z_m_s2",
            )?;
            Ok(Record::Imu(ImuSample {
                time_s: x[0] + logs.imu.time_offset_s,
                gyro_rad_s: Vec3::new(x[1], x[2], x[3]),
                accel_m_s2: Vec3::new(x[4], x[5], x[6]),
            }))
        }
        (_, Some(sensor)) => {
            let columns = "time_s,east_m,north_m,up_m and optionally sigma_m";
            let x = numbers(4, 5, columns)?;
            let time_s = x[0] + logs.positions[sensor].time_offset_s;
            let position_m = Vec3::new(x[1], x[2], x[3]) - project.origin_m;
            let sigma_m = x.get(4).copied();
            Ok(Record::Position(
                sensor,
                PositionFix::with_sigma(time_s, position_m, sigma_m),
            ))
        }
        ("heading", None) => {
            let x = numbers(2, 3, "time_s,heading_deg and optionally sigma_deg")?;
            let offset_s = logs.heading.as_ref().map_or(0.0, |log| log.time_offset_s);
            let sigma_rad = x.get(2).map(|sigma| sigma.to_radians());
            Ok(Record::Heading(HeadingFix::new(
                x[0] + offset_s,
                x[1].to_radians(),
                sigma_rad,
            )))
        }
        _ => {
            let mut names = vec!["imu".to_owned(), "heading".to_owned()];
            names.extend(logs.settings.positions.iter().map(|p| p.name.clone()));
            let found = name.chars().take(40).collect::<String>();
            Err((
                format!("a record of `{found}`"),
                format!("one of {}", names.join(", ")),
            ))
        }
    }
}
