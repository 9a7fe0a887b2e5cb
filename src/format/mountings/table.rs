//! The mountings by time that a run writes as `mounting.csv`: told, so that they are not taken for profiles.

use crate::format::kind::{Frame, Kind};
use crate::format::text::table::Columns;

pub(crate) const MOUNTING_TABLE: Kind = Kind {
    columns: Some(Columns {
        needed: &[
            "time_s", "scanner", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw",
        ],
        optional: &[],
    }),
    frame: Frame::Fixed("metres, seconds (named in the header); body frame of the project"),
    ..Kind::new("mounting-csv", "mountings by time (table)")
};
