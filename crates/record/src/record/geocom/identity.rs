//! Identity of the connected instrument.

use std::collections::VecDeque;
use std::time::Duration;

use super::channel::{Channel, Link};
use super::codes::ReturnCode;
use super::event::Event;
use super::modes::{command, value};
use super::procedure::Procedure;
use super::settings::TrackingSettings;
use crate::error::{Error, Result};

/// Name, serial number and battery of an instrument.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Identity {
    /// Name, for example "TS16".
    pub name: String,
    /// Serial number.
    pub serial_number: i64,
    /// Charge of its battery, percent, if the instrument gives it.
    pub battery_percent: Option<i64>,
}

/// Tests the connection and reads the identity of the instrument.
pub(super) fn greet<L: Link, S>(
    channel: &mut Channel<L, S>,
    settings: &TrackingSettings,
    pending: &mut VecDeque<Event<S>>,
) -> Result<Identity> {
    let timeout = settings.reply_timeout;
    channel.set_checksum(false);
    command(channel, Procedure::Null, &[], timeout)?;
    if settings.checksum {
        channel.set_checksum(true);
        let answer = channel.ask(Procedure::Null, &[], timeout);
        if answer.as_ref().is_err() && channel.is_dead {
            answer?;
        } else if !matches!(&answer, Ok(answer) if answer.code() == ReturnCode::OK) {
            channel.set_checksum(false);
            let note = "the instrument sends no checksums: a damaged value may remain undetected";
            pending.push_back(Event::Note(note.into()));
        }
    }
    let name = value(channel, Procedure::GetName, timeout, |fields| {
        fields.text(0)
    })?;
    let number = value(channel, Procedure::GetSerialNumber, timeout, |fields| {
        fields.integer(0)
    })?;
    let Some(serial_number) = number else {
        return Err(Error::data(
            format!(
                "{}: found no serial number, expected the serial number of an instrument",
                channel.port()
            ),
            "check that a total station is connected to this port",
        ));
    };
    Ok(Identity {
        name: name.unwrap_or_else(|| "unknown".into()),
        serial_number,
        battery_percent: battery(channel, timeout)?,
    })
}

/// Charge of the battery, percent, if the instrument gives it.
pub(super) fn battery<L: Link, S>(
    channel: &mut Channel<L, S>,
    timeout: Duration,
) -> Result<Option<i64>> {
    let percent = value(channel, Procedure::CheckPower, timeout, |fields| {
        fields.integer(0)
    })?;
    Ok(percent.filter(|percent| (0..=100).contains(percent)))
}
