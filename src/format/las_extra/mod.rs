//! Clouds written as LAS or LAZ with further named values beside each point: "extra bytes", which
//! LAS 1.4 describes in a record of its own.

mod cloud;
mod copy;
pub(super) mod dimension;
#[cfg(test)]
mod tests;

pub use cloud::cloud_to_las;
pub use copy::copy_las;
pub use dimension::{ExtraDimension, ExtraKind, Row};
