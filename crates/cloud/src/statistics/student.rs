//! The 97.5 % quantile of Student's t distribution.

use std::f64::consts::PI;

use super::normal::NORMAL_97_5;

/// From here on the expansion about the normal quantile is accurate to 1e-11.
const MANY: f64 = 200.0;

/// 97.5 % quantile of Student's t distribution with `dof` degrees of freedom, 1 or more and not
/// necessarily an integer. Relative error below 1e-11; NaN below 1.
pub fn student_97_5(dof: f64) -> f64 {
    if dof.is_nan() || dof < 1.0 {
        return f64::NAN;
    }
    if dof >= MANY {
        return expansion(dof, 4);
    }
    // The tail probability falls and flattens for t > 0. Two terms of the expansion lie below the
    // root, so Newton's steps approach it from below.
    let density_at_zero = gamma_ratio(dof / 2.0) / (PI * dof).sqrt();
    let mut t = expansion(dof, 2);
    for _ in 0..50 {
        let density = density_at_zero * (-(dof + 1.0) / 2.0 * (t * t / dof).ln_1p()).exp();
        let step = (tail_probability(t, dof) - 0.05) / (2.0 * density);
        t += step;
        if step.abs() <= 1e-13 * t {
            break;
        }
    }
    t
}

/// The first terms of the quantile in powers of 1 / degrees of freedom (Abramowitz and Stegun
/// 26.7.5).
fn expansion(dof: f64, terms: usize) -> f64 {
    const Z: f64 = NORMAL_97_5;
    const Z2: f64 = Z * Z;
    const TERMS: [f64; 4] = [
        Z * (Z2 + 1.0) / 4.0,
        Z * ((5.0 * Z2 + 16.0) * Z2 + 3.0) / 96.0,
        Z * (((3.0 * Z2 + 19.0) * Z2 + 17.0) * Z2 - 15.0) / 384.0,
        Z * ((((79.0 * Z2 + 776.0) * Z2 + 1482.0) * Z2 - 1920.0) * Z2 - 945.0) / 92_160.0,
    ];
    let terms = TERMS[..terms].iter().rev();
    Z + terms.fold(0.0, |sum, term| (sum + term) / dof)
}

/// The probability that |T| exceeds `t` ≥ 1.9: the regularised incomplete beta function I(ν / (ν +
/// t²); ν / 2, 1 / 2), by its continued fraction (DLMF 8.17.22), which converges fast for such t.
fn tail_probability(t: f64, dof: f64) -> f64 {
    const TINY: f64 = 1e-300;
    let (a, b) = (dof / 2.0, 0.5);
    let beyond = t * t / (dof + t * t);
    let x = 1.0 - beyond;
    // Lentz's algorithm for 1 / (1 + d₁ / (1 + d₂ / (1 + …))).
    let (mut fraction, mut c, mut d) = (1.0, 1.0, 0.0);
    for i in 1..500 {
        let m = f64::from(i / 2);
        let coefficient = if i % 2 == 0 {
            m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m))
        } else {
            -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0))
        };
        let away_from_zero = |value: f64| if value.abs() < TINY { TINY } else { value };
        d = 1.0 / away_from_zero(1.0 + coefficient * d);
        c = away_from_zero(1.0 + coefficient / c);
        let factor = c * d;
        fraction *= factor;
        if (factor - 1.0).abs() < 1e-15 {
            break;
        }
    }
    let power = (-a * (t * t / dof).ln_1p()).exp();
    gamma_ratio(a) * power * beyond.sqrt() / (a * PI.sqrt() * fraction)
}

/// Γ(a + ½) / Γ(a) for a > 0, by recurrence from where its asymptotic series is exact.
fn gamma_ratio(a: f64) -> f64 {
    let (mut a, mut factor) = (a, 1.0);
    while a < 40.0 {
        factor *= a / (a + 0.5);
        a += 1.0;
    }
    const TERMS: [f64; 7] = [
        1.0,
        -1.0 / 8.0,
        1.0 / 128.0,
        5.0 / 1024.0,
        -21.0 / 32_768.0,
        -399.0 / 262_144.0,
        869.0 / 4_194_304.0,
    ];
    factor * a.sqrt() * TERMS.iter().rev().fold(0.0, |sum, term| sum / a + term)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_high_precision() {
        // mpmath with 40 digits; scipy.stats.t.ppf(0.975, ν) gives the same to 1e-13.
        let table = [
            (1.0, 12.706204736174705),
            (1.0001, 12.703202820451482),
            (1.5, 6.0166631044279315),
            (2.0, 4.302652729749464),
            (2.5, 3.5746548420036834),
            (3.0, 3.1824463052837095),
            (3.7, 2.8675207071911895),
            (5.0, 2.5705818356363155),
            (8.0, 2.3060041352041667),
            (10.25, 2.220794410744808),
            (15.0, 2.1314495455597755),
            (30.0, 2.042272456301238),
            (47.3, 2.0114037532826705),
            (100.0, 1.9839715185235522),
            (199.9, 1.9719022283759267),
            (200.1, 1.9718902249293788),
            (500.0, 1.9647198374673678),
            // scipy
            (1e3, 1.9623390808264083),
            (1e5, 1.9599877075346095),
            (1e9, 1.959963986912325),
        ];
        for (dof, expected) in table {
            let found = student_97_5(dof);
            assert!(
                (found / expected - 1.0).abs() < 1e-11,
                "{dof}: {found} {expected}"
            );
        }
        assert_eq!(student_97_5(f64::INFINITY), NORMAL_97_5);
        assert!(student_97_5(f64::NAN).is_nan());
        assert!(student_97_5(0.5).is_nan());
    }

    #[test]
    fn quantiles_fall_with_the_degrees_of_freedom() {
        let mut before = f64::INFINITY;
        for i in 0..4000 {
            let found = student_97_5(1.0 + 0.1 * f64::from(i));
            assert!(found < before && found > NORMAL_97_5);
            before = found;
        }
    }
}
