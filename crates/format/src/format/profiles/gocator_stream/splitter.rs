//! Whole messages out of a stream of bytes.

use super::layout::{Beginning, LARGEST_MESSAGE, LONGEST_HEAD, beginning};

/// Cuts a stream into messages, from pieces of any length.
///
/// The protocol has neither a mark where a message begins nor a checksum. A message is taken as whole
/// when
///
/// * its size is the one that its own counts give, or, for types that are not read here, when
///   another message or the end of the stream follows,
/// * no message begins inside it: where a link was cut in a message and opened again, the first
///   message of the new link is in what looks like the end of the old one.
///
/// A message is given out when the first 16 bytes behind it are there, or at the end.
///
/// Bytes that belong to no message are skipped up to the next message of a known type, and counted.
/// At most one message of [`LARGEST_MESSAGE`] and the last piece are kept.
#[derive(Debug)]
pub struct Splitter {
    buffer: Vec<u8>,
    /// First byte of the buffer that is not given out.
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
    /// A whole message, and where it begins in the stream.
    Message(&'a [u8], u64),
    /// So many bytes that belong to no whole message.
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
    /// A splitter that takes messages of up to so many bytes.
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

    /// Takes the next bytes of the stream. All that [`Splitter::next`] has should be taken first.
    pub fn push(&mut self, bytes: &[u8]) {
        // Moving the rest only when it is the smaller part keeps the cost in proportion.
        if self.start > self.buffer.len() / 2 {
            self.buffer.copy_within(self.start.., 0);
            self.buffer.truncate(self.buffer.len() - self.start);
            self.start = 0;
        }
        self.buffer.extend_from_slice(bytes);
    }

    /// Says that no more bytes come: what is left is judged without waiting.
    pub fn finish(&mut self) {
        self.is_finished = true;
    }

    /// Bytes that are kept.
    pub fn kept(&self) -> usize {
        self.buffer.len() - self.start
    }

    /// The next part of the stream, nothing if more bytes are needed to tell.
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

    /// What the first byte that is kept is.
    fn judge(&self) -> Judgement {
        let bytes = &self.buffer[self.start..];
        let (size, is_certain) = match beginning(bytes, self.largest) {
            Beginning::TooShort if self.is_finished && !bytes.is_empty() => {
                return Judgement::Skip(1);
            }
            Beginning::TooShort => return Judgement::Wait,
            Beginning::Certain(size) => (size, true),
            // In garbage, four bytes of a size are no evidence.
            Beginning::Possible(size) if self.skipped == 0 => (size, false),
            Beginning::Possible(_) | Beginning::Invalid => return Judgement::Skip(1),
        };
        // Heads that begin in the last bytes of this message have to be seen whole, too.
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

    /// Where a message begins inside one: the link was cut there and opened again.
    fn message_inside(&self, bytes: &[u8], size: usize) -> Option<usize> {
        let largest_byte = self.largest >> 24;
        let heads = &bytes[1..bytes.len().min(size + LONGEST_HEAD)];
        (1..size).zip(heads.windows(6)).find_map(|(at, head)| {
            // A quick look spares nearly all of the exact ones.
            let is_possible = head[5] & 0x7f == 0
                && (1..=7).contains(&head[4])
                && usize::from(head[3]) <= largest_byte;
            let is_message = is_possible
                && matches!(beginning(&bytes[at..], self.largest), Beginning::Certain(_));
            is_message.then_some(at)
        })
    }
}
