//! Number, mean and covariance of the points in a ball, in one pass.

use super::sums;
use super::window::{BallQuery, Window};
use crate::cloud::StructureTensor;
use crate::cloud::vectors::with_widest_vectors;
use crate::geometry::{Mat3, Vec3};

/// Offsets of points from the centre of a ball, one list per coordinate; 0 for points outside the ball.
#[derive(Debug, Default)]
pub(super) struct Offsets {
    lists: [Vec<f64>; 3],
    filled: usize,
    inside: u64,
}

impl Offsets {
    /// Replaces all values by the offsets of the points in the closed ball of `radius` (metres)
    /// around `centre`.
    pub(super) fn fill(&mut self, window: &Window, centre: &Vec3, radius: f64) {
        let ball = window.ball(centre, radius);
        fill_offsets(self, window, &ball, centre, radius * radius);
    }

    /// The structure tensor of the points inside.
    ///
    /// Sums of squares about the centre lose terms that are small relative to the squared radius.
    pub(super) fn tensor(&self, centre: &Vec3) -> StructureTensor {
        let [x, y, z] = &self.lists;
        let filled = self.filled;
        let [x, y, z] = [&x[..filled], &y[..filled], &z[..filled]];
        let n = self.inside as f64;
        let [sum_x, sum_y, sum_z, xx, xy, xz, yy, yz, zz] =
            sums::moments(x, y, z).map(|sum| sum / n);
        let mean = Vec3::new(sum_x, sum_y, sum_z);
        StructureTensor {
            mean: centre + mean,
            covariance: Mat3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) - mean * mean.transpose(),
            count: self.inside as usize,
        }
    }
}

with_widest_vectors! {
    fn fill_offsets(
        offsets: &mut Offsets,
        window: &Window,
        ball: &BallQuery,
        centre: &Vec3,
        limit: f64
    ) = fill
}

/// Points with |p − centre|² ≤ `limit` are inside; points that are not finite are outside. No
/// closures: they would not be compiled for wide vectors.
#[inline(always)]
fn fill(offsets: &mut Offsets, window: &Window, ball: &BallQuery, centre: &Vec3, limit: f64) {
    offsets.filled = 0;
    offsets.inside = 0;
    for row in 0..window.rows() {
        let [x, y, z] = window.row_in_ball(row, ball);
        let begin = offsets.filled;
        let end = begin + x.len();
        let [into_x, into_y, into_z] = &mut offsets.lists;
        if into_x.len() < end {
            into_x.resize(2 * end, 0.0);
            into_y.resize(2 * end, 0.0);
            into_z.resize(2 * end, 0.0);
        }
        offsets.inside += write(
            x,
            y,
            z,
            centre,
            limit,
            &mut into_x[begin..end],
            &mut into_y[begin..end],
            &mut into_z[begin..end],
        );
        offsets.filled = end;
    }
}

/// Writes the offsets of points from `centre`, 0 for those outside, and returns the number of those
/// inside.
#[inline(always)]
#[allow(clippy::too_many_arguments)] // Compilers know of separate lists that they do not overlap.
fn write(
    x: &[f64],
    y: &[f64],
    z: &[f64],
    centre: &Vec3,
    limit: f64,
    into_x: &mut [f64],
    into_y: &mut [f64],
    into_z: &mut [f64],
) -> u64 {
    let count = x.len();
    let (y, z) = (&y[..count], &z[..count]);
    let (into_x, into_y, into_z) = (
        &mut into_x[..count],
        &mut into_y[..count],
        &mut into_z[..count],
    );
    let centre = *centre;
    let mut inside_count = 0;
    for at in 0..count {
        let (x, y, z) = (x[at] - centre.x, y[at] - centre.y, z[at] - centre.z);
        // Without a branch, because which points are inside is nearly random. All bits stay, or
        // none.
        let inside = u64::from(x * x + y * y + z * z <= limit);
        let keep = inside.wrapping_neg();
        into_x[at] = f64::from_bits(x.to_bits() & keep);
        into_y[at] = f64::from_bits(y.to_bits() & keep);
        into_z[at] = f64::from_bits(z.to_bits() & keep);
        inside_count += inside;
    }
    inside_count
}
