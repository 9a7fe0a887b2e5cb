//! The mountings of the other scanners in the frame of the first.

use super::html::{self, escape};
use super::tables::method_name;
use crate::calibration::{Calibration, RelativeMounting, ScannerFromScanner, relative};
use crate::comparison::MountingKind;
use crate::geometry::so3;
use crate::judgement;
use crate::number;
use crate::results::Calibrations;
use crate::statistics::NORMAL_97_5_ROUNDED;

/// The result of a method.
struct Column {
    name: &'static str,
    mounting: RelativeMounting,
    is_result: bool,
}

/// A table for each scanner but the first; empty for one scanner.
pub fn tables(calibrations: &Calibrations) -> String {
    let truth = calibrations.mountings(MountingKind::Truth);
    let result = &calibrations.result;
    let mut out = String::new();
    for (i, mounting) in result.relative().into_iter().enumerate() {
        let truth = truth.map(|truth| relative(&truth[0], &truth[i + 1]));
        let column = |calibration: &Calibration| Column {
            name: method_name(calibration.method),
            mounting: calibration.relative().swap_remove(i),
            is_result: false,
        };
        let two_steps = calibrations.two_steps();
        let two_steps = two_steps.filter(|calibration| calibration.method != result.method);
        let mut columns: Vec<Column> = two_steps.map(column).into_iter().collect();
        let heading = format!("{} relative to {}", mounting.name, mounting.first);
        columns.push(Column {
            mounting,
            is_result: true,
            ..column(result)
        });
        out.push_str(&format!("<h3>Scanner {}</h3>\n", escape(&heading)));
        out.push_str(&table(&columns, truth.as_ref()));
    }
    if out.is_empty() {
        return out;
    }
    let sentences: Vec<String> = judgement::relative(result);
    format!(
        "{out}<p class=\"note\">{} In the frame of the first scanner; what all scanners share, such as errors of the poses and of the lever arm, drops out. The rotation is a rotation vector; its ± and error are about the axes of the first scanner.</p>\n",
        escape(&sentences.join(" "))
    )
}

fn table(columns: &[Column], truth: Option<&ScannerFromScanner>) -> String {
    let mut head = String::from("<tr><td></td>");
    for column in columns {
        let class = result(column.is_result);
        head.push_str(&format!("<th scope=\"col\"{class}>{}</th>", column.name));
    }
    if truth.is_some() {
        head.push_str("<th scope=\"col\">truth</th>");
    }
    head.push_str("</tr>\n");
    let names = [
        "t<sub>x</sub> (m)",
        "t<sub>y</sub> (m)",
        "t<sub>z</sub> (m)",
        "about x (°)",
        "about y (°)",
        "about z (°)",
    ];
    let mut body = String::new();
    for (i, name) in names.into_iter().enumerate() {
        body.push_str(&format!("<tr><th scope=\"row\">{name}</th>"));
        for column in columns {
            body.push_str(&format!(
                "<td{}>{}</td>",
                result(column.is_result),
                cell(&column.mounting, truth, i)
            ));
        }
        if let Some(truth) = truth {
            let value = show(i, values(truth)[i]);
            body.push_str(&format!("<td><span class=\"value\">{value}</span></td>"));
        }
        body.push_str("</tr>\n");
    }
    html::table("numbers mounting relative", &head, &body)
}

fn result(is_result: bool) -> &'static str {
    if is_result { " class=\"result\"" } else { "" }
}

/// Metres and degrees.
fn values(pose: &ScannerFromScanner) -> [f64; 6] {
    let (t, turn) = (pose.translation_m, so3::log(&pose.rotation));
    let turn = turn.map(f64::to_degrees);
    [t.x, t.y, t.z, turn.x, turn.y, turn.z]
}

/// Estimated minus true values along and about the axes of the first scanner, metres and degrees.
fn errors(estimated: &ScannerFromScanner, truth: &ScannerFromScanner) -> [f64; 6] {
    let shift = estimated.translation_m - truth.translation_m;
    let turn = so3::log(&(estimated.rotation * truth.rotation.inverse()));
    let turn = turn.map(f64::to_degrees);
    [shift.x, shift.y, shift.z, turn.x, turn.y, turn.z]
}

/// A value to 0.001 mm or 0.0001°.
fn show(parameter: usize, value: f64) -> String {
    number::fixed(value, if parameter < 3 { 6 } else { 4 })
}

fn cell(relative: &RelativeMounting, truth: Option<&ScannerFromScanner>, i: usize) -> String {
    let pose = &relative.first_from_scanner;
    let (factor, unit) = if i < 3 {
        (1e3, "\u{202f}mm")
    } else {
        (1.0, "°")
    };
    let mut out = format!("<span class=\"value\">{}</span>", show(i, values(pose)[i]));
    let sigma = relative.sigma[i].filter(|sigma| sigma.is_finite());
    let sigma = sigma.map(|sigma| if i < 3 { sigma } else { sigma.to_degrees() });
    if let Some(sigma) = sigma {
        let text = number::sigma(factor * sigma);
        out.push_str(&format!("<span class=\"sigma\">± {text}{unit}</span>"));
    }
    let error = truth.map(|truth| errors(pose, truth)[i]);
    if let Some(error) = error.filter(|error| error.is_finite()) {
        let is_outside = sigma.is_some_and(|s| error.abs() > NORMAL_97_5_ROUNDED * s);
        let (class, mark) = if is_outside {
            ("error out", " ‡")
        } else {
            ("error", "")
        };
        let text = number::signed(number::fixed(factor * error, if i < 3 { 3 } else { 4 }));
        out.push_str(&format!(
            "<span class=\"{class}\">{text}{unit}{mark}</span>"
        ));
    }
    out
}
