//! Damages a stream, and counts the frames that are left intact.

/// Furthest that a frame can lie behind the last intact one, bytes: a hundred destroyed in a row do not happen.
const FURTHEST: usize = 4000;

/// Damages about one frame in a hundred of a stream of intact frames, and inserts bytes after about as many.
pub fn damage(stream: &[u8]) -> Vec<u8> {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut random = |below: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as usize % below
    };
    let mut damaged = Vec::with_capacity(stream.len() + stream.len() / 50);
    let mut rest = stream;
    while let Some((frame, behind)) = first_frame(rest) {
        rest = behind;
        let mut piece = frame.to_vec();
        let size = piece.len();
        // The end stays intact: a library that waits for the rest of a frame would not read the frames behind it.
        match random(if rest.len() < 10_000 { 1 } else { 600 }) {
            10 => piece[random(size)] ^= 1 + random(255) as u8,
            11 => piece.truncate(random(size)),
            12 => drop(piece.drain(..1 + random(size - 1))),
            13 => piece.insert(1 + random(size - 1), random(256) as u8),
            14 => drop(piece.remove(random(size))),
            15 => piece.clear(),
            20 => piece.extend((0..random(60)).map(|_| random(256) as u8)),
            21 => piece.extend((0..random(60)).map(|_| [0xff, 0x5a, 0x33, 0][random(4)])),
            22 => piece.extend(b"$GPZDA,120000.00,28,02,2024,00,00*6A\r\n"),
            // A header that claims the longest possible frame hides the frames behind it.
            23 => piece.extend([0xff, 0x5a, 0x2c, 0, 0xf6, 0x0f]),
            // The beginning of the same frame again.
            24 => piece.extend(&frame[..random(size)]),
            _ => {}
        }
        damaged.extend(piece);
    }
    damaged
}

/// Counts the frames of a stream that another stream contains, byte for byte and in order, and their bytes. Even a
/// damaged frame can be intact: the garbage before it may end with its missing byte.
pub fn intact_frames(stream: &[u8], damaged: &[u8]) -> (u64, u64) {
    let (mut rest, mut at) = (stream, 0);
    let (mut frames, mut bytes) = (0, 0);
    while let Some((frame, behind)) = first_frame(rest) {
        rest = behind;
        let near = &damaged[at..damaged.len().min(at + FURTHEST)];
        let mut places = near.windows(frame.len());
        if let Some(place) = places.position(|bytes| bytes == frame) {
            at += place + frame.len();
            frames += 1;
            bytes += frame.len() as u64;
        }
    }
    (frames, bytes)
}

/// The first frame of a stream of intact frames, and the rest.
fn first_frame(stream: &[u8]) -> Option<(&[u8], &[u8])> {
    let [low, high] = *stream.get(4..6)?.first_chunk()?;
    stream.split_at_checked(usize::from(u16::from_le_bytes([low, high])) + 9)
}
