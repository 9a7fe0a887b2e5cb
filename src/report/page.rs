//! The page: sections in reading order, and its frame.

use super::content::{Content, TrajectoryFigure};
use super::html::{self, escape};
use super::{adjustment, convergence, figures, maps, mounting, residual_plots, tables};

/// Colours and type, for screen (light and dark) and print.
const STYLE: &str = include_str!("style.css");

/// The whole page as one HTML document that needs nothing else. Sections without data are left
/// out; equal contents give equal bytes.
pub fn render(content: &Content) -> String {
    let mut links = String::new();
    let mut body = String::new();
    for (id, heading, markup) in sections(content) {
        if markup.is_empty() {
            continue;
        }
        links.push_str(&format!("<li><a href=\"#{id}\">{heading}</a></li>\n"));
        body.push_str(&html::section(id, heading, &markup));
    }
    let title = escape(&content.title);
    let nav = if links.is_empty() {
        String::new()
    } else {
        format!("<nav aria-label=\"Contents\"><ul>\n{links}</ul></nav>\n")
    };
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n\
         <meta name=\"color-scheme\" content=\"light dark\"/>\n<title>{title}</title>\n\
         <style>\n{STYLE}</style>\n</head>\n<body>\n<header>\n<h1>{title}</h1>\n{}</header>\n\
         <main>\n{}{nav}{body}</main>\n</body>\n</html>\n",
        tables::provenance(content),
        html::verdicts(&content.summary),
    )
}

/// Identifier, heading and markup of each section, empty where there are no data.
fn sections(content: &Content) -> Vec<(&'static str, &'static str, String)> {
    let trajectory = content.trajectory.as_ref();
    let residuals = content.residuals.as_ref();
    let correlation = content.correlation.as_ref();
    vec![
        ("mounting", "Mounting", mounting::tables(&content.mountings)),
        (
            "distances",
            "Agreement of the point clouds",
            tables::distances(&content.distances),
        ),
        (
            "maps",
            "Where they agree and where not",
            maps::maps(&content.maps),
        ),
        (
            "observability",
            "What the data could determine",
            html::verdicts(&content.observability),
        ),
        (
            "residuals",
            "Is the mounting constant?",
            residuals.map(figures::residuals).unwrap_or_default(),
        ),
        (
            "trajectory",
            "Trajectory",
            trajectory.map(trajectory_section).unwrap_or_default(),
        ),
        (
            "convergence",
            "Convergence and methods",
            convergence::section(&content.methods),
        ),
        (
            "correlation",
            "Correlations of the parameters",
            correlation.map(correlations).unwrap_or_default(),
        ),
        ("inputs", "Input", tables::facts(&content.inputs)),
        (
            "resources",
            "Time and memory",
            tables::resources(&content.stages, content.peak_memory_bytes),
        ),
        ("warnings", "Warnings", tables::warnings(&content.warnings)),
    ]
}

/// The drives from above, then how the adjustment went and how well the poses are known.
fn trajectory_section(figure: &TrajectoryFigure) -> String {
    adjustment::words(figure)
        + &figures::top_view(figure)
        + &figures::pose_sigmas(figure)
        + &adjustment::tables(figure)
        + &residual_plots::over_time(figure)
        + &residual_plots::histograms(figure)
        + &residual_plots::biases(figure)
}

fn correlations(matrix: &super::content::CorrelationMatrix) -> String {
    let table = tables::correlation(matrix);
    if table.is_empty() {
        return table;
    }
    table
        + "<p class=\"note\">Red: the two grow together; blue: one grows as the other falls. Beyond about 0.9 the data can hardly tell them apart. A dash: not estimated.</p>\n"
}
