//! Trajectories with roll, pitch and heading as tables, and the refusal of those whose header does not state what the
//! angles are.
//!
//! Programs write `Roll, Pitch, Yaw` beside eastings and northings with other meanings: yaw counts clockwise from true
//! north, clockwise from the north axis of the coordinates, or counterclockwise from the east axis. Nothing in the file
//! tells these apart, so that such a table is read only under the names of this module, which state all of it.

use crate::error::Result;
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::log::tables::{read_rows, sigma};
use crate::format::poses::order::Order;
use crate::format::text::table::{Columns, Table};
use crate::geometry::{Vec3, WorldFromBody};
use crate::sensor::{NavigationAngles, NavigationSigma, PoseRecord};

pub(crate) const NAVIGATION: Columns = Columns {
    needed: &[
        "time_s",
        "east_m",
        "north_m",
        "up_m",
        "roll_deg",
        "pitch_deg",
        "heading_deg",
    ],
    optional: &[
        "sigma_east_m",
        "sigma_north_m",
        "sigma_up_m",
        "sigma_roll_deg",
        "sigma_pitch_deg",
        "sigma_heading_deg",
    ],
};

pub(crate) const NAVIGATION_TABLE: Kind = Kind {
    columns: Some(NAVIGATION),
    poses: Some(read),
    has_navigation_angles: true,
    frame: Frame::Fixed(
        "metres, degrees, seconds (named in the header); world: east, north, up; heading clockwise from the north axis; \
         body x forward, y left, z up, turned to the axes of the project",
    ),
    ..Kind::new(
        "navigation-csv",
        "trajectory (table with roll, pitch, heading)",
    )
};

/// What a table of poses with angles should have.
pub(crate) const EXPECTED: &str = "the header `time_s,east_m,north_m,up_m,roll_deg,pitch_deg,heading_deg` with the columns in their order, if roll \
     is positive with the right side down, pitch with the nose up, and heading counts clockwise from the north axis of \
     the coordinates, not from true north; else poses with quaternions (TUM)";

/// What to say of a log of positions whose header also names such angles, which are left out.
pub(crate) fn remark_on_angles(names: &[String]) -> Option<String> {
    let found = unstated_angles(names)?;
    Some(format!(
        "only the positions are read of {found}; poses need {EXPECTED}"
    ))
}

/// Whether a header names roll, pitch, and a yaw or heading, and what was found then.
pub(crate) fn unstated_angles(names: &[String]) -> Option<String> {
    let plain = |name: &String| {
        let stem = name.split(['[', '(']).next().unwrap_or_default();
        stem.trim().to_lowercase()
    };
    let stems: Vec<String> = names.iter().map(plain).collect();
    let named = |wanted: &[&str]| {
        let is_named = |stem: &String| {
            let first = stem.split(['_', ' ']).next().unwrap_or_default();
            wanted.contains(&first)
        };
        stems.iter().any(is_named)
    };
    let has_angles = named(&["roll"]) && named(&["pitch"]);
    let has_all = has_angles && named(&["yaw", "heading", "azimuth"]);
    let shown: String = names.join(", ").chars().take(200).collect();
    has_all.then(|| {
        format!("`{shown}`, poses with angles whose zero and direction the names do not state")
    })
}

/// Reads the table. The body has x forward, y left, z up.
fn read(input: &Input) -> Result<Vec<PoseRecord>> {
    let mut order = Order::default();
    let poses = read_rows::<13, _>(input, &NAVIGATION, "pose", |row, table: &Table| {
        order.add(row[0], |found, expected| table.error(found, expected));
        if row[5].abs() > 90.0 {
            return Err(table.error(format!("pitch_deg = {}", row[5]), "-90 to 90"));
        }
        let angles = NavigationAngles::from_deg([row[4], row[5], row[6]]);
        let pose = WorldFromBody::new(angles.rotation(), Vec3::new(row[1], row[2], row[3]));
        Ok(PoseRecord {
            sigma: sigmas(&row[7..], table)?.map(|sigma| angles.pose_sigma(&sigma)),
            ..PoseRecord::new(row[0], pose)
        })
    })?;
    order.finish()?;
    Ok(poses)
}

/// The standard deviations of a row, if it has them.
fn sigmas(values: &[f64], table: &Table) -> Result<Option<NavigationSigma>> {
    let mut found = [0.0; 6];
    let mut count = 0;
    for ((slot, value), name) in found.iter_mut().zip(values).zip(NAVIGATION.optional) {
        if let Some(sigma) = sigma(*value, name, table)? {
            *slot = sigma;
            count += 1;
        }
    }
    let [east, north, up, roll, pitch, heading] = found;
    match count {
        0 => Ok(None),
        6 => Ok(Some(NavigationSigma {
            position_m: Vec3::new(east, north, up),
            angles: NavigationAngles::from_deg([roll, pitch, heading]),
        })),
        _ => Err(table.error(
            format!(
                "{count} of the standard deviations {}",
                NAVIGATION.optional.join(", ")
            ),
            "all of them or none",
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::{detect, read_projected_trajectory, read_trajectory};
    use crate::geometry::BodyAxes;

    const HEADER: &str = "time_s,east_m,north_m,up_m,roll_deg,pitch_deg,heading_deg";
    const SIGMAS: &str =
        "sigma_east_m,sigma_north_m,sigma_up_m,sigma_roll_deg,sigma_pitch_deg,sigma_heading_deg";

    fn read_text(text: &str) -> Result<Vec<PoseRecord>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        std::fs::write(&path, text).unwrap();
        assert_eq!(detect(&path)?.id(), "navigation-csv");
        read_trajectory(&path)
    }

    #[test]
    fn angles_are_those_of_navigation() {
        // Towards the east, with the nose up by 30 degrees: x is half up, y to the north.
        let pose = read_text(&format!("{HEADER}\n5,1,2,3,0,30,90\n")).unwrap()[0];
        let axis = |axis: Vec3| pose.world_from_body.rotation * axis;
        assert!((axis(Vec3::x()) - Vec3::new(0.75f64.sqrt(), 0.0, 0.5)).norm() < 1e-12);
        assert!((axis(Vec3::y()) - Vec3::y()).norm() < 1e-12);
        assert_eq!(pose.world_from_body.translation_m, Vec3::new(1.0, 2.0, 3.0));
        assert_eq!((pose.time_s, pose.sigma), (5.0, None));
        // The left side is up.
        let pose = read_text(&format!("{HEADER}\n5,1,2,3,10,0,0\n")).unwrap()[0];
        assert!((pose.world_from_body.rotation * Vec3::y()).z > 0.17);
    }

    #[test]
    fn the_body_takes_the_axes_of_the_project() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        std::fs::write(&path, format!("{HEADER}\n5,1,2,3,0,0,0\n")).unwrap();
        let read = |axes| read_projected_trajectory(&path, axes, None).unwrap()[0];
        let down = |axes| (read(axes).world_from_body.rotation * Vec3::z()).z;
        assert!((down(BodyAxes::Flu) - 1.0).abs() < 1e-12);
        assert!((down(BodyAxes::Frd) + 1.0).abs() < 1e-12);
    }

    #[test]
    fn standard_deviations_are_all_or_none() {
        let text = format!("{HEADER},{SIGMAS}\n5,1,2,3,0,0,0,0.01,0.02,0.03,0.1,0.2,0.3\n");
        let sigma = read_text(&text).unwrap()[0].sigma.unwrap();
        assert_eq!(sigma.position_m, Vec3::new(0.01, 0.02, 0.03));
        // Towards north, pitch turns about the east axis and roll about the north axis.
        let expected = Vec3::new(0.2, 0.1, 0.3).map(f64::to_radians);
        assert!((sigma.rotation_rad - expected).amax() < 1e-15);
        let error = read_text(&text.replace("0.02,", ","))
            .unwrap_err()
            .to_string();
        assert!(error.contains("5 of the standard deviations"), "{error}");
        let error = read_text(&format!("{HEADER}\n5,1,2,3,0,91,0\n")).unwrap_err();
        assert!(error.to_string().contains("pitch_deg = 91"), "{error}");
    }

    #[test]
    fn names_that_leave_the_angles_open_are_refused() {
        for header in [
            "Time[s],Easting[m],Northing[m],Height[m],Roll[deg],Pitch[deg],Yaw[deg]",
            "#Time X Y Z Roll Pitch Yaw",
            "gps_time;x;y;z;roll_deg;pitch_deg;yaw_deg",
        ] {
            let error = read_text(&format!("{header}\n1,2,3,4,5,6,7\n"))
                .unwrap_err()
                .to_string();
            assert!(error.contains("poses with angles whose zero"), "{error}");
            assert!(error.contains(HEADER), "{error}");
        }
    }
}
