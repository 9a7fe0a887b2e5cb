//! The first screen of the page: headline with reasons, mountings, platform, a map, and all verdicts.

use super::axis::Axis;
use super::chart::Plot;
use super::content::Content;
use super::html::{self, escape};
use super::platform::{self, Fan};
use super::tables::mounting_name;
use super::{maps, mounting};
use crate::comparison::{Against, Agreements, MountingKind};
use crate::number;
use crate::results::Calibrations;
use crate::verdict::{Headline, Severity, Verdict};

/// The first screen; empty if it has no content.
pub fn screen(content: &Content) -> String {
    let pictures: String = [mountings(content), drawing(content), map(content)]
        .into_iter()
        .filter(|picture| !picture.is_empty())
        .map(|picture| format!("<div>{picture}</div>\n"))
        .collect();
    let pictures = if pictures.is_empty() {
        pictures
    } else {
        format!("<div class=\"screen\">\n{pictures}</div>\n")
    };
    headline(content) + &pictures + &all_verdicts(&content.verdicts)
}

/// The summary of all verdicts with its reasons (markup); empty without any.
fn headline(content: &Content) -> String {
    if content.verdicts.is_empty() {
        return String::new();
    }
    let headline = Headline::of(&content.verdicts);
    let class = match headline {
        Headline::Usable => "good",
        Headline::Care => "attention",
        Headline::Unusable => "fault",
    };
    format!(
        "<p class=\"headline {class}\">Result: {}</p>\n<p class=\"why\">{}</p>\n",
        headline.text(),
        escape(&reasons(content))
    )
}

/// The reasons for the headline.
fn reasons(content: &Content) -> String {
    let marked: Vec<&Verdict> = content
        .verdicts
        .iter()
        .filter(|verdict| verdict.severity.is_marked())
        .collect();
    match marked.as_slice() {
        [] => {
            let agreement = agreement(content);
            let known = content
                .verdicts
                .iter()
                .find(|verdict| verdict.code == "mounting.sigma");
            let known = known.map(|verdict| verdict.text.clone());
            let parts: Vec<String> = agreement.into_iter().chain(known).collect();
            format!(
                "Nothing that was tested contradicts it. {}",
                parts.join(" ")
            )
        }
        [only] => only.text.clone(),
        [first, others @ ..] => format!("{} And {} more below.", first.text, others.len()),
    }
}

/// The largest distances of the first drive's clouds, in a sentence.
fn agreement(content: &Content) -> Option<String> {
    let all = &content.drives.first()?.agreements;
    let with_reference = |is_reference: bool| {
        let agreements = all.under(MountingKind::Final);
        let agreements = agreements
            .filter(|agreement| (agreement.against == Against::Reference) == is_reference);
        let sizes =
            agreements.map(|agreement| (agreement.statistics.rmse_m, agreement.statistics.nmad_m));
        sizes.max_by(|a, b| a.0.total_cmp(&b.0))
    };
    let text = |(rmse_m, nmad_m): (f64, f64)| {
        let [rmse, nmad] = [rmse_m, nmad_m].map(number::length);
        format!("{rmse} (RMSE; NMAD {nmad})")
    };
    match (
        with_reference(true).map(text),
        with_reference(false).map(text),
    ) {
        (Some(reference), Some(scanners)) => Some(format!(
            "The clouds agree with the reference to {reference} or better, and with each other to {scanners}."
        )),
        (Some(only), None) => Some(format!(
            "The clouds agree with the reference to {only} or better."
        )),
        (None, Some(only)) => Some(format!("The clouds agree with each other to {only}.")),
        (None, None) => all.final_passes().map(|passes| {
            let median = number::length(passes.median_m);
            format!("Passes over the same ground lie {median} apart in the median.")
        }),
    }
}

/// The mountings of the result.
fn mountings(content: &Content) -> String {
    let Some(calibrations) = &content.calibrations else {
        return String::new();
    };
    "<h3>Mounting on the body</h3>\n".to_owned() + &mounting::brief(&calibrations.result)
}

fn drawing(content: &Content) -> String {
    let (Some(calibrations), Some(platform)) = (&content.calibrations, &content.platform) else {
        return String::new();
    };
    let fans = fans(calibrations);
    "<h3>Platform</h3>\n".to_owned() + &platform::drawing(platform, &fans)
}

fn fans(calibrations: &Calibrations) -> Vec<Fan<'_>> {
    let initial = calibrations.mountings(MountingKind::Initial);
    let scanners = calibrations.result.mountings.iter().enumerate();
    scanners
        .map(|(i, mounting)| Fan {
            name: &mounting.name,
            before: initial.and_then(|initial| initial.get(i).copied()),
            after: mounting.body_from_scanner,
        })
        .collect()
}

/// The map of the remaining distances between the first pair of clouds; if there are no two clouds, how far passes lie
/// apart.
fn map(content: &Content) -> String {
    let Some(drive) = content.drives.first() else {
        return String::new();
    };
    let mut agreements = drive.agreements.under(MountingKind::Final);
    match agreements.next() {
        Some(agreement) => maps::alone(agreement),
        None => passes(&drive.agreements),
    }
}

/// Width of the figure of passes and height of its rows.
const PASSES_WIDTH: f64 = 420.0;
const PASSES_ROW: f64 = 34.0;

/// How far passes over the same ground lie apart, before and after.
fn passes(agreements: &Agreements) -> String {
    if agreements.final_passes().is_none() {
        return String::new();
    }
    let is_joint = agreements.passes_of(MountingKind::TwoStep, false).is_some();
    let names = agreements.passes.iter().map(|passes| {
        let name = mounting_name(passes.mounting, is_joint);
        let poses = if passes.on_given_poses {
            ", given poses"
        } else {
            ""
        };
        let median = number::length(passes.distances.median_m);
        format!("{name}{poses}: {median}")
    });
    let all = agreements.passes.iter();
    let medians_mm: Vec<f64> = all.map(|p| 1e3 * p.distances.median_m).collect();
    let ends = medians_mm.iter().copied().chain([0.0]);
    let x = Axis::over("median distance between passes, mm", ends);
    let mut plot = Plot::rows(PASSES_WIDTH, PASSES_ROW, &names.collect::<Vec<_>>(), x);
    for (row, median_mm) in medians_mm.into_iter().enumerate() {
        plot.span("there", (0.0, median_mm), row as f64, 10.0);
    }
    "<h3>Passes over the same ground</h3>\n".to_owned()
        + &html::figure(
            &plot.finish("How far passes over the same ground lie apart"),
            "How far passes of a scanner over the same ground lie apart, along the normal; the smaller, the better.",
        )
}

/// All verdicts: those that need attention, good results, information, and, separately, those on other drives and runs.
fn all_verdicts(verdicts: &[Verdict]) -> String {
    let (main, beside): (Vec<_>, Vec<_>) =
        verdicts.iter().partition(|verdict| verdict.about.is_none());
    let beside = by_weight(&beside);
    by_weight(&main)
        + &if beside.is_empty() {
            beside
        } else {
            format!("<h3>Other drives and runs</h3>\n{beside}")
        }
}

/// Verdicts that need attention one by one, and the rest in brief, good results first.
fn by_weight(verdicts: &[&Verdict]) -> String {
    let with_severity = |wanted: &dyn Fn(Severity) -> bool| -> Vec<Verdict> {
        let chosen = verdicts.iter().filter(|verdict| wanted(verdict.severity));
        chosen.copied().cloned().collect()
    };
    let marked = with_severity(&Severity::is_marked);
    let mut rest = with_severity(&|severity| severity == Severity::Good);
    rest.extend(with_severity(&|severity| severity == Severity::Note));
    html::verdicts(&marked) + &html::brief(&rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_matters_most_stands_first_and_other_drives_apart() {
        let verdicts = [
            Verdict::care("a", "careful"),
            Verdict::care("a", "elsewhere").on("drive-2"),
            Verdict::note("b", "noted"),
            Verdict::good("c", "fine"),
        ];
        let page = all_verdicts(&verdicts);
        let place = |text: &str| page.find(text).unwrap();
        let order = ["careful", "fine", "noted", "Other drives", "elsewhere"].map(place);
        assert!(order.is_sorted(), "{page}");
    }

    #[test]
    fn the_reason_is_that_of_the_gravest() {
        let verdicts = vec![Verdict::fault("a", "Broken."), Verdict::care("b", "Bent.")];
        let content = Content {
            verdicts,
            ..Content::default()
        };
        assert_eq!(reasons(&content), "Broken. And 1 more below.");
        let page = headline(&content);
        assert!(
            page.contains("not usable") && page.contains("fault"),
            "{page}"
        );
    }
}
