//! Clouds in square tiles: points go to disk by tile as they come, and from there into one COPC file a tile.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{BufReader, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::format::{CloudPoint, CloudShape, CloudSink, copc_sink};
use crate::geometry::Vec3;
use crate::progress::Progress;

/// Points of a tile are kept in memory until they are this many bytes.
const BUFFER: usize = 1 << 20;

/// Which tile: its place in the grid, of which (0, 0) has its south-west corner at the origin of the world.
type Place = (i64, i64);

/// A written tile.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Tile {
    /// The file, relative to the folder of the results.
    pub file: String,
    /// Number of points.
    pub points: u64,
    /// Lowest coordinates of its points (east, north, up), metres.
    pub low_m: [f64; 3],
    /// Highest coordinates, metres.
    pub high_m: [f64; 3],
}

/// The points of one scanner in one tile.
struct Spool {
    path: PathBuf,
    bytes: Vec<u8>,
    points: u64,
    low: Vec3,
    high: Vec3,
}

impl Spool {
    fn flush(&mut self) -> Result<()> {
        let failed = |error| Error::io(&self.path, error);
        let mut file = File::options()
            .create(true)
            .append(true)
            .open(&self.path)
            .map_err(failed)?;
        file.write_all(&self.bytes).map_err(failed)?;
        self.bytes.clear();
        Ok(())
    }
}

/// The tiles of a drive while its points come, of several scanners at the same time.
pub struct Tiling {
    folder: PathBuf,
    side_m: f64,
    /// By tile, then by scanner.
    spools: Mutex<BTreeMap<Place, BTreeMap<usize, Spool>>>,
}

impl Tiling {
    /// Tiles of this side; `folder` takes points until the tiles are written, and does not exist.
    ///
    /// # Errors
    /// The folder cannot be created.
    pub fn new(folder: PathBuf, side_m: f64) -> Result<Self> {
        fs::create_dir_all(&folder).map_err(|error| Error::io(&folder, error))?;
        Ok(Self {
            folder,
            side_m,
            spools: Mutex::default(),
        })
    }

    /// What takes the points of a scanner.
    pub fn sink(&self, scanner: usize) -> Box<dyn CloudSink + '_> {
        Box::new(TiledSink {
            tiling: self,
            scanner,
            spools: BTreeMap::new(),
        })
    }

    /// Writes a COPC file for each tile into `folder`, scanners in their order, and removes what was kept of the
    /// points.
    ///
    /// # Errors
    /// A file that cannot be written; a point that COPC cannot hold; [`Error::Cancelled`].
    pub fn write(
        self,
        folder: &Path,
        shape: &CloudShape,
        progress: &dyn Progress,
    ) -> Result<Vec<Tile>> {
        let spools = self
            .spools
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner);
        let total = spools
            .values()
            .flat_map(BTreeMap::values)
            .map(|spool| spool.points)
            .sum();
        let stage = progress.stage("writing tiles", total);
        let mut tiles = Vec::new();
        for ((east, north), scanners) in &spools {
            let name = format!("tile_{east}_{north}.copc.laz");
            let low = scanners
                .values()
                .fold(Vec3::repeat(f64::INFINITY), |low, spool| {
                    low.inf(&spool.low)
                });
            let high = scanners
                .values()
                .fold(Vec3::repeat(f64::NEG_INFINITY), |high, spool| {
                    high.sup(&spool.high)
                });
            let shape = CloudShape {
                low,
                high,
                ..shape.clone()
            };
            let mut sink = copc_sink(&folder.join(&name), &shape)?;
            let mut points = 0;
            for spool in scanners.values() {
                read(spool, shape.dimensions.len(), sink.as_mut())?;
                points += spool.points;
                stage.advance(spool.points)?;
            }
            sink.finish()?;
            tiles.push(Tile {
                file: name,
                points,
                low_m: low.into(),
                high_m: high.into(),
            });
        }
        fs::remove_dir_all(&self.folder).map_err(|error| Error::io(&self.folder, error))?;
        Ok(tiles)
    }
}

/// The tiles of one scanner.
struct TiledSink<'a> {
    tiling: &'a Tiling,
    scanner: usize,
    spools: BTreeMap<Place, Spool>,
}

impl CloudSink for TiledSink<'_> {
    fn push(&mut self, point: &CloudPoint<'_>) -> Result<()> {
        let [east, north] =
            [point.position.x, point.position.y].map(|x| (x / self.tiling.side_m).floor() as i64);
        let spool = self.spools.entry((east, north)).or_insert_with(|| Spool {
            path: self
                .tiling
                .folder
                .join(format!("{east}_{north}_{}", self.scanner)),
            bytes: Vec::with_capacity(BUFFER),
            points: 0,
            low: point.position,
            high: point.position,
        });
        spool.points += 1;
        spool.low = spool.low.inf(&point.position);
        spool.high = spool.high.sup(&point.position);
        let [x, y, z] = point.position.into();
        for value in [x, y, z, point.time_s, point.intensity.into()]
            .iter()
            .chain(point.values)
        {
            spool.bytes.extend_from_slice(&value.to_le_bytes());
        }
        if spool.bytes.len() >= BUFFER {
            spool.flush()?;
        }
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        let mut all = self
            .tiling
            .spools
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        for (place, mut spool) in std::mem::take(&mut self.spools) {
            spool.flush()?;
            all.entry(place).or_default().insert(self.scanner, spool);
        }
        Ok(())
    }
}

/// Passes the points of a spool on.
fn read(spool: &Spool, dimensions: usize, sink: &mut dyn CloudSink) -> Result<()> {
    let failed = |error| Error::io(&spool.path, error);
    let mut file = BufReader::with_capacity(BUFFER, File::open(&spool.path).map_err(failed)?);
    let mut record = vec![0; 8 * (5 + dimensions)];
    let mut values = vec![0.0; 5 + dimensions];
    loop {
        match file.read_exact(&mut record) {
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => return Ok(()),
            other => other.map_err(failed)?,
        }
        for (value, bytes) in values.iter_mut().zip(record.as_chunks().0) {
            *value = f64::from_le_bytes(*bytes);
        }
        sink.push(&CloudPoint {
            position: Vec3::new(values[0], values[1], values[2]),
            time_s: values[3],
            // It came from single precision.
            intensity: values[4] as f32,
            values: &values[5..],
        })?;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::{ExtraDimension, ExtraKind, read_cloud};
    use crate::progress::Silent;

    #[test]
    fn every_point_is_in_the_tile_of_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let tiling = Tiling::new(folder.path().join("spool"), 10.0).unwrap();
        let shape = CloudShape {
            has_time: true,
            has_intensity: true,
            dimensions: vec![ExtraDimension::new("scanner", ExtraKind::U32, "number")],
            ..CloudShape::default()
        };
        for scanner in [1, 0] {
            let mut sink = tiling.sink(scanner);
            for i in 0..100 {
                let point = CloudPoint {
                    position: Vec3::new(f64::from(i) - 50.0, 3.0, 1.0),
                    time_s: f64::from(i),
                    intensity: 7.0,
                    values: &[scanner as f64],
                };
                sink.push(&point).unwrap();
            }
            sink.finish().unwrap();
        }
        let tiles = tiling.write(folder.path(), &shape, &Silent).unwrap();
        assert_eq!(tiles.len(), 10);
        assert_eq!(tiles[0].file, "tile_-5_0.copc.laz");
        for (tile, first) in tiles.iter().zip((-50..).step_by(10)) {
            let cloud = read_cloud(&folder.path().join(&tile.file)).unwrap();
            assert_eq!((cloud.points.len(), tile.points), (20, 20));
            assert_eq!(tile.low_m[0], f64::from(first));
            assert_eq!(tile.high_m[0], f64::from(first + 9));
        }
        assert!(!folder.path().join("spool").exists());
    }
}
