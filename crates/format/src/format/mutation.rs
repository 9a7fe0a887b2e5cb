//! Damaged copies of valid files, for the tests of readers.

use std::path::Path;

/// Inputs that often break parsers.
const PIECES: [&[u8]; 14] = [
    b"",
    b",",
    b"\n",
    b"\r",
    b"$",
    b"*",
    b"#",
    b"nan",
    b"-inf",
    b"1e999",
    b"-99999999999999999999999",
    b"\xff\xfe",
    "\u{e9}".as_bytes(),
    b"\0",
];

/// Calls `read` for each of `count` damaged copies of `valid`, written to `path`; the same copies
/// every time. `read` must return but may fail.
pub(crate) fn for_each_damaged(path: &Path, valid: &[u8], count: u32, mut read: impl FnMut()) {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut random = move |below: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 16) as usize % below.max(1)
    };
    for _ in 0..count {
        let mut bytes = valid.to_vec();
        for _ in 0..1 + random(4) {
            let at = random(bytes.len());
            let end = (at + 1 + random(12)).min(bytes.len());
            match random(6) {
                0 => bytes.truncate(at),
                1 => drop(bytes.drain(at.min(end)..end)),
                2 => {
                    let copy = bytes[at.min(end)..end].to_vec();
                    let to = random(bytes.len());
                    bytes.splice(to..to, copy);
                }
                3 => {
                    if let Some(byte) = bytes.get_mut(at) {
                        *byte = random(256) as u8;
                    }
                }
                4 => {
                    if let Some(byte) = bytes.get_mut(at) {
                        *byte ^= 1 << random(8);
                    }
                }
                _ => {
                    let piece = PIECES[random(PIECES.len())];
                    bytes.splice(at.min(end)..end, piece.iter().copied());
                }
            }
        }
        // Some file systems write a truncated file to the disk at once, but not a new one.
        let _ = std::fs::remove_file(path);
        std::fs::write(path, &bytes).unwrap();
        read();
    }
}
