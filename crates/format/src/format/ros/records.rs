//! The records of both kinds of bag.

use super::wire::Encoding;

/// Largest accepted length of a name of a topic or type, bytes; a longer name is damage.
const LONGEST_NAME: usize = 4096;

/// The kind of a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// The definition of a message type (MCAP only).
    Schema,
    /// A topic, or the part of a topic that one program sent.
    Channel,
    /// A message.
    Message,
    /// Compressed records.
    Chunk,
    /// Positions of the messages of one channel in the preceding chunk.
    Index,
    /// The end of the messages.
    End,
    /// A record that is not read.
    Other,
}

/// A record as it is in the file.
#[derive(Clone, Copy)]
pub(super) struct Raw<'a> {
    /// Its kind.
    pub(super) kind: Kind,
    /// The header of a record of ROS 1; empty in MCAP.
    pub(super) head: &'a [u8],
    /// Its content.
    pub(super) data: &'a [u8],
}

/// The content of a record.
#[derive(Debug, PartialEq)]
pub(super) enum Record<'a> {
    /// See [`Kind::Schema`].
    Schema {
        /// Its number in the file.
        id: u32,
        /// The name of the message type.
        name: String,
    },
    /// See [`Kind::Channel`].
    Channel {
        /// Its number in the file.
        id: u32,
        /// The channel.
        channel: Channel,
    },
    /// See [`Kind::Message`].
    Message {
        /// The number of its channel.
        channel: u32,
        /// The time at which it was recorded, nanoseconds.
        recorded_ns: u64,
        /// The serialised message.
        data: &'a [u8],
    },
    /// See [`Kind::Index`].
    Index {
        /// The number of the channel.
        channel: u32,
        /// The times at which its messages were recorded.
        span: Span,
    },
}

/// A channel as it is in the file.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Channel {
    /// The name of the topic.
    pub(super) topic: String,
    /// The message type, or the number of its schema.
    pub(super) message_type: TypeName,
    /// Serialisation of its messages.
    pub(super) encoding: Encoding,
}

/// The type of the messages of a channel.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum TypeName {
    /// The name of the type.
    Known(String),
    /// The number of the schema that has the name.
    Schema(u32),
}

/// Number of messages with their first and last time of recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Span {
    /// Number of messages.
    pub(super) count: u64,
    /// The earliest time, nanoseconds.
    pub(super) first_ns: u64,
    /// The latest time, nanoseconds.
    pub(super) last_ns: u64,
}

impl Default for Span {
    fn default() -> Self {
        Self {
            count: 0,
            first_ns: u64::MAX,
            last_ns: 0,
        }
    }
}

impl Span {
    /// The span of one message.
    pub(super) fn one(time_ns: u64) -> Self {
        Self {
            count: 1,
            first_ns: time_ns,
            last_ns: time_ns,
        }
    }

    /// Adds the messages of `other`.
    pub(super) fn add(&mut self, other: Self) {
        self.count = self.count.saturating_add(other.count);
        self.first_ns = self.first_ns.min(other.first_ns);
        self.last_ns = self.last_ns.max(other.last_ns);
    }
}

/// The head of a chunk.
pub(super) struct ChunkHead<'a> {
    /// Name of the compression: empty, `none`, `bz2`, `lz4` or `zstd`.
    pub(super) compression: &'a [u8],
    /// Size of the unpacked records according to the file, bytes.
    pub(super) size: u64,
    /// CRC-32 of the unpacked records; 0 if not given.
    pub(super) crc: u32,
    /// Start of the packed records in the data of the chunk.
    pub(super) start: usize,
}

/// The unread rest of a record; little-endian.
#[derive(Clone, Copy)]
pub(super) struct Cursor<'a>(pub(super) &'a [u8]);

impl<'a> Cursor<'a> {
    /// The next `n` bytes.
    pub(super) fn take(&mut self, n: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(n)?;
        self.0 = rest;
        Some(taken)
    }

    /// The next `N` bytes.
    fn word<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    /// A number of 16 bits.
    pub(super) fn u16(&mut self) -> Option<u16> {
        self.word().map(u16::from_le_bytes)
    }

    /// A number of 32 bits.
    pub(super) fn u32(&mut self) -> Option<u32> {
        self.word().map(u32::from_le_bytes)
    }

    /// A number of 64 bits.
    pub(super) fn u64(&mut self) -> Option<u64> {
        self.word().map(u64::from_le_bytes)
    }

    /// Bytes preceded by their count (u32).
    pub(super) fn sized(&mut self) -> Option<&'a [u8]> {
        let size = self.u32()?;
        self.take(usize::try_from(size).ok()?)
    }
}

/// A name of a topic or type; bytes that are not text are replaced.
pub(super) fn name(bytes: &[u8]) -> Option<String> {
    (bytes.len() <= LONGEST_NAME).then(|| String::from_utf8_lossy(bytes).into_owned())
}

/// The name of a message type as in ROS 1: without the `msg` that ROS 2 adds.
pub(super) fn short_type(name: &str) -> String {
    name.replacen("/msg/", "/", 1)
}
