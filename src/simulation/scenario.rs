//! What is simulated: every number of the twin, with defaults.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::error::{Error, Location, Result};
use crate::geometry::euler::rotation_from_euler_deg;
use crate::geometry::{BodyAxes, BodyFromScanner, EulerConvention, Rotation, Vec3};

/// A scenario: as read from TOML, where every key may be left out.
///
/// Whatever the axes of the body that is written, lever arms and mountings are given here in FRD.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Scenario {
    /// Name, for people.
    pub name: String,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Axes of the body in all files.
    pub body: BodyAxes,
    /// Magnitude of gravity, m/s².
    pub gravity_m_s2: f64,
    /// The field.
    pub field: Field,
    /// Its soil.
    pub soil: SoilSettings,
    /// How the robot moves.
    pub motion: MotionSettings,
    /// The IMU.
    pub imu: ImuSettings,
    /// The prism and its total station.
    pub prism: PrismSettings,
    /// The heading antennas.
    pub heading: HeadingSettings,
    /// Both profile scanners.
    pub profiles: ProfileSettings,
    /// The reference cloud.
    pub reference: ReferenceSettings,
    /// Mounting that gives way.
    pub deformation: DeformationSettings,
    /// Boards on the field.
    pub boards: Vec<BoardSettings>,
    /// True and initial mounting of each scanner.
    pub scanners: Vec<ScannerSettings>,
    /// The drives.
    pub drives: Vec<DriveSettings>,
    /// Where it was read from; `None` for a preset.
    #[serde(skip)]
    pub file: Option<PathBuf>,
}

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
}

/// A board.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoardSettings {
    /// Centre: east, north, up, metres.
    pub center_m: [f64; 3],
    /// Tilt against the horizon, degrees.
    pub tilt_deg: f64,
    /// Direction the normal leans to, degrees clockwise from north.
    pub azimuth_deg: f64,
    /// Length along the level and the sloping edge, metres.
    pub size_m: [f64; 2],
}

/// How the robot moves.
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

/// The IMU: datasheet of the SBG Ellipse-D.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ImuSettings {
    /// Samples per second.
    pub rate_hz: f64,
    /// Angle random walk, °/√h.
    pub gyro_noise_deg_sqrt_h: f64,
    /// Velocity random walk, µg/√Hz.
    pub accel_noise_ug_sqrt_hz: f64,
    /// Gyro bias instability, °/h.
    pub gyro_bias_instability_deg_h: f64,
    /// Accelerometer bias instability, µg.
    pub accel_bias_instability_ug: f64,
    /// Time in which a bias walks as far as its instability, seconds.
    pub bias_time_s: f64,
    /// Standard deviation of each axis's bias at the start, rad/s.
    pub gyro_bias_sigma_rad_s: f64,
    /// Standard deviation of each axis's bias at the start, m/s².
    pub accel_bias_sigma_m_s2: f64,
    /// False for an ideal IMU.
    pub noise: bool,
}

/// Prism and total station.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PrismSettings {
    /// Positions per second.
    pub rate_hz: f64,
    /// White noise of each coordinate, metres.
    pub sigma_m: f64,
    /// The prism in the body (FRD), metres.
    pub lever_arm_m: [f64; 3],
    /// A position carries a time stamp this much too late, seconds.
    pub latency_s: f64,
    /// Amplitude of an error that depends on where the line of sight enters the prism, metres.
    pub incidence_bias_m: f64,
    /// The total station, metres.
    pub station_m: [f64; 3],
}

/// Heading antennas.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HeadingSettings {
    /// Headings per second.
    pub rate_hz: f64,
    /// White noise, degrees.
    pub sigma_deg: f64,
    /// Heading of the body minus that of the antennas, degrees.
    pub mounting_offset_deg: f64,
}

/// The profile scanners: datasheet of the Gocator 2490.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ProfileSettings {
    /// Profiles per second.
    pub rate_hz: f64,
    /// Rays per profile.
    pub width: usize,
    /// Opening of the fan, degrees.
    pub fan_deg: f64,
    /// Nearest and farthest distance along the fan's axis, metres.
    pub range_m: [f64; 2],
    /// Noise at the nearest and farthest distance, linear between, metres.
    pub sigma_m: [f64; 2],
    /// No return beyond this angle of incidence, degrees.
    pub grazing_deg: f64,
    /// Share of points lost at random.
    pub dropout: f64,
    /// Neighbouring ranges that differ by more make an edge, metres.
    pub edge_m: f64,
    /// Share of points at edges that are lost, and that fly between both sides.
    pub edge_lost_flying: [f64; 2],
}

/// The reference cloud by terrestrial laser scanning.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ReferenceSettings {
    /// Spacing on the boards, metres.
    pub board_spacing_m: f64,
    /// Spacing on the soil, metres.
    pub soil_spacing_m: f64,
    /// Noise of each coordinate, metres.
    pub sigma_m: f64,
    /// Error of the registration, added to all points, metres.
    pub offset_m: [f64; 3],
}

/// Mounting that gives way to gravity, to acceleration and with time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DeformationSettings {
    /// Off: the mounting is rigid.
    pub enabled: bool,
    /// Rotation of a scanner for one degree of roll or pitch, degrees.
    pub rotation_deg_per_deg: f64,
    /// Shift of a scanner for one degree of roll or pitch, metres.
    pub shift_m_per_deg: f64,
    /// Shift of a scanner for an acceleration of 1 m/s², metres.
    pub shift_m_per_m_s2: f64,
    /// Rotation gained from start to end of a drive, degrees.
    pub drift_deg: f64,
    /// Shift gained from start to end of a drive, metres.
    pub drift_m: f64,
}

/// A scanner's mounting.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScannerSettings {
    /// Name.
    pub name: String,
    /// True position in the body (FRD), metres.
    pub translation_m: [f64; 3],
    /// True rotation body_from_scanner, degrees, `bonn`.
    pub rotation_deg: [f64; 3],
    /// Position the user starts from.
    pub initial_translation_m: [f64; 3],
    /// Rotation the user starts from, `bonn`.
    pub initial_rotation_deg: [f64; 3],
}

/// A drive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DriveSettings {
    /// Passes over boards in order.
    pub passes: Vec<Pass>,
}

/// One straight pass over a board.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pass {
    /// Index of the board.
    pub board: usize,
    /// Degrees clockwise from north.
    pub heading_deg: f64,
}

impl Scenario {
    /// The paper's field and three drives, thinned in rate to what takes seconds.
    pub fn demo() -> Self {
        Self::default()
    }

    /// The paper's rates: gigabytes of profiles.
    pub fn full() -> Self {
        let mut scenario = Self {
            name: "full".into(),
            ..Self::default()
        };
        scenario.profiles.rate_hz = 200.0;
        scenario.profiles.width = 1920;
        scenario.reference.board_spacing_m = 0.001;
        scenario.reference.soil_spacing_m = 0.001;
        scenario
    }

    /// The preset of this name (`demo`, `full`) or the file at this path.
    ///
    /// # Errors
    /// Neither a preset nor a readable file; keys that do not exist; numbers without sense.
    pub fn load(name_or_path: &str) -> Result<Self> {
        match name_or_path {
            "demo" => return Ok(Self::demo()),
            "full" => return Ok(Self::full()),
            _ => {}
        }
        let path = Path::new(name_or_path);
        let text = std::fs::read_to_string(path).map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound => Error::format(
                path,
                Location::Whole,
                "neither a file nor a scenario of this name",
                "`demo`, `full` or a scenario file",
            ),
            _ => Error::io(path, e),
        })?;
        let mut scenario: Self = toml::from_str(&text).map_err(|e| {
            let at = e.span().map_or(Location::Whole, |span| {
                let before = text.get(..span.start).unwrap_or_default();
                Location::Line(before.matches('\n').count() as u64 + 1)
            });
            Error::format(path, at, e.message().to_owned(), "the keys of a scenario")
        })?;
        scenario.check().map_err(|error| match error {
            Error::Data {
                kind,
                problem,
                remedy,
            } => Error::of(kind, format!("{}: {problem}", path.display()), remedy),
            other => other,
        })?;
        scenario.file = Some(path.to_owned());
        Ok(scenario)
    }

    /// The rotation from FRD to the axes of the body as written.
    pub fn body_from_frd(&self) -> Rotation {
        match self.body {
            BodyAxes::Frd => Rotation::identity(),
            BodyAxes::Flu => Rotation::from_axis_angle(&Vec3::x_axis(), std::f64::consts::PI),
        }
    }

    /// The prism in the body as written, metres.
    pub fn lever_arm_m(&self) -> Vec3 {
        self.body_from_frd() * Vec3::from(self.prism.lever_arm_m)
    }

    /// True mounting body_from_scanner of each scanner in the body as written.
    pub fn true_mountings(&self) -> Vec<BodyFromScanner> {
        self.scanners
            .iter()
            .map(|s| self.mounting(s.translation_m, s.rotation_deg))
            .collect()
    }

    /// Mounting body_from_scanner that the user starts from.
    pub fn initial_mountings(&self) -> Vec<BodyFromScanner> {
        self.scanners
            .iter()
            .map(|s| self.mounting(s.initial_translation_m, s.initial_rotation_deg))
            .collect()
    }

    fn mounting(&self, translation_m: [f64; 3], rotation_deg: [f64; 3]) -> BodyFromScanner {
        let body_from_frd = self.body_from_frd();
        BodyFromScanner::new(
            body_from_frd * rotation_from_euler_deg(EulerConvention::Bonn, rotation_deg),
            body_from_frd * Vec3::from(translation_m),
        )
    }
}
