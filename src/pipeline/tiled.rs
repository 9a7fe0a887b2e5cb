//! Clouds in square tiles: points are written to disk by tile as they arrive, and then into one COPC file per tile.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use serde::{Deserialize, Serialize};

use crate::error::{Error, Location, Result};
use crate::format::{CloudPoint, CloudShape, CloudSink, ExtraValue, copc_sink};
use crate::geometry::Vec3;
use crate::progress::Progress;

/// Limit of the memory of points that are not on disk yet, bytes: an eighth of the least memory for which a campaign
/// runs another item at the same time (500 MB).
const MOST_WAITING: usize = 64 << 20;
/// Points of a tile are written to disk in pieces of this many bytes, if memory allows.
const PIECE: usize = 1 << 20;

/// Place of a tile in the grid; tile (0, 0) has its south-west corner at the origin of the world.
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
    /// Points that are not in its file yet.
    waiting: Vec<u8>,
    points: u64,
    low: Vec3,
    high: Vec3,
}

/// The tiles of a drive while points of several scanners arrive at the same time.
pub struct Tiling {
    folder: PathBuf,
    side_m: f64,
    /// Limit of the memory of the points of each scanner that are not on disk yet, bytes.
    most_waiting: usize,
    /// Spools by tile, then by scanner.
    spools: Mutex<BTreeMap<Place, BTreeMap<usize, Spool>>>,
}

impl Tiling {
    /// Tiles with sides of `side_m` for the points of this many scanners; `folder` holds the points until the tiles are
    /// written, and must not exist yet.
    ///
    /// # Errors
    /// The folder cannot be created.
    pub fn new(folder: PathBuf, side_m: f64, scanners: usize) -> Result<Self> {
        fs::create_dir_all(&folder).map_err(|error| Error::io(&folder, error))?;
        Ok(Self {
            folder,
            side_m,
            most_waiting: MOST_WAITING / scanners.max(1),
            spools: Mutex::default(),
        })
    }

    /// The sink for the points of a scanner.
    pub fn sink(&self, scanner: usize) -> Box<dyn CloudSink + '_> {
        Box::new(self.tiled(scanner))
    }

    fn tiled(&self, scanner: usize) -> TiledSink<'_> {
        TiledSink {
            tiling: self,
            scanner,
            spools: BTreeMap::new(),
            held: 0,
        }
    }

    /// The file of the points of a scanner in a tile.
    fn path(&self, (east, north): Place, scanner: usize) -> PathBuf {
        self.folder.join(format!("{east}_{north}_{scanner}"))
    }

    /// Writes a COPC file for each tile into `folder`, scanners in their order, and removes the temporary files of the
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
        let spools = self.spools.lock().unwrap_or_else(PoisonError::into_inner);
        let total = spools
            .values()
            .flat_map(BTreeMap::values)
            .map(|spool| spool.points)
            .sum();
        let stage = progress.stage("writing tiles", total);
        let mut tiles = Vec::new();
        for (place, scanners) in spools.iter() {
            let name = format!("tile_{}_{}.copc.laz", place.0, place.1);
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
            for (scanner, spool) in scanners {
                let path = self.path(*place, *scanner);
                read(&path, spool.points, shape.dimensions.len(), sink.as_mut())?;
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
    /// Memory of the points that are not on disk yet, bytes.
    held: usize,
}

impl TiledSink<'_> {
    /// Frees half of the memory. The fullest tiles are written first, so that few files get large pieces.
    fn relieve(&mut self) -> Result<()> {
        let mut fullest: Vec<(&Place, &mut Spool)> = self.spools.iter_mut().collect();
        fullest.sort_by_key(|(_, spool)| Reverse(spool.waiting.capacity()));
        for (place, spool) in fullest {
            if self.held <= self.tiling.most_waiting / 2 {
                break;
            }
            let waiting = std::mem::take(&mut spool.waiting);
            self.held -= waiting.capacity();
            append(&self.tiling.path(*place, self.scanner), &waiting)?;
        }
        Ok(())
    }
}

impl CloudSink for TiledSink<'_> {
    fn push(&mut self, point: &CloudPoint<'_>) -> Result<()> {
        let [east, north] =
            [point.position.x, point.position.y].map(|x| (x / self.tiling.side_m).floor() as i64);
        let place = (east, north);
        let spool = self.spools.entry(place).or_insert_with(|| Spool {
            waiting: Vec::new(),
            points: 0,
            low: point.position,
            high: point.position,
        });
        spool.points += 1;
        spool.low = spool.low.inf(&point.position);
        spool.high = spool.high.sup(&point.position);
        let [x, y, z] = point.position.into();
        let fields = [x, y, z, point.time_s, point.intensity.into()];
        let before = spool.waiting.capacity();
        spool
            .waiting
            .reserve(8 * (fields.len() + point.values.len()));
        self.held += spool.waiting.capacity() - before;
        let values = point.values.iter().map(|value| value.number());
        for value in fields.into_iter().chain(values) {
            spool.waiting.extend_from_slice(&value.to_le_bytes());
        }
        if spool.waiting.len() >= PIECE {
            append(&self.tiling.path(place, self.scanner), &spool.waiting)?;
            spool.waiting.clear();
        }
        if self.held > self.tiling.most_waiting {
            self.relieve()?;
        }
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        for (place, spool) in &mut self.spools {
            let waiting = std::mem::take(&mut spool.waiting);
            append(&self.tiling.path(*place, self.scanner), &waiting)?;
        }
        let mut all = self
            .tiling
            .spools
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        for (place, spool) in std::mem::take(&mut self.spools) {
            all.entry(place).or_default().insert(self.scanner, spool);
        }
        Ok(())
    }
}

/// Appends to a file, which is created if it is missing; does nothing without bytes.
fn append(path: &Path, bytes: &[u8]) -> Result<()> {
    if bytes.is_empty() {
        return Ok(());
    }
    let opened = File::options().create(true).append(true).open(path);
    opened
        .and_then(|mut file| file.write_all(bytes))
        .map_err(|error| Error::io(path, error))
}

/// Passes the points of a file, of which there must be this many, to a sink.
fn read(path: &Path, points: u64, dimensions: usize, sink: &mut dyn CloudSink) -> Result<()> {
    let failed = |error| Error::io(path, error);
    let mut file = BufReader::with_capacity(PIECE, File::open(path).map_err(failed)?);
    let mut record = vec![0; 8 * (5 + dimensions)];
    let found = file.get_ref().metadata().map_err(failed)?.len();
    let expected = points * record.len() as u64;
    if found != expected {
        return Err(Error::format(
            path,
            Location::Whole,
            format!("{found} bytes"),
            format!("{expected} bytes of {points} points, as they were written"),
        ));
    }
    let mut values = vec![0.0; 5 + dimensions];
    let mut extra = Vec::with_capacity(dimensions);
    for _ in 0..points {
        file.read_exact(&mut record).map_err(failed)?;
        for (value, bytes) in values.iter_mut().zip(record.as_chunks().0) {
            *value = f64::from_le_bytes(*bytes);
        }
        extra.clear();
        extra.extend(values[5..].iter().map(|value| ExtraValue::Number(*value)));
        sink.push(&CloudPoint {
            position: Vec3::new(values[0], values[1], values[2]),
            time_s: values[3],
            // The intensity was stored from single precision.
            intensity: values[4] as f32,
            values: &extra,
        })?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::{ExtraDimension, ExtraKind, read_cloud};
    use crate::progress::Silent;

    fn shape() -> CloudShape {
        CloudShape {
            has_time: true,
            has_intensity: true,
            dimensions: vec![ExtraDimension::new("scanner", ExtraKind::U32, "number")],
            ..CloudShape::default()
        }
    }

    #[test]
    fn every_point_is_in_the_tile_of_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let tiling = Tiling::new(folder.path().join("spool"), 10.0, 2).unwrap();
        for scanner in [1, 0] {
            let mut sink = tiling.sink(scanner);
            for i in 0..100 {
                let point = CloudPoint {
                    position: Vec3::new(f64::from(i) - 50.0, 3.0, 1.0),
                    time_s: f64::from(i),
                    intensity: 7.0,
                    values: &[ExtraValue::Number(scanner as f64)],
                };
                sink.push(&point).unwrap();
            }
            sink.finish().unwrap();
        }
        let tiles = tiling.write(folder.path(), &shape(), &Silent).unwrap();
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

    #[test]
    fn a_spool_that_lost_bytes_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let tiling = Tiling::new(folder.path().join("spool"), 10.0, 1).unwrap();
        let mut sink = tiling.sink(0);
        for i in 0..9 {
            let point = CloudPoint {
                position: Vec3::new(f64::from(i), 3.0, 1.0),
                time_s: 1.0,
                intensity: 7.0,
                values: &[ExtraValue::Number(0.0)],
            };
            sink.push(&point).unwrap();
        }
        sink.finish().unwrap();
        let spool = File::options().write(true).open(tiling.path((0, 0), 0));
        spool.unwrap().set_len(8 * 48 + 1).unwrap();
        let error = tiling.write(folder.path(), &shape(), &Silent).unwrap_err();
        let error = error.to_string();
        assert!(
            error.contains("385 bytes") && error.contains("9 points"),
            "{error}"
        );
    }

    /// Tiles the points of a scanner that moves to and fro over a field of 20 m, with a limit of the waiting bytes;
    /// returns the bytes of each tile, and the most memory that waiting points took.
    fn tiled(side_m: f64, most_waiting: usize) -> (BTreeMap<String, Vec<u8>>, usize) {
        let folder = tempfile::tempdir().unwrap();
        let spool = folder.path().join("spool");
        let mut tiling = Tiling::new(spool, side_m, 1).unwrap();
        tiling.most_waiting = most_waiting;
        let mut sink = Box::new(tiling.tiled(0));
        let mut most = 0;
        for i in 0..20_000 {
            let at = f64::from(i);
            let point = CloudPoint {
                position: Vec3::new(20.0 * (0.618 * at).fract(), 1e-3 * at, 0.1 * at.sin()),
                time_s: at,
                intensity: 7.0,
                values: &[ExtraValue::Number(0.0)],
            };
            sink.push(&point).unwrap();
            let held = sink.spools.values().map(|spool| spool.waiting.capacity());
            let held = held.sum::<usize>();
            assert_eq!(sink.held, held);
            most = most.max(held);
        }
        sink.finish().unwrap();
        let tiles = tiling.write(folder.path(), &shape(), &Silent).unwrap();
        let bytes = |tile: &Tile| fs::read(folder.path().join(&tile.file)).unwrap();
        let tiles = tiles.iter().map(|tile| (tile.file.clone(), bytes(tile)));
        (tiles.collect(), most)
    }

    #[test]
    fn many_small_tiles_take_no_more_memory_than_few() {
        let (plain, all) = tiled(1.0, usize::MAX);
        assert_eq!(plain.len(), 400);
        // No memory is taken beyond the needs of the points.
        assert!(all < 4 * 48 * 20_000, "{all}");
        for most_waiting in [20_000, 200_000] {
            let (bounded, held) = tiled(1.0, most_waiting);
            assert!(held <= most_waiting, "{held}");
            assert!(bounded == plain, "{most_waiting}");
        }
    }
}
