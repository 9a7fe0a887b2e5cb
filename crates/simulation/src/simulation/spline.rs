//! Uniform quintic B-splines: four times continuously differentiable, local, no equations to solve.

/// A curve of `N` channels over equally spaced knots.
///
/// Its value at u is Σ B(u − i) c_i with the quintic B-spline B; a constant or straight sequence
/// of control points is reproduced exactly, anything else is smoothed over about two knots.
#[derive(Debug, Clone, PartialEq)]
pub struct Spline<const N: usize> {
    start: f64,
    spacing: f64,
    control: Vec<[f64; N]>,
}

/// Value, first and second derivative of a [`Spline`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jet<const N: usize> {
    /// The value.
    pub value: [f64; N],
    /// First derivative.
    pub first: [f64; N],
    /// Second derivative.
    pub second: [f64; N],
}

impl<const N: usize> Spline<N> {
    /// The spline whose control point i belongs to `start + i * spacing`; the first and the last
    /// control point are repeated so that the curve is defined over all of them.
    pub fn new(start: f64, spacing: f64, samples: &[[f64; N]]) -> Self {
        let (Some(first), Some(last)) = (samples.first(), samples.last()) else {
            return Self {
                start,
                spacing,
                control: vec![[0.0; N]; 6],
            };
        };
        let mut control = vec![*first; 3];
        control.extend_from_slice(samples);
        control.extend([*last; 3]);
        Self {
            start: start - spacing,
            spacing,
            control,
        }
    }

    /// The curve at `u`; beyond the ends it stays near the end point.
    pub fn at(&self, u: f64) -> Jet<N> {
        let position = (u - self.start) / self.spacing;
        let last = (self.control.len() - 6) as f64;
        let cell = position.floor().clamp(0.0, last);
        let f = (position - cell).clamp(0.0, 1.0);
        let [w0, w1, w2] = weights(f);
        let mut jet = Jet {
            value: [0.0; N],
            first: [0.0; N],
            second: [0.0; N],
        };
        let from = cell as usize;
        for (k, control) in self.control[from..from + 6].iter().enumerate() {
            for (n, c) in control.iter().enumerate() {
                jet.value[n] += w0[k] * c;
                jet.first[n] += w1[k] * c;
                jet.second[n] += w2[k] * c;
            }
        }
        let h = self.spacing;
        jet.first = jet.first.map(|x| x / h);
        jet.second = jet.second.map(|x| x / (h * h));
        jet
    }
}

/// Weights of six neighbouring control points and their two derivatives with respect to `f`.
fn weights(f: f64) -> [[f64; 6]; 3] {
    // 120 times the pieces of the quintic B-spline, lowest power first.
    const PIECES: [[f64; 6]; 6] = [
        [1.0, -5.0, 10.0, -10.0, 5.0, -1.0],
        [26.0, -50.0, 20.0, 20.0, -20.0, 5.0],
        [66.0, 0.0, -60.0, 0.0, 30.0, -10.0],
        [26.0, 50.0, 20.0, -20.0, -20.0, 10.0],
        [1.0, 5.0, 10.0, 10.0, 5.0, -5.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
    ];
    let mut w = [[0.0; 6]; 3];
    for (k, c) in PIECES.iter().enumerate() {
        let (mut p, mut d, mut dd) = (0.0, 0.0, 0.0);
        for power in (0..6).rev() {
            dd = dd * f + 2.0 * d;
            d = d * f + p;
            p = p * f + c[power];
        }
        w[0][k] = p / 120.0;
        w[1][k] = d / 120.0;
        w[2][k] = dd / 120.0;
    }
    w
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_sum_to_one_and_reproduce_lines() {
        let samples: Vec<[f64; 1]> = (0..20).map(|i| [3.0 + 0.5 * f64::from(i)]).collect();
        let spline = Spline::new(10.0, 0.25, &samples);
        for u in [10.8, 11.0, 12.345, 13.9] {
            let jet = spline.at(u);
            assert!((jet.value[0] - (3.0 + 2.0 * (u - 10.0))).abs() < 1e-12);
            assert!((jet.first[0] - 2.0).abs() < 1e-12 && jet.second[0].abs() < 1e-10);
        }
    }

    #[test]
    fn derivatives_meet_finite_differences_also_across_knots() {
        let samples: Vec<[f64; 1]> = (0..40).map(|i| [(f64::from(i) * 0.7).sin()]).collect();
        let spline = Spline::new(0.0, 0.5, &samples);
        // Steps of 1e-4 leave an error of 1e-8 from truncation and rounding.
        let h = 1e-4;
        for u in [3.0, 4.26, 7.5, 11.999_95] {
            let (a, b, c) = (spline.at(u - h), spline.at(u), spline.at(u + h));
            assert!(((c.value[0] - a.value[0]) / (2.0 * h) - b.first[0]).abs() < 1e-7);
            assert!(((c.first[0] - a.first[0]) / (2.0 * h) - b.second[0]).abs() < 1e-6);
        }
    }
}
