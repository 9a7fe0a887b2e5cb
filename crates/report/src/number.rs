//! Numbers as text: rounding, units, a true minus sign, and a dash for values that are not finite.

/// Shown for a missing number.
pub const DASH: &str = "–";
/// Between groups of three digits, and between number and unit.
const NARROW_SPACE: char = '\u{202f}';

/// `value` with this many decimals.
pub fn fixed(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return DASH.to_owned();
    }
    let text = format!("{:.decimals$}", value.abs());
    let is_zero = text.bytes().all(|b| b == b'0' || b == b'.');
    let (whole, fraction) = text.split_once('.').unwrap_or((&text, ""));
    let mut out = String::new();
    if value < 0.0 && !is_zero {
        out.push('−');
    }
    out.push_str(&grouped(whole));
    if !fraction.is_empty() {
        out.push('.');
        out.push_str(fraction);
    }
    out
}

/// Digits in groups of three from 10 000 on.
fn grouped(digits: &str) -> String {
    if digits.len() < 5 {
        return digits.to_owned();
    }
    let mut out = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(NARROW_SPACE);
        }
        out.push(c);
    }
    out
}

/// A whole number.
pub fn count(n: usize) -> String {
    grouped(&n.to_string())
}

/// Number of decimals for `digits` significant digits of `value`, at most `most`.
fn decimals(value: f64, digits: i32, most: i32) -> usize {
    if value == 0.0 || !value.is_finite() {
        return 0;
    }
    (digits - 1 - value.abs().log10().floor() as i32).clamp(0, most) as usize
}

/// `value` with this many significant digits.
pub fn significant(value: f64, digits: i32) -> String {
    fixed(value, decimals(value, digits, 12))
}

/// 10 to this power.
pub fn power(exponent: i32) -> String {
    let raised: String = exponent
        .to_string()
        .chars()
        .map(|c| match c {
            '-' => '⁻',
            '0' => '⁰',
            '1' => '¹',
            '2' => '²',
            '3' => '³',
            '4' => '⁴',
            '5' => '⁵',
            '6' => '⁶',
            '7' => '⁷',
            '8' => '⁸',
            _ => '⁹',
        })
        .collect();
    format!("10{raised}")
}

/// `text` and a unit, kept on one line; a dash stands alone.
pub fn with_unit(text: String, unit: &str) -> String {
    if text == DASH {
        text
    } else {
        format!("{text}{NARROW_SPACE}{unit}")
    }
}

/// Puts a `+` before positive numbers.
pub fn signed(text: String) -> String {
    let positive = text.bytes().any(|b| (b'1'..=b'9').contains(&b)) && !text.starts_with('−');
    if positive { format!("+{text}") } else { text }
}

/// A length of `metres` as a number of millimetres: three digits, to 0.01 mm.
pub fn millimetres(metres: f64) -> String {
    fixed(metres * 1e3, decimals(metres * 1e3, 3, 2).min(2))
}

/// A length of `metres` in a sentence: to the millimetre from 1 cm on, two digits below 1 mm.
pub fn length(metres: f64) -> String {
    let mm = metres * 1e3;
    match mm {
        _ if !mm.is_finite() => DASH.into(),
        10.0.. => format!("{mm:.0} mm"),
        1.0.. => format!("{mm:.1} mm"),
        _ => format!("{} mm", fixed(mm, decimals(mm, 2, 4))),
    }
}

/// A standard deviation as a number: two digits, to 0.001.
pub fn sigma(value: f64) -> String {
    fixed(value, decimals(value, 2, 4))
}

/// The fewest digits that give `value` to ten significant digits: for round settings.
pub fn shortest(value: f64) -> String {
    let all = decimals(value, 10, 12);
    let text = fixed(value, all);
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

/// A voxel size of `metres`.
pub fn voxel(metres: f64) -> String {
    with_unit(shortest(metres * 1e3), "mm")
}

/// A duration.
pub fn duration(seconds: f64) -> String {
    if seconds.is_finite() && seconds >= 100.0 {
        let whole = seconds.round() as u64;
        return format!(
            "{}{NARROW_SPACE}min {:02}{NARROW_SPACE}s",
            whole / 60,
            whole % 60
        );
    }
    with_unit(fixed(seconds, decimals(seconds, 3, 2)), "s")
}

/// An amount of memory.
pub fn memory(bytes: u64) -> String {
    let mib = bytes as f64 / f64::from(1u32 << 20);
    if mib < 1000.0 {
        with_unit(fixed(mib, 0), "MiB")
    } else {
        with_unit(fixed(mib / 1024.0, 2), "GiB")
    }
}

/// The smallest of 1, 2, 5 times a power of ten that is not below `value`.
pub fn nice_above(value: f64) -> f64 {
    if !(value > 0.0 && value.is_finite()) {
        return 1.0;
    }
    let decade = 10f64.powf(value.log10().floor());
    // A small tolerance, so that 5.000000001 gives 5.
    for factor in [1.0, 2.0, 5.0] {
        if value <= factor * decade * (1.0 + 1e-9) {
            return factor * decade;
        }
    }
    10.0 * decade
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_as_a_surveyor_writes_them() {
        assert_eq!(fixed(-0.0004, 3), "0.000");
        assert_eq!(fixed(-1.5, 1), "−1.5");
        assert_eq!(fixed(f64::NAN, 2), DASH);
        assert_eq!(with_unit(fixed(f64::INFINITY, 2), "mm"), DASH);
        assert_eq!(count(1234567), "1\u{202f}234\u{202f}567");
        assert_eq!(count(1234), "1234");
        assert_eq!(millimetres(0.00132), "1.32");
        assert_eq!(millimetres(0.0431), "43.1");
        assert_eq!(millimetres(0.125), "125");
        assert_eq!(length(0.0431), "43 mm");
        assert_eq!(length(0.00132), "1.3 mm");
        assert_eq!(length(0.000_147), "0.15 mm");
        assert_eq!(length(0.0), "0 mm");
        assert_eq!(length(f64::NAN), DASH);
        assert_eq!(sigma(0.00432), "0.0043");
        assert_eq!(significant(0.012_34, 2), "0.012");
        assert_eq!(significant(1678.4, 3), "1678");
        assert_eq!(power(-12), "10⁻¹²");
        assert_eq!(signed(fixed(0.3, 1)), "+0.3");
        assert_eq!(signed(fixed(0.0, 1)), "0.0");
        assert_eq!(duration(125.4), "2\u{202f}min 05\u{202f}s");
        assert_eq!(duration(0.0), "0\u{202f}s");
        assert_eq!(shortest(-0.1 * 25.0), "−2.5");
        assert_eq!(shortest(50.0), "50");
        assert_eq!(shortest(0.0), "0");
        assert_eq!(voxel(f64::NAN), DASH);
        assert_eq!(voxel(0.005), "5\u{202f}mm");
    }

    #[test]
    fn nice_numbers_are_not_below() {
        for (value, nice) in [(0.9, 1.0), (1.0, 1.0), (1.3, 2.0), (4.9, 5.0), (6.0, 10.0)] {
            assert!((nice_above(value) - nice).abs() < 1e-12, "{value}");
            assert!((nice_above(value * 1e-3) - nice * 1e-3).abs() < 1e-15);
        }
        assert_eq!(nice_above(f64::NAN), 1.0);
        assert_eq!(nice_above(0.0), 1.0);
    }
}
