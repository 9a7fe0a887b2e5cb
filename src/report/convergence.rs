//! How the adjustments went: methods side by side, convergence by scale.

use super::axis::{Axis, thin};
use super::chart::Plot;
use super::content::{CostMeasure, MethodRun, ScaleRun};
use super::figures::{FULL, VERTICES, series};
use super::html::{self, escape};
use super::number::{self, DASH};

impl CostMeasure {
    fn label(self) -> &'static str {
        match self {
            Self::Thickness => "mean thickness (mm)",
            Self::Omnivariance => "RMS omnivariance (mm²)",
        }
    }

    fn unit(self) -> &'static str {
        match self {
            Self::Thickness => "mm",
            Self::Omnivariance => "mm²",
        }
    }

    fn words(self) -> &'static str {
        match self {
            Self::Thickness => "geometric mean of the thicknesses √(λ₃ + s²) of all neighbourhoods",
            Self::Omnivariance => {
                "root mean square of the omnivariances (λ₁ λ₂ λ₃)<sup>⅓</sup> of all neighbourhoods"
            }
        }
    }

    /// From metres to millimetres, or their squares.
    fn shown(self, cost: f64) -> f64 {
        match self {
            Self::Thickness => 1e3 * cost,
            Self::Omnivariance => 1e6 * cost,
        }
    }
}

/// The whole section: comparison, the chart of every method, and scale by scale.
pub fn section(runs: &[MethodRun]) -> String {
    let mut charts = runs.iter().map(chart);
    let first = charts.next().unwrap_or_default();
    comparison(runs)
        + &first
        + &html::details(
            "Convergence of the other methods",
            &charts.collect::<String>(),
        )
        + &html::details("Every method, scale by scale", &scales(runs))
}

fn has_errors(runs: &[MethodRun]) -> bool {
    let mut scales = runs.iter().flat_map(|run| &run.scales);
    scales.any(|s| s.max_translation_error_m.is_some() || s.max_rotation_error_rad.is_some())
}

const ERROR_HEADS: &str = "<th scope=\"col\">largest error<br/><small>mm</small></th><th scope=\"col\">largest error<br/><small>°</small></th>";

fn errors(scale: Option<&ScaleRun>) -> String {
    let length = scale
        .and_then(|s| s.max_translation_error_m)
        .map(number::millimetres);
    let angle = scale
        .and_then(|s| s.max_rotation_error_rad)
        .map(|a| number::sigma(a.to_degrees()));
    let dash = || DASH.to_owned();
    format!(
        "<td>{}</td><td>{}</td>",
        length.unwrap_or_else(dash),
        angle.unwrap_or_else(dash)
    )
}

/// One line a method.
fn comparison(runs: &[MethodRun]) -> String {
    if runs.is_empty() {
        return String::new();
    }
    let known = has_errors(runs);
    let head = format!(
        "<tr><th scope=\"col\">method</th><th scope=\"col\">voxels</th><th scope=\"col\">iterations</th><th scope=\"col\">time<br/><small>s</small></th>{}<th scope=\"col\" class=\"text\">ended</th></tr>\n",
        if known { ERROR_HEADS } else { "" }
    );
    let mut body = String::new();
    for run in runs {
        let voxels = match run.scales.as_slice() {
            [] => DASH.to_owned(),
            [only] => number::voxel(only.voxel_m),
            [first, .., last] => format!(
                "{} to {}",
                number::voxel(first.voxel_m),
                number::voxel(last.voxel_m)
            ),
        };
        let class = if run.converged { "text" } else { "text out" };
        let ended = if run.converged && run.ending.is_empty() {
            "converged"
        } else {
            &run.ending
        };
        body.push_str(&format!(
            "<tr><th scope=\"row\">{}</th><td>{voxels}</td><td>{}</td><td>{}</td>{}<td class=\"{class}\">{}</td></tr>\n",
            escape(&run.method),
            number::count(run.scales.iter().map(|s| s.iterations).sum()),
            number::fixed(run.scales.iter().map(|s| s.seconds).sum(), 1),
            if known {
                errors(run.scales.last())
            } else {
                String::new()
            },
            escape(ended)
        ));
    }
    html::table("numbers methods", &head, &body)
}

/// The cost of one method over its iterations, every scale in its own column.
fn chart(run: &MethodRun) -> String {
    let costs = || run.scales.iter().flat_map(|s| &s.cost).copied();
    if !costs().any(|c| c.is_finite() && c > 0.0) {
        return String::new();
    }
    let x = Axis {
        label: "voxel size · iterations".into(),
        min: 0.0,
        max: run.scales.len() as f64,
        log: false,
    };
    let y = Axis::logarithmic(run.measure.label(), costs().map(|c| run.measure.shown(c)));
    let mut plot = Plot::bare(FULL, 260.0, x, y);
    for (i, scale) in run.scales.iter().enumerate() {
        let left = i as f64;
        if i > 0 {
            plot.upright("grid", left);
        }
        let steps = scale.cost.len().max(2) as f64 - 1.0;
        let place = |j: usize| left + 0.12 + 0.76 * j as f64 / steps;
        let curve: Vec<[f64; 2]> = scale
            .cost
            .iter()
            .enumerate()
            .map(|(j, c)| [place(j), run.measure.shown(*c)])
            .collect();
        plot.line(&series(0), &thin(&curve, VERTICES));
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
            "{}: {}, before the first iteration of each scale and after every one. Each scale has its own points, so only the fall within a column counts.",
            escape(&run.method),
            run.measure.words()
        ),
    )
}

/// Every scale of every method.
fn scales(runs: &[MethodRun]) -> String {
    if runs.iter().all(|run| run.scales.is_empty()) {
        return String::new();
    }
    let known = has_errors(runs);
    let head = format!(
        "<tr><th scope=\"col\">method</th><th scope=\"col\">voxel</th><th scope=\"col\">points</th><th scope=\"col\">neighbour-<br/>hoods</th><th scope=\"col\">iterations</th><th scope=\"col\">cost<br/>at the end</th><th scope=\"col\">time<br/><small>s</small></th>{}</tr>\n",
        if known { ERROR_HEADS } else { "" }
    );
    let mut body = String::new();
    for run in runs {
        for (i, scale) in run.scales.iter().enumerate() {
            let is_first = i == 0;
            let last = scale.cost.last().copied().unwrap_or(f64::NAN);
            let cost = number::significant(run.measure.shown(last), 3);
            body.push_str(&format!(
                "<tr class=\"{}\"><th scope=\"row\">{}</th><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td>{}</tr>\n",
                if is_first { "first" } else { "" },
                if is_first { escape(&run.method) } else { String::new() },
                number::voxel(scale.voxel_m),
                number::count(scale.points),
                number::count(scale.neighbourhoods),
                number::count(scale.iterations),
                number::with_unit(cost, run.measure.unit()),
                number::fixed(scale.seconds, 2),
                if known { errors(Some(scale)) } else { String::new() }
            ));
        }
    }
    html::table("numbers", &head, &body)
}
