//! Measures how fast one core reads a recording of the Gocator, compared with reading only its bytes.
//!
//! `cargo run --release --features examples --example read_speed -- [FILE]`: without a file, it makes one of 500 MB.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::Instant;

use boresight::Result;
use boresight::error::Error;
use boresight::format::{BonnWriter, open_profiles};

/// Number of runs; the median is reported.
const RUNS: usize = 5;
/// Profiles of 1920 points in the generated file: 500 MB.
const PROFILES: u32 = 51_000;
const WIDTH: u32 = 1920;

fn write(path: &Path) -> Result<()> {
    let mut writer = BonnWriter::create(path)?;
    for profile in 0..PROFILES {
        let wave = f64::from(profile % 700) * 1e-4;
        let ray = |i: u32| {
            let x_m = (f64::from(i) / f64::from(WIDTH) - 0.5) * 1.2;
            (!i.is_multiple_of(97)).then_some((x_m, wave * x_m - 0.9, (i % 251) as u8))
        };
        let points: Vec<_> = (0..WIDTH).map(ray).collect();
        writer.write_profile(f64::from(profile) * 0.005, &points)?;
    }
    writer.finish()
}

/// The median time of some runs, seconds.
fn timed(mut work: impl FnMut() -> Result<()>) -> Result<f64> {
    let mut seconds = Vec::new();
    for _ in 0..RUNS {
        let begun = Instant::now();
        work()?;
        seconds.push(begun.elapsed().as_secs_f64());
    }
    seconds.sort_by(f64::total_cmp);
    Ok(seconds[RUNS / 2])
}

fn main() -> Result<()> {
    let folder = tempfile::tempdir().map_err(|e| Error::io(std::env::temp_dir(), e))?;
    let path = match std::env::args().nth(1) {
        Some(file) => PathBuf::from(file),
        None => {
            let path = folder.path().join("left.bin");
            write(&path)?;
            path
        }
    };
    let failed = |e| Error::io(&path, e);
    let megabytes = std::fs::metadata(&path).map_err(failed)?.len() as f64 / 1e6;
    let mut buffer = vec![0; 1 << 18];
    let bytes_s = timed(|| {
        let mut file = std::fs::File::open(&path).map_err(failed)?;
        while file.read(&mut buffer).map_err(failed)? > 0 {}
        Ok(())
    })?;
    let (mut chunk, mut points) = (Vec::new(), 0);
    let points_s = timed(|| {
        let mut reader = open_profiles(&path)?;
        points = 0;
        while reader.next_chunk(&mut chunk)? {
            points += chunk.len();
        }
        Ok(())
    })?;
    println!(
        "{megabytes:.0} MB, {points} points: {:.0} MB/s, {:.0} million points a second; its bytes alone {:.0} MB/s",
        megabytes / points_s,
        points as f64 / points_s / 1e6,
        megabytes / bytes_s
    );
    Ok(())
}
