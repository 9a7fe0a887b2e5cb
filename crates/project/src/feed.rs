//! The records of a drive in common time, with the origin subtracted. They come from whole logs, excerpts of
//! logs that grow, or the lines of a stream. Format readers convert units and frames; times are continued past midnight,
//! and time offsets and the origin are applied, here and nowhere else.

use crate::error::{Error, Result};
use crate::format::{self, Input};
use crate::geometry::Vec3;
use crate::project::{Logs, Project};
use crate::sensor::{Continued, HeadingFix, ImuSample, PositionFix, Positions, Record};
use crate::trajectory::TrajectorySettings;

/// Reads the logs of a project. Methods that read a log take its `times`, which continue those of the excerpts read
/// before, and `clock`, which may convert the times of the log before the project's time offset is added; [`log_clock`]
/// leaves them as they are.
#[derive(Clone, Copy)]
pub struct Feed<'a> {
    project: &'a Project,
    logs: &'a Logs,
    origin_m: Vec3,
}

/// The times of the sensors in a stream of lines so far.
#[derive(Debug, Clone)]
pub struct StreamTimes {
    imu: Continued,
    heading: Continued,
    positions: Vec<Continued>,
}

/// Leaves the times of a log as they are.
pub fn log_clock<T>(_: &mut Vec<T>) {}

fn remark(input: &Input, text: Option<String>) {
    if let Some(text) = text {
        input.remark(text);
    }
}

impl<'a> Feed<'a> {
    /// The feed of these logs of `project`, with the origin that it states, or none.
    pub fn new(project: &'a Project, logs: &'a Logs) -> Self {
        Self {
            project,
            logs,
            origin_m: project.origin_m.unwrap_or_default(),
        }
    }

    /// The same feed with another origin, metres.
    pub fn with_origin(self, origin_m: Vec3) -> Self {
        Self { origin_m, ..self }
    }

    /// The settings of the trajectory, with the origin subtracted from stations.
    pub fn settings(&self) -> TrajectorySettings {
        let mut settings = self.logs.settings.clone();
        let positions = settings.positions.iter_mut();
        for station_m in positions.filter_map(|position| position.station_m.as_mut()) {
            *station_m -= self.origin_m;
        }
        settings
    }

    /// The samples of the IMU, in the order of the file.
    ///
    /// # Errors
    /// Those of [`format::read_imu`].
    pub fn imu(
        &self,
        input: impl Into<Input>,
        times: &mut Continued,
        clock: impl FnOnce(&mut Vec<ImuSample>),
    ) -> Result<Vec<ImuSample>> {
        let input = &input.into();
        let mut samples = format::read_imu(input)?;
        let units = self.logs.imu_units;
        samples.iter_mut().for_each(|sample| units.convert(sample));
        remark(input, times.continue_times(&mut samples));
        clock(&mut samples);
        samples.iter_mut().for_each(|sample| self.place_imu(sample));
        Ok(samples)
    }

    /// The headings, in the order of the file.
    ///
    /// # Errors
    /// Those of [`format::read_heading`].
    pub fn heading(
        &self,
        input: impl Into<Input>,
        times: &mut Continued,
        clock: impl FnOnce(&mut Vec<HeadingFix>),
    ) -> Result<Vec<HeadingFix>> {
        let input = &input.into();
        let mut fixes = format::read_heading(input)?;
        remark(input, times.continue_times(&mut fixes));
        remark(input, times.remark_on_side());
        clock(&mut fixes);
        fixes.iter_mut().for_each(|fix| self.place_heading(fix));
        Ok(fixes)
    }

    /// The positions of a sensor, in the order of the file, and the rows without a measurement. An excerpt may hold no
    /// position.
    ///
    /// # Errors
    /// Those of [`format::read_projected_positions`].
    pub fn positions(
        &self,
        sensor: usize,
        input: impl Into<Input>,
        times: &mut Continued,
        clock: impl FnOnce(&mut Vec<PositionFix>),
    ) -> Result<Positions> {
        let input = &input.into();
        let log = &self.logs.positions[sensor];
        let crs = self.project.crs.as_ref();
        let mut positions = format::read_projected_positions(input, &log.observations, crs)?;
        remark(input, times.continue_times(&mut positions.fixes));
        remark(input, times.remark_on_side());
        let fixed_m = &self.logs.settings.positions[sensor].sigma_m;
        let qualities = &positions.qualities;
        let by_quality = log
            .by_quality
            .apply(&mut positions.fixes, qualities, fixed_m);
        remark(input, by_quality);
        clock(&mut positions.fixes);
        for fix in &mut positions.fixes {
            self.place_position(sensor, fix);
        }
        Ok(positions)
    }

    fn place_imu(&self, sample: &mut ImuSample) {
        sample.time_s += self.logs.imu.time_offset_s;
    }

    fn place_heading(&self, fix: &mut HeadingFix) {
        let log = self.logs.heading.as_ref();
        fix.time_s += log.map_or(0.0, |log| log.time_offset_s);
    }

    fn place_position(&self, sensor: usize, fix: &mut PositionFix) {
        fix.time_s += self.logs.positions[sensor].time_offset_s;
        fix.position_m -= self.origin_m;
    }

    /// The times of a stream of lines before the first one.
    pub fn stream_times(&self) -> StreamTimes {
        StreamTimes {
            imu: Continued::default(),
            heading: Continued::default(),
            positions: vec![Continued::default(); self.logs.positions.len()],
        }
    }

    /// Puts the other sensors in a stream of lines on the side of midnight, or of the end of the week, on which the IMU is
    /// at this time, seconds, and with them their records that `waiting` holds.
    pub fn join(&self, times: &mut StreamTimes, imu_s: f64, waiting: &mut [Record]) {
        let offset_s = self
            .logs
            .heading
            .as_ref()
            .map_or(0.0, |log| log.time_offset_s);
        let heading_s = times.heading.join(imu_s - offset_s);
        for record in &mut *waiting {
            if let Record::Heading(fix) = record {
                fix.time_s += heading_s;
            }
        }
        for (sensor, times) in times.positions.iter_mut().enumerate() {
            let shift_s = times.join(imu_s - self.logs.positions[sensor].time_offset_s);
            for record in &mut *waiting {
                if let Record::Position(of, fix) = record
                    && *of == sensor
                {
                    fix.time_s += shift_s;
                }
            }
        }
    }

    /// The names of the sensors whose times in a stream of lines started again, or are on the other side of a start than
    /// those of the IMU, each with a sentence on it.
    pub fn remarks<'b>(
        &'b self,
        times: &'b StreamTimes,
    ) -> impl Iterator<Item = (&'b str, String)> {
        let names = self.logs.settings.positions.iter();
        let names = names.map(|sensor| sensor.name.as_str());
        let all = [("imu", &times.imu), ("heading", &times.heading)];
        let all = all.into_iter().chain(names.zip(&times.positions));
        all.flat_map(|(name, times)| {
            let remarks = [times.remark(), times.remark_on_side()];
            remarks.into_iter().flatten().map(move |text| (name, text))
        })
    }

    /// The record in a line of a stream of all sensors: `imu,time_s,gyro_x_rad_s,…,accel_z_m_s2`, the name of a
    /// position sensor with `time_s,east_m,north_m,up_m` and optionally `sigma_m`, or `heading,time_s,heading_deg` and
    /// optionally `sigma_deg`.
    ///
    /// # Errors
    /// The line is not a record: the error that `error` makes from what was found and what was expected.
    pub fn line(
        &self,
        text: &str,
        times: &mut StreamTimes,
        error: impl Fn(String, String) -> Error,
    ) -> Result<Record> {
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
                    let start = text.chars().take(80).collect::<String>();
                    error(format!("`{start}`"), format!("{name},{columns}"))
                })
        };
        let sensors = &self.logs.settings.positions;
        match (name, sensors.iter().position(|sensor| sensor.name == name)) {
            ("imu", _) => {
                let columns = "time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,\
                               accel_y_m_s2,accel_z_m_s2";
                let x = numbers(7, 7, columns)?;
                let mut sample = ImuSample {
                    time_s: times.imu.at(x[0]),
                    gyro_rad_s: Vec3::new(x[1], x[2], x[3]),
                    accel_m_s2: Vec3::new(x[4], x[5], x[6]),
                };
                self.place_imu(&mut sample);
                Ok(Record::Imu(sample))
            }
            (_, Some(sensor)) => {
                let columns = "time_s,east_m,north_m,up_m and optionally sigma_m";
                let x = numbers(4, 5, columns)?;
                let position_m = Vec3::new(x[1], x[2], x[3]);
                let time_s = times.positions[sensor].at(x[0]);
                let mut fix = PositionFix::with_sigma(time_s, position_m, x.get(4).copied());
                self.place_position(sensor, &mut fix);
                Ok(Record::Position(sensor, fix))
            }
            ("heading", None) => {
                let x = numbers(2, 3, "time_s,heading_deg and optionally sigma_deg")?;
                let sigma_rad = x.get(2).map(|sigma| sigma.to_radians());
                let time_s = times.heading.at(x[0]);
                let mut fix = HeadingFix::new(time_s, x[1].to_radians(), sigma_rad);
                self.place_heading(&mut fix);
                Ok(Record::Heading(fix))
            }
            _ => {
                let mut names = vec!["imu", "heading"];
                names.extend(sensors.iter().map(|sensor| sensor.name.as_str()));
                let start = name.chars().take(40).collect::<String>();
                Err(error(
                    format!("a record of `{start}`"),
                    format!("one of {}", names.join(", ")),
                ))
            }
        }
    }
}
