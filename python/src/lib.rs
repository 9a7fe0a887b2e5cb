//! The compiled part of the Python package `boresight`: the library's functions on numpy arrays.
//!
//! It converts arrays, releases the interpreter while the library works, and passes on progress, signals and
//! errors. Names, defaults, classes and documentation are in the Python files of `python/package/boresight`.

mod arrays;
mod campaign;
mod clouds;
mod drives;
mod errors;
mod files;
mod kernels;
mod mountings;
mod work;

use pyo3::prelude::*;

#[pymodule]
fn _boresight(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    kernels::register(module)?;
    clouds::register(module)?;
    files::register(module)?;
    mountings::register(module)?;
    drives::register(module)?;
    campaign::register(module)
}
