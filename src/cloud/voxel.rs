//! Thinning on a voxel grid that is fixed in space.
//!
//! Voxel i along an axis is the half-open interval [i v, (i + 1) v) of the edge length v, so the
//! same point falls into the same voxel whatever cloud it belongs to.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::hash::{BuildHasherDefault, Hasher};

use crate::geometry::Vec3;

/// Column, row and layer of a voxel.
pub type VoxelKey = [i64; 3];

/// A map with keys such as [`VoxelKey`], or tuples of it and other integers, hashed quickly and the
/// same in every run.
pub type VoxelMap<Key, Value> = HashMap<Key, Value, BuildHasherDefault<VoxelHasher>>;

/// The voxel of edge `voxel_m` (metres, positive) that holds `point`.
#[inline]
pub fn voxel_key(point: &Vec3, voxel_m: f64) -> VoxelKey {
    [
        (point.x / voxel_m).floor() as i64,
        (point.y / voxel_m).floor() as i64,
        (point.z / voxel_m).floor() as i64,
    ]
}

/// Squared distance of `point` to the centre of its voxel, in units of the edge.
#[inline]
pub fn squared_distance_to_centre(point: &Vec3, voxel_m: f64) -> f64 {
    let offset = (point / voxel_m).map(|u| u - u.floor() - 0.5);
    offset.norm_squared()
}

/// Indices of one point for each occupied voxel of edge `voxel_m` (metres, positive): the point
/// nearest to the voxel's centre, of equals the first. Ascending.
///
/// ```
/// use boresight::cloud::voxel::thin;
/// use boresight::geometry::Vec3;
/// let points = [0.1, 0.6, 0.9, 1.2].map(|x| Vec3::new(x, 0.5, 0.5));
/// assert_eq!(thin(&points, 1.0), [1, 3]);
/// ```
pub fn thin(points: &[Vec3], voxel_m: f64) -> Vec<u32> {
    thin_by(points, voxel_m, |_| 0)
}

/// As [`thin`], for each group of points by itself: one point for each voxel and value of `group`,
/// which is asked with the index of the point (for instance its scanner and pass).
///
/// Thinning across passes would hide the misfit between them, which is what calibration looks for.
pub fn thin_by(points: &[Vec3], voxel_m: f64, group: impl Fn(usize) -> u64) -> Vec<u32> {
    let mut best: VoxelMap<(VoxelKey, u64), (f64, u32)> = VoxelMap::default();
    for ((at, point), index) in points.iter().enumerate().zip(0u32..) {
        let distance = squared_distance_to_centre(point, voxel_m);
        match best.entry((voxel_key(point, voxel_m), group(at))) {
            Entry::Vacant(place) => {
                place.insert((distance, index));
            }
            Entry::Occupied(mut place) => {
                if distance < place.get().0 {
                    place.insert((distance, index));
                }
            }
        }
    }
    let mut kept: Vec<u32> = best.into_values().map(|(_, index)| index).collect();
    kept.sort_unstable();
    kept
}

/// Hashes the integers of voxel keys: each word is added to the state, which is multiplied by an
/// odd constant to 128 bits and folded. Not safe against keys made to collide, which measured
/// points are not.
#[derive(Debug, Clone, Copy, Default)]
pub struct VoxelHasher {
    state: u64,
}

impl VoxelHasher {
    #[inline]
    fn mix(&mut self, word: u64) {
        // 2⁶⁴ divided by the golden ratio: odd, bits without pattern.
        const MULTIPLIER: u128 = 0x9E37_79B9_7F4A_7C15;
        // The rotation keeps (a, b) apart from (b, a); the added constant keeps zeros from staying
        // zero.
        let word = word ^ self.state.rotate_left(23) ^ 0xD1B5_4A32_D192_ED03;
        let product = u128::from(word) * MULTIPLIER;
        self.state = (product as u64) ^ ((product >> 64) as u64);
    }
}

impl Hasher for VoxelHasher {
    #[inline]
    fn write(&mut self, bytes: &[u8]) {
        let (words, rest) = bytes.as_chunks::<8>();
        for word in words {
            self.mix(u64::from_le_bytes(*word));
        }
        if !rest.is_empty() {
            let mut last = [0; 8];
            last[..rest.len()].copy_from_slice(rest);
            self.mix(u64::from_le_bytes(last));
        }
    }

    #[inline]
    fn write_u64(&mut self, word: u64) {
        self.mix(word);
    }

    #[inline]
    fn write_u32(&mut self, word: u32) {
        self.mix(u64::from(word));
    }

    #[inline]
    fn write_usize(&mut self, word: usize) {
        self.mix(word as u64);
    }

    #[inline]
    fn finish(&self) -> u64 {
        self.state
    }
}
