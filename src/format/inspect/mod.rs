//! What a file holds, in numbers with units, without keeping it in memory.

mod gather;
mod inspection;

use std::path::Path;

use super::cloud::read_cloud;
use super::detect::{Format, TABLES, detect};
use super::las::{LasFile, PoseColumns, extra_names};
use super::mounting::read_mounting;
use super::profile::open_profiles;
use super::sbet;
use super::table::{Columns, Table};
use super::trajectory::read_trajectory;
use crate::error::{Error, Result};
use crate::format::file::{CHUNK_POINTS, nothing_in, open};
use crate::geometry::{EulerConvention, euler::euler_deg_from_rotation};
use gather::Gather;
pub use inspection::{Bounds, Gap, Inspection};

/// Columns of points.
const POINT: [&str; 4] = ["x_m", "y_m", "z_m", "intensity"];

/// Reads a file through and says what it holds.
///
/// # Errors
/// Whatever its reader finds wrong, and project files, which are no data.
pub fn inspect(path: &Path) -> Result<Inspection> {
    let format = detect(path)?;
    let (_, bytes) = open(path)?;
    let mut report = Inspection {
        path: path.to_owned(),
        format,
        bytes,
        count: 0,
        epochs: None,
        span_s: None,
        rate_hz: None,
        gaps: Vec::new(),
        bounds: Vec::new(),
        columns: Vec::new(),
        notes: Vec::new(),
    };
    if let Some((_, columns)) = TABLES.iter().find(|(table, _)| *table == format) {
        inspect_table(path, columns, &mut report)?;
        return Ok(report);
    }
    match format {
        Format::BonnProfiles => inspect_profiles(path, &mut report)?,
        Format::BonnTrajectory | Format::Tum => inspect_poses(path, &mut report)?,
        Format::Sbet => inspect_sbet(path, &mut report)?,
        Format::Las | Format::Laz => inspect_las(path, &mut report)?,
        Format::BonnMounting => inspect_mounting(path, &mut report)?,
        Format::Project => {
            return Err(Error::data(
                format!("{} is a project, not data", path.display()),
                "name the files of the project, or inspect it as a project",
            ));
        }
        _ => inspect_cloud(path, &mut report)?,
    }
    Ok(report)
}

fn inspect_table(path: &Path, columns: &Columns, report: &mut Inspection) -> Result<()> {
    let wanted: Vec<&str> = columns
        .needed
        .iter()
        .chain(columns.optional)
        .copied()
        .collect();
    let find = |names: [&str; 2]| wanted.iter().position(|name| names.contains(name));
    let time = find(["time_s", "sec_of_day"]);
    let range = find(["slope_distance_m", "slope_dist_m"]);
    let mut without_range = 0;
    let mut table = Table::open(path, columns)?;
    let mut seen = Gather::of(&wanted);
    let mut row = vec![0.0; wanted.len()];
    while table.next_row(&mut row)? {
        let has_range = !range.is_some_and(|i| row[i] <= 0.0);
        without_range += usize::from(!has_range);
        let values = if has_range { &row[..] } else { &[] };
        seen.see(time.map_or(f64::NAN, |i| row[i]), values.iter().copied());
    }
    if seen.count == 0 {
        return Err(nothing_in(path, "row"));
    }
    if without_range > 0 {
        report.notes.push(format!(
            "{without_range} rows have no range: they are rejected on reading, and not among the \
             values above"
        ));
    }
    match report.format {
        Format::TpsCsv => report.notes.push(
            "coordinates and polar observations: the project chooses with observations = \
             \"cartesian\" or \"polar\"; vertical angles are from the horizon (vertical_angle = \
             \"elevation\")"
                .to_owned(),
        ),
        Format::PolarCsv => report.notes.push(
            "polar observations: the project gives station_m and station_orientation_deg"
                .to_owned(),
        ),
        _ => {}
    }
    report.columns = table.names().to_vec();
    let repeated = seen.clock.repeated;
    seen.report(report);
    if let Some(time) = time {
        report.bounds.retain(|bounds| bounds.column != wanted[time]);
    }
    // Of profiles and clouds many points share a time, of logs no two records should.
    let is_log = matches!(
        report.format,
        Format::ImuCsv | Format::PrismCsv | Format::PolarCsv | Format::TpsCsv | Format::HeadingCsv
    );
    if is_log && repeated > 0 {
        report.notes.push(format!(
            "{repeated} rows repeat the time of the row before: they are dropped and named when \
             the trajectory is estimated"
        ));
    }
    Ok(())
}

fn inspect_profiles(path: &Path, report: &mut Inspection) -> Result<()> {
    let mut reader = open_profiles(path)?;
    let mut chunk = Vec::new();
    let mut seen = Gather::of(&POINT);
    while reader.next_chunk(&mut chunk)? {
        for point in &chunk {
            let p = &point.position_m;
            seen.see(point.time_s, [p.x, p.y, p.z, f64::from(point.intensity)]);
        }
    }
    seen.report(report);
    Ok(())
}

fn inspect_poses(path: &Path, report: &mut Inspection) -> Result<()> {
    let mut seen = Gather::of(&POINT[..3]);
    for pose in read_trajectory(path)? {
        let position = pose.world_from_body.translation_m;
        seen.see(pose.time_s, position.iter().copied());
    }
    seen.report(report);
    Ok(())
}

fn inspect_sbet(path: &Path, report: &mut Inspection) -> Result<()> {
    let mut seen = Gather::of(&sbet::COLUMNS[1..]);
    sbet::for_each(path, |row| {
        seen.see(row[0], row[1..].iter().copied());
    })?;
    report.columns = sbet::COLUMNS.map(str::to_owned).to_vec();
    report.notes.push(
        "geographic positions and a wander azimuth: export projected coordinates to use it"
            .to_owned(),
    );
    seen.report(report);
    Ok(())
}

fn inspect_las(path: &Path, report: &mut Inspection) -> Result<()> {
    let mut file = LasFile::open(path)?;
    let mut seen = Gather::of(&POINT);
    while file.read(CHUNK_POINTS, |_, point| {
        let p = &point.position;
        seen.see(point.time_s, [p.x, p.y, p.z, f64::from(point.intensity)]);
        Ok(())
    })? > 0
    {}
    report.columns = extra_names(&file);
    if PoseColumns::of(&file).is_some() {
        report.notes.push(
            "every point carries the pose of the sensor: the file serves as profiles and as \
             trajectory"
                .to_owned(),
        );
    }
    seen.report(report);
    Ok(())
}

fn inspect_cloud(path: &Path, report: &mut Inspection) -> Result<()> {
    let cloud = read_cloud(path)?;
    let mut seen = Gather::of(&POINT);
    for (i, p) in cloud.points.iter().enumerate() {
        let intensity = cloud.intensity.get(i).map_or(f64::NAN, |v| f64::from(*v));
        let time_s = cloud.time_s.get(i).copied().unwrap_or(f64::NAN);
        seen.see(time_s, [p.x, p.y, p.z, intensity]);
    }
    seen.report(report);
    Ok(())
}

fn inspect_mounting(path: &Path, report: &mut Inspection) -> Result<()> {
    let mounting = read_mounting(path)?;
    let t = mounting.translation_m;
    let angles = euler_deg_from_rotation(EulerConvention::Bonn, &mounting.rotation);
    report.count = 1;
    report.notes.push(format!(
        "translation ({}, {}, {}) m, rotation ({:.4}, {:.4}, {:.4}) degrees in the convention \
         `bonn`",
        t.x, t.y, t.z, angles[0], angles[1], angles[2]
    ));
    Ok(())
}
