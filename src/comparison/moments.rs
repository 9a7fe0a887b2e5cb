//! Number, sums and sums of products of the offsets of points.

use std::ops::Range;

use crate::cloud::StructureTensor;
use crate::geometry::{Mat3, Vec3};

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

    /// Adds the moments of a sequence of points up to `end`, less those up to `begin`.
    #[inline]
    pub(super) fn merge_between(&mut self, begin: &Self, end: &Self) {
        for ((sum, begin), end) in self.0.iter_mut().zip(begin.0).zip(end.0) {
            *sum += end - begin;
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

/// Offsets of points from a centre, coordinate by coordinate.
#[derive(Debug, Default)]
pub(super) struct Offsets {
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
}

impl Offsets {
    /// Moments about `centre` of those points in `ranges` of the lists x, y, z with
    /// |p − centre|² ≤ `limit`.
    pub(super) fn moments_within(
        &mut self,
        [x, y, z]: [&[f64]; 3],
        ranges: &[Range<u32>],
        centre: &Vec3,
        limit: f64,
    ) -> Moments {
        let most = ranges.iter().map(Range::len).sum::<usize>() + 1;
        if self.x.len() < most {
            for list in [&mut self.x, &mut self.y, &mut self.z] {
                list.resize(2 * most, 0.0);
            }
        }
        let (kept_x, kept_y, kept_z) = (
            &mut self.x[..most],
            &mut self.y[..most],
            &mut self.z[..most],
        );
        let mut kept = 0;
        for range in ranges {
            let range = range.start as usize..range.end as usize;
            let (x, y, z) = (&x[range.clone()], &y[range.clone()], &z[range]);
            for ((x, y), z) in x.iter().zip(y).zip(z) {
                let (x, y, z) = (x - centre.x, y - centre.y, z - centre.z);
                // Written in any case and kept by counting it: which points are inside is as good as
                // random, and would cost a mispredicted branch every other time.
                kept_x[kept] = x;
                kept_y[kept] = y;
                kept_z[kept] = z;
                kept += usize::from(x * x + y * y + z * z <= limit);
            }
        }
        let (x, y, z) = (&kept_x[..kept], &kept_y[..kept], &kept_z[..kept]);
        let [sum_x, xx, xy] = sums(x, y);
        let [sum_y, yy, yz] = sums(y, z);
        let [sum_z, zz, xz] = sums(z, x);
        Moments([kept as f64, sum_x, sum_y, sum_z, xx, xy, xz, yy, yz, zz])
    }
}

/// Σa, Σaa and Σab of two lists of the same length, each in four sums side by side: one alone waits
/// for its last addition.
fn sums(a: &[f64], b: &[f64]) -> [f64; 3] {
    let (a, a_rest) = a.as_chunks::<4>();
    let (b, b_rest) = b.as_chunks::<4>();
    let [mut sum, mut squares, mut products] = [[0.0; 4]; 3];
    for (a, b) in a.iter().zip(b) {
        for lane in 0..4 {
            sum[lane] += a[lane];
            squares[lane] += a[lane] * a[lane];
            products[lane] += a[lane] * b[lane];
        }
    }
    for (a, b) in a_rest.iter().zip(b_rest) {
        sum[0] += a;
        squares[0] += a * a;
        products[0] += a * b;
    }
    [sum, squares, products].map(|lanes| (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]))
}
