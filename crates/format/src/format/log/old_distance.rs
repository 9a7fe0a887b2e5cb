//! Distances that are older than the angles beside them.

use crate::geometry::Vec3;

/// What two distances to a prism may differ by because of noise, metres: five standard deviations of the difference of
/// two, at the 1 mm that tracking total stations state.
const NOISE_M: f64 = 5.0 * std::f64::consts::SQRT_2 * 0.001;

/// Return codes of GeoCOM for angles without a distance (TMC_ANGLE_OK, TMC_ANGLE_NO_FULL_CORRECTION,
/// TMC_ANGLE_ACCURACY_GUARANTEE): a distance beside them is the last one.
const ANGLES_ONLY: [f64; 3] = [1285.0, 1288.0, 1289.0];

/// Why a row with this slope distance (metres) is not a measurement.
pub(super) fn without_range(slope_distance_m: f64) -> Option<String> {
    if slope_distance_m == 0.0 {
        Some("zero range".to_owned())
    } else if slope_distance_m < 0.0 {
        Some(format!("a range of {slope_distance_m} m"))
    } else {
        None
    }
}

/// A row of a total station, with the position of the prism relative to any point that does not move.
#[derive(Debug, Clone, Copy)]
pub(super) struct PolarRow {
    pub time_s: f64,
    pub slope_distance_m: f64,
    pub position_m: Vec3,
    /// What the instrument says of the row, NaN if it says nothing.
    pub status: f64,
}

/// Finds rows that repeat an earlier distance beside new angles.
///
/// A total station that turns after the prism without having measured since gives its last distance again. The position
/// is then off along the line of sight by the radial speed of the prism times the age of the distance. GeoCOM says so in
/// its return codes. Other instruments have codes of their own or none, so the geometry decides as well: a distance is
/// old if it equals that of the row before to the last digit, although between the two the prism moved across the line
/// of sight by more than noise, and with its last radial speed would have moved along it by more than noise.
#[derive(Debug, Default)]
pub(super) struct OldDistances {
    /// The last row with a distance of its own, and the radial speed until then, m/s.
    last: Option<(PolarRow, f64)>,
}

impl OldDistances {
    /// Why the next row is not a measurement, if its distance is old.
    pub fn reason(&mut self, row: PolarRow) -> Option<String> {
        if ANGLES_ONLY.contains(&row.status) {
            return Some("angles without a distance".to_owned());
        }
        let Some((last, radial_speed_m_s)) = self.last else {
            self.last = Some((row, 0.0));
            return None;
        };
        let elapsed_s = row.time_s - last.time_s;
        let moved_m = row.slope_distance_m - last.slope_distance_m;
        if moved_m != 0.0 || (row.position_m - last.position_m).norm() <= NOISE_M {
            self.last = Some((row, moved_m / elapsed_s));
            return None;
        }
        // The next row is compared with the same one: a slow prism takes several rows to leave the noise.
        ((radial_speed_m_s * elapsed_s).abs() > NOISE_M).then(|| {
            format!(
                "the distance of {elapsed_s:.2} s before, {} m, beside new angles",
                row.slope_distance_m
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows at 7 Hz of a prism with a constant velocity, from 20 m north of the instrument; `given` are the distances
    /// that the rows hold, from those that are measured.
    fn old_rows(velocity_m_s: Vec3, given: impl Fn(usize, &[f64]) -> f64) -> Vec<usize> {
        let rate_hz = 7.0;
        let positions: Vec<Vec3> = (0..40)
            .map(|i| Vec3::new(0.0, 20.0, 0.0) + velocity_m_s * (i as f64 / rate_hz))
            .collect();
        let distances: Vec<f64> = positions.iter().map(Vec3::norm).collect();
        let mut old = OldDistances::default();
        let rows = positions.iter().enumerate().map(|(i, position_m)| {
            let slope_distance_m = given(i, &distances);
            PolarRow {
                time_s: i as f64 / rate_hz,
                slope_distance_m,
                position_m: position_m.normalize() * slope_distance_m,
                status: if i == 5 { ANGLES_ONLY[0] } else { f64::NAN },
            }
        });
        let is_old = |(i, row)| old.reason(row).map(|_| i);
        rows.enumerate().filter_map(is_old).collect()
    }

    #[test]
    fn a_distance_that_a_moving_prism_repeats_or_that_its_code_denies_is_old() {
        let repeated = |i: usize, distances: &[f64]| match i {
            10 | 11 => distances[9],
            30 => distances[29],
            _ => distances[i],
        };
        assert_eq!(
            old_rows(Vec3::new(0.3, 0.2, 0.0), repeated),
            [5, 10, 11, 30]
        );
        // Slower: 4 mm a row do not show in the first.
        assert_eq!(old_rows(Vec3::new(0.3, 0.03, 0.0), repeated), [5, 11]);
    }

    #[test]
    fn a_distance_that_stays_is_not_old() {
        let rounded = |i: usize, distances: &[f64]| (1e3 * distances[i]).round() / 1e3;
        // At rest, around the instrument, and straight away from it.
        assert_eq!(old_rows(Vec3::zeros(), rounded), [5]);
        assert_eq!(old_rows(Vec3::new(0.02, 0.0, 0.0), rounded), [5]);
        assert_eq!(old_rows(Vec3::new(0.0, 0.3, 0.0), rounded), [5]);
    }
}
