//! The page: sections in reading order, and its frame.

use super::content::Content;
use super::html::{self, escape};
use super::track::Track;
use super::{adjustment, convergence, figures, maps, mounting, residual_plots, tables, verdicts};
use crate::geometry::Vec3;

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
        html::verdicts(&verdicts::summary(content)),
    )
}

/// Identifier, heading and markup of each section, empty where there are no data.
fn sections(content: &Content) -> Vec<(&'static str, &'static str, String)> {
    let tracks: Vec<Track> = content.drives.iter().map(Track::of).collect();
    let calibrations = content.calibrations.as_ref();
    let result = calibrations.map(|calibrations| calibrations.result);
    vec![
        (
            "mounting",
            "Mounting",
            calibrations.map(mounting::tables).unwrap_or_default(),
        ),
        (
            "distances",
            "Agreement of the point clouds",
            tables::distances(content.drives),
        ),
        (
            "maps",
            "Where they agree and where not",
            maps::maps(content.drives),
        ),
        (
            "observability",
            "What the data could determine",
            calibrations.map_or_else(String::new, |calibrations| {
                html::verdicts(&verdicts::observability(calibrations))
            }),
        ),
        (
            "residuals",
            "Is the mounting constant?",
            result.map(figures::residuals).unwrap_or_default(),
        ),
        (
            "trajectory",
            "Trajectory",
            trajectory(&tracks, content.background_m),
        ),
        (
            "convergence",
            "Convergence and methods",
            calibrations.map(convergence::section).unwrap_or_default(),
        ),
        (
            "correlation",
            "Correlations of the parameters",
            result.map(tables::correlation).unwrap_or_default(),
        ),
        ("inputs", "Input", tables::facts(&content.inputs)),
        (
            "resources",
            "Time and memory",
            tables::resources(content.stages, content.peak_memory_bytes),
        ),
        ("warnings", "Warnings", tables::warnings(content.warnings)),
    ]
}

/// The drives from above, then how the adjustment went and how well the poses are known.
fn trajectory(tracks: &[Track], background_m: &[Vec3]) -> String {
    adjustment::words(tracks)
        + &figures::top_view(tracks, background_m)
        + &figures::pose_sigmas(tracks)
        + &adjustment::tables(tracks)
        + &residual_plots::over_time(tracks)
        + &residual_plots::histograms(tracks)
        + &residual_plots::biases(tracks)
}
