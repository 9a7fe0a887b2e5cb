use super::*;
use crate::format::mutation::for_each_damaged;

const GSI_16: &str = "*110001+00000000000000P1 21.324+0000000012345078 \
    22.325+0000000016000000 31..06+0000000000123456 58..16+0000000000000344 \
    81..08-0000000123456789 82..00+0000005600000123 83..07+0000000000123456 \
    560..6+0000000000235958 561..6+0000000000022900 562...+0000000000002024 \r\n\
    *410002+0000000000000012 42....+000000000000000A \r\n";
const GSI_8: &str = "110002+0000A012 21.322-12345678 22.323+09000000 31..01+00012345 \
    19....+02291230 87..10+00001500 88..10-00000025 84..10+00001000 85..10+00002000 \
    86..10+00003000 51..1.+0123+034\n110003+00000000 17....+29022024 560..6+00000001 \
    31..00+00000000";

fn read_text(text: &str) -> Result<Vec<GsiPoint>> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.gsi");
    std::fs::write(&path, text).unwrap();
    read(&Input::from(&path))
}

fn assert_near(found: &[Option<f64>], expected: &[f64]) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        let found = found.unwrap();
        assert!(
            (found - expected).abs() <= 1e-15 * expected.abs().max(2.0),
            "{found} {expected}"
        );
    }
}

/// Values from another reader, geocompy 1.0, except the 29th of February, which it does not read.
#[test]
fn words_have_their_units_and_signs() {
    let points = read_text(GSI_16).unwrap();
    assert_eq!(points.len(), 1);
    let p = &points[0];
    assert_eq!(p.name, "P1");
    assert_near(
        &[
            p.horizontal_rad,
            p.vertical_rad,
            p.slope_distance_m,
            p.reflector_constant_m,
        ],
        &[
            2.159_882_764_810_109_5,
            std::f64::consts::FRAC_PI_2,
            12.3456,
            0.0344,
        ],
    );
    assert_near(&p.target_m, &[-1234.56789, 5_600_000.123, 3.762_938_88]);
    assert_eq!(p.station_m, [None; 3]);
    assert_eq!(
        (p.days_since_1970, p.second_of_day_s),
        (Some(19_782), Some(86_398.0))
    );
    assert_eq!(p.time_s(), Some(1_709_251_198.0));

    let points = read_text(GSI_8).unwrap();
    let p = &points[0];
    assert_eq!(p.name, "A012");
    assert_near(
        &[p.horizontal_rad, p.vertical_rad, p.slope_distance_m],
        &[
            -1.939_254_565_419_256_6,
            std::f64::consts::FRAC_PI_2,
            3.762_756,
        ],
    );
    assert_near(&p.station_m, &[1.0, 2.0, 3.0]);
    assert_near(
        &[p.reflector_height_m, p.instrument_height_m],
        &[1.5, -0.025],
    );
    // This block has no year.
    assert_eq!((p.time_s(), p.second_of_day_s), (None, Some(45_000.0)));
    let p = &points[1];
    assert_eq!((p.name.as_str(), p.slope_distance_m), ("", None));
    assert_eq!(p.time_s(), Some(1_709_164_801.0));
}

#[test]
fn files_are_detected_by_their_first_block() {
    for (text, expected) in [
        (GSI_16, true),
        (GSI_8, true),
        ("\r\n410001+00000012 42....+0000000A \r\n", true),
        ("110001+0000A012 21.322-1234567 ", false),
        ("210001+0000A012 ", false),
        ("11,12\n", false),
        ("", false),
    ] {
        assert_eq!(looks_like(text.as_bytes()), expected, "{text}");
    }
}

#[test]
fn errors_name_line_word_and_expectation() {
    for (from, to, message) in [
        (
            "21.322",
            "21.320",
            "line 1: found the word `21.320-12345678`, expected an angle",
        ),
        (
            "21.322-12345678",
            "21.324-12365678",
            "`21.324-12365678`, expected minutes",
        ),
        (
            "31..01",
            "31..02",
            "found the word `31..02+00012345`, expected a length",
        ),
        (
            "00012345",
            "0001234A",
            "found the word `31..01+0001234A`, expected digits",
        ),
        (
            "02291230",
            "02292430",
            "found the word `19....+02292430`, expected a time of day",
        ),
        (
            "29022024",
            "29022023",
            "line 2: found the date 2023-02-29, expected a date",
        ),
        (
            "09000000 ",
            "0900000 ",
            "found `22.323+0900000 3`, expected words of two or three",
        ),
        (
            "87..10+",
            "87..10 ",
            "found `87..10 00001500`, expected words of",
        ),
    ] {
        let e = read_text(&GSI_8.replace(from, to)).unwrap_err().to_string();
        assert!(e.contains(message), "{e}");
    }
    let e = read_text("410001+00000012 ").unwrap_err().to_string();
    assert!(e.contains("no point"), "{e}");
}

#[test]
fn damaged_files_do_not_panic() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.gsi");
    for valid in [GSI_16, GSI_8] {
        for_each_damaged(&path, valid.as_bytes(), 3000, || {
            drop(read(&Input::from(&path)));
            looks_like(&std::fs::read(&path).unwrap_or_default());
        });
    }
}
