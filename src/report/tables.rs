//! The tables of the page.

use super::content::{Content, CorrelationMatrix, DistanceRow, Fact, MountingKind, StageTime};
use super::html::{self, escape};
use super::number::{self, DASH};
use super::raster;

/// Name of a mounting in tables and figures.
pub fn mounting_name(kind: MountingKind) -> &'static str {
    match kind {
        MountingKind::Initial => "initial",
        MountingKind::Final => "calibrated",
        MountingKind::Truth => "true mounting",
    }
}

/// Labels and their values.
pub fn facts(list: &[Fact]) -> String {
    if list.is_empty() {
        return String::new();
    }
    let mut out = String::from("<dl class=\"facts\">\n");
    for fact in list {
        out.push_str(&format!(
            "<div><dt>{}</dt><dd>{}</dd></div>\n",
            escape(&fact.label),
            escape(&fact.value)
        ));
    }
    out.push_str("</dl>\n");
    out
}

/// The pairs of clouds in the order of their first rows.
fn pairs(rows: &[DistanceRow]) -> Vec<&str> {
    let mut pairs: Vec<&str> = Vec::new();
    for row in rows {
        if !pairs.contains(&row.pair.as_str()) {
            pairs.push(&row.pair);
        }
    }
    pairs
}

/// Table II: the RMSE of every pair and drive, and all statistics folded below.
pub fn distances(rows: &[DistanceRow]) -> String {
    if rows.is_empty() {
        return String::new();
    }
    rmse(rows)
        + "<p class=\"note\">Root mean square of the signed M3C2 distances over the core points. The true mounting, where it is listed, is applied on the same estimated poses: what it leaves is the share of poses and noise. Table II of the paper.</p>\n"
        + &html::details(
            "Mean, standard deviation, median, number of core points",
            &statistics(rows),
        )
}

/// RMSE before and after.
fn rmse(rows: &[DistanceRow]) -> String {
    let known = rows.iter().any(|row| row.mounting == MountingKind::Truth);
    let mut heads = vec!["clouds", "drive", "initial", "calibrated"];
    if known {
        heads.push("true mounting");
    }
    let mut head = String::from("<tr>");
    for (i, text) in heads.iter().enumerate() {
        let unit = if i < 2 { "" } else { "<br/><small>mm</small>" };
        let class = if i < 2 { " class=\"text\"" } else { "" };
        head.push_str(&format!("<th scope=\"col\"{class}>{text}{unit}</th>"));
    }
    head.push_str("<th scope=\"col\">times better</th></tr>\n");
    let mut body = String::new();
    for pair in pairs(rows) {
        let of_pair: Vec<&DistanceRow> = rows.iter().filter(|r| r.pair == pair).collect();
        let mut drives: Vec<&str> = of_pair.iter().map(|r| r.drive.as_str()).collect();
        drives.dedup();
        for (i, drive) in drives.iter().enumerate() {
            let find = |kind: MountingKind| {
                let mut all = of_pair.iter();
                all.find(|r| r.drive == *drive && r.mounting == kind)
                    .map_or(f64::NAN, |r| r.statistics.rmse_m)
            };
            let (first, last) = (find(MountingKind::Initial), find(MountingKind::Final));
            let is_first = i == 0;
            body.push_str(&format!(
                "<tr class=\"{}\"><th scope=\"row\">{}</th><td class=\"text\">{}</td><td>{}</td><td class=\"result\">{}</td>",
                if is_first { "first" } else { "" },
                if is_first { escape(pair) } else { String::new() },
                escape(drive),
                number::millimetres(first),
                number::millimetres(last)
            ));
            if known {
                let truth = number::millimetres(find(MountingKind::Truth));
                body.push_str(&format!("<td>{truth}</td>"));
            }
            body.push_str(&format!(
                "<td>{}</td></tr>\n",
                number::significant(first / last, 2)
            ));
        }
    }
    html::table("numbers rmse", &head, &body)
}

/// One table a pair of clouds.
fn statistics(rows: &[DistanceRow]) -> String {
    let mut out = String::new();
    for pair in pairs(rows) {
        let of_pair: Vec<&DistanceRow> = rows.iter().filter(|r| r.pair == pair).collect();
        let mut body = String::new();
        let mut previous: Option<&str> = None;
        for row in of_pair {
            let s = &row.statistics;
            let is_first = previous != Some(row.drive.as_str());
            let drive = if is_first {
                escape(&row.drive)
            } else {
                String::new()
            };
            previous = Some(&row.drive);
            let mut classes = Vec::new();
            if is_first {
                classes.push("first");
            }
            if row.mounting == MountingKind::Final {
                classes.push("result");
            }
            body.push_str(&format!(
                "<tr class=\"{}\"><th scope=\"row\">{drive}</th><td class=\"text\">{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n",
                classes.join(" "),
                mounting_name(row.mounting),
                number::signed(number::millimetres(s.mean_m)),
                number::millimetres(s.std_m),
                number::millimetres(s.rmse_m),
                number::signed(number::millimetres(s.median_m)),
                number::count(s.n)
            ));
        }
        let head = "<tr><th scope=\"col\">drive</th><th scope=\"col\" class=\"text\">mounting</th><th scope=\"col\">mean<br/><small>mm</small></th><th scope=\"col\">std<br/><small>mm</small></th><th scope=\"col\">RMSE<br/><small>mm</small></th><th scope=\"col\">median<br/><small>mm</small></th><th scope=\"col\">core points<br/><small>n</small></th></tr>\n";
        out.push_str(&format!("<h3>{}</h3>\n", escape(pair)));
        out.push_str(&html::table("numbers distances", head, &body));
    }
    out
}

/// Correlations as a table coloured by sign and size.
pub fn correlation(matrix: &CorrelationMatrix) -> String {
    let n = matrix.labels.len();
    if n == 0 {
        return String::new();
    }
    // A label breaks before its last word: "left" over "tx".
    let label = |text: &str| match text.rsplit_once(' ') {
        Some((before, last)) => format!("{}<br/>{}", escape(before), escape(last)),
        None => escape(text),
    };
    let mut head = String::from("<tr><td></td>");
    for text in &matrix.labels {
        head.push_str(&format!("<th scope=\"col\">{}</th>", label(text)));
    }
    head.push_str("</tr>\n");
    let mut body = String::new();
    for (i, text) in matrix.labels.iter().enumerate() {
        body.push_str(&format!("<tr><th scope=\"row\">{}</th>", escape(text)));
        for j in 0..n {
            let value = matrix.values.get(i).and_then(|row| row.get(j)).copied();
            match value.filter(|v| v.is_finite()) {
                None => body.push_str(&format!("<td class=\"none\">{DASH}</td>")),
                Some(_) if i == j => body.push_str("<td class=\"self\">1</td>"),
                Some(v) => {
                    let [r, g, b] = raster::diverging(0.75f64.copysign(v));
                    let alpha = v.abs().min(1.0) * 0.75;
                    body.push_str(&format!(
                        "<td style=\"background:rgba({r},{g},{b},{alpha:.2})\">{}</td>",
                        number::fixed(v, 2)
                    ));
                }
            }
        }
        body.push_str("</tr>\n");
    }
    html::table("heat", &head, &body)
}

/// Run time by stage with bars, and peak memory.
pub fn resources(stages: &[StageTime], peak_memory_bytes: Option<u64>) -> String {
    let mut out = String::new();
    if !stages.is_empty() {
        let usable = |s: &StageTime| {
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

/// What the run was: command, project, seed, program, date.
pub fn provenance(content: &Content) -> String {
    let mut list = Vec::new();
    let mut add = |label: &str, value: &str| {
        if !value.is_empty() {
            list.push(format!("<span>{label} <b>{}</b></span>", escape(value)));
        }
    };
    add("project", &content.project);
    add("command", &content.command);
    add(
        "seed",
        &content.seed.map_or(String::new(), |s| s.to_string()),
    );
    add("by", &content.version);
    add("on", &content.date);
    if list.is_empty() {
        return String::new();
    }
    format!("<p class=\"provenance\">{}</p>\n", list.join("\n"))
}
