//! The stages in order: reference, poses, samples, calibration, clouds, agreements, report.
//!
//! [`analyse`] runs all stages; the other functions are the single commands of the command line.

mod analyse;
mod calibrated;
pub mod clouds;
mod commands;
pub mod compare;
mod convert;
mod drives;
pub mod features;
pub mod field;
mod findings;
mod finished;
mod init;
mod inputs;
mod job;
pub mod joint;
mod kept_page;
mod keys;
mod logs;
mod mounting;
pub mod online;
mod outcome;
pub mod overlap;
mod own;
mod page;
mod placement;
mod poses;
mod program;
mod recorded;
pub mod result;
mod scene;
pub mod stages;
pub mod start;
mod summary;
pub mod thin;
mod tiled;

pub use analyse::analyse;
pub use calibrated::with_method;
pub use commands::{calibrate, demo, run, simulate, trajectory};
pub use compare::compare;
pub use convert::{Conversion, convert, mountings_text};
pub use features::features;
pub use field::field;
pub use findings::{Extras, Findings, KeptStages, Truth};
pub use init::{NewProject, init};
pub use inputs::{hash_of, size};
pub use job::Job;
pub use kept_page::report;
pub use keys::Key;
pub use outcome::{Options, Outcome};
pub use overlap::overlap;
pub use page::now_s;
pub use placement::{Placement, georeference, marked_unusable};
pub use thin::thin;
pub use tiled::Tile;
