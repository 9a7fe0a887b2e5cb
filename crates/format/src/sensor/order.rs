//! Records in time order.

/// Indices of a longest strictly increasing subsequence (Fredman 1975), n log n. One wild time costs one record, however
/// far off it is; of equal times, the first is kept.
pub fn longest_increasing(values: &[f64]) -> Vec<usize> {
    if values.windows(2).all(|pair| pair[1] > pair[0]) {
        return (0..values.len()).collect();
    }
    // ends[l]: the index with the smallest value that ends an increasing run of length l + 1.
    let mut ends: Vec<usize> = Vec::new();
    let mut before = vec![usize::MAX; values.len()];
    for (i, value) in values.iter().enumerate() {
        let length = ends.partition_point(|&end| values[end] < *value);
        if length > 0 {
            before[i] = ends[length - 1];
        }
        if length == ends.len() {
            ends.push(i);
        } else if values[ends[length]] > *value {
            ends[length] = i;
        }
    }
    let mut indices = Vec::with_capacity(ends.len());
    let mut at = ends.last().copied().unwrap_or(usize::MAX);
    while at != usize::MAX {
        indices.push(at);
        at = before[at];
    }
    indices.reverse();
    indices
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_increasing_set_is_found() {
        // Against all subsets of short sequences.
        let mut state = 1u32;
        for _ in 0..200 {
            let values: Vec<f64> = (0..9)
                .map(|_| {
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    f64::from((state >> 24) % 8)
                })
                .collect();
            let increasing = |set: u32| {
                let chosen: Vec<f64> = (0..9)
                    .filter(|i| set >> i & 1 == 1)
                    .map(|i| values[i as usize])
                    .collect();
                chosen.windows(2).all(|w| w[1] > w[0])
            };
            let best = (0u32..512)
                .filter(|set| increasing(*set))
                .map(u32::count_ones)
                .max();
            let indices = longest_increasing(&values);
            assert!(
                indices
                    .windows(2)
                    .all(|w| values[w[1]] > values[w[0]] && w[1] > w[0])
            );
            assert_eq!(Some(indices.len() as u32), best, "{values:?}");
        }
        assert_eq!(longest_increasing(&[0.0, 1.0, 1.0, 2.0, 2.0]), [0, 1, 3]);
        // One wild stamp costs one record.
        assert_eq!(
            longest_increasing(&[0.0, 1.0, 99.0, 2.0, 3.0]),
            [0, 1, 3, 4]
        );
    }
}
