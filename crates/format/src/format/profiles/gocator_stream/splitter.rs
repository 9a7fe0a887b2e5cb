//! Splits a stream of bytes into complete messages.

use super::layout::{Beginning, LARGEST_MESSAGE, LONGEST_HEAD, beginning};

/// Splits a stream, which arrives in pieces of any length, into messages.
///
/// The protocol has neither a mark at the beginning of a message nor a checksum. A message is accepted as
/// complete when
///
/// * its size agrees with its own counts or, for types that are not read here, when
///   another message or the end of the stream follows,
/// * no message begins inside it: if a link was cut within a message and opened again, the first
///   message of the new link lies in what looks like the end of the old message.
///
/// A message is returned when the first 16 bytes after it have arrived, or at the end.
///
/// Bytes that belong to no message are skipped up to the next message of a known type, and counted.
/// At most one message of [`LARGEST_MESSAGE`] and the last piece are buffered.
#[derive(Debug)]
pub struct Splitter {
    buffer: Vec<u8>,
    /// Index in the buffer of the first byte that was not returned.
    start: usize,
    /// Position of that byte in the stream.
    position: u64,
    largest: usize,
    /// Bytes skipped since the last message.
    skipped: u64,
    is_finished: bool,
}

/// A part of the stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Piece<'a> {
    /// A complete message, and its position in the stream.
    Message(&'a [u8], u64),
    /// Number of bytes that belong to no complete message.
    Gap(u64),
}

enum Judgement {
    Message(usize),
    Skip(usize),
    Wait,
}

impl Default for Splitter {
    fn default() -> Self {
        Self::new(LARGEST_MESSAGE)
    }
}

impl Splitter {
    /// A splitter for messages of at most `largest` bytes.
    pub fn new(largest: usize) -> Self {
        Self {
            buffer: Vec::new(),
            start: 0,
            position: 0,
            largest,
            skipped: 0,
            is_finished: false,
        }
    }

    /// Takes the next bytes of the stream. Call [`Splitter::next`] until it returns `None` before.
    pub fn push(&mut self, bytes: &[u8]) {
        // The rest is moved only when it is the smaller part, so that the total cost stays linear.
        if self.start > self.buffer.len() / 2 {
            self.buffer.copy_within(self.start.., 0);
            self.buffer.truncate(self.buffer.len() - self.start);
            self.start = 0;
        }
        self.buffer.extend_from_slice(bytes);
    }

    /// Ends the stream: the remaining bytes are judged without waiting for more.
    pub fn finish(&mut self) {
        self.is_finished = true;
    }

    /// Number of buffered bytes.
    pub fn kept(&self) -> usize {
        self.buffer.len() - self.start
    }

    /// The next part of the stream; `None` if more bytes are needed to decide.
    #[expect(clippy::should_implement_trait, reason = "the part is borrowed")]
    pub fn next(&mut self) -> Option<Piece<'_>> {
        let size = loop {
            match self.judge() {
                Judgement::Message(size) => break size,
                Judgement::Skip(bytes) => {
                    self.start += bytes;
                    self.position += bytes as u64;
                    self.skipped += bytes as u64;
                }
                Judgement::Wait => {
                    let is_over = self.is_finished && self.skipped > 0;
                    return is_over.then(|| Piece::Gap(std::mem::take(&mut self.skipped)));
                }
            }
        };
        if self.skipped > 0 {
            return Some(Piece::Gap(std::mem::take(&mut self.skipped)));
        }
        let (start, position) = (self.start, self.position);
        self.start += size;
        self.position += size as u64;
        Some(Piece::Message(&self.buffer[start..self.start], position))
    }

    /// Decides whether a message begins at the first buffered byte.
    fn judge(&self) -> Judgement {
        let bytes = &self.buffer[self.start..];
        let (size, is_certain) = match beginning(bytes, self.largest) {
            Beginning::TooShort if self.is_finished && !bytes.is_empty() => {
                return Judgement::Skip(1);
            }
            Beginning::TooShort => return Judgement::Wait,
            Beginning::Certain(size) => (size, true),
            // Among damaged bytes, a plausible size is not enough evidence.
            Beginning::Possible(size) if self.skipped == 0 => (size, false),
            Beginning::Possible(_) | Beginning::Invalid => return Judgement::Skip(1),
        };
        // Heads that begin in the last bytes of this message must be complete, too.
        if bytes.len() < size + LONGEST_HEAD && !self.is_finished {
            return Judgement::Wait;
        }
        let Some(following) = bytes.get(size..) else {
            return Judgement::Skip(1);
        };
        match self.message_inside(bytes, size) {
            Some(at) => Judgement::Skip(at),
            None if !is_certain && beginning(following, self.largest) == Beginning::Invalid => {
                Judgement::Skip(1)
            }
            None => Judgement::Message(size),
        }
    }

    /// Offset of a message that begins inside this one: the link was cut there and opened again.
    fn message_inside(&self, bytes: &[u8], size: usize) -> Option<usize> {
        let largest_byte = self.largest >> 24;
        let heads = &bytes[1..bytes.len().min(size + LONGEST_HEAD)];
        (1..size).zip(heads.windows(6)).find_map(|(at, head)| {
            // A quick check makes the exact one rare.
            let is_possible = head[5] & 0x7f == 0
                && (1..=7).contains(&head[4])
                && usize::from(head[3]) <= largest_byte;
            let is_message = is_possible
                && matches!(beginning(&bytes[at..], self.largest), Beginning::Certain(_));
            is_message.then_some(at)
        })
    }
}
