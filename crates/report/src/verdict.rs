//! Verdicts: statements about results, each with a severity and a stable code. Only
//! [`judgement`](crate::judgement) makes them.

use serde::{Deserialize, Serialize};

/// Severity of a statement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// All is well.
    Good,
    /// For information.
    Note,
    /// The result may be used, but only with the stated reason in mind.
    Care,
    /// The result is wrong, or nothing shows that it is right.
    Fault,
}

impl Severity {
    /// Whether the statement is listed first and marked with a `!`.
    pub fn is_marked(self) -> bool {
        self >= Self::Care
    }
}

/// A statement in words that a field crew understands, for example "Left scanner: points agree with
/// the reference scan to 1.3 mm (before: 43 mm)".
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// Its severity.
    pub severity: Severity,
    /// Its code, stable from version to version, for example `prism.lever_arm`; docs/verdicts.md lists
    /// them all.
    pub code: String,
    /// One or two sentences, with units.
    pub text: String,
    /// The number on which it rests, in SI units and radians, if there is one.
    pub value: Option<f64>,
    /// Standard deviation of the number.
    pub sigma: Option<f64>,
    /// The drive or run that it is about, for example `drive-2`; `None` for the main one.
    pub about: Option<String>,
}

impl Verdict {
    /// A statement without a number.
    pub(crate) fn new(
        severity: Severity,
        code: impl Into<String>,
        text: impl Into<String>,
    ) -> Self {
        Self {
            severity,
            code: code.into(),
            text: text.into(),
            value: None,
            sigma: None,
            about: None,
        }
    }

    /// A statement of severity [`Severity::Good`].
    pub(crate) fn good(code: impl Into<String>, text: impl Into<String>) -> Self {
        Self::new(Severity::Good, code, text)
    }

    /// A statement of severity [`Severity::Note`].
    pub(crate) fn note(code: impl Into<String>, text: impl Into<String>) -> Self {
        Self::new(Severity::Note, code, text)
    }

    /// A statement of severity [`Severity::Care`].
    pub(crate) fn care(code: impl Into<String>, text: impl Into<String>) -> Self {
        Self::new(Severity::Care, code, text)
    }

    /// A statement of severity [`Severity::Fault`].
    pub(crate) fn fault(code: impl Into<String>, text: impl Into<String>) -> Self {
        Self::new(Severity::Fault, code, text)
    }

    /// The same statement about another drive, whose name begins the text.
    pub(crate) fn on(mut self, drive: &str) -> Self {
        self.text = format!("{drive}: {}", self.text);
        self.about(drive)
    }

    /// The same statement, marked as one about a drive or run other than the main one.
    pub(crate) fn about(mut self, run: &str) -> Self {
        self.about = Some(run.to_owned());
        self
    }

    /// The same statement with the number on which it rests.
    pub(crate) fn with_value(mut self, value: f64, sigma: Option<f64>) -> Self {
        (self.value, self.sigma) = (Some(value), sigma);
        self
    }
}

/// Limits that a result must meet.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Acceptance {
    /// Largest standard deviation of a mounting's position along an axis, metres.
    pub sigma_translation_m: f64,
    /// Largest standard deviation of a mounting's rotation about an axis, radians.
    pub sigma_rotation_rad: f64,
    /// Largest median and largest normalised median absolute deviation of distances between clouds,
    /// metres.
    pub distance_m: f64,
    /// Least share of the common field that the distances must cover.
    pub coverage: f64,
}

impl Default for Acceptance {
    fn default() -> Self {
        Self {
            sigma_translation_m: 0.005,
            sigma_rotation_rad: 0.1_f64.to_radians(),
            distance_m: 0.005,
            coverage: 0.5,
        }
    }
}

/// The conclusion from all verdicts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Headline {
    /// No verdict of severity care or fault.
    Usable,
    /// At least one verdict of severity care, no fault.
    Care,
    /// At least one fault.
    Unusable,
}

impl Headline {
    /// The headline of the gravest verdict.
    pub fn of(verdicts: &[Verdict]) -> Self {
        match verdicts.iter().map(|verdict| verdict.severity).max() {
            Some(Severity::Fault) => Self::Unusable,
            Some(Severity::Care) => Self::Care,
            _ => Self::Usable,
        }
    }

    /// The headline in words.
    pub fn text(self) -> &'static str {
        match self {
            Self::Usable => "usable",
            Self::Care => "usable with care",
            Self::Unusable => "not usable",
        }
    }
}

/// The text with a capital first letter.
pub fn capitalised(text: &str) -> String {
    let mut text = text.to_owned();
    if let Some(first) = text.get_mut(0..1) {
        first.make_ascii_uppercase();
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_headline_is_that_of_the_gravest_verdict() {
        let good = Verdict::good("a", "");
        let (care, fault) = (Verdict::care("b", ""), Verdict::fault("c", ""));
        assert_eq!(Headline::of(&[]), Headline::Usable);
        assert_eq!(Headline::of(std::slice::from_ref(&good)), Headline::Usable);
        assert_eq!(Headline::of(&[care.clone(), good.clone()]), Headline::Care);
        assert_eq!(Headline::of(&[care, fault, good]), Headline::Unusable);
    }
}
