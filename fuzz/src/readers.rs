//! The readers of each fuzz target. An input is read like a user's file, by its path. The replay of the corpora in
//! `tests/clock/corpora.rs` does the same.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use boresight::Result;
use boresight::cloud::PointCloud;
use boresight::format;
use boresight::nalgebra::Vector3;
use boresight::sensor::{Observations, TotalStation};

/// Longest time that a reader may take for a file of a few kilobytes.
const LONGEST: Duration = Duration::from_secs(1);

/// Formats that are fuzzed together.
pub struct Target {
    /// Name of the target and of the folder with its corpus.
    pub name: &'static str,
    /// Names of the file. With the first name every reader is called, with the others only the readers of the
    /// format's contents.
    pub files: &'static [&'static str],
    /// Parts of a recording that are read by name.
    pub parts: &'static [&'static str],
}

/// A target without parts.
const fn of(name: &'static str, files: &'static [&'static str]) -> Target {
    Target {
        name,
        files,
        parts: &[],
    }
}

/// All targets of readers.
pub const TARGETS: [Target; 12] = [
    of("las", &["input.las"]),
    of("e57", &["input.e57"]),
    of("ply", &["input.ply"]),
    of("pcd", &["input.pcd"]),
    of("npy", &["input.npy"]),
    of("parquet", &["input.parquet"]),
    of(
        "text",
        &[
            "input.csv",
            "input.pts",
            "input.ptx",
            "input.xyz",
            "input.trj",
            "input.tum",
            "timestamps.txt",
        ],
    ),
    of("bonn", &["input.bin", "input.trj"]),
    of("sbg", &["input.log"]),
    Target {
        parts: &["imu", "odom", "pose_cov", "scan", "ouster", "hesai"],
        ..of("ros", &["input.bag"])
    },
    of("sbet", &["input.sbet"]),
    of("any", &["input.dat"]),
];

/// The target of this name.
pub fn target(name: &str) -> Option<&'static Target> {
    TARGETS.iter().find(|target| target.name == name)
}

/// A folder for one input at a time, with the files that some formats expect beside it.
pub struct Scratch {
    folder: PathBuf,
}

impl Scratch {
    /// Fills `folder`, which must be empty, with the times of KITTI poses and the records of KITTI time stamps.
    ///
    /// # Errors
    /// The folder cannot be written.
    pub fn new(folder: &Path) -> std::io::Result<Self> {
        let data = folder.join("data");
        std::fs::create_dir_all(&data)?;
        let times: Vec<String> = (0..40).map(|i| format!("{i}.5\n")).collect();
        std::fs::write(folder.join("times.txt"), times.concat())?;
        let record: Vec<String> = (0..30).map(|i| format!("{i}.5")).collect();
        for i in 0..4 {
            std::fs::write(data.join(format!("{i:010}.txt")), record.join(" "))?;
        }
        Ok(Self {
            folder: folder.to_owned(),
        })
    }
}

/// Calls `around` for each reader of `target`, with a function that makes the reader read `bytes`.
///
/// # Panics
/// If a reader takes more than a second, if an error does not name the file, or if a result contradicts the
/// documentation of the reader.
pub fn read_all(
    target: &Target,
    scratch: &Scratch,
    bytes: &[u8],
    around: &mut dyn FnMut(&mut dyn FnMut()),
) {
    for (i, file) in target.files.iter().enumerate() {
        let path = scratch.folder.join(file);
        std::fs::write(&path, bytes).expect("the input is written");
        let known = format::detect(&path).ok();
        for (name, read, has) in READERS {
            if i == 0 || known.is_some_and(has) {
                around(&mut || timed(name, read, &path));
            }
        }
        for part in target.parts {
            let part = PathBuf::from(format!("{}#/{part}", path.display()));
            for (name, read, _) in READERS.iter().filter(|reader| PARTED.contains(&reader.0)) {
                around(&mut || timed(name, *read, &part));
            }
        }
        std::fs::remove_file(&path).expect("the input is removed");
    }
}

/// Calls a reader, and repeats the call if it was slow, as the machine may have been busy.
fn timed(name: &str, read: Reader, path: &Path) {
    let mut fastest = Duration::MAX;
    for _ in 0..3 {
        let start = Instant::now();
        let outcome = read(path);
        fastest = fastest.min(start.elapsed());
        if let Err(error) = outcome {
            // The error must name the file or a companion file.
            let file = format::file_of(path);
            let folder = file.parent().map(|folder| folder.display().to_string());
            let text = error.to_string();
            assert!(
                folder.is_some_and(|folder| text.contains(&folder)),
                "{name}: the error does not name the file: {text}"
            );
        }
        if fastest <= LONGEST {
            return;
        }
    }
    panic!("{name} takes {fastest:?}");
}

type Reader = fn(&Path) -> Result<()>;

/// Name, reader, and whether the reader reads contents of a format.
type Entry = (&'static str, Reader, fn(format::Format) -> bool);

/// Readers that can be given a part of a file.
const PARTED: [&str; 3] = ["read_imu", "read_trajectory", "open_profiles"];

const READERS: [Entry; 15] = [
    ("detect", |path| format::detect(path).map(drop), |_| true),
    ("inspect", inspect, |_| true),
    ("read_imu", read_imu, |format| format.has_imu()),
    ("read_heading", read_heading, |format| format.has_heading()),
    ("read_positions", read_positions, |format| {
        format.has_positions()
    }),
    ("read_positions (polar)", read_polar, |format| {
        format.has_positions()
    }),
    ("read_trajectory", read_trajectory, |format| {
        format.has_poses()
    }),
    ("read_geographic", read_geographic, |format| {
        format.has_geographic()
    }),
    ("read_geographic_poses", read_geographic_poses, |format| {
        format.has_geographic_poses()
    }),
    ("read_cloud", read_cloud, |format| format.has_cloud()),
    ("open_profiles", read_profiles, |format| {
        format.has_profiles()
    }),
    (
        "read_mounting",
        |path| format::read_mounting(path).map(drop),
        |_| false,
    ),
    ("read_core_points", read_core_points, |format| {
        format.has_cloud()
    }),
    ("read_frame_log", read_frame_log, |_| false),
    ("salvage", salvage, |_| false),
];

fn inspect(path: &Path) -> Result<()> {
    let found = format::inspect(path)?;
    assert!(found.bounds.iter().all(|bounds| bounds.min <= bounds.max));
    Ok(())
}

fn read_imu(path: &Path) -> Result<()> {
    let samples = format::read_imu(path)?;
    assert!(!samples.is_empty(), "no sample and no error");
    assert!(samples.iter().all(|s| s.time_s.is_finite()));
    assert!(
        samples
            .iter()
            .all(|s| is_finite(&s.gyro_rad_s) && is_finite(&s.accel_m_s2))
    );
    Ok(())
}

fn read_heading(path: &Path) -> Result<()> {
    let fixes = format::read_heading(path)?;
    assert!(!fixes.is_empty(), "no heading and no error");
    assert!(
        fixes
            .iter()
            .all(|fix| fix.time_s.is_finite() && fix.heading_rad.is_finite())
    );
    Ok(())
}

fn read_positions(path: &Path) -> Result<()> {
    positions(path, &Observations::AsFound)
}

fn read_polar(path: &Path) -> Result<()> {
    let instrument = TotalStation {
        station_m: Vector3::new(1.0, 2.0, 3.0),
        orientation_rad: 0.5,
        vertical: Default::default(),
        reflector_constant_m: 0.01,
        sigma_distance_m: 0.001,
        sigma_distance_ppm: 1.0,
        sigma_angle_rad: 1e-5,
        sigma_prism_m: 0.002,
    };
    positions(path, &Observations::Polar(instrument))
}

fn positions(path: &Path, observations: &Observations) -> Result<()> {
    let found = format::read_positions(path, observations)?;
    assert!(!found.fixes.is_empty(), "no position and no error");
    assert!(
        found
            .fixes
            .iter()
            .all(|fix| fix.time_s.is_finite() && is_finite(&fix.position_m))
    );
    Ok(())
}

fn read_geographic(path: &Path) -> Result<()> {
    let fixes = format::read_geographic(path)?;
    assert!(!fixes.is_empty(), "no position and no error");
    for fix in &fixes {
        let place = [
            fix.time_s,
            fix.latitude_rad,
            fix.longitude_rad,
            fix.height_m,
        ];
        assert!(place.iter().all(|value| value.is_finite()), "{fix:?}");
    }
    Ok(())
}

fn read_geographic_poses(path: &Path) -> Result<()> {
    for pose in format::read_geographic_poses(path)? {
        let place = [
            pose.time_s,
            pose.latitude_rad,
            pose.longitude_rad,
            pose.height_m,
        ];
        assert!(place.iter().all(|value| value.is_finite()), "{pose:?}");
        let norm = pose.angles.rotation().quaternion().norm();
        assert!((norm - 1.0).abs() < 1e-6, "a quaternion of length {norm}");
    }
    Ok(())
}

fn read_trajectory(path: &Path) -> Result<()> {
    let poses = format::read_trajectory(path)?;
    assert!(!poses.is_empty(), "no pose and no error");
    assert!(poses.iter().all(|pose| pose.time_s.is_finite()));
    assert!(
        poses.is_sorted_by(|a, b| a.time_s < b.time_s),
        "times that do not increase"
    );
    for pose in &poses {
        let at = &pose.world_from_body;
        assert!(
            is_finite(&at.translation_m),
            "a position that is not finite"
        );
        let norm = at.rotation.quaternion().norm();
        assert!((norm - 1.0).abs() < 1e-6, "a quaternion of length {norm}");
    }
    Ok(())
}

fn read_cloud(path: &Path) -> Result<()> {
    let PointCloud {
        points,
        time_s,
        intensity,
    } = format::read_cloud(path)?;
    assert!(!points.is_empty(), "no point and no error");
    assert!(points.iter().all(is_finite), "a point that is not finite");
    for count in [time_s.len(), intensity.len()] {
        assert!(
            count == 0 || count == points.len(),
            "{count} of {}",
            points.len()
        );
    }
    Ok(())
}

fn read_profiles(path: &Path) -> Result<()> {
    let mut reader = format::open_profiles(path)?;
    let (mut chunk, mut last_s, mut count) = (Vec::new(), f64::NEG_INFINITY, 0);
    while reader.next_chunk(&mut chunk)? {
        assert!(!chunk.is_empty(), "an empty chunk");
        count += chunk.len();
        for point in &chunk {
            assert!(
                point.time_s >= last_s,
                "time {} s after {last_s} s",
                point.time_s
            );
            assert!(is_finite(&point.position_m), "a point that is not finite");
            last_s = point.time_s;
        }
    }
    assert!(chunk.is_empty(), "points after the end");
    assert!(count > 0, "no point and no error");
    Ok(())
}

fn read_core_points(path: &Path) -> Result<()> {
    let core = format::read_core_points(path)?;
    assert!(!core.points.is_empty(), "no point and no error");
    assert!(core.points.iter().chain(&core.normals).all(is_finite));
    assert!(core.normals.is_empty() || core.normals.len() == core.points.len());
    Ok(())
}

fn read_frame_log(path: &Path) -> Result<()> {
    let names = ["temperature_c", "load"].map(str::to_owned);
    let log = format::read_frame_log(path, &names[..1]);
    format::read_frame_log(path, &names)?;
    assert!(!log?.rows.is_empty(), "no row and no error");
    Ok(())
}

/// Checks that salvaging accounts for every byte of the input, if that is not compressed. A recording of ROS loses its index, or gains an end:
/// its copy is whole.
fn salvage(path: &Path) -> Result<()> {
    let is_recording = format::detect(path).is_ok_and(|found| found.id() == "ros-bag");
    let [kept, again] = ["kept.csv", "again.csv"].map(|name| path.with_file_name(name));
    let outcome = format::salvage(path, &kept);
    let second = outcome.is_ok().then(|| format::salvage(&kept, &again));
    let size = |path: &Path| std::fs::metadata(path).map_or(0, |found| found.len());
    let [whole, copy] = [path, &kept].map(size);
    let start = std::fs::read(path).unwrap_or_default();
    let is_packed =
        start.starts_with(&[0x1f, 0x8b]) || start.starts_with(&[0x28, 0xb5, 0x2f, 0xfd]);
    let copies = [&kept, &again].map(|path| std::fs::read(path).unwrap_or_default());
    let _ = std::fs::remove_file(kept);
    let _ = std::fs::remove_file(again);
    let found = outcome?;
    if is_recording {
        let second = second.expect("a copy").expect("a recording");
        assert_eq!((second.kept, second.dropped_bytes), (found.kept, 0));
        assert!(copies[0] == copies[1], "a copy of a copy differs");
    } else if !is_packed {
        assert_eq!(whole, copy + found.dropped_bytes);
    }
    Ok(())
}

fn is_finite(v: &Vector3<f64>) -> bool {
    v.iter().all(|x| x.is_finite())
}
