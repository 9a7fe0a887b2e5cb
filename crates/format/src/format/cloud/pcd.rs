//! PCD of the Point Cloud Library: text, binary, and binary compressed with LZF.

use crate::cloud::PointCloud;
use crate::error::Result;
use crate::format::binary::{Bytes, Number};
use crate::format::cloud::fields::Fields;
use crate::format::cloud::gathering::Gathering;
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::text::numerals::Numerals;
use crate::geometry::Vec3;

/// Compressed points may unpack to at most this many times their size plus this many bytes. Scans unpack to two to
/// ten times their size.
const MAX_EXPANSION: u64 = 32;
const EXPANSION_ALLOWANCE_BYTES: u64 = 16_000_000;

pub(crate) const PCD: Kind = Kind {
    signature: Some(|start| {
        let has_fields = start.contains(b"FIELDS ") || start.contains(b"COLUMNS ");
        has_fields && start.contains(b"DATA ")
    }),
    extensions: &["pcd"],
    cloud: Some(read),
    frame: Frame::Fixed(
        "metres (assumed: PCD has no unit); axes of the file, taken for the world: VIEWPOINT is not applied",
    ),
    ..Kind::new("pcd", "cloud (PCD)")
};

#[derive(Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Text,
    Binary,
    Compressed,
}

/// The content of the header.
pub(crate) struct Header {
    encoding: Encoding,
    pub(crate) count: u64,
    pub(crate) names: Vec<String>,
    types: Vec<Number>,
    repeats: Vec<usize>,
    /// Position and quaternion (w, x, y, z) of the sensor.
    viewpoint: Option<Vec<f64>>,
}

/// Largest accepted COUNT of a field, above that of any feature descriptor.
const MOST_REPEATS: usize = 4096;

pub(crate) fn read_header(bytes: &mut Bytes) -> Result<Header> {
    let (mut names, mut sizes, mut kinds): (Vec<String>, Vec<_>, Vec<_>) = Default::default();
    let mut repeats: Vec<usize> = Vec::new();
    let mut viewpoint = None;
    let (mut area, mut points) = ([None::<u64>; 2], None::<u64>);
    let encoding = loop {
        let line = bytes.line_of_any_text()?;
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let mut words = line.split_ascii_whitespace();
        let key = words.next().unwrap_or_default();
        let rest: Vec<&str> = words.collect();
        let integer = |text: Option<&&str>| text.and_then(|text| text.parse::<u64>().ok());
        match key {
            "VERSION" => {}
            "VIEWPOINT" => viewpoint = rest.iter().map(|s| s.parse().ok()).collect(),
            // Versions before 0.5 call them columns.
            "FIELDS" | "COLUMNS" => names = rest.iter().map(|s| (*s).to_owned()).collect(),
            "SIZE" => sizes = rest.iter().map(|s| (*s).to_owned()).collect(),
            "TYPE" => kinds = rest.iter().map(|s| (*s).to_owned()).collect::<Vec<_>>(),
            "COUNT" => {
                repeats = rest
                    .iter()
                    .map(|s| s.parse().unwrap_or(usize::MAX))
                    .collect()
            }
            "WIDTH" => area[0] = integer(rest.first()),
            "HEIGHT" => area[1] = integer(rest.first()),
            "POINTS" => points = integer(rest.first()),
            "DATA" => {
                break match rest.as_slice() {
                    ["ascii"] => Encoding::Text,
                    ["binary"] => Encoding::Binary,
                    ["binary_compressed"] => Encoding::Compressed,
                    _ => {
                        return Err(bytes.error(
                            format!("`{line}`"),
                            "DATA ascii, binary or binary_compressed",
                        ));
                    }
                };
            }
            _ => return Err(bytes.error(format!("`{line}`"), "a line of a PCD header")),
        }
    };
    if repeats.is_empty() {
        repeats = vec![1; names.len()];
    }
    let types: Option<Vec<Number>> = sizes
        .iter()
        .zip(&kinds)
        .map(|(size, kind): (&String, &String)| number(kind, size))
        .collect();
    let count = points.or_else(|| area[0]?.checked_mul(area[1]?));
    match (types, count) {
        (Some(types), Some(count))
            if types.len() == names.len()
                && sizes.len() == kinds.len()
                && repeats.len() == names.len()
                && repeats.iter().all(|n| *n <= MOST_REPEATS) =>
        {
            // A field that is there no times takes no bytes.
            let used: Vec<usize> = (0..names.len()).filter(|at| repeats[*at] > 0).collect();
            Ok(Header {
                encoding,
                count,
                names: used.iter().map(|at| names[*at].clone()).collect(),
                types: used.iter().map(|at| types[*at]).collect(),
                repeats: used.iter().map(|at| repeats[*at]).collect(),
                viewpoint,
            })
        }
        _ => Err(bytes.error(
            "a header whose FIELDS, SIZE, TYPE, COUNT and POINTS are inconsistent",
            "a consistent PCD header",
        )),
    }
}

fn number(kind: &str, size: &str) -> Option<Number> {
    Some(match (kind, size) {
        ("I", "1") => Number::I8,
        ("I", "2") => Number::I16,
        ("I", "4") => Number::I32,
        ("I", "8") => Number::I64,
        ("U", "1") => Number::U8,
        ("U", "2") => Number::U16,
        ("U", "4") => Number::U32,
        ("U", "8") => Number::U64,
        ("F", "4") => Number::F32,
        ("F", "8") => Number::F64,
        _ => return None,
    })
}

pub(crate) fn read(input: &Input) -> Result<PointCloud> {
    let mut bytes = Bytes::open(input)?;
    let header = read_header(&mut bytes)?;
    let fields = Fields::of(&header.names, &header.types).ok_or_else(|| {
        let found = format!("the fields {}", header.names.join(" "));
        bytes.error(found, "x, y and z")
    })?;
    let mut cloud = Gathering::new(input);
    if let Some(remark) = header.viewpoint.as_deref().and_then(viewpoint_remark) {
        input.remark(remark);
    }
    // The origin is written where nothing is known.
    let place = header.viewpoint.as_deref().and_then(|v| v.first_chunk());
    let place = place.map(|place| Vec3::from(*place));
    place
        .filter(|place| *place != Vec3::zeros())
        .into_iter()
        .for_each(|place| cloud.seen_from(place));
    let mut values = vec![0.0; header.names.len()];
    let sizes: Vec<usize> = header
        .types
        .iter()
        .zip(&header.repeats)
        .map(|(kind, n)| kind.size() * n)
        .collect();
    let length: usize = sizes.iter().sum();
    let total_bytes = header.count.saturating_mul(length as u64);
    match header.encoding {
        Encoding::Text => {
            for _ in 0..header.count {
                let mut line = bytes.line()?;
                while line.is_empty() {
                    line = bytes.line()?;
                }
                let mut numerals = Numerals::default();
                let mut cells = line.split_ascii_whitespace();
                for (value, n) in values.iter_mut().zip(&header.repeats) {
                    *value = cells
                        .next()
                        .and_then(|cell| numerals.number(cell))
                        .ok_or_else(|| bytes.error(format!("`{line}`"), "the fields of a point"))?;
                    for _ in 1..*n {
                        cells.next();
                    }
                }
                fields.push(&values, &mut cloud);
            }
            bytes.remark_on_rest(input, None)?;
        }
        Encoding::Binary => {
            bytes.check(total_bytes, "points")?;
            let mut record = vec![0; length];
            for _ in 0..header.count {
                bytes.take(&mut record, "a point")?;
                let mut at = 0;
                for ((value, kind), size) in values.iter_mut().zip(&header.types).zip(&sizes) {
                    *value = kind.read(&record[at..], false);
                    at += size;
                }
                fields.push(&values, &mut cloud);
            }
            bytes.remark_on_rest(input, Some(length))?;
        }
        Encoding::Compressed => {
            let mut head = [0; 8];
            bytes.take(&mut head, "the sizes of the compressed points")?;
            let size = |at: usize| u64::from(Number::U32.read(&head[at..], false) as u32);
            let (packed, unpacked) = (size(0), size(4));
            // Three bytes of LZF unpack to at most 264 bytes.
            if unpacked != total_bytes || unpacked > packed.saturating_mul(264) {
                return Err(bytes.error(
                    format!("{packed} bytes that unpack to {unpacked}"),
                    format!("{} points of {length} bytes", header.count),
                ));
            }
            bytes.check(packed, "compressed points")?;
            let in_memory = header
                .count
                .saturating_mul((size_of::<Vec3>() + size_of::<f64>() + size_of::<f32>()) as u64);
            if unpacked.max(in_memory)
                > MAX_EXPANSION
                    .saturating_mul(packed)
                    .saturating_add(EXPANSION_ALLOWANCE_BYTES)
            {
                return Err(bytes.error(
                    format!("{packed} bytes that unpack to {unpacked}"),
                    "at most 32 times as many and 16 MB, also as points: save the cloud as binary, \
                     not binary_compressed",
                ));
            }
            let mut input = vec![0; packed as usize];
            bytes.take(&mut input, "compressed points")?;
            let columns = unpack(&input, unpacked as usize)
                .ok_or_else(|| bytes.error("damaged compression", "LZF"))?;
            // The file held this many points, so that the allocation is bounded.
            cloud.reserve(header.count as usize);
            // All values of a field are stored together.
            for i in 0..header.count as usize {
                let mut start = 0;
                for ((value, kind), size) in values.iter_mut().zip(&header.types).zip(&sizes) {
                    *value = kind.read(&columns[start + i * size..], false);
                    start += size * header.count as usize;
                }
                fields.push(&values, &mut cloud);
            }
        }
    }
    fields.finish(cloud)
}

/// What to say about a viewpoint that is not the origin, unturned.
fn viewpoint_remark(viewpoint: &[f64]) -> Option<String> {
    let &[x, y, z, w, i, j, k] = viewpoint else {
        return None;
    };
    let axis = Vec3::new(i, j, k);
    if Vec3::new(x, y, z) == Vec3::zeros() && axis == Vec3::zeros() {
        return None;
    }
    let angle_deg = 2.0 * axis.norm().atan2(w.abs()).to_degrees();
    Some(format!(
        "VIEWPOINT ({x}, {y}, {z}) m, turned by {angle_deg:.1}°, is not applied: points are taken to be in the frame \
         of the world, as the Point Cloud Library stores them"
    ))
}

/// Unpacks LZF. A control byte c below 32 is followed by c + 1 literals. Otherwise its upper three
/// bits are the length − 2 of a copy (if 7, the next byte is added), and its lower five bits and
/// the next byte are the distance − 1.
fn unpack(input: &[u8], length: usize) -> Option<Vec<u8>> {
    // A damaged header must not allocate memory for bytes that the file does not have.
    let mut out = Vec::with_capacity(length.min(8 * input.len()));
    let mut input = input.iter().copied();
    while let Some(control) = input.next() {
        if control < 32 {
            for _ in 0..=control {
                out.push(input.next()?);
            }
        } else {
            let mut count = usize::from(control >> 5);
            if count == 7 {
                count += usize::from(input.next()?);
            }
            let distance = (usize::from(control & 31) << 8) + usize::from(input.next()?) + 1;
            let start = out.len().checked_sub(distance)?;
            for i in start..start + count + 2 {
                out.push(out[i]);
            }
        }
        if out.len() > length {
            return None;
        }
    }
    (out.len() == length).then_some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lzf_unpacks_literals_copies_and_runs() {
        // "abc", then 3 from distance 3, then 3 + 7 of the last byte.
        let packed = [2, b'a', b'b', b'c', 1 << 5, 2, 7 << 5, 1, 0];
        assert_eq!(unpack(&packed, 16).unwrap(), b"abcabccccccccccc");
        assert!(unpack(&packed, 15).is_none() && unpack(&packed, 17).is_none());
        assert!(unpack(&[1 << 5, 9], 3).is_none());
    }
}
