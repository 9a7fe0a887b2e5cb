//! Streams that are cut off or altered, and streams that do not come from a scanner.

use super::common::{frame, read, settings, stream};
use boresight::format::gocator_stream::data_set;
use boresight::format::gocator_stream::{
    Encoder, LARGEST_MESSAGE, Piece, Profile, ProfileReader, Splitter,
};

/// A profile without its position in the stream.
fn content(profile: &Profile) -> Profile {
    Profile {
        bytes: 0..0,
        ..profile.clone()
    }
}

/// Asserts that all profiles except these were read, unaltered and in order.
fn assert_others_read(all: &[Profile], read_profiles: &[Profile], except: &[usize], what: &str) {
    let mut rest = read_profiles.iter().map(content);
    for (index, profile) in all.iter().enumerate() {
        let is_read = except.contains(&index) || rest.any(|it| it == content(profile));
        assert!(is_read, "{what}: profile {index} of {}", all.len());
    }
}

/// A simple generator of pseudo-random numbers.
fn noise(seed: u64) -> impl FnMut() -> u64 {
    let mut state = seed;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 32
    }
}

#[test]
fn profiles_do_not_depend_on_the_pieces_in_which_bytes_arrive() {
    let (bytes, _) = stream(4, &settings(9, false), true);
    let (all, counts) = read(&bytes, bytes.len());
    assert_eq!(all.len(), 4);
    for length in 1..bytes.len() {
        assert_eq!(read(&bytes, length), (all.clone(), counts), "{length}");
        let mut reader = ProfileReader::new();
        let mut profiles = Vec::new();
        for piece in [&bytes[..length], &bytes[length..]] {
            reader.read(piece, |profile| profiles.push(profile));
        }
        reader.finish(|profile| profiles.push(profile));
        assert_eq!(profiles, all, "cut at {length}");
    }
}

#[test]
fn complete_profiles_of_a_truncated_stream_are_read() {
    let (bytes, ends) = stream(4, &settings(9, false), true);
    let (all, _) = read(&bytes, 4096);
    for length in 0..=bytes.len() {
        let (read_profiles, counts) = read(&bytes[..length], 4096);
        let whole = ends.iter().filter(|&&end| end <= length).count();
        assert_eq!(read_profiles[..whole], all[..whole], "{length}");
        // A data set that ends early may leave a profile without its intensity.
        assert!(read_profiles.len() <= whole + 1);
        if let Some(cut) = read_profiles.get(whole) {
            assert_eq!((&cut.x_m, &cut.intensity), (&all[whole].x_m, &None));
        }
        assert_eq!(counts.bytes, length as u64);
    }
}

#[test]
fn a_changed_byte_affects_only_its_own_profile() {
    for is_uniform in [false, true] {
        let (bytes, ends) = stream(5, &settings(9, is_uniform), true);
        let (all, _) = read(&bytes, 4096);
        for at in 0..bytes.len() {
            let hit = ends.iter().filter(|&&end| end <= at).count();
            // Every bit, and the values at the ends.
            let flipped = (0..8).map(|bit| bytes[at] ^ (1 << bit));
            for value in flipped.chain([0, 0x7f, 0x80, 0xff]) {
                let mut damaged = bytes.clone();
                if damaged[at] == value {
                    continue;
                }
                damaged[at] = value;
                let (read_profiles, _) = read(&damaged, 4096);
                assert_others_read(&all, &read_profiles, &[hit], &format!("{at} = {value}"));
                assert!(read_profiles.len() <= all.len(), "{at} = {value}");
            }
        }
    }
}

#[test]
fn a_missing_or_repeated_byte_affects_only_one_profile() {
    let (bytes, ends) = stream(5, &settings(9, false), true);
    let (all, _) = read(&bytes, 4096);
    for at in 0..bytes.len() {
        let hit = ends.iter().filter(|&&end| end <= at).count();
        let mut shorter = bytes.clone();
        shorter.remove(at);
        let (read_profiles, _) = read(&shorter, 4096);
        assert_others_read(&all, &read_profiles, &[hit], &format!("without {at}"));
        let mut longer = bytes.clone();
        longer.insert(at, bytes[at]);
        let (read_profiles, _) = read(&longer, 4096);
        assert_others_read(&all, &read_profiles, &[hit], &format!("{at} repeated"));
    }
}

#[test]
fn garbage_between_data_sets_affects_no_profile() {
    let settings = settings(50, false);
    let (bytes, ends) = stream(20, &settings, true);
    let (all, _) = read(&bytes, 4096);
    for seed in 1..200 {
        let mut number = noise(seed);
        let (mut mixed, mut start, mut added) = (Vec::new(), 0, 0);
        for &end in &ends {
            mixed.extend(&bytes[start..end]);
            start = end;
            if seed % 5 == 0 {
                // Zeros claim messages without bytes.
                mixed.extend([0; 33]);
                added += 33;
            } else {
                let length = number() % 300;
                mixed.extend((0..length).map(|_| number() as u8));
                added += length;
            }
        }
        let (read_profiles, counts) = read(&mixed, 777);
        assert_others_read(&all, &read_profiles, &[], &format!("seed {seed}"));
        assert_eq!(read_profiles.len(), all.len());
        assert_eq!(counts.skipped_bytes, added, "seed {seed}");
    }
}

#[test]
fn a_cut_link_affects_only_the_profile_that_was_cut() {
    let (bytes, ends) = stream(6, &settings(40, false), true);
    let (all, _) = read(&bytes, 4096);
    // The link ends at any byte of the third data set and later continues with the fourth.
    for cut in ends[1]..ends[2] {
        let joined = [&bytes[..cut], &bytes[ends[2]..]].concat();
        let (read_profiles, counts) = read(&joined, 100);
        assert_others_read(&all, &read_profiles, &[2], &format!("cut at {cut}"));
        let doubtful = read_profiles.iter().filter(|it| it.frame == 2);
        for profile in doubtful {
            assert_eq!((&profile.x_m, &profile.z_m), (&all[2].x_m, &all[2].z_m));
            assert_eq!(profile.intensity, None, "it was cut");
        }
        // If it is cut between two messages, no byte is left over.
        assert!(counts.gaps <= 1);
    }
}

#[test]
fn a_profile_never_gets_the_stamp_of_another() {
    let (bytes, ends) = stream(4, &settings(9, false), false);
    let (all, _) = read(&bytes, 4096);
    // The profile of the first frame and the stamp of the second are damaged.
    let mut damaged = bytes.clone();
    damaged[70..90].fill(0xee);
    damaged[ends[0]..ends[0] + 20].fill(0xee);
    let (read_profiles, counts) = read(&damaged, 4096);
    assert_eq!(
        read_profiles.iter().map(|it| it.frame).collect::<Vec<_>>(),
        [2, 3]
    );
    assert_others_read(&all, &read_profiles, &[0, 1], "two sets");
    assert_eq!((counts.empty, counts.unstamped), (1, 1));
}

#[test]
fn noise_gives_no_profile_and_does_not_accumulate() {
    let mut number = noise(3);
    let mut splitter = Splitter::new(1 << 16);
    for _ in 0..200 {
        let piece: Vec<u8> = (0..10_000).map(|_| number() as u8).collect();
        splitter.push(&piece);
        while let Some(piece) = splitter.next() {
            assert!(matches!(piece, Piece::Gap(_)), "{piece:?}");
        }
        assert!(splitter.kept() <= (1 << 16) + 10_000);
    }
}

#[test]
fn a_message_that_claims_too_large_a_size_is_skipped_at_once() {
    let settings = settings(9, false);
    let mut encoder = Encoder::default();
    let mut bytes = (LARGEST_MESSAGE as u32 + 1).to_le_bytes().to_vec();
    bytes.extend([10, 0]);
    data_set(&mut encoder, &settings, 5, &[frame(5, 9, false)]);
    bytes.extend(encoder.take());
    let (profiles, counts) = read(&bytes, 10);
    assert_eq!((profiles.len(), counts.skipped_bytes), (1, 6));
}

#[test]
fn random_damage_never_panics() {
    let (bytes, _) = stream(8, &settings(30, false), true);
    for seed in 1..3000 {
        let mut number = noise(seed);
        let mut damaged = bytes.clone();
        for _ in 0..number() % 20 {
            let at = number() as usize % damaged.len();
            match number() % 4 {
                0 => damaged[at] = number() as u8,
                1 => drop(
                    damaged.drain(at..(at + number() as usize % 50).min(bytes.len() / 2).max(at)),
                ),
                2 => damaged.insert(at, number() as u8),
                _ => {
                    let end = (at + number() as usize % 200).min(damaged.len());
                    let again = damaged[at..end].to_vec();
                    damaged.splice(at..at, again);
                }
            }
        }
        let (_, counts) = read(&damaged, 1 + number() as usize % 500);
        assert_eq!(counts.bytes, damaged.len() as u64);
    }
}
