//! What goes wrong on a simulated instrument and its cable.

use std::time::Duration;

/// What goes wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultKind {
    /// The prism is hidden; afterwards it has to be looked for.
    LostLock,
    /// The instrument says that it is busy.
    Busy,
    /// The reply has a wrong checksum.
    WrongChecksum,
    /// The instrument finds that the request has a wrong checksum.
    DamagedRequest,
    /// The reply comes later by this.
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
    /// What goes wrong.
    pub kind: FaultKind,
    /// When it begins, s.
    pub from_s: f64,
    /// When it ends, s.
    pub to_s: f64,
    /// Concerns every so many requests, from 1 (all).
    pub every: u64,
}

impl Fault {
    /// A fault of all requests in an interval.
    pub fn between(kind: FaultKind, from_s: f64, to_s: f64) -> Self {
        Self {
            kind,
            from_s,
            to_s,
            every: 1,
        }
    }

    /// The same of every so many requests.
    pub fn every(self, every: u64) -> Self {
        Self {
            every: every.max(1),
            ..self
        }
    }

    /// Whether it concerns request number `request` at a time.
    pub(super) fn is_at(&self, time_s: f64, request: u64) -> bool {
        (self.from_s..self.to_s).contains(&time_s) && request.is_multiple_of(self.every)
    }

    /// Whether it began or lasted in an interval of time.
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
