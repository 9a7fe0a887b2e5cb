//! Damaged and truncated bags: readers return an error or the undamaged part, never panic and are never slow.

use std::path::{Path, PathBuf};
use std::time::Instant;

use super::tests::{SAMPLES, plain_samples, points_of, sample};
use super::*;

/// A pseudo-random number generator.
struct Dice(u64);

impl Dice {
    fn roll(&mut self, below: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % below.max(1)
    }
}

/// Changes a few bytes, overwrites a length, truncates the file, or removes bytes from the middle.
fn damage(bytes: &mut Vec<u8>, dice: &mut Dice) {
    let at = dice.roll(bytes.len());
    match dice.roll(6) {
        0 => bytes[at] ^= 1 << dice.roll(8),
        1 => bytes[at] = dice.roll(256) as u8,
        2 => {
            let numbers = [
                0,
                1,
                0x7f,
                0xff,
                0x7fff_ffff,
                0xffff_ffff,
                0x1_0000_0000,
                u64::MAX,
            ];
            let number = numbers[dice.roll(numbers.len())].to_le_bytes();
            let size = [4, 8][dice.roll(2)].min(bytes.len() - at);
            bytes[at..at + size].copy_from_slice(&number[..size]);
        }
        3 => bytes.truncate(at),
        4 => {
            let end = (at + 1 + dice.roll(40)).min(bytes.len());
            bytes.drain(at..end);
        }
        _ => {
            for _ in 0..=dice.roll(8) {
                let at = dice.roll(bytes.len());
                bytes[at] = dice.roll(256) as u8;
            }
        }
    }
}

/// Calls every reader; returns whether any succeeded.
fn read_everything(path: &Path) -> bool {
    let input = &Input::from(path);
    let mut success = topics(input).is_ok();
    success |= read_imu(input, None).is_ok();
    success |= read_fixes(input, None).is_ok();
    for topic in ["/odom", "/pose_cov", "/transform", "/pose"] {
        success |= read_poses(input, Some(topic)).is_ok();
    }
    for topic in ["/scan", "/ouster", "/velodyne", "/livox", "/hesai"] {
        success |= points_of(path, topic).is_ok();
    }
    success
}

/// Writes `count` damaged copies of every sample and passes each to `check`.
fn for_damaged(count: u64, mut check: impl FnMut(&Path)) {
    let dir = tempfile::tempdir().unwrap();
    let path: PathBuf = dir.path().join("damaged");
    for name in SAMPLES.iter().filter(|name| sample(name).is_file()) {
        let whole = std::fs::read(sample(name)).unwrap();
        for seed in 0..count {
            let mut dice = Dice(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15));
            let mut bytes = whole.clone();
            damage(&mut bytes, &mut dice);
            std::fs::write(&path, &bytes).unwrap();
            check(&path);
        }
    }
}

#[test]
fn damage_is_an_error_or_harmless() {
    let (mut cases, mut readable) = (0, 0);
    for_damaged(60, |path| {
        let start = Instant::now();
        readable += usize::from(read_everything(path));
        assert!(start.elapsed().as_secs_f64() < 1.0);
        cases += 1;
    });
    println!("{cases} damaged bags, {readable} of them readable in part");
}

#[test]
fn a_truncated_bag_is_read_up_to_its_last_complete_message() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("cut");
    // The pages of a database are in any order.
    for name in plain_samples() {
        let whole = std::fs::read(sample(name)).unwrap();
        let all = read_imu(&Input::from(&sample(name)), None).unwrap();
        let mut last = 0;
        for length in (1..whole.len()).step_by(97) {
            std::fs::write(&path, &whole[..length]).unwrap();
            let Ok(found) = read_imu(&Input::from(&path), None) else {
                assert_eq!(last, 0, "{name}, {length} bytes");
                continue;
            };
            assert_eq!(found, all[..found.len()], "{name}, {length} bytes");
            assert!(found.len() >= last, "{name}, {length} bytes");
            last = found.len();
        }
        assert_eq!(last, 12, "{name}");
    }
}

/// The offsets of the header and of the data of the last chunk of a ROS 1 bag.
fn last_chunk(bytes: &[u8]) -> (usize, usize) {
    let length = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    let (mut at, mut last) = (rosbag::MAGIC.len(), (0, 0));
    while at < bytes.len() {
        let head = at + 4;
        let data = head + length(at) + 4;
        if rosbag::chunk_head(&bytes[head..data - 4]).is_some() {
            last = (head, data);
        }
        at = data + length(data - 4);
    }
    last
}

#[test]
fn an_open_recording_of_ros_1_is_read() {
    // The recorder writes the position of the index and the sizes of the last chunk only at the end.
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.bag.active");
    for name in ["plain.bag", "bz2.bag", "lz4.bag"] {
        let mut bytes = std::fs::read(sample(name)).unwrap();
        let zero = |bytes: &mut [u8], field: &[u8], size: usize| {
            let at = bytes.windows(field.len()).position(|w| w == field).unwrap() + field.len();
            let value = bytes[at..at + size].to_vec();
            bytes[at..at + size].fill(0);
            value
        };
        let index = zero(&mut bytes, b"index_pos=", 8);
        bytes.truncate(u64::from_le_bytes(index.try_into().unwrap()) as usize);
        let (head, data) = last_chunk(&bytes);
        std::fs::write(&path, &bytes[..head - 4]).unwrap();
        let before = read_imu(&Input::from(&path), None).map_or(0, |samples| samples.len());
        assert!(before < 12, "{name}");

        zero(&mut bytes[head..data], b"size=", 4);
        bytes[data - 4..data].fill(0);
        std::fs::write(&path, &bytes).unwrap();
        assert_eq!(
            read_imu(&Input::from(&path), None).unwrap().len(),
            12,
            "{name}"
        );
    }
}

#[test]
fn damage_in_a_complete_bag_costs_its_chunk_and_is_reported_with_its_byte() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.mcap");
    let mut bytes = std::fs::read(sample("plain.mcap")).unwrap();
    // This byte is in the first chunk, whose checksum is then wrong.
    bytes[2000] ^= 1;
    std::fs::write(&path, &bytes).unwrap();
    let input = Input::from(&path);
    let all = read_imu(&Input::from(&sample("plain.mcap")), None).unwrap();
    let found = read_imu(&input, None);
    let text = match &found {
        Ok(found) => {
            assert!(found.len() < all.len() && found.iter().all(|sample| all.contains(sample)));
            input.remarks().join("\n")
        }
        Err(error) => error.to_string(),
    };
    assert!(
        text.contains("checksum") && text.contains(", byte "),
        "{text}"
    );
}

#[test]
fn a_copy_holds_all_that_can_be_read_and_is_whole() {
    let dir = tempfile::tempdir().unwrap();
    let [damaged, copy] = ["damaged", "copy"].map(|name| dir.path().join(name));
    for name in plain_samples() {
        let whole = sample(name);
        let all = read_imu(&Input::from(&whole), None).unwrap();
        let copied = copy_whole_records(&Input::from(&whole), &copy).unwrap();
        assert!(copied.messages >= 12, "{name}");
        let input = Input::from(&copy);
        assert_eq!(read_imu(&input, None).unwrap(), all, "{name}");
        assert_eq!(input.remarks(), [""; 0], "{name}");
        // Cut off in the middle: the copy ends before that, and does not say that it is cut off.
        let bytes = std::fs::read(&whole).unwrap();
        std::fs::write(&damaged, &bytes[..bytes.len() / 2]).unwrap();
        let copied = copy_whole_records(&Input::from(&damaged), &copy).unwrap();
        assert!(!copied.left_out.is_empty(), "{name}");
        let input = Input::from(&copy);
        let found = read_imu(&input, None).unwrap_or_default();
        assert_eq!(found, all[..found.len()], "{name}");
        if name.ends_with("mcap") {
            assert_eq!(input.remarks(), [""; 0], "{name}");
        }
    }
}

#[test]
fn a_wrong_length_of_a_chunk_costs_the_bytes_up_to_the_next_chunk() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.mcap");
    let mut bytes = std::fs::read(sample("no_summary.mcap")).unwrap();
    let mut at = mcap::MAGIC.len();
    let mut chunks = Vec::new();
    while let Some(prefix) = bytes.get(at..at + mcap::PREFIX) {
        let length = u64::from_le_bytes(prefix[1..].try_into().unwrap());
        chunks.extend((prefix[0] == 6).then_some(at));
        at += mcap::PREFIX + length as usize;
    }
    assert!(chunks.len() > 2, "{}", chunks.len());
    bytes[chunks[1] + 8] = 0x7f;
    std::fs::write(&path, bytes).unwrap();
    let input = Input::from(&path);
    let all = read_imu(&Input::from(&sample("no_summary.mcap")), None).unwrap();
    let found = read_imu(&input, None).unwrap();
    assert!(
        found.len() < all.len() && found.last() == all.last(),
        "{}",
        found.len()
    );
    let remarks = input.remarks().join("\n");
    assert!(remarks.contains("bytes left in the file"), "{remarks}");
}

#[test]
fn a_damaged_packed_chunk_is_reported_with_its_byte() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.bag");
    let whole = std::fs::read(sample("bz2.bag")).unwrap();
    let (_, data) = last_chunk(&whole);
    let length = u32::from_le_bytes(whole[data - 4..data].try_into().unwrap()) as usize;
    // The name of the format, the middle, and the checksum at the end.
    for at in [data, data + length / 2, data + length - 2] {
        let mut bytes = whole.clone();
        bytes[at] ^= 4;
        std::fs::write(&path, &bytes).unwrap();
        let text = read_imu(&Input::from(&path), None).unwrap_err().to_string();
        assert!(
            text.contains("found a chunk that cannot be unpacked (bzip2: ")
                && text.contains(", byte "),
            "byte {at}: {text}"
        );
    }
}

#[test]
fn small_chunks_that_unpack_to_many_bytes_are_refused() {
    const BLOCK: u32 = 1 << 17;
    let block = |kind: u32, size: u32| (kind << 1 | size << 3).to_le_bytes();
    let file = |blocks: u32, chunks: usize| {
        // A frame of zstd: the prefix of a record of unknown kind, then one byte repeated.
        let size = 9 + u64::from(blocks * BLOCK);
        let mut packed = vec![0x28, 0xb5, 0x2f, 0xfd, 0, 0x50];
        packed.extend(&block(0, 9)[..3]);
        packed.push(0x80);
        packed.extend((size - 9).to_le_bytes());
        for i in 0..blocks {
            let is_last = u32::from(i + 1 == blocks);
            packed.extend(&(block(1, BLOCK)[..3]));
            let header = packed.len() - 3;
            packed[header] |= is_last as u8;
            packed.push(7);
        }
        let mut chunk = [0; 2].map(u64::to_le_bytes).concat();
        chunk.extend(size.to_le_bytes());
        chunk.extend([0, 4].map(u32::to_le_bytes).concat());
        chunk.extend(b"zstd");
        chunk.extend((packed.len() as u64).to_le_bytes());
        chunk.extend(packed);
        let record = [&[6], (chunk.len() as u64).to_le_bytes().as_slice(), &chunk].concat();
        [mcap::MAGIC, &record.repeat(chunks), mcap::MAGIC].concat()
    };
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.mcap");
    std::fs::write(&path, file(40, 2)).unwrap();
    assert!(topics(&Input::from(&path)).unwrap().is_empty());
    std::fs::write(&path, file(120, 20)).unwrap();
    let text = topics(&Input::from(&path)).unwrap_err().to_string();
    assert!(text.contains("chunks that unpack to"), "{text}");
    std::fs::write(&path, file(800, 1)).unwrap();
    let text = topics(&Input::from(&path)).unwrap_err().to_string();
    assert!(text.contains("found a chunk of 104857609 bytes"), "{text}");
}

/// Bytes of a page of `small_pages.db3`.
const PAGE: usize = 512;

/// The starts of the pages of this kind.
fn pages(bytes: &[u8], kind: u8) -> Vec<usize> {
    let pages = (PAGE..bytes.len()).step_by(PAGE);
    pages.filter(|at| bytes[*at] == kind).collect()
}

#[test]
fn a_damaged_page_of_a_database_costs_its_rows() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.db3");
    let whole = std::fs::read(sample("small_pages.db3")).unwrap();
    let all = read_imu(&Input::from(&sample("small_pages.db3")), None).unwrap();
    let leaves = pages(&whole, 0x0d);
    let mut costs = 0;
    for page in &leaves {
        let mut bytes = whole.clone();
        bytes[*page] = 0x77;
        std::fs::write(&path, bytes).unwrap();
        let input = Input::from(&path);
        // Without its page, the table of topics has no topic.
        let Ok(found) = read_imu(&input, None) else {
            continue;
        };
        assert!(found.iter().all(|sample| all.contains(sample)));
        if found.len() < all.len() {
            costs += 1;
            let remarks = input.remarks().join("\n");
            assert!(remarks.contains(&format!("byte {page}:")), "{remarks}");
        }
    }
    assert!(costs >= 3 && leaves.len() > 20, "{costs} {}", leaves.len());
    // Pages above pages that contain themselves.
    let mut bytes = whole.clone();
    for page in pages(&whole, 0x05) {
        let number = (page / PAGE) as u32 + 1;
        bytes[page + 8..page + 12].copy_from_slice(&number.to_be_bytes());
    }
    std::fs::write(&path, bytes).unwrap();
    let input = Input::from(&path);
    assert!(!read_imu(&input, None).unwrap().is_empty());
    let remarks = input.remarks().join("\n");
    assert!(remarks.contains("damaged places"), "{remarks}");
}

#[test]
fn other_databases_and_unmerged_messages_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.db3");
    let whole = std::fs::read(sample("small_pages.db3")).unwrap();
    std::fs::write(&path, &whole).unwrap();
    std::fs::write(dir.path().join("a.db3-wal"), "messages").unwrap();
    let input = Input::from(&path);
    assert_eq!(read_imu(&input, None).unwrap().len(), 12);
    let remarks = input.remarks().join("\n");
    assert!(remarks.contains("a.db3-wal are left out"), "{remarks}");
    let error = copy_whole_records(&input, &dir.path().join("b")).unwrap_err();
    assert!(
        error.to_string().contains("sqlite3 FILE .recover"),
        "{error}"
    );
    let at = whole.windows(8).position(|bytes| bytes == b"messages");
    let mut other = whole;
    other[at.unwrap()..][..8].copy_from_slice(b"features");
    for at in 0..other.len() - 8 {
        if &other[at..at + 8] == b"messages" {
            other[at..at + 8].copy_from_slice(b"features");
        }
    }
    std::fs::write(&path, other).unwrap();
    let error = topics(&Input::from(&path)).unwrap_err().to_string();
    for expected in [
        "an SQLite database with the tables",
        "features",
        "a recording of rosbag2",
    ] {
        assert!(error.contains(expected), "{error}");
    }
    std::fs::write(&path, sqlite::MAGIC).unwrap();
    let error = topics(&Input::from(&path)).unwrap_err().to_string();
    assert!(error.contains("an impossible size of pages"), "{error}");
}
