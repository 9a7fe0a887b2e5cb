//! Faults of logs and field that the project does not state.

use super::super::scenario::Scenario;
use super::draws::Draws;
use crate::geometry::Vec3;

/// A time after the end of every drawn drive, seconds.
const END_S: f64 = 1e4;

/// A fault of a drawn scenario.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// The total station, or the base of the antenna, is bumped and stays so.
    PositionStep,
    /// Positions are displaced for some time.
    PositionBlock,
    /// The clock of the positions runs fast or slow.
    PositionClock,
    /// Single positions are far off.
    PositionOutliers,
    /// The gyros read more or less than the rate of turn.
    GyroScale,
    /// The ranges of one scanner are too long or too short.
    RangeOffset,
    /// The time stamps of one scanner are late.
    ScannerLate,
    /// One board is moved between the drive and the scan of the reference.
    BoardMoved,
    /// The reference is displaced by far more than is stated.
    ReferenceDisplaced,
}

impl Fault {
    /// All faults.
    pub const ALL: [Self; 9] = [
        Self::PositionStep,
        Self::PositionBlock,
        Self::PositionClock,
        Self::PositionOutliers,
        Self::GyroScale,
        Self::RangeOffset,
        Self::ScannerLate,
        Self::BoardMoved,
        Self::ReferenceDisplaced,
    ];

    /// Whether the scenario has what this fault is one of.
    fn is_possible(self, scenario: &Scenario) -> bool {
        match self {
            Self::BoardMoved => scenario.reference.enabled && !scenario.boards.is_empty(),
            Self::ReferenceDisplaced => scenario.reference.enabled,
            _ => true,
        }
    }
}

/// Draws one fault of the scenario, and how large it is.
pub(super) fn fault(draws: &mut Draws, scenario: &mut Scenario) -> Fault {
    let possible: Vec<Fault> = Fault::ALL
        .into_iter()
        .filter(|fault| fault.is_possible(scenario))
        .collect();
    let fault = possible[draws.count(0, possible.len() - 1)];
    // The trajectory begins at rest.
    let from_s = scenario.motion.rest_s + draws.uniform((5.0, 30.0));
    let sign = if draws.chance(0.5) { 1.0 } else { -1.0 };
    let scanner = draws.count(0, scenario.scanners.len() - 1);
    let mut displacement = |sizes_m: (f64, f64)| -> [f64; 3] {
        let direction = Vec3::from(draws.normals(1.0)).normalize();
        (direction * draws.log_uniform(sizes_m)).into()
    };
    match fault {
        Fault::PositionStep => {
            scenario.prism.displaced_m = displacement((0.01, 0.2));
            scenario.prism.displaced_s = [from_s, END_S];
        }
        Fault::PositionBlock => {
            scenario.prism.displaced_m = displacement((0.02, 0.3));
            scenario.prism.displaced_s = [from_s, from_s + draws.uniform((5.0, 20.0))];
        }
        Fault::PositionClock => {
            scenario.prism.clock_ppm = sign * draws.log_uniform((20.0, 500.0));
        }
        Fault::PositionOutliers => {
            scenario.prism.outlier_share = draws.uniform((0.01, 0.1));
            scenario.prism.outlier_m = draws.log_uniform((0.05, 1.0));
        }
        Fault::GyroScale => scenario.imu.gyro_scale = sign * draws.log_uniform((0.003, 0.03)),
        Fault::RangeOffset => {
            scenario.scanners[scanner].range_offset_m = sign * draws.log_uniform((0.002, 0.01));
        }
        Fault::ScannerLate => {
            scenario.scanners[scanner].latency_s = sign * draws.log_uniform((0.005, 0.1));
        }
        Fault::BoardMoved => {
            let board = draws.count(0, scenario.boards.len() - 1);
            scenario.boards[board].moved_m = draws.normals(0.02);
        }
        Fault::ReferenceDisplaced => {
            let [x_m, y_m, z_m] = displacement((0.03, 0.3));
            let stated = scenario.reference.offset_m;
            scenario.reference.offset_m = [stated[0] + x_m, stated[1] + y_m, stated[2] + z_m];
        }
    }
    fault
}
