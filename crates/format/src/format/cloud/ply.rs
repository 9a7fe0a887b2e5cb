//! PLY: text, little-endian and big-endian; the points are the element `vertex`.

use crate::cloud::PointCloud;
use crate::error::Result;
use crate::format::binary::{Bytes, Fields, Number};
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};

pub(crate) const PLY: Kind = Kind {
    signature: Some(|start| {
        start.bytes.starts_with(b"ply\n") || start.bytes.starts_with(b"ply\r\n")
    }),
    extensions: &["ply"],
    cloud: Some(read),
    frame: Frame::Fixed("metres (assumed: PLY has no unit); axes of the file, taken for the world"),
    ..Kind::new("ply", "cloud (PLY)")
};

#[derive(Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Text,
    Binary { big_endian: bool },
}

/// The content of the header.
pub(crate) struct Header {
    encoding: Encoding,
    pub(crate) count: u64,
    pub(crate) names: Vec<String>,
    types: Vec<Number>,
}

fn number(name: &str) -> Option<Number> {
    Some(match name {
        "char" | "int8" => Number::I8,
        "uchar" | "uint8" => Number::U8,
        "short" | "int16" => Number::I16,
        "ushort" | "uint16" => Number::U16,
        "int" | "int32" => Number::I32,
        "uint" | "uint32" => Number::U32,
        "float" | "float32" => Number::F32,
        "double" | "float64" => Number::F64,
        _ => return None,
    })
}

pub(crate) fn read_header(bytes: &mut Bytes) -> Result<Header> {
    if bytes.line()? != "ply" {
        return Err(bytes.error("a different first line", "`ply`"));
    }
    let mut encoding = None;
    let mut count = None;
    let (mut names, mut types) = (Vec::new(), Vec::new());
    let mut in_vertex = false;
    loop {
        let line = bytes.line()?;
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match words.as_slice() {
            ["end_header"] => break,
            ["comment", ..] | ["obj_info", ..] | [] => {}
            ["format", name, _] => {
                encoding = Some(match *name {
                    "ascii" => Encoding::Text,
                    "binary_little_endian" => Encoding::Binary { big_endian: false },
                    "binary_big_endian" => Encoding::Binary { big_endian: true },
                    other => {
                        return Err(bytes.error(format!("format {other}"), "a format of PLY 1.0"));
                    }
                });
            }
            ["element", "vertex", n] => {
                in_vertex = true;
                count = n.parse::<u64>().ok();
            }
            ["element", ..] if count.is_none() => {
                return Err(bytes.error(format!("`{line}`"), "vertices as the first element"));
            }
            ["element", ..] => in_vertex = false,
            ["property", kind, name] if in_vertex => {
                let Some(kind) = number(kind) else {
                    return Err(bytes.error(format!("property type {kind}"), "a type of PLY"));
                };
                names.push((*name).to_owned());
                types.push(kind);
            }
            ["property", ..] if !in_vertex => {}
            _ => return Err(bytes.error(format!("`{line}`"), "a line of a PLY header")),
        }
    }
    let (Some(encoding), Some(count)) = (encoding, count) else {
        return Err(bytes.error("a header without format or vertices", "a header with both"));
    };
    for axis in ["x", "y", "z"] {
        if !names.iter().any(|name| name == axis) {
            return Err(bytes.error(
                format!("the vertex properties {}", names.join(", ")),
                "x, y and z",
            ));
        }
    }
    Ok(Header {
        encoding,
        count,
        names,
        types,
    })
}

pub(crate) fn read(input: &Input) -> Result<PointCloud> {
    let mut bytes = Bytes::open(input)?;
    let header = read_header(&mut bytes)?;
    let mut fields = Fields::default();
    for (i, name) in header.names.iter().enumerate() {
        fields.note(name, i);
    }
    let mut cloud = PointCloud::default();
    let mut values = vec![0.0; header.types.len()];
    match header.encoding {
        Encoding::Text => {
            for _ in 0..header.count {
                let line = bytes.line()?;
                let mut cells = line.split_ascii_whitespace();
                for value in &mut values {
                    *value = cells
                        .next()
                        .and_then(|cell| cell.parse().ok())
                        .ok_or_else(|| {
                            let count = header.types.len();
                            bytes.error(format!("`{line}`"), format!("{count} numbers"))
                        })?;
                }
                fields.push(&values, &mut cloud);
            }
        }
        Encoding::Binary { big_endian } => {
            let length: usize = header.types.iter().map(|kind| kind.size()).sum();
            bytes.check(header.count.saturating_mul(length as u64), "vertices")?;
            let mut record = vec![0; length];
            for _ in 0..header.count {
                bytes.take(&mut record, "a vertex")?;
                let mut at = 0;
                for (value, kind) in values.iter_mut().zip(&header.types) {
                    *value = kind.read(&record[at..], big_endian);
                    at += kind.size();
                }
                fields.push(&values, &mut cloud);
            }
        }
    }
    Ok(cloud)
}
