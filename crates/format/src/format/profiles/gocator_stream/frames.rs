//! Data sets as a scanner sends them, for the simulated scanner and for tests.

use super::encode::{Encoder, Scales};
use super::layout::NULL_RANGE;
use super::message::{Attributes, Stamp};

/// Settings of a scanner.
#[derive(Debug, Clone)]
pub struct ScannerSettings {
    /// Serial number.
    pub serial_number: u32,
    /// Steps and offsets of the ranges.
    pub scales: Scales,
    /// Whether profiles are uniform, with x at the constant spacing of the scales; otherwise points have x and z.
    pub is_uniform: bool,
    /// Points of a profile; missing points of a frame are sent as invalid.
    pub width: u32,
    /// Whether stamps have a time of PTP, which is then the time of the frame.
    pub has_ptp: bool,
}

impl Default for ScannerSettings {
    /// A scanner of 0.5 m width at 0.5 m distance, with 1280 points.
    fn default() -> Self {
        Self {
            serial_number: 24_001,
            scales: Scales {
                x_scale_nm: 20_000,
                z_scale_nm: 20_000,
                x_offset_um: 0,
                z_offset_um: 0,
            },
            is_uniform: false,
            width: 1280,
            has_ptp: false,
        }
    }
}

/// One frame of a scanner.
#[derive(Debug, Clone)]
pub struct ScannerFrame {
    /// Time on the clock of the scanner, microseconds.
    pub time_us: f64,
    /// x and z of the points in metres; NaN for an invalid point. A uniform profile uses only z.
    pub points_m: Vec<[f64; 2]>,
    /// Intensities, one for each point, if the scanner sends them.
    pub intensity: Option<Vec<u8>>,
}

/// Writes a data set of one or several frames: stamps, profiles and, if the first frame has them,
/// intensities.
pub fn data_set(
    encoder: &mut Encoder,
    settings: &ScannerSettings,
    first: u64,
    frames: &[ScannerFrame],
) {
    let width = settings.width as usize;
    let attributes = Attributes {
        width: settings.width,
        x_scale_nm: settings.scales.x_scale_nm,
        z_scale_nm: settings.scales.z_scale_nm,
        x_offset_um: settings.scales.x_offset_um,
        z_offset_um: settings.scales.z_offset_um,
        exposure_ns: 100_000,
        // 2 is the stream of profiles.
        stream_step: Some((2, 0)),
        ..Attributes::default()
    };
    let stamps: Vec<Stamp> = (first..)
        .zip(frames)
        .map(|(frame, it)| Stamp {
            frame,
            time_ticks: Stamp::ticks(it.time_us),
            serial_number: settings.serial_number,
            ptp_time_us: settings.has_ptp.then(|| rounded(it.time_us)),
            ..Stamp::default()
        })
        .collect();
    let (mut points, mut intensities) = (Vec::new(), Vec::new());
    for frame in frames {
        for index in 0..width {
            let [x_m, z_m] = frame.points_m.get(index).copied().unwrap_or([f64::NAN; 2]);
            let z = settings.scales.raw_z(z_m);
            let x = settings.scales.raw_x(x_m);
            let is_valid = z != NULL_RANGE && (settings.is_uniform || x != NULL_RANGE);
            points.push(if is_valid { [x, z] } else { [NULL_RANGE; 2] });
            let values = frame.intensity.as_deref().unwrap_or_default();
            intensities.push(values.get(index).copied().unwrap_or_default());
        }
    }
    let has_intensity = frames.first().is_some_and(|it| it.intensity.is_some());
    encoder.stamps(0, &stamps, false);
    if settings.is_uniform {
        let ranges: Vec<i16> = points.iter().map(|[_, z]| *z).collect();
        encoder.uniform_profile(&attributes, &ranges, !has_intensity);
    } else {
        encoder.point_cloud(&attributes, &points, !has_intensity);
    }
    if has_intensity {
        encoder.intensity(&attributes, &intensities, true);
    }
}

fn rounded(time_us: f64) -> u64 {
    time_us.round() as u64
}
