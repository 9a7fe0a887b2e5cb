//! Speed of reading.

use std::hint::black_box;
use std::time::Instant;

use super::common::{settings, stream};
use boresight::format::gocator_stream::{ProfileReader, Splitter};

#[test]
#[ignore = "just acceptance"]
fn the_stream_is_split_at_more_than_500_megabytes_per_second() {
    let (bytes, _) = stream(20_000, &settings(1280, false), true);
    let megabytes = bytes.len() as f64 / 1e6;
    println!("{megabytes:.0} MB, 20000 profiles of 1280 points with intensity");
    for piece in [1460, 1 << 16] {
        for _ in 0..3 {
            let start = Instant::now();
            let mut splitter = Splitter::default();
            let mut messages = 0;
            for bytes in bytes.chunks(piece) {
                splitter.push(bytes);
                while let Some(piece) = splitter.next() {
                    black_box(piece);
                    messages += 1;
                }
            }
            let split = megabytes / start.elapsed().as_secs_f64();
            let start = Instant::now();
            let mut reader = ProfileReader::new();
            let mut points = 0;
            for bytes in bytes.chunks(piece) {
                reader.read(bytes, |profile| points += black_box(profile).x_m.len());
            }
            let read = megabytes / start.elapsed().as_secs_f64();
            println!(
                "pieces of {piece}: split {split:.0} MB/s ({messages} messages), profiles {read:.0} MB/s \
                 ({points} points)"
            );
            assert!(split > 500.0);
        }
    }
}
