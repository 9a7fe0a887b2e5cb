//! Pseudo-random data, and files made of them.

use std::path::Path;

use boresight::format::*;
use boresight::geometry::Vec3;
use boresight::sensor::ScanPoint;

pub fn all_points(path: &Path) -> boresight::Result<Vec<ScanPoint>> {
    let mut reader = open_profiles(path)?;
    let (mut all, mut chunk) = (Vec::new(), Vec::new());
    while reader.next_chunk(&mut chunk)? {
        assert!(!chunk.is_empty() && chunk.len() <= 270_000);
        all.extend_from_slice(&chunk);
    }
    assert!(chunk.is_empty());
    assert_eq!(reader.bytes_read(), reader.bytes_total());
    Ok(all)
}

/// Pseudo-random numbers from -1 to 1, the same in every run.
pub fn noise(i: usize, k: usize) -> f64 {
    let mut x = (i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (k as u64 + 1) << 32;
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64 * 2.0 - 1.0
}

pub fn vector(i: usize, k: usize) -> Vec3 {
    Vec3::new(noise(i, k), noise(i, k + 1), noise(i, k + 2))
}

/// Writes a recording of `profiles` profiles with 160 rays, a third of them without a point; returns the points.
pub fn write_recording(path: &Path, profiles: usize) -> Vec<ScanPoint> {
    let mut writer = BonnWriter::create(path).unwrap();
    let mut written = Vec::new();
    for i in 0..profiles {
        let time_s = 1000.0 + i as f64 * 0.005;
        let rays: Vec<_> = (0..160)
            .map(|j| {
                let z = -1.2 + 0.5 * noise(i, j);
                let x = z * (j as f64 - 80.0) / 120.0;
                (j % 3 != 0).then_some((x, z, j as u8))
            })
            .collect();
        writer.write_profile(time_s, &rays).unwrap();
        written.extend(rays.into_iter().flatten().map(|(x, z, shade)| ScanPoint {
            time_s,
            position_m: Vec3::new(x, 0.0, z),
            intensity: f32::from(shade),
        }));
    }
    writer.finish().unwrap();
    written
}

pub fn write_cloud(path: &Path, n: usize) -> Vec<(Vec3, f64)> {
    let offset = Vec3::new(400_000.3, 5_600_000.0, 60.0);
    let mut writer = CloudWriter::create(path, offset).unwrap();
    let points: Vec<_> = (0..n)
        .map(|i| {
            (
                offset + vector(i, 0) * 20.0,
                1.7e9 + (i / 10) as f64 * 0.005,
            )
        })
        .collect();
    for (point, time_s) in &points {
        writer.write(point, *time_s, 130.4, 2).unwrap();
    }
    writer.finish().unwrap();
    points
}
