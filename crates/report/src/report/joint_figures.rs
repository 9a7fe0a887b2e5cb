//! Figures of the joint adjustment along the drive: how far it moved the poses, and the residuals
//! of the positions before and after.

use super::axis::{Axis, decimate};
use super::bending_figures;
use super::chart::Plot;
use super::figures::{FULL, HALF, VERTICES, series, time_label, time_shift};
use super::html::{self, escape};
use super::track::Track;
use crate::geometry::Vec3;
use crate::joint::{AdjustedDrive, PositionResiduals};
use crate::number;
use crate::results::Calibrations;
use crate::trajectory::Solution;

/// Length of the blocks whose mean residuals are drawn, seconds: short enough to show a pattern along the drive, long
/// enough to average out a prism's noise.
const BLOCK_S: f64 = 2.0;

/// All figures of the project's own drive; empty without a joint adjustment.
pub fn figures(calibrations: &Calibrations, tracks: &[Track]) -> String {
    let drive = calibrations
        .joint_found()
        .and_then(|joint| joint.drives.first());
    let Some(drive) = drive else {
        return String::new();
    };
    let solution = tracks.first().and_then(|track| track.solution);
    let bending = calibrations.joint_found().map(bending_figures::figures);
    let figures = moved(drive) + &residuals(drive, solution) + &bending.unwrap_or_default();
    if figures.is_empty() {
        return figures;
    }
    let refused = match calibrations.refused() {
        Some(_) => {
            "<p>The joint adjustment was refused: these figures show what it would have done to the poses.</p>\n"
        }
        None => "",
    };
    format!("<h3>What the joint adjustment changed</h3>\n{refused}{figures}")
}

/// The figure of the displacement of each pose.
fn moved(drive: &AdjustedDrive) -> String {
    let Some(start_s) = drive.moved.first().map(|m| m.time_s) else {
        return String::new();
    };
    let start = time_shift(start_s);
    let chart = |label: &str, names: [&str; 3], pick: &dyn Fn(usize) -> Vec3| {
        let all: Vec<Vec3> = (0..drive.moved.len()).map(pick).collect();
        let times = || drive.moved.iter().map(|m| m.time_s - start);
        let values = all.iter().flat_map(|v| v.iter().copied());
        let x = Axis::over(&time_label(start), times());
        let y = Axis::rounded(label, values.chain([0.0]));
        let mut plot = Plot::new(HALF, 240.0, x.clone(), y);
        plot.line("zero", &[[x.min, 0.0], [x.max, 0.0]]);
        let mut entries = Vec::new();
        for (i, name) in names.into_iter().enumerate() {
            let curve: Vec<[f64; 2]> = times().zip(&all).map(|(t, v)| [t, v[i]]).collect();
            plot.line(&format!("{} fine", series(i)), &decimate(&curve, VERTICES));
            entries.push((series(i), name.to_owned()));
        }
        html::legend(&entries) + &plot.finish(label)
    };
    let shift = |i: usize| drive.moved[i].shift_m * 1e3;
    let turn = |i: usize| drive.moved[i].turn_rad.map(f64::to_degrees);
    let left = chart("shift (mm)", ["east", "north", "up"], &shift);
    let right = chart("rotation (°)", ["about x", "about y", "about z"], &turn);
    let rms = |component: &dyn Fn(usize) -> Vec3| {
        let sum: f64 = (0..drive.moved.len())
            .map(|i| component(i).norm_squared())
            .sum();
        (sum / drive.moved.len() as f64).sqrt()
    };
    html::figure(
        &format!("<div class=\"pair\"><div>{left}</div><div>{right}</div></div>\n"),
        &format!(
            "How far each pose of {} moved from where the trajectory alone had put it: {} and {}° in 3D, root mean square. Shifts in the world, rotations about the body's axes.",
            escape(&drive.name),
            number::with_unit(number::significant(rms(&shift), 2), "mm"),
            number::significant(rms(&turn), 2)
        ),
    )
}

/// Time and residual (millimetres).
type Records = Vec<(f64, Vec3)>;

/// Mean residuals of each position sensor before and after.
fn residuals(drive: &AdjustedDrive, solution: Option<&Solution>) -> String {
    let figures = drive.residuals.iter().map(|after| {
        let before = solution.map_or_else(Vec::new, |solution| before(solution, &after.sensor));
        of_sensor(after, &before)
    });
    figures.collect()
}

/// The used residuals of a sensor in the adjustment of the trajectory alone.
fn before(solution: &Solution, sensor: &str) -> Records {
    let place = solution.sensors.iter().position(|s| s.name == sensor);
    let list = place.and_then(|place| solution.residuals.get(place));
    let used = list.into_iter().flatten().filter(|r| r.weight > 0.0);
    used.filter(|r| r.values.len() == 3)
        .map(|r| (r.time_s, Vec3::from_column_slice(&r.values)))
        .collect()
}

/// Times and means of blocks; a block without records is a gap.
fn block_means(records: &[(f64, Vec3)], component: usize) -> Vec<[f64; 2]> {
    let mut blocks: Vec<(i64, usize, f64, f64)> = Vec::new();
    let usable = records
        .iter()
        .filter(|(t, v)| t.is_finite() && v[component].is_finite());
    for (time_s, value) in usable {
        let block = (time_s / BLOCK_S).floor() as i64;
        match blocks.last_mut().filter(|last| last.0 == block) {
            Some(last) => {
                last.1 += 1;
                last.2 += time_s;
                last.3 += value[component];
            }
            None => blocks.push((block, 1, *time_s, value[component])),
        }
    }
    let mut curve = Vec::with_capacity(blocks.len());
    for (i, (block, n, time_s, sum)) in blocks.iter().enumerate() {
        let time_s = time_s / *n as f64;
        if i > 0 && block - blocks[i - 1].0 > 1 {
            curve.push([time_s - BLOCK_S, f64::NAN]);
        }
        curve.push([time_s, 1e3 * sum / *n as f64]);
    }
    curve
}

fn of_sensor(after: &PositionResiduals, before: &[(f64, Vec3)]) -> String {
    let curves: [[Vec<[f64; 2]>; 2]; 3] = std::array::from_fn(|component| {
        [before, &after.records].map(|records| block_means(records, component))
    });
    let all = || curves.iter().flatten().flatten();
    let Some(start_s) = all().map(|p| p[0]).reduce(f64::min) else {
        return String::new();
    };
    let start = time_shift(start_s);
    let reach = all().map(|p| p[1].abs()).filter(|v| v.is_finite());
    let reach = reach.fold(0.0, f64::max).max(1e-3);
    let x = Axis::over(&time_label(start), all().map(|p| p[0] - start));
    let mut charts = String::new();
    for (name, [before, after]) in ["east", "north", "up"].into_iter().zip(&curves) {
        let label = format!("{name} (mm)");
        let y = Axis::rounded(&label, [-reach, reach]);
        let mut plot = Plot::new(FULL, 165.0, x.clone(), y);
        plot.line("zero", &[[x.min, 0.0], [x.max, 0.0]]);
        for (class, curve) in [("s5", before), ("s0", after)] {
            let shown: Vec<[f64; 2]> = curve.iter().map(|p| [p[0] - start, p[1]]).collect();
            plot.line(&format!("{class} fine"), &decimate(&shown, VERTICES));
        }
        charts.push_str(&plot.finish(&format!("Mean residuals, {label}")));
    }
    let entries = [
        ("s5".to_owned(), "before: trajectory alone".to_owned()),
        ("s0".to_owned(), "after: joint adjustment".to_owned()),
    ];
    let entries = &entries[usize::from(before.is_empty())..];
    html::figure(
        &(html::legend(entries) + &charts),
        &format!(
            "{}, predicted minus measured, means over {BLOCK_S:.0} s. The trajectory alone follows the measured positions; the joint adjustment follows the scans, and its residuals show the noise of the sensor. A pattern that lasts means that positions and scans see different worlds.",
            escape(&after.sensor)
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_have_means_and_gaps() {
        let at = |time_s: f64, mm: f64| (time_s, Vec3::repeat(1e-3 * mm));
        let records = [at(0.5, 1.0), at(1.5, 3.0), at(2.5, f64::NAN), at(6.5, -1.0)];
        let curve = block_means(&records, 1);
        assert_eq!(curve.len(), 3);
        assert!((curve[0][0] - 1.0).abs() < 1e-12 && (curve[0][1] - 2.0).abs() < 1e-12);
        assert!(curve[1][1].is_nan());
        assert!((curve[2][1] + 1.0).abs() < 1e-12);
    }
}
