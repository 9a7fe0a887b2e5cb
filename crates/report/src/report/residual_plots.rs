//! Figures of the trajectory's adjustment: residuals over time and their distribution, biases.

use super::axis::{self, Axis, decimate};
use super::chart::Plot;
use super::figures::{FULL, HALF, VERTICES, series, time_label, time_shift};
use super::html::{self, escape};
use super::track::{Track, adjusted};
use crate::diagnostics::{component_name, sensor_name};
use crate::geometry::Vec3;
use crate::number;
use crate::sensor::ImuBias;
use crate::statistics::median;
use crate::trajectory::{Residual, SensorDiagnostics, Solution};

/// A gap without used records is at least this many usual time steps and this many seconds long.
const GAP_STEPS: f64 = 5.0;
const MIN_GAP_S: f64 = 1.0;
/// Half width of the histogram and width of its bars, standard deviations.
const HALF_WIDTH: f64 = 5.0;
const BIN: f64 = 0.25;

/// Residuals over time of every sensor of the first drive that was adjusted.
pub fn over_time(tracks: &[Track]) -> String {
    let Some((drive, solution)) = adjusted(tracks).next() else {
        return String::new();
    };
    let mut out = String::new();
    for (sensor, residuals) in measured(solution) {
        out.push_str(&of_sensor(drive, solution, sensor, residuals));
    }
    if out.is_empty() {
        return out;
    }
    format!("<h3>Residuals over time</h3>\n{out}")
}

/// Sensors that have residuals of individual records.
pub fn measured(solution: &Solution) -> impl Iterator<Item = (&SensorDiagnostics, &[Residual])> {
    let all = solution.sensors.iter().zip(&solution.residuals);
    all.filter(|(_, list)| !list.is_empty())
        .map(|(sensor, list)| (sensor, list.as_slice()))
}

/// Factor and unit in which residuals are drawn.
fn drawn_unit(unit: &str) -> (f64, &str) {
    match unit {
        "m" => (1e3, "mm"),
        "rad" => (1f64.to_degrees(), "°"),
        other => (1.0, other),
    }
}

fn of_sensor(
    drive: &Track,
    solution: &Solution,
    sensor: &SensorDiagnostics,
    residuals: &[Residual],
) -> String {
    let (factor, unit) = drawn_unit(&sensor.unit);
    let components = residuals.iter().map(|r| r.values.len()).max().unwrap_or(0);
    let span = axis::range(
        drive
            .poses
            .iter()
            .map(|p| p.time_s)
            .chain(residuals.iter().map(|r| r.time_s)),
    );
    let Some((from_s, to_s)) = span else {
        return String::new();
    };
    let start = time_shift(from_s);
    let gaps = gaps(used_s(residuals), (from_s, to_s));
    let name = sensor_name(&sensor.name);
    let mut charts = String::new();
    for index in 0..components {
        let points = |is_used: bool| -> Vec<[f64; 2]> {
            residuals
                .iter()
                .filter(|r| (r.weight > 0.0) == is_used)
                .filter_map(|r| Some([r.time_s - start, factor * r.values.get(index)?]))
                .collect()
        };
        let (used, rejected) = (points(true), points(false));
        let reach = used
            .iter()
            .map(|p| 1.05 * p[1].abs())
            .filter(|v| v.is_finite())
            .fold(0.0, f64::max);
        let reach = if reach > 0.0 { reach } else { 1.0 };
        let label = format!("{} ({unit})", component_name(name, components, index));
        let x = Axis::over(&time_label(start), [from_s - start, to_s - start]);
        let y = Axis::rounded(&label, [-reach, reach]);
        let (low, high) = (y.min, y.max);
        let mut plot = Plot::new(FULL, if components > 1 { 165.0 } else { 200.0 }, x, y);
        for (from, to) in &gaps {
            plot.shade("gap", from - start, to - start);
        }
        for (from, to) in &solution.imu_gaps_s {
            plot.shade("silent", from - start, to - start);
        }
        plot.line("zero", &[[from_s - start, 0.0], [to_s - start, 0.0]]);
        plot.scatter("s0", &used);
        let inside: Vec<_> = rejected
            .iter()
            .copied()
            .filter(|p| (low..=high).contains(&p[1]))
            .collect();
        plot.crosses("cross", &inside);
        plot.beyond("beyond", &rejected);
        charts.push_str(&plot.finish(&format!("Residuals of {name}: {label}")));
    }
    let mut entries = vec![("s0".to_owned(), "used".to_owned())];
    let rejected = residuals.iter().filter(|r| r.weight == 0.0).count();
    if rejected > 0 {
        let text = "rejected; triangles at the edge are beyond the scale";
        entries.push(("cross".into(), text.into()));
    }
    if !gaps.is_empty() {
        entries.push(("gap".into(), "no record used".into()));
    }
    if !solution.imu_gaps_s.is_empty() {
        entries.push(("silent".into(), "no IMU samples".into()));
    }
    html::figure(
        &(html::legend(&entries) + &charts),
        &format!(
            "{}, predicted minus measured: {} records used, {} rejected{}.",
            escape(name),
            number::count(residuals.len() - rejected),
            number::count(rejected),
            match gaps.len() {
                0 => String::new(),
                1 => ", one gap".into(),
                n => format!(", {} gaps", number::count(n)),
            }
        ),
    )
}

/// Spans without records between two times, from the times of the records in their order, seconds.
pub fn gaps(times_s: impl Iterator<Item = f64>, (from_s, to_s): (f64, f64)) -> Vec<(f64, f64)> {
    let times: Vec<f64> = times_s.filter(|t| t.is_finite()).collect();
    let usual = median(times.windows(2).map(|w| w[1] - w[0])).unwrap_or(0.0);
    let least = (GAP_STEPS * usual).max(MIN_GAP_S);
    let ends: Vec<f64> = std::iter::once(from_s).chain(times).chain([to_s]).collect();
    let pairs = ends.windows(2).map(|w| (w[0], w[1]));
    pairs.filter(|(a, b)| b - a > least).collect()
}

/// Times of the records that were used.
pub fn used_s(residuals: &[Residual]) -> impl Iterator<Item = f64> {
    let used = residuals.iter().filter(|r| r.weight > 0.0);
    used.map(|r| r.time_s)
}

/// Histograms of the normalised residuals with the standard normal, one chart per sensor.
pub fn histograms(tracks: &[Track]) -> String {
    let Some((_, solution)) = adjusted(tracks).next() else {
        return String::new();
    };
    let mut charts = String::new();
    for (sensor, residuals) in measured(solution) {
        // A component without redundancy has a test value of zero.
        let tests: Vec<f64> = residuals
            .iter()
            .filter(|r| r.weight > 0.0)
            .flat_map(|r| r.tests.iter().copied())
            .filter(|t| t.is_finite() && *t != 0.0)
            .collect();
        if !tests.is_empty() {
            charts.push_str(&histogram(sensor_name(&sensor.name), &tests));
        }
    }
    if charts.is_empty() {
        return charts;
    }
    let entries = [
        ("s0".to_owned(), "used residuals".to_owned()),
        ("s1".to_owned(), "standard normal".to_owned()),
    ];
    html::figure(
        &format!(
            "{}<div class=\"pair\">{charts}</div>\n",
            html::legend(&entries)
        ),
        "Residuals divided by their standard deviations, all components together. If the sigmas are right and the errors normal, the bars follow the curve; a wider histogram means larger errors than the sigma of the sensor, a narrower one smaller errors.",
    )
}

fn histogram(name: &str, tests: &[f64]) -> String {
    let bins = (2.0 * HALF_WIDTH / BIN).round() as usize;
    let mut counts = vec![0usize; bins];
    let mut beyond_three = 0usize;
    for test in tests {
        beyond_three += usize::from(test.abs() > 3.0);
        let place = ((test + HALF_WIDTH) / BIN).floor();
        if place >= 0.0 && place < bins as f64 {
            counts[place as usize] += 1;
        }
    }
    let share = |count: usize| 100.0 * count as f64 / tests.len() as f64;
    let normal = |z: f64| 100.0 * BIN * (-0.5 * z * z).exp() / (2.0 * std::f64::consts::PI).sqrt();
    let most = counts.iter().map(|c| share(*c)).fold(normal(0.0), f64::max);
    let x = Axis::over("residual (σ of the residual)", [-HALF_WIDTH, HALF_WIDTH]);
    let y = Axis::rounded("share (%)", [0.0, most]);
    let mut plot = Plot::new(HALF, 210.0, x, y);
    for (i, count) in counts.iter().enumerate() {
        let left = -HALF_WIDTH + BIN * i as f64;
        plot.bar("var(--s0)", left, left + BIN, share(*count));
    }
    let curve: Vec<[f64; 2]> = (0..=100)
        .map(|i| -HALF_WIDTH + 2.0 * HALF_WIDTH * f64::from(i) / 100.0)
        .map(|z| [z, normal(z)])
        .collect();
    plot.line("s1", &curve);
    format!(
        "<div><h4>{}<small>{} residuals, {} % beyond ± 3 (normal: 0.3 %)</small></h4>\n{}</div>\n",
        escape(name),
        number::count(tests.len()),
        number::fixed(share(beyond_three), 1),
        plot.finish(&format!("Histogram of the residuals of {name}"))
    )
}

/// Biases of gyro and accelerometer along the first drive that has them.
pub fn biases(tracks: &[Track]) -> String {
    let has_bias = |d: &&Track| d.poses.iter().any(|p| p.bias.is_some());
    let Some(drive) = tracks.iter().find(has_bias) else {
        return String::new();
    };
    let gyro = |b: &ImuBias| b.gyro_rad_s.map(|w| w.to_degrees() * 3600.0);
    let accelerometer = |b: &ImuBias| b.accel_m_s2 * 1e3;
    let left = bias(drive, "gyro", "°/h", gyro);
    let right = bias(drive, "accelerometer", "mm/s²", accelerometer);
    let body = format!("<div class=\"pair\"><div>{left}</div><div>{right}</div></div>\n");
    html::figure(
        &body,
        &format!(
            "Biases along {}, about and along the body's axes, minus their means over the drive (see the legend).",
            escape(drive.name)
        ),
    )
}

fn bias(drive: &Track, name: &str, unit: &str, pick: impl Fn(&ImuBias) -> Vec3) -> String {
    let known: Vec<(f64, Vec3)> = drive
        .poses
        .iter()
        .filter_map(|p| Some((p.time_s, pick(p.bias.as_ref()?))))
        .filter(|(t, b)| t.is_finite() && b.iter().all(|x| x.is_finite()))
        .collect();
    let Some(first) = known.first() else {
        return String::new();
    };
    let mean = known.iter().map(|k| k.1).sum::<Vec3>() / known.len() as f64;
    let start = time_shift(first.0);
    let x = Axis::over(&time_label(start), known.iter().map(|k| k.0 - start));
    let about = known.iter().flat_map(|k| (k.1 - mean).data.0[0]);
    let y = Axis::rounded(&format!("bias − mean ({unit})"), about);
    let mut plot = Plot::new(HALF, 240.0, x, y);
    let mut entries = Vec::new();
    for (i, axis) in ["x", "y", "z"].iter().enumerate() {
        let curve: Vec<[f64; 2]> = known
            .iter()
            .map(|k| [k.0 - start, k.1[i] - mean[i]])
            .collect();
        plot.line(&format!("{} fine", series(i)), &decimate(&curve, VERTICES));
        let words = number::with_unit(number::signed(number::significant(mean[i], 3)), unit);
        entries.push((series(i), format!("{axis}, mean {words}")));
    }
    format!(
        "<h4>{name}</h4>\n{}{}",
        html::legend(&entries),
        plot.finish(&format!("Bias of the {name}"))
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(time_s: f64, weight: f64) -> Residual {
        Residual {
            record: 1,
            time_s,
            values: vec![0.0],
            normalised: vec![0.0],
            tests: vec![0.0],
            weight,
        }
    }

    #[test]
    fn gaps_are_seen_at_the_ends_between_and_where_all_is_rejected() {
        let list: Vec<Residual> = (0..100)
            .map(|i| {
                at(
                    10.0 + 0.1 * f64::from(i),
                    f64::from(u8::from(!(40..60).contains(&i))),
                )
            })
            .collect();
        let spans = gaps(used_s(&list), (5.0, 20.5));
        assert_eq!(spans.len(), 2, "{spans:?}");
        assert_eq!(spans[0], (5.0, 10.0));
        assert!((spans[1].0 - 13.9).abs() < 1e-9 && (spans[1].1 - 16.0).abs() < 1e-9);
        assert_eq!(gaps(std::iter::empty(), (0.0, 3.0)), [(0.0, 3.0)]);
    }
}
