//! Logs from the manufacturer's library, and logs from a writer that shares no code with the reader.

use super::*;
use crate::geometry::Vec3;
use crate::sensor::FixQuality;

/// A log written by the manufacturer's library, sbgECom 5.2.590: five IMU_SHORT 1 ms apart, the third
/// turning fast, with two UTC_TIME, an IMU_DATA, an EKF_EULER, and two GPS1_HDT and GPS1_POS each. The
/// first GPS1_HDT and the first GPS1_POS have no solution. The clock rolls over before the fourth
/// IMU_SHORT.
const MANUFACTURER_LOG: &str = "\
    ff5a2c0020003cf6ffffff036c5ce803506ba604a0b2120484787ffd49e88effdecb0dff401fed8433ff5a020021\
    003cf6ffffa600e807021c173a3b7067de3ae80300000000c07f0000c07f0000c07f9c7133ff5a2c00200024faff\
    ffff03e06c55ff36b43e014569d50080eff20300021d01b4a6a401401feaf133ff5a03003a0024faffffff035638\
    46c2dfe3fec196e2fb401229ee3e52f697402d4d1b400000a041563846c2dfe3fec196e2fb401229ee3e52f69740\
    2d4d1b4096cc33ff5a0f002000f8f8ffff4100050000002f762d4315e48b3fa0598441f4223c400000803fffff97\
    f233ff5a0e003e005cf9ffff41d265a80000000090b4d1b6071928c0985449356ceb49c096d61d5c9b22a5402a51\
    89c0b5861d4059c5823eea5b9240ffffffffffff11010000e0bb33ff5a2c0020000cfeffffff076830370300b5ce\
    022031e7fe802accbfd01d95f4400815c3401fe19533ff5a060028000cfeffff9e36ecbf9077f73f3400bb3f0ad7\
    233c0ad7233c0ad7233c0000000000000000000000002ece33ff5a2c002000f4010000ff038405bc030e94f20120\
    f5fb0424e80fffa4ea540210aa3c03401f357a33ff5a0f002000c800000000000500000026a18943bbeffb3c4a79\
    304289dc853f0000803fffffacac33ff5a0e003e002c010000008227e400000000d44f1cf3acba42c0204c31f6d4\
    4f23405284f783fa0ba040710afbc1496135405ed498402a2c1840ffffffffffff11010000ff8233ff5a2c002000\
    dc050000ff03ac88f0fcfe5f96004444be03b4a391fc04acb9fc907b7efe401fa52733ff5a02002100dc050000a6\
    00e807021c173a3b70701b3be80300000000c07f0000c07f0000c07f1c5233";
/// Values that the manufacturer's library reads from this log: rad/s, then m/s².
const IMU_OF_MANUFACTURER: [[f64; 6]; 5] = [
    [
        -0.625516832,
        -0.110442027,
        -0.236526996,
        62.5225639,
        74.4011993,
        65.1686096,
    ],
    [
        0.987241745,
        0.278327942,
        0.410792172,
        -10.6609192,
        19.9189968,
        13.3382006,
    ],
    [
        -87.5425568,
        -15.5682211,
        -83.0638275,
        51.4493179,
        44.9191895,
        -17.5505066,
    ],
    [
        -0.234466016,
        0.582926333,
        0.809242487,
        59.7513466,
        31.1611462,
        79.747345,
    ],
    [
        -0.85777396,
        -0.81867975,
        -0.376481771,
        -48.9666328,
        9.39843559,
        59.8916664,
    ],
];
const FIRST_STAMP_US: u32 = 4_294_964_796;
/// 2024-02-28T23:58:59.987654Z, the UTC of that stamp.
const FIRST_UTC_S: f64 = 1_709_164_739.987_654;

pub(super) fn manufacturer_log() -> Vec<u8> {
    let digits = MANUFACTURER_LOG.as_bytes().chunks(2);
    let byte = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap();
    digits.map(byte).collect()
}

/// Calls `check` with the path of a file with this content.
pub(super) fn with_file<T>(content: &[u8], check: impl FnOnce(&Input) -> T) -> T {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.bin");
    std::fs::write(&path, content).unwrap();
    check(&Input::from(&path))
}

/// A frame; the CRC is computed bit by bit, as the manufacturer describes it.
pub(super) fn frame((class, message): Kind, payload: &[u8]) -> Vec<u8> {
    let mut checked = vec![message, class];
    checked.extend((payload.len() as u16).to_le_bytes());
    checked.extend(payload);
    let mut crc = 0_u16;
    for byte in &checked {
        crc ^= u16::from(*byte);
        for _ in 0..8 {
            let carry = crc % 2;
            crc = (crc / 2) ^ (carry * 0x8408);
        }
    }
    [&[0xff, 0x5a], &checked[..], &crc.to_le_bytes(), &[0x33]].concat()
}

pub(super) fn imu_short(stamp_us: u32, state: u16, gyro: [i32; 3], accel: [i32; 3]) -> Vec<u8> {
    let mut payload = [&stamp_us.to_le_bytes()[..], &state.to_le_bytes()].concat();
    for value in accel.into_iter().chain(gyro) {
        payload.extend(value.to_le_bytes());
    }
    payload.extend([0, 20]);
    frame(IMU_SHORT, &payload)
}

/// IMU_DATA with the same value in all three axes; the first of the two sets must not be read.
fn imu_data(stamp_us: u32, gyro: f32, accel: f32) -> Vec<u8> {
    let mut payload = [&stamp_us.to_le_bytes()[..], &[0xff, 0x03]].concat();
    for value in [[-1.0; 7], [accel, accel, accel, gyro, gyro, gyro, 0.0]].concat() {
        payload.extend(value.to_le_bytes());
    }
    payload.truncate(58);
    frame(IMU_DATA, &payload)
}

/// UTC_TIME of 2024-01-01 as older firmware sends it, without the state of the clock.
fn utc_time(stamp_us: u32, state: u16, time: [u8; 3], ns: u32) -> Vec<u8> {
    let mut payload = [&stamp_us.to_le_bytes()[..], &state.to_le_bytes()].concat();
    payload.extend(2024_u16.to_le_bytes());
    payload.extend([1, 1]);
    payload.extend(time);
    payload.extend(ns.to_le_bytes());
    payload.extend([0; 4]);
    frame(UTC_TIME, &payload)
}
/// States of UTC_TIME: leap seconds known and aligned to the pulse; not aligned; not valid.
const ALIGNED: u16 = 2 << 6 | 1 << 5 | 3 << 1 | 1;
const NOT_ALIGNED: u16 = 2 << 6 | 1 << 1;
const NOT_VALID: u16 = 1 << 5 | 3 << 1;
/// 2024-01-01T00:00:00Z.
const YEAR_S: f64 = 1_704_067_200.0;

fn heading(kind: Kind, stamp_us: u32, status: u16, degrees: [f32; 4]) -> Vec<u8> {
    let mut payload = [&stamp_us.to_le_bytes()[..], &status.to_le_bytes(), &[0; 4]].concat();
    payload.extend(degrees.iter().flat_map(|v| v.to_le_bytes()));
    frame(kind, &payload)
}

fn position(kind: Kind, state: u32, place: [f64; 3], more: [f32; 4]) -> Vec<u8> {
    let mut payload = [&7_u32.to_le_bytes()[..], &state.to_le_bytes(), &[0; 4]].concat();
    payload.extend(place.iter().flat_map(|v| v.to_le_bytes()));
    payload.extend(more.iter().flat_map(|v| v.to_le_bytes()));
    frame(kind, &payload)
}

pub(super) fn times(content: &[u8]) -> Vec<f64> {
    let samples = with_file(content, read_imu).unwrap();
    samples.iter().map(|sample| sample.time_s).collect()
}

fn close(found: f64, expected: f64, tolerance: f64) {
    assert!(
        (found - expected).abs() <= tolerance,
        "{found} is not {expected}"
    );
}

#[test]
fn a_log_of_the_manufacturer_is_read_like_in_its_library() {
    let log = manufacturer_log();
    assert!(looks_like(&log));
    let samples = with_file(&log, read_imu).unwrap();
    assert_eq!(samples.len(), 5);
    for (i, (sample, expected)) in samples.iter().zip(IMU_OF_MANUFACTURER).enumerate() {
        close(sample.time_s, FIRST_UTC_S + 1e-3 * i as f64, 5e-7);
        let values = sample.gyro_rad_s.iter().chain(&sample.accel_m_s2);
        for (value, expected) in values.zip(expected) {
            // The manufacturer's library computes with 24 bits.
            close(*value, expected, 1e-7 * expected.abs());
        }
    }
    let [fix] = with_file(&log, read_heading).unwrap()[..] else {
        panic!("one heading");
    };
    close(fix.time_s, FIRST_UTC_S + 0.0027, 5e-7);
    close(fix.heading_rad.to_degrees(), 275.258972, 1e-6);
    close(fix.sigma_rad.unwrap().to_degrees(), 0.0307539608, 1e-10);
    close(fix.pitch_rad.unwrap().to_degrees(), 44.1184464, 1e-7);
    close(fix.pitch_sigma_rad.unwrap().to_degrees(), 1.0457927, 1e-7);
    let [fix] = with_file(&log, read_positions).unwrap()[..] else {
        panic!("one position");
    };
    close(fix.time_s, FIRST_UTC_S + 0.0028, 5e-7);
    close(fix.latitude_rad.to_degrees(), -37.458_403_004_478_58, 1e-14);
    close(fix.longitude_rad.to_degrees(), 9.655_921_643_750_9, 1e-14);
    close(fix.height_m, 2053.9892880772613 - 31.3800983, 1e-6);
    let sigma_m = [4.77592373, 2.83406281, 2.37769556];
    let sigmas = fix.sigma_m.unwrap();
    let found = sigmas.iter().zip(sigma_m);
    found.for_each(|(value, expected)| close(*value, expected, 1e-7));
    let counts = with_file(&log, summary).unwrap();
    let text = "2 UTC_TIME, 1 IMU_DATA, 1 EKF_EULER, 2 GPS1_POS (1 unusable), 2 GPS1_HDT (1 \
                unusable), 5 IMU_SHORT";
    assert_eq!(counts.describe(), text);
    assert_eq!((counts.frames, counts.damaged_bytes), (13, 0));
    let (first_s, last_s) = counts.span_s.unwrap();
    close(first_s, FIRST_UTC_S, 5e-7);
    close(last_s, FIRST_UTC_S + 4e-3, 5e-7);
}

#[test]
fn without_utc_times_are_those_of_the_device() {
    let log = manufacturer_log();
    let first = &log[..41];
    assert!(!with_file(first, summary).unwrap().is_utc);
    let begin_s = f64::from(FIRST_STAMP_US) * 1e-6;
    assert_eq!(times(first), [begin_s]);
    // Twice around in steps of 20 minutes.
    let step_us = 1_200_000_000_u32;
    let stamps = (0..8).map(|i| FIRST_STAMP_US.wrapping_add(step_us.wrapping_mul(i)));
    let log: Vec<u8> = stamps
        .flat_map(|s| imu_short(s, 1, [0; 3], [0; 3]))
        .collect();
    for (i, time_s) in times(&log).into_iter().enumerate() {
        close(time_s, begin_s + 1200.0 * i as f64, 1e-9);
    }
}

#[test]
fn imu_data_is_read_if_there_is_no_imu_short() {
    let mut log = [imu_data(1000, 0.25, -9.5), imu_data(2000, f32::NAN, 1.0)].concat();
    let sample = ImuSample {
        time_s: 1e-3,
        gyro_rad_s: Vec3::repeat(0.25),
        accel_m_s2: Vec3::repeat(-9.5),
    };
    assert_eq!(with_file(&log, read_imu).unwrap(), [sample]);
    // No contact to the IMU, then standard and fast scale.
    log.extend(imu_short(3000, 0x3fe, [1; 3], [1; 3]));
    assert_eq!(with_file(&log, read_imu).unwrap(), [sample]);
    log.extend(imu_short(
        4000,
        1,
        [1 << 26, 0, -(1 << 25)],
        [1 << 20, 0, i32::MIN],
    ));
    log.extend(imu_short(
        5000,
        1 | 1 << 10,
        [12_304_174, 0, i32::MIN],
        [0; 3],
    ));
    let [standard, fast] = with_file(&log, read_imu).unwrap()[..] else {
        panic!("two samples");
    };
    assert_eq!(standard.gyro_rad_s, Vec3::new(1.0, 0.0, -0.5));
    assert_eq!(standard.accel_m_s2, Vec3::new(1.0, 0.0, -2048.0));
    assert_eq!((standard.time_s, fast.gyro_rad_s.x), (4e-3, 1.0));
    close(fast.gyro_rad_s.z, -10_000_f64.to_radians(), 1e-4);
}

#[test]
fn utc_of_the_best_state_is_used() {
    let sample = |stamp| imu_short(stamp, 1, [0; 3], [0; 3]);
    let mut log = [sample(1_000_000), utc_time(2_000_000, NOT_VALID, [9; 3], 0)].concat();
    assert_eq!(times(&log), [1.0]);
    log.extend(utc_time(3_000_000, NOT_ALIGNED, [0, 0, 40], 0));
    assert_eq!(times(&log), [YEAR_S + 38.0]);
    log.extend(utc_time(4_000_000, ALIGNED, [0, 0, 40], 500_000_000));
    log.extend(utc_time(6_000_000, ALIGNED, [0, 0, 42], 500_100_000));
    log.extend(utc_time(6_500_000, NOT_ALIGNED, [0, 0, 50], 0));
    log.extend([sample(5_000_000), sample(7_000_000)].concat());
    let found = times(&log);
    for (found, expected) in found.into_iter().zip([37.5, 41.500_05, 43.500_1]) {
        close(found, YEAR_S + expected, 3e-7);
    }
    log.extend(utc_time(8_000_000, ALIGNED, [0, 0, 45], 500_000_000));
    let error = with_file(&log, read_imu).unwrap_err().to_string();
    assert!(error.contains("UTC that steps by 1.000 s"), "{error}");
    // The device was restarted.
    let log = [sample(60_000_000), sample(2_000)].concat();
    let error = with_file(&log, read_imu).unwrap_err().to_string();
    assert!(error.contains("byte 41: found a clock of the device that goes back by 59.998 s"));
    assert_eq!(with_file(&log, summary).unwrap().frames, 2);
}

#[test]
fn headings_and_positions_without_a_solution_are_left_out() {
    let mut log = heading(GPS2_HDT, 1, 0, [10.0, 0.5, -3.0, 90.0]);
    // Not enough satellites, and standard deviations that mark a missing solution.
    log.extend(heading(GPS1_HDT, 2, 1, [20.0, 0.5, 1.0, 0.5]));
    log.extend(heading(GPS1_HDT, 3, 0, [20.0, 180.0, 1.0, 0.5]));
    log.extend(heading(GPS1_HDT, 3, 0, [20.0, 0.0, 1.0, 0.5]));
    let fix = HeadingFix::new(1e-6, 10_f64.to_radians(), Some(0.5_f64.to_radians()));
    assert_eq!(with_file(&log, read_heading).unwrap(), [fix]);
    log.extend(heading(GPS1_HDT, 4, 1 << 6, [359.5, 0.25, -90.0, 1.0]));
    let fix = HeadingFix {
        time_s: 4e-6,
        heading_rad: 359.5_f64.to_radians(),
        sigma_rad: Some(0.25_f64.to_radians()),
        pitch_rad: Some(-std::f64::consts::FRAC_PI_2),
        pitch_sigma_rad: Some(1_f64.to_radians()),
    };
    assert_eq!(with_file(&log, read_heading).unwrap(), [fix]);

    let place = [48.0, 9.0, 500.0];
    let fixed = 7 << 6;
    let mut log = position(GPS1_POS, 1 | fixed, place, [47.5, 1.0, 2.0, 3.0]);
    log.extend(position(GPS1_POS, 0, place, [47.5, 1.0, 2.0, 3.0]));
    log.extend(position(GPS1_POS, fixed, place, [47.5, 1.0, 2.0, 9999.0]));
    log.extend(position(
        GPS1_POS,
        fixed,
        [91.0, 9.0, 0.0],
        [47.5, 1.0, 2.0, 3.0],
    ));
    let error = with_file(&log, read_positions).unwrap_err().to_string();
    let text = "found 4 GPS1_POS (4 unusable), expected GPS1_POS or GPS2_POS with a solution";
    assert!(error.ends_with(text), "{error}");
    log.extend(position(
        GPS2_POS,
        0xfffff000 | fixed,
        place,
        [47.5, 1.0, 2.0, 3.0],
    ));
    let fix = GeographicFix {
        time_s: 7e-6,
        latitude_rad: 48_f64.to_radians(),
        longitude_rad: 9_f64.to_radians(),
        height_m: 547.5,
        sigma_m: Some(Vec3::new(2.0, 1.0, 3.0)),
        quality: Some(FixQuality::Fixed),
    };
    assert_eq!(with_file(&log, read_positions).unwrap(), [fix]);
}
