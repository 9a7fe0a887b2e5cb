//! The unit of the coordinates of a LAS file: from its coordinate reference system, as well-known text (LAS 1.4, record
//! 2112 of `LASF_Projection`) or as GeoTIFF keys (record 34735).

use crate::format::cloud::crs::{CoordinateUnit, is_metre, unit};
use crate::geometry::Vec3;
use las::crs::{GeoTiffCrs, GeoTiffData};

/// GeoTIFF keys of the type of the system and of its units of length.
pub(crate) const MODEL_TYPE: u16 = 1024;
pub(crate) const LINEAR_UNIT: u16 = 3076;
const VERTICAL_UNIT: u16 = 4099;
/// Model type of latitudes and longitudes.
pub(crate) const IS_GEOGRAPHIC: u16 = 2;

/// Name and length of a unit of EPSG, metres.
pub(crate) fn epsg_unit(code: u16) -> Option<(&'static str, f64)> {
    Some(match code {
        9001 => ("metre", 1.0),
        9002 => ("foot", 0.3048),
        9003 => ("US survey foot", 1200.0 / 3937.0),
        _ => return None,
    })
}

/// The number of a GeoTIFF key.
pub(crate) fn key(keys: &GeoTiffCrs, id: u16) -> Option<u16> {
    let entry = keys.entries.iter().find(|entry| entry.id == id)?;
    match entry.data {
        GeoTiffData::U16(value) => Some(value),
        _ => None,
    }
}

/// The unit of the coordinates; `None` if the file does not name it.
pub(crate) fn coordinate_unit(header: &las::Header) -> Option<CoordinateUnit> {
    let wkt = header.get_wkt_crs_bytes().map(String::from_utf8_lossy);
    if let Some(unit) = wkt.as_deref().and_then(unit) {
        return Some(unit);
    }
    let keys = header.get_geotiff_crs().ok()??;
    if key(&keys, MODEL_TYPE) == Some(IS_GEOGRAPHIC) {
        return Some(CoordinateUnit::Degree);
    }
    let (name, horizontal_m) = epsg_unit(key(&keys, LINEAR_UNIT)?)?;
    let vertical = key(&keys, VERTICAL_UNIT).and_then(epsg_unit);
    Some(CoordinateUnit::Length {
        name: name.to_owned(),
        horizontal_m,
        vertical_m: vertical.map_or(horizontal_m, |(_, metres)| metres),
    })
}

/// Whether the file names a coordinate reference system.
pub(crate) fn has_system(header: &las::Header) -> bool {
    header.get_wkt_crs_bytes().is_some() || matches!(header.get_geotiff_crs(), Ok(Some(_)))
}

/// A unit other than the metre: its name, and the metres of a step east, north and up.
pub(crate) fn converted(unit: Option<&CoordinateUnit>) -> Option<(&str, Vec3)> {
    match unit? {
        CoordinateUnit::Length {
            name,
            horizontal_m,
            vertical_m,
        } if !is_metre(*horizontal_m) || !is_metre(*vertical_m) => {
            Some((name, Vec3::new(*horizontal_m, *horizontal_m, *vertical_m)))
        }
        _ => None,
    }
}
