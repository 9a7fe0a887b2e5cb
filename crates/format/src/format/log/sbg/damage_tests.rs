//! Logs with damaged frames and with bytes of other protocols.

use super::tests::{frame, imu_short, manufacturer_log, times, with_file};
use super::*;

#[test]
fn frames_are_found_between_other_bytes_and_large_frames() {
    let sample = |i: u32| imu_short(i, 1, [0; 3], [0; 3]);
    let large = frame((0x90, 48), &[7; 4086]);
    let mut log = b"$GPZDA,1*00\r\n\xff\xff".to_vec();
    log.extend([sample(0), large.clone(), frame((0, 31), &[]), sample(1)].concat());
    // A header that claims more bytes than follow must not hide the frames in these bytes.
    log.extend(b"\xff\x5a\x2c\x00\xf0\x0f");
    for i in 2..2000 {
        log.extend(sample(i));
        log.extend(if i % 40 == 0 { &large[..] } else { &[] });
    }
    log.extend(&sample(0)[..40]);
    let found = times(&log);
    assert_eq!(found.len(), 2000);
    assert!(
        found
            .iter()
            .enumerate()
            .all(|(i, t)| *t == clock::seconds(1000 * i as i64))
    );
    let counts = with_file(&log, summary).unwrap();
    assert_eq!(
        (counts.damaged_bytes, counts.damaged_places),
        (15 + 6 + 40, 3)
    );
    let text =
        "1 GPS1_RAW, 2000 IMU_SHORT, 50 page of class 16 message 48, 61 damaged bytes in 3 places";
    assert_eq!(counts.describe(), text);
    assert!(looks_like(&log[..200]) && looks_like(&large));
    assert!(!looks_like(&log[..40]) && !looks_like(b""));
    let error = with_file(&log, read_heading).unwrap_err().to_string();
    assert!(error.contains(text), "{error}");
    for nothing in [&b"no log"[..], &b"\xff\x5a"[..], &large[..4000]] {
        let error = with_file(nothing, summary).unwrap_err().to_string();
        assert!(error.contains("found no complete sbgECom frame"), "{error}");
    }
}

#[test]
fn the_reader_keeps_undamaged_frames_around_any_damage() {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut random = |below: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as usize % below
    };
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.bin");
    let manufacturer_log = manufacturer_log();
    for round in 0..100 {
        // Pieces, some of them damaged; the gyro of undamaged samples counts them.
        let mut log = Vec::new();
        let mut undamaged = Vec::new();
        for i in 0..1 + random(100) as i32 {
            let mut piece = imu_short(1000 * i as u32, 1, [i << 20, 0, 0], [0; 3]);
            match random(10) {
                0 => piece[random(41)] ^= 1 + random(255) as u8,
                1 => piece.truncate(random(41)),
                2 => drop(piece.splice(..random(41), (0..random(9)).map(|_| 0xff))),
                3 => piece.insert(1 + random(40), random(256) as u8),
                4 => {
                    piece = (0..random(50))
                        .map(|_| [0xff, 0x5a, 0, 44][random(4)])
                        .collect()
                }
                5 => piece = manufacturer_log[random(600)..][..random(29)].to_vec(),
                _ => undamaged.push(f64::from(i) / 64.0),
            }
            log.extend(piece);
        }
        std::fs::write(&path, &log).unwrap();
        let found = read_imu(&Input::from(&path)).unwrap_or_default();
        let found: Vec<f64> = found.iter().map(|sample| sample.gyro_rad_s.x).collect();
        let mut rest = found.iter();
        let kept = undamaged.iter().all(|i| rest.any(|x| x == i));
        assert!(kept, "{round}: {found:?}, {undamaged:?}");
    }
    for _ in 0..1000 {
        // The manufacturer's log with bytes changed and cut off at either end.
        let mut log = manufacturer_log.clone();
        for _ in 0..random(20) {
            let at = random(log.len());
            log[at] = random(256) as u8;
        }
        let end = random(log.len());
        let log = &log[random(end + 1)..end];
        std::fs::write(&path, log).unwrap();
        let _ = (
            read_imu(&Input::from(&path)),
            read_heading(&Input::from(&path)),
            read_positions(&Input::from(&path)),
        );
        let other = summary(&Input::from(&path)).map_or(0, |counts| counts.damaged_bytes);
        assert!(other <= log.len() as u64);
    }
}
