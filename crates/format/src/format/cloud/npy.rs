//! NumPy `.npy`: an array of shape (n, 3 or more) or, with few rows, (3 or more, n), or records with the fields x, y and z.

use crate::cloud::PointCloud;
use crate::error::Result;
use crate::format::binary::{Bytes, Number};
use crate::format::cloud::fields::Fields;
use crate::format::cloud::gathering::{Gathering, unnamed};
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::text::lines::MOST_COLUMNS;
use crate::geometry::Vec3;

pub(crate) const NPY: Kind = Kind {
    signature: Some(|start| start.bytes.starts_with(b"\x93NUMPY")),
    extensions: &["npy"],
    cloud: Some(read),
    frame: Frame::Fixed(
        "metres (assumed: NumPy has no unit); axes of the file, taken for the world",
    ),
    ..Kind::new("npy", "cloud (NumPy)")
};

/// Most rows of an array in which points may be columns.
const MOST_FIELDS: usize = 16;
/// Most bytes of a record.
const MOST_RECORD: usize = 1 << 20;
/// Most bytes of a header: structured types of a thousand fields have less.
const MOST_HEADER: usize = 1 << 16;

/// A number in memory order.
#[derive(Clone, Copy)]
struct Item {
    kind: Number,
    big_endian: bool,
    /// Of a field, bytes after the start of its record.
    offset: usize,
}

/// The description of the array.
struct Header {
    /// Names and types of the fields; one without a name if the array has no fields.
    fields: Vec<(String, Item)>,
    is_structured: bool,
    /// Bytes of a record, or of a number if there are no records.
    record_size: usize,
    is_fortran: bool,
    shape: Vec<u64>,
}

pub(crate) fn read(input: &Input) -> Result<PointCloud> {
    let mut bytes = Bytes::open(input)?;
    let mut head = [0; 8];
    bytes.take(&mut head, "the start of an .npy file")?;
    if !head.starts_with(b"\x93NUMPY") {
        return Err(bytes.error("no .npy signature", "an .npy file"));
    }
    let length = if head[6] == 1 {
        let mut size = [0; 2];
        bytes.take(&mut size, "the length of the header")?;
        usize::from(u16::from_le_bytes(size))
    } else {
        let mut size = [0; 4];
        bytes.take(&mut size, "the length of the header")?;
        u32::from_le_bytes(size) as usize
    };
    bytes.check(length as u64, "the header")?;
    let mut text = vec![0; length.min(MOST_HEADER)];
    bytes.take(&mut text, "the header")?;
    let text = String::from_utf8_lossy(&text).into_owned();
    let unsupported = |bytes: &Bytes| {
        let found: String = text.trim().chars().take(200).collect();
        bytes.error(
            format!("`{found}`"),
            "numbers of shape (n, 3) or with more columns or of shape (3, n), or records of shape (n,) with x, y and z",
        )
    };
    let header = header(&text).ok_or_else(|| unsupported(&bytes))?;
    match (header.is_structured, header.shape.as_slice()) {
        (true, [n]) => records(input, &mut bytes, &header, *n, unsupported),
        (false, [rows, columns]) if *columns >= 3 || *rows == 3 => {
            table(input, &mut bytes, &header, [*rows, *columns])
        }
        _ => Err(unsupported(&bytes)),
    }
}

/// Reads records with x, y and z among their fields.
fn records(
    input: &Input,
    bytes: &mut Bytes,
    header: &Header,
    n: u64,
    unsupported: impl Fn(&Bytes) -> crate::error::Error,
) -> Result<PointCloud> {
    let names: Vec<String> = header.fields.iter().map(|(name, _)| name.clone()).collect();
    let types: Vec<Number> = header.fields.iter().map(|(_, item)| item.kind).collect();
    let is_raw = |axis: &str| {
        let mut fields = header.fields.iter();
        fields.any(|(name, item)| name == axis && matches!(item.kind, Number::I32))
    };
    if ["X", "Y", "Z"].into_iter().all(is_raw) {
        return Err(bytes.error(
            "X, Y and Z as whole numbers of 32 bits, as in the records of LAS files, without their scale and offset",
            "coordinates: the array `las.xyz` of laspy, or the LAS file itself",
        ));
    }
    let fields = Fields::of(&names, &types).ok_or_else(|| unsupported(bytes))?;
    let length = header.record_size;
    bytes.check(n.saturating_mul(length as u64), "records")?;
    let mut gathering = Gathering::new(input);
    let mut record = vec![0; length];
    let mut values = vec![0.0; types.len()];
    for _ in 0..n {
        bytes.take(&mut record, "a record")?;
        for (value, (_, item)) in values.iter_mut().zip(&header.fields) {
            *value = item.kind.read(&record[item.offset..], item.big_endian);
        }
        fields.push(&values, &mut gathering);
    }
    fields.finish(gathering)
}

/// Reads an array of numbers, in which points are rows or, if it has few of them, columns.
fn table(
    input: &Input,
    bytes: &mut Bytes,
    header: &Header,
    [rows, columns]: [u64; 2],
) -> Result<PointCloud> {
    let (
        _,
        Item {
            kind, big_endian, ..
        },
    ) = header.fields[0];
    let count = rows.saturating_mul(columns);
    bytes.check(count.saturating_mul(kind.size() as u64), "coordinates")?;
    let mut numbers = Vec::with_capacity(count as usize);
    let mut item = vec![0; kind.size()];
    for _ in 0..count {
        bytes.take(&mut item, "a coordinate")?;
        numbers.push(kind.read(&item, big_endian));
    }
    let (rows, columns) = (rows as usize, columns as usize);
    let at = |row: usize, column: usize| {
        if header.is_fortran {
            numbers[column * rows + row]
        } else {
            numbers[row * columns + column]
        }
    };
    let as_rows = || -> Vec<Vec3> {
        let row = |i| Vec3::from_fn(|axis, _| at(i, axis));
        (0..rows).map(row).collect()
    };
    let as_columns = || -> Vec<Vec3> {
        let column = |i| Vec3::from_fn(|axis, _| at(axis, i));
        (0..columns).map(column).collect()
    };
    let mut gathering = Gathering::new(input);
    let may_be_columns = columns > rows || columns == 3;
    let (points, is_by_rows) = match (rows, columns) {
        (3..=MOST_FIELDS, 3..=MOST_COLUMNS) if may_be_columns => {
            let (by_rows, by_columns) = (as_rows(), as_columns());
            let is_by_rows = extent(&by_rows) <= extent(&by_columns);
            input.remark(format!(
                "points may be the rows or the columns of an array of shape ({rows}, {columns}): the {} lie closer \
                 together and are taken for points",
                if is_by_rows { "rows" } else { "columns" }
            ));
            (if is_by_rows { by_rows } else { by_columns }, is_by_rows)
        }
        (3, _) => (as_columns(), false),
        (4..=MOST_FIELDS, _) if columns > MOST_COLUMNS => (as_columns(), false),
        _ => (as_rows(), true),
    };
    if let Some(remark) = unnamed(if is_by_rows { columns } else { rows }) {
        let remark = if is_by_rows {
            remark
        } else {
            remark.replace("column", "row")
        };
        input.remark(remark);
    }
    for point in points {
        gathering.push(point, f64::NAN, f64::NAN);
    }
    gathering.finish()
}

/// Diagonal of the box around points.
fn extent(points: &[Vec3]) -> f64 {
    let first = points.first().copied().unwrap_or_default();
    let low = points.iter().fold(first, |low, p| low.inf(p));
    let high = points.iter().fold(first, |high, p| high.sup(p));
    (high - low).norm()
}

/// Reads the header, which is a literal of a Python dictionary with `descr`, `fortran_order` and `shape`.
fn header(text: &str) -> Option<Header> {
    let after = |key: &str| {
        let (_, rest) = text.split_once(&format!("'{key}':"))?;
        Some(rest.trim_start())
    };
    let (shape, _) = after("shape")?.strip_prefix('(')?.split_once(')')?;
    let shape = shape.split(',').map(str::trim).filter(|n| !n.is_empty());
    let shape = shape.map(|n| n.parse().ok()).collect::<Option<_>>()?;
    let descr = after("descr")?;
    let (fields, is_structured, record_size) = match descr.strip_prefix('[') {
        None => {
            let (kind, _) = descr.strip_prefix('\'')?.split_once('\'')?;
            let item = item(kind, 0)?;
            (vec![(String::new(), item)], false, item.kind.size())
        }
        Some(list) => {
            let (list, _) = list.split_once(']')?;
            let mut fields = Vec::new();
            let mut offset = 0usize;
            for tuple in list.split('(').skip(1) {
                let mut quoted = tuple.split('\'').skip(1).step_by(2);
                let (name, kind) = (quoted.next()?, quoted.next()?);
                // A third element would be the shape of an array in the field.
                let (_, rest) = tuple.rsplit_once('\'')?;
                let is_single = rest.trim_start().starts_with(')');
                // Bytes that align the next field have no name.
                let padding = kind.strip_prefix("|V").filter(|_| name.is_empty());
                let size = match padding {
                    Some(bytes) => bytes.parse().ok().filter(|size| *size <= MOST_HEADER)?,
                    None => {
                        let item = item(kind, offset).filter(|_| is_single)?;
                        fields.push((name.to_owned(), item));
                        item.kind.size()
                    }
                };
                offset = Some(offset + size).filter(|offset| *offset <= MOST_RECORD)?;
            }
            (fields, true, offset)
        }
    };
    Some(Header {
        fields,
        is_structured,
        record_size,
        is_fortran: after("fortran_order")?.starts_with("True"),
        shape,
    })
}

/// The number type that NumPy writes as `<f8`, at this byte of a record.
fn item(text: &str, offset: usize) -> Option<Item> {
    let big_endian = match text.get(..1)? {
        "<" | "|" => false,
        ">" => true,
        _ => return None,
    };
    let kind = match text.get(1..)? {
        "i1" => Number::I8,
        "u1" | "b1" => Number::U8,
        "i2" => Number::I16,
        "u2" => Number::U16,
        "i4" => Number::I32,
        "u4" => Number::U32,
        "i8" => Number::I64,
        "u8" => Number::U64,
        "f4" => Number::F32,
        "f8" => Number::F64,
        _ => return None,
    };
    Some(Item {
        kind,
        big_endian,
        offset,
    })
}
