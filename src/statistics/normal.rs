//! The normal distribution, and χ² as sums of its squares.

/// 97.5 % quantile of the standard normal distribution: 95 % lie within ± this.
pub const NORMAL_97_5: f64 = 1.959_963_984_540_054;

/// [`NORMAL_97_5`] as the literature rounds it.
pub const NORMAL_97_5_ROUNDED: f64 = 1.96;

/// Standard deviation of a normal distribution whose median absolute deviation is 1.
pub const SIGMAS_PER_MAD: f64 = 1.4826;

/// Median of χ² with one degree of freedom.
pub const CHI_SQUARE_1_MEDIAN: f64 = 0.454_936;

/// Bounds of χ² with so many `degrees` of freedom that hold 95 % (Wilson and Hilferty 1931).
pub fn chi_square_bounds_95(degrees: f64) -> [f64; 2] {
    [-NORMAL_97_5, NORMAL_97_5].map(|z| chi_square(degrees, z))
}

/// The χ² with so many `degrees` of freedom below which lies as much as below `z` of a standard
/// normal distribution (Wilson and Hilferty 1931); 0 for no degrees.
pub fn chi_square(degrees: f64, z: f64) -> f64 {
    if degrees <= 0.0 {
        return 0.0;
    }
    let spread = 2.0 / (9.0 * degrees);
    degrees * (1.0 - spread + z * spread.sqrt()).max(0.0).powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_are_those_of_the_tables() {
        // χ²: 10 degrees 3.247 to 20.483; 100 degrees 74.222 to 129.561.
        // The approximation is good to 0.03 from 10 degrees on.
        let [low, high] = chi_square_bounds_95(10.0);
        assert!((low - 3.247).abs() < 0.03 && (high - 20.483).abs() < 0.03);
        let [low, high] = chi_square_bounds_95(100.0);
        assert!((low - 74.222).abs() < 0.03 && (high - 129.561).abs() < 0.03);
    }
}
