//! The HTML page and its sections in reading order.

use super::content::{Calibrations, Content};
use super::html::{self, escape};
use super::track::Track;
use super::{
    adjustment, convergence, figures, joint, joint_figures, maps, mounting, relative,
    residual_plots, scene, tables, verdicts,
};
use crate::calibration::Method;
use crate::geometry::Vec3;
use crate::verdict::Headline;

/// Colours and type, for screen (light and dark) and print.
const STYLE: &str = include_str!("style.css");

/// Renders the page as one self-contained HTML document. Sections without data are left
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
         <main>\n{}{}{nav}{body}</main>\n</body>\n</html>\n",
        tables::provenance(content),
        headline(content),
        html::verdicts(&content.verdicts),
    )
}

/// What all verdicts come to (markup); empty without any.
fn headline(content: &Content) -> String {
    let headline = Headline::of(&content.verdicts);
    let class = match headline {
        Headline::Usable => "good",
        Headline::Care => "attention",
        Headline::Unusable => "fault",
    };
    match content.verdicts.is_empty() {
        true => String::new(),
        false => format!(
            "<p class=\"headline {class}\">Result: {}</p>\n",
            headline.text()
        ),
    }
}

/// Identifier, heading and markup of each section; the markup is empty without data.
fn sections(content: &Content) -> Vec<(&'static str, &'static str, String)> {
    let tracks: Vec<Track> = content.drives.iter().map(Track::of).collect();
    let calibrations = content.calibrations.as_ref();
    let result = calibrations.map(|calibrations| calibrations.result);
    vec![
        (
            "mounting",
            "Mounting",
            calibrations.map_or_else(String::new, |calibrations| {
                mounting::tables(calibrations) + &relative::tables(calibrations)
            }),
        ),
        (
            "distances",
            "Agreement of the point clouds",
            tables::distances(content.drives),
        ),
        ("maps", "Maps of the distances", maps::maps(content.drives)),
        (
            "scene",
            "The clouds in three dimensions",
            scene::section(content.drives),
        ),
        (
            "observability",
            "What the data could determine",
            calibrations.map_or_else(String::new, |calibrations| {
                html::verdicts(&verdicts::observability(calibrations))
            }),
        ),
        (
            "tests",
            "Do the sensors agree with each other?",
            calibrations.map(joint::section).unwrap_or_default(),
        ),
        (
            "residuals",
            "Is the mounting constant?",
            result.map(figures::residuals).unwrap_or_default(),
        ),
        (
            "trajectory",
            "Trajectory",
            trajectory(&tracks, content.background_m, calibrations),
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

/// The drives from above, the course of the adjustment, and the uncertainty of the poses.
fn trajectory(
    tracks: &[Track],
    background_m: &[Vec3],
    calibrations: Option<&Calibrations>,
) -> String {
    let joint = calibrations.map(|calibrations| joint_figures::figures(calibrations, tracks));
    let is_joint = calibrations.is_some_and(|c| c.result.method == Method::Joint);
    let origin = match is_joint {
        true => {
            "<p>The poses and their standard deviations are those of the joint adjustment. Residuals by sensor, constants and rejected measurements are those of the trajectory alone, from which it started.</p>\n"
        }
        false => "",
    };
    origin.to_owned()
        + &adjustment::statements(tracks)
        + &figures::top_view(tracks, background_m)
        + &figures::pose_sigmas(tracks)
        + &joint.unwrap_or_default()
        + &adjustment::tables(tracks)
        + &residual_plots::over_time(tracks)
        + &residual_plots::histograms(tracks)
        + &residual_plots::biases(tracks)
}
