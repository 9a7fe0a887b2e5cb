//! Figures of mountings that move: along the drive, and against roll and pitch with the part that the load explains.

use super::axis::{Axis, decimate};
use super::chart::Plot;
use super::figures::{HALF, VERTICES, series, time_label, time_shift};
use super::html::{self, escape};
use crate::geometry::Vec3;
use crate::joint::{AdjustedDrive, Compliance, Joint, MovedMounting};
use crate::number;
use crate::statistics::rms;

/// Maximum number of dots for a parameter.
const DOTS: usize = 300;
/// Height of a chart.
const HEIGHT: f64 = 240.0;
/// Number of vertices of the curve of the load.
const CURVE: usize = 40;

/// Rotations or shifts: their index among the offsets (δφ, δp), label and names, and the factor to their unit.
struct Kind {
    first: usize,
    label: &'static str,
    names: [&'static str; 3],
    factor: f64,
}

const KINDS: [Kind; 2] = [
    Kind {
        first: 0,
        label: "rotation (°)",
        names: ["about x", "about y", "about z"],
        factor: 180.0 / std::f64::consts::PI,
    },
    Kind {
        first: 3,
        label: "shift (mm)",
        names: ["x", "y", "z"],
        factor: 1e3,
    },
];

/// All figures of the project's own drive; empty if mountings are rigid.
pub fn figures(joint: &Joint) -> String {
    let Some(drive) = joint.drives.first() else {
        return String::new();
    };
    let scanners = joint.mountings.iter().zip(&drive.bending).enumerate();
    let figures = scanners.map(|(scanner, (mounting, moved))| {
        let compliance = joint.compliance.get(scanner);
        of_scanner(&mounting.name, drive, moved, compliance)
    });
    let figures: String = figures.collect();
    if figures.is_empty() {
        figures
    } else {
        format!("<h3>How the mountings moved</h3>\n{figures}")
    }
}

fn of_scanner(
    name: &str,
    drive: &AdjustedDrive,
    moved: &MovedMounting,
    compliance: Option<&Compliance>,
) -> String {
    let mut charts = String::new();
    for against in [Against::Time, Against::Roll, Against::Pitch] {
        for kind in &KINDS {
            charts.push_str(&format!(
                "<div>{}</div>",
                chart(kind, against, drive, moved, compliance)
            ));
        }
    }
    let size = |kind: &Kind| {
        let samples = moved.offsets.samples();
        let values = samples.flat_map(|(_, offset)| &offset[kind.first..kind.first + 3]);
        number::significant(rms(values.map(|x| x * kind.factor)), 2)
    };
    html::figure(
        &format!("<div class=\"pair\">{charts}</div>\n"),
        &format!(
            "How the mounting of {} moved about its mean, in body axes: by {} mm and {}° on each axis, root mean \
             square, with bands of one standard deviation, and the same against roll and pitch, in the same colours. Roll is positive with the right side down, pitch with \
             the front up. Lines are what the load explains with all else at its mean; dots lie off them where \
             other loads act, or where the mounting moved with time{}.",
            escape(name),
            size(&KINDS[1]),
            size(&KINDS[0]),
            match every(moved) {
                1 => String::new(),
                every => format!(" (a dot for one of {every} samples)"),
            },
        ),
    )
}

/// Number of samples per dot.
fn every(moved: &MovedMounting) -> usize {
    moved.offsets.samples().count().div_ceil(DOTS).max(1)
}

/// The quantity against which offsets are drawn.
#[derive(Clone, Copy)]
enum Against {
    Time,
    Roll,
    Pitch,
}

fn chart(
    kind: &Kind,
    against: Against,
    drive: &AdjustedDrive,
    moved: &MovedMounting,
    compliance: Option<&Compliance>,
) -> String {
    match against {
        Against::Time => over_time(kind, moved),
        Against::Roll => by_tilt(kind, "roll (°)", 1, drive, moved, compliance),
        Against::Pitch => by_tilt(kind, "pitch (°)", 0, drive, moved, compliance),
    }
}

fn over_time(kind: &Kind, moved: &MovedMounting) -> String {
    let samples = || moved.offsets.samples().zip(moved.sigmas.samples());
    let first_s = moved.offsets.samples().next().map_or(0.0, |(t, _)| t);
    let start = time_shift(first_s);
    let places = kind.first..kind.first + 3;
    let ends = samples().flat_map(|((_, offset), (_, sigma))| {
        let values = places
            .clone()
            .flat_map(|i| [offset[i] - sigma[i], offset[i] + sigma[i]]);
        values.map(|x| x * kind.factor).collect::<Vec<_>>()
    });
    let x = Axis::over(&time_label(start), samples().map(|((t, _), _)| t - start));
    let mut plot = Plot::new(
        HALF,
        HEIGHT,
        x.clone(),
        Axis::rounded(kind.label, ends.chain([0.0])),
    );
    plot.line("zero", &[[x.min, 0.0], [x.max, 0.0]]);
    let every = moved.offsets.samples().count().div_ceil(VERTICES).max(1);
    let mut entries = Vec::new();
    for (i, name) in kind.names.iter().enumerate() {
        let place = kind.first + i;
        let band = samples().step_by(every).map(|((t, offset), (_, sigma))| {
            let [low, high] = [-1.0, 1.0].map(|sign| offset[place] + sign * sigma[place]);
            [t - start, low * kind.factor, high * kind.factor]
        });
        plot.band("band", &band.collect::<Vec<_>>());
        let curve = samples().map(|((t, offset), _)| [t - start, offset[place] * kind.factor]);
        let curve: Vec<[f64; 2]> = curve.collect();
        plot.line(&format!("{} fine", series(i)), &decimate(&curve, VERTICES));
        entries.push((series(i), (*name).to_owned()));
    }
    html::legend(&entries) + &plot.finish(&format!("{} over time", kind.label))
}

/// Roll and pitch from the direction up in the body; the body's z axis points down or up.
fn tilt_deg(up: &Vec3, load: usize) -> f64 {
    let sign = if load == 1 { up.z.signum() } else { 1.0 };
    (sign * up[load]).clamp(-1.0, 1.0).asin().to_degrees()
}

fn by_tilt(
    kind: &Kind,
    label: &str,
    load: usize,
    drive: &AdjustedDrive,
    moved: &MovedMounting,
    compliance: Option<&Compliance>,
) -> String {
    let samples = moved.offsets.samples().step_by(every(moved));
    let mut upward = 1.0;
    let dots = samples.filter_map(|(time_s, offset)| {
        let pose = drive.trajectory.pose_at(time_s)?;
        let up = pose.rotation.inverse() * Vec3::z();
        upward = up.z.signum();
        Some((tilt_deg(&up, load), offset))
    });
    let dots: Vec<(f64, &[f64; 6])> = dots.collect();
    let x = Axis::over(label, dots.iter().map(|dot| dot.0));
    let curve = |compliance: &Compliance, place: usize| -> Vec<[f64; 2]> {
        let at = |k: usize| {
            let tilt = x.min + (x.max - x.min) * k as f64 / CURVE as f64;
            let mut now = compliance.mean_load;
            now[load] = tilt.to_radians().sin() * if load == 1 { upward } else { 1.0 };
            [tilt, compliance.offset(&now)[place] * kind.factor]
        };
        (0..=CURVE).map(at).collect()
    };
    let places = kind.first..kind.first + 3;
    let curves = places.map(|place| compliance.map_or(Vec::new(), |c| curve(c, place)));
    let curves: Vec<Vec<[f64; 2]>> = curves.collect();
    let offsets = dots
        .iter()
        .flat_map(|(_, offset)| &offset[kind.first..kind.first + 3]);
    let values = offsets.map(|offset| offset * kind.factor);
    let drawn = curves.iter().flatten().map(|point| point[1]);
    let y = Axis::rounded(kind.label, values.chain(drawn).chain([0.0]));
    let mut plot = Plot::new(HALF, HEIGHT, x.clone(), y);
    for (i, curve) in curves.iter().enumerate() {
        let place = kind.first + i;
        let points = dots
            .iter()
            .map(|(tilt, offset)| [*tilt, offset[place] * kind.factor]);
        plot.dots(
            &format!("dot {}", series(i)),
            1.3,
            &points.collect::<Vec<_>>(),
        );
        plot.line(&series(i), curve);
    }
    plot.finish(&format!("{} against {label}", kind.label))
}
