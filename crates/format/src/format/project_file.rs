//! Project files, which are detected here but read elsewhere.

use super::kind::{Frame, Kind};

pub(crate) const PROJECT: Kind = Kind {
    extensions: &["toml"],
    frame: Frame::Fixed("as the files that it names"),
    ..Kind::new("project", "project")
};
