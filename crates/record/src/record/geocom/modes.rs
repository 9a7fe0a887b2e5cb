//! The instrument's modes, which are read before tracking and restored after it.

use std::time::Duration;

use super::channel::{Channel, Link};
use super::codec::{Fields, Value};
use super::codes::ReturnCode;
use super::procedure::Procedure;
use crate::error::{Error, Result};

/// Modes of an instrument; `None` for a mode that it does not have. The numbers are the manufacturer's.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Modes {
    /// Decimals in replies (`COM_SetDoublePrecision`).
    pub decimals: Option<u16>,
    /// Mode of the distance meter (`EDM_MODE`).
    pub edm_mode: Option<u16>,
    /// Measurement program (`BAP_USER_MEASPRG`).
    pub program: Option<u16>,
    /// Type of the prism (`BAP_PRISMTYPE`).
    pub prism_type: Option<u16>,
    /// Whether lock mode is on (0, 1).
    pub lock: Option<u16>,
}

/// Each mode's procedures to read and to write, in the order of writing: a program sets the mode
/// of the distance meter as well.
const ORDER: [(Procedure, Procedure); 5] = [
    (Procedure::GetDecimals, Procedure::SetDecimals),
    (Procedure::GetPrismType, Procedure::SetPrismType),
    (Procedure::GetMeasProgram, Procedure::SetMeasProgram),
    (Procedure::GetEdmMode, Procedure::SetEdmMode),
    (Procedure::GetLockState, Procedure::SetLockState),
];

impl Modes {
    fn list(&self) -> [Option<u16>; 5] {
        [
            self.decimals,
            self.prism_type,
            self.program,
            self.edm_mode,
            self.lock,
        ]
    }

    /// Reads all modes.
    ///
    /// # Errors
    /// [`Error::Io`] if the link fails. A mode that the instrument does not give is `None`.
    pub(super) fn read<L: Link, S>(channel: &mut Channel<L, S>, timeout: Duration) -> Result<Self> {
        let mut modes = [None; 5];
        for (slot, (get, _)) in modes.iter_mut().zip(ORDER) {
            *slot = value(channel, get, timeout, |fields| {
                fields.integer(0).and_then(|mode| u16::try_from(mode).ok())
            })?;
        }
        let [decimals, prism_type, program, edm_mode, lock] = modes;
        Ok(Self {
            decimals,
            edm_mode,
            program,
            prism_type,
            lock,
        })
    }

    /// Checks that all modes that will change are known, so that they can be restored.
    ///
    /// # Errors
    /// [`Error::Data`] for the first unknown mode.
    pub(super) fn check_known(&self, changes: &Self, port: &str) -> Result<()> {
        for ((present, change), (get, _)) in self.list().iter().zip(changes.list()).zip(ORDER) {
            if present.is_none() && change.is_some() {
                return Err(Error::data(
                    format!(
                        "{port}: {get}: found no value, expected a value to restore at the end"
                    ),
                    "omit the setting, so that the instrument's own is used",
                ));
            }
        }
        Ok(())
    }

    /// Writes all modes that are given, one after the other.
    ///
    /// # Errors
    /// The first error; the other modes are written nevertheless, unless the link failed.
    pub(super) fn write<L: Link, S>(
        &self,
        channel: &mut Channel<L, S>,
        timeout: Duration,
    ) -> Result<()> {
        let mut result = Ok(());
        for (value, (_, set)) in self.list().into_iter().zip(ORDER) {
            let Some(value) = value else { continue };
            let written = command(channel, set, &[Value::Integer(value.into())], timeout);
            let is_silent = matches!(written, Err(Error::Io { .. }));
            result = result.and(written);
            if is_silent {
                break;
            }
        }
        result
    }

    /// These modes, without the modes that `changes` does not have.
    pub(super) fn where_changed(&self, changes: &Self) -> Self {
        Self {
            decimals: changes.decimals.and(self.decimals),
            edm_mode: changes.edm_mode.or(changes.program).and(self.edm_mode),
            program: changes.program.and(self.program),
            prism_type: changes.prism_type.and(self.prism_type),
            lock: changes.lock.and(self.lock),
        }
    }
}

/// Sends a request whose reply has no values.
///
/// # Errors
/// [`Error::Io`] if the link fails, [`Error::Data`] if the instrument refuses.
pub(super) fn command<L: Link, S>(
    channel: &mut Channel<L, S>,
    procedure: Procedure,
    parameters: &[Value],
    timeout: Duration,
) -> Result<()> {
    let code = channel.ask(procedure, parameters, timeout)?.code();
    match code {
        ReturnCode::OK => Ok(()),
        _ => Err(refusal(channel.port(), procedure, code)),
    }
}

/// The error for a request that the instrument refused.
pub(super) fn refusal(port: &str, procedure: Procedure, code: ReturnCode) -> Error {
    let remedy = if code.is_unknown() {
        "this instrument has no such function: choose settings that do not need it"
    } else {
        "look at the instrument's screen, and try the same function there"
    };
    let problem = format!("{port}: {procedure}: found return code {code}, expected 0 OK");
    Error::data(problem, remedy)
}

/// Requests a value; `None` if the instrument does not give it. The request is repeated if the value is
/// damaged.
pub(super) fn value<L: Link, S, T>(
    channel: &mut Channel<L, S>,
    procedure: Procedure,
    timeout: Duration,
    read: impl Fn(&Fields) -> Option<T>,
) -> Result<Option<T>> {
    for _ in 0..3 {
        let answer = channel.ask(procedure, &[], timeout)?;
        if answer.code() != ReturnCode::OK {
            return Ok(None);
        }
        match read(&answer.reply.fields) {
            None => channel.counters.garbled += 1,
            value => return Ok(value),
        }
    }
    Ok(None)
}
