//! The programs built with the manufacturer's library, and their output.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::str::{FromStr, SplitWhitespace};

use boresight::geometry::Vec3;
use boresight::sensor::GeographicFix;

/// Both programs, compiled.
pub struct Maker {
    folder: tempfile::TempDir,
}

/// The content of a file as the library reads it.
#[derive(Default)]
pub struct Reading {
    /// Number of intact frames by class and message.
    pub frames: BTreeMap<(u8, u8), u64>,
    /// Their bytes.
    pub frame_bytes: u64,
    pub imu: Vec<Imu>,
    pub utc: Vec<Utc>,
    pub headings: Vec<Heading>,
    pub positions: Vec<Position>,
}

/// A sample; values in rad/s, then m/s².
pub struct Imu {
    pub stamp_us: u32,
    pub status: u16,
    pub values: [f32; 6],
    /// The integers as sent; only for IMU_SHORT.
    pub raw: Option<[i32; 6]>,
}

pub struct Utc {
    pub stamp_us: u32,
    pub is_accurate: bool,
    pub unix_ns: i64,
}

pub struct Heading {
    pub stamp_us: u32,
    pub is_valid: bool,
    pub is_pitch_valid: bool,
    /// Heading and its accuracy, pitch and its accuracy.
    pub degrees: [f32; 4],
}

pub struct Position {
    pub stamp_us: u32,
    pub is_valid: bool,
    /// Latitude and longitude in degrees, altitude in metres.
    pub place: [f64; 3],
    pub undulation_m: f32,
    /// Accuracy of latitude, longitude, altitude.
    pub accuracy_m: [f32; 3],
}

impl Position {
    /// The position as a fix, without its time.
    pub fn fix(&self) -> GeographicFix {
        let [latitude, longitude, altitude_m] = self.place;
        let [north_m, east_m, up_m] = self.accuracy_m.map(f64::from);
        GeographicFix {
            time_s: 0.0,
            latitude_rad: latitude.to_radians(),
            longitude_rad: longitude.to_radians(),
            height_m: altitude_m + f64::from(self.undulation_m),
            sigma_m: Some(Vec3::new(east_m, north_m, up_m)),
            quality: None,
        }
    }
}

impl Maker {
    /// Builds both programs with the library that is installed in the folder BORESIGHT_SBGECOM.
    pub fn build() -> Self {
        let prefix = std::env::var("BORESIGHT_SBGECOM");
        let prefix = PathBuf::from(prefix.expect("BORESIGHT_SBGECOM names no library"));
        let folder = tempfile::tempdir().expect("no folder");
        let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/clock/sbgecom");
        for name in ["make", "read"] {
            let built = Command::new("cc")
                .args([
                    "-std=gnu99",
                    "-O2",
                    "-Wall",
                    "-DSBG_COMMON_STATIC_USE",
                    "-I",
                ])
                .arg(prefix.join("include"))
                .arg(sources.join(name).with_extension("c"))
                .arg("-o")
                .arg(folder.path().join(name))
                .arg("-L")
                .arg(prefix.join("lib"))
                .args(["-lsbgECom", "-lm"])
                .status();
            assert!(built.is_ok_and(|status| status.success()), "{name}.c");
        }
        Self { folder }
    }

    /// Starts to make and send a stream of some seconds.
    pub fn make(&self, seconds: u32, imu: &str, how: &str, to: &str) -> Child {
        let made = Command::new(self.folder.path().join("make"))
            .args([&seconds.to_string(), imu, how, to])
            .spawn();
        made.expect("make does not run")
    }

    /// Makes a stream of some seconds as a file; returns its bytes.
    pub fn make_file(&self, seconds: u32, imu: &str, path: &Path) -> Vec<u8> {
        let to = path.to_str().expect("a path");
        let ended = self.make(seconds, imu, "file", to).wait();
        assert!(ended.is_ok_and(|status| status.success()));
        std::fs::read(path).expect("no file was made")
    }

    /// Reads a file.
    pub fn read(&self, path: &Path) -> Reading {
        let read = Command::new(self.folder.path().join("read"))
            .arg(path)
            .output()
            .expect("read does not run");
        assert!(read.status.success(), "{}", path.display());
        let text = String::from_utf8(read.stdout).expect("text");
        let mut reading = Reading::default();
        for line in text.lines() {
            reading.take(line);
        }
        reading
    }
}

/// The next value of a line.
fn next<T: FromStr>(cells: &mut SplitWhitespace<'_>) -> T {
    let value = cells.next().and_then(|cell| cell.parse().ok());
    value.expect("a value is missing")
}

impl Reading {
    fn take(&mut self, line: &str) {
        let cells = &mut line.split_whitespace();
        let kind: String = next(cells);
        if kind == "frame" {
            let count = self.frames.entry((next(cells), next(cells))).or_default();
            *count += 1;
            self.frame_bytes += next::<u64>(cells);
            return;
        }
        let stamp_us = next(cells);
        match kind.as_str() {
            "imu_short" => {
                let status = next(cells);
                let pairs: [(i32, f32); 6] = std::array::from_fn(|_| (next(cells), next(cells)));
                self.imu.push(Imu {
                    stamp_us,
                    status,
                    values: pairs.map(|(_, value)| value),
                    raw: Some(pairs.map(|(raw, _)| raw)),
                });
            }
            "imu_data" => self.imu.push(Imu {
                stamp_us,
                status: next(cells),
                values: std::array::from_fn(|_| next(cells)),
                raw: None,
            }),
            "utc" => {
                let [status, accurate, _clock]: [i64; 3] = std::array::from_fn(|_| next(cells));
                let date: [i64; 3] = std::array::from_fn(|_| next(cells));
                let [hour, minute, second, ns]: [i64; 4] = std::array::from_fn(|_| next(cells));
                assert_eq!(date[..2], [2024, 2]);
                // 2024-02-01T00:00:00Z.
                let day_s = 1_706_745_600 + 86_400 * (date[2] - 1);
                // Without known leap seconds it is not UTC.
                if status == 2 {
                    self.utc.push(Utc {
                        stamp_us,
                        is_accurate: accurate == 1,
                        unix_ns: 1_000_000_000 * (day_s + 3600 * hour + 60 * minute + second) + ns,
                    });
                }
            }
            "hdt" => self.headings.push(Heading {
                stamp_us,
                is_valid: next::<u8>(cells) == 1,
                is_pitch_valid: next::<u8>(cells) == 1,
                degrees: std::array::from_fn(|_| next(cells)),
            }),
            "pos" => {
                let [status, solution]: [u8; 2] = std::array::from_fn(|_| next(cells));
                let position = Position {
                    stamp_us,
                    is_valid: false,
                    place: std::array::from_fn(|_| next(cells)),
                    undulation_m: next(cells),
                    accuracy_m: std::array::from_fn(|_| next(cells)),
                };
                // The library does not report whether a position is valid; an accuracy of 9999 m stands for none.
                let has_accuracy = position.accuracy_m.iter().all(|&it| it < 9999.0);
                self.positions.push(Position {
                    is_valid: status == 0 && solution != 0 && has_accuracy,
                    ..position
                });
            }
            other => panic!("{other}"),
        }
    }
}
