//! Provenance of the results: author, time, program, command, and input files.

use super::content::{Content, Fact, InputFile};
use super::html::{self, escape};
use crate::format::civil_time;
use crate::number::{self, DASH};

/// The paper that describes the method.
const PAPER: &str =
    "<a href=\"https://arxiv.org/abs/2403.17788\">Esser et al. 2024, arXiv 2403.17788</a>";

/// The logo (markup); empty without one.
pub fn logo(content: &Content) -> String {
    let organisation = content.imprint.organisation.as_deref().unwrap_or_default();
    content.logo.as_ref().map_or_else(String::new, |uri| {
        format!(
            "<img class=\"logo\" src=\"{}\" alt=\"{}\"/>\n",
            escape(uri),
            escape(organisation)
        )
    })
}

/// Author, date, project, command, seed, program and method.
pub fn lines(content: &Content) -> String {
    let imprint = &content.imprint;
    let by: Vec<&str> = [&imprint.author, &imprint.organisation]
        .into_iter()
        .flatten()
        .map(String::as_str)
        .collect();
    let byline = if by.is_empty() {
        String::new()
    } else {
        format!("<p class=\"byline\">{}</p>\n", escape(&by.join(", ")))
    };
    let mut list = Vec::new();
    let mut add = |label: &str, value: &str| {
        if !value.is_empty() {
            list.push(format!("<span>{label} <b>{}</b></span>", escape(value)));
        }
    };
    let made = content.made_s.map(|made_s| civil_time(made_s) + " UTC");
    add("", &made.unwrap_or_default());
    add("project", &content.project);
    add("command", &content.command);
    add(
        "seed",
        &content.seed.map_or(String::new(), |s| s.to_string()),
    );
    add("by", concat!("boresight ", env!("CARGO_PKG_VERSION")));
    if content.calibrations.is_some() {
        list.push(format!("<span>method after {PAPER}</span>"));
    }
    format!("{byline}<p class=\"provenance\">{}</p>\n", list.join("\n"))
}

/// The inputs, and the files with their checksums.
pub fn inputs(content: &Content) -> String {
    facts(&content.inputs) + &html::details("Files and checksums", &files(&content.files))
}

fn files(files: &[InputFile]) -> String {
    if files.is_empty() {
        return String::new();
    }
    let mut body = String::new();
    for file in files {
        let hash = file.xxh128.map(|hash| format!("{hash:032x}"));
        body.push_str(&format!(
            "<tr><td class=\"text path\">{}</td><td>{}</td><td><code>{}</code></td></tr>\n",
            escape(&file.path),
            number::count(file.bytes as usize),
            hash.unwrap_or_else(|| DASH.into())
        ));
    }
    let head = "<tr><th scope=\"col\" class=\"text\">file</th><th scope=\"col\">bytes</th><th scope=\"col\">XXH128</th></tr>\n";
    html::table("numbers files", head, &body)
        + "<p class=\"note\">When the run began; <code>xxhsum -H2 FILE</code> prints the same.</p>\n"
}

/// Labels and their values.
fn facts(list: &[Fact]) -> String {
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
