//! Readers of each kind of measurement, for every format that holds it.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::detect::{detect, other_table};
use super::file::nothing_in;
use super::input::Input;
use super::kind::{Format, Frame, Kind, Reader};
use super::kinds::KINDS;
use super::plausible::{check_place, check_time};
use super::recorded::{SensorClock, sensor_clock, station_times};
use crate::cloud::PointCloud;
use crate::error::{Error, Location, Result};
use crate::format::cloud::sink::CloudClock;
use crate::format::cloud::table as cloud_table;
use crate::format::las::file::LasFile;
use crate::format::log::{positions, tables as native};
use crate::format::poses::order::in_time_order;
use crate::format::poses::table as pose_table;
use crate::format::profiles::reader::ProfileReader;
use crate::format::profiles::table as profile;
use crate::format::text::civil::adjusted_gps_from_unix_s;
use crate::geometry::{BodyAxes, Projection, Vec3};
use crate::sensor::{
    Continued, GeographicFix, GeographicPose, HeadingFix, ImuSample, Observations, PoseRecord,
    Positions, ScanPoint, Timed, project_fixes, project_poses,
};

/// The reader that `select` chooses from the format of a file. A text table with other columns, or a file of an
/// unknown format, is given to the reader of the native `table`, which names the missing column.
///
/// # Errors
/// A file that cannot be opened, or of a format without such measurements.
fn reader<T>(
    input: &Input,
    what: &str,
    select: impl Fn(&Kind) -> Option<T>,
    table: &'static Kind,
) -> Result<T> {
    let kind = match detect(input) {
        Ok(format) => format.0,
        Err(error @ Error::Io { .. }) => return Err(error),
        Err(_) => table,
    };
    let is_table = kind.columns.is_some();
    if let Some(reader) = select(kind).or_else(|| select(table).filter(|_| is_table)) {
        return Ok(reader);
    }
    let names = KINDS.iter().filter(|kind| select(kind).is_some());
    let names: Vec<&str> = names.map(|kind| kind.name).collect();
    let expected = format!("{what}: {}", names.join(", "));
    Err(Error::format(
        input.path(),
        Location::Whole,
        kind.name,
        expected,
    ))
}

/// Reads an IMU log. Rows are returned in the order of the file.
///
/// # Errors
/// A file of another format, and errors of the format's reader.
pub fn read_imu(input: impl Into<Input>) -> Result<Vec<ImuSample>> {
    let input = &input.into();
    let mut samples = reader(input, "an IMU log", |kind| kind.imu, &native::IMU_TABLE)?(input)?;
    put_on_common_time(input, &mut samples)?;
    check_times(input, &samples)?;
    Ok(samples)
}

/// Reads a heading log. Rows are returned in the order of the file.
///
/// # Errors
/// A file of another format, and errors of the format's reader.
pub fn read_heading(input: impl Into<Input>) -> Result<Vec<HeadingFix>> {
    let input = &input.into();
    let select = |kind: &Kind| kind.heading;
    let mut fixes = reader(input, "a heading log", select, &native::HEADING_TABLE)?(input)?;
    put_on_common_time(input, &mut fixes)?;
    check_times(input, &fixes)?;
    Ok(fixes)
}

/// Reads a position log, rows in the order of the file. `observations` selects coordinates or polar
/// observations if a table has both, and gives the instrument for polar observations. A row without a range is
/// rejected; it is not an error.
///
/// # Errors
/// A file of another format, errors of the format's reader, no row with a range.
pub fn read_positions(input: impl Into<Input>, observations: &Observations) -> Result<Positions> {
    let input = &input.into();
    let select = |kind: &Kind| kind.positions;
    let read = reader(input, "a position log", select, &positions::POSITION_TABLE)?;
    let mut positions = read(input, observations)?;
    put_on_common_time(input, &mut positions.fixes)?;
    let corrected_times: HashMap<u64, f64> = station_times(input)?
        .into_iter()
        .map(|(written_s, corrected_s)| (written_s.to_bits(), corrected_s))
        .collect();
    for fix in &mut positions.fixes {
        if let Some(corrected_s) = corrected_times.get(&fix.time_s.to_bits()) {
            fix.time_s = *corrected_s;
        }
    }
    check_times(input, &positions.fixes)?;
    for fix in &positions.fixes {
        check_place(input.path(), &fix.position_m)?;
    }
    Ok(positions)
}

fn check_times<T: Timed>(input: &Input, records: &[T]) -> Result<()> {
    let mut times_s = records.iter().map(T::time_s);
    times_s.try_for_each(|time_s| check_time(input.path(), time_s))
}

/// Converts the times of a recorded sensor to the common time of its recording.
fn put_on_common_time<T: Timed>(input: &Input, records: &mut [T]) -> Result<()> {
    if let Some(clock) = sensor_clock(input)? {
        convert_times(&clock, records);
    }
    Ok(())
}

fn convert_times<T: Timed>(clock: &SensorClock, records: &mut [T]) {
    for record in records {
        *record.time_s_mut() = clock.common_s(record.time_s());
    }
}

/// Reads a trajectory in time order. Times that start again at midnight or at the end of the week are continued; poses that
/// repeat a time, and messages of a recording out of order, are left out, which the input remarks.
///
/// # Errors
/// A file of another format, and errors of the format's reader; latitudes and longitudes; a line
/// or record with an earlier time than that before it; no poses.
pub fn read_trajectory(input: impl Into<Input>) -> Result<Vec<PoseRecord>> {
    let input = &input.into();
    let refuse: Reader<Vec<PoseRecord>> = refuse_geographic;
    let select = |kind: &Kind| kind.poses.or(kind.geographic_poses.map(|_| refuse));
    let read = reader(input, "a trajectory", select, &pose_table::POSE_TABLE)?;
    checked(input, in_time_order(input, read(input)?)?)
}

/// Refuses poses with latitudes and longitudes, which need a projection. Damage to the file is reported first.
fn refuse_geographic(input: &Input) -> Result<Vec<PoseRecord>> {
    read_geographic_poses(input)?;
    Err(unprojected(input.path()))
}

/// The poses, whose times and places a sensor can have.
fn checked(input: &Input, poses: Vec<PoseRecord>) -> Result<Vec<PoseRecord>> {
    for pose in &poses {
        check_time(input.path(), pose.time_s)?;
        check_place(input.path(), &pose.world_from_body.translation_m)?;
    }
    Ok(poses)
}

/// Reads the positions of a log with latitudes and longitudes, in the order of the file.
///
/// # Errors
/// A file of another format, and errors of the format's reader.
pub fn read_geographic(input: impl Into<Input>) -> Result<Vec<GeographicFix>> {
    let input = &input.into();
    let select = |kind: &Kind| kind.geographic;
    let mut fixes = reader(
        input,
        "latitudes and longitudes",
        select,
        &positions::POSITION_TABLE,
    )?(input)?;
    put_on_common_time(input, &mut fixes)?;
    check_times(input, &fixes)?;
    Ok(fixes)
}

/// Reads poses with latitudes and longitudes, in the order of the file.
///
/// # Errors
/// A file of another format, and errors of the format's reader.
pub fn read_geographic_poses(input: impl Into<Input>) -> Result<Vec<GeographicPose>> {
    let input = &input.into();
    let what = "poses with latitudes and longitudes";
    reader(
        input,
        what,
        |kind| kind.geographic_poses,
        &pose_table::POSE_TABLE,
    )?(input)
}

/// Reads a position log like [`read_positions`], and projects geographic positions.
///
/// # Errors
/// Those of [`read_positions`]; geographic positions if `crs` is `None` or if they lie outside of it.
pub fn read_projected_positions(
    input: impl Into<Input>,
    observations: &Observations,
    crs: Option<&Projection>,
) -> Result<Positions> {
    let input = &input.into();
    let is_geographic = |format: Format| format.has_geographic() && !format.has_positions();
    if !detect(input).is_ok_and(is_geographic) {
        return read_positions(input, observations);
    }
    let crs = crs.ok_or_else(|| unprojected(input.path()))?;
    let geographic = read_geographic(input)?;
    let fixes = project_fixes(&geographic, crs).map_err(|error| of_file(error, input))?;
    let qualities = geographic.iter().map(|fix| fix.quality);
    Ok(Positions {
        qualities: qualities.collect::<Option<_>>().unwrap_or_default(),
        ..Positions::of(fixes)
    })
}

/// Reads a trajectory like [`read_trajectory`], for a body with these axes. Geographic poses are projected. Poses with
/// roll, pitch and heading, which refer to a body with x forward, y left, z up, are turned to these axes.
///
/// # Errors
/// Those of [`read_trajectory`]; geographic poses if `crs` is `None` or if they lie outside of it.
pub fn read_projected_trajectory(
    input: impl Into<Input>,
    axes: BodyAxes,
    crs: Option<&Projection>,
) -> Result<Vec<PoseRecord>> {
    let input = &input.into();
    let format = detect(input).ok();
    let is_geographic = format.is_some_and(Format::has_geographic_poses);
    let mut poses = match crs.filter(|_| is_geographic) {
        Some(crs) => {
            let poses = read_geographic_poses(input)?;
            let poses = project_poses(&poses, crs).map_err(|e| of_file(e, input))?;
            checked(input, in_time_order(input, poses)?)?
        }
        None => read_trajectory(input)?,
    };
    if format.is_some_and(Format::has_navigation_angles) {
        for pose in &mut poses {
            pose.world_from_body.rotation *= axes.body_from_flu();
        }
    }
    Ok(poses)
}

/// An error of data, with the file from which they come.
fn of_file(error: Error, input: &Input) -> Error {
    match error {
        Error::Data {
            problem, remedy, ..
        } => Error::data(format!("{}: {problem}", input.path().display()), remedy),
        other => other,
    }
}

fn unprojected(path: &Path) -> Error {
    Error::format(
        path,
        Location::Whole,
        "latitudes and longitudes",
        "the projected system of the world, such as EPSG:25832: `crs` in [frame] of a project, `--crs` of convert",
    )
}

/// Reads a cloud. Points marked as not measured are left out; the input remarks what its file holds that is not in it.
///
/// # Errors
/// A file that is missing, damaged, of another format, or without points; coordinates and times beyond
/// [`MOST_COORDINATE_M`](super::MOST_COORDINATE_M) and [`MOST_TIME_S`](super::MOST_TIME_S).
pub fn read_cloud(input: impl Into<Input>) -> Result<PointCloud> {
    let input = &input.into();
    if detect(input).is_err()
        && let Ok(Some(error)) = other_table(input)
    {
        // The reader of the native table would say less.
        return Err(error);
    }
    let cloud = reader(
        input,
        "a cloud",
        |kind| kind.cloud,
        &cloud_table::CLOUD_TABLE,
    )?(input)?;
    if cloud.points.is_empty() {
        return Err(nothing_in(input.path(), "point"));
    }
    let cloud = if detect(input).is_ok_and(Format::has_positions) {
        with_continued_times(input, cloud)
    } else {
        cloud
    };
    if u32::try_from(cloud.points.len()).is_err() {
        return Err(Error::format(
            input.path(),
            Location::Whole,
            format!("{} points", cloud.points.len()),
            format!("{} at most: thin the cloud", u32::MAX),
        ));
    }
    Ok(cloud)
}

/// The points of a log of positions, whose times continue past midnight and the end of the week.
fn with_continued_times(input: &Input, mut cloud: PointCloud) -> PointCloud {
    let mut times = Continued::default();
    let measured = cloud.time_s.iter_mut().filter(|time_s| !time_s.is_nan());
    measured.for_each(|time_s| *time_s = times.at(*time_s));
    if let Some(remark) = times.remark() {
        input.remark(remark);
    }
    cloud
}

/// The coordinate reference system of a cloud file, as WKT; `None` if the file names none.
///
/// # Errors
/// A file that is missing, damaged or of an unknown format.
pub fn crs_wkt(input: impl Into<Input>) -> Result<Option<String>> {
    let input = &input.into();
    match detect(input)?.0.wkt {
        Some(reader) => reader(input),
        None => Ok(None),
    }
}

/// The metres of a step east, north and up in a LAS or LAZ file whose coordinates are converted to metres; `None` if
/// they are metres, and for files of other formats.
///
/// # Errors
/// A file that is missing, damaged or of an unknown format.
pub fn unit_m(input: impl Into<Input>) -> Result<Option<Vec3>> {
    let input = &input.into();
    if !detect(input)?.is_las() {
        return Ok(None);
    }
    let file = LasFile::reopen(input)?;
    Ok(file.converted().map(|(_, metres)| metres))
}

/// Units and frame of a file's content, and whether the file states them or they are assumed, in one line.
///
/// # Errors
/// A file that is missing, damaged or of an unknown format.
pub fn describe_frame(input: impl Into<Input>) -> Result<String> {
    let input = &input.into();
    match detect(input)?.0.frame {
        Frame::Fixed(text) => Ok(text.to_owned()),
        Frame::OfFile(reader) => reader(input),
    }
}

/// Opens a recording of a scanner, which is read in bounded memory if the format allows it.
///
/// # Errors
/// A file that is missing, empty, or of a format without points in the frame of a scanner.
pub fn open_profiles(input: impl Into<Input>) -> Result<Box<dyn ProfileReader>> {
    let input = &input.into();
    let select = |kind: &Kind| kind.profiles;
    let profiles = reader(input, "profiles", select, &profile::PROFILE_TABLE)?(input)?;
    Ok(Box::new(OnCommonTime {
        profiles,
        clock: sensor_clock(input)?,
        path: input.path().to_owned(),
    }))
}

/// Opens a recording as [`open_profiles`] does, for poses on this clock: LAS with adjusted standard GPS time, which is
/// read as Unix time, is converted back if the poses have adjusted standard GPS time, too.
///
/// # Errors
/// Those of [`open_profiles`].
pub fn open_profiles_on(
    input: impl Into<Input>,
    clock: CloudClock,
) -> Result<Box<dyn ProfileReader>> {
    let input = &input.into();
    let profiles = open_profiles(input)?;
    let is_converted = clock == CloudClock::AdjustedGps
        && detect(input).is_ok_and(Format::is_las)
        && LasFile::reopen(input)?.has_adjusted_gps_time();
    Ok(if is_converted {
        Box::new(OnAdjustedGps(profiles))
    } else {
        profiles
    })
}

/// Profiles with Unix times that are converted to adjusted standard GPS time.
struct OnAdjustedGps(Box<dyn ProfileReader>);

impl ProfileReader for OnAdjustedGps {
    fn next_chunk(&mut self, into: &mut Vec<ScanPoint>) -> Result<bool> {
        let is_more = self.0.next_chunk(into)?;
        for point in into {
            point.time_s = adjusted_gps_from_unix_s(point.time_s);
        }
        Ok(is_more)
    }

    fn bytes_read(&self) -> u64 {
        self.0.bytes_read()
    }

    fn bytes_total(&self) -> u64 {
        self.0.bytes_total()
    }
}

/// Profiles of a scanner, of a recorded one with times on the common clock of its recording.
struct OnCommonTime {
    profiles: Box<dyn ProfileReader>,
    clock: Option<SensorClock>,
    path: PathBuf,
}

impl ProfileReader for OnCommonTime {
    fn next_chunk(&mut self, into: &mut Vec<ScanPoint>) -> Result<bool> {
        let is_more = self.profiles.next_chunk(into)?;
        if let Some(clock) = &self.clock {
            convert_times(clock, into);
        }
        for point in into.iter() {
            check_time(&self.path, point.time_s)?;
            check_place(&self.path, &point.position_m)?;
        }
        Ok(is_more)
    }

    fn bytes_read(&self) -> u64 {
        self.profiles.bytes_read()
    }

    fn bytes_total(&self) -> u64 {
        self.profiles.bytes_total()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::write_sbet;
    use crate::geometry::{Rotation, WorldFromBody};

    #[test]
    fn a_missing_cloud_has_no_unit() {
        let folder = tempfile::tempdir().unwrap();
        let error = unit_m(&folder.path().join("a.las"))
            .unwrap_err()
            .to_string();
        assert!(error.contains("a.las"), "{error}");
    }

    #[test]
    fn geographic_poses_take_the_axes_of_the_body() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.sbet");
        let crs = Projection::new("EPSG:25832").unwrap();
        let pose = |i: u32| {
            let turned = Rotation::from_euler_angles(0.1, -0.05, 0.3 + 0.01 * f64::from(i));
            let at = Vec3::new(364_000.0 + f64::from(i), 5_621_000.0, 100.0);
            PoseRecord::new(f64::from(i), WorldFromBody::new(turned, at))
        };
        let poses: Vec<PoseRecord> = (0..5).map(pose).collect();
        write_sbet(&path, &poses, &crs).unwrap();
        let read = |axes| read_projected_trajectory(&path, axes, Some(&crs)).unwrap();
        let (flu, frd) = (read(BodyAxes::Flu), read(BodyAxes::Frd));
        for ((pose, flu), frd) in poses.iter().zip(&flu).zip(&frd) {
            let axis_of = |record: &PoseRecord, axis| record.world_from_body.rotation * axis;
            assert!((axis_of(pose, Vec3::y()) - axis_of(flu, Vec3::y())).norm() < 1e-9);
            assert!((axis_of(pose, Vec3::x()) - axis_of(frd, Vec3::x())).norm() < 1e-9);
            assert!((axis_of(pose, Vec3::z()) + axis_of(frd, Vec3::z())).norm() < 1e-9);
            let apart = pose.world_from_body.translation_m - frd.world_from_body.translation_m;
            assert!(apart.norm() < 1e-6);
        }
        let error = read_projected_trajectory(&path, BodyAxes::Frd, None).unwrap_err();
        let error = error.to_string();
        assert!(error.contains("a.sbet") && error.contains("crs"), "{error}");
    }
}
