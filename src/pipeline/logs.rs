//! The logs of a drive as the trajectory stage takes them.

use crate::error::Result;
use crate::format;
use crate::progress::Progress;
use crate::project::{LogFile, Logs, PositionLog, Project, TrajectorySettings};
use crate::sensor::{HeadingFix, ImuSample, PositionFix, RejectedRow};
use crate::trajectory::MotionLogs;

/// Rejected rows of one log that are told one by one; all of them are in the results.
const ROWS_TOLD: usize = 20;

/// What the logs of a project hold: common time, the project's origin subtracted.
#[derive(Debug, Clone, PartialEq)]
pub struct DriveLogs {
    /// Rates and specific forces, in the order of the file.
    pub imu: Vec<ImuSample>,
    /// Positions, one stream for each of the settings' positions.
    pub positions: Vec<Vec<PositionFix>>,
    /// Headings; empty where there is no log of them.
    pub heading: Vec<HeadingFix>,
    /// Those of the project, with stations moved by the origin as the positions are.
    pub settings: TrajectorySettings,
    /// Rows that hold no measurement.
    pub rejected: Vec<RejectedRow>,
}

impl DriveLogs {
    /// Reads the logs of `project`, and tells of rows that hold no measurement.
    ///
    /// # Errors
    /// What the readers find.
    pub fn read(project: &Project, logs: &Logs, progress: &dyn Progress) -> Result<Self> {
        let mut imu = format::read_imu(&logs.imu.path)?;
        imu.iter_mut()
            .for_each(|sample| sample.time_s += logs.imu.time_offset_s);
        let mut settings = logs.settings.clone();
        let mut positions = Vec::with_capacity(logs.positions.len());
        let mut rejected = Vec::new();
        for (log, settings) in logs.positions.iter().zip(&mut settings.positions) {
            let PositionLog {
                path,
                time_offset_s,
                observations,
            } = log;
            let format::Positions {
                mut fixes,
                rejected: rows,
            } = format::read_positions(path, observations)?;
            for fix in &mut fixes {
                fix.time_s += time_offset_s;
                fix.position_m -= project.origin_m;
            }
            if let Some(station) = &mut settings.station_m {
                *station -= project.origin_m;
            }
            tell_rejected(&settings.name, &rows, fixes.len() + rows.len(), progress);
            rejected.extend(rows);
            positions.push(fixes);
        }
        let mut heading = Vec::new();
        if let Some(LogFile {
            path,
            time_offset_s,
        }) = &logs.heading
        {
            heading = format::read_heading(path)?;
            heading
                .iter_mut()
                .for_each(|fix| fix.time_s += time_offset_s);
        }
        Ok(Self {
            imu,
            positions,
            heading,
            settings,
            rejected,
        })
    }

    /// All streams.
    pub fn motion(&self) -> MotionLogs<'_> {
        MotionLogs {
            imu: &self.imu,
            positions: &self.positions,
            heading: &self.heading,
        }
    }
}

fn tell_rejected(name: &str, rows: &[RejectedRow], all: usize, progress: &dyn Progress) {
    for row in rows.iter().take(ROWS_TOLD) {
        progress.say(&format!("{name}: rejected {row}"));
    }
    if rows.len() > ROWS_TOLD {
        let more = rows.len() - ROWS_TOLD;
        progress.say(&format!("{name}: rejected {more} more rows"));
    }
    if !rows.is_empty() {
        progress.warn(&format!(
            "{} of {all} rows of `{name}` hold no measurement and were rejected",
            rows.len()
        ));
    }
}
