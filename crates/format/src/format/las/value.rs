//! A value of an extra dimension.

/// A value of a dimension of a point. Integers of 64 bits do not fit into a 64-bit float.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ExtraValue {
    /// A number, or NaN for no value.
    Number(f64),
    /// An integer.
    Signed(i64),
    /// An integer that is not negative.
    Unsigned(u64),
}

impl ExtraValue {
    /// No value.
    pub const NONE: Self = Self::Number(f64::NAN);

    /// The value as a floating-point number; integers above 2⁵³ are rounded.
    pub fn number(self) -> f64 {
        match self {
            Self::Number(value) => value,
            Self::Signed(value) => value as f64,
            Self::Unsigned(value) => value as f64,
        }
    }

    /// The value as an integer from −2⁶³ to 2⁶³ − 1, clamped to this range; `None` for no value.
    pub fn signed(self) -> Option<i64> {
        match self {
            Self::Number(value) if value.is_nan() => None,
            // `as` saturates.
            Self::Number(value) => Some(value as i64),
            Self::Signed(value) => Some(value),
            Self::Unsigned(value) => Some(i64::try_from(value).unwrap_or(i64::MAX)),
        }
    }

    /// The value as an integer from 0 to 2⁶⁴ − 1, clamped to this range; `None` for no value.
    pub fn unsigned(self) -> Option<u64> {
        match self {
            Self::Number(value) if value.is_nan() => None,
            // `as` saturates.
            Self::Number(value) => Some(value as u64),
            Self::Signed(value) => Some(u64::try_from(value).unwrap_or(0)),
            Self::Unsigned(value) => Some(value),
        }
    }
}

impl From<f64> for ExtraValue {
    fn from(value: f64) -> Self {
        Self::Number(value)
    }
}

impl std::fmt::Display for ExtraValue {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Number(value) if value.is_nan() => Ok(()),
            Self::Number(value) => value.fmt(f),
            Self::Signed(value) => value.fmt(f),
            Self::Unsigned(value) => value.fmt(f),
        }
    }
}
