//! Streams that are cut, altered, or not of a scanner at all.

use super::common::{frame, read, settings, stream};
use boresight::format::gocator_stream::data_set;
use boresight::format::gocator_stream::{
    Encoder, LARGEST_MESSAGE, Piece, Profile, ProfileReader, Splitter,
};

/// What makes a profile, without where it was.
fn content(profile: &Profile) -> Profile {
    Profile {
        bytes: 0..0,
        ..profile.clone()
    }
}

/// All of the profiles except these are among those that were read, unaltered and in order.
fn assert_others_kept(all: &[Profile], kept: &[Profile], except: &[usize], what: &str) {
    let mut rest = kept.iter().map(content);
    for (index, profile) in all.iter().enumerate() {
        let is_there = except.contains(&index) || rest.any(|it| it == content(profile));
        assert!(is_there, "{what}: profile {index} of {}", all.len());
    }
}

/// A generator of numbers that need not be good.
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
fn pieces_make_no_difference() {
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
fn truncation_keeps_what_was_whole() {
    let (bytes, ends) = stream(4, &settings(9, false), true);
    let (all, _) = read(&bytes, 4096);
    for length in 0..=bytes.len() {
        let (kept, counts) = read(&bytes[..length], 4096);
        let whole = ends.iter().filter(|&&end| end <= length).count();
        assert_eq!(kept[..whole], all[..whole], "{length}");
        // Of a set that ends early, a profile may be left without its intensity.
        assert!(kept.len() <= whole + 1);
        if let Some(cut) = kept.get(whole) {
            assert_eq!((&cut.x_m, &cut.intensity), (&all[whole].x_m, &None));
        }
        assert_eq!(counts.bytes, length as u64);
    }
}

#[test]
fn no_flipped_byte_costs_another_profile() {
    for is_uniform in [false, true] {
        let (bytes, ends) = stream(5, &settings(9, is_uniform), true);
        let (all, _) = read(&bytes, 4096);
        for at in 0..bytes.len() {
            let hit = ends.iter().filter(|&&end| end <= at).count();
            for value in 0..=255u8 {
                let mut damaged = bytes.clone();
                if damaged[at] == value {
                    continue;
                }
                damaged[at] = value;
                let (kept, _) = read(&damaged, 4096);
                assert_others_kept(&all, &kept, &[hit], &format!("{at} = {value}"));
                assert!(kept.len() <= all.len(), "{at} = {value}");
            }
        }
    }
}

#[test]
fn missing_and_doubled_bytes_cost_one_profile() {
    let (bytes, ends) = stream(5, &settings(9, false), true);
    let (all, _) = read(&bytes, 4096);
    for at in 0..bytes.len() {
        let hit = ends.iter().filter(|&&end| end <= at).count();
        let mut shorter = bytes.clone();
        shorter.remove(at);
        let (kept, _) = read(&shorter, 4096);
        assert_others_kept(&all, &kept, &[hit], &format!("without {at}"));
        let mut longer = bytes.clone();
        longer.insert(at, bytes[at]);
        let (kept, _) = read(&longer, 4096);
        assert_others_kept(&all, &kept, &[hit], &format!("doubled {at}"));
    }
}

#[test]
fn garbage_between_data_sets_costs_nothing() {
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
                // Zeros say that a message has no bytes.
                mixed.extend([0; 33]);
                added += 33;
            } else {
                let length = number() % 300;
                mixed.extend((0..length).map(|_| number() as u8));
                added += length;
            }
        }
        let (kept, counts) = read(&mixed, 777);
        assert_others_kept(&all, &kept, &[], &format!("seed {seed}"));
        assert_eq!(kept.len(), all.len());
        assert_eq!(counts.skipped_bytes, added, "seed {seed}");
    }
}

#[test]
fn link_that_was_cut_costs_what_was_cut() {
    let (bytes, ends) = stream(6, &settings(40, false), true);
    let (all, _) = read(&bytes, 4096);
    // The link ends at any byte of the third data set and sends from the fourth on later.
    for cut in ends[1]..ends[2] {
        let joined = [&bytes[..cut], &bytes[ends[2]..]].concat();
        let (kept, counts) = read(&joined, 100);
        assert_others_kept(&all, &kept, &[2], &format!("cut at {cut}"));
        let doubtful = kept.iter().filter(|it| it.frame == 2);
        for profile in doubtful {
            assert_eq!((&profile.x_m, &profile.z_m), (&all[2].x_m, &all[2].z_m));
            assert_eq!(profile.intensity, None, "it was cut");
        }
        // Where it is cut between two messages, no byte is left over.
        assert!(counts.gaps <= 1);
    }
}

#[test]
fn profile_never_gets_the_stamp_of_another() {
    let (bytes, ends) = stream(4, &settings(9, false), false);
    let (all, _) = read(&bytes, 4096);
    // The profile of the first frame and the stamp of the second are damaged.
    let mut damaged = bytes.clone();
    damaged[70..90].fill(0xee);
    damaged[ends[0]..ends[0] + 20].fill(0xee);
    let (kept, counts) = read(&damaged, 4096);
    assert_eq!(kept.iter().map(|it| it.frame).collect::<Vec<_>>(), [2, 3]);
    assert_others_kept(&all, &kept, &[0, 1], "two sets");
    assert_eq!((counts.empty, counts.unstamped), (1, 1));
}

#[test]
fn noise_is_no_profile_and_keeps_no_memory() {
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
fn size_that_is_too_large_is_not_waited_for() {
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
