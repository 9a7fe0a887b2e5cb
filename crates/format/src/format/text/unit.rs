//! Columns in units other than boresight's, identified by the ends of their names.

use crate::sensor::STANDARD_GRAVITY_M_S2;

/// Ends of names with the wanted unit and with a unit that a file may have, and the factor from the file's unit
/// to the wanted unit.
const UNITS: [(&str, &str, f64); 13] = [
    ("_rad_s", "_deg_s", std::f64::consts::PI / 180.0),
    ("_rad_s", "_mrad_s", 1e-3),
    ("_m_s2", "_g", STANDARD_GRAVITY_M_S2),
    ("_m_s2", "_mg", 1e-3 * STANDARD_GRAVITY_M_S2),
    ("_m", "_mm", 1e-3),
    ("_m", "_cm", 1e-2),
    ("_m", "_km", 1e3),
    ("_m2", "_mm2", 1e-6),
    ("time_s", "time_ms", 1e-3),
    ("time_s", "time_us", 1e-6),
    ("time_s", "time_ns", 1e-9),
    ("_deg", "_rad", 180.0 / std::f64::consts::PI),
    ("_deg", "_gon", 0.9),
];

/// The factor from the values of the column `name` to those of `wanted`, if the names differ only in their
/// units or not at all.
pub(crate) fn factor(name: &str, wanted: &str) -> Option<f64> {
    if name == wanted {
        return Some(1.0);
    }
    UNITS.iter().find_map(|(to, from, factor)| {
        let stem = wanted.strip_suffix(to)?;
        (name.strip_suffix(from)? == stem).then_some(*factor)
    })
}

/// As [`factor`], for a column of a table with these names: without `time_s`, a column called `time` holds seconds or
/// dates.
pub(crate) fn factor_of(name: &str, wanted: &str, names: &[String]) -> Option<f64> {
    let is_time = || {
        wanted == "time_s"
            && ["time", "timestamp"]
                .iter()
                .any(|known| name.eq_ignore_ascii_case(known))
            && !names.iter().any(|name| factor(name, wanted).is_some())
    };
    factor(name, wanted).or_else(|| is_time().then_some(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_differ_in_their_unit_have_a_factor() {
        for (name, wanted, expected) in [
            ("time_s", "time_s", Some(1.0)),
            ("time_ns", "time_s", Some(1e-9)),
            ("accel_x_g", "accel_x_m_s2", Some(9.80665)),
            ("sigma_east_mm", "sigma_east_m", Some(1e-3)),
            ("cov_en_mm2", "cov_en_m2", Some(1e-6)),
            ("accel_x_g", "accel_y_m_s2", None),
            ("x", "x_m", None),
            ("gyro_x_rad_ms", "gyro_x_rad_s", None),
        ] {
            assert_eq!(factor(name, wanted), expected, "{name}");
        }
        let gyro = factor("gyro_x_deg_s", "gyro_x_rad_s").unwrap();
        assert!((gyro - 1f64.to_radians()).abs() < 1e-18);
        assert!((factor("heading_gon", "heading_deg").unwrap() * 400.0 - 360.0).abs() < 1e-12);
    }
}
