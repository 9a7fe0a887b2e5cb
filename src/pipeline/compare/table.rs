//! The table of a comparison.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use rayon::prelude::*;

use super::columns::COLUMNS;
use crate::comparison::{CoreDistance, M3c2};
use crate::error::{Error, Result};

/// Number of rows formatted by one thread at a time.
const ROWS: usize = 4096;

/// Writes one line per core point, in their order; NaN if a value is unknown.
pub(super) fn write(path: &Path, distances: &M3c2) -> Result<()> {
    let write = || -> std::io::Result<()> {
        let mut file = BufWriter::new(File::create(path)?);
        write!(file, "east_m,north_m,up_m")?;
        for column in &COLUMNS {
            write!(file, ",{}", column.name)?;
        }
        writeln!(file)?;
        // The blocks are formatted in batches: text needs more memory than numbers.
        for rows in distances.core.chunks(64 * ROWS) {
            let blocks: Vec<Vec<u8>> = rows.par_chunks(ROWS).map(lines).collect();
            for block in blocks {
                file.write_all(&block)?;
            }
        }
        file.flush()
    };
    write().map_err(|error| Error::io(path, error))
}

fn lines(rows: &[CoreDistance]) -> Vec<u8> {
    let mut text = Vec::with_capacity(200 * rows.len());
    for row in rows {
        let p = &row.point;
        // Writing to a Vec cannot fail.
        let _ = write!(text, "{},{},{}", p.x, p.y, p.z);
        for column in &COLUMNS {
            let _ = write!(text, ",{}", (column.value)(row));
        }
        text.push(b'\n');
    }
    text
}
