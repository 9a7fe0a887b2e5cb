//! The frames of the messages of a recording, named in their headers.

use super::bag::{Messages, Topic};
use super::directory::topics;
use super::messages::{Imu, NavSatFix, ODOMETRY, TRANSFORM};
use super::wire::{Decoded, Message, Wire};
use super::{POSES, points};
use crate::error::Result;
use crate::format::file::Part;
use crate::format::input::Input;

/// Most topics whose frames are looked up, and most characters of a name that are shown.
const MOST_TOPICS: usize = 20;
const LONGEST_NAME: usize = 60;

fn shown(name: &[u8]) -> String {
    let name: String = String::from_utf8_lossy(name)
        .chars()
        .take(LONGEST_NAME)
        .collect();
    if name.is_empty() {
        "(no name)".to_owned()
    } else {
        name
    }
}

/// The frame in the header of a message.
struct InHeader(String);

impl<'a> Message<'a> for InHeader {
    fn decode(wire: &mut impl Wire<'a>) -> Decoded<Self> {
        Ok(Self(shown(wire.header()?.1)))
    }
}

/// The frame in the header of a message with poses of a child frame.
struct InHeaderAndChild(String);

impl<'a> Message<'a> for InHeaderAndChild {
    fn decode(wire: &mut impl Wire<'a>) -> Decoded<Self> {
        let world = shown(wire.header()?.1);
        let body = shown(wire.text()?);
        Ok(Self(format!("{body} in {world}")))
    }
}

/// The frame of the first message of a topic; `None` if it cannot be read.
fn frame_of(input: &Input, topic: &Topic) -> Option<String> {
    let mut messages = Messages::open(input, topic.clone()).ok()?;
    if !messages.advance().ok()? {
        return None;
    }
    match topic.message_type.as_str() {
        ODOMETRY | TRANSFORM => messages.read(|found: InHeaderAndChild| Ok(found.0)),
        _ => messages.read(|found: InHeader| Ok(found.0)),
    }
    .ok()
}

/// Units and frames of the topic named after the file, or of all topics that can be read.
pub(super) fn describe(input: &Input) -> Result<String> {
    let part = Part::of(input.path());
    let file = Input::from(&part.file);
    let is_read = |topic: &Topic| {
        let types = [&Imu::TYPES[..], &NavSatFix::TYPES, &points::TYPES, &POSES];
        types
            .iter()
            .any(|types| types.contains(&topic.message_type.as_str()))
            && topic.count > 0
            && topic.is_named(part.name.as_deref())
    };
    let topics: Vec<Topic> = topics(&file)?.into_iter().filter(is_read).collect();
    let mut frames: Vec<(String, &Topic, usize)> = Vec::new();
    for topic in topics.iter().take(MOST_TOPICS) {
        let Some(frame) = frame_of(&file, topic) else {
            continue;
        };
        match frames.iter_mut().find(|(other, ..)| *other == frame) {
            Some((.., count)) => *count += 1,
            None => frames.push((frame, topic, 1)),
        }
    }
    let name = |(frame, topic, count): &(String, &Topic, usize)| {
        let topic = shown(topic.name.as_bytes());
        match count {
            1 => format!("{frame} ({topic})"),
            n => format!("{frame} ({topic} and {} more)", n - 1),
        }
    };
    let frames: Vec<String> = frames.iter().map(name).collect();
    Ok(if frames.is_empty() {
        "metres, radians and seconds (ROS); no frames named".to_owned()
    } else {
        format!(
            "metres, radians and seconds (ROS); frames named in the headers: {}",
            frames.join(", ")
        )
    })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    /// The frames that `tests/data/ros/make.py` wrote.
    #[test]
    fn frames_are_those_of_the_first_messages() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/ros");
        for name in ["plain.bag", "plain.mcap"] {
            let path = folder.join(name);
            let frames = crate::format::inspect(&path).unwrap().frame;
            assert!(frames.contains("base_link in odom (/odom)"), "{frames}");
            assert!(frames.contains("map_frame ("), "{frames}");
        }
    }
}
