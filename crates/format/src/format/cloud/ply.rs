//! PLY: text, little-endian and big-endian; the points are the element `vertex`.

use crate::cloud::PointCloud;
use crate::error::{Error, Result};
use crate::format::binary::{Bytes, Number};
use crate::format::cloud::fields::Fields;
use crate::format::cloud::gathering::Gathering;
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::text::numerals::Numerals;

pub(crate) const PLY: Kind = Kind {
    signature: Some(|start| start.bytes.starts_with(b"ply\n") || start.bytes.starts_with(b"ply\r")),
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

/// A property of an element: a number, or a list with a type for its length.
pub(crate) struct Property {
    pub(crate) name: String,
    kind: Number,
    length: Option<Number>,
}

/// An element: records with the same properties.
pub(crate) struct Element {
    name: String,
    pub(crate) count: u64,
    properties: Vec<Property>,
}

/// The content of the header.
pub(crate) struct Header {
    encoding: Encoding,
    /// The elements before the vertices, which are passed over.
    before: Vec<Element>,
    pub(crate) vertices: Element,
    /// Whether nothing follows the vertices.
    is_last: bool,
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

/// Most elements and properties of a header, more than any program writes.
const MOST_PROPERTIES: usize = 1024;

pub(crate) fn read_header(bytes: &mut Bytes) -> Result<Header> {
    if bytes.line()? != "ply" {
        return Err(bytes.error("a different first line", "`ply`"));
    }
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    let mut properties = 0;
    loop {
        let line = bytes.line_of_any_text()?;
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        let unknown = |bytes: &Bytes| bytes.error(format!("`{line}`"), "a line of a PLY header");
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
            ["element", name, n] => elements.push(Element {
                name: (*name).to_owned(),
                count: n.parse().map_err(|_| unknown(bytes))?,
                properties: Vec::new(),
            }),
            ["property", of @ .., name] => {
                let (length, kind) = match of {
                    [kind] => (None, *kind),
                    ["list", length, kind] => (Some(*length), *kind),
                    _ => return Err(unknown(bytes)),
                };
                let typed = |kind: &str| {
                    let error = || bytes.error(format!("property type {kind}"), "a type of PLY");
                    number(kind).ok_or_else(error)
                };
                let property = Property {
                    name: (*name).to_owned(),
                    kind: typed(kind)?,
                    length: length.map(typed).transpose()?,
                };
                properties += 1;
                let element = elements
                    .last_mut()
                    .filter(|_| properties <= MOST_PROPERTIES);
                element
                    .ok_or_else(|| unknown(bytes))?
                    .properties
                    .push(property);
            }
            _ => return Err(unknown(bytes)),
        }
    }
    let at = elements.iter().position(|element| element.name == "vertex");
    let (Some(encoding), Some(at)) = (encoding, at) else {
        return Err(bytes.error("a header without format or vertices", "a header with both"));
    };
    let is_last = elements[at + 1..].iter().all(|element| element.count == 0);
    // Elements behind the vertices are not read.
    elements.truncate(at + 1);
    let Some(vertices) = elements.pop() else {
        return Err(bytes.error("no vertices", "the element vertex"));
    };
    Ok(Header {
        encoding,
        before: elements,
        vertices,
        is_last,
    })
}

impl Header {
    /// The properties of a vertex that are numbers, in their order.
    pub(crate) fn numbers(&self) -> impl Iterator<Item = &Property> {
        let properties = self.vertices.properties.iter();
        properties.filter(|property| property.length.is_none())
    }
}

pub(crate) fn read(input: &Input) -> Result<PointCloud> {
    let mut bytes = Bytes::open(input)?;
    let header = read_header(&mut bytes)?;
    let names: Vec<String> = header.numbers().map(|p| p.name.clone()).collect();
    let types: Vec<Number> = header.numbers().map(|p| p.kind).collect();
    let fields = Fields::of(&names, &types).ok_or_else(|| {
        let found = format!("the vertex properties {}", names.join(", "));
        bytes.error(found, "x, y and z")
    })?;
    let mut gathering = Gathering::new(input);
    let lists = header.vertices.properties.iter();
    let lists: Vec<&str> = lists
        .filter(|property| property.length.is_some())
        .map(|property| property.name.as_str())
        .collect();
    if !lists.is_empty() {
        input.remark(format!("the lists {} are left out", lists.join(", ")));
    }
    let mut values = Vec::with_capacity(names.len());
    let elements = header.before.iter().chain([&header.vertices]);
    for element in elements {
        let is_vertex = element.name == header.vertices.name;
        if let Encoding::Binary { .. } = header.encoding {
            let least = element.properties.iter();
            let least: usize = least.map(|p| p.length.unwrap_or(p.kind).size()).sum();
            bytes.check(element.count.saturating_mul(least as u64), &element.name)?;
        }
        let has_lists = element.properties.iter().any(|p| p.length.is_some());
        let mut record = vec![0; element.properties.iter().map(|p| p.kind.size()).sum()];
        for _ in 0..element.count {
            values.clear();
            match header.encoding {
                Encoding::Text => text_record(&mut bytes, element, &mut values)?,
                Encoding::Binary { big_endian } if has_lists => {
                    record_with_lists(&mut bytes, element, big_endian, &mut values)?;
                }
                Encoding::Binary { big_endian } => {
                    bytes.take(&mut record, "a record")?;
                    let mut at = 0;
                    for property in &element.properties {
                        values.push(property.kind.read(&record[at..], big_endian));
                        at += property.kind.size();
                    }
                }
            }
            if is_vertex {
                fields.push(&values, &mut gathering);
            }
        }
        if is_vertex && header.is_last && !has_lists {
            let length = (header.encoding != Encoding::Text).then_some(record.len());
            bytes.remark_on_rest(input, length)?;
        }
    }
    fields.finish(gathering)
}

/// Reads the numbers of a record, without its lists, from the next line that is not empty.
fn text_record(bytes: &mut Bytes, element: &Element, values: &mut Vec<f64>) -> Result<()> {
    let mut line = bytes.line()?;
    while line.is_empty() {
        line = bytes.line()?;
    }
    let mut numerals = Numerals::default();
    let mut cells = line.split_ascii_whitespace();
    let mut next = || cells.next().and_then(|cell| numerals.number(cell));
    for property in &element.properties {
        let wrong = |bytes: &Bytes| {
            let found: String = line.chars().take(80).collect();
            let expected = format!("the properties of a {}", element.name);
            bytes.error(format!("`{found}`"), expected)
        };
        let value = next().ok_or_else(|| wrong(bytes))?;
        if property.length.is_none() {
            values.push(value);
            continue;
        }
        for _ in 0..list_length(value, || wrong(bytes))? {
            next().ok_or_else(|| wrong(bytes))?;
        }
    }
    Ok(())
}

/// Reads the numbers of a record, without its lists.
fn record_with_lists(
    bytes: &mut Bytes,
    element: &Element,
    big_endian: bool,
    values: &mut Vec<f64>,
) -> Result<()> {
    let mut buffer = [0; 8];
    let read = |bytes: &mut Bytes, kind: Number, buffer: &mut [u8; 8]| {
        bytes.take(&mut buffer[..kind.size()], "a record")?;
        Ok::<f64, Error>(kind.read(&buffer[..], big_endian))
    };
    for property in &element.properties {
        let Some(length) = property.length else {
            values.push(read(bytes, property.kind, &mut buffer)?);
            continue;
        };
        let length = read(bytes, length, &mut buffer)?;
        let wrong = || bytes.error(format!("a list of {length} values"), "a length");
        let count = list_length(length, wrong)?;
        bytes.check(count.saturating_mul(property.kind.size() as u64), "a list")?;
        for _ in 0..count {
            read(bytes, property.kind, &mut buffer)?;
        }
    }
    Ok(())
}

fn list_length(value: f64, wrong: impl FnOnce() -> Error) -> Result<u64> {
    if value >= 0.0 && value.fract() == 0.0 && value <= f64::from(u32::MAX) {
        Ok(value as u64)
    } else {
        Err(wrong())
    }
}
