//! Search for the prism, at the start and after the prism was lost.

use std::time::{Duration, Instant};

use super::channel::Link;
use super::codec::Value;
use super::codes::ReturnCode;
use super::event::Event;
use super::instrument::Instrument;
use super::modes::refusal;
use super::procedure::Procedure;
use crate::error::Result;

/// The lock is checked after this time without a distance.
const LOCK_CHECK: Duration = Duration::from_millis(500);
/// Measuring is restarted after this time without a distance, although the instrument follows the prism.
const RESTART: Duration = Duration::from_secs(3);

impl<L: Link, S> Instrument<L, S> {
    /// Searches for the prism; returns whether the instrument follows it now.
    pub(super) fn look_for_prism(&mut self) -> Result<bool> {
        let [hz, v] = self.settings.search_rad.map(Value::float);
        let timeout = self.settings.search_timeout;
        let window = [hz, v, Value::Integer(0)];
        // The manual asks for a fine adjustment before the first lock.
        self.channel.ask(Procedure::FineAdjust, &window, timeout)?;
        let mut code = self.channel.ask(Procedure::LockIn, &[], timeout)?.code();
        if code == ReturnCode::AUT_NOT_ENABLED {
            // Someone at the instrument changed its modes, or switched it off and on.
            self.changes
                .write(&mut self.channel, self.settings.reply_timeout)?;
            code = self.channel.ask(Procedure::LockIn, &[], timeout)?.code();
        }
        if code != ReturnCode::OK && self.settings.power_search {
            let clockwise = [Value::Integer(1), Value::Integer(1)];
            self.channel
                .ask(Procedure::PowerSearchNext, &clockwise, timeout)?;
            code = self.channel.ask(Procedure::LockIn, &[], timeout)?.code();
        }
        if code.is_unknown() {
            let port = self.channel.port();
            return Err(refusal(port, Procedure::LockIn, code));
        }
        Ok(code == ReturnCode::OK)
    }

    /// Checks the lock if distances are missing, and searches for a lost prism; `None` if nothing changed.
    pub(super) fn check_lock(&mut self) -> Result<Option<Event<S>>> {
        let is_due = self
            .last_lock_check
            .is_none_or(|last| last.elapsed() >= LOCK_CHECK)
            && (self.is_lost || self.last_distance.elapsed() >= LOCK_CHECK);
        if !is_due {
            return Ok(None);
        }
        self.last_lock_check = Some(Instant::now());
        let is_long = self.last_distance.max(self.last_start).elapsed() >= RESTART;
        if self.settings.lock {
            let timeout = self.settings.reply_timeout;
            let answer = self.channel.ask(Procedure::ReadLockStatus, &[], timeout)?;
            // 0: not locked; 1: locked; 2: predicting the motion of the prism behind an obstacle.
            let status = match answer.code() {
                ReturnCode::OK => answer.reply.fields.integer(0),
                _ => None,
            };
            let is_locked = match status {
                Some(0) if !self.is_lost => {
                    self.is_lost = true;
                    self.channel.counters.losses += 1;
                    // The next call searches for the prism at once.
                    self.last_lock_check = None;
                    return Ok(Some(Event::Lost));
                }
                Some(0) => self.look_for_prism()?,
                Some(1) => true,
                Some(_) => return Ok(None),
                None => is_long && self.look_for_prism()?,
            };
            self.last_lock_check = Some(Instant::now());
            if self.is_lost && is_locked {
                self.is_lost = false;
                self.start_distances()?;
                return Ok(Some(Event::Found));
            }
            if !is_locked {
                return Ok(None);
            }
        }
        if is_long {
            self.changes
                .write(&mut self.channel, self.settings.reply_timeout)?;
            self.start_distances()?;
        }
        Ok(None)
    }
}
