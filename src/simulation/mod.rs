//! A simulated twin: a field, a robot that drives over it, and its sensor data.
//!
//! It models scenes, motion and sensors and is independent of the estimators, which can therefore
//! be validated with it.

mod aiding;
mod check;
mod defaults;
mod deformation;
mod describe;
mod drive;
mod inertial;
mod profiler;
mod random;
mod reference;
mod route;
mod scenario;
mod scene;
mod soil;
mod spline;
mod write;

pub use aiding::{simulate_heading, simulate_prism};
pub use deformation::Mountings;
pub use drive::{BodyState, Drive};
pub use inertial::{Inertial, simulate_imu};
pub use profiler::{Profile, Profiler, Ray};
pub use reference::Reference;
pub use scenario::{
    BoardSettings, DeformationSettings, DriveSettings, Field, HeadingSettings, ImuSettings,
    MotionSettings, Pass, PrismSettings, ProfileSettings, ReferenceSettings, ScannerSettings,
    Scenario, SoilSettings,
};
pub use scene::{Board, Hit, Scene, Surface};
pub use write::{SimulatedDrive, SimulatedFiles, simulate};
