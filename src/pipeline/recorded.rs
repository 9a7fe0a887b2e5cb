//! The clocks of a recording.

use std::path::Path;

use super::open_project::OpenProject;
use crate::error::Result;
use crate::format::{RecordingClocks, is_in_recording, recording_clock, sensor_clock};
use crate::project::{Motion, Project};

/// The clocks of the recording of a drive: of its computer, and of each of its logs; `None` if the logs were not recorded.
///
/// # Errors
/// Files of the recording that cannot be read; see [`sensor_clock`].
pub(super) fn clocks(project: &OpenProject) -> Result<Option<RecordingClocks>> {
    let logs = logs(project);
    let Some(system) = logs.iter().find_map(|(_, path)| recording_clock(path)) else {
        return Ok(None);
    };
    let system = system?;
    let mut sensors = Vec::new();
    for (name, path) in logs {
        sensors.extend(sensor_clock(project.input(path))?.map(|clock| (name.to_owned(), clock)));
    }
    Ok(Some(RecordingClocks { system, sensors }))
}

/// Whether the logs of a drive were recorded with the times of their arrival.
pub(super) fn is_recorded(project: &Project) -> bool {
    let mut logs = logs(project).into_iter();
    logs.any(|(_, path)| is_in_recording(path))
}

/// The logs of a drive, with the names of their sensors.
fn logs(project: &Project) -> Vec<(&str, &Path)> {
    let mut logs: Vec<(&str, &Path)> = Vec::new();
    if let Motion::Logs(motion) = &project.motion {
        logs.push(("imu", &motion.imu.path));
        let names = motion.settings.positions.iter().map(|p| p.name.as_str());
        logs.extend(names.zip(motion.positions.iter().map(|p| p.path.as_path())));
        logs.extend(motion.heading.iter().map(|h| ("heading", h.path.as_path())));
    }
    for scanner in &project.scanners {
        let files = scanner.profiles.iter();
        logs.extend(files.map(|path| (scanner.name.as_str(), path.as_path())));
    }
    logs
}
