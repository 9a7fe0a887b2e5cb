//! Counts what arrives, for the view.

use super::field::Kind;
use crate::format::ArrivingSbg;
use crate::format::gocator_stream::{Message, Piece, Splitter};

/// Longest line: one without an end is cut there.
pub(super) const LONGEST_LINE: usize = 4096;

/// Counts records, and bytes that belong to none.
pub(super) enum Counter {
    /// Lines; how long the present one is.
    Lines(usize),
    /// Frames of sbgECom.
    Sbg(ArrivingSbg),
    /// Frames of a Gocator.
    Gocator(Box<Splitter>),
}

impl Counter {
    pub(super) fn new(kind: &Kind) -> Self {
        match kind {
            Kind::Sbg => Self::Sbg(ArrivingSbg::default()),
            Kind::Gocator => Self::Gocator(Box::default()),
            _ => Self::Lines(0),
        }
    }

    /// The link was opened again: a line that had begun does not go on.
    pub(super) fn reopened(&mut self) {
        if let Self::Lines(length) = self {
            *length = 0;
        }
    }

    /// What the sensor says of itself, if it does.
    pub(super) fn word(&self) -> String {
        match self {
            Self::Sbg(arriving) => arriving.word(),
            _ => String::new(),
        }
    }

    /// Records that these bytes complete, and bytes that turned out to belong to none.
    pub(super) fn take(&mut self, bytes: &[u8]) -> (u64, u64) {
        match self {
            Self::Lines(length) => {
                let mut count = 0;
                for &byte in bytes {
                    let is_end = byte == b'\n' || *length >= LONGEST_LINE;
                    *length = if is_end { 0 } else { *length + 1 };
                    count += u64::from(is_end);
                }
                (count, 0)
            }
            Self::Sbg(arriving) => arriving.take(bytes),
            Self::Gocator(splitter) => {
                splitter.push(bytes);
                let (mut frames, mut damaged) = (0, 0);
                while let Some(piece) = splitter.next() {
                    match piece {
                        Piece::Message(bytes, _) => frames += stamps_in(bytes),
                        Piece::Gap(bytes) => damaged += bytes,
                    }
                }
                (frames, damaged)
            }
        }
    }
}

/// Frames of which a message has the stamps.
fn stamps_in(message: &[u8]) -> u64 {
    match Message::parse(message) {
        Some((Message::Stamps(stamps), _)) => stamps.iter().count() as u64,
        _ => 0,
    }
}
