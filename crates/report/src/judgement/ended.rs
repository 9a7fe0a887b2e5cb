//! The verdict on a run that ended with an error.

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
