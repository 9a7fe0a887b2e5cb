//! The scenario: all settings of a simulation.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::field::{
    BoardSettings, DriveSettings, Field, MotionSettings, PlantSettings, SoilSettings,
};
use super::sensors::{
    DeformationSettings, HeadingSettings, ImuSettings, LidarSettings, PrismSettings,
    ProfileSettings, ProjectSettings, ReferenceSettings, ScannerKind, ScannerSettings,
};
use crate::error::{Error, Location, Result};
use crate::geometry::euler::rotation_from_euler_deg;
use crate::geometry::{BodyAxes, BodyFromScanner, EulerConvention, Rotation, Vec3};

/// A scenario as read from TOML; every key is optional.
///
/// Lever arms and mountings are given in FRD here, regardless of the body axes of the written files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Scenario {
    /// Name.
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
    /// Plants on it.
    pub plants: PlantSettings,
    /// Motion of the robot.
    pub motion: MotionSettings,
    /// The IMU.
    pub imu: ImuSettings,
    /// The prism and its total station.
    pub prism: PrismSettings,
    /// The heading antennas.
    pub heading: HeadingSettings,
    /// All profile scanners.
    pub profiles: ProfileSettings,
    /// All lidars.
    pub lidar: LidarSettings,
    /// The reference cloud.
    pub reference: ReferenceSettings,
    /// Deformation of the mountings.
    pub deformation: DeformationSettings,
    /// What the project files state.
    pub project: ProjectSettings,
    /// Boards on the field.
    pub boards: Vec<BoardSettings>,
    /// The scanners, with their true and initial mountings.
    pub scanners: Vec<ScannerSettings>,
    /// The drives.
    pub drives: Vec<DriveSettings>,
    /// The file it was read from; `None` for a preset.
    #[serde(skip)]
    pub file: Option<PathBuf>,
}

impl Scenario {
    /// The preset of this name (`demo`, `full`, `plain`) or the file at this path.
    ///
    /// # Errors
    /// Neither a preset nor a readable file; unknown keys; invalid values.
    pub fn load(name_or_path: &str) -> Result<Self> {
        match name_or_path {
            "demo" => return Ok(Self::demo()),
            "full" => return Ok(Self::full()),
            "plain" => return Ok(Self::plain()),
            _ => {}
        }
        let path = Path::new(name_or_path);
        let text = std::fs::read_to_string(path).map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound => Error::format(
                path,
                Location::Whole,
                "neither a file nor a scenario of this name",
                "`demo`, `full`, `plain` or a scenario file",
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

    /// The rotation from FRD to the body axes of the written files.
    pub fn body_from_frd(&self) -> Rotation {
        match self.body {
            BodyAxes::Frd => Rotation::identity(),
            BodyAxes::Flu => Rotation::from_axis_angle(&Vec3::x_axis(), std::f64::consts::PI),
        }
    }

    /// The prism in the body axes of the written files, metres.
    pub fn lever_arm_m(&self) -> Vec3 {
        self.body_from_frd() * Vec3::from(self.prism.lever_arm_m)
    }

    /// True mounting body_from_scanner of each scanner in the body axes of the written files.
    pub fn true_mountings(&self) -> Vec<BodyFromScanner> {
        self.scanners
            .iter()
            .map(|s| self.mounting(s.translation_m, s.rotation_deg))
            .collect()
    }

    /// Initial mounting body_from_scanner of each scanner for the calibration.
    pub fn initial_mountings(&self) -> Vec<BodyFromScanner> {
        self.scanners
            .iter()
            .map(|s| self.mounting(s.initial_translation_m, s.initial_rotation_deg))
            .collect()
    }

    /// Indices of the scanners of this kind.
    pub fn scanners_of(&self, kind: ScannerKind) -> Vec<usize> {
        let scanners = self.scanners.iter().enumerate();
        let of_kind = scanners.filter(|(_, scanner)| scanner.kind == kind);
        of_kind.map(|(index, _)| index).collect()
    }

    fn mounting(&self, translation_m: [f64; 3], rotation_deg: [f64; 3]) -> BodyFromScanner {
        let body_from_frd = self.body_from_frd();
        BodyFromScanner::new(
            body_from_frd * rotation_from_euler_deg(EulerConvention::Bonn, rotation_deg),
            body_from_frd * Vec3::from(translation_m),
        )
    }
}
