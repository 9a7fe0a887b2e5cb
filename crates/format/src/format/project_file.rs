//! Project files, which are told from data but are read elsewhere.

use super::kind::{Frame, Kind};

pub(crate) const PROJECT: Kind = Kind {
    extensions: &["toml"],
    frame: Frame::Fixed("as the files that it names"),
    ..Kind::new("project", "project")
};
