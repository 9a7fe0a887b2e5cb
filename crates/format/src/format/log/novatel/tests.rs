//! Messages of receivers, recorded and made up.

use super::message::sum;
use super::*;
use crate::format::detect;
use crate::geometry::Vec3;
use crate::sensor::{FixQuality, NavigationAngles};

const HEADER: &str = "COM1,0,73.5,FINESTEERING,2274,292500.000,00000000,471d,7397";
const POSE: &str = "INS_SOLUTION_GOOD,INS_RTKFIXED,50.95425087,6.89550221,48.3615,46.9156,1,2,3,0.12,-0.43,341.33,\
                    0.01,0.02,0.03,0.1,0.1,0.1,0.04,0.05,0.06,00000000,0";

fn line(name: &str, body: &str) -> String {
    let text = format!("{name},{HEADER};{body}");
    format!("#{text}*{:08x}\n", sum(text.as_bytes()))
}

fn best(kind: &str) -> String {
    let body = format!(
        "SOL_COMPUTED,{kind},50.95425087,6.89550221,48.3615,46.9156,WGS84,0.02,0.01,0.03,\"0\""
    );
    line("BESTPOSA", &body)
}

fn with<T>(text: &str, read: impl Fn(&Input) -> T) -> T {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.log");
    std::fs::write(&path, text).unwrap();
    assert_eq!(detect(&path).unwrap().id(), "novatel");
    read(&Input::from(&path))
}

#[test]
fn positions_have_their_quality_and_ellipsoidal_height() {
    for (kind, quality) in [
        ("NARROW_INT", FixQuality::Fixed),
        ("WIDE_INT", FixQuality::Float),
        ("PSRDIFF", FixQuality::Differential),
        ("SINGLE", FixQuality::Single),
    ] {
        let fix = with(&best(kind), |input| read_positions(input).unwrap()[0]);
        assert_eq!(fix.quality, Some(quality), "{kind}");
        assert_eq!(fix.sigma_m, Some(Vec3::new(0.01, 0.02, 0.03)));
        assert!((fix.height_m - 95.2771).abs() < 1e-9);
        assert!((fix.latitude_rad.to_degrees() - 50.954_250_87).abs() < 1e-12);
        // 2023-08-09 09:15:00 of GPS time.
        assert_eq!(fix.time_s, 1_691_572_500.0 - 18.0);
    }
}

#[test]
fn poses_have_velocities_and_standard_deviations() {
    let pose = with(&line("INSPVAXA", POSE), |input| {
        read_poses(input).unwrap()[0]
    });
    assert_eq!(
        pose.angles,
        NavigationAngles::from_deg([0.12, -0.43, 341.33])
    );
    assert_eq!(pose.velocity_m_s, Some(Vec3::new(2.0, 1.0, 3.0)));
    assert!((pose.height_m - 95.2771).abs() < 1e-9);
    let sigma = pose.sigma.unwrap();
    assert_eq!(sigma.position_m, Vec3::new(0.02, 0.01, 0.03));
    assert_eq!(sigma.angles, NavigationAngles::from_deg([0.04, 0.05, 0.06]));
}

#[test]
fn messages_that_cannot_be_used_are_counted() {
    let good = line("INSPVAXA", POSE);
    let aligning = line(
        "INSPVAXA",
        &POSE.replace("INS_SOLUTION_GOOD", "INS_ALIGNING"),
    );
    let early = good.replace("FINESTEERING", "UNKNOWN");
    let text = early[1..].split('*').next().unwrap().to_owned();
    let early_but_whole = format!("#{text}*{:08x}\n", sum(text.as_bytes()));
    let both = format!("{good}{good}{aligning}{}", best("SINGLE"));
    let remarks = with(&both, |input| {
        assert_eq!(read_poses(input).unwrap().len(), 2);
        input.remarks().join("\n")
    });
    assert_eq!(remarks, "poses (INSPVAXA) left out: 1 without a solution");
    let text = format!("{good}{early_but_whole}");
    let remarks = with(&text, |input| {
        assert_eq!(read_poses(input).unwrap().len(), 1);
        input.remarks().join("\n")
    });
    assert_eq!(
        remarks,
        "poses (INSPVAXA) left out: 1 before the receiver knew the time"
    );
    // The time is part of what the checksum covers.
    let error = with(&format!("{good}{early}{early}"), |input| {
        read_poses(input).unwrap_err()
    });
    let error = error.to_string();
    assert!(
        error.contains("1 poses (INSPVAXA), left out: 2 with a wrong"),
        "{error}"
    );
    let error = with(&best("SINGLE"), |input| read_poses(input).unwrap_err()).to_string();
    assert!(error.contains("0 poses (INSPVAXA)"), "{error}");
    let named = with(&both, |input| contents(input).unwrap());
    assert_eq!(named, "messages: 3 INSPVAXA, 1 BESTPOSA");
}

#[test]
fn the_more_frequent_positions_are_read() {
    let gnss = best("SINGLE");
    let text = gnss.trim_start_matches('#').split_once(',').unwrap().1;
    let body = text.split_once(';').unwrap().1.split_once('*').unwrap().0;
    let gnss = line("BESTGNSSPOSA", body);
    let text = format!("{gnss}{gnss}{}", best("NARROW_INT"));
    let remarks = with(&text, |input| {
        assert_eq!(read_positions(input).unwrap().len(), 2);
        input.remarks().join("\n")
    });
    assert_eq!(
        remarks,
        "positions are those of BESTGNSSPOSA: left out are 1 BESTPOSA"
    );
}

/// A message of NovAtel's documentation, at the place and the minute of its example of INSPVAXA.
const PLAIN_POSE: &str = "#INSPVAA,USB1,0,67.5,FINESTEERING,2209,490558.000,02000020,18bc,16809;2209,490558.000000000,\
    51.15043714042,-114.03067871718,1080.3548,0.0051,-0.0014,-0.0012,-0.296402993,0.311887972,157.992156267,\
    INS_SOLUTION_GOOD*cc698020\n";

#[test]
fn poses_without_standard_deviations_have_ellipsoidal_heights() {
    let pose = with(PLAIN_POSE, |input| read_poses(input).unwrap()[0]);
    // The example of INSPVAXA from 224 s later: 1097.3598 m above the sea, which lies at -17.0001 m.
    assert!((pose.height_m - (1097.3598 - 17.0001)).abs() < 0.01);
    assert_eq!(pose.time_s, 1_652_458_558.0 - 18.0);
    assert_eq!(pose.velocity_m_s, Some(Vec3::new(-0.0014, 0.0051, -0.0012)));
    let angles = [-0.296402993, 0.311887972, 157.992156267];
    assert_eq!(pose.angles, NavigationAngles::from_deg(angles));
    assert_eq!(pose.sigma, None);
    // The short header has no status of the time; the time of the body is finer.
    let short = "%INSPVASA,1264,144059.000;1264,144059.002135700,51.116680071,-114.037929194,515.286704183,277.896368884,\
                 84.915188605,-8.488207941,0.759619515,-2.892414901,6.179554750,INS_ALIGNMENT_COMPLETE*855d6f76\n";
    let pose = with(short, |input| read_poses(input).unwrap()[0]);
    assert!((pose.time_s - (1_080_576_046.002_135_7)).abs() < 1e-6);
    // Messages with standard deviations are preferred where both are equally frequent.
    let both = format!("{PLAIN_POSE}{}", line("INSPVAXA", POSE));
    let pose = with(&both, |input| read_poses(input).unwrap()[0]);
    assert!(pose.sigma.is_some());
}

/// Positions of a receiver by Unicore, of which another message (BESTNAVXYZA) of 9 s later gives (-1144697.2607,
/// 6090339.1897, 1504171.6679) m from the centre of the earth, 22.54 m below the ellipsoid. From the tests of satpulse.
const UNICORE: &str = "#BESTNAVA,97,GPS,FINE,2406,92751000,17548,0,18,22;SOL_COMPUTED,SINGLE,13.73183356550,100.64472424326,\
    8.3086,-30.8310,WGS84,1.4220,1.2684,2.2777,\"\",0.000,5.000,52,28,28,0,1,12,11,51,SOL_COMPUTED,DOPPLER_VELOCITY,0.000,\
    0.000,0.0054,227.237905,-0.0011,0.0183,0.0134*a10b7a38\r\n";

#[test]
fn positions_of_unicore_are_read() {
    let fix = with(UNICORE, |input| read_positions(input).unwrap()[0]);
    assert!((fix.height_m + 22.54).abs() < 0.05, "{}", fix.height_m);
    assert!((fix.latitude_rad.to_degrees() - 13.731_833_565_5).abs() < 1e-11);
    assert_eq!(fix.quality, Some(FixQuality::Single));
    assert_eq!(fix.sigma_m, Some(Vec3::new(1.2684, 1.4220, 2.2777)));
    // Week 2406 of GPS time, 92751 s.
    assert_eq!(fix.time_s, 1_771_206_351.0 - 18.0);
}

#[test]
fn weeks_of_beidou_become_those_of_gps() {
    let gps = with(UNICORE, |input| read_positions(input).unwrap()[0]);
    let text = UNICORE[1..].split('*').next().unwrap();
    for (system, week) in [("BDS", 2406 - 1356), ("BDST", 2406 - 1356), ("BDS", 2406)] {
        let other = format!("{system},FINE,{week},{}", 92_751_000 - 14_000);
        let text = text.replace("GPS,FINE,2406,92751000", &other);
        let text = format!("#{text}*{:08x}\n", sum(text.as_bytes()));
        let found = with(&text, |input| read_positions(input).unwrap()[0]);
        assert_eq!(found, gps, "{other}");
    }
}

#[test]
fn headings_of_two_antennas_need_fixed_ambiguities() {
    let heading = |kind: &str| {
        let body = format!("SOL_COMPUTED,{kind},0.9276,178.3478,-1.3037,0,0.2619,0,\"R222\"");
        line("HEADINGA", &body)
    };
    let text = format!("{}{}", heading("NARROW_INT"), heading("NARROW_FLOAT"));
    let (fixes, remarks) = with(&text, |input| {
        (read_headings(input).unwrap(), input.remarks())
    });
    assert_eq!(fixes.len(), 1);
    assert!((fixes[0].heading_rad.to_degrees() - 178.3478).abs() < 1e-12);
    assert!((fixes[0].sigma_rad.unwrap().to_degrees() - 0.2619).abs() < 1e-12);
    assert!((fixes[0].pitch_rad.unwrap().to_degrees() + 1.3037).abs() < 1e-12);
    assert_eq!(fixes[0].pitch_sigma_rad, None);
    assert_eq!(
        remarks,
        ["headings (HEADINGA) left out: 1 without fixed ambiguities"]
    );
    let error = with(&heading("NARROW_FLOAT"), |input| {
        read_headings(input).unwrap_err()
    });
    assert!(error.to_string().contains("0 headings (HEADINGA)"));
}

#[test]
fn damaged_files_do_not_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.log");
    let text = format!(
        "{}{}{PLAIN_POSE}{UNICORE}",
        line("INSPVAXA", POSE),
        best("SINGLE")
    );
    crate::format::mutation::for_each_damaged(&path, text.as_bytes(), 500, || {
        let _ = detect(&path);
        let _ = read_poses(&Input::from(&path));
        let _ = read_positions(&Input::from(&path));
        let _ = read_headings(&Input::from(&path));
    });
}
