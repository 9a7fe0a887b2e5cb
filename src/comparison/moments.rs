//! Number, mean and covariance of the points in a ball, in one pass.

use super::sums;
use crate::cloud::StructureTensor;
use crate::cloud::vectors::with_widest_vectors;
use crate::geometry::{Mat3, Vec3};

/// Offsets of points from the centre of a ball, coordinate by coordinate; those of points outside
/// are 0.
#[derive(Debug, Default)]
pub(super) struct Offsets {
    lists: [Vec<f64>; 3],
    filled: usize,
    inside: u64,
}

impl Offsets {
    pub(super) fn clear(&mut self) {
        self.filled = 0;
        self.inside = 0;
    }

    /// Adds points, given as lists of their coordinates of the same length: those with
    /// |p − centre|² ≤ `limit` lie inside. What is not finite lies outside.
    pub(super) fn add(&mut self, points: [&[f64]; 3], centre: &Vec3, limit: f64) {
        let end = self.filled + points[0].len();
        if self.lists[0].len() < end {
            for list in &mut self.lists {
                list.resize(2 * end, 0.0);
            }
        }
        let [x, y, z] = &mut self.lists;
        let into = [
            &mut x[self.filled..end],
            &mut y[self.filled..end],
            &mut z[self.filled..end],
        ];
        self.inside += offsets_within(points, centre, limit, into);
        self.filled = end;
    }

    /// The structure tensor of the points inside.
    ///
    /// Sums of squares about the centre lose what is small beside the square of the radius.
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
    /// Writes the offsets of points from `centre`, 0 for those farther than the root of `limit`, and
    /// returns how many are not.
    fn offsets_within(points: [&[f64]; 3], centre: &Vec3, limit: f64, into: [&mut [f64]; 3]) -> u64
        = write_offsets
}

#[inline(always)]
fn write_offsets(
    [x, y, z]: [&[f64]; 3],
    centre: &Vec3,
    limit: f64,
    [into_x, into_y, into_z]: [&mut [f64]; 3],
) -> u64 {
    let count = x.len();
    let (y, z) = (&y[..count], &z[..count]);
    let (into_x, into_y, into_z) = (
        &mut into_x[..count],
        &mut into_y[..count],
        &mut into_z[..count],
    );
    let centre = *centre;
    let mut found = 0;
    for at in 0..count {
        let (x, y, z) = (x[at] - centre.x, y[at] - centre.y, z[at] - centre.z);
        // Without a branch: which points are inside is as good as random. All bits stay, or none.
        let inside = u64::from(x * x + y * y + z * z <= limit);
        let keep = |value: f64| f64::from_bits(value.to_bits() & inside.wrapping_neg());
        into_x[at] = keep(x);
        into_y[at] = keep(y);
        into_z[at] = keep(z);
        found += inside;
    }
    found
}
