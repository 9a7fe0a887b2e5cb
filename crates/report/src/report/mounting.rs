//! Table I: the mounting of each scanner by each method, and the truth.

use super::html::{self, escape};
use super::tables::method_name;
use crate::calibration::{Calibration, Method, Variant};
use crate::comparison::MountingKind;
use crate::geometry::euler::euler_deg_from_rotation;
use crate::geometry::{BodyFromScanner, EulerConvention};
use crate::joint::Joint;
use crate::number;
use crate::results::Calibrations;
use crate::statistics::NORMAL_97_5_ROUNDED;

/// Errors larger than this many standard deviations are marked.
const BOUND: f64 = NORMAL_97_5_ROUNDED;

/// A column of the table: a mounting of one scanner and its origin.
struct Column<'a> {
    label: &'static str,
    body_from_scanner: BodyFromScanner,
    /// The calibration and the index of the scanner; `None` for initial values.
    calibrated: Option<(&'a Calibration, usize)>,
    /// Whether the column is emphasised.
    is_result: bool,
}

/// Origin of the value of a parameter.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Origin {
    /// Written by the user and not estimated in this column.
    Given,
    /// Estimated from the data.
    Estimated,
    /// Fixed by the user.
    Fixed,
    /// Unobservable: held at its initial value.
    Unobservable,
}

impl Column<'_> {
    /// Origin of tx, ty, tz, rx, ry or rz; the last three stand for α, β, γ.
    fn origin(&self, parameter: usize) -> Origin {
        match self.calibrated {
            None => Origin::Given,
            Some((calibration, scanner)) if calibration.mountings[scanner].fixed[parameter] => {
                Origin::Fixed
            }
            Some((calibration, scanner)) if calibration.is_observable(scanner, parameter) => {
                Origin::Estimated
            }
            Some(_) => Origin::Unobservable,
        }
    }
}

/// One value with its uncertainty and error.
struct Cell {
    value: f64,
    sigma: Option<f64>,
    error: Option<f64>,
    origin: Origin,
}

/// A block of three parameters.
#[derive(Clone, Copy, PartialEq)]
enum Block {
    Translation,
    Euler(EulerConvention),
}

impl Block {
    fn heading(self) -> &'static str {
        match self {
            Self::Translation => "Lever arm t<sub>bs</sub> in body axes (m)",
            Self::Euler(EulerConvention::Zyx) => {
                "Rotation (°), convention zyx: R<sub>bs</sub> = R<sub>z</sub>(γ) R<sub>y</sub>(β) R<sub>x</sub>(α)"
            }
            Self::Euler(EulerConvention::Bonn) => {
                "Rotation (°), convention bonn: R<sub>bs</sub> = (R<sub>z</sub>(γ) R<sub>y</sub>(β) R<sub>x</sub>(α))<sup>T</sup>"
            }
        }
    }

    fn names(self) -> [&'static str; 3] {
        match self {
            Self::Translation => ["t<sub>x</sub>", "t<sub>y</sub>", "t<sub>z</sub>"],
            Self::Euler(_) => ["α", "β", "γ"],
        }
    }

    /// In metres or degrees.
    fn values(self, pose: &BodyFromScanner) -> [f64; 3] {
        match self {
            Self::Translation => pose.translation_m.into(),
            Self::Euler(convention) => euler_deg_from_rotation(convention, &pose.rotation),
        }
    }

    /// In metres or degrees.
    fn sigmas(self, column: &Column) -> [Option<f64>; 3] {
        let Some((calibration, scanner)) = column.calibrated else {
            return [None; 3];
        };
        match self {
            Self::Translation => {
                let convention = calibration.mountings[scanner].convention;
                let [x, y, z, ..] = calibration.sigmas(scanner, convention);
                [x, y, z]
            }
            Self::Euler(convention) => {
                let [.., alpha, beta, gamma] = calibration.sigmas(scanner, convention);
                [alpha, beta, gamma].map(|sigma| sigma.map(f64::to_degrees))
            }
        }
    }

    fn first(self) -> usize {
        match self {
            Self::Translation => 0,
            Self::Euler(_) => 3,
        }
    }

    fn cells(self, column: &Column, truth: Option<&BodyFromScanner>) -> [Cell; 3] {
        let values = self.values(&column.body_from_scanner);
        let sigmas = self.sigmas(column);
        let truth = truth.map(|pose| self.values(pose));
        std::array::from_fn(|i| Cell {
            value: values[i],
            sigma: sigmas[i].filter(|s| s.is_finite()),
            error: truth.map(|truth| {
                let error = values[i] - truth[i];
                match self {
                    Self::Translation => error,
                    Self::Euler(_) => error - 360.0 * (error / 360.0).round(),
                }
            }),
            origin: column.origin(self.first() + i),
        })
    }

    /// A value to 0.01 mm or 0.0001°.
    fn show_value(self, value: f64) -> String {
        match self {
            Self::Translation => number::fixed(value, 5),
            Self::Euler(_) => number::fixed(value, 4),
        }
    }

    fn show_sigma(self, sigma: f64) -> String {
        match self {
            Self::Translation => number::with_unit(number::sigma(sigma * 1e3), "mm"),
            Self::Euler(_) => number::sigma(sigma) + "°",
        }
    }

    fn show_error(self, error: f64) -> String {
        match self {
            Self::Translation => {
                number::with_unit(number::signed(number::fixed(error * 1e3, 2)), "mm")
            }
            Self::Euler(_) => number::signed(number::fixed(error, 4)) + "°",
        }
    }

    fn markup(self, cell: &Cell) -> String {
        let mut out = format!(
            "<span class=\"value\">{}</span>",
            self.show_value(cell.value)
        );
        match cell.origin {
            Origin::Given => {}
            Origin::Estimated => {
                if let Some(sigma) = cell.sigma {
                    out.push_str(&format!(
                        "<span class=\"sigma\">± {}</span>",
                        self.show_sigma(sigma)
                    ));
                }
            }
            Origin::Fixed => out.push_str("<span class=\"held\">fixed by user</span>"),
            Origin::Unobservable => {
                out.push_str("<span class=\"held open\">unobservable</span>");
            }
        }
        if let Some(error) = cell.error.filter(|e| e.is_finite()) {
            let estimated = cell.origin == Origin::Estimated;
            let is_outside = estimated && cell.sigma.is_some_and(|s| error.abs() > BOUND * s);
            let class = if is_outside { "error out" } else { "error" };
            out.push_str(&format!(
                "<span class=\"{class}\">{}{}</span>",
                self.show_error(error),
                if is_outside { " ‡" } else { "" }
            ));
        }
        out
    }
}

/// The tables of all scanners: the methods side by side, then two steps under other conditions, folded.
pub fn tables(calibrations: &Calibrations) -> String {
    let truth = calibrations.mountings(MountingKind::Truth);
    let refused = refused(calibrations);
    let scanners = calibrations.result.mountings.iter().enumerate();
    let (mut out, mut converted, mut folded) = (String::new(), String::new(), String::new());
    let mut is_any_open = false;
    for (scanner, mounting) in scanners {
        let truth = truth.map(|truth| &truth[scanner]);
        let heading = format!("<h3>Scanner {}</h3>\n", escape(&mounting.name));
        let methods = methods(calibrations, refused.as_ref(), scanner);
        let conditions = conditions(calibrations, scanner);
        let written = Block::Euler(mounting.convention);
        let blocks = [Block::Translation, written];
        out.push_str(&(heading.clone() + &table(&methods, &blocks, truth)));
        let all = EulerConvention::ALL.map(Block::Euler);
        for other in all.into_iter().filter(|block| *block != written) {
            converted.push_str(&(heading.clone() + &table(&methods, &[other], truth)));
        }
        if !conditions.is_empty() {
            folded.push_str(&(heading + &table(&conditions, &blocks, truth)));
        }
        let is_open = |column: &Column| (0..6).any(|p| column.origin(p) == Origin::Unobservable);
        is_any_open |= methods.iter().chain(&conditions).any(is_open);
    }
    if out.is_empty() {
        return out;
    }
    out.push_str("<p class=\"note\">± is one standard deviation.");
    if truth.is_some() {
        out.push_str(" The error is value minus truth. ‡ marks errors beyond 1.96 σ; one in twenty is expected.");
    }
    if is_any_open {
        out.push_str(" Two steps hold unobservable parameters at their initial values; in the joint adjustment these are \
             observations like others.");
    }
    out.push_str(" Table I of the paper.</p>\n");
    out + &html::details(
        "The same rotations in the other convention of angles",
        &converted,
    ) + &html::details("Two steps under other conditions", &folded)
}

/// The mountings of a calibration with their standard deviations, one column per scanner, each in its own convention.
pub fn brief(calibration: &Calibration) -> String {
    let conventions: Vec<EulerConvention> =
        calibration.mountings.iter().map(|m| m.convention).collect();
    let mut head = String::from("<tr><td></td>");
    for mounting in &calibration.mountings {
        head.push_str(&format!(
            "<th scope=\"col\">{}</th>",
            escape(&mounting.name)
        ));
    }
    head.push_str("</tr>\n");
    let mut body = String::new();
    for part in 0..2 {
        for parameter in 0..3 {
            let mut row = String::new();
            let mut name = "";
            for (scanner, convention) in conventions.iter().enumerate() {
                let block = [Block::Translation, Block::Euler(*convention)][part];
                name = block.names()[parameter];
                let cells = block.cells(&column("", calibration, scanner), None);
                row.push_str(&format!("<td>{}</td>", block.markup(&cells[parameter])));
            }
            body.push_str(&format!("<tr><th scope=\"row\">{name}</th>{row}</tr>\n"));
        }
    }
    let convention = match conventions.as_slice() {
        [first, others @ ..] if others.iter().all(|other| other == first) => {
            format!(", convention {}", first.name())
        }
        _ => String::new(),
    };
    html::table("numbers mounting brief", &head, &body)
        + &format!(
            "<p class=\"aside\">Metres and degrees{convention}; ± is one standard deviation.</p>\n"
        )
}

/// The mountings of a joint adjustment whose values are not the result.
fn refused(calibrations: &Calibrations) -> Option<Calibration> {
    let joint: &Joint = calibrations.refused()?;
    Some(joint.calibration(&calibrations.result))
}

/// A column of a calibration.
fn column<'a>(label: &'static str, calibration: &'a Calibration, scanner: usize) -> Column<'a> {
    Column {
        label,
        body_from_scanner: calibration.mountings[scanner].body_from_scanner,
        calibrated: Some((calibration, scanner)),
        is_result: false,
    }
}

/// The columns of one scanner: initial values and every method.
fn methods<'a>(
    calibrations: &'a Calibrations,
    refused: Option<&'a Calibration>,
    scanner: usize,
) -> Vec<Column<'a>> {
    let result = &calibrations.result;
    let initial = calibrations.mountings(MountingKind::Initial);
    let initial = initial.map(|initial| Column {
        label: "initial",
        body_from_scanner: initial[scanner],
        calibrated: None,
        is_result: false,
    });
    let variant = |variant, label| {
        let calibration = calibrations.variant(variant);
        calibration.map(|calibration| column(label, calibration, scanner))
    };
    let mut list = Vec::from_iter(initial);
    list.extend(variant(Variant::Paper, method_name(Method::Paper)));
    list.extend(variant(Variant::TwoStep, method_name(Method::TwoStep)));
    list.push(Column {
        is_result: true,
        ..column(method_name(result.method), result, scanner)
    });
    list.extend(
        refused.map(|calibration| column("joint adjustment, refused", calibration, scanner)),
    );
    list
}

/// The columns of one scanner for two steps under other conditions.
fn conditions(calibrations: &Calibrations, scanner: usize) -> Vec<Column<'_>> {
    let conditions = [
        (Variant::WithoutReference, "without reference"),
        (Variant::ExactPoses, "with exact poses"),
    ];
    let columns = conditions.into_iter().filter_map(|(variant, label)| {
        let calibration = calibrations.variant(variant)?;
        Some(column(label, calibration, scanner))
    });
    columns.collect()
}

fn table(columns: &[Column], blocks: &[Block], truth: Option<&BodyFromScanner>) -> String {
    let result = |is_result: bool| if is_result { " class=\"result\"" } else { "" };
    let mut head = String::from("<tr><td></td>");
    for column in columns {
        head.push_str(&format!(
            "<th scope=\"col\"{}>{}</th>",
            result(column.is_result),
            column.label
        ));
    }
    if truth.is_some() {
        head.push_str("<th scope=\"col\">truth</th>");
    }
    head.push_str("</tr>\n");

    let width = 1 + columns.len() + usize::from(truth.is_some());
    let mut body = String::new();
    for block in blocks {
        body.push_str(&format!(
            "<tr class=\"block\"><th colspan=\"{width}\" scope=\"colgroup\">{}</th></tr>\n",
            block.heading()
        ));
        let cells: Vec<[Cell; 3]> = columns.iter().map(|e| block.cells(e, truth)).collect();
        for (i, name) in block.names().iter().enumerate() {
            body.push_str(&format!("<tr><th scope=\"row\">{name}</th>"));
            for (column, cells) in columns.iter().zip(&cells) {
                body.push_str(&format!(
                    "<td{}>{}</td>",
                    result(column.is_result),
                    block.markup(&cells[i])
                ));
            }
            if let Some(truth) = truth {
                let value = block.show_value(block.values(truth)[i]);
                body.push_str(&format!("<td><span class=\"value\">{value}</span></td>"));
            }
            body.push_str("</tr>\n");
        }
    }
    if let Some(truth) = truth.filter(|_| blocks.contains(&Block::Translation)) {
        body.push_str(&format!(
            "<tr class=\"block\"><th colspan=\"{width}\" scope=\"colgroup\">Distance from the truth</th></tr>\n<tr><th scope=\"row\">total</th>"
        ));
        for column in columns {
            let mounting = &column.body_from_scanner;
            let length = (mounting.translation_m - truth.translation_m).norm();
            let angle = mounting.rotation.angle_to(&truth.rotation).to_degrees();
            body.push_str(&format!(
                "<td{}>{}<br/>{}°</td>",
                result(column.is_result),
                number::with_unit(number::fixed(length * 1e3, 2), "mm"),
                number::fixed(angle, 4)
            ));
        }
        body.push_str("<td></td></tr>\n");
    }
    html::table("numbers mounting", &head, &body)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vec3;
    use crate::geometry::euler::rotation_from_euler_deg;

    #[test]
    fn errors_of_angles_wrap() {
        let mounting = |alpha_deg: f64| {
            let angles = [alpha_deg, 0.0, 90.0];
            let rotation = rotation_from_euler_deg(EulerConvention::Bonn, angles);
            BodyFromScanner::new(rotation, Vec3::new(1.254, -0.545, 0.587))
        };
        let initial = Column {
            label: "initial",
            body_from_scanner: mounting(179.95),
            calibrated: None,
            is_result: false,
        };
        let truth = mounting(-179.95);
        let cells = Block::Euler(EulerConvention::Bonn).cells(&initial, Some(&truth));
        assert!((cells[0].error.unwrap() + 0.1).abs() < 1e-9);
    }

    #[test]
    fn unobservable_parameters_show_no_sigma() {
        let cell = |origin| Cell {
            value: 1.254,
            sigma: Some(1e-3),
            error: None,
            origin,
        };
        let held = Block::Translation.markup(&cell(Origin::Unobservable));
        assert!(held.contains("unobservable") && !held.contains('±'));
        let estimated = Block::Translation.markup(&cell(Origin::Estimated));
        assert!(estimated.contains("± 1.0"), "{estimated}");
    }
}
