//! The factors of the graph: residuals with analytic derivatives, as whitened rows.

mod heading;
mod imu;
mod jacobian;
mod position;
mod propagation;
mod rest;
#[cfg(test)]
mod tests;

pub use heading::{HeadingFactor, Quantity};
pub use imu::ImuFactor;
pub use position::{PositionFactor, PositionSensor};
pub use propagation::Propagation;
pub use rest::RestFactor;
