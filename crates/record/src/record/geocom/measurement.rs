//! Measurements, and the parsing of each procedure's reply.

use std::f64::consts::TAU;
use std::time::Duration;

use super::channel::Answer;
use super::codec::Fields;
use super::codes::ReturnCode;
use super::procedure::Procedure;

/// Quality of a measurement according to its return code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Class {
    /// Angles and distance with all corrections and full accuracy.
    Full,
    /// Angles and distance, not all corrections applied or accuracy not guaranteed.
    NoFullCorrection,
    /// Angles without a new distance.
    AnglesOnly,
    /// Neither angles nor distance.
    Nothing,
}

impl Class {
    fn of(code: ReturnCode) -> Self {
        match code {
            ReturnCode::OK => Self::Full,
            ReturnCode::TMC_NO_FULL_CORRECTION | ReturnCode::TMC_ACCURACY_GUARANTEE => {
                Self::NoFullCorrection
            }
            ReturnCode::TMC_ANGLE_OK
            | ReturnCode::TMC_ANGLE_NO_FULL_CORRECTION
            | ReturnCode::TMC_ANGLE_ACCURACY_GUARANTEE => Self::AnglesOnly,
            _ => Self::Nothing,
        }
    }
}

/// Directions of the telescope.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Angles {
    /// Horizontal direction, clockwise, rad.
    pub hz_rad: f64,
    /// Zenith angle, rad.
    pub v_rad: f64,
}

/// One reply to a measurement request; `S` is the caller's time stamp.
#[derive(Debug, Clone, PartialEq)]
pub struct Measurement<S> {
    /// Time at which the reply was complete.
    pub arrived: S,
    /// Time from writing the request until the reply was complete; the angles were measured in between.
    pub round_trip: Duration,
    /// Directions, if valid.
    pub angles: Option<Angles>,
    /// Slope distance, m, if there is a new one.
    pub distance_m: Option<f64>,
    /// East, north, height, m, in the instrument's station coordinates; only from
    /// [`Procedure::GetCoordinate`].
    pub position_m: Option<[f64; 3]>,
    /// Time of the distance on the instrument's own clock, s, if the procedure gives it.
    pub instrument_time_s: Option<f64>,
    /// Quality of the measurement.
    pub class: Class,
    /// Return code of the instrument.
    pub code: ReturnCode,
    /// The procedure that measured.
    pub by: Procedure,
}

/// Procedures for measuring, the best first; an instrument may not support the first ones.
pub(super) const PROCEDURES: [Procedure; 5] = [
    Procedure::GetFullMeas,
    Procedure::GetSimpleMeas,
    Procedure::QuickDist,
    Procedure::GetCoordinate,
    Procedure::GetAngle,
];

/// A full circle, with some tolerance for rounding.
const LARGEST_ANGLE_RAD: f64 = TAU + 1e-6;

impl<S> Measurement<S> {
    /// Parses the reply of one of [`PROCEDURES`]. `None` if the reply lacks values that its code promises.
    pub(super) fn read(by: Procedure, answer: Answer<S>) -> Option<Self> {
        let code = answer.code();
        let (fields, mut class) = (&answer.reply.fields, Class::of(code));
        let mut values = ReplyValues::default();
        // The manual promises values only with code 0.
        if fields.is_empty() && code != ReturnCode::OK {
            class = Class::Nothing;
        }
        if class != Class::Nothing {
            values = ReplyValues::read(by, fields, class != Class::AnglesOnly)?;
            let has_distance = values.distance_m.is_some() || values.position_m.is_some();
            if !has_distance {
                class = Class::AnglesOnly;
            }
        }
        Some(Self {
            arrived: answer.arrived,
            round_trip: answer.round_trip,
            angles: values.angles,
            distance_m: values.distance_m,
            position_m: values.position_m,
            instrument_time_s: values.instrument_time_s,
            class,
            code,
            by,
        })
    }

    /// Drops the distance, because it was measured before the angles and has been returned already.
    pub(super) fn drop_distance(&mut self) {
        self.distance_m = None;
        self.position_m = None;
        self.instrument_time_s = None;
        self.class = Class::AnglesOnly;
    }
}

/// The values in a reply.
#[derive(Default)]
struct ReplyValues {
    angles: Option<Angles>,
    distance_m: Option<f64>,
    position_m: Option<[f64; 3]>,
    instrument_time_s: Option<f64>,
}

impl ReplyValues {
    fn read(by: Procedure, fields: &Fields, has_distance: bool) -> Option<Self> {
        let mut values = Self::default();
        let length = match by {
            Procedure::GetFullMeas | Procedure::GetCoordinate => 8,
            Procedure::GetAngle => 2,
            _ => 3,
        };
        if fields.len() != length {
            return None;
        }
        if by == Procedure::GetCoordinate {
            if has_distance {
                let (e, n, h) = (fields.float(0)?, fields.float(1)?, fields.float(2)?);
                values.position_m = Some([e, n, h]);
                values.instrument_time_s = Some(time_s(fields, 3)?);
            }
            return Some(values);
        }
        let angles = Angles {
            hz_rad: fields.float(0)?,
            v_rad: fields.float(1)?,
        };
        if [angles.hz_rad, angles.v_rad]
            .iter()
            .any(|angle| angle.abs() > LARGEST_ANGLE_RAD)
        {
            return None;
        }
        values.angles = Some(angles);
        if has_distance && by != Procedure::GetAngle {
            let at = if by == Procedure::GetFullMeas { 6 } else { 2 };
            let distance_m = fields.float(at)?;
            values.distance_m = (distance_m > 0.0).then_some(distance_m);
            if by == Procedure::GetFullMeas && values.distance_m.is_some() {
                values.instrument_time_s = Some(time_s(fields, 7)?);
            }
        }
        Some(values)
    }
}

/// The time in field `i`, seconds; instruments write milliseconds since they were switched on.
fn time_s(fields: &Fields, i: usize) -> Option<f64> {
    fields.float(i).map(|time_ms| 1e-3 * time_ms)
}
