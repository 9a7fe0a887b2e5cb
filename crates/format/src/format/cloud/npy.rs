//! NumPy `.npy`: little-endian float32 or float64 of shape (n, 3) in C order.

use crate::cloud::PointCloud;
use crate::error::Result;
use crate::format::binary::{Bytes, Number};
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
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
    let mut header = vec![0; length];
    bytes.take(&mut header, "the header")?;
    let header = String::from_utf8_lossy(&header).into_owned();
    let unsupported = |bytes: &Bytes| {
        let found: String = header.trim().chars().take(200).collect();
        bytes.error(
            format!("`{found}`"),
            "'<f8' or '<f4' of shape (n, 3) with 'fortran_order': False",
        )
    };
    let kind = if header.contains("'<f8'") {
        Number::F64
    } else if header.contains("'<f4'") {
        Number::F32
    } else {
        return Err(unsupported(&bytes));
    };
    let shape = header
        .split_once("'shape': (")
        .and_then(|(_, rest)| rest.split_once(", 3)"))
        .and_then(|(n, _)| n.parse::<u64>().ok());
    let (Some(n), true) = (shape, header.contains("'fortran_order': False")) else {
        return Err(unsupported(&bytes));
    };
    bytes.check(n.saturating_mul(3 * kind.size() as u64), "coordinates")?;
    let mut cloud = PointCloud::default();
    let mut record = vec![0; 3 * kind.size()];
    for _ in 0..n {
        bytes.take(&mut record, "a point")?;
        let p = Vec3::from_fn(|i, _| kind.read(&record[i * kind.size()..], false));
        if p.iter().all(|v| v.is_finite()) {
            cloud.points.push(p);
        }
    }
    Ok(cloud)
}
