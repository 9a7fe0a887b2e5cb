//! Where the values of a pose are in the rows of a text export with latitudes and longitudes.

use crate::error::Result;
use crate::format::poses::order::Order;
use crate::format::text::lines::Lines;
use crate::geometry::Vec3;
use crate::sensor::{GeographicPose, NavigationAngles, NavigationSigma};

/// The columns of a pose, counted from 0.
pub(super) struct Layout {
    /// Number of columns.
    pub(super) width: usize,
    /// Time (seconds), latitude, longitude (degrees), ellipsoidal height (metres), roll, pitch, heading (degrees).
    pub(super) needed: [usize; 7],
    /// East, north, up, m/s.
    pub(super) velocity: Option<[usize; 3]>,
    /// Standard deviations: east, north, up (metres), roll, pitch, heading (degrees).
    pub(super) sigma: Option<[usize; 6]>,
}

impl Layout {
    /// Adds the pose in a row, the last one of `lines`.
    ///
    /// # Errors
    /// A place that is none.
    pub(super) fn add(
        &self,
        row: &[f64],
        lines: &Lines,
        order: &mut Order,
        poses: &mut Vec<GeographicPose>,
    ) -> Result<()> {
        let pose = self.pose(row);
        order.add(pose.time_s, |found, expected| lines.error(found, expected));
        if let Err(found) = pose.check() {
            return Err(lines.error(found, "latitudes within ±90° and longitudes within ±360°"));
        }
        poses.push(pose);
        Ok(())
    }

    fn pose(&self, row: &[f64]) -> GeographicPose {
        let [time_s, latitude, longitude, height_m, roll, pitch, heading] =
            self.needed.map(|at| row[at]);
        let sigma = self.sigma.map(|at| at.map(|at| row[at]));
        // Zero stands for an unknown standard deviation.
        let sigma = sigma.filter(|values| values.iter().all(|value| *value > 0.0));
        GeographicPose {
            time_s,
            latitude_rad: latitude.to_radians(),
            longitude_rad: longitude.to_radians(),
            height_m,
            angles: NavigationAngles::from_deg([roll, pitch, heading]),
            velocity_m_s: self.velocity.map(|at| Vec3::from(at.map(|at| row[at]))),
            sigma: sigma.map(|[east, north, up, roll, pitch, heading]| NavigationSigma {
                position_m: Vec3::new(east, north, up),
                angles: NavigationAngles::from_deg([roll, pitch, heading]),
            }),
        }
    }
}

/// The places of columns that are used only together.
pub(super) fn all<const N: usize>(columns: [Option<usize>; N]) -> Option<[usize; N]> {
    let places: Option<Vec<usize>> = columns.into_iter().collect();
    places.and_then(|places| places.try_into().ok())
}
