//! The simulated instrument's replies to requests.

use std::time::Duration;

use super::super::codec::{Malformed, Reply, Request, Value};
use super::super::codes::ReturnCode;
use super::super::procedure::Procedure;
use super::{FaultKind, Simulated, direction};

/// A reply and the time until it is sent.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Answered {
    /// The line, without terminator; `None` if there is no reply.
    pub line: Option<Vec<u8>>,
    /// Time from the request to the reply.
    pub after: Duration,
}

/// The measurement program that measures angles at the time of the distance.
const SYNCHRONOUS: u16 = 10;

type Outcome = (ReturnCode, Vec<Value>);

/// The ATR's field of view: half of 1.5 gon, rad.
const FIELD_OF_VIEW_RAD: f64 = 0.0118;

impl Simulated {
    /// The reply to a line that arrives at a time, s, with the faults of that time.
    pub fn answer(&mut self, line: &[u8], time_s: f64) -> Answered {
        self.counts.requests += 1;
        self.follow(time_s);
        let mut after = self.settings.reply_time;
        if line == b"c" {
            let line = Some(b"?".to_vec());
            return Answered { line, after };
        }
        let text = match Request::parse(line) {
            Err(malformed) => failure(0, not_read(line, malformed)),
            Ok(request) => {
                let (text, wait) = self.reply(&request, time_s);
                after += wait;
                text
            }
        };
        if let Some(FaultKind::Slow(delay)) =
            self.fault(time_s, |kind| matches!(kind, FaultKind::Slow(_)))
        {
            self.counts.faults += 1;
            after += delay;
        }
        let line = Some(text.into_bytes());
        let line = self.damaged(line, time_s);
        Answered { line, after }
    }

    fn reply(&mut self, request: &Request, time_s: f64) -> (String, Duration) {
        let transaction = request.transaction.unwrap_or(0);
        let fails = |code| (failure(transaction, code), Duration::ZERO);
        if request.has_checksum && !self.settings.has_checksums {
            return fails(ReturnCode::COM_NO_CHECKSUM);
        }
        if self
            .fault(time_s, |kind| kind == FaultKind::DamagedRequest)
            .is_some()
        {
            self.counts.faults += 1;
            return fails(ReturnCode::COM_SRVR_RX_CHECKSUM_ERROR);
        }
        let known = Procedure::from_number(request.procedure);
        let Some(procedure) = known.filter(|known| !self.settings.unknown.contains(known)) else {
            return fails(ReturnCode::COM_PROC_UNAVAIL);
        };
        let (mut wait, mut outcome) = (Duration::ZERO, (ReturnCode::SYSBUSY, vec![]));
        if self.fault(time_s, |kind| kind == FaultKind::Busy).is_some() {
            self.counts.faults += 1;
            if procedure.name().starts_with("TMC") {
                outcome.0 = ReturnCode::TMC_BUSY;
            }
        } else {
            match self.perform(procedure, request, time_s, &mut wait) {
                Some(performed) => outcome = performed,
                None => return fails(ReturnCode::COM_CANT_DECODE_REQ),
            }
        }
        let (ok, checked) = (ReturnCode::OK, request.has_checksum);
        (
            Reply::line(ok, transaction, outcome.0, &outcome.1, checked),
            wait,
        )
    }

    /// Performs a procedure; `None` if the parameters do not fit it.
    fn perform(
        &mut self,
        procedure: Procedure,
        request: &Request,
        time_s: f64,
        wait: &mut Duration,
    ) -> Option<Outcome> {
        let done = |code| Some((code, vec![]));
        let give = |values: Vec<Value>| Some((ReturnCode::OK, values));
        let fields = &request.fields;
        let parameters = match procedure {
            Procedure::GetFullMeas | Procedure::GetSimpleMeas | Procedure::GetCoordinate => 2,
            Procedure::DoMeasure | Procedure::PowerSearchNext => 2,
            Procedure::FineAdjust => 3,
            Procedure::GetAngle => 1,
            _ if procedure.name().contains("_Set") => 1,
            _ => 0,
        };
        if fields.len() != parameters {
            return None;
        }
        match procedure {
            Procedure::Null => done(ReturnCode::OK),
            Procedure::GetGeoComVersion => give([1, 50, 0].map(Value::Integer).into()),
            Procedure::GetFirmware => give([5, 2, 0].map(Value::Integer).into()),
            Procedure::GetName => give(vec![Value::Text(self.settings.name.clone())]),
            Procedure::GetSerialNumber => give(vec![Value::Integer(self.settings.serial_number)]),
            // Percent; power from the internal battery, which is the recommended one.
            Procedure::CheckPower => give([87, 2, 2].map(Value::Integer).into()),
            Procedure::GetDecimals => mode(self.modes.decimals),
            Procedure::GetEdmMode => mode(self.modes.edm_mode),
            Procedure::GetMeasProgram => mode(self.modes.program),
            Procedure::GetPrismType => mode(self.modes.prism_type),
            Procedure::GetLockState => mode(self.modes.lock),
            Procedure::SetDecimals => {
                Some(set(&mut self.modes.decimals, fields.integer(0)?, 0..=15))
            }
            Procedure::SetEdmMode => {
                Some(set(&mut self.modes.edm_mode, fields.integer(0)?, 1..=14))
            }
            Procedure::SetPrismType => {
                Some(set(&mut self.modes.prism_type, fields.integer(0)?, 0..=12))
            }
            Procedure::SetMeasProgram => Some(self.set_program(fields.integer(0)?)),
            Procedure::SetLockState => {
                let outcome = set(&mut self.modes.lock, fields.integer(0)?, 0..=1);
                self.is_locked &= self.modes.lock == Some(1);
                Some(outcome)
            }
            Procedure::ReadLockStatus => give(vec![Value::Integer(self.is_locked.into())]),
            Procedure::LockIn => done(self.lock_in(time_s)),
            Procedure::FineAdjust => {
                let window = [fields.float(0)?, fields.float(1)?];
                done(self.search(time_s, window.map(|half| half.max(FIELD_OF_VIEW_RAD))))
            }
            Procedure::PowerSearchNext => done(self.search(time_s, [f64::MAX, f64::MAX])),
            Procedure::DoMeasure => {
                self.given = 0;
                self.measuring_since_s = match fields.integer(0)? {
                    0 | 3 => None,
                    _ => Some(time_s),
                };
                done(ReturnCode::OK)
            }
            Procedure::GetAngle => give(self.angles().into()),
            Procedure::QuickDist => {
                self.measuring_since_s.get_or_insert(time_s);
                Some(self.measure(procedure, time_s, 2.0 / self.settings.rate_hz, wait))
            }
            Procedure::GetFullMeas | Procedure::GetSimpleMeas | Procedure::GetCoordinate => {
                let longest_s = 1e-3 * fields.integer(0)? as f64;
                Some(self.measure(procedure, time_s, longest_s, wait))
            }
        }
    }

    fn set_program(&mut self, program: i64) -> Outcome {
        let outcome = set(&mut self.modes.program, program, 0..=11);
        if outcome.0 == ReturnCode::OK {
            // The mode of the distance meter that belongs to each program.
            const MODES: [u16; 12] = [2, 3, 4, 5, 6, 9, 8, 10, 12, 11, 7, 13];
            let i = usize::try_from(program).unwrap_or(0);
            self.modes.edm_mode = MODES.get(i).copied();
        }
        outcome
    }

    fn lock_in(&mut self, time_s: f64) -> ReturnCode {
        if self.modes.lock != Some(1) {
            return ReturnCode::AUT_NOT_ENABLED;
        }
        self.is_locked = self.sees(time_s, [FIELD_OF_VIEW_RAD; 2]);
        self.follow(time_s);
        if self.is_locked {
            ReturnCode::OK
        } else {
            ReturnCode::AUT_NO_TARGET
        }
    }

    fn search(&mut self, time_s: f64, window_rad: [f64; 2]) -> ReturnCode {
        if !self.sees(time_s, window_rad) {
            return ReturnCode::AUT_NO_TARGET;
        }
        self.pointing = direction((self.target)(time_s));
        ReturnCode::OK
    }

    fn angles(&self) -> [Value; 2] {
        self.pointing.map(|angle| self.float(angle))
    }

    fn measure(
        &mut self,
        procedure: Procedure,
        time_s: f64,
        longest_s: f64,
        wait: &mut Duration,
    ) -> Outcome {
        let mut time_s = time_s;
        if self
            .newest(time_s)
            .is_none_or(|newest| newest <= self.given)
        {
            let next_s = self.measured_at_s(self.given + 1) + 1e-6;
            let wait_s = (next_s - time_s).min(longest_s);
            if self.measuring_since_s.is_some() && wait_s > 0.0 {
                *wait = Duration::from_secs_f64(wait_s / self.settings.speed);
                time_s += wait_s;
                self.follow(time_s);
            }
        }
        let newest = self.newest(time_s);
        let is_new = newest.is_some_and(|newest| newest > self.given);
        let number = newest.filter(|_| is_new || self.settings.repeats_distances);
        if is_new {
            self.counts.distances += 1;
            self.given = newest.unwrap_or(0);
        }
        let code = match number {
            Some(_) => ReturnCode::OK,
            None => ReturnCode::TMC_ANGLE_OK,
        };
        let position_m = number.map(|number| (self.target)(self.measured_at_s(number)));
        let time_ms = number.map_or(0, |number| {
            (1e3 * self.measured_at_s(number)).round() as i64
        });
        let [e, n, u] = position_m.unwrap_or_default();
        let mut values: Vec<Value> = match position_m {
            Some(position_m) if self.modes.program == Some(SYNCHRONOUS) => {
                direction(position_m).map(|angle| self.float(angle)).into()
            }
            _ => self.angles().into(),
        };
        let distance = self.float(e.hypot(n).hypot(u));
        match procedure {
            Procedure::GetCoordinate => {
                let position = [e, n, u].map(|value| self.float(value));
                values = position.into();
                values.push(Value::Integer(time_ms));
                values.extend_from_within(..);
            }
            Procedure::GetFullMeas => {
                // Accuracy of angles, inclinations across and along, their accuracy.
                values.extend([4.8e-6, 1.2e-5, -2.3e-5, 2.4e-6].map(|value| self.float(value)));
                values.extend([distance, Value::Integer(time_ms)]);
            }
            _ => values.push(distance),
        }
        (code, values)
    }

    fn float(&self, value: f64) -> Value {
        let decimals = usize::from(self.modes.decimals.unwrap_or(15));
        Value::Float { value, decimals }
    }

    fn damaged(&mut self, line: Option<Vec<u8>>, time_s: f64) -> Option<Vec<u8>> {
        let is_damage = |kind| {
            let is_bytes = matches!(kind, FaultKind::WrongChecksum | FaultKind::Garbage);
            is_bytes || kind == FaultKind::Silent
        };
        let (Some(kind), Some(mut line)) = (self.fault(time_s, is_damage), line.clone()) else {
            return line;
        };
        self.counts.faults += 1;
        match kind {
            FaultKind::Silent => return None,
            FaultKind::WrongChecksum => {
                // After the transaction's number, instead of the true checksum if there is one.
                let colon = line
                    .iter()
                    .position(|&byte| byte == b':')
                    .unwrap_or(line.len());
                let commas: Vec<usize> = (0..colon).filter(|&i| line[i] == b',').collect();
                let header = commas.get(2).copied().unwrap_or(colon);
                let plain = [&line[..header], &line[colon..]].concat();
                let wrong = super::super::codec::checksum(&plain).wrapping_add(1);
                line = [
                    &line[..header],
                    format!(",{wrong}").as_bytes(),
                    &line[colon..],
                ]
                .concat();
            }
            _ => {
                let count = 1 + (self.noise.number() % 40) as usize;
                let noise = self.noise.bytes(count);
                line = match self.noise.number() % 3 {
                    0 => [noise, line].concat(),
                    1 => noise,
                    _ => [&line[..line.len() / 2], &noise].concat(),
                };
            }
        }
        Some(line)
    }
}

fn mode(value: Option<u16>) -> Option<Outcome> {
    Some(match value {
        Some(value) => (ReturnCode::OK, vec![Value::Integer(value.into())]),
        None => (ReturnCode::NOT_IMPL, vec![]),
    })
}

fn set(slot: &mut Option<u16>, value: i64, allowed: std::ops::RangeInclusive<u16>) -> Outcome {
    let value = u16::try_from(value)
        .ok()
        .filter(|value| allowed.contains(value));
    match value {
        Some(_) => *slot = value,
        None => return (ReturnCode::IVPARAM, vec![]),
    }
    (ReturnCode::OK, vec![])
}

fn failure(transaction: u16, code: ReturnCode) -> String {
    Reply::line(code, transaction, ReturnCode::OK, &[], false)
}

fn not_read(line: &[u8], malformed: Malformed) -> ReturnCode {
    match malformed {
        Malformed::Checksum => ReturnCode::COM_SRVR_RX_CHECKSUM_ERROR,
        Malformed::Syntax if line.starts_with(b"%R1Q,") => ReturnCode::COM_CANT_DECODE_REQ,
        Malformed::Syntax => ReturnCode::COM_NOT_GEOCOM,
    }
}
