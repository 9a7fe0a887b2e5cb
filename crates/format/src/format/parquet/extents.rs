//! Extents of files as GeoParquet 1.1: a table with one polygon per file, which GIS programs read.

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::sync::Arc;

use ::parquet::basic::{Compression, LogicalType, Repetition, Type as Physical};
use ::parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use ::parquet::errors::ParquetError;
use ::parquet::file::metadata::KeyValue;
use ::parquet::file::properties::WriterProperties;
use ::parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use ::parquet::schema::types::Type;
use serde_json::json;

use super::write::{CRS_KEY, problem};
use crate::error::{Error, Result};
use crate::format::extents::Extent;

/// Text columns, which come first, in this order.
const TEXTS: [&str; 4] = ["plot", "date", "item", "path"];
/// Number columns after the number of points.
const HEIGHTS: [&str; 2] = ["low_up_m", "high_up_m"];

/// Writes one row per extent: `plot`, `date`, `item`, `path`, `points`, `low_up_m`, `high_up_m` and `geometry`, the
/// rectangle in the plane as WKB. GeoParquet does not define WKT, so that `crs` is null and the coordinate reference
/// system is stored as WKT in the metadata `crs_wkt`. The same rows give the same bytes.
///
/// # Errors
/// The file cannot be written.
pub fn write_extents(path: &Path, extents: &[Extent], wkt: Option<&str>) -> Result<()> {
    let file = File::create(path).map_err(|error| Error::io(path, error))?;
    write(BufWriter::new(file), extents, wkt).map_err(|error| problem(path, error))
}

fn write(
    file: BufWriter<File>,
    extents: &[Extent],
    wkt: Option<&str>,
) -> std::result::Result<(), ParquetError> {
    let column = |name: &str, kind, logical| {
        let builder =
            Type::primitive_type_builder(name, kind).with_repetition(Repetition::REQUIRED);
        builder.with_logical_type(logical).build().map(Arc::new)
    };
    let mut fields = Vec::new();
    for name in TEXTS {
        fields.push(column(
            name,
            Physical::BYTE_ARRAY,
            Some(LogicalType::String),
        )?);
    }
    fields.push(column("points", Physical::INT64, None)?);
    for name in HEIGHTS {
        fields.push(column(name, Physical::DOUBLE, None)?);
    }
    fields.push(column("geometry", Physical::BYTE_ARRAY, None)?);
    let schema = Type::group_type_builder("schema")
        .with_fields(fields)
        .build()?;
    let mut metadata = vec![KeyValue::new("geo".to_owned(), geo(extents))];
    metadata.extend(wkt.map(|wkt| KeyValue::new(CRS_KEY.to_owned(), wkt.to_owned())));
    let properties = WriterProperties::builder()
        .set_created_by("boresight".to_owned())
        .set_compression(Compression::SNAPPY)
        .set_key_value_metadata(Some(metadata))
        .build();
    let mut out = SerializedFileWriter::new(file, Arc::new(schema), Arc::new(properties))?;
    let mut group = out.next_row_group()?;
    let texts: [fn(&Extent) -> &str; 4] = [|e| &e.plot, |e| &e.date, |e| &e.item, |e| &e.path];
    for text in texts {
        let cells = extents.iter().map(|extent| ByteArray::from(text(extent)));
        put::<ByteArrayType>(&mut group, cells.collect())?;
    }
    put::<Int64Type>(
        &mut group,
        extents.iter().map(|e| e.points.cast_signed()).collect(),
    )?;
    put::<DoubleType>(&mut group, extents.iter().map(|e| e.low_m[2]).collect())?;
    put::<DoubleType>(&mut group, extents.iter().map(|e| e.high_m[2]).collect())?;
    let polygons = extents
        .iter()
        .map(|extent| ByteArray::from(rectangle(extent)));
    put::<ByteArrayType>(&mut group, polygons.collect())?;
    group.close()?;
    out.close()?;
    Ok(())
}

fn put<T: DataType>(
    group: &mut SerializedRowGroupWriter<'_, BufWriter<File>>,
    cells: Vec<T::T>,
) -> std::result::Result<(), ParquetError> {
    if let Some(mut column) = group.next_column()? {
        column.typed::<T>().write_batch(&cells, None, None)?;
        column.close()?;
    }
    Ok(())
}

/// The metadata that make the file a GeoParquet file.
fn geo(extents: &[Extent]) -> String {
    let bound = |from: f64, pick: &dyn Fn(f64, &Extent) -> f64| extents.iter().fold(from, pick);
    let low = |i: usize| bound(f64::INFINITY, &move |low, e: &Extent| low.min(e.low_m[i]));
    let high = |i: usize| {
        bound(f64::NEG_INFINITY, &move |high, e: &Extent| {
            high.max(e.high_m[i])
        })
    };
    let mut geometry = json!({ "encoding": "WKB", "geometry_types": ["Polygon"], "crs": null });
    if !extents.is_empty() {
        geometry["bbox"] = json!([low(0), low(1), high(0), high(1)]);
    }
    json!({ "version": "1.1.0", "primary_column": "geometry", "columns": { "geometry": geometry } })
        .to_string()
}

/// A closed ring, counter-clockwise, as little-endian WKB.
fn rectangle(extent: &Extent) -> Vec<u8> {
    const POLYGON: u32 = 3;
    let ([west, south, _], [east, north, _]) = (extent.low_m, extent.high_m);
    let ring = [
        [west, south],
        [east, south],
        [east, north],
        [west, north],
        [west, south],
    ];
    let mut bytes = vec![1];
    for number in [POLYGON, 1, ring.len() as u32] {
        bytes.extend_from_slice(&number.to_le_bytes());
    }
    for value in ring.as_flattened() {
        bytes.extend_from_slice(&value.to_le_bytes());
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::parquet::file::reader::{FileReader, SerializedFileReader};
    use ::parquet::record::RowAccessor;

    #[test]
    fn extents_come_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("index.parquet");
        let extent = |plot: &str| Extent {
            plot: plot.into(),
            date: "2025-05-01".into(),
            item: "drive_p".into(),
            path: "items/drive_p/tiles/tile_0_0.copc.laz".into(),
            points: 7,
            low_m: [1.0, 2.0, 3.0],
            high_m: [4.0, 5.0, 6.0],
        };
        write_extents(&path, &[extent("p"), extent("q")], Some("WKT")).unwrap();
        let file = SerializedFileReader::new(File::open(&path).unwrap()).unwrap();
        let rows: Vec<_> = file
            .get_row_iter(None)
            .unwrap()
            .map(|row| row.unwrap())
            .collect();
        assert_eq!(rows.len(), 2);
        assert_eq!(rows[1].get_string(0).unwrap(), "q");
        assert_eq!(rows[0].get_long(4).unwrap(), 7);
        let polygon = rows[0].get_bytes(7).unwrap();
        assert_eq!(polygon.data().len(), 1 + 3 * 4 + 10 * 8);
        assert_eq!(polygon.data()[13..21], 1.0_f64.to_le_bytes());
        let metadata = file
            .metadata()
            .file_metadata()
            .key_value_metadata()
            .unwrap();
        let geo = metadata.iter().find(|entry| entry.key == "geo").unwrap();
        let geo: serde_json::Value = serde_json::from_str(geo.value.as_ref().unwrap()).unwrap();
        assert_eq!(
            geo["columns"]["geometry"]["bbox"],
            json!([1.0, 2.0, 4.0, 5.0])
        );
    }
}
