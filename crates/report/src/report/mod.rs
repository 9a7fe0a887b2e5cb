//! The report: one self-contained HTML page with the paper's tables and figures and a summary in
//! plain words.
//!
//! [`content`] defines the results to show; [`render`] makes the page. Charts are inline SVG, maps
//! of many points are small PNG images in data URIs.

mod adjustment;
mod axis;
mod bending_figures;
pub mod campaign;
mod chart;
#[cfg(test)]
mod compared;
mod comparison;
pub mod content;
mod convergence;
pub mod csv;
mod detection;
pub mod drift;
mod figures;
mod first;
mod html;
pub mod imprint;
mod joint;
mod joint_figures;
mod maps;
mod marks;
mod mounting;
mod page;
mod platform;
mod pose_errors;
mod precision;
mod provenance;
mod raster;
mod relative;
mod residual_plots;
pub mod scene;
mod tables;
mod timeline;
mod track;

pub use content::Content;
pub use imprint::Imprint;
pub use page::render;
