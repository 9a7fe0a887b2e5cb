//! Smooth noise in the plane.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Side of the table of lattice values; the noise repeats after half as many wavelengths.
const LATTICE: usize = 256;

/// Noise of one wavelength: values on a lattice, smoothly interpolated.
#[derive(Debug, Clone)]
pub struct Wave {
    /// Wavelength, metres.
    pub length_m: f64,
    values: Vec<f64>,
}

impl Wave {
    /// The noise of this wavelength and standard deviation.
    pub fn new(mut rng: ChaCha8Rng, length_m: f64, sigma: f64) -> Self {
        // Uniform on ±√3 has unit variance; smooth interpolation keeps about half of it.
        let values = (0..LATTICE * LATTICE)
            .map(|_| rng.random_range(-1.0..1.0) * 6f64.sqrt() * sigma)
            .collect();
        Self { length_m, values }
    }

    /// The value at a point.
    pub fn at(&self, x: f64, y: f64) -> f64 {
        // Half a wavelength between lattice points; rotated so that lattices do not align.
        let (s, c) = self.length_m.sin_cos();
        let (u, v) = (
            2.0 * (c * x + s * y) / self.length_m,
            2.0 * (c * y - s * x) / self.length_m,
        );
        let (iu, iv) = (u.floor(), v.floor());
        let (wu, wv) = (fade(u - iu), fade(v - iv));
        let value = |di: i64, dj: i64| {
            let i = (iu as i64 + di).rem_euclid(LATTICE as i64) as usize;
            let j = (iv as i64 + dj).rem_euclid(LATTICE as i64) as usize;
            self.values[j * LATTICE + i]
        };
        let low = value(0, 0) + wu * (value(1, 0) - value(0, 0));
        let high = value(0, 1) + wu * (value(1, 1) - value(0, 1));
        low + wv * (high - low)
    }
}

/// 6 f⁵ − 15 f⁴ + 10 f³.
fn fade(f: f64) -> f64 {
    f * f * f * (f * (f * 6.0 - 15.0) + 10.0)
}
