//! Verdicts on the clocks and gaps of a recording.

use crate::format::{ClockStep, RecordingClock, RecordingClocks, SensorClock};
use crate::verdict::Verdict;

/// Longest gap of the IMU for which poses are still supported, seconds.
const LONG_GAP_S: f64 = 2.0;
/// Largest delay of records that is not reported, seconds.
const NOTABLE_DELAY_S: f64 = 0.02;
/// Largest drift of a sensor's clock over a recording that is not reported, seconds.
const NOTABLE_DRIFT_S: f64 = 1e-3;
/// A kill or a power cut loses the arrival times of the last second of a file. A log that continues for longer without
/// arrival times is reported, seconds.
const NOTABLE_END_S: f64 = 1.0;

/// The verdicts on a recording: on its system clock, and on the named sensors that have clocks or times of arrival.
pub fn verdicts(clocks: &RecordingClocks) -> Vec<Verdict> {
    let RecordingClocks { system, sensors } = clocks;
    let arrivals = sensors.iter().map(|(_, clock)| clock.last_arrival_s);
    let until_s = arrivals.fold(f64::NEG_INFINITY, f64::max);
    let sensors = sensors.iter();
    let on_sensors = sensors.flat_map(|(name, clock)| sensor_verdicts(name, clock));
    system_clock(system, until_s)
        .into_iter()
        .chain(on_sensors)
        .collect()
}

/// The verdict on the system clock of a recording that ends at a common time, seconds.
fn system_clock(clock: &RecordingClock, until_s: f64) -> Option<Verdict> {
    let code = "recording.clock";
    let common = "times of the total station are from a clock that ran evenly from the beginning, and times of sensors \
                  with clocks of their own follow from the arrival times";
    if let Some(ClockStep { set_s, at_s }) = clock.steps.first() {
        let times = match clock.steps.len() {
            1 => String::new(),
            2 => " and once more".to_owned(),
            more => format!(" and {} times more", more - 1),
        };
        let text = format!(
            "The clock of the recording computer was set by {set_s:+.3} s, {at_s:.0} s after the beginning{times}: \
             {common}."
        );
        return Some(Verdict {
            value: Some(*set_s),
            ..Verdict::care(code, text)
        });
    }
    if clock.is_synchronised(until_s) {
        return None;
    }
    let why = match (clock.answered, clock.locked) {
        (0, _) => "chrony did not run".to_owned(),
        (_, 0) => "it was not synchronised".to_owned(),
        (_, locked) if locked < clock.checks => {
            format!("it was not synchronised for {} s", clock.checks - locked)
        }
        _ if clock.damaged > 0 => format!("damaged checks: {}", clock.damaged),
        _ if clock.unchecked_s(until_s) > 0.0 => {
            format!(
                "its checks end {:.0} s before the recording",
                clock.unchecked_s(until_s)
            )
        }
        _ => format!("it was off by {:.1} ms", 1e3 * clock.worst_rms_s),
    };
    Some(Verdict::care(
        code,
        format!(
            "The clock of the recording computer may have been wrong ({why}): {common}, later by the shortest delay of \
             each link."
        ),
    ))
}

/// The verdicts on the clock, the arrival times and the gaps of a sensor.
fn sensor_verdicts(name: &str, clock: &SensorClock) -> Vec<Verdict> {
    let mut verdicts = Vec::new();
    let (median_ms, late_ms) = (1e3 * clock.delay_median_s, 1e3 * clock.delay_999_s);
    let span_s = clock.span_s;
    if !clock.is_synchronised {
        let drifted_s = clock.drift * span_s;
        let drift = if drifted_s.abs() > NOTABLE_DRIFT_S {
            format!(
                ", and drifted by {:.1} ms ({:.1} ppm), which was corrected",
                1e3 * drifted_s,
                1e6 * clock.drift
            )
        } else {
            String::new()
        };
        verdicts.push(Verdict {
            value: Some(clock.offset_s),
            ..Verdict::note(
                "recording.sensor_clock",
                format!(
                    "{name}: its clock differs by {:.3} s from that of the recording{drift}. Its times follow from the \
                     earliest arrivals; half of all records arrived up to {median_ms:.1} ms later, 99.9 % up to \
                     {late_ms:.1} ms.",
                    clock.offset_s
                ),
            )
        });
    }
    if clock.is_synchronised && clock.delay_999_s > NOTABLE_DELAY_S {
        verdicts.push(Verdict {
            value: Some(clock.delay_999_s),
            ..Verdict::note(
                "recording.delay",
                format!(
                    "{name}: half of its records arrived up to {median_ms:.1} ms, 99.9 % up to {late_ms:.1} ms after \
                     they were measured."
                ),
            )
        });
    }
    verdicts.extend(missing_arrivals(name, clock));
    if clock.gaps > 0 {
        let text = format!(
            "{name}: nothing arrived for {:.1} s{}.",
            clock.longest_gap_s,
            match clock.gaps {
                1 => String::new(),
                more => format!(", the longest of {more} gaps"),
            }
        );
        let is_grave = name == "imu" && clock.longest_gap_s > LONG_GAP_S;
        let verdict = if is_grave {
            Verdict::care("recording.gap", text)
        } else {
            Verdict::note("recording.gap", text)
        };
        verdicts.push(Verdict {
            value: Some(clock.longest_gap_s),
            ..verdict
        });
    }
    verdicts
}

/// The verdict on missing arrival times.
fn missing_arrivals(name: &str, clock: &SensorClock) -> Option<Verdict> {
    let mut missing = Vec::new();
    if clock.damaged_arrivals > 0 {
        let rows = clock.damaged_arrivals;
        missing.push(format!("{rows} rows of its times of arrival are damaged"));
    }
    if clock.beyond_arrivals_s > NOTABLE_END_S {
        let beyond_s = clock.beyond_arrivals_s;
        missing.push(format!(
            "the last {beyond_s:.1} s of its log have no times of arrival"
        ));
    }
    (!missing.is_empty()).then(|| {
        let text = format!(
            "{name}: {}. Its clock follows from the other records.",
            missing.join(", and ")
        );
        Verdict {
            value: Some(clock.beyond_arrivals_s),
            ..Verdict::note("recording.arrivals", text)
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checks_of_the_clock_that_are_missing_are_reported() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("clock.csv");
        let verdict = |damaged: &str, until_s: f64| {
            let rows = "1000,0,PPS,0,0,1,\n1001,1,PPS,0,0,1,\n";
            let header = "unix_s,monotonic_s,reference,offset_s,rms_s,is_locked,set_s\n";
            std::fs::write(&path, format!("{header}{rows}{damaged}")).unwrap();
            system_clock(&RecordingClock::read(&path).unwrap(), until_s)
        };
        assert!(verdict("", 1002.0).is_none());
        for (damaged, until_s, why) in [
            ("", 4601.0, "(its checks end 3600 s before the recording)"),
            ("x\n", 1002.0, "(damaged checks: 1)"),
        ] {
            let verdict = verdict(damaged, until_s).unwrap();
            assert!(verdict.text.contains(why), "{}", verdict.text);
        }
    }
}
