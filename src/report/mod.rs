//! The report: one page that opens from disk without a network, with the paper's tables and
//! figures and a summary in plain words.
//!
//! [`content`] says which results are shown; [`render`] makes the page. Charts are inline SVG in the
//! colours of the page's style, maps of many points are small PNG images in data URIs.

mod adjustment;
mod axis;
mod chart;
pub mod content;
mod convergence;
pub mod diagnostics;
mod figures;
mod html;
mod maps;
mod marks;
mod mounting;
mod number;
mod page;
mod raster;
mod residual_plots;
mod tables;
mod track;
pub(crate) mod verdicts;

pub use content::Content;
pub use page::render;
