//! Records of a log that a reader cannot use, counted by reason.

use std::fmt;

use crate::error::{Error, Location, Result};
use crate::format::input::Input;

/// The reason of a record whose checksum is wrong.
pub(crate) const WRONG_CHECKSUM: &str = "with a wrong checksum";
/// The reason of a record with fields that are missing or are not numbers.
pub(crate) const DAMAGED: &str = "damaged";
/// The reason of a heading of two antennas that is not accurate enough to be used.
pub(crate) const NOT_FIXED: &str = "without fixed ambiguities";

/// Numbers of records by reason, in the order in which the reasons came up.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct LeftOut(Vec<(&'static str, u64)>);

impl LeftOut {
    /// Counts a record.
    pub(crate) fn add(&mut self, why: &'static str) {
        self.add_all(why, 1);
    }

    /// Counts several records.
    pub(crate) fn add_all(&mut self, why: &'static str, count: u64) {
        match self.0.iter_mut().find(|(reason, _)| *reason == why) {
            Some((_, sum)) => *sum += count,
            None if count > 0 => self.0.push((why, count)),
            None => {}
        }
    }

    /// The number of records with this reason.
    pub(crate) fn count(&self, why: &str) -> u64 {
        let found = self.0.iter().find(|(reason, _)| *reason == why);
        found.map_or(0, |(_, count)| *count)
    }

    /// The number of all records.
    pub(crate) fn total(&self) -> u64 {
        self.0.iter().map(|(_, count)| count).sum()
    }

    /// The records that a reader found beside these, which the input remarks.
    ///
    /// # Errors
    /// No record; more records left out than found. `what` names them, `expected` says what would be read.
    pub(crate) fn checked<T>(
        &self,
        input: &Input,
        records: Vec<T>,
        what: &str,
        expected: &str,
    ) -> Result<Vec<T>> {
        if records.is_empty() || self.total() > records.len() as u64 {
            let also = match self.total() {
                0 => String::new(),
                _ => format!(", left out: {self}"),
            };
            let found = format!("{} {what}{also}", records.len());
            return Err(Error::format(
                input.path(),
                Location::Whole,
                found,
                expected,
            ));
        }
        self.remark(input, what);
        Ok(records)
    }

    /// Keeps the numbers as a remark on the file.
    pub(crate) fn remark(&self, input: &Input, what: &str) {
        if self.total() > 0 {
            input.remark(format!("{what} left out: {self}"));
        }
    }
}

/// The numbers with their reasons.
impl fmt::Display for LeftOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (at, (why, count)) in self.0.iter().enumerate() {
            let separator = if at > 0 { ", " } else { "" };
            write!(f, "{separator}{count} {why}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_are_counted_by_reason_and_a_file_with_more_of_them_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.log");
        std::fs::write(&path, "").unwrap();
        let input = Input::from(&path);
        let mut left_out = LeftOut::default();
        left_out.add(DAMAGED);
        left_out.add_all(WRONG_CHECKSUM, 0);
        left_out.add(DAMAGED);
        assert_eq!((left_out.total(), left_out.count(DAMAGED)), (2, 2));
        let check = |records| left_out.checked(&input, records, "positions", "more");
        assert_eq!(check(vec![1, 2]).unwrap(), [1, 2]);
        assert_eq!(input.remarks(), ["positions left out: 2 damaged"]);
        let error = check(vec![1]).unwrap_err().to_string();
        assert!(
            error.contains("found 1 positions, left out: 2 damaged, expected more"),
            "{error}"
        );
        let none: Vec<i32> = Vec::new();
        let error = LeftOut::default().checked(&input, none, "positions", "some");
        assert!(
            error
                .unwrap_err()
                .to_string()
                .contains("found 0 positions, expected some")
        );
    }
}
