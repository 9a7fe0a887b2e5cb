//! Voxel keys for the tables of the thinning: packed into one word for clouds of ordinary extent,
//! complete keys for all others.

use std::hash::Hasher;

use rayon::prelude::*;

use super::keys::VoxelHasher;
use crate::geometry::Vec3;

/// A way to number voxels.
pub(super) trait Numbering: Sync {
    /// Equal if two points share a voxel (and group).
    type Key: Copy + Eq + Default + Send + Sync;

    /// The key of the voxel of the point with this index and these coordinates in voxels, and the
    /// voxel's lower corner in voxels; `None` if a coordinate is not finite or the voxel cannot be
    /// numbered.
    fn voxel(&self, index: usize, in_voxels: &Vec3) -> Option<(Self::Key, Vec3)>;

    /// 64 irregular bits.
    fn hash(key: Self::Key) -> u64;
}

/// When added to a number of at most 2⁵¹, leaves its nearest integer in the last bits: 1.5 · 2⁵².
const TO_INTEGER: f64 = 6_755_399_441_055_744.0;
/// Largest first voxel of an axis, and largest number of bits of an axis: within these limits every
/// number too large for [`TO_INTEGER`] is recognised as lying outside.
const FARTHEST: f64 = (1u64 << 50) as f64;
const MOST_BITS: u32 = 49;
/// Bits of an axis before the cloud's extent is known: 10 km at 5 mm, half of it to each side of
/// the first point.
const GUESSED_BITS: u32 = 21;

/// The voxels of a box, numbered in one word.
pub(super) struct Packed {
    /// The first voxel of each axis, in the form that [`TO_INTEGER`] leaves.
    first: [u64; 3],
    /// Bits of each axis, in total less than 64.
    bits: [u32; 3],
}

impl Packed {
    /// The voxels around the first point.
    pub(super) fn around_first(points: &[Vec3], voxel_m: f64) -> Option<Self> {
        let first = points
            .iter()
            .map(|p| p / voxel_m)
            .find(|u| u.iter().all(|v| v.is_finite()))?;
        let half = (1u64 << (GUESSED_BITS - 1)) as f64;
        Self::new(first.map(|v| v.floor() - half), [GUESSED_BITS; 3])
    }

    /// The voxels of all points, if one word can number them.
    pub(super) fn of_all(points: &[Vec3], voxel_m: f64) -> Option<Self> {
        let nothing = || (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
        let (low, high) = points
            .par_iter()
            .map(|p| p / voxel_m)
            .filter(|u| u.iter().all(|v| v.is_finite()))
            .fold(nothing, |(low, high), u| (low.inf(&u), high.sup(&u)))
            .reduce(nothing, |a, b| (a.0.inf(&b.0), a.1.sup(&b.1)));
        let low = low.map(f64::floor);
        // Beyond 2⁶³ the conversion saturates, and the bits are too many in any case.
        let bits = (high.map(f64::floor) - low).map(|voxels| 64 - (voxels as u64).leading_zeros());
        Self::new(low, bits.into())
    }

    fn new(first: Vec3, bits: [u32; 3]) -> Option<Self> {
        let near = first.iter().all(|v| v.abs() <= FARTHEST);
        let short = bits.iter().all(|b| *b <= MOST_BITS) && bits.iter().sum::<u32>() < 64;
        (near && short).then(|| Self {
            first: first.map(|v| (v + TO_INTEGER).to_bits()).into(),
            bits,
        })
    }
}

impl Numbering for Packed {
    type Key = u64;

    #[inline(always)]
    fn voxel(&self, _index: usize, in_voxels: &Vec3) -> Option<(u64, Vec3)> {
        // `f64::floor` is a call on processors without SSE 4.1, and branches would be mispredicted
        // half of the time.
        let floor = in_voxels.map(|u| {
            let nearest = (u + TO_INTEGER) - TO_INTEGER;
            nearest - if nearest > u { 1.0 } else { 0.0 }
        });
        let along = |axis: usize| {
            let bits = (floor[axis] + TO_INTEGER).to_bits();
            bits.wrapping_sub(self.first[axis])
        };
        let [x, y, z] = [along(0), along(1), along(2)];
        let [a, b, c] = self.bits;
        (x >> a | y >> b | z >> c == 0).then_some((x | y << a | z << (a + b), floor))
    }

    #[inline(always)]
    fn hash(key: u64) -> u64 {
        let mut hasher = VoxelHasher::default();
        hasher.write_u64(key);
        hasher.finish()
    }
}

/// Complete keys: any voxel of any group.
pub(super) struct Whole<Group> {
    pub(super) group: Group,
}

impl<Group: Fn(usize) -> u64 + Sync> Numbering for Whole<Group> {
    /// As [`super::voxel_key`], and the group.
    type Key = ([i64; 3], u64);

    #[inline]
    fn voxel(&self, index: usize, in_voxels: &Vec3) -> Option<(Self::Key, Vec3)> {
        if !in_voxels.iter().all(|v| v.is_finite()) {
            return None;
        }
        let floor = in_voxels.map(f64::floor);
        let cell = floor.map(|v| v as i64);
        Some(((cell.into(), (self.group)(index)), floor))
    }

    #[inline]
    fn hash(([x, y, z], group): Self::Key) -> u64 {
        let mut hasher = VoxelHasher::default();
        for word in [x as u64, y as u64, z as u64, group] {
            hasher.write_u64(word);
        }
        hasher.finish()
    }
}
