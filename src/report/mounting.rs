//! Table I: the mounting of each scanner at several stages of knowledge.

use super::content::Calibrations;
use super::html::{self, escape};
use super::number;
use crate::calibration::{Calibration, Variant};
use crate::comparison::MountingKind;
use crate::geometry::euler::euler_deg_from_rotation;
use crate::geometry::{BodyFromScanner, EulerConvention};
use crate::statistics::NORMAL_97_5_ROUNDED;

/// Errors beyond this many sigmas are marked.
const BOUND: f64 = NORMAL_97_5_ROUNDED;

/// A column of the table: a mounting of one scanner and where it comes from.
struct Estimate<'a> {
    label: &'static str,
    body_from_scanner: BodyFromScanner,
    /// The calibration that found it, and the scanner's place there; `None` for initial values.
    found: Option<(&'a Calibration, usize)>,
    /// Its column is emphasised.
    is_result: bool,
}

/// Where the value of a parameter comes from.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Origin {
    /// Written by the user and not estimated in this column.
    Given,
    /// Estimated from the data.
    Estimated,
    /// Held at its value because the user asked so.
    Fixed,
    /// Not observable from the data: held at its initial value.
    NotObservable,
}

impl Estimate<'_> {
    /// Of tx, ty, tz, rx, ry, rz; the last three mark α, β, γ.
    fn origin(&self, parameter: usize) -> Origin {
        match self.found {
            None => Origin::Given,
            Some((found, scanner)) if found.mountings[scanner].fixed[parameter] => Origin::Fixed,
            Some((found, scanner)) if found.is_observable(scanner, parameter) => Origin::Estimated,
            Some(_) => Origin::NotObservable,
        }
    }
}

/// One value with what is known of its error.
struct Cell {
    value: f64,
    sigma: Option<f64>,
    error: Option<f64>,
    origin: Origin,
}

/// A block of three parameters.
#[derive(Clone, Copy)]
enum Block {
    Translation,
    Euler(EulerConvention),
}

impl Block {
    const ALL: [Self; 3] = [
        Self::Translation,
        Self::Euler(EulerConvention::Zyx),
        Self::Euler(EulerConvention::Bonn),
    ];

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

    /// Metres or degrees.
    fn values(self, pose: &BodyFromScanner) -> [f64; 3] {
        match self {
            Self::Translation => pose.translation_m.into(),
            Self::Euler(convention) => euler_deg_from_rotation(convention, &pose.rotation),
        }
    }

    /// Metres or degrees.
    fn sigmas(self, estimate: &Estimate) -> [Option<f64>; 3] {
        let Some((found, scanner)) = estimate.found else {
            return [None; 3];
        };
        match self {
            Self::Translation => {
                let own = found.mountings[scanner].convention;
                let [x, y, z, ..] = found.sigmas(scanner, own);
                [x, y, z]
            }
            Self::Euler(convention) => {
                let [.., alpha, beta, gamma] = found.sigmas(scanner, convention);
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

    fn cells(self, estimate: &Estimate, truth: Option<&BodyFromScanner>) -> [Cell; 3] {
        let values = self.values(&estimate.body_from_scanner);
        let sigmas = self.sigmas(estimate);
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
            origin: estimate.origin(self.first() + i),
        })
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
            number::fixed(cell.value, 4)
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
            Origin::NotObservable => {
                out.push_str("<span class=\"held open\">not observable</span>");
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

/// All scanners.
pub fn tables(calibrations: &Calibrations) -> String {
    let truth = calibrations.mountings(MountingKind::Truth);
    let scanners = calibrations.result.mountings.iter();
    let tables: Vec<(&str, Vec<Estimate>, Option<&BodyFromScanner>)> = scanners
        .enumerate()
        .map(|(scanner, mounting)| {
            let truth = truth.map(|truth| &truth[scanner]);
            (&*mounting.name, estimates(calibrations, scanner), truth)
        })
        .collect();
    if tables.is_empty() {
        return String::new();
    }
    let mut out: String = tables
        .iter()
        .map(|(name, estimates, truth)| table(name, estimates, *truth))
        .collect();
    out.push_str("<p class=\"note\">± is one standard deviation.");
    if truth.is_some() {
        out.push_str(" Below it the error: value minus truth. ‡ marks errors beyond 1.96 σ, of which one in twenty is to be expected.");
    }
    let mut estimates = tables.iter().flat_map(|(_, estimates, _)| estimates);
    if estimates.any(|e| (0..6).any(|parameter| e.origin(parameter) == Origin::NotObservable)) {
        out.push_str(" What is not observable keeps what the initial values say of it.");
    }
    out.push_str(" Table I of the paper.</p>\n");
    out
}

/// The columns of one scanner. The paper's method gives no standard deviations and is shown among
/// the methods.
fn estimates<'a>(calibrations: &Calibrations<'a>, scanner: usize) -> Vec<Estimate<'a>> {
    let of = |label, found: &'a Calibration, is_result| Estimate {
        label,
        body_from_scanner: found.mountings[scanner].body_from_scanner,
        found: Some((found, scanner)),
        is_result,
    };
    let without = calibrations.variant(Variant::WithoutReference);
    let exact = calibrations.variant(Variant::ExactPoses);
    let initial = calibrations.mountings(MountingKind::Initial);
    let initial = initial.map(|initial| Estimate {
        label: "initial",
        body_from_scanner: initial[scanner],
        found: None,
        is_result: false,
    });
    let label = without.map_or("found", |_| "with reference");
    let mut list = Vec::from_iter(initial);
    list.extend(without.map(|found| of("without reference", found, false)));
    list.push(of(label, calibrations.result, true));
    list.extend(exact.map(|found| of("with exact poses", found, false)));
    list
}

fn table(scanner: &str, estimates: &[Estimate], truth: Option<&BodyFromScanner>) -> String {
    let result = |is_result: bool| if is_result { " class=\"result\"" } else { "" };
    let mut head = String::from("<tr><td></td>");
    for estimate in estimates {
        head.push_str(&format!(
            "<th scope=\"col\"{}>{}</th>",
            result(estimate.is_result),
            estimate.label
        ));
    }
    if truth.is_some() {
        head.push_str("<th scope=\"col\">truth</th>");
    }
    head.push_str("</tr>\n");

    let columns = 1 + estimates.len() + usize::from(truth.is_some());
    let mut body = String::new();
    for block in Block::ALL {
        body.push_str(&format!(
            "<tr class=\"block\"><th colspan=\"{columns}\" scope=\"colgroup\">{}</th></tr>\n",
            block.heading()
        ));
        let cells: Vec<[Cell; 3]> = estimates.iter().map(|e| block.cells(e, truth)).collect();
        for (i, name) in block.names().iter().enumerate() {
            body.push_str(&format!("<tr><th scope=\"row\">{name}</th>"));
            for (estimate, cells) in estimates.iter().zip(&cells) {
                body.push_str(&format!(
                    "<td{}>{}</td>",
                    result(estimate.is_result),
                    block.markup(&cells[i])
                ));
            }
            if let Some(truth) = truth {
                let value = number::fixed(block.values(truth)[i], 4);
                body.push_str(&format!("<td><span class=\"value\">{value}</span></td>"));
            }
            body.push_str("</tr>\n");
        }
    }
    if let Some(truth) = truth {
        body.push_str(&format!(
            "<tr class=\"block\"><th colspan=\"{columns}\" scope=\"colgroup\">Distance from the truth</th></tr>\n<tr><th scope=\"row\">in all</th>"
        ));
        for estimate in estimates {
            let mounting = &estimate.body_from_scanner;
            let length = (mounting.translation_m - truth.translation_m).norm();
            let angle = mounting.rotation.angle_to(&truth.rotation).to_degrees();
            body.push_str(&format!(
                "<td{}>{}<br/>{}°</td>",
                result(estimate.is_result),
                number::with_unit(number::fixed(length * 1e3, 2), "mm"),
                number::fixed(angle, 4)
            ));
        }
        body.push_str("<td></td></tr>\n");
    }
    format!(
        "<h3>Scanner {}</h3>\n{}",
        escape(scanner),
        html::table("numbers mounting", &head, &body)
    )
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
        let initial = Estimate {
            label: "initial",
            body_from_scanner: mounting(179.95),
            found: None,
            is_result: false,
        };
        let truth = mounting(-179.95);
        let cells = Block::Euler(EulerConvention::Bonn).cells(&initial, Some(&truth));
        assert!((cells[0].error.unwrap() + 0.1).abs() < 1e-9);
    }

    #[test]
    fn what_is_not_observable_shows_no_sigma() {
        let cell = |origin| Cell {
            value: 1.254,
            sigma: Some(1e-3),
            error: None,
            origin,
        };
        let held = Block::Translation.markup(&cell(Origin::NotObservable));
        assert!(held.contains("not observable") && !held.contains('±'));
        let estimated = Block::Translation.markup(&cell(Origin::Estimated));
        assert!(estimated.contains("± 1.0"), "{estimated}");
    }
}
