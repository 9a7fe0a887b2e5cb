//! Axes of charts: ends, ticks, and decimation of the curves drawn over them.

use crate::number;

/// Maximum number of ticks: no axis has room for more.
const MAX_TICKS: i64 = 1000;
/// Minimum number of ticks on an axis.
const LEAST_TICKS: usize = 3;

/// One axis.
#[derive(Debug, Clone)]
pub struct Axis {
    /// Quantity and unit, for example "time (s)"; may be empty.
    pub label: String,
    /// Lower end.
    pub min: f64,
    /// Upper end, above `min`.
    pub max: f64,
    /// Whether the axis is logarithmic; `min` is then positive.
    pub log: bool,
}

impl Axis {
    /// A linear axis over the finite `values`.
    pub fn over(label: &str, values: impl IntoIterator<Item = f64>) -> Self {
        let (min, max) = range(values).unwrap_or((0.0, 1.0));
        let spare = if max > min {
            0.0
        } else {
            0.5 * min.abs().max(1.0)
        };
        Self {
            label: label.to_owned(),
            min: min - spare,
            max: max + spare,
            log: false,
        }
    }

    /// A linear axis over `values` that ends at ticks.
    pub fn rounded(label: &str, values: impl IntoIterator<Item = f64>) -> Self {
        let mut axis = Self::over(label, values);
        let step = axis.step(5.0);
        axis.min = (axis.min / step + 1e-9).floor() * step;
        axis.max = (axis.max / step - 1e-9).ceil() * step;
        axis
    }

    /// A logarithmic axis over the positive finite `values`, with ends of 1, 2 or 5 times a power
    /// of ten.
    pub fn logarithmic(label: &str, values: impl IntoIterator<Item = f64>) -> Self {
        let (least, most) = range(values.into_iter().filter(|v| *v > 0.0)).unwrap_or((1.0, 10.0));
        // The largest such number below v is the reciprocal of the smallest above 1 / v.
        let min = 1.0 / number::nice_above(1.0 / least);
        let max = number::nice_above(most).min(f64::MAX);
        Self {
            label: label.to_owned(),
            min,
            max: if max > min { max } else { 10.0 * min },
            log: true,
        }
    }

    /// Spacing of ticks for about `wanted` intervals.
    fn step(&self, wanted: f64) -> f64 {
        number::nice_above((self.max - self.min) / wanted)
    }

    /// Positions and texts of about `wanted` ticks, at least three if the numbers allow it: fewer do not show the
    /// scale.
    pub fn ticks(&self, wanted: f64) -> Vec<(f64, String)> {
        if self.log {
            return self.logarithmic_ticks(wanted);
        }
        let mut ticks = self.linear_ticks(wanted);
        for more in [1.5, 2.0, 3.0, 5.0] {
            if ticks.len() >= LEAST_TICKS {
                break;
            }
            ticks = self.linear_ticks(more * wanted);
        }
        ticks
    }

    fn linear_ticks(&self, wanted: f64) -> Vec<(f64, String)> {
        let step = self.step(wanted);
        let decimals = (-(step.log10() + 1e-9).floor()).max(0.0) as usize;
        let first = (self.min / step - 1e-6).ceil() as i64;
        let last = (self.max / step + 1e-6).floor() as i64;
        // An axis whose ends overflow the subtraction has no ticks.
        if last.saturating_sub(first) > MAX_TICKS {
            return Vec::new();
        }
        (first..=last)
            .map(|i| {
                let value = i as f64 * step;
                (value, number::fixed(value, decimals))
            })
            .collect()
    }

    /// Ticks at 1, 2, 5 times powers of ten, or only at powers of ten if these would be too many.
    fn logarithmic_ticks(&self, wanted: f64) -> Vec<(f64, String)> {
        let low = self.min.log10().floor() as i32;
        let high = self.max.log10().ceil() as i32;
        let inside = |v: f64| v >= self.min * (1.0 - 1e-9) && v <= self.max * (1.0 + 1e-9);
        let text = |v: f64| {
            if (1e-3..1e5).contains(&v) {
                number::shortest(v)
            } else {
                let exponent = (v.log10() + 1e-9).floor();
                match (v / 10f64.powf(exponent)).round() {
                    1.0 => number::power(exponent as i32),
                    factor => format!("{factor}·{}", number::power(exponent as i32)),
                }
            }
        };
        let all = |factors: &[f64], every: usize| -> Vec<(f64, String)> {
            (low..=high)
                .step_by(every)
                .flat_map(|e| factors.iter().map(move |f| f * 10f64.powi(e)))
                .filter(|v| inside(*v))
                .map(|v| (v, text(v)))
                .collect()
        };
        let close = all(&[1.0, 2.0, 5.0], 1);
        let is_short = self.min >= 1e-3 && self.max < 1e5;
        if is_short && close.len() as f64 <= 2.0 * wanted {
            return close;
        }
        let every = (f64::from(high - low) / wanted).ceil().max(1.0) as usize;
        let powers = all(&[1.0], every);
        match powers.len() {
            0 | 1 => close,
            _ => powers,
        }
    }

    /// Position of `value` along the axis, from 0 at its lower end to 1.
    pub fn share(&self, value: f64) -> f64 {
        if self.log {
            (value / self.min).log10() / (self.max / self.min).log10()
        } else {
            (value - self.min) / (self.max - self.min)
        }
    }
}

/// Minimum and maximum of the finite values.
pub fn range(values: impl IntoIterator<Item = f64>) -> Option<(f64, f64)> {
    values
        .into_iter()
        .filter(|v| v.is_finite())
        .fold(None, |range, v| match range {
            None => Some((v, v)),
            Some((low, high)) => Some((low.min(v), high.max(v))),
        })
}

/// Reduces `points` to about `max_count`. The smallest and largest y of each stretch are kept, and
/// so are gaps.
pub fn decimate(points: &[[f64; 2]], max_count: usize) -> Vec<[f64; 2]> {
    if points.len() <= max_count {
        return points.to_vec();
    }
    let stretch = points.len().div_ceil((max_count / 2).max(1));
    let mut out = Vec::new();
    for chunk in points.chunks(stretch) {
        let by_y = |a: &(usize, &[f64; 2]), b: &(usize, &[f64; 2])| a.1[1].total_cmp(&b.1[1]);
        let finite = || chunk.iter().enumerate().filter(|(_, p)| p[1].is_finite());
        let (Some(low), Some(high)) = (finite().min_by(by_y), finite().max_by(by_y)) else {
            out.push([chunk[0][0], f64::NAN]);
            continue;
        };
        out.push(*if low.0 <= high.0 { low.1 } else { high.1 });
        if low.0 != high.0 {
            out.push(*if low.0 < high.0 { high.1 } else { low.1 });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let axis = Axis::rounded("", [-0.37, 1.21]);
        let ticks = axis.ticks(5.0);
        assert!(ticks.len() >= 3, "{ticks:?}");
        assert!(axis.min <= -0.37 && axis.max >= 1.21);
        assert_eq!(ticks[0].1, "−0.5");
        let log = Axis::logarithmic("", [3e-9, 0.0, f64::NAN, 3e-5]);
        assert_eq!(log.ticks(9.0)[0].1, "10⁻⁸");
        assert!((log.min - 2e-9).abs() < 1e-18 && (log.max - 5e-5).abs() < 1e-14);
        let near = Axis::logarithmic("", [1.06, 16.0]);
        let texts: Vec<String> = near.ticks(5.0).into_iter().map(|t| t.1).collect();
        assert_eq!(texts, ["1", "2", "5", "10", "20"]);
    }

    #[test]
    fn every_axis_has_ticks_that_tell_its_scale() {
        for reach in [0.9, 1.0, 1.7, 2.0, 3.3, 12.0, 61.0] {
            let axis = Axis::rounded("", [-reach, reach]);
            assert!(
                axis.ticks(2.0).len() >= LEAST_TICKS,
                "{reach}: {:?}",
                axis.ticks(2.0)
            );
        }
        let log = Axis::logarithmic("", [2.1e-9, 4e-9]);
        let texts: Vec<String> = log.ticks(3.0).into_iter().map(|tick| tick.1).collect();
        assert_eq!(texts, ["2·10⁻⁹", "5·10⁻⁹"]);
    }

    #[test]
    fn ends_beyond_all_bounds_have_no_ticks() {
        for values in [[-1e308, 1e308], [-f64::MAX, f64::MAX]] {
            assert!(Axis::over("", values).ticks(5.0).len() < 100);
            assert!(Axis::rounded("", values).ticks(5.0).len() < 100);
        }
        let log = Axis::logarithmic("", [f64::MIN_POSITIVE, f64::MAX]);
        assert!(log.ticks(5.0).len() < 100);
    }

    #[test]
    fn an_axis_over_nothing_or_one_value_has_length() {
        for values in [vec![], vec![f64::NAN], vec![5.0], vec![0.0, 0.0]] {
            let axis = Axis::over("", values);
            assert!(axis.max > axis.min && axis.min.is_finite());
        }
    }

    #[test]
    fn thinning_keeps_peaks() {
        let mut points: Vec<[f64; 2]> = (0..10_000).map(|i| [f64::from(i), 0.0]).collect();
        points[7777][1] = 5.0;
        let thinned = decimate(&points, 400);
        assert!(thinned.len() <= 400);
        assert!(thinned.contains(&[7777.0, 5.0]));
    }
}
