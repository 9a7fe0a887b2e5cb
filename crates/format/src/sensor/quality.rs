//! How a GNSS receiver computed its positions.

use super::Positions;

/// The solution behind a GNSS position, the most precise first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FixQuality {
    /// Carrier phases with fixed ambiguities: RTK, PPK or PPP fixed.
    Fixed,
    /// Carrier phases with ambiguities that are not resolved: RTK, PPK or PPP float.
    Float,
    /// Code with corrections: DGPS or SBAS.
    Differential,
    /// Code alone, or a solution of an unknown kind.
    Single,
}

impl FixQuality {
    /// All qualities, in the order of their declaration.
    pub const ALL: [Self; 4] = [Self::Fixed, Self::Float, Self::Differential, Self::Single];

    /// Its name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fixed => "fixed",
            Self::Float => "float",
            Self::Differential => "differential",
            Self::Single => "single",
        }
    }

    /// The number of positions of each quality in one line, such as `250 fixed, 12 float`.
    pub fn counts(qualities: impl Iterator<Item = Self> + Clone) -> String {
        let count = |quality| qualities.clone().filter(|other| *other == quality).count();
        let counts = Self::ALL.map(|quality| (quality, count(quality)));
        let counts = counts.iter().filter(|(_, count)| *count > 0);
        let counts = counts.map(|(quality, count)| format!("{count} {}", quality.name()));
        counts.collect::<Vec<_>>().join(", ")
    }
}

impl Positions {
    /// Positions without rejected rows and without a quality.
    pub fn of(fixes: Vec<super::PositionFix>) -> Self {
        Self {
            fixes,
            ..Self::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn qualities_are_counted_by_name() {
        let all = [FixQuality::Float, FixQuality::Fixed, FixQuality::Float];
        assert_eq!(FixQuality::counts(all.into_iter()), "1 fixed, 2 float");
    }
}
