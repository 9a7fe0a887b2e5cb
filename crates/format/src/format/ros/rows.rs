//! The rows of a recording in SQLite as its records.

use std::path::PathBuf;

use super::db3::Tables;
use super::records::Kind;
use super::sqlite::Source;
use super::walk::Walk;
use crate::error::{Error, Result};

impl Source for Walk {
    fn total(&self) -> u64 {
        self.bytes_total()
    }

    fn stand_at(&mut self, start: u64) {
        self.start = start;
    }

    fn fill(&mut self, into: &mut [u8]) -> Result<()> {
        self.read_at(self.start, into)
    }

    fn damage(&self, found: String, expected: String) -> Error {
        self.error(found, expected)
    }
}

impl Walk {
    /// Finds the tables of a recording.
    pub(super) fn find_tables(&mut self) -> Result<()> {
        self.tables = Tables::find(self)?;
        Ok(())
    }

    /// Advances to the next row of a kind that is `wanted`; `None` after the last one.
    pub(super) fn step_row(&mut self, wanted: &[Kind]) -> Result<Option<Kind>> {
        loop {
            match self.row() {
                Ok(Some(kind)) if wanted.contains(&kind) => return Ok(Some(kind)),
                Ok(Some(_)) => {}
                Ok(None) => return Ok(None),
                Err(error @ (Error::Io { .. } | Error::Cancelled)) => return Err(error),
                Err(error) => self.pass_over(error),
            }
        }
    }

    fn row(&mut self) -> Result<Option<Kind>> {
        let mut tables = std::mem::take(&mut self.tables);
        let mut record = std::mem::take(&mut self.data);
        let found = tables.next(self, &mut record);
        tables.farthest = tables.farthest.max(self.at);
        (self.tables, self.data) = (tables, record);
        Ok(found?.map(|(kind, row)| {
            self.kind = kind;
            self.head.clear();
            self.head.extend_from_slice(&row.to_le_bytes());
            kind
        }))
    }

    /// Remarks on messages that a recorder which was killed left beside the file.
    pub(super) fn remark_unmerged(&self) {
        let mut log = self.path().as_os_str().to_owned();
        log.push("-wal");
        let log = PathBuf::from(log);
        if log.metadata().is_ok_and(|found| found.len() > 0) {
            self.input().remark(format!(
                "messages of {} are left out: open the recording with sqlite3 once, which merges them",
                log.display()
            ));
        }
    }
}
