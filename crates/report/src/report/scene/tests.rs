//! Scenes are unpacked as the viewer unpacks them, and compared with equation (1) in double precision.

use std::io::Read as _;

use flate2::read::ZlibDecoder;
use serde_json::Value;

use super::packed::Packed;
use super::quantised::ROTATION_STEP;
use super::{Input, REFERENCE_STEP_M, Scan, Scene, View, gather, section};
use crate::comparison::{Agreements, ComparisonSettings, MountingKind};
use crate::geometry::{Bending, BodyFromScanner, Rotation, Vec3, WorldFromBody};
use crate::results::Drive;
use crate::sensor::{PoseRecord, ScanPoint};
use crate::trajectory::Trajectory;
use boresight_estimation::georeference::Georeferencer;

const OFFSET_S: f64 = 0.015;

/// A drive of two scanners, one of which scans in three dimensions, with a mounting that moves at the end.
struct Case {
    estimated: Trajectory,
    adjusted: Trajectory,
    mountings: [Vec<BodyFromScanner>; 2],
    bending: Vec<Bending>,
    points: [Vec<(u32, ScanPoint)>; 2],
    reference: Vec<Vec3>,
}

impl Case {
    fn new() -> Self {
        let pose = |time_s: f64, off: f64| {
            let rotation = Rotation::from_euler_angles(0.02 * time_s.sin(), off, 0.3 * time_s);
            let along = Vec3::new(0.4 * time_s, 30.0 + off, 1.9 + 0.01 * time_s.cos());
            PoseRecord::new(time_s, WorldFromBody::new(rotation, along))
        };
        let trajectory = |off: f64| {
            let times_s = (0..=200).map(|i| 1000.0 + 0.1 * f64::from(i));
            Trajectory::new(times_s.map(|time_s| pose(time_s, off)).collect()).unwrap()
        };
        let mounting = |off: f64| {
            let rotation = Rotation::from_euler_angles(-2.5 + off, off, 1.57);
            BodyFromScanner::new(rotation, Vec3::new(1.2, -0.5, 0.5 + off))
        };
        let point = |profile: u32, beam: u32, y: f64| {
            let angle = 0.01 * f64::from(beam) - 0.5;
            let position_m = Vec3::new(1.5 * angle.sin(), y, -1.5 * angle.cos());
            let time_s = 1000.0 + 0.04 * f64::from(profile);
            let intensity = 0.0;
            (
                profile,
                ScanPoint {
                    time_s,
                    position_m,
                    intensity,
                },
            )
        };
        let all = |y: f64| {
            let beams = (0..450).flat_map(|profile| (0..100).map(move |beam| (profile, beam)));
            beams
                .map(|(profile, beam)| point(profile, beam, y * f64::from(beam)))
                .collect()
        };
        let bending = Bending::sampled((1000.0, 1020.0), 0.05, |t| {
            [
                0.001 * t.sin(),
                0.0,
                0.002 * t.cos(),
                0.0005,
                0.001 * t.sin(),
                0.0,
            ]
        });
        Self {
            estimated: trajectory(0.0),
            adjusted: trajectory(0.003),
            mountings: [vec![mounting(0.02); 2], vec![mounting(0.0); 2]],
            bending: vec![bending.clone(), bending],
            points: [all(0.0), all(0.001)],
            reference: (0..1000)
                .map(|i| Vec3::new(0.01 * f64::from(i), 30.2, 0.123_456))
                .collect(),
        }
    }

    fn scene(&self, most_points: usize) -> Scene {
        let names = ["left", "right"];
        let scans = names.iter().zip(&self.points).map(|(name, points)| Scan {
            name,
            time_offset_s: OFFSET_S,
            total: 10 * points.len() as u64,
            points,
        });
        let view = |kind, trajectory, number: usize, bending| View {
            kind,
            trajectory,
            mountings: &self.mountings[number],
            bending,
        };
        gather(&Input {
            planes: &[],
            origin_m: Vec3::new(364_000.0, 5_620_000.0, 100.0),
            scans: scans.collect(),
            views: vec![
                view(MountingKind::Initial, &self.estimated, 0, &[]),
                view(MountingKind::Final, &self.adjusted, 1, &self.bending),
            ],
            agreements: &Agreements::default(),
            settings: &ComparisonSettings::default(),
            reference: &self.reference,
            most_points,
        })
        .expect("points and views")
    }
}

/// The lists of a scene, read from its bytes as `web/src/data/unpack.js` does.
struct Unpacked {
    header: Value,
    bytes: Vec<u8>,
}

impl Unpacked {
    fn of(scene: &Scene) -> Self {
        let packed = Packed::of(scene, "drive", &["initial", "calibrated"]);
        let mut bytes = Vec::new();
        ZlibDecoder::new(&packed.deflated[..])
            .read_to_end(&mut bytes)
            .unwrap();
        assert_eq!(packed.header["bytes"], bytes.len());
        Self {
            header: packed.header,
            bytes,
        }
    }

    /// A list of numbers: signed if they have 32 bits, otherwise unsigned.
    fn list(&self, place: &Value) -> Vec<f64> {
        let get = |name: &str| place[name].as_u64().unwrap() as usize;
        let (at, length, width) = (get("at"), get("length"), get("bits") / 8);
        let mut last = 0_u32;
        (0..length)
            .map(|i| {
                let byte = |plane: usize| u32::from(self.bytes[at + plane * length + i]);
                let value = (0..width)
                    .map(|plane| byte(plane) << (8 * plane))
                    .sum::<u32>();
                match width {
                    1 => return f64::from(value),
                    2 => last = (last + value) & 0xffff,
                    _ => last = last.wrapping_add(value),
                }
                if width == 4 {
                    f64::from(last as i32)
                } else {
                    f64::from(last)
                }
            })
            .collect()
    }

    fn axis(&self, range: &Value, points: usize) -> Vec<f64> {
        let [low, high] = ["low", "high"].map(|name| range[name].as_f64().unwrap());
        match &range["values"] {
            Value::Null => vec![low; points],
            place => {
                let step = (high - low) / 65535.0;
                self.list(place)
                    .iter()
                    .map(|value| low + step * value)
                    .collect()
            }
        }
    }

    fn transforms(&self, track: &Value) -> Vec<(Rotation, Vec3)> {
        let step_m = self.header["step_m"].as_f64().unwrap();
        let t: Vec<_> = (0..3)
            .map(|i| self.list(&track["translation"][i]))
            .collect();
        let q: Vec<_> = (0..4).map(|i| self.list(&track["rotation"][i])).collect();
        let one = |i: usize| {
            let component = |axis: usize| q[axis][i] * ROTATION_STEP;
            let [x, y, z, w] = [0, 1, 2, 3].map(component);
            let rotation = nalgebra::Quaternion::new(w, x, y, z);
            let translation = Vec3::new(t[0][i], t[1][i], t[2][i]) * step_m;
            (Rotation::new_normalize(rotation), translation)
        };
        (0..t[0].len()).map(one).collect()
    }
}

#[test]
fn unpacked_points_differ_by_no_more_than_the_quantisation() {
    let case = Case::new();
    let scene = case.scene(20_000);
    let unpacked = Unpacked::of(&scene);
    let header = &unpacked.header;
    let origin: Vec<f64> = serde_json::from_value(header["origin_m"].clone()).unwrap();
    let origin_m = Vec3::from_column_slice(&origin) - Vec3::new(364_000.0, 5_620_000.0, 100.0);
    let mut compared = 0;
    for (number, variant) in header["variants"].as_array().unwrap().iter().enumerate() {
        for (scanner, fan) in header["fans"].as_array().unwrap().iter().enumerate() {
            let points = fan["points"].as_u64().unwrap() as usize;
            let [x, y, z] = ["x_m", "y_m", "z_m"].map(|axis| unpacked.axis(&fan[axis], points));
            let [counts, times, numbers] =
                ["counts", "times", "numbers"].map(|name| unpacked.list(&fan[name]));
            let poses = &header["poses"][variant["poses"].as_u64().unwrap() as usize][scanner];
            let poses = unpacked.transforms(poses);
            let mean = &case.mountings[number][scanner];
            let moving = variant["moving"]
                .get(scanner)
                .map(|track| unpacked.transforms(track));
            let (trajectory, bending) = match number {
                0 => (&case.estimated, None),
                _ => (&case.adjusted, Some(&case.bending[scanner])),
            };
            let mut place = Georeferencer::new(trajectory, *mean, OFFSET_S).with_bending(bending);
            // Half a step each of the scanner's coordinates, of both translations, and of the rotations at the end of
            // a lever of two metres.
            let step = |axis: &str| {
                let ends = &fan[axis];
                (ends["high"].as_f64().unwrap() - ends["low"].as_f64().unwrap()) / 65535.0
            };
            let within_m = 0.5 * (step("x_m") + step("y_m") + step("z_m"))
                + 3.0 * scene.step_m
                + 2.0 * 8.0 * ROTATION_STEP;
            assert!(within_m < 5e-5);
            let mut point = 0;
            for profile in 0..counts.len() {
                let (rotation, translation) = &poses[profile];
                let moved = moving.as_ref().map(|track| track[profile]);
                let (turn, shift) = moved.unwrap_or((mean.rotation, mean.translation_m));
                let time_s = scene.start_s + scene.step_s * times[profile] - OFFSET_S;
                let exact_s = 1000.0 + 0.04 * numbers[profile];
                assert!((time_s - exact_s).abs() < 1e-6);
                for _ in 0..counts[profile] as usize {
                    let position_m = Vec3::new(x[point], y[point], z[point]);
                    let placed = translation + rotation * (shift + turn * position_m) + origin_m;
                    let beam = (position_m.x.atan2(-position_m.z) + 0.5) / 0.01;
                    let index = 100 * numbers[profile] as usize + beam.round() as usize;
                    let expected = place.place(&case.points[scanner][index].1).unwrap();
                    let off_m = (placed - expected).norm();
                    assert!(off_m <= within_m, "{off_m} instead of {within_m}");
                    point += 1;
                    compared += 1;
                }
            }
            assert_eq!(point, points);
        }
    }
    // The requested points and those around the places of sections, each compared with two mountings.
    assert!((39_000..80_000).contains(&compared), "{compared}");
    let axis = unpacked.list(&header["reference"]["axes"][2]);
    assert_eq!(axis.len(), 1000);
    let up_m = axis[7] * REFERENCE_STEP_M + origin_m.z;
    assert!((up_m - 0.123_456).abs() <= 0.5 * REFERENCE_STEP_M);
}

#[test]
fn equal_drives_give_equal_bytes() {
    let case = Case::new();
    let [a, b] = [case.scene(5000), case.scene(5000)].map(|scene| {
        let packed = Packed::of(&scene, "drive", &["initial", "calibrated"]);
        (packed.header.to_string(), packed.base64(), scene)
    });
    assert_eq!((&a.0, &a.1), (&b.0, &b.1));
    assert_eq!(a.2, b.2);
    // Equal poses are written once.
    let twice = |kind| View {
        kind,
        trajectory: &case.estimated,
        mountings: &case.mountings[0],
        bending: &[],
    };
    let scene = gather(&Input {
        planes: &[],
        origin_m: Vec3::zeros(),
        scans: vec![Scan {
            name: "left",
            time_offset_s: 0.0,
            total: 1,
            points: &case.points[0],
        }],
        views: vec![twice(MountingKind::Initial), twice(MountingKind::Final)],
        agreements: &Agreements::default(),
        settings: &ComparisonSettings::default(),
        reference: &[],
        most_points: 100,
    });
    assert_eq!(scene.map(|scene| scene.poses.len()), Some(1));
}

#[test]
fn names_cannot_close_the_script_that_contains_them() {
    let drive = || Drive {
        name: "</script><b>'&".into(),
        ..Drive::default()
    };
    let (drives, scenes) = ([drive(), drive()], [Some(Case::new().scene(500)), None]);
    let markup = section(&drives, &scenes);
    assert_eq!(markup, section(&drives, &scenes));
    let scripts = markup.matches("<script").count();
    assert_eq!((scripts, markup.matches("</script>").count()), (3, 3));
    assert!(!markup.contains("<b>") && markup.contains("&lt;b&gt;"));
    let begin = markup.find("id=\"scene-header\">").unwrap() + "id=\"scene-header\">".len();
    let end = begin + markup[begin..].find("</script>").unwrap();
    let header: Value = serde_json::from_str(&markup[begin..end]).unwrap();
    assert_eq!(header["drives"][0]["name"], drives[0].name);
    assert_eq!(header["drives"][0]["variants"][1]["name"], "calibrated");
    assert_eq!(section(&drives[1..], &scenes[1..]), "");
}
