//! A summary of the content of a file: numbers with units, collected without keeping the content in memory.

mod gather;
mod inspection;
mod picture;
mod recording;
mod streams;

use super::detect::detect;
use super::kind::{Frame, Kind};
use super::read::{read_cloud, read_trajectory};
use crate::error::{Error, Result};
use crate::format::cloud::gathering::counted;
use crate::format::file::{CHUNK_POINTS, nothing_in};
use crate::format::input::Input;
use crate::format::las::columns::{PoseColumns, extra_names};
use crate::format::las::file::LasFile;
use crate::format::mountings::bonn_xml::read_mounting;
use crate::format::plausible::check_point;
use crate::format::poses::{navigation, sbet};
use crate::format::text::table::{Columns, Table};
use crate::geometry::{EulerConvention, euler::euler_deg_from_rotation};
use gather::POINT;
use gather::StreamSummary;
pub use inspection::{Bounds, Gap, Inspection};
use recording::inspect_recording;
use streams::{
    inspect_geographic, inspect_geographic_poses, inspect_heading, inspect_imu, inspect_poses,
    inspect_positions, inspect_profiles,
};

/// Reads a whole file and summarises its content.
///
/// # Errors
/// All errors of the file's reader; a project file, which is not data.
pub fn inspect(input: impl Into<Input>) -> Result<Inspection> {
    let input = &input.into();
    let format = detect(input)?;
    let (_, bytes) = input.open()?;
    let mut report = Inspection {
        path: input.path().to_owned(),
        format,
        frame: String::new(),
        bytes,
        count: 0,
        epochs: None,
        span_s: None,
        rate_hz: None,
        jitter_s: None,
        picture: Vec::new(),
        gaps: Vec::new(),
        bounds: Vec::new(),
        columns: Vec::new(),
        notes: Vec::new(),
    };
    let kind = format.0;
    if !kind.note.is_empty() {
        report.notes.push(kind.note.to_owned());
    }
    match (kind.id, &kind.columns) {
        (_, Some(columns)) => inspect_table(input, columns, &mut report)?,
        ("las" | "laz", _) => inspect_las(input, &mut report)?,
        ("sbet", _) => inspect_sbet(input, &mut report)?,
        ("bonn-mounting", _) => inspect_mounting(input, &mut report)?,
        ("project", _) => {
            return Err(Error::data(
                format!("{} is a project, not data", input.path().display()),
                "inspect the files that it names, or inspect it as a project",
            ));
        }
        ("ros-bag", _) => inspect_recording(input, kind, &mut report)?,
        _ if kind.profiles.is_some() => inspect_profiles(input, &mut report)?,
        _ if kind.geographic_poses.is_some() => inspect_log(input, kind, &mut report)?,
        _ if kind.poses.is_some() => inspect_poses(input, &mut report)?,
        _ if kind.cloud.is_some() && kind.positions.is_none() => inspect_cloud(input, &mut report)?,
        _ => inspect_log(input, kind, &mut report)?,
    }
    report.frame = match kind.frame {
        Frame::Fixed(text) => text.to_owned(),
        Frame::OfFile(tell) => tell(input)?,
    };
    report.notes.extend(input.remarks());
    Ok(report)
}

fn inspect_table(input: &Input, columns: &Columns, report: &mut Inspection) -> Result<()> {
    let wanted: Vec<&str> = columns
        .needed
        .iter()
        .chain(columns.optional)
        .copied()
        .collect();
    let find = |names: [&str; 2]| wanted.iter().position(|name| names.contains(name));
    let time = find(["time_s", "sec_of_day"]);
    let range = find(["slope_distance_m", "slope_dist_m"]);
    let [east, north, up] = ["east_m", "north_m", "up_m"].map(|name| find([name; 2]));
    let mut without_range = 0;
    let mut table = Table::open(input, columns)?;
    let mut summary = StreamSummary::of_columns(&wanted);
    let mut row = vec![0.0; wanted.len()];
    while table.next_row(&mut row)? {
        let place = [east, north, up].map(|at| at.map_or(f64::NAN, |i| row[i]));
        let time_s = time.map_or(f64::NAN, |i| row[i]);
        check_point(input.path(), summary.count, &place.into(), time_s)?;
        let has_range = !range.is_some_and(|i| row[i] <= 0.0);
        without_range += usize::from(!has_range);
        let values = if has_range { &row[..] } else { &[] };
        summary.add(time.map_or(f64::NAN, |i| row[i]), values.iter().copied());
    }
    if summary.count == 0 {
        return Err(nothing_in(input.path(), "row"));
    }
    if without_range > 0 {
        report.notes.push(format!(
            "{without_range} rows without a range: they are rejected when read, and not included in the \
             values above"
        ));
    }
    report.columns = table.names().to_vec();
    if report.format.has_positions() {
        report
            .notes
            .extend(navigation::remark_on_angles(table.names()));
    }
    let repeated = summary.clock.repeated;
    summary.report(report)?;
    if let Some(time) = time {
        report.bounds.retain(|bounds| bounds.column != wanted[time]);
    }
    if report.format.0.poses.is_some() {
        // The rows that make no pose, and the order of times.
        read_trajectory(input)?;
    }
    // In profiles and clouds many points share a time; in logs no two records should.
    let kind = report.format.0;
    let is_log = kind.imu.is_some() || kind.positions.is_some() || kind.heading.is_some();
    if is_log && repeated > 0 {
        report.notes.push(format!(
            "{repeated} rows repeat the time of the previous row: they are dropped and reported when \
             the trajectory is estimated"
        ));
    }
    Ok(())
}

/// Summarises a log that may hold several kinds of measurements: the first kind that can be read, in the order
/// poses with latitudes, IMU, headings, geographic positions, positions, and a note of the other contents.
fn inspect_log(input: &Input, kind: &Kind, report: &mut Inspection) -> Result<()> {
    if let Some(contents) = kind.contents {
        report.notes.push(contents(input)?);
    }
    let mut last_error = None;
    for inspect in [
        inspect_geographic_poses,
        inspect_imu,
        inspect_heading,
        inspect_geographic,
        inspect_positions,
    ] {
        match inspect(input, kind) {
            Some(Ok(summary)) => {
                return summary.report(report);
            }
            Some(Err(error)) => last_error = Some(error),
            None => {}
        }
    }
    last_error.map_or(Ok(()), Err)
}

fn inspect_sbet(input: &Input, report: &mut Inspection) -> Result<()> {
    let mut summary = StreamSummary::of_columns(&sbet::COLUMNS[1..]);
    sbet::for_each(input, |row| {
        summary.add(row[0], row[1..].iter().copied());
    })?;
    report.columns = sbet::COLUMNS.map(str::to_owned).to_vec();
    summary.report(report)
}

fn inspect_las(input: &Input, report: &mut Inspection) -> Result<()> {
    let mut file = LasFile::open(input)?;
    let mut summary = StreamSummary::of_columns(&POINT);
    let (has_time, mut untimed) = (file.has_time(), 0);
    while file.read(CHUNK_POINTS, |_, point| {
        let p = &point.position;
        untimed += u64::from(has_time && point.time_s.is_nan());
        summary.add(point.time_s, [p.x, p.y, p.z, f64::from(point.intensity)]);
        Ok(())
    })? > 0
    {}
    report.columns = extra_names(&file);
    report.notes.extend(file.remarks());
    if untimed > 0 {
        report
            .notes
            .push(format!("{} without a time", counted(untimed, "point")));
    }
    if summary.count == 0 {
        report
            .notes
            .push("the header announces no points".to_owned());
    }
    if PoseColumns::of(&file).is_some() {
        report.notes.push(
            "every point carries the sensor's pose: the file can serve as profiles and as a \
             trajectory"
                .to_owned(),
        );
    }
    summary.report(report)
}

fn inspect_cloud(input: &Input, report: &mut Inspection) -> Result<()> {
    let cloud = read_cloud(input)?;
    let mut summary = StreamSummary::of_columns(&POINT);
    for (i, p) in cloud.points.iter().enumerate() {
        let intensity = cloud.intensity.get(i).map_or(f64::NAN, |v| f64::from(*v));
        let time_s = cloud.time_s.get(i).copied().unwrap_or(f64::NAN);
        summary.add(time_s, [p.x, p.y, p.z, intensity]);
    }
    summary.report(report)
}

fn inspect_mounting(input: &Input, report: &mut Inspection) -> Result<()> {
    let mounting = read_mounting(input)?;
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
