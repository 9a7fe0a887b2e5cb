//! Quantiles of Fisher's F distribution.

/// ln Γ of a positive number (Lanczos, 9 terms), to 1e-14.
fn ln_gamma(x: f64) -> f64 {
    const G: f64 = 7.0;
    const TERMS: [f64; 9] = [
        0.999_999_999_999_809_9,
        676.520_368_121_885_1,
        -1_259.139_216_722_402_8,
        771.323_428_777_653_1,
        -176.615_029_162_140_6,
        12.507_343_278_686_905,
        -0.138_571_095_265_720_12,
        9.984_369_578_019_572e-6,
        1.505_632_735_149_311_6e-7,
    ];
    let x = x - 1.0;
    let series = (1..9).fold(TERMS[0], |sum, i| sum + TERMS[i] / (x + i as f64));
    let t = x + G + 0.5;
    0.5 * std::f64::consts::TAU.ln() + (x + 0.5) * t.ln() - t + series.ln()
}

/// The regularised incomplete beta function I(x; a, b) by its continued fraction (DLMF 8.17.22).
fn incomplete_beta(x: f64, a: f64, b: f64) -> f64 {
    const TINY: f64 = 1e-300;
    if x <= 0.0 {
        return 0.0;
    }
    if x >= 1.0 {
        return 1.0;
    }
    // Converges fast below the mean.
    if x > (a + 1.0) / (a + b + 2.0) {
        return 1.0 - incomplete_beta(1.0 - x, b, a);
    }
    let away_from_zero = |value: f64| if value.abs() < TINY { TINY } else { value };
    let (mut fraction, mut c, mut d) = (1.0, 1.0, 0.0);
    for i in 1..10_000 {
        let m = f64::from(i / 2);
        let coefficient = if i % 2 == 0 {
            m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m))
        } else {
            -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0))
        };
        d = 1.0 / away_from_zero(1.0 + coefficient * d);
        c = away_from_zero(1.0 + coefficient / c);
        fraction *= c * d;
        if (c * d - 1.0).abs() < 1e-15 {
            break;
        }
    }
    let power = a * x.ln() + b * (-x).ln_1p() + ln_gamma(a + b) - ln_gamma(a) - ln_gamma(b);
    power.exp() / (a * fraction)
}

/// The value that Fisher's F exceeds with `probability` (0 to 1), for `above` degrees of freedom of the numerator
/// and `below` of the denominator; relative error below 1e-9 up to a million degrees.
pub fn fisher_exceeded(above: f64, below: f64, probability: f64) -> f64 {
    // P(F > f) = I(ν₂ / (ν₂ + ν₁ f); ν₂ / 2, ν₁ / 2).
    let tail = |f: f64| incomplete_beta(below / (below + above * f), 0.5 * below, 0.5 * above);
    let mut high = 1.0;
    while tail(high) > probability && high < 1e300 {
        high *= 2.0;
    }
    let mut low = 0.0;
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if tail(middle) > probability {
            low = middle
        } else {
            high = middle
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::student_97_5;

    #[test]
    fn two_degrees_above_are_a_closed_form() {
        // P(F > f) = (1 + 2 f / ν)^(−ν / 2).
        for (below, probability) in [(2.0, 0.3), (7.0, 0.01), (39.0, 5e-4), (1e3, 1e-6)] {
            let expected = below / 2.0 * (f64::powf(probability, -2.0 / below) - 1.0);
            let found = fisher_exceeded(2.0, below, probability);
            assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
        }
    }

    #[test]
    fn one_degree_above_is_the_square_of_student() {
        for below in [1.0, 3.7, 12.0, 120.0] {
            let found = fisher_exceeded(1.0, below, 0.05);
            let expected = student_97_5(below).powi(2);
            assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
        }
    }

    #[test]
    fn many_degrees_below_are_chi_square() {
        // scipy.stats.chi2.isf([0.01, 5e-4], 6) = 16.811893829770927, 24.102799.
        let found = 6.0 * fisher_exceeded(6.0, 1e6, 0.01);
        assert!((found - 16.811_893_8).abs() < 1e-3, "{found}");
        let found = 6.0 * fisher_exceeded(6.0, 1e6, 5e-4);
        assert!((found - 24.1028).abs() < 2e-3, "{found}");
    }
}
