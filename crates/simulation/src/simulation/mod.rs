//! A simulated twin: a field, a robot that drives over it, and its sensor data.
//!
//! It models scenes, motion and sensors and is independent of the estimators, which can therefore
//! be validated with it.

mod aiding;
mod board;
mod bounds;
mod check;
mod clods;
mod defaults;
mod deformation;
mod describe;
mod draw;
mod drive;
mod field;
mod inertial;
mod lidar;
mod plants;
mod presets;
mod profiler;
mod random;
mod ray;
mod recordings;
mod reference;
mod route;
mod scenario;
mod scene;
mod sensors;
mod soil;
mod spline;
mod wave;
mod write;

pub use aiding::{simulate_heading, simulate_prism};
pub use board::Board;
pub use deformation::Mountings;
pub use draw::{Extent, Fault};
pub use drive::{BodyState, Drive};
pub use field::{
    BoardSettings, DriveSettings, Field, MotionSettings, Pass, PlantSettings, SoilSettings,
};
pub use inertial::{Inertial, simulate_imu};
pub use lidar::Lidar;
pub use plants::Plants;
pub use profiler::{Profile, Profiler, Ray};
pub use reference::Reference;
pub use scenario::Scenario;
pub use scene::{Hit, Scene, Surface};
pub use sensors::{
    DeformationSettings, HeadingSettings, ImuSettings, LidarSettings, PrismSettings,
    ProfileSettings, ProjectSettings, ReferenceSettings, ScannerKind, ScannerSettings,
};
pub use write::{SimulatedDrive, SimulatedFiles, SimulatedReference, output_names, simulate};
