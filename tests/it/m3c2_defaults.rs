//! `boresight compare` without options, on clouds that are not those of a field robot.

use std::fs;
use std::path::Path;

use boresight::comparison::OpenSettings;
use boresight::format::{CloudShape, CloudWriter, ExtraDimension, ExtraKind, ExtraValue};
use boresight::geometry::Vec3;
use boresight::pipeline::{Options, compare};
use boresight::progress::Silent;
use boresight::tiles::{Comparison, NormalSource, Orientation};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

use crate::common::{boresight, boresight_at};

const AIRBORNE: [&str; 2] = [
    "tests/data/autzen_m3c2/autzen-bmx-2023.las",
    "tests/data/autzen_m3c2/autzen-bmx-2010.las",
];

/// Runs the command; returns its document and what it says.
fn compared(folder: &Path, files: [&str; 2], more: &[&str]) -> (Value, String) {
    let arguments = [&["compare"], &files[..], &["--out", "out"], more].concat();
    let run = boresight_at(folder, &arguments);
    assert_eq!(run.code, 0, "{}{}", run.out, run.err);
    let json = boresight_at(folder, &[&arguments[..], &["--json"]].concat());
    (serde_json::from_str(&json.out).unwrap(), run.out)
}

#[test]
fn scales_follow_airborne_clouds_and_are_said() {
    let temp = tempfile::tempdir().unwrap();
    let here = std::env::current_dir().unwrap();
    let paths = AIRBORNE.map(|file| here.join(file).to_str().unwrap().to_owned());
    let files = [&*paths[0], &*paths[1]];
    let (result, summary) = compared(temp.path(), files, &[]);
    assert_eq!(result["n"], result["core_points"]);
    assert!(result["n"].as_u64().unwrap() > 25, "{result}");
    let settings = &result["settings"];
    let radius_m = settings["cylinder_radius_m"].as_f64().unwrap();
    // 829 and 687 points lie on about 1400 m²: a disc of 20 points has a radius of 3.3 m.
    assert!((2.8..4.0).contains(&radius_m), "{settings}");
    for option in [
        "--core-spacing-m",
        "--normal-radii-m",
        "--cylinder-radius-m",
        "--max-distance-m",
    ] {
        assert!(summary.contains(option), "{option}: {summary}");
    }
    assert!(summary.contains("m, measured"), "{summary}");
    let page = fs::read_to_string(temp.path().join("out/compare.html")).unwrap();
    assert!(page.contains(&format!("{radius_m} m, measured")));
    // A colour bar for the distances, and one in other colours for the level of detection.
    assert_eq!(page.matches("class=\"ramp\"").count(), 2);
    assert!(page.contains("#00224e"));

    // What is given holds, and the rest follows from it.
    let (result, summary) = compared(temp.path(), files, &["--cylinder-radius-m", "2.5"]);
    let settings = &result["settings"];
    assert_eq!(settings["cylinder_radius_m"], 2.5);
    assert_eq!(settings["core_spacing_m"], 5.0);
    assert!(
        summary.contains("2.5 m, given (--cylinder-radius-m)"),
        "{summary}"
    );
}

#[test]
fn measured_scales_do_not_depend_on_the_memory() {
    let temp = tempfile::tempdir().unwrap();
    let run = |name: &str, memory_bytes: u64| {
        let comparison = Comparison {
            cloud: AIRBORNE[0].into(),
            reference: AIRBORNE[1].into(),
            core: None,
            normals: NormalSource::Core {
                orientation: Orientation::default(),
            },
            settings: OpenSettings::default(),
            memory_bytes: Some(memory_bytes),
        };
        let options = Options {
            out: temp.path().join(name),
            seed: None,
            fresh: false,
            kept: Vec::new(),
        };
        let outcome = compare(&comparison, &options, &Silent).unwrap();
        let table = fs::read_to_string(options.out.join("m3c2.csv")).unwrap();
        (outcome.result["settings"].clone(), table)
    };
    assert_eq!(run("whole", 1 << 30), run("tiles", 0));
}

#[test]
fn clouds_that_lie_elsewhere_are_refused_with_the_options_to_change() {
    let temp = tempfile::tempdir().unwrap();
    let cloud = |name: &str, east: f64| {
        let point = |i: u32| format!("{},{},0\n", east + f64::from(i % 20), f64::from(i / 20));
        let rows: String = (0..400).map(point).collect();
        fs::write(temp.path().join(name), format!("x,y,z\n{rows}")).unwrap();
    };
    cloud("a.csv", 0.0);
    cloud("b.csv", 1e4);
    let run = boresight_at(temp.path(), &["compare", "a.csv", "b.csv"]);
    assert_eq!(run.code, 1);
    for part in ["do not overlap", "--max-distance-m", "--normal-radii-m"] {
        assert!(run.err.contains(part), "{part}: {}", run.err);
    }
}

/// The room that a scanner at its centre sees: walls 4 m to the west and east, which have grown inwards.
fn room(growth_m: f64, seed: u64) -> Vec<Vec3> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut point = |side: f64| {
        let [along, up] = [3.0, 2.0].map(|half: f64| rng.random_range(-half..half));
        let noise = rng.random_range(-0.002..0.002);
        Vec3::new(side * (4.0 - growth_m) + noise, along, up)
    };
    (0..20_000)
        .map(|i| point(if i % 2 == 0 { 1.0 } else { -1.0 }))
        .collect()
}

fn ptx(path: &Path, centre: Vec3, points: &[Vec3]) {
    let Vec3 { .. } = centre;
    let (x, y, z) = (centre.x, centre.y, centre.z);
    let mut text = format!(
        "{}\n1\n{x} {y} {z}\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n{x} {y} {z} 1\n",
        points.len()
    );
    for p in points {
        text.push_str(&format!("{} {} {} 0.5\n", p.x, p.y, p.z));
    }
    fs::write(path, text).unwrap();
}

fn csv(path: &Path, header: &str, points: &[Vec3], tail: &str) {
    let rows = points
        .iter()
        .map(|p| format!("{} {} {}{tail}\n", p.x, p.y, p.z));
    fs::write(path, header.to_owned() + &rows.collect::<String>()).unwrap();
}

/// Writes points whose second half is seen from a place a metre to the east of the first.
fn las(path: &Path, points: &[Vec3]) {
    let names = ["X Sensor", "Y Sensor", "Z Sensor"];
    let shape = CloudShape {
        dimensions: names
            .map(|name| ExtraDimension::new(name, ExtraKind::F64, ""))
            .into(),
        ..CloudShape::default()
    };
    let mut writer = CloudWriter::around(path, Vec3::zeros(), &shape).unwrap();
    for (i, point) in points.iter().enumerate() {
        let x = f64::from(u8::from(2 * i >= points.len()));
        let place = [x, 0.0, 0.5].map(ExtraValue::Number);
        writer.write_with(point, 0.0, 0.0, 0, &place).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn walls_that_grow_towards_the_scanner_have_positive_distances() {
    let temp = tempfile::tempdir().unwrap();
    let at = |name: &str| temp.path().join(name);
    let (before, after) = (room(0.0, 1), room(0.01, 2));
    let mean_m = |result: &Value| result["mean_m"].as_f64().unwrap();
    let grown = |result: &Value| {
        assert!((mean_m(result) - 0.01).abs() < 3e-4, "{result}");
        assert_eq!(result["normals_across_orientation"], 0, "{result}");
    };

    // Without a place of the scanner, the signs are arbitrary, which is said.
    let header = "x y z\n";
    csv(&at("before.xyz"), header, &before, "");
    csv(&at("after.xyz"), header, &after, "");
    let files = ["after.xyz", "before.xyz"];
    let (result, summary) = compared(temp.path(), files, &[]);
    assert!(mean_m(&result).abs() < 5e-3, "{result}");
    assert_eq!(result["normals_across_orientation"], result["n"]);
    assert!(summary.contains("--viewpoint"), "{summary}");
    let (result, _) = compared(temp.path(), files, &["--viewpoint", "0,0,0"]);
    grown(&result);

    // The scan's place in a PTX, far from the origin.
    let centre = Vec3::new(3000.0, -500.0, 90.0);
    ptx(&at("before.ptx"), centre, &before);
    ptx(&at("after.ptx"), centre, &after);
    let (result, _) = compared(temp.path(), ["after.ptx", "before.ptx"], &[]);
    assert_eq!(
        result["viewpoints_m"][0],
        serde_json::json!([3000.0, -500.0, 90.0])
    );
    grown(&result);
    // A PTX around its origin.
    ptx(&at("before.ptx"), Vec3::zeros(), &before);
    let (result, _) = compared(temp.path(), ["after.xyz", "before.ptx"], &[]);
    grown(&result);

    // PCD: the viewpoint of the header, and one of each point.
    let header = |fields: &str, viewpoint: &str| {
        let n = fields.split(' ').count();
        let each = |value: &str| vec![value; n].join(" ");
        format!(
            "VERSION .7\nFIELDS {fields}\nSIZE {}\nTYPE {}\nCOUNT {}\nWIDTH {}\nHEIGHT 1\nVIEWPOINT {viewpoint} 1 0 0 0\n\
             POINTS {}\nDATA ascii\n",
            each("4"),
            each("F"),
            each("1"),
            before.len(),
            before.len()
        )
    };
    csv(&at("before.pcd"), &header("x y z", "0.5 0 0"), &before, "");
    let (result, _) = compared(temp.path(), ["after.xyz", "before.pcd"], &[]);
    grown(&result);
    let fields = header("x y z vp_x vp_y vp_z", "0 0 0");
    csv(&at("before.pcd"), &fields, &before, " 0.2 0 0.1");
    let (result, _) = compared(temp.path(), ["after.xyz", "before.pcd"], &[]);
    grown(&result);
    assert_eq!(result["viewpoints_m"].as_array().unwrap().len(), 1);

    // PLY with the origin of each beam, here of the compared cloud.
    let properties = ["x", "y", "z", "x_origin", "y_origin", "z_origin"];
    let properties = properties
        .map(|name| format!("property float {name}\n"))
        .concat();
    let header = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\n{properties}end_header\n",
        after.len()
    );
    csv(&at("after.ply"), &header, &after, " -0.2 0 0.1");
    let (result, _) = compared(temp.path(), ["after.ply", "before.xyz"], &[]);
    grown(&result);

    // Text with the place of the sensor, and LAS with it as extra dimensions: of a scanner that moves, here by a step of a
    // metre. Of two places in text, the first is taken.
    let header = "x y z vp_x vp_y vp_z sensor_x\n";
    csv(&at("before.txt"), header, &before, " 0.2 0 0.1 90");
    let (result, _) = compared(temp.path(), ["after.xyz", "before.txt"], &[]);
    grown(&result);
    assert_eq!(result["viewpoints_m"], serde_json::json!([[0.2, 0.0, 0.1]]));
    las(&at("before.las"), &before);
    let (result, _) = compared(temp.path(), ["after.xyz", "before.las"], &[]);
    grown(&result);
    assert_eq!(
        result["viewpoints_m"],
        serde_json::json!([[0.0, 0.0, 0.5], [1.0, 0.0, 0.5]])
    );
}

#[test]
fn the_pose_of_a_scan_in_e57_is_its_viewpoint() {
    let temp = tempfile::tempdir().unwrap();
    let write = |name: &str, points: &[Vec3]| {
        let path = temp.path().join(name);
        let mut file = e57::E57Writer::from_file(&path, "file").unwrap();
        let prototype = vec![
            e57::Record::CARTESIAN_X_F64,
            e57::Record::CARTESIAN_Y_F64,
            e57::Record::CARTESIAN_Z_F64,
        ];
        let mut scan = file.add_pointcloud("scan", prototype).unwrap();
        let (x, y, z) = (100.0, 200.0, 30.0);
        scan.set_transform(Some(e57::Transform {
            rotation: e57::Quaternion {
                w: 0.5f64.sqrt(),
                x: 0.0,
                y: 0.0,
                z: 0.5f64.sqrt(),
            },
            translation: e57::Translation { x, y, z },
        }));
        for p in points {
            let values = [p.x, p.y, p.z].map(e57::RecordValue::Double);
            scan.add_point(values.to_vec()).unwrap();
        }
        scan.finalize().unwrap();
        file.finalize().unwrap();
    };
    write("before.e57", &room(0.0, 1));
    write("after.e57", &room(0.01, 2));
    let (result, _) = compared(temp.path(), ["after.e57", "before.e57"], &[]);
    assert!(
        (result["mean_m"].as_f64().unwrap() - 0.01).abs() < 3e-4,
        "{result}"
    );
    assert_eq!(result["viewpoints_m"].as_array().unwrap().len(), 1);
    assert!(
        boresight(&["compare", "--help"])
            .out
            .contains("--viewpoint")
    );
}
