//! The inner loops of [`super::candidates`], in plain Rust and for 512-bit vectors.
//!
//! Three of them use AVX-512 instructions that the compiler does not generate from plain loops:
//! comparisons that set bits, lists of the set bits, and products of a point's coordinates with
//! each other. Both versions give bit-identical results: no operation is fused or reordered.

/// Number of comparisons in one word of bits.
pub(super) const WORD: usize = 64;

/// Loops over candidates.
pub(super) trait Lanes {
    /// Counts the values of `squared` that do not exceed `threshold`.
    fn count(squared: &[f32], threshold: f32) -> usize;

    /// A word with bit i set if value i does not exceed `threshold`.
    fn up_to(squared: &[f32; WORD], threshold: f32) -> u64;

    /// Lists the positions of the set bits, in ascending order.
    fn places(words: &[u64], into: &mut Vec<u32>);

    /// Σ d (dᵀ, 1) with d = point − centre over the points at `places`; the fourth coordinate of a
    /// point is 1, of the centre 0. Points at even positions of the list are summed separately.
    fn moments(points: &[[f64; 4]], places: &[u32], centre: &[f64; 4]) -> [[f64; 4]; 3];
}

/// Portable loops, compiled for the vectors of the function they are inlined into.
pub(super) struct Plain;

impl Lanes for Plain {
    #[inline(always)]
    fn count(squared: &[f32], threshold: f32) -> usize {
        let mut count = 0u32;
        for squared in squared {
            count += u32::from(*squared <= threshold);
        }
        count as usize
    }

    #[inline(always)]
    fn up_to(squared: &[f32; WORD], threshold: f32) -> u64 {
        let mut bits = 0;
        for (at, squared) in squared.iter().enumerate() {
            bits |= u64::from(*squared <= threshold) << at;
        }
        bits
    }

    #[inline(always)]
    fn places(words: &[u64], into: &mut Vec<u32>) {
        let count: u32 = words.iter().map(|word| word.count_ones()).sum();
        into.resize(count as usize, 0);
        let mut next = into.iter_mut();
        for (at, &word) in words.iter().enumerate() {
            let mut word = word;
            while word != 0 {
                if let Some(place) = next.next() {
                    *place = (at * WORD) as u32 + word.trailing_zeros();
                }
                word &= word - 1;
            }
        }
    }

    #[inline(always)]
    fn moments(points: &[[f64; 4]], places: &[u32], centre: &[f64; 4]) -> [[f64; 4]; 3] {
        // Two sums side by side, because each addition waits for the previous one.
        let (mut even, mut odd) = ([0.0; 16], [0.0; 16]);
        let (pairs, last) = places.as_chunks::<2>();
        for [a, b] in pairs {
            add_products(&mut even, &points[*a as usize], centre);
            add_products(&mut odd, &points[*b as usize], centre);
        }
        for a in last {
            add_products(&mut even, &points[*a as usize], centre);
        }
        let at = |row: usize, column: usize| even[4 * row + column] + odd[4 * row + column];
        std::array::from_fn(|row| std::array::from_fn(|column| at(row, column)))
    }
}

/// Adds d dᵀ. The last row is not needed but makes the products whole vectors.
#[inline(always)]
fn add_products(sums: &mut [f64; 16], point: &[f64; 4], centre: &[f64; 4]) {
    let d: [f64; 4] = std::array::from_fn(|i| point[i] - centre[i]);
    for (at, sum) in sums.iter_mut().enumerate() {
        *sum += d[at / 4] * d[at % 4];
    }
}

/// Loops for machines with AVX-512 (F, BW, DQ, VL), to be called from functions compiled for it.
#[cfg(target_arch = "x86_64")]
pub(super) struct Avx512;

// SAFETY, for every block: `Avx512` is used only in functions that run on machines with these
// instructions. Loads and stores are unaligned and stay inside the given arrays or their reserved
// capacity; the length is extended only over what was written.
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
impl Lanes for Avx512 {
    #[inline(always)]
    fn count(squared: &[f32], threshold: f32) -> usize {
        use std::arch::x86_64::*;
        let (chunks, rest) = squared.as_chunks::<16>();
        let counted = unsafe {
            let threshold = _mm512_set1_ps(threshold);
            let one = _mm512_set1_epi32(1);
            let mut counts = _mm512_setzero_si512();
            for chunk in chunks {
                let below = _mm512_cmple_ps_mask(_mm512_loadu_ps(chunk.as_ptr()), threshold);
                counts = _mm512_mask_add_epi32(counts, below, counts, one);
            }
            _mm512_reduce_add_epi32(counts) as usize
        };
        counted + Plain::count(rest, threshold)
    }

    #[inline(always)]
    fn up_to(squared: &[f32; WORD], threshold: f32) -> u64 {
        use std::arch::x86_64::*;
        let mut bits = 0;
        for (at, chunk) in squared.as_chunks::<16>().0.iter().enumerate() {
            let below = unsafe {
                _mm512_cmple_ps_mask(_mm512_loadu_ps(chunk.as_ptr()), _mm512_set1_ps(threshold))
            };
            bits |= u64::from(below) << (16 * at);
        }
        bits
    }

    #[inline(always)]
    fn places(words: &[u64], into: &mut Vec<u32>) {
        use std::arch::x86_64::*;
        let mut filled = 0;
        into.clear();
        // Whole vectors are written, so one more is reserved.
        into.reserve(words.len() * WORD + 16);
        unsafe {
            let out = into.as_mut_ptr();
            let sixteen = _mm512_set1_epi32(16);
            let mut places =
                _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
            for &word in words {
                for part in 0..4 {
                    let bits = (word >> (16 * part)) as u16;
                    let listed = _mm512_maskz_compress_epi32(bits, places);
                    _mm512_storeu_si512(out.add(filled).cast(), listed);
                    filled += bits.count_ones() as usize;
                    places = _mm512_add_epi32(places, sixteen);
                }
            }
            into.set_len(filled);
        }
    }

    #[inline(always)]
    fn moments(points: &[[f64; 4]], places: &[u32], centre: &[f64; 4]) -> [[f64; 4]; 3] {
        use std::arch::x86_64::*;
        let mut sums = [[0.0; 8]; 2];
        let mut third = [[0.0; 4]; 2];
        unsafe {
            let rows = _mm512_setr_epi64(0, 0, 0, 0, 1, 1, 1, 1);
            let centre = _mm256_loadu_pd(centre.as_ptr());
            // First and second row, and third row, of even and odd points.
            let mut upper = [_mm512_setzero_pd(); 2];
            let mut lower = [_mm256_setzero_pd(); 2];
            // No closures: they would not be compiled for these instructions.
            for pair in 0..places.len().div_ceil(2) {
                for side in 0..2 {
                    let Some(&place) = places.get(2 * pair + side) else {
                        break;
                    };
                    let point = &points[place as usize];
                    let d = _mm256_sub_pd(_mm256_loadu_pd(point.as_ptr()), centre);
                    let twice = _mm512_broadcast_f64x4(d);
                    let factors = _mm512_permutexvar_pd(rows, twice);
                    upper[side] = _mm512_add_pd(upper[side], _mm512_mul_pd(factors, twice));
                    let z = _mm256_permute4x64_pd::<0b10_10_10_10>(d);
                    lower[side] = _mm256_add_pd(lower[side], _mm256_mul_pd(z, d));
                }
            }
            for side in 0..2 {
                _mm512_storeu_pd(sums[side].as_mut_ptr(), upper[side]);
                _mm256_storeu_pd(third[side].as_mut_ptr(), lower[side]);
            }
        }
        let [even, odd] = &sums;
        [
            std::array::from_fn(|i| even[i] + odd[i]),
            std::array::from_fn(|i| even[4 + i] + odd[4 + i]),
            std::array::from_fn(|i| third[0][i] + third[1][i]),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, PartialEq)]
    struct Neighbours {
        words: Vec<u64>,
        count: usize,
        places: Vec<u32>,
        sums: [[f64; 4]; 3],
    }

    const THRESHOLD: f32 = 0.5;
    const CENTRE: [f64; 4] = [0.1, 0.2, 0.3, 0.0];

    #[inline(always)]
    fn neighbours<L: Lanes>(squared: &[f32], points: &[[f64; 4]]) -> Neighbours {
        let words = squared.as_chunks::<WORD>().0.iter();
        let words: Vec<u64> = words.map(|word| L::up_to(word, THRESHOLD)).collect();
        let mut places = Vec::new();
        L::places(&words, &mut places);
        Neighbours {
            count: L::count(squared, THRESHOLD),
            sums: L::moments(points, &places, &CENTRE),
            words,
            places,
        }
    }

    /// Squared distances, some of them NaN or exactly at the threshold, and points.
    fn cases() -> impl Iterator<Item = (Vec<f32>, Vec<[f64; 4]>)> {
        (0..20u32).map(|seed| {
            let n = WORD * (1 + seed as usize % 5);
            let noise = |i: usize| {
                f64::from((i as u32 + seed).wrapping_mul(2_654_435_761) >> 8) / f64::from(1 << 24)
            };
            let mut squared: Vec<f32> = (0..n).map(|i| noise(i) as f32).collect();
            squared[n / 2] = THRESHOLD;
            squared[n / 3] = f32::NAN;
            squared[n - 1] = f32::INFINITY;
            let point = |i| [noise(3 * i), noise(3 * i + 1), noise(3 * i + 2), 1.0];
            (squared, (0..n).map(point).collect())
        })
    }

    #[test]
    fn plain_loops_match_their_definitions() {
        for (squared, points) in cases() {
            let all = neighbours::<Plain>(&squared, &points);
            let below = (0..).zip(&squared).filter(|(_, s)| **s <= THRESHOLD);
            let places: Vec<u32> = below.map(|(place, _)| place).collect();
            assert!(places.contains(&(squared.len() as u32 / 2)));
            let mut words = vec![0; squared.len() / WORD];
            let mut sums = [[0.0; 4]; 3];
            for &place in &places {
                words[place as usize / WORD] |= 1u64 << (place as usize % WORD);
                let d: [f64; 4] = std::array::from_fn(|i| points[place as usize][i] - CENTRE[i]);
                for (row, sums) in sums.iter_mut().enumerate() {
                    for (column, sum) in sums.iter_mut().enumerate() {
                        *sum += d[row] * d[column];
                    }
                }
            }
            assert_eq!((all.count, &all.places), (places.len(), &places));
            assert_eq!(all.words, words);
            for (moment, sum) in all.sums.iter().flatten().zip(sums.iter().flatten()) {
                assert!((moment - sum).abs() < 1e-12, "{moment} {sum}");
            }
        }
    }

    #[cfg(target_arch = "x86_64")]
    #[test]
    fn wide_and_plain_loops_give_identical_results() {
        use std::io::Write;

        use crate::cloud::vectors::Width;

        #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,popcnt")]
        fn wide(squared: &[f32], points: &[[f64; 4]]) -> Neighbours {
            neighbours::<Avx512>(squared, points)
        }

        let has_avx512 = is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl");
        if !has_avx512 {
            // Not by a macro, whose lines are kept for tests that fail.
            let _ = writeln!(std::io::stderr(), "skipped: no AVX-512");
            return;
        }
        assert_eq!(Width::here(), Width::Avx512);
        for (squared, points) in cases() {
            // SAFETY: the machine has AVX-512.
            #[allow(unsafe_code)]
            let wide = unsafe { wide(&squared, &points) };
            assert_eq!(wide, neighbours::<Plain>(&squared, &points));
        }
    }
}
