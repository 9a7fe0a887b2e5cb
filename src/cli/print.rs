//! Output of results and errors, as text or as JSON.

use std::io::Write;

use serde_json::{Value, json};

use crate::error::{Error, Location, Result};
use crate::pipeline::Outcome;
use crate::verdict::{Headline, Verdict};

/// Prints the outcome of a command.
pub(super) fn print_outcome(outcome: &Outcome, json: bool) -> Result<()> {
    let mut text = if json {
        format!("{:#}\n", outcome.result)
    } else {
        let verdicts = outcome.verdicts.as_deref().map(marked).unwrap_or_default();
        format!("{verdicts}{}\n", outcome.summary.trim_end())
    };
    if !json {
        if !outcome.files.is_empty() && outcome.summary.contains('\n') {
            text.push('\n');
        }
        for file in &outcome.files {
            text.push_str(&format!("wrote {}\n", file.display()));
        }
    }
    match std::io::stdout().write_all(text.as_bytes()) {
        // The reader has closed the pipe.
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        written => written.map_err(|error| Error::io("stdout", error)),
    }
}

/// The headline, and each statement that needs attention after a `!`.
fn marked(verdicts: &[Verdict]) -> String {
    if verdicts.is_empty() {
        return String::new();
    }
    let mut text = format!("result: {}\n\n", Headline::of(verdicts).text());
    let marked = verdicts
        .iter()
        .filter(|verdict| verdict.severity.is_marked());
    text.extend(marked.map(|verdict| format!("! {}\n\n", verdict.text)));
    text
}

/// Prints an error; if that fails, the message is lost.
pub(super) fn print_error(error: &Error, json: bool) {
    let _ = if json {
        writeln!(std::io::stdout(), "{:#}", error_json(error))
    } else {
        writeln!(std::io::stderr(), "error: {error}")
    };
}

fn error_json(error: &Error) -> Value {
    let mut details = match error {
        Error::Io { path, source } => {
            json!({ "file": path.display().to_string(), "problem": source.to_string() })
        }
        Error::Format {
            path,
            at,
            found,
            expected,
        } => {
            let mut details = json!({
                "file": path.display().to_string(),
                "found": found,
                "expected": expected,
            });
            match at {
                Location::Whole => {}
                Location::Line(line) => details["line"] = json!(line),
                Location::Byte(byte) => details["byte"] = json!(byte),
                Location::Row(row) => details["row"] = json!(row),
            }
            details
        }
        Error::Data {
            kind,
            problem,
            remedy,
        } => json!({ "kind": kind, "problem": problem, "remedy": remedy }),
        other => json!({ "problem": other.to_string() }),
    };
    details["message"] = json!(error.to_string());
    json!({ "error": details })
}

/// Error for a result that cannot be represented as JSON.
pub(super) fn unprintable(error: impl std::fmt::Display) -> Error {
    Error::data(
        format!("the result cannot be printed as JSON: {error}"),
        "run the command without --json",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_as_json_name_file_and_line() {
        let error = Error::format("a.toml", Location::Line(3), "x", "y");
        let json = error_json(&error);
        assert_eq!(json["error"]["file"], "a.toml");
        assert_eq!(json["error"]["line"], 3);
        assert_eq!(
            json["error"]["message"],
            "a.toml, line 3: found x, expected y"
        );
    }
}
