//! Number, sums and sums of products of the offsets of points.

use crate::cloud::StructureTensor;
use crate::geometry::{Mat3, Vec3};

/// Offsets that are summed side by side.
const LANES: usize = 2;

/// n, Σx, Σy, Σz, Σxx, Σxy, Σxz, Σyy, Σyz, Σzz.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Moments([f64; 10]);

impl Moments {
    #[inline]
    pub(super) fn add(&mut self, x: f64, y: f64, z: f64) {
        let products = [1.0, x, y, z, x * x, x * y, x * z, y * y, y * z, z * z];
        for (sum, product) in self.0.iter_mut().zip(products) {
            *sum += product;
        }
    }

    #[inline]
    pub(super) fn merge(&mut self, other: &Self) {
        for (sum, more) in self.0.iter_mut().zip(other.0) {
            *sum += more;
        }
    }

    /// Moments of the same points whose offsets are all longer by `by`.
    pub(super) fn moved(&self, by: &Vec3) -> Self {
        let [n, x, y, z, xx, xy, xz, yy, yz, zz] = self.0;
        let (a, b, c) = (by.x, by.y, by.z);
        Self([
            n,
            x + n * a,
            y + n * b,
            z + n * c,
            xx + a * (2.0 * x + n * a),
            xy + a * y + b * (x + n * a),
            xz + a * z + c * (x + n * a),
            yy + b * (2.0 * y + n * b),
            yz + b * z + c * (y + n * b),
            zz + c * (2.0 * z + n * c),
        ])
    }

    /// The structure tensor of the points whose offsets from `centre` these are.
    pub(super) fn tensor(&self, centre: &Vec3) -> StructureTensor {
        let [n, x, y, z, xx, xy, xz, yy, yz, zz] = self.0;
        let mean = Vec3::new(x, y, z) / n;
        StructureTensor {
            mean: centre + mean,
            covariance: Mat3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) / n - mean * mean.transpose(),
            count: n as usize,
        }
    }
}

/// Moments of which every lane holds a part.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Lanes([[f64; LANES]; 10]);

impl Lanes {
    /// Adds the offsets from `centre` of those points with |p − centre|² ≤ `limit`.
    #[inline]
    pub(super) fn add_within(&mut self, points: [&[f64]; 3], centre: &Vec3, limit: f64) {
        let [(x, x_rest), (y, y_rest), (z, z_rest)] =
            points.map(|coordinates| coordinates.as_chunks::<LANES>());
        let mut sums = self.0;
        for ((x, y), z) in x.iter().zip(y).zip(z) {
            for lane in 0..LANES {
                add_lane(&mut sums, lane, [x[lane], y[lane], z[lane]], centre, limit);
            }
        }
        for ((x, y), z) in x_rest.iter().zip(y_rest).zip(z_rest) {
            add_lane(&mut sums, 0, [*x, *y, *z], centre, limit);
        }
        self.0 = sums;
    }

    pub(super) fn sum(&self) -> Moments {
        Moments(self.0.map(|lanes| lanes.iter().sum()))
    }
}

#[inline(always)]
fn add_lane(
    sums: &mut [[f64; LANES]; 10],
    lane: usize,
    point: [f64; 3],
    centre: &Vec3,
    limit: f64,
) {
    let (x, y, z) = (
        point[0] - centre.x,
        point[1] - centre.y,
        point[2] - centre.z,
    );
    // Without a branch: which points are inside is as good as random.
    let inside = if x * x + y * y + z * z <= limit {
        1.0
    } else {
        0.0
    };
    let (x, y, z) = (x * inside, y * inside, z * inside);
    let products = [inside, x, y, z, x * x, x * y, x * z, y * y, y * z, z * z];
    for (sum, product) in sums.iter_mut().zip(products) {
        sum[lane] += product;
    }
}
