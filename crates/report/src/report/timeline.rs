//! When each sensor delivered records: spans with records, gaps, and rejected records, on one time axis.

use super::axis::Axis;
use super::chart::Plot;
use super::figures::{FULL, time_label, time_shift};
use super::html::{self, escape};
use super::residual_plots::{gaps, measured, used_s};
use super::scene::Scene;
use crate::diagnostics::sensor_name;
use crate::results::Drive;

/// Height of a row.
const ROW: f64 = 26.0;

/// One sensor.
struct Row {
    name: String,
    /// Spans with records, from and to, seconds.
    there: Vec<(f64, f64)>,
    rejected_s: Vec<f64>,
}

/// The time line of a drive, with the scanners of its scene; empty if its poses came from a file.
pub fn figure(drive: &Drive, scene: Option<&Scene>) -> String {
    let rows = rows(drive, scene);
    let (Some(first), Some(last)) = (drive.poses.first(), drive.poses.last()) else {
        return String::new();
    };
    if rows.is_empty() {
        return String::new();
    }
    let start = time_shift(first.time_s);
    let ends = [first.time_s - start, last.time_s - start];
    let names: Vec<String> = rows.iter().map(|row| row.name.clone()).collect();
    let mut plot = Plot::rows(FULL, ROW, &names, Axis::over(&time_label(start), ends));
    for (at, row) in rows.iter().enumerate() {
        for (from_s, to_s) in &row.there {
            plot.span("there", (from_s - start, to_s - start), at as f64, 8.0);
        }
        let rejected: Vec<[f64; 2]> = row
            .rejected_s
            .iter()
            .map(|time_s| [time_s - start, at as f64])
            .collect();
        plot.crosses("cross", &rejected);
    }
    let rejected: usize = rows.iter().map(|row| row.rejected_s.len()).sum();
    let mut entries = vec![("there".to_owned(), "records used".to_owned())];
    if rejected > 0 {
        entries.push(("cross".into(), "rejected".into()));
    }
    html::figure(
        &(html::legend(&entries) + &plot.finish("When each sensor was there")),
        &format!(
            "When each sensor of {} was there; gaps are those of more than five usual steps. Rejected: {rejected}.",
            escape(&drive.name)
        ),
    )
}

fn rows(drive: &Drive, scene: Option<&Scene>) -> Vec<Row> {
    let (Some(solution), Some(first), Some(last)) =
        (&drive.solution, drive.poses.first(), drive.poses.last())
    else {
        return Vec::new();
    };
    let span = (first.time_s, last.time_s);
    let mut rows = vec![Row {
        name: "IMU".into(),
        there: between(span, &solution.imu_gaps_s),
        rejected_s: Vec::new(),
    }];
    for (sensor, residuals) in measured(solution) {
        let rejected = residuals.iter().filter(|r| r.weight == 0.0);
        let rejected_s: Vec<f64> = rejected.map(|r| r.time_s).collect();
        rows.push(Row {
            name: sensor_name(&sensor.name).to_owned(),
            there: between(span, &gaps(used_s(residuals), span)),
            rejected_s,
        });
    }
    let scanners = scene.into_iter().flat_map(|scene| {
        let fans = scene.fans.iter();
        fans.map(|fan| {
            let times = fan.times.iter();
            let times = times.map(|step| scene.start_s + f64::from(*step) * scene.step_s);
            (&fan.name, times)
        })
    });
    rows.extend(scanners.map(|(name, times)| Row {
        name: name.clone(),
        there: between(span, &gaps(times, span)),
        rejected_s: Vec::new(),
    }));
    rows
}

/// The parts of a span outside these gaps, which are in the order of time.
fn between((from_s, to_s): (f64, f64), gaps: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut all = Vec::new();
    let mut begin = from_s;
    for (gap_from_s, gap_to_s) in gaps {
        if *gap_from_s > begin {
            all.push((begin, *gap_from_s));
        }
        begin = begin.max(*gap_to_s);
    }
    if to_s > begin {
        all.push((begin, to_s));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_between_gaps_is_there() {
        let spans = between((0.0, 10.0), &[(0.0, 1.0), (4.0, 5.0), (9.0, 10.0)]);
        assert_eq!(spans, [(1.0, 4.0), (5.0, 9.0)]);
        assert_eq!(between((0.0, 3.0), &[]), [(0.0, 3.0)]);
        assert_eq!(between((0.0, 3.0), &[(0.0, 3.0)]), []);
    }
}
