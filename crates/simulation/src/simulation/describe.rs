//! The text files of a simulated campaign: projects, true mountings, scene, errors, scenario.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use super::drive::Drive;
use super::field::Pass;
use super::scenario::Scenario;
use super::scene::Scene;
use super::sensors::{ScannerKind, ScannerSettings};
use crate::error::{Error, Result};
use crate::geometry::euler::euler_deg_from_rotation;
use crate::geometry::{BodyFromScanner, EulerConvention, Vec3};

/// The log of the frame's temperature.
pub const FRAME_LOG: &str = "frame.csv";

/// The folder of a drive.
pub(super) fn drive_name(index: usize) -> String {
    format!("drive-{}", index + 1)
}

/// The file of a scanner's points.
pub(super) fn recording_name(scanner: &ScannerSettings) -> String {
    let extension = match scanner.kind {
        ScannerKind::Profile => "bin",
        ScannerKind::Lidar => "csv",
    };
    format!("{}.{extension}", scanner.name)
}

/// Writes `text` into a file.
pub(super) fn write_text(path: &Path, text: &str) -> Result<()> {
    std::fs::write(path, text).map_err(|e| Error::io(path, e))
}

/// Writes the project, true mounting, scene and errors of one drive.
pub(super) fn write_texts(
    scenario: &Scenario,
    scene: &Scene,
    drive: &Drive,
    index: usize,
    at: &dyn Fn(&str) -> PathBuf,
) -> Result<()> {
    write_text(&at("project.toml"), &project(scenario, index))?;
    write_text(&at("truth/mounting.toml"), &mounting(scenario))?;
    write_text(&at("truth/scene.toml"), &scene_text(scenario, scene, index))?;
    let errors = errors(scenario, drive.span_s.0);
    if errors.is_empty() {
        return Ok(());
    }
    let text = format!("# Errors that the project does not state.\n{errors}");
    write_text(&at("truth/errors.toml"), &text)
}

/// The scenario with every value.
pub(super) fn scenario(scenario: &Scenario) -> Result<String> {
    toml::to_string(scenario)
        .map_err(|e| Error::data(format!("the scenario cannot be written: {e}"), "correct it"))
}

/// A project as a user would write it: datasheets, a measured lever arm, an initial mounting.
fn project(scenario: &Scenario, index: usize) -> String {
    let body = match scenario.body {
        crate::geometry::BodyAxes::Frd => "FRD",
        crate::geometry::BodyAxes::Flu => "FLU",
    };
    let (imu, prism, heading) = (&scenario.imu, &scenario.prism, &scenario.heading);
    let mut text = format!(
        "# Simulated: {} of scenario {:?}, seed {}.\n\
         [frame]\nbody = \"{body}\"\ngravity_m_s2 = {:?}\n\n\
         [imu]\nfile = \"imu.csv\"\n\
         gyro_noise_deg_sqrt_h = {:?}\naccel_noise_ug_sqrt_hz = {:?}\n\
         gyro_bias_instability_deg_h = {:?}\naccel_bias_instability_ug = {:?}\n\n\
         [prism]\nfile = \"prism.csv\"\nsigma_m = {:?}\nlever_arm_m = {}\nsigma_lever_arm_m = 0.0\n",
        drive_name(index),
        scenario.name,
        scenario.seed,
        scenario.gravity_m_s2,
        imu.gyro_noise_deg_sqrt_h,
        imu.accel_noise_ug_sqrt_hz,
        imu.gyro_bias_instability_deg_h,
        imu.accel_bias_instability_ug,
        prism.sigma_m,
        list(&scenario.lever_arm_m(), 6),
    );
    let stated = scenario.project.states_errors;
    if stated {
        text += &unless_zero("time_offset_s", -prism.latency_s);
        text += &lasting(
            "sigma_correlated_m",
            prism.sigma_correlated_m,
            prism.correlation_s,
        );
    }
    if heading.enabled {
        text += &format!(
            "\n[heading]\nfile = \"heading.csv\"\nsigma_deg = {:?}\nmounting_offset_deg = {:?}\n",
            heading.sigma_deg, heading.mounting_offset_deg
        );
        if stated {
            text += &unless_zero("time_offset_s", -heading.latency_s);
            text += &lasting(
                "sigma_correlated_deg",
                heading.sigma_correlated_deg,
                heading.correlation_s,
            );
        }
    }
    for (scanner, initial) in scenario.scanners.iter().zip(scenario.initial_mountings()) {
        text += &scanner_table(&scanner.name, Some(&recording_name(scanner)), &initial, 6);
    }
    if scenario.deformation.warms() {
        text += &format!("\n[bending]\nfile = \"{FRAME_LOG}\"\ncolumns = [\"temperature_c\"]\n");
    }
    if scenario.reference.enabled {
        text += "\n[reference]\nfile = \"../tls.laz\"\n";
        if scenario.project.sigma_reference_m > 0.0 {
            text += &format!(
                "sigma_m = {:?}\nsigma_deg = 0.0\n",
                scenario.project.sigma_reference_m
            );
        }
    }
    let sizes = &scenario.project.voxel_sizes_m;
    if !sizes.is_empty() {
        text += &format!("\n[calibration]\nvoxel_sizes_m = {sizes:?}\nneighbours = 50\n");
    }
    if index == 0 {
        for other in 1..scenario.drives.len() {
            let name = drive_name(other);
            text += &format!(
                "\n[[evaluation]]\nname = \"{name}\"\nproject = \"../{name}/project.toml\"\n"
            );
        }
    }
    text
}

/// The true mountings, without deformation.
fn mounting(scenario: &Scenario) -> String {
    let mut text =
        String::from("# True mountings; with deformation, those of the robot at rest.\n");
    for (scanner, truth) in scenario.scanners.iter().zip(scenario.true_mountings()) {
        text += &scanner_table(&scanner.name, None, &truth, 10);
    }
    text
}

/// The errors beyond white noise of the logs of a drive that starts at `start_s`, and of the reference, as
/// TOML.
fn errors(scenario: &Scenario, start_s: f64) -> String {
    let (prism, heading) = (&scenario.prism, &scenario.heading);
    let mut keys = unless_zero("latency_s", prism.latency_s);
    keys += &unless_zero("incidence_bias_m", prism.incidence_bias_m);
    keys += &lasting(
        "sigma_correlated_m",
        prism.sigma_correlated_m,
        prism.correlation_s,
    );
    if !prism.lost_s.is_empty() {
        let spans = prism.lost_s.iter();
        let spans: Vec<_> = spans.map(|span| span.map(|s| start_s + s)).collect();
        keys += &format!("# On the time scale of the trajectory.\nlost_s = {spans:?}\n");
    }
    if prism.outlier_share != 0.0 {
        keys += &format!(
            "outlier_share = {:?}\noutlier_m = {:?}\n",
            prism.outlier_share, prism.outlier_m
        );
    }
    if prism.displaced_m != [0.0; 3] {
        let span_s = prism.displaced_s.map(|s| start_s + s);
        keys += &format!(
            "displaced_m = {:?}\ndisplaced_s = {span_s:?}\n",
            prism.displaced_m
        );
    }
    keys += &unless_zero("clock_ppm", prism.clock_ppm);
    let mut text = table("[imu]", &unless_zero("gyro_scale", scenario.imu.gyro_scale));
    text += &table("[prism]", &keys);
    let mut keys = unless_zero("latency_s", heading.latency_s);
    keys += &lasting(
        "sigma_correlated_deg",
        heading.sigma_correlated_deg,
        heading.correlation_s,
    );
    text += &table("[heading]", &keys);
    for scanner in &scenario.scanners {
        let keys = unless_zero("latency_s", scanner.latency_s)
            + &unless_zero("range_offset_m", scanner.range_offset_m);
        if !keys.is_empty() {
            text += &table("[[scanner]]", &format!("name = {:?}\n{keys}", scanner.name));
        }
    }
    let reference = &scenario.reference;
    let mut keys = String::new();
    if reference.offset_m != [0.0; 3] {
        keys += &format!("offset_m = {:?}\n", reference.offset_m);
    }
    if reference.surface_error_m != 0.0 {
        keys += &format!(
            "surface_error_m = {:?}\nsurface_error_scale_m = {:?}\n",
            reference.surface_error_m, reference.surface_error_scale_m
        );
    }
    text + &table("[reference]", &keys)
}

/// The keys of errors that last; empty if there are none.
fn lasting(key: &str, sigma: f64, correlation_s: f64) -> String {
    if sigma == 0.0 {
        return String::new();
    }
    format!("{key} = {sigma:?}\ncorrelation_s = {correlation_s:?}\n")
}

/// A key with its value; empty if it is zero.
fn unless_zero(key: &str, value: f64) -> String {
    if value == 0.0 {
        return String::new();
    }
    format!("{key} = {value:?}\n")
}

/// A table with these keys; empty if there are none.
fn table(header: &str, keys: &str) -> String {
    if keys.is_empty() {
        return String::new();
    }
    format!("\n{header}\n{keys}")
}

fn scanner_table(
    name: &str,
    profiles: Option<&str>,
    mounting: &BodyFromScanner,
    digits: usize,
) -> String {
    let angles = euler_deg_from_rotation(EulerConvention::Bonn, &mounting.rotation);
    let profiles = profiles.map_or(String::new(), |p| format!("profiles = {p:?}\n"));
    format!(
        "\n[[scanner]]\nname = {name:?}\n{profiles}translation_m = {}\nrotation_deg = {}\n\
         rotation_convention = \"bonn\"\n",
        list(&mounting.translation_m, digits),
        list(&Vec3::from(angles), digits),
    )
}

/// Field, clods, plants, boards and the passes of one drive.
fn scene_text(scenario: &Scenario, scene: &Scene, index: usize) -> String {
    let mut text = format!(
        "# The field extends from the origin to size_m (east, north).\n[field]\nsize_m = {:?}\n",
        scene.size_m
    );
    let soil = &scenario.soil;
    if soil.clod_height_m != 0.0 {
        text += &table(
            "[soil]",
            &format!(
                "clod_height_m = {:?}\nclod_size_m = {:?}\nclod_cover = {:?}\n",
                soil.clod_height_m, soil.clod_size_m, soil.clod_cover
            ),
        );
    }
    let plants = &scenario.plants;
    if plants.count_per_m2 != 0.0 {
        text += &table(
            "[plants]",
            &format!(
                "count_per_m2 = {:?}\nheight_m = {:?}\nleaf_m = {:?}\nsway_m = {:?}\n",
                plants.count_per_m2, plants.height_m, plants.leaf_m, plants.sway_m
            ),
        );
    }
    for (board, settings) in scene.boards.iter().zip(&scenario.boards) {
        let [a, b] = board.half_m;
        let corners = [(a, b), (-a, b), (-a, -b), (a, -b)]
            .map(|(u, v)| list(&board.point_m(u, v), 9))
            .join(", ");
        let moved = Vec3::from(settings.moved_m);
        let moved = if moved == Vec3::zeros() {
            String::new()
        } else {
            format!(
                "# Displacement since the reference scan.\nmoved_m = {}\n",
                list(&moved, 9)
            )
        };
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "\n[[board]]\ncenter_m = {}\nnormal = {}\ntilt_deg = {:?}\nazimuth_deg = {:?}\n\
             corners_m = [{corners}]\n{moved}",
            list(&board.center_m, 9),
            list(&board.normal, 12),
            settings.tilt_deg,
            settings.azimuth_deg,
        );
    }
    for pass in &scenario.drives[index].passes {
        text += &match pass {
            Pass::Board { board, heading_deg } => {
                format!("\n[[pass]]\nboard = {board}\nheading_deg = {heading_deg:?}\n")
            }
            Pass::Line { from_m, to_m } => {
                format!("\n[[pass]]\nfrom_m = {from_m:?}\nto_m = {to_m:?}\n")
            }
        };
    }
    text
}

/// A TOML list of three numbers, without negative zeros.
fn list(v: &Vec3, digits: usize) -> String {
    let unit = 10f64.powi(digits as i32);
    let [x, y, z] = [v.x, v.y, v.z].map(|c| (c * unit).round() / unit + 0.0);
    format!("[{x:?}, {y:?}, {z:?}]")
}
