//! The project file as typed: degrees, datasheet units, paths relative to the file.
//!
//! Every table refuses keys it does not know.

use std::path::PathBuf;

use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

use super::settings::Method;
use crate::geometry::{BodyAxes, EulerConvention};

/// The whole file.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Written {
    /// Axes, origin, gravity.
    #[serde(default)]
    pub frame: Frame,
    /// With `prism` and `heading`: logs to estimate the trajectory from.
    pub imu: Option<Imu>,
    /// Positions of the prism.
    pub prism: Option<Prism>,
    /// Headings of the antenna baseline.
    pub heading: Option<Heading>,
    /// Instead of the three above.
    pub trajectory: Option<Poses>,
    /// The scanners.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub scanner: Vec<Scanner>,
    /// The reference cloud.
    pub reference: Option<Reference>,
    /// How the mountings are found.
    #[serde(default)]
    pub calibration: Calibration,
    /// How clouds are compared.
    #[serde(default)]
    pub comparison: Comparison,
    /// Other drives.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub evaluation: Vec<Evaluation>,
}

/// `[frame]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frame {
    /// `FRD` (default) or `FLU`.
    pub body: Option<BodyAxes>,
    /// Default 0, 0, 0.
    pub origin_m: Option<[f64; 3]>,
    /// Default 0.
    pub grid_convergence_deg: Option<f64>,
    /// Default 9.81.
    pub gravity_m_s2: Option<f64>,
}

/// `[imu]`; the defaults are those of an SBG Ellipse-D.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Imu {
    /// Relative to the project file.
    pub file: PathBuf,
    /// Common time = sensor time + this.
    pub time_offset_s: Option<f64>,
    /// Angle random walk, °/√h. Default 0.15.
    pub gyro_noise_deg_sqrt_h: Option<f64>,
    /// Velocity random walk, µg/√Hz. Default 57.
    pub accel_noise_ug_sqrt_hz: Option<f64>,
    /// Bias instability, °/h. Default 7. The bias walks by this in the correlation time.
    pub gyro_bias_instability_deg_h: Option<f64>,
    /// Bias instability, µg. Default 14. The bias walks by this in the correlation time.
    pub accel_bias_instability_ug: Option<f64>,
    /// Instead of the instability.
    pub gyro_bias_walk_rad_s_sqrt_s: Option<f64>,
    /// Instead of the instability.
    pub accel_bias_walk_m_s2_sqrt_s: Option<f64>,
}

/// `[prism]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Prism {
    /// Relative to the project file.
    pub file: PathBuf,
    /// Common time = sensor time + this.
    pub time_offset_s: Option<f64>,
    /// Of each coordinate, where the log gives none. Default 0.005.
    pub sigma_m: Option<f64>,
    /// Prism in the body frame.
    pub lever_arm_m: [f64; 3],
}

/// `[heading]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Heading {
    /// Relative to the project file.
    pub file: PathBuf,
    /// Common time = sensor time + this.
    pub time_offset_s: Option<f64>,
    /// Where the log gives none. Default 0.7.
    pub sigma_deg: Option<f64>,
    /// From the antenna baseline to the body's x axis, clockwise. Default 0.
    pub mounting_offset_deg: Option<f64>,
}

/// `[trajectory]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Poses {
    /// Relative to the project file.
    pub file: PathBuf,
    /// Common time = time in the file + this.
    pub time_offset_s: Option<f64>,
    /// Of each coordinate, where the file gives none.
    pub sigma_position_m: Option<f64>,
    /// About each axis, where the file gives none.
    pub sigma_rotation_deg: Option<f64>,
}

/// `[[scanner]]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scanner {
    /// Letters, digits, `-` and `_`.
    pub name: String,
    /// One file or several in time order, relative to the project file.
    pub profiles: Files,
    /// Common time = scanner time + this.
    pub time_offset_s: Option<f64>,
    /// Scanner in the body frame.
    pub translation_m: [f64; 3],
    /// α, β, γ in the convention below.
    pub rotation_deg: Option<[f64; 3]>,
    /// Instead of the angles.
    pub quaternion_xyzw: Option<[f64; 4]>,
    /// `zyx` (default) or `bonn`.
    pub rotation_convention: Option<EulerConvention>,
    /// Of tx ty tz rx ry rz.
    pub fixed: Option<Vec<String>>,
}

/// `[reference]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reference {
    /// Relative to the project file.
    pub file: PathBuf,
}

/// `[calibration]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Coarse to fine.
    pub voxel_sizes_m: Option<Vec<f64>>,
    /// In each neighbourhood.
    pub neighbours: Option<usize>,
    /// `reweighted` (default) or `paper`.
    pub method: Option<Method>,
    /// A scale.
    pub max_iterations: Option<usize>,
    /// A point of the same scanner and voxel this much later belongs to another pass.
    pub pass_gap_s: Option<f64>,
}

/// `[comparison]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Comparison {
    /// Between core points.
    pub core_spacing_m: Option<f64>,
    /// Of the neighbourhoods for normals.
    pub normal_radii_m: Option<Vec<f64>>,
    /// Of the cylinder.
    pub cylinder_radius_m: Option<f64>,
    /// Half length of the cylinder.
    pub max_distance_m: Option<f64>,
    /// Added to the level of detection.
    pub registration_error_m: Option<f64>,
}

/// `[[evaluation]]`
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Evaluation {
    /// Letters, digits, `-` and `_`.
    pub name: String,
    /// Its project file, relative to this one.
    pub project: PathBuf,
}

/// One file name, or a list of them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Files(pub Vec<PathBuf>);

impl Serialize for Files {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0.as_slice() {
            [one] => one.serialize(serializer),
            all => all.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Files {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Visitor;
        impl<'de> de::Visitor<'de> for Visitor {
            type Value = Files;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("a file name or a list of file names")
            }

            fn visit_str<E: de::Error>(self, name: &str) -> Result<Files, E> {
                Ok(Files(vec![name.into()]))
            }

            fn visit_seq<A: de::SeqAccess<'de>>(self, mut names: A) -> Result<Files, A::Error> {
                let mut files = Vec::new();
                while let Some(name) = names.next_element()? {
                    files.push(name);
                }
                Ok(Files(files))
            }
        }
        deserializer.deserialize_any(Visitor)
    }
}
