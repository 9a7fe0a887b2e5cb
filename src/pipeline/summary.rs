//! What was found, in a few lines for people.

use std::fmt::Write;

use super::evaluate::{Against, Drive};
use super::page;
use crate::calibration::Calibration;
use crate::geometry::EulerConvention;
use crate::geometry::euler::euler_deg_from_rotation;
use crate::project::{PARAMETER_NAMES, Project};
use crate::report::content::MountingKind;

/// A table of the mountings: a row a parameter, a column a scanner; then what was not found.
pub fn mountings(calibration: &Calibration) -> String {
    let columns: Vec<Vec<String>> = (0..calibration.mountings.len())
        .map(|scanner| column(calibration, scanner))
        .collect();
    let mut rows = vec![String::from("mounting")];
    rows.extend(PARAMETER_NAMES.iter().map(|name| format!("  {name}")));
    let mut lines = aligned(&rows, &columns);
    for (line, unit) in lines.iter_mut().zip(["", "m", "m", "m", "°", "°", "°"]) {
        let _ = write!(line, "   {unit}"); // a String takes everything
    }
    lines.extend(page::statements(calibration, ""));
    if !calibration.converged {
        lines.push("The calibration did not converge at every scale.".into());
    }
    joined(&lines)
}

/// Name and convention, then the six parameters of one scanner.
fn column(calibration: &Calibration, scanner: usize) -> Vec<String> {
    let mounting = &calibration.mountings[scanner];
    let pose = &mounting.body_from_scanner;
    let sigmas = calibration.sigmas(scanner, mounting.convention);
    let angles = euler_deg_from_rotation(mounting.convention, &pose.rotation);
    let convention = match mounting.convention {
        EulerConvention::Zyx => "zyx",
        EulerConvention::Bonn => "bonn",
    };
    let mut cells = vec![format!("{} ({convention})", mounting.name)];
    for parameter in 0..6 {
        let (value, sigma, digits) = match parameter {
            0..3 => (pose.translation.vector[parameter], sigmas[parameter], 4),
            _ => {
                let sigma = sigmas[parameter].map(f64::to_degrees);
                (angles[parameter - 3], sigma, 3)
            }
        };
        let certainty = match sigma {
            Some(sigma) => format!("± {sigma:.digits$}"),
            None if mounting.fixed[parameter] => "fixed".into(),
            None if calibration.is_observable(scanner, parameter) => String::new(),
            None => "held".into(),
        };
        cells.push(format!("{value:.digits$} {certainty:<8}"));
    }
    cells
}

/// A table of the distances: a row a comparison, a column a mounting.
pub fn distances(project: &Project, drives: &[Drive]) -> String {
    let kinds = [
        (MountingKind::Initial, "initial"),
        (MountingKind::Final, "calibrated"),
        (MountingKind::Truth, "truth"),
    ];
    let mut rows = vec![String::from("distances (M3C2, RMSE)")];
    let mut columns: Vec<Vec<String>> = kinds.map(|(_, name)| vec![name.to_owned()]).into();
    for drive in drives {
        let mut pairs: Vec<(usize, Against)> = Vec::new();
        for found in &drive.agreements {
            if !pairs.contains(&(found.scanner, found.against)) {
                pairs.push((found.scanner, found.against));
                rows.push(format!("  {}: {}", drive.name, found.pair(project)));
            }
        }
        for (scanner, against) in pairs {
            for ((kind, _), column) in kinds.iter().zip(&mut columns) {
                let found = drive.find(scanner, against, *kind);
                let rmse_m = found.map(|found| found.statistics.rmse_m);
                column.push(rmse_m.map_or("-".into(), |rmse| format!("{:.2} mm", rmse * 1e3)));
            }
        }
    }
    // Only simulations know the truth.
    columns.retain(|column| column[1..].iter().any(|cell| cell != "-"));
    if columns.is_empty() {
        return "No clouds to compare.".into();
    }
    joined(&aligned(&rows, &columns))
}

/// Rows with their columns, each as wide as its widest cell: names to the left, cells to the right.
fn aligned(rows: &[String], columns: &[Vec<String>]) -> Vec<String> {
    let width = |cells: &[String]| cells.iter().map(|c| c.chars().count()).max().unwrap_or(0);
    let widest_name = width(rows);
    let widths: Vec<usize> = columns.iter().map(|column| width(column)).collect();
    rows.iter()
        .enumerate()
        .map(|(row, name)| {
            let mut line = format!("{name:<widest_name$}");
            for (column, width) in columns.iter().zip(&widths) {
                let _ = write!(line, "   {:>width$}", column[row]); // a String takes everything
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
