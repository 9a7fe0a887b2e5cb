//! Voxel keys, and maps over voxels.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use crate::geometry::Vec3;

/// Column, row and layer of a voxel.
pub type VoxelKey = [i64; 3];

/// A map with keys such as [`VoxelKey`], or tuples of it and other integers, with a fast hash that
/// is the same in every run.
pub type VoxelMap<Key, Value> = HashMap<Key, Value, BuildHasherDefault<VoxelHasher>>;

/// The voxel of edge `voxel_m` (metres, positive) that contains `point`.
#[inline]
pub fn voxel_key(point: &Vec3, voxel_m: f64) -> VoxelKey {
    [
        (point.x / voxel_m).floor() as i64,
        (point.y / voxel_m).floor() as i64,
        (point.z / voxel_m).floor() as i64,
    ]
}

/// The voxels that points lie in.
pub fn occupied(points: impl Iterator<Item = Vec3>, voxel_m: f64) -> VoxelMap<VoxelKey, ()> {
    points
        .map(|point| (voxel_key(&point, voxel_m), ()))
        .collect()
}

/// Squared distance from `point` to the centre of its voxel, in units of the edge.
#[inline]
pub fn squared_distance_to_centre(point: &Vec3, voxel_m: f64) -> f64 {
    let offset = (point / voxel_m).map(|u| u - u.floor() - 0.5);
    offset.norm_squared()
}

/// Hashes the integers of voxel keys: each word is added to the state, which is multiplied by an
/// odd constant to 128 bits and folded. Not safe against keys made to collide, which do not occur
/// in measured points.
#[derive(Debug, Clone, Copy, Default)]
pub struct VoxelHasher {
    state: u64,
}

impl VoxelHasher {
    #[inline]
    fn mix(&mut self, word: u64) {
        // 2⁶⁴ divided by the golden ratio: odd, with irregular bits.
        const MULTIPLIER: u128 = 0x9E37_79B9_7F4A_7C15;
        // The rotation separates (a, b) from (b, a); the added constant keeps zeros from staying
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
