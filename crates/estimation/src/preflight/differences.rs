//! Fourth differences: how much neighbouring values scatter about a smooth course.

/// Number of values in a difference.
pub const VALUES: usize = 5;

/// Weights of the values at these times, such that the weighted sum is zero for a cubic course and scatters
/// like a single value: wᵢ ∝ 1/∏ⱼ(tᵢ − tⱼ), of unit length. `None` where the times do not increase.
pub fn weights(times_s: [f64; VALUES]) -> Option<[f64; VALUES]> {
    if times_s.windows(2).any(|pair| pair[1] <= pair[0]) {
        return None;
    }
    let weights = times_s.map(|time_s| {
        let others = times_s.iter().filter(|other| **other != time_s);
        others.map(|other| time_s - other).product::<f64>().recip()
    });
    let length = weights.iter().map(|w| w * w).sum::<f64>().sqrt();
    Some(weights.map(|weight| weight / length))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cubic_course_vanishes_and_the_weights_have_unit_length() {
        let times_s = [0.0, 0.1, 0.25, 0.3, 0.42];
        let weights = weights(times_s).expect("times that increase");
        let cubic = times_s.map(|t| 2.0 - 3.0 * t + t * t - 4.0 * t * t * t);
        let left: f64 = weights.iter().zip(cubic).map(|(w, value)| w * value).sum();
        assert!(left.abs() < 1e-12, "{left}");
        let length: f64 = weights.iter().map(|w| w * w).sum();
        assert!((length - 1.0).abs() < 1e-12, "{length}");
        assert!(super::weights([0.0, 0.1, 0.1, 0.3, 0.4]).is_none());
    }
}
