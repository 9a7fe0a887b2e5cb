//! Logs of quantities that may bend the frame: temperatures, loads, pressures.

use crate::error::Result;
use crate::format::file::nothing_in;
use crate::format::input::Input;
use crate::format::text::table::{Columns, Table};
use crate::sensor::{FrameLog, MAX_FRAME_COLUMNS};

/// Reads `time_s` and the named columns, at most [`MAX_FRAME_COLUMNS`], of a text table. Other columns are
/// ignored, so that a column of an IMU log can be named.
///
/// # Errors
/// A column that the table does not have, cells that are not finite numbers, times that do not ascend, no rows.
pub fn read_frame_log(input: impl Into<Input>, columns: &[String]) -> Result<FrameLog> {
    let input = &input.into();
    let columns = &columns[..columns.len().min(MAX_FRAME_COLUMNS)];
    let mut needed = vec!["time_s"];
    needed.extend(columns.iter().map(String::as_str));
    let wanted = Columns {
        needed: &needed,
        optional: &[],
    };
    let mut table = Table::open(input, &wanted)?;
    let mut row = vec![0.0; needed.len()];
    let mut log = FrameLog {
        rows: Vec::new(),
        columns: columns.len(),
    };
    while table.next_row(&mut row)? {
        let time_s = row[0];
        if let Some((before_s, _)) = log.rows.last().filter(|(before_s, _)| time_s <= *before_s) {
            return Err(table.error(
                format!("time_s = {time_s} after {before_s}"),
                "ascending times",
            ));
        }
        let value = |i: usize| row.get(i + 1).copied().unwrap_or(0.0);
        log.rows.push((time_s, std::array::from_fn(value)));
    }
    if log.rows.is_empty() {
        return Err(nothing_in(input.path(), "row"));
    }
    Ok(log)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, columns: &[&str]) -> Result<FrameLog> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("frame.csv");
        std::fs::write(&path, text).unwrap();
        let columns: Vec<String> = columns.iter().map(|name| (*name).to_owned()).collect();
        read_frame_log(&path, &columns)
    }

    #[test]
    fn named_columns_are_read_and_others_ignored() {
        let text = "time_ms,gyro,temperature_c,load_kg\n1000,0.1,20.5,3\n2000,0.1,21,4\n";
        let log = read(text, &["load_kg"]).unwrap();
        assert_eq!(log.rows, [(1.0, [3.0, 0.0]), (2.0, [4.0, 0.0])]);
        let log = read(text, &["load_kg", "temperature_c"]).unwrap();
        assert_eq!((log.columns, log.rows[1]), (2, (2.0, [4.0, 21.0])));
    }

    #[test]
    fn errors_name_column_and_line() {
        let message = |text: &str| read(text, &["load_kg"]).unwrap_err().to_string();
        let found = message("time_s,lod_kg\n1,2\n");
        assert!(found.contains("`lod_kg` looks like `load_kg`"), "{found}");
        let found = message("time_s,load_kg\n1,2\n1,3\n");
        assert!(
            found.contains("line 3: found time_s = 1 after 1"),
            "{found}"
        );
        assert!(message("time_s,load_kg\n").contains("no row"));
    }
}
