//! Pseudo-random numbers that are the same in every run.

/// 64 pseudo-random bits drawn for `number`; those of consecutive numbers are independent (SplitMix64,
/// Steele, Lea and Flood 2014).
pub fn drawn(number: u64) -> u64 {
    let mut x = number.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// A pseudo-random sign drawn for `number`, +1 or −1.
pub fn drawn_sign(number: u64) -> f64 {
    if drawn(number) & 1 == 0 { 1.0 } else { -1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_numbers_are_those_of_the_generator_seeded_with_zero() {
        // From the reference implementation, https://prng.di.unimi.it/splitmix64.c.
        assert_eq!(drawn(0), 0xe220_a839_7b1d_cdaf);
        assert_eq!(drawn(1), 0x6e78_9e6a_a1b9_65f4);
        assert_eq!(drawn(2), 0x06c4_5d18_8009_454f);
    }

    #[test]
    fn signs_of_neighbours_cancel() {
        let count = 10_000;
        let signs: Vec<f64> = (0..count).map(drawn_sign).collect();
        let most = 4.0 * (count as f64).sqrt();
        assert!(signs.iter().sum::<f64>().abs() < most);
        let pairs = signs.windows(2).map(|pair| pair[0] * pair[1]);
        assert!(pairs.sum::<f64>().abs() < most);
    }
}
