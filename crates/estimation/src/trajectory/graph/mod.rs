//! The factor graph of one drive: its factors, and the unknowns on which each depends.

mod build;
mod context;
mod factor_graph;
mod growing;
mod problem;

pub use context::FactorContext;
pub use factor_graph::Graph;
pub use problem::Source;
