//! Folders of all kinds: what `init` makes of them, and what `inspect` says about them.

use std::fmt::Write;
use std::fs;
use std::path::Path;

use boresight::format::{
    CloudShape, CloudWriter, ExtraDimension, ExtraKind, ExtraValue, open_profiles, read_trajectory,
};
use boresight::geometry::{BodyFromScanner, Vec3};
use boresight::project::{Motion, Project, mountings};
use boresight::trajectory::Trajectory;

use super::transcript::replay;
use crate::common::{Run, boresight, names, rewrite, simulated};

fn init(folder: &Path) -> Run {
    boresight(&["init", folder.to_str().unwrap()])
}

/// Writes the IMU and the prism of a simulated drive as EuRoC does, with times in nanoseconds.
fn write_euroc(drive: &Path, to: &Path) {
    let columns = "w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],\
                   a_RS_S_z [m s^-2]";
    let imu = format!("#timestamp [ns],{columns}\n");
    let leica = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m]\n".to_owned();
    for (log, folder, header) in [("imu.csv", "imu0", imu), ("prism.csv", "leica0", leica)] {
        let table = fs::read_to_string(drive.join(log)).unwrap();
        let mut text = header;
        for row in table.lines().skip(1) {
            let (time_s, rest) = row.split_once(',').unwrap();
            let time_ns =
                (time_s.parse::<f64>().unwrap() * 1e9).round() as i64 + 1_400_000_000_000_000_000;
            let _ = writeln!(text, "{time_ns},{rest}");
        }
        let folder = to.join("mav0").join(folder);
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join("data.csv"), text).unwrap();
        fs::write(folder.join("sensor.yaml"), "# a sensor\nsensor_type: any\n").unwrap();
    }
}

#[test]
fn a_euroc_folder_gives_a_trajectory_with_nothing_but_the_advice_of_the_terminal() {
    let (temp, drive) = simulated();
    let folder = temp.path().join("MH_01");
    write_euroc(&drive, &folder);
    replay("euroc.txt", temp.path());
    let written = names(&folder.join("out"));
    assert!(
        written.contains(&"trajectory.csv".to_owned()),
        "{written:?}"
    );
    let looked = boresight(&["inspect", folder.join("mav0").to_str().unwrap()]);
    assert_eq!(looked.code, 0, "{}", looked.err);
    assert!(
        looked.out.contains("imu0/data.csv: the samples of an IMU"),
        "{}",
        looked.out
    );
}

/// Writes the points of a scanner as LAS with the sensor's pose at every point, of those before or after a time.
fn write_posed(drive: &Path, scanner: usize, to: &Path, is_in: impl Fn(f64) -> bool) {
    let project = Project::read(&drive.join("project.toml")).unwrap();
    let trajectory = read_trajectory(&drive.join("truth/trajectory.csv")).unwrap();
    let trajectory = Trajectory::new(trajectory).unwrap();
    let names = [
        "SensorX",
        "SensorY",
        "SensorZ",
        "SensorRollRads",
        "SensorPitchRads",
        "SensorYawRads",
    ];
    let shape = CloudShape {
        has_time: true,
        dimensions: names
            .map(|name| ExtraDimension::new(name, ExtraKind::F64, ""))
            .into(),
        ..CloudShape::default()
    };
    let mut writer = CloudWriter::around(to, Vec3::zeros(), &shape).unwrap();
    let scanner = &project.scanners[scanner];
    let mut reader = open_profiles(&scanner.profiles[0]).unwrap();
    let mut chunk = Vec::new();
    while reader.next_chunk(&mut chunk).unwrap() {
        for point in chunk.iter().filter(|point| is_in(point.time_s)) {
            let Some(body) = trajectory.pose_at(point.time_s) else {
                continue;
            };
            let place = body.map(&scanner.body_from_scanner.map(&point.position_m));
            let sensor = body.map(&scanner.body_from_scanner.translation_m);
            let turn = body.rotation * scanner.body_from_scanner.rotation;
            let (roll, pitch, yaw) = turn.euler_angles();
            let values = [sensor.x, sensor.y, sensor.z, roll, pitch, yaw].map(ExtraValue::Number);
            writer
                .write_with(&place, point.time_s, point.intensity, 0, &values)
                .unwrap();
        }
    }
    writer.finish().unwrap();
}

#[test]
fn las_with_the_pose_of_the_sensor_is_a_whole_project() {
    let (temp, drive) = simulated();
    let folder = temp.path().join("strips");
    fs::create_dir(&folder).unwrap();
    // Two strips of one sensor, and another sensor.
    write_posed(&drive, 0, &folder.join("a.las"), |time_s| time_s < 36030.0);
    write_posed(&drive, 0, &folder.join("b.las"), |time_s| time_s >= 36030.0);
    write_posed(&drive, 1, &folder.join("c.las"), |_| true);
    fs::copy(drive.join("../tls.laz"), folder.join("tls.laz")).unwrap();
    replay("las.txt", temp.path());
    let mounted = mountings(&folder.join("out/calibration.toml"))
        .unwrap()
        .scanners;
    // The simulated mounting is off by some centimetres and degrees.
    let (turn, shift) = mounted[0].1.perturbation_from(&BodyFromScanner::identity());
    assert!(turn.norm() < 0.1 && shift.norm() < 0.2, "{turn} {shift}");
}

#[test]
fn logs_and_trajectories_without_a_scanner_are_no_error() {
    let folder = tempfile::tempdir().unwrap();
    let polar = "time_s,slope_distance_m,horizontal_deg,vertical_deg\n10,5,0,90\n11,5,1,90\n";
    fs::write(folder.path().join("station.csv"), polar).unwrap();
    let made = init(folder.path());
    assert_eq!(made.code, 0, "{}", made.err);
    for key in [
        "lever_arm_m",
        "station_m",
        "[imu], or [trajectory]",
        "No file is a recording of a scanner",
    ] {
        assert!(made.out.contains(key), "{key}: {}", made.out);
    }
    let text = fs::read_to_string(folder.path().join("project.toml")).unwrap();
    assert!(text.contains("# station_orientation_deg"), "{text}");

    let kitti = tempfile::tempdir().unwrap();
    fs::write(kitti.path().join("times.txt"), "0.0\n0.1\n0.2\n").unwrap();
    let rows = (0..3).map(|i| format!("1 0 0 0 0 1 0 0 0 0 1 {i}\n"));
    fs::write(kitti.path().join("poses.txt"), rows.collect::<String>()).unwrap();
    let made = init(kitti.path());
    assert_eq!(made.code, 0, "{}", made.err);
    assert!(
        made.out.contains("poses.txt: poses: [trajectory]; 3 rows"),
        "{}",
        made.out
    );
    let project = Project::read(&kitti.path().join("project.toml")).unwrap();
    assert!(matches!(project.motion, Motion::Poses(_)));
}

/// A log of a receiver with its own inertial sensor: NovAtel's example of poses, and positions of the same receiver.
const NOVATEL: &str = "#INSPVAXA,USB1,0,65.5,FINESTEERING,2209,490782.000,02000020,46eb,16809;INS_SOLUTION_GOOD,INS_PPP,\
    51.15043710672,-114.03067871892,1097.3598,-17.0001,-0.0016,0.0002,0.0029,-0.308665944,0.297893298,157.960833016,0.1816,\
    0.1816,0.1808,0.0018,0.0018,0.0016,0.0292,0.0292,0.0582,13000045,0*a74644a2\n\
    #BESTGNSSPOSA,USB1,0,65.0,FINESTEERING,2209,487877.000,02000020,c292,16809;SOL_COMPUTED,PPP,51.15043712234,\
    -114.03067870773,1097.3556,-17.0001,WGS84,0.0176,0.0123,0.0317,\"TSTR\",17.000,0.000,42,38,38,37,00,00,3f,37*5fea7d4b\n";

#[test]
fn a_log_is_offered_for_all_that_it_holds() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    write("span.txt", NOVATEL);
    write("profiles.csv", "time_s,x_m,z_m\n0,0.1,1.0\n0,0.2,1.0\n");
    write("broken.csv", "time_s,heading_deg\n0,north\n");
    let made = init(folder.path());
    assert_eq!(made.code, 0, "{}", made.err);
    let uses = "span.txt: latitudes and longitudes of an antenna: [gnss], with frame.crs; poses with latitudes and \
                longitudes: [trajectory], with frame.crs; 1 rows";
    assert!(made.out.contains(uses), "{}", made.out);
    let missing = "project.toml: crs; translation_m; rotation_deg.";
    assert!(made.out.contains(missing), "{}", made.out);
    // What is wrong with a file is said once.
    assert_eq!(made.out.matches("north").count(), 1, "{}", made.out);
    let project = folder.path().join("project.toml");
    let text = fs::read_to_string(&project).unwrap();
    assert!(text.contains("[trajectory]\nfile = \"span.txt\""), "{text}");
    assert!(text.contains("be estimated instead: span.txt"), "{text}");
    // The advice is enough for the project to be read.
    rewrite(&project, |text| {
        let text = text.replace("# crs =     ", "crs = \"EPSG:32611\" ");
        let text = text.replace("# translation_m =  ", "translation_m = [0, 0, 0] ");
        text.replace("# rotation_deg =  ", "rotation_deg = [0, 0, 0] ")
    });
    let project = Project::read(&project).unwrap();
    assert!(project.crs.is_some() && matches!(project.motion, Motion::Poses(_)));
}

#[test]
fn a_log_with_an_unknown_header_is_not_the_reference() {
    let (_temp, drive) = simulated();
    fs::remove_file(drive.join("project.toml")).unwrap();
    rewrite(&drive.join("prism.csv"), |text| {
        text.replace(
            "time_s,east_m,north_m,up_m",
            "Zeit,Rechtswert,Hochwert,Hoehe",
        )
    });
    let made = init(&drive);
    assert_eq!(made.code, 0, "{}", made.err);
    let advice = "prism.csv: nothing yet: it begins with a time that increases from row to row, as a log does, and its \
                  header is not known; name the columns of positions time_s, east_m, north_m, up_m, and run \
                  `boresight init --force`.";
    assert!(made.out.contains(advice), "{}", made.out);
    let text = fs::read_to_string(drive.join("project.toml")).unwrap();
    assert!(!text.contains("[reference]"), "{text}");
    // The advice is enough.
    rewrite(&drive.join("prism.csv"), |text| {
        text.replace(
            "Zeit,Rechtswert,Hochwert,Hoehe",
            "time_s,east_m,north_m,up_m",
        )
    });
    let again = boresight(&["init", "--force", drive.to_str().unwrap()]);
    assert!(
        again
            .out
            .contains("prism.csv: the positions of a prism: [prism]"),
        "{}",
        again.out
    );
    // A table of points remains a reference.
    let cloud = "x,y,z\n0,0,0\n0,1,0\n1,0,0\n";
    fs::write(drive.join("scan.csv"), cloud).unwrap();
    boresight(&["init", "--force", drive.to_str().unwrap()]);
    let text = fs::read_to_string(drive.join("project.toml")).unwrap();
    assert!(text.contains("[reference]\nfile = \"scan.csv\""), "{text}");
}

#[test]
fn two_drives_in_one_folder_are_not_four_scanners() {
    let (_temp, drive) = simulated();
    fs::remove_file(drive.join("project.toml")).unwrap();
    let field = drive.parent().unwrap();
    let second = field.join("drive-2");
    fs::create_dir(&second).unwrap();
    for name in names(&drive)
        .iter()
        .filter(|name| drive.join(name).is_file())
    {
        fs::copy(drive.join(name), second.join(name)).unwrap();
    }
    let run = init(field);
    let [first, other] =
        [&drive, &second].map(|folder| format!("boresight init {}", folder.display()));
    run.assert_failed_with(&[
        "holds the files of 2 drives",
        &first,
        &other,
        "[[evaluation]]",
    ]);
    assert!(!field.join("project.toml").exists());
    assert_eq!(init(&drive).code, 0);

    // All files in one folder, under names of their own, and a day apart.
    for name in ["imu.csv", "prism.csv", "heading.csv"] {
        rewrite(&second.join(name), |text| {
            let later = |row: &str| {
                let (time_s, rest) = row.split_once(',').unwrap();
                format!("{},{rest}\n", time_s.parse::<f64>().unwrap() + 86400.0)
            };
            let (header, rows) = text.split_once('\n').unwrap();
            format!("{header}\n{}", rows.lines().map(later).collect::<String>())
        });
        fs::rename(second.join(name), drive.join(format!("second_{name}"))).unwrap();
    }
    // Profiles as tables, whose times are written as they are.
    for (name, start_s) in [("first_scan.csv", 36010.0), ("second_scan.csv", 122410.0)] {
        let rows = (0..100).map(|i| format!("{},0.1,1.0\n", start_s + 0.1 * f64::from(i)));
        fs::write(
            drive.join(name),
            format!("time_s,x_m,z_m\n{}", rows.collect::<String>()),
        )
        .unwrap();
    }
    for name in ["left.bin", "right.bin"] {
        fs::remove_file(drive.join(name)).unwrap();
    }
    let run = boresight(&["init", "--force", drive.to_str().unwrap()]);
    run.assert_failed_with(&[
        "holds the files of 2 drives",
        "second_scan.csv",
        "move the files of each drive into a folder of its own",
    ]);
}

/// Moves the rows of a log in time, so that those after a time come first, and lets the times start at 0.
fn write_shifted(log: &Path, split: usize, to: &Path) {
    let text = fs::read_to_string(log).unwrap();
    let (header, rows) = text.split_once('\n').unwrap();
    let rows: Vec<(&str, &str)> = rows
        .lines()
        .map(|row| row.split_once(',').unwrap())
        .collect();
    let split = split % rows.len();
    let values = rows[split..].iter().chain(&rows[..split]).map(|row| row.1);
    let mut shifted = format!("{header}\n");
    let start_s: f64 = rows[0].0.parse().unwrap();
    for ((time_s, _), values) in rows.iter().zip(values) {
        let time_s = time_s.parse::<f64>().unwrap() - start_s;
        let _ = writeln!(shifted, "{time_s:.3},{values}");
    }
    fs::write(to, shifted).unwrap();
}

#[test]
fn drives_with_the_same_times_are_told_by_how_they_turn() {
    let (temp, drive) = simulated();
    let folder = temp.path().join("both");
    for (run, split) in [("first", 0), ("second", 1500)] {
        fs::create_dir_all(folder.join(run)).unwrap();
        for log in ["imu.csv", "prism.csv"] {
            write_shifted(&drive.join(log), split, &folder.join(run).join(log));
        }
        let rows = (0..100).map(|i| format!("{},0.1,1.0\n", 10.0 + 0.1 * f64::from(i)));
        let rows: String = rows.collect();
        let profiles = folder.join(run).join(format!("scan-{run}.csv"));
        fs::write(profiles, format!("time_s,x_m,z_m\n{rows}")).unwrap();
    }
    let run = init(&folder);
    let [first, second] =
        ["first", "second"].map(|run| format!("boresight init {}", folder.join(run).display()));
    let problem = "holds the files of 2 drives: first/imu.csv; second/imu.csv, which turn differently at the same times";
    run.assert_failed_with(&[problem, &first, &second]);
    assert_eq!(init(&folder.join("first")).code, 0);

    // Another log of the same IMU is no other drive.
    fs::copy(
        folder.join("first/imu.csv"),
        folder.join("first/export.csv"),
    )
    .unwrap();
    let again = boresight(&["init", "--force", folder.join("first").to_str().unwrap()]);
    assert_eq!(again.code, 0, "{}", again.err);
    // All files in one folder.
    fs::rename(
        folder.join("second/imu.csv"),
        folder.join("first/second.csv"),
    )
    .unwrap();
    let flat = boresight(&["init", "--force", folder.join("first").to_str().unwrap()]);
    let problem = "2 drives: export.csv, imu.csv; second.csv, which turn differently";
    flat.assert_failed_with(&[
        problem,
        "move the files of each drive into a folder of its own",
    ]);
}

#[test]
fn inspect_lists_the_files_of_a_folder() {
    let (_temp, drive) = simulated();
    let field = drive.parent().unwrap();
    let run = boresight(&["inspect", field.to_str().unwrap()]);
    assert_eq!(run.code, 0, "{}", run.err);
    for line in [
        "drive-1/imu.csv: the samples of an IMU: [imu]; ",
        "drive-1/left.bin: the profiles of a [[scanner]]; 23286 rows, 36",
        "drive-1/project.toml: a project file",
        "tls.laz: a cloud: [reference]",
        "a project of these files: boresight init ",
    ] {
        assert!(run.out.contains(line), "{line}: {}", run.out);
    }
    let json = boresight(&["inspect", "--json", field.to_str().unwrap()]);
    let document: serde_json::Value = serde_json::from_str(&json.out).unwrap();
    assert_eq!(document["files"][0]["format"], "folder");
    assert_eq!(
        document["files"][0]["files"][0]["serves"],
        "headings: [heading]"
    );
    // A folder with a project is that project.
    let project = boresight(&["inspect", drive.to_str().unwrap()]);
    assert!(
        project.out.contains("what `boresight run` will do"),
        "{}",
        project.out
    );
}
