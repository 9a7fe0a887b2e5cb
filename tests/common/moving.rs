//! True mountings on a frame that bends.

use std::path::Path;

use boresight::error::{Error, Result};
use boresight::geometry::{BodyFromScanner, Rotation, Vec3};
use boresight::nalgebra::Quaternion;

/// Times (seconds) and mountings of a scanner, from a file of the simulator.
pub fn mountings_in(file: &Path) -> Result<Vec<(f64, BodyFromScanner)>> {
    let text = std::fs::read_to_string(file).map_err(|e| Error::io(file, e))?;
    let rows = text.lines().skip(1).map(|line| {
        let row: Vec<f64> = line.split(',').flat_map(str::parse).collect();
        let [time_s, x, y, z, qx, qy, qz, qw] = row[..] else {
            let found = format!("{}: {line}", file.display());
            return Err(Error::data(found, "8 numbers"));
        };
        let rotation = Rotation::new_normalize(Quaternion::new(qw, qx, qy, qz));
        Ok((time_s, BodyFromScanner::new(rotation, Vec3::new(x, y, z))))
    });
    rows.collect()
}
