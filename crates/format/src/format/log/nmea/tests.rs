use super::sentence::*;
use super::skipped::WITHOUT_SEPARATION;
use super::*;
use crate::format::mutation::for_each_damaged;
use crate::sensor::FixQuality;

/// A log that begins and ends in the middle of a sentence. Expected values are from another reader,
/// pynmea2 1.19.
const LOG: &str = "5.0,M,47.0,M,,*10\r\n\
    $GPHDT,200.0,T*37\r\n\
    $GPGGA,235959.80,5043.6512345,N,00705.2468101,E,4,17,0.7,104.5678,M,47.123,M,1.0,0001*7F\r\n\
    $GPVTG,89.68,T,,M,0.00,N,0.0,K,A*32\r\n\
    $GPHDT,123.4567,T*05\r\n\
    $GNZDA,235959.80,31,12,2023,00,00*73\r\n\
    $GPHDT,123.4567,T*05\r\n\
    $GNGGA,000000.00,3351.9000000,S,15112.3000000,W,5,09,1.1,-3.2,M,-21.05,M,,*4F\r\n\
    $GPHDT,,T*1B\r\n\
    $GNHDT,0.0125,T*1D\r\n\
    $GNRMC,000000.00,A,3351.9,S,15112.3,W,0.1,2.2,010124,,,R*53\r\n\
    $GPGGA,000000.20,,,,,0,00,,,M,,M,,*4A\r\n\
    $GPGGA,000000.40,5043.0,N,00705.0,E,1,17,0.7,104.5,M,,M,,*77\r\n\
    $GPTHS,359.9,A*31\r\n\
    $GPTHS,359.9,V*26\r\n\
    $GPHDT,123.4568,T*05\r\n\
    $GPHDT,123.4";
const PASHR: &str = "$PASHR,123456.789,271.25,T,-1.50,+2.25,+0.01,0.029,0.031,0.059,2,1*39\r\n";

fn with<T>(text: &str, read: impl Fn(&Input) -> T) -> T {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.nmea");
    std::fs::write(&path, text).unwrap();
    read(&Input::from(&path))
}

#[test]
fn headings_have_the_time_of_their_epoch() {
    let log = with(LOG, read_heading_log).unwrap();
    let found: Vec<[f64; 2]> = log
        .records
        .iter()
        .map(|fix| [fix.time_s, fix.heading_rad.to_degrees()])
        .collect();
    let expected = [[1_704_067_199.8, 123.4567], [1_704_067_200.0, 0.0125]];
    for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    }
    assert_eq!(found.len(), 2);
    // The first half line, VTG, and THS, which is less frequent than HDT.
    assert_eq!(log.skipped.other, 3);
    let lost = log.skipped.lost;
    // One before the first time, and a second one in the same epoch.
    let reasons = [WRONG_CHECKSUM, DAMAGED, WITHOUT_FIX, WITHOUT_TIME];
    assert_eq!(reasons.map(|why| lost.count(why)), [1, 1, 2, 2]);
    assert_eq!(lost.total(), 6);
}

#[test]
fn positions_are_ellipsoidal() {
    let log = with(LOG, read_position_log).unwrap();
    let expected = [
        [1_704_067_199.8, 50.727_520_575, 7.087_446_835, 151.6908],
        [1_704_067_200.0, -33.865, -151.205, -24.25],
    ];
    for (fix, [time_s, latitude, longitude, height_m]) in log.records.iter().zip(expected) {
        assert_eq!(fix.time_s, time_s);
        assert!((fix.latitude_rad.to_degrees() - latitude).abs() < 1e-13);
        assert!((fix.longitude_rad.to_degrees() - longitude).abs() < 1e-13);
        assert!((fix.height_m - height_m).abs() < 1e-12);
    }
    let lost = log.skipped.lost;
    assert_eq!(
        [WITHOUT_FIX, WITHOUT_SEPARATION].map(|why| lost.count(why)),
        [1, 1]
    );
}

#[test]
fn times_without_a_date_continue_over_midnight() {
    let mut text = String::new();
    for (i, time) in ["235959.9", "000000.0", "235959.95", "000000.1"]
        .iter()
        .enumerate()
    {
        text += &format!("$GPGGA,{time},0000.0,N,00000.0,E,1,9,1,0,M,0,M,,\n$GPHDT,{i},T\n");
    }
    let expected = [86_399.9, 86_400.0, 86_399.95, 86_400.1];
    let times = with(&text, read_heading).unwrap();
    assert_eq!(
        times.iter().map(|fix| fix.time_s).collect::<Vec<_>>(),
        expected
    );
    let times = with(&text, read_positions).unwrap();
    assert_eq!(
        times.iter().map(|fix| fix.time_s).collect::<Vec<_>>(),
        expected
    );
    // A date applies to earlier sentences too, and a later date corrects the day.
    text += "$GPZDA,000001,02,01,1970,,\n$GPHDT,9,T\n$GPZDA,000001,05,01,1970,,\n$GPHDT,9,T\n";
    let times = with(&text, read_heading).unwrap();
    let times: Vec<f64> = times.iter().map(|fix| fix.time_s).collect();
    assert_eq!(times[..4], expected);
    assert_eq!(times[4..], [86_401.0, 4.0 * 86_400.0 + 1.0]);
}

#[test]
fn attitudes_have_their_own_time_and_accuracy() {
    let fix = with(PASHR, read_heading).unwrap()[0];
    let degrees = [
        fix.heading_rad,
        fix.sigma_rad.unwrap(),
        fix.pitch_rad.unwrap(),
    ];
    assert!((fix.time_s - 45_296.789).abs() < 1e-11);
    for (found, expected) in degrees
        .map(f64::to_degrees)
        .iter()
        .zip([271.25, 0.059, 2.25])
    {
        assert!((found - expected).abs() < 1e-13);
    }
    let pitch_sigma = fix.pitch_sigma_rad.unwrap();
    assert!((pitch_sigma - 0.031_f64.to_radians()).abs() < 1e-15);
}

#[test]
fn errors_list_the_content_of_the_log() {
    let e = with(PASHR, read_positions).unwrap_err().to_string();
    assert!(e.contains("found no sentence that can be used"), "{e}");
    assert!(e.contains("expected positions (GGA"), "{e}");
    let e = with("$GPHDT,1.0,T\n", read_heading)
        .unwrap_err()
        .to_string();
    assert!(
        e.contains("1 headings without a time of their own, expected headings"),
        "{e}"
    );
    let text = "$GPZDA,000001,02,01,1970,,\n".to_owned() + &"$GPHDT,9,T\n".repeat(10);
    let e = with(&text, read_heading).unwrap_err().to_string();
    assert!(
        e.contains("found 10 headings, 9 of them without a time"),
        "{e}"
    );
    for (text, expected) in [
        (LOG, true),
        (PASHR, true),
        ("$GPHDT,9,T\n", true),
        ("note\n$GPHDT,9,T\n", false),
        ("$GPHDT,9.5,T*00\n", false),
        ("time_s,heading_deg\n1,2\n", false),
        ("", false),
    ] {
        assert_eq!(looks_like(text.as_bytes()), expected, "{text}");
    }
}

#[test]
fn damaged_files_do_not_panic() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.nmea");
    let without_checksums: String = LOG
        .lines()
        .map(|line| line.split('*').next().unwrap_or_default().to_owned() + "\n")
        .collect();
    for valid in [LOG, PASHR, &without_checksums] {
        for_each_damaged(&path, valid.as_bytes(), 2000, || {
            drop((
                read_heading(&Input::from(&path)),
                read_positions(&Input::from(&path)),
            ));
            looks_like(&std::fs::read(&path).unwrap_or_default());
        });
    }
}

fn read(body: &str) -> std::result::Result<Sentence, Useless> {
    let (has_checksum, sentence) = parse(body.as_bytes());
    assert!(!has_checksum, "{body}");
    sentence.map(|(sentence, _)| sentence)
}

#[test]
fn pieces_begin_at_dollar_signs() {
    let mut found = Vec::new();
    pieces(
        b"12:00:01 $GPHDT,1$GPHDT,2,T\r\n\xff\x00 junk\r\n\n$",
        |piece| {
            found.push(piece.to_vec());
        },
    );
    let expected: [&[u8]; 4] = [b"GPHDT,1", b"GPHDT,2,T", b"\xff\x00 junk", b""];
    assert_eq!(found, expected);
}

#[test]
fn checksums_are_verified() {
    let heading = parse(b"GPHDT,123.4567,T").1.unwrap();
    assert_eq!(parse(b"GPHDT,123.4567,T*05"), (true, Ok(heading)));
    assert_eq!(parse(b"GPHDT,123.4567,T*05,12:00:01"), (true, Ok(heading)));
    assert_eq!(
        parse(b"GPHDT,123.4568,T*05"),
        (true, Err(Useless::WrongChecksum))
    );
    for cut in [
        "GPHDT,123.4567,T*0",
        "GPHDT,123.4567,T*",
        "GPHDT,123.4567,T*+5",
    ] {
        assert_eq!(
            parse(cut.as_bytes()),
            (false, Err(Useless::Damaged)),
            "{cut}"
        );
    }
}

#[test]
fn fields_out_of_range_are_errors() {
    let fix = "GPGGA,120000.5,5043.5,N,00705.5,E,1,17,0.7,104.5,M,47.1,M,,";
    let position = [50.725, 7.0 + 5.5 / 60.0];
    let expected = Sentence::Position(Place {
        kind: 0,
        second_s: 43_200.5,
        date: None,
        place_deg: position,
        altitude_m: 104.5,
        separation_m: Some(47.1),
        quality: FixQuality::Single,
    });
    assert_eq!(read(fix), Ok(expected));
    for (from, to) in [
        ("120000.5", "240000"),
        ("120000.5", "120061"),
        ("120000.5", "1200"),
        ("120000.5", ""),
        ("5043.5", "9043.5"),
        ("5043.5", "5060.5"),
        ("5043.5", ""),
        ("5043.5", "3"),
        ("5043.5", "5é43.5"),
        ("00705.5", "+0705.5"),
        (",N", ",X"),
        (",1,17", ",300,17"),
        ("104.5", "1e3"),
        ("104.5,M", "104.5,F"),
        ("47.1,M,,", "47.1"),
        ("47.1,M", "47.1,"),
    ] {
        let text = fix.replace(from, to);
        assert_eq!(read(&text), Err(Useless::Damaged), "{text}");
    }
    assert_eq!(read(&fix.replace(",1,17", ",,")), Ok(Sentence::NoPosition));
    for text in [
        "GPHDT,361,T",
        "GPHDT,1",
        "GPHDT,1,M",
        "GPTHS,1",
        "GPTHS,nan,A",
        "GPHDT",
    ] {
        assert_eq!(read(text), Err(Useless::Damaged), "{text}");
    }
    for text in [
        "GPHDT,,T",
        "GPTHS,12.5,V",
        "GPTHS,12.5,M",
        "GPTHS,12.5,S",
        "GPTHS,,",
    ] {
        assert_eq!(read(text), Ok(Sentence::NoHeading), "{text}");
    }
    let text = "PASHR,120000,,T,,,,,,,0,0";
    assert_eq!(read(text), Ok(Sentence::NoHeading));
    let text = "PASHR,120000,10,T,1,95,0,,,,1,0";
    assert_eq!(read(text), Err(Useless::Damaged));
    for text in [
        "PASHR,POS,1,2",
        "PUBX,00",
        "GPHDTX,1,T",
        "AIVDM,1",
        "",
        "hello",
    ] {
        assert_eq!(read(text), Err(Useless::Other), "{text}");
    }
}

#[test]
fn dates_need_a_valid_status_and_calendar() {
    let rmc = "GPRMC,120000,A,,,,,,,290224,,";
    assert_eq!(read(rmc), Ok(Sentence::Date(43_200.0, 19_782)));
    assert_eq!(
        read("GPZDA,120000,29,02,2024"),
        Ok(Sentence::Date(43_200.0, 19_782))
    );
    assert_eq!(read(&rmc.replace("2902", "3002")), Err(Useless::Damaged));
    assert_eq!(read(&rmc.replace("24,", "245,")), Err(Useless::Damaged));
    assert_eq!(read(&rmc.replace('A', "V")), Ok(Sentence::NoDate));
    assert_eq!(read("GPZDA,,,,,00,00"), Ok(Sentence::NoDate));
    assert_eq!(read("GPZDA,120000,30,02,2024"), Err(Useless::Damaged));
}

/// Sentences of a receiver by Unicore in one second, and of two more; and one of a receiver with the checksum of ComNav.
/// Recorded by others.
const KSXT_LOG: [&str; 4] = [
    "$GNGGA,122420.00,2140.83628676,N,11055.10256280,E,1,26,0.6,53.3950,M,-13.4261,M,,*6D\r\n",
    "$KSXT,20240830122420.00,110.91837605,21.68060478,53.3950,0.00,0.00,152.04,0.407,,1,0,0,26,,,,0.191,-0.359,0.606,,*0F\r\n",
    "$KSXT,20240830122421.00,110.91837716,21.68060120,54.5514,0.00,0.00,179.68,0.421,,1,0,0,26,,,,0.002,-0.421,0.369,,*00\r\n",
    "$KSXT,20201222075720.00,119.17084152,32.07387900,83.5770,269.94,1.19,207.28,0.001,,3,3,25,25,-3.617,-4.468,-7.860,\
     -0.000,-0.001,-0.022,1.0,56,*33736701\r\n",
];

#[test]
fn positions_of_ksxt_have_the_height_of_gga() {
    let [gga, same, next, comnav] = KSXT_LOG;
    let of = |text: &str| {
        with(text, |input| {
            (read_positions(input).unwrap(), input.remarks().join("\n"))
        })
    };
    let (expected, _) = of(gga);
    // GGA is read if it is as frequent, and gives the separation before and after it.
    for text in [
        format!("{same}{gga}"),
        format!("{gga}{same}{next}"),
        format!("{same}{next}{gga}"),
    ] {
        let (found, remarks) = of(&text);
        assert_eq!(found[0].time_s, 1_725_020_660.0);
        assert!((found[0].latitude_rad - expected[0].latitude_rad).abs() < 1e-10);
        assert!((found[0].longitude_rad - expected[0].longitude_rad).abs() < 1e-10);
        assert!((found[0].height_m - (53.3950 - 13.4261)).abs() < 1e-9);
        assert_eq!(found[0].quality, Some(FixQuality::Single));
        assert_eq!(remarks, "");
    }
    let (found, remarks) = of(&format!("{same}{next}"));
    assert_eq!(
        found.iter().map(|fix| fix.height_m).collect::<Vec<_>>(),
        [53.395, 54.5514]
    );
    assert!(remarks.contains("above the sea"), "{remarks}");
    // Beside headings, the positions and what they leave open are named.
    let text = with(&format!("{same}{next}$GPHDT,123.4567,T*05\r\n"), |input| {
        let named = contents(input).unwrap();
        format!("{named} {}", input.remarks().join("\n"))
    });
    assert!(
        text.starts_with("positions: 2 KSXT; headings: 1 HDT the heights of KSXT"),
        "{text}"
    );
    let (found, _) = of(comnav);
    assert_eq!(
        (found[0].quality, found[0].height_m),
        (Some(FixQuality::Fixed), 83.577)
    );
    let heading = with(comnav, read_heading).unwrap()[0];
    assert!((heading.heading_rad.to_degrees() - 269.94).abs() < 1e-9);
    let damaged = comnav.replace("83.5770", "83.5771");
    let error = with(&format!("{same}{damaged}"), read_heading)
        .unwrap_err()
        .to_string();
    assert!(error.contains("1 with a wrong checksum"), "{error}");
    // Without a fix and a time.
    let text = format!(
        "{same}$KSXT,,0.00000000,0.00000000,0.0000,0.00,0.00,0.00,0.000,,0,0,0,0,,,,0.000,0.000,0.000,,\n"
    );
    assert_eq!(of(&text).0.len(), 1);
    let float = next.replace(",,1,0,0,", ",,2,0,0,");
    let float = float.split('*').next().unwrap();
    assert_eq!(of(float).0[0].quality, Some(FixQuality::Float));
}
