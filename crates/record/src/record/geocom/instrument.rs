//! A total station that tracks a prism.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::channel::{Channel, Counters, Link};
use super::codec::Value;
use super::codes::ReturnCode;
use super::event::Event;
use super::identity::{Identity, battery, greet};
use super::measurement::{Class, Measurement, PROCEDURES};
use super::modes::{Modes, command, refusal};
use super::procedure::Procedure;
use super::settings::TrackingSettings;
use crate::error::{Error, Result};

/// Least number of decimals in replies: 1e-9 rad is 1e-7 m at 100 m.
const FEWEST_DECIMALS: u16 = 9;
/// `TMC_MEASURE_PRG`: clear, and start measuring in the mode that is set.
const CLEAR: i64 = 3;
const START: i64 = 1;
/// `TMC_INCLINE_PRG`: the instrument decides whether to measure the inclination.
const INCLINATION: Value = Value::Integer(1);

/// A total station; `S` is the caller's time stamp.
pub struct Instrument<L: Link, S> {
    pub(super) channel: Channel<L, S>,
    pub(super) settings: TrackingSettings,
    identity: Identity,
    /// The modes before tracking, as far as this program changes them.
    before: Option<Modes>,
    /// The modes that tracking sets.
    pub(super) changes: Modes,
    is_tracking: bool,
    /// Index in [`PROCEDURES`] of the procedure that measures.
    procedure: usize,
    pub(super) is_lost: bool,
    pending: VecDeque<Event<S>>,
    last_request: Option<Instant>,
    pub(super) last_distance: Instant,
    /// `None` if the lock must be checked now.
    pub(super) last_lock_check: Option<Instant>,
    pub(super) last_start: Instant,
    last_instrument_time_s: Option<f64>,
}

impl<L: Link, S> Instrument<L, S> {
    /// Connects to the instrument on `link`, which error messages name `port`; `now` gives the time stamps of
    /// replies.
    ///
    /// # Errors
    /// [`Error::Io`] if there is no reply, [`Error::Data`] if the reply is not that of such an instrument.
    pub fn connect(
        link: L,
        port: &str,
        settings: TrackingSettings,
        now: impl FnMut() -> S + Send + 'static,
    ) -> Result<Self> {
        settings.check(port)?;
        let mut channel = Channel::new(link, port, Box::new(now));
        let mut pending = VecDeque::new();
        let identity = greet(&mut channel, &settings, &mut pending)?;
        let start = Instant::now();
        Ok(Self {
            channel,
            settings,
            identity,
            before: None,
            changes: Modes::default(),
            is_tracking: false,
            procedure: 0,
            is_lost: false,
            pending,
            last_request: None,
            last_distance: start,
            last_lock_check: Some(start),
            last_start: start,
            last_instrument_time_s: None,
        })
    }

    /// Continues over a new link after the old link ended. If the instrument was tracking, it tracks
    /// again; the modes before the first start will still be written back at the end.
    ///
    /// # Errors
    /// Those of [`Self::connect`] and [`Self::start`], and [`Error::Data`] if another instrument
    /// answers.
    pub fn reconnect(&mut self, link: L) -> Result<()> {
        self.channel.replace_link(link);
        let identity = greet(&mut self.channel, &self.settings, &mut self.pending)?;
        if identity.serial_number != self.identity.serial_number {
            let (new, old) = (identity.serial_number, self.identity.serial_number);
            // Our modes must not be written to another instrument.
            self.channel.is_dead = true;
            let port = self.channel.port();
            return Err(Error::data(
                format!("{port}: found instrument {new}, expected {old} as before"),
                "connect the instrument that the recording began with",
            ));
        }
        self.identity = identity;
        if self.is_tracking {
            self.start()
        } else {
            Ok(())
        }
    }

    /// The identity of the instrument at the last connection.
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    /// Whether it was started; it then continues tracking over a new link.
    pub fn is_tracking(&self) -> bool {
        self.is_tracking
    }

    /// Charge of the battery now, percent, if the instrument gives it.
    ///
    /// # Errors
    /// [`Error::Io`] if the link fails.
    pub fn read_battery(&mut self) -> Result<Option<i64>> {
        let percent = battery(&mut self.channel, self.settings.reply_timeout)?;
        self.identity.battery_percent = percent;
        Ok(percent)
    }

    /// Counts of events on the link so far.
    pub fn counters(&self) -> Counters {
        self.channel.counters
    }

    /// The procedure that measures.
    pub fn measures_by(&self) -> Procedure {
        PROCEDURES[self.procedure]
    }

    /// The modes that [`Self::stop`] writes back.
    pub fn before(&self) -> Option<Modes> {
        self.before
    }

    /// Sets the modes, searches for the prism and starts measuring. A prism that is not found is not an
    /// error: [`Event::Lost`] follows, and the search is repeated.
    ///
    /// # Errors
    /// [`Error::Io`] if the link fails, [`Error::Data`] if the instrument refuses a setting; the
    /// modes are then as before.
    pub fn start(&mut self) -> Result<()> {
        self.is_tracking = true;
        let started = self.set_up();
        if started.is_err()
            && !self.channel.is_dead
            && let Err(error) = self.stop()
        {
            let text = format!("the instrument may not be as before: {error}");
            self.pending.push_back(Event::Note(text));
        }
        started
    }

    fn set_up(&mut self) -> Result<()> {
        let timeout = self.settings.reply_timeout;
        let present = Modes::read(&mut self.channel, timeout)?;
        let has_few = |decimals: &u16| *decimals < FEWEST_DECIMALS;
        self.changes = Modes {
            decimals: present.decimals.filter(has_few).map(|_| 15),
            edm_mode: self.settings.edm_mode,
            program: self.settings.program,
            prism_type: self.settings.prism_type,
            lock: self.settings.lock.then_some(1),
        };
        present.check_known(&self.changes, self.channel.port())?;
        // After a reconnection the present modes are those that this program set.
        self.before = self.before.or(Some(present.where_changed(&self.changes)));
        self.changes.write(&mut self.channel, timeout)?;
        if self.settings.lock {
            let is_found = self.look_for_prism()?;
            match (self.is_lost, is_found) {
                (true, true) => self.pending.push_back(Event::Found),
                (false, false) => {
                    self.channel.counters.losses += 1;
                    self.pending.push_back(Event::Lost);
                }
                _ => {}
            }
            self.is_lost = !is_found;
        }
        self.last_instrument_time_s = None;
        self.start_distances()
    }

    pub(super) fn start_distances(&mut self) -> Result<()> {
        let timeout = self.settings.reply_timeout;
        // A measurement program of another user may still be running and block the distance meter.
        for program in [CLEAR, START] {
            let parameters = [Value::Integer(program), INCLINATION];
            command(
                &mut self.channel,
                Procedure::DoMeasure,
                &parameters,
                timeout,
            )?;
        }
        (self.last_start, self.last_distance) = (Instant::now(), Instant::now());
        Ok(())
    }

    /// Waits for the next event, as long as the instrument needs but at most four times the time-out of
    /// each request.
    ///
    /// # Errors
    /// [`Error::Io`] with the port if the link ended or the instrument does not reply: then open the
    /// port again and call [`Self::reconnect`]. [`Error::Data`] if the instrument cannot measure.
    pub fn next_event(&mut self) -> Result<Event<S>> {
        if let Some(event) = self.pending.pop_front() {
            return Ok(event);
        }
        if !self.is_tracking {
            let port = self.channel.port();
            return Err(Error::data(
                format!("{port}: not started"),
                "call start first",
            ));
        }
        if let Some(event) = self.check_lock()? {
            return Ok(event);
        }
        self.measure()
    }

    fn measure(&mut self) -> Result<Event<S>> {
        if let Some(last) = self.last_request {
            std::thread::sleep(self.settings.interval.saturating_sub(last.elapsed()));
        }
        self.last_request = Some(Instant::now());
        let by = self.measures_by();
        let wait_ms = i64::try_from(self.settings.wait.as_millis()).unwrap_or(i64::MAX);
        let parameters = match by {
            Procedure::QuickDist => vec![],
            Procedure::GetAngle => vec![INCLINATION],
            _ => vec![Value::Integer(wait_ms), INCLINATION],
        };
        let timeout = self.settings.reply_timeout + self.settings.wait;
        let end = Instant::now() + 3 * timeout;
        loop {
            let answer = self.channel.ask(by, &parameters, timeout)?;
            if answer.code().is_unknown() {
                return self.fall_back(answer.code());
            }
            if let Some(measurement) = Measurement::read(by, answer) {
                return self.finish(measurement);
            }
            self.channel.counters.garbled += 1;
            if Instant::now() >= end {
                let port = self.channel.port();
                let problem =
                    format!("{port}: {by}: found replies with other values than expected");
                return Err(Error::data(
                    problem,
                    "turn on checksums, or check the cable",
                ));
            }
            self.channel.counters.asked_again += 1;
        }
    }

    fn finish(&mut self, mut measurement: Measurement<S>) -> Result<Event<S>> {
        let has_distance = matches!(measurement.class, Class::Full | Class::NoFullCorrection);
        if has_distance {
            let time_s = measurement.instrument_time_s;
            if time_s.is_some() && time_s == self.last_instrument_time_s {
                self.channel.counters.repeated_distances += 1;
                measurement.drop_distance();
            } else {
                self.last_instrument_time_s = time_s;
                self.last_distance = Instant::now();
            }
        }
        // Coordinates come without angles.
        if measurement.by == Procedure::GetCoordinate {
            let timeout = self.settings.reply_timeout;
            let answer = self
                .channel
                .ask(Procedure::GetAngle, &[INCLINATION], timeout)?;
            measurement.angles =
                Measurement::read(Procedure::GetAngle, answer).and_then(|angles| angles.angles);
            if measurement.angles.is_none() && measurement.class == Class::AnglesOnly {
                measurement.class = Class::Nothing;
            }
        }
        Ok(Event::Measured(measurement))
    }

    fn fall_back(&mut self, code: ReturnCode) -> Result<Event<S>> {
        let old = self.measures_by();
        if self.procedure + 1 == PROCEDURES.len() {
            return Err(refusal(self.channel.port(), old, code));
        }
        self.procedure += 1;
        let new = self.measures_by();
        let loss = match new {
            Procedure::GetAngle => "there will be no distances",
            Procedure::GetCoordinate => "there will be coordinates instead of distances",
            _ => "distances will have no time from the instrument",
        };
        Ok(Event::Note(format!(
            "the instrument does not support {old}; {new} is used instead: {loss}"
        )))
    }

    /// Stops measuring and restores the modes before tracking.
    ///
    /// # Errors
    /// The first error; the other modes are restored nevertheless, unless the link ended.
    pub fn stop(&mut self) -> Result<()> {
        self.stop_within(self.settings.reply_timeout)
    }

    fn stop_within(&mut self, timeout: Duration) -> Result<()> {
        let clear = [Value::Integer(CLEAR), INCLINATION];
        let mut result = command(&mut self.channel, Procedure::DoMeasure, &clear, timeout);
        if let (Some(before), false) = (self.before, self.channel.is_dead) {
            result = result.and(before.write(&mut self.channel, timeout));
        }
        if result.is_ok() {
            (self.before, self.is_tracking) = (None, false);
        }
        result
    }
}

impl<L: Link, S> Drop for Instrument<L, S> {
    fn drop(&mut self) {
        if self.is_tracking && !self.channel.is_dead {
            // Nobody could handle an error here.
            let _ = self.stop_within(self.settings.reply_timeout.min(Duration::from_millis(500)));
        }
    }
}
