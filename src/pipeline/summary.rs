//! Summaries of the results as text.

use std::fmt::Write;

use super::findings::Findings;
use crate::calibration::Calibration;
use crate::comparison::MountingKind;
use crate::diagnostics::{self, PoseSigmas};
use crate::geometry::euler::euler_deg_from_rotation;
use crate::judgement;
use crate::results::Drive;
use crate::sensor::PoseRecord;
use crate::trajectory::{SensorDiagnostics, Solution};

/// Explains the ± of a mounting.
const SIGMA_OF_A_MOUNTING: &str = "± is one standard deviation of a parameter of the mounting on the body, as it \
    follows from the noise of logs and scans: of repeated drives, 68 % lie within ± once and 95 % within ± twice it.";
/// Explains the numbers of distances.
const RMSE_OF_DISTANCES: &str = "RMSE is the root mean square of the single distances, noise of both clouds \
    included: it has no ±, and is no standard deviation of the mounting.";
/// Explains the ± of a constant.
const SIGMA_OF_A_CONSTANT: &str =
    "± is one standard deviation (68 %) of the constant, by this drive alone.";

/// The method whose values are the result, the mountings, and the distances; if the joint adjustment was refused, the
/// reason comes first.
pub fn run(findings: &Findings, report: &str) -> String {
    format!(
        "report: {report}\n\n{}\n{}\n{}",
        calibration(findings),
        distances(&findings.drives),
        stages(findings)
    )
}

/// The method whose values are the result, and the mountings.
pub fn calibration(findings: &Findings) -> String {
    let calibrations = &findings.calibrations;
    let (result, joint) = (&calibrations.result, calibrations.joint.as_ref());
    let methods = judgement::method(result, joint);
    let methods = methods
        .iter()
        .filter(|verdict| !verdict.severity.is_marked());
    let methods: String = methods
        .map(|verdict| format!("{}\n\n", verdict.text))
        .collect();
    let reference = judgement::reference_sigmas(result, joint);
    format!(
        "{methods}{}\n{}",
        mountings(result),
        reference.map_or(String::new(), |text| text + "\n")
    )
}

/// The stages that were not run again, and the folder of finished stages.
fn stages(findings: &Findings) -> String {
    let Some(kept) = &findings.kept_stages else {
        return String::new();
    };
    let mut text = String::new();
    if !kept.reused.is_empty() {
        let names = kept.reused.join(", ");
        text.push_str(&format!(
            "\nFinished by an earlier run: {names} (--fresh runs them again).\n"
        ));
    }
    let (folder, megabytes) = (kept.folder.display(), 1e-6 * kept.bytes as f64);
    text + &format!(
        "\nFinished stages are kept in {folder} ({megabytes:.1} MB), which may be removed.\n"
    )
}

/// A table of the mountings with a row per parameter and a column per scanner, then the
/// unobservable directions.
fn mountings(calibration: &Calibration) -> String {
    let columns: Vec<Vec<String>> = (0..calibration.mountings.len())
        .map(|scanner| column(calibration, scanner))
        .collect();
    let mut rows = vec![String::from("mounting")];
    let names = ["tx", "ty", "tz", "α", "β", "γ"];
    rows.extend(names.map(|name| format!("  {name}")));
    let mut lines = aligned(&rows, &columns);
    for (line, unit) in lines.iter_mut().zip(["", "m", "m", "m", "°", "°", "°"]) {
        let _ = write!(line, "   {unit}"); // writing to a String cannot fail
    }
    if columns.iter().flatten().any(|cell| cell.contains('±')) {
        lines.push(SIGMA_OF_A_MOUNTING.into());
    }
    lines.extend(judgement::relative(calibration));
    lines.extend(judgement::unobservable(calibration, ""));
    if !calibration.converged {
        lines.push("The calibration did not converge at every scale.".into());
    }
    joined(&lines)
}

/// Column of a scanner: name and convention, then its six parameters.
fn column(calibration: &Calibration, scanner: usize) -> Vec<String> {
    let mounting = &calibration.mountings[scanner];
    let pose = &mounting.body_from_scanner;
    let sigmas = calibration.sigmas(scanner, mounting.convention);
    let angles = euler_deg_from_rotation(mounting.convention, &pose.rotation);
    let mut cells = vec![format!(
        "{} ({})",
        mounting.name,
        mounting.convention.name()
    )];
    for parameter in 0..6 {
        let (value, sigma, digits) = match parameter {
            0..3 => (pose.translation_m[parameter], sigmas[parameter], 5),
            _ => {
                let sigma = sigmas[parameter].map(f64::to_degrees);
                (angles[parameter - 3], sigma, 4)
            }
        };
        let sigma = match sigma {
            Some(sigma) => format!("± {sigma:.digits$}"),
            None if mounting.fixed[parameter] => "fixed".into(),
            None if calibration.is_observable(scanner, parameter) => String::new(),
            None => "held".into(),
        };
        cells.push(format!("{value:.digits$} {sigma:<9}"));
    }
    cells
}

/// A table of the distances with a row per comparison and a column per mounting.
pub fn distances(drives: &[Drive]) -> String {
    let is_joint = drives.iter().any(|drive| {
        let two_steps = MountingKind::TwoStep;
        let compared = drive.agreements.under(two_steps).next().is_some();
        compared || drive.agreements.passes_of(two_steps, false).is_some()
    });
    let result = if is_joint {
        "joint adjustment"
    } else {
        "calibrated"
    };
    let kinds = [
        (MountingKind::Initial, "initial"),
        (MountingKind::TwoStep, "two steps"),
        (MountingKind::Final, result),
        (MountingKind::Truth, "truth"),
    ];
    let mut rows = vec![String::from("distances (M3C2, RMSE)")];
    let mut columns: Vec<Vec<String>> = kinds.map(|(_, name)| vec![name.to_owned()]).into();
    for drive in drives {
        for pair in drive.agreements.pairs() {
            rows.push(format!("  {}: {}", drive.name, pair[0].pair()));
            for ((kind, _), column) in kinds.iter().zip(&mut columns) {
                let agreement = pair.iter().find(|agreement| agreement.mounting == *kind);
                let rmse_m = agreement.map(|agreement| agreement.statistics.rmse_m);
                column.push(rmse_m.map_or("-".into(), |rmse| format!("{:.2} mm", rmse * 1e3)));
            }
        }
    }
    for drive in drives
        .iter()
        .filter(|drive| !drive.agreements.passes.is_empty())
    {
        rows.push(format!("  {}: passes (median)", drive.name));
        for ((kind, _), column) in kinds.iter().zip(&mut columns) {
            let passes = drive.agreements.passes_of(*kind, false);
            let median_m = passes.map(|passes| passes.median_m);
            column.push(median_m.map_or("-".into(), |m| format!("{:.2} mm", m * 1e3)));
        }
    }
    // The truth is known only for simulations.
    columns.retain(|column| column[1..].iter().any(|cell| cell != "-"));
    if columns.is_empty() {
        return "No clouds to compare.".into();
    }
    let mut lines = aligned(&rows, &columns);
    lines.push(RMSE_OF_DISTANCES.into());
    joined(&lines)
}

/// Tables of the pose sigmas, and of the sensors and constants of the adjustment.
pub fn trajectory(solution: Option<&Solution>, poses: &[PoseRecord]) -> String {
    let seconds = match poses {
        [first, .., last] => last.time_s - first.time_s,
        _ => 0.0,
    };
    let mut lines = vec![format!("{} poses over {seconds:.1} s", poses.len())];
    if let Some(sigmas) = PoseSigmas::of(poses) {
        lines.extend(pose_sigmas(&sigmas));
    }
    let Some(solution) = solution else {
        return joined(&lines);
    };
    lines.push(format!(
        "{} after {} iterations over {} nodes",
        solution.stop, solution.iterations, solution.nodes
    ));
    lines.push(String::new());
    lines.extend(sensors(solution));
    if !solution.constants.is_empty() {
        lines.push(String::new());
        lines.extend(constants(solution));
        if solution
            .constants
            .iter()
            .any(|constant| diagnostics::constant_text(constant).sigma.is_some())
        {
            lines.push(SIGMA_OF_A_CONSTANT.into());
        }
    }
    joined(&lines)
}

fn pose_sigmas(sigmas: &PoseSigmas) -> Vec<String> {
    let both = |median: String, max: String| vec![median, max];
    let degrees = |value: f64| format!("{value:.3}°");
    let quantities =
        [sigmas.position_m.median, sigmas.position_m.max].map(|m| format!("{:.1} mm", 1e3 * m));
    let [median, max] = quantities;
    let columns = [
        vec!["median".to_owned(), "largest".to_owned()],
        both(median, max),
        both(
            degrees(sigmas.tilt_deg.median),
            degrees(sigmas.tilt_deg.max),
        ),
        both(
            degrees(sigmas.heading_deg.median),
            degrees(sigmas.heading_deg.max),
        ),
    ];
    let rows = ["sigma of the poses", "  position", "  tilt", "  heading"].map(String::from);
    let columns: Vec<Vec<String>> = (0..2)
        .map(|i| columns.iter().map(|row| row[i].clone()).collect())
        .collect();
    let mut lines = aligned(&rows, &columns);
    for outage in &sigmas.outages {
        lines.push(format!(
            "  outage from {:.1} s to {:.1} s: position up to {:.1} mm",
            outage.from_s,
            outage.to_s,
            1e3 * outage.max_position_m
        ));
    }
    lines
}

fn sensors(solution: &Solution) -> Vec<String> {
    let shown: Vec<&SensorDiagnostics> = diagnostics::sensors_shown(solution).collect();
    let mut rows = vec![String::from("residuals")];
    rows.extend(
        shown
            .iter()
            .map(|s| format!("  {}", diagnostics::sensor_name(&s.name))),
    );
    let column = |head: &str, cell: &dyn Fn(&SensorDiagnostics) -> String| -> Vec<String> {
        let cells = shown.iter().map(|sensor| cell(sensor));
        std::iter::once(head.to_owned()).chain(cells).collect()
    };
    let component = |s: &SensorDiagnostics| {
        let component = s.variance_component;
        component.map_or("-".into(), |component| format!("{component:.2}"))
    };
    let columns = [
        column("used", &|s| s.count.to_string()),
        column("rejected", &|s| s.rejected.to_string()),
        column("ignored", &|s| s.ignored.to_string()),
        column("RMS", &|s| diagnostics::quantity(s.rms_raw, &s.unit)),
        column("RMS/sigma", &|s| format!("{:.2}", s.rms_normalised)),
        column("redundancy", &|s| format!("{:.0}", s.redundancy)),
        column("variance component", &component),
    ];
    let mut lines = aligned(&rows, &columns);
    let words = column("chi-square test", &|s| diagnostics::chi_square_text(s));
    for (line, words) in lines.iter_mut().zip(words) {
        let _ = write!(line, "   {words}"); // writing to a String cannot fail
    }
    lines
}

fn constants(solution: &Solution) -> Vec<String> {
    let mut rows = vec![String::from("constants")];
    let mut estimated = vec![String::from("estimated")];
    let mut project = vec![String::from("project")];
    for constant in &solution.constants {
        let words = diagnostics::constant_text(constant);
        rows.push(format!("  {}", constant.name));
        estimated.push(match &words.sigma {
            Some(sigma) => format!("{} ± {sigma} {}", words.value, words.unit),
            None => "not determined by this drive".into(),
        });
        project.push(format!("{} {}", words.start, words.unit));
    }
    aligned(&rows, &[estimated, project])
}

/// Formats a table with names aligned to the left and columns aligned to the right.
fn aligned(rows: &[String], columns: &[Vec<String>]) -> Vec<String> {
    let width = |cells: &[String]| cells.iter().map(|c| c.chars().count()).max().unwrap_or(0);
    let widest_name = width(rows);
    let widths: Vec<usize> = columns.iter().map(|column| width(column)).collect();
    rows.iter()
        .enumerate()
        .map(|(row, name)| {
            let mut line = format!("{name:<widest_name$}");
            for (column, width) in columns.iter().zip(&widths) {
                let _ = write!(line, "   {:>width$}", column[row]); // writing to a String cannot fail
            }
            line
        })
        .collect()
}

fn joined(lines: &[String]) -> String {
    let lines: Vec<&str> = lines.iter().map(|line| line.trim_end()).collect();
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_as_wide_as_their_widest_cell() {
        let rows = ["a".to_owned(), "long".to_owned()];
        let columns = [
            vec!["1°".to_owned(), "22".to_owned()],
            vec!["x".to_owned(), "-3.5".to_owned()],
        ];
        let lines = aligned(&rows, &columns);
        assert_eq!(lines, ["a      1°      x", "long   22   -3.5"]);
    }
}
