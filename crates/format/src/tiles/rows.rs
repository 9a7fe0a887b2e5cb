//! Features of points, stored in memory or on disk until they are written.

use std::fs;
use std::path::{Path, PathBuf};

use super::records::{Appender, number, read_records};
use crate::cloud::Surroundings;
use crate::cloud::shape::{Feature, Shape};
use crate::error::{Error, Result};

/// Number of columns of all features.
pub const FEATURE_COLUMNS: usize = 14;
/// Bytes of a row on disk, after the index of its point.
const RECORD: usize = 4 * FEATURE_COLUMNS;

/// The chosen features of one point, rounded for writing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FeatureRow {
    /// Their columns in the chosen order, each as the bits of an f32 or as the number of neighbours; the rest is 0.
    pub words: [u32; FEATURE_COLUMNS],
}

impl FeatureRow {
    /// The features of a neighbourhood.
    pub fn of(near: &Surroundings, features: &[Feature]) -> Self {
        Self::of_shape(&Shape::of_wanted(near, features), features)
    }

    fn of_shape(shape: &Shape, features: &[Feature]) -> Self {
        let mut words = [0; FEATURE_COLUMNS];
        let mut places = words.iter_mut();
        for &feature in features {
            // The shorter iterator first: zip must not consume a column without a value for it.
            let values = shape.values(feature).into_iter();
            for (value, place) in values.take(feature.columns().len()).zip(&mut places) {
                *place = match feature {
                    Feature::Neighbours => value as u32,
                    _ => (value as f32).to_bits(),
                };
            }
        }
        Self { words }
    }

    /// Fills in the columns of `features`, which must be those that the row was made with.
    pub(super) fn fill(&self, features: &[Feature], values: &mut [f64]) {
        let columns = features
            .iter()
            .flat_map(|feature| feature.columns().iter().map(move |_| feature));
        for ((value, &word), feature) in values.iter_mut().zip(&self.words).zip(columns) {
            *value = match feature {
                Feature::Neighbours => f64::from(word),
                _ => f64::from(f32::from_bits(word)),
            };
        }
    }

    fn to_bytes(self) -> [u8; RECORD] {
        let mut bytes = [0; RECORD];
        for (place, word) in bytes.as_chunks_mut::<4>().0.iter_mut().zip(self.words) {
            *place = word.to_le_bytes();
        }
        bytes
    }

    fn from_bytes(bytes: &[u8]) -> Self {
        let mut words = [0; FEATURE_COLUMNS];
        for (word, bytes) in words.iter_mut().zip(bytes.as_chunks::<4>().0) {
            *word = u32::from_le_bytes(*bytes);
        }
        Self { words }
    }
}

/// Rows on disk: added in any order, and sorted into files that each cover a range of indices.
pub(super) struct RowStore {
    folder: PathBuf,
    appender: Appender,
    points: u64,
    range: u64,
}

impl RowStore {
    /// A store for `points` rows, of which `range` will be in memory at a time.
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

    /// Finishes writing, for reading in order.
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

/// Rows by index. Its folder is removed when it is dropped.
pub(super) struct SortedRows {
    folder: PathBuf,
    points: u64,
    range: u64,
    loaded: Option<u64>,
    rows: Vec<FeatureRow>,
}

impl SortedRows {
    /// The row at an index; fast if indices ascend.
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
        let mut rows = 0;
        self.rows.clear();
        self.rows.resize(
            expected as usize,
            FeatureRow {
                words: [0; FEATURE_COLUMNS],
            },
        );
        read_records::<{ RECORD + 8 }>(&path(&self.folder, file), |record| {
            let place = (number(record) - first) as usize;
            self.rows[place] = FeatureRow::from_bytes(&record[8..]);
            rows += 1;
            Ok(())
        })?;
        if rows != expected {
            return Err(Error::data(
                format!(
                    "{}: found {rows} of {expected} rows in a temporary file",
                    self.folder.display()
                ),
                "free disk space and run again; no other program may write to this folder",
            ));
        }
        self.loaded = Some(file);
        Ok(())
    }
}

impl Drop for SortedRows {
    fn drop(&mut self) {
        // A failure cannot be handled here; the staging area is removed as a whole.
        let _ = fs::remove_dir_all(&self.folder);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::StructureTensor;
    use crate::geometry::Vec3;

    fn row(i: u32) -> FeatureRow {
        FeatureRow {
            words: std::array::from_fn(|at| i * 20 + at as u32),
        }
    }

    #[test]
    fn the_number_of_columns_is_that_of_all_features() {
        let columns = Feature::ALL.map(|feature| feature.columns().len());
        assert_eq!(columns.iter().sum::<usize>(), FEATURE_COLUMNS);
        let shape = Shape {
            normal: Vec3::new(69.0, 70.0, 71.0),
            neighbours: 21,
            omnivariance_m2: 60.0,
            radius_m: 72.0,
            ..Shape::of(&Surroundings {
                tensor: StructureTensor::from_points(&[]),
                reach_m: 0.0,
            })
        };
        let mut values = [0.0; 6];
        let chosen = [
            Feature::Normal,
            Feature::Neighbours,
            Feature::Omnivariance,
            Feature::Radius,
        ];
        FeatureRow::of_shape(&shape, &chosen).fill(&chosen, &mut values);
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
        assert!(error.to_string().contains("1 of 3 rows"), "{error}");
    }
}
