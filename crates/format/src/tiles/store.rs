//! A cloud larger than memory, stored on disk in tiles: streamed in once, read back by rectangle.
//!
//! Results do not depend on the tiles: [`TileStore::within`] returns all points in a rectangle in
//! the order of the stream. Work that needs all points within a distance h goes tile by tile like this:
//!
//! ```text
//! let store = TileStore::write(&staging.path("tiles"), most_points, stream)?;
//! for tile in store.tiles().rectangles() {
//!     let near = store.within(&tile.widened(h))?;   // the points with halo
//!     let in_tile = near.points.iter().filter(|point| tile.contains(point));
//! }
//! ```
//!
//! For two clouds, each has its own store; the tiles of one serve as rectangles for both.

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::plane::{Rectangle, Tiles};
use super::records::{Appender, number, read_records};
use super::source::CloudSource;
use super::stage::stage;
use crate::cloud::Stream;
use crate::error::{Error, Result};
use crate::geometry::Vec3;
use crate::progress::Progress;
use crate::statistics::EvenSample;

/// Bytes of a point in a file: index and three coordinates.
const RECORD: usize = 32;
/// Largest sample from which the tiles are laid out.
const MOST_SAMPLED: usize = 1 << 18;

/// Points with their indices in the stream.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TilePoints {
    /// Index of each point in the stream, counted from 0, ascending.
    pub indices: Vec<u64>,
    /// The points, metres.
    pub points: Vec<Vec3>,
}

/// The points of a cloud on disk, by tile. Its folder is removed when it is dropped.
#[derive(Debug)]
pub struct TileStore {
    folder: PathBuf,
    tiles: Tiles,
    counts: Vec<u64>,
    low: Vec3,
    high: Vec3,
}

impl TileStore {
    /// Writes the points of `stream` into `folder`, which is created, in tiles of at most about
    /// `most_points`; more only if points coincide in the plane. Takes 32 bytes of disk per point
    /// (56 while it is written), and memory for a tile and about 100 MB.
    ///
    /// The folder belongs to the store. Inside a [`crate::output::Staging`] it is removed even
    /// after a killed run.
    ///
    /// # Errors
    /// Errors of the stream, a folder that cannot be written.
    pub fn write(folder: &Path, most_points: usize, stream: &mut Stream<'_>) -> Result<Self> {
        fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
        // From here on the folder is also removed on failure.
        let mut store = Self {
            folder: folder.to_owned(),
            tiles: Tiles::new(&mut [], 1),
            counts: Vec::new(),
            low: Vec3::repeat(f64::INFINITY),
            high: Vec3::repeat(f64::NEG_INFINITY),
        };
        let whole = folder.join("whole");
        let (count, mut sample) = store.gather(&whole, stream)?;
        let share = sample.len() as f64 / count.max(1) as f64;
        let most = (most_points as f64 * share).floor().max(1.0) as usize;
        store.tiles = Tiles::new(&mut sample, most);
        store.counts = vec![0; store.tiles.rectangles().len()];
        store.spread(&whole)?;
        fs::remove_file(&whole).map_err(|e| Error::io(&whole, e))?;
        Ok(store)
    }

    /// As [`Self::write`], for the points of a cloud, as a stage of `progress`.
    ///
    /// # Errors
    /// As [`Self::write`] and [`CloudSource::stream`].
    pub fn of(
        cloud: &CloudSource,
        folder: &Path,
        most_points: usize,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let mut stream = |each: &mut dyn FnMut(&[Vec3]) -> Result<()>| cloud.stream(progress, each);
        let write = || Self::write(folder, most_points, &mut stream);
        stage(progress, "sorting a cloud into tiles", cloud.len(), write).map(|(store, _)| store)
    }

    /// Writes the stream unsorted, and returns the number of points and an even sample of them.
    fn gather(&mut self, whole: &Path, stream: &mut Stream<'_>) -> Result<(u64, Vec<[f64; 2]>)> {
        let file = File::create(whole).map_err(|e| Error::io(whole, e))?;
        let mut out = BufWriter::with_capacity(1 << 20, file);
        let mut sample = EvenSample::new(MOST_SAMPLED);
        stream(&mut |points| {
            for point in points {
                self.low = self.low.inf(point);
                self.high = self.high.sup(point);
                sample.push([point.x, point.y]);
                for value in point.iter() {
                    out.write_all(&value.to_le_bytes())
                        .map_err(|e| Error::io(whole, e))?;
                }
            }
            Ok(())
        })?;
        out.flush().map_err(|e| Error::io(whole, e))?;
        Ok((sample.seen(), sample.into_values()))
    }

    /// Sorts the gathered points into the files of the tiles.
    fn spread(&mut self, whole: &Path) -> Result<()> {
        let mut appender = Appender::new(self.counts.len());
        let mut index = 0u64;
        read_records::<24>(whole, |record| {
            let point = point_of(record);
            let tile = self.tiles.tile_of(&point);
            self.counts[tile] += 1;
            let path = || self.path(tile);
            appender.push(tile, &[&index.to_le_bytes(), record], path)?;
            index += 1;
            Ok(())
        })?;
        appender.finish(|tile| self.path(tile))
    }

    fn path(&self, tile: usize) -> PathBuf {
        self.folder.join(format!("tile-{tile}"))
    }

    /// The tiles, which may be empty.
    pub fn tiles(&self) -> &Tiles {
        &self.tiles
    }

    /// Number of points in a tile.
    pub fn count(&self, tile: usize) -> u64 {
        self.counts[tile]
    }

    /// Smallest and largest coordinates of the cloud, metres; infinite if it has no points.
    pub fn extent(&self) -> (Vec3, Vec3) {
        (self.low, self.high)
    }

    /// All points in a rectangle.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn within(&self, rectangle: &Rectangle) -> Result<TilePoints> {
        let points = self.at_most(rectangle, usize::MAX)?;
        Ok(points.unwrap_or_default())
    }

    /// All points in a rectangle; `None` if there are more than `most`.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn at_most(&self, rectangle: &Rectangle, most: usize) -> Result<Option<TilePoints>> {
        let mut numbered: Vec<(u64, Vec3)> = Vec::new();
        let mut files = 0;
        for (tile, other) in self.tiles.rectangles().iter().enumerate() {
            if self.counts[tile] == 0 || !other.intersects(rectangle) {
                continue;
            }
            files += 1;
            read_records::<RECORD>(&self.path(tile), |record| {
                let point = point_of(&record[8..]);
                if rectangle.contains(&point) && numbered.len() <= most {
                    numbered.push((number(record), point));
                }
                Ok(())
            })?;
            if numbered.len() > most {
                return Ok(None);
            }
        }
        if files > 1 {
            numbered.par_sort_unstable_by_key(|(index, _)| *index);
        }
        let (indices, points) = numbered.into_iter().unzip();
        Ok(Some(TilePoints { indices, points }))
    }
}

impl Drop for TileStore {
    fn drop(&mut self) {
        // A failure cannot be handled here; the staging area is removed as a whole.
        let _ = fs::remove_dir_all(&self.folder);
    }
}

fn point_of(bytes: &[u8]) -> Vec3 {
    let (words, _) = bytes.as_chunks::<8>();
    Vec3::from_iterator(words.iter().map(|word| f64::from_le_bytes(*word)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud(n: u32) -> Vec<Vec3> {
        (0..n)
            .map(|i| {
                let x = f64::from(i);
                let far = if i % 97 == 5 { 1e5 } else { 1.0 };
                Vec3::new(
                    (x * 0.618).fract() * far,
                    (x * 0.7548).fract(),
                    (x * 0.1).sin(),
                )
            })
            .collect()
    }

    fn store(folder: &Path, points: &[Vec3], most: usize) -> TileStore {
        TileStore::write(folder, most, &mut |each| {
            points.chunks(100).try_for_each(&mut *each)
        })
        .unwrap()
    }

    #[test]
    fn rectangles_return_the_points_that_an_exhaustive_search_finds() {
        let folder = tempfile::tempdir().unwrap();
        let points = cloud(5000);
        for most in [60, 700, 5000, 100_000] {
            let place = folder.path().join("tiles");
            let store = store(&place, &points, most);
            let tiles = store.tiles().rectangles();
            assert!(tiles.len() >= 5000 / most.min(5000));
            let halos = tiles.iter().map(|tile| tile.widened(0.07));
            for rectangle in tiles.iter().copied().chain(halos) {
                let found = store.within(&rectangle).unwrap();
                let expected: Vec<u64> = (0..)
                    .zip(&points)
                    .filter(|(_, p)| rectangle.contains(p))
                    .map(|(i, _)| i)
                    .collect();
                assert_eq!(found.indices, expected);
                for (index, point) in found.indices.iter().zip(&found.points) {
                    assert_eq!(*point, points[*index as usize]);
                }
                let n = expected.len();
                assert!(store.at_most(&rectangle, n).unwrap().is_some());
                assert!(n == 0 || store.at_most(&rectangle, n - 1).unwrap().is_none());
            }
            let total: u64 = (0..tiles.len()).map(|tile| store.count(tile)).sum();
            assert_eq!(total, 5000);
            let (low, high) = store.extent();
            assert!(
                points
                    .iter()
                    .all(|p| low.inf(p) == low && high.sup(p) == high)
            );
            drop(store);
            assert!(!place.exists());
        }
    }

    #[test]
    fn a_stream_that_fails_leaves_no_files() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("tiles");
        let error = TileStore::write(&place, 10, &mut |each| {
            each(&cloud(1000))?;
            Err(Error::data("damaged in the middle", "mend it"))
        })
        .unwrap_err();
        assert!(error.to_string().starts_with("damaged"));
        assert!(!place.exists());
    }
}
