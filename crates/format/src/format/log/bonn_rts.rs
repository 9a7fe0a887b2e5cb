//! Tables of robotic total stations as the `rts-network` of the Bonn group for engineering geodesy
//! exports them: `ref_time, ts_time, h_angle, v_angle, distance, num_chars, geocom_return_code,
//! rpc_return_code`.
//!
//! | column | unit |
//! |---|---|
//! | `ref_time` | seconds of the Unix epoch: when the computer received the observation |
//! | `ts_time` | the observation on the clock of the instrument: see below |
//! | `h_angle` | radians clockwise from the instrument's horizontal zero |
//! | `v_angle` | radians from the zenith |
//! | `distance` | slope distance, metres |
//! | `num_chars` | length of the answer of the instrument, bytes |
//!
//! The instrument answers in radians, metres and milliseconds since it was switched on, and the
//! group computes x = d sin v sin h, y = d sin v cos h, z = d cos v. The export divides `ts_time`
//! by 1000. A corrected export also shifts `ts_time` to the clock of the computer and subtracts the
//! duration of the transmission from `ref_time`. Recordings made without the export have the same
//! columns, but milliseconds. The header is the same in both cases; the reader compares the spans
//! of the two clocks.

use crate::error::{Error, Location, Result};
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::log::old_distance::{OldDistances, PolarRow, without_range};
use crate::format::log::positions::check_measured;
use crate::format::text::table::{Columns, Table};
use crate::geometry::Vec3;
use crate::sensor::{Observations, PolarObservation, Positions, RejectedRow};

/// The columns that are needed and the columns that are used if present; others are ignored.
pub(crate) const COLUMNS: Columns = Columns {
    needed: &["ref_time", "ts_time", "h_angle", "v_angle", "distance"],
    optional: &["num_chars", "geocom_return_code", "rpc_return_code"],
};

pub(crate) const RTS: Kind = Kind {
    columns: Some(COLUMNS),
    positions: Some(read_positions),
    note: "polar observations: the project must give station_m and station_orientation_deg; times are those of \
           the computer (ref_time)",
    frame: Frame::Fixed(
        "radians, metres and seconds (the format); polar about the instrument, clockwise from its zero, from the zenith",
    ),
    ..Kind::new("rts-csv", "total station log (table of the Bonn group)")
};

/// Spans of the two clocks differ by this factor if one counts milliseconds and the other seconds,
/// within a few percent for the jitter of the computer's clock.
const MILLISECONDS: std::ops::Range<f64> = 900.0..1100.0;

/// One observation of the prism.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RtsObservation {
    /// Arrival of the observation at the computer, seconds of the Unix epoch.
    pub ref_time_s: f64,
    /// The observation on the clock of the instrument, seconds since it was switched on; in a
    /// corrected export seconds of the computer's clock.
    pub instrument_time_s: f64,
    /// From the instrument's axes to the prism, metres.
    pub slope_distance_m: f64,
    /// Clockwise from the instrument's horizontal zero, radians.
    pub horizontal_rad: f64,
    /// From the zenith, radians.
    pub vertical_rad: f64,
    /// Length of the instrument's answer, bytes: its transmission took ten bits per byte.
    pub answer_bytes: Option<f64>,
}

impl RtsObservation {
    /// The polar observation with the time `time_s`: one of the two times, or a combination of them.
    pub fn at(&self, time_s: f64) -> PolarObservation {
        PolarObservation {
            time_s,
            slope_distance_m: self.slope_distance_m,
            horizontal_rad: self.horizontal_rad,
            vertical_rad: self.vertical_rad,
        }
    }
}

/// The content of a table.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RtsObservations {
    /// In the order of the file.
    pub observations: Vec<RtsObservation>,
    /// Rows without a range, with an old one, or without a time of the instrument, with their times of arrival.
    pub rejected: Vec<RejectedRow>,
}

/// Reads a table; rows without a range, or with an old one, are rejected, with the return codes of the instrument.
///
/// # Errors
/// Missing columns, cells that are not finite numbers, angles that are not radians, no row with a
/// range.
pub fn read_polar(input: &Input) -> Result<RtsObservations> {
    use std::f64::consts::TAU;
    // Instruments round 2π, and corrections for delays may exceed it.
    const SLACK_RAD: f64 = 1e-2;
    let mut table = Table::open(input, &COLUMNS)?;
    let mut log = RtsObservations::default();
    let mut old = OldDistances::default();
    let mut row = [0.0; 8];
    while table.next_row(&mut row)? {
        let [
            ref_time_s,
            instrument_time_s,
            horizontal_rad,
            vertical_rad,
            slope_distance_m,
            answer_bytes,
            geocom_code,
            rpc_code,
        ] = row;
        let reason = without_range(slope_distance_m).or_else(|| {
            // Before its first measurement.
            if instrument_time_s == 0.0 {
                return Some("no time of the instrument".to_owned());
            }
            let direction = Vec3::new(
                vertical_rad.sin() * horizontal_rad.sin(),
                vertical_rad.sin() * horizontal_rad.cos(),
                vertical_rad.cos(),
            );
            old.reason(PolarRow {
                time_s: ref_time_s,
                slope_distance_m,
                position_m: direction * slope_distance_m,
                status: rpc_code,
            })
        });
        if let Some(mut reason) = reason {
            for (name, code) in [("GeoCOM", geocom_code), ("RPC", rpc_code)] {
                if !code.is_nan() {
                    reason += &format!(", {name} code {code}");
                }
            }
            log.rejected.push(RejectedRow {
                source: input.path().display().to_string(),
                line: table.number(),
                time_s: ref_time_s,
                reason,
            });
            continue;
        }
        for (name, angle, least) in [
            ("h_angle", horizontal_rad, -TAU - SLACK_RAD),
            ("v_angle", vertical_rad, -SLACK_RAD),
        ] {
            if !(least..=TAU + SLACK_RAD).contains(&angle) {
                let found = format!("{name} = {angle}");
                return Err(table.error(found, "an angle in radians, up to 6.2832"));
            }
        }
        log.observations.push(RtsObservation {
            ref_time_s,
            instrument_time_s,
            slope_distance_m,
            horizontal_rad,
            vertical_rad,
            answer_bytes: Some(answer_bytes).filter(|bytes| !bytes.is_nan()),
        });
    }
    let counts = [log.observations.len(), log.rejected.len()];
    let needed = "a range and a time of the instrument";
    check_measured(input, counts, "observation", needed)?;
    if counts_milliseconds(&log.observations) {
        for observation in &mut log.observations {
            observation.instrument_time_s *= 1e-3;
        }
    }
    Ok(log)
}

/// Whether the clock of the instrument counts a thousand times as fast as the clock of the computer.
fn counts_milliseconds(observations: &[RtsObservation]) -> bool {
    let (Some(first), Some(last)) = (observations.first(), observations.last()) else {
        return false;
    };
    let span = last.instrument_time_s - first.instrument_time_s;
    MILLISECONDS.contains(&(span / (last.ref_time_s - first.ref_time_s)))
}

/// Reads positions relative to an instrument, at the times of the computer.
fn read_positions(input: &Input, observations: &Observations) -> Result<Positions> {
    let Observations::Polar(instrument) = observations else {
        return Err(Error::format(
            input.path(),
            Location::Whole,
            "polar observations only",
            "the instrument's pose in the project (station_m and station_orientation_deg)",
        ));
    };
    let log = read_polar(input)?;
    let observations = log.observations.iter();
    Ok(Positions {
        fixes: observations
            .map(|rts| instrument.position_fix(&rts.at(rts.ref_time_s)))
            .collect(),
        rejected: log.rejected,
        ..Positions::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::mutation::for_each_damaged;
    use crate::sensor::TotalStation;

    const EXPORT: &str = "ref_time, ts_time, h_angle, v_angle, distance, num_chars, \
        geocom_return_code, rpc_return_code\n\
        1709200000.125,812.5,1.5707963267948966,1.5707963267948966,25.5,96,0,0\n\
        1709200000.225,812.6,1.58,1.5,0.0,96,0,1284\n\
        1709200000.325,812.7,6.25,1.5,25.0,95,0,1283\n";

    #[test]
    fn new_rows_of_a_log_that_grows_may_all_lack_a_range() {
        let mut lines = EXPORT.lines();
        let rows = [lines.next().unwrap(), lines.nth(1).unwrap(), ""].join("\n");
        assert!(read_text(&rows).is_err());
        let excerpt = Input::excerpt("rts.csv".as_ref(), rows.into_bytes());
        let found = read_polar(&excerpt).unwrap();
        assert_eq!((found.observations.len(), found.rejected.len()), (0, 1));
    }

    fn read_text(text: &str) -> Result<RtsObservations> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("rts.csv");
        std::fs::write(&path, text).unwrap();
        read_polar(&Input::from(&path))
    }

    #[test]
    fn an_export_is_read_in_radians_metres_and_seconds() {
        let found = read_text(EXPORT).unwrap();
        assert_eq!(found.observations.len(), 2);
        let first = found.observations[0];
        assert_eq!(
            (first.ref_time_s, first.instrument_time_s),
            (1_709_200_000.125, 812.5)
        );
        assert_eq!(
            (first.slope_distance_m, first.answer_bytes),
            (25.5, Some(96.0))
        );
        assert_eq!(found.observations[1].horizontal_rad, 6.25);
        let rejected = &found.rejected[0];
        assert_eq!((rejected.line, rejected.time_s), (3, 1_709_200_000.225));
        assert_eq!(rejected.reason, "zero range, GeoCOM code 0, RPC code 1284");

        // A quarter turn clockwise from the y axis, at the horizon.
        let instrument = TotalStation {
            station_m: Vec3::zeros(),
            orientation_rad: 0.0,
            vertical: Default::default(),
            reflector_constant_m: 0.0,
            sigma_distance_m: 0.001,
            sigma_distance_ppm: 1.0,
            sigma_angle_rad: 1e-5,
            sigma_prism_m: 0.0,
        };
        let fix = instrument.position_fix(&first.at(first.ref_time_s));
        assert!((fix.position_m - Vec3::x() * 25.5).norm() < 1e-12);
        // The coordinates that the group computes.
        let second = found.observations[1];
        let (d, h, v) = (25.0, 6.25_f64, 1.5_f64);
        let expected = Vec3::new(v.sin() * h.sin(), v.sin() * h.cos(), v.cos()) * d;
        let fix = instrument.position_fix(&second.at(second.instrument_time_s));
        assert!((fix.position_m - expected).norm() < 1e-12);
    }

    #[test]
    fn milliseconds_follow_from_the_span() {
        let recording = EXPORT
            .replace(",812.5,", ",812500,")
            .replace(",812.7,", ",812700,");
        let times = |text: &str| {
            let found = read_text(text).unwrap().observations;
            [found[0].instrument_time_s, found[1].instrument_time_s]
        };
        assert_eq!(times(&recording), [812.5, 812.7]);
        assert_eq!(times(EXPORT), [812.5, 812.7]);
        let corrected = EXPORT.replace(",812.", ",1709200000.");
        assert_eq!(times(&corrected), [1_709_200_000.5, 1_709_200_000.7]);
    }

    #[test]
    fn headers_and_errors() {
        let names = |text: &str| text.split(", ").map(str::to_owned).collect::<Vec<_>>();
        let header = "note, distance, ref_time, ts_time, h_angle, v_angle";
        assert!(COLUMNS.are_in(&names(header)));
        assert!(!COLUMNS.are_in(&names("ref_time, ts_time, h_angle, v_angle")));
        let text = |text: &str| read_text(text).unwrap_err().to_string();
        let e = text(&EXPORT.replace(",6.25,", ",358.1,"));
        assert!(
            e.contains("line 4: found h_angle = 358.1, expected an angle in radians"),
            "{e}"
        );
        let e = text(&EXPORT.replace(",1.5,", ",100,"));
        assert!(e.contains("line 4: found v_angle = 100"), "{e}");
        let e = text(&EXPORT.replace("25.5", "0").replace("25.0", "-1"));
        assert!(e.contains("found 3 rows, none with a range"), "{e}");
        let header = EXPORT.lines().next().unwrap();
        assert!(text(header).contains("no observation"));
        assert!(text("ref_time, ts_time\n1,2\n").contains("without h_angle"));
    }

    #[test]
    fn damaged_files_do_not_panic() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("rts.csv");
        for_each_damaged(&path, EXPORT.as_bytes(), 4000, || {
            drop(read_polar(&Input::from(&path)))
        });
    }
}
