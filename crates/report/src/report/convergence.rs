//! Convergence of the adjustments: methods side by side, then by scale.

use super::axis::{Axis, decimate};
use super::chart::Plot;
use super::figures::{FULL, VERTICES, series};
use super::html::{self, escape};
use crate::calibration::{Calibration, Method, Scale, Variant};
use crate::comparison::MountingKind;
use crate::geometry::{BodyFromScanner, so3};
use crate::number::{self, DASH};
use crate::results::Calibrations;

/// An adjustment over all its scales.
struct Run<'a> {
    label: &'static str,
    calibration: &'a Calibration,
    /// The true body_from_scanner of each scanner, if known.
    truth: Option<&'a [BodyFromScanner]>,
}

impl Run<'_> {
    /// Axis label, unit and definition of [`Run::cost`].
    fn measure(&self) -> [&'static str; 3] {
        match self.calibration.method {
            Method::TwoStep | Method::Joint => [
                "mean thickness (mm)",
                "mm",
                "geometric mean of the thicknesses √(λ₃ + s²) of all neighbourhoods",
            ],
            Method::Paper => [
                "RMS omnivariance (mm²)",
                "mm²",
                "root mean square of the omnivariances (λ₁ λ₂ λ₃)<sup>⅓</sup> of all neighbourhoods",
            ],
        }
    }

    /// The method's cost before the first and after every iteration of a scale, as a mean over the
    /// neighbourhoods, so that it does not depend on their number.
    fn cost(&self, scale: &Scale) -> Vec<f64> {
        let means = scale.costs.iter();
        match self.calibration.method {
            // exp(½ mean ln(λ₃ + s²)): the geometric mean of √(λ₃ + s²).
            Method::TwoStep | Method::Joint => means.map(|mean| 1e3 * (0.5 * mean).exp()).collect(),
            Method::Paper => means.map(|mean| 1e6 * mean.sqrt()).collect(),
        }
    }

    /// Cells of the largest errors of the observable translations and of the rotations after a scale; empty if the
    /// truth is not known.
    fn errors(&self, scale: Option<&Scale>) -> String {
        let Some(truth) = self.truth else {
            return String::new();
        };
        let (mut length_m, mut angle_rad) = (0.0f64, 0.0f64);
        let mountings = scale.iter().flat_map(|scale| &scale.mountings);
        for (scanner, (mounting, truth)) in mountings.zip(truth).enumerate() {
            let estimated = &mounting.body_from_scanner;
            let shift = estimated.translation_m - truth.translation_m;
            let turn = so3::log(&(estimated.rotation * truth.rotation.inverse()));
            for axis in (0..3).filter(|&axis| self.calibration.is_observable(scanner, axis)) {
                length_m = length_m.max(shift[axis].abs());
            }
            angle_rad = angle_rad.max(turn.amax());
        }
        format!(
            "<td>{}</td><td>{}</td>",
            number::millimetres(length_m),
            number::sigma(angle_rad.to_degrees())
        )
    }
}

fn runs(calibrations: &Calibrations) -> Vec<Run<'_>> {
    let truth = calibrations.mountings(MountingKind::Truth);
    let run = |label, calibration| Run {
        label,
        calibration,
        truth,
    };
    let two_steps = calibrations.two_steps();
    let result = match calibrations.result.method {
        Method::Paper => Some(run("as in the paper", &calibrations.result)),
        _ => two_steps.map(|calibration| run("two steps", calibration)),
    };
    let variants = [
        (Variant::Paper, "as in the paper"),
        (Variant::WithoutReference, "two steps without reference"),
        (Variant::ExactPoses, "two steps with exact poses"),
    ];
    let variants = variants.into_iter().filter_map(|(variant, label)| {
        let calibration = calibrations.variant(variant)?;
        Some(run(label, calibration))
    });
    result.into_iter().chain(variants).collect()
}

/// The whole section: comparison, a chart for each method, and the table of scales.
pub fn section(calibrations: &Calibrations) -> String {
    let runs = &runs(calibrations);
    let mut charts = runs.iter().map(chart);
    let first = charts.next().unwrap_or_default();
    comparison(runs)
        + &first
        + &html::details(
            "Convergence of the other methods",
            &charts.collect::<String>(),
        )
        + &html::details("All methods, scale by scale", &scales(runs))
}

fn error_heads(runs: &[Run]) -> &'static str {
    if runs.iter().any(|run| run.truth.is_some()) {
        "<th scope=\"col\">largest error<br/><small>mm</small></th><th scope=\"col\">largest error<br/><small>°</small></th>"
    } else {
        ""
    }
}

/// One row per method.
fn comparison(runs: &[Run]) -> String {
    let head = format!(
        "<tr><th scope=\"col\">method</th><th scope=\"col\">voxels</th><th scope=\"col\">iterations</th><th scope=\"col\">time<br/><small>s</small></th>{}<th scope=\"col\" class=\"text\">ended</th></tr>\n",
        error_heads(runs)
    );
    let mut body = String::new();
    for run in runs {
        let scales = run.calibration.scales.as_slice();
        let voxels = match scales {
            [] => DASH.to_owned(),
            [only] => number::voxel(only.voxel_m),
            [first, .., last] => format!(
                "{} to {}",
                number::voxel(first.voxel_m),
                number::voxel(last.voxel_m)
            ),
        };
        let class = if run.calibration.converged {
            "text"
        } else {
            "text out"
        };
        let ended = scales.last().map(|scale| scale.ending.to_string());
        body.push_str(&format!(
            "<tr><th scope=\"row\">{}</th><td>{voxels}</td><td>{}</td><td>{}</td>{}<td class=\"{class}\">{}</td></tr>\n",
            run.label,
            number::count(scales.iter().map(|s| s.iterations).sum()),
            number::fixed(scales.iter().map(|s| s.seconds).sum(), 1),
            run.errors(scales.last()),
            escape(&ended.unwrap_or_default())
        ));
    }
    html::table("numbers methods", &head, &body)
}

/// The cost of one method over its iterations, with one column per scale.
fn chart(run: &Run) -> String {
    let [label, _, definition] = run.measure();
    let scales = &run.calibration.scales;
    let costs = || scales.iter().flat_map(|scale| run.cost(scale));
    if !costs().any(|c| c.is_finite() && c > 0.0) {
        return String::new();
    }
    let x = Axis {
        label: "voxel size · iterations".into(),
        min: 0.0,
        max: scales.len() as f64,
        log: false,
    };
    let y = Axis::logarithmic(label, costs());
    let mut plot = Plot::bare(FULL, 260.0, x, y);
    for (i, scale) in scales.iter().enumerate() {
        let cost = run.cost(scale);
        let left = i as f64;
        if i > 0 {
            plot.upright("grid", left);
        }
        let steps = cost.len().max(2) as f64 - 1.0;
        let place = |j: usize| left + 0.12 + 0.76 * j as f64 / steps;
        let curve = cost.iter().enumerate().map(|(j, cost)| [place(j), *cost]);
        let curve: Vec<[f64; 2]> = curve.collect();
        plot.line(&series(0), &decimate(&curve, VERTICES));
        if curve.len() <= 16 {
            plot.dots(&format!("dot {}", series(0)), 3.0, &curve);
        }
        let (x, y) = (plot.px(left + 0.5), plot.bottom() + 17.0);
        let text = format!("{} · {}", number::voxel(scale.voxel_m), scale.iterations);
        plot.text("tick", x, y, &text);
    }
    plot.x_label();
    html::figure(
        &plot.finish("Cost over iterations"),
        &format!(
            "{}: {definition}, over the iterations of each scale. Each scale has its own points, so values are comparable only within a column.",
            run.label
        ),
    )
}

/// All scales of all methods.
fn scales(runs: &[Run]) -> String {
    if runs.iter().all(|run| run.calibration.scales.is_empty()) {
        return String::new();
    }
    let head = format!(
        "<tr><th scope=\"col\">method</th><th scope=\"col\">voxel</th><th scope=\"col\">points</th><th scope=\"col\">neighbour-<br/>hoods</th><th scope=\"col\">iterations</th><th scope=\"col\">cost<br/>at the end</th><th scope=\"col\">time<br/><small>s</small></th>{}</tr>\n",
        error_heads(runs)
    );
    let mut body = String::new();
    for run in runs {
        let [_, unit, _] = run.measure();
        for (i, scale) in run.calibration.scales.iter().enumerate() {
            let is_first = i == 0;
            let last = run.cost(scale).last().copied().unwrap_or(f64::NAN);
            let cost = number::significant(last, 3);
            body.push_str(&format!(
                "<tr class=\"{}\"><th scope=\"row\">{}</th><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td>{}</tr>\n",
                if is_first { "first" } else { "" },
                if is_first { run.label } else { "" },
                number::voxel(scale.voxel_m),
                number::count(scale.points + scale.reference_points),
                number::count(scale.neighbourhoods),
                number::count(scale.iterations),
                number::with_unit(cost, unit),
                number::fixed(scale.seconds, 2),
                run.errors(Some(scale))
            ));
        }
    }
    html::table("numbers", &head, &body)
}
