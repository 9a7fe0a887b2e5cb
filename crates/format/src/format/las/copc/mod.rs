//! Clouds written as Cloud Optimized Point Cloud (COPC 1.0, <https://copc.io>): a LAZ file of LAS
//! 1.4 whose chunks are the cells of an octree. It is read as LAZ.

mod file;
mod octree;
#[cfg(test)]
mod tests;

use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use self::file::{CopcFile, Extent, MOST_WKT};
use self::octree::{Cube, Keyed, divide};
use crate::error::{Error, Location, Problem, Result};
use crate::format::cloud::sink::{CloudClock, CloudPoint, CloudShape, CloudSink};
use crate::format::las::extra::ExtraDimension;
use crate::format::las::extra::dimension;
use crate::format::las::record::{
    Placement, RECORD, SCANNER, append_record, check_time, gps_time_s,
};
use crate::format::las::value::ExtraValue;

/// Points for which memory is allocated at a time.
const BLOCK_POINTS: usize = 1 << 16;

/// The records of all points, in their order.
struct Records {
    blocks: Vec<Vec<u8>>,
    /// Bytes per record.
    length: usize,
}

impl Records {
    /// The block that takes the next record.
    fn open_block(&mut self) -> &mut Vec<u8> {
        let full = BLOCK_POINTS * self.length;
        if self.blocks.last().is_none_or(|block| block.len() == full) {
            self.blocks.push(Vec::with_capacity(full));
        }
        let last = self.blocks.len() - 1;
        &mut self.blocks[last]
    }

    fn get(&self, number: u32) -> &[u8] {
        let (block, at) = (
            number as usize / BLOCK_POINTS,
            number as usize % BLOCK_POINTS,
        );
        &self.blocks[block][at * self.length..][..self.length]
    }

    /// The coordinates of all points with their numbers, as keys of the octree.
    fn keyed(&self, cube: &Cube, count: u32) -> Vec<Keyed> {
        (0..count)
            .into_par_iter()
            .map(|number| (cube.key(steps_of(self.get(number))), number))
            .collect()
    }
}

/// The coordinates of a record.
fn steps_of(record: &[u8]) -> [i32; 3] {
    let at =
        |i: usize| i32::from_le_bytes([record[i], record[i + 1], record[i + 2], record[i + 3]]);
    [at(0), at(4), at(8)]
}

struct CopcSink {
    path: PathBuf,
    out: BufWriter<File>,
    placement: Placement,
    has_time: bool,
    clock: CloudClock,
    dimensions: Vec<ExtraDimension>,
    scanner: Option<usize>,
    wkt: Option<String>,
    records: Records,
    extent: Extent,
}

/// Creates or replaces a COPC file, whose name should end in `.copc.laz`: points of format 6 with
/// position, GPS time (0 if the shape has none, because each format that COPC allows has a time),
/// intensity (rounded into 0 to 65535) and the dimensions as extra bytes; the value of a dimension
/// named `scanner` is also the `point_source_id` and, up to 255, the `user_data`. The WKT of the
/// coordinate reference system is kept. Coordinates are rounded to
/// [`CLOUD_STEP_M`](crate::format::CLOUD_STEP_M). A cloud without points is a
/// valid file. The same points give the same bytes for any number of threads.
///
/// Memory holds all points until the end: 46 bytes for each, plus those of its dimensions.
///
/// # Errors
/// Dimensions that LAS does not allow, bounds that are not finite, a WKT of more than 65 534 bytes,
/// more than 2³² − 1 points, a file that cannot be written.
pub fn copc_sink(path: &Path, shape: &CloudShape) -> Result<Box<dyn CloudSink>> {
    dimension::check(path, &shape.dimensions)?;
    let placement = Placement::of(path, shape)?;
    let wkt_length = shape.wkt.as_ref().map_or(0, String::len);
    if wkt_length > MOST_WKT {
        return Err(Error::format(
            path,
            Location::Whole,
            format!("a coordinate reference system with {wkt_length} bytes of WKT"),
            format!("at most {MOST_WKT}"),
        ));
    }
    let extra: usize = shape.dimensions.iter().map(|d| d.kind.size()).sum();
    let out = File::create(path).map_err(|e| Error::io(path, e))?;
    Ok(Box::new(CopcSink {
        path: path.to_owned(),
        out: BufWriter::with_capacity(1 << 20, out),
        placement,
        has_time: shape.has_time,
        clock: shape.clock,
        scanner: shape.dimensions.iter().position(|d| d.name == SCANNER),
        dimensions: shape.dimensions.clone(),
        wkt: shape.wkt.clone(),
        records: Records {
            blocks: Vec::new(),
            length: RECORD + extra,
        },
        extent: Extent::default(),
    }))
}

impl CloudSink for CopcSink {
    fn push(&mut self, point: &CloudPoint<'_>) -> Result<()> {
        if self.extent.count == u64::from(u32::MAX) {
            return Err(Error::of(
                Problem::TooMany,
                format!(
                    "{}: more than {} points for a COPC file",
                    self.path.display(),
                    u32::MAX
                ),
                "write LAZ, or thin the cloud",
            ));
        }
        let steps = self
            .placement
            .steps(&self.path, &point.position, point.time_s)?;
        if self.has_time {
            check_time(&self.path, point.time_s)?;
        }
        let time_s = if self.has_time {
            gps_time_s(self.clock, point.time_s)
        } else {
            0.0
        };
        // `as` saturates and converts NaN to 0.
        let scanner = self.scanner.and_then(|at| point.values.get(at));
        let scanner = scanner.map_or(0, |v| v.number() as u16);
        self.extent.include(steps, time_s);
        let block = self.records.open_block();
        append_record(steps, Some(time_s), point.intensity, scanner, block);
        for (at, dimension) in self.dimensions.iter().enumerate() {
            let value = point.values.get(at).copied().unwrap_or(ExtraValue::NONE);
            dimension.kind.append(value, block);
        }
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<()> {
        let sink = *self;
        let extent = sink.extent;
        let cube = Cube::around(extent.low, extent.high);
        let mut keyed = sink.records.keyed(&cube, extent.count as u32);
        let cells = divide(&cube, &mut keyed);
        let file = CopcFile {
            path: &sink.path,
            placement: sink.placement,
            clock: sink.clock,
            dimensions: &sink.dimensions,
            wkt: sink.wkt.as_deref(),
            extent,
            cube,
        };
        let record = |number: u32| sink.records.get(number);
        file.write(sink.out, &cells, &keyed, &record)
    }
}
