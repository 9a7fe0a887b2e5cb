use super::*;
use crate::format::{detect, inspect, open_profiles};

/// The blocks before the data, as in an export of a real sensor.
fn head(trigger: &str, angle: &str) -> String {
    format!(
        "Info\nCSV Version,Sensor Count,Trigger Mode,Trigger Rate,Trigger Delay Domain,Trigger Delay,Operation Mode,\
         XResolution,YResolution,ZResolution,YSpeed,Layout\n2,1,{trigger},0,0.00000,2,0.50000,0.10000,0.00300,\
         100.00000,0\nEnd\n\nDeviceInfo\nID,Model,Version,Exposure Mode,Exposure Count,Exposure 0,Exposure Min,\
         Transform X,Transform Y,Transform Z,Transform X Angle,Transform Y Angle,Transform Z Angle\n40959,\
         312430-2M-01,5.1.6.79,0,1,2138.540,-,0.1,0.0,1.7,{angle},-4.71110,0.00000\nEnd\n\nRecordingFilter\nCondition \
         Combination Type\nAny\n\nType,Enabled,Result\nAny Measurement,No,Pass\nEnd\n\n"
    )
}

const COLUMNS: &str = "Frame,Source,Time,Encoder,Z Encoder,Inputs,Exposure,Y,Axis";

fn uniform(rows: &str) -> String {
    format!(
        "Profile\nFrame Count,Column Count,X Offset,Y Offset,Z Offset\n2,3,-0.50000,0.00000,1.70000\n{COLUMNS},-0.50000,\
         0.00000,0.50000\n{rows}End\n"
    )
}

fn raw(rows: &str) -> String {
    format!(
        "RawProfile\nFrame Count,Column Count,X Offset,Y Offset,Z Offset\n2,3,-0.50000,0.00000,1.70000\n\n{COLUMNS},0,1,2\n\
         {rows}End\n"
    )
}

const ROWS: &str = "7,0,10240000,5,0,0,100.0,0.0,Z,-10.250,,3.000\n7,0,10240000,5,0,0,100.0,0.0,I,17,0,255\n\
                    8,0,10250240,6,0,0,100.0,0.1,Z,,2.5,\n";

fn read(text: &str) -> Result<Vec<ScanPoint>> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("replay.csv");
    std::fs::write(&path, text).unwrap();
    assert_eq!(detect(&path)?.id(), "gocator-csv");
    let mut reader = open_profiles(&path)?;
    let (mut chunk, mut all) = (Vec::new(), Vec::new());
    while reader.next_chunk(&mut chunk)? {
        all.extend_from_slice(&chunk);
    }
    assert_eq!(reader.bytes_read(), reader.bytes_total());
    Ok(all)
}

fn refusal(text: &str) -> String {
    read(text).unwrap_err().to_string()
}

fn point(time_s: f64, x_m: f64, z_m: f64, intensity: f32) -> ScanPoint {
    ScanPoint {
        time_s,
        position_m: Vec3::new(x_m, 0.0, z_m),
        intensity,
    }
}

fn assert_near(points: &[ScanPoint], expected: &[ScanPoint]) {
    assert_eq!(points.len(), expected.len());
    for (point, expected) in points.iter().zip(expected) {
        assert!((point.time_s - expected.time_s).abs() < 1e-12, "{point:?}");
        assert!(
            (point.position_m - expected.position_m).norm() < 1e-15,
            "{point:?}"
        );
        assert_eq!(point.intensity, expected.intensity);
    }
}

#[test]
fn uniform_profiles_take_x_from_the_header() {
    let points = read(&(head("1,100.0", "0.0") + &uniform(ROWS))).unwrap();
    let expected = [
        point(10.0, -0.5e-3, -10.25e-3, 17.0),
        point(10.0, 0.5e-3, 3e-3, 255.0),
        point(10.01, 0.0, 2.5e-3, 0.0),
    ];
    assert_near(&points, &expected);
}

#[test]
fn point_cloud_profiles_take_x_from_rows() {
    let rows = "0,0,1024000,0,0,0,100,0,X,-0.51,0.02,0.53\n0,0,1024000,0,0,0,100,0,Z,1,-2,\n\
                1,0,1034240,0,0,0,100,0,X,-0.52,,0.54\n1,0,1034240,0,0,0,100,0,Z,1.5,2,3\n";
    let points =
        read(&(head("0,100.0", "0.0") + &raw(rows) + "\nSurface\nanything\nEnd\n")).unwrap();
    let expected = [
        point(1.0, -0.51e-3, 1e-3, 0.0),
        point(1.0, 0.02e-3, -2e-3, 0.0),
        point(1.01, -0.52e-3, 1.5e-3, 0.0),
        point(1.01, 0.54e-3, 3e-3, 0.0),
    ];
    assert_near(&points, &expected);
}

#[test]
fn the_trigger_rate_decides_the_unit_of_time() {
    // Periods of 10240 and of 10000 units at 100 Hz.
    let first_time_s = |time: &str, trigger: &str| {
        let rows = ROWS.replace("10250240", time);
        read(&(head(trigger, "0.0") + &uniform(&rows))).unwrap()[0].time_s
    };
    assert!((first_time_s("10250240", "0,100.00000") - 10.0).abs() < 1e-9);
    assert!((first_time_s("10250000", "0,100.00000") - 10.24).abs() < 1e-9);
    assert!((first_time_s("10250000", "1,100.00000") - 10.0).abs() < 1e-9);
    assert!((first_time_s("10250000", "0,250.00000") - 10.0).abs() < 1e-9);
}

#[test]
fn inspect_names_units_and_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("replay.csv");
    std::fs::write(&path, head("0,100.0", "0.0") + &uniform(ROWS)).unwrap();
    let report = inspect(&path).unwrap();
    assert_eq!((report.count, report.epochs), (3, Some(2)));
    assert!(report.frame.contains("1/1.024 µs") && report.frame.contains("scanner frame"));
    assert!((report.rate_hz.unwrap() - 100.0).abs() < 1e-6);
}

#[test]
fn errors_name_the_fault() {
    let level = head("1,100.0", "0.0");
    let with_rows = |rows: &str| refusal(&(level.clone() + &uniform(rows)));
    let message = refusal(&(head("1,100.0", "2.5") + &uniform(ROWS)));
    assert!(
        message.contains("Transform X Angle = 2.5 degrees"),
        "{message}"
    );
    let message = refusal(&level.replace("\n2,1,", "\n3,1,"));
    assert!(
        message.contains("CSV version 3, expected version 2"),
        "{message}"
    );
    let message = refusal(&(level.clone() + "Part\nFrame\n1\nEnd\n"));
    assert!(
        message.contains("the blocks RecordingFilter, Part, expected a block Profile"),
        "{message}"
    );
    let tilted = refusal(&(head("1,100.0", "2.5") + "Part\nFrame\n1\nEnd\n"));
    assert!(
        tilted.contains("the blocks RecordingFilter, Part"),
        "{tilted}"
    );
    let message = refusal(&(level.clone() + &uniform(ROWS) + &raw("")));
    assert!(
        message.contains("second block of profiles, RawProfile"),
        "{message}"
    );
    let message = refusal(&(level.clone() + &uniform(ROWS).replace("2,3,-0.5", "2,4,-0.5")));
    assert!(
        message.contains("3 columns after Axis, expected 4"),
        "{message}"
    );
    let message = refusal(&(level.clone() + &uniform(ROWS).replace("2,3,-0.5", "2,3,-30.5")));
    assert!(
        message.contains("columns from -0.5 mm, expected from -30.5 mm"),
        "{message}"
    );
    let message = with_rows(&ROWS.replace("8,0,", "8,1,"));
    assert!(
        message.contains("source 1 among those of source 0"),
        "{message}"
    );
    let message = with_rows(&ROWS.replace("10250240", "9000000"));
    assert!(message.contains("in time order"), "{message}");
    let message = with_rows(&ROWS.replace(",I,", ",Z,"));
    assert!(message.contains("axis Z of frame 7 twice"), "{message}");
    let message = with_rows(&ROWS.replace(",I,", ",X,"));
    assert!(
        message.contains("line 24: found `X` in column Axis, expected Z or I"),
        "{message}"
    );
    let message = with_rows(&ROWS.replace("3.000", "3.0mm"));
    assert!(
        message.contains("`3.0mm` in column 0.50000, expected a finite number"),
        "{message}"
    );
    let message = with_rows(&ROWS.replace("3.000", "3.000,4"));
    assert!(message.contains("13 values, expected 12"), "{message}");
    let message = refusal(&(level.clone() + uniform(ROWS).trim_end_matches("End\n")));
    assert!(
        message.contains("the end of the file, expected `End`"),
        "{message}"
    );
    let message = with_rows("");
    assert!(message.contains("no valid point"), "{message}");
}

#[test]
fn damaged_files_do_not_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("replay.csv");
    for block in [uniform(ROWS), raw(ROWS)] {
        let valid = head("0,100.0", "0.0") + &block;
        crate::format::mutation::for_each_damaged(&path, valid.as_bytes(), 500, || {
            let mut chunk = Vec::new();
            if let Ok(mut reader) = GocatorCsv::open(&Input::from(&path)) {
                while reader.next_chunk(&mut chunk).is_ok_and(|more| more) {}
            }
        });
    }
}
