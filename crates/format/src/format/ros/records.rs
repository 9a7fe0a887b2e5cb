//! The records of which both kinds of bag consist.

use super::wire::Encoding;

/// Longer names of topics and types are damage.
const LONGEST_NAME: usize = 4096;

/// What a record is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// The definition of a message type (MCAP only).
    Schema,
    /// A topic, or the part of it that one program sent.
    Channel,
    /// A message.
    Message,
    /// Compressed records.
    Chunk,
    /// Where the messages of one channel are in the chunk before.
    Index,
    /// Nothing follows.
    End,
    /// Of no interest here.
    Other,
}

/// A record as it is in the file.
#[derive(Clone, Copy)]
pub(super) struct Raw<'a> {
    /// What it is.
    pub(super) kind: Kind,
    /// The header of a record of ROS 1, empty in MCAP.
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
        /// When it was recorded, nanoseconds.
        recorded_ns: u64,
        /// The serialised message.
        data: &'a [u8],
    },
    /// See [`Kind::Index`].
    Index {
        /// The number of the channel.
        channel: u32,
        /// When its messages were recorded.
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
    /// How its messages are serialised.
    pub(super) encoding: Encoding,
}

/// The type of the messages of a channel.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum TypeName {
    /// Its name.
    Known(String),
    /// The number of the schema that tells it.
    Schema(u32),
}

/// Number of messages with their first and last time of recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Span {
    /// Messages.
    pub(super) count: u64,
    /// The earliest, nanoseconds.
    pub(super) first_ns: u64,
    /// The latest, nanoseconds.
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
    /// One message.
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
    /// How it is compressed: empty, `none`, `bz2`, `lz4` or `zstd`.
    pub(super) compression: &'a [u8],
    /// Bytes of the unpacked records, as the file claims.
    pub(super) size: u64,
    /// CRC-32 of the unpacked records, 0 if not given.
    pub(super) crc: u32,
    /// Where the packed records begin in the data of the chunk.
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

    /// Bytes after their number as u32.
    pub(super) fn sized(&mut self) -> Option<&'a [u8]> {
        let size = self.u32()?;
        self.take(usize::try_from(size).ok()?)
    }
}

/// A name of a topic or type; bytes that are not text are replaced.
pub(super) fn name(bytes: &[u8]) -> Option<String> {
    (bytes.len() <= LONGEST_NAME).then(|| String::from_utf8_lossy(bytes).into_owned())
}

/// The name of a message type as ROS 1 writes it: without the `msg` that ROS 2 adds.
pub(super) fn short_type(name: &str) -> String {
    name.replacen("/msg/", "/", 1)
}
