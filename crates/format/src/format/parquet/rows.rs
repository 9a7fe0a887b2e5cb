//! The rows of a Parquet file, in batches, row group by row group.

use std::fmt;
use std::fs::File;
use std::path::PathBuf;
use std::sync::Arc;

use ::parquet::column::reader::{ColumnReader, ColumnReaderImpl, get_column_reader};
use ::parquet::data_type::DataType;
use ::parquet::errors::Result as Decoded;
use ::parquet::file::metadata::ParquetMetaData;

use super::columns::{Header, Value, header_of, type_of};
use super::pages::{Pages, Pool};
use super::{WHOLE, damaged, footer, unpack};
use crate::error::{Error, Location, Result};
use crate::format::file::guarded;
use crate::format::input::Input;

/// Rows decoded at a time.
const BATCH: usize = 4096;
/// Memory for pages in addition to the size of the file, bytes; unpacking can double it for a moment.
const PAGES: usize = 24 << 20;
/// Rows that any file may have, and further rows per byte of its size: a few bytes can claim any
/// number of equal rows.
const MOST_ROWS: [u64; 2] = [1_000_000, 8];

/// A file, read row by row.
pub(crate) struct Rows {
    path: PathBuf,
    file: Arc<File>,
    content: ParquetMetaData,
    header: Header,
    bytes: u64,
    count: u64,
    pool: Arc<Pool>,
    /// Indices of the selected columns.
    selected: Vec<usize>,
    /// The selected columns of the current row group.
    columns: Vec<Column>,
    next_group: usize,
    left_in_group: usize,
    /// Position in the batch.
    at: usize,
    /// Rows of the batch.
    batch: usize,
    /// The row last read, counted from 1.
    row: u64,
}

impl fmt::Debug for Rows {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "row {} of {}", self.row, self.path.display())
    }
}

impl Rows {
    /// Reads the footer.
    pub(crate) fn open(input: &Input) -> Result<Self> {
        let (mut file, bytes) = input.open_file()?;
        let content = guarded(input.path(), "Parquet", || {
            footer::read(input.path(), &mut file, bytes)
        })?;
        let mut count = 0_u64;
        for group in content.row_groups() {
            let rows = u64::try_from(group.num_rows()).unwrap_or(u64::MAX);
            count = count.saturating_add(rows);
        }
        let most = MOST_ROWS[0] + MOST_ROWS[1] * bytes;
        if count > most {
            let found = format!("{count} rows in {bytes} bytes");
            let expected = format!("{most} at most");
            return Err(Error::format(
                input.path(),
                Location::Whole,
                found,
                expected,
            ));
        }
        let pages = usize::try_from(bytes).unwrap_or(usize::MAX);
        Ok(Self {
            path: input.path().to_owned(),
            file: Arc::new(file),
            header: header_of(&content),
            content,
            bytes,
            count,
            pool: Pool::of(PAGES.saturating_add(pages)),
            selected: Vec::new(),
            columns: Vec::new(),
            next_group: 0,
            left_in_group: 0,
            at: 0,
            batch: 0,
            row: 0,
        })
    }

    pub(crate) fn into_header(self) -> Header {
        self.header
    }

    pub(crate) fn names(&self) -> &[String] {
        &self.header.names
    }

    /// Selects the columns to read; [`cell`](Self::cell) numbers them in this order.
    ///
    /// # Errors
    /// A column that does not hold a number in every row, or has an unknown compression.
    pub(crate) fn select(&mut self, columns: Vec<usize>) -> Result<()> {
        let schema = self.content.file_metadata().schema_descr();
        for &index in &columns {
            let column = &schema.columns()[index];
            let name = &self.header.names[index];
            if Value::of(column).is_none() {
                let found = format!("column {name} of the type {}", type_of(column));
                return Err(self.error(found, "floating-point numbers or integers"));
            }
            for group in self.content.row_groups() {
                let codec = group.column(index).compression_codec();
                if !unpack::is_known(codec) {
                    let found = format!("column {name} with the compression {codec}");
                    let expected = "none, Snappy, gzip, zstd or LZ4";
                    return Err(self.error(found, expected));
                }
            }
        }
        self.selected = columns;
        Ok(())
    }

    /// Reads the next row; false at the end.
    pub(crate) fn advance(&mut self) -> Result<bool> {
        self.at += 1;
        if self.at >= self.batch {
            let path = self.path.clone();
            if !guarded(&path, "Parquet", || self.fill())? {
                return Ok(false);
            }
        }
        self.row += 1;
        Ok(true)
    }

    /// The value of a selected column in the row last read; `None` stands for a null.
    #[inline]
    pub(crate) fn cell(&self, column: usize) -> Option<f64> {
        self.columns[column].cells[self.at]
    }

    /// Decodes the next batch; false at the end.
    fn fill(&mut self) -> Result<bool> {
        (self.at, self.batch) = (0, 0);
        while self.left_in_group == 0 {
            if self.next_group == self.content.num_row_groups() {
                return Ok(false);
            }
            self.open_group(self.next_group)?;
            self.next_group += 1;
        }
        let wanted = self.left_in_group.min(BATCH);
        for i in 0..self.columns.len() {
            let read = self.columns[i].fill(wanted);
            let read = read.map_err(|e| damaged(&self.path, Location::Row(self.row + 1), e))?;
            if read < wanted {
                let name = &self.header.names[self.selected[i]];
                let found = format!(
                    "the end of column {name}, {} rows before that of its row group",
                    self.left_in_group - read
                );
                let at = Location::Row(self.row + 1 + read as u64);
                return Err(Error::format(&self.path, at, found, WHOLE));
            }
        }
        self.left_in_group -= wanted;
        self.batch = wanted;
        Ok(true)
    }

    fn open_group(&mut self, index: usize) -> Result<()> {
        // The readers of the previous group return their memory to the pool.
        self.columns.clear();
        let group = self.content.row_group(index);
        // The sum over all groups was checked when the file was opened.
        let rows = usize::try_from(group.num_rows()).unwrap_or_default();
        for &index in &self.selected {
            let column = group.column(index);
            let start = column.dictionary_page_offset();
            let start = start.unwrap_or_else(|| column.data_page_offset());
            let end = start.checked_add(column.compressed_size());
            let is_within = start >= 0
                && column.compressed_size() >= 0
                && end.is_some_and(|end| end as u64 <= self.bytes);
            if !is_within || column.file_path().is_some() {
                let name = &self.header.names[index];
                let found = format!("column {name} outside the file");
                return Err(self.error(found, WHOLE));
            }
            let descriptor = column.column_descr_ptr();
            let value = Value::of(&descriptor).unwrap_or(Value::Signed);
            let pages = Pages::of(&self.file, column, rows, &self.pool)
                .map_err(|e| damaged(&self.path, Location::Row(self.row + 1), e))?;
            self.columns.push(Column {
                present: descriptor.max_def_level(),
                reader: get_column_reader(descriptor, Box::new(pages)),
                value,
                cells: Vec::with_capacity(rows.min(BATCH)),
            });
        }
        self.left_in_group = rows;
        Ok(())
    }

    /// The row last read, counted from 1.
    pub(crate) fn number(&self) -> u64 {
        self.row
    }

    /// Bytes read so far, approximately.
    pub(crate) fn bytes_read(&self) -> u64 {
        let share = self.row as f64 / self.count.max(1) as f64;
        (share * self.bytes as f64) as u64
    }

    pub(crate) fn bytes_total(&self) -> u64 {
        self.bytes
    }

    /// A format error at the row last read.
    pub(crate) fn error(&self, found: impl Into<String>, expected: impl Into<String>) -> Error {
        let at = match self.row {
            0 => Location::Whole,
            row => Location::Row(row),
        };
        Error::format(&self.path, at, found, expected)
    }
}

/// A column of a row group.
struct Column {
    reader: ColumnReader,
    value: Value,
    /// The definition level of a value that is not null.
    present: i16,
    /// The values of the batch.
    cells: Vec<Option<f64>>,
}

impl Column {
    /// Decodes at most `rows` rows; returns how many there were.
    fn fill(&mut self, rows: usize) -> Decoded<usize> {
        let (value, present, cells) = (self.value, self.present, &mut self.cells);
        cells.clear();
        match &mut self.reader {
            ColumnReader::FloatColumnReader(r) => decode(r, rows, present, cells, f64::from),
            ColumnReader::DoubleColumnReader(r) => decode(r, rows, present, cells, |v| v),
            ColumnReader::Int32ColumnReader(r) => {
                decode(r, rows, present, cells, |v| value.of_i32(v))
            }
            ColumnReader::Int64ColumnReader(r) => {
                decode(r, rows, present, cells, |v| value.of_i64(v))
            }
            _ => Ok(0),
        }
    }
}

fn decode<T: DataType>(
    reader: &mut ColumnReaderImpl<T>,
    rows: usize,
    present: i16,
    cells: &mut Vec<Option<f64>>,
    number: impl Fn(T::T) -> f64,
) -> Decoded<usize> {
    let (mut levels, mut values) = (Vec::new(), Vec::new());
    let (read, ..) = reader.read_records(rows, Some(&mut levels), None, &mut values)?;
    let mut values = values.into_iter().map(number);
    match present {
        0 => cells.extend(values.map(Some)),
        _ => cells.extend(levels.iter().map(|level| {
            if *level == present {
                values.next()
            } else {
                None
            }
        })),
    }
    Ok(read.min(cells.len()))
}
