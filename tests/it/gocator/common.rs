//! Frames and streams for the tests.

use boresight::format::gocator_stream::{Counts, Encoder, Profile, ProfileReader, Scales};
use boresight::format::gocator_stream::{ScannerFrame, ScannerSettings, data_set};

pub fn settings(width: u32, is_uniform: bool) -> ScannerSettings {
    ScannerSettings {
        width,
        is_uniform,
        scales: Scales {
            x_scale_nm: 25_000,
            z_scale_nm: 7_500,
            x_offset_um: -100_000,
            z_offset_um: 350_000,
        },
        ..ScannerSettings::default()
    }
}

/// A frame at 100 Hz with every seventh point invalid.
pub fn frame(index: u64, width: u32, has_intensity: bool) -> ScannerFrame {
    let points_m = (0..width)
        .map(|point| {
            if (u64::from(point) + index).is_multiple_of(7) {
                return [f64::NAN; 2];
            }
            let x_m = -0.1 + 25e-6 * f64::from(point);
            [x_m, 0.35 + 0.02 * (x_m * 90.0 + index as f64).sin()]
        })
        .collect();
    ScannerFrame {
        time_us: 1e6 + 1e4 * index as f64,
        points_m,
        intensity: has_intensity.then(|| (0..width).map(|it| (it % 251) as u8).collect()),
    }
}

/// Data sets of one frame each, and the position at which each of them ends.
pub fn stream(
    frames: u64,
    settings: &ScannerSettings,
    has_intensity: bool,
) -> (Vec<u8>, Vec<usize>) {
    let mut encoder = Encoder::default();
    let (mut bytes, mut ends) = (Vec::new(), Vec::new());
    for index in 0..frames {
        let frame = frame(index, settings.width, has_intensity);
        data_set(&mut encoder, settings, index, &[frame]);
        bytes.extend(encoder.take());
        ends.push(bytes.len());
    }
    (bytes, ends)
}

/// All profiles of these bytes, read in pieces of this length.
pub fn read(bytes: &[u8], piece: usize) -> (Vec<Profile>, Counts) {
    let mut reader = ProfileReader::new();
    let mut profiles = Vec::new();
    for piece in bytes.chunks(piece) {
        reader.read(piece, |profile| profiles.push(profile));
    }
    reader.finish(|profile| profiles.push(profile));
    (profiles, reader.counts())
}
