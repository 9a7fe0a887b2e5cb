//! The table of a comparison.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use rayon::prelude::*;

use crate::comparison::{CoreDistance, M3c2};
use crate::error::{Error, Result};

/// Number of rows formatted by one thread at a time.
const ROWS: usize = 4096;

const HEADER: &str = "east_m,north_m,up_m,distance_m,level_of_detection_m,normal_x,normal_y,\
    normal_z,normal_radius_m,reference_spread_m,compared_spread_m,reference_count,compared_count\n";

/// Writes one line per core point, in their order; NaN if a value is unknown.
pub(super) fn write(path: &Path, found: &M3c2) -> Result<()> {
    let write = || -> std::io::Result<()> {
        let mut file = BufWriter::new(File::create(path)?);
        file.write_all(HEADER.as_bytes())?;
        // Only some blocks at a time: text needs more memory than numbers.
        for rows in found.core.chunks(64 * ROWS) {
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
        let (p, n) = (&row.point, &row.normal);
        // A Vec takes all bytes.
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},{},{},{},{},{},{},{}",
            p.x,
            p.y,
            p.z,
            row.distance_m,
            row.level_of_detection_m,
            n.x,
            n.y,
            n.z,
            row.normal_radius_m,
            row.reference_spread_m,
            row.compared_spread_m,
            row.reference_count,
            row.compared_count
        );
    }
    text
}
