//! Parallel thinning: points are distributed to buckets by the hash of their voxel, so small that
//! the table of one stays in a core's cache; then each bucket is thinned separately.

use std::sync::atomic::{AtomicU8, Ordering};

use rayon::prelude::*;

use super::keys::squared_distance_to_centre;
use super::numbering::{Numbering, Packed, Whole};
use crate::geometry::Vec3;

/// Points distributed at a time: they and their entries stay in a core's cache, and the share of a
/// bucket is long enough to be read sequentially.
const CHUNK: usize = 1 << 16;
/// Approximate number of points in a bucket. Its table takes 1 MB.
const BUCKET: usize = 1 << 15;
/// With more buckets, each would get only a few entries of a chunk.
const MOST_BUCKET_BITS: u32 = 12;

/// Indices of one point for each occupied voxel of edge `voxel_m` (metres, positive): the point
/// nearest to the voxel's centre, at equal distances the first. Ascending, and the same for any
/// number of threads. A point with a coordinate that is NaN or infinite is never kept.
///
/// Takes 17 bytes of memory per point in addition to the cloud and the result.
///
/// # Panics
/// With 2³² points or more.
///
/// ```
/// use boresight_cloud::cloud::voxel::thin;
/// use boresight_cloud::geometry::Vec3;
/// let points = [0.1, 0.6, 0.9, 1.2].map(|x| Vec3::new(x, 0.5, 0.5));
/// assert_eq!(thin(&points, 1.0), [1, 3]);
/// ```
pub fn thin(points: &[Vec3], voxel_m: f64) -> Vec<u32> {
    // The extent is rarely so large that a second pass over all points is needed.
    let packed = Packed::around_first(points, voxel_m)
        .and_then(|numbering| thin_numbered(points, voxel_m, &numbering).ok());
    packed
        .or_else(|| {
            let numbering = Packed::of_all(points, voxel_m)?;
            thin_numbered(points, voxel_m, &numbering).ok()
        })
        .unwrap_or_else(|| thin_by(points, voxel_m, |_| 0))
}

/// As [`thin`], for each group of points separately: one point for each voxel and value of `group`,
/// which is called with the index of the point (it may return its scanner and pass, for example).
/// Takes two and a half times the memory.
///
/// Thinning across passes would hide the discrepancies between them, which calibration minimises.
///
/// # Panics
/// With 2³² points or more.
pub fn thin_by(points: &[Vec3], voxel_m: f64, group: impl Fn(usize) -> u64 + Sync) -> Vec<u32> {
    thin_numbered(points, voxel_m, &Whole { group })
        .unwrap_or_else(|Outside| unreachable!("every voxel has a whole number"))
}

/// A point is outside the voxels that can be numbered.
struct Outside;

/// A point with the key of its voxel and the rating that decides between points of one voxel. The
/// rating is the squared distance to the centre as the bits of an f32, which are ordered like the
/// numbers, followed by the index. Rounding never swaps two distances, so only those with equal
/// bits need a second comparison.
type Entry<Key> = (Key, u64);

/// Not a rating of any point: squared distances are at most 0.75.
const FREE: u64 = u64::MAX;

/// The entries of a chunk of points, by bucket.
struct Distributed<Key> {
    entries: Vec<Entry<Key>>,
    /// The first entry of each bucket, and the end.
    starts: Vec<u32>,
}

/// The voxels of a bucket with the best rating of each, in open addressing.
pub(super) struct Table<Key> {
    /// Their number is a power of two.
    slots: Vec<Entry<Key>>,
    /// Shift that leaves as many leading bits of a hash as number the slots.
    shift: u32,
    used: usize,
}

impl<Key: Copy + Eq + Default> Table<Key> {
    pub(super) fn new() -> Self {
        Self {
            slots: Vec::new(),
            shift: 0,
            used: 0,
        }
    }

    /// Removes all voxels and makes room for `count`.
    pub(super) fn clear(&mut self, count: usize) {
        let slots = (count + count / 2 + 2).next_power_of_two();
        self.slots.clear();
        self.slots.resize(slots, (Key::default(), FREE));
        self.shift = 64 - slots.trailing_zeros();
        self.used = 0;
    }

    /// The rating of a voxel, inserted as [`FREE`] if the voxel is new.
    #[inline(always)]
    pub(super) fn rating_mut(&mut self, key: Key, place: impl Fn(Key) -> u64) -> &mut u64 {
        let mask = self.slots.len() - 1;
        let mut at = (place(key) >> self.shift) as usize & mask;
        loop {
            let (other, rating) = self.slots[at];
            if other == key && rating != FREE {
                break;
            }
            if rating == FREE {
                self.slots[at].0 = key;
                break;
            }
            at = (at + 1) & mask;
        }
        &mut self.slots[at].1
    }

    /// Counts a voxel that has been added, and grows the table if it fills up.
    #[inline(always)]
    pub(super) fn count_added(&mut self, place: impl Fn(Key) -> u64) {
        self.used += 1;
        if self.used > self.slots.len() / 4 * 3 {
            self.grow(place);
        }
    }

    #[cold]
    fn grow(&mut self, place: impl Fn(Key) -> u64) {
        let old = std::mem::take(&mut self.slots);
        let used = self.used;
        self.clear(2 * old.len());
        self.used = used;
        for (key, rating) in old.into_iter().filter(|slot| slot.1 != FREE) {
            *self.rating_mut(key, &place) = rating;
        }
    }
}

/// Points and their marks: kept or not.
struct Thinning<'a> {
    points: &'a [Vec3],
    voxel_m: f64,
    /// 1 if a point is not kept.
    dropped: Vec<AtomicU8>,
}

impl Thinning<'_> {
    fn drop_point(&self, index: usize) {
        self.dropped[index].store(1, Ordering::Relaxed);
    }

    /// Leaves the better of two ratings of one voxel in `held` and marks the other's point.
    #[inline(always)]
    fn keep_better(&self, held: &mut u64, other: u64) {
        let (mut better, mut worse) = ((*held).min(other), (*held).max(other));
        if better >> 32 == worse >> 32 && self.swapped(better as u32, worse as u32) {
            std::mem::swap(&mut better, &mut worse);
        }
        *held = better;
        self.drop_point(worse as u32 as usize);
    }

    /// Whether the later of two points is nearer to the centre by a difference lost in f32.
    #[cold]
    fn swapped(&self, first: u32, second: u32) -> bool {
        let distance = |i: u32| squared_distance_to_centre(&self.points[i as usize], self.voxel_m);
        distance(second) < distance(first)
    }

    /// Distributes chunk `number` of the points to 2^`bits` buckets; consecutive points that share
    /// a voxel, as those of a profile often do, are compared at once.
    fn distribute<N: Numbering>(
        &self,
        number: usize,
        bits: u32,
        numbering: &N,
        entries: &mut Vec<Entry<N::Key>>,
    ) -> Result<Distributed<N::Key>, Outside> {
        let first = number * CHUNK;
        let last = (first + CHUNK).min(self.points.len());
        let bucket = |key| (N::hash(key) >> (64 - bits)) as usize;
        let mut counts = vec![0u32; 1 << bits];
        let mut before = None;
        entries.clear();
        for (index, point) in (first..last).zip(&self.points[first..last]) {
            let in_voxels = point / self.voxel_m;
            let Some((key, floor)) = numbering.voxel(index, &in_voxels) else {
                if in_voxels.iter().all(|v| v.is_finite()) {
                    return Err(Outside);
                }
                self.drop_point(index);
                continue;
            };
            let distance = (in_voxels - floor - Vec3::repeat(0.5)).norm_squared();
            let rating = u64::from((distance as f32).to_bits()) << 32 | index as u64;
            if before == Some(key)
                && let Some((_, held)) = entries.last_mut()
            {
                self.keep_better(held, rating);
                continue;
            }
            before = Some(key);
            counts[bucket(key)] += 1;
            entries.push((key, rating));
        }
        let mut starts = Vec::with_capacity(counts.len() + 1);
        let mut end = 0;
        starts.push(end);
        for count in &mut counts {
            let start = end;
            end += *count;
            starts.push(end);
            *count = start;
        }
        let mut places = counts;
        let mut distributed = vec![Entry::default(); entries.len()];
        for entry in &*entries {
            let place = &mut places[bucket(entry.0)];
            distributed[*place as usize] = *entry;
            *place += 1;
        }
        Ok(Distributed {
            entries: distributed,
            starts,
        })
    }

    /// Selects the points of a bucket from the `runs` that the chunks contributed.
    fn select<'b, N: Numbering>(
        &self,
        runs: impl Iterator<Item = &'b [Entry<N::Key>]> + Clone,
        bits: u32,
        table: &mut Table<N::Key>,
    ) where
        N::Key: 'b,
    {
        let count: usize = runs.clone().map(<[_]>::len).sum();
        // The bits that selected the bucket are the same for all of its voxels.
        let place = |key| N::hash(key) << bits;
        table.clear(count.min(2 * BUCKET));
        for &(key, rating) in runs.flatten() {
            let held = table.rating_mut(key, place);
            if *held == FREE {
                *held = rating;
                table.count_added(place);
            } else {
                self.keep_better(held, rating);
            }
        }
    }

    /// The indices of the points that are kept.
    fn kept(&self) -> Vec<u32> {
        let is_dropped = |mark: &AtomicU8| mark.load(Ordering::Relaxed) != 0;
        let count = |chunk: &[AtomicU8]| chunk.iter().filter(|mark| !is_dropped(mark)).count();
        let counts: Vec<usize> = self.dropped.par_chunks(CHUNK).map(count).collect();
        let mut kept = vec![0; counts.iter().sum()];
        let mut rest = kept.as_mut_slice();
        let mut parts = Vec::with_capacity(counts.len());
        for count in counts {
            parts.push(rest.split_off_mut(..count).unwrap_or_default());
        }
        parts.into_par_iter().enumerate().for_each_init(
            || vec![0; CHUNK],
            |indices, (number, part)| {
                let first = number * CHUNK;
                let marks = &self.dropped[first..(first + CHUNK).min(self.dropped.len())];
                let mut count = 0;
                // Also writes indices that are not kept, to be overwritten: cheaper than a branch.
                for (mark, index) in marks.iter().zip(first as u32..) {
                    indices[count] = index;
                    count += usize::from(!is_dropped(mark));
                }
                part.copy_from_slice(&indices[..count]);
            },
        );
        kept
    }
}

fn thin_numbered<N: Numbering>(
    points: &[Vec3],
    voxel_m: f64,
    numbering: &N,
) -> Result<Vec<u32>, Outside> {
    let n = points.len();
    assert!(
        u32::try_from(n).is_ok(),
        "{n} points are too many to thin at once"
    );
    let thinning = Thinning {
        points,
        voxel_m,
        dropped: (0..n).into_par_iter().map(|_| AtomicU8::new(0)).collect(),
    };
    let bits = (n / BUCKET).max(2).next_power_of_two().trailing_zeros();
    let bits = bits.min(MOST_BUCKET_BITS);
    let distributed = (0..n.div_ceil(CHUNK))
        .into_par_iter()
        .map_init(
            || Vec::with_capacity(CHUNK.min(n)),
            |entries, number| thinning.distribute(number, bits, numbering, entries),
        )
        .collect::<Result<Vec<_>, Outside>>()?;
    (0..1usize << bits)
        .into_par_iter()
        .for_each_init(Table::new, |table, bucket| {
            let runs = distributed.iter().map(|chunk| {
                let (start, end) = (chunk.starts[bucket], chunk.starts[bucket + 1]);
                &chunk.entries[start as usize..end as usize]
            });
            thinning.select::<N>(runs, bits, table);
        });
    Ok(thinning.kept())
}
