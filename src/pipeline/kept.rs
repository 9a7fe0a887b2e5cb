//! Values kept on disk for later runs.
//!
//! The first line of a file names the program that wrote it, because no other program can read the value that follows.
//! The file ends with a hash of all preceding bytes: a file that is damaged or incomplete holds no value.

use std::fs;
use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;
use twox_hash::xxhash3_128::Hasher;

use super::program::PROGRAM;
use crate::error::{Error, Location, Result};

/// Start of the first line, before the program.
const START: &str = "kept by boresight ";

/// The content of a file that keeps a value.
///
/// # Errors
/// The value contains something that has no bytes, such as a path that is not Unicode.
pub fn bytes_of(value: &impl Serialize) -> Result<Vec<u8>> {
    let line = format!("{START}{PROGRAM}\n").into_bytes();
    let mut bytes = postcard::to_extend(value, line).map_err(|error| {
        Error::data(
            format!("a result cannot be kept: {error}"),
            "report this as a bug in boresight",
        )
    })?;
    let hash = Hasher::oneshot(&bytes).to_le_bytes();
    bytes.extend(hash);
    Ok(bytes)
}

/// The value that a file keeps.
///
/// # Errors
/// The file cannot be read, is damaged or keeps no value; another program wrote it.
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let failed = |error| Error::io(path, error);
    // Opening a pipe would block until another process writes to it.
    if !path.metadata().map_err(failed)?.is_file() {
        return Err(failed(std::io::ErrorKind::InvalidInput.into()));
    }
    parse(path, &fs::read(path).map_err(failed)?, PROGRAM)
}

fn parse<T: DeserializeOwned>(path: &Path, bytes: &[u8], program: &str) -> Result<T> {
    let wrong = |at, found: &str, expected: &str| Err(Error::format(path, at, found, expected));
    let Some(after) = bytes.strip_prefix(START.as_bytes()) else {
        let expected = format!(
            "`{}`, with which a run begins such a file",
            START.trim_end()
        );
        return wrong(Location::Line(1), "another file", &expected);
    };
    let (before, hash) = bytes.split_at(bytes.len().saturating_sub(size_of::<u128>()));
    let is_whole = Hasher::oneshot(before).to_le_bytes() == hash;
    let line = after
        .split(|byte| *byte == b'\n')
        .next()
        .unwrap_or_default();
    let Some(value) = before
        .get(START.len() + line.len() + 1..)
        .filter(|_| is_whole)
    else {
        return wrong(
            Location::Byte(bytes.len() as u64),
            "a file that is cut off or changed",
            "the file as the run wrote it: run again",
        );
    };
    if line != program.as_bytes() {
        let found = format!(
            "a file kept by another program (boresight {})",
            String::from_utf8_lossy(line)
        );
        let expected = format!(
            "a file kept by this program (boresight {program}): use that program, or run again with this one"
        );
        return wrong(Location::Line(1), &found, &expected);
    }
    match postcard::take_from_bytes(value) {
        Ok((value, [])) => Ok(value),
        _ => wrong(
            Location::Whole,
            "a value of another kind",
            "the value that this program keeps under this name: run again",
        ),
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};
    use serde::Deserialize;

    use super::*;
    use crate::geometry::{Bending, BodyFromScanner, Rotation, Vec3};

    #[derive(Serialize, Deserialize)]
    enum Kind {
        Plain,
        Named(String),
    }

    /// One field of each kind.
    #[derive(Serialize, Deserialize)]
    struct Value {
        kinds: Vec<Kind>,
        missing: Option<f64>,
        numbers: Vec<(usize, [f32; 2])>,
        hash: u128,
        place: Vec3,
        mounting: BodyFromScanner,
        motion: Bending,
        row: DVector<f64>,
        table: DMatrix<f64>,
    }

    fn value() -> Value {
        let signalling = f64::from_bits(0x7ff4_0000_dead_beef);
        // A quaternion whose last bits a normalisation would change.
        let rotation = Rotation::from_euler_angles(0.1, 0.2, 0.3).into_inner() * (1.0 + 1e-15);
        Value {
            kinds: vec![Kind::Named("left".into()), Kind::Plain],
            missing: None,
            numbers: vec![(7, [0.1, -0.0])],
            hash: u128::MAX - 1,
            place: Vec3::new(1e-300, f64::NEG_INFINITY, signalling),
            mounting: BodyFromScanner::new(Rotation::new_unchecked(rotation), -Vec3::zeros()),
            motion: Bending::new(0.5, 0.05, vec![[0.1; 6], [f64::NAN; 6]]),
            row: DVector::from_vec(vec![1.0, 0.1 + 0.2]),
            table: DMatrix::from_fn(2, 3, |i, j| (i + 10 * j) as f64),
        }
    }

    #[test]
    fn values_come_back_bit_by_bit() {
        let (value, path) = (value(), Path::new("value.kept"));
        let bytes = bytes_of(&value).unwrap();
        let back: Value = parse(path, &bytes, PROGRAM).unwrap();
        assert_eq!(bytes_of(&back).unwrap(), bytes);
        assert_eq!(back.table, value.table);
        assert_eq!(back.mounting, value.mounting);
        assert_eq!(back.place.z.to_bits(), value.place.z.to_bits());
        assert!(back.mounting.translation_m.x.is_sign_negative());
    }

    #[test]
    fn damaged_files_and_files_of_other_programs_are_refused() {
        let path = Path::new("value.kept");
        let bytes = bytes_of(&value()).unwrap();
        let refused = |bytes: &[u8], program: &str| {
            let error = parse::<Value>(path, bytes, program).err().unwrap();
            assert!(error.to_string().starts_with("value.kept"), "{error}");
            error.to_string()
        };
        for length in 0..bytes.len() {
            let error = refused(&bytes[..length], PROGRAM);
            let starts = length >= START.len();
            assert_eq!(error.contains("cut off"), starts, "{length} bytes: {error}");
        }
        for place in 0..bytes.len() {
            let mut bytes = bytes.clone();
            bytes[place] ^= 1;
            refused(&bytes, PROGRAM);
        }
        refused(&bytes_of(&(value(), true)).unwrap(), PROGRAM);
        let error = refused(&bytes, "another");
        assert!(error.contains("another program"), "{error}");
        assert!(error.contains(env!("CARGO_PKG_VERSION")), "{error}");
    }
}
