//! Keys of a scenario: the field and the objects on it, the robot's motion and its drives.

use serde::{Deserialize, Serialize};

/// Size of the field.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Field {
    /// East and north, metres; one corner is the origin of the world.
    pub size_m: [f64; 2],
    /// Ground beyond the field on each side, for turning, metres.
    pub margin_m: f64,
}

/// Relief of the soil.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SoilSettings {
    /// Spacing of the height grid, metres.
    pub cell_m: f64,
    /// Wavelengths from undulation to crumbs, metres.
    pub wavelengths_m: Vec<f64>,
    /// Standard deviation of the height at each wavelength, metres.
    pub sigmas_m: Vec<f64>,
    /// Mean height of clods, metres; zero for none. They lie on the relief at random places, have
    /// random sizes, and are crushed by the wheels.
    pub clod_height_m: f64,
    /// Mean diameter of clods, metres.
    pub clod_size_m: f64,
    /// Share of the ground that clods cover.
    pub clod_cover: f64,
}

/// Plants on the field, clear of the boards: swaying leaves above the soil.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlantSettings {
    /// Plants per square metre, each of six leaves; zero for none.
    pub count_per_m2: f64,
    /// Height of the tallest plants above the soil, metres; leaves begin at a quarter of it.
    pub height_m: f64,
    /// Length of a leaf, metres; it is half as wide.
    pub leaf_m: f64,
    /// Standard deviation of the displacement of a leaf, metres. It sways with periods of about ten
    /// seconds, so it moves between passes and between the reference scan and the drives.
    pub sway_m: f64,
}

/// A board.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoardSettings {
    /// Centre: east, north, up, metres.
    pub center_m: [f64; 3],
    /// Tilt against the horizon, degrees.
    pub tilt_deg: f64,
    /// Direction of the inclination of the normal, degrees clockwise from north.
    pub azimuth_deg: f64,
    /// Length along the level and the sloping edge, metres.
    pub size_m: [f64; 2],
    /// Displacement of the board between the reference scan and the drives: east, north, up,
    /// metres.
    #[serde(default)]
    pub moved_m: [f64; 3],
}

/// Motion of the robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MotionSettings {
    /// Speed over boards, m/s.
    pub scan_speed_m_s: f64,
    /// Speed between boards, m/s.
    pub transit_speed_m_s: f64,
    /// Rest before the drive, seconds.
    pub rest_s: f64,
    /// Tightest turn, metres.
    pub turn_radius_m: f64,
    /// Height of the IMU above ground, metres.
    pub imu_height_m: f64,
    /// Distance between the axles and between left and right wheels, metres.
    pub wheelbase_track_m: [f64; 2],
    /// Shortest wavelength of the ground that the wheels follow, metres.
    pub wheel_wavelength_m: f64,
    /// Natural frequency of the suspension, Hz.
    pub suspension_hz: f64,
    /// Damping ratio of the suspension.
    pub suspension_damping: f64,
}

/// A drive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DriveSettings {
    /// Straight passes in order.
    pub passes: Vec<Pass>,
}

/// One straight pass of the profile scanners: with the keys `board` and `heading_deg`, or with
/// `from_m` and `to_m`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "PassKeys", into = "PassKeys")]
pub enum Pass {
    /// Over the centre of a board, from edge to edge.
    Board {
        /// Index of the board.
        board: usize,
        /// Heading, degrees clockwise from north.
        heading_deg: f64,
    },
    /// Over the ground.
    Line {
        /// Where it begins: east, north, metres.
        from_m: [f64; 2],
        /// Where it ends: east, north, metres.
        to_m: [f64; 2],
    },
}

/// The keys of a pass in a scenario file.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct PassKeys {
    board: Option<usize>,
    heading_deg: Option<f64>,
    from_m: Option<[f64; 2]>,
    to_m: Option<[f64; 2]>,
}

impl TryFrom<PassKeys> for Pass {
    type Error = &'static str;

    fn try_from(keys: PassKeys) -> Result<Self, Self::Error> {
        match (keys.board, keys.heading_deg, keys.from_m, keys.to_m) {
            (Some(board), Some(heading_deg), None, None) => Ok(Self::Board { board, heading_deg }),
            (None, None, Some(from_m), Some(to_m)) => Ok(Self::Line { from_m, to_m }),
            _ => Err("a pass has either board and heading_deg or from_m and to_m"),
        }
    }
}

impl From<Pass> for PassKeys {
    fn from(pass: Pass) -> Self {
        match pass {
            Pass::Board { board, heading_deg } => Self {
                board: Some(board),
                heading_deg: Some(heading_deg),
                ..Self::default()
            },
            Pass::Line { from_m, to_m } => Self {
                from_m: Some(from_m),
                to_m: Some(to_m),
                ..Self::default()
            },
        }
    }
}
