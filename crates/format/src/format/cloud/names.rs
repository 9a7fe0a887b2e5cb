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
const NAMES: [(&str, Meaning); 38] = [
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
    ("u", Meaning::Z),
    ("intensity", Meaning::Intensity),
    ("i", Meaning::Intensity),
    ("intensität", Meaning::Intensity),
];

/// Names of times, without differences of spelling, behind which a unit may stand.
const TIMES: [&str; 4] = ["timestamp", "gpstime", "time", "times"];

/// Units in brackets or behind the last `_`, and their lengths in metres or durations in seconds.
const UNITS: [(&str, f64); 24] = [
    ("m", 1.0),
    ("metre", 1.0),
    ("meter", 1.0),
    ("metres", 1.0),
    ("meters", 1.0),
    ("mm", 1e-3),
    ("cm", 1e-2),
    ("km", 1e3),
    ("ft", 0.3048),
    ("foot", 0.3048),
    ("feet", 0.3048),
    ("international feet", 0.3048),
    ("us survey feet", 1200.0 / 3937.0),
    ("us survey foot", 1200.0 / 3937.0),
    ("us feet", 1200.0 / 3937.0),
    ("us-ft", 1200.0 / 3937.0),
    ("us ft", 1200.0 / 3937.0),
    ("ftus", 1200.0 / 3937.0),
    ("s", 1.0),
    ("sec", 1.0),
    ("ms", 1e-3),
    ("us", 1e-6),
    ("µs", 1e-6),
    ("ns", 1e-9),
];

/// Columns of a native table: one of them is misspelt if a header has only some.
const NATIVE: [&str; 3] = ["east_m", "north_m", "up_m"];

/// Columns of a trajectory.
const ATTITUDE: [&str; 11] = [
    "qx", "qy", "qz", "qw", "roll", "pitch", "yaw", "heading", "omega", "phi", "kappa",
];

/// A name without its unit, in brackets or behind the last `_`, and without differences of spelling: `gps_time` and
/// `GpsTime` become `gpstime`; and the unit.
fn plain(name: &str) -> (String, Option<String>) {
    let name = name.to_lowercase();
    let (stem, unit) = match (name.find(['[', '(']), name.rsplit_once('_')) {
        (Some(at), _) if name.ends_with([']', ')']) => {
            let unit = name[at + 1..name.len() - 1].trim().to_owned();
            (name[..at].to_owned(), Some(unit))
        }
        (_, Some((stem, unit))) if unit_factor(unit).is_some() => {
            (stem.to_owned(), Some(unit.to_owned()))
        }
        _ => (name, None),
    };
    (stem.replace(['_', ' ', '-', '.'], ""), unit)
}

/// The length in metres or the duration in seconds of a unit.
pub(crate) fn unit_factor(unit: &str) -> Option<f64> {
    let unit = unit
        .trim_matches(['[', ']', '(', ')', '"', ' '])
        .to_lowercase();
    let known = UNITS.iter().find(|(known, _)| *known == unit);
    known.map(|(_, factor)| *factor)
}

fn named(name: &str) -> Option<Meaning> {
    let (stem, _) = plain(name);
    let mut places = VIEWPOINTS.iter().filter_map(|names| {
        let axes = [Meaning::SeenFromX, Meaning::SeenFromY, Meaning::SeenFromZ];
        let axis = names.iter().position(|known| *known == stem)?;
        Some(axes[axis])
    });
    if TIMES.contains(&stem.as_str()) {
        return Some(Meaning::Time);
    }
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
    let factor = unit_factor(&unit).ok_or_else(|| format!("the unit of `{name}`"))?;
    Ok(Some((meaning, factor)))
}

/// Whether a table with these columns is a cloud.
pub(crate) fn is_cloud(names: &[String]) -> bool {
    has_places(names) && (!begins_with_time(names) || has(names, Meaning::Intensity))
}

/// Whether a table with these columns holds positions with their times, which may be a log or a cloud.
pub(crate) fn is_timed(names: &[String]) -> bool {
    has_places(names) && !is_cloud(names)
}

fn has(names: &[String], wanted: Meaning) -> bool {
    names.iter().any(|name| named(name) == Some(wanted))
}

fn begins_with_time(names: &[String]) -> bool {
    names
        .first()
        .is_some_and(|name| plain(name).0.starts_with("time") || named(name) == Some(Meaning::Time))
}

/// Whether there are columns of x, y and z and none of an attitude.
pub(crate) fn has_places(names: &[String]) -> bool {
    let is_attitude = |name: &String| {
        let stem = plain(name).0;
        let angle = stem.strip_suffix("deg").or(stem.strip_suffix("rad"));
        ATTITUDE.contains(&angle.unwrap_or(&stem))
    };
    let axes = [Meaning::X, Meaning::Y, Meaning::Z];
    let native = NATIVE
        .iter()
        .filter(|native| names.iter().any(|name| name == *native));
    axes.into_iter().all(|axis| has(names, axis))
        && !names.iter().any(is_attitude)
        && [0, NATIVE.len()].contains(&native.count())
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
            ("time_ns", Ok(Some((Meaning::Time, 1e-9)))),
            ("Timestamp [ms]", Ok(Some((Meaning::Time, 1e-3)))),
            ("East_m", Ok(Some((Meaning::X, 1.0)))),
            ("z_mm", Ok(Some((Meaning::Z, 1e-3)))),
            ("Elev.", Ok(Some((Meaning::Z, 1.0)))),
            ("U", Ok(Some((Meaning::Z, 1.0)))),
            ("X[US survey feet]", Ok(Some((Meaning::X, 1200.0 / 3937.0)))),
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
