//! Clouds written as LAS or LAZ with further named values beside each point: "extra bytes", which
//! LAS 1.4 describes in a record of its own.

mod cloud;
mod copy;
pub(super) mod dimension;
#[cfg(test)]
mod tests;

pub use cloud::cloud_to_las;
pub use copy::copy_las;
pub use dimension::{ExtraDimension, ExtraKind};

use crate::error::Result;

/// Asked once for every point of the input, in its order, with the index of the point: fills one
/// value for each dimension and says whether the point is to be written at all. What it does not
/// fill is NaN.
pub type Row<'a> = dyn FnMut(u64, &mut [f64]) -> Result<bool> + 'a;
