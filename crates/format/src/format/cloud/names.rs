//! Names of columns of clouds in the tables of other programs.

/// What a column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Meaning {
    X,
    Y,
    Z,
    Time,
    Intensity,
    /// The place from which a point was seen.
    SeenFromX,
    SeenFromY,
    SeenFromZ,
}

impl Meaning {
    /// Whether it belongs to the place from which a point was seen.
    pub(crate) fn is_viewpoint(self) -> bool {
        matches!(self, Self::SeenFromX | Self::SeenFromY | Self::SeenFromZ)
    }
}

/// Names of the place from which a point was seen, without differences of spelling: of the Point Cloud Library, PDAL and
/// others.
pub(crate) const VIEWPOINTS: [[&str; 3]; 6] = [
    ["vpx", "vpy", "vpz"],
    ["beamoriginx", "beamoriginy", "beamoriginz"],
    ["xorigin", "yorigin", "zorigin"],
    ["originx", "originy", "originz"],
    ["xsensor", "ysensor", "zsensor"],
    ["sensorx", "sensory", "sensorz"],
];

/// Names without differences of spelling, and what they mean.
const NAMES: [(&str, Meaning); 41] = [
    ("x", Meaning::X),
    ("y", Meaning::Y),
    ("z", Meaning::Z),
    ("easting", Meaning::X),
    ("northing", Meaning::Y),
    ("height", Meaning::Z),
    ("east", Meaning::X),
    ("north", Meaning::Y),
    ("elevation", Meaning::Z),
    ("e", Meaning::X),
    ("n", Meaning::Y),
    ("h", Meaning::Z),
    ("up", Meaning::Z),
    ("elev", Meaning::Z),
    ("altitude", Meaning::Z),
    ("rechtswert", Meaning::X),
    ("hochwert", Meaning::Y),
    ("höhe", Meaning::Z),
    ("hoehe", Meaning::Z),
    ("rechts", Meaning::X),
    ("hoch", Meaning::Y),
    ("ost", Meaning::X),
    ("ostwert", Meaning::X),
    ("nord", Meaning::Y),
    ("nordwert", Meaning::Y),
    ("xcoord", Meaning::X),
    ("ycoord", Meaning::Y),
    ("zcoord", Meaning::Z),
    ("xcoordinate", Meaning::X),
    ("ycoordinate", Meaning::Y),
    ("zcoordinate", Meaning::Z),
    ("pointx", Meaning::X),
    ("pointy", Meaning::Y),
    ("pointz", Meaning::Z),
    ("gpstime", Meaning::Time),
    ("time", Meaning::Time),
    ("times", Meaning::Time),
    ("timestamp", Meaning::Time),
    ("intensity", Meaning::Intensity),
    ("i", Meaning::Intensity),
    ("intensität", Meaning::Intensity),
];

/// Units in brackets, and their lengths in metres or durations in seconds.
const UNITS: [(&str, f64); 9] = [
    ("m", 1.0),
    ("metre", 1.0),
    ("meter", 1.0),
    ("mm", 1e-3),
    ("cm", 1e-2),
    ("km", 1e3),
    ("ft", 0.3048),
    ("s", 1.0),
    ("sec", 1.0),
];

/// Columns of a trajectory.
const ATTITUDE: [&str; 11] = [
    "qx", "qy", "qz", "qw", "roll", "pitch", "yaw", "heading", "omega", "phi", "kappa",
];

/// A name without its unit in brackets and without differences of spelling: `gps_time` and `GpsTime` become `gpstime`;
/// and the unit.
fn plain(name: &str) -> (String, Option<String>) {
    let name = name.to_lowercase();
    let (stem, unit) = match name.find(['[', '(']) {
        Some(at) if name.ends_with([']', ')']) => {
            let unit = name[at + 1..name.len() - 1].trim().to_owned();
            (name[..at].to_owned(), Some(unit))
        }
        _ => (name, None),
    };
    (stem.replace(['_', ' ', '-'], ""), unit)
}

fn named(name: &str) -> Option<Meaning> {
    let (stem, _) = plain(name);
    let mut places = VIEWPOINTS.iter().filter_map(|names| {
        let axes = [Meaning::SeenFromX, Meaning::SeenFromY, Meaning::SeenFromZ];
        let axis = names.iter().position(|known| *known == stem)?;
        Some(axes[axis])
    });
    let entry = NAMES.iter().find(|(known, _)| *known == stem);
    entry.map(|entry| entry.1).or_else(|| places.next())
}

/// The columns with the place from which a point was seen, among these names.
pub(crate) fn viewpoint_columns(names: &[String]) -> Option<[usize; 3]> {
    let find = |wanted: &str| names.iter().position(|name| plain(name).0 == wanted);
    let mut places = VIEWPOINTS.iter();
    places.find_map(|[x, y, z]| Some([find(x)?, find(y)?, find(z)?]))
}

/// What the column with this name holds, and the factor to metres or seconds; `None` for other columns.
///
/// # Errors
/// The name of a coordinate or a time with an unknown unit.
pub(crate) fn meaning(name: &str) -> Result<Option<(Meaning, f64)>, String> {
    let Some(meaning) = named(name) else {
        return Ok(None);
    };
    let unit = match plain(name).1 {
        Some(unit) if meaning != Meaning::Intensity => unit,
        _ => return Ok(Some((meaning, 1.0))),
    };
    let factor = UNITS.iter().find(|(known, _)| *known == unit);
    let factor = factor.ok_or_else(|| format!("the unit of `{name}`"))?;
    Ok(Some((meaning, factor.1)))
}

/// Whether a table with these columns is a cloud.
pub(crate) fn is_cloud(names: &[String]) -> bool {
    let has = |wanted: Meaning| names.iter().any(|name| named(name) == Some(wanted));
    let stems: Vec<String> = names.iter().map(|name| plain(name).0).collect();
    let begins_with_time = stems.first().is_some_and(|name| name.starts_with("time"));
    let is_attitude = |stem: &String| {
        let angle = stem.strip_suffix("deg").or(stem.strip_suffix("rad"));
        ATTITUDE.contains(&angle.unwrap_or(stem))
    };
    [Meaning::X, Meaning::Y, Meaning::Z].into_iter().all(has)
        && !stems.iter().any(is_attitude)
        && (!begins_with_time || has(Meaning::Intensity))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_other_programs_have_their_meanings() {
        for (name, expected) in [
            ("Easting", Ok(Some((Meaning::X, 1.0)))),
            ("Höhe", Ok(Some((Meaning::Z, 1.0)))),
            ("X[m]", Ok(Some((Meaning::X, 1.0)))),
            ("y (mm)", Ok(Some((Meaning::Y, 1e-3)))),
            ("GPS_Time", Ok(Some((Meaning::Time, 1.0)))),
            ("I", Ok(Some((Meaning::Intensity, 1.0)))),
            ("VP_X", Ok(Some((Meaning::SeenFromX, 1.0)))),
            ("Sensor Z (mm)", Ok(Some((Meaning::SeenFromZ, 1e-3)))),
            ("Red", Ok(None)),
        ] {
            assert_eq!(meaning(name), expected, "{name}");
        }
        assert!(meaning("X[furlong]").is_err_and(|unit| unit.contains("X[furlong]")));
    }
}
