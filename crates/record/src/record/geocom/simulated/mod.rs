//! A simulated total station: answers GeoCOM requests, tracks a moving prism, and has faults.

mod answers;
mod faults;
mod serve;

use std::f64::consts::TAU;
use std::time::{Duration, Instant};

pub use faults::{Fault, FaultKind, Noise};
pub use serve::{TcpInstrument, serve};

use super::modes::Modes;
use super::procedure::Procedure;

/// Properties of a simulated instrument.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulatedSettings {
    /// Name.
    pub name: String,
    /// Serial number.
    pub serial_number: i64,
    /// Rate of distances, Hz.
    pub rate_hz: f64,
    /// Seconds of simulated time per second of real time.
    pub speed: f64,
    /// Time from a request to its reply.
    pub reply_time: Duration,
    /// Whether it supports checksums.
    pub has_checksums: bool,
    /// Whether it repeats the last distance until there is a newer one.
    pub repeats_distances: bool,
    /// Procedures that it does not support.
    pub unknown: Vec<Procedure>,
    /// Faults.
    pub faults: Vec<Fault>,
}

impl Default for SimulatedSettings {
    fn default() -> Self {
        Self {
            name: "SIMULATED TS16".into(),
            serial_number: 3_201_407,
            rate_hz: 7.0,
            speed: 1.0,
            reply_time: Duration::from_millis(5),
            has_checksums: true,
            repeats_distances: false,
            unknown: Vec::new(),
            faults: Vec::new(),
        }
    }
}

/// Counts of a simulated instrument's actions.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SimulatedCounts {
    /// Requests received.
    pub requests: u64,
    /// Distances returned.
    pub distances: u64,
    /// Replies that were damaged, dropped, delayed or replaced by faults.
    pub faults: u64,
    /// Connections closed by faults.
    pub cuts: u64,
}

/// A prism's position as a function of time: t (s) -> east, north, up (m) in the instrument's frame.
type Target = Box<dyn Fn(f64) -> [f64; 3] + Send>;

/// A simulated instrument.
pub struct Simulated {
    settings: SimulatedSettings,
    target: Target,
    /// Times at which it measures distances, s, if not at a constant rate.
    epochs_s: Option<Vec<f64>>,
    switched_on: Instant,
    modes: Modes,
    counts: SimulatedCounts,
    noise: Noise,
    is_locked: bool,
    /// Hz and V of the telescope, rad.
    pointing: [f64; 2],
    /// Time at which measuring distances began, s.
    measuring_since_s: Option<f64>,
    /// Number of distances returned since then.
    given: u64,
    last_request_s: f64,
}

impl Simulated {
    /// An instrument that is switched on now and points at the prism.
    pub fn new(
        settings: SimulatedSettings,
        target: impl Fn(f64) -> [f64; 3] + Send + 'static,
    ) -> Self {
        let pointing = direction(target(0.0));
        Self {
            settings,
            target: Box::new(target),
            epochs_s: None,
            switched_on: Instant::now(),
            modes: Modes {
                decimals: Some(15),
                edm_mode: Some(2),
                program: Some(0),
                prism_type: Some(0),
                lock: Some(0),
            },
            counts: SimulatedCounts::default(),
            noise: Noise(0x9e37_79b9_7f4a_7c15),
            is_locked: false,
            pointing,
            measuring_since_s: None,
            given: 0,
            last_request_s: 0.0,
        }
    }

    /// An instrument that was switched on at an instant and measures a prism's positions (m, in its frame) at given
    /// times (s, increasing). In between, the prism moves at constant velocity.
    pub fn measuring(
        settings: SimulatedSettings,
        measured: Vec<(f64, [f64; 3])>,
        switched_on: Instant,
    ) -> Self {
        let epochs_s = measured.iter().map(|(time_s, _)| *time_s).collect();
        let target = move |time_s: f64| -> [f64; 3] {
            let next = measured.partition_point(|(at_s, _)| *at_s <= time_s);
            let before = measured.get(next.saturating_sub(1));
            match (before, measured.get(next)) {
                (Some((a_s, a)), Some((b_s, b))) if next > 0 => {
                    let part = (time_s - a_s) / (b_s - a_s);
                    std::array::from_fn(|i| a[i] + part * (b[i] - a[i]))
                }
                (Some((_, position)), _) => *position,
                (None, _) => [0.0, 1.0, 0.0],
            }
        };
        Self {
            epochs_s: Some(epochs_s),
            switched_on,
            ..Self::new(settings, target)
        }
    }

    /// Its present modes.
    pub fn modes(&self) -> Modes {
        self.modes
    }

    /// Sets its modes, as a user would at the instrument.
    pub fn set_modes(&mut self, modes: Modes) {
        self.modes = modes;
    }

    /// Stops measuring and switches the lock off, as a user would at the instrument.
    pub fn interrupt(&mut self) {
        self.measuring_since_s = None;
        self.is_locked = false;
        self.modes.lock = Some(0);
    }

    /// Counts of its actions so far.
    pub fn counts(&self) -> SimulatedCounts {
        self.counts
    }

    /// Whether it is measuring distances.
    pub fn is_measuring(&self) -> bool {
        self.measuring_since_s.is_some()
    }

    /// Time since it was switched on, s. Its target, its faults and its time stamps use this time.
    pub fn time_s(&self) -> f64 {
        self.settings.speed * self.switched_on.elapsed().as_secs_f64()
    }

    /// The first fault that affects the present request and whose kind satisfies `is_wanted`.
    fn fault(&self, time_s: f64, is_wanted: impl Fn(FaultKind) -> bool) -> Option<FaultKind> {
        let request = self.counts.requests;
        let mut faults = self.settings.faults.iter();
        let fault = faults.find(|fault| is_wanted(fault.kind) && fault.is_at(time_s, request));
        fault.map(|fault| fault.kind)
    }

    fn is_hidden(&self, time_s: f64) -> bool {
        self.fault(time_s, |kind| kind == FaultKind::LostLock)
            .is_some()
    }

    /// Follows the prism up to a time.
    fn follow(&mut self, time_s: f64) {
        let was_hidden = self.settings.faults.iter().any(|fault| {
            fault.kind == FaultKind::LostLock && fault.touches(self.last_request_s, time_s)
        });
        self.is_locked &= !was_hidden;
        if self.is_locked {
            self.pointing = direction((self.target)(time_s));
        }
        self.last_request_s = time_s;
    }

    /// Whether the prism is visible within a window around the telescope's direction.
    fn sees(&self, time_s: f64, window_rad: [f64; 2]) -> bool {
        let [hz, v] = direction((self.target)(time_s));
        let turn = (hz - self.pointing[0] + 0.5 * TAU).rem_euclid(TAU) - 0.5 * TAU;
        let is_inside =
            turn.abs() <= window_rad[0] && (v - self.pointing[1]).abs() <= window_rad[1];
        is_inside && !self.is_hidden(time_s)
    }

    /// Number of the newest distance, counted from 1, if there is one.
    fn newest(&self, time_s: f64) -> Option<u64> {
        let since_s = self.measuring_since_s?;
        if !self.sees(time_s, [0.005, 0.005]) {
            return None;
        }
        let number = match &self.epochs_s {
            Some(all) => {
                let until = |time_s: f64| all.partition_point(|at_s| *at_s <= time_s) as u64;
                until(time_s).saturating_sub(until(since_s))
            }
            None => ((time_s - since_s) * self.settings.rate_hz) as u64,
        };
        // Modes without repetition measure once.
        let last = if self.is_continuous() {
            number
        } else {
            number.min(1)
        };
        (last > 0).then_some(last)
    }

    fn is_continuous(&self) -> bool {
        matches!(self.modes.edm_mode, Some(6..=9))
    }

    /// Time of a distance, s.
    fn measured_at_s(&self, number: u64) -> f64 {
        let since_s = self.measuring_since_s.unwrap_or(0.0);
        match &self.epochs_s {
            Some(all) => {
                let before = all.partition_point(|at_s| *at_s <= since_s) as u64;
                let index = usize::try_from(before + number).unwrap_or(usize::MAX);
                let at_s = index.checked_sub(1).and_then(|index| all.get(index));
                at_s.copied().unwrap_or(f64::INFINITY)
            }
            None => since_s + number as f64 / self.settings.rate_hz,
        }
    }
}

/// Hz, clockwise from north, and zenith angle of a position, rad.
fn direction([east_m, north_m, up_m]: [f64; 3]) -> [f64; 2] {
    let hz = east_m.atan2(north_m).rem_euclid(TAU);
    [hz, east_m.hypot(north_m).atan2(up_m)]
}
