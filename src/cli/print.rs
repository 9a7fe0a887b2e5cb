//! What commands print: results and errors, as text or as JSON.

use std::io::Write;

use serde_json::{Value, json};

use crate::error::{Error, Location, Result};
use crate::pipeline::Outcome;

/// Prints what a command found.
pub(super) fn print_outcome(outcome: &Outcome, json: bool) -> Result<()> {
    let mut text = if json {
        format!("{:#}\n", outcome.result)
    } else {
        format!("{}\n", outcome.summary.trim_end())
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
        // Whoever reads has seen enough.
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        written => written.map_err(|error| Error::io("stdout", error)),
    }
}

/// Says once what went wrong; nothing is left to do where that cannot be written.
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
            }
            details
        }
        Error::Data {
            kind,
            problem,
            remedy,
        } => json!({ "kind": kind, "problem": problem, "remedy": remedy }),
        Error::Cancelled => json!({ "problem": "cancelled" }),
    };
    details["message"] = json!(error.to_string());
    json!({ "error": details })
}

/// The error of a result that JSON cannot hold.
pub(super) fn unprintable(error: impl std::fmt::Display) -> Error {
    Error::data(
        format!("what was found cannot be printed as JSON: {error}"),
        "inspect without --json",
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
