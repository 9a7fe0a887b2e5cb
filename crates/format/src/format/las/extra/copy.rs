//! A LAS or LAZ file copied point by point with appended dimensions.

use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use super::dimension::{self, ExtraDimension, Retained, Row};
use crate::error::{Error, Location, Result};
use crate::format::file::{CHUNK_POINTS, nothing_in};
use crate::format::input::Input;
use crate::format::las::batches::{LasOut, is_compressed};
use crate::format::las::file::LasFile;
use crate::output::protect_inputs;
use crate::progress::Progress;

/// Copies the points of the LAS or LAZ file `input` that `row` accepts to `output` (compressed if
/// its name ends in `.laz`), in their order, each with all its fields followed by the values of
/// `dimensions`; returns their number. A dimension of the input with one of these names is
/// replaced.
///
/// The copy keeps point format, scale, offset, times, flags, colours, coordinate reference system,
/// existing extra dimensions and all other variable-length records. Its version is 1.4, which
/// defines extra dimensions, and indices that depend on the order of the points in the file (COPC,
/// LAStools) are left out. Memory is bounded by a few chunks of points. `progress` advances by one
/// for each point read; the caller begins and ends the stage.
///
/// # Errors
/// An input that is the output, is damaged, has no points or has waveforms; names that LAS does
/// not allow; an output that cannot be written; errors of `row`.
pub fn copy_las(
    input: impl Into<Input>,
    output: &Path,
    dimensions: &[ExtraDimension],
    row: &mut Row<'_>,
    progress: &dyn Progress,
) -> Result<u64> {
    let input = &input.into();
    let path = input.path();
    dimension::check(output, dimensions)?;
    protect_inputs(Path::new(""), &[path.to_owned()], &[output])?;
    let mut file = LasFile::open(input)?;
    let format = *file.header().point_format();
    let expected = file.header().number_of_points();
    if format.has_waveform {
        return Err(Error::format(
            path,
            Location::Whole,
            "points with waveforms (point formats 4, 5, 9, 10)",
            "points without waveforms: export the points alone",
        ));
    }
    if expected == 0 {
        return Err(nothing_in(path, "point"));
    }
    let retained = Retained::of(&file, dimensions)?;
    let header = header(&file, output, dimensions, &retained)?;
    let mut out = LasOut::create(output, header)?;
    let mut values = vec![f64::NAN; dimensions.len()];
    let mut extra = Vec::new();
    let mut written = 0;
    loop {
        let count = file.read(CHUNK_POINTS, |index, point| {
            values.fill(f64::NAN);
            if !row(index, &mut values)? {
                return Ok(());
            }
            extra.clear();
            for range in &retained.ranges {
                extra.extend_from_slice(&point.extra[range.clone()]);
            }
            for (dimension, value) in dimensions.iter().zip(&values) {
                dimension.kind.append((*value).into(), &mut extra);
            }
            let standard = &point.record[..point.record.len() - point.extra.len()];
            written += 1;
            out.push(&[standard, &extra])
        })?;
        if count == 0 {
            break;
        }
        progress.advance(count);
        progress.check()?;
    }
    if file.taken() != expected {
        return Err(Error::format(
            path,
            Location::Whole,
            format!("{} points", file.taken()),
            format!("the {expected} points of its header"),
        ));
    }
    out.finish()?;
    Ok(written)
}

/// The header of the copy.
fn header(
    file: &LasFile,
    output: &Path,
    dimensions: &[ExtraDimension],
    retained: &Retained,
) -> Result<las::Builder> {
    let mut builder = las::Builder::from(file.header().clone());
    builder.point_format.is_compressed = is_compressed(output)?;
    builder.version = (1, 4).into();
    builder.generating_software = "boresight".to_owned();
    // No padding between the points and the first extended record: the lengths have changed.
    builder.point_padding = Vec::new();
    builder.evlrs = evlrs(file)?;
    for list in [&mut builder.vlrs, &mut builder.evlrs] {
        list.retain(|vlr| !is_rewritten(vlr));
        list.iter_mut().for_each(make_writable);
    }
    builder.point_format.extra_bytes = retained.len() as u16;
    dimension::append(output, &mut builder, retained.entries.clone(), dimensions)?;
    Ok(builder)
}

/// Records that the writer creates itself, or that refer to positions in the old file.
fn is_rewritten(vlr: &las::Vlr) -> bool {
    let id = (vlr.user_id.as_str(), vlr.record_id);
    matches!(
        id,
        ("LASF_Spec", 4) | ("laszip encoded", 22204) | ("LAStools", 30) | ("copc", _)
    )
}

/// Decoded texts that are not ASCII can be longer than the fields they came from.
fn make_writable(vlr: &mut las::Vlr) {
    for (text, most) in [(&mut vlr.user_id, 16), (&mut vlr.description, 32)] {
        if !text.is_ascii() {
            *text = text.replace(|c: char| !c.is_ascii(), "?");
        }
        text.truncate(most);
    }
}

/// All extended records of a file; the decoder reads only the first.
fn evlrs(file: &LasFile) -> Result<Vec<las::Vlr>> {
    let path = file.path();
    if file.header().evlrs().is_empty() {
        return Ok(Vec::new());
    }
    let (mut input, size) = file.input().open()?;
    let damaged = |at: u64| {
        Error::format(
            path,
            Location::Byte(at),
            "an extended record that reaches past the end of the file",
            "an undamaged LAS or LAZ file",
        )
    };
    let mut bytes_at = |at: u64, n: u64| -> Result<Vec<u8>> {
        if at.checked_add(n).is_none_or(|end| end > size) {
            return Err(damaged(at));
        }
        let mut bytes = vec![0; n as usize];
        input
            .seek(SeekFrom::Start(at))
            .and_then(|_| input.read_exact(&mut bytes))
            .map_err(|e| Error::io(path, e))?;
        Ok(bytes)
    };
    let number = |bytes: &[u8]| bytes.iter().rev().fold(0u64, |n, b| n << 8 | u64::from(*b));
    let text = |bytes: &[u8]| {
        let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
        String::from_utf8_lossy(&bytes[..end]).into_owned()
    };
    // Start of the first extended record and number of extended records (LAS 1.4, table 3).
    let head = bytes_at(235, 12)?;
    let (mut at, count) = (number(&head[..8]), number(&head[8..]));
    let mut records = Vec::new();
    for _ in 0..count {
        let head = bytes_at(at, 60)?;
        let length = number(&head[20..28]);
        let data = bytes_at(at + 60, length)?;
        at += 60 + length;
        records.push(las::Vlr {
            user_id: text(&head[2..18]),
            record_id: number(&head[18..20]) as u16,
            description: text(&head[28..60]),
            data,
        });
    }
    Ok(records)
}
