//! LAS and LAZ among the formats.

use crate::error::Result;
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind, Start};
use crate::format::las::columns::PoseColumns;
use crate::format::las::file::LasFile;
use crate::format::las::frame as las_frame;
use crate::format::las::points::read_las;
use crate::format::las::scan::{LasScan, PosedScan, read_poses};
use crate::format::profiles::reader::ProfileReader;

/// The byte with the format of the points, and its bit for compression.
const POINT_FORMAT: usize = 104;
const COMPRESSED: u8 = 0x80;

pub(crate) const LAS: Kind = Kind {
    signature: Some(|start| is_las(start) && !is_compressed(start)),
    extensions: &["las"],
    poses: Some(read_poses),
    cloud: Some(read_las),
    profiles: Some(open_profiles),
    wkt: Some(wkt),
    frame: Frame::OfFile(las_frame::describe),
    ..Kind::new("las", "points (LAS)")
};

pub(crate) const LAZ: Kind = Kind {
    signature: Some(|start| is_las(start) && is_compressed(start)),
    extensions: &["laz"],
    poses: Some(read_poses),
    cloud: Some(read_las),
    profiles: Some(open_profiles),
    wkt: Some(wkt),
    frame: Frame::OfFile(las_frame::describe),
    ..Kind::new("laz", "points (LAZ)")
};

fn is_las(start: &Start<'_>) -> bool {
    start.bytes.starts_with(b"LASF")
}

fn is_compressed(start: &Start<'_>) -> bool {
    start
        .bytes
        .get(POINT_FORMAT)
        .is_some_and(|b| b & COMPRESSED != 0)
}

fn wkt(input: &Input) -> Result<Option<String>> {
    let file = LasFile::reopen(input)?;
    let wkt = file.header().get_wkt_crs_bytes();
    let text = wkt.map(|wkt| String::from_utf8_lossy(wkt).into_owned());
    let text = text.map(|text| text.trim_end_matches('\0').trim().to_owned());
    Ok(text.filter(|text| !text.is_empty()))
}

/// Points in the scanner frame with times; or points in the world with the sensor's pose for each, which are
/// transformed back into the scanner frame and sorted by time in memory.
fn open_profiles(input: &Input) -> Result<Box<dyn ProfileReader>> {
    let file = LasFile::open(input)?;
    Ok(match PoseColumns::of(&file) {
        Some(_) => Box::new(PosedScan::read(file)?),
        None => Box::new(LasScan::new(&file)?),
    })
}
