//! `boresight inspect --allan`: noise figures in the keys and units of the project file.

use std::fmt::Write;
use std::path::Path;

use serde_json::{Map, Value, json};

use super::print::unprintable;
use crate::error::{Error, Location, Result};
use crate::format::{self, Input};
use crate::sensor::STANDARD_GRAVITY_M_S2;
use crate::sensor::allan::{AxisNoise, Figure, ImuNoiseEstimate, allan};

/// A key of `[imu]` with the figures of the three axes.
struct Key {
    name: &'static str,
    unit: &'static str,
    axes: [Figure; 3],
}

impl Key {
    fn new(
        name: &'static str,
        unit: &'static str,
        axes: &[AxisNoise; 3],
        pick: fn(&AxisNoise) -> Figure,
        unit_of_si: f64,
    ) -> Self {
        let axes = std::array::from_fn(|i| pick(&axes[i]).scaled(unit_of_si));
        Self { name, unit, axes }
    }

    /// The value of the project for all axes: the largest one, if all axes are determined.
    fn recommended(&self) -> Option<f64> {
        let values = self.axes.iter().map(Figure::determined);
        values
            .collect::<Option<Vec<_>>>()?
            .into_iter()
            .reduce(f64::max)
    }

    /// Upper bound of all axes, as far as the log determines it.
    fn bound(&self) -> Option<f64> {
        let bounds = self.axes.iter().map(|figure| match *figure {
            Figure::Determined { value, .. } | Figure::AtMost { value } => Some(value),
            Figure::Undetermined => None,
        });
        bounds
            .collect::<Option<Vec<_>>>()?
            .into_iter()
            .reduce(f64::max)
    }
}

/// The keys of one sensor.
struct Keys {
    white: Key,
    instability: Key,
    walk: Key,
}

impl Keys {
    fn of(noise: &ImuNoiseEstimate) -> [Self; 2] {
        let degrees = 1f64.to_degrees();
        let micro_g = 1e6 / STANDARD_GRAVITY_M_S2;
        let (gyro, accel) = (&noise.gyro, &noise.accel);
        [
            Self {
                white: Key::new(
                    "gyro_noise_deg_sqrt_h",
                    "°/√h",
                    gyro,
                    |a| a.white,
                    60.0 * degrees,
                ),
                instability: Key::new(
                    "gyro_bias_instability_deg_h",
                    "°/h",
                    gyro,
                    |a| a.instability,
                    3600.0 * degrees,
                ),
                walk: Key::new(
                    "gyro_bias_walk_rad_s_sqrt_s",
                    "rad/s/√s",
                    gyro,
                    |a| a.walk,
                    1.0,
                ),
            },
            Self {
                white: Key::new(
                    "accel_noise_ug_sqrt_hz",
                    "µg/√Hz",
                    accel,
                    |a| a.white,
                    micro_g,
                ),
                instability: Key::new(
                    "accel_bias_instability_ug",
                    "µg",
                    accel,
                    |a| a.instability,
                    micro_g,
                ),
                walk: Key::new(
                    "accel_bias_walk_m_s2_sqrt_s",
                    "m/s²/√s",
                    accel,
                    |a| a.walk,
                    1.0,
                ),
            },
        ]
    }

    fn all(&self) -> [&Key; 3] {
        [&self.white, &self.instability, &self.walk]
    }

    /// The lines of `[imu]`. A bias walk that is determined replaces the instability, from which the project would
    /// otherwise derive a bias walk. Values that are not determined become comments, so that the value of the datasheet
    /// or the default remains in force.
    fn snippet(&self) -> String {
        let mut text = line(&self.white, self.white.recommended());
        match self.walk.recommended() {
            Some(walk) => text += &line(&self.walk, Some(walk)),
            None => text += &line(&self.instability, self.instability.recommended()),
        }
        text
    }
}

fn line(key: &Key, value: Option<f64>) -> String {
    match (value, key.bound()) {
        (Some(value), _) => format!("{} = {}\n", key.name, digits(value)),
        (None, Some(bound)) => format!(
            "# {}: not determined by this log, at most {} {}\n",
            key.name,
            digits(bound),
            key.unit
        ),
        (None, None) => format!("# {}: not determined by this log\n", key.name),
    }
}

/// Four significant digits, valid as TOML.
fn digits(value: f64) -> String {
    if (1e-3..1e5).contains(&value) {
        let decimals = (3 - value.log10().floor() as i32).max(0) as usize;
        format!("{value:.decimals$}")
    } else {
        format!("{value:.3e}")
    }
}

/// Noise figures of the static log `file`, as JSON and as text.
pub(super) fn inspect(file: &Path) -> Result<(Value, String)> {
    let input = &Input::from(file);
    let format = format::detect(input)?;
    if !format.has_imu() {
        return Err(Error::format(
            file,
            Location::Whole,
            format.to_string(),
            "an IMU log at rest, which is the only input of --allan",
        ));
    }
    let noise = allan(&format::read_imu(input)?)?;
    let keys = Keys::of(&noise);
    let snippet = keys.iter().map(Keys::snippet).collect::<String>();
    Ok((
        document(file, &noise, &keys, &snippet)?,
        text(file, &noise, &keys, &snippet),
    ))
}

fn document(
    file: &Path,
    noise: &ImuNoiseEstimate,
    keys: &[Keys; 2],
    snippet: &str,
) -> Result<Value> {
    let figures: Map<String, Value> = keys
        .iter()
        .flat_map(Keys::all)
        .map(|key| {
            let figure = json!({
                "unit": key.unit,
                "axes": key.axes,
                "recommended": key.recommended(),
            });
            (key.name.to_owned(), figure)
        })
        .collect();
    Ok(json!({
        "path": file.display().to_string(),
        "figures": figures,
        "imu_toml": format!("[imu]\n{snippet}"),
        "allan": serde_json::to_value(noise).map_err(unprintable)?,
    }))
}

fn text(file: &Path, noise: &ImuNoiseEstimate, keys: &[Keys; 2], snippet: &str) -> String {
    let [first, last] = noise.span_s;
    let mut text = format!(
        "{}\n  at rest  {first:.3} s to {last:.3} s, {} samples at {:.3} Hz\n",
        file.display(),
        noise.samples,
        1.0 / noise.interval_s
    );
    for warning in &noise.warnings {
        let _ = writeln!(text, "  warning  {warning}");
    }
    let _ = writeln!(
        text,
        "\n  {:<29}{:<10}{:>22}{:>22}{:>22}",
        "figure", "unit", "x", "y", "z"
    );
    for key in keys.iter().flat_map(Keys::all) {
        let _ = write!(text, "  {:<29}{:<10}", key.name, key.unit);
        for figure in &key.axes {
            let _ = write!(text, "{:>22}", figure_text(figure));
        }
        text.push('\n');
    }
    curves(&mut text, noise);
    let _ = write!(
        text,
        "\nFor the project, the noisiest axis of each sensor (keep the datasheet's values \
         where the log does not determine them):\n\n[imu]\n{snippet}"
    );
    text
}

fn figure_text(figure: &Figure) -> String {
    match *figure {
        Figure::Determined { value, sigma } => format!("{} ± {}", digits(value), short(sigma)),
        Figure::AtMost { value } => format!("at most {}", digits(value)),
        Figure::Undetermined => "not determined".to_owned(),
    }
}

/// A sigma with two significant digits.
fn short(sigma: f64) -> String {
    if (1e-4..100.0).contains(&sigma) {
        let decimals = (1 - sigma.log10().floor() as i32).max(0) as usize;
        format!("{sigma:.decimals$}")
    } else {
        format!("{sigma:.1e}")
    }
}

/// Appends the Allan deviations, one line per octave.
fn curves(text: &mut String, noise: &ImuNoiseEstimate) {
    let _ = writeln!(
        text,
        "\n  Allan deviation, gyro °/h, accelerometer µg\n  {:>11}{:>8}{:>11}{:>11}{:>11}{:>11}{:>11}{:>11}",
        "τ s", "±", "gyro x", "gyro y", "gyro z", "accel x", "accel y", "accel z"
    );
    for (i, point) in noise.gyro[0].curve.iter().enumerate() {
        let _ = write!(
            text,
            "  {:>11}{:>7.0}%",
            digits(point.tau_s),
            100.0 * point.relative_sigma()
        );
        for axis in &noise.gyro {
            let _ = write!(
                text,
                "{:>11}",
                digits(axis.curve[i].deviation.to_degrees() * 3600.0)
            );
        }
        for axis in &noise.accel {
            let micro_g = axis.curve[i].deviation * 1e6 / STANDARD_GRAVITY_M_S2;
            let _ = write!(text, "{:>11}", digits(micro_g));
        }
        text.push('\n');
    }
}
