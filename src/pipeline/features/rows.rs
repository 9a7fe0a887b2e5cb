//! The features of a point as they are kept until they are written, in memory or on disk.

use std::fs;
use std::path::{Path, PathBuf};

use crate::cloud::shape::{Feature, Shape};
use crate::error::{Error, Result};
use crate::pipeline::tile_store::{Appender, number, read_records};

/// Columns of all features but the number of neighbours.
const NUMBERS: usize = 13;
/// Bytes of a row on disk, after the place of its point.
const RECORD: usize = 4 * NUMBERS + 4;

/// All features of a point, rounded as they are written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FeatureRow {
    /// In the order of [`Feature::ALL`].
    numbers: [f32; NUMBERS],
    neighbours: u32,
}

/// The features whose columns `numbers` holds.
fn numbered() -> impl Iterator<Item = Feature> {
    Feature::ALL
        .into_iter()
        .filter(|feature| *feature != Feature::Neighbours)
}

impl FeatureRow {
    pub(super) fn of(shape: &Shape) -> Self {
        let mut numbers = [f32::NAN; NUMBERS];
        let columns = numbered().flat_map(|feature| {
            let values = shape.values(feature);
            values.into_iter().take(feature.columns().len())
        });
        for (place, value) in numbers.iter_mut().zip(columns) {
            *place = value as f32;
        }
        Self {
            numbers,
            neighbours: u32::try_from(shape.neighbours).unwrap_or(u32::MAX),
        }
    }

    /// Fills the columns of `features`.
    pub(super) fn select(&self, features: &[Feature], values: &mut [f64]) {
        let mut places = values.iter_mut();
        for feature in features {
            if *feature == Feature::Neighbours {
                if let Some(place) = places.next() {
                    *place = f64::from(self.neighbours);
                }
                continue;
            }
            let first: usize = numbered()
                .take_while(|other| other != feature)
                .map(|other| other.columns().len())
                .sum();
            let numbers = &self.numbers[first..first + feature.columns().len()];
            // The shorter one first: it must not take a place for a number it does not have.
            for (number, place) in numbers.iter().zip(&mut places) {
                *place = f64::from(*number);
            }
        }
    }

    fn to_bytes(self) -> [u8; RECORD] {
        let mut bytes = [0; RECORD];
        let numbers = self.numbers.iter().map(|number| number.to_le_bytes());
        let words = numbers.chain([self.neighbours.to_le_bytes()]);
        let (places, _) = bytes.as_chunks_mut::<4>();
        for (place, word) in places.iter_mut().zip(words) {
            *place = word;
        }
        bytes
    }

    fn from_bytes(bytes: &[u8]) -> Self {
        let (words, _) = bytes.as_chunks::<4>();
        let mut numbers = [0.0; NUMBERS];
        for (number, word) in numbers.iter_mut().zip(words) {
            *number = f32::from_le_bytes(*word);
        }
        let last = words.get(NUMBERS).copied().unwrap_or_default();
        Self {
            numbers,
            neighbours: u32::from_le_bytes(last),
        }
    }
}

/// Rows on disk: taken in any order, sorted into files by ranges of places.
pub(super) struct RowStore {
    folder: PathBuf,
    appender: Appender,
    points: u64,
    range: u64,
}

impl RowStore {
    /// For `points` rows, of which `range` will be in memory at a time.
    pub(super) fn create(folder: &Path, points: u64, range: usize) -> Result<Self> {
        fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
        let range = range as u64;
        Ok(Self {
            folder: folder.to_owned(),
            appender: Appender::new(points.div_ceil(range) as usize),
            points,
            range,
        })
    }

    pub(super) fn put(&mut self, index: u64, row: &FeatureRow) -> Result<()> {
        let file = index / self.range;
        let parts = [&index.to_le_bytes()[..], &row.to_bytes()[..]];
        let path = || path(&self.folder, file);
        self.appender.push(file as usize, &parts, path)
    }

    /// To be read in order.
    pub(super) fn sorted(self) -> Result<SortedRows> {
        self.appender
            .finish(|file| path(&self.folder, file as u64))?;
        Ok(SortedRows {
            folder: self.folder,
            points: self.points,
            range: self.range,
            loaded: None,
            rows: Vec::new(),
        })
    }
}

fn path(folder: &Path, file: u64) -> PathBuf {
    folder.join(format!("rows-{file}"))
}

/// Rows by place. Its folder goes when it is dropped.
pub(super) struct SortedRows {
    folder: PathBuf,
    points: u64,
    range: u64,
    loaded: Option<u64>,
    rows: Vec<FeatureRow>,
}

impl SortedRows {
    /// The row of a place; fast where places ascend.
    pub(super) fn row(&mut self, index: u64) -> Result<FeatureRow> {
        let file = index / self.range;
        if self.loaded != Some(file) {
            self.load(file)?;
        }
        Ok(self.rows[(index % self.range) as usize])
    }

    fn load(&mut self, file: u64) -> Result<()> {
        let first = file * self.range;
        let expected = self.range.min(self.points - first);
        let mut found = 0;
        self.rows.clear();
        self.rows.resize(
            expected as usize,
            FeatureRow {
                numbers: [f32::NAN; NUMBERS],
                neighbours: 0,
            },
        );
        read_records::<{ RECORD + 8 }>(&path(&self.folder, file), |record| {
            let place = (number(record) - first) as usize;
            self.rows[place] = FeatureRow::from_bytes(&record[8..]);
            found += 1;
            Ok(())
        })?;
        if found != expected {
            return Err(Error::data(
                format!(
                    "{}: {found} rows of {expected} in a temporary file",
                    self.folder.display()
                ),
                "free space on the disk and run again; nothing else may write to this folder",
            ));
        }
        self.loaded = Some(file);
        Ok(())
    }
}

impl Drop for SortedRows {
    fn drop(&mut self) {
        // Nothing can be done about a failure here; the staging area is removed as a whole.
        let _ = fs::remove_dir_all(&self.folder);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(i: u32) -> FeatureRow {
        let numbers = std::array::from_fn(|at| (i * 20 + at as u32) as f32);
        FeatureRow {
            numbers,
            neighbours: 7 * i,
        }
    }

    #[test]
    fn columns_count_as_many_as_features_have() {
        let columns: usize = numbered().map(|feature| feature.columns().len()).sum();
        assert_eq!(columns, NUMBERS);
        let mut values = [0.0; 6];
        let chosen = [
            Feature::Normal,
            Feature::Neighbours,
            Feature::Omnivariance,
            Feature::Radius,
        ];
        row(3).select(&chosen, &mut values);
        assert_eq!(values, [69.0, 70.0, 71.0, 21.0, 60.0, 72.0]);
    }

    #[test]
    fn rows_come_back_in_order() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("rows");
        let mut store = RowStore::create(&place, 1000, 128).unwrap();
        for i in 0..1000u32 {
            let index = i * 387 % 1000;
            store.put(u64::from(index), &row(index)).unwrap();
        }
        let mut sorted = store.sorted().unwrap();
        for i in 0..1000 {
            assert_eq!(sorted.row(u64::from(i)).unwrap(), row(i));
        }
        drop(sorted);
        assert!(!place.exists());
        let mut store = RowStore::create(&place, 3, 128).unwrap();
        store.put(0, &row(0)).unwrap();
        let error = store.sorted().unwrap().row(0).unwrap_err();
        assert!(error.to_string().contains("1 rows of 3"), "{error}");
    }
}
