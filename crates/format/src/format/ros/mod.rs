//! Recordings of ROS: bags of ROS 2 as MCAP (`.mcap`) and SQLite (`.db3`), and of ROS 1 (`.bag`, version 2.0).
//!
//! The files of a recording of ROS 2 that is split are read one after another; its folder or its `metadata.yaml` stands
//! for them.
//!
//! A recording that was cut off is read to its last complete message. The messages of a topic are read
//! in the order of the file; their times are the stamps in their headers.

mod bag;
mod cdr;
mod chunk;
mod cloud;
pub(crate) mod compression;
mod damage;
mod db3;
mod directory;
mod frames;
mod mcap;
mod messages;
mod points;
mod records;
mod ros1;
mod rosbag;
mod rows;
mod salvage;
mod split;
mod sqlite;
mod stamps;
mod timed;
mod walk;
mod wire;

#[cfg(test)]
mod damage_tests;
#[cfg(test)]
mod tests;

use super::file::{Part, file_of, nothing_in};
use super::kind::{Frame, Kind};
use crate::error::{Error, Location, Result};
use crate::format::input::Input;
use crate::format::profiles::reader::ProfileReader;
use crate::sensor::{GeographicFix, ImuSample, PoseRecord};
pub(crate) use bag::Topic;
use bag::{LeftOut, Messages};
use messages::{
    Imu, NavSatFix, ODOMETRY, Odometry, POSE, POSE_WITH_COVARIANCE, PoseStamped,
    PoseWithCovarianceStamped, TRANSFORM, TransformStamped,
};
pub(crate) use salvage::copy as copy_whole_records;
use wire::Decoded;

pub(crate) const BAG: Kind = Kind {
    signature: Some(|start| looks_like(start.bytes)),
    imu: Some(|input| of_part(input, read_imu)),
    geographic: Some(|input| of_part(input, read_fixes)),
    poses: Some(|input| of_part(input, read_poses)),
    profiles: Some(|input| of_part(input, open_points)),
    contents: Some(|input| {
        let file = Input::from(&file_of(input.path()));
        Ok(format!("topics: {}", list(&topics(&file)?)))
    }),
    beside: Some(split::beside),
    note: "if there are several topics, name one after the file: `drive.mcap#/topic`",
    frame: Frame::OfFile(frames::describe),
    ..Kind::new("ros-bag", "recording (ROS bag, MCAP or .db3)")
};

/// Reads the topic that is named after the file, or the only topic of a fitting type.
fn of_part<T>(input: &Input, read: fn(&Input, Option<&str>) -> Result<T>) -> Result<T> {
    let part = Part::of(input.path());
    match part.name {
        Some(name) => read(&input.of_file(&part.file), Some(&name)),
        None => read(input, None),
    }
}

/// The message types with poses.
const POSES: [&str; 4] = [ODOMETRY, POSE, POSE_WITH_COVARIANCE, TRANSFORM];

/// Whether these are the first bytes of a bag, including ROS 1 bags of versions that are not read.
pub(crate) fn looks_like(start: &[u8]) -> bool {
    [
        mcap::MAGIC,
        rosbag::ANY_VERSION,
        sqlite::MAGIC,
        split::START,
    ]
    .iter()
    .any(|magic| start.starts_with(magic))
}

/// Lists the topics of a bag by name, from the indices of its chunks if it has them, otherwise from
/// all its messages.
///
/// # Errors
/// A file that is missing, of another format, or damaged.
pub(crate) fn topics(input: &Input) -> Result<Vec<Topic>> {
    directory::topics(input)
}

/// Reads the samples of a topic of `sensor_msgs/Imu` in the order of the file: angular rate and
/// specific force in the axes of the IMU. If `topic` is `None`, the only such topic is read.
///
/// # Errors
/// Those of [`topics`]; no such topic or several; a message that is damaged or lacks one of both sensors.
pub(crate) fn read_imu(input: &Input, topic: Option<&str>) -> Result<Vec<ImuSample>> {
    let topic = choose(input, topic, &Imu::TYPES, "IMU samples")?;
    read_all(input, topic, "IMU sample", |messages| {
        messages.read(|imu: Imu| Ok(Some(imu.sample())))
    })
}

/// Reads the poses of a topic of `nav_msgs/Odometry`, `geometry_msgs/PoseStamped`,
/// `geometry_msgs/PoseWithCovarianceStamped` or `geometry_msgs/TransformStamped`. The world is the
/// frame of the headers, the body is the frame whose poses are given. If `topic` is `None`, the only such
/// topic is read.
///
/// # Errors
/// Those of [`read_imu`].
pub(crate) fn read_poses(input: &Input, topic: Option<&str>) -> Result<Vec<PoseRecord>> {
    let topic = choose(input, topic, &POSES, "poses")?;
    let message_type = topic.message_type.clone();
    read_all(input, topic, "pose", |messages| {
        match message_type.as_str() {
            ODOMETRY => messages.read(|m: Odometry| m.0.pose()),
            POSE => messages.read(|m: PoseStamped| m.0.pose()),
            POSE_WITH_COVARIANCE => messages.read(|m: PoseWithCovarianceStamped| m.0.pose()),
            _ => messages.read(|m: TransformStamped| m.0.pose()),
        }
        .map(Some)
    })
}

/// Reads the positions of a topic of `sensor_msgs/NavSatFix` in the order of the file, without
/// messages that have no fix. If `topic` is `None`, the only such topic is read.
///
/// # Errors
/// Those of [`read_imu`].
pub(crate) fn read_fixes(input: &Input, topic: Option<&str>) -> Result<Vec<GeographicFix>> {
    let topic = choose(input, topic, &NavSatFix::TYPES, "GNSS fixes")?;
    read_all(input, topic, "GNSS fix", |messages| {
        messages.read(|fix: NavSatFix| Ok(fix.0))
    })
}

/// Opens a topic of `sensor_msgs/PointCloud2` or `sensor_msgs/LaserScan` as a scanner recording. The
/// points of a laser scan are in the x-y plane of the scanner. If `topic` is `None`, the only such topic is
/// opened.
///
/// # Errors
/// Those of [`topics`]; no such topic or several.
pub(crate) fn open_points(input: &Input, topic: Option<&str>) -> Result<Box<dyn ProfileReader>> {
    let topic = choose(input, topic, &points::TYPES, "points")?;
    Ok(Box::new(points::BagPoints::open(input, topic)?))
}

/// Reads every message of a topic; `what` names one record. Messages that are damaged or have impossible values are left
/// out, which the input remarks.
fn read_all<T>(
    input: &Input,
    topic: Topic,
    what: &str,
    mut record: impl FnMut(&Messages) -> Decoded<Option<T>>,
) -> Result<Vec<T>> {
    let name = topic.name.clone();
    let mut messages = Messages::open(input, topic)?;
    let (mut records, mut left_out) = (Vec::new(), LeftOut::default());
    let mut unmeasured = 0;
    while messages.advance()? {
        match record(&messages) {
            Ok(Some(measured)) => records.push(measured),
            Ok(None) => unmeasured += 1,
            Err(fault) => left_out.add(messages.error(fault)),
        }
    }
    left_out.finish(&messages, records.len() as u64)?;
    if unmeasured > 0 {
        input.remark(format!(
            "{unmeasured} messages of {name} without a fix left out"
        ));
    }
    if records.is_empty() {
        let nothing = || nothing_in(input.path(), &format!("{what} in {name}"));
        return Err(messages.take_damage().unwrap_or_else(nothing));
    }
    Ok(records)
}

/// What the messages of a topic hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Content {
    /// Samples of an IMU.
    Imu,
    /// Geographic positions.
    Fixes,
    /// Poses.
    Poses,
    /// Points of a scanner.
    Points,
}

/// The topics with messages that are read, or that called `wanted`, by their content.
///
/// # Errors
/// Those of [`topics`].
pub(crate) fn readable(input: &Input, wanted: Option<&str>) -> Result<Vec<(Content, String)>> {
    let content = |topic: &Topic| {
        let is_one = |types: &[&str]| types.contains(&topic.message_type.as_str());
        [
            (Content::Imu, is_one(&Imu::TYPES)),
            (Content::Fixes, is_one(&NavSatFix::TYPES)),
            (Content::Poses, is_one(&POSES)),
            (Content::Points, is_one(&points::TYPES)),
        ]
        .into_iter()
        .find_map(|(content, is_it)| is_it.then_some(content))
    };
    let topics = topics(input)?.into_iter();
    let topics = topics.filter(|topic| topic.count > 0 && topic.is_named(wanted));
    let mut readable: Vec<(Content, String)> = topics
        .filter_map(|topic| Some((content(&topic)?, topic.name)))
        .collect();
    readable.sort();
    Ok(readable)
}

/// The topic called `wanted`, with or without the slash before its name, or the only topic of these
/// `types` that has messages.
fn choose(input: &Input, wanted: Option<&str>, types: &[&str], what: &str) -> Result<Topic> {
    split::remark_on_others(input);
    let topics = topics(input)?;
    let fits = |topic: &Topic| types.contains(&topic.message_type.as_str());
    let refused = |found: String, expected: String| {
        Err(Error::format(
            input.path(),
            Location::Whole,
            found,
            expected,
        ))
    };
    let expected = format!("a topic with {what} ({})", types.join(", "));
    let mut candidates: Vec<&Topic> = topics.iter().filter(|t| t.is_named(wanted)).collect();
    if let (Some(name), true) = (wanted, candidates.is_empty()) {
        let found = format!("no topic `{name}` among {}", list(&topics));
        return refused(found, expected);
    }
    let all_named = list(candidates.iter().copied());
    candidates.retain(|topic| fits(topic));
    // A topic that was announced but has no messages is not a candidate if others have messages.
    if candidates.iter().any(|topic| topic.count > 0) {
        candidates.retain(|topic| topic.count > 0);
    }
    match candidates.as_slice() {
        [topic] => Ok((*topic).clone()),
        [] => refused(all_named, expected),
        several => refused(
            format!(
                "{} topics with {what}: {}",
                several.len(),
                list(several.iter().copied())
            ),
            format!(
                "the name of one topic after the file: `{}#{}`",
                input.path().display(),
                several[0].name
            ),
        ),
    }
}

/// Names and types of topics, short enough to print.
fn list<'a>(topics: impl IntoIterator<Item = &'a Topic>) -> String {
    const MOST_TOPICS: usize = 50;
    const MOST: usize = 1000;
    let names: Vec<String> = topics
        .into_iter()
        .take(MOST_TOPICS)
        .map(|t| format!("{} ({}, {} messages)", t.name, t.message_type, t.count))
        .collect();
    if names.is_empty() {
        return "no topics".to_owned();
    }
    names.join(", ").chars().take(MOST).collect()
}
