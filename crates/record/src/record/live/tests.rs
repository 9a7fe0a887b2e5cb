//! The live pose of a drive to the east at a metre a second.

use std::fs::{self, OpenOptions};
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use super::*;
use crate::geometry::Projection;

/// When the drive begins, common time, seconds.
const BEGIN_S: f64 = 1000.0;
const IMU: &str =
    "time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2\n";
const HEADING: &str = "time_s,heading_deg\n";

/// A drive whose logs grow.
struct Drive {
    folder: tempfile::TempDir,
    live: Live,
    /// By how much the clocks of the IMU and the prism are slow, seconds.
    slow_s: [f64; 2],
    /// Common time of the midnight at which the times in the logs start again, seconds.
    midnight_s: Option<f64>,
    polar: bool,
}

fn project(folder: &Path, frame: &str, prism: &str, slow_s: [f64; 2]) -> Field {
    let text = format!(
        "[frame]\nbody = \"FRD\"\n{frame}[imu]\nfile = \"imu.csv\"\ntime_offset_s = {}\n\
         gyro_noise_deg_sqrt_h = 0.15\naccel_noise_ug_sqrt_hz = 57.0\n\
         gyro_bias_instability_deg_h = 7.0\naccel_bias_instability_ug = 14.0\n\
         [prism]\nfile = \"prism.csv\"\ntime_offset_s = {}\nlever_arm_m = [0, 0, 0]\n{prism}\
         [heading]\nfile = \"heading.csv\"\nsigma_deg = 0.5\n",
        slow_s[0], slow_s[1]
    );
    fs::write(folder.join("project.toml"), text).unwrap();
    Field {
        path: folder.join("field.toml"),
        folder: folder.to_owned(),
        sources: Vec::new(),
        boards: Vec::new(),
        project: toml::Table::new(),
    }
}

impl Drive {
    fn new(slow_s: [f64; 2]) -> Self {
        Self::with("", "sigma_m = 0.005\n", slow_s, false)
    }

    fn with(frame: &str, prism: &str, slow_s: [f64; 2], polar: bool) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let field = project(folder.path(), frame, prism, slow_s);
        let columns = if polar {
            "time_s,slope_distance_m,horizontal_deg,vertical_deg\n"
        } else {
            "time_s,east_m,north_m,up_m\n"
        };
        for (name, header) in [("imu", IMU), ("heading", HEADING), ("prism", columns)] {
            fs::write(folder.path().join(format!("{name}.csv")), header).unwrap();
        }
        let live = Live::open(&field, folder.path()).unwrap();
        Self {
            folder,
            live,
            slow_s,
            midnight_s: None,
            polar,
        }
    }

    /// A time as the logs write it, seconds.
    fn written_s(&self, time_s: f64) -> f64 {
        let Some(midnight_s) = self.midnight_s else {
            return time_s;
        };
        (time_s - midnight_s).rem_euclid(86_400.0)
    }

    fn append(&self, name: &str, row: &str) {
        let path = self.folder.path().join(name);
        let mut log = OpenOptions::new().append(true).open(path).unwrap();
        writeln!(log, "{row}").unwrap();
    }

    /// Appends the measurements of the IMU; `from` and `to` in hundredths of a second.
    fn imu(&self, from: u32, to: u32) {
        for k in from..to {
            let time_s = self.written_s(BEGIN_S + 0.01 * f64::from(k) - self.slow_s[0]);
            self.append("imu.csv", &format!("{time_s:.3},0,0,0,0,0,-9.81"));
        }
    }

    /// Appends positions of the prism and headings; `from` and `to` in hundredths of a second.
    fn others(&self, from: u32, to: u32) {
        for k in (from..to).filter(|k| k % 10 == 0) {
            let (true_s, east_m) = (BEGIN_S + 0.01 * f64::from(k), 0.01 * f64::from(k));
            let time_s = self.written_s(true_s - self.slow_s[1]);
            let heading_s = self.written_s(true_s);
            let place = if self.polar {
                let level_m = east_m.hypot(20.0);
                let hz_deg = east_m.atan2(20.0).to_degrees();
                format!("{level_m:.6},{hz_deg:.9},90")
            } else {
                format!("{east_m:.6},20,0")
            };
            self.append("prism.csv", &format!("{time_s:.3},{place}"));
            self.append("heading.csv", &format!("{heading_s:.3},90"));
        }
    }

    fn look(&mut self, hundredths: u32) {
        let now_s = BEGIN_S + 0.01 * f64::from(hundredths);
        self.live.update(now_s).unwrap();
    }
}

#[test]
fn the_live_pose_uses_the_time_offsets_of_the_project() {
    let mut drive = Drive::new([0.05, 0.1]);
    for k in (0..1200).step_by(25) {
        drive.imu(k, k + 25);
        drive.others(k, k + 25);
        drive.look(k + 25);
    }
    let pose = drive.live.pose.unwrap();
    let off_m = pose.position_m.x - (pose.time_s - BEGIN_S);
    assert!(off_m.abs() < 0.02, "{off_m}");
}

#[test]
fn the_live_pose_goes_on_at_midnight() {
    let mut drive = Drive::new([0.0; 2]);
    drive.midnight_s = Some(BEGIN_S + 8.1);
    for k in (0..1400).step_by(25) {
        drive.imu(k, k + 25);
        drive.others(k, k + 25);
        drive.look(k + 25);
        if k < 700 {
            continue;
        }
        let pose = drive.live.pose.expect("a pose");
        let now_s = BEGIN_S + 0.01 * f64::from(k + 25);
        assert!(pose.time_s > now_s - 1.0, "{} at {now_s}", pose.time_s);
        let is_remarked = drive.live.trouble().is_some_and(|trouble| {
            trouble.contains("imu.csv: the times start again") && trouble.contains("prism.csv:")
        });
        assert_eq!(is_remarked, k + 25 > 810, "{:?}", drive.live.trouble());
    }
}

#[test]
fn positions_and_headings_that_arrive_before_the_imu_are_used() {
    let mut drive = Drive::new([0.0; 2]);
    for k in (0..1200).step_by(50) {
        drive.others(k, k + 25);
        drive.look(k + 25);
        drive.imu(k, k + 50);
        drive.look(k + 50);
        drive.others(k + 25, k + 50);
    }
    let pose = drive.live.pose.expect("a pose");
    assert!(pose.time_s > BEGIN_S + 11.0, "{pose:?}");
    assert!(pose.sigma_m.norm() < 0.02, "{pose:?}");
}

#[test]
fn a_row_without_a_distance_does_not_end_the_live_pose() {
    // Only a build with projections reads a project with a coordinate reference system.
    if Projection::new("EPSG:25832").is_err() {
        return;
    }
    let frame = "crs = \"EPSG:25832\"\norigin_m = [363000.0, 5600000.0, 60.0]\n";
    let prism = "station_m = [363000.0, 5600000.0, 60.0]\nstation_orientation_deg = 0.0\n";
    let mut drive = Drive::with(frame, prism, [0.0; 2], true);
    for k in (0..1200).step_by(25) {
        drive.imu(k, k + 25);
        drive.others(k, k + 25);
        drive.look(k + 25);
    }
    assert!(drive.live.pose.is_some());
    drive.append("prism.csv", "1012.05,0,0,90");
    drive.imu(1200, 1225);
    drive.look(1225);
    assert!(drive.live.pose.is_some());
}

#[test]
fn the_view_names_a_log_that_cannot_be_read() {
    let folder = tempfile::tempdir().unwrap();
    let field = project(folder.path(), "", "sigma_m = 0.005\n", [0.0; 2]);
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    write("imu.csv", "time_s,gyro_x_rad_s\n1,0\n");
    write("prism.csv", "time_s,east_m,north_m,up_m\n");
    write("heading.csv", HEADING);
    let (stop, view) = (AtomicBool::new(false), Mutex::new(LiveView::default()));
    let clock = Clock::default();
    std::thread::scope(|scope| {
        scope.spawn(|| follow(&field, folder.path(), &clock, &stop, &view));
        std::thread::sleep(Duration::from_millis(700));
        stop.store(true, Ordering::Relaxed);
    });
    let trouble = view.into_inner().unwrap().trouble.unwrap();
    assert!(
        trouble.contains("imu.csv") && trouble.contains("gyro_y_rad_s"),
        "{trouble}"
    );
}
