//! Counts the records that arrive, for the view.

use super::field::Kind;
use crate::format::ArrivingSbg;
use crate::format::gocator_stream::{Message, Piece, Splitter};

/// Longest line, bytes; a longer one is cut there.
pub(super) const LONGEST_LINE: usize = 4096;

/// Counts records, and bytes that belong to no record.
pub(super) enum Counter {
    /// Lines, with the length of the incomplete one.
    Lines(usize),
    /// sbgECom frames.
    Sbg(ArrivingSbg),
    /// Gocator frames.
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

    /// After the link was reopened: an incomplete line is not continued.
    pub(super) fn reopened(&mut self) {
        if let Self::Lines(length) = self {
            *length = 0;
        }
    }

    /// The status that the sensor reports; empty if it reports none.
    pub(super) fn sensor_status(&self) -> String {
        match self {
            Self::Sbg(arriving) => arriving.device_status(),
            _ => String::new(),
        }
    }

    /// Number of records that these bytes complete, and of bytes that belong to no record.
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

/// Number of frames whose stamps are in a message.
fn stamps_in(message: &[u8]) -> u64 {
    match Message::parse(message) {
        Some((Message::Stamps(stamps), _)) => stamps.iter().count() as u64,
        _ => 0,
    }
}
