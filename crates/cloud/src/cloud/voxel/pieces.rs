//! Thinning of clouds that arrive in pieces.

use rayon::prelude::*;

use super::thinning::thin;
use crate::geometry::Vec3;

/// Number of points at which a cloud is thinned for the first time: less than 2 GB with all that
/// thinning takes.
const FIRST: usize = 1 << 25;

/// Thins a cloud that arrives in pieces, with the same result as [`thin`] on the whole.
///
/// It [is full](Self::is_full) when it holds twice as many points as were kept last time. If it is
/// thinned whenever it is full, it holds at most one piece and twice the points that are kept (32
/// bytes per point, and the memory of [`thin`]), and takes at most three times as long as thinning the
/// whole cloud at once.
///
/// ```
/// use boresight_cloud::cloud::voxel::Thinner;
/// use boresight_cloud::geometry::Vec3;
/// let mut thinner = Thinner::new(1.0);
/// for piece in [[0.1, 0.6], [0.9, 1.2]] {
///     thinner.add(&piece.map(|x| Vec3::new(x, 0.5, 0.5)));
///     if thinner.is_full() {
///         thinner.thin();
///     }
/// }
/// assert_eq!(thinner.finish(), [1, 3]);
/// ```
#[derive(Debug, Clone)]
pub struct Thinner {
    voxel_m: f64,
    /// Number of points added so far.
    seen: u64,
    points: Vec<Vec3>,
    /// Index of each point, ascending; `None` as long as no point has been dropped.
    indices: Option<Vec<u64>>,
    /// Number of points at which thinning is due.
    full: usize,
    /// Smallest value of `full`.
    first: usize,
}

impl Thinner {
    /// An empty thinner; `voxel_m` is the edge of the voxels (metres, positive).
    pub fn new(voxel_m: f64) -> Self {
        Self::with_first(voxel_m, FIRST)
    }

    /// A thinner that is full for the first time with `first` points.
    fn with_first(voxel_m: f64, first: usize) -> Self {
        Self {
            voxel_m,
            seen: 0,
            points: Vec::new(),
            indices: None,
            full: first,
            first,
        }
    }

    /// Adds the next points.
    pub fn add(&mut self, points: &[Vec3]) {
        let next = self.seen + points.len() as u64;
        self.points.extend_from_slice(points);
        if let Some(indices) = &mut self.indices {
            indices.extend(self.seen..next);
        }
        self.seen = next;
    }

    /// Whether thinning is due.
    pub fn is_full(&self) -> bool {
        self.points.len() >= self.full
    }

    /// Drops the points that are not kept. This does not change the final result: the nearest point of a
    /// voxel (at equal distances the first) is also the nearest of its piece, and the order of the points
    /// is preserved.
    ///
    /// # Panics
    /// With 2³² points or more.
    pub fn thin(&mut self) {
        let kept = thin(&self.points, self.voxel_m);
        self.indices = Some(self.indices_of(&kept));
        for (to, &from) in kept.iter().enumerate() {
            self.points[to] = self.points[from as usize];
        }
        self.points.truncate(kept.len());
        self.full = self.first.max(2 * kept.len());
    }

    /// The indices, among all points added, of the points that are kept, ascending.
    ///
    /// # Panics
    /// With 2³² points or more.
    pub fn finish(self) -> Vec<u64> {
        self.indices_of(&thin(&self.points, self.voxel_m))
    }

    /// The indices of the points at these positions.
    fn indices_of(&self, places: &[u32]) -> Vec<u64> {
        match &self.indices {
            Some(indices) => places.par_iter().map(|&at| indices[at as usize]).collect(),
            None => places.par_iter().map(|&at| u64::from(at)).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A rough surface with an occasional duplicate point.
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
        let mut points = surface(20_000);
        points[..800].fill(Vec3::repeat(f64::NAN));
        // From many points per voxel to about one.
        for voxel_m in [0.2, 0.03, 0.004] {
            let whole: Vec<u64> = thin(&points, voxel_m).iter().map(|&i| i.into()).collect();
            for (first, piece) in [(1, 1), (10, 999), (700, 64), (5000, 7), (100, 20_000)] {
                let mut thinner = Thinner::with_first(voxel_m, first);
                let mut most = 0;
                for piece in points.chunks(piece) {
                    thinner.add(piece);
                    most = most.max(thinner.points.len());
                    if thinner.is_full() {
                        thinner.thin();
                    }
                }
                let found = thinner.finish();
                assert_eq!(found, whole, "{voxel_m} m, pieces of {piece}");
                // Bounded by the number of points kept, not added.
                assert!(most <= first.max(2 * whole.len()) + piece, "{most}");
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
