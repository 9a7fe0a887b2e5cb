//! The parts of a COPC file, and their order: header, records, chunks, chunk table, hierarchy.

use std::fs::File;
use std::io::{BufWriter, Cursor, Seek, SeekFrom, Write};
use std::path::Path;

use las::raw;
use laz::laszip::{ChunkTable, ChunkTableEntry};
use laz::record::{LayeredPointRecordCompressor, RecordCompressor};
use laz::{LazVlr, LazVlrBuilder};
use rayon::prelude::*;

use super::octree::{Cell, Cube, Keyed};
use crate::error::{Error, Location, Result};
use crate::format::cloud::sink::CloudClock;
use crate::format::file::guarded;
use crate::format::las::batches::problem;
use crate::format::las::extra::ExtraDimension;
use crate::format::las::extra::dimension;
use crate::format::las::record::{Placement, RECORD, is_adjusted_gps, wkt_record};

/// Most bytes of WKT that fit into a record together with the terminating zero.
pub(super) const MOST_WKT: usize = u16::MAX as usize - 1;

/// Points compressed at a time, so that all threads are busy.
const BATCH_POINTS: usize = 1 << 20;
/// Bytes of a LAS 1.4 header; the record that makes a file COPC is the first after it.
const HEADER: u16 = 375;
/// Bytes of that record, and of an entry of the hierarchy.
const INFO: usize = 160;
const ENTRY: usize = 32;
/// Spacings of the points of the root cell along a side of the cube.
const SPACINGS: f64 = 128.0;
/// Global encoding: the coordinate reference system is WKT; times are adjusted standard GPS time.
const WKT_BIT: u16 = 1 << 4;
const ADJUSTED_GPS_BIT: u16 = 1;
/// Point format 6, compressed.
const POINT_FORMAT: u8 = 6 | 0x80;

/// Number, bounds and times of all points.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extent {
    pub(super) count: u64,
    /// Lowest and highest coordinates, steps.
    pub(super) low: [i32; 3],
    pub(super) high: [i32; 3],
    /// First and last finite time.
    first_s: f64,
    last_s: f64,
}

impl Default for Extent {
    fn default() -> Self {
        Self {
            count: 0,
            low: [0; 3],
            high: [0; 3],
            first_s: f64::INFINITY,
            last_s: f64::NEG_INFINITY,
        }
    }
}

impl Extent {
    pub(super) fn include(&mut self, steps: [i32; 3], time_s: f64) {
        if self.count == 0 {
            (self.low, self.high) = (steps, steps);
        }
        for (axis, v) in steps.into_iter().enumerate() {
            self.low[axis] = self.low[axis].min(v);
            self.high[axis] = self.high[axis].max(v);
        }
        if time_s.is_finite() {
            self.first_s = self.first_s.min(time_s);
            self.last_s = self.last_s.max(time_s);
        }
        self.count += 1;
    }
}

/// Everything but the points.
pub(super) struct CopcFile<'a> {
    pub(super) path: &'a Path,
    pub(super) placement: Placement,
    pub(super) clock: CloudClock,
    pub(super) dimensions: &'a [ExtraDimension],
    pub(super) wkt: Option<&'a str>,
    pub(super) extent: Extent,
    pub(super) cube: Cube,
}

/// Positions in the file that are known only at the end.
#[derive(Default)]
struct Places {
    hierarchy_record: u64,
    hierarchy: u64,
    hierarchy_bytes: u64,
}

impl CopcFile<'_> {
    /// Writes the file. `points` lists the numbers of the points of each cell, and `record` returns
    /// the record of the point with a number.
    ///
    /// # Errors
    /// The file cannot be written.
    pub(super) fn write<'r>(
        &self,
        mut out: BufWriter<File>,
        cells: &[Cell],
        points: &[Keyed],
        record: &(dyn Fn(u32) -> &'r [u8] + Sync),
    ) -> Result<()> {
        guarded(self.path, "LAZ", || {
            let laz = self.laz()?;
            let start = self.start(&laz, &Places::default())?;
            let failed = |e| Error::io(self.path, e);
            out.write_all(&start).map_err(failed)?;
            // Room for the position of the chunk table, where the points begin.
            out.write_all(&[0; 8]).map_err(failed)?;
            let mut at = start.len() as u64 + 8;
            let mut table = ChunkTable::with_capacity(cells.len());
            let mut hierarchy = Vec::with_capacity(cells.len() * ENTRY);
            for batch in batches(cells) {
                for (cell, chunk) in batch
                    .iter()
                    .zip(self.compress(&laz, batch, points, record)?)
                {
                    append_entry(&mut hierarchy, cell, at, self.size(&chunk)?);
                    table.push(ChunkTableEntry {
                        point_count: cell.points.len() as u64,
                        byte_count: chunk.len() as u64,
                    });
                    out.write_all(&chunk).map_err(failed)?;
                    at += chunk.len() as u64;
                }
            }
            if cells.is_empty() {
                // A root without points: there is no chunk, so neither a position nor bytes.
                let root = Cell {
                    level: 0,
                    at: [0; 3],
                    points: 0..0,
                };
                append_entry(&mut hierarchy, &root, 0, 0);
            }
            table.write_to(&mut out, &laz).map_err(failed)?;
            let hierarchy_record = out.stream_position().map_err(failed)?;
            let hierarchy = raw_record(self.path, "copc", 1000, "EPT hierarchy", hierarchy, true)?;
            let places = Places {
                hierarchy_record,
                hierarchy: hierarchy_record + 60,
                hierarchy_bytes: hierarchy.data.len() as u64,
            };
            hierarchy
                .write_to(&mut out)
                .map_err(|e| problem(self.path, e))?;
            out.seek(SeekFrom::Start(0)).map_err(failed)?;
            out.write_all(&self.start(&laz, &places)?).map_err(failed)?;
            out.write_all(&at.to_le_bytes()).map_err(failed)?;
            out.flush().map_err(failed)
        })
    }

    fn laz(&self) -> Result<LazVlr> {
        let extra: usize = self.dimensions.iter().map(|d| d.kind.size()).sum();
        Ok(LazVlrBuilder::default()
            .with_point_format(6, extra as u16)
            .map_err(|e| problem(self.path, e.into()))?
            .with_variable_chunk_size()
            .build())
    }

    /// The header and the records before the points: their length does not depend on `places`.
    fn start(&self, laz: &LazVlr, places: &Places) -> Result<Vec<u8>> {
        let mut data = Vec::new();
        laz.write_to(&mut data)
            .map_err(|e| Error::io(self.path, e))?;
        let record =
            |user, id, description, data| raw_record(self.path, user, id, description, data, false);
        let mut records = vec![
            record("copc", 1, "COPC info", self.info(places))?,
            record("laszip encoded", 22204, "laszip", data)?,
        ];
        let mut builder = las::Builder::default();
        dimension::append(self.path, &mut builder, Vec::new(), self.dimensions)?;
        for vlr in builder.vlrs {
            records.push(vlr.into_raw(false).map_err(|e| problem(self.path, e))?);
        }
        if let Some(wkt) = self.wkt {
            let wkt = wkt_record(wkt).into_raw(false);
            records.push(wkt.map_err(|e| problem(self.path, e))?);
        }
        let mut body = Vec::new();
        for record in &records {
            record
                .write_to(&mut body)
                .map_err(|e| problem(self.path, e))?;
        }
        let header = self.header(body.len() as u32, records.len() as u32, places);
        let mut start = Vec::new();
        header
            .write_to(&mut start)
            .map_err(|e| problem(self.path, e))?;
        debug_assert_eq!(start.len(), usize::from(HEADER));
        start.extend(body);
        Ok(start)
    }

    fn header(&self, records_bytes: u32, records: u32, places: &Places) -> raw::Header {
        let extra: usize = self.dimensions.iter().map(|d| d.kind.size()).sum();
        let is_adjusted = is_adjusted_gps(self.clock);
        let Placement { offset_m, step_m } = self.placement;
        let metres = |steps: [i32; 3], axis: usize| match self.extent.count {
            0 => 0.0,
            _ => f64::from(steps[axis]) * step_m + offset_m[axis],
        };
        let (low, high) = (self.extent.low, self.extent.high);
        let mut software = [0; 32];
        software[..9].copy_from_slice(b"boresight");
        let mut returns = [0; 15];
        returns[0] = self.extent.count;
        raw::Header {
            global_encoding: WKT_BIT | if is_adjusted { ADJUSTED_GPS_BIT } else { 0 },
            version: (1, 4).into(),
            generating_software: software,
            header_size: HEADER,
            offset_to_point_data: u32::from(HEADER) + records_bytes,
            number_of_variable_length_records: records,
            point_data_record_format: POINT_FORMAT,
            point_data_record_length: (RECORD + extra) as u16,
            x_scale_factor: step_m,
            y_scale_factor: step_m,
            z_scale_factor: step_m,
            x_offset: offset_m.x,
            y_offset: offset_m.y,
            z_offset: offset_m.z,
            min_x: metres(low, 0),
            max_x: metres(high, 0),
            min_y: metres(low, 1),
            max_y: metres(high, 1),
            min_z: metres(low, 2),
            max_z: metres(high, 2),
            evlr: Some(raw::header::Evlr {
                start_of_first_evlr: places.hierarchy_record,
                number_of_evlrs: 1,
            }),
            large_file: Some(raw::header::LargeFile {
                number_of_point_records: self.extent.count,
                number_of_points_by_return: returns,
            }),
            ..Default::default()
        }
    }

    /// The record that makes a file COPC.
    fn info(&self, places: &Places) -> Vec<u8> {
        let Placement { offset_m, step_m } = self.placement;
        let centre = self.cube.centre();
        let side_m = self.cube.side() as f64 * step_m;
        let (first_s, last_s) = if self.extent.first_s <= self.extent.last_s {
            (self.extent.first_s, self.extent.last_s)
        } else {
            (0.0, 0.0)
        };
        let mut info = Vec::with_capacity(INFO);
        for (axis, at) in centre.into_iter().enumerate() {
            info.extend((at * step_m + offset_m[axis]).to_le_bytes());
        }
        info.extend((side_m / 2.0).to_le_bytes());
        info.extend((side_m / SPACINGS).to_le_bytes());
        info.extend(places.hierarchy.to_le_bytes());
        info.extend(places.hierarchy_bytes.to_le_bytes());
        info.extend(first_s.to_le_bytes());
        info.extend(last_s.to_le_bytes());
        info.resize(INFO, 0);
        info
    }

    /// The compressed chunks of some cells.
    fn compress<'r>(
        &self,
        laz: &LazVlr,
        cells: &[Cell],
        points: &[Keyed],
        record: &(dyn Fn(u32) -> &'r [u8] + Sync),
    ) -> Result<Vec<Vec<u8>>> {
        let compress_cell = |cell: &Cell| {
            let mut compressor = LayeredPointRecordCompressor::new(Cursor::new(Vec::new()));
            compressor.set_fields_from(laz.items())?;
            for (_, number) in &points[cell.points.clone()] {
                compressor.compress_next(record(*number))?;
            }
            compressor.done()?;
            Ok(compressor.into_inner().into_inner())
        };
        cells
            .par_iter()
            .map(|cell| {
                compress_cell(cell).map_err(|e: laz::LasZipError| problem(self.path, e.into()))
            })
            .collect()
    }

    /// The size of a chunk as the hierarchy stores it.
    fn size(&self, chunk: &[u8]) -> Result<i32> {
        i32::try_from(chunk.len()).map_err(|_| {
            Error::format(
                self.path,
                Location::Whole,
                format!("{} bytes of points in one cell", chunk.len()),
                "at most 2147483647: points that are not all at the same place",
            )
        })
    }
}

/// Consecutive cells with enough points for all threads.
fn batches(cells: &[Cell]) -> impl Iterator<Item = &[Cell]> {
    let mut rest = cells;
    std::iter::from_fn(move || {
        let mut points = 0;
        let length = rest
            .iter()
            .take_while(|cell| {
                let is_within = points < BATCH_POINTS;
                points += cell.points.len();
                is_within
            })
            .count();
        let (batch, after) = rest.split_at(length);
        rest = after;
        (length > 0).then_some(batch)
    })
}

/// Appends an entry of the hierarchy: key, position of the chunk, its bytes and points.
fn append_entry(hierarchy: &mut Vec<u8>, cell: &Cell, at: u64, bytes: i32) {
    hierarchy.extend(cell.level.to_le_bytes());
    for number in cell.at {
        hierarchy.extend(number.to_le_bytes());
    }
    hierarchy.extend(at.to_le_bytes());
    hierarchy.extend(bytes.to_le_bytes());
    hierarchy.extend((cell.points.len() as u32).to_le_bytes());
}

fn raw_record(
    path: &Path,
    user_id: &str,
    record_id: u16,
    description: &str,
    data: Vec<u8>,
    is_extended: bool,
) -> Result<raw::Vlr> {
    las::Vlr {
        user_id: user_id.to_owned(),
        record_id,
        description: description.to_owned(),
        data,
    }
    .into_raw(is_extended)
    .map_err(|e| problem(path, e))
}
