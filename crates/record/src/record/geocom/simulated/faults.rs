//! Faults of a simulated instrument and its cable.

use std::time::Duration;

/// The kind of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultKind {
    /// The prism is hidden; afterwards the instrument must search for it.
    LostLock,
    /// The instrument replies that it is busy.
    Busy,
    /// The reply has a wrong checksum.
    WrongChecksum,
    /// The instrument replies that the request has a wrong checksum.
    DamagedRequest,
    /// The reply is delayed by this time.
    Slow(Duration),
    /// No reply.
    Silent,
    /// Random bytes before the reply, instead of it, or instead of its end.
    Garbage,
    /// The connection is closed, and new ones are closed at once.
    CableOut,
}

/// A fault in an interval of the instrument's time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fault {
    /// Its kind.
    pub kind: FaultKind,
    /// Beginning, s.
    pub from_s: f64,
    /// End, s.
    pub to_s: f64,
    /// The fault affects every n-th request; 1 for all requests.
    pub every: u64,
}

impl Fault {
    /// A fault that affects all requests in an interval.
    pub fn between(kind: FaultKind, from_s: f64, to_s: f64) -> Self {
        Self {
            kind,
            from_s,
            to_s,
            every: 1,
        }
    }

    /// The same fault, affecting only every n-th request.
    pub fn every(self, every: u64) -> Self {
        Self {
            every: every.max(1),
            ..self
        }
    }

    /// Whether the fault affects request number `request` at a time.
    pub(super) fn is_at(&self, time_s: f64, request: u64) -> bool {
        (self.from_s..self.to_s).contains(&time_s) && request.is_multiple_of(self.every)
    }

    /// Whether the fault overlaps an interval of time.
    pub(super) fn touches(&self, from_s: f64, to_s: f64) -> bool {
        self.from_s <= to_s && from_s < self.to_s
    }
}

/// Random bytes, the same in each run (xorshift of Marsaglia).
#[derive(Debug, Clone)]
pub struct Noise(pub u64);

impl Noise {
    /// The next random number.
    pub fn number(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// Random bytes.
    pub fn bytes(&mut self, count: usize) -> Vec<u8> {
        (0..count).map(|_| (self.number() >> 24) as u8).collect()
    }
}
