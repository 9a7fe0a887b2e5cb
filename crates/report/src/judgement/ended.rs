//! Verdicts on runs that end with an error.

use crate::error::Error;
use crate::verdict::Verdict;

/// The verdict on the results of a run that ended with this error before its last stage.
pub fn early(error: &Error) -> Verdict {
    let text = error.to_string();
    let problem = text.lines().next().unwrap_or_default();
    Verdict::care(
        "run.error",
        format!("The run ended early, and later results are missing: {problem}"),
    )
}

/// The verdict on a project with which a run would end with this error.
pub fn would(error: &Error) -> Verdict {
    let text = error.to_string().replace("\n  remedy:", " Remedy:");
    Verdict::fault(
        "run.error",
        format!("A run would end with this error: {text}"),
    )
}
