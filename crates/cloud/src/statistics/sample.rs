//! Means, medians and quantiles of a sample.

/// The mean; NaN for an empty sample.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// √(Σ v² / n); NaN for an empty sample.
pub fn rms(values: impl IntoIterator<Item = f64>) -> f64 {
    let add = |(sum, count), v| (sum + v * v, count + 1.0);
    let (sum, count): (f64, f64) = values.into_iter().fold((0.0, 0.0), add);
    (sum / count).sqrt()
}

/// The correlation coefficient of pairs of values; 0 if one of them does not vary.
pub fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len() as f64;
    let (mean_a, mean_b) = (a.iter().sum::<f64>() / n, b.iter().sum::<f64>() / n);
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (x, y) in a.iter().zip(b) {
        ab += (x - mean_a) * (y - mean_b);
        aa += (x - mean_a).powi(2);
        bb += (y - mean_b).powi(2);
    }
    if aa * bb > 0.0 {
        ab / (aa * bb).sqrt()
    } else {
        0.0
    }
}

/// The median; of an even number of values, the greater of the middle two. `None` for an empty
/// sample.
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// The quantile `p` of `sorted`, interpolated linearly; the smallest value for p ≤ 0, the largest
/// for p ≥ 1; NaN for an empty sample.
pub fn quantile(sorted: &[f64], p: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else {
        return f64::NAN;
    };
    let at = (p * last as f64).clamp(0.0, last as f64);
    let below = at.floor() as usize;
    let above = (below + 1).min(last);
    sorted[below] + (at - below as f64) * (sorted[above] - sorted[below])
}

/// The quartile `quarters` (1 to 3) of `sorted`: the mean of two values if the cut falls between
/// them, else the value it falls on (definition 2 of Hyndman and Fan 1996). NaN for an empty
/// sample.
pub fn quartile(sorted: &[f64], quarters: usize) -> f64 {
    let cut = quarters * sorted.len();
    if sorted.is_empty() {
        f64::NAN
    } else if cut.is_multiple_of(4) {
        (sorted[cut / 4 - 1] + sorted[cut / 4]) / 2.0
    } else {
        sorted[cut / 4]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quartiles_cut_or_lie_between() {
        let values = [1.0, 2.0, 4.0, 8.0, 16.0];
        // Positions by hand: n = 4 cuts between, n = 5 cuts at a value, n = 1 is the value itself.
        let quartiles = |n: usize| [1, 2, 3].map(|quarters| quartile(&values[..n], quarters));
        assert_eq!(quartiles(1), [1.0, 1.0, 1.0]);
        assert_eq!(quartiles(2), [1.0, 1.5, 2.0]);
        assert_eq!(quartiles(3), [1.0, 2.0, 4.0]);
        assert_eq!(quartiles(4), [1.5, 3.0, 6.0]);
        assert_eq!(quartiles(5), [2.0, 4.0, 8.0]);
        assert!(quartile(&[], 2).is_nan());
    }

    #[test]
    fn medians_and_quantiles_by_hand() {
        assert_eq!(median([5.0, 1.0, 9.0]), Some(5.0));
        assert_eq!(median([5.0, 1.0, 9.0, 7.0]), Some(7.0));
        assert_eq!(median([]), None);
        let sorted = [1.0, 2.0, 4.0, 8.0, 16.0];
        assert_eq!(
            [0.0, 0.25, 0.375, 0.5, 1.0].map(|p| quantile(&sorted, p)),
            [1.0, 2.0, 3.0, 4.0, 16.0]
        );
        assert_eq!([-1.0, 2.0].map(|p| quantile(&sorted, p)), [1.0, 16.0]);
        assert!(quantile(&[], 0.5).is_nan());
        assert_eq!((mean(&sorted), rms([1.0, 7.0])), (6.2, 5.0));
    }
}
