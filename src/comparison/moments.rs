//! Number, mean and covariance of the points in a ball, in one pass.

use super::window::{Ball, Window};
use crate::cloud::StructureTensor;
use crate::cloud::vectors::with_widest_vectors;
use crate::geometry::{Mat3, Vec3};

/// Sums that run side by side: one alone waits for its last addition.
const LANES: usize = 8;

/// Σx, Σy, Σz, Σxx, Σxy, Σxz, Σyy, Σyz, Σzz of offsets from the centre of a ball, and how many there
/// are, each in several parts.
#[derive(Debug, Clone, Copy)]
struct Sums {
    moments: [[f64; LANES]; 9],
    inside: [u64; LANES],
}

/// The structure tensor of the points of a window in the closed ball of `radius` (metres) around
/// `centre`.
///
/// Sums of squares about the centre lose what is small beside the square of the radius.
pub(super) fn tensor_in_ball(window: &Window, centre: &Vec3, radius: f64) -> StructureTensor {
    let mut sums = Sums {
        moments: [[0.0; LANES]; 9],
        inside: [0; LANES],
    };
    add_ball(
        &mut sums,
        window,
        &window.ball(centre, radius),
        centre,
        radius * radius,
    );
    let count: u64 = sums.inside.iter().sum();
    let [x, y, z, xx, xy, xz, yy, yz, zz] = sums
        .moments
        .map(|[a, b, c, d, e, f, g, h]| ((a + e) + (c + g)) + ((b + f) + (d + h)))
        .map(|sum| sum / count as f64);
    let mean = Vec3::new(x, y, z);
    StructureTensor {
        mean: centre + mean,
        covariance: Mat3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) - mean * mean.transpose(),
        count: count as usize,
    }
}

with_widest_vectors! {
    fn add_ball(sums: &mut Sums, window: &Window, ball: &Ball, centre: &Vec3, limit: f64) = add
}

/// Those with |p − centre|² ≤ `limit` lie inside; what is not finite lies outside. Written without
/// closures, which would not be compiled for the wide vectors.
#[inline(always)]
fn add(sums: &mut Sums, window: &Window, ball: &Ball, centre: &Vec3, limit: f64) {
    let Sums {
        mut moments,
        mut inside,
    } = *sums;
    for row in 0..window.rows() {
        let [x, y, z] = window.row_in_ball(row, ball);
        let (x, y, z) = (
            x.as_chunks::<LANES>().0,
            y.as_chunks::<LANES>().0,
            z.as_chunks::<LANES>().0,
        );
        for ((x, y), z) in x.iter().zip(y).zip(z) {
            let (mut dx, mut dy, mut dz) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
            let mut keep = [0; LANES];
            for i in 0..LANES {
                dx[i] = x[i] - centre.x;
                dy[i] = y[i] - centre.y;
                dz[i] = z[i] - centre.z;
            }
            for i in 0..LANES {
                // Without a branch: which points are inside is as good as random. All bits stay,
                // or none.
                let is_inside = dx[i] * dx[i] + dy[i] * dy[i] + dz[i] * dz[i] <= limit;
                keep[i] = u64::from(is_inside).wrapping_neg();
                inside[i] += u64::from(is_inside);
            }
            for i in 0..LANES {
                dx[i] = f64::from_bits(dx[i].to_bits() & keep[i]);
                dy[i] = f64::from_bits(dy[i].to_bits() & keep[i]);
                dz[i] = f64::from_bits(dz[i].to_bits() & keep[i]);
            }
            let factors = [&dx, &dy, &dz];
            for axis in 0..3 {
                for i in 0..LANES {
                    moments[axis][i] += factors[axis][i];
                }
            }
            for (sum, (a, b)) in [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
                .into_iter()
                .enumerate()
            {
                for i in 0..LANES {
                    moments[3 + sum][i] += factors[a][i] * factors[b][i];
                }
            }
        }
    }
    *sums = Sums { moments, inside };
}
