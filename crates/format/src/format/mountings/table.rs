//! The mountings by time that a run writes as `mounting.csv`. They are detected so that they are not read as profiles.

use crate::format::kind::{Frame, Kind};
use crate::format::text::table::Columns;

pub(crate) const MOUNTING_TABLE: Kind = Kind {
    columns: Some(Columns {
        needed: &["time_s", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"],
        optional: &[],
    }),
    frame: Frame::Fixed("metres, seconds (named in the header); body frame of the project"),
    ..Kind::new("mounting-csv", "mountings by time (table)")
};

#[cfg(test)]
mod tests {
    use crate::format::{detect, inspect};

    #[test]
    fn mountings_by_time_are_not_profiles() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mounting.csv");
        let text = "time_s,scanner,x_m,y_m,z_m,qx,qy,qz,qw\n1,left,0,0,1,0,0,0,1\n";
        std::fs::write(&path, text).unwrap();
        assert_eq!(detect(&path).unwrap().id(), "mounting-csv");
        assert!(
            inspect(&path)
                .unwrap()
                .to_string()
                .contains("mountings by time")
        );
    }
}
