//! The report: one page that opens from disk, with the tables and figures of the paper.

pub mod content;

pub use content::Content;
