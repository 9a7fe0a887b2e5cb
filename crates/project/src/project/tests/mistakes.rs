use super::{EXAMPLE, Motion, POSES, Project, SEVERAL, folder, read};

/// The message for `text`, without the folder, so that it starts with `project.toml`.
pub(super) fn message(text: &str) -> String {
    let message = read(text).unwrap_err().to_string();
    let start = message.find("project.toml").unwrap();
    message[start..].to_owned()
}

#[test]
fn all_missing_keys_are_said_at_once() {
    let without = |keys: &[&str]| {
        let kept = |line: &&str| !keys.iter().any(|key| line.starts_with(key));
        let lines: Vec<&str> = EXAMPLE.lines().filter(kept).collect();
        lines.join("\n")
    };
    assert_eq!(
        message(&without(&["lever_arm_m", "translation_m", "rotation_deg"])),
        "project.toml, line 14: found tables without keys that they need: [prism] (line 14) without `lever_arm_m`; \
         [scanner] (line 26) without `translation_m`, `rotation_deg` or `quaternion_xyzw`, expected these keys"
    );
    assert_eq!(
        message(&without(&["translation_m", "rotation_deg"])),
        "project.toml, line 27: found a table without keys that it needs: [scanner] (line 27) without \
         `translation_m`, `rotation_deg` or `quaternion_xyzw`, expected these keys"
    );
    // The others are found after the misspelt one is mended.
    let misspelt = without(&["translation_m"]).replace("lever_arm_m", "lever_arm");
    assert!(message(&misspelt).contains("unknown key `lever_arm`"));
    let text = "[[scanner]]\nname = \"left\"\nprofiles = \"left.bin\"\ntranslation_m = [0, 0, 0]\nrotation_deg = [0, 0, 0]\n";
    assert!(message(text).contains("found no [imu] and no [prism] or [gnss]"));
}

#[test]
fn mistakes_are_reported_with_line_and_remedy() {
    // Text to replace, its replacement, and what the message must contain.
    let cases: [(&str, &str, &str); 30] = [
        (
            "sigma_m = 0.005",
            "sigm_m = 0.005",
            "line 16: found the unknown key `sigm_m`, expected `sigma_m` (or one of: name, file, ",
        ),
        (
            "[[scanner]]",
            "[[scaner]]",
            "line 27: found the unknown key `scaner`, expected `scanner` (or",
        ),
        (
            "body = \"FRD\"",
            "body = \"frd\"",
            "line 2: found the unknown value `frd`, expected `FRD` (or one of: FLU)",
        ),
        (
            "rotation_convention = \"bonn\"",
            "rotation_convention = \"born\"",
            "line 32: found the unknown value `born`, expected `bonn`",
        ),
        (
            "neighbours = 50",
            "neighbours = 3",
            "line 40: found neighbours = 3, expected 4 or more",
        ),
        (
            "neighbours = 50",
            "neighbours = -3",
            "line 40: found integer `-3`, expected a whole number",
        ),
        (
            "neighbours = 50",
            "max_iterations = 0",
            "line 40: found max_iterations = 0, expected 1 or more",
        ),
        (
            "neighbours = 50",
            "pass_gap_s = 0.0",
            "line 40: found pass_gap_s = 0, expected a number above 0",
        ),
        (
            "0.01, 0.005]",
            "0.01, 0.02]",
            "line 39: found voxel_sizes_m = [0.05, 0.04, 0.03, 0.02, 0.01, 0.02], expected at least one size, each smaller",
        ),
        (
            "0.01, 0.005]",
            "0.01, -0.005]",
            "line 39: found voxel_sizes_m = -0.005, expected a number above 0",
        ),
        (
            "sigma_m = 0.005",
            "sigma_m = \"5 mm\"",
            "line 16: found string \"5 mm\", expected a number",
        ),
        (
            "sigma_m = 0.005",
            "sigma_m = nan",
            "line 16: found sigma_m = NaN, expected a number above 0",
        ),
        (
            "sigma_m = 0.005",
            "sigma_m = 0.005 m",
            "line 16: found invalid TOML (",
        ),
        (
            "lever_arm_m = [0.10, 0.05, -0.55]",
            "",
            "line 14: found a table without `lever_arm_m`, expected the key `lever_arm_m`",
        ),
        (
            "lever_arm_m = [0.10, 0.05, -0.55]",
            "lever_arm_m = [0.10, inf, -0.55]",
            "line 17: found lever_arm_m = inf, expected a finite number",
        ),
        (
            "lever_arm_m = [0.10, 0.05, -0.55]",
            "lever_arm_m = [0.10, 0.05]",
            "line 17: found 2, expected a list of 3 numbers",
        ),
        (
            "gravity_m_s2 = 9.81",
            "gravity_m_s2 = -9.81",
            "line 5: found gravity_m_s2 = -9.81, expected the magnitude of gravity",
        ),
        (
            "gyro_noise_deg_sqrt_h = 0.15",
            "gyro_noise_deg_sqrt_h = 0",
            "line 9: found gyro_noise_deg_sqrt_h = 0, expected a number above 0",
        ),
        (
            "gyro_noise_deg_sqrt_h = 0.15",
            "gyro_bias_walk_rad_s_sqrt_s = 1e-6",
            "line 9: found both gyro_bias_walk_rad_s_sqrt_s and gyro_bias_instability_deg_h, expected one of the two",
        ),
        (
            "name = \"left\"",
            "name = \"le/ft\"",
            "line 28: found the name \"le/ft\", expected 1 to 64 letters",
        ),
        (
            "name = \"left\"",
            "name = \"\"",
            "line 28: found the name \"\", expected 1 to 64 letters",
        ),
        (
            "name = \"left\"",
            "name = \"initial\"",
            "line 28: found the name \"initial\", which is reserved for the results",
        ),
        (
            "profiles = \"left.bin\"",
            "profiles = []",
            "line 29: found an empty list, expected at least one file",
        ),
        (
            "profiles = \"left.bin\"",
            "profiles = 5",
            "line 29: found integer `5`, expected a file name or a list of file names",
        ),
        (
            "rotation_deg = [-145.0, 0.0, 90.0]",
            "",
            "line 28: found no rotation of the scanner \"left\", expected rotation_deg or quaternion_xyzw",
        ),
        (
            "rotation_deg = [-145.0, 0.0, 90.0]",
            "quaternion_xyzw = [1, 1, 0, 0]",
            "line 31: found a quaternion of length 1.414",
        ),
        (
            "# fixed = [\"tx\", \"ty\", \"tz\"]",
            "fixed = [\"tx\", \"xr\"]",
            "line 33: found the unknown parameter `xr`, expected `rx` (parameters: tx, ty,",
        ),
        (
            "# fixed = [\"tx\", \"ty\", \"tz\"]",
            "quaternion_xyzw = [0, 0, 0, 1]",
            "line 33: found both rotation_deg and quaternion_xyzw, expected one of the two",
        ),
        (
            "# [trajectory]                          # instead of the three above\n#",
            "[trajectory]\n",
            "line 7: found [imu] together with [trajectory] with a file, expected either a trajectory or the logs",
        ),
        (
            "[prism]\nfile = \"prism.csv\"\nsigma_m = 0.005\nlever_arm_m = [0.10, 0.05, -0.55]",
            "",
            ": found no [prism] or [gnss], expected [imu] and [prism] or [gnss], or [trajectory] with a file",
        ),
    ];
    for (old, new, expected) in cases {
        assert_eq!(EXAMPLE.matches(old).count(), 1, "{old}");
        let message = message(&EXAMPLE.replacen(old, new, 1));
        assert!(
            message.contains(expected),
            "{new}: {message}\n  expected: {expected}"
        );
    }
}

#[test]
fn mistakes_with_several_sensors_are_reported_with_line_and_remedy() {
    let instrument = "station_m = [363010.5, 5600020.25, 61.5]\n";
    let cases = [
        (
            "name = \"rear\"",
            "",
            "line 24: found one of 2 [[prism]] without a name, expected `name`",
        ),
        (
            "name = \"rear\"",
            "name = \"FRONT\"",
            "line 23: found the name \"FRONT\", which is already taken",
        ),
        (
            "name = \"rear\"",
            "name = \"gnss\"",
            "line 32: found the name \"gnss\", which is already",
        ),
        (
            "name = \"rear\"",
            "name = \"heading\"",
            "line 23: found the name \"heading\", which",
        ),
        (
            "name = \"rear\"",
            "name = \"a.b\"",
            "line 23: found the name \"a.b\", expected 1 to 64 letters, digits, `-` or `_`",
        ),
        (
            "[0.004, 0.004, 0.006]",
            "[0.004, 0.004, 0]",
            "line 29: found sigma_m = 0, expected a number above 0",
        ),
        (
            "[0.004, 0.004, 0.006]",
            "[0.004, 0.004]",
            "line 29: found 2, expected a list of 3 numbers",
        ),
        (
            "sigma_m = 0.003",
            "sigma_m = [0.003, 0.003, 0.004]",
            "line 16: found three values of sigma_m, expected one",
        ),
        (
            instrument,
            "",
            "line 12: found station_orientation_deg without station_m",
        ),
        (
            "station_orientation_deg = 337.205145\n",
            "",
            "line 13: found vertical_angle without station_orientation_deg",
        ),
        (
            "\"cartesian\"",
            "\"polar\"",
            "line 28: found polar observations without station_orientation_deg",
        ),
        (
            "\"elevation\"",
            "\"horizon\"",
            "line 14: found the unknown value `horizon`, expected `elevation`",
        ),
        (
            "sigma_angle_arcsec = 0.5",
            "sigma_angle_mgon = 0.15",
            "line 19: found the unknown key `sigma_angle_mgon`, expected `sigma_angle_arcsec`",
        ),
        (
            "loss = \"huber\"",
            "loss = \"hubert\"",
            "line 20: found the unknown value `hubert`, expected `huber`",
        ),
        (
            "loss = \"huber\"",
            "observations = \"cartesian\"",
            "line 13: found station_orientation_deg together with observations = \"cartesian\"",
        ),
        (
            "\"gnss.lever_arm\"",
            "\"gnss.leverarm\"",
            "line 46: found the unknown constant `gnss.leverarm`, expected `gnss.lever_arm` (constants: front.time_offset, front.time_drift, front.lever_arm, front.incidence_bias, rear.time_offset, ",
        ),
        (
            "\"gnss.lever_arm\"",
            "\"gnss.incidence_bias\"",
            "line 46: found the unknown constant `gnss.incidence_bias`",
        ),
        (
            "\"gnss.lever_arm\"",
            "\"frame.gravity\"",
            "line 46: found `frame.gravity` twice",
        ),
        ("station_m = [363000.0, 5600000.0, 61.0]\n", "", ""),
        (
            "max_sigma_position_m = 0.02",
            "max_sigma_position_m = 0",
            "line 48: found max_sigma_position_m = 0, expected a number above 0",
        ),
        (
            "nodes = \"imu\"",
            "sigma_position_m = 1",
            "line 44: found sigma_position_m without a file of poses, expected `file` as well",
        ),
        (
            "[gnss]",
            "[gnsss]",
            "line 32: found the unknown key `gnsss`, expected `gnss`",
        ),
        (
            "[gnss]\n",
            "[gnss]\nstation_m = [1, 2, 3]\n",
            "line 33: found the unknown key `station_m`",
        ),
    ];
    for (old, new, expected) in cases {
        assert_eq!(SEVERAL.matches(old).count(), 1, "{old}");
        let text = SEVERAL.replacen(old, new, 1);
        if expected.is_empty() {
            read(&text).unwrap();
            continue;
        }
        let message = message(&text);
        assert!(
            message.contains(expected),
            "{new}: {message}\n  expected: {expected}"
        );
    }
    let bias = SEVERAL
        .replace("front.incidence_bias", "rear.incidence_bias")
        .replace("station_m = [363000.0, 5600000.0, 61.0]\n", "");
    let message_of_bias = message(&bias);
    assert!(
        message_of_bias.contains(
            "line 45: found `rear.incidence_bias` without a line of sight, expected station_m of `rear`"
        ),
        "{message_of_bias}"
    );
    let offset = "[trajectory]\nestimate = [\"heading.time_offset\"]\n";
    let no_heading = super::UNUSUAL.replacen("[[scanner]]", &format!("{offset}[[scanner]]"), 1);
    let no_heading = message(&no_heading);
    assert!(
        no_heading.contains("found `heading.time_offset` without [heading]"),
        "{no_heading}"
    );
    let nodes = message(&format!("{POSES}nodes = \"prism\"\n"));
    assert!(
        nodes.contains("line 6: found nodes together with a file of poses"),
        "{nodes}"
    );
}

/// `[[prism]]` with one table is equivalent to `[prism]`, up to the line of an error.
#[test]
fn an_array_of_one_table_is_equivalent_to_a_table() {
    let array = EXAMPLE.replace("[prism]\n", "[[prism]]\n");
    let settings = |text: &str| match read(text).unwrap().motion {
        Motion::Logs(logs) => logs.settings,
        Motion::Poses(_) => panic!("logs"),
    };
    assert_eq!(settings(&array), settings(EXAMPLE));
    let bad = message(&array.replace("sigma_m = 0.005", "sigma_m = 0"));
    assert!(
        bad.contains("line 16: found sigma_m = 0, expected"),
        "{bad}"
    );
}

#[test]
fn names_must_be_unique() {
    let scanner = |name: &str| {
        format!(
            "[[scanner]]\nname = \"{name}\"\nprofiles = \"p\"\ntranslation_m = [0, 0, 0]\n\
             rotation_deg = [0, 0, 0]\n"
        )
    };
    let twice = message(&format!("{POSES}{}{}", scanner("a"), scanner("A")));
    assert!(
        twice.contains("line 12: found the name \"A\" twice"),
        "{twice}"
    );
    let pair = [scanner("a"), scanner("b"), scanner("a-b")].concat();
    let pair = message(&format!("{POSES}{pair}"));
    assert!(
        pair.contains("line 17: found the name \"a-b\", which"),
        "{pair}"
    );
}

#[test]
fn text_that_is_not_utf8_is_refused_with_its_byte() {
    let folder = folder();
    let path = folder.path().join("project.toml");
    std::fs::write(&path, b"[frame]\n\xff").unwrap();
    let error = Project::read(&path).unwrap_err().to_string();
    assert!(
        error.contains("byte 8: found bytes that are not UTF-8"),
        "{error}"
    );
}
