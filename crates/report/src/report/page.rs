//! The HTML page and its sections in reading order.

use super::content::Content;
use super::html::{self, escape};
use super::track::Track;
use super::{
    adjustment, comparison, convergence, csv, detection, figures, first, joint, joint_figures,
    maps, mounting, pose_errors, precision, provenance, relative, residual_plots, scene, tables,
    timeline,
};
use crate::calibration::Method;
use crate::judgement;
use crate::results::Calibrations;

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
        body.push_str(&html::section(
            id,
            heading,
            &(markup + &numbers(id, content)),
        ));
    }
    let title = escape(content.imprint.title.as_ref().unwrap_or(&content.title));
    let nav = if links.is_empty() {
        String::new()
    } else {
        format!("<nav aria-label=\"Contents\"><ul>\n{links}</ul></nav>\n")
    };
    let header = format!(
        "{}<h1>{title}</h1>\n{}",
        provenance::logo(content),
        provenance::lines(content)
    );
    document(
        &title,
        &header,
        &format!("{}{nav}{body}", first::screen(content)),
    )
}

/// A self-contained page (all markup).
pub(super) fn document(title: &str, header: &str, main: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n\
         <meta name=\"color-scheme\" content=\"light dark\"/>\n<title>{title}</title>\n\
         <style>\n{STYLE}</style>\n</head>\n<body>\n<header>\n{header}</header>\n\
         <main>\n{main}</main>\n</body>\n</html>\n"
    )
}

/// Links to the files behind the figures of a section; empty without any.
fn numbers(id: &str, content: &Content) -> String {
    let files = csv::FILES.iter();
    let files =
        files.filter(|file| file.section == id && content.csv.iter().any(|name| name == file.name));
    let links: Vec<String> = files
        .map(|file| format!("<a href=\"{0}/{1}\">{1}</a>", csv::FOLDER, file.name))
        .collect();
    if links.is_empty() {
        String::new()
    } else {
        format!(
            "<p class=\"note numbers-of\">Numbers behind the figures, beside this page: {}</p>\n",
            links.join(", ")
        )
    }
}

/// Identifier, heading and markup of each section; the markup is empty without data.
fn sections(content: &Content) -> Vec<(&'static str, &'static str, String)> {
    let tracks: Vec<Track> = content.drives.iter().map(Track::of).collect();
    let calibrations = content.calibrations.as_deref();
    let result = calibrations.map(|calibrations| &calibrations.result);
    vec![
        (
            "mounting",
            "Mounting",
            calibrations.map_or_else(String::new, |calibrations| {
                mounting::tables(calibrations) + &relative::tables(calibrations)
            }),
        ),
        (
            "comparison",
            "Distances between the clouds",
            content
                .comparison
                .as_ref()
                .map(comparison::section)
                .unwrap_or_default(),
        ),
        (
            "pose-errors",
            "Errors of the trajectory",
            content
                .compared_poses
                .as_ref()
                .map(pose_errors::section)
                .unwrap_or_default(),
        ),
        (
            "distances",
            "Agreement of the point clouds",
            tables::distances(&content.drives),
        ),
        (
            "maps",
            "Maps of the distances",
            maps::maps(&content.drives) + &detection::maps(&content.drives, &content.background_m),
        ),
        (
            "scene",
            "The clouds in three dimensions",
            scene::section(&content.drives, &content.scenes),
        ),
        (
            "observability",
            "What the data could determine",
            calibrations.map_or_else(String::new, |calibrations| {
                html::verdicts(&judgement::observability(calibrations))
                    + &precision::figure(calibrations)
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
            trajectory(&tracks, content, calibrations),
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
        ("inputs", "Input", provenance::inputs(content)),
        (
            "resources",
            "Time and memory",
            html::details(
                "Stages",
                &tables::resources(&content.stages, content.peak_memory_bytes),
            ),
        ),
        ("warnings", "Warnings", tables::warnings(&content.warnings)),
    ]
}

/// The drives from above, the course of the adjustment, and the uncertainty of the poses.
fn trajectory(tracks: &[Track], content: &Content, calibrations: Option<&Calibrations>) -> String {
    let joint = calibrations.map(|calibrations| joint_figures::figures(calibrations, tracks));
    let is_joint = calibrations.is_some_and(|c| c.result.method == Method::Joint);
    let origin = if is_joint {
        "<p>The poses and their standard deviations are those of the joint adjustment. Residuals by sensor, constants and rejected measurements are those of the trajectory alone, from which it started.</p>\n"
    } else {
        ""
    };
    origin.to_owned()
        + &adjustment::statements(tracks)
        + &figures::top_view(tracks, &content.background_m)
        + &content
            .drives
            .first()
            .map(|drive| timeline::figure(drive, content.scenes.first().and_then(Option::as_ref)))
            .unwrap_or_default()
        + &figures::pose_sigmas(tracks)
        + &joint.unwrap_or_default()
        + &adjustment::tables(tracks)
        + &residual_plots::over_time(tracks)
        + &residual_plots::histograms(tracks)
        + &html::details("Biases of the IMU", &residual_plots::biases(tracks))
}
