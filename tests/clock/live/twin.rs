//! A recording of a simulated drive as its sensors would have sent it: the IMU by sbgECom with UTC, headings by NMEA,
//! the prism as polar observations of a total station, the scanners by their data channels, each with a separate clock.

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::Path;

use boresight::format;
use boresight::format::gocator_stream::{Encoder, Scales, ScannerFrame, ScannerSettings, data_set};
use boresight::sensor::Observations;

/// UTC at the beginning of the recording.
const BEGIN_S: f64 = 1_764_000_000.0;
/// Time from there to the first sample.
const LEAD_S: f64 = 3.0;
/// Position of the total station.
const STATION_M: [f64; 3] = [-12.0, -9.0, 1.6];
/// Time from a measurement of the prism to its arrival.
pub const STATION_DELAY_S: f64 = 0.005;
/// Time from a profile to its arrival, and relative drift of the scanner's clock, which is slow.
const SCANNER_DELAY_S: f64 = 0.002;
const SCANNER_DRIFT: f64 = 2e-5;
/// Step of the scanner's coordinates, which then reach 0.98 m, and most points of a profile.
pub const STEP_NM: u32 = 30_000;
const MOST_POINTS: u32 = 320;
/// The data channel sends z in the scanner frame plus this stand-off.
const STAND_OFF_M: f64 = 1.150;

/// A log, and the times of arrival of its pieces.
struct Log {
    data: BufWriter<File>,
    stamps: BufWriter<File>,
    bytes: usize,
}

impl Log {
    fn new(folder: &Path, name: &str, extension: &str) -> Self {
        let create =
            |end: &str| BufWriter::new(File::create(folder.join(format!("{name}.{end}"))).unwrap());
        let mut stamps = create("stamps.csv");
        stamps
            .write_all(b"bytes_before,monotonic_s,unix_s\n")
            .unwrap();
        Self {
            data: create(extension),
            stamps,
            bytes: 0,
        }
    }

    fn add(&mut self, bytes: &[u8], at_s: f64) {
        let unix_s = BEGIN_S + at_s;
        writeln!(self.stamps, "{},{at_s:.6},{unix_s:.6}", self.bytes).unwrap();
        self.data.write_all(bytes).unwrap();
        self.bytes += bytes.len();
    }
}

/// Writes the recording of a project's drive into a folder.
pub fn record(project: &Path, into: &Path) {
    fs::create_dir_all(into).unwrap();
    let drive = project.parent().unwrap();
    let imu = format::read_imu(&drive.join("imu.csv")).unwrap();
    let zero_s = imu[0].time_s - LEAD_S;
    let since = |time_s: f64| time_s - zero_s;
    let end_s = since(imu.last().unwrap().time_s) + 1.0;

    let mut log = Log::new(into, "ins", "sbg");
    let mut next_utc_s = 0.0;
    for sample in &imu {
        let at_s = since(sample.time_s);
        if at_s >= next_utc_s {
            next_utc_s = at_s + 1.0;
            log.add(&utc_frame(at_s), at_s + 0.001);
        }
        log.add(
            &imu_frame(at_s, sample.accel_m_s2.into(), sample.gyro_rad_s.into()),
            at_s + 0.001,
        );
    }

    let mut log = Log::new(into, "compass", "nmea");
    for fix in format::read_heading(&drive.join("heading.csv")).unwrap() {
        let at_s = since(fix.time_s);
        let day_s = (BEGIN_S + at_s).rem_euclid(86_400.0);
        let (hours, rest) = ((day_s / 3600.0).floor(), day_s % 3600.0);
        let time = format!(
            "{hours:02.0}{:02.0}{:09.6}",
            (rest / 60.0).floor(),
            rest % 60.0
        );
        let heading_deg = fix.heading_rad.to_degrees().rem_euclid(360.0);
        let text = sentence(&format!("GPZDA,{time},24,11,2025,00,00"))
            + &sentence(&format!("GPHDT,{heading_deg:.9},T"));
        log.add(text.as_bytes(), at_s + 0.004);
    }

    let mut station = "time_s,slope_distance_m,horizontal_deg,vertical_deg,status,monotonic_s,round_trip_s,synchronous,\
                       instrument_time_s\n"
        .to_owned();
    let prism = format::read_positions(&drive.join("prism.csv"), &Observations::AsFound).unwrap();
    for fix in prism.fixes {
        let [e, n, u]: [f64; 3] = std::array::from_fn(|i| fix.position_m[i] - STATION_M[i]);
        let (level_m, at_s) = (e.hypot(n), since(fix.time_s));
        station += &format!(
            "{:.6},{:.9},{:.12},{:.12},0,{:.6},0.01,1,{at_s:.6}\n",
            BEGIN_S + at_s,
            level_m.hypot(u),
            e.atan2(n).to_degrees().rem_euclid(360.0),
            level_m.atan2(u).to_degrees(),
            at_s + STATION_DELAY_S
        );
    }
    fs::write(into.join("station.csv"), station).unwrap();

    for (number, name) in ["left", "right"].into_iter().enumerate() {
        scanner(
            &drive.join(format!("{name}.bin")),
            into,
            name,
            number,
            since,
        );
    }

    let mut clock = "unix_s,monotonic_s,reference,offset_s,rms_s,is_locked,set_s\n".to_owned();
    for second in 0..end_s as u32 {
        clock += &format!(
            "{:.6},{second}.000000,PPS,1e-7,2e-7,1,\n",
            BEGIN_S + f64::from(second)
        );
    }
    fs::write(into.join("clock.csv"), clock).unwrap();
    fs::write(into.join("events.csv"), "unix_s,monotonic_s,source,event\n").unwrap();
    fs::write(into.join("field.toml"), field(project)).unwrap();
    let field = boresight::record::Field::read(&into.join("field.toml")).unwrap();
    fs::write(into.join("project.toml"), field.project_text().unwrap()).unwrap();
}

/// Writes the profiles of a `.bin` file as a scanner log, with a clock that began at another time and is slow.
fn scanner(bin: &Path, into: &Path, name: &str, number: usize, since: impl Fn(f64) -> f64) {
    let settings = ScannerSettings {
        serial_number: 24_001 + number as u32,
        scales: Scales {
            x_scale_nm: STEP_NM,
            z_scale_nm: STEP_NM,
            x_offset_um: 0,
            z_offset_um: 0,
        },
        width: MOST_POINTS,
        ..ScannerSettings::default()
    };
    let mut log = Log::new(into, name, "gocator");
    let mut encoder = Encoder::default();
    let mut frame: Option<(f64, ScannerFrame)> = None;
    let mut count = 0;
    let mut send = |frame: Option<(f64, ScannerFrame)>, log: &mut Log| {
        let Some((at_s, frame)) = frame else { return };
        data_set(&mut encoder, &settings, count, &[frame]);
        count += 1;
        log.add(&encoder.take(), at_s + SCANNER_DELAY_S);
    };
    let mut reader = format::open_profiles(bin).unwrap();
    let mut points = Vec::new();
    while reader.next_chunk(&mut points).unwrap() {
        for point in &points {
            let at_s = since(point.time_s);
            if frame.as_ref().is_none_or(|(time_s, _)| *time_s != at_s) {
                let done = frame.replace((
                    at_s,
                    ScannerFrame {
                        time_us: 1e6 * (at_s * (1.0 - SCANNER_DRIFT) + 100.0 * (1 + number) as f64),
                        points_m: Vec::new(),
                        intensity: Some(Vec::new()),
                    },
                ));
                send(done, &mut log);
            }
            if let Some((_, frame)) = &mut frame {
                let [x, _, z]: [f64; 3] = point.position_m.into();
                frame.points_m.push([x, z + STAND_OFF_M]);
                frame
                    .intensity
                    .iter_mut()
                    .for_each(|all| all.push(point.intensity as u8));
            }
        }
    }
    send(frame, &mut log);
}

/// The text of `field.toml`: the sources, and the project with sources instead of files.
fn field(project: &Path) -> String {
    let drive = project.parent().unwrap();
    let mut written: toml::Table = fs::read_to_string(project).unwrap().parse().unwrap();
    written.remove("evaluation");
    for (table, source) in [("imu", "ins"), ("heading", "compass"), ("prism", "station")] {
        let table = written[table].as_table_mut().unwrap();
        table.remove("file");
        table.insert("source".into(), source.into());
    }
    let prism = written["prism"].as_table_mut().unwrap();
    prism.insert("station_m".into(), STATION_M.to_vec().into());
    prism.insert("station_orientation_deg".into(), 0.0.into());
    // All noise is already in the coordinates.
    prism.insert("sigma_distance_m".into(), 1e-6.into());
    prism.insert("sigma_angle_arcsec".into(), 1e-3.into());
    for scanner in written["scanner"].as_array_mut().unwrap() {
        let scanner = scanner.as_table_mut().unwrap();
        let name = scanner["name"].clone();
        scanner.remove("profiles");
        scanner.insert("source".into(), name);
    }
    let reference = written["reference"].as_table_mut().unwrap();
    let file = drive.join(reference["file"].as_str().unwrap());
    reference.insert("file".into(), file.to_str().unwrap().into());
    let mut all = toml::Table::new();
    all.insert("project".into(), written.into());
    let text = "[[source]]\nname = \"ins\"\nkind = \"sbg\"\naddress = \"udp://0.0.0.0:5000\"\n\
                [[source]]\nname = \"compass\"\nkind = \"nmea\"\nport = \"/dev/ttyUSB0\"\n\
                [[source]]\nname = \"station\"\nkind = \"geocom\"\nport = \"/dev/ttyUSB1\"\nprogram = 10\n\
                [[source]]\nname = \"left\"\nkind = \"gocator\"\naddress = \"192.168.1.10:3196\"\n\
                [[source]]\nname = \"right\"\nkind = \"gocator\"\naddress = \"192.168.1.11:3196\"\n";
    format!("{text}{}", toml::to_string(&all).unwrap())
}

fn sentence(body: &str) -> String {
    let sum = body.bytes().fold(0, |sum, byte| sum ^ byte);
    format!("${body}*{sum:02X}\r\n")
}

/// An sbgECom frame.
fn sbg_frame(message: u8, payload: &[u8]) -> Vec<u8> {
    let mut frame = vec![0xff, 0x5a, message, 0];
    frame.extend_from_slice(&(payload.len() as u16).to_le_bytes());
    frame.extend_from_slice(payload);
    let crc = frame[2..].iter().fold(0_u16, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte), |crc, _| {
            (crc >> 1) ^ if crc & 1 == 1 { 0x8408 } else { 0 }
        })
    });
    frame.extend_from_slice(&crc.to_le_bytes());
    frame.push(0x33);
    frame
}

/// The clock of the device, microseconds.
fn device_us(at_s: f64) -> u32 {
    (1e6 * (at_s + 40.0)).round() as u32
}

fn imu_frame(at_s: f64, accel_m_s2: [f64; 3], gyro_rad_s: [f64; 3]) -> Vec<u8> {
    let mut payload = device_us(at_s).to_le_bytes().to_vec();
    // Communication with the IMU works, and all sensors are healthy.
    payload.extend_from_slice(&0x01ff_u16.to_le_bytes());
    let accel = accel_m_s2.map(|value| (value * 1_048_576.0).round() as i32);
    let gyro = gyro_rad_s.map(|value| (value * 67_108_864.0).round() as i32);
    for value in accel.into_iter().chain(gyro) {
        payload.extend_from_slice(&value.to_le_bytes());
    }
    payload.extend_from_slice(&2500_i16.to_le_bytes());
    sbg_frame(44, &payload)
}

fn utc_frame(at_s: f64) -> Vec<u8> {
    let unix_s = BEGIN_S + f64::from(device_us(at_s)) * 1e-6 - 40.0;
    let second_of_day = unix_s.rem_euclid(86_400.0);
    let [hour, minute, second] = [3600.0, 60.0, 1.0].map(|unit| (second_of_day / unit).floor());
    let mut payload = device_us(at_s).to_le_bytes().to_vec();
    // UTC with leap seconds, aligned to the pulse.
    payload.extend_from_slice(&(2_u16 << 6 | 1 << 5 | 1).to_le_bytes());
    payload.extend_from_slice(&2025_u16.to_le_bytes());
    payload.extend_from_slice(&[
        11,
        24,
        hour as u8,
        (minute % 60.0) as u8,
        (second % 60.0) as u8,
    ]);
    let nanosecond = (1e9 * second_of_day.fract()).round() as u32;
    payload.extend_from_slice(&nanosecond.to_le_bytes());
    payload.extend_from_slice(&0_u32.to_le_bytes());
    sbg_frame(2, &payload)
}
