//! The precision of the parameters as a picture: the standard deviation of every parameter by each method, on
//! logarithmic axes, and the parameters that are not determined.

use super::axis::Axis;
use super::chart::Plot;
use super::figures::HALF;
use super::html;
use super::tables::method_name;
use crate::calibration::{Calibration, Variant};
use crate::results::Calibrations;

/// Height of a row.
const ROW: f64 = 22.0;
/// Names of the parameters; rotations are about the body's axes.
const NAMES: [&str; 6] = ["tx", "ty", "tz", "about x", "about y", "about z"];

/// A method with its class in the charts.
struct Series<'a> {
    class: &'static str,
    name: String,
    calibration: &'a Calibration,
}

/// Standard deviations of all parameters, positions beside rotations; empty without a covariance.
pub fn figure(calibrations: &Calibrations) -> String {
    let result = &calibrations.result;
    let mut series = vec![Series {
        class: "s0",
        name: method_name(result.method).to_owned(),
        calibration: result,
    }];
    for (variant, class, name) in [
        (Variant::TwoStep, "s1", "two steps"),
        (
            Variant::WithoutReference,
            "s2",
            "two steps without reference",
        ),
    ] {
        series.extend(calibrations.variant(variant).map(|calibration| Series {
            class,
            name: name.to_owned(),
            calibration,
        }));
    }
    series.retain(|one| one.calibration.covariance.is_some());
    if series.is_empty() {
        return String::new();
    }
    let parts = [
        (0, "σ of position (mm)", 1e3),
        (3, "σ of rotation about body axes (°)", 1f64.to_degrees()),
    ];
    let charts = parts.map(|(first, label, factor)| {
        format!("<div>{}</div>", chart(&series, first, label, factor))
    });
    let mut entries: Vec<(String, String)> = series
        .iter()
        .map(|one| (one.class.to_owned(), one.name.clone()))
        .collect();
    let is_open = series.iter().any(|one| {
        (0..one.calibration.mountings.len())
            .any(|scanner| sigmas(one.calibration, scanner).contains(&None))
    });
    if is_open {
        entries.push(("open".into(), "fixed, or not determined by the data".into()));
    }
    html::figure(
        &format!(
            "{}<div class=\"pair\">{}</div>\n",
            html::legend(&entries),
            charts.concat()
        ),
        "Standard deviations of the mountings on logarithmic axes: what lies further to the left in a panel is known better.",
    )
}

/// Standard deviations of positions and of rotations about the body's axes, metres and radians; `None` for a parameter
/// that is fixed or not determined.
pub fn sigmas(calibration: &Calibration, scanner: usize) -> [Option<f64>; 6] {
    let covariance = calibration.covariance.as_ref();
    std::array::from_fn(|parameter| {
        let row = 6 * scanner + parameter;
        let variance = covariance?[(row, row)];
        let is_known = !calibration.mountings[scanner].fixed[parameter]
            && calibration.is_observable(scanner, parameter)
            && variance > 0.0;
        is_known.then(|| variance.sqrt())
    })
}

fn chart(series: &[Series], first: usize, label: &str, factor: f64) -> String {
    let scanners = &series[0].calibration.mountings;
    let names: Vec<String> = scanners
        .iter()
        .flat_map(|mounting| {
            let names = &NAMES[first..first + 3];
            names.iter().map(|name| format!("{} {name}", mounting.name))
        })
        .collect();
    let all = |one: &Series| -> Vec<Option<f64>> {
        let rows = 0..scanners.len();
        let rows =
            rows.flat_map(|scanner| sigmas(one.calibration, scanner)[first..first + 3].to_vec());
        rows.map(|sigma| sigma.map(|sigma| factor * sigma))
            .collect()
    };
    let known = series.iter().flat_map(|one| all(one).into_iter().flatten());
    let x = Axis::logarithmic(label, known);
    let edge = x.max;
    let mut plot = Plot::rows(HALF, ROW, &names, x);
    for (at, one) in series.iter().enumerate() {
        // The methods are drawn side by side in a row, so that none hides another.
        let aside = 0.22 * (at as f64 - 0.5 * (series.len() - 1) as f64);
        let (mut dots, mut open) = (Vec::new(), Vec::new());
        for (row, sigma) in all(one).into_iter().enumerate() {
            match sigma {
                Some(sigma) => dots.push([sigma, row as f64 + aside]),
                None => open.push([edge, row as f64 + aside]),
            }
        }
        plot.dots(&format!("dot {}", one.class), 3.6, &dots);
        for cross in open {
            plot.crosses("cross open", &[cross]);
        }
    }
    plot.finish(label)
}
