//! Sums of long lists, compiled for the widest vectors.
//!
//! Each sum has 32 partial sums side by side, because a single one would wait for its last
//! addition. One sum at a time: compilers vectorise such loops, but not those that mix several
//! sums.

use crate::cloud::vectors::with_widest_vectors;

const LANES: usize = 32;

with_widest_vectors! {
    /// Σx, Σy, Σz, Σxx, Σxy, Σxz, Σyy, Σyz, Σzz of lists of the same length.
    pub(super) fn moments(x: &[f64], y: &[f64], z: &[f64]) -> [f64; 9] = add_moments
}

#[inline(always)]
fn add_moments(x: &[f64], y: &[f64], z: &[f64]) -> [f64; 9] {
    [
        total(x),
        total(y),
        total(z),
        total_product(x, x),
        total_product(x, y),
        total_product(x, z),
        total_product(y, y),
        total_product(y, z),
        total_product(z, z),
    ]
}

with_widest_vectors! {
    /// Σa and Σb.
    pub(super) fn both(a: &[f64], b: &[f64]) -> [f64; 2] = add_both
}

#[inline(always)]
fn add_both(a: &[f64], b: &[f64]) -> [f64; 2] {
    [total(a), total(b)]
}

with_widest_vectors! {
    /// Σ ((a − middle) w)² with the weights w, as many as a.
    pub(super) fn squares_about(middle: f64, a: &[f64], weights: &[f64]) -> f64 = add_squares
}

#[inline(always)]
fn add_squares(middle: f64, a: &[f64], weights: &[f64]) -> f64 {
    let (a, a_rest) = a.as_chunks::<LANES>();
    let (weights, weights_rest) = weights.as_chunks::<LANES>();
    let mut sums = [0.0; LANES];
    for (a, weights) in a.iter().zip(weights) {
        for lane in 0..LANES {
            let about = (a[lane] - middle) * weights[lane];
            sums[lane] += about * about;
        }
    }
    for ((sum, a), weight) in sums.iter_mut().zip(a_rest).zip(weights_rest) {
        let about = (a - middle) * weight;
        *sum += about * about;
    }
    total_of_lanes(sums)
}

#[inline(always)]
fn total(a: &[f64]) -> f64 {
    let (a, rest) = a.as_chunks::<LANES>();
    let mut sums = [0.0; LANES];
    for a in a {
        for lane in 0..LANES {
            sums[lane] += a[lane];
        }
    }
    for (sum, a) in sums.iter_mut().zip(rest) {
        *sum += a;
    }
    total_of_lanes(sums)
}

#[inline(always)]
fn total_product(a: &[f64], b: &[f64]) -> f64 {
    let (a, a_rest) = a.as_chunks::<LANES>();
    let (b, b_rest) = b.as_chunks::<LANES>();
    let mut sums = [0.0; LANES];
    for (a, b) in a.iter().zip(b) {
        for lane in 0..LANES {
            sums[lane] += a[lane] * b[lane];
        }
    }
    for ((sum, a), b) in sums.iter_mut().zip(a_rest).zip(b_rest) {
        *sum += a * b;
    }
    total_of_lanes(sums)
}

/// The sum of the partial sums, halves added to halves.
#[inline(always)]
fn total_of_lanes(mut sums: [f64; LANES]) -> f64 {
    let mut half = LANES / 2;
    while half > 0 {
        for lane in 0..half {
            sums[lane] += sums[lane + half];
        }
        half /= 2;
    }
    sums[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_those_of_whole_numbers() {
        // Integers add up without rounding, in any order.
        for n in [0usize, 1, 15, 16, 17, 50] {
            let list = |k: i32| -> Vec<f64> {
                (0..n as i32).map(|i| f64::from((k * i) % 7 - 3)).collect()
            };
            let [x, y, z] = [list(3), list(5), list(11)];
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let ones = vec![1.0; n];
            let expected = [
                dot(&x, &ones),
                dot(&y, &ones),
                dot(&z, &ones),
                dot(&x, &x),
                dot(&x, &y),
                dot(&x, &z),
                dot(&y, &y),
                dot(&y, &z),
                dot(&z, &z),
            ];
            assert_eq!(moments(&x, &y, &z), expected);
            assert_eq!(both(&x, &y), [expected[0], expected[1]]);
            let weights: Vec<f64> = (0..n).map(|i| f64::from(u8::from(i % 3 > 0))).collect();
            let about: Vec<f64> = x.iter().zip(&weights).map(|(x, w)| (x - 2.0) * w).collect();
            assert_eq!(squares_about(2.0, &x, &weights), dot(&about, &about));
        }
    }
}
