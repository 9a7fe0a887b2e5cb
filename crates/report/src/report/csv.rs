//! The numbers behind the figures as CSV files: in full where figures thin them out, and means over cells for maps.
//!
//! Lengths are in metres, angles in radians unless a name says degrees, times in seconds on the common clock. Unknown
//! values are empty.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::content::Content;
use super::precision;
use super::raster::Bounds;
use crate::calibration::{Calibration, Variant};
use crate::comparison::{Agreement, MountingKind};
use crate::diagnostics::component_name;
use crate::geometry::Vec3;
use crate::number::{nice_above, shortest};
use crate::results::{Calibrations, Drive};

/// Folder of the files, beside the page.
pub const FOLDER: &str = "figures";

/// Maximum number of cells of a map along the longer side of a field.
const CELLS: f64 = 200.0;

/// The mountings whose distances are drawn, with their columns.
const KINDS: [(MountingKind, &str); 3] = [
    (MountingKind::Initial, "initial"),
    (MountingKind::TwoStep, "two_steps"),
    (MountingKind::Final, "result"),
];

/// A file, with the section of the page whose figures it belongs to.
pub struct File {
    /// Its name in [`FOLDER`].
    pub name: &'static str,
    /// Identifier of the section.
    pub section: &'static str,
    text: fn(&Content) -> String,
}

impl File {
    /// Its content.
    pub fn text(&self, content: &Content) -> String {
        (self.text)(content)
    }
}

/// All files.
pub const FILES: [File; 7] = [
    file("distances.csv", "maps", |content| {
        distances(&content.drives)
    }),
    file("sigmas.csv", "observability", |content| {
        content
            .calibrations
            .as_deref()
            .map_or_else(String::new, sigmas)
    }),
    file("blocks.csv", "residuals", |content| {
        content
            .calibrations
            .as_deref()
            .map_or_else(String::new, blocks)
    }),
    file("poses.csv", "trajectory", |content| poses(&content.drives)),
    file("residuals.csv", "trajectory", |content| {
        residuals(&content.drives)
    }),
    file("moved.csv", "trajectory", |content| {
        content
            .calibrations
            .as_deref()
            .map_or_else(String::new, moved)
    }),
    file("convergence.csv", "convergence", |content| {
        content
            .calibrations
            .as_deref()
            .map_or_else(String::new, convergence)
    }),
];

const fn file(name: &'static str, section: &'static str, text: fn(&Content) -> String) -> File {
    File {
        name,
        section,
        text,
    }
}

/// A number in a cell; empty if it is not known.
fn cell(value: f64, decimals: usize) -> String {
    if value.is_finite() {
        format!("{value:.decimals$}")
    } else {
        String::new()
    }
}

/// A text in a cell.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

fn row(out: &mut String, cells: &[String]) {
    // Writing to a string cannot fail.
    let _ = writeln!(out, "{}", cells.join(","));
}

/// Number and means of distances and levels of detection in the cells of a grid, for each mounting.
fn distances(drives: &[Drive]) -> String {
    let names = KINDS.map(|(_, name)| {
        format!("{name}_core_points,{name}_mean_distance_m,{name}_mean_level_of_detection_m")
    });
    let mut out = format!("drive,clouds,east_m,north_m,cell_m,{}\n", names.join(","));
    let empty = out.len();
    for drive in drives {
        for pair in drive.agreements.pairs() {
            of_pair(&drive.name, pair, &mut out);
        }
    }
    if out.len() > empty {
        out
    } else {
        String::new()
    }
}

/// Sums over a cell.
#[derive(Clone, Copy, Default)]
struct Cell {
    count: usize,
    distance_m: f64,
    /// Number of core points with a level of detection.
    levels: usize,
    level_m: f64,
}

fn of_pair(drive: &str, agreements: &[Agreement], out: &mut String) {
    let places = agreements
        .iter()
        .flat_map(|agreement| agreement.distances.points());
    let Some(bounds) = Bounds::around(places.map(|(p, _)| [p.x, p.y])) else {
        return;
    };
    let [east, north] = [0, 1].map(|i| bounds.max[i] - bounds.min[i]);
    let cell_m = nice_above(east.max(north) / CELLS);
    let mut cells: BTreeMap<[i64; 2], [Cell; KINDS.len()]> = BTreeMap::new();
    for (column, (kind, _)) in KINDS.iter().enumerate() {
        for agreement in agreements
            .iter()
            .filter(|agreement| agreement.mounting == *kind)
        {
            let points = agreement.distances.points();
            for ((p, distance_m), level_m) in
                points.zip(agreement.distances.levels_of_detection_m())
            {
                let key = [p.x, p.y].map(|x| (x / cell_m).floor() as i64);
                let cell = &mut cells.entry(key).or_default()[column];
                cell.count += 1;
                cell.distance_m += distance_m;
                if level_m.is_finite() {
                    cell.levels += 1;
                    cell.level_m += level_m;
                }
            }
        }
    }
    let start = [quoted(drive), quoted(&agreements[0].pair())];
    for (key, known) in cells {
        let mut line = start.to_vec();
        line.extend(key.map(|x| cell((x as f64 + 0.5) * cell_m, 4)));
        line.push(shortest(cell_m));
        for sums in known {
            line.push(sums.count.to_string());
            line.push(cell(sums.distance_m / sums.count as f64, 6));
            line.push(cell(sums.level_m / sums.levels as f64, 6));
        }
        row(out, &line);
    }
}

/// The calibrations of a run with their names.
fn calibrations(all: &Calibrations) -> Vec<(&'static str, &Calibration)> {
    let names = [
        (Variant::Paper, "paper"),
        (Variant::TwoStep, "two steps"),
        (Variant::WithoutReference, "two steps without reference"),
        (Variant::ExactPoses, "two steps with exact poses"),
    ];
    let variants = names.into_iter().filter_map(|(variant, name)| {
        let calibration = all.variant(variant)?;
        Some((name, calibration))
    });
    std::iter::once(("result", &all.result))
        .chain(variants)
        .collect()
}

/// Standard deviations and correlations of positions and of rotations about the body's axes.
fn sigmas(all: &Calibrations) -> String {
    let parameters = ["tx", "ty", "tz", "about_x", "about_y", "about_z"];
    let mut out = String::from("calibration,scanner,parameter,sigma");
    let names: Vec<String> = all
        .result
        .mountings
        .iter()
        .flat_map(|mounting| {
            parameters.map(|parameter| quoted(&format!("{} {parameter}", mounting.name)))
        })
        .collect();
    for name in &names {
        let _ = write!(out, ",correlation {name}");
    }
    out.push('\n');
    for (name, calibration) in calibrations(all) {
        let Some(correlation) = calibration.correlation() else {
            continue;
        };
        for (scanner, mounting) in calibration.mountings.iter().enumerate() {
            let sigmas = precision::sigmas(calibration, scanner);
            for (i, (parameter, sigma)) in parameters.iter().zip(sigmas).enumerate() {
                let at = 6 * scanner + i;
                let mut cells = vec![
                    name.to_owned(),
                    quoted(&mounting.name),
                    (*parameter).to_owned(),
                    cell(sigma.unwrap_or(f64::NAN), 9),
                ];
                let columns = 0..correlation.ncols();
                cells.extend(columns.map(|column| cell(correlation[(at, column)], 4)));
                row(&mut out, &cells);
            }
        }
    }
    out
}

/// Median residuals along the drive.
fn blocks(all: &Calibrations) -> String {
    let Some(constancy) = &all.result.constancy else {
        return String::new();
    };
    let mut out = String::from("scanner,time_s,median_m,expected_sigma_m\n");
    for (mounting, list) in all.result.mountings.iter().zip(&constancy.blocks) {
        for block in list {
            let name = quoted(&mounting.name);
            let values = [
                (block.time_s, 3),
                (block.median_m, 7),
                (block.expected_sigma_m, 7),
            ];
            let cells = values.map(|(value, decimals)| cell(value, decimals));
            row(&mut out, &[vec![name], cells.to_vec()].concat());
        }
    }
    out
}

/// The poses of all drives with their standard deviations and biases.
fn poses(drives: &[Drive]) -> String {
    let axes = |name: &str, unit: &str| ["x", "y", "z"].map(|axis| format!("{name}_{axis}_{unit}"));
    let head = [
        [
            "drive", "time_s", "east_m", "north_m", "up_m", "qx", "qy", "qz", "qw",
        ]
        .map(str::to_owned)
        .to_vec(),
        ["east", "north", "up"]
            .map(|axis| format!("sigma_{axis}_m"))
            .to_vec(),
        ["east", "north", "up"]
            .map(|axis| format!("sigma_about_{axis}_rad"))
            .to_vec(),
        axes("gyro_bias", "rad_s").to_vec(),
        axes("accel_bias", "m_s2").to_vec(),
    ];
    let mut out = head.concat().join(",") + "\n";
    let empty = out.len();
    for drive in drives {
        for pose in super::track::Track::of(drive).poses {
            let t = pose.world_from_body.translation_m;
            let q = pose.world_from_body.rotation.coords;
            let unknown = Vec3::repeat(f64::NAN);
            let sigma = pose.sigma.as_ref();
            let bias = pose.bias.as_ref();
            let mut cells = vec![quoted(&drive.name), cell(pose.time_s, 4)];
            cells.extend(t.iter().map(|x| cell(*x, 5)));
            cells.extend(q.iter().map(|x| cell(*x, 9)));
            let rest = [
                sigma.map_or(unknown, |s| s.position_m),
                sigma.map_or(unknown, |s| s.rotation_rad),
                bias.map_or(unknown, |b| b.gyro_rad_s),
                bias.map_or(unknown, |b| b.accel_m_s2),
            ];
            cells.extend(rest.iter().flat_map(|v| v.iter()).map(|x| cell(*x, 8)));
            row(&mut out, &cells);
        }
    }
    if out.len() > empty {
        out
    } else {
        String::new()
    }
}

/// The residuals of every record of the sensors.
fn residuals(drives: &[Drive]) -> String {
    let mut out =
        String::from("drive,sensor,record,time_s,component,unit,residual,normalised,test,weight\n");
    let empty = out.len();
    for drive in drives {
        let Some(solution) = &drive.solution else {
            continue;
        };
        for (sensor, list) in solution.sensors.iter().zip(&solution.residuals) {
            for residual in list {
                for (i, value) in residual.values.iter().enumerate() {
                    let component_of = |values: &[f64]| values.get(i).copied().unwrap_or(f64::NAN);
                    let component = component_name(&sensor.name, residual.values.len(), i);
                    row(
                        &mut out,
                        &[
                            quoted(&drive.name),
                            quoted(&sensor.name),
                            residual.record.to_string(),
                            cell(residual.time_s, 4),
                            quoted(&component),
                            sensor.unit.clone(),
                            cell(*value, 7),
                            cell(component_of(&residual.normalised), 4),
                            cell(component_of(&residual.tests), 4),
                            cell(residual.weight, 4),
                        ],
                    );
                }
            }
        }
    }
    if out.len() > empty {
        out
    } else {
        String::new()
    }
}

/// The changes of the poses by the joint adjustment.
fn moved(all: &Calibrations) -> String {
    let Some(joint) = all.joint_found() else {
        return String::new();
    };
    let mut out = String::from(
        "drive,time_s,shift_east_m,shift_north_m,shift_up_m,turn_x_rad,turn_y_rad,turn_z_rad\n",
    );
    for drive in &joint.drives {
        for pose in &drive.moved {
            let mut cells = vec![quoted(&drive.name), cell(pose.time_s, 4)];
            let values = pose.shift_m.iter().chain(pose.turn_rad.iter());
            cells.extend(values.map(|x| cell(*x, 8)));
            row(&mut out, &cells);
        }
    }
    out
}

/// The cost of every iteration.
fn convergence(all: &Calibrations) -> String {
    let mut out = String::from("calibration,voxel_m,iteration,neighbourhoods,cost\n");
    for (name, calibration) in calibrations(all) {
        for scale in &calibration.scales {
            for (iteration, cost) in scale.costs.iter().enumerate() {
                row(
                    &mut out,
                    &[
                        name.to_owned(),
                        cell(scale.voxel_m, 4),
                        iteration.to_string(),
                        scale.neighbourhoods.to_string(),
                        format!("{cost:e}"),
                    ],
                );
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::compared::agreement;

    #[test]
    fn cells_are_quoted_where_they_must_and_empty_where_nothing_is_known() {
        assert_eq!(quoted("left"), "left");
        assert_eq!(quoted("a,\"b\""), "\"a,\"\"b\"\"\"");
        assert_eq!(cell(f64::NAN, 3), "");
        assert_eq!(cell(-0.1234, 2), "-0.12");
    }

    #[test]
    fn cells_of_a_map_have_means() {
        let agreement = agreement(&[[0.0, 1e-3, 2e-3], [1e-4, 3e-3, 2e-3], [9.97, -1e-3, 2e-3]]);
        let mut out = String::new();
        of_pair("drive-1", &[agreement], &mut out);
        let lines: Vec<&str> = out.lines().collect();
        assert_eq!(
            lines,
            [
                "drive-1,left to reference,0.0250,0.0250,0.05,0,,,0,,,2,0.002000,0.002000",
                "drive-1,left to reference,9.9750,0.0250,0.05,0,,,0,,,1,-0.001000,0.002000"
            ]
        );
    }

    #[test]
    fn nothing_to_show_makes_no_file() {
        let content = Content::default();
        assert!(FILES.iter().all(|file| file.text(&content).is_empty()));
    }
}
