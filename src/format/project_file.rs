//! Project files, which are told from data but are read elsewhere.

use super::kind::Kind;

pub(crate) const PROJECT: Kind = Kind {
    extensions: &["toml"],
    ..Kind::new("project", "project")
};
