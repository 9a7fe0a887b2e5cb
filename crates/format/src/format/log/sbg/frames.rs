//! Frames of sbgECom; the reader resynchronises after damaged bytes.
//!
//! A frame is the bytes `FF 5A`, the message (u8), its class (u8), the length of the payload (u16),
//! the payload, a CRC (u16) over everything from the message to the payload, and the byte `33`. All
//! numbers are little-endian. A class with the highest bit set marks a page of a large frame, whose
//! payload starts with five bytes about the pages; only answers to commands use large frames.

use std::io::Read;
use std::path::PathBuf;

use crate::error::{Error, Result};
use crate::format::input::{Input, Stream};

const SYNC: [u8; 2] = [0xff, 0x5a];
const END: u8 = 0x33;
/// Bytes before the payload.
const HEADER: usize = 6;
/// Bytes of a frame without its payload.
const OVERHEAD: usize = HEADER + 3;
const MAX_PAYLOAD: usize = 4086;
/// Bytes read from the file at a time.
const CHUNK: u64 = 1 << 16;

/// A complete frame with the right CRC.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame<'a> {
    /// Start of the frame in the file, bytes.
    pub(super) at: u64,
    /// Length of the frame, bytes.
    pub(super) bytes: usize,
    /// Class, with the highest bit set for a page of a large frame.
    pub(super) class: u8,
    /// Number of the message within the class.
    pub(super) message: u8,
    /// At most 4086 bytes.
    pub(super) payload: &'a [u8],
}

/// The beginning of a byte slice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Start {
    /// A complete frame of this many bytes.
    Frame(usize),
    /// Bytes that may be the beginning of a frame.
    Incomplete,
    /// Anything else.
    Other,
}

/// The remainders of the CRC: polynomial 0x8408 (bits reversed), initially 0.
const CRC_TABLE: [u16; 256] = {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut crc = byte as u16;
        let mut bit = 0;
        while bit < 8 {
            crc = (crc >> 1) ^ (if crc & 1 == 1 { 0x8408 } else { 0 });
            bit += 1;
        }
        table[byte] = crc;
        byte += 1;
    }
    table
};

fn crc(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0, |crc: u16, byte| {
        (crc >> 8) ^ CRC_TABLE[usize::from(crc.to_le_bytes()[0] ^ byte)]
    })
}

/// Whether `bytes` begin with a frame.
pub(super) fn start_of(bytes: &[u8]) -> Start {
    let available = bytes.len().min(SYNC.len());
    if bytes[..available] != SYNC[..available] {
        return Start::Other;
    }
    let Some(&[low, high]) = bytes.get(4..HEADER).and_then(|b| b.first_chunk()) else {
        return Start::Incomplete;
    };
    let payload = usize::from(u16::from_le_bytes([low, high]));
    if payload > MAX_PAYLOAD {
        return Start::Other;
    }
    let Some(frame) = bytes.get(..payload + OVERHEAD) else {
        return Start::Incomplete;
    };
    let (checked, rest) = frame.split_at(payload + HEADER);
    let [low, high] = crc(&checked[SYNC.len()..]).to_le_bytes();
    if rest == [low, high, END] {
        Start::Frame(frame.len())
    } else {
        Start::Other
    }
}

/// Reads the frames of a file one after the other and counts all other bytes.
#[derive(Debug)]
pub(super) struct Frames {
    path: PathBuf,
    file: Stream,
    buffer: Vec<u8>,
    /// Index in the buffer of the next byte.
    start: usize,
    /// Start of the buffer in the file, bytes.
    buffer_at: u64,
    file_ended: bool,
    /// Bytes outside complete frames so far.
    pub(super) other_bytes: u64,
    /// Unbroken runs of such bytes so far.
    pub(super) other_runs: u64,
    /// Whether the last byte belongs to such a run.
    in_run: bool,
}

impl Frames {
    pub(super) fn open(input: &Input) -> Result<Self> {
        let (file, _) = input.open()?;
        Ok(Self {
            path: input.path().to_owned(),
            file,
            buffer: Vec::new(),
            start: 0,
            buffer_at: 0,
            file_ended: false,
            other_bytes: 0,
            other_runs: 0,
            in_run: false,
        })
    }

    /// The next complete frame; `None` at the end of the file.
    pub(super) fn next(&mut self) -> Result<Option<Frame<'_>>> {
        let size = loop {
            match start_of(&self.buffer[self.start..]) {
                Start::Frame(size) => break size,
                Start::Incomplete if !self.file_ended => self.refill()?,
                _ if self.start == self.buffer.len() => return Ok(None),
                _ => self.skip(),
            }
        };
        let at = self.buffer_at + self.start as u64;
        let bytes = &self.buffer[self.start..self.start + size];
        self.start += size;
        self.in_run = false;
        Ok(Some(Frame {
            at,
            bytes: size,
            message: bytes[2],
            class: bytes[3],
            payload: &bytes[HEADER..size - 3],
        }))
    }

    /// Advances to the next byte that could begin a frame. The length in a damaged header is not used:
    /// it could hide the frames after the damage.
    fn skip(&mut self) {
        let rest = &self.buffer[self.start + 1..];
        let skipped = 1 + rest
            .iter()
            .position(|b| *b == SYNC[0])
            .unwrap_or(rest.len());
        self.start += skipped;
        self.other_bytes += skipped as u64;
        self.other_runs += u64::from(!self.in_run);
        self.in_run = true;
    }

    fn refill(&mut self) -> Result<()> {
        self.buffer.drain(..self.start);
        self.buffer_at += self.start as u64;
        self.start = 0;
        let read = (&mut self.file)
            .take(CHUNK)
            .read_to_end(&mut self.buffer)
            .map_err(|e| Error::io(&self.path, e))?;
        self.file_ended = read == 0;
        Ok(())
    }
}
