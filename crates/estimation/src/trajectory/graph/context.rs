//! Makes factors from records.

use crate::geometry::heading::wrap;
use crate::geometry::{Mat3, Vec3};
use crate::sensor::{HeadingFix, ImuBias, PositionFix};
use crate::trajectory::constants::Constants;
use crate::trajectory::factors::{HeadingFactor, PositionFactor, Propagation, Quantity};
use crate::trajectory::imu_series::ImuSeries;
use crate::trajectory::logs::Stream;
use crate::trajectory::motion_sums::MotionSums;
use crate::trajectory::settings::TrajectorySettings;
use crate::trajectory::streams::Numbered;

/// What factors depend on besides their records.
#[derive(Clone, Copy)]
pub struct FactorContext<'a> {
    pub imu: &'a ImuSeries,
    pub settings: &'a TrajectorySettings,
    pub constants: &'a Constants,
    /// The bias about which the IMU is integrated.
    pub about: &'a ImuBias,
}

impl FactorContext<'_> {
    /// The propagation from a node to a record; it has no sums where they coincide.
    fn propagation(&self, node_s: f64, after_node_s: f64, time_s: f64) -> Propagation {
        let sums = || MotionSums::over(*self.about, self.imu.pieces(node_s, time_s));
        Propagation {
            sums: (after_node_s != 0.0).then(|| Box::new(sums())),
            sample: self.imu[self.imu.at(time_s)],
        }
    }

    /// The factor of a fix that lies `after_node_s` after the node at `node_s`.
    pub fn position(
        &self,
        sensor: usize,
        fix: &Numbered<PositionFix>,
        (node_s, after_node_s): (f64, f64),
    ) -> PositionFactor {
        let time_s = fix.value.time_s;
        let sigma_m = &self.settings.positions[sensor].sigma_m;
        let stream = Stream::Position(sensor);
        PositionFactor {
            propagation: self.propagation(node_s, after_node_s, time_s),
            sensor,
            record: fix.record,
            time_s,
            position_m: fix.value.position_m,
            whitener: whitener(fix.value.covariance_m2, sigma_m),
            weight: 1.0,
            clocks: self.constants.clocks_of(stream, fix.record, time_s),
        }
    }

    /// The factors of a heading, and of its pitch, that lies `after_node_s` after the node at `node_s`.
    pub fn headings(
        &self,
        fix: &Numbered<HeadingFix>,
        (node_s, after_node_s): (f64, f64),
    ) -> Vec<HeadingFactor> {
        let antennas = &self.settings.heading;
        let time_s = fix.value.time_s;
        let heading = antennas.mounting_offset_rad - antennas.grid_convergence_rad;
        let factor = |quantity, value_rad, sigma_rad| HeadingFactor {
            propagation: self.propagation(node_s, after_node_s, time_s),
            record: fix.record,
            time_s,
            quantity,
            value_rad,
            sigma_rad,
            weight: 1.0,
            clocks: self
                .constants
                .clocks_of(Stream::Heading, fix.record, time_s),
        };
        let mut factors = vec![factor(
            Quantity::Heading,
            wrap(fix.value.heading_rad + heading),
            fix.value.sigma_rad.unwrap_or(antennas.sigma_rad),
        )];
        if let Some(pitch_rad) = fix.value.pitch_rad {
            // Seen from above, the baseline lies counter-clockwise of the x axis by the offset.
            let (sin, cos) = antennas.mounting_offset_rad.sin_cos();
            let left = self.settings.axes.up().cross(&Vec3::x());
            let sigma = fix.value.pitch_sigma_rad;
            factors.push(factor(
                Quantity::Pitch(Vec3::x() * cos + left * sin),
                pitch_rad,
                sigma.unwrap_or(antennas.pitch_sigma_rad),
            ));
        }
        factors
    }
}

/// W with Wᵀ W the inverse of the covariance, or of the variances where none is given.
fn whitener(covariance_m2: Option<Mat3>, sigma_m: &Vec3) -> Mat3 {
    covariance_m2
        .and_then(|c| c.cholesky())
        .and_then(|c| c.l().try_inverse())
        .unwrap_or_else(|| Mat3::from_diagonal(&sigma_m.map(|s| 1.0 / s)))
}
