//! Thinning of clouds that come piece by piece.

use super::thin;
use crate::geometry::Vec3;

/// Points that are taken in before they are thinned for the first time.
const FIRST: usize = 1 << 22;

/// Thins a cloud that comes piece by piece, with the result that [`thin`] has on the whole.
///
/// What is held is thinned whenever there is twice as much of it as was kept the last time: memory
/// is bounded by twice what is kept (32 bytes a point held, and what [`thin`] takes), time by three
/// times that of thinning everything at once.
///
/// ```
/// use boresight::cloud::voxel::Thinner;
/// use boresight::geometry::Vec3;
/// let at = |x| Vec3::new(x, 0.5, 0.5);
/// let mut thinner = Thinner::new(1.0);
/// thinner.add(&[at(0.1), at(0.6)]);
/// thinner.add(&[at(0.9), at(1.2)]);
/// assert_eq!(thinner.finish(), [1, 3]);
/// ```
#[derive(Debug, Clone)]
pub struct Thinner {
    voxel_m: f64,
    /// Points taken in so far.
    seen: u64,
    points: Vec<Vec3>,
    /// Where each of the points stood, ascending.
    indices: Vec<u64>,
    /// Points held that call for thinning.
    full: usize,
    first: usize,
}

impl Thinner {
    /// Has no points yet; `voxel_m` is the edge of the voxels (metres, positive).
    pub fn new(voxel_m: f64) -> Self {
        Self::with_first(voxel_m, FIRST)
    }

    /// Thins for the first time when `first` points are there.
    fn with_first(voxel_m: f64, first: usize) -> Self {
        Self {
            voxel_m,
            seen: 0,
            points: Vec::new(),
            indices: Vec::new(),
            full: first,
            first,
        }
    }

    /// Takes in the next points.
    ///
    /// # Panics
    /// When 2³² points or more have to be held.
    pub fn add(&mut self, points: &[Vec3]) {
        let mut rest = points;
        while !rest.is_empty() {
            let room = self.full.saturating_sub(self.points.len());
            let (piece, after) = rest.split_at(room.min(rest.len()));
            rest = after;
            self.points.extend_from_slice(piece);
            let next = self.seen + piece.len() as u64;
            self.indices.extend(self.seen..next);
            self.seen = next;
            if self.points.len() >= self.full {
                self.thin();
                self.full = self.first.max(2 * self.points.len());
            }
        }
    }

    /// Of all points taken in, the indices of those that are kept, ascending.
    ///
    /// # Panics
    /// When 2³² points or more have to be held.
    pub fn finish(mut self) -> Vec<u64> {
        self.thin();
        self.indices
    }

    /// Forgets what is not kept. The nearest of a voxel, of equals the first, is the nearest of the
    /// nearest of its parts, because the order of the points stays.
    fn thin(&mut self) {
        let kept = thin(&self.points, self.voxel_m);
        for (to, &from) in kept.iter().enumerate() {
            self.points[to] = self.points[from as usize];
            self.indices[to] = self.indices[from as usize];
        }
        self.points.truncate(kept.len());
        self.indices.truncate(kept.len());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A rough surface with a point that comes twice now and then.
    fn surface(n: usize) -> Vec<Vec3> {
        let mut points: Vec<Vec3> = (0..n as u64)
            .map(|i| {
                let part = |k: u64| {
                    let mixed = (i * 3 + k).wrapping_mul(0x9E37_79B9_7F4A_7C15);
                    (mixed ^ mixed >> 29).wrapping_mul(0xBF58_476D_1CE4_E5B9) as f64 / 2f64.powi(64)
                };
                Vec3::new(part(0), part(1) - 0.5, 0.02 * part(2))
            })
            .collect();
        for i in (0..n).step_by(7) {
            points[n - 1 - i] = points[i];
        }
        points
    }

    #[test]
    fn a_cloud_in_pieces_is_thinned_as_in_one() {
        let points = surface(20_000);
        // From many points a voxel to about one.
        for voxel_m in [0.2, 0.03, 0.004] {
            let whole: Vec<u64> = thin(&points, voxel_m).iter().map(|&i| i.into()).collect();
            for (first, piece) in [(1, 1), (10, 999), (700, 64), (5000, 7), (100, 20_000)] {
                let mut thinner = Thinner::with_first(voxel_m, first);
                let mut most = 0;
                for piece in points.chunks(piece) {
                    thinner.add(piece);
                    most = most.max(thinner.points.len());
                }
                let found = thinner.finish();
                assert_eq!(found, whole, "{voxel_m} m, pieces of {piece}");
                // Bounded by what is kept, not by what comes in.
                assert!(most <= first.max(2 * whole.len()), "{most}");
            }
        }
    }

    #[test]
    fn nothing_stays_nothing() {
        let mut thinner = Thinner::new(0.1);
        assert!(thinner.clone().finish().is_empty());
        thinner.add(&[]);
        thinner.add(&[Vec3::repeat(f64::NAN)]);
        assert!(thinner.finish().is_empty());
    }
}
