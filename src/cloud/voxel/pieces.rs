//! Thinning of clouds that come piece by piece.

use rayon::prelude::*;

use super::thinning::thin;
use crate::geometry::Vec3;

/// Points that are taken in before they are thinned for the first time: less than 2 GB with all
/// that thinning takes.
const FIRST: usize = 1 << 25;

/// Thins a cloud that comes piece by piece, with the result that [`thin`] has on the whole.
///
/// Whoever thins whenever it [is full](Self::is_full), which is when there is twice as much as was
/// kept the last time, holds no more than twice what is kept and one piece (32 bytes a point, and
/// what [`thin`] takes), and spends three times the time of thinning all at once at most.
///
/// ```
/// use boresight::cloud::voxel::Thinner;
/// use boresight::geometry::Vec3;
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
    /// Points taken in so far.
    seen: u64,
    points: Vec<Vec3>,
    /// Where each of the points stood, ascending; `None` as long as none has been forgotten.
    indices: Option<Vec<u64>>,
    /// Points held that call for thinning, and the least of that.
    full: usize,
    first: usize,
}

impl Thinner {
    /// Has no points yet; `voxel_m` is the edge of the voxels (metres, positive).
    pub fn new(voxel_m: f64) -> Self {
        Self::with_first(voxel_m, FIRST)
    }

    /// Is full for the first time with `first` points.
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

    /// Takes in the next points.
    pub fn add(&mut self, points: &[Vec3]) {
        let next = self.seen + points.len() as u64;
        self.points.extend_from_slice(points);
        if let Some(indices) = &mut self.indices {
            indices.extend(self.seen..next);
        }
        self.seen = next;
    }

    /// Whether it is time to thin.
    pub fn is_full(&self) -> bool {
        self.points.len() >= self.full
    }

    /// Forgets the points that are not kept. The nearest of a voxel, of equals the first, is the
    /// nearest of the nearest of its parts, because the order of the points stays.
    ///
    /// # Panics
    /// With 2³² points or more.
    pub fn thin(&mut self) {
        let kept = thin(&self.points, self.voxel_m);
        self.indices = Some(self.named(&kept));
        for (to, &from) in kept.iter().enumerate() {
            self.points[to] = self.points[from as usize];
        }
        self.points.truncate(kept.len());
        self.full = self.first.max(2 * kept.len());
    }

    /// Of all points taken in, the indices of those that are kept, ascending.
    ///
    /// # Panics
    /// With 2³² points or more.
    pub fn finish(self) -> Vec<u64> {
        self.named(&thin(&self.points, self.voxel_m))
    }

    /// Where the points at these places stood.
    fn named(&self, places: &[u32]) -> Vec<u64> {
        match &self.indices {
            Some(indices) => places.par_iter().map(|&at| indices[at as usize]).collect(),
            None => places.par_iter().map(|&at| u64::from(at)).collect(),
        }
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
        let mut points = surface(20_000);
        points[..800].fill(Vec3::repeat(f64::NAN));
        // From many points a voxel to about one.
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
                // Bounded by what is kept, not by what comes in.
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
