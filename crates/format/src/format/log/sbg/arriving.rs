//! Frames counted while they arrive.

use super::fields::Fields;
use super::frames::{Start, start_of};
use super::message::{EKF_EULER, EKF_QUAT, UTC_TIME};

/// The stream of a device while it is recorded: counts frames and follows the state of the device.
#[derive(Debug, Default)]
pub struct Arriving {
    /// Bytes at the end that may be the beginning of a frame.
    pending: Vec<u8>,
    utc: &'static str,
    filter: &'static str,
}

impl Arriving {
    /// Takes the next bytes. Returns the number of frames that they complete and the number of bytes that belong
    /// to no frame.
    pub fn take(&mut self, bytes: &[u8]) -> (u64, u64) {
        self.pending.extend_from_slice(bytes);
        let (mut at, mut frames, mut other_bytes) = (0, 0, 0);
        while at < self.pending.len() {
            match start_of(&self.pending[at..]) {
                Start::Frame(size) => {
                    let frame = &self.pending[at..at + size];
                    let payload = Fields(&frame[6..size - 3]);
                    match (frame[3], frame[2]) {
                        UTC_TIME => self.utc = utc_status(payload),
                        EKF_EULER => self.filter = filter_status(payload, 28),
                        EKF_QUAT => self.filter = filter_status(payload, 32),
                        _ => {}
                    }
                    frames += 1;
                    at += size;
                }
                Start::Incomplete => break,
                Start::Other => {
                    other_bytes += 1;
                    at += 1;
                }
            }
        }
        self.pending.drain(..at);
        (frames, other_bytes)
    }

    /// The status of the device's clock and of its filter as text; empty if neither is known.
    pub fn device_status(&self) -> String {
        let statuses = [self.utc, self.filter];
        let known: Vec<&str> = statuses.into_iter().filter(|s| !s.is_empty()).collect();
        known.join(", ")
    }
}

/// The status of the clock, from a UTC_TIME message.
fn utc_status(payload: Fields<'_>) -> &'static str {
    const ALIGNED: u16 = 1 << 5;
    let state = payload.u16(4).unwrap_or(0);
    match ((state >> 6) & 0xf, state & ALIGNED) {
        (2, 0) => "UTC not aligned to the pulse",
        (2, _) => "UTC aligned to the pulse",
        (1, _) => "UTC without leap seconds",
        _ => "no UTC",
    }
}

/// The mode of the filter: the lowest four bits of the state at this offset.
fn filter_status(payload: Fields<'_>, at: usize) -> &'static str {
    match payload.u32(at).map(|state| state & 0xf) {
        Some(1) => "filter: vertical gyro",
        Some(2) => "filter: attitude and heading",
        Some(3) => "filter: velocity",
        Some(4) => "filter: position",
        _ => "filter not started",
    }
}
