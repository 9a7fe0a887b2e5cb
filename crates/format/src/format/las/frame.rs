//! Units and frame of a LAS file: the coordinate reference system in its header, as well-known text (LAS 1.4, record
//! 2112 of `LASF_Projection`) or as GeoTIFF keys (record 34735).

use crate::error::Result;
use crate::format::cloud::crs::{ANGLES, describe as describe_wkt, describe_unit};
use crate::format::file::guarded;
use crate::format::input::Input;
use crate::format::las::columns::PoseColumns;
use crate::format::las::file::LasFile;
use crate::format::las::units::{IS_GEOGRAPHIC, LINEAR_UNIT, MODEL_TYPE, epsg_unit, key};
use las::crs::{GeoTiffCrs, GeoTiffData};

/// GeoTIFF keys of the system: its names and codes.
const CITATION: u16 = 1026;
const GEOGRAPHIC: u16 = 2048;
const PROJECTED: u16 = 3072;
const PROJECTED_CITATION: u16 = 3073;
/// Model type of projected coordinates.
const IS_PROJECTED: u16 = 1;
/// How a unit other than the metre is read.
const CONVERTED: &str = "converted to metres";
/// GeoTIFF codes that are EPSG codes; the others stand for no code.
const CODES: std::ops::Range<u16> = 1024..32767;

/// Units and frame of a file.
///
/// # Errors
/// Those of opening the file.
pub(crate) fn describe(input: &Input) -> Result<String> {
    let file = LasFile::reopen(input)?;
    let header = file.header();
    let keys = guarded(input.path(), "LAS or LAZ", || Ok(header.get_geotiff_crs()))?;
    let wkt = header.get_wkt_crs_bytes().map(String::from_utf8_lossy);
    let system = match (
        wkt.as_deref()
            .and_then(|text| describe_wkt(text, CONVERTED)),
        keys,
    ) {
        (Some(text), _) => format!("{text} (WKT of the file)"),
        (None, Ok(Some(keys))) => describe_keys(&keys),
        (None, Ok(None)) => {
            "metres (assumed: the file names no unit and no coordinate system)".to_owned()
        }
        (None, Err(_)) => "metres (assumed: the GeoTIFF keys of the file are damaged)".to_owned(),
    };
    Ok(match PoseColumns::of(&file) {
        Some(_) => format!("{system}; world frame, with the pose of the sensor at every point"),
        None => {
            format!("{system}; world frame if read as a cloud, scanner frame if read as profiles")
        }
    })
}

fn describe_keys(keys: &GeoTiffCrs) -> String {
    let number = |id: u16| key(keys, id);
    let text = |id: u16| {
        keys.entries
            .iter()
            .find(|entry| entry.id == id)
            .and_then(|entry| match &entry.data {
                GeoTiffData::String(text) => text.split(['|', '\0']).next().map(str::trim),
                _ => None,
            })
    };
    let is_geographic = number(MODEL_TYPE) == Some(IS_GEOGRAPHIC);
    let code = number(if is_geographic { GEOGRAPHIC } else { PROJECTED });
    let name = [PROJECTED_CITATION, CITATION].into_iter().filter_map(text);
    let name = name
        .filter(|name| !name.is_empty())
        .map(|name| name.chars().take(80).collect());
    let name = match (
        code.filter(|code| CODES.contains(code)),
        name.into_iter().next(),
    ) {
        (Some(code), _) => format!("EPSG:{code}"),
        (None, Some(name)) => name,
        (None, None) if number(MODEL_TYPE) == Some(IS_PROJECTED) => {
            "a projected system without code".to_owned()
        }
        (None, None) => "a system without code".to_owned(),
    };
    let unit = match number(LINEAR_UNIT) {
        _ if is_geographic => ANGLES.to_owned(),
        Some(code) => match epsg_unit(code) {
            Some((name, metres)) => describe_unit(name, metres, CONVERTED),
            None => format!("unit EPSG:{code}, but read as metres"),
        },
        None => "unit of that system, read as metres".to_owned(),
    };
    format!("{name}; {unit} (GeoTIFF keys of the file)")
}

#[cfg(test)]
mod tests {
    /// The frame that `inspect` reports for a file with these records of `LASF_Projection`.
    fn frame(records: &[(u16, Vec<u8>)]) -> String {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.las");
        let mut builder = las::Builder::from((1, 4));
        builder.point_format = las::point::Format::new(1).unwrap();
        for (record_id, data) in records {
            builder.vlrs.push(las::Vlr {
                user_id: "LASF_Projection".to_owned(),
                record_id: *record_id,
                data: data.clone(),
                ..Default::default()
            });
        }
        let header = builder.into_header().unwrap();
        let mut writer = las::Writer::from_path(&path, header).unwrap();
        let point = las::Point {
            gps_time: Some(1.0),
            ..Default::default()
        };
        writer.write_point(point).unwrap();
        writer.close().unwrap();
        let report = crate::format::inspect(&path).unwrap();
        assert!(
            report
                .to_string()
                .contains(&format!("  frame    {}\n", report.frame))
        );
        report.frame
    }

    fn keys(entries: &[[u16; 4]]) -> Vec<u8> {
        let head = [1, 1, 0, entries.len() as u16];
        let words = head.iter().chain(entries.iter().flatten());
        words.flat_map(|word| word.to_le_bytes()).collect()
    }

    #[test]
    fn the_coordinate_system_comes_from_the_well_known_text_or_the_geotiff_keys() {
        let wkt = br#"PROJCS["UTM 32N",UNIT["metre",1],AUTHORITY["EPSG","25832"]]"#.to_vec();
        let found = frame(&[(2112, [wkt, vec![0]].concat())]);
        assert!(
            found.starts_with("EPSG:25832, UTM 32N; metres (WKT of the file);"),
            "{found}"
        );
        let found = frame(&[(
            34735,
            keys(&[[1024, 0, 1, 1], [3072, 0, 1, 26917], [3076, 0, 1, 9002]]),
        )]);
        let expected =
            "EPSG:26917; unit foot of 0.3048 m, converted to metres (GeoTIFF keys of the file);";
        assert!(found.starts_with(expected), "{found}");
        let found = frame(&[(34735, keys(&[[1024, 0, 1, 2], [2048, 0, 1, 4326]]))]);
        assert!(
            found.starts_with("EPSG:4326; latitude and longitude, but read as metres"),
            "{found}"
        );
        let names = (34737, b"ETRS89 / UTM 32N|\0".to_vec());
        let found = frame(&[
            (
                34735,
                keys(&[[1024, 0, 1, 1], [1026, 34737, 17, 0], [3072, 0, 1, 32767]]),
            ),
            names,
        ]);
        assert!(
            found.starts_with("ETRS89 / UTM 32N; unit of that system"),
            "{found}"
        );
    }

    #[test]
    fn without_a_coordinate_system_metres_are_assumed() {
        assert!(frame(&[]).starts_with("metres (assumed: the file names no unit"));
        let damaged = frame(&[(34735, keys(&[[3072, 0, 1, 26917]])[..12].to_vec())]);
        assert!(
            damaged.contains("keys of the file are damaged"),
            "{damaged}"
        );
        assert!(frame(&[(2112, b"no text".to_vec())]).starts_with("metres (assumed"));
    }
}
