//! Tables over many drives.

use boresight::geometry::Vec3;
use boresight::nalgebra::{DMatrix, SymmetricEigen};
use boresight::statistics::{NORMAL_97_5, chi_square, mean, rms};

use super::joint_drive::{Outcome, Run, SIX};

/// Normal quantile of the two-sided 99 % interval.
const NORMAL_99_5: f64 = 2.575_829_303_548_901;

/// Parameters of a mounting: tx ty tz rx ry rz.
const NAMES: [&str; SIX] = ["tx mm", "ty mm", "tz mm", "rx °", "ry °", "rz °"];

/// Factor of a parameter from metres to millimetres or from radians to degrees.
fn unit(parameter: usize) -> f64 {
    if parameter % SIX < 3 {
        1e3
    } else {
        1f64.to_degrees()
    }
}

fn list(values: impl Iterator<Item = f64>, digits: usize) -> String {
    values
        .map(|x| format!("{x:.digits$}"))
        .collect::<Vec<_>>()
        .join(" ")
}

fn millimetres(metres: f64) -> String {
    format!("{:.3}", 1e3 * metres)
}

/// Prints both methods' errors of one drive in a few lines.
pub fn print_seed(case: &str, seed: u64, run: &Run) {
    let [two, one] = run.errors();
    let sigmas = run.sigmas();
    let scaled = |values: &[f64]| list(values.iter().enumerate().map(|(i, x)| x * unit(i)), 4);
    println!("{case} seed {seed} two   {}", scaled(two.as_slice()));
    println!("{case} seed {seed} joint {}", scaled(one.as_slice()));
    println!("{case} seed {seed} sigma {}", scaled(sigmas.as_slice()));
    let [_, relative] = run.relative_errors();
    println!(
        "{case} seed {seed} right relative to left {}",
        scaled(relative.as_slice())
    );
    let normalised = one.component_div(&sigmas);
    println!(
        "{case} seed {seed} normalised {} chi-square {:.1}; relative {}",
        list(normalised.iter().copied(), 2),
        run.chi_square().unwrap_or(f64::NAN),
        list(
            relative
                .component_div(&run.relative_sigmas())
                .iter()
                .copied(),
            2
        ),
    );
    let joint = &run.joint;
    let groups = joint.groups.iter().filter_map(|group| {
        Some(format!(
            "{} {:.3} of {:.0}",
            group.name, group.ratio?, group.redundancy
        ))
    });
    println!(
        "{case} seed {seed} ratios {}",
        groups.collect::<Vec<_>>().join(", ")
    );
    for constant in &joint.constants {
        let sigma = constant.sigma.unwrap_or(f64::NAN);
        println!(
            "{case} seed {seed} {} {:.6} ± {sigma:.6} {}",
            constant.name, constant.value, constant.unit
        );
    }
    for (value, sigma) in joint.late_s.iter().flatten() {
        println!(
            "{case} seed {seed} scanner late {:.3} ± {:.3} ms",
            value * 1e3,
            sigma * 1e3
        );
    }
    println!(
        "{case} seed {seed} poses {:.3} {:.3} points {:.3} {:.3} gap {:.3} {:.3} mm; {} iterations, {} rows, {} surfels, {} unknowns, {}; {:.1} {:.1} s",
        run.two_steps.poses_m * 1e3,
        run.one_piece.poses_m * 1e3,
        run.two_steps.points_m * 1e3,
        run.one_piece.points_m * 1e3,
        run.two_steps.gap_m * 1e3,
        run.one_piece.gap_m * 1e3,
        joint.iterations,
        joint.rows,
        joint.surfels,
        joint.unknowns,
        joint.stop,
        run.two_steps.seconds,
        run.one_piece.seconds,
    );
    println!(
        "{case} seed {seed} distances to the reference {} {}, exact {} mm",
        millimetres(run.two_steps.distances_m[0]),
        millimetres(run.one_piece.distances_m[0]),
        millimetres(run.one_piece.distances_m[1]),
    );
    let [error, sigma] = [0, 1].map(|which| {
        let of = |axis: usize| rms(run.points.iter().map(|point| point[which][axis]));
        list((0..3).map(|axis| 1e3 * of(axis)), 3)
    });
    println!(
        "{case} seed {seed} points east, north, up {error} of {sigma} mm expected, {:.1} % within 95 % intervals",
        1e2 * inside(&run.points)
    );
    for drive in &joint.drives {
        println!(
            "{case} seed {seed} motion left in scans {:.2}",
            drive.motion_left
        );
    }
    for blocks in joint.drives.iter().flat_map(|drive| &drive.positions) {
        println!(
            "{case} seed {seed} {} means over {:.0} s: {} sigma",
            blocks.sensor,
            blocks.block_s,
            list(blocks.rms.iter().copied(), 2)
        );
    }
    if let Some(found) = &run.evaluation {
        let list = |of: fn(&Outcome) -> f64| list(found.iter().map(|found| of(found) * 1e3), 3);
        println!(
            "{case} seed {seed} another drive, mountings of two steps, of joint, and adjusted: poses {} points {} mm",
            list(|found| found.poses_m),
            list(|found| found.points_m),
        );
    }
    for jump in joint.drives.iter().flat_map(|drive| &drive.jumps) {
        println!(
            "{case} seed {seed} scanner {} jumped between {:.1} and {:.1} s by {} mm, sigma {}",
            jump.scanner + 1,
            jump.between_s[0],
            jump.between_s[1],
            list(jump.step[3..].iter().map(|m| 1e3 * m), 2),
            list(jump.sigma[3..].iter().map(|m| 1e3 * m), 2),
        );
    }
    for climb in &joint.ladder {
        println!(
            "{case} seed {seed} not {}: {}",
            climb.rung.name(),
            climb.reasons.join("; ")
        );
    }
    for region in &joint.regions {
        println!("{case} seed {seed} {}", region.describe(&Vec3::zeros()));
    }
    for reason in &run.refused {
        println!("{case} seed {seed} refused: {reason}");
    }
}

/// Share of all coordinates within their 95 % intervals.
fn inside(points: &[[Vec3; 2]]) -> f64 {
    let all = points
        .iter()
        .flat_map(|[error, sigma]| error.iter().zip(sigma));
    let within: Vec<f64> = all
        .map(|(e, s)| f64::from(e.abs() < NORMAL_97_5 * s))
        .collect();
    mean(&within)
}

/// Prints normalised errors along the eigenvectors of the correlation matrix. They show a wrong combination of
/// parameters that single parameters do not show.
pub fn print_directions(run: &Run) {
    let covariance = &run.joint.covariance;
    let sigmas = run.sigmas();
    let [_, error] = run.errors();
    let error = error.component_div(&sigmas);
    let size = covariance.nrows();
    let correlation = DMatrix::from_fn(size, size, |i, j| {
        covariance[(i, j)] / (sigmas[i] * sigmas[j])
    });
    let eigen = SymmetricEigen::new(correlation);
    for (value, vector) in eigen
        .eigenvalues
        .iter()
        .zip(eigen.eigenvectors.column_iter())
    {
        println!(
            "   eigenvalue {value:.2e} normalised {:.2}: {}",
            vector.dot(&error) / value.sqrt(),
            list(vector.iter().copied(), 2)
        );
    }
}

/// The results of all drives of a case.
pub struct Summary {
    case: String,
    /// For each drive: errors of 18 parameters (left, right, right relative to left) by two steps and by
    /// the joint adjustment, and their sigmas.
    parameters: Vec<[Vec<f64>; 3]>,
    chi_squares: Vec<f64>,
    /// Errors of poses and points by both methods, millimetres.
    places: Vec<[f64; 4]>,
    /// Names and ratios of the groups, and the root mean squares over all axes of the positions' means
    /// over blocks.
    ratios: Vec<Vec<(String, f64)>>,
    refused: usize,
    iterations: Vec<f64>,
    seconds: Vec<[f64; 2]>,
    /// For each drive, its constants: name with unit, value, sigma.
    constants: Vec<Vec<(String, f64, f64)>>,
}

impl Summary {
    pub fn new(case: &str) -> Self {
        Self {
            case: case.into(),
            parameters: Vec::new(),
            chi_squares: Vec::new(),
            places: Vec::new(),
            ratios: Vec::new(),
            refused: 0,
            iterations: Vec::new(),
            seconds: Vec::new(),
            constants: Vec::new(),
        }
    }

    pub fn add(&mut self, run: &Run) {
        let [two, one] = run.errors();
        let [two_relative, one_relative] = run.relative_errors();
        let both = |a: &[f64], b: &[f64]| [a, b].concat();
        self.parameters.push([
            both(two.as_slice(), two_relative.as_slice()),
            both(one.as_slice(), one_relative.as_slice()),
            both(run.sigmas().as_slice(), run.relative_sigmas().as_slice()),
        ]);
        self.chi_squares.extend(run.chi_square());
        let (two, one) = (&run.two_steps, &run.one_piece);
        let places = [two.poses_m, one.poses_m, two.points_m, one.points_m];
        self.places.push(places.map(|x| x * 1e3));
        let groups = run.joint.groups.iter();
        let ratios = groups.filter_map(|group| Some((group.name.clone(), group.ratio?)));
        let blocks = run.joint.drives.iter().flat_map(|drive| &drive.positions);
        let blocks = blocks.map(|b| {
            let name = format!(
                "{}, root mean square of means over {:.0} s",
                b.sensor, b.block_s
            );
            (name, rms(b.rms))
        });
        self.ratios.push(ratios.chain(blocks).collect());
        self.refused += usize::from(!run.refused.is_empty());
        self.iterations.push(run.joint.iterations as f64);
        self.seconds.push([two.seconds, one.seconds]);
        let constants = run.joint.constants.iter().map(|constant| {
            let sigma = constant.sigma.unwrap_or(f64::NAN);
            (
                format!("{} ({})", constant.name, constant.unit),
                constant.value,
                sigma,
            )
        });
        let late = run
            .joint
            .late_s
            .iter()
            .enumerate()
            .filter_map(|(scanner, late)| {
                let (value, sigma) = (*late)?;
                Some((format!("scanner {} late (s)", scanner + 1), value, sigma))
            });
        self.constants.push(constants.chain(late).collect());
    }

    /// A value of [`Self::parameters`] for all drives.
    fn column(&self, method: usize, parameter: usize) -> Vec<f64> {
        let of_each = self.parameters.iter();
        of_each.map(|drive| drive[method][parameter]).collect()
    }

    pub fn print(&self) {
        let count = self.parameters.len();
        if count == 0 {
            return;
        }
        println!("\n### {}, {count} drives\n", self.case);
        println!("| parameter | two steps | joint | gain | sigma | normalised | mean |");
        println!("|---|---:|---:|---:|---:|---:|---:|");
        let mut normalised = Vec::new();
        for parameter in 0..3 * SIX {
            let scanner = ["left", "right", "right to left"][parameter / SIX];
            let [two, one, sigma] = [0, 1, 2].map(|method| self.column(method, parameter));
            let own: Vec<f64> = one.iter().zip(&sigma).map(|(e, s)| e / s).collect();
            let size = |values: &[f64]| rms(values.iter().copied()) * unit(parameter);
            let digits = if parameter % SIX < 3 { 3 } else { 4 };
            println!(
                "| {scanner} {} | {:.digits$} | {:.digits$} | {:.1} | {:.digits$} | {:.2} | {:+.2} |",
                NAMES[parameter % SIX],
                size(&two),
                size(&one),
                size(&two) / size(&one),
                size(&sigma),
                rms(own.iter().copied()),
                mean(&own),
            );
            if parameter < 2 * SIX {
                normalised.extend(own);
            }
        }
        let inside = normalised.iter().filter(|x| x.abs() < NORMAL_97_5).count();
        let degrees = (2 * SIX * self.chi_squares.len()) as f64;
        let [low, high] = [-NORMAL_99_5, NORMAL_99_5].map(|z| chi_square(degrees, z));
        println!(
            "\nNormalised errors of both mountings: RMS {:.3}, {:.1} % within 95 % intervals, largest \
             mean allowed {:.2}; sum of χ² {:.0}, 99 % within {low:.0} to {high:.0}.",
            rms(normalised.iter().copied()),
            1e2 * inside as f64 / normalised.len() as f64,
            3.0 / (count as f64).sqrt(),
            self.chi_squares.iter().sum::<f64>(),
        );
        let place = |i: usize| rms(self.places.iter().map(|p| p[i]));
        println!(
            "Poses in the field {:.2} → {:.2} mm, points {:.2} → {:.2} mm; {:.1} iterations; \
             two steps {:.1} s, joint {:.1} s.",
            place(0),
            place(1),
            place(2),
            place(3),
            mean(&self.iterations),
            mean(&self.seconds.iter().map(|s| s[0]).collect::<Vec<_>>()),
            mean(&self.seconds.iter().map(|s| s[1]).collect::<Vec<_>>()),
        );
        println!("Refused: {} of {count}.", self.refused);
        for (name, _) in &self.ratios[0] {
            let of_each = self.ratios.iter().flatten();
            let found: Vec<f64> = of_each
                .filter(|(n, _)| n == name)
                .map(|(_, r)| *r)
                .collect();
            let least = found.iter().copied().fold(f64::INFINITY, f64::min);
            let most = found.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            println!("{name}: {:.3}, {least:.3} to {most:.3}.", mean(&found));
        }
        for (place, (name, ..)) in self.constants[0].iter().enumerate() {
            let of = |f: fn(&(String, f64, f64)) -> f64| -> Vec<f64> {
                self.constants
                    .iter()
                    .filter_map(|all| all.get(place).map(f))
                    .collect()
            };
            let (values, sigmas) = (of(|c| c.1), of(|c| c.2));
            let middle = mean(&values);
            println!(
                "{name}: mean {middle:.6}, scatter {:.6}, sigma {:.6}.",
                rms(values.iter().map(|v| v - middle)),
                rms(sigmas),
            );
        }
    }
}
