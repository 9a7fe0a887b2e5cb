//! Text exports of the program sbgBasicLogger of SBG Systems (sbgECom 4 and 5): one file per message,
//! `imuShort.txt`, `imuData.txt` or `gnss1Hdt.txt`. A line of names and a line of units are followed by
//! rows, with tabs between cells:
//!
//! ```text
//! timestamp  status      accelX     accelY     accelZ     gyroX        gyroY        gyroZ        temperature
//! (us)       (na)        (m.s^-2)   (m.s^-2)   (m.s^-2)   (deg.s^-1)   (deg.s^-1)   (deg.s^-1)   (degC)
//! ```
//!
//! If the program was asked for UTC, the first column is `iso8601Time` instead of `timestamp`. Exports
//! of sbgCenter and Qinertia are not read.
//!
//! The program treats the UTC of the device as local time: on a computer whose time zone is not UTC,
//! times are off by the zone. The binary log does not have this fault and should be preferred.

use crate::error::{Error, Location, Result};
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::log::sbg::clock::{DeviceClock, seconds, unix_ns};
use crate::format::text::lines::{Lines, Separator};
use crate::geometry::Vec3;
use crate::sensor::{HeadingFix, ImuSample};

/// Name and unit of the first column: the clock of the device, and UTC.
const STAMP: (&str, &str) = ("timestamp", "(us)");
const UTC: (&str, &str) = ("iso8601Time", "(yyyy-mm-ddThh:mm:ss.ssssssZ)");
/// Names and units of the columns that are read.
const IMU: [(&str, &str); 6] = [
    ("gyroX", "(deg.s^-1)"),
    ("gyroY", "(deg.s^-1)"),
    ("gyroZ", "(deg.s^-1)"),
    ("accelX", "(m.s^-2)"),
    ("accelY", "(m.s^-2)"),
    ("accelZ", "(m.s^-2)"),
];
const HEADING: [(&str, &str); 4] = [
    ("heading", "(deg)"),
    ("headingStd", "(deg)"),
    ("pitch", "(deg)"),
    ("pitchStd", "(deg)"),
];

pub(crate) const EXPORT: Kind = Kind {
    signature: Some(|start| looks_like(start.bytes)),
    imu: Some(read_imu),
    heading: Some(read_heading),
    frame: Frame::Fixed(
        "degrees and m/s² (named in the file); axes of the device, x forward, y right, z down unless set otherwise; headings clockwise from north",
    ),
    ..Kind::new("sbg-text", "log of IMU or GNSS (SBG text export)")
};

/// Whether these are the first bytes of an export with samples of the IMU or with headings.
pub(crate) fn looks_like(start: &[u8]) -> bool {
    let line = start.split(|b| *b == b'\n').next().unwrap_or_default();
    let Ok(line) = std::str::from_utf8(line) else {
        return false;
    };
    let names = Separator::Space.names(line);
    let has = |wanted: &str| names.iter().any(|name| name == wanted);
    let is_timed = [STAMP.0, UTC.0]
        .map(Some)
        .contains(&names.first().map(String::as_str));
    let is_imu = IMU.iter().all(|(name, _)| has(name));
    is_timed && has("status") && (is_imu || HEADING.iter().all(|(name, _)| has(name)))
}

/// Reads the samples of the IMU in the order of the file. They are those of IMU_SHORT or IMU_DATA in the
/// axes of the device, see [`read_imu`](crate::format::log::sbg::read_imu) of the binary log; or those of
/// FAST_IMU_DATA, whose file has the same columns. Samples without contact to the IMU are left out.
///
/// Times are UTC in seconds of the Unix epoch if the export has UTC; rows before the device knew UTC
/// are then left out. Otherwise times are seconds of the clock of the device, with roll-overs undone. If
/// the program was asked to average samples, the time is that of the last sample of each group.
///
/// # Errors
/// Missing columns, other units, cells that are not finite numbers, no usable row.
pub(crate) fn read_imu(input: &Input) -> Result<Vec<ImuSample>> {
    read(
        input,
        &IMU,
        "sample of the IMU",
        |time_s, state, row: &[f64; 6]| {
            let contact = state & 1 != 0;
            contact.then(|| ImuSample {
                time_s,
                gyro_rad_s: Vec3::new(row[0], row[1], row[2]).map(f64::to_radians),
                accel_m_s2: Vec3::new(row[3], row[4], row[5]),
            })
        },
    )
}

/// Reads the true headings of the baseline from the main to the auxiliary antenna. Rows without a
/// solution are left out as in the binary log; times are as in [`read_imu`].
///
/// # Errors
/// Those of [`read_imu`].
pub(crate) fn read_heading(input: &Input) -> Result<Vec<HeadingFix>> {
    read(
        input,
        &HEADING,
        "heading",
        |time_s, state, row: &[f64; 4]| {
            let [heading_deg, sigma_deg, pitch_deg, pitch_sigma_deg] = *row;
            let within = |sigma: f64, most: f64| 0.0 < sigma && sigma < most;
            let has_pitch = within(pitch_sigma_deg, 90.0) && pitch_deg.abs() <= 90.0;
            let has_heading = state & 0x3f == 0 && within(sigma_deg, 180.0);
            has_heading.then(|| HeadingFix {
                time_s,
                heading_rad: heading_deg.to_radians(),
                sigma_rad: Some(sigma_deg.to_radians()),
                pitch_rad: has_pitch.then(|| pitch_deg.to_radians()),
                pitch_sigma_rad: has_pitch.then(|| pitch_sigma_deg.to_radians()),
            })
        },
    )
}

/// Reads all rows; `record` gets the time, the status and the values of the wanted columns.
fn read<const N: usize, T>(
    input: &Input,
    wanted: &[(&str, &str); N],
    what: &str,
    record: impl Fn(f64, u32, &[f64; N]) -> Option<T>,
) -> Result<Vec<T>> {
    let mut lines = Lines::open(input)?;
    let header = Header::read(&mut lines, wanted)?;
    let mut clock = DeviceClock::default();
    let mut records = Vec::new();
    let mut rows: u64 = 0;
    while lines.advance()? {
        let text = lines.text();
        if text.is_empty() {
            continue;
        }
        rows += 1;
        let cells: Vec<&str> = text.split_ascii_whitespace().collect();
        if cells.len() != header.width {
            let found = format!("{} values", cells.len());
            return Err(lines.error(found, format!("{} as in the header", header.width)));
        }
        let bad = |cell: &str, expected: &str| {
            let cell: String = cell.chars().take(40).collect();
            lines.error(format!("`{cell}`"), expected)
        };
        let time_s = match (header.is_utc, cells[0].parse::<u32>()) {
            // The device did not know UTC yet.
            (true, Ok(_)) => continue,
            (true, Err(_)) => utc_s(cells[0])
                .ok_or_else(|| bad(cells[0], "a time (yyyy-mm-ddThh:mm:ss.ssssssZ)"))?,
            (false, Ok(stamp_us)) => seconds(1000 * clock.unwrapped_us(stamp_us)),
            (false, Err(_)) => return Err(bad(cells[0], "microseconds of 32 bits")),
        };
        let status = cells[header.status];
        let state = status_bits(status).ok_or_else(|| bad(status, "a status of 32 bits"))?;
        let mut row = [0.0; N];
        for (value, index) in row.iter_mut().zip(header.indices) {
            let number = cells[index].parse().ok().filter(|v: &f64| v.is_finite());
            *value = number.ok_or_else(|| bad(cells[index], "a finite number"))?;
        }
        records.extend(record(time_s, state, &row));
    }
    if records.is_empty() {
        let found = format!("{rows} rows, none of them usable");
        let expected = if header.is_utc {
            format!("at least one {what} with UTC")
        } else {
            format!("at least one {what}")
        };
        return Err(Error::format(
            input.path(),
            Location::Whole,
            found,
            expected,
        ));
    }
    Ok(records)
}

/// The first two lines of an export.
struct Header<const N: usize> {
    is_utc: bool,
    status: usize,
    /// Indices of the wanted columns.
    indices: [usize; N],
    width: usize,
}

impl<const N: usize> Header<N> {
    fn read(lines: &mut Lines, wanted: &[(&str, &str); N]) -> Result<Self> {
        lines.advance()?;
        let names = Separator::Space.names(lines.text());
        let index = |wanted: &str| names.iter().position(|name| name == wanted);
        let missing = |name: &str| {
            let found: String = lines.text().chars().take(200).collect();
            let expected = format!("a header of sbgBasicLogger with {name}");
            lines.error(format!("`{found}`"), expected)
        };
        let is_utc = match index(UTC.0) {
            Some(0) => true,
            _ if index(STAMP.0) == Some(0) => false,
            _ => return Err(missing("timestamp or iso8601Time in the first column")),
        };
        let status = index("status").ok_or_else(|| missing("status"))?;
        let mut indices = [0; N];
        for (slot, (name, _)) in indices.iter_mut().zip(wanted) {
            *slot = index(name).ok_or_else(|| missing(name))?;
        }
        lines.advance()?;
        let units = Separator::Space.names(lines.text());
        let time = (0, if is_utc { UTC } else { STAMP });
        let columns = indices.into_iter().zip(*wanted).chain([time]);
        for (index, (name, unit)) in columns {
            if units.get(index).is_none_or(|other| other != unit) {
                let found = units.get(index).map_or("no unit", String::as_str);
                return Err(lines.error(format!("{found} of {name}"), unit));
            }
        }
        Ok(Self {
            is_utc,
            status,
            indices,
            width: names.len(),
        })
    }
}

/// A status, hexadecimal with `0x` or decimal.
fn status_bits(cell: &str) -> Option<u32> {
    match cell.strip_prefix("0x") {
        Some(digits) => u32::from_str_radix(digits, 16).ok(),
        None => cell.parse().ok(),
    }
}

/// Seconds of the Unix epoch of a time like `2024-02-28T23:58:59.990155Z`.
fn utc_s(cell: &str) -> Option<f64> {
    let (date, time) = cell.strip_suffix('Z')?.split_once('T')?;
    let (time, us) = time.split_once('.')?;
    let numbers = |text: &str, separator| {
        let mut numbers = text.split(separator).map(|part| part.parse::<u16>().ok());
        let three = [numbers.next()??, numbers.next()??, numbers.next()??];
        numbers.next().is_none().then_some(three.map(i64::from))
    };
    let us: u32 = us.parse().ok().filter(|_| us.len() == 6)?;
    unix_ns(
        numbers(date, '-')?,
        numbers(time, ':')?,
        1000 * i64::from(us),
    )
    .map(seconds)
}

#[cfg(test)]
mod tests {
    use super::*;

    const IMU_UTC: &str = "iso8601Time\tstatus\taccelX\taccelY\taccelZ\tgyroX\tgyroY\tgyroZ\ttemperature\n\
        (yyyy-mm-ddThh:mm:ss.ssssssZ)\t(na)\t(m.s^-2)\t(m.s^-2)\t(m.s^-2)\t(deg.s^-1)\t(deg.s^-1)\t(deg.s^-1)\t(degC)\n\
        \x20                4294964796\t0x000003ff\t62.522563934\t74.401199341\t65.168609619\t-35.839474481\t-6.327862054\t-13.551998606\t31.250000000\n\
        2024-02-28T23:58:59.988654Z\t0x000003ff\t-10.660919189\t19.918996811\t13.338200569\t56.564785347\t15.947016391\t23.536657710\t31.250000000\n";
    const IMU_STAMPS: &str = "timestamp\tstatus\taccelX\taccelY\taccelZ\tgyroX\tgyroY\tgyroZ\ttemperature\n\
        (us)\t(na)\t(m.s^-2)\t(m.s^-2)\t(m.s^-2)\t(deg.s^-1)\t(deg.s^-1)\t(deg.s^-1)\t(degC)\n\
        4294966796\t0x000007ff\t51.449317932\t44.919189453\t-17.550506592\t-5015.819030287\t-891.993363111\t-4759.206746792\t31.250000000\n\
        \x20      500\t0x000003ff\t59.751346588\t31.161146164\t79.747344971\t-13.433913173\t33.399218645\t46.366179105\t31.250000000\n";
    const HEADINGS: &str = "timestamp\tstatus\tgpsTow\theading\theadingStd\tpitch\tpitchStd\tbaseline\tnumSvTracked\tnumSvUsed\n\
        (us)\t(na)\t(ms)\t(deg)\t(deg)\t(deg)\t(deg)\t(m)\t(na)\t(na)\n\
        4294965496\t0x0041\t5\t173.461654663\t1.092898011\t16.543762207\t2.939633369\t1.000000000\t255\t255\n\
        \x20      200\t0x0000\t5\t275.258972168\t0.030753961\t44.118446350\t1.045792699\t1.000000000\t255\t255\n";

    fn with_file<T>(text: &str, check: impl FnOnce(&Input) -> T) -> T {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("imuShort.txt");
        std::fs::write(&path, text).unwrap();
        check(&Input::from(&path))
    }

    fn is_close(found: &Vec3, expected: [f64; 3], tolerance: f64) -> bool {
        (found - Vec3::from(expected)).amax() < tolerance
    }

    #[test]
    fn exports_of_the_manufacturer_are_read() {
        // Written by sbgBasicLogger 5.2.590; the values are those of the binary log in the tests of `sbg`.
        let [sample] = with_file(IMU_UTC, read_imu).unwrap()[..] else {
            panic!("one sample");
        };
        assert_eq!(sample.time_s, 1_709_164_739.988_654);
        assert!(is_close(
            &sample.gyro_rad_s,
            [0.987241745, 0.278327942, 0.410792172],
            1e-7
        ));
        assert!(is_close(
            &sample.accel_m_s2,
            [-10.6609192, 19.9189968, 13.3382006],
            1e-6
        ));
        let [before, after] = with_file(IMU_STAMPS, read_imu).unwrap()[..] else {
            panic!("two samples");
        };
        assert_eq!([before.time_s, after.time_s], [4294.966796, 4294.967796]);
        assert!(is_close(
            &before.gyro_rad_s,
            [-87.5425568, -15.5682211, -83.0638275],
            1e-5
        ));
        let [fix] = with_file(HEADINGS, read_heading).unwrap()[..] else {
            panic!("one heading");
        };
        assert_eq!(fix.time_s, 4294.967496);
        assert_eq!(fix.heading_rad, 275.258972168_f64.to_radians());
        assert_eq!(fix.sigma_rad, Some(0.030753961_f64.to_radians()));
        assert_eq!(fix.pitch_rad, Some(44.11844635_f64.to_radians()));
        assert_eq!(fix.pitch_sigma_rad, Some(1.045792699_f64.to_radians()));
        for text in [IMU_UTC, IMU_STAMPS, HEADINGS] {
            assert!(looks_like(text.as_bytes()));
        }
        assert!(!looks_like(b"time_s,heading_deg\n") && !looks_like(b"\xff\x5a"));
    }

    #[test]
    fn rows_without_a_measurement_are_left_out() {
        let text = IMU_STAMPS.replace("0x000007ff", "0x000007fe");
        assert_eq!(with_file(&text, read_imu).unwrap().len(), 1);
        let text = HEADINGS.replace("1.045792699", "90.000000000");
        let fix = with_file(&text, read_heading).unwrap()[0];
        assert_eq!((fix.pitch_rad, fix.pitch_sigma_rad), (None, None));
        let text = HEADINGS.replace("0.030753961", "180.000000000");
        let error = with_file(&text, read_heading).unwrap_err().to_string();
        assert!(error.contains("2 rows, none of them usable"), "{error}");
        let text: String = IMU_UTC.split_inclusive('\n').take(3).collect();
        let error = with_file(&text, read_imu).unwrap_err().to_string();
        assert!(
            error.contains("at least one sample of the IMU with UTC"),
            "{error}"
        );
    }

    #[test]
    fn errors_name_the_fault() {
        for (from, to, expected) in [
            ("accelY", "accel", "line 1: found `timestamp"),
            (
                "timestamp",
                "time",
                "timestamp or iso8601Time in the first column",
            ),
            (
                "(deg.s^-1)",
                "(rad.s^-1)",
                "line 2: found (rad.s^-1) of gyroX, expected (deg.s^-1)",
            ),
            ("(us)", "(ms)", "line 2: found (ms) of timestamp"),
            (
                "0x000007ff",
                "0xx",
                "line 3: found `0xx`, expected a status",
            ),
            (
                "4294966796",
                "4294967296",
                "line 3: found `4294967296`, expected microseconds",
            ),
            (
                "44.919189453",
                "nan",
                "line 3: found `nan`, expected a finite number",
            ),
            (
                "\t31.250000000\n",
                "\n",
                "line 3: found 8 values, expected 9 as in the header",
            ),
        ] {
            let text = IMU_STAMPS.replacen(from, to, 1);
            let error = with_file(&text, read_imu).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
        for time in [
            "2024-02-30T23:58:59.988654Z",
            "2024-02-28T23:58:59Z",
            "x",
            "TZ",
            "-1",
        ] {
            let text = IMU_UTC.replace("2024-02-28T23:58:59.988654Z", time);
            let error = with_file(&text, read_imu).unwrap_err().to_string();
            assert!(
                error.contains("line 4") && error.contains("expected a time"),
                "{error}"
            );
        }
    }
}
