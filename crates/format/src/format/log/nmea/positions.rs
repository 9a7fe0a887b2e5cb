//! Positions from the sentences of a log.

use std::path::Path;

use super::clock::{Clock, Moment};
use super::fields::{KSXT, Place, Sentence};
use super::skipped::{Skipped, UNDATED, WITHOUT_FIX, WITHOUT_SEPARATION};
use super::{NmeaLog, no_records, remark_on_midnight, scan};
use crate::error::{Error, Location, Result};
use crate::format::input::Input;
use crate::geometry::Vec3;
use crate::sensor::GeographicFix;

/// What is said of heights above the sea that cannot be converted.
const ABOVE_THE_SEA: &str = "the heights of KSXT are those above the sea, as the GGA of these receivers gives them, and stay as \
                             they are: the log has no GGA with the separation of geoid and ellipsoid";

/// Positions with the standard deviations of the GST sentences with their times.
#[derive(Default)]
struct Fixes {
    /// By the kind of their sentence.
    by_sentence: [Vec<(Moment, GeographicFix)>; 3],
    /// Second of the day and standard deviations of the last GST.
    accuracy: Option<(f64, Vec3)>,
    /// The separations of geoid and ellipsoid of the first and the last GGA, metres.
    separations_m: Option<(f64, f64)>,
    /// Positions of KSXT before the first GGA, whose heights count from the sea.
    above_the_sea: usize,
}

impl Fixes {
    /// Takes a position; false if its height above the ellipsoid is unknown. The separation changes by millimetres
    /// between a KSXT and the GGA before it.
    fn push(&mut self, moment: Moment, place: &Place) -> bool {
        if let Some(last_m) = place.separation_m.filter(|_| place.kind == 0) {
            let first_m = self.separations_m.map_or(last_m, |(first_m, _)| first_m);
            self.separations_m = Some((first_m, last_m));
        }
        let known_m = match place.kind {
            KSXT => self.separations_m.map(|(_, last_m)| last_m),
            _ => place.separation_m,
        };
        if known_m.is_none() && place.kind != KSXT {
            return false;
        }
        self.above_the_sea += usize::from(known_m.is_none());
        let [latitude_rad, longitude_rad] = place.place_deg.map(f64::to_radians);
        let accuracy = self
            .accuracy
            .filter(|(second_s, _)| *second_s == place.second_s);
        let fix = GeographicFix {
            time_s: 0.0,
            latitude_rad,
            longitude_rad,
            height_m: place.altitude_m + known_m.unwrap_or(0.0),
            sigma_m: accuracy.map(|(_, sigma_m)| sigma_m),
            quality: Some(place.quality),
        };
        self.by_sentence[place.kind].push((moment, fix));
        true
    }

    /// Takes a GST, which comes before or after the position with its time.
    fn take(&mut self, second_s: f64, sigma_m: Vec3) {
        self.accuracy = Some((second_s, sigma_m));
        for fixes in &mut self.by_sentence {
            if let Some((_, fix)) = fixes.last_mut().filter(|(m, _)| m.second_s == second_s) {
                fix.sigma_m = Some(sigma_m);
            }
        }
    }

    /// The positions of the most frequent sentence, the first of equally frequent ones, and the number of the others.
    fn most(mut self, input: &Input) -> (Vec<(Moment, GeographicFix)>, usize) {
        let first_m = self.separations_m.map(|(first_m, _)| first_m);
        let early = self.by_sentence[KSXT].iter_mut().take(self.above_the_sea);
        early.for_each(|(_, fix)| fix.height_m += first_m.unwrap_or(0.0));
        let all: usize = self.by_sentence.iter().map(Vec::len).sum();
        let kinds = (0..self.by_sentence.len()).rev();
        let kind = kinds.max_by_key(|kind| self.by_sentence[*kind].len());
        let kind = kind.unwrap_or_default();
        if kind == KSXT && self.above_the_sea > 0 && first_m.is_none() {
            input.remark(ABOVE_THE_SEA);
        }
        let fixes = self.by_sentence[kind].split_off(0);
        let others = all - fixes.len();
        (fixes, others)
    }
}

/// The error for a log without a position.
fn no_positions(path: &Path, skipped: &Skipped) -> Error {
    let without_separation = skipped.lost.count(WITHOUT_SEPARATION);
    if without_separation == 0 {
        let expected = "positions (GGA with a fix and a geoid separation, PTNL,GGK or KSXT)";
        return no_records(path, skipped, expected);
    }
    let found = format!(
        "{without_separation} positions (GGA) without the separation of geoid and ellipsoid, so that their heights above \
         the ellipsoid are unknown"
    );
    let expected = "GGA with the separation in its 11th field: set the receiver to write it, or to write PTNL,GGK";
    Error::format(path, Location::Whole, found, expected)
}

/// Reads the positions of a log from its GGA, PTNL,GGK or KSXT sentences, whichever are more, with the standard
/// deviations of its GST sentences, and counts skipped sentences.
///
/// # Errors
/// No position with a fix and the separation of geoid and ellipsoid, without which the ellipsoidal height
/// is unknown.
pub(super) fn read_position_log(input: &Input) -> Result<NmeaLog<GeographicFix>> {
    let mut clock = Clock::default();
    let mut fixes = Fixes::default();
    let mut skipped = scan(input, |sentence, skipped| match sentence {
        Sentence::Position(place) => {
            let moment = clock.at_maybe(place.second_s, place.date);
            if !fixes.push(moment, &place) {
                skipped.lost.add(WITHOUT_SEPARATION);
            }
        }
        Sentence::Accuracy(second_s, sigma_m) => fixes.take(second_s, sigma_m),
        Sentence::Date(second_s, date) => {
            clock.at_date(second_s, date);
        }
        Sentence::Heading(_, heading) => {
            heading
                .second_s
                .map(|second_s| clock.at_maybe(second_s, heading.date));
        }
        Sentence::NoPosition => skipped.lost.add(WITHOUT_FIX),
        Sentence::NoHeading | Sentence::NotFixed | Sentence::NoDate | Sentence::NoAccuracy => {}
    })?;
    let (fixes, others) = fixes.most(input);
    if fixes.is_empty() {
        return Err(no_positions(input.path(), &skipped));
    }
    skipped.other += others as u64;
    let mut undated = 0;
    let fixes = clock.date(fixes, &mut undated);
    skipped.lost.add_all(UNDATED, undated);
    let records = fixes
        .into_iter()
        .map(|(time_s, fix)| GeographicFix { time_s, ..fix });
    let records = records.collect();
    Ok(NmeaLog { records, skipped })
}

/// Reads the positions of a log: see [`read_position_log`].
///
/// # Errors
/// Those of [`read_position_log`].
pub(super) fn read_positions(input: &Input) -> Result<Vec<GeographicFix>> {
    let log = read_position_log(input)?;
    remark_on_midnight(input, &log.records);
    log.skipped.lost.remark(input, "NMEA sentences");
    Ok(log.records)
}
