//! Tests of the keys of the joint adjustment.

use super::mistakes::message;
use super::{EXAMPLE, POSES, Project, UNUSUAL, folder, read, write};
use crate::calibration::Method;
use crate::geometry::Vec3;
use crate::joint::{JointSettings, MountingMotion, ReferenceSigma};
use crate::project::Motion;
use crate::trajectory::TrajectorySettings;

/// All keys that only the joint adjustment uses.
pub(super) const JOINT: &str = r#"
[imu]
file = "imu.csv"

[prism]
file = "prism.csv"
lever_arm_m = [0, 0, 1]
sigma_correlated_m = [0.001, 0.001, 0.002]
correlation_s = 20

[gnss]
file = "gnss.csv"
lever_arm_m = [0, 0, 1]
sigma_correlated_m = 0.01

[heading]
file = "heading.csv"
sigma_correlated_deg = 0.2
correlation_s = 60.5

[[scanner]]
name = "left"
profiles = "left.bin"
translation_m = [1.2, -0.5, 0.5]
rotation_deg = [0, 0, 0]
estimate = ["time_offset"]

[[scanner]]
name = "right"
profiles = "right.bin"
translation_m = [1.2, 0.5, 0.5]
rotation_deg = [0, 0, 0]

[reference]
file = "tls.laz"
sigma_m = 0.0
sigma_deg = 0.007
sigma_surface_m = 0.0003

[calibration]
method = "joint"

[joint]
surfel_m = 0.04
max_iterations = 12

[[drive]]
name = "drive-2"
project = "../drive-2/project.toml"

[[drive]]
name = "drive-3"
project = "../drive-3/project.toml"

[[evaluation]]
name = "drive-4"
project = "../drive-4/project.toml"

[bending]
file = "frame.csv"
time_offset_s = -0.5
columns = ["temperature_c"]
"#;

fn settings(text: &str) -> TrajectorySettings {
    match read(text).unwrap().motion {
        Motion::Logs(logs) => logs.settings,
        Motion::Poses(_) => panic!("logs"),
    }
}

#[test]
fn keys_of_the_joint_adjustment_are_understood() {
    let project = read(JOINT).unwrap();
    assert!(project.is_joint);
    assert_eq!(project.calibration.method, Method::TwoStep);
    let expected = JointSettings {
        surfel_m: Some(0.04),
        max_iterations: 12,
        mounting: MountingMotion::default(),
        reference: ReferenceSigma {
            shift_m: 0.0,
            tilt_rad: 0.007_f64.to_radians(),
            assumed: false,
            surface_m: Some(0.0003),
        },
        correlation_s: 5.0,
    };
    assert_eq!(project.joint, expected);
    let bending = project.bending.as_ref().unwrap();
    assert_eq!(bending.log.time_offset_s, -0.5);
    assert_eq!(bending.columns, ["temperature_c"]);
    let estimated: Vec<bool> = project
        .scanners
        .iter()
        .map(|scanner| scanner.estimate_time_offset)
        .collect();
    assert_eq!(estimated, [true, false]);
    let names = |others: &[crate::project::OtherDrive]| {
        let names = others.iter().map(|other| other.name.clone());
        names.collect::<Vec<_>>()
    };
    assert_eq!(names(&project.drives), ["drive-2", "drive-3"]);
    assert_eq!(names(&project.evaluations), ["drive-4"]);
    assert!(project.drives[0].project.ends_with("drive-2/project.toml"));

    let settings = settings(JOINT);
    let [prism, gnss] = &settings.positions[..] else {
        panic!("two");
    };
    assert_eq!(prism.sigma_correlated_m, Vec3::new(0.001, 0.001, 0.002));
    assert_eq!(prism.correlation_s, 20.0);
    assert_eq!(gnss.sigma_correlated_m, Vec3::repeat(0.01));
    assert_eq!(gnss.correlation_s, 30.0);
    let heading = &settings.heading;
    assert_eq!(heading.sigma_correlated_rad, 0.2_f64.to_radians());
    assert_eq!(heading.correlation_s, 60.5);
}

#[test]
fn the_method_is_joint_unless_the_project_says_otherwise() {
    let example = read(EXAMPLE).unwrap();
    assert!(example.is_joint);
    assert_eq!(example.joint, JointSettings::default());
    let assumed = ReferenceSigma {
        shift_m: 0.002,
        tilt_rad: 0.005_f64.to_radians(),
        assumed: true,
        surface_m: None,
    };
    assert_eq!(example.joint.reference, assumed);
    let positions = &settings(EXAMPLE).positions[0];
    assert_eq!(positions.sigma_correlated_m, Vec3::zeros());
    assert_eq!(positions.correlation_s, 30.0);

    for (name, method, is_joint, printed) in [
        ("joint", Method::TwoStep, true, "joint"),
        ("two-step", Method::TwoStep, false, "two-step"),
        ("reweighted", Method::TwoStep, false, "two-step"),
        ("paper", Method::Paper, false, "paper"),
    ] {
        let key = format!("method = \"{name}\"\n[comparison]");
        let project = read(
            &UNUSUAL
                .replace("method = \"paper\"\n", "")
                .replace("[comparison]", &key),
        );
        let project = project.unwrap();
        assert_eq!(project.calibration.method, method, "{name}");
        assert_eq!(project.is_joint, is_joint, "{name}");
        let toml = project.to_toml().unwrap();
        let line = format!("method = \"{printed}\"");
        assert!(toml.lines().any(|printed| printed == line), "{toml}");
    }
}

#[test]
fn the_reference_is_assumed_only_if_no_sigma_is_given() {
    let with = |keys: &str| {
        let keys = format!("file = \"tls.laz\"\n{keys}\n");
        let text = EXAMPLE.replacen("file = \"tls.laz\"\n", &keys, 1);
        read(&text).unwrap().joint.reference
    };
    let default = ReferenceSigma::default();
    assert_eq!(with(""), default);
    let given = ReferenceSigma {
        assumed: false,
        ..default
    };
    let shift_m = 0.001;
    assert_eq!(with("sigma_m = 0.001"), ReferenceSigma { shift_m, ..given });
    let tilt_rad = 0.0;
    assert_eq!(with("sigma_deg = 0"), ReferenceSigma { tilt_rad, ..given });
    let surface_m = Some(0.0002);
    let surface = with("sigma_surface_m = 0.0002");
    assert_eq!(
        surface,
        ReferenceSigma {
            surface_m,
            ..default
        }
    );
}

#[test]
fn printed_joint_projects_read_back_to_the_same_project() {
    let poses = format!("{POSES}correlation_s = 12.5\n");
    let given = EXAMPLE.replace("file = \"tls.laz\"", "file = \"tls.laz\"\nsigma_m = 0.002");
    let surface = EXAMPLE.replace(
        "file = \"tls.laz\"",
        "file = \"tls.laz\"\nsigma_surface_m = 0.001",
    );
    let two_step = EXAMPLE.replace("[calibration]", "[calibration]\nmethod = \"two-step\"");
    for text in [JOINT, &poses, &given, &surface, &two_step] {
        let folder = folder();
        let path = write(folder.path(), text);
        let project = Project::read(&path).unwrap();
        let printed = project.to_toml().unwrap();
        write(folder.path(), &printed);
        assert_eq!(Project::read(&path).unwrap(), project, "{printed}");
    }
    assert_eq!(read(&poses).unwrap().joint.correlation_s, 12.5);
    // An assumed value is not printed: read back, it would count as given.
    let printed = read(EXAMPLE).unwrap().to_toml().unwrap();
    let reference = printed.split_once("[reference]").unwrap().1;
    assert!(reference.lines().nth(1).unwrap().starts_with("file = "));
    assert_eq!(reference.lines().nth(2), Some(""), "{printed}");
}

#[test]
fn mistakes_in_joint_keys_are_reported_with_line_and_remedy() {
    let cases = [
        (
            "method = \"joint\"",
            "method = \"jiont\"",
            "line 41: found the unknown value `jiont`, expected `joint` (or one of: reweighted, two-step, paper)",
        ),
        (
            "method = \"joint\"",
            "method = \"two-step\"",
            "line 26: found estimate without the joint adjustment, expected calibration.method = \"joint\"",
        ),
        (
            "estimate = [\"time_offset\"]",
            "estimate = [\"time_ofset\"]",
            "line 26: found the unknown constant `time_ofset`, expected `time_offset`",
        ),
        (
            "estimate = [\"time_offset\"]",
            "estimate = [\"time_offset\", \"time_offset\"]",
            "line 26: found `time_offset` twice, expected each constant once",
        ),
        (
            "surfel_m = 0.04",
            "surfel_m = 0",
            "line 44: found surfel_m = 0, expected a number above 0",
        ),
        (
            "surfel_m = 0.04",
            "surfels_m = 0.04",
            "line 44: found the unknown key `surfels_m`, expected `surfel_m` (or one of: max_iterations, mounting)",
        ),
        (
            "max_iterations = 12",
            "max_iterations = 0",
            "line 45: found max_iterations = 0, expected 1 or more",
        ),
        (
            "sigma_m = 0.0\n",
            "sigma_m = -0.001\n",
            "line 36: found sigma_m = -0.001, expected 0 or a number above 0",
        ),
        (
            "sigma_deg = 0.007",
            "sigma_deg = nan",
            "line 37: found sigma_deg = NaN, expected 0 or a number above 0",
        ),
        (
            "sigma_surface_m = 0.0003",
            "sigma_surface_m = \"0.3 mm\"",
            "line 38: found string \"0.3 mm\", expected a number",
        ),
        (
            "[0.001, 0.001, 0.002]",
            "[0.001, 0.001, -0.002]",
            "line 8: found sigma_correlated_m = -0.002, expected 0 or a number above 0",
        ),
        (
            "correlation_s = 20\n",
            "correlation_s = 0\n",
            "line 9: found correlation_s = 0, expected a number above 0",
        ),
        (
            "sigma_correlated_m = [0.001, 0.001, 0.002]\n",
            "",
            "line 8: found correlation_s without sigma_correlated_m, expected both",
        ),
        (
            "sigma_correlated_m = 0.01\n",
            "correlation_s = 3\n",
            "line 14: found correlation_s without sigma_correlated_m, expected both",
        ),
        (
            "sigma_correlated_deg = 0.2\n",
            "",
            "line 18: found correlation_s without sigma_correlated_deg, expected both",
        ),
        (
            "correlation_s = 60.5",
            "correlation_s = inf",
            "line 19: found correlation_s = inf, expected a number above 0",
        ),
        (
            "name = \"drive-3\"",
            "name = \"Drive-2\"",
            "line 52: found the name \"Drive-2\" twice, expected a unique name",
        ),
        (
            "name = \"drive-4\"",
            "name = \"Drive-3\"",
            "line 56: found the name \"Drive-3\", which is that of a drive, expected a unique name",
        ),
        (
            "name = \"drive-3\"",
            "name = \"drive 3\"",
            "line 52: found the name \"drive 3\", expected 1 to 64 letters",
        ),
        (
            "name = \"drive-2\"",
            "nam = \"drive-2\"",
            "line 48: found the unknown key `nam`, expected `name` (or one of: project)",
        ),
        (
            "project = \"../drive-2/project.toml\"\n",
            "",
            "line 47: found a table without `project`, expected the key `project`",
        ),
    ];
    for (old, new, expected) in cases {
        assert_eq!(JOINT.matches(old).count(), 1, "{old}");
        let message = message(&JOINT.replacen(old, new, 1));
        assert!(
            message.contains(expected),
            "{new}: {message}\n  expected: {expected}"
        );
    }
    let drives = JOINT
        .replace("estimate = [\"time_offset\"]\n", "")
        .replace("method = \"joint\"", "method = \"paper\"");
    let drives = message(&drives);
    assert!(
        drives.contains(
            "line 46: found [[drive]] without the joint adjustment, expected calibration"
        ),
        "{drives}"
    );
    let logs = JOINT.replacen(
        "[[scanner]]",
        "[trajectory]\ncorrelation_s = 5\n[[scanner]]",
        1,
    );
    let logs = message(&logs);
    assert!(
        logs.contains("line 22: found correlation_s without a file of poses, expected `file`"),
        "{logs}"
    );
    let never = message(&format!("{POSES}correlation_s = 0\n"));
    assert!(
        never.contains("line 6: found correlation_s = 0, expected a number above 0"),
        "{never}"
    );
}

#[test]
fn invalid_columns_of_bending_are_refused() {
    for columns in [
        "[]",
        "[\"a\", \"a\"]",
        "[\"time_s\"]",
        "[\"a\", \"b\", \"c\"]",
    ] {
        let text = JOINT.replace("[\"temperature_c\"]", columns);
        let refusal = message(&text);
        assert!(refusal.contains("one or two columns"), "{refusal}");
    }
    let two_step = JOINT.replace("method = \"joint\"", "method = \"two-step\"");
    let two_step = two_step.replace("estimate = [\"time_offset\"]", "");
    let (start, _) = two_step.split_once("[[drive]]").unwrap();
    let (_, bending) = two_step.split_once("[bending]").unwrap();
    let refusal = message(&format!("{start}[bending]{bending}"));
    assert!(
        refusal.contains("[bending] without the joint adjustment"),
        "{refusal}"
    );
}
