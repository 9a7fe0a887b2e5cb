//! Errors of positions and headings that last: a Gauss-Markov process by its largest modes.

use std::f64::consts::FRAC_PI_2;
use std::ops::Mul;

use crate::adjustment::{Columns, Parameter, Unknown};

/// Most modes: those of positions are three columns each, and the time of an adjustment grows with their square. The
/// errors of smaller modes are taken for noise. On a drive of 5.6 min with errors of positions and headings that last for
/// 20 s, positions, tilt and yaw are off by 1.0, 0.8 and 0.7 times what is stated (without any mode 20, 2.0 and 5.8 times
/// on drives of 4 min).
const MAX_MODES: usize = 48;
/// Halvings of the interval of a root, down to rounding errors.
const HALVINGS: usize = 60;

/// The largest modes of a process with E x(t) x(t + Δ) = e^(−|Δ|/τ) over a span of 2a (Karhunen-Loève; Ghanem and Spanos
/// 1991, section 2.3.3): with independent standard normal ξ and t from the middle of the span,
///
/// x(t) = Σ ξ_n s_n cos(ω_n t − n π/2), s² = 2τ sin² y / (a + sin(2 y)/(2 ω)),
///
/// where ω a = n π/2 + y with y from 0 to π/2, and ω a tan y = a/τ: sin² y is 1/(1 + ω² τ²).
#[derive(Debug, Clone)]
pub struct Modes {
    middle_s: f64,
    modes: Vec<Mode>,
    /// The standard deviation of records with which no mode that is left out stands out, over that of their white noise:
    /// at no period is there more error than is stated.
    noise_factor: f64,
}

#[derive(Debug, Clone, Copy)]
struct Mode {
    /// ω.
    rate_rad_s: f64,
    /// n π/2.
    phase_rad: f64,
    /// s.
    amplitude: f64,
}

impl Modes {
    /// The modes over a span for a correlation time that stand out from white noise, whose variance at fixes every second
    /// is `white_s` times that of the process: the variance 2τ sin² y of a mode is larger.
    pub fn new((from_s, to_s): (f64, f64), correlation_s: f64, white_s: f64) -> Self {
        let half_s = 0.5 * (to_s - from_s);
        let modes = (0..MAX_MODES).map(|index| mode(index, half_s, correlation_s));
        let modes = modes.take_while(|(_, variance_s)| *variance_s > white_s);
        let modes: Vec<Mode> = modes.map(|(mode, _)| mode).collect();
        let (_, left_out_s) = mode(modes.len(), half_s, correlation_s);
        Self {
            middle_s: from_s + half_s,
            noise_factor: if modes.len() == MAX_MODES {
                (1.0 + left_out_s / white_s).sqrt()
            } else {
                1.0
            },
            modes,
        }
    }

    /// Number of modes.
    pub fn count(&self) -> usize {
        self.modes.len()
    }

    /// The value of each at a time, for an amplitude ξ of 1.
    pub fn at(&self, time_s: f64) -> impl Iterator<Item = f64> {
        let after_s = time_s - self.middle_s;
        let value =
            move |mode: &Mode| mode.amplitude * (mode.rate_rad_s * after_s - mode.phase_rad).cos();
        self.modes.iter().map(value)
    }
}

/// The mode n, and its variance 2τ sin² y, seconds.
fn mode(n: usize, half_s: f64, correlation_s: f64) -> (Mode, f64) {
    let phase_rad = n as f64 * FRAC_PI_2;
    let (mut low, mut high) = (0.0, FRAC_PI_2);
    for _ in 0..HALVINGS {
        let y = 0.5 * (low + high);
        if (phase_rad + y) * y.sin() < half_s / correlation_s * y.cos() {
            low = y;
        } else {
            high = y;
        }
    }
    let rate_rad_s = (phase_rad + low) / half_s;
    let variance_s = 2.0 * correlation_s * low.sin().powi(2);
    let norm_s = half_s + (2.0 * low).sin() / (2.0 * rate_rad_s);
    let mode = Mode {
        rate_rad_s,
        phase_rad,
        amplitude: (variance_s / norm_s).sqrt(),
    };
    (mode, variance_s)
}

/// A lasting error: σ times a process by its modes.
#[derive(Debug, Clone)]
pub struct Lasting<T> {
    sigma: T,
    modes: Modes,
    /// One for each mode: independent standard normal values.
    pub amplitudes: Vec<Parameter<T>>,
}

impl<T: Unknown + Mul<f64, Output = T>> Lasting<T> {
    /// An error of `zero`, with columns of its own.
    pub fn new(sigma: T, modes: Modes, zero: T, columns: &mut Columns) -> Self {
        let mut amplitudes = vec![Parameter::held(zero); modes.count()];
        let each = amplitudes.iter_mut();
        each.for_each(|amplitude| amplitude.estimate(columns));
        Self {
            sigma,
            modes,
            amplitudes,
        }
    }

    /// The factor on the standard deviation of records for the modes that are taken for noise.
    pub fn noise_factor(&self) -> f64 {
        self.modes.noise_factor
    }

    /// The amplitudes at a time, each with what its component of 1 adds to that of the error.
    pub fn at(&self, time_s: f64) -> impl Iterator<Item = (&Parameter<T>, T)> {
        let values = self.modes.at(time_s);
        let by = values.map(|value| self.sigma.clone() * value);
        self.amplitudes.iter().zip(by)
    }

    /// Takes over the amplitudes of an earlier adjustment.
    pub fn resume(&mut self, before: &Self) {
        let amplitudes = self.amplitudes.iter_mut().zip(&before.amplitudes);
        amplitudes.for_each(|(amplitude, before)| amplitude.value = before.value.clone());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn modes_together_have_the_covariance_of_the_process() {
        for (span_s, correlation_s) in [(30.0, 100.0), (100.0, 20.0), (3.0, 3.0)] {
            let modes = Modes::new((1000.0, 1000.0 + span_s), correlation_s, 0.0);
            assert_eq!(modes.count(), MAX_MODES);
            for (a, b) in [(0.1, 0.1), (0.3, 0.9), (0.0, 1.0), (0.55, 0.5)] {
                let at = |share: f64| modes.at(1000.0 + share * span_s);
                let covariance: f64 = at(a).zip(at(b)).map(|(x, y)| x * y).sum();
                let expected = (-f64::abs(a - b) * span_s / correlation_s).exp();
                // Modes of higher rate: Σ 4a/(τ π² k²) of the variance from the last on, twice that at the ends.
                let left_out = 4.0 * span_s / (correlation_s * PI.powi(2) * MAX_MODES as f64);
                let error = covariance - expected;
                assert!(error.abs() < left_out, "{a} {b}: {error} of {left_out}");
            }
        }
    }

    #[test]
    fn modes_below_the_noise_are_left_out() {
        let all = |white_s| Modes::new((0.0, 100.0), 20.0, white_s);
        let modes = |white_s| all(white_s).count();
        // 2τ/(1 + (π k τ/T)²) = 40/(1 + 0.395 k²) of the mode k is 1 at k = 9.9.
        assert!((9..=11).contains(&modes(1.0)));
        assert_eq!(modes(50.0), 0);
        // 48 are all that there can be, and the next has 40/(1 + 0.395 48²) = 0.0439.
        assert_eq!((modes(0.01), all(1.0).noise_factor), (MAX_MODES, 1.0));
        let factor = all(0.01).noise_factor;
        assert!((factor.powi(2) - 5.39).abs() < 0.15, "{factor}");
    }
}
