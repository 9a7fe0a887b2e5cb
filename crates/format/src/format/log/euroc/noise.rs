//! `sensor.yaml` beside an IMU log of the EuRoC data set, with the noise of the IMU in SI units. Kalibr uses the same names.

use crate::error::{Error, Location, Result};
use crate::format::input::Input;
use crate::format::kind::{Frame, Kind};
use crate::format::text::yaml;

/// The noise of an IMU, as far as a file has it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct DescribedNoise {
    /// Noise density of the angular rates, rad/s/√Hz.
    pub gyro_density: Option<f64>,
    /// Random walk of their bias, rad/s/√s.
    pub gyro_bias_walk: Option<f64>,
    /// Noise density of the specific forces, m/s²/√Hz.
    pub accel_density: Option<f64>,
    /// Random walk of their bias, m/s²/√s.
    pub accel_bias_walk: Option<f64>,
}

pub(crate) const DESCRIPTION: Kind = Kind {
    signature: Some(|start| {
        start.extension == "yaml" && start.contains(b"gyroscope_noise_density:")
    }),
    contents: Some(|input| {
        let noise = read_imu_noise(input)?;
        let values = [
            ("angular rates", noise.gyro_density, "rad/s/√Hz"),
            ("their bias", noise.gyro_bias_walk, "rad/s/√s"),
            ("specific forces", noise.accel_density, "m/s²/√Hz"),
            ("their bias", noise.accel_bias_walk, "m/s²/√s"),
        ];
        let text =
            |(what, value, unit): (_, Option<f64>, _)| Some(format!("{what} {} {unit}", value?));
        let values: Vec<String> = values.into_iter().filter_map(text).collect();
        Ok(format!("noise: {}", values.join(", ")))
    }),
    frame: Frame::Fixed("SI units (the format)"),
    ..Kind::new("euroc-sensor", "description of an IMU (EuRoC sensor.yaml)")
};

/// Reads the noise of an IMU.
///
/// # Errors
/// A file that is not YAML; a value that is not positive.
pub fn read_imu_noise(input: impl Into<Input>) -> Result<DescribedNoise> {
    let input = &input.into();
    let mut noise = DescribedNoise::default();
    for entry in yaml::values(input)? {
        let value = match entry.keys.as_str() {
            "gyroscope_noise_density" => &mut noise.gyro_density,
            "gyroscope_random_walk" => &mut noise.gyro_bias_walk,
            "accelerometer_noise_density" => &mut noise.accel_density,
            "accelerometer_random_walk" => &mut noise.accel_bias_walk,
            _ => continue,
        };
        let number = entry.text.parse().ok();
        let number = number.filter(|number: &f64| number.is_finite() && *number > 0.0);
        let Some(number) = number else {
            return Err(Error::format(
                input.path(),
                Location::Line(entry.line),
                format!("{} = `{}`", entry.keys, entry.text),
                "a positive number",
            ));
        };
        *value = Some(number);
    }
    Ok(noise)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::inspect;

    #[test]
    fn noise_is_read_by_its_names() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sensor.yaml");
        let text = "sensor_type: imu\nT_BS:\n  cols: 4\n  data: [1.0, 0.0,\n         0.0, 1.0]\n\
            gyroscope_noise_density: 1.6968e-04     # [ rad / s / sqrt(Hz) ]\n\
            gyroscope_random_walk: 1.9393e-05\naccelerometer_noise_density: 2.0000e-3\n";
        std::fs::write(&path, text).unwrap();
        let expected = DescribedNoise {
            gyro_density: Some(1.6968e-4),
            gyro_bias_walk: Some(1.9393e-5),
            accel_density: Some(2e-3),
            accel_bias_walk: None,
        };
        assert_eq!(read_imu_noise(&path).unwrap(), expected);
        let found = inspect(&path).unwrap();
        assert_eq!(found.format.id(), "euroc-sensor");
        let notes = found.notes.join("; ");
        assert!(notes.contains("specific forces 0.002 m/s²/√Hz"), "{notes}");
        std::fs::write(&path, text.replace("1.9393e-05", "-1")).unwrap();
        let error = read_imu_noise(&path).unwrap_err().to_string();
        assert!(
            error.contains("line 7: found gyroscope_random_walk = `-1`, expected a positive"),
            "{error}"
        );
    }
}
