//! The messages of one topic of a bag of any kind.

use std::ops::Range;

use super::cdr::Cdr;
use super::records::{Cursor, Kind, Record};
use super::ros1::Ros1;
use super::split;
use super::walk::Walk;
use super::wire::{Decoded, Encoding, Fault, Message};
use crate::error::{Error, Result};
use crate::format::compressed::ZSTANDARD;
use crate::format::input::Input;

/// A topic of a bag.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Topic {
    /// Its name.
    pub(crate) name: String,
    /// The type of its messages as ROS 1 writes it, such as `sensor_msgs/Imu`.
    pub(crate) message_type: String,
    /// Number of messages.
    pub(crate) count: u64,
    /// Times at which the first and the last message were recorded, seconds; not the stamps in their headers.
    pub(crate) recorded_s: Option<(f64, f64)>,
    /// Serialisation of the messages.
    pub(super) encoding: Encoding,
    /// The numbers of the files of the recording and the channels of the topic in them, in increasing order.
    pub(super) channels: Vec<(usize, u32)>,
}

impl Topic {
    /// Whether it is called `wanted`, with or without the slash before a name; every topic is if none is wanted.
    pub(super) fn is_named(&self, wanted: Option<&str>) -> bool {
        let bare = self.name.trim_start_matches('/');
        wanted.is_none_or(|name| name.trim_start_matches('/') == bare)
    }
}

/// The messages of one topic in the order of the files, which is the order of recording.
pub(super) struct Messages {
    files: Vec<Input>,
    /// The number of the current file.
    file: usize,
    walk: Walk,
    /// The first damage of the files before the current one.
    damage: Option<Error>,
    topic: Topic,
    /// The records of the current chunk, or the content of a message outside of chunks.
    block: Vec<u8>,
    /// Start of the next record in the block.
    at: usize,
    /// Range of the current message in the block.
    message: Range<usize>,
    /// The content of the current message if it is compressed by itself.
    unpacked: Option<Decoded<Vec<u8>>>,
    /// Messages so far.
    count: u64,
    /// When the current message was recorded, nanoseconds.
    recorded_ns: u64,
}

impl Messages {
    /// Opens a bag before the first message of a topic.
    pub(super) fn open(input: &Input, topic: Topic) -> Result<Self> {
        let files = split::files(input)?;
        Ok(Self {
            walk: Walk::open(files.first().unwrap_or(input))?,
            files,
            file: 0,
            damage: None,
            topic,
            block: Vec::new(),
            at: 0,
            message: 0..0,
            unpacked: None,
            count: 0,
            recorded_ns: 0,
        })
    }

    /// Goes to the next message; false at the end.
    pub(super) fn advance(&mut self) -> Result<bool> {
        loop {
            if self.advance_in_chunk() {
                break;
            }
            match self.walk.step(&[Kind::Chunk, Kind::Message])? {
                None | Some(Kind::End) => {
                    self.walk.remark();
                    if !self.begin_next_file()? {
                        return Ok(false);
                    }
                }
                Some(Kind::Chunk) => self.at = self.walk.unpack(&mut self.block)?,
                Some(Kind::Message) => match self.walk.record() {
                    Some(Record::Message {
                        channel,
                        recorded_ns,
                        data,
                    }) if self.has(channel) => {
                        let size = data.len();
                        self.recorded_ns = recorded_ns;
                        self.walk.swap_data(&mut self.block);
                        self.at = self.block.len();
                        self.message = self.at - size..self.at;
                        break;
                    }
                    Some(_) => {}
                    None => self.walk.pass_over(self.walk.unreadable(Kind::Message)),
                },
                Some(_) => {}
            }
        }
        self.count += 1;
        let content = &self.block[self.message.clone()];
        // Messages of ROS 2 begin with the kind of their serialisation, which is never like this.
        let is_packed = self.topic.encoding == Encoding::Cdr && content.starts_with(ZSTANDARD);
        self.unpacked = is_packed.then(|| self.walk.unpack_message(content));
        Ok(true)
    }

    /// Goes to the start of the next file; false if there is none.
    fn begin_next_file(&mut self) -> Result<bool> {
        let Some(next) = self.files.get(self.file + 1) else {
            return Ok(false);
        };
        let walk = Walk::open(next)?;
        let damage = self.walk.take_damage();
        self.damage = self.damage.take().or(damage);
        self.walk = walk;
        self.file += 1;
        self.block.clear();
        self.at = 0;
        Ok(true)
    }

    /// Goes to the next message of the current chunk; false at its end.
    fn advance_in_chunk(&mut self) -> bool {
        let mut rest = Cursor(&self.block[self.at..]);
        let mut size = None;
        while let Some(raw) = self.walk.split(&mut rest) {
            if raw.kind != Kind::Message {
                continue;
            }
            if let Some(Record::Message {
                channel,
                recorded_ns,
                data,
            }) = self.walk.parse(raw)
                && self
                    .topic
                    .channels
                    .binary_search(&(self.file, channel))
                    .is_ok()
            {
                self.recorded_ns = recorded_ns;
                size = Some(data.len());
                break;
            }
        }
        self.at = self.block.len() - rest.0.len();
        let Some(size) = size else {
            self.at = self.block.len();
            return false;
        };
        // A message ends at the end of its record.
        self.message = self.at - size..self.at;
        true
    }

    /// Whether a channel belongs to the topic.
    fn has(&self, channel: u32) -> bool {
        let channels = &self.topic.channels;
        channels.binary_search(&(self.file, channel)).is_ok()
    }

    /// When the current message was recorded, seconds.
    pub(super) fn recorded_s(&self) -> f64 {
        self.recorded_ns as f64 * 1e-9
    }

    /// Decodes the current message and converts it.
    pub(super) fn read<'a, M: Message<'a>, T>(
        &'a self,
        convert: impl FnOnce(M) -> Decoded<T>,
    ) -> Decoded<T> {
        let bytes = match &self.unpacked {
            Some(unpacked) => unpacked.as_ref().map_err(Fault::clone)?,
            None => &self.block[self.message.clone()],
        };
        decode(&self.topic.encoding, bytes).and_then(convert)
    }

    /// A format error at the record of the current message, or at its chunk.
    pub(super) fn error(&self, fault: Fault) -> Error {
        let place = format!("message {} of {}", self.count, self.topic.name);
        self.walk
            .error(format!("{} in {place}", fault.found), fault.expected)
    }

    /// The error of the first damaged place of the file, if there is one.
    pub(super) fn take_damage(&mut self) -> Option<Error> {
        self.damage.take().or_else(|| self.walk.take_damage())
    }

    /// Bytes read so far.
    pub(super) fn bytes_read(&self) -> u64 {
        let before = self.files[..self.file].iter().map(size);
        before.sum::<u64>().saturating_add(self.walk.bytes_read())
    }

    /// Size of the files in bytes, of the current one after unpacking.
    pub(super) fn bytes_total(&self) -> u64 {
        let before = self.files[..self.file].iter().map(size);
        let after = self.files.iter().skip(self.file + 1).map(size);
        let others = before.chain(after).sum::<u64>();
        others.saturating_add(self.walk.bytes_total())
    }

    /// The topic.
    pub(super) fn topic(&self) -> &Topic {
        &self.topic
    }

    /// The file.
    pub(super) fn walk(&self) -> &Walk {
        &self.walk
    }
}

/// The size of a file in bytes, 0 if it is unknown.
fn size(input: &Input) -> u64 {
    input.path().metadata().map_or(0, |found| found.len())
}

/// Messages of a topic that cannot be used.
#[derive(Default)]
pub(super) struct LeftOut {
    count: u64,
    first: Option<Error>,
}

impl LeftOut {
    /// Adds a message with the error that says why.
    pub(super) fn add(&mut self, error: Error) {
        self.count += 1;
        self.first.get_or_insert(error);
    }

    /// Remarks on these messages.
    ///
    /// # Errors
    /// There are more of them than the messages that were `kept`: the first one.
    pub(super) fn finish(&mut self, messages: &Messages, kept: u64) -> Result<()> {
        let Some(first) = self.first.take() else {
            return Ok(());
        };
        if self.count > kept {
            return Err(first);
        }
        messages.walk.input().remark(format!(
            "{} of {} messages of {} left out, the first: {first}",
            self.count, messages.count, messages.topic.name
        ));
        Ok(())
    }
}

/// Decodes the bytes of a message.
fn decode<'a, M: Message<'a>>(encoding: &Encoding, bytes: &'a [u8]) -> Decoded<M> {
    match encoding {
        Encoding::Cdr => M::decode(&mut Cdr::new(bytes)?),
        Encoding::Ros1 => M::decode(&mut Ros1::new(bytes)),
        Encoding::Other(name) => Err(Fault::new(
            format!("messages encoded as `{name}`"),
            "cdr or ros1",
        )),
    }
}
