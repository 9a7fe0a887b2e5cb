//! A small drive with its truth, and ways to damage its files.

use std::fs;
use std::path::{Path, PathBuf};

use boresight::error::Result;
use boresight::format;
use boresight::geometry::{BodyFromScanner, Vec3};
use boresight::pipeline::{Extras, Findings, Options, analyse};
use boresight::progress::Silent;
use boresight::project::Project;
use boresight::simulation::{Scenario, simulate};

use super::moving::mountings_in;

/// Three boards on a small field, each scanned in two directions.
const SCENARIO: &str = r#"
name = "small"
boards = [
    { center_m = [1.2, 1.2, 0.5], tilt_deg = 30.0, azimuth_deg = 70.0, size_m = [1.0, 1.0] },
    { center_m = [3.6, 1.2, 0.5], tilt_deg = 45.0, azimuth_deg = 190.0, size_m = [1.0, 1.0] },
    { center_m = [2.4, 2.9, 0.5], tilt_deg = 15.0, azimuth_deg = 310.0, size_m = [1.0, 1.0] },
]
drives = [{ passes = [
    { board = 0, heading_deg = 90.0 },
    { board = 1, heading_deg = 90.0 },
    { board = 2, heading_deg = 300.0 },
    { board = 0, heading_deg = 200.0 },
    { board = 1, heading_deg = 60.0 },
    { board = 2, heading_deg = 180.0 },
] }]
[field]
size_m = [4.8, 4.1]
margin_m = 5.0
[profiles]
rate_hz = 20.0
width = 240
[reference]
board_spacing_m = 0.005
soil_spacing_m = 0.008
"#;

/// A simulated drive in a folder.
pub struct Field {
    pub folder: PathBuf,
    pub truth: Vec<BodyFromScanner>,
}

impl Field {
    /// Simulates a drive with this seed and a changed scenario into `folder`.
    pub fn new(folder: &Path, seed: u64, change: impl Fn(&mut Scenario)) -> Self {
        let mut scenario: Scenario = toml::from_str(SCENARIO).unwrap();
        scenario.seed = seed;
        change(&mut scenario);
        let files = simulate(&scenario, folder, &Silent).unwrap();
        let field = Self {
            folder: files.drives[0].folder.clone(),
            truth: scenario.true_mountings(),
        };
        let sizes = "voxel_sizes_m = [0.05, 0.04, 0.03, 0.02, 0.01, 0.005]\nneighbours = 50";
        field.project(
            sizes,
            "voxel_sizes_m = [0.05, 0.03, 0.015]\nneighbours = 25",
        );
        field
    }

    /// True mountings of a scanner by time, if the frame bends.
    pub fn true_mountings(&self, scanner: &str) -> Vec<(f64, BodyFromScanner)> {
        mountings_in(&self.folder.join(format!("truth/mounting-{scanner}.csv"))).unwrap()
    }

    /// Runs the project as it is.
    pub fn run(&self) -> Result<Findings> {
        let project = Project::read(&self.folder.join("project.toml"))?;
        let options = Options {
            out: self.folder.join("out"),
            seed: None,
            fresh: false,
            kept: Vec::new(),
        };
        analyse(&project, &options, &Extras::default(), &Silent)
    }

    /// The largest error of a parameter in units of its standard deviation, of a position (metres) and of a rotation
    /// (degrees).
    pub fn errors(&self, findings: &Findings) -> [f64; 3] {
        let calibration = &findings.calibrations.result;
        let mut worst = [0.0_f64; 3];
        for (scanner, (mounting, truth)) in
            calibration.mountings.iter().zip(&self.truth).enumerate()
        {
            let (turn, shift) = mounting.body_from_scanner.perturbation_from(truth);
            for (parameter, error) in shift.iter().chain(turn.iter()).enumerate() {
                let place = 6 * scanner + parameter;
                let covariance = calibration.covariance.as_ref();
                let sigma = covariance.map_or(0.0, |all| all[(place, place)].sqrt());
                if sigma > 0.0 {
                    worst[0] = worst[0].max(error.abs() / sigma);
                }
                let kind = 1 + parameter / 3;
                let unit = if parameter < 3 {
                    1.0
                } else {
                    1f64.to_degrees()
                };
                worst[kind] = worst[kind].max(error.abs() * unit);
            }
        }
        worst
    }

    /// Changes the text of the project.
    pub fn project(&self, from: &str, to: &str) {
        let path = self.folder.join("project.toml");
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "no `{from}` in\n{text}");
        fs::write(&path, text.replacen(from, to, 1)).unwrap();
    }

    /// Moves the points of the reference.
    pub fn reference(&self, change: impl Fn(&mut Vec3)) {
        let folder = self.folder.parent().unwrap();
        let mut cloud = format::read_cloud(&folder.join("tls.laz")).unwrap();
        cloud.points.iter_mut().for_each(change);
        format::write_cloud_table(&folder.join("moved.csv"), &cloud).unwrap();
        self.project("../tls.laz", "../moved.csv");
    }

    /// Changes the rows of a log; columns in the order of the file.
    pub fn rows(&self, log: &str, change: impl Fn(&mut Vec<f64>)) {
        let path = self.folder.join(log);
        let text = fs::read_to_string(&path).unwrap();
        let mut lines = text.lines();
        let mut out = format!("{}\n", lines.next().unwrap());
        for line in lines {
            let mut row: Vec<f64> = line
                .split(',')
                .map(|cell| cell.trim().parse().unwrap())
                .collect();
            change(&mut row);
            let cells: Vec<String> = row.iter().map(f64::to_string).collect();
            out += &cells.join(",");
            out.push('\n');
        }
        fs::write(&path, out).unwrap();
    }
}
