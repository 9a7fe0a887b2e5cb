//! Salvage of damaged recordings and tables: copies of their undamaged records and rows.

use std::fs::File;
use std::io::{BufRead, BufReader, BufWriter, Read, Write};
use std::path::Path;

use super::detect::detect;
use super::input::Input;
use super::kind::{Kind, RecordAt};
use super::kinds::KINDS;
use super::ros;
use crate::error::{Error, Location, Result};
use crate::format::text::lines::Separator;

/// Numbers of the records and bytes salvaged from a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct Salvaged {
    /// Profiles or messages of a recording, or rows of a table, in the copy.
    pub kept: u64,
    /// Rows of a table that were left out.
    pub dropped_rows: u64,
    /// Bytes that were left out.
    pub dropped_bytes: u64,
    /// Places where something was left out.
    pub places: u64,
    /// Byte offset of the first such place.
    pub first_byte: Option<u64>,
}

impl Salvaged {
    /// Counts `bytes` left out at offset `at`; `continues` if they belong to the same place as the last ones.
    fn add_dropped(&mut self, at: u64, bytes: u64, continues: bool) {
        self.dropped_bytes += bytes;
        self.places += u64::from(!continues);
        self.first_byte.get_or_insert(at);
    }
}

/// Number of bytes in memory, more than the longest record has.
const WINDOW: usize = 4 << 20;
/// Lines of this many bytes or more do not belong to a table.
const LONGEST_LINE: u64 = 1 << 20;
/// Longest accepted interval between the profiles before and after damage, seconds. Bytes that only look like a
/// profile seldom have a time within it.
const LONGEST_PAUSE_S: f64 = 3600.0;

/// Writes a copy of a recording (`.bin`, a ROS bag or MCAP) or of a text table to `to`. The copy leaves out records and rows that
/// are cut off, that cannot be read, or that contain a value that is not a finite number.
///
/// # Errors
/// Files that cannot be read or written, or that have another format; a file without an undamaged record or row.
pub fn salvage(path: &Path, to: &Path) -> Result<Salvaged> {
    let input = &Input::from(path);
    let detected = detect(input).ok().map(|format| format.0);
    let is_parquet = input.is_parquet();
    let salvaged = match detected.and_then(|kind| kind.record) {
        Some(record) => records(input, to, record),
        None if detected.is_some_and(|kind| kind.id == ros::BAG.id) => recording(input, to),
        None if detected.is_none_or(is_text) && !is_parquet => rows(input, to),
        None => {
            let kinds = KINDS.iter().filter(|kind| kind.record.is_some());
            let names: Vec<&str> = kinds.map(|kind| kind.name).collect();
            let other = if is_parquet {
                "Parquet"
            } else {
                "another format"
            };
            let found = detected
                .filter(|_| !is_parquet)
                .map_or(other, |kind| kind.name);
            let expected = format!("a text table, or {}, {}", names.join(", "), ros::BAG.name);
            return Err(Error::format(path, Location::Whole, found, expected));
        }
    }?;
    match salvaged.kept {
        0 => Err(Error::format(
            path,
            Location::Whole,
            "no undamaged content",
            "profiles, messages or rows",
        )),
        _ => Ok(salvaged),
    }
}

/// Copies a recording of ROS.
fn recording(input: &Input, to: &Path) -> Result<Salvaged> {
    let copied = ros::copy_whole_records(input, to)?;
    let left_out = &copied.left_out;
    Ok(Salvaged {
        kept: copied.messages,
        dropped_rows: 0,
        dropped_bytes: left_out.iter().map(|(_, length)| length).sum(),
        places: left_out.len() as u64,
        first_byte: left_out.first().map(|(start, _)| *start),
    })
}

fn is_text(kind: &Kind) -> bool {
    kind.columns.is_some() || kind.numbers.is_some()
}

fn records(input: &Input, to: &Path, record: RecordAt) -> Result<Salvaged> {
    let (mut from, total) = input.open()?;
    let out = File::create(to).map_err(|e| Error::io(to, e))?;
    let mut out = BufWriter::with_capacity(1 << 20, out);
    let mut salvaged = Salvaged::default();
    let mut window: Vec<u8> = Vec::new();
    // Offset of the window in the file, and of the next byte in the window.
    let (mut start, mut at) = (0u64, 0usize);
    let mut last_s: Option<f64> = None;
    let mut is_damaged = false;
    while start + (at as u64) < total {
        if window.len() - at < WINDOW / 2 && start + (window.len() as u64) < total {
            window.drain(..at);
            (start, at) = (start + at as u64, 0);
            let wanted = (WINDOW - window.len()) as u64;
            (&mut from)
                .take(wanted)
                .read_to_end(&mut window)
                .map_err(|e| Error::io(input.path(), e))?;
        }
        let fits = |time_s: f64| {
            last_s.is_none_or(|last_s| {
                let pause_s = time_s - last_s;
                pause_s >= 0.0 && (!is_damaged || pause_s < LONGEST_PAUSE_S)
            })
        };
        match record(&window[at..], &fits) {
            // The next record is complete and earlier, so that the time of this one is wrong.
            Some(whole)
                if record(&window[at + whole.length..], &|time_s| {
                    fits(time_s) && time_s < whole.time_s
                })
                .is_some() =>
            {
                salvaged.add_dropped(start + at as u64, whole.length as u64, is_damaged);
                is_damaged = true;
                at += whole.length;
            }
            Some(whole) => {
                out.write_all(&window[at..at + whole.length])
                    .map_err(|e| Error::io(to, e))?;
                at += whole.length;
                salvaged.kept += 1;
                last_s = Some(whole.time_s);
                is_damaged = false;
            }
            None => {
                salvaged.add_dropped(start + at as u64, 1, is_damaged);
                is_damaged = true;
                at += 1;
            }
        }
    }
    out.flush().map_err(|e| Error::io(to, e))?;
    Ok(salvaged)
}

fn rows(input: &Input, to: &Path) -> Result<Salvaged> {
    let (from, _) = input.open()?;
    let mut from = BufReader::with_capacity(1 << 20, from);
    let out = File::create(to).map_err(|e| Error::io(to, e))?;
    let mut out = BufWriter::with_capacity(1 << 20, out);
    let mut salvaged = Salvaged::default();
    let mut columns = Columns::default();
    let (mut line, mut start) = (Vec::new(), 0u64);
    let mut is_damaged = false;
    loop {
        line.clear();
        let read = (&mut from)
            .take(LONGEST_LINE)
            .read_until(b'\n', &mut line)
            .map_err(|e| Error::io(input.path(), e))? as u64;
        if read == 0 {
            break;
        }
        let text = std::str::from_utf8(&line).ok().map(str::trim);
        let is_whole = match text {
            _ if read == LONGEST_LINE => false,
            None => false,
            Some(text) if text.is_empty() || text.starts_with('#') => true,
            Some(text) => columns.fit(&cells(text)),
        };
        if is_whole {
            out.write_all(&line).map_err(|e| Error::io(to, e))?;
        } else {
            salvaged.add_dropped(start, read, is_damaged);
            salvaged.dropped_rows += 1;
        }
        is_damaged = !is_whole;
        start += read;
    }
    salvaged.kept = columns.rows;
    out.flush().map_err(|e| Error::io(to, e))?;
    Ok(salvaged)
}

/// The content of a cell of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Cell {
    Empty,
    Number,
    /// Infinite or NaN.
    NotFinite,
    Text,
}

fn cells(text: &str) -> Vec<Cell> {
    let mut cells = Vec::new();
    let _ = Separator::of(text).split::<()>(text, |_, cell| {
        cells.push(match cell.parse::<f64>() {
            _ if cell.is_empty() => Cell::Empty,
            Ok(value) if value.is_finite() => Cell::Number,
            Ok(_) => Cell::NotFinite,
            Err(_) => Cell::Text,
        });
        Ok(())
    });
    cells
}

/// The columns of a table, known from its header and its first row.
#[derive(Default)]
struct Columns {
    /// Number of cells in the last line of text before the first row.
    header: Option<usize>,
    /// Whether each column holds text.
    are_text: Option<Vec<bool>>,
    rows: u64,
}

impl Columns {
    /// Adds a line; returns whether it is undamaged.
    fn fit(&mut self, cells: &[Cell]) -> bool {
        let is_row = cells.contains(&Cell::Number) || cells.contains(&Cell::NotFinite);
        if self.are_text.is_none() && !is_row {
            self.header = Some(cells.len());
            return true;
        }
        let width = self.are_text.as_ref().map(Vec::len).or(self.header);
        let are_numbers = cells.iter().enumerate().all(|(i, cell)| {
            let is_text = self
                .are_text
                .as_ref()
                .is_none_or(|are_text| are_text[i.min(are_text.len() - 1)]);
            *cell != Cell::NotFinite && (*cell != Cell::Text || is_text)
        });
        if !are_numbers || width.is_some_and(|width| width != cells.len()) {
            return false;
        }
        self.are_text
            .get_or_insert_with(|| cells.iter().map(|cell| *cell == Cell::Text).collect());
        self.rows += 1;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn salvaged(name: &str, bytes: &[u8]) -> Result<(Salvaged, Vec<u8>)> {
        let folder = tempfile::tempdir().unwrap();
        let [from, to] = [name, "kept"].map(|name| folder.path().join(name));
        std::fs::write(&from, bytes).unwrap();
        let found = salvage(&from, &to)?;
        Ok((found, std::fs::read(&to).unwrap()))
    }

    fn recording(profiles: usize) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        let mut writer = crate::format::BonnWriter::create(&path).unwrap();
        let points = vec![Some((0.1, -0.2, 7)); 50];
        for i in 0..profiles {
            writer
                .write_profile(100.0 + 0.005 * i as f64, &points)
                .unwrap();
        }
        writer.finish().unwrap();
        std::fs::read(&path).unwrap()
    }

    #[test]
    fn profiles_around_a_damage_are_kept() {
        let whole = recording(10);
        let length = whole.len() / 10;
        let (found, kept) = salvaged("a.bin", &whole).unwrap();
        assert_eq!(
            (found.kept, found.dropped_bytes, kept),
            (10, 0, whole.clone())
        );
        // Cut off in the last one, and a time that is no number in the fourth.
        let mut damaged = whole[..whole.len() - 7].to_vec();
        damaged[3 * length..3 * length + 8].copy_from_slice(&f64::NAN.to_le_bytes());
        let (found, kept) = salvaged("a.bin", &damaged).unwrap();
        let expected = [&whole[..3 * length], &whole[4 * length..9 * length]].concat();
        assert_eq!((found.kept, found.places), (8, 2));
        assert_eq!(found.first_byte, Some(3 * length as u64));
        assert_eq!(found.dropped_bytes, (2 * length - 7) as u64);
        assert!(kept == expected);
    }

    #[test]
    fn a_time_that_is_wrong_costs_one_profile_and_a_pause_none() {
        let whole = recording(6);
        let length = whole.len() / 6;
        for at in [0, 2] {
            let mut damaged = whole.clone();
            damaged[at * length..at * length + 8].copy_from_slice(&1e6f64.to_le_bytes());
            let (found, kept) = salvaged("a.bin", &damaged).unwrap();
            let expected = [&whole[..at * length], &whole[(at + 1) * length..]].concat();
            assert_eq!((found.kept, found.dropped_bytes), (5, length as u64));
            assert!(kept == expected);
        }
        let mut paused = whole.clone();
        for i in 3..6 {
            let time_s = 90_000.0 + 0.005 * i as f64;
            paused[i * length..i * length + 8].copy_from_slice(&time_s.to_le_bytes());
        }
        assert_eq!(salvaged("a.bin", &paused).unwrap().0.kept, 6);
    }

    #[test]
    fn rows_around_a_damage_are_kept() {
        let text = "# made by hand\ntime_s,x_m,note\n1,2,a\n2,NaN,b\n3,4,c\n4,\n5,,d\n6,7";
        let (found, kept) = salvaged("a.csv", text.as_bytes()).unwrap();
        let kept = String::from_utf8(kept).unwrap();
        assert_eq!(
            kept,
            "# made by hand\ntime_s,x_m,note\n1,2,a\n3,4,c\n5,,d\n"
        );
        assert_eq!((found.kept, found.dropped_rows, found.places), (3, 3, 3));
        // A row that is cut off or not finite does not determine the columns.
        let text = "time_s,x_m,z_m\n1,2\n1,NaN,2\n2,3,4\n3,inf,1\n";
        let (found, kept) = salvaged("a.csv", text.as_bytes()).unwrap();
        assert_eq!(String::from_utf8(kept).unwrap(), "time_s,x_m,z_m\n2,3,4\n");
        assert_eq!((found.kept, found.dropped_rows), (1, 3));
        let none = salvaged("a.laz", b"LASF").unwrap_err().to_string();
        assert!(
            none.contains("expected a text table, or profiles"),
            "{none}"
        );
    }
}
