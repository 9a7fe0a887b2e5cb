//! Tables of numbers: CSV files and NumPy arrays.

use std::path::Path;

/// The rows of a CSV file, whose first line is its header, or of a `.npy` array.
pub fn numbers(path: &Path) -> Vec<Vec<f64>> {
    let bytes = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    if path.extension().is_some_and(|kind| kind == "npy") {
        return array(&bytes);
    }
    let text = String::from_utf8(bytes).unwrap();
    text.lines()
        .skip(1)
        .map(|line| {
            line.split(',')
                .map(|field| field.trim().parse().unwrap())
                .collect()
        })
        .collect()
}

/// The rows of an array of one or two dimensions.
fn array(bytes: &[u8]) -> Vec<Vec<f64>> {
    assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
    let length = u16::from_le_bytes([bytes[8], bytes[9]]);
    let (header, values) = bytes[10..].split_at(length.into());
    // {'descr': '<f8', 'fortran_order': False, 'shape': (30000, 6), }
    let header = std::str::from_utf8(header).unwrap();
    assert!(header.contains("'fortran_order': False"), "{header}");
    let values = match header.split('\'').nth(3).unwrap() {
        "<f8" => words(values, f64::from_le_bytes),
        "<f4" => words(values, |bytes| f32::from_le_bytes(bytes).into()),
        "<i8" => words(values, |bytes| i64::from_le_bytes(bytes) as f64),
        kind => panic!("numbers of the kind {kind}"),
    };
    let shape = header.split(['(', ')']).nth(1).unwrap();
    let columns = shape.split(',').nth(1).unwrap().trim();
    let columns = columns.parse().unwrap_or(1);
    values.chunks_exact(columns).map(<[f64]>::to_vec).collect()
}

fn words<const N: usize>(bytes: &[u8], read: impl Fn([u8; N]) -> f64) -> Vec<f64> {
    let (words, rest) = bytes.as_chunks::<N>();
    assert!(rest.is_empty());
    words.iter().map(|word| read(*word)).collect()
}
