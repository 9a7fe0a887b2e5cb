//! Dates and times of day as numbers.

/// Seconds of a day, without leap seconds.
pub(crate) const DAY_S: f64 = 86_400.0;

/// The days from 1970-01-01 to a date of the Gregorian calendar; `None` if there is no such date.
pub(crate) fn days_since_1970(year: i64, month: i64, day: i64) -> Option<i64> {
    let leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let length = match month {
        2 => 28 + i64::from(leap),
        4 | 6 | 9 | 11 => 30,
        1..=12 => 31,
        _ => return None,
    };
    if !(1..=9999).contains(&year) || !(1..=length).contains(&day) {
        return None;
    }
    // Years start in March, so that the leap day is the last one.
    let (year, month) = match month {
        1 | 2 => (year - 1, month + 9),
        _ => (year, month - 3),
    };
    let day_of_year = (153 * month + 2) / 5 + day - 1;
    let leap_days = year / 4 - year / 100 + year / 400;
    Some(365 * year + leap_days + day_of_year - 719_468)
}

/// The days from 1970-01-01 to a date written as YYYY-MM-DD; `None` if there is no such date.
pub fn day_number(date: &str) -> Option<i64> {
    let bytes = date.as_bytes();
    let has_marks = bytes.len() == 10 && (bytes[4], bytes[7]) == (b'-', b'-');
    let number = |range: std::ops::Range<usize>| -> Option<i64> {
        let digits = date.get(range)?;
        let are_digits = digits.bytes().all(|b| b.is_ascii_digit());
        are_digits.then(|| digits.parse().ok()).flatten()
    };
    let day = days_since_1970(number(0..4)?, number(5..7)?, number(8..10)?);
    day.filter(|_| has_marks)
}

/// Year, month and day of the date that is `days` after 1970-01-01.
pub(crate) fn civil_date(days: i64) -> (i64, i64, i64) {
    // Starts at or before the right year, as years have 365.2425 days on average.
    let mut year = 1970 + (days as f64 / 365.2425).floor() as i64 - 1;
    let begun = |year: i64, month: i64| days_since_1970(year, month, 1).is_some_and(|d| d <= days);
    while begun(year + 1, 1) {
        year += 1;
    }
    let month = (1..=12).rfind(|month| begun(year, *month)).unwrap_or(1);
    (
        year,
        month,
        days - days_since_1970(year, month, 1).unwrap_or(days) + 1,
    )
}

/// The seconds since midnight; `None` if there is no such time. Second 60 is a leap second.
pub(crate) fn second_of_day(hour: u32, minute: u32, second_s: f64) -> Option<f64> {
    let is_time = hour < 24 && minute < 60 && (0.0..61.0).contains(&second_s);
    is_time.then(|| f64::from(hour * 3600 + minute * 60) + second_s)
}

/// The Unix time at a date with a time of day of UTC: `2024-05-01T12:00:00.25Z`, also with a blank in place of the `T`
/// and with an offset such as `+02:00` in place of the `Z`; `None` for other text.
pub(crate) fn unix_from_iso(text: &str) -> Option<f64> {
    let (date, time) = text.trim().split_once(['T', ' '])?;
    let at = time.find(['Z', 'z', '+', '-']).unwrap_or(time.len());
    let (time, zone) = time.split_at(at);
    let offset_s = match zone {
        "" | "Z" | "z" => 0.0,
        _ => {
            let sign = if zone.starts_with('-') { -1.0 } else { 1.0 };
            let (hours, minutes) = zone[1..].split_once(':').unwrap_or((&zone[1..], "0"));
            sign * second_of_day(hours.parse().ok()?, minutes.parse().ok()?, 0.0)?
        }
    };
    let (hour, rest) = time.split_once(':')?;
    let (minute, second) = rest.split_once(':').unwrap_or((rest, "0"));
    let second = second_of_day(
        hour.parse().ok()?,
        minute.parse().ok()?,
        second.parse().ok()?,
    )?;
    Some(day_number(date)? as f64 * DAY_S + second - offset_s)
}

/// Times (Unix seconds) from which GPS is ahead of UTC, and by how many seconds.
const LEAP_SECONDS: [(f64, f64); 19] = [
    (315_964_800.0, 0.0),
    (362_793_600.0, 1.0),
    (394_329_600.0, 2.0),
    (425_865_600.0, 3.0),
    (489_024_000.0, 4.0),
    (567_993_600.0, 5.0),
    (631_152_000.0, 6.0),
    (662_688_000.0, 7.0),
    (709_948_800.0, 8.0),
    (741_484_800.0, 9.0),
    (773_020_800.0, 10.0),
    (820_454_400.0, 11.0),
    (867_715_200.0, 12.0),
    (915_148_800.0, 13.0),
    (1_136_073_600.0, 14.0),
    (1_230_768_000.0, 15.0),
    (1_341_100_800.0, 16.0),
    (1_435_708_800.0, 17.0),
    (1_483_228_800.0, 18.0),
];

/// Adjusted standard GPS time is smaller than GPS time by this, seconds (LAS 1.4, global encoding).
const GPS_ADJUSTMENT_S: f64 = 1e9;

/// GPS time, seconds since 1980-01-06, at a Unix time.
pub(crate) fn gps_from_unix_s(unix_s: f64) -> f64 {
    let ahead_s = LEAP_SECONDS.iter().rfind(|(from_s, _)| *from_s <= unix_s);
    unix_s - LEAP_SECONDS[0].0 + ahead_s.map_or(0.0, |(_, ahead_s)| *ahead_s)
}

/// The Unix time at a GPS time, seconds since 1980-01-06. A leap second gives the later of its two Unix times.
pub(crate) fn unix_from_gps_s(gps_s: f64) -> f64 {
    let begun = |(from_s, ahead_s): &&(f64, f64)| from_s - LEAP_SECONDS[0].0 + ahead_s <= gps_s;
    let ahead_s = LEAP_SECONDS.iter().rfind(begun);
    gps_s + LEAP_SECONDS[0].0 - ahead_s.map_or(0.0, |(_, ahead_s)| *ahead_s)
}

/// Adjusted standard GPS time, seconds since 1980-01-06 less 10⁹, at a Unix time.
pub(crate) fn adjusted_gps_from_unix_s(unix_s: f64) -> f64 {
    gps_from_unix_s(unix_s) - GPS_ADJUSTMENT_S
}

/// The Unix time at an adjusted standard GPS time.
pub(crate) fn unix_from_adjusted_gps_s(time_s: f64) -> f64 {
    unix_from_gps_s(time_s + GPS_ADJUSTMENT_S)
}

/// Formats seconds since 1970 as date and time, `2026-11-23 08:29:20`.
pub fn civil_time(time_s: f64) -> String {
    let (days, second) = ((time_s / DAY_S).floor(), time_s.rem_euclid(DAY_S));
    let (year, month, day) = civil_date(days as i64);
    let (hour, minute) = ((second / 3600.0) as u32, (second / 60.0) as u32 % 60);
    let second = (second % 60.0).floor() as u32;
    format!("{year}-{month:02}-{day:02} {hour:02}:{minute:02}:{second:02}")
}

/// Formats seconds of the Unix epoch from 2000 to 2100 as date and time; `None` for other times, which must be of
/// another clock.
pub fn utc(time_s: f64) -> Option<String> {
    const FROM_S: f64 = 946_684_800.0;
    const TO_S: f64 = 4_102_444_800.0;
    let is_likely = (FROM_S..TO_S).contains(&time_s);
    is_likely.then(|| civil_time(time_s))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_have_their_dates() {
        for days in (-1000..40_000).step_by(13).chain([59, 60, 11_016, 11_017]) {
            let (year, month, day) = civil_date(days);
            assert_eq!(days_since_1970(year, month, day), Some(days));
        }
    }

    #[test]
    fn dates_have_their_days() {
        for (date, expected) in [
            ((1970, 1, 1), Some(0)),
            ((1969, 12, 31), Some(-1)),
            ((2000, 2, 29), Some(11_016)),
            ((2000, 3, 1), Some(11_017)),
            ((2024, 12, 31), Some(20_088)),
            ((1900, 2, 29), None),
            ((2023, 2, 29), None),
            ((2023, 4, 31), None),
            ((2023, 13, 1), None),
            ((2023, 0, 1), None),
            ((0, 1, 1), None),
            ((i64::MAX, 1, 1), None),
            ((2023, 1, i64::MIN), None),
        ] {
            let (year, month, day) = date;
            assert_eq!(days_since_1970(year, month, day), expected, "{date:?}");
        }
        let mut days = (1..10_000).flat_map(|year| {
            (1..=12).flat_map(move |month| {
                (1..=31).filter_map(move |day| days_since_1970(year, month, day))
            })
        });
        let first = days.next().unwrap();
        assert!(days.enumerate().all(|(i, day)| day == first + 1 + i as i64));
    }

    #[test]
    fn times_of_day_have_their_seconds() {
        assert_eq!(second_of_day(23, 59, 60.5), Some(86_400.5));
        for (hour, minute, second_s) in [(24, 0, 0.0), (0, 60, 0.0), (0, 0, 61.0), (0, 0, -0.1)] {
            assert_eq!(second_of_day(hour, minute, second_s), None);
        }
        assert_eq!(second_of_day(1, 2, f64::NAN), None);
    }

    #[test]
    fn leap_seconds_begin_on_their_days() {
        for (number, (from_s, ahead_s)) in LEAP_SECONDS.iter().enumerate() {
            assert_eq!(*ahead_s, number as f64);
            let (_, month, day) = civil_date((from_s / DAY_S) as i64);
            assert!(number == 0 || [(1, 1), (7, 1)].contains(&(month, day)));
            assert_eq!(from_s % DAY_S, 0.0);
        }
        // GPS week 2238 began on 2022-11-27 at 18 s before midnight UTC.
        let unix_s = days_since_1970(2022, 11, 27).unwrap() as f64 * DAY_S - 18.0;
        assert_eq!(gps_from_unix_s(unix_s), 2238.0 * 7.0 * DAY_S);
        for unix_s in [unix_s, 1_483_228_799.25, 1_483_228_800.0, 4e8] {
            assert_eq!(unix_from_gps_s(gps_from_unix_s(unix_s)), unix_s);
        }
    }

    #[test]
    fn dates_with_times_are_unix_times() {
        for text in [
            "2023-11-14T22:13:20.5Z",
            "2023-11-14 22:13:20.5",
            "2023-11-15T00:13:20.5+02:00",
        ] {
            assert_eq!(unix_from_iso(text), Some(1_700_000_000.5), "{text}");
        }
        for text in [
            "2023-11-14",
            "22:13:20",
            "2023-13-14T22:13:20Z",
            "2023-11-14T25:13:20Z",
            "a T b",
        ] {
            assert_eq!(unix_from_iso(text), None, "{text}");
        }
    }

    #[test]
    fn dates_count_days() {
        assert_eq!(day_number("1970-01-01"), Some(0));
        assert_eq!(day_number("2000-03-01"), Some(11_017));
        assert_eq!(
            day_number("2024-02-29"),
            day_number("2024-03-01").map(|d| d - 1)
        );
        for wrong in [
            "2025-02-29",
            "2025-13-01",
            "20250501",
            "2025-5-001",
            "2025-00-10",
            "+025-05-01",
        ] {
            assert_eq!(day_number(wrong), None, "{wrong}");
        }
    }
}
