//! The tables of the page.

use super::html::{self, escape};
use super::raster;
use crate::calibration::{Calibration, Method};
use crate::comparison::{Agreement, MountingKind};
use crate::number::{self, DASH};
use crate::progress::StageSeconds;
use crate::results::Drive;

/// A pair of clouds, and its comparisons by the name of the drive.
type Pair<'a> = (String, Vec<(&'a str, &'a [Agreement])>);

/// The pairs of clouds in the order in which they first occur.
fn pairs(drives: &[Drive]) -> Vec<Pair<'_>> {
    let mut pairs: Vec<Pair> = Vec::new();
    for drive in drives {
        for agreements in drive.agreements.pairs() {
            let name = agreements[0].pair();
            let of_drive = (drive.name.as_str(), agreements);
            match pairs.iter_mut().find(|(pair, _)| *pair == name) {
                Some((_, drives)) => drives.push(of_drive),
                None => pairs.push((name, vec![of_drive])),
            }
        }
    }
    pairs
}

/// Table II: the RMSE of every pair and drive, and all statistics folded below.
pub fn distances(drives: &[Drive]) -> String {
    let pairs = pairs(drives);
    if pairs.is_empty() {
        return String::new();
    }
    rmse(&pairs)
        + "<p class=\"note\">Root mean square of the signed M3C2 distances over the core points, and beside it, in grey, their normalised median absolute deviation (NMAD), which single places do not move. Two steps use the poses of the trajectory alone, the joint adjustment its own. The column of the true mounting, if shown, uses the same poses as the result: its distances are due to poses and noise alone. Table II of the paper.</p>\n"
        + &html::details(
            "Mean, standard deviation, median, number of core points",
            &statistics(&pairs),
        )
}

/// Name of a method in tables and figures.
pub fn method_name(method: Method) -> &'static str {
    match method {
        Method::TwoStep => "two steps",
        Method::Joint => "joint adjustment",
        Method::Paper => "as in the paper",
    }
}

/// Name of a mounting in tables and maps. If two steps are shown too, the result is that of the joint adjustment.
pub fn mounting_name(kind: MountingKind, is_joint: bool) -> &'static str {
    match kind {
        MountingKind::Final if is_joint => "joint adjustment",
        other => other.name(),
    }
}

/// RMSE by mounting.
fn rmse(pairs: &[Pair]) -> String {
    let has = |kind: MountingKind| {
        let mut all = pairs.iter().flat_map(|(_, drives)| drives);
        all.any(|(_, agreements)| agreements.iter().any(|f| f.mounting == kind))
    };
    let kinds = [
        MountingKind::Initial,
        MountingKind::TwoStep,
        MountingKind::Final,
        MountingKind::Truth,
    ];
    let always = [MountingKind::Initial, MountingKind::Final];
    let kinds = kinds.into_iter().filter(|k| always.contains(k) || has(*k));
    let kinds: Vec<MountingKind> = kinds.collect();
    let is_joint = has(MountingKind::TwoStep);
    let mut head = String::from(
        "<tr><th scope=\"col\" class=\"text\">clouds</th><th scope=\"col\" class=\"text\">drive</th>",
    );
    for kind in &kinds {
        let class = match kind {
            MountingKind::Final => " class=\"result\"",
            _ => "",
        };
        head.push_str(&format!(
            "<th scope=\"col\"{class}>{}<br/><small>mm</small></th>",
            mounting_name(*kind, is_joint)
        ));
    }
    head.push_str("<th scope=\"col\">times better</th></tr>\n");
    let mut body = String::new();
    for (pair, drives) in pairs {
        for (i, (drive, all)) in drives.iter().enumerate() {
            let find = |kind: MountingKind| {
                let agreement = all.iter().find(|agreement| agreement.mounting == kind);
                let statistics = agreement.map(|agreement| &agreement.statistics);
                statistics.map_or([f64::NAN; 2], |s| [s.rmse_m, s.nmad_m])
            };
            let [first, _] = find(MountingKind::Initial);
            let [last, _] = find(MountingKind::Final);
            let is_first = i == 0;
            body.push_str(&format!(
                "<tr class=\"{}\"><th scope=\"row\">{}</th><td class=\"text\">{}</td>",
                if is_first { "first" } else { "" },
                if is_first {
                    escape(pair)
                } else {
                    String::new()
                },
                escape(drive),
            ));
            for kind in &kinds {
                let class = match kind {
                    MountingKind::Final => " class=\"result\"",
                    _ => "",
                };
                let [rmse, nmad] = find(*kind).map(number::millimetres);
                body.push_str(&format!(
                    "<td{class}>{rmse} <span class=\"sigma\">{nmad}</span></td>"
                ));
            }
            body.push_str(&format!(
                "<td>{}</td></tr>\n",
                number::significant(first / last, 2)
            ));
        }
    }
    html::table("numbers rmse", &head, &body)
}

/// One table per pair of clouds.
fn statistics(pairs: &[Pair]) -> String {
    let mut out = String::new();
    for (pair, drives) in pairs {
        let mut body = String::new();
        for (drive, all) in drives {
            let is_joint = all.iter().any(|f| f.mounting == MountingKind::TwoStep);
            for (i, agreement) in all.iter().enumerate() {
                let s = &agreement.statistics;
                let mut classes = Vec::new();
                if i == 0 {
                    classes.push("first");
                }
                if agreement.mounting == MountingKind::Final {
                    classes.push("result");
                }
                body.push_str(&format!(
                    "<tr class=\"{}\"><th scope=\"row\">{}</th><td class=\"text\">{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n",
                    classes.join(" "),
                    if i == 0 { escape(drive) } else { String::new() },
                    mounting_name(agreement.mounting, is_joint),
                    number::signed(number::millimetres(s.mean_m)),
                    number::millimetres(s.std_m),
                    number::millimetres(s.rmse_m),
                    number::signed(number::millimetres(s.median_m)),
                    number::count(s.n)
                ));
            }
        }
        let head = "<tr><th scope=\"col\">drive</th><th scope=\"col\" class=\"text\">mounting</th><th scope=\"col\">mean<br/><small>mm</small></th><th scope=\"col\">std<br/><small>mm</small></th><th scope=\"col\">RMSE<br/><small>mm</small></th><th scope=\"col\">median<br/><small>mm</small></th><th scope=\"col\">core points<br/><small>n</small></th></tr>\n";
        out.push_str(&format!("<h3>{}</h3>\n", escape(pair)));
        out.push_str(&html::table("numbers distances", head, &body));
    }
    out
}

/// Correlations of the mountings' parameters as a table coloured by sign and size; empty without a
/// covariance.
pub fn correlation(calibration: &Calibration) -> String {
    let Some(correlation) = calibration.correlation() else {
        return String::new();
    };
    // Rotations are about the body's axes, whatever the Euler convention.
    let names = ["tx", "ty", "tz", "about x", "about y", "about z"];
    let scanners = calibration.mountings.iter().map(|m| escape(&m.name));
    let labels: Vec<(String, &str)> = scanners
        .flat_map(|scanner| names.map(|name| (scanner.clone(), name)))
        .collect();
    let mut head = String::from("<tr><td></td>");
    for (scanner, name) in &labels {
        head.push_str(&format!("<th scope=\"col\">{scanner}<br/>{name}</th>"));
    }
    head.push_str("</tr>\n");
    let mut body = String::new();
    for (i, (scanner, name)) in labels.iter().enumerate() {
        body.push_str(&format!("<tr><th scope=\"row\">{scanner} {name}</th>"));
        for j in 0..labels.len() {
            let value = correlation[(i, j)];
            if !value.is_finite() {
                body.push_str(&format!("<td class=\"none\">{DASH}</td>"));
            } else if i == j {
                body.push_str("<td class=\"self\">1</td>");
            } else {
                let [r, g, b] = raster::diverging(0.75f64.copysign(value));
                let alpha = value.abs().min(1.0) * 0.75;
                body.push_str(&format!(
                    "<td style=\"background:rgba({r},{g},{b},{alpha:.2})\">{}</td>",
                    number::fixed(value, 2)
                ));
            }
        }
        body.push_str("</tr>\n");
    }
    html::table("heat", &head, &body)
        + "<p class=\"note\">Red: positive; blue: negative. Beyond about ± 0.9 the data hardly separate the two parameters. A dash: not estimated.</p>\n"
}

/// Run time by stage with bars, and peak memory.
pub fn resources(stages: &[StageSeconds], peak_memory_bytes: Option<u64>) -> String {
    let mut out = String::new();
    if !stages.is_empty() {
        let usable = |s: &StageSeconds| {
            if s.seconds.is_finite() {
                s.seconds
            } else {
                0.0
            }
        };
        let total: f64 = stages.iter().map(usable).sum();
        let longest = stages.iter().map(usable).fold(1e-9, f64::max);
        let mut body = String::new();
        for stage in stages {
            body.push_str(&format!(
                "<tr><th scope=\"row\">{}</th><td>{}</td><td class=\"bar\"><span style=\"width:{:.1}%\"></span></td></tr>\n",
                escape(&stage.name),
                number::duration(stage.seconds),
                100.0 * usable(stage) / longest
            ));
        }
        body.push_str(&format!(
            "<tr class=\"total\"><th scope=\"row\">all stages</th><td>{}</td><td></td></tr>\n",
            number::duration(total)
        ));
        let head = html::head(&["stage", "time", ""]);
        out.push_str(&html::table("numbers stages", &head, &body));
        out.push_str("<p class=\"note\">Each in the run that finished it.</p>\n");
    }
    if let Some(bytes) = peak_memory_bytes {
        out.push_str(&format!("<p>Peak memory: {}.</p>\n", number::memory(bytes)));
    }
    out
}

/// Warnings as a list.
pub fn warnings(list: &[String]) -> String {
    if list.is_empty() {
        return String::new();
    }
    let items: Vec<String> = list
        .iter()
        .map(|text| format!("<li>{}</li>\n", escape(text)))
        .collect();
    format!("<ul class=\"warnings\">\n{}</ul>\n", items.concat())
}
