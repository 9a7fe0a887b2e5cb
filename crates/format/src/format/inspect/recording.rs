//! The summary of a recording with several topics.

use super::inspection::Inspection;
use super::streams::{inspect_geographic, inspect_imu, inspect_poses, inspect_profiles};
use crate::error::Result;
use crate::format::file::Part;
use crate::format::input::Input;
use crate::format::kind::Kind;
use crate::format::ros::{self, Content};

/// Summarises the topic that is named after the file, or the first that can be read, in the order IMU, geographic
/// positions, poses, points; a note lists all topics.
pub(super) fn inspect_recording(input: &Input, kind: &Kind, report: &mut Inspection) -> Result<()> {
    if let Some(contents) = kind.contents {
        report.notes.push(contents(input)?);
    }
    let part = Part::of(input.path());
    let file = &input.of_file(&part.file);
    // The list of the files of a recording is not the recording.
    let files = kind.beside.map_or(Vec::new(), |list| list(&part.file));
    if !files.is_empty() {
        let sizes = files.iter().filter_map(|file| file.metadata().ok());
        report.bytes = sizes.map(|found| found.len()).sum();
    }
    let readable = ros::readable(file, part.name.as_deref())?;
    let Some((content, topic)) = readable.first() else {
        return Ok(());
    };
    if part.name.is_none() && readable.len() > 1 {
        report
            .notes
            .push(format!("the values above are those of {topic}"));
    }
    let named = &input.of_file(format!("{}#{topic}", part.file.display()).as_ref());
    match content {
        Content::Imu => inspect_imu(named, kind).map(|summary| summary?.report(report)),
        Content::Fixes => inspect_geographic(named, kind).map(|summary| summary?.report(report)),
        Content::Poses => Some(inspect_poses(named, report)),
        Content::Points => Some(inspect_profiles(named, report)),
    }
    .unwrap_or(Ok(()))
}
