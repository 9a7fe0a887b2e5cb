//! Building blocks of HTML. All external text goes through [`escape`].

use crate::verdict::{Severity, Verdict};

/// `text` with everything that HTML or XML would read as markup replaced, and control characters
/// shown as the replacement character.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            '\n' | '\t' => out.push(c),
            c if c.is_control() => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

/// A section with its heading (text); empty if the body is.
pub fn section(id: &str, heading: &str, body: &str) -> String {
    if body.is_empty() {
        return String::new();
    }
    format!(
        "<section id=\"{id}\">\n<h2>{}</h2>\n{body}</section>\n",
        escape(heading)
    )
}

/// A figure with its caption (markup); scrolls sideways on narrow screens.
pub fn figure(body: &str, caption: &str) -> String {
    format!("<figure tabindex=\"0\">\n{body}<figcaption>{caption}</figcaption>\n</figure>\n")
}

/// A table from finished rows; scrolls sideways on narrow screens.
pub fn table(class: &str, head: &str, body: &str) -> String {
    format!(
        "<div class=\"scroll\" tabindex=\"0\"><table class=\"{class}\">\n<thead>\n{head}</thead>\n<tbody>\n{body}</tbody>\n</table></div>\n"
    )
}

/// A body folded under a summary (text); empty if the body is.
pub fn details(summary: &str, body: &str) -> String {
    if body.is_empty() {
        return String::new();
    }
    format!(
        "<details>\n<summary>{}</summary>\n{body}</details>\n",
        escape(summary)
    )
}

/// A row of column headings (markup).
pub fn head(cells: &[&str]) -> String {
    let mut out = String::from("<tr>");
    for cell in cells {
        out.push_str(&format!("<th scope=\"col\">{cell}</th>"));
    }
    out.push_str("</tr>\n");
    out
}

/// Statements as a list, each with the sign of its severity.
pub fn verdicts(list: &[Verdict]) -> String {
    statements("verdicts", list)
}

/// Statements as a list in small type, for good results and information.
pub fn brief(list: &[Verdict]) -> String {
    statements("verdicts brief", list)
}

fn statements(class: &str, list: &[Verdict]) -> String {
    if list.is_empty() {
        return String::new();
    }
    let mut out = format!("<ul class=\"{class}\">\n");
    for verdict in list {
        let (class, sign, word) = match verdict.severity {
            Severity::Good => ("good", "✓", "good"),
            Severity::Note => ("neutral", "·", "note"),
            Severity::Care => ("attention", "!", "care"),
            Severity::Fault => ("fault", "!", "fault"),
        };
        out.push_str(&format!(
            "<li class=\"{class}\"><span class=\"sign\" role=\"img\" aria-label=\"{word}\">{sign}</span><span>{}</span></li>\n",
            escape(&verdict.text)
        ));
    }
    out.push_str("</ul>\n");
    out
}

/// A scale of colours (CSS) between the texts of its ends (markup).
pub fn ramp(from: &str, colours: &[String], to: &str) -> String {
    format!(
        "<div class=\"heights\">{from} <span class=\"ramp\" style=\"background:linear-gradient(to right,{})\"></span> {to}</div>\n",
        colours.join(",")
    )
}

/// A legend: colour class and text of each entry.
pub fn legend(entries: &[(String, String)]) -> String {
    let mut out = String::from("<ul class=\"legend\">");
    for (class, text) in entries {
        out.push_str(&format!(
            "<li><span class=\"swatch {class}\"></span>{}</li>",
            escape(text)
        ));
    }
    out.push_str("</ul>\n");
    out
}
