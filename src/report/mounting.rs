//! Table I: the mounting of each scanner at several stages of knowledge.

use super::content::{MountingEstimate, MountingTable, ParameterOrigin};
use super::html::{self, escape};
use super::number;
use crate::geometry::euler::{euler_deg_from_rotation, euler_jacobian};
use crate::geometry::{BodyFromScanner, EulerConvention};
use crate::statistics::NORMAL_97_5_ROUNDED;

/// Errors beyond this many sigmas are marked.
const BOUND: f64 = NORMAL_97_5_ROUNDED;

/// One value with what is known of its error.
struct Cell {
    value: f64,
    sigma: Option<f64>,
    error: Option<f64>,
    origin: ParameterOrigin,
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
    fn sigmas(self, estimate: &MountingEstimate) -> [Option<f64>; 3] {
        match self {
            Self::Translation => estimate.translation_sigma_m,
            Self::Euler(convention) => {
                let Some(covariance) = &estimate.rotation_covariance_rad2 else {
                    return [None; 3];
                };
                let rotation = &estimate.body_from_scanner.rotation;
                let jacobian = euler_jacobian(convention, rotation);
                let euler = jacobian * covariance * jacobian.transpose();
                std::array::from_fn(|i| {
                    // Rounding may leave a variance of zero slightly negative.
                    let variance = euler[(i, i)];
                    let known = variance.is_finite().then(|| variance.max(0.0));
                    known.map(|v| v.sqrt().to_degrees())
                })
            }
        }
    }

    fn first(self) -> usize {
        match self {
            Self::Translation => 0,
            Self::Euler(_) => 3,
        }
    }

    fn cells(self, estimate: &MountingEstimate, truth: Option<&BodyFromScanner>) -> [Cell; 3] {
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
            origin: estimate.origin[self.first() + i],
        })
    }

    fn show(self, value: f64) -> String {
        match self {
            Self::Translation => number::fixed(value, 4),
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
        let mut out = format!("<span class=\"value\">{}</span>", self.show(cell.value));
        match cell.origin {
            ParameterOrigin::Given => {}
            ParameterOrigin::Estimated => {
                if let Some(sigma) = cell.sigma {
                    out.push_str(&format!(
                        "<span class=\"sigma\">± {}</span>",
                        self.show_sigma(sigma)
                    ));
                }
            }
            ParameterOrigin::Fixed => out.push_str("<span class=\"held\">fixed by user</span>"),
            ParameterOrigin::NotObservable => {
                out.push_str("<span class=\"held open\">not observable</span>");
            }
        }
        if let Some(error) = cell.error.filter(|e| e.is_finite()) {
            let estimated = cell.origin == ParameterOrigin::Estimated;
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
pub fn tables(list: &[MountingTable]) -> String {
    let usable: Vec<&MountingTable> = list.iter().filter(|t| !t.estimates.is_empty()).collect();
    if usable.is_empty() {
        return String::new();
    }
    let mut out: String = usable.iter().map(|t| table(t)).collect();
    out.push_str("<p class=\"note\">± is one standard deviation.");
    if usable.iter().any(|t| t.truth.is_some()) {
        out.push_str(" Below it the error: value minus truth. ‡ marks errors beyond 1.96 σ, of which one in twenty is to be expected.");
    }
    let mut estimates = usable.iter().flat_map(|t| &t.estimates);
    if estimates.any(|e| e.origin.contains(&ParameterOrigin::NotObservable)) {
        out.push_str(" What is not observable keeps what the initial values say of it.");
    }
    out.push_str(" Table I of the paper.</p>\n");
    out
}

fn table(table: &MountingTable) -> String {
    let result = |is_result: bool| if is_result { " class=\"result\"" } else { "" };
    let mut head = String::from("<tr><td></td>");
    for estimate in &table.estimates {
        head.push_str(&format!(
            "<th scope=\"col\"{}>{}</th>",
            result(estimate.is_result),
            escape(&estimate.label)
        ));
    }
    if table.truth.is_some() {
        head.push_str("<th scope=\"col\">truth</th>");
    }
    head.push_str("</tr>\n");

    let columns = 1 + table.estimates.len() + usize::from(table.truth.is_some());
    let mut body = String::new();
    for block in Block::ALL {
        body.push_str(&format!(
            "<tr class=\"block\"><th colspan=\"{columns}\" scope=\"colgroup\">{}</th></tr>\n",
            block.heading()
        ));
        let cells: Vec<[Cell; 3]> = table
            .estimates
            .iter()
            .map(|estimate| block.cells(estimate, table.truth.as_ref()))
            .collect();
        for (i, name) in block.names().iter().enumerate() {
            body.push_str(&format!("<tr><th scope=\"row\">{name}</th>"));
            for (estimate, cells) in table.estimates.iter().zip(&cells) {
                body.push_str(&format!(
                    "<td{}>{}</td>",
                    result(estimate.is_result),
                    block.markup(&cells[i])
                ));
            }
            if let Some(truth) = &table.truth {
                let value = block.show(block.values(truth)[i]);
                body.push_str(&format!("<td><span class=\"value\">{value}</span></td>"));
            }
            body.push_str("</tr>\n");
        }
    }
    if let Some(truth) = &table.truth {
        body.push_str(&format!(
            "<tr class=\"block\"><th colspan=\"{columns}\" scope=\"colgroup\">Distance from the truth</th></tr>\n<tr><th scope=\"row\">in all</th>"
        ));
        for estimate in &table.estimates {
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
        escape(&table.scanner),
        html::table("numbers mounting", &head, &body)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::euler::rotation_from_euler_deg;
    use crate::geometry::{BodyFromScanner, Mat3, Vec3};

    fn estimate(rotation_deg: [f64; 3], covariance: Option<Mat3>) -> MountingEstimate {
        MountingEstimate {
            label: "with reference".into(),
            body_from_scanner: BodyFromScanner::new(
                rotation_from_euler_deg(EulerConvention::Bonn, rotation_deg),
                Vec3::new(1.254, -0.545, 0.587),
            ),
            translation_sigma_m: [Some(1e-3); 3],
            rotation_covariance_rad2: covariance,
            origin: [ParameterOrigin::Estimated; 6],
            is_result: true,
        }
    }

    #[test]
    fn sigmas_of_euler_angles_follow_from_the_rotation_vector() {
        // bonn: R = Qᵀ with Q = Rz(γ) Ry(β) Rx(α), so R Exp(φ) = (Exp(−φ) Q)ᵀ, and turning Q
        // about its fixed z axis is a change of γ alone.
        let sigma_rad = 2e-3f64;
        let mut covariance = Mat3::zeros();
        covariance[(2, 2)] = sigma_rad.powi(2);
        let e = estimate([-143.769, -0.369, 89.833], Some(covariance));
        let sigmas = Block::Euler(EulerConvention::Bonn).sigmas(&e);
        let [alpha, beta, gamma] = sigmas.map(Option::unwrap);
        assert!((gamma - sigma_rad.to_degrees()).abs() < 1e-6, "{gamma}");
        assert!(alpha < 1e-6 && beta < 1e-6, "{alpha} {beta}");
    }

    #[test]
    fn errors_of_angles_wrap() {
        let e = estimate([179.95, 0.0, 90.0], None);
        let truth = estimate([-179.95, 0.0, 90.0], None).body_from_scanner;
        let cells = Block::Euler(EulerConvention::Bonn).cells(&e, Some(&truth));
        assert!((cells[0].error.unwrap() + 0.1).abs() < 1e-9);
    }

    #[test]
    fn what_is_not_observable_shows_no_sigma() {
        let mut e = estimate([-143.769, -0.369, 89.833], None);
        e.origin[2] = ParameterOrigin::NotObservable;
        let cells = Block::Translation.cells(&e, None);
        let held = Block::Translation.markup(&cells[2]);
        assert!(
            held.contains("not observable") && !held.contains('±'),
            "{held}"
        );
        assert!(Block::Translation.markup(&cells[1]).contains("± 1.0"));
    }
}
