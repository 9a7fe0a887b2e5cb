//! The logs of a drive, read and prepared for the trajectory stage.

use super::inputs::size;
use super::open_project::OpenProject;
use super::profiles::warn_of_remarks;
use crate::error::Result;
use crate::feed::{Feed, log_clock};
use crate::progress::Progress;
use crate::project::Logs;
use crate::sensor::{
    Continued, HeadingFix, ImuSample, PositionFix, Record, RejectedRow, Timed, on_both_sides,
    span_s, start_between_s,
};
use crate::trajectory::MotionLogs;
use crate::trajectory::TrajectorySettings;

/// Maximum number of rejected rows of a log that are listed; all of them are in the results.
const MAX_ROWS_LISTED: usize = 20;

/// The logs of a project, in common time and with the project's origin subtracted.
#[derive(Debug, Clone, PartialEq)]
pub struct DriveLogs {
    /// Angular rates and specific forces, in the order of the file.
    pub imu: Vec<ImuSample>,
    /// Positions, one stream for each of the settings' positions.
    pub positions: Vec<Vec<PositionFix>>,
    /// Headings; empty without a log.
    pub heading: Vec<HeadingFix>,
    /// Settings of the project, with the origin subtracted from stations.
    pub settings: TrajectorySettings,
    /// Rows without a measurement.
    pub rejected: Vec<RejectedRow>,
}

impl DriveLogs {
    /// Reads the logs of `project`, and reports rows without a measurement.
    ///
    /// # Errors
    /// Errors of the readers.
    pub fn read(project: &OpenProject, logs: &Logs, progress: &dyn Progress) -> Result<Self> {
        let positions = logs.positions.iter().map(|log| &log.path);
        let heading = logs.heading.iter().map(|log| &log.path);
        let all = positions.chain(heading).chain([&logs.imu.path]);
        let stage = progress.stage("reading logs", all.map(|path| size(path)).sum());
        let feed = Feed::new(project, logs).with_origin(project.origin_m());
        let input = project.input(&logs.imu.path);
        let imu = feed.imu(&input, &mut Continued::default(), log_clock)?;
        warn_of_remarks("imu", &[input], progress);
        stage.advance(size(&logs.imu.path))?;
        let settings = feed.settings();
        let mut positions = Vec::with_capacity(logs.positions.len());
        let mut rejected = Vec::new();
        for (sensor, log) in logs.positions.iter().enumerate() {
            let input = project.input(&log.path);
            let read = feed.positions(sensor, &input, &mut Continued::default(), log_clock)?;
            stage.advance(size(&log.path))?;
            let (mut fixes, rows) = (read.fixes, read.rejected);
            let name = &settings.positions[sensor].name;
            start_with(&imu, name, &mut fixes, progress);
            warn_of_remarks(name, &[input], progress);
            report_rejected(name, &rows, fixes.len() + rows.len(), progress);
            rejected.extend(rows);
            positions.push(fixes);
        }
        let mut heading = Vec::new();
        if let Some(log) = &logs.heading {
            let input = project.input(&log.path);
            heading = feed.heading(&input, &mut Continued::default(), log_clock)?;
            warn_of_remarks("heading", &[input], progress);
            start_with(&imu, "heading", &mut heading, progress);
            stage.advance(size(&log.path))?;
        }
        Ok(Self {
            imu,
            positions,
            heading,
            settings,
            rejected,
        })
    }

    /// All logs, as input of the trajectory.
    pub fn motion(&self) -> MotionLogs<'_> {
        MotionLogs {
            imu: &self.imu,
            positions: &self.positions,
            heading: &self.heading,
        }
    }

    /// The records of all sensors in time order.
    pub fn in_order(&self) -> Vec<Record> {
        let mut records: Vec<Record> = self.imu.iter().copied().map(Record::Imu).collect();
        records.extend(self.heading.iter().copied().map(Record::Heading));
        for (sensor, fixes) in self.positions.iter().enumerate() {
            records.extend(fixes.iter().map(|fix| Record::Position(sensor, *fix)));
        }
        Record::sort(&mut records);
        records
    }
}

/// Shifts a log whose clock started again, at midnight or at the end of the week, before it or the IMU's log began.
fn start_with<T: Timed>(imu: &[ImuSample], name: &str, records: &mut [T], progress: &dyn Progress) {
    let (Some(imu_s), Some(log_s)) = (span_s(imu), span_s(records)) else {
        return;
    };
    let shift_s = start_between_s([log_s.0, log_s.1], [imu_s.0, imu_s.1]);
    if shift_s == 0.0 {
        return;
    }
    records
        .iter_mut()
        .for_each(|record| *record.time_s_mut() += shift_s);
    progress.warn(&format!("{name}: {}", on_both_sides(shift_s)));
}

fn report_rejected(name: &str, rows: &[RejectedRow], all: usize, progress: &dyn Progress) {
    for row in rows.iter().take(MAX_ROWS_LISTED) {
        progress.say(&format!("{name}: rejected {row}"));
    }
    if rows.len() > MAX_ROWS_LISTED {
        let more = rows.len() - MAX_ROWS_LISTED;
        progress.say(&format!("{name}: rejected {more} more rows"));
    }
    if !rows.is_empty() {
        progress.warn(&format!(
            "{} of {all} rows of `{name}` contain no measurement and were rejected",
            rows.len()
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vec3;
    use crate::project::{Motion, Project};
    use std::sync::Mutex;

    #[derive(Default)]
    struct Messages(Mutex<Vec<String>>);

    impl Progress for Messages {
        fn begin(&self, _stage: &str, _total: u64) {}
        fn advance(&self, _units: u64) {}
        fn end(&self) {}
        fn say(&self, message: &str) {
            self.0.lock().unwrap().push(message.to_owned());
        }
        fn warn(&self, message: &str) {
            self.say(&format!("warning: {message}"));
        }
    }

    #[test]
    fn all_logs_have_common_time_and_no_origin() {
        let folder = tempfile::tempdir().unwrap();
        let write =
            |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
        write(
            "project.toml",
            "[frame]\norigin_m = [363000.0, 5600000.0, 60.0]\n\
             [imu]\nfile = \"imu.csv\"\ntime_offset_s = 1\n\
             [prism]\nfile = \"polar.csv\"\nlever_arm_m = [0, 0, 0]\ntime_offset_s = 2\n\
             station_m = [363010.0, 5600020.0, 61.0]\nstation_orientation_deg = 90\n\
             [gnss]\nfile = \"gnss.csv\"\nlever_arm_m = [0, 0, 0]\ntime_offset_s = 3\n\
             [heading]\nfile = \"heading.csv\"\ntime_offset_s = 4\n",
        );
        let columns =
            "gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2";
        write(
            "imu.csv",
            &format!("time_s,{columns}\n10,0,0,0,0,0,-9.81\n"),
        );
        let lost = "9,0,0,0\n".repeat(25);
        let polar = "time_s,slope_distance_m,horizontal_deg,vertical_deg\n10,5,0,90\n";
        write("polar.csv", &format!("{polar}{lost}"));
        write(
            "gnss.csv",
            "time_s,east_m,north_m,up_m\n10,363001,5600002,63\n",
        );
        write("heading.csv", "time_s,heading_deg,pitch_deg\n10,90,1\n");
        let project = Project::read(&folder.path().join("project.toml")).unwrap();
        let Motion::Logs(logs) = &project.motion else {
            panic!("logs");
        };
        let messages = Messages::default();
        let read = DriveLogs::read(&OpenProject::new(&project), logs, &messages).unwrap();
        let motion = read.motion();
        assert_eq!(motion.imu[0].time_s, 11.0);
        assert_eq!(motion.heading[0].time_s, 14.0);
        assert!(motion.heading[0].pitch_rad.is_some());
        // 5 m to the east of the station; the coordinates are exact to a nanometre at 5600 km.
        let prism = &motion.positions[0][0];
        assert_eq!(prism.time_s, 12.0);
        assert!((prism.position_m - Vec3::new(15.0, 20.0, 1.0)).norm() < 2e-9);
        let station_m = read.settings.positions[0].station_m.unwrap();
        assert_eq!(station_m, Vec3::new(10.0, 20.0, 1.0));
        let antenna = &motion.positions[1][0];
        assert_eq!((antenna.time_s, antenna.covariance_m2), (13.0, None));
        assert_eq!(antenna.position_m, Vec3::new(1.0, 2.0, 3.0));
        // All rejected rows are in the result; only the first ones are listed in messages.
        assert_eq!(read.rejected.len(), 25);
        assert_eq!((read.rejected[0].line, read.rejected[0].time_s), (3, 9.0));
        let messages = messages.0.into_inner().unwrap();
        assert_eq!(messages.len(), 22);
        assert!(
            messages[19].ends_with("polar.csv, line 22, 9 s: zero range"),
            "{}",
            messages[19]
        );
        assert_eq!(messages[20], "prism: rejected 5 more rows");
        assert!(
            messages[21].starts_with("warning: 25 of 26 rows of `prism` contain"),
            "{}",
            messages[21]
        );
    }
}
