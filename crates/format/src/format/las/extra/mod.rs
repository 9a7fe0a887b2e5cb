//! Clouds written as LAS or LAZ with further named values for each point: the "extra bytes" that
//! LAS 1.4 describes in a separate record.

mod cloud;
mod copy;
pub(crate) mod dimension;
#[cfg(test)]
mod tests;

pub use cloud::cloud_to_las;
pub use copy::copy_las;
pub use dimension::{ExtraDimension, ExtraKind, Row};
