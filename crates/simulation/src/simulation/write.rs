//! Writes a simulated campaign: the files that a field crew would bring home, and the truth.

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::aiding::{simulate_heading, simulate_prism};
use super::deformation::Mountings;
use super::describe;
use super::drive::Drive;
use super::inertial::simulate_imu;
use super::recordings::Robot;
use super::reference::Reference;
use super::scenario::Scenario;
use super::scene::Scene;
use crate::error::Result;
use crate::format;
use crate::geometry::Vec3;
use crate::output::Staging;
use crate::progress::Progress;

/// The file with all keys of the scenario.
const SCENARIO: &str = "scenario.toml";
/// The file of the reference.
const REFERENCE: &str = "tls.laz";

/// Strips of the reference generated at a time.
const STRIPS_AT_ONCE: usize = 64;

/// Start of the first drive, seconds of the day.
const FIRST_DRIVE_S: f64 = 36_000.0;
/// Interval between the starts of drives, seconds.
const DRIVE_EVERY_S: f64 = 1_200.0;

/// The files written.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulatedFiles {
    /// One entry per drive; the project of the first drive evaluates the others.
    pub drives: Vec<SimulatedDrive>,
    /// The reference cloud, if there is one.
    pub reference: Option<SimulatedReference>,
}

/// The reference cloud.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulatedReference {
    /// The file.
    pub file: PathBuf,
    /// Number of its points.
    pub points: u64,
}

/// The files of one drive.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulatedDrive {
    /// Its folder.
    pub folder: PathBuf,
    /// Its project file.
    pub project: PathBuf,
    /// Its duration, seconds.
    pub duration_s: f64,
    /// Number of profiles of all profile scanners.
    pub profiles: u64,
    /// Number of points of all scanners.
    pub points: u64,
}

/// Names of the files and folders that [`simulate`] writes into its folder.
pub fn output_names(scenario: &Scenario) -> Vec<String> {
    let reference = scenario.reference.enabled.then(|| REFERENCE.to_owned());
    let drives = (0..scenario.drives.len()).map(describe::drive_name);
    [SCENARIO.to_owned()]
        .into_iter()
        .chain(reference)
        .chain(drives)
        .collect()
}

/// Simulates the scenario and writes it into the folder `out`: `drive-1`, `drive-2`, … with logs,
/// recordings and `project.toml`, each with a folder `truth` that contains the trajectory, the mounting,
/// the scene and, if there are any, the errors that the project does not state; next to them `tls.laz`
/// and `scenario.toml`. The same scenario gives the same bytes for any number of threads. Memory is
/// bounded for any number of points.
///
/// # Errors
/// An invalid scenario; a folder that cannot be written.
pub fn simulate(
    scenario: &Scenario,
    out: &Path,
    progress: &dyn Progress,
) -> Result<SimulatedFiles> {
    scenario.check()?;
    let inputs: Vec<PathBuf> = scenario.file.iter().cloned().collect();
    let staging = Staging::new(out, &inputs, &[SCENARIO, REFERENCE])?;
    let scene = Scene::new(scenario);
    let mut drives = Vec::with_capacity(scenario.drives.len());
    for index in 0..scenario.drives.len() {
        let start_s = FIRST_DRIVE_S + index as f64 * DRIVE_EVERY_S;
        let drive = Drive::new(scenario, &scene, index, start_s);
        let name = describe::drive_name(index);
        let at = |file: &str| staging.path(&format!("{name}/{file}"));
        write_logs(scenario, &drive, index, &at)?;
        describe::write_texts(scenario, &scene, &drive, index, &at)?;
        let robot = Robot {
            scenario,
            scene: &scene,
            drive: &drive,
            index,
        };
        let (profiles, points) = robot.write_profiles(&at, progress)?;
        let lidar_points = robot.write_revolutions(&at, progress)?;
        let folder = out.join(&name);
        drives.push(SimulatedDrive {
            project: folder.join("project.toml"),
            folder,
            duration_s: drive.span_s.1 - drive.span_s.0,
            profiles,
            points: points + lidar_points,
        });
    }
    let reference = if scenario.reference.enabled {
        let points = write_reference(scenario, &scene, &staging.path(REFERENCE), progress)?;
        Some(SimulatedReference {
            file: out.join(REFERENCE),
            points,
        })
    } else {
        None
    };
    describe::write_text(&staging.path(SCENARIO), &describe::scenario(scenario)?)?;
    staging.commit()?;
    Ok(SimulatedFiles { drives, reference })
}

/// Writes the logs of IMU, prism and heading, and the true trajectory.
fn write_logs(
    scenario: &Scenario,
    drive: &Drive,
    index: usize,
    at: &dyn Fn(&str) -> PathBuf,
) -> Result<()> {
    let imu = simulate_imu(scenario, drive, index);
    format::write_imu(&at("imu.csv"), &imu.samples)?;
    format::write_trajectory(&at("truth/trajectory.csv"), &imu.truth)?;
    format::write_positions(&at("prism.csv"), &simulate_prism(scenario, drive, index))?;
    if scenario.heading.enabled {
        format::write_heading(
            &at("heading.csv"),
            &simulate_heading(scenario, drive, index),
        )?;
    }
    if scenario.deformation.enabled {
        write_deformation(scenario, drive, at)?;
    }
    Ok(())
}

/// Writes the true mounting of every scanner ten times a second and, if the frame warms up, the log of a
/// thermometer.
fn write_deformation(
    scenario: &Scenario,
    drive: &Drive,
    at: &dyn Fn(&str) -> PathBuf,
) -> Result<()> {
    use std::fmt::Write;
    let mountings = Mountings::new(scenario, drive);
    if scenario.deformation.warms() {
        let mut text = String::from("time_s,temperature_c\n");
        let (start, end) = drive.span_s;
        for k in 0..=(end - start) as usize {
            let time_s = start + k as f64;
            let _ = writeln!(text, "{time_s:.1},{:.2}", mountings.temperature_c(time_s));
        }
        describe::write_text(&at(describe::FRAME_LOG), &text)?;
    }
    for (scanner, settings) in scenario.scanners.iter().enumerate() {
        let mut text = String::from("time_s,x_m,y_m,z_m,qx,qy,qz,qw\n");
        let (start, end) = drive.moving_s;
        for k in 0..((end - start) * 10.0) as usize {
            let time_s = start + k as f64 * 0.1;
            let mounting = mountings.body_from_scanner(scanner, time_s, &drive.at(time_s));
            let (t, q) = (mounting.translation_m, mounting.rotation.coords);
            // Writing to a string cannot fail.
            let _ = writeln!(
                text,
                "{time_s:.3},{:.7},{:.7},{:.7},{:.10},{:.10},{:.10},{:.10}",
                t.x, t.y, t.z, q.x, q.y, q.z, q.w
            );
        }
        describe::write_text(&at(&format!("truth/mounting-{}.csv", settings.name)), &text)?;
    }
    Ok(())
}

/// Writes the reference cloud and returns its number of points.
fn write_reference(
    scenario: &Scenario,
    scene: &Scene,
    path: &Path,
    progress: &dyn Progress,
) -> Result<u64> {
    let reference = Reference::new(scenario, scene);
    let mut writer = format::CloudWriter::create(path, Vec3::zeros())?;
    let stage = progress.stage("simulating the reference", reference.strips() as u64);
    let mut points = 0;
    for from in (0..reference.strips()).step_by(STRIPS_AT_ONCE) {
        let to = reference.strips().min(from + STRIPS_AT_ONCE);
        let strips: Vec<Vec<Vec3>> = (from..to)
            .into_par_iter()
            .map(|k| reference.strip(k))
            .collect();
        for point in strips.iter().flatten() {
            writer.write(point, 0.0, 0.0, 0)?;
            points += 1;
        }
        stage.advance((to - from) as u64)?;
    }
    writer.finish()?;
    Ok(points)
}
